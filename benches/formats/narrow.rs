//! 64-wide nodes with pointers of 16 bits where they fit.

use super::tree::{Link, Node, Tree, mirror_slot};
use super::walk::Format;

/// Where the walk keeps the flips of a node that it is in.
const FLIP_SHIFT: u32 = 29;

/// How the pointers of a node are stored; nodes of one form lie together in each height, in this order, so that the
/// place of a node tells its form.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Form {
    /// Mask, pointers of 16 bits, two a word.
    Narrow,
    /// Mask, mask of the narrow pointers, those (two a word), then the wide ones.
    Mixed,
    /// Mask, pointers of 32 bits.
    Wide,
}

/// In 32-bit words. A pointer counts from the start of the height below, in words (leaves: in masks); its top three bits
/// are flips if `MIRRORED`. Within a form, what is used most comes first.
///
/// Without `MIXED` a node has narrow pointers only if all of them fit.
pub struct Narrow<const MIXED: bool, const MIRRORED: bool> {
    words: Vec<u32>,
    /// Of each height; index 0 unused.
    heights: Vec<Height>,
    leaves: Vec<u64>,
    root: u32,
}

/// Where the nodes of a height start in the array, and their forms end, counted from there.
#[derive(Clone, Copy, Default)]
struct Height {
    start: u32,
    narrow_end: u32,
    mixed_end: u32,
}

impl<const MIXED: bool, const MIRRORED: bool> Narrow<MIXED, MIRRORED> {
    /// Bits of a narrow pointer that say where.
    const NARROW_BITS: u32 = if MIRRORED { 13 } else { 16 };
    const FLIPS: u32 = if MIRRORED { 7 << FLIP_SHIFT } else { 0 };

    pub fn pack(tree: &Tree) -> Self {
        assert!(tree.width == 2 && tree.leaf == 2);
        let by_use = tree.by_use(0);
        let leaves = by_use.iter().map(|&leaf| tree.leaves[leaf as usize]).collect();
        let mut places = vec![0; by_use.len()];
        by_use.iter().enumerate().for_each(|(place, &leaf)| places[leaf as usize] = place as u32);
        let mut words: Vec<u32> = Vec::new();
        let mut heights = vec![Height::default()];
        for (index, nodes) in tree.heights.iter().enumerate() {
            let forms: Vec<Form> = nodes.iter().map(|node| Self::form(node, &places)).collect();
            let mut order = tree.by_use(index + 1);
            order.sort_by_key(|&item| forms[item as usize]);
            let mut height = Height { start: words.len() as u32, ..Height::default() };
            let mut here = vec![0; nodes.len()];
            for item in order {
                let form = forms[item as usize];
                here[item as usize] = words.len() as u32 - height.start;
                Self::push(&mut words, &nodes[item as usize], form, &places);
                let end = words.len() as u32 - height.start;
                assert!(end < 1 << FLIP_SHIFT, "the pointers are too narrow");
                if form == Form::Narrow {
                    height.narrow_end = end;
                }
                if form <= Form::Mixed {
                    height.mixed_end = end;
                }
            }
            heights.push(height);
            places = here;
        }
        let root = u32::from(tree.root.flip) << FLIP_SHIFT | places[tree.root.to as usize];
        Narrow { words, heights, leaves, root }
    }

    fn fits(link: &Link, places: &[u32]) -> bool {
        places[link.to as usize] >> Self::NARROW_BITS == 0
    }

    /// The smallest form.
    fn form(node: &Node, places: &[u32]) -> Form {
        let narrow = node.links.iter().filter(|link| Self::fits(link, places)).count();
        // In words: two a pair of narrow pointers are saved, two a mask are spent.
        let saved = narrow - narrow.div_ceil(2);
        match () {
            () if narrow == node.links.len() => Form::Narrow,
            () if MIXED && saved > 2 => Form::Mixed,
            () => Form::Wide,
        }
    }

    fn push(words: &mut Vec<u32>, node: &Node, form: Form, places: &[u32]) {
        let halves = |mask: u64| [mask as u32, (mask >> 32) as u32];
        words.extend(halves(node.mask));
        let slots = (0..64).filter(|slot| node.mask >> slot & 1 == 1);
        let (narrow, wide): (Vec<_>, Vec<_>) =
            slots.zip(&node.links).partition(|(_, link)| form != Form::Wide && Self::fits(link, places));
        if form == Form::Mixed {
            words.extend(halves(narrow.iter().fold(0, |mask, (slot, _)| mask | 1 << slot)));
        }
        let pointer = |link: &Link, bits: u32| u32::from(link.flip) << (bits & 31) | places[link.to as usize];
        let pointers: Vec<u32> = narrow.iter().map(|(_, link)| pointer(link, Self::NARROW_BITS)).collect();
        words.extend(pointers.chunks(2).map(|pair| pair[0] | pair.get(1).map_or(0, |second| second << 16)));
        words.extend(wide.iter().map(|(_, link)| pointer(link, FLIP_SHIFT)));
    }

    /// A narrow pointer, the `index`-th of those from `at` on.
    #[inline(always)]
    fn narrow(&self, at: usize, index: usize) -> u32 {
        let half = self.words[at + index / 2] >> (index % 2 * 16) & 0xffff;
        if MIRRORED {
            half & ((1 << Self::NARROW_BITS) - 1) | half >> Self::NARROW_BITS << FLIP_SHIFT
        } else {
            half
        }
    }

    #[inline(always)]
    fn mask(&self, at: usize) -> u64 {
        u64::from(self.words[at]) | u64::from(self.words[at + 1]) << 32
    }
}

impl<const MIXED: bool, const MIRRORED: bool> Format for Narrow<MIXED, MIRRORED> {
    const WIDTH: u32 = 2;
    const LEAF: u32 = 2;

    fn root(&self) -> u32 {
        self.root
    }

    #[inline(always)]
    fn heights(&self) -> u32 {
        self.heights.len() as u32 - 1
    }

    #[inline(always)]
    fn child(&self, height: u32, node: u32, slot: u32) -> Option<u32> {
        let flips = node & Self::FLIPS;
        let place = node ^ flips;
        let slot = slot ^ mirror_slot::<2>(flips >> FLIP_SHIFT);
        let height = self.heights[height as usize];
        let at = (height.start + place) as usize;
        let mask = self.mask(at);
        if mask >> slot & 1 == 0 {
            return None;
        }
        let lower = (1u64 << slot) - 1;
        let rank = |mask: u64| (mask & lower).count_ones() as usize;
        let pointer = if place < height.narrow_end {
            self.narrow(at + 2, rank(mask))
        } else if MIXED && place < height.mixed_end {
            let narrow = self.mask(at + 2);
            if narrow >> slot & 1 == 1 {
                self.narrow(at + 4, rank(narrow))
            } else {
                self.words[at + 4 + narrow.count_ones().div_ceil(2) as usize + rank(mask & !narrow)]
            }
        } else {
            self.words[at + 2 + rank(mask)]
        };
        Some(pointer ^ flips)
    }

    #[inline(always)]
    fn leaf(&self, leaf: u32) -> u64 {
        self.leaves[(leaf & !Self::FLIPS) as usize]
    }

    #[inline(always)]
    fn leaf_flip(&self, leaf: u32) -> u32 {
        mirror_slot::<2>((leaf & Self::FLIPS) >> FLIP_SHIFT)
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.words) + size_of_val(&*self.leaves) + size_of_val(&*self.heights)
    }
}

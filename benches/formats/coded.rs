//! Octree nodes with pointers of 16 or 32 bits, a two-bit code for each slot: SSVDAG (Villanueva, Marton and Gobbetti
//! 2016), and the same without mirror images.

use super::tree::{Link, Tree, mirror_slot};
use super::walk::Format;

/// Where the walk keeps the flips of a node that it is in.
const FLIP_SHIFT: u32 = 29;

/// In 16-bit words: a header of eight codes (0 empty, 1 short pointer, 2 long pointer of two words), then the pointers.
/// A pointer counts from the start of the height below, in words (leaves: in masks); its top three bits are flips if
/// `MIRRORED`. What is used most comes first in each height, so that it can be pointed at in short.
///
/// The published form uses code 3 for one more bit of long pointers, which nothing here needs.
pub struct Coded<const MIRRORED: bool> {
    words: Vec<u16>,
    /// Start of each height; index 0 unused.
    starts: Vec<usize>,
    leaves: Vec<u64>,
    root: u32,
}

impl<const MIRRORED: bool> Coded<MIRRORED> {
    /// Bits of a short pointer that say where.
    const SHORT_BITS: u32 = if MIRRORED { 13 } else { 16 };
    const FLIPS: u32 = if MIRRORED { 7 << FLIP_SHIFT } else { 0 };

    pub fn pack(tree: &Tree) -> Self {
        assert!(tree.width == 1 && tree.leaf == 2);
        let by_use = tree.by_use(0);
        let leaves = by_use.iter().map(|&leaf| tree.leaves[leaf as usize]).collect();
        let mut places = vec![0; by_use.len()];
        by_use.iter().enumerate().for_each(|(place, &leaf)| places[leaf as usize] = place as u32);
        let mut words: Vec<u16> = Vec::new();
        let mut starts = vec![0];
        for (index, nodes) in tree.heights.iter().enumerate() {
            let start = words.len();
            let mut here = vec![0; nodes.len()];
            for item in tree.by_use(index + 1) {
                let node = &nodes[item as usize];
                let place = words.len() - start;
                assert!(place < 1 << FLIP_SHIFT, "the pointers are too narrow");
                here[item as usize] = place as u32;
                let header = words.len();
                words.push(0);
                for (slot, link) in (0..8).filter(|slot| node.mask >> slot & 1 == 1).zip(&node.links) {
                    let place = places[link.to as usize];
                    let is_short = place >> Self::SHORT_BITS == 0;
                    words[header] |= if is_short { 1 } else { 2 } << (2 * slot);
                    if is_short {
                        words.push(((u32::from(link.flip) << Self::SHORT_BITS) | place) as u16);
                    } else {
                        let pointer = pointer(link, place);
                        words.extend([pointer as u16, (pointer >> 16) as u16]);
                    }
                }
            }
            starts.push(start);
            places = here;
        }
        let root = pointer(&tree.root, places[tree.root.to as usize]);
        Coded { words, starts, leaves, root }
    }
}

fn pointer(link: &Link, place: u32) -> u32 {
    u32::from(link.flip) << FLIP_SHIFT | place
}

impl<const MIRRORED: bool> Format for Coded<MIRRORED> {
    const WIDTH: u32 = 1;
    const LEAF: u32 = 2;

    fn root(&self) -> u32 {
        self.root
    }

    #[inline(always)]
    fn heights(&self) -> u32 {
        self.starts.len() as u32 - 1
    }

    #[inline(always)]
    fn child(&self, height: u32, node: u32, slot: u32) -> Option<u32> {
        let flips = node & Self::FLIPS;
        let slot = slot ^ mirror_slot::<1>(flips >> FLIP_SHIFT);
        let at = self.starts[height as usize] + (node ^ flips) as usize;
        let codes = u32::from(self.words[at]);
        let code = codes >> (2 * slot) & 3;
        if code == 0 {
            return None;
        }
        // A code is the words of its pointer.
        let before = codes & ((1 << (2 * slot)) - 1);
        let skipped = (before & 0x5555).count_ones() + 2 * (before & 0xaaaa).count_ones();
        let at = at + 1 + skipped as usize;
        let low = u32::from(self.words[at]);
        let pointer = if code == 2 {
            low | u32::from(self.words[at + 1]) << 16
        } else if MIRRORED {
            low & ((1 << Self::SHORT_BITS) - 1) | low >> Self::SHORT_BITS << FLIP_SHIFT
        } else {
            low
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
        size_of_val(&*self.words) + size_of_val(&*self.leaves) + size_of_val(&*self.starts)
    }
}

//! Ours, with the leaf masks that are used once inside the node that uses them.

use super::tree::Tree;
use super::walk::Format;

/// A pointer to a node of height 1 that has masks inside, or to a mask inside a node.
const INSIDE: u32 = 1 << 31;

/// Nodes as ours. A node of height 1 that gains by it has a second mask, of the children that are leaf masks of two
/// words instead of indices; the pointer to it says so.
pub struct Inline {
    words: Vec<u32>,
    leaves: Vec<u64>,
    root: u32,
    heights: u32,
}

impl Inline {
    pub fn pack(tree: &Tree) -> Self {
        assert!(tree.width == 2 && tree.leaf == 2 && tree.heights.len() > 1);
        let halves = |mask: u64| [mask as u32, (mask >> 32) as u32];
        let uses = tree.uses(0);
        let mut words = Vec::new();
        let mut leaves = Vec::new();
        let mut index_of_leaf = vec![None; tree.leaves.len()];
        let mut places = Vec::new();
        for node in &tree.heights[0] {
            let is_single: Vec<bool> = node.links.iter().map(|link| uses[link.to as usize] == 1).collect();
            // A word an index is saved, two for the mask are spent.
            let gains = is_single.iter().filter(|&&single| single).count() > 2;
            let at = u32::try_from(words.len()).unwrap();
            assert!(at & INSIDE == 0, "the pointers are too narrow");
            places.push(if gains { at | INSIDE } else { at });
            words.extend(halves(node.mask));
            if gains {
                let slots = (0..64).filter(|slot| node.mask >> slot & 1 == 1);
                let inside = slots.zip(&is_single).filter(|&(_, &single)| single);
                words.extend(halves(inside.fold(0, |mask, (slot, _)| mask | 1 << slot)));
            }
            for (link, single) in node.links.iter().zip(is_single) {
                let mask = tree.leaves[link.to as usize];
                if gains && single {
                    words.extend(halves(mask));
                } else {
                    let index = *index_of_leaf[link.to as usize].get_or_insert_with(|| {
                        leaves.push(mask);
                        leaves.len() as u32 - 1
                    });
                    words.push(index);
                }
            }
        }
        for nodes in &tree.heights[1..] {
            let mut here = Vec::with_capacity(nodes.len());
            for node in nodes {
                here.push(words.len() as u32);
                words.extend(halves(node.mask));
                words.extend(node.links.iter().map(|link| places[link.to as usize]));
            }
            places = here;
        }
        let root = places[tree.root.to as usize];
        Inline { words, leaves, root, heights: tree.heights.len() as u32 }
    }

    #[inline(always)]
    fn mask(&self, at: usize) -> u64 {
        u64::from(self.words[at]) | u64::from(self.words[at + 1]) << 32
    }
}

impl Format for Inline {
    const WIDTH: u32 = 2;
    const LEAF: u32 = 2;

    fn root(&self) -> u32 {
        self.root
    }

    #[inline(always)]
    fn heights(&self) -> u32 {
        self.heights
    }

    #[inline(always)]
    fn child(&self, _height: u32, node: u32, slot: u32) -> Option<u32> {
        let at = (node & !INSIDE) as usize;
        let mask = self.mask(at);
        if mask >> slot & 1 == 0 {
            return None;
        }
        let lower = (1u64 << slot) - 1;
        let rank = (mask & lower).count_ones() as usize;
        if node & INSIDE == 0 {
            return Some(self.words[at + 2 + rank]);
        }
        let inside = self.mask(at + 2);
        let word = at + 4 + rank + (inside & lower).count_ones() as usize;
        Some(if inside >> slot & 1 == 1 { word as u32 | INSIDE } else { self.words[word] })
    }

    #[inline(always)]
    fn leaf(&self, leaf: u32) -> u64 {
        if leaf & INSIDE == 0 { self.leaves[leaf as usize] } else { self.mask((leaf ^ INSIDE) as usize) }
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.words) + size_of_val(&*self.leaves)
    }
}

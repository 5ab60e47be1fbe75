//! Pointers of 32 bits: octree nodes (Kämpe, Sintorn and Assarsson 2013) and ours, each with and without mirror images.

use super::tree::{Link, Tree, mirror_slot};
use super::walk::Format;

/// Bits of a pointer that say how its target is mirrored; the walk adds them up in the same place.
const FLIP_SHIFT: u32 = 29;

/// A node is its mask (one word, two if it is 64 bits wide), then a word for each child: word offset of a node, index
/// of a leaf mask.
///
/// Leaf masks of 2^3 voxels lie among the nodes, one word each; those of 4^3 apart.
pub struct Words<const WIDTH: u32, const LEAF: u32, const MIRRORED: bool> {
    words: Vec<u32>,
    leaves: Vec<u64>,
    root: u32,
    heights: u32,
}

impl<const WIDTH: u32, const LEAF: u32, const MIRRORED: bool> Words<WIDTH, LEAF, MIRRORED> {
    const HEADER: usize = WIDTH as usize;
    const FLIPS: u32 = if MIRRORED { 7 << FLIP_SHIFT } else { 0 };

    pub fn pack(tree: &Tree) -> Self {
        assert!(tree.width == WIDTH && tree.leaf == LEAF);
        let mut words = Vec::new();
        let mut leaves = Vec::new();
        if LEAF == 1 {
            words.extend(tree.leaves.iter().map(|&mask| mask as u32));
        } else {
            leaves.clone_from(&tree.leaves);
        }
        let mut places: Vec<u32> = (0..tree.leaves.len() as u32).collect();
        let pointer = |places: &[u32], link: &Link| {
            let place = places[link.to as usize];
            assert!(place & Self::FLIPS == 0 && (MIRRORED || link.flip == 0), "the pointer is too narrow");
            u32::from(link.flip) << FLIP_SHIFT | place
        };
        for nodes in &tree.heights {
            let mut here = Vec::with_capacity(nodes.len());
            for node in nodes {
                here.push(u32::try_from(words.len()).unwrap());
                words.push(node.mask as u32);
                if WIDTH == 2 {
                    words.push((node.mask >> 32) as u32);
                }
                words.extend(node.links.iter().map(|link| pointer(&places, link)));
            }
            places = here;
        }
        let root = pointer(&places, &tree.root);
        Words { words, leaves, root, heights: tree.heights.len() as u32 }
    }
}

impl<const WIDTH: u32, const LEAF: u32, const MIRRORED: bool> Format for Words<WIDTH, LEAF, MIRRORED> {
    const WIDTH: u32 = WIDTH;
    const LEAF: u32 = LEAF;

    fn root(&self) -> u32 {
        self.root
    }

    #[inline(always)]
    fn heights(&self) -> u32 {
        self.heights
    }

    #[inline(always)]
    fn child(&self, _height: u32, node: u32, slot: u32) -> Option<u32> {
        let flips = node & Self::FLIPS;
        let at = (node ^ flips) as usize;
        let slot = slot ^ mirror_slot::<WIDTH>(flips >> FLIP_SHIFT);
        let mut mask = u64::from(self.words[at]);
        if WIDTH == 2 {
            mask |= u64::from(self.words[at + 1]) << 32;
        }
        if mask >> slot & 1 == 0 {
            return None;
        }
        let before = (mask & ((1 << slot) - 1)).count_ones() as usize;
        Some(self.words[at + Self::HEADER + before] ^ flips)
    }

    #[inline(always)]
    fn leaf(&self, leaf: u32) -> u64 {
        let at = (leaf & !Self::FLIPS) as usize;
        if LEAF == 1 { u64::from(self.words[at]) } else { self.leaves[at] }
    }

    #[inline(always)]
    fn leaf_flip(&self, leaf: u32) -> u32 {
        mirror_slot::<LEAF>((leaf & Self::FLIPS) >> FLIP_SHIFT)
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.words) + size_of_val(&*self.leaves)
    }
}

//! The packed form of the DAG: what is built, stored, validated and traversed.
//!
//! A node of height h covers 4^(h+1) voxels a side and has 4x4x4 child slots, bit x + 4 y + 16 z. Children of a node of
//! height 1 are leaf bricks (64-bit masks of 4x4x4 voxels, same bit order). In the array of u32 words a node is
//!
//! ```text
//! word 0       mask of occupied slots, low half
//! word 1       mask, high half
//! word 2 ..    one child for each set bit, in bit order: height 1: index of a leaf mask, above: word offset of a node
//! ```
//!
//! Nodes of one height lie together, height 1 first, so that every child lies before its parents. Beside the words of
//! height 2 and above stand counts (a second array, not read while traversing): for word 0 and 1 of a node, the leaf bricks
//! below it and 0; for word 2 + i, the leaf bricks below the children before child i. They turn the path to a brick
//! into its ordinal in depth-first order, which shared nodes cannot hold. At height 1 the rank of a child's bit says the
//! same. From height 6 on counts may exceed 32 bits (64^h bricks below a node of height h): the high halves of these
//! words' counts follow behind all the low ones.
//!
//! Sharing: Kämpe, Sintorn and Assarsson, "High Resolution Sparse Voxel DAGs", 2013. We differ: 64 children a node.

/// Words before the children.
pub const HEADER_WORDS: usize = 2;

/// Index of a child slot or of a voxel in a brick: coordinates within 0..4 at `shift` bits.
#[inline]
pub fn slot(voxel: [i32; 3], shift: u32) -> u32 {
    let digit = |c: i32| (c >> shift & 3) as u32;
    digit(voxel[0]) | digit(voxel[1]) << 2 | digit(voxel[2]) << 4
}

/// Mask of the node at a word offset.
#[inline]
pub fn mask_at(words: &[u32], node: u32) -> u64 {
    let at = node as usize;
    u64::from(words[at]) | u64::from(words[at + 1]) << 32
}

/// Words of the node at a word offset.
#[inline]
pub(crate) fn node_length(words: &[u32], at: usize) -> usize {
    HEADER_WORDS + (words[at].count_ones() + words[at + 1].count_ones()) as usize
}

/// Word of the child in `slot`, whose bit must be set in `mask`.
#[inline]
pub fn child_word(mask: u64, node: u32, slot: u32) -> usize {
    node as usize + HEADER_WORDS + (mask & ((1u64 << slot) - 1)).count_ones() as usize
}

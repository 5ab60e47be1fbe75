//! Builds the DAG bottom up: equal bricks and equal nodes are stored once, by hash and full comparison.
//!
//! Every table lists its nodes in the order in which they are first met, depth first. That order is the same however
//! the grid is cut into pieces that are built apart and merged in order.

use hashbrown::HashTable;
use std::hash::Hasher;

use super::counts::make_counts;
use super::node::{HEADER_WORDS, node_length};
use super::{Dag, DagError, DagShape};

/// Entries of the table that answers for masks met a moment ago; a power of two.
const RECENT: usize = 1 << 10;

/// Tables of one DAG under construction: leaf masks, and one table of nodes for each height.
pub(crate) struct DagTables {
    pub leaves: Vec<u64>,
    leaf_of_mask: HashTable<u32>,
    /// Leaf index of a mask with this hash, if it is still that: half of all bricks repeat one of the last.
    recent: Box<[u32; RECENT]>,
    /// `heights[h - 1]` holds the nodes of height h; their children are offsets within the table below.
    pub heights: Vec<NodeTable>,
}

/// Nodes of one height, packed as [`super::node`] says.
#[derive(Default)]
pub(crate) struct NodeTable {
    pub words: Vec<u32>,
    offset_of_node: HashTable<u32>,
}

/// A node about to be stored: occupied slots and children.
#[derive(Default)]
pub(crate) struct NodeDraft {
    mask: u64,
    children: Vec<u32>,
}

impl NodeDraft {
    /// Begins a node with these occupied slots; their children follow through [`NodeDraft::push`].
    pub fn begin(&mut self, mask: u64) {
        self.mask = mask;
        self.children.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.mask == 0
    }

    /// The next child of those that were announced.
    #[inline]
    pub fn push(&mut self, child: u32) {
        self.children.push(child);
    }

    /// Adds a child that was not announced; slots must come in rising order.
    pub fn add(&mut self, slot: u32, child: u32) {
        debug_assert!(slot < 64 && self.mask >> slot == 0, "slots must rise: {slot} after {:#x}", self.mask);
        self.mask |= 1 << slot;
        self.children.push(child);
    }
}

#[inline]
fn hash_node(mask: u64, children: &[u32]) -> u64 {
    let mut hasher = rustc_hash::FxHasher::default();
    hasher.write_u64(mask);
    let (pairs, rest) = children.as_chunks::<2>();
    pairs.iter().for_each(|&[a, b]| hasher.write_u64(u64::from(a) | u64::from(b) << 32));
    rest.iter().for_each(|&child| hasher.write_u32(child));
    hasher.finish()
}

#[inline]
fn hash_mask(mask: u64) -> u64 {
    let mut hasher = rustc_hash::FxHasher::default();
    hasher.write_u64(mask);
    hasher.finish()
}

/// The words of the node at `offset`.
pub(crate) fn node_words(words: &[u32], offset: u32) -> &[u32] {
    let at = offset as usize;
    &words[at..at + node_length(words, at)]
}

impl NodeTable {
    /// Stores a node or finds its equal; returns its offset.
    pub fn intern(&mut self, draft: &NodeDraft) -> Result<u32, DagError> {
        let header = [draft.mask as u32, (draft.mask >> 32) as u32];
        let hash = hash_node(draft.mask, &draft.children);
        let words = &self.words;
        let equal = |&at: &u32| {
            let at = at as usize;
            words[at..at + HEADER_WORDS] == header
                && words[at + HEADER_WORDS..][..draft.children.len()] == draft.children
        };
        if let Some(&offset) = self.offset_of_node.find(hash, equal) {
            return Ok(offset);
        }
        let offset = u32::try_from(self.words.len()).map_err(|_| DagError::TooManyNodes)?;
        self.words.extend(header);
        self.words.extend_from_slice(&draft.children);
        let words = &self.words;
        self.offset_of_node.insert_unique(hash, offset, |&at| match node_words(words, at) {
            [low, high, children @ ..] => hash_node(u64::from(*low) | u64::from(*high) << 32, children),
            _ => 0,
        });
        Ok(offset)
    }
}

impl DagTables {
    pub fn new(height: u32) -> Self {
        DagTables {
            leaves: Vec::new(),
            leaf_of_mask: HashTable::new(),
            recent: Box::new([0; RECENT]),
            heights: (0..height).map(|_| NodeTable::default()).collect(),
        }
    }

    /// Stores a brick or finds its equal.
    #[inline]
    pub fn intern_leaf(&mut self, mask: u64) -> Result<u32, DagError> {
        let hash = hash_mask(mask);
        let recent = &mut self.recent[hash as usize % RECENT];
        if self.leaves.get(*recent as usize) == Some(&mask) {
            return Ok(*recent);
        }
        let leaves = &self.leaves;
        let index = match self.leaf_of_mask.find(hash, |&at| leaves[at as usize] == mask) {
            Some(&index) => index,
            None => {
                let index = u32::try_from(self.leaves.len()).map_err(|_| DagError::TooManyNodes)?;
                self.leaves.push(mask);
                let leaves = &self.leaves;
                self.leaf_of_mask.insert_unique(hash, index, |&at| hash_mask(leaves[at as usize]));
                index
            }
        };
        *recent = index;
        Ok(index)
    }

    /// Copies everything of `part` that is not here yet, bottom up. Returns the new offset of `part`'s node `root`
    /// of height `part.heights.len()`.
    pub fn merge(&mut self, part: &DagTables, root: u32) -> Result<u32, DagError> {
        let mut new_of_old = Vec::with_capacity(part.leaves.len());
        for &mask in &part.leaves {
            new_of_old.push(self.intern_leaf(mask)?);
        }
        let mut draft = NodeDraft::default();
        for (table, mine) in part.heights.iter().zip(&mut self.heights) {
            // Offsets are sparse: one slot a word is simple, and parts are small.
            let mut new_of_old_here = vec![u32::MAX; table.words.len()];
            let mut at = 0usize;
            while at < table.words.len() {
                let words = node_words(&table.words, at as u32);
                draft.begin(u64::from(words[0]) | u64::from(words[1]) << 32);
                draft.children.extend(words[HEADER_WORDS..].iter().map(|&c| new_of_old[c as usize]));
                new_of_old_here[at] = mine.intern(&draft)?;
                at += words.len();
            }
            new_of_old = new_of_old_here;
        }
        Ok(new_of_old[root as usize])
    }

    /// Bytes held, used yet or not.
    pub fn bytes(&self) -> u64 {
        let nodes: usize =
            self.heights.iter().map(|t| 4 * t.words.capacity() + t.offset_of_node.allocation_size()).sum();
        (nodes + 8 * self.leaves.capacity() + self.leaf_of_mask.allocation_size()) as u64
    }

    /// Drops what only interning needs.
    pub fn shrink(&mut self) {
        self.leaf_of_mask = HashTable::new();
        self.heights.iter_mut().for_each(|table| table.offset_of_node = HashTable::new());
    }

    /// Joins the tables into one array with the heights in order, and counts bricks. `root` is the offset of the root in
    /// the top table; `None` for an empty grid.
    pub fn finish(mut self, log2: u32, root: Option<u32>) -> Result<Dag, DagError> {
        self.shrink();
        let total: usize = self.heights.iter().map(|t| t.words.len()).sum();
        u32::try_from(total).map_err(|_| DagError::TooManyNodes)?;
        let mut words: Vec<u32> = Vec::new();
        let mut height_ends = Vec::new();
        let mut base_below = 0u32;
        for (index, mut table) in self.heights.into_iter().enumerate() {
            let base = words.len() as u32;
            if index == 0 {
                // By far the longest: moved, not copied.
                words = table.words;
                words.reserve_exact(total - words.len());
            } else {
                let mut at = 0;
                while at < table.words.len() {
                    let length = node_length(&table.words, at);
                    table.words[at + HEADER_WORDS..at + length]
                        .iter_mut()
                        .for_each(|child| *child += base_below);
                    at += length;
                }
                words.append(&mut table.words);
            }
            height_ends.push(words.len() as u32);
            base_below = base;
        }
        words.shrink_to_fit();
        self.leaves.shrink_to_fit();
        let root = root.map(|offset| offset + base_below);
        let shape = DagShape { log2, height_ends, root };
        let counts = make_counts(&shape, &words);
        Ok(Dag { shape, words, counts, leaves: self.leaves })
    }
}

//! Builds the DAG bottom up: equal bricks and equal nodes are stored once, by hash and full comparison.

use hashbrown::HashTable;
use std::hash::Hasher;

use super::node::HEADER_WORDS;
use super::{Dag, DagError};

/// Tables of one DAG under construction: leaf masks, and one table of nodes for each height.
#[derive(Default)]
pub(crate) struct DagTables {
    pub leaves: Vec<u64>,
    leaf_of_mask: HashTable<u32>,
    /// `heights[h - 1]` holds the nodes of height h; their children are offsets within the table below.
    pub heights: Vec<NodeTable>,
}

/// Nodes of one height, packed as [`super::node`] says, and their brick counts.
#[derive(Default)]
pub(crate) struct NodeTable {
    pub words: Vec<u32>,
    pub counts: Vec<u32>,
    offset_of_node: HashTable<u32>,
}

/// A node about to be stored: occupied slots, children and the bricks below each of them.
#[derive(Default)]
pub(crate) struct NodeDraft {
    mask: u64,
    children: Vec<u32>,
    bricks: Vec<u32>,
}

impl NodeDraft {
    pub fn clear(&mut self) {
        self.mask = 0;
        self.children.clear();
        self.bricks.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.mask == 0
    }

    /// Adds a child; slots must come in rising order.
    pub fn push(&mut self, slot: u32, child: u32, bricks: u32) {
        debug_assert!(slot < 64 && self.mask >> slot == 0, "slots must rise: {slot} after {:#x}", self.mask);
        self.mask |= 1 << slot;
        self.children.push(child);
        self.bricks.push(bricks);
    }
}

fn hash_words(words: impl Iterator<Item = u32>) -> u64 {
    let mut hasher = rustc_hash::FxHasher::default();
    words.for_each(|word| hasher.write_u32(word));
    hasher.finish()
}

fn hash_mask(mask: u64) -> u64 {
    hash_words([mask as u32, (mask >> 32) as u32].into_iter())
}

/// The words of the node at `offset`.
pub(crate) fn node_words(words: &[u32], offset: u32) -> &[u32] {
    let at = offset as usize;
    let children = (words[at].count_ones() + words[at + 1].count_ones()) as usize;
    &words[at..at + HEADER_WORDS + children]
}

impl NodeTable {
    /// Stores a node or finds its equal; returns its offset and the bricks below it.
    pub fn intern(&mut self, draft: &NodeDraft) -> Result<(u32, u32), DagError> {
        let header = [draft.mask as u32, (draft.mask >> 32) as u32];
        let content = || header.iter().chain(&draft.children).copied();
        let total = draft.bricks.iter().try_fold(0u32, |sum, &n| sum.checked_add(n));
        let total = total.ok_or(DagError::TooManyBricks)?;
        let hash = hash_words(content());
        let words = &self.words;
        let equal = |&at: &u32| node_words(words, at).iter().copied().eq(content());
        if let Some(&offset) = self.offset_of_node.find(hash, equal) {
            return Ok((offset, total));
        }
        let offset = u32::try_from(self.words.len()).map_err(|_| DagError::TooManyNodes)?;
        self.words.extend(content());
        self.counts.extend([total, 0]);
        self.counts
            .extend(draft.bricks.iter().scan(0, |before, &n| Some(std::mem::replace(before, *before + n))));
        let words = &self.words;
        self.offset_of_node
            .insert_unique(hash, offset, |&at| hash_words(node_words(words, at).iter().copied()));
        Ok((offset, total))
    }
}

impl DagTables {
    pub fn new(height: u32) -> Self {
        DagTables { heights: (0..height).map(|_| NodeTable::default()).collect(), ..Self::default() }
    }

    /// Stores a brick or finds its equal.
    pub fn intern_leaf(&mut self, mask: u64) -> Result<u32, DagError> {
        let hash = hash_mask(mask);
        let leaves = &self.leaves;
        if let Some(&index) = self.leaf_of_mask.find(hash, |&at| leaves[at as usize] == mask) {
            return Ok(index);
        }
        let index = u32::try_from(self.leaves.len()).map_err(|_| DagError::TooManyNodes)?;
        self.leaves.push(mask);
        let leaves = &self.leaves;
        self.leaf_of_mask.insert_unique(hash, index, |&at| hash_mask(leaves[at as usize]));
        Ok(index)
    }

    /// Copies everything of `part` that is not here yet, bottom up. Returns the new offset of `part`'s node `root` of
    /// height `part.heights.len()`, and the bricks below it.
    pub fn merge(&mut self, part: &DagTables, root: u32) -> Result<(u32, u32), DagError> {
        let mut new_of_old = Vec::with_capacity(part.leaves.len());
        for &mask in &part.leaves {
            new_of_old.push(self.intern_leaf(mask)?);
        }
        let mut draft = NodeDraft::default();
        let mut last = (0, 0);
        for (table, mine) in part.heights.iter().zip(&mut self.heights) {
            // Offsets are sparse: one slot a word is simple, and blocks are small.
            let mut new_of_old_here = vec![u32::MAX; table.words.len()];
            let mut at = 0usize;
            while at < table.words.len() {
                let words = node_words(&table.words, at as u32);
                let counts = &table.counts[at..at + words.len()];
                draft.clear();
                draft.mask = u64::from(words[0]) | u64::from(words[1]) << 32;
                draft.children.extend(words[HEADER_WORDS..].iter().map(|&c| new_of_old[c as usize]));
                let ends = counts[HEADER_WORDS + 1..].iter().chain(&counts[..1]);
                draft.bricks.extend(counts[HEADER_WORDS..].iter().zip(ends).map(|(start, end)| end - start));
                let stored = mine.intern(&draft)?;
                new_of_old_here[at] = stored.0;
                if at as u32 == root {
                    last = stored;
                }
                at += words.len();
            }
            new_of_old = new_of_old_here;
        }
        Ok(last)
    }

    /// Joins the tables into one array with the heights in order. `root` is the offset of the root in the top table;
    /// `None` for an empty grid.
    pub fn finish(self, log2: u32, root: Option<u32>) -> Result<Dag, DagError> {
        let total: usize = self.heights.iter().map(|t| t.words.len()).sum();
        u32::try_from(total).map_err(|_| DagError::TooManyNodes)?;
        let mut words = Vec::with_capacity(total);
        let mut counts = Vec::with_capacity(total);
        let mut height_ends = Vec::new();
        let mut base_below = 0u32;
        for (index, mut table) in self.heights.into_iter().enumerate() {
            let base = words.len() as u32;
            if index > 0 {
                let mut at = 0;
                while at < table.words.len() {
                    let length = node_words(&table.words, at as u32).len();
                    table.words[at + HEADER_WORDS..at + length]
                        .iter_mut()
                        .for_each(|child| *child += base_below);
                    at += length;
                }
            }
            words.append(&mut table.words);
            counts.append(&mut table.counts);
            height_ends.push(words.len() as u32);
            base_below = base;
        }
        let root = root.map(|offset| offset + base_below);
        Ok(Dag { shape: super::DagShape { log2, height_ends, root }, words, counts, leaves: self.leaves })
    }
}

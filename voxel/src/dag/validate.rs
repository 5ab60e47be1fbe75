//! Checks arrays of unknown origin before anything trusts them.

use super::counts::{Counts, count_length};
use super::node::{HEADER_WORDS, node_length};
use super::{DagError, DagRef, DagShape, root_height};
use crate::grid::LOG2_RANGE;

/// Sizes of a DAG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DagStatistics {
    /// Distinct nodes, all heights.
    pub nodes: u64,
    /// Distinct leaf bricks.
    pub distinct_leaves: u64,
    /// Occupied bricks, sharing expanded.
    pub bricks: u64,
    /// Occupied voxels, sharing expanded.
    pub voxels: u64,
    /// Bytes of nodes and leaf masks: what traversal needs.
    pub traversal_bytes: u64,
    /// Bytes of the counts beside them.
    pub count_bytes: u64,
}

impl<'a> DagRef<'a> {
    /// Checks every mask, child and count of the arrays in one linear pass and returns a view that is safe to
    /// traverse, with its statistics. Costs about a nanosecond a word.
    ///
    /// Errors name the broken rule and the place; nothing is ever read out of range.
    pub fn validate(
        shape: &DagShape,
        words: &'a [u32],
        counts: &'a [u32],
        leaves: &'a [u64],
    ) -> Result<(Self, DagStatistics), DagError> {
        let broken = |rule, place: String| Err(DagError::Broken { rule, place });
        if !LOG2_RANGE.contains(&shape.log2) {
            return broken("the grid has 2^6 to 2^17 voxels a side", format!("log2 {}", shape.log2));
        }
        let height = root_height(shape.log2);
        if shape.height_ends.len() != height as usize {
            return broken("there is one end for each height", format!("{} ends", shape.height_ends.len()));
        }
        if shape.height_ends.last().map(|&end| end as usize) != Some(words.len()) {
            return broken("the last height ends with the array", format!("{} words", words.len()));
        }
        if !shape.height_ends.is_sorted() {
            return broken("the ends of the heights rise", format!("{:?}", shape.height_ends));
        }
        if count_length(shape, words.len()) != Some(counts.len()) {
            return broken(
                "there is a count for each word above height 1",
                format!("{} counts", counts.len()),
            );
        }
        if let Some(empty) = leaves.iter().position(|&mask| mask == 0) {
            return broken("no brick is empty", format!("leaf {empty}"));
        }

        let mut statistics = DagStatistics {
            distinct_leaves: leaves.len() as u64,
            traversal_bytes: size_of_val(words) as u64 + size_of_val(leaves) as u64,
            count_bytes: size_of_val(counts) as u64,
            ..Default::default()
        };
        let counts = Counts::new(shape, words.len(), counts);
        let mut below = Starts::default();
        let mut start = 0usize;
        for (index, &end) in shape.height_ends.iter().enumerate() {
            let end = end as usize;
            let height_here = index as u32 + 1;
            let mut here = Starts::new(start, end);
            let mut at = start;
            while at < end {
                let place = || format!("word {at} of height {height_here}");
                if end - at < HEADER_WORDS {
                    return broken("a node has two mask words", place());
                }
                let children = node_length(words, at) - HEADER_WORDS;
                if children == 0 {
                    return broken("no node is empty", place());
                }
                if children > end - at - HEADER_WORDS {
                    return broken("a node has a word for each child", place());
                }
                if height_here == height && !slots_inside_grid(words, at, shape.log2) {
                    return broken("no node reaches out of the grid", place());
                }
                let (mut bricks, mut voxels) = (0u64, 0u64);
                for word in at + HEADER_WORDS..at + HEADER_WORDS + children {
                    let child = words[word];
                    if height_here == 1 {
                        match leaves.get(child as usize) {
                            Some(mask) => voxels += u64::from(mask.count_ones()),
                            None => return broken("a leaf index is in range", format!("word {word}")),
                        }
                        continue;
                    }
                    if counts.at(height_here, word) != bricks {
                        return broken("counts add up", format!("word {word}"));
                    }
                    let Some(below) = below.voxels(child as usize) else {
                        return broken("a child is a node of the height below", format!("word {word}"));
                    };
                    // No overflow: at most 64^height bricks of 64 voxels, below 2^60.
                    bricks += counts.below(words, height_here - 1, child);
                    voxels += below;
                }
                if height_here > 1
                    && (counts.at(height_here, at) != bricks || counts.at(height_here, at + 1) != 0)
                {
                    return broken("counts add up", place());
                }
                here.push(at, voxels);
                statistics.nodes += 1;
                at += HEADER_WORDS + children;
            }
            here.finish();
            (below, start) = (here, end);
        }
        let counted = DagRef { height, log2: shape.log2, root: shape.root, words, counts, leaves };
        if let Some(root) = shape.root {
            let Some(voxels) = below.voxels(root as usize) else {
                return broken("the root is a node of the greatest height", format!("word {root}"));
            };
            statistics.bricks = counted.brick_count();
            statistics.voxels = voxels;
        }
        Ok((counted, statistics))
    }
}

/// Where the nodes of one height start, and the voxels below each: a bit a word and 8 bytes a node.
#[derive(Default)]
struct Starts {
    first: usize,
    is_start: Vec<u64>,
    /// Nodes before each word of `is_start`.
    before: Vec<u32>,
    voxels: Vec<u64>,
}

impl Starts {
    fn new(first: usize, end: usize) -> Self {
        let words = (end - first).div_ceil(64);
        Starts { first, is_start: vec![0; words], before: Vec::with_capacity(words), voxels: Vec::new() }
    }

    /// The next node.
    fn push(&mut self, at: usize, voxels: u64) {
        let bit = at - self.first;
        self.is_start[bit / 64] |= 1 << (bit % 64);
        self.voxels.push(voxels);
    }

    fn finish(&mut self) {
        let ones =
            self.is_start.iter().scan(0, |sum, word| Some(std::mem::replace(sum, *sum + word.count_ones())));
        self.before.extend(ones);
    }

    /// Voxels below the node at a word; `None` when no node of this height starts there.
    fn voxels(&self, at: usize) -> Option<u64> {
        let bit = at.checked_sub(self.first)?;
        let word = self.is_start.get(bit / 64)?;
        let rank = (word & ((1 << (bit % 64)) - 1)).count_ones() + self.before[bit / 64];
        (word >> (bit % 64) & 1 == 1).then(|| self.voxels[rank as usize])
    }
}

/// With an odd log2 the root covers twice the grid: only its lower 2x2x2 slots may be used.
fn slots_inside_grid(words: &[u32], at: usize, log2: u32) -> bool {
    const LOWER_OCTANT: u64 = 0x0033_0033;
    let mask = u64::from(words[at]) | u64::from(words[at + 1]) << 32;
    log2.is_multiple_of(2) || mask & !LOWER_OCTANT == 0
}

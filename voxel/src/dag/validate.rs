//! Checks arrays of unknown origin before anything trusts them.

use super::node::HEADER_WORDS;
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
        if counts.len() != words.len() {
            return broken("there is a count for each word", format!("{} counts", counts.len()));
        }
        if shape.height_ends.last().map(|&end| end as usize) != Some(words.len()) {
            return broken("the last height ends with the array", format!("{} words", words.len()));
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
        // Voxels below each node, by word offset; u64::MAX where no node starts.
        const NO_NODE: u64 = u64::MAX;
        let mut voxels_below = vec![NO_NODE; words.len()];
        let (mut below_start, mut start) = (0usize, 0usize);
        for (index, &end) in shape.height_ends.iter().enumerate() {
            let end = end as usize;
            if end < start || end > words.len() {
                return broken("the ends of the heights rise", format!("height {}", index + 1));
            }
            let mut at = start;
            while at < end {
                let place = || format!("word {at} of height {}", index + 1);
                if end - at < HEADER_WORDS {
                    return broken("a node has two mask words", place());
                }
                let children = (words[at].count_ones() + words[at + 1].count_ones()) as usize;
                if children == 0 {
                    return broken("no node is empty", place());
                }
                if children > end - at - HEADER_WORDS {
                    return broken("a node has a word for each child", place());
                }
                if index as u32 + 1 == height && !slots_inside_grid(words, at, shape.log2) {
                    return broken("no node reaches out of the grid", place());
                }
                let (mut bricks, mut voxels) = (0u64, 0u64);
                for word in at + HEADER_WORDS..at + HEADER_WORDS + children {
                    if u64::from(counts[word]) != bricks {
                        return broken("counts add up", format!("word {word}"));
                    }
                    let child = words[word] as usize;
                    let (child_bricks, child_voxels) = if index == 0 {
                        match leaves.get(child) {
                            Some(mask) => (1, u64::from(mask.count_ones())),
                            None => return broken("a leaf index is in range", format!("word {word}")),
                        }
                    } else {
                        let is_node = (below_start..start).contains(&child) && voxels_below[child] != NO_NODE;
                        if !is_node {
                            return broken("a child is a node of the height below", format!("word {word}"));
                        }
                        (u64::from(counts[child]), voxels_below[child])
                    };
                    bricks += child_bricks;
                    voxels = voxels.saturating_add(child_voxels).min(NO_NODE - 1);
                }
                if u64::from(counts[at]) != bricks || counts[at + 1] != 0 {
                    return broken("counts add up", place());
                }
                voxels_below[at] = voxels;
                statistics.nodes += 1;
                at += HEADER_WORDS + children;
            }
            (below_start, start) = (start, end);
        }
        if let Some(root) = shape.root {
            let at = root as usize;
            if !(below_start..words.len()).contains(&at) || voxels_below[at] == NO_NODE {
                return broken("the root is a node of the greatest height", format!("word {root}"));
            }
            statistics.bricks = u64::from(counts[at]);
            statistics.voxels = voxels_below[at];
        }
        Ok((DagRef { height, log2: shape.log2, root: shape.root, words, counts, leaves }, statistics))
    }
}

/// With an odd log2 the root covers twice the grid: only its lower 2x2x2 slots may be used.
fn slots_inside_grid(words: &[u32], at: usize, log2: u32) -> bool {
    const LOWER_OCTANT: u64 = 0x0033_0033;
    let mask = u64::from(words[at]) | u64::from(words[at + 1]) << 32;
    log2.is_multiple_of(2) || mask & !LOWER_OCTANT == 0
}

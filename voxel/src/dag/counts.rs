//! Leaf bricks below nodes and before children: what turns the path to a brick into its ordinal.
//!
//! Children of a node of height 1 are single bricks: the rank of their bit is the count, nothing is stored. For every
//! word of the nodes of height 2 and above there is a u32: for word 0 and 1 of a node, the bricks below it and 0; for
//! word 2 + i, the bricks below the children before child i. A node of height h has at most 64^h bricks: from height 6 on
//! that may exceed 32 bits, and the high halves of these words' counts follow behind all the low ones.

use super::DagShape;
use super::node::{HEADER_WORDS, mask_at, node_length};

/// Height from which counts have a high half.
const WIDE_HEIGHT: u32 = 6;

/// Counts over borrowed arrays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counts<'a> {
    low: &'a [u32],
    high: &'a [u32],
    /// First word with a low half.
    low_from: usize,
    /// First word with a high half.
    high_from: usize,
}

/// First word with a count, first word with a high half.
fn counted_from(shape: &DagShape) -> (usize, usize) {
    let end = |height: u32| shape.height_ends.get(height as usize - 1).or(shape.height_ends.last());
    let end = |height| end(height).map_or(0, |&end| end as usize);
    (end(1), end(WIDE_HEIGHT - 1))
}

/// Counts that an array of `words` words of nodes has; `None` when the shape does not fit.
pub(crate) fn count_length(shape: &DagShape, words: usize) -> Option<usize> {
    let (low_from, high_from) = counted_from(shape);
    words.checked_sub(low_from)?.checked_add(words.checked_sub(high_from)?)
}

impl<'a> Counts<'a> {
    /// Of an array of `words` words of nodes. With an array of another length than [`count_length`], reading panics.
    pub fn new(shape: &DagShape, words: usize, counts: &'a [u32]) -> Self {
        let (low_from, high_from) = counted_from(shape);
        let (low, high) = counts.split_at(words.saturating_sub(low_from).min(counts.len()));
        Counts { low, high, low_from, high_from }
    }

    /// Low halves, and the first word that has one.
    pub fn low(&self) -> (usize, &'a [u32]) {
        (self.low_from, self.low)
    }

    /// The count beside a word of a node of this height, at least 2.
    #[inline]
    pub fn at(&self, height: u32, word: usize) -> u64 {
        let low = u64::from(self.low[word - self.low_from]);
        if height < WIDE_HEIGHT { low } else { low | u64::from(self.high[word - self.high_from]) << 32 }
    }

    /// Leaf bricks below a node.
    #[inline]
    pub fn below(&self, words: &[u32], height: u32, node: u32) -> u64 {
        if height == 1 { mask_at(words, node).count_ones().into() } else { self.at(height, node as usize) }
    }
}

/// The counts of nodes made by this library.
pub(crate) fn make_counts(shape: &DagShape, words: &[u32]) -> Vec<u32> {
    let (low_from, high_from) = counted_from(shape);
    let low_length = words.len() - low_from;
    let mut counts = vec![0u32; low_length + words.len() - high_from];
    let mut at = low_from;
    for (index, &end) in shape.height_ends.iter().enumerate().skip(1) {
        let height = index as u32 + 1;
        while at < end as usize {
            let length = node_length(words, at);
            let mut before = 0u64;
            for word in at + HEADER_WORDS..at + length {
                put(&mut counts, height, word, before, (low_from, low_length, high_from));
                let child = words[word];
                let (low, high) = counts.split_at(low_length);
                before += Counts { low, high, low_from, high_from }.below(words, height - 1, child);
            }
            put(&mut counts, height, at, before, (low_from, low_length, high_from));
            at += length;
        }
    }
    counts
}

fn put(counts: &mut [u32], height: u32, word: usize, count: u64, at: (usize, usize, usize)) {
    let (low_from, low_length, high_from) = at;
    counts[word - low_from] = count as u32;
    if height >= WIDE_HEIGHT {
        counts[low_length + word - high_from] = (count >> 32) as u32;
    }
}

#[cfg(test)]
mod tests {
    use crate::dag::build::{DagTables, NodeDraft};
    use crate::dag::node::slot;
    use crate::dag::{Dag, DagRef, root_height};
    use crate::raycast::{GridRay, Next};

    /// A grid in which all nodes of a height are one: few words, as many bricks as the masks (height 1 first) say.
    fn uniform(log2: u32, masks: &[u64]) -> Dag {
        let mut tables = DagTables::new(root_height(log2));
        let mut node = tables.intern_leaf(u64::MAX).unwrap();
        for (table, &mask) in tables.heights.iter_mut().zip(masks) {
            let mut draft = NodeDraft::default();
            draft.begin(mask);
            (0..mask.count_ones()).for_each(|_| draft.push(node));
            node = table.intern(&draft).unwrap();
        }
        tables.finish(log2, Some(node)).unwrap()
    }

    /// Slots of the lower octant: the root of a grid of 2^17 covers twice the grid.
    const OCTANT: u64 = 0x0033_0033;

    #[test]
    fn a_full_grid_of_2_to_the_17_has_2_to_the_45_bricks() {
        let mut masks = [u64::MAX; 8];
        masks[7] = OCTANT;
        let dag = uniform(17, &masks);
        let (view, statistics) = DagRef::validate(&dag.shape, &dag.words, &dag.counts, &dag.leaves).unwrap();
        assert_eq!((statistics.bricks, statistics.voxels), (1 << 45, 1 << 51));
        assert_eq!(view.brick_count(), 1 << 45);
        assert_eq!(view.brick_at([(1 << 17) - 1; 3]), Some(((1 << 45) - 1, u64::MAX)));
        assert_eq!(view.brick_mask((1 << 45) - 1), Some(u64::MAX));
        assert_eq!(view.brick_mask(1 << 45), None);
        assert!(dag.counts.contains(&(1 << 10)), "2^42 bricks below a child of the root");
    }

    #[test]
    fn ordinals_beyond_32_bits_are_ranks_in_depth_first_order() {
        let mut random = oorandom::Rand64::new(4);
        let mut beyond = 0;
        for round in 0..40 {
            let mut masks = [0; 8].map(|_: u64| random.rand_u64() | random.rand_u64() | 1);
            masks[7] &= OCTANT;
            let dag = uniform(17, &masks);
            let (view, statistics) =
                DagRef::validate(&dag.shape, &dag.words, &dag.counts, &dag.leaves).unwrap();
            let below: Vec<u64> = masks
                .iter()
                .scan(1, |bricks, mask| {
                    Some(std::mem::replace(bricks, *bricks * u64::from(mask.count_ones())))
                })
                .collect();
            assert_eq!(statistics.bricks, masks.iter().map(|m| u64::from(m.count_ones())).product::<u64>());
            for _ in 0..200 {
                let voxel = [0; 3].map(|_: i32| random.rand_range(0..1 << 17) as i32);
                let slots: Vec<u32> = (1..=8).map(|h| slot(voxel, 2 * h)).collect();
                let is_occupied = masks.iter().zip(&slots).all(|(mask, slot)| mask >> slot & 1 == 1);
                let rank = |(mask, slot): (&u64, &u32)| u64::from((mask & ((1 << slot) - 1)).count_ones());
                let ordinal: u64 = masks.iter().zip(&slots).map(rank).zip(&below).map(|(r, b)| r * b).sum();
                let expected = is_occupied.then_some((ordinal, u64::MAX));
                assert_eq!(view.brick_at(voxel), expected, "seed 4, round {round}, {voxel:?}");
                if !is_occupied {
                    continue;
                }
                beyond += u32::from(ordinal > u64::from(u32::MAX));
                assert_eq!(view.brick_mask(ordinal), Some(u64::MAX));
                let centre = glam::DVec3::from(voxel.map(|c| f64::from(c) + 0.5));
                view.cast(&GridRay::new(centre, glam::DVec3::X), |hit| {
                    assert_eq!(hit.brick_ordinal(), ordinal, "seed 4, round {round}, {voxel:?}");
                    Next::End
                });
            }
        }
        assert!(beyond > 500, "too few ordinals beyond 32 bits to mean anything: {beyond}");
    }

    #[test]
    fn a_changed_count_is_found_in_either_half() {
        let masks = [u64::MAX, 7, 3, 1, u64::MAX, u64::MAX, 0x0101, OCTANT];
        let dag = uniform(17, &masks);
        for at in 0..dag.counts.len() {
            for bit in 0..32 {
                let mut counts = dag.counts.clone();
                counts[at] ^= 1 << bit;
                let found = DagRef::validate(&dag.shape, &dag.words, &counts, &dag.leaves);
                assert!(found.is_err(), "count {at}, bit {bit}");
            }
        }
    }
}

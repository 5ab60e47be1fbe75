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

//! Bit strings in u64 words, least significant bit first.

/// The low `width` bits, at most 64.
#[inline]
pub(super) fn low_mask(width: u32) -> u64 {
    if width == 0 { 0 } else { u64::MAX >> (64 - width) }
}

/// Bits that it takes to write any number up to `largest`.
#[inline]
pub(super) fn width_of(largest: u64) -> u32 {
    u64::BITS - largest.leading_zeros()
}

/// A growing bit string.
#[derive(Default)]
pub(super) struct BitWriter {
    words: Vec<u64>,
    length: usize,
}

impl BitWriter {
    pub fn len(&self) -> usize {
        self.length
    }

    pub fn clear(&mut self) {
        self.words.clear();
        self.length = 0;
    }

    /// Words that hold the bits; the rest of the last one is 0.
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Appends the low `width` bits of `value`, whose other bits are 0.
    #[inline]
    pub fn push(&mut self, value: u64, width: u32) {
        debug_assert!(value & !low_mask(width) == 0, "{value:#x} is wider than {width} bits");
        let used = (self.length % 64) as u32;
        match self.words.last_mut() {
            Some(last) if used != 0 => {
                *last |= value << used;
                if used + width > 64 {
                    self.words.push(value >> (64 - used));
                }
            }
            _ if width != 0 => self.words.push(value),
            _ => {}
        }
        self.length += width as usize;
    }

    /// Appends another bit string.
    pub fn append(&mut self, other: &BitWriter) {
        let mut left = other.length;
        for &word in &other.words {
            let width = left.min(64) as u32;
            self.push(word, width);
            left -= width as usize;
        }
    }
}

/// Bits to read. Past the end they are 0, so that damaged positions give nonsense, never a panic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bits<'a>(pub &'a [u64]);

impl Bits<'_> {
    /// `width` bits from position `at`.
    #[inline]
    pub fn get(self, at: usize, width: u32) -> u64 {
        let (word, shift) = (at / 64, (at % 64) as u32);
        let word_at = |index: usize| self.0.get(index).copied().unwrap_or(0);
        let mut value = word_at(word) >> shift;
        if shift + width > 64 {
            value |= word_at(word + 1) << (64 - shift);
        }
        value & low_mask(width)
    }

    /// Set bits among the `length` from `at`.
    pub fn count_ones(self, at: usize, length: usize) -> usize {
        chunks(length).map(|(from, width)| self.get(at + from, width).count_ones() as usize).sum()
    }

    /// Position, counted from `at`, of the set bit that has `n` set bits before it, among `length` bits.
    #[inline]
    pub fn select_one(self, at: usize, length: usize, n: usize) -> Option<usize> {
        self.select(at, length, n, 0)
    }

    /// The same for clear bits.
    #[inline]
    pub fn select_zero(self, at: usize, length: usize, n: usize) -> Option<usize> {
        self.select(at, length, n, u64::MAX)
    }

    #[inline]
    fn select(self, at: usize, length: usize, mut n: usize, flip: u64) -> Option<usize> {
        for (from, width) in chunks(length) {
            let mut word = (self.get(at + from, width) ^ flip) & low_mask(width);
            let ones = word.count_ones() as usize;
            if n < ones {
                (0..n).for_each(|_| word &= word - 1);
                return Some(from + word.trailing_zeros() as usize);
            }
            n -= ones;
        }
        None
    }
}

/// Starts and widths of pieces of at most 64 bits.
#[inline]
fn chunks(length: usize) -> impl Iterator<Item = (usize, u32)> {
    (0..length).step_by(64).map(move |from| (from, (length - from).min(64) as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_pushed_is_read_back() {
        let mut random = oorandom::Rand64::new(1);
        for round in 0..200 {
            let mut writer = BitWriter::default();
            let values: Vec<(u64, u32)> = (0..random.rand_range(1..100))
                .map(|_| {
                    let width = random.rand_range(0..65) as u32;
                    (random.rand_u64() & low_mask(width), width)
                })
                .collect();
            values.iter().for_each(|&(value, width)| writer.push(value, width));
            let mut twice = BitWriter::default();
            twice.push(1, 3);
            twice.append(&writer);
            let (bits, shifted) = (Bits(writer.words()), Bits(twice.words()));
            let mut at = 0;
            for &(value, width) in &values {
                assert_eq!(bits.get(at, width), value, "seed 1, round {round}");
                assert_eq!(shifted.get(at + 3, width), value, "seed 1, round {round}");
                at += width as usize;
            }
            assert_eq!((writer.len(), writer.words().len()), (at, at.div_ceil(64)), "seed 1, round {round}");
            let plain: Vec<bool> = (0..at).map(|i| bits.get(i, 1) == 1).collect();
            let ones: Vec<usize> = (0..at).filter(|&i| plain[i]).collect();
            let zeros: Vec<usize> = (0..at).filter(|&i| !plain[i]).collect();
            assert_eq!(bits.count_ones(0, at), ones.len());
            for n in 0..=at {
                assert_eq!(shifted.select_one(3, at, n), ones.get(n).copied(), "seed 1, round {round}, {n}");
                assert_eq!(
                    shifted.select_zero(3, at, n),
                    zeros.get(n).copied(),
                    "seed 1, round {round}, {n}"
                );
            }
        }
    }
}

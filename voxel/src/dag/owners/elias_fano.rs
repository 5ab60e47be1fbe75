//! Rising numbers in about 2 + log2(gap) bits each (Elias 1974, Fano 1971): low bits plain, high bits in unary.

use super::bits::{BitWriter, Bits, width_of};

/// Where and how numbers are written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// How many.
    pub count: usize,
    /// Low bits of each.
    pub low_width: u32,
    /// Bits of the unary part: one 1 a number, one 0 a step of 2^low_width.
    pub upper_bits: usize,
}

impl Shape {
    /// The smallest for these numbers, which rise.
    pub fn of(values: &[u64]) -> Self {
        let (count, last) = (values.len(), values.last().copied().unwrap_or(0));
        let low_width = width_of(last / (count.max(1) as u64)).saturating_sub(1);
        Shape { count, low_width, upper_bits: count + (last >> low_width) as usize }
    }

    /// Bits that the numbers take.
    pub fn bits(&self) -> usize {
        self.upper_bits + self.count * self.low_width as usize
    }

    pub fn write(&self, values: &[u64], out: &mut BitWriter) {
        let mut step = 0;
        for &value in values {
            while step < value >> self.low_width {
                let zeros = ((value >> self.low_width) - step).min(64) as u32;
                out.push(0, zeros);
                step += u64::from(zeros);
            }
            out.push(1, 1);
        }
        let low = (1u64 << self.low_width) - 1;
        values.iter().for_each(|value| out.push(value & low, self.low_width));
    }
}

/// Numbers to read.
#[derive(Clone, Copy, Debug)]
pub(super) struct EliasFano<'a> {
    pub bits: Bits<'a>,
    pub at: usize,
    pub shape: Shape,
}

impl EliasFano<'_> {
    #[inline]
    fn low(&self, i: usize) -> u64 {
        let width = self.shape.low_width;
        self.bits.get(self.at + self.shape.upper_bits + i * width as usize, width)
    }

    /// Number `i`; `None` past the end.
    #[inline]
    pub fn get(&self, i: usize) -> Option<u64> {
        let position = self.bits.select_one(self.at, self.shape.upper_bits, i)?;
        Some(((position - i) as u64) << self.shape.low_width | self.low(i))
    }

    /// How many numbers are at most `value`.
    #[inline]
    pub fn rank(&self, value: u64) -> usize {
        let step = (value >> self.shape.low_width) as usize;
        let start = match step {
            0 => 0,
            _ => match self.bits.select_zero(self.at, self.shape.upper_bits, step - 1) {
                Some(zero) => zero + 1,
                None => return self.shape.count,
            },
        };
        let low = value & ((1u64 << self.shape.low_width) - 1);
        let mut i = start - step;
        let mut at = start;
        while at < self.shape.upper_bits && self.bits.get(self.at + at, 1) == 1 && self.low(i) <= low {
            i += 1;
            at += 1;
        }
        i
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_ranks_are_those_of_the_plain_list() {
        let mut random = oorandom::Rand64::new(2);
        for round in 0..500 {
            let reach = 1u64 << random.rand_range(1..50);
            let mut values: Vec<u64> =
                (0..random.rand_range(0..256)).map(|_| random.rand_range(0..reach)).collect();
            values.sort_unstable();
            values.dedup();
            let shape = Shape::of(&values);
            let mut writer = BitWriter::default();
            writer.push(5, 3);
            shape.write(&values, &mut writer);
            assert_eq!(writer.len(), 3 + shape.bits(), "seed 2, round {round}");
            assert!(shape.upper_bits <= 3 * values.len(), "seed 2, round {round}: {shape:?}");
            let packed = EliasFano { bits: Bits(writer.words()), at: 3, shape };
            for (i, &value) in values.iter().enumerate() {
                assert_eq!(packed.get(i), Some(value), "seed 2, round {round}");
                assert_eq!(packed.rank(value), i + 1, "seed 2, round {round}");
            }
            assert_eq!(packed.get(values.len()), None);
            for _ in 0..50 {
                let value = random.rand_range(0..2 * reach);
                let expected = values.partition_point(|&v| v <= value);
                assert_eq!(packed.rank(value), expected, "seed 2, round {round}: {value} in {values:?}");
            }
        }
    }
}

//! The order in which the samples of a cell of k x k pixels come to its pixels: every pixel once in k*k samples.

use super::sampling::sample_offset;

/// Pixels of a cell, in the order in which the R2 sequence first comes to them: so neighbours in time are apart in the
/// image, as they are in the sequence itself, which alone reaches 87 % of 16 pixels in 16 samples.
#[derive(Clone, Debug)]
pub(super) struct PixelOrder {
    side: u32,
    pixels: Vec<(u32, u32)>,
}

/// Points of the sequence to try for each pixel before the rest is taken row by row. Fewer than 3 are needed (tested):
/// this only makes it plain that the search ends.
const PATIENCE: u32 = 8;

impl PixelOrder {
    /// Of cells of `side` x `side` pixels, `side` at least 1.
    pub fn new(side: u32) -> Self {
        let count = (side * side) as usize;
        let (mut pixels, mut is_taken) = (Vec::with_capacity(count), vec![false; count]);
        let pixel = |at: f64| ((at * f64::from(side)) as u32).min(side - 1);
        let by_sequence = (0..PATIENCE * side * side).map(sample_offset).map(|(x, y)| (pixel(x), pixel(y)));
        let by_row = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
        for (x, y) in by_sequence.chain(by_row) {
            if pixels.len() == count {
                break;
            }
            if !std::mem::replace(&mut is_taken[(y * side + x) as usize], true) {
                pixels.push((x, y));
            }
        }
        PixelOrder { side, pixels }
    }

    /// Pixels a side.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// The pixel of a sample, and how many samples that pixel has had before.
    pub fn of_sample(&self, sample: u32) -> ((u32, u32), u32) {
        let count = self.side * self.side;
        (self.pixels[(sample % count) as usize], sample / count)
    }

    /// The same pixel in a cell that begins elsewhere: `shift`, in `0..1`, moves the order of all pixels around the cell,
    /// so that cells side by side are not sampled at the same place, and each still has every pixel once.
    pub fn shifted(&self, pixel: (u32, u32), shift: (f64, f64)) -> (u32, u32) {
        let move_by = |at: u32, shift: f64| {
            let moved = at + ((shift * f64::from(self.side)) as u32).min(self.side - 1);
            if moved >= self.side { moved - self.side } else { moved }
        };
        (move_by(pixel.0, shift.0), move_by(pixel.1, shift.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_comes_once_and_the_sequence_alone_gets_there() {
        for side in (1..=32).chain([64, 100, 256]) {
            let order = PixelOrder::new(side);
            let mut pixels = order.pixels.clone();
            let last = *pixels.last().unwrap();
            pixels.sort_unstable();
            pixels.dedup();
            assert_eq!(pixels.len(), (side * side) as usize, "{side}");
            let points = (0..3 * side * side).map(sample_offset);
            let mut came = points.map(|(x, y)| [x, y].map(|at| (at * f64::from(side)) as u32));
            assert!(
                came.any(|[x, y]| (x, y) == last),
                "{side}: the last pixel was not reached by the sequence"
            );
        }
    }

    #[test]
    fn a_quarter_of_the_samples_is_spread_over_the_cell() {
        // Of each quarter of the cell about a quarter; of each block of 2 x 2 pixels seldom two.
        for side in [4, 8, 16] {
            let first = &PixelOrder::new(side).pixels[..(side * side / 4) as usize];
            let mut quarters = [0; 4];
            let mut blocks = std::collections::BTreeSet::new();
            for &(x, y) in first {
                quarters[usize::from(2 * x >= side) + 2 * usize::from(2 * y >= side)] += 1;
                blocks.insert((x / 2, y / 2));
            }
            let (share, spread) = (side * side / 16, 1 + side / 8);
            assert!(quarters.iter().all(|n: &u32| n.abs_diff(share) <= spread), "{side}: {quarters:?}");
            assert!(
                blocks.len() * 4 >= first.len() * 3,
                "{side}: {} of {} blocks",
                blocks.len(),
                first.len()
            );
        }
    }

    #[test]
    fn a_shifted_order_is_an_order_of_all_pixels() {
        let order = PixelOrder::new(5);
        for shift in [(0.0, 0.0), (0.3, 0.999_999_999), (0.2, 0.6), (1.0 - f64::EPSILON / 2.0, 0.5)] {
            let mut seen = [false; 25];
            for sample in 0..25 {
                let (x, y) = order.shifted(order.of_sample(sample).0, shift);
                assert!(!std::mem::replace(&mut seen[(5 * y + x) as usize], true), "{shift:?}, {sample}");
            }
        }
        assert_eq!(order.of_sample(53).1, 2);
    }
}

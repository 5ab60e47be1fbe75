//! The numbers behind pixels' samples: Owen-scrambled Sobol points (Burley, "Practical Hash-based Owen Scrambling", 2020),
//! another scrambling for each pixel.
//!
//! Each purpose takes the first two dimensions, which alone fill the square evenly at every power of four, under a scrambling
//! and an order of its own (Burley's padding): the samples of a pixel are stratified for each light. The same pixel,
//! sample and seed give the same numbers wherever and in whatever order they are asked for.

/// Most samples of a pixel: the length of the sequence.
pub const MAX_SAMPLES: u32 = 1 << 16;

/// The pairs of numbers that a sample takes, one for each purpose.
#[derive(Clone, Copy, Debug)]
pub(super) enum Purpose {
    /// Where in the pixel.
    Pixel,
    /// Where on the sun.
    Sun,
    /// Where in the sky.
    Sky,
    /// Where on the shining rectangle of this number.
    Area(u32),
}

/// Two numbers in `0..1` of one sample of a pixel, below [`MAX_SAMPLES`].
pub(super) fn numbers(column: u32, row: u32, sample: u32, seed: u32, purpose: Purpose) -> (f64, f64) {
    let purpose = match purpose {
        Purpose::Pixel => 0,
        Purpose::Sun => 1,
        Purpose::Sky => 2,
        Purpose::Area(number) => 3 + number,
    };
    let pixel_seed = hash(column, hash(row, hash(seed, purpose)));
    let [x, y, ..] = sobol_burley::sample_4d(sample, 0, pixel_seed);
    (f64::from(x), f64::from(y))
}

/// A well-mixed number from two (the finalizer of MurmurHash3 over their sum with an odd multiple).
fn hash(a: u32, b: u32) -> u32 {
    let mut h = a.wrapping_mul(0x9e37_79b1).wrapping_add(b ^ 0x85eb_ca6b);
    h = (h ^ h >> 16).wrapping_mul(0x85eb_ca6b);
    h = (h ^ h >> 13).wrapping_mul(0xc2b2_ae35);
    h ^ h >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_fill_the_square_evenly_for_every_purpose() {
        for purpose in [Purpose::Pixel, Purpose::Sun, Purpose::Sky, Purpose::Area(0), Purpose::Area(70)] {
            for side in [2usize, 4, 8, 16] {
                let mut cells = vec![0; side * side];
                for sample in 0..(side * side) as u32 {
                    let (x, y) = numbers(7, 1000, sample, 5, purpose);
                    assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
                    cells[(x * side as f64) as usize + (y * side as f64) as usize * side] += 1;
                }
                assert!(cells.iter().all(|&count| count == 1), "{purpose:?}, {side} x {side}: {cells:?}");
            }
        }
    }

    #[test]
    fn neighbouring_pixels_other_purposes_and_other_seeds_take_other_points() {
        let first = |column, row, seed| numbers(column, row, 0, seed, Purpose::Pixel);
        let mean = |of: &dyn Fn(u32) -> (f64, f64)| (0..4096).map(|i| of(i).0).sum::<f64>() / 4096.0;
        assert!((mean(&|i| first(i, 0, 0)) - 0.5).abs() < 0.02);
        assert!((mean(&|i| first(0, i, 0)) - 0.5).abs() < 0.02);
        assert_ne!(first(3, 4, 0), first(4, 3, 0));
        assert_ne!(first(3, 4, 0), first(3, 4, 1));
        // No purpose follows another.
        let pairs =
            (0..1024).map(|i| (numbers(5, 6, i, 0, Purpose::Pixel).0, numbers(5, 6, i, 0, Purpose::Sun).0));
        let covariance = pairs.map(|(a, b)| (a - 0.5) * (b - 0.5)).sum::<f64>() / 1024.0;
        assert!(covariance.abs() < 0.01, "{covariance}");
    }
}

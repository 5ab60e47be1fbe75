//! The numbers behind pixels' samples: Owen-scrambled Sobol points (Burley, "Practical Hash-based Owen Scrambling", 2020),
//! another scrambling for each pixel.
//!
//! All samples of a pixel together are stratified in each pair of numbers that is used together; the same pixel, sample
//! and seed give the same numbers wherever and in whatever order they are asked for.

/// Most samples of a pixel: the length of the sequence.
pub const MAX_SAMPLES: u32 = 1 << 16;

/// The sets of numbers that a sample takes, one for each purpose.
#[derive(Clone, Copy)]
pub(super) enum Purpose {
    /// Where in the pixel; then where on the sun.
    PixelAndSun,
    /// Where in the sky.
    Sky,
    /// Where on the shining rectangle of this number.
    Area(u32),
}

/// Numbers in `0..1` of one sample of a pixel.
pub(super) fn numbers(column: u32, row: u32, sample: u32, seed: u32, purpose: Purpose) -> [f64; 4] {
    let set = match purpose {
        Purpose::PixelAndSun => 0,
        Purpose::Sky => 1,
        Purpose::Area(number) => 2 + number,
    };
    // Sets beyond the sequence's 64 are taken from another scrambling.
    let (set, round) = (set % 64, set / 64);
    let pixel_seed = hash(column, hash(row, hash(seed, round)));
    sobol_burley::sample_4d(sample % MAX_SAMPLES, set, pixel_seed).map(f64::from)
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
    fn sixteen_samples_fill_each_pair_of_numbers_evenly() {
        for (pixel, purpose) in [(0, Purpose::PixelAndSun), (7, Purpose::Sky), (9, Purpose::Area(70))] {
            let points: Vec<[f64; 4]> =
                (0..16).map(|sample| numbers(pixel, 1000 - pixel, sample, 5, purpose)).collect();
            assert!(points.iter().flatten().all(|x| (0.0..1.0).contains(x)));
            for number in 0..4 {
                let mut cells: Vec<u32> = points.iter().map(|p| (p[number] * 16.0) as u32).collect();
                cells.sort_unstable();
                assert_eq!(cells, (0..16).collect::<Vec<_>>(), "number {number} of pixel {pixel}");
            }
        }
    }

    #[test]
    fn neighbouring_pixels_and_other_seeds_take_other_points() {
        let first = |column, row, seed| numbers(column, row, 0, seed, Purpose::PixelAndSun);
        let mean = |of: &dyn Fn(u32) -> [f64; 4]| (0..4096).map(|i| of(i)[0]).sum::<f64>() / 4096.0;
        assert!((mean(&|i| first(i, 0, 0)) - 0.5).abs() < 0.02);
        assert!((mean(&|i| first(0, i, 0)) - 0.5).abs() < 0.02);
        assert_ne!(first(3, 4, 0), first(4, 3, 0));
        assert_ne!(first(3, 4, 0), first(3, 4, 1));
    }
}

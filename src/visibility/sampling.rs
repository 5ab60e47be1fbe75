//! Which rays a query casts: tiles, pixels, and points within a pixel.

use crate::camera::CameraRays;
use crate::ray::Ray;

/// Pixels a side of a tile: neighbouring rays are cast together.
const TILE: u32 = 8;

/// A block of pixels: columns and rows.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Pixel columns.
    pub columns: std::ops::Range<u32>,
    /// Pixel rows.
    pub rows: std::ops::Range<u32>,
}

/// One ray of an image.
#[derive(Clone, Copy, Debug)]
pub struct PixelRay {
    /// Pixel column.
    pub column: u32,
    /// Pixel row, 0 on top.
    pub row: u32,
    /// World space.
    pub ray: Ray,
}

/// All tiles of an image, row by row.
pub(crate) fn tiles((width, height): (u32, u32)) -> Vec<Tile> {
    let spans = |length: u32| (0..length).step_by(TILE as usize).map(move |at| at..(at + TILE).min(length));
    spans(height)
        .flat_map(|rows| spans(width).map(move |columns| Tile { columns, rows: rows.clone() }))
        .collect()
}

/// The point of sample `index` within a pixel, in `0..1`: the R2 sequence (Roberts, "The Unreasonable Effectiveness of
/// Quasirandom Sequences", 2018), which starts in the middle, so that the first sample of a pixel is its centre.
pub fn sample_offset(index: u32) -> (f64, f64) {
    // 1/g and 1/g^2, g the plastic number, the real root of x^3 = x + 1.
    const STEPS: (f64, f64) = (0.754_877_666_246_692_8, 0.569_840_290_998_053_3);
    let at = |step: f64| (0.5 + f64::from(index) * step).fract();
    (at(STEPS.0), at(STEPS.1))
}

impl Tile {
    /// Pixels of the tile.
    pub fn pixels(&self) -> u64 {
        self.columns.len() as u64 * self.rows.len() as u64
    }
}

/// Calls `visit` for every ray of a tile: each pixel gets one for each of the `samples` ([`sample_offset`]).
pub fn for_each_pixel_ray(
    camera: &CameraRays,
    tile: &Tile,
    samples: std::ops::Range<u32>,
    mut visit: impl FnMut(PixelRay),
) {
    for sample in samples {
        let (x, y) = sample_offset(sample);
        for row in tile.rows.clone() {
            for column in tile.columns.clone() {
                let ray = camera.ray(f64::from(column) + x, f64::from(row) + y);
                visit(PixelRay { column, row, ray });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_pixel_once() {
        for (width, height) in [(1, 1), (8, 8), (9, 17), (100, 3)] {
            let mut seen = vec![0; (width * height) as usize];
            for tile in tiles((width, height)) {
                for row in tile.rows.clone() {
                    tile.columns.clone().for_each(|column| seen[(row * width + column) as usize] += 1);
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{width} x {height}");
        }
    }

    #[test]
    fn the_first_sample_is_the_middle_and_sixteen_fill_the_pixel() {
        assert_eq!(sample_offset(0), (0.5, 0.5));
        // Every quarter of the pixel gets its share.
        let mut quarters = [0; 4];
        for (x, y) in (0..16).map(sample_offset) {
            quarters[usize::from(x >= 0.5) + 2 * usize::from(y >= 0.5)] += 1;
        }
        assert!(quarters.iter().all(|&n| (3..=5).contains(&n)), "{quarters:?}");
    }
}

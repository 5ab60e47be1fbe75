//! Which rays a query casts: cells of a grid, tiles of cells, and points within a cell.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::camera::CameraRays;
use crate::ray::Ray;

/// Cells a side of a tile: neighbouring rays are cast together.
const TILE: u32 = 8;

/// A block of cells: columns and rows.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Columns of cells.
    pub columns: Range<u32>,
    /// Rows of cells.
    pub rows: Range<u32>,
}

impl Tile {
    /// Cells of the tile.
    pub fn cells(&self) -> u64 {
        self.columns.len() as u64 * self.rows.len() as u64
    }
}

/// One ray of an image.
#[derive(Clone, Copy, Debug)]
pub struct PixelRay {
    /// Column of its cell.
    pub column: u32,
    /// Row of its cell, 0 on top.
    pub row: u32,
    /// World space.
    pub ray: Ray,
}

/// Rays per pixel: N rays a pixel, or one ray every N pixels (`1/N`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaysPerPixel {
    rays: u32,
    /// 1 unless `rays` is.
    pixels: u32,
}

impl RaysPerPixel {
    /// One.
    pub const ONE: Self = RaysPerPixel { rays: 1, pixels: 1 };
    /// As many as any command takes, and as few: 1/65536.
    const MOST: u32 = 65_536;

    /// So many rays for each pixel; 0 is taken as 1.
    pub const fn rays(rays: u32) -> Self {
        RaysPerPixel { rays: if rays == 0 { 1 } else { rays }, pixels: 1 }
    }

    /// As a number.
    pub fn get(self) -> f64 {
        f64::from(self.rays) / f64::from(self.pixels)
    }

    /// Samples of each cell of the grid of rays ([`RayGrid`]): 1 where there is less than a ray a pixel.
    pub fn samples(self) -> u32 {
        self.rays
    }

    /// Side of a cell of that grid in pixels.
    pub fn spacing(self) -> f64 {
        f64::from(self.pixels).sqrt()
    }
}

impl FromStr for RaysPerPixel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (rays, pixels) = text.trim().split_once('/').unwrap_or((text.trim(), "1"));
        match (rays.trim().parse(), pixels.trim().parse()) {
            (Ok(rays), Ok(1)) if (1..=Self::MOST).contains(&rays) => Ok(RaysPerPixel { rays, pixels: 1 }),
            (Ok(1), Ok(pixels)) if (1..=Self::MOST).contains(&pixels) => Ok(RaysPerPixel { rays: 1, pixels }),
            _ => Err(format!("expected rays per pixel such as 4, 1 or 1/16, found \"{text}\"")),
        }
    }
}

impl fmt::Display for RaysPerPixel {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        if self.pixels == 1 { write!(to, "{}", self.rays) } else { write!(to, "1/{}", self.pixels) }
    }
}

impl Serialize for RaysPerPixel {
    /// As a number, for programs that plot.
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_f64(self.get())
    }
}

/// Where in their cells the rays of one sample go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Jitter {
    /// To the same point of every cell ([`sample_offset`]): the first sample to all middles, as a picture has it.
    Regular,
    /// To another point of each cell, so that nothing can hide between rows or columns of points: a post a third of a
    /// pixel wide is missed by all the middles of its column, or by none. The points of a sample are those of
    /// [`Jitter::Regular`] moved by steps of the same sequence along rows and columns (a Cranley-Patterson rotation, 1976).
    #[default]
    Scattered,
}

impl Jitter {
    /// The point of a sample in a cell, in `0..1`.
    pub fn offset(self, sample: u32, column: u32, row: u32) -> (f64, f64) {
        let (x, y) = sample_offset(sample);
        match self {
            Jitter::Regular => (x, y),
            Jitter::Scattered => {
                let (column, row) = (f64::from(column), f64::from(row));
                let (long, short) = STEPS;
                ((x + column * short + row * long).fract(), (y + column * long + row * short).fract())
            }
        }
    }
}

/// The square cells of an image in each of which a query casts as many rays: pixels, or larger ones where there is less
/// than a ray a pixel. The last column and row may reach beyond the image; rays there are left out.
#[derive(Clone, Copy)]
pub struct RayGrid<'a> {
    camera: &'a CameraRays,
    /// Side of a cell, pixels.
    spacing: f64,
    columns: u32,
    rows: u32,
    jitter: Jitter,
}

impl<'a> RayGrid<'a> {
    /// The cells for that many rays.
    pub fn new(camera: &'a CameraRays, rays: RaysPerPixel, jitter: Jitter) -> Self {
        let spacing = rays.spacing();
        let cells = |pixels: u32| (f64::from(pixels) / spacing).ceil() as u32;
        let (width, height) = camera.size();
        RayGrid { camera, spacing, columns: cells(width), rows: cells(height), jitter }
    }

    /// All tiles, row by row.
    pub fn tiles(&self) -> Vec<Tile> {
        let spans =
            |length: u32| (0..length).step_by(TILE as usize).map(move |at| at..(at + TILE).min(length));
        spans(self.rows)
            .flat_map(|rows| spans(self.columns).map(move |columns| Tile { columns, rows: rows.clone() }))
            .collect()
    }

    /// Calls `visit` for one ray of each cell of a tile: that of this sample.
    pub fn for_each_ray(&self, tile: &Tile, sample: u32, mut visit: impl FnMut(PixelRay)) {
        let (width, height) = self.camera.size();
        for row in tile.rows.clone() {
            for column in tile.columns.clone() {
                let (x, y) = self.jitter.offset(sample, column, row);
                let (x, y) = ((f64::from(column) + x) * self.spacing, (f64::from(row) + y) * self.spacing);
                if x < f64::from(width) && y < f64::from(height) {
                    visit(PixelRay { column, row, ray: self.camera.ray(x, y) });
                }
            }
        }
    }
}

/// 1/g and 1/g^2, g the plastic number, the real root of x^3 = x + 1.
const STEPS: (f64, f64) = (0.754_877_666_246_692_8, 0.569_840_290_998_053_3);

/// The point of sample `index` within a cell, in `0..1`: the R2 sequence (Roberts, "The Unreasonable Effectiveness of
/// Quasirandom Sequences", 2018), which starts in the middle, so that the first sample of a pixel is its centre.
pub fn sample_offset(index: u32) -> (f64, f64) {
    let at = |step: f64| (0.5 + f64::from(index) * step).fract();
    (at(STEPS.0), at(STEPS.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};

    fn camera(width: u32, height: u32) -> CameraRays {
        let projection = Projection::Perspective { fov_y_deg: 60.0 };
        let (eye, target, up) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        Camera { eye, target, up, projection, width, height }.rays().unwrap()
    }

    #[test]
    fn tiles_cover_every_pixel_once() {
        for (width, height) in [(1, 1), (8, 8), (9, 17), (100, 3)] {
            let mut seen = vec![0; (width * height) as usize];
            for tile in RayGrid::new(&camera(width, height), RaysPerPixel::ONE, Jitter::Regular).tiles() {
                for row in tile.rows.clone() {
                    tile.columns.clone().for_each(|column| seen[(row * width + column) as usize] += 1);
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{width} x {height}");
        }
    }

    #[test]
    fn a_fraction_of_a_ray_per_pixel_is_one_ray_in_as_many_pixels() {
        for (width, height, rays) in [(64, 64, "1/16"), (100, 60, "1/4"), (97, 31, "1/7"), (3, 1000, "1/64")]
        {
            let (camera, rays): (_, RaysPerPixel) = (camera(width, height), rays.parse().unwrap());
            let grid = RayGrid::new(&camera, rays, Jitter::Scattered);
            let frames = 200;
            let mut count = 0;
            for (sample, tile) in
                (0..frames).flat_map(|s| grid.tiles().into_iter().map(move |tile| (s, tile)))
            {
                grid.for_each_ray(&tile, sample, |_| count += 1);
            }
            let per_frame = f64::from(count) / f64::from(frames);
            let expected = f64::from(width * height) * rays.get();
            assert!(
                (per_frame / expected - 1.0).abs() < 0.03,
                "{width} x {height} at {rays}: {per_frame} rays"
            );
        }
    }

    #[test]
    fn scattered_points_leave_no_gap_between_rows_or_columns() {
        // A post or a beam `width` pixels wide and 48 pixels long, anywhere: middles of pixels miss most of the thin ones.
        for width in [0.05, 0.1, 0.3] {
            for start in 0..200u32 {
                let at = f64::from(start) / 200.0 * (1.0 - width);
                let is_met = |jitter: Jitter, sample: u32, upright: bool| {
                    (0..48).any(|i| {
                        let (column, row) = if upright { (start, i) } else { (i, start) };
                        let (x, y) = jitter.offset(sample, column, row);
                        (at..at + width).contains(if upright { &x } else { &y })
                    })
                };
                for (sample, upright) in [(0, true), (0, false), (7, true), (1 << 24, false)] {
                    let place = format!("{width} px wide at {at}, sample {sample}, upright {upright}");
                    assert!(is_met(Jitter::Scattered, sample, upright), "{place}");
                }
            }
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

    #[test]
    fn rays_per_pixel_are_whole_or_a_fraction_of_one() {
        for (text, value, shown) in
            [("4", 4.0, "4"), (" 1/16 ", 0.0625, "1/16"), ("1/1", 1.0, "1"), ("65536", 65536.0, "65536")]
        {
            let rays: RaysPerPixel = text.parse().unwrap();
            assert_eq!((rays.get(), rays.to_string().as_str()), (value, shown), "{text}");
        }
        for bad in ["0", "1/0", "-1", "3/4", "0.5", "1/", "", "65537", "1/65537", "many"] {
            assert!(bad.parse::<RaysPerPixel>().unwrap_err().contains("1/16"), "{bad}");
        }
    }
}

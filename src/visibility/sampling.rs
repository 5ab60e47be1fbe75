//! Which rays a query casts: cells of a grid, tiles of cells, and points within a cell.
//!
//! At 1/n ray per pixel a cell is n pixels. Where n is a square (1/4, 1/9, 1/16, ...) these are k x k whole pixels, and n
//! successive samples cast exactly the rays that one sample casts at one ray per pixel, each once. At any other n
//! (1/2, 1/7, ...) the points of a cell are those of the R2 sequence: no two alike, but after n samples some
//! pixels have had two rays and about one in eight none.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use super::pixel_order::PixelOrder;
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

/// Cells of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    All,
    /// One of every four in a row or column, so that nothing runs between them: of 4 x 4 a solution of the four queens.
    Quarter,
    /// All but these.
    Rest,
}

impl Part {
    fn has(self, column: u32, row: u32) -> bool {
        let is_quarter = || (column + 2 * row + row / 2).is_multiple_of(4);
        match self {
            Part::All => true,
            Part::Quarter => is_quarter(),
            Part::Rest => !is_quarter(),
        }
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
///
/// Where N is a square (1/4, 1/9, 1/16), N samples of `1/N` cast exactly the rays that one sample casts at one ray per
/// pixel. At any other N (1/2, 1/7) they leave about one pixel in eight without a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaysPerPixel {
    rays: u32,
    /// 1 unless `rays` is.
    pixels: u32,
}

impl RaysPerPixel {
    /// One.
    pub const ONE: Self = RaysPerPixel { rays: 1, pixels: 1 };

    /// One for sixteen pixels: what a frame of a walk needs.
    pub const SIXTEENTH: Self = RaysPerPixel { rays: 1, pixels: 16 };
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

    /// That side where it is a whole number of pixels, more than one: 1/16 is a ray in each 4 x 4.
    fn whole_spacing(self) -> Option<u32> {
        let side = self.pixels.isqrt();
        (side > 1 && side * side == self.pixels).then_some(side)
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
        let (right, down) = self.shift(column, row);
        ((x + right).fract(), (y + down).fract())
    }

    /// How far the points of a cell are moved, at least 0.
    fn shift(self, column: u32, row: u32) -> (f64, f64) {
        match self {
            Jitter::Regular => (0.0, 0.0),
            Jitter::Scattered => {
                let (column, row) = (f64::from(column), f64::from(row));
                let (long, short) = STEPS;
                (column * short + row * long, column * long + row * short)
            }
        }
    }
}

/// The square cells of an image in each of which a query casts as many rays: pixels, or larger ones where there is less
/// than a ray a pixel. The last column and row may reach beyond the image; rays there are left out.
#[derive(Clone)]
pub struct RayGrid {
    camera: CameraRays,
    /// Side of a cell, pixels.
    spacing: f64,
    columns: u32,
    rows: u32,
    jitter: Jitter,
    /// Where cells are whole pixels: which of them comes when.
    order: Option<PixelOrder>,
}

impl RayGrid {
    /// The cells for that many rays.
    pub fn new(camera: &CameraRays, rays: RaysPerPixel, jitter: Jitter) -> Self {
        let spacing = rays.spacing();
        let cells = |pixels: u32| (f64::from(pixels) / spacing).ceil() as u32;
        let (width, height) = camera.size();
        let order = rays.whole_spacing().map(PixelOrder::new);
        RayGrid { camera: *camera, spacing, columns: cells(width), rows: cells(height), jitter, order }
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
    pub fn for_each_ray(&self, tile: &Tile, sample: u32, visit: impl FnMut(PixelRay)) {
        self.for_each_ray_of(tile, Part::All, sample, visit);
    }

    /// Rays that [`RayGrid::for_each_ray_of`] visits.
    pub(super) fn count_rays(&self, tile: &Tile, part: Part, sample: u32) -> u64 {
        let mut count = 0;
        self.for_each_ray_of(tile, part, sample, |_| count += 1);
        count
    }

    /// As [`RayGrid::for_each_ray`], for a part of the cells.
    pub(super) fn for_each_ray_of(
        &self,
        tile: &Tile,
        part: Part,
        sample: u32,
        mut visit: impl FnMut(PixelRay),
    ) {
        match &self.order {
            None => self.for_each_point(tile, part, &mut visit, |column, row| {
                let (x, y) = self.jitter.offset(sample, column, row);
                ((f64::from(column) + x) * self.spacing, (f64::from(row) + y) * self.spacing)
            }),
            Some(order) => {
                let (first, sample) = order.of_sample(sample);
                let side = order.side();
                self.for_each_point(tile, part, &mut visit, |column, row| {
                    let (right, down) = self.jitter.shift(column, row);
                    let (x, y) = order.shifted(first, (right.fract(), down.fract()));
                    // From here on as if the pixel were a cell of its own.
                    let (column, row) = (column * side + x, row * side + y);
                    let (x, y) = self.jitter.offset(sample, column, row);
                    (f64::from(column) + x, f64::from(row) + y)
                });
            }
        }
    }

    /// Calls `visit` for a ray of each cell of a tile through the point that is given for the cell, in pixels.
    fn for_each_point(
        &self,
        tile: &Tile,
        part: Part,
        visit: &mut impl FnMut(PixelRay),
        point: impl Fn(u32, u32) -> (f64, f64),
    ) {
        let (width, height) = self.camera.size();
        for row in tile.rows.clone() {
            for column in tile.columns.clone().filter(|&column| part.has(column, row)) {
                let (x, y) = point(column, row);
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
    fn a_quarter_of_a_tile_is_in_every_row_and_column_and_the_rest_is_the_rest() {
        let camera = camera(64, 40);
        let grid = RayGrid::new(&camera, RaysPerPixel::ONE, Jitter::Scattered);
        for tile in grid.tiles() {
            let cells = |part| {
                let mut cells = Vec::new();
                grid.for_each_ray_of(&tile, part, 3, |cell| cells.push((cell.column, cell.row)));
                cells
            };
            let (quarter, rest) = (cells(Part::Quarter), cells(Part::Rest));
            for line in 0..8 {
                let in_column = quarter.iter().filter(|&&(column, _)| column == tile.columns.start + line);
                let in_row = quarter.iter().filter(|&&(_, row)| row == tile.rows.start + line);
                assert_eq!((in_column.count(), in_row.count()), (2, 2), "{tile:?}, line {line}");
            }
            let mut both = [quarter, rest].concat();
            let mut all = cells(Part::All);
            both.sort_unstable();
            all.sort_unstable();
            assert_eq!(both, all);
        }
    }

    #[test]
    fn samples_of_cells_of_whole_pixels_are_the_rays_of_one_sample_a_pixel() {
        // In a last column or row, too, where cells reach beyond the image.
        for (jitter, sample) in [(Jitter::Regular, 0), (Jitter::Scattered, 0), (Jitter::Scattered, 5)] {
            for side in [1u32, 2, 3, 4, 8] {
                let camera = camera(37, 22);
                let all = |rays: RaysPerPixel, samples: Range<u32>| {
                    let grid = RayGrid::new(&camera, rays, jitter);
                    let mut directions = Vec::new();
                    for (sample, tile) in
                        samples.flat_map(|s| grid.tiles().into_iter().map(move |tile| (s, tile)))
                    {
                        grid.for_each_ray(&tile, sample, |cell| {
                            directions.push(cell.ray.direction.to_array())
                        });
                    }
                    directions.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    directions
                };
                let n = side * side;
                let by_pixel = all(RaysPerPixel::ONE, sample..sample + 1);
                let by_cell = all(format!("1/{n}").parse().unwrap(), sample * n..(sample + 1) * n);
                assert_eq!(by_pixel.len(), 37 * 22);
                assert!(by_cell == by_pixel, "{jitter:?}, sample {sample}, cells of {side} x {side}");
            }
        }
    }

    #[test]
    fn scattered_cells_of_whole_pixels_leave_no_gap_either() {
        // A post or a beam a tenth of a cell wide and 48 cells long, in one sample.
        let (columns, width) = (48, 0.1);
        for side in [2u32, 4, 8] {
            let camera = camera(columns * side, columns * side);
            let rays = RaysPerPixel { rays: 1, pixels: side * side };
            let grid = RayGrid::new(&camera, rays, Jitter::Scattered);
            for sample in [0, 7, 1 << 24] {
                let mut points = [vec![Vec::new(); columns as usize], vec![Vec::new(); columns as usize]];
                for tile in grid.tiles() {
                    grid.for_each_ray(&tile, sample, |cell| {
                        // Where in the image the ray goes, in cells.
                        let (right, down) = camera.pixel_steps();
                        let direction = cell.ray.direction - camera.ray(0.0, 0.0).direction;
                        let at = [right, down]
                            .map(|step| direction.dot(step) / step.length_squared() / f64::from(side));
                        points[0][cell.column as usize].push(at[0] - f64::from(cell.column));
                        points[1][cell.row as usize].push(at[1] - f64::from(cell.row));
                    });
                }
                for line in points.iter_mut().flatten() {
                    line.sort_by(f64::total_cmp);
                    let starts = std::iter::once(0.0).chain(line.iter().copied());
                    let gaps = starts.zip(line.iter().copied().chain([1.0])).map(|(a, b)| b - a);
                    let widest = gaps.fold(0.0, f64::max);
                    assert!(widest < width, "{side} x {side}, sample {sample}: a gap of {widest}");
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

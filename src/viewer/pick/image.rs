//! Picking from an image of drawables and depths.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use glam::UVec2;

use crate::render::NOBODY;

/// A drawable that fills a square of so many pixels a side is not thin.
const BROAD: u32 = 4;

/// Why an image cannot be picked from.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PickError {
    /// Too few or too many pixels.
    #[error(
        "an image of {width} x {height} pixels needs as many drawables and depths; \
         there are {drawables} drawables and {depths} depths: pass both of the same frame, with its size"
    )]
    Size {
        /// Pixels a row, as given.
        width: u32,
        /// Rows, as given.
        height: u32,
        /// Drawables given.
        drawables: usize,
        /// Depths given.
        depths: usize,
    },
}

/// What a window shows, row by row from the top.
#[derive(Clone, Copy, Debug)]
pub struct PickImage<'a> {
    drawables: &'a [u32],
    depths: &'a [f32],
    width: u32,
    height: u32,
}

/// A pixel that was picked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelPick {
    /// What the pixel shows; never [`NOBODY`].
    pub drawable: u32,
    /// Which pixel: column, row.
    pub pixel: UVec2,
    /// Its depth along the view, world units.
    pub depth: f32,
}

impl<'a> PickImage<'a> {
    /// An image of `(width, height)` pixels: the drawable of each ([`NOBODY`] where nothing is) and its depth along the view
    /// (infinite where nothing is).
    ///
    /// # Errors
    ///
    /// Not as many pixels as the size says.
    pub fn new(
        drawables: &'a [u32],
        depths: &'a [f32],
        (width, height): (u32, u32),
    ) -> Result<Self, PickError> {
        let pixels = u64::from(width) * u64::from(height);
        if drawables.len() as u64 != pixels || depths.len() as u64 != pixels {
            let (drawables, depths) = (drawables.len(), depths.len());
            return Err(PickError::Size { width, height, drawables, depths });
        }
        Ok(PickImage { drawables, depths, width, height })
    }

    /// What a pixel shows; `None` where that is nothing, and beside the image.
    fn at(&self, pixel: UVec2) -> Option<PixelPick> {
        if pixel.x >= self.width || pixel.y >= self.height {
            return None;
        }
        let place = pixel.y as usize * self.width as usize + pixel.x as usize;
        let drawable = *self.drawables.get(place).filter(|&&drawable| drawable != NOBODY)?;
        Some(PixelPick { drawable, pixel, depth: *self.depths.get(place)? })
    }

    /// Pixels of the image within `radius` of `centre`, by columns and rows.
    fn around(&self, centre: UVec2, radius: u32) -> impl Iterator<Item = UVec2> + use<> {
        let span = |at: u32, size: u32| -> RangeInclusive<u32> {
            at.saturating_sub(radius)..=at.saturating_add(radius).min(size.saturating_sub(1))
        };
        let columns = span(centre.x, self.width);
        span(centre.y, self.height).flat_map(move |y| columns.clone().map(move |x| UVec2::new(x, y)))
    }

    /// Does a drawable nowhere fill a square of [`BROAD`] pixels near one of its pixels?
    fn is_thin(&self, pick: &PixelPick) -> bool {
        let fills = |corner: UVec2| {
            let mut square =
                (0..BROAD).flat_map(|y| (0..BROAD).map(move |x| corner.saturating_add(UVec2::new(x, y))));
            square.all(|pixel| self.at(pixel).is_some_and(|there| there.drawable == pick.drawable))
        };
        !self.around(pick.pixel, BROAD).any(fills)
    }
}

/// What a click at the pixel `at` means; `radius` is how many pixels a click may be off.
///
/// - Where the pixel shows nothing, the nearest pixel within the radius that shows something; of equally near ones the one in
///   front.
/// - Otherwise what the pixel shows, unless that is broad and something thin passes by in front of it: then the nearest of the
///   thin drawables. Thin is what fills no square of 4 x 4 pixels about there, so that a pipe or a wire before a wall can be hit,
///   but the edge of a large part does not grow. In front is what is nearer than the farthest pixel within the radius of the
///   drawable clicked at, so that a wire on a floor counts, but what is seen through a gap does not.
///
/// The answer is always a pixel of the image within the radius, and what that pixel shows.
pub fn pick_pixel(image: &PickImage, at: UVec2, radius: u32) -> Option<PixelPick> {
    let nearest = nearest_of_each(image, at, radius);
    let order = |a: &&Near, b: &&Near| {
        a.distance_squared.cmp(&b.distance_squared).then(a.pick.depth.total_cmp(&b.pick.depth))
    };
    let Some(clicked) = image.at(at) else {
        return nearest.values().min_by(order).map(|near| near.pick);
    };
    let behind = nearest.get(&clicked.drawable).map_or(clicked.depth, |near| near.farthest);
    let mut thin: Vec<&Near> = nearest
        .values()
        .filter(|near| near.pick.drawable != clicked.drawable && near.pick.depth < behind)
        .collect();
    if thin.is_empty() || image.is_thin(&clicked) {
        return Some(clicked);
    }
    thin.sort_by(order);
    let thin = thin.into_iter().find(|near| image.is_thin(&near.pick));
    Some(thin.map_or(clicked, |near| near.pick))
}

/// The drawables that have any pixel in the rectangle with the corners `a` and `b`, both included and in any order; sorted,
/// each once. What of the rectangle is beside the image holds nothing.
pub fn pick_rectangle(image: &PickImage, a: UVec2, b: UVec2) -> Vec<u32> {
    let (low, high) = (a.min(b), a.max(b).saturating_add(UVec2::ONE));
    let high = high.min(UVec2::new(image.width, image.height));
    let mut found = BTreeSet::new();
    for row in low.y..high.y {
        let start = row as usize * image.width as usize;
        let columns = start + low.x as usize..start + high.x as usize;
        // Empty where the rectangle is beside the image: the range begins after it ends then.
        let pixels = image.drawables.get(columns).unwrap_or_default();
        found.extend(pixels.chunk_by(|a, b| a == b).filter_map(|run| run.first()));
    }
    found.remove(&NOBODY);
    found.into_iter().collect()
}

/// A drawable within the radius.
struct Near {
    /// Its pixel that is nearest to the cursor; of several the one in front.
    pick: PixelPick,
    /// Of that pixel from the cursor's, squared pixels.
    distance_squared: u64,
    /// Depth of its farthest pixel within the radius.
    farthest: f32,
}

/// All drawables within the radius.
fn nearest_of_each(image: &PickImage, at: UVec2, radius: u32) -> BTreeMap<u32, Near> {
    let mut found: BTreeMap<u32, Near> = BTreeMap::new();
    for pick in image.around(at, radius).filter_map(|pixel| image.at(pixel)) {
        let square = |a: u32, b: u32| u64::from(a.abs_diff(b)).pow(2);
        let distance_squared = square(pick.pixel.x, at.x).saturating_add(square(pick.pixel.y, at.y));
        if distance_squared > u64::from(radius).pow(2) {
            continue;
        }
        let near =
            found.entry(pick.drawable).or_insert(Near { pick, distance_squared, farthest: pick.depth });
        near.farthest = near.farthest.max(pick.depth);
        if (distance_squared, pick.depth) < (near.distance_squared, near.pick.depth) {
            (near.pick, near.distance_squared) = (pick, distance_squared);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: u32 = 64;
    const WALL: u32 = 1;
    const PIPE: u32 = 2;
    const BALL: u32 = 3;

    /// Painted by functions that say what a pixel shows, and its depth.
    struct Canvas {
        drawables: Vec<u32>,
        depths: Vec<f32>,
    }

    impl Canvas {
        fn new() -> Self {
            let pixels = (SIZE * SIZE) as usize;
            Canvas { drawables: vec![NOBODY; pixels], depths: vec![f32::INFINITY; pixels] }
        }

        fn paint(mut self, drawable: u32, depth: f32, covers: impl Fn(i32, i32) -> bool) -> Self {
            for (i, (d, z)) in self.drawables.iter_mut().zip(&mut self.depths).enumerate() {
                let (x, y) = (i as i32 % SIZE as i32, i as i32 / SIZE as i32);
                if covers(x, y) && depth < *z {
                    (*d, *z) = (drawable, depth);
                }
            }
            self
        }

        fn image(&self) -> PickImage<'_> {
            PickImage::new(&self.drawables, &self.depths, (SIZE, SIZE)).unwrap()
        }

        fn pick(&self, x: u32, y: u32, radius: u32) -> Option<u32> {
            pick_pixel(&self.image(), UVec2::new(x, y), radius).map(|pick| pick.drawable)
        }
    }

    fn ball(x: i32, y: i32) -> bool {
        (x - 32).pow(2) + (y - 32).pow(2) <= 15 * 15
    }

    #[test]
    fn a_pipe_before_a_wall_is_hit_from_a_few_pixels_off_and_the_wall_from_farther() {
        for width in 1..=3 {
            let canvas = Canvas::new()
                .paint(WALL, 9.0, |_, _| true)
                .paint(PIPE, 5.0, |x, _| (30..30 + width).contains(&x));
            for (x, expected) in [(30, PIPE), (27, PIPE), (25, PIPE), (24, WALL), (10, WALL), (63, WALL)] {
                assert_eq!(canvas.pick(x, 40, 5), Some(expected), "{width} wide, column {x}");
            }
            let off = pick_pixel(&canvas.image(), UVec2::new(27, 40), 5).unwrap();
            assert_eq!((off.pixel, off.depth), (UVec2::new(30, 40), 5.0));
            assert_eq!(canvas.pick(29, 40, 0), Some(WALL), "without a radius");
        }
    }

    #[test]
    fn slanting_pipes_and_ends_of_pipes_are_thin_too() {
        let canvas =
            Canvas::new().paint(WALL, 9.0, |_, _| true).paint(PIPE, 5.0, |x, y| (x - y).abs() <= 1 && y < 40);
        assert_eq!(canvas.pick(33, 30, 5), Some(PIPE));
        assert_eq!(canvas.pick(40, 41, 4), Some(PIPE), "its end");
        assert_eq!(canvas.pick(50, 50, 5), Some(WALL));
    }

    #[test]
    fn broad_things_do_not_grow_at_their_edges_and_corners() {
        let canvas = Canvas::new().paint(WALL, 9.0, |_, _| true).paint(BALL, 5.0, ball);
        for y in 0..SIZE {
            for x in 0..SIZE {
                let expected = if ball(x as i32, y as i32) { BALL } else { WALL };
                assert_eq!(canvas.pick(x, y, 6), Some(expected), "({x}, {y})");
            }
        }
        let corner = Canvas::new()
            .paint(WALL, 9.0, |_, _| true)
            .paint(BALL, 5.0, |x, y| x > 20 && y > 20 && x + y < 90);
        assert_eq!(corner.pick(19, 19, 4), Some(WALL));
    }

    #[test]
    fn the_pipe_that_is_clicked_at_beats_the_pipe_before_it() {
        let canvas = Canvas::new().paint(WALL, 9.0, |_, _| true).paint(PIPE, 5.0, |x, _| x == 30).paint(
            BALL,
            7.0,
            |_, y| y == 30,
        );
        assert_eq!(canvas.pick(33, 30, 5), Some(BALL));
        assert_eq!(canvas.pick(32, 27, 5), Some(PIPE), "the nearer of two thin ones");
    }

    #[test]
    fn what_is_seen_through_a_gap_does_not_beat_what_the_gap_is_in() {
        let canvas = Canvas::new().paint(WALL, 3.0, |x, _| x != 30).paint(PIPE, 8.0, |_, _| true);
        assert_eq!(canvas.pick(28, 30, 5), Some(WALL));
        assert_eq!(canvas.pick(30, 30, 5), Some(PIPE));
        // A floor that runs away upwards, and a wire on it, above the cursor: farther than the floor there.
        let mut floor = Canvas::new();
        for y in 0..SIZE as i32 {
            floor = floor.paint(WALL, 100.0 - y as f32, |_, row| row == y);
        }
        let floor = floor.paint(PIPE, 69.5, |_, y| y == 30);
        assert_eq!(floor.pick(20, 33, 5), Some(PIPE));
    }

    #[test]
    fn beside_everything_the_nearest_is_picked_and_far_from_everything_nothing() {
        let canvas = Canvas::new().paint(BALL, 5.0, ball).paint(PIPE, 4.0, |x, _| x == 55);
        assert_eq!(canvas.pick(50, 32, 4), Some(BALL));
        assert_eq!(canvas.pick(52, 32, 4), Some(PIPE));
        assert_eq!(canvas.pick(32, 5, 11), None);
        assert_eq!(canvas.pick(32, 5, 12), Some(BALL));
        assert_eq!(Canvas::new().pick(32, 32, 500), None);
    }

    #[test]
    fn at_the_border_and_beyond_it_only_the_image_is_searched() {
        let canvas = Canvas::new().paint(WALL, 9.0, |x, _| x < 60).paint(PIPE, 5.0, |_, y| y == 63);
        assert_eq!(canvas.pick(0, 0, 5), Some(WALL));
        assert_eq!(canvas.pick(63, 63, 5), Some(PIPE));
        assert_eq!(canvas.pick(0, 61, 5), Some(PIPE));
        assert_eq!(canvas.pick(63, 0, 3), None);
        assert_eq!(canvas.pick(64, 63, 3), Some(PIPE), "a click beside the window");
        assert_eq!(canvas.pick(u32::MAX, u32::MAX, 3), None);
        assert_eq!(canvas.pick(64, 0, 5), Some(WALL), "(59, 0) is just near enough");
        assert_eq!(canvas.pick(u32::MAX, 0, u32::MAX), Some(PIPE), "its end at (63, 63) is nearest");
    }

    #[test]
    fn picks_are_pixels_of_the_image_within_the_radius_and_rectangles_hold_what_is_in_them() {
        let seed = 5;
        let mut random = oorandom::Rand64::new(seed);
        for round in 0..300 {
            let mut canvas = Canvas::new();
            for drawable in 0..random.rand_range(0..9) as u32 {
                let mut number = |end| random.rand_range(0..end) as i32;
                let (x, y, w, h) = (number(64), number(64), 1 + number(30), 1 + number(30));
                let inside = move |i, j| (x..x + w).contains(&i) && (y..y + h).contains(&j);
                canvas = canvas.paint(drawable, 1.0 + number(9) as f32, inside);
            }
            let image = canvas.image();
            let mut pixel = || UVec2::new(random.rand_range(0..70) as u32, random.rand_range(0..70) as u32);
            let (a, b) = (pixel(), pixel());
            let radius = round % 8;
            if let Some(pick) = pick_pixel(&image, a, radius) {
                assert_eq!(image.at(pick.pixel), Some(pick), "seed {seed}, round {round}");
                let off = pick.pixel.as_dvec2().distance(a.as_dvec2());
                assert!(off <= f64::from(radius), "seed {seed}, round {round}: {off}");
            }
            let (low, high) = (a.min(b), a.max(b));
            let pixels = (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| UVec2::new(x, y)));
            let inside: BTreeSet<u32> =
                pixels.filter_map(|pixel| image.at(pixel)).map(|pick| pick.drawable).collect();
            let expected: Vec<u32> = inside.into_iter().collect();
            assert_eq!(pick_rectangle(&image, a, b), expected, "seed {seed}, round {round}: {a} {b}");
        }
    }

    #[test]
    fn images_of_the_wrong_size_are_refused() {
        let error = PickImage::new(&[1, 2], &[0.0], (2, 1)).unwrap_err();
        assert!(
            error.to_string().contains("2 x 1 pixels") && error.to_string().contains("1 depths"),
            "{error}"
        );
        let empty = PickImage::new(&[], &[], (0, 7)).unwrap();
        assert_eq!(pick_pixel(&empty, UVec2::ZERO, 3), None);
        assert!(pick_rectangle(&empty, UVec2::ZERO, UVec2::splat(9)).is_empty());
    }
}

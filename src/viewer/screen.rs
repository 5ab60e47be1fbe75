//! Where points are in the image, and what of a segment or triangle is nearest to a place there.
//!
//! Points are relative to the eye, so that no digits are lost far from the origin. Places in the image are in pixels from the
//! upper left corner; the middle of pixel (i, j) is (i + 0.5, j + 0.5).

use std::cmp::Ordering;

use glam::{DVec2, DVec3};

use crate::camera::{CameraRays, Plane};
use crate::filter::Filter;

/// Distances in the image that differ by less than one in so many pixels count as equal: what lies exactly behind one another
/// is told apart by depth, not by rounding.
const STEPS_PER_PIXEL: f64 = 1024.0;

/// A camera's image, and what is left out of it.
pub struct Screen {
    forward: DVec3,
    /// Pixels a unit to the right and down: at depth 1, or anywhere in a parallel projection.
    right: DVec3,
    down: DVec3,
    middle: DVec2,
    is_parallel: bool,
    /// Sides of the image and clip planes, relative to the eye.
    planes: Vec<Plane>,
}

/// A projected point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnScreen {
    /// Pixels.
    pub at: DVec2,
    /// Along the view, world units.
    pub depth: f64,
}

/// A point near a place in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Pixels from that place.
    pub distance: f64,
    /// Relative to the eye.
    pub point: DVec3,
    /// Where it is in the image.
    pub on_screen: OnScreen,
}

impl Nearest {
    /// By distance in the image; equal ones front to back.
    pub fn compare(&self, other: &Nearest) -> Ordering {
        let steps = |near: &Nearest| (near.distance * STEPS_PER_PIXEL).round();
        let by_distance = steps(self).total_cmp(&steps(other));
        by_distance.then(self.on_screen.depth.total_cmp(&other.on_screen.depth))
    }
}

impl Screen {
    /// The image of a camera behind the clip planes of a filter.
    pub fn new(camera: &CameraRays, filter: &Filter) -> Self {
        let (per_column, per_row) = camera.pixel_steps();
        let (width, height) = camera.size();
        let relative = |plane: &Plane| Plane { point: plane.point - camera.eye(), ..*plane };
        Screen {
            forward: camera.forward(),
            right: per_column / per_column.length_squared(),
            down: per_row / per_row.length_squared(),
            middle: 0.5 * DVec2::new(width.into(), height.into()),
            is_parallel: camera.is_parallel(),
            planes: camera.frustum().iter().chain(filter.clip_planes()).map(relative).collect(),
        }
    }

    /// Where a point is in the image, or beside it; `None` where it is not before the eye.
    pub fn project(&self, point: DVec3) -> Option<OnScreen> {
        self.project_line(point).filter(|on_screen| on_screen.depth > 0.0)
    }

    /// Where the line through a point and the eye, in a parallel projection along the view, is in the image; `None` where
    /// that is nowhere.
    fn project_line(&self, point: DVec3) -> Option<OnScreen> {
        let depth = point.dot(self.forward);
        let scale = if self.is_parallel { 1.0 } else { depth.recip() };
        let at = self.middle + scale * DVec2::new(point.dot(self.right), point.dot(self.down));
        at.is_finite().then_some(OnScreen { at, depth })
    }

    /// Is a point within the image and inside all clip planes?
    pub fn holds(&self, point: DVec3) -> bool {
        self.planes.iter().all(|plane| height(plane, point) >= 0.0)
    }

    /// A point beside a place in the image.
    pub fn near_point(&self, point: DVec3, place: DVec2) -> Option<Nearest> {
        Some(near(self.project(point)?, point, place))
    }

    /// The point of a segment that is nearest to a place in the image, of what is seen of the segment.
    pub fn near_segment(&self, a: DVec3, b: DVec3, place: DVec2) -> Option<Nearest> {
        let (a, b) = self.clipped_segment(a, b)?;
        self.near_clipped(a, b, place)
    }

    /// The point of a triangle's outline that is nearest to a place in the image, of what is seen of the triangle.
    pub fn near_outline(&self, triangle: [DVec3; 3], place: DVec2) -> Option<Nearest> {
        let corners = self.clipped_triangle(triangle);
        let next = corners.iter().cycle().skip(1);
        let sides = corners.iter().zip(next);
        sides.filter_map(|(&a, &b)| self.near_clipped(a, b, place)).min_by(Nearest::compare)
    }

    /// Of a segment that is seen as a whole. Its depth is not asked for: where a parallel projection cut it at the plane of the
    /// eye, that is 0 but for rounding.
    fn near_clipped(&self, a: DVec3, b: DVec3, place: DVec2) -> Option<Nearest> {
        let (from, to) = (self.project_line(a)?, self.project_line(b)?);
        let along = to.at - from.at;
        // Not a number where the segment is seen end-on: its nearer end, then.
        let s = ((place - from.at).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        let s = if s.is_nan() { f64::from(to.depth < from.depth) } else { s };
        // Depth is not linear in the image, its reciprocal is.
        let weight = s * from.depth;
        let in_space = if self.is_parallel { s } else { weight / (weight + (1.0 - s) * to.depth) };
        let point = a.lerp(b, in_space);
        Some(near(self.project_line(point)?, point, place))
    }

    /// What is seen of a segment.
    pub fn clipped_segment(&self, a: DVec3, b: DVec3) -> Option<(DVec3, DVec3)> {
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for plane in &self.planes {
            let (from, to) = (height(plane, a), height(plane, b));
            match (from < 0.0, to < 0.0) {
                (true, true) => return None,
                (true, false) => enter = enter.max(from / (from - to)),
                (false, true) => leave = leave.min(from / (from - to)),
                (false, false) => {}
            }
        }
        (enter <= leave).then(|| (a.lerp(b, enter), a.lerp(b, leave)))
    }

    /// Corners of what is seen of a triangle, in order (Sutherland and Hodgman, "Reentrant Polygon Clipping", 1974).
    fn clipped_triangle(&self, triangle: [DVec3; 3]) -> Vec<DVec3> {
        let mut corners = triangle.to_vec();
        for plane in &self.planes {
            if corners.iter().any(|&corner| height(plane, corner) < 0.0) {
                corners = cut(&corners, plane);
            }
        }
        corners
    }
}

fn near(on_screen: OnScreen, point: DVec3, place: DVec2) -> Nearest {
    Nearest { distance: on_screen.at.distance(place), point, on_screen }
}

/// How far inside a plane, in lengths of its normal.
fn height(plane: &Plane, point: DVec3) -> f64 {
    plane.normal.dot(point - plane.point)
}

/// The part of a convex polygon that is inside a plane.
pub fn cut(corners: &[DVec3], plane: &Plane) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (&a, &b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        let (from, to) = (height(plane, a), height(plane, b));
        if from >= 0.0 {
            kept.push(a);
        }
        if (from < 0.0) != (to < 0.0) {
            kept.push(a.lerp(b, from / (from - to)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};

    /// A camera at a random place around `centre`, perspective or parallel.
    fn camera(random: &mut oorandom::Rand64, centre: DVec3) -> CameraRays {
        let eye = centre + 10.0 * vector(random);
        let target = eye + vector(random);
        let projection = if random.rand_float() < 0.5 {
            Projection::Perspective { fov_y_deg: 20.0 + 80.0 * random.rand_float() }
        } else {
            Projection::Orthographic { height: 1.0 + 9.0 * random.rand_float() }
        };
        let (eye, target) = (eye.into(), target.into());
        Camera { eye, target, up: vector(random).into(), projection, width: 320, height: 200 }.rays().unwrap()
    }

    fn vector(random: &mut oorandom::Rand64) -> DVec3 {
        DVec3::new(random.rand_float(), random.rand_float(), random.rand_float()) * 2.0 - 1.0
    }

    #[test]
    fn points_of_a_ray_project_to_where_it_goes_through() {
        for (seed, offset) in [(1, 0.0), (2, 1e7)] {
            let mut random = oorandom::Rand64::new(seed);
            for round in 0..500 {
                let camera = camera(&mut random, DVec3::splat(offset));
                let screen = Screen::new(&camera, &Filter::default());
                let place = DVec2::new(320.0 * random.rand_float(), 200.0 * random.rand_float());
                let depth = 0.1 + 50.0 * random.rand_float();
                let point = camera.ray(place.x, place.y).at(depth) - camera.eye();
                let found = screen.project(point).unwrap();
                let off = found.at.distance(place);
                let tolerance = if offset > 0.0 { 1e-4 } else { 1e-8 };
                assert!(off < tolerance, "seed {seed}, round {round}: {found:?} instead of {place}");
                assert!((found.depth - depth).abs() < 1e-7, "seed {seed}, round {round}");
                assert!(screen.holds(point) && screen.project(-point).is_none());
            }
        }
    }

    #[test]
    fn the_nearest_point_of_a_segment_is_that_of_many_points_along_it() {
        let (seed, mut found_any) = (3, 0);
        let mut random = oorandom::Rand64::new(seed);
        for round in 0..300 {
            let camera = camera(&mut random, DVec3::ZERO);
            let mut filter = Filter::default();
            if round % 2 == 0 {
                filter.clip_by(Plane { normal: vector(&mut random), point: 5.0 * vector(&mut random) });
            }
            let screen = Screen::new(&camera, &filter);
            let (a, b) = (8.0 * vector(&mut random), 8.0 * vector(&mut random));
            let place = DVec2::new(320.0 * random.rand_float(), 200.0 * random.rand_float());
            let points = (0..=20_000).map(|i| a.lerp(b, f64::from(i) / 20_000.0));
            let seen = points.filter(|&point| screen.holds(point));
            let sampled = seen.filter_map(|point| screen.near_point(point, place)).min_by(Nearest::compare);
            let found = screen.near_segment(a, b, place);
            let outline = screen.near_outline([a, b, b], place);
            assert_eq!(found.is_some(), outline.is_some(), "seed {seed}, round {round}");
            // Near the eye the samples are far apart in the image: they may be worse, never better.
            if let Some(sampled) = sampled {
                let found = found.unwrap_or_else(|| panic!("seed {seed}, round {round}: nothing found"));
                let gain = sampled.distance - found.distance;
                assert!((-1e-6..2.0).contains(&gain), "seed {seed}, round {round}: {sampled:?} {found:?}");
                assert!((outline.unwrap().distance - found.distance).abs() < 1e-6, "seed {seed}, {round}");
                found_any += 1;
            }
        }
        assert!(found_any > 50, "{found_any}");
    }
}

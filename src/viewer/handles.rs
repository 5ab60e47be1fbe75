//! What is dragged in the picture: arrows and rings about what is selected, arrows of section planes.
//!
//! World space in f64; places in the image are pixels from its upper left corner.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::action::AxisName;
use super::screen::{Nearest, Screen, cut};
use crate::camera::{CameraRays, Plane};
use crate::ray::Ray;

/// Length of an arrow, pixels.
const ARROW: f64 = 90.0;
/// Radius of a ring, pixels.
const RING: f64 = 70.0;
/// Sides of a drawn ring.
const RING_SIDES: u32 = 48;
/// How near to a handle the cursor takes it, pixels.
const GRAB: f64 = 7.0;
/// A ring that is seen at less than this, as a sine, is turned by moving along it: its plane is next to nowhere under the cursor.
const EDGE_ON: f64 = 0.15;

/// What a handle does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// Moves what is selected along an axis.
    Along(AxisName),
    /// Turns it about one.
    About(AxisName),
    /// Moves a section plane along its normal; its number.
    Section(usize),
}

/// Where a handle is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// From a point to another.
    Arrow {
        /// Its foot.
        from: DVec3,
        /// Its tip.
        to: DVec3,
    },
    /// A circle.
    Ring {
        /// Its middle.
        centre: DVec3,
        /// What it turns about, length 1.
        axis: DVec3,
        /// From the middle.
        radius: f64,
    },
}

impl Shape {
    /// The line that it is drawn as.
    pub fn line(&self) -> Vec<DVec3> {
        match *self {
            Shape::Arrow { from, to } => vec![from, to],
            Shape::Ring { centre, axis, radius } => {
                let (a, b) = axis.any_orthonormal_pair();
                let at = |side: u32| {
                    let (sin, cos) = (TAU * f64::from(side) / f64::from(RING_SIDES)).sin_cos();
                    centre + radius * (cos * a + sin * b)
                };
                (0..=RING_SIDES).map(at).collect()
            }
        }
    }
}

/// Handles about a point: three arrows and three rings, as large in the image wherever it is.
pub fn of_selection(camera: &CameraRays, centre: DVec3) -> Vec<(Handle, Shape)> {
    let Some(pixel) = pixel_at(camera, centre) else { return Vec::new() };
    let arrow = |axis: AxisName| {
        let to = centre + ARROW * pixel * axis.unit();
        (Handle::Along(axis), Shape::Arrow { from: centre, to })
    };
    let ring = |axis: AxisName| {
        (Handle::About(axis), Shape::Ring { centre, axis: axis.unit(), radius: RING * pixel })
    };
    AxisName::ALL.map(arrow).into_iter().chain(AxisName::ALL.map(ring)).collect()
}

/// The arrow of a section plane, from the middle of what is seen of it within a box towards what is kept; nothing where none of it
/// is seen.
pub fn of_section(camera: &CameraRays, plane: &Plane, (min, max): (DVec3, DVec3)) -> Option<Shape> {
    let outline = outline(plane, min, max);
    let seen = camera.frustum().iter().fold(outline, |corners, side| cut(&corners, side));
    let count = seen.len().max(1) as f64;
    let from = seen.into_iter().reduce(|a, b| a + b)? / count;
    let to = from + ARROW * pixel_at(camera, from)? * plane.normal.try_normalize()?;
    Some(Shape::Arrow { from, to })
}

/// Corners of what a plane cuts out of a box, in order; none where they do not meet.
pub fn outline(plane: &Plane, min: DVec3, max: DVec3) -> Vec<DVec3> {
    let Some(normal) = plane.normal.try_normalize() else { return Vec::new() };
    let (a, b) = normal.any_orthonormal_pair();
    let centre = 0.5 * (min + max);
    let foot = centre - normal * normal.dot(centre - plane.point);
    let reach = (max - min).length();
    let square = [a + b, b - a, -a - b, a - b].map(|corner| foot + reach * corner);
    AxisName::ALL.iter().fold(square.to_vec(), |corners, axis| {
        let axis = axis.unit();
        let corners = cut(&corners, &Plane { normal: axis, point: min });
        cut(&corners, &Plane { normal: -axis, point: max })
    })
}

/// The handle under the cursor, nearest first.
pub fn under(handles: &[(Handle, Shape)], camera: &CameraRays, cursor: DVec2) -> Option<(Handle, Shape)> {
    let screen = Screen::new(camera, &Default::default());
    let nearest = |(_, shape): &(Handle, Shape)| -> Option<Nearest> {
        let line = shape.line();
        let near = |ends: &[DVec3]| {
            let &[a, b] = ends else { return None };
            screen.near_segment(a - camera.eye(), b - camera.eye(), cursor)
        };
        line.windows(2).filter_map(near).min_by(Nearest::compare)
    };
    let found = handles.iter().filter_map(|handle| Some((nearest(handle)?, handle)));
    let found = found.filter(|(near, _)| near.distance <= GRAB);
    found.min_by(|(a, _), (b, _)| a.compare(b)).map(|(_, handle)| *handle)
}

/// World units that a pixel covers at a point; `None` behind the eye.
fn pixel_at(camera: &CameraRays, point: DVec3) -> Option<f64> {
    let (right, _) = camera.pixel_steps();
    let depth = if camera.is_parallel() { 1.0 } else { (point - camera.eye()).dot(camera.forward()) };
    (depth > 0.0).then(|| depth * right.length()).filter(|pixel| pixel.is_finite())
}

/// A handle that is dragged.
#[derive(Clone, Copy, Debug)]
pub struct Drag {
    shape: Shape,
    /// Where it was taken: along the arrow, or as an angle.
    taken: f64,
    /// Where it is now; angles go on beyond a turn.
    now: f64,
    /// A ring that is seen from its side: a point of it, and the direction along it.
    tangent: Option<(DVec3, DVec3)>,
}

impl Drag {
    /// Taken where a ray of the camera passes it; `None` where that cannot be told.
    pub fn begin(shape: Shape, ray: &Ray) -> Option<Self> {
        let mut drag = Drag { shape, taken: 0.0, now: 0.0, tangent: None };
        if let Shape::Ring { centre, axis, radius } = shape {
            let towards = ray.direction.try_normalize()?;
            if towards.dot(axis).abs() < EDGE_ON {
                // The side that faces the eye.
                let out = -(towards - towards.dot(axis) * axis).try_normalize()?;
                drag.tangent = Some((centre + radius * out, axis.cross(out)));
            }
        }
        drag.taken = drag.place(ray)?;
        drag.now = drag.taken;
        Some(drag)
    }

    /// How far it has been dragged, world units or radians, when the cursor is at a ray of the camera; as far as before where that
    /// cannot be told.
    pub fn to(&mut self, ray: &Ray) -> f64 {
        if let Some(place) = self.place(ray) {
            let is_angle = matches!(self.shape, Shape::Ring { .. }) && self.tangent.is_none();
            // The nearest turn.
            let turns = if is_angle { ((self.now - place) / TAU).round() } else { 0.0 };
            self.now = place + turns * TAU;
        }
        self.now - self.taken
    }

    fn place(&self, ray: &Ray) -> Option<f64> {
        match (self.shape, self.tangent) {
            (Shape::Arrow { from, to }, _) => along(from, (to - from).try_normalize()?, ray),
            (Shape::Ring { radius, .. }, Some((point, direction))) => {
                along(point, direction, ray).map(|length| length / radius)
            }
            (Shape::Ring { centre, axis, .. }, None) => {
                let t = axis.dot(centre - ray.origin) / axis.dot(ray.direction);
                let out = ray.origin + t * ray.direction - centre;
                let (a, b) = axis.any_orthonormal_pair();
                let angle = out.dot(b).atan2(out.dot(a));
                (t > 0.0 && angle.is_finite()).then_some(angle)
            }
        }
    }
}

/// Where a line comes nearest to a ray, in lengths of `axis` (length 1) from `point`; `None` where it lies along the ray, and where
/// that is behind the ray's origin.
fn along(point: DVec3, axis: DVec3, ray: &Ray) -> Option<f64> {
    let direction = ray.direction.try_normalize()?;
    let away = ray.origin - point;
    let cos = axis.dot(direction);
    let sin_squared = 1.0 - cos * cos;
    if sin_squared < 1e-4 {
        return None;
    }
    let t = (cos * away.dot(axis) - away.dot(direction)) / sin_squared;
    (t > 0.0).then(|| away.dot(axis) + t * cos)
}

#[cfg(test)]
mod tests {
    use super::super::navigate::Random;
    use super::*;
    use crate::camera::{Camera, Projection};

    fn camera(random: &mut Random, centre: DVec3, is_parallel: bool) -> CameraRays {
        let direction = random.vector().normalize_or(DVec3::X);
        let projection = match is_parallel {
            true => Projection::Orthographic { height: 12.0 },
            false => Projection::Perspective { fov_y_deg: 50.0 },
        };
        let up = direction.any_orthonormal_vector().into();
        let eye = (centre + 10.0 * direction).into();
        Camera { eye, target: centre.into(), up, projection, width: 800, height: 600 }.rays().unwrap()
    }

    fn pixel_of(camera: &CameraRays, point: DVec3) -> DVec2 {
        Screen::new(camera, &Default::default()).project(point - camera.eye()).unwrap().at
    }

    #[test]
    fn an_arrow_follows_the_cursor() {
        for (seed, centre) in [(1, DVec3::ZERO), (2, DVec3::new(1e7, -2e7, 3e6))] {
            let mut random = Random::new(seed);
            let mut followed = 0;
            for round in 0..400 {
                let camera = camera(&mut random, centre, round % 2 == 0);
                let handles = of_selection(&camera, centre);
                let (_, shape) = handles[round % 3];
                let Shape::Arrow { from, to } = shape else { panic!("{shape:?}") };
                let (start, by) = (from.lerp(to, 0.7), 3.0 * random.unit() - 1.0);
                let end = start + by * (to - from).normalize_or_zero();
                let ray = |point| {
                    let at = pixel_of(&camera, point);
                    camera.ray(at.x, at.y)
                };
                let Some(mut drag) = Drag::begin(shape, &ray(start)) else { continue };
                let found = drag.to(&ray(end));
                assert!((found - by).abs() < 1e-4, "seed {seed}, round {round}: {found} {by}");
                followed += 1;
            }
            assert!(followed > 380, "{followed}");
        }
    }

    #[test]
    fn a_ring_follows_the_cursor_for_more_than_a_turn() {
        let mut random = Random::new(3);
        let mut edge_on = 0;
        for round in 0..300 {
            let camera = camera(&mut random, DVec3::ONE, round % 2 == 0);
            let (_, shape) = of_selection(&camera, DVec3::ONE)[3 + round % 3];
            let Shape::Ring { centre, axis, radius } = shape else { panic!("{shape:?}") };
            let (a, b) = axis.any_orthonormal_pair();
            let ray = |angle: f64| {
                let at = pixel_of(&camera, centre + radius * (angle.cos() * a + angle.sin() * b));
                camera.ray(at.x, at.y)
            };
            let from = TAU * random.unit();
            let mut drag = Drag::begin(shape, &ray(from)).unwrap();
            if drag.tangent.is_some() {
                edge_on += 1;
                continue;
            }
            // One turn and a half, in steps.
            let turn = 1.5 * TAU;
            let found = (1..=60).map(|step| drag.to(&ray(from + turn * f64::from(step) / 60.0))).last();
            assert!((found.unwrap() - turn).abs() < 1e-6, "seed 3, round {round}: {found:?}");
        }
        assert!(edge_on > 10, "{edge_on}");
        // From its side it turns the way the cursor moves along it.
        let camera = Camera {
            eye: [0.0, 0.0, 10.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            projection: Projection::Perspective { fov_y_deg: 50.0 },
            width: 800,
            height: 600,
        };
        let camera = camera.rays().unwrap();
        let ring = Shape::Ring { centre: DVec3::ZERO, axis: DVec3::Y, radius: 1.0 };
        let mut drag = Drag::begin(ring, &camera.ray(400.0, 300.0)).unwrap();
        // About Y, what is in front goes to the right.
        assert!(drag.to(&camera.ray(420.0, 300.0)) > 0.01);
    }

    #[test]
    fn the_handle_under_the_cursor_is_the_nearest_in_the_image() {
        let mut random = Random::new(5);
        for round in 0..200 {
            let camera = camera(&mut random, DVec3::ZERO, round % 2 == 0);
            let handles = of_selection(&camera, DVec3::ZERO);
            let Some(&(handle, Shape::Arrow { to, .. })) = handles.get(round % 3) else { panic!() };
            // Its tip stands out beyond the rings, unless it points at the eye.
            let at = pixel_of(&camera, to);
            if at.distance(DVec2::new(400.0, 300.0)) > RING + 10.0 {
                assert_eq!(under(&handles, &camera, at).map(|found| found.0), Some(handle), "round {round}");
            }
            assert_eq!(under(&handles, &camera, DVec2::new(5.0, 5.0)), None);
        }
    }

    #[test]
    fn a_plane_cuts_a_polygon_out_of_a_box() {
        let mut random = Random::new(7);
        let (min, max) = (DVec3::new(-1.0, -2.0, 5.0), DVec3::new(3.0, 1.0, 6.0));
        for round in 0..300 {
            let plane = Plane { normal: random.vector(), point: min + (max - min) * random.unit() };
            let corners = outline(&plane, min, max);
            assert!((3..=6).contains(&corners.len()), "seed 7, round {round}: {corners:?}");
            for corner in corners {
                assert!(plane.normal.dot(corner - plane.point).abs() < 1e-9);
                assert!(corner.cmpge(min - 1e-9).all() && corner.cmple(max + 1e-9).all());
            }
        }
        let beside = Plane { normal: DVec3::X, point: DVec3::splat(100.0) };
        assert!(outline(&beside, min, max).is_empty());
    }
}

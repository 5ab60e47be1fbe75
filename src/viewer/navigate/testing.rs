//! What the tests here share.

use glam::{DVec2, DVec3};

use super::{Navigator, Probe};
use crate::camera::Camera;

#[path = "../../../tests/common/random.rs"]
#[allow(dead_code, reason = "what other tests use")]
mod random;
pub(in crate::viewer) use random::Random;

/// A window.
pub(super) const SIZE: (u32, u32) = (640, 480);

/// In a scene of metres, 100 a side, around a centre.
pub(super) fn navigator(centre: DVec3, up: DVec3) -> Navigator {
    Navigator::new(centre - 50.0, centre + 50.0, up, 1.0).unwrap()
}

/// Where a point is in the picture, pixels from the upper left corner.
pub(super) fn pixel(navigator: &Navigator, point: DVec3) -> DVec2 {
    pixel_of(&navigator.camera(SIZE), point)
}

/// Where a point is in a camera's picture.
pub(super) fn pixel_of(camera: &Camera, point: DVec3) -> DVec2 {
    let rays = camera.rays().unwrap();
    let (right, down) = rays.pixel_steps();
    let from_eye = point - rays.eye();
    let depth = from_eye.dot(rays.forward());
    let in_image = if rays.is_parallel() { from_eye } else { from_eye / depth };
    let middle = 0.5 * DVec2::new(f64::from(camera.width), f64::from(camera.height));
    middle + DVec2::new(in_image.dot(right), in_image.dot(down)) / right.length_squared()
}

/// A box of these ranges.
pub(super) fn block(x: (f64, f64), y: (f64, f64), z: (f64, f64)) -> (DVec3, DVec3) {
    (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1))
}

/// Boxes whose faces stop rays from either side.
#[derive(Default)]
pub(super) struct Boxes(pub Vec<(DVec3, DVec3)>);

impl Probe for Boxes {
    fn distance(&self, origin: DVec3, direction: DVec3, most: f64) -> Option<f64> {
        let hit = |(min, max): &(DVec3, DVec3)| {
            let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
            for k in 0..3 {
                let (a, b) = ((min[k] - origin[k]) / direction[k], (max[k] - origin[k]) / direction[k]);
                if direction[k] != 0.0 {
                    enter = enter.max(a.min(b));
                    leave = leave.min(a.max(b));
                } else if origin[k] < min[k] || origin[k] > max[k] {
                    return None;
                }
            }
            let t = if enter >= 0.0 { enter } else { leave };
            (enter <= leave && (0.0..=most).contains(&t)).then_some(t)
        };
        self.0.iter().filter_map(hit).min_by(f64::total_cmp)
    }
}

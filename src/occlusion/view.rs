//! From the world to the pixels of a depth image.
//!
//! # Homogeneous pixels and nearness
//!
//! A point of the world becomes (X, Y, H, A): the centre of pixel (column, row) is at (X/H, Y/H) = (column, row), and its
//! *nearness* is A/H, greater when nearer and, at fixed pixels, linear along straight lines of the image:
//!
//! - perspective: H = depth / scale, A = 1; nearness = scale / depth, above 0.
//! - parallel: H = 1, A = (origin - depth) / scale, of either sign.
//!
//! Depth counts along the view from the eye. Nothing was ever seen at negative infinity ([`FARTHEST`]).

use glam::{DAffine3, DVec3};

use crate::camera::{CameraRays, Plane};

/// Nearness of a pixel where there is nothing.
pub const FARTHEST: f32 = f32::NEG_INFINITY;

/// Perspective: a point with a smaller H, in scene sizes, is taken to be at the eye or behind it.
pub(super) const LEAST_H: f64 = 1e-30;

/// The camera as the depth images see it.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// X, Y, and H (perspective) or A (parallel) of a vector from the eye.
    rows: [DVec3; 3],
    /// What is added to them.
    offsets: [f64; 3],
    eye: DVec3,
    forward: DVec3,
    is_parallel: bool,
    size: (u32, u32),
}

/// A point in homogeneous pixels, see the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Homogeneous {
    /// Column times `h`.
    pub x: f64,
    /// Row times `h`.
    pub y: f64,
    /// Perspective: depth in scene sizes. Parallel: 1.
    pub h: f64,
    /// Nearness times `h`.
    pub a: f64,
}

/// A [`View`] for the coordinates of a part: X, Y and the third, each `m[0] x + m[1] y + m[2] z + m[3]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartView {
    pub m: [[f64; 4]; 3],
    pub is_parallel: bool,
}

impl View {
    /// What `camera` sees. Nearness is scaled by `radius`, about the size of the scene, and in parallel projection
    /// counted from `centre`, about its middle: f32 then has the most digits where they are needed.
    pub fn new(camera: &CameraRays, centre: DVec3, radius: f64) -> Self {
        let (column, row) = camera.pixel_steps();
        let (eye, forward) = (camera.eye(), camera.forward());
        let first = camera.ray(0.5, 0.5);
        let scale = if radius > 0.0 && radius.is_finite() { radius.recip() } else { 1.0 };
        let (right, down) = (column / column.length_squared(), row / row.length_squared());
        let is_parallel = camera.is_parallel();
        let (rows, offsets) = if is_parallel {
            let corner = first.origin - eye;
            let middle = (centre - eye).dot(forward) * scale;
            ([right, down, -forward * scale], [-corner.dot(right), -corner.dot(down), middle])
        } else {
            // The centre of pixel (0, 0) at depth 1.
            let corner = first.direction - forward;
            let rows = [right - corner.dot(right) * forward, down - corner.dot(down) * forward, forward];
            (rows.map(|row| row * scale), [0.0; 3])
        };
        View { rows, offsets, eye, forward, is_parallel, size: camera.size() }
    }

    /// Pixels a row, rows.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Are all rays parallel? Tells what nearness is.
    pub fn is_parallel(&self) -> bool {
        self.is_parallel
    }

    /// Position of the eye, world space.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// View direction, length 1.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// What is at the eye's depth or beyond.
    pub fn eye_plane(&self) -> Plane {
        Plane { normal: self.forward, point: self.eye }
    }

    /// A point of the world.
    pub fn point(&self, world: DVec3) -> Homogeneous {
        let [x, y, third] = self.vector(world - self.eye);
        let [x, y, third] = [x + self.offsets[0], y + self.offsets[1], third + self.offsets[2]];
        self.homogeneous(x, y, third)
    }

    /// X, Y and the third coordinate of a vector: differences of points.
    pub(super) fn vector(&self, world: DVec3) -> [f64; 3] {
        self.rows.map(|row| row.dot(world))
    }

    fn homogeneous(&self, x: f64, y: f64, third: f64) -> Homogeneous {
        if self.is_parallel {
            Homogeneous { x, y, h: 1.0, a: third }
        } else {
            Homogeneous { x, y, h: third, a: 1.0 }
        }
    }

    /// The view of a placed part.
    pub(super) fn of_part(&self, world_from_part: &DAffine3) -> PartView {
        let axes = world_from_part.matrix3;
        let start = world_from_part.translation - self.eye;
        let row = |k: usize| {
            let row = self.rows[k];
            let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| row.dot(axis));
            [x, y, z, row.dot(start) + self.offsets[k]]
        };
        PartView { m: [row(0), row(1), row(2)], is_parallel: self.is_parallel }
    }
}

impl PartView {
    /// A point of the part; the same operations in the same order as the SIMD paths.
    #[inline(always)]
    pub fn point(&self, part: [f32; 3]) -> Homogeneous {
        let [x, y, z] = part.map(f64::from);
        let [x, y, third] = self.m.map(|m| x * m[0] + y * m[1] + z * m[2] + m[3]);
        if self.is_parallel {
            Homogeneous { x, y, h: 1.0, a: third }
        } else {
            Homogeneous { x, y, h: third, a: 1.0 }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};

    #[test]
    fn points_on_the_ray_of_a_pixel_are_at_that_pixel() {
        let perspective = Camera {
            eye: [1e7, -2e6, 30.0],
            target: [1e7 + 3.0, -2e6 + 1.0, 28.0],
            up: [0.0, 0.0, 1.0],
            projection: Projection::Perspective { fov_y_deg: 70.0 },
            width: 333,
            height: 77,
        };
        let parallel = Camera { projection: Projection::Orthographic { height: 12.0 }, ..perspective };
        for camera in [perspective, parallel] {
            let rays = camera.rays().unwrap();
            let view = View::new(&rays, rays.eye() + 40.0 * rays.forward(), 25.0);
            for (column, row, depth) in [(0.0, 0.0, 1.0), (332.0, 76.0, 90.0), (17.25, 40.5, 4.0)] {
                let point = view.point(rays.ray(column + 0.5, row + 0.5).at(depth));
                let found = (point.x / point.h, point.y / point.h);
                let close = |a: f64, b: f64| (a - b).abs() < 1e-5;
                assert!(close(found.0, column) && close(found.1, row), "{found:?} {column} {row}");
                let nearness = if view.is_parallel() { (40.0 - depth) / 25.0 } else { 25.0 / depth };
                assert!(close(point.a / point.h, nearness), "{point:?} {nearness}");
            }
        }
    }
}

//! The camera of every command and file, and its rays.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::ray::Ray;

/// Largest side of an image.
const MAX_SIDE: u32 = 65_536;

/// Why a camera cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// Eye and target coincide, or a coordinate is not finite.
    #[error("the camera needs a finite eye and a finite target apart from it; eye is {eye}, target {target}")]
    View {
        /// As given.
        eye: DVec3,
        /// As given.
        target: DVec3,
    },
    /// `up` is zero, not finite, or along the view.
    #[error("the camera's up {up} must be finite, not zero, and not along the view")]
    Up {
        /// As given.
        up: DVec3,
    },
    /// Field of view out of range.
    #[error("the camera's fov_y_deg must be between 0 and 180 degrees, both excluded; it is {0}")]
    FieldOfView(f64),
    /// Image size out of range.
    #[error("the image must have 1 to 65,536 pixels a side; it is {width} x {height}")]
    Size {
        /// As given.
        width: u32,
        /// As given.
        height: u32,
    },
}

/// A perspective camera, right-handed, in model units.
///
/// Pixel (i, j) has its ray through ((i + 0.5) / width, (j + 0.5) / height), row 0 on top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position.
    pub eye: DVec3Json,
    /// Looked at.
    pub target: DVec3Json,
    /// Which way is up; need not be at a right angle to the view.
    pub up: DVec3Json,
    /// Vertical field of view in degrees.
    pub fov_y_deg: f64,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Three numbers in JSON.
pub type DVec3Json = [f64; 3];

impl Camera {
    /// A camera that sees the whole box from the direction `from` (from the box's centre towards the eye).
    pub fn around(min: DVec3, max: DVec3, from: DVec3, up: DVec3, width: u32, height: u32) -> Self {
        let fov_y_deg = 45.0;
        let centre = min + 0.5 * (max - min);
        let back = from.normalize_or(DVec3::X);
        let right = up.cross(back).normalize_or(back.any_orthonormal_vector());
        let up_in_image = back.cross(right);
        let tan_y = libm::tan(0.5 * f64::to_radians(fov_y_deg));
        let tan_x = tan_y * f64::from(width) / f64::from(height);
        // The nearest eye from which every corner of the box is inside the image, and a little more.
        let half = 0.5 * (max - min);
        let signs = [-1.0, 1.0];
        let corners =
            signs.iter().flat_map(|x| signs.iter().flat_map(move |y| signs.map(|z| DVec3::new(*x, *y, z))));
        let needed = corners.map(|sign| {
            let corner = sign * half;
            let wide = (corner.dot(right).abs() / tan_x).max(corner.dot(up_in_image).abs() / tan_y);
            wide + corner.dot(back)
        });
        let distance = needed.fold(f64::MIN_POSITIVE, f64::max) * 1.04;
        let eye = centre + back * distance;
        Camera { eye: eye.into(), target: centre.into(), up: up.into(), fov_y_deg, width, height }
    }

    /// Checks the camera and makes its rays ready.
    pub fn rays(&self) -> Result<CameraRays, CameraError> {
        let (eye, target, up) = (DVec3::from(self.eye), DVec3::from(self.target), DVec3::from(self.up));
        let Some(forward) = (target - eye).try_normalize().filter(|_| eye.is_finite()) else {
            return Err(CameraError::View { eye, target });
        };
        let Some(right) = up.try_normalize().and_then(|up| forward.cross(up).try_normalize()) else {
            return Err(CameraError::Up { up });
        };
        if !(self.fov_y_deg > 0.0 && self.fov_y_deg < 180.0) {
            return Err(CameraError::FieldOfView(self.fov_y_deg));
        }
        if !(1..=MAX_SIDE).contains(&self.width) || !(1..=MAX_SIDE).contains(&self.height) {
            return Err(CameraError::Size { width: self.width, height: self.height });
        }
        let half_height = libm::tan(self.fov_y_deg.to_radians() / 2.0);
        let pixel = 2.0 * half_height / f64::from(self.height);
        let up = right.cross(forward);
        let corner = forward - right * (pixel * f64::from(self.width) / 2.0) + up * half_height;
        Ok(CameraRays {
            eye,
            forward,
            corner,
            per_column: right * pixel,
            per_row: -up * pixel,
            pixel,
            width: self.width,
            height: self.height,
        })
    }
}

/// The rays of a checked camera. Directions have length 1 along the view, so that `t` is the depth.
#[derive(Clone, Copy, Debug)]
pub struct CameraRays {
    eye: DVec3,
    forward: DVec3,
    /// Direction of the image's upper left corner.
    corner: DVec3,
    per_column: DVec3,
    per_row: DVec3,
    /// Side of a pixel at depth 1.
    pixel: f64,
    width: u32,
    height: u32,
}

impl CameraRays {
    /// The ray through (x, y) in pixels from the upper left corner; pixel (i, j)'s is at (i + 0.5, j + 0.5).
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        Ray::new(self.eye, self.corner + x * self.per_column + y * self.per_row)
    }

    /// Side of a pixel in world units at depth 1; the footprint at depth t is t times this.
    pub fn pixel_at_unit_depth(&self) -> f64 {
        self.pixel
    }

    /// Pixels a row, rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Position of the eye.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// View direction, length 1.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// The four side planes of the view pyramid and the plane of the eye: inward normals; all pass through the eye.
    pub fn frustum_normals(&self) -> [DVec3; 5] {
        let corner = |x: u32, y: u32| self.ray(f64::from(x), f64::from(y)).direction;
        let corners =
            [corner(0, 0), corner(self.width, 0), corner(self.width, self.height), corner(0, self.height)];
        let side = |i: usize| corners[i].cross(corners[(i + 1) % 4]) * -1.0;
        let inward = |n: DVec3| if n.dot(self.forward) < 0.0 { -n } else { n };
        [inward(side(0)), inward(side(1)), inward(side(2)), inward(side(3)), self.forward]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            eye: [1.0, 2.0, 3.0],
            target: [1.0, 2.0, -7.0],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 90.0,
            width: 200,
            height: 100,
        }
    }

    #[test]
    fn the_middle_looks_forward_and_row_zero_is_on_top() {
        let rays = camera().rays().unwrap();
        let middle = rays.ray(100.0, 50.0).direction;
        assert!((middle - DVec3::NEG_Z).length() < 1e-12, "{middle}");
        let upper_left = rays.ray(0.0, 0.0).direction;
        assert!((upper_left - DVec3::new(-2.0, 1.0, -1.0)).length() < 1e-12, "{upper_left}");
    }

    #[test]
    fn the_frustum_holds_what_the_pixels_see() {
        let rays = camera().rays().unwrap();
        for (x, y, inside) in
            [(0.5, 0.5, true), (199.5, 99.5, true), (-1.0, 50.0, false), (100.0, 101.0, false)]
        {
            let direction = rays.ray(x, y).direction;
            let all = rays.frustum_normals().iter().all(|n| n.dot(direction) >= 0.0);
            assert_eq!(all, inside, "pixel {x} {y}");
        }
    }

    #[test]
    fn bad_cameras_are_refused() {
        let good = camera();
        assert!(Camera { target: good.eye, ..good }.rays().is_err());
        assert!(Camera { up: [0.0, 0.0, 2.0], ..good }.rays().is_err());
        assert!(Camera { up: [0.0; 3], ..good }.rays().is_err());
        assert!(Camera { eye: [f64::NAN, 0.0, 0.0], ..good }.rays().is_err());
        assert!(Camera { fov_y_deg: 180.0, ..good }.rays().is_err());
        assert!(Camera { width: 0, ..good }.rays().is_err());
    }

    #[test]
    fn a_camera_around_a_box_sees_its_corners() {
        let (min, max) = (DVec3::new(1e6, 0.0, -5.0), DVec3::new(1e6 + 30.0, 10.0, 5.0));
        let camera = Camera::around(min, max, DVec3::new(1.0, 0.7, 0.8), DVec3::Y, 640, 480);
        let normals = camera.rays().unwrap().frustum_normals();
        for corner in 0..8 {
            let pick = |k: usize| if corner >> k & 1 == 1 { max[k] } else { min[k] };
            let to = DVec3::new(pick(0), pick(1), pick(2)) - DVec3::from(camera.eye);
            assert!(normals.iter().all(|n| n.dot(to) >= 0.0), "corner {corner}");
        }
    }
}

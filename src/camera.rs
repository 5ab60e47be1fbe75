//! The camera of every command and file, and its rays.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::ray::Ray;

/// Largest side of an image.
pub const MAX_SIDE: u32 = 65_536;

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
    /// Height of a parallel projection out of range.
    #[error("the camera's ortho_height must be finite and above 0 model units; it is {0}")]
    OrthoHeight(f64),
    /// A camera file names no projection, or two.
    #[error("a camera needs fov_y_deg (perspective) or ortho_height (parallel projection), and not both")]
    Projection,
    /// Image size out of range.
    #[error("the image must have 1 to 65,536 pixels a side; it is {width} x {height}")]
    Size {
        /// As given.
        width: u32,
        /// As given.
        height: u32,
    },
}

/// How directions become pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// All rays through the eye.
    Perspective {
        /// Vertical field of view in degrees.
        fov_y_deg: f64,
    },
    /// Parallel rays; the eye is in the middle of the plane where they start.
    Orthographic {
        /// Height of the image in model units.
        height: f64,
    },
}

/// A camera, right-handed, in model units.
///
/// Pixel (i, j) has its ray through ((i + 0.5) / width, (j + 0.5) / height), row 0 on top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CameraFile", into = "CameraFile")]
pub struct Camera {
    /// Position.
    pub eye: DVec3Json,
    /// Looked at.
    pub target: DVec3Json,
    /// Which way is up; need not be at a right angle to the view.
    pub up: DVec3Json,
    /// Perspective or parallel.
    pub projection: Projection,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A camera as files have it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    eye: DVec3Json,
    target: DVec3Json,
    up: DVec3Json,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fov_y_deg: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ortho_height: Option<f64>,
    width: u32,
    height: u32,
}

impl TryFrom<CameraFile> for Camera {
    type Error = CameraError;

    fn try_from(file: CameraFile) -> Result<Self, CameraError> {
        let CameraFile { eye, target, up, width, height, .. } = file;
        let projection = match (file.fov_y_deg, file.ortho_height) {
            (Some(fov_y_deg), None) => Projection::Perspective { fov_y_deg },
            (None, Some(height)) => Projection::Orthographic { height },
            _ => return Err(CameraError::Projection),
        };
        Ok(Camera { eye, target, up, projection, width, height })
    }
}

impl From<Camera> for CameraFile {
    fn from(camera: Camera) -> Self {
        let Camera { eye, target, up, projection, width, height } = camera;
        let (fov_y_deg, ortho_height) = match projection {
            Projection::Perspective { fov_y_deg } => (Some(fov_y_deg), None),
            Projection::Orthographic { height } => (None, Some(height)),
        };
        CameraFile { eye, target, up, fov_y_deg, ortho_height, width, height }
    }
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
        let projection = Projection::Perspective { fov_y_deg };
        Camera { eye: eye.into(), target: centre.into(), up: up.into(), projection, width, height }
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
        if !(1..=MAX_SIDE).contains(&self.width) || !(1..=MAX_SIDE).contains(&self.height) {
            return Err(CameraError::Size { width: self.width, height: self.height });
        }
        let (is_parallel, half_height) = match self.projection {
            Projection::Perspective { fov_y_deg } => {
                if !(fov_y_deg > 0.0 && fov_y_deg < 180.0) {
                    return Err(CameraError::FieldOfView(fov_y_deg));
                }
                (false, libm::tan(fov_y_deg.to_radians() / 2.0))
            }
            Projection::Orthographic { height } => {
                if !(height > 0.0 && height.is_finite()) {
                    return Err(CameraError::OrthoHeight(height));
                }
                (true, 0.5 * height)
            }
        };
        let pixel = 2.0 * half_height / f64::from(self.height);
        let up = right.cross(forward);
        let corner = up * half_height - right * (pixel * f64::from(self.width) / 2.0);
        Ok(CameraRays {
            eye,
            forward,
            corner,
            per_column: right * pixel,
            per_row: -up * pixel,
            pixel,
            is_parallel,
            width: self.width,
            height: self.height,
        })
    }
}

/// The rays of a checked camera. Directions have length 1 along the view, so that `t` is the depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRays {
    eye: DVec3,
    forward: DVec3,
    /// The image's upper left corner, from its middle: at depth 1, or anywhere in a parallel projection.
    corner: DVec3,
    per_column: DVec3,
    per_row: DVec3,
    /// Side of a pixel there.
    pixel: f64,
    is_parallel: bool,
    width: u32,
    height: u32,
}

/// Points p with `normal.dot(p - point) >= 0` are inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Points inward; any length but 0.
    pub normal: DVec3,
    /// A point of the plane, world space.
    pub point: DVec3,
}

impl Plane {
    /// Is any point of the box inside?
    pub fn reaches(&self, min: DVec3, max: DVec3) -> bool {
        let farthest = DVec3::select(self.normal.cmpge(DVec3::ZERO), max, min);
        self.normal.dot(farthest - self.point) >= 0.0
    }

    /// Is all of the box inside?
    pub fn holds(&self, min: DVec3, max: DVec3) -> bool {
        let nearest = DVec3::select(self.normal.cmpge(DVec3::ZERO), min, max);
        self.normal.dot(nearest - self.point) >= 0.0
    }
}

impl CameraRays {
    /// The ray through (x, y) in pixels from the upper left corner; pixel (i, j)'s is at (i + 0.5, j + 0.5).
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let in_image = self.corner + x * self.per_column + y * self.per_row;
        if self.is_parallel {
            Ray::new(self.eye + in_image, self.forward)
        } else {
            Ray::new(self.eye, self.forward + in_image)
        }
    }

    /// Side of a pixel in world units at this depth.
    #[inline]
    pub fn pixel_at(&self, depth: f64) -> f64 {
        if self.is_parallel { self.pixel } else { self.pixel * depth }
    }

    /// The same picture from an eye that is no farther before a box than that is large: parallel rays may start anywhere before
    /// what they see. A perspective stays as it is.
    pub fn brought_near(&self, min: DVec3, max: DVec3) -> CameraRays {
        if !self.is_parallel {
            return *self;
        }
        let nearest = DVec3::select(self.forward.cmpge(DVec3::ZERO), min, max);
        let ahead = (nearest - self.eye).dot(self.forward) - (max - min).max_element();
        // Not a number where the box is none.
        if ahead > 0.0 { CameraRays { eye: self.eye + ahead * self.forward, ..*self } } else { *self }
    }

    /// Are all rays parallel?
    pub fn is_parallel(&self) -> bool {
        self.is_parallel
    }

    /// World steps from one pixel to the next, to the right and down: at depth 1, or at any in a parallel projection.
    pub fn pixel_steps(&self) -> (DVec3, DVec3) {
        (self.per_column, self.per_row)
    }

    /// Pixels a row, rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Position of the eye: where rays start, or the middle of the plane where they do.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// View direction, length 1.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// The four sides of what the camera sees, and the plane through the eye.
    pub fn frustum(&self) -> [Plane; 5] {
        let (right, down) = (f64::from(self.width), f64::from(self.height));
        let corners = [(0.0, 0.0), (right, 0.0), (right, down), (0.0, down)].map(|(x, y)| self.ray(x, y));
        let middle = self.ray(0.5 * right, 0.5 * down).at(1.0);
        let side = |i: usize| {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let point = a.origin;
            let normal = (a.at(1.0) - point).cross(b.at(1.0) - point);
            Plane { normal: if normal.dot(middle - point) < 0.0 { -normal } else { normal }, point }
        };
        let at_eye = Plane { normal: self.forward, point: self.eye };
        [side(0), side(1), side(2), side(3), at_eye]
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
            projection: Projection::Perspective { fov_y_deg: 90.0 },
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
            let point = rays.eye() + 7.0 * direction;
            let all = rays.frustum().iter().all(|plane| plane.reaches(point, point));
            assert_eq!(all, inside, "pixel {x} {y}");
        }
    }

    #[test]
    fn parallel_cameras_come_near_and_see_the_same() {
        let far = Camera {
            eye: [4e9, 2e9, 1e9],
            target: [0.0; 3],
            projection: Projection::Orthographic { height: 8.0 },
            ..camera()
        };
        let (min, max) = (DVec3::new(-3.0, 1.0, -2.0), DVec3::new(5.0, 2.0, 4.0));
        let far = far.rays().unwrap();
        let near = far.brought_near(min, max);
        assert!(near.eye().length() < 40.0, "{}", near.eye());
        let corners =
            (0..8).map(|i| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), min, max));
        assert!(corners.clone().all(|corner| (corner - near.eye()).dot(near.forward()) >= 0.0));
        let (a, b) = (far.ray(30.0, 70.0), near.ray(30.0, 70.0));
        let apart = b.origin - a.origin;
        assert!((apart - apart.dot(a.direction) * a.direction).length() < 1e-5 && a.direction == b.direction);
        assert_eq!(near.brought_near(min, max), near, "near enough");
        let perspective = camera().rays().unwrap();
        assert_eq!(perspective.brought_near(min + 1e9, max + 1e9), perspective);
    }

    #[test]
    fn a_parallel_projection_sees_a_box_of_the_asked_height() {
        let camera = Camera { projection: Projection::Orthographic { height: 10.0 }, ..camera() };
        let rays = camera.rays().unwrap();
        let upper_left = rays.ray(0.0, 0.0);
        assert!((upper_left.origin - DVec3::new(-9.0, 7.0, 3.0)).length() < 1e-12, "{upper_left:?}");
        assert!((upper_left.direction - DVec3::NEG_Z).length() < 1e-12);
        assert_eq!((rays.pixel_at(1.0), rays.pixel_at(100.0)), (0.1, 0.1));
        let seen = |point: DVec3| rays.frustum().iter().all(|plane| plane.reaches(point, point));
        assert!(seen(DVec3::new(10.9, 6.9, -500.0)) && seen(DVec3::new(-8.9, -2.9, 2.9)));
        assert!(!seen(DVec3::new(11.1, 2.0, 0.0)) && !seen(DVec3::new(1.0, 7.1, 0.0)));
        assert!(!seen(DVec3::new(1.0, 2.0, 3.1)), "behind the eye");
    }

    #[test]
    fn camera_files_name_one_projection() {
        let read = |projection: &str| {
            let rest = r#""eye":[1,2,3],"target":[0,0,0],"up":[0,0,1],"width":8,"height":9"#;
            serde_json::from_str::<Camera>(&format!("{{{projection}{rest}}}"))
        };
        let perspective = read(r#""fov_y_deg":60,"#).unwrap();
        assert_eq!(perspective.projection, Projection::Perspective { fov_y_deg: 60.0 });
        let parallel = read(r#""ortho_height":2.5,"#).unwrap();
        assert_eq!(parallel.projection, Projection::Orthographic { height: 2.5 });
        for camera in [perspective, parallel] {
            let text = serde_json::to_string(&camera).unwrap();
            assert_eq!(serde_json::from_str::<Camera>(&text).unwrap(), camera, "{text}");
        }
        for bad in ["", r#""fov_y_deg":60,"ortho_height":1,"#, r#""fov_y_deg":60,"fov":1,"#] {
            assert!(read(bad).is_err(), "{bad}");
        }
        assert!(read(r#""ortho_height":0,"#).unwrap().rays().is_err());
    }

    #[test]
    fn bad_cameras_are_refused() {
        let good = camera();
        assert!(Camera { target: good.eye, ..good }.rays().is_err());
        assert!(Camera { up: [0.0, 0.0, 2.0], ..good }.rays().is_err());
        assert!(Camera { up: [0.0; 3], ..good }.rays().is_err());
        assert!(Camera { eye: [f64::NAN, 0.0, 0.0], ..good }.rays().is_err());
        let wide = Projection::Perspective { fov_y_deg: 180.0 };
        assert!(Camera { projection: wide, ..good }.rays().is_err());
        assert!(Camera { width: 0, ..good }.rays().is_err());
    }

    #[test]
    fn a_camera_around_a_box_sees_its_corners() {
        let (min, max) = (DVec3::new(1e6, 0.0, -5.0), DVec3::new(1e6 + 30.0, 10.0, 5.0));
        let camera = Camera::around(min, max, DVec3::new(1.0, 0.7, 0.8), DVec3::Y, 640, 480);
        let frustum = camera.rays().unwrap().frustum();
        for corner in 0..8 {
            let pick = |k: usize| if corner >> k & 1 == 1 { max[k] } else { min[k] };
            let point = DVec3::new(pick(0), pick(1), pick(2));
            assert!(frustum.iter().all(|plane| plane.reaches(point, point)), "corner {corner}");
        }
    }
}

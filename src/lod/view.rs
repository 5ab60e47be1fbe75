//! What a view tells about each visible drawable.

use glam::DVec3;

use crate::camera::CameraRays;
use crate::exact::ExactScene;
use crate::visibility::VisibleSet;

/// A visible drawable as selection sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Which.
    pub drawable: u32,
    /// Pixels that it covers, by the samples of a query; 0 where none met it though it may be seen.
    pub pixels: f64,
    /// Pixels by which a displacement of one world unit shows at most, where the drawable is nearest; infinite where it reaches
    /// the eye.
    pub pixels_per_unit: f64,
    /// Pixels of the rectangle around its projected box, as far as it is in the image (Peng and Cao 2013, A_i).
    pub area: f64,
    /// Least depth of its box's corners, world units, not below 0 (Peng and Cao 2013, D_i).
    pub depth: f64,
}

/// The visible drawables of a query's answer, rising.
pub fn candidates(scene: &ExactScene, camera: &CameraRays, seen: &VisibleSet) -> Vec<Candidate> {
    let (width, height) = camera.size();
    let image = f64::from(width) * f64::from(height);
    let per_sample = if seen.weight == 0 { 0.0 } else { image / seen.weight as f64 };
    let projection = Projected::new(camera);
    let visible = (0..).zip(&seen.visible).zip(&seen.samples).filter(|((_, visible), _)| **visible);
    visible
        .map(|((drawable, _), &samples)| {
            let (min, max) = scene.drawable_box(drawable);
            let (depth, area) = projection.of_box(min, max);
            Candidate {
                drawable,
                pixels: f64::from(samples) * per_sample,
                pixels_per_unit: projection.slant / camera.pixel_at(depth),
                area,
                depth,
            }
        })
        .collect()
}

/// Projects boxes into an image.
struct Projected<'a> {
    camera: &'a CameraRays,
    /// World vectors whose products with a point, seen from the eye, are its columns and rows from the image's middle: at
    /// depth 1 in a perspective.
    column: DVec3,
    row: DVec3,
    /// What is displaced towards the image's corner is displaced in the image by more than at its middle: by the secant of the
    /// corner's angle. 1 in a parallel projection.
    slant: f64,
}

impl<'a> Projected<'a> {
    fn new(camera: &'a CameraRays) -> Self {
        let (column, row) = camera.pixel_steps();
        Projected {
            camera,
            column: column / column.length_squared(),
            row: row / row.length_squared(),
            slant: camera.ray(0.0, 0.0).direction.length(),
        }
    }

    /// Least depth of a box's corners, not below 0, and pixels of the rectangle around its image; the whole image where the box
    /// reaches the eye's plane.
    fn of_box(&self, min: DVec3, max: DVec3) -> (f64, f64) {
        let (width, height) = self.camera.size();
        let size = [f64::from(width), f64::from(height)];
        let (mut nearest, mut low, mut high) = (f64::INFINITY, [f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..8u32 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] };
            let from_eye = DVec3::new(pick(0), pick(1), pick(2)) - self.camera.eye();
            let depth = from_eye.dot(self.camera.forward());
            nearest = nearest.min(depth);
            let by = if self.camera.is_parallel() { 1.0 } else { depth };
            for (axis, step) in [self.column, self.row].into_iter().enumerate() {
                let at = 0.5 * size[axis] + from_eye.dot(step) / by;
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        if nearest <= 0.0 {
            return (0.0, size[0] * size[1]);
        }
        let span = |axis: usize| (high[axis].min(size[axis]) - low[axis].max(0.0)).max(0.0);
        (nearest, span(0) * span(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};

    /// Where a point is in the image, by the rays: the pixel whose ray passes it.
    fn pixel_of(camera: &CameraRays, point: DVec3) -> [f64; 2] {
        let (column, row) = camera.pixel_steps();
        let depth = (point - camera.eye()).dot(camera.forward());
        let from_corner = point - camera.ray(0.0, 0.0).at(depth);
        let scale = if camera.is_parallel() { 1.0 } else { depth };
        [column, row].map(|step| from_corner.dot(step) / step.length_squared() / scale)
    }

    #[test]
    fn boxes_cover_the_pixels_of_their_corners_and_displacements_show_no_larger_than_told() {
        let mut random = oorandom::Rand64::new(5);
        let mut number = move || random.rand_float() * 2.0 - 1.0;
        for round in 0..500 {
            let mut vector = || DVec3::new(number(), number(), number());
            let (eye, target) = (vector() * 10.0, vector() * 3.0);
            let (centre, half) = (vector() * 5.0, vector().abs());
            let shift = vector() * 1e-4;
            let projection = match round % 2 {
                0 => Projection::Perspective { fov_y_deg: 20.0 + 100.0 * vector().x.abs() },
                _ => Projection::Orthographic { height: 12.0 },
            };
            let camera = Camera {
                eye: eye.into(),
                target: target.into(),
                up: [0.1, 0.2, 1.0],
                projection,
                width: 200,
                height: 120,
            };
            let camera = camera.rays().unwrap();
            let projected = Projected::new(&camera);
            let (min, max) = (centre - half, centre + half);
            let (depth, area) = projected.of_box(min, max);
            let corners: Vec<DVec3> = (0..8)
                .map(|i| DVec3::select(glam::BVec3::new(i & 1 == 0, i & 2 == 0, i & 4 == 0), min, max))
                .collect();
            let depth_of = |point: DVec3| (point - eye).dot(camera.forward());
            let least = corners.iter().map(|&corner| depth_of(corner)).fold(f64::INFINITY, f64::min);
            assert!((depth - least.max(0.0)).abs() < 1e-9, "round {round}");
            if least <= 0.0 {
                assert_eq!(area, 200.0 * 120.0);
                continue;
            }
            let pixels: Vec<[f64; 2]> = corners.iter().map(|&corner| pixel_of(&camera, corner)).collect();
            let span = |axis: usize, size: f64| {
                let values = pixels.iter().map(|pixel| pixel[axis].clamp(0.0, size));
                values.clone().fold(0.0, f64::max) - values.fold(f64::INFINITY, f64::min)
            };
            let expected = span(0, 200.0) * span(1, 120.0);
            assert!((area - expected).abs() < 1e-6 * expected.max(1.0), "round {round}: {area} {expected}");
            let bound = projected.slant / camera.pixel_at(depth) * shift.length() * (1.0 + 1e-3);
            for (corner, before) in corners.iter().zip(&pixels) {
                let after = pixel_of(&camera, *corner + shift);
                let moved = (after[0] - before[0]).hypot(after[1] - before[1]);
                let in_image = (0.0..200.0).contains(&before[0]) && (0.0..120.0).contains(&before[1]);
                assert!(!in_image || moved <= bound, "round {round}: {moved} over {bound}");
            }
        }
    }
}

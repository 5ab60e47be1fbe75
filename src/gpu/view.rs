//! The camera as shaders have it.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, DVec4};

use crate::camera::CameraRays;

/// Near plane of a perspective, in largest sides of the scene. With reverse-Z in f32 it costs no precision: depth is right to
/// 2^-23 of itself wherever the plane is.
const NEAR: f64 = 1e-6;

/// The camera of a frame: `View` of `shaders/view.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct ViewUniform {
    pub clip_x: [f32; 4],
    pub clip_y: [f32; 4],
    pub clip_z: [f32; 4],
    pub clip_w: [f32; 4],
    pub start: [f32; 3],
    pub near: f32,
    pub start_column: [f32; 3],
    pub far: f32,
    pub start_row: [f32; 3],
    pub width: u32,
    pub direction: [f32; 3],
    pub height: u32,
    pub direction_column: [f32; 3],
    pub padding_0: u32,
    pub direction_row: [f32; 3],
    pub padding_1: u32,
    pub forward: [f32; 3],
    pub padding_2: u32,
}

impl ViewUniform {
    /// Of a camera; `min` and `max` are the corners of the scene.
    pub fn new(camera: &CameraRays, min: DVec3, max: DVec3) -> Self {
        let (width, height) = camera.size();
        let (column, row) = camera.pixel_steps();
        let (eye, forward) = (camera.eye(), camera.forward());
        // Pixels from the image's middle, of a point at depth 1.
        let right = column / column.length_squared() * (2.0 / f64::from(width));
        let up = -row / row.length_squared() * (2.0 / f64::from(height));
        let rays = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(|(x, y)| camera.ray(x, y));
        let starts = rays.map(|ray| ray.origin - eye);
        let directions = rays.map(|ray| ray.direction);
        let is_parallel = camera.is_parallel();
        let largest = (max - min).max_element().max(f64::MIN_POSITIVE);
        let near = if is_parallel { 0.0 } else { NEAR * largest };
        let farthest = DVec3::select(forward.cmpge(DVec3::ZERO), max, min);
        // Beyond the scene's last corner; where all of it is behind the eye, anywhere.
        let far = ((farthest - eye).dot(forward) * (1.0 + 1e-6)).max(NEAR * largest);
        let (clip_z, clip_w) = if is_parallel {
            ((-forward / far).extend(1.0), DVec4::W)
        } else {
            (DVec4::W * near, forward.extend(0.0))
        };
        let single = |v: DVec3| v.as_vec3().to_array();
        ViewUniform {
            clip_x: right.extend(0.0).as_vec4().to_array(),
            clip_y: up.extend(0.0).as_vec4().to_array(),
            clip_z: clip_z.as_vec4().to_array(),
            clip_w: clip_w.as_vec4().to_array(),
            start: single(starts[0]),
            near: near as f32,
            start_column: single(starts[1] - starts[0]),
            far: far as f32,
            start_row: single(starts[2] - starts[0]),
            width,
            direction: single(directions[0]),
            height,
            direction_column: single(directions[1] - directions[0]),
            padding_0: 0,
            direction_row: single(directions[2] - directions[0]),
            padding_1: 0,
            forward: single(forward),
            padding_2: 0,
        }
    }
}

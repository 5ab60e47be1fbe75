//! Clip planes as shaders have them.

use glam::{DVec3, Vec4};
use wgpu::{Buffer, BufferUsages};

use super::context::Context;
use crate::camera::Plane;

/// The planes of a frame, for `shaders/clip.wgsl`.
#[derive(Debug)]
pub(super) struct ClipPlanes {
    buffer: Buffer,
    is_empty: bool,
}

impl ClipPlanes {
    /// As seen from `eye`. A plane without a normal cuts nothing.
    pub fn new(context: &Context, planes: &[Plane], eye: DVec3) -> Self {
        let plane = |plane: &Plane| {
            let normal = plane.normal.try_normalize()?;
            Some(normal.extend(normal.dot(eye - plane.point)).as_vec4())
        };
        let mut list: Vec<Vec4> = planes.iter().filter_map(plane).collect();
        let is_empty = list.is_empty();
        if is_empty {
            // A buffer cannot be empty.
            list.push(Vec4::W);
        }
        let list: Vec<[f32; 4]> = list.iter().map(Vec4::to_array).collect();
        ClipPlanes { buffer: context.buffer("clip planes", &list, BufferUsages::STORAGE), is_empty }
    }

    /// Nothing is cut.
    pub fn is_empty(&self) -> bool {
        self.is_empty
    }

    /// Where shaders find them.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        self.buffer.as_entire_binding()
    }

    /// What `shaders/clip.wgsl` needs to know.
    pub fn constant(is_cut: bool) -> (&'static str, f64) {
        ("HAS_CLIP", f64::from(u8::from(is_cut)))
    }
}

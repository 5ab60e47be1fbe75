//! What is drawn in a frame: an instance for each drawable, and a draw for each page.
//!
//! Placements are f64 on the CPU. What goes to the GPU is relative to the eye: where the eye is within reach of a part's
//! grid, whole steps of the grid are subtracted from its vertices as integers, so that rounding is a fraction of the
//! distance to the eye, not of the part's size or of its distance from the origin.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DMat3, DVec3, IVec3};

use crate::camera::{CameraRays, Plane};
use crate::filter::Filter;
use crate::lod::Choice;
use crate::moved::Moved;
use crate::scene::Scene;
use crate::streaming::PageLayout;

/// Farther than this from the eye, in steps, a part is placed by its origin: i32 would not do, and f32 is as good there.
const MOST_STEPS: f64 = (1 << 29) as f64;

/// One drawable in one frame: `Instance` of `shaders/page.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct Instance {
    pub column_x: [f32; 3],
    pub column_y: [f32; 3],
    pub column_z: [f32; 3],
    pub base: [i32; 3],
    pub fraction: [f32; 3],
    pub translation: [f32; 3],
    pub vertices_at: u32,
    pub indices_at: u32,
    pub index_bits: u32,
    pub drawable: u32,
    pub colour: u32,
}

/// Where shaders find it.
pub const ATTRIBUTES: [wgpu::VertexAttribute; 8] = wgpu::vertex_attr_array![
    0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Sint32x3, 4 => Float32x3, 5 => Float32x3, 6 => Uint32x4, 7 => Uint32
];

impl Instance {
    /// A buffer of them, as pipelines want it.
    pub(super) fn layout() -> wgpu::VertexBufferLayout<'static> {
        wgpu::VertexBufferLayout {
            array_stride: size_of::<Instance>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &ATTRIBUTES,
        }
    }
}

/// Where a chunk's grid lies: its offset in the part's grid, the part's step, its placement.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Added to quantized coordinates.
    pub offset: [i32; 3],
    /// Part units a step.
    pub step: DVec3,
    /// Part space to world.
    pub world_from_part: DAffine3,
}

impl Instance {
    /// Places a chunk as seen from `eye`. The rest is zero.
    pub fn placed(placement: &Placement, eye: DVec3) -> Self {
        let Placement { offset, step, world_from_part } = *placement;
        let linear = world_from_part.matrix3 * DMat3::from_diagonal(step);
        let offset = IVec3::from(offset);
        // Where the eye is in steps; a placement without volume has no such place.
        let eye_steps = linear.inverse() * (eye - world_from_part.translation);
        let is_near = eye_steps.is_finite() && eye_steps.abs().max_element() < MOST_STEPS;
        let (base, fraction, translation) = if is_near {
            let whole = eye_steps.floor();
            (offset - whole.as_ivec3(), whole - eye_steps, DVec3::ZERO)
        } else {
            (offset, DVec3::ZERO, world_from_part.translation - eye)
        };
        Instance {
            column_x: linear.x_axis.as_vec3().to_array(),
            column_y: linear.y_axis.as_vec3().to_array(),
            column_z: linear.z_axis.as_vec3().to_array(),
            base: base.to_array(),
            fraction: fraction.as_vec3().to_array(),
            translation: translation.as_vec3().to_array(),
            ..Instance::default()
        }
    }

    /// Draws a page that begins at this byte of the pool.
    pub fn with_page(self, layout: &PageLayout, offset: u64) -> Self {
        // The pool has at most 2^32 words, and pages begin at multiples of 16.
        let vertices_at = (offset / 4) as u32;
        Instance {
            vertices_at,
            indices_at: vertices_at + layout.indices_at / 4,
            index_bits: layout.index_bits,
            ..self
        }
    }
}

/// Arguments of an indirect draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Draw {
    /// Three a triangle.
    pub vertices: u32,
    /// Drawables that share the page.
    pub instances: u32,
    /// Zero.
    pub first_vertex: u32,
    /// The first of them.
    pub first_instance: u32,
}

/// What a user has changed about how drawables look.
#[derive(Clone, Copy)]
pub struct Changes<'a> {
    /// What is hidden, and looked through.
    pub filter: &'a Filter,
    /// What is elsewhere.
    pub moved: Option<&'a Moved>,
}

/// Alpha of what is opaque and of an object that no clip plane cuts: its inside is never capped. That of one that is cut is 255.
pub const WHOLE: u8 = 253;

/// Does a clip plane go through an object's box?
fn is_cut(object: u32, changes: &Changes, scene: &Scene) -> bool {
    let planes = changes.filter.clip_planes();
    if planes.is_empty() {
        return false;
    }
    let (min, max) = match changes.moved.and_then(|moved| moved.object_box(scene, object)) {
        Some(bounds) => bounds,
        None => {
            let record = &scene.objects()[object as usize];
            (DVec3::from(record.min), DVec3::from(record.max))
        }
    };
    let reaches = |normal: DVec3, point: DVec3| Plane { normal, point }.reaches(min, max);
    planes.iter().any(|plane| reaches(plane.normal, plane.point) && reaches(-plane.normal, plane.point))
}

/// What a frame draws.
#[derive(Clone, Debug)]
pub struct DrawList {
    /// Whose eye instances are relative to.
    pub camera: CameraRays,
    /// Corners of a box around all that may be drawn.
    pub bounds: (DVec3, DVec3),
    /// Those that share a page lie together.
    pub instances: Vec<Instance>,
    /// Of what is opaque, a draw a page.
    pub opaque: Vec<Draw>,
    /// Of what is seen through.
    pub transparent: Vec<Draw>,
    /// Of all instances.
    pub triangles: u64,
}

impl DrawList {
    /// Lists resident drawables, for a camera: `changes` is what is looked through and moved. `offset_of` tells where in the pool
    /// a page is; what is not there is left out.
    pub fn new(
        scene: &Scene,
        camera: &CameraRays,
        drawn: &[Choice],
        changes: &Changes,
        offset_of: impl Fn(u32) -> Option<u64>,
    ) -> Self {
        let bounds = scene.meta().bounds;
        let mut bounds = (DVec3::from(bounds.min), DVec3::from(bounds.max));
        if let Some((min, max)) = changes.moved.and_then(Moved::bounds) {
            bounds = (bounds.0.min(min), bounds.1.max(max));
        }
        // However far away it is: f32 shall do.
        let camera = camera.brought_near(bounds.0, bounds.1);
        let eye = camera.eye();
        let page_of = |choice: &Choice| scene.page_of(choice.drawable, choice.level);
        let colour_of = |choice: &Choice| {
            let [r, g, b, a] = scene.objects()[scene.drawable_object(choice.drawable) as usize].colour;
            [r, g, b, changes.filter.alpha_of(choice.drawable, a)]
        };
        let shown = drawn.iter().filter(|choice| !changes.filter.is_hidden(choice.drawable));
        let mut order: Vec<(bool, u32, Choice)> =
            shown.map(|choice| (colour_of(choice)[3] < 255, page_of(choice), *choice)).collect();
        order.sort_unstable();
        let (instances, opaque, transparent) = (Vec::new(), Vec::new(), Vec::new());
        let mut list = DrawList { camera, bounds, instances, opaque, transparent, triangles: 0 };
        for group in order.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let [(is_transparent, page, _), ..] = *group else { continue };
            let Some(offset) = offset_of(page) else { continue };
            let record = &scene.levels()[page as usize];
            let layout = PageLayout::of(record);
            let first_instance = list.instances.len() as u32;
            list.instances.extend(group.iter().map(|(.., choice)| {
                let chunk = scene.drawables()[choice.drawable as usize].chunk;
                let object = scene.drawable_object(choice.drawable);
                let part = scene.objects()[object as usize].part;
                let moved = changes.moved.and_then(|moved| moved.world_from_part(object));
                let placement = Placement {
                    offset: scene.chunks()[chunk as usize].offset,
                    step: glam::Vec3::from(scene.parts()[part as usize].step).as_dvec3(),
                    world_from_part: moved.unwrap_or_else(|| scene.world_from_part(object)),
                };
                let [r, g, b, alpha] = colour_of(choice);
                let is_whole = !is_transparent && !is_cut(object, changes, scene);
                Instance {
                    drawable: choice.drawable,
                    colour: u32::from_le_bytes([r, g, b, if is_whole { WHOLE } else { alpha }]),
                    ..Instance::placed(&placement, eye).with_page(&layout, offset)
                }
            }));
            let draws = if is_transparent { &mut list.transparent } else { &mut list.opaque };
            draws.push(Draw {
                vertices: 3 * record.triangle_count,
                instances: group.len() as u32,
                first_vertex: 0,
                first_instance,
            });
            list.triangles += u64::from(record.triangle_count) * group.len() as u64;
        }
        list
    }
}

//! The shadow pass: voxel rays from what each pixel shows to the sun and into the sky, accumulated while nothing moves.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use voxsight_voxel::grid::Grid;
use wgpu::{BindingResource, Buffer, BufferUsages, ComputePipeline};

use super::clip::ClipPlanes;
use super::context::Context;
use super::dag::GpuDag;
use super::query::ENDLESS;
use super::shader::compute_pipeline;
use super::target::Targets;
use super::timer::Recording;
use crate::camera::{CameraRays, Plane};
use crate::render::{KeyLight, Lighting, Sky};

/// Samples of a pixel that are accumulated, at most: what another one adds, a 4096th of a share, is far below a step of the picture.
const MOST_SAMPLES: u32 = 4096;

/// Samples of a dispatch, at most: drivers give up what takes seconds, and a pixel has 32 bits for what is stopped.
const MOST_AT_ONCE: u32 = 4;

/// Where rays start above a surface, as on the CPU: see `render::shadow`.
pub const HEIGHT: f64 = crate::render::HEIGHT;

/// Side of a workgroup, pixels.
pub const GROUP: u32 = 8;

/// `Shadow` of `shaders/shadow.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct ShadowUniform {
    pub eye_voxel: [i32; 3],
    pub voxels_per_unit: f32,
    pub eye_fraction: [f32; 3],
    pub first_sample: u32,
    pub sun: [f32; 3],
    pub sun_cap: f32,
    pub samples: u32,
    pub has_sun: u32,
    pub has_sky: u32,
    pub reach: f32,
    pub is_first: u32,
    pub is_last: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// `Filter` of `shaders/filter.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct FilterUniform {
    pub samples: u32,
    pub radius: i32,
    pub has_sun: u32,
    pub has_sky: u32,
}

/// How shadows are cast in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShadowSettings {
    /// Rays to each light for each pixel and frame.
    pub samples: u32,
    /// Smooth what few samples leave grainy.
    pub smooth: bool,
}

impl Default for ShadowSettings {
    fn default() -> Self {
        ShadowSettings { samples: 1, smooth: true }
    }
}

/// What accumulated samples are of; of anything else they begin anew.
#[derive(Clone, Debug, PartialEq)]
struct Still {
    /// In the world: what shaders know is relative to the eye, and the same wherever that is.
    camera: CameraRays,
    lighting: Lighting,
    clip: Vec<Plane>,
    /// Changes with what is drawn and what casts.
    scene: u64,
}

/// Voxels that cast shadows.
#[derive(Debug)]
pub(super) struct Caster {
    /// The occupied ones.
    pub dag: GpuDag,
    /// Where they are.
    pub grid: Grid,
}

/// What a pipeline that traces is made for: log2 of the words of a slab, slabs, is anything cut away?
type TraceKind = (u32, u32, bool);

/// Traces and smooths.
#[derive(Debug)]
pub(super) struct ShadowPass {
    /// Made when they are first needed.
    traces: Vec<(TraceKind, ComputePipeline)>,
    smooth: ComputePipeline,
    free: Buffer,
    stopped: Buffer,
    reached: Buffer,
    size: (u32, u32),
    still: Option<Still>,
    samples: u32,
}

/// What the pass needs of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowInputs<'a> {
    /// What stops light: the scene's voxels, and those of what was moved.
    pub casters: &'a [Caster],
    /// Seen from here.
    pub camera: &'a CameraRays,
    /// The same for shaders: a [`super::view::ViewUniform`].
    pub view: &'a Buffer,
    /// What is cut away casts no shadow.
    pub clip: &'a ClipPlanes,
    /// The same as the caller has them.
    pub planes: &'a [Plane],
    /// In this light.
    pub lighting: &'a Lighting,
    /// Another number, another scene: accumulation begins anew.
    pub scene: u64,
    /// How.
    pub settings: ShadowSettings,
}

impl ShadowPass {
    /// Made once.
    pub fn new(context: &Context) -> Self {
        ShadowPass {
            traces: Vec::new(),
            smooth: compute_pipeline(context, "filter", "smooth_shares", &[]),
            free: storage(context, "free", 1),
            stopped: storage(context, "stopped", 1),
            reached: storage(context, "reached", 1),
            size: (0, 0),
            still: None,
            samples: 0,
        }
    }

    /// Rays to sun and sky that nothing stopped, of all samples so far, two u32 a pixel.
    pub fn free(&self) -> &Buffer {
        &self.free
    }

    /// Shares of sun and sky that reach each pixel, two f32 each, row by row.
    pub fn reached(&self) -> &Buffer {
        &self.reached
    }

    /// Samples of each pixel so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Casts the rays of a frame. False where no light casts shadows: then nothing is recorded. Eight bytes a pixel can be bound.
    pub fn record(&mut self, recording: &mut Recording, inputs: &ShadowInputs, targets: &Targets) -> bool {
        let Recording { context, encoder, timer } = recording;
        let lights = light_uniform(inputs.lighting);
        if lights.has_sun == 0 && lights.has_sky == 0 {
            return false;
        }
        if self.size != targets.size {
            let pixels = u64::from(targets.size.0) * u64::from(targets.size.1);
            self.free = storage(context, "free", pixels);
            self.stopped = storage(context, "stopped", pixels.div_ceil(2));
            self.reached = storage(context, "reached", pixels);
            self.size = targets.size;
            self.still = None;
        }
        let still = Still {
            camera: *inputs.camera,
            lighting: inputs.lighting.clone(),
            clip: inputs.planes.to_vec(),
            scene: inputs.scene,
        };
        if self.still.as_ref() != Some(&still) {
            self.still = Some(still);
            self.samples = 0;
        }
        let last = self.samples.saturating_add(inputs.settings.samples.max(1)).min(MOST_SAMPLES);
        let groups = (targets.size.0.div_ceil(GROUP), targets.size.1.div_ceil(GROUP));
        let seen = [
            BindingResource::TextureView(&targets.depth.view),
            BindingResource::TextureView(&targets.drawable.view),
            BindingResource::TextureView(&targets.normal.view),
        ];
        for caster in inputs.casters {
            let kind = trace_kind(caster, inputs.clip);
            if self.traces.iter().all(|(made, _)| *made != kind) {
                self.traces.push((kind, trace_pipeline(context, &caster.dag, kind.2)));
            }
        }
        if self.samples < last {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("shadow"),
                timestamp_writes: timer.compute_pass("shadow"),
            });
            while self.samples < last {
                let samples = MOST_AT_ONCE.min(last - self.samples);
                for (number, caster) in inputs.casters.iter().enumerate() {
                    let uniform = ShadowUniform {
                        first_sample: self.samples,
                        samples,
                        is_first: (number == 0).into(),
                        is_last: (number + 1 == inputs.casters.len()).into(),
                        ..shadow_uniform(&lights, inputs.lighting, inputs.camera.eye(), &caster.grid)
                    };
                    let uniform = context.uniform("shadow", &uniform);
                    let kind = trace_kind(caster, inputs.clip);
                    // Made above for every caster.
                    let Some((_, trace)) = self.traces.iter().find(|(made, _)| *made == kind) else {
                        continue;
                    };
                    let [depth, drawable, normal] = seen.clone();
                    let resources = [
                        inputs.view.as_entire_binding(),
                        uniform.as_entire_binding(),
                        depth,
                        drawable,
                        normal,
                        inputs.clip.binding(),
                        self.free.as_entire_binding(),
                        self.stopped.as_entire_binding(),
                    ];
                    pass.set_pipeline(trace);
                    let group = context.bind("shadow", &trace.get_bind_group_layout(0), resources);
                    pass.set_bind_group(0, &group, &[]);
                    pass.set_bind_group(1, &caster.dag.bind(context, &trace.get_bind_group_layout(1)), &[]);
                    pass.dispatch_workgroups(groups.0, groups.1, 1);
                }
                self.samples += samples;
            }
        }
        let radius = match (inputs.settings.smooth, self.samples) {
            (false, _) => 0,
            (true, 0..16) => 2,
            (true, 16..64) => 1,
            (true, _) => 0,
        };
        let filter =
            FilterUniform { samples: self.samples, radius, has_sun: lights.has_sun, has_sky: lights.has_sky };
        let filter = context.uniform("filter", &filter);
        let [depth, drawable, normal] = seen;
        let resources = [
            inputs.view.as_entire_binding(),
            filter.as_entire_binding(),
            depth,
            drawable,
            normal,
            self.free.as_entire_binding(),
            self.reached.as_entire_binding(),
        ];
        let group = context.bind("filter", &self.smooth.get_bind_group_layout(0), resources);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("filter"),
            timestamp_writes: timer.compute_pass("filter"),
        });
        pass.set_pipeline(&self.smooth);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(groups.0, groups.1, 1);
        true
    }
}

/// What all casters have in common.
fn light_uniform(lighting: &Lighting) -> ShadowUniform {
    let (sun, sun_cap) = match lighting.key {
        KeyLight::Sun(sun) => {
            let half = 0.5 * sun.angle_deg.to_radians();
            // 1 - cos, without losing its digits.
            (Some(sun.direction.normalize_or(DVec3::Y)), 2.0 * libm::sin(0.5 * half).powi(2))
        }
        KeyLight::Headlight | KeyLight::None => (None, 0.0),
    };
    ShadowUniform {
        sun: sun.unwrap_or(DVec3::Y).as_vec3().to_array(),
        sun_cap: sun_cap as f32,
        has_sun: sun.is_some().into(),
        has_sky: matches!(lighting.sky, Sky::Occluded { .. }).into(),
        ..ShadowUniform::default()
    }
}

/// The same for the voxels of a grid, all but the numbers of samples.
fn shadow_uniform(lights: &ShadowUniform, lighting: &Lighting, eye: DVec3, grid: &Grid) -> ShadowUniform {
    let eye = grid.grid_from_world(eye);
    // A camera so far away that its voxel is no i32 sees nothing in f32 either.
    let whole = eye.floor().clamp(DVec3::splat(-1e9), DVec3::splat(1e9));
    let reach = match lighting.sky {
        Sky::Occluded { reach } => (reach / grid.voxel_size).min(ENDLESS),
        Sky::None | Sky::Plain => 0.0,
    };
    ShadowUniform {
        eye_voxel: whole.as_ivec3().to_array(),
        voxels_per_unit: (1.0 / grid.voxel_size) as f32,
        eye_fraction: (eye - whole).as_vec3().to_array(),
        reach: reach as f32,
        ..*lights
    }
}

/// Two numbers a pixel.
fn storage(context: &Context, label: &str, pixels: u64) -> Buffer {
    context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: 8 * pixels,
        usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}

fn trace_kind(caster: &Caster, clip: &ClipPlanes) -> TraceKind {
    let [(_, shift), (_, slabs)] = caster.dag.constants();
    (shift as u32, slabs as u32, !clip.is_empty())
}

fn trace_pipeline(context: &Context, dag: &GpuDag, is_cut: bool) -> ComputePipeline {
    let [shift, slabs] = dag.constants();
    compute_pipeline(context, "shadow", "trace", &[shift, slabs, ClipPlanes::constant(is_cut)])
}

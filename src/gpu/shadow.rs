//! The shadow pass: voxel rays from what each pixel shows to the sun and into the sky, accumulated while nothing moves.

use std::sync::OnceLock;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use voxsight_voxel::grid::Grid;
use wgpu::{BindingResource, Buffer, BufferUsages, ComputePipeline};

use super::clip::ClipPlanes;
use super::context::{Context, GpuError};
use super::dag::GpuDag;
use super::shader::compute_pipeline;
use super::target::Targets;
use super::timer::Recording;
use crate::camera::CameraRays;
use crate::render::{KeyLight, Lighting, Sky};

/// Samples of a pixel that are accumulated, at most: what another one adds, a 4096th of a share, is far below a step of the picture.
const MOST_SAMPLES: u32 = 4096;

/// Samples of a dispatch, at most: drivers give up what takes seconds.
const MOST_AT_ONCE: u32 = 4;

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
    /// Changes with what is drawn and what casts.
    scene: u64,
}

/// Traces and smooths.
#[derive(Debug)]
pub(super) struct ShadowPass {
    trace: ComputePipeline,
    /// The same where something is cut away, made when that first happens.
    trace_cut: OnceLock<ComputePipeline>,
    smooth: ComputePipeline,
    free: Buffer,
    reached: Buffer,
    size: (u32, u32),
    still: Option<Still>,
    samples: u32,
}

/// What the pass needs of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowInputs<'a> {
    /// Voxels.
    pub dag: &'a GpuDag,
    /// Where they are.
    pub grid: &'a Grid,
    /// Seen from here.
    pub camera: &'a CameraRays,
    /// The same for shaders: a [`super::view::ViewUniform`].
    pub view: &'a Buffer,
    /// What is cut away casts no shadow.
    pub clip: &'a ClipPlanes,
    /// In this light.
    pub lighting: &'a Lighting,
    /// Another number, another scene: accumulation begins anew.
    pub scene: u64,
    /// How.
    pub settings: ShadowSettings,
}

impl ShadowPass {
    /// For DAGs in a memory of this kind.
    pub fn new(context: &Context, dag: &GpuDag) -> Self {
        ShadowPass {
            trace: trace_pipeline(context, dag, false),
            trace_cut: OnceLock::new(),
            smooth: compute_pipeline(context, "filter", "smooth_shares", &[]),
            free: storage(context, "free", 1),
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

    /// Casts the rays of a frame. False where no light casts shadows: then nothing is recorded.
    ///
    /// # Errors
    ///
    /// A picture of more pixels than a buffer can tell of.
    pub fn record(
        &mut self,
        recording: &mut Recording,
        inputs: &ShadowInputs,
        targets: &Targets,
    ) -> Result<bool, GpuError> {
        let Recording { context, encoder, timer } = recording;
        let mut uniform = shadow_uniform(inputs);
        if uniform.has_sun == 0 && uniform.has_sky == 0 {
            return Ok(false);
        }
        if self.size != targets.size {
            let pixels = u64::from(targets.size.0) * u64::from(targets.size.1);
            context.check_bound("bytes of shadows, 8 a pixel", 8 * pixels)?;
            self.free = storage(context, "free", pixels);
            self.reached = storage(context, "reached", pixels);
            self.size = targets.size;
            self.still = None;
        }
        let still = Still { camera: *inputs.camera, lighting: inputs.lighting.clone(), scene: inputs.scene };
        if self.still.as_ref() != Some(&still) {
            self.still = Some(still);
            self.samples = 0;
        }
        let last = (self.samples + inputs.settings.samples.max(1)).min(MOST_SAMPLES);
        let groups = (targets.size.0.div_ceil(GROUP), targets.size.1.div_ceil(GROUP));
        let seen = [
            BindingResource::TextureView(&targets.depth.view),
            BindingResource::TextureView(&targets.drawable.view),
            BindingResource::TextureView(&targets.normal.view),
        ];
        if self.samples < last {
            let trace = if inputs.clip.is_empty() {
                &self.trace
            } else {
                self.trace_cut.get_or_init(|| trace_pipeline(context, inputs.dag, true))
            };
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("shadow"),
                timestamp_writes: timer.compute_pass("shadow"),
            });
            pass.set_pipeline(trace);
            pass.set_bind_group(1, &inputs.dag.bind(context, &trace.get_bind_group_layout(1)), &[]);
            while self.samples < last {
                uniform.first_sample = self.samples;
                uniform.samples = MOST_AT_ONCE.min(last - self.samples);
                let uniform_buffer = context.uniform("shadow", &uniform);
                let [depth, drawable, normal] = seen.clone();
                let resources = [
                    inputs.view.as_entire_binding(),
                    uniform_buffer.as_entire_binding(),
                    depth,
                    drawable,
                    normal,
                    inputs.clip.binding(),
                    self.free.as_entire_binding(),
                ];
                let group = context.bind("shadow", &trace.get_bind_group_layout(0), resources);
                pass.set_bind_group(0, &group, &[]);
                pass.dispatch_workgroups(groups.0, groups.1, 1);
                self.samples += uniform.samples;
            }
        }
        let radius = match (inputs.settings.smooth, self.samples) {
            (false, _) => 0,
            (true, 0..16) => 2,
            (true, 16..64) => 1,
            (true, _) => 0,
        };
        let filter = FilterUniform {
            samples: self.samples,
            radius,
            has_sun: uniform.has_sun,
            has_sky: uniform.has_sky,
        };
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
        Ok(true)
    }
}

/// All but the numbers of samples.
fn shadow_uniform(inputs: &ShadowInputs) -> ShadowUniform {
    let grid = inputs.grid;
    let eye = grid.grid_from_world(inputs.camera.eye());
    // A camera so far away that its voxel is no i32 sees nothing in f32 either.
    let whole = eye.floor().clamp(DVec3::splat(-1e9), DVec3::splat(1e9));
    let (sun, sun_cap) = match inputs.lighting.key {
        KeyLight::Sun(sun) => {
            let half = 0.5 * sun.angle_deg.to_radians();
            // 1 - cos, without losing its digits.
            (Some(sun.direction.normalize_or(DVec3::Y)), 2.0 * libm::sin(0.5 * half).powi(2))
        }
        KeyLight::Headlight | KeyLight::None => (None, 0.0),
    };
    let reach = match inputs.lighting.sky {
        Sky::Occluded { reach } => Some((reach / grid.voxel_size).min(1e6)),
        Sky::None | Sky::Plain => None,
    };
    ShadowUniform {
        eye_voxel: whole.as_ivec3().to_array(),
        voxels_per_unit: (1.0 / grid.voxel_size) as f32,
        eye_fraction: (eye - whole).as_vec3().to_array(),
        sun: sun.unwrap_or(DVec3::Y).as_vec3().to_array(),
        sun_cap: sun_cap as f32,
        has_sun: sun.is_some().into(),
        has_sky: reach.is_some().into(),
        reach: reach.unwrap_or(0.0) as f32,
        ..ShadowUniform::default()
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

fn trace_pipeline(context: &Context, dag: &GpuDag, is_cut: bool) -> ComputePipeline {
    let [shift, slabs] = dag.constants();
    compute_pipeline(context, "shadow", "trace", &[shift, slabs, ClipPlanes::constant(is_cut)])
}

//! The query `voxel` on the GPU: a second backend of [`Culling`]. What it is asked now can be fetched later, without waiting.

use std::sync::mpsc::{Receiver, TryRecvError, channel};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use voxsight_voxel::grid::Grid;
use wgpu::{Buffer, BufferUsages, ComputePipeline, PollType};

use super::clear::ClearBricks;
use super::context::{Context, GpuError};
use super::dag::GpuDag;
use super::owners::GpuOwners;
use super::shader::compute_pipeline;
use super::twin::{GridRay, Tally};
use crate::camera::CameraRays;
use crate::progress::Progress;
use crate::ray::Ray;
use crate::visibility::culling::{CulledFrame, Culling, timed};
use crate::visibility::{QueryScene, QuerySettings, RayGrid, VisibleSet};

/// Rays of a workgroup.
pub const GROUP: u32 = 64;
/// Workgroups of a row.
const ROW: u32 = 1024;
/// Farther than any grid is wide, voxels: ends that lie beyond are taken as this.
pub const ENDLESS: f64 = 1e6;

/// `ListedRay` of `shaders/query.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct ListedRay {
    pub base: [i32; 3],
    pub t_end: f32,
    pub fraction: [f32; 3],
    pub padding_0: u32,
    pub direction: [f32; 3],
    pub padding_1: u32,
}

/// `Query` of `shaders/query.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct QueryUniform {
    pub rays: u32,
    pub row: u32,
    pub drawables: u32,
    pub padding_0: u32,
}

/// A world-space ray as shaders walk it: in voxels, its direction of length 1, its start split into whole voxels and the rest.
/// `None` where it cannot meet the grid.
pub fn grid_ray(grid: &Grid, ray: &Ray) -> Option<GridRay> {
    let per_unit = ray.direction.length() / grid.voxel_size;
    let direction = ray.direction.try_normalize()?;
    let origin = grid.grid_from_world(ray.at(ray.t_min));
    // Towards the grid first, where whole voxels and f32 do.
    let centre = DVec3::splat(0.5 * f64::from(grid.side()));
    let skipped = ((centre - origin).dot(direction) - f64::from(grid.side())).max(0.0);
    let start = origin + skipped * direction;
    let whole = start.floor();
    let length = (ray.t_max - ray.t_min) * per_unit - skipped;
    (whole.abs().max_element() < ENDLESS && length >= 0.0).then(|| GridRay {
        base: whole.as_ivec3(),
        fraction: (start - whole).as_vec3(),
        direction: direction.as_vec3(),
        t_end: length.min(ENDLESS) as f32,
    })
}

/// Casts rays of the query `voxel`.
pub struct GpuQuery {
    context: Context,
    settings: QuerySettings,
    dag: GpuDag,
    owners: GpuOwners,
    pipeline: ComputePipeline,
}

/// A question under way.
pub struct Pending {
    staging: Buffer,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    drawables: u32,
    rays: u64,
}

impl GpuQuery {
    /// For a scene, which must stay the same; what is hidden, transparent or cut away is asked for each frame.
    ///
    /// # Errors
    ///
    /// The GPU cannot hold its voxels and owners.
    pub fn new(context: &Context, scene: &QueryScene, settings: QuerySettings) -> Result<Self, GpuError> {
        let bound = context.device.limits().max_storage_buffers_per_shader_stage;
        if bound < 11 {
            let what = format!("11 storage buffers a shader (it has {bound})");
            return Err(GpuError::Lacks { adapter: context.name.clone(), what });
        }
        let dag = GpuDag::new(context, &scene.dag, &ClearBricks::default())?;
        let owners = GpuOwners::new(context, &scene.dag, &scene.owners)?;
        let constants: Vec<(&str, f64)> = dag.constants().into_iter().chain(owners.constants()).collect();
        let pipeline = compute_pipeline(context, "query", "count", &constants);
        context.check()?;
        Ok(GpuQuery { context: context.clone(), settings, dag, owners, pipeline })
    }

    /// The rays of a camera, as the CPU casts them, cut to what the filter leaves; and how many there were before.
    pub fn rays(&self, scene: &QueryScene, camera: &CameraRays) -> (Vec<GridRay>, u64) {
        let QuerySettings { rays_per_pixel, first_sample, jitter, .. } = self.settings;
        let cells = RayGrid::new(&scene.exact.brought_near(camera), rays_per_pixel, jitter);
        let (mut rays, mut count) = (Vec::new(), 0);
        for tile in cells.tiles() {
            for sample in 0..rays_per_pixel.samples() {
                cells.for_each_ray(&tile, first_sample.wrapping_add(sample), |cell| {
                    count += 1;
                    let clipped = scene.filter.clipped(&cell.ray);
                    rays.extend(clipped.and_then(|ray| grid_ray(&scene.grid, &ray)));
                });
            }
        }
        (rays, count)
    }

    /// Asks; does not wait. `count` is the number of rays that the answer shall tell, those that cannot meet anything included.
    ///
    /// # Errors
    ///
    /// The driver has reported one.
    pub fn ask(&self, scene: &QueryScene, rays: &[GridRay], count: u64) -> Result<Pending, GpuError> {
        let GpuQuery { context, pipeline, .. } = self;
        let drawables = scene.exact.drawable_count();
        let kinds = context.buffer("kinds", &kinds(scene), BufferUsages::STORAGE);
        let size = 4 * (u64::from(drawables) + u64::from(drawables.div_ceil(32)) + 1);
        let buffer = |label, usage| {
            context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        // All zero, as buffers are made.
        let tally = buffer("tally", BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let staging = buffer("tally read back", BufferUsages::MAP_READ | BufferUsages::COPY_DST);
        let voxels = self.dag.bind_voxels(context, &pipeline.get_bind_group_layout(1));
        let owners = self.owners.bind(context, &pipeline.get_bind_group_layout(2));
        let mut encoder = context.device.create_command_encoder(&Default::default());
        for rays in rays.chunks((context.most_bound() as usize / size_of::<ListedRay>()).max(1)) {
            let listed: Vec<ListedRay> = rays.iter().map(listed).collect();
            let list = context.buffer("rays", &listed, BufferUsages::STORAGE);
            let uniform =
                QueryUniform { rays: listed.len() as u32, row: ROW * GROUP, drawables, padding_0: 0 };
            let uniform = context.uniform("query", &uniform);
            let resources = [&list, &kinds, &tally, &uniform].map(|buffer| buffer.as_entire_binding());
            let group = context.bind("query", &pipeline.get_bind_group_layout(0), resources);
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.set_bind_group(1, &voxels, &[]);
            pass.set_bind_group(2, &owners, &[]);
            let groups = (listed.len() as u32).div_ceil(GROUP);
            pass.dispatch_workgroups(groups.min(ROW), groups.div_ceil(ROW), 1);
        }
        encoder.copy_buffer_to_buffer(&tally, 0, &staging, 0, size);
        context.queue.submit([encoder.finish()]);
        let (tell, mapped) = channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // The question was dropped: nobody wants to know.
            let _ = tell.send(result);
        });
        context.check()?;
        Ok(Pending { staging, mapped, drawables, rays: count })
    }

    /// The answer, if it is there.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn poll(&self, pending: &Pending) -> Result<Option<VisibleSet>, GpuError> {
        self.context.poll(PollType::Poll)?;
        match pending.mapped.try_recv() {
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(fetched_twice()),
            Ok(mapped) => pending.answer(mapped).map(Some),
        }
    }

    /// The answer; waits for it.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn wait(&self, pending: &Pending) -> Result<VisibleSet, GpuError> {
        self.context.wait()?;
        // Another thread's poll may be about to tell it.
        pending.answer(pending.mapped.recv().map_err(|_| fetched_twice())?)
    }
}

impl Pending {
    fn answer(&self, mapped: Result<(), wgpu::BufferAsyncError>) -> Result<VisibleSet, GpuError> {
        mapped.map_err(|error| GpuError::Failed(error.to_string()))?;
        let bytes = self.staging.get_mapped_range(..).map_err(|e| GpuError::Failed(e.to_string()))?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        drop(bytes);
        self.staging.unmap();
        let tally = tally_of(&words, self.drawables as usize);
        Ok(VisibleSet {
            rays: self.rays,
            weight: self.rays,
            hits: tally.hits.into(),
            samples: tally.samples,
            visible: tally.seen,
        })
    }
}

fn fetched_twice() -> GpuError {
    GpuError::Failed("an answer was fetched twice".into())
}

/// What the shader's words say.
fn tally_of(words: &[u32], drawables: usize) -> Tally {
    let (samples, rest) = words.split_at(drawables);
    let seen = (0..drawables).map(|d| rest[d / 32] >> (d % 32) & 1 == 1).collect();
    Tally { samples: samples.to_vec(), seen, hits: rest[drawables.div_ceil(32)] }
}

fn listed(ray: &GridRay) -> ListedRay {
    ListedRay {
        base: ray.base.to_array(),
        t_end: ray.t_end,
        fraction: ray.fraction.to_array(),
        direction: ray.direction.to_array(),
        ..ListedRay::default()
    }
}

/// Of a drawable's two bits: it is hidden.
pub const HIDDEN: u32 = 1;
/// It is seen through.
pub const TRANSPARENT: u32 = 2;

/// Two bits a drawable: [`HIDDEN`], [`TRANSPARENT`].
fn kinds(scene: &QueryScene) -> Vec<u32> {
    let drawables = scene.exact.drawable_count();
    let mut words = vec![0u32; drawables.div_ceil(16).max(1) as usize];
    for drawable in 0..drawables {
        let hidden = if scene.filter.is_hidden(drawable) { HIDDEN } else { 0 };
        let transparent = if scene.is_transparent(drawable) { TRANSPARENT } else { 0 };
        words[drawable as usize / 16] |= (hidden | transparent) << (2 * (drawable % 16));
    }
    words
}

impl Culling for GpuQuery {
    fn name(&self) -> String {
        "gpu-voxel".to_owned()
    }

    /// `None` also where the GPU has failed: [`Context::check`] tells what was wrong then.
    fn frame(
        &mut self,
        scene: &QueryScene,
        camera: &CameraRays,
        progress: &dyn Progress,
    ) -> Option<CulledFrame> {
        let mut stages = Vec::new();
        let (rays, count) = timed(&mut stages, "list", || self.rays(scene, camera));
        if progress.is_cancelled() {
            return None;
        }
        let keep = |error: GpuError| self.context.keep(error);
        let pending = timed(&mut stages, "send", || self.ask(scene, &rays, count)).map_err(keep).ok()?;
        let found = timed(&mut stages, "rays", || self.wait(&pending)).map_err(keep).ok()?;
        Some(CulledFrame { found, stages })
    }
}

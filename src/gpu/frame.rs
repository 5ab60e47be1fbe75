//! A frame: copies, geometry, light, one after the other in one submission.

use glam::DVec3;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::grid::Grid;
use wgpu::BufferUsages;

use super::clear::ClearBricks;
use super::clip::ClipPlanes;
use super::context::{Context, GpuError};
use super::dag::GpuDag;
use super::geometry::GeometryPass;
use super::glass::GlassPass;
use super::instance::{DrawList, Instance};
use super::light::LightUniform;
use super::marks::Marks;
use super::memory::{Copies, PagedMemory};
use super::pages::PageInputs;
use super::shade::{LightInputs, ShadeInputs, ShadePass};
use super::shadow::{Caster, ShadowInputs, ShadowPass, ShadowSettings};
use super::target::Targets;
use super::timer::{Recording, Timer};
use super::view::ViewUniform;
use crate::camera::Plane;
use crate::render::Lighting;

/// Passes of a frame in their order, as [`FrameRenderer::times`] names them.
pub const PASSES: [&str; 5] = ["geometry", "shadow", "filter", "transparent", "shade"];

/// What a frame shows.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Resident drawables at their levels, and the camera that sees them.
    pub list: &'a DrawList,
    /// Only what is inside all of these is there.
    pub clip: &'a [Plane],
    /// In this light.
    pub lighting: &'a Lighting,
    /// The world's up direction.
    pub up: DVec3,
    /// What is selected.
    pub marks: &'a Marks,
    /// Cast by voxels, if at all.
    pub shadows: Option<ShadowSettings>,
    /// What `clip` cuts open is drawn as solid.
    pub caps: bool,
    /// Another number where other drawables are drawn or cast shadows: accumulated shadows begin anew.
    pub scene: u64,
}

/// Voxels that cast shadows: first the scene's, then those of what was moved, if there are any.
#[derive(Debug)]
struct Voxels {
    casters: Vec<Caster>,
    pass: ShadowPass,
}

/// Draws frames.
#[derive(Debug)]
pub struct FrameRenderer {
    context: Context,
    /// Where pages are streamed to.
    pub memory: PagedMemory,
    targets: Targets,
    geometry: GeometryPass,
    glass: GlassPass,
    voxels: Option<Voxels>,
    shade: ShadePass,
    timer: Timer,
    /// Stands for the shares of light where nothing casts shadows.
    nothing: wgpu::Buffer,
}

impl FrameRenderer {
    /// For pictures of this size; `budget` bytes hold a scene's pages.
    ///
    /// # Errors
    ///
    /// More than the adapter can hold.
    pub fn new(context: &Context, budget: u64, size: (u32, u32)) -> Result<Self, GpuError> {
        let memory = PagedMemory::new(context, budget)?;
        let renderer = FrameRenderer {
            geometry: GeometryPass::new(context, memory.slabs()),
            glass: GlassPass::new(context, memory.slabs()),
            voxels: None,
            shade: ShadePass::new(context),
            targets: Targets::new(context, size)?,
            timer: Timer::new(context),
            nothing: context.buffer("nothing", &[0u32; 2], BufferUsages::STORAGE),
            context: context.clone(),
            memory,
        };
        context.check()?;
        Ok(renderer)
    }

    /// Makes voxels cast shadows from now on.
    ///
    /// # Errors
    ///
    /// More than the adapter can hold.
    pub fn set_voxels(&mut self, dag: &DagRef, grid: &Grid, clear: &ClearBricks) -> Result<(), GpuError> {
        let dag = GpuDag::new(&self.context, dag, clear)?;
        let pass = ShadowPass::new(&self.context);
        // What could not be made must not be drawn with.
        self.context.check()?;
        self.voxels = Some(Voxels { casters: vec![Caster { dag, grid: *grid }], pass });
        Ok(())
    }

    /// Makes other voxels cast shadows beside the scene's: those of what was moved. Nothing without [`FrameRenderer::set_voxels`].
    ///
    /// # Errors
    ///
    /// More than the adapter can hold.
    pub fn set_moved_voxels(&mut self, moved: Option<(&DagRef, &Grid)>) -> Result<(), GpuError> {
        let Some(voxels) = &mut self.voxels else { return Ok(()) };
        voxels.casters.truncate(1);
        if let Some((dag, grid)) = moved {
            let dag = GpuDag::new(&self.context, dag, &ClearBricks::default())?;
            self.context.check()?;
            voxels.casters.push(Caster { dag, grid: *grid });
        }
        Ok(())
    }

    /// Other drawables cast shadows.
    ///
    /// # Errors
    ///
    /// More bricks than a buffer holds.
    pub fn set_clear(&mut self, clear: &ClearBricks) -> Result<(), GpuError> {
        let casters = self.voxels.as_mut().map(|voxels| &mut voxels.casters);
        let scene = casters.and_then(|casters| casters.first_mut());
        scene.map_or(Ok(()), |caster| caster.dag.set_clear(&self.context, clear))
    }

    /// Do voxels cast shadows?
    pub fn has_voxels(&self) -> bool {
        self.voxels.is_some()
    }

    /// Rays to sun and sky that nothing stopped, for each pixel, and of how many: what [`FrameRenderer::reached`] is smoothed from.
    pub fn free(&self) -> Option<(&wgpu::Buffer, u32)> {
        self.voxels.as_ref().map(|voxels| (voxels.pass.free(), voxels.pass.samples()))
    }

    /// Shares of sun and sky that reached each pixel of the last frame with shadows.
    pub fn reached(&self) -> Option<&wgpu::Buffer> {
        self.voxels.as_ref().map(|voxels| voxels.pass.reached())
    }

    /// Samples of its shadows so far.
    pub fn shadow_samples(&self) -> u32 {
        self.voxels.as_ref().map_or(0, |voxels| voxels.pass.samples())
    }

    /// Bytes of the voxel DAG.
    pub fn voxel_bytes(&self) -> u64 {
        self.voxels.as_ref().map_or(0, |voxels| voxels.casters.iter().map(|caster| caster.dag.bytes()).sum())
    }

    /// Copies what was written into the memory. Does not wait.
    ///
    /// # Errors
    ///
    /// The driver has reported one, here or before.
    pub fn upload(&mut self) -> Result<Copies, GpuError> {
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        let copies = self.memory.flush(&self.context, &mut encoder);
        self.context.queue.submit([encoder.finish()]);
        self.context.check()?;
        Ok(copies)
    }

    /// Draws a frame: what was written into the memory and not yet copied goes first. Does not wait.
    ///
    /// # Errors
    ///
    /// The driver has reported one, here or before; larger than the adapter's textures.
    pub fn draw(&mut self, input: &FrameInput) -> Result<(), GpuError> {
        let FrameRenderer { context, memory, geometry, glass, shade, timer, .. } = self;
        let (camera, bounds) = (&input.list.camera, input.list.bounds);
        let pixels = u64::from(camera.size().0) * u64::from(camera.size().1);
        if self.voxels.is_some() && input.shadows.is_some() {
            // Before anything is recorded: what is not submitted would be lost.
            context.check_bound("bytes of shadows, 8 a pixel", 8 * pixels)?;
        }
        if self.targets.size != camera.size() {
            self.targets = Targets::new(context, camera.size())?;
        }
        let view = context.uniform("view", &ViewUniform::new(camera, bounds.0, bounds.1));
        let clip = ClipPlanes::new(context, input.clip, camera.eye());
        let marks = input.marks.buffer(context);
        timer.begin();
        let mut encoder = context.device.create_command_encoder(&Default::default());
        memory.flush(context, &mut encoder);
        let mut recording = Recording { context, encoder: &mut encoder, timer };
        // A buffer cannot be empty.
        let none = [Instance::default()];
        let instances = if input.list.instances.is_empty() { &none } else { input.list.instances.as_slice() };
        let instances = context.buffer("instances", instances, BufferUsages::VERTEX);
        let pages = PageInputs {
            pool: memory.slabs(),
            list: input.list,
            instances: &instances,
            view: &view,
            clip: &clip,
        };
        geometry.record(&mut recording, &pages, &self.targets);
        let reached = match (&mut self.voxels, input.shadows) {
            (Some(Voxels { casters, pass }), Some(settings)) => {
                let inputs = ShadowInputs {
                    casters,
                    camera,
                    view: &view,
                    clip: &clip,
                    planes: input.clip,
                    lighting: input.lighting,
                    scene: input.scene,
                    settings,
                };
                pass.record(&mut recording, &inputs, &self.targets).then(|| pass.reached())
            }
            _ => None,
        };
        let has_glass = !input.list.transparent.is_empty();
        let light = LightUniform {
            has_caps: (input.caps && !clip.is_empty()).into(),
            ..LightUniform::new(input.lighting, input.up, reached.is_some(), has_glass)
        };
        let light = LightInputs { light: &context.uniform("light", &light), marks: &marks };
        if has_glass {
            glass.record(&mut recording, &pages, &light, &self.targets);
        }
        let inputs =
            ShadeInputs { view: &view, reached: reached.unwrap_or(&self.nothing), clip: &clip, light };
        shade.record(&mut recording, &inputs, &self.targets);
        timer.end(&mut encoder);
        context.queue.submit([encoder.finish()]);
        context.check()
    }

    /// What it draws with.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// What the last frame drew into.
    pub fn targets(&self) -> &Targets {
        &self.targets
    }

    /// Milliseconds of the last frame's passes; waits for them.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn times(&self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        self.timer.read(&self.context)
    }
}

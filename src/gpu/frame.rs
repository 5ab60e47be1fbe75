//! A frame: copies, geometry, light, one after the other in one submission.

use glam::DVec3;
use wgpu::BufferUsages;
use wgpu::util::DeviceExt;

use super::context::{Context, GpuError};
use super::geometry::GeometryPass;
use super::instance::DrawList;
use super::light::LightUniform;
use super::marks::Marks;
use super::memory::{Copies, PagedMemory};
use super::shade::{ShadeInputs, ShadePass};
use super::target::Targets;
use super::timer::{Recording, Timer};
use super::view::ViewUniform;
use crate::camera::CameraRays;
use crate::render::Lighting;

/// What a frame shows.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Resident drawables at their levels.
    pub list: &'a DrawList,
    /// Seen from here.
    pub camera: &'a CameraRays,
    /// In this light.
    pub lighting: &'a Lighting,
    /// The world's up direction.
    pub up: DVec3,
    /// What is selected.
    pub marks: &'a Marks,
}

/// Draws frames.
#[derive(Debug)]
pub struct FrameRenderer {
    context: Context,
    /// Where pages are streamed to.
    pub memory: PagedMemory,
    targets: Targets,
    geometry: GeometryPass,
    shade: ShadePass,
    timer: Timer,
    /// Corners of the scene.
    bounds: (DVec3, DVec3),
    /// Stands for the shares of light where nothing casts shadows.
    nothing: wgpu::Buffer,
}

impl FrameRenderer {
    /// For a scene between two corners, in pictures of this size; `budget` bytes hold its pages.
    ///
    /// # Errors
    ///
    /// More than the adapter can hold.
    pub fn new(
        context: &Context,
        budget: u64,
        bounds: (DVec3, DVec3),
        size: (u32, u32),
    ) -> Result<Self, GpuError> {
        let memory = PagedMemory::new(context, budget)?;
        Ok(FrameRenderer {
            geometry: GeometryPass::new(context, memory.slabs()),
            shade: ShadePass::new(context),
            targets: Targets::new(context, size)?,
            timer: Timer::new(context),
            nothing: uniform(context, "nothing", &[0u32; 2], BufferUsages::STORAGE),
            context: context.clone(),
            memory,
            bounds,
        })
    }

    /// Draws a frame: what was written into the memory goes first. Does not wait.
    ///
    /// # Errors
    ///
    /// The driver has reported one, here or before; larger than the adapter's textures.
    pub fn draw(&mut self, input: &FrameInput) -> Result<Copies, GpuError> {
        let FrameRenderer { context, memory, geometry, shade, timer, .. } = self;
        if self.targets.size != input.camera.size() {
            self.targets = Targets::new(context, input.camera.size())?;
        }
        let view = ViewUniform::new(input.camera, self.bounds.0, self.bounds.1);
        let view = uniform(context, "view", &[view], BufferUsages::UNIFORM);
        let light = LightUniform::new(input.lighting, input.up, false);
        let light = uniform(context, "light", &[light], BufferUsages::UNIFORM);
        let marks = input.marks.buffer(context);
        timer.begin();
        let mut encoder = context.device.create_command_encoder(&Default::default());
        let copies = memory.flush(context, &mut encoder);
        let mut recording = Recording { context, encoder: &mut encoder, timer };
        geometry.record(&mut recording, memory.slabs(), input.list, &view, &self.targets);
        let inputs = ShadeInputs { view: &view, light: &light, reached: &self.nothing, marks: &marks };
        shade.record(&mut recording, &inputs, &self.targets);
        timer.end(&mut encoder);
        context.queue.submit([encoder.finish()]);
        context.check()?;
        Ok(copies)
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

fn uniform<T: bytemuck::Pod>(
    context: &Context,
    label: &str,
    contents: &[T],
    usage: BufferUsages,
) -> wgpu::Buffer {
    context.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents: bytemuck::cast_slice(contents),
        usage,
    })
}

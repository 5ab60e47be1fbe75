//! The shading pass: light on what the geometry pass saw.

use wgpu::{BindingResource, Buffer, RenderPipeline};

use super::clip::ClipPlanes;
use super::context::Context;
use super::pages::cleared;
use super::shader::module_of;
use super::target::{PICTURE, Targets};
use super::timer::Recording;

/// Makes the picture.
#[derive(Debug)]
pub(super) struct ShadePass {
    pipeline: RenderPipeline,
}

/// What it reads beside the targets.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadeInputs<'a> {
    /// [`super::view::ViewUniform`].
    pub view: &'a Buffer,
    /// Shares of sun and sky, two f32 a pixel; any buffer of 8 bytes where nothing casts shadows.
    pub reached: &'a Buffer,
    /// What is cut away.
    pub clip: &'a ClipPlanes,
    /// Light and marks.
    pub light: LightInputs<'a>,
}

/// What surfaces look like beside their own colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightInputs<'a> {
    /// [`super::light::LightUniform`].
    pub light: &'a Buffer,
    /// [`super::marks::Marks`].
    pub marks: &'a Buffer,
}

impl ShadePass {
    /// Made once.
    pub fn new(context: &Context) -> Self {
        let module = module_of(context, "shade");
        let pipeline = context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("shade"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex_main"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment_main"),
                compilation_options: Default::default(),
                targets: &[Some(PICTURE.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        ShadePass { pipeline }
    }

    /// Fills the picture.
    pub fn record(&self, recording: &mut Recording, inputs: &ShadeInputs, targets: &Targets) {
        let Recording { context, encoder, timer } = recording;
        let resources = [
            inputs.view.as_entire_binding(),
            BindingResource::TextureView(&targets.drawable.view),
            BindingResource::TextureView(&targets.normal.view),
            BindingResource::TextureView(&targets.colour.view),
            inputs.reached.as_entire_binding(),
            inputs.clip.binding(),
            BindingResource::TextureView(&targets.glass_sum.view),
            BindingResource::TextureView(&targets.glass_through.view),
        ];
        let group = context.bind("shade", &self.pipeline.get_bind_group_layout(0), resources);
        let light = bind_light(context, &self.pipeline, &inputs.light);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shade"),
            color_attachments: &[cleared(&targets.picture.view, wgpu::Color::BLACK)],
            depth_stencil_attachment: None,
            timestamp_writes: timer.render_pass("shade"),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_bind_group(1, &light, &[]);
        pass.draw(0..3, 0..1);
    }
}

/// Bindings of `shaders/light.wgsl` and `shaders/marks.wgsl`.
pub(super) fn bind_light(
    context: &Context,
    pipeline: &RenderPipeline,
    inputs: &LightInputs,
) -> wgpu::BindGroup {
    let resources = [inputs.light, inputs.marks].map(|buffer| buffer.as_entire_binding());
    context.bind("light", &pipeline.get_bind_group_layout(1), resources)
}

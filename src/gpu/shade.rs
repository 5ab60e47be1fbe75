//! The shading pass: light on what the geometry pass saw.

use wgpu::{BindGroupEntry, BindingResource, Buffer, RenderPipeline};

use super::context::Context;
use super::shader::module_of;
use super::target::{PICTURE, Targets};
use super::timer::Recording;

/// Makes the picture.
#[derive(Debug)]
pub struct ShadePass {
    pipeline: RenderPipeline,
}

/// What it reads beside the targets.
#[derive(Clone, Copy, Debug)]
pub struct ShadeInputs<'a> {
    /// [`super::view::ViewUniform`].
    pub view: &'a Buffer,
    /// [`super::light::LightUniform`].
    pub light: &'a Buffer,
    /// Shares of sun and sky, two f32 a pixel; any buffer of 8 bytes where nothing casts shadows.
    pub reached: &'a Buffer,
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
            inputs.marks.as_entire_binding(),
            BindingResource::TextureView(&targets.glass_sum.view),
            BindingResource::TextureView(&targets.glass_through.view),
        ];
        let entries: Vec<BindGroupEntry> =
            (0..).zip(resources).map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
        let group = context.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shade"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let light = bind_light(context, &self.pipeline, inputs.light);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shade"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &targets.picture.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
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

/// Bindings of `shaders/light.wgsl`.
pub(super) fn bind_light(context: &Context, pipeline: &RenderPipeline, light: &Buffer) -> wgpu::BindGroup {
    context.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("light"),
        layout: &pipeline.get_bind_group_layout(1),
        entries: &[BindGroupEntry { binding: 0, resource: light.as_entire_binding() }],
    })
}

//! Transparent surfaces, drawn in any order over what is opaque.

use wgpu::{BlendComponent, BlendFactor, BlendOperation, BlendState, Buffer, RenderPipeline};

use super::context::Context;
use super::geometry::{bind_pages, draw_all};
use super::instance::{DrawList, Instance};
use super::memory::Slabs;
use super::shade::bind_light;
use super::shader::{POOL_CONSTANTS, module_of};
use super::target::{DEPTH, GLASS_SUM, GLASS_THROUGH, Targets};
use super::timer::Recording;

/// Draws what is transparent.
#[derive(Debug)]
pub struct GlassPass {
    pipeline: RenderPipeline,
}

/// What the pass reads.
#[derive(Clone, Copy, Debug)]
pub struct GlassInputs<'a> {
    /// Where pages lie.
    pub pool: &'a Slabs,
    /// What is drawn.
    pub list: &'a DrawList,
    /// All of its instances.
    pub instances: &'a Buffer,
    /// [`super::view::ViewUniform`].
    pub view: &'a Buffer,
    /// [`super::light::LightUniform`].
    pub light: &'a Buffer,
}

impl GlassPass {
    /// For pages in a memory of this kind.
    pub fn new(context: &Context, pool: &Slabs) -> Self {
        let module = module_of(context, "glass");
        let constants = pool.constants(POOL_CONSTANTS);
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let blended = |format, src_factor, dst_factor| {
            let component = BlendComponent { src_factor, dst_factor, operation: BlendOperation::Add };
            let blend = Some(BlendState { color: component, alpha: component });
            Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })
        };
        let pipeline = context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("glass"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex_main"),
                compilation_options: options.clone(),
                buffers: &[Some(Instance::layout())],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(false),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment_glass"),
                compilation_options: options,
                targets: &[
                    blended(GLASS_SUM, BlendFactor::One, BlendFactor::One),
                    blended(GLASS_THROUGH, BlendFactor::Zero, BlendFactor::OneMinusSrc),
                ],
            }),
            multiview_mask: None,
            cache: None,
        });
        GlassPass { pipeline }
    }

    /// Draws the transparent part of a list.
    pub fn record(&self, recording: &mut Recording, inputs: &GlassInputs, targets: &Targets) {
        let Recording { context, encoder, timer } = recording;
        let clear = |view, color| {
            let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(color), store: wgpu::StoreOp::Store };
            Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("glass"),
            color_attachments: &[
                clear(&targets.glass_sum.view, wgpu::Color::TRANSPARENT),
                clear(&targets.glass_through.view, wgpu::Color::WHITE),
            ],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &targets.depth.view,
                // Only read.
                depth_ops: None,
                stencil_ops: None,
            }),
            timestamp_writes: timer.render_pass("transparent"),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        let pages = bind_pages(context, &self.pipeline, inputs.pool, inputs.view);
        let light = bind_light(context, &self.pipeline, inputs.light);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &pages, &[]);
        pass.set_bind_group(1, &light, &[]);
        pass.set_vertex_buffer(0, inputs.instances.slice(..));
        draw_all(context, &mut pass, &inputs.list.transparent);
    }
}

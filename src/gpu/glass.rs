//! Transparent surfaces, drawn in any order over what is opaque.

use wgpu::{BlendComponent, BlendFactor, BlendOperation, BlendState};

use super::context::Context;
use super::memory::Slabs;
use super::pages::{PageInputs, PagePipelines, PageShader, bind_pages, cleared, draw_all};
use super::shade::{LightInputs, bind_light};
use super::target::{GLASS_SUM, GLASS_THROUGH, Targets};
use super::timer::Recording;

/// Draws what is transparent.
#[derive(Debug)]
pub(super) struct GlassPass {
    pipelines: PagePipelines,
}

impl GlassPass {
    /// For pages in a memory of this kind.
    pub fn new(context: &Context, pool: &Slabs) -> Self {
        let blended = |format, src_factor, dst_factor| {
            let component = BlendComponent { src_factor, dst_factor, operation: BlendOperation::Add };
            let blend = Some(BlendState { color: component, alpha: component });
            Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })
        };
        let shader = PageShader {
            name: "glass",
            fragment: "fragment_glass",
            fragment_cut: "fragment_glass",
            targets: vec![
                blended(GLASS_SUM, BlendFactor::One, BlendFactor::One),
                blended(GLASS_THROUGH, BlendFactor::Zero, BlendFactor::OneMinusSrc),
            ],
            writes_depth: false,
        };
        GlassPass { pipelines: PagePipelines::new(context, pool, shader) }
    }

    /// Draws the transparent part of a list.
    pub fn record(
        &self,
        recording: &mut Recording,
        inputs: &PageInputs,
        light: &LightInputs,
        targets: &Targets,
    ) {
        let Recording { context, encoder, timer } = recording;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("glass"),
            color_attachments: &[
                cleared(&targets.glass_sum.view, wgpu::Color::TRANSPARENT),
                cleared(&targets.glass_through.view, wgpu::Color::WHITE),
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
        let pipeline = self.pipelines.choose(context, inputs);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bind_pages(context, pipeline, inputs), &[]);
        pass.set_bind_group(1, &bind_light(context, pipeline, light), &[]);
        pass.set_vertex_buffer(0, inputs.instances.slice(..));
        draw_all(context, &mut pass, &inputs.list.transparent);
    }
}

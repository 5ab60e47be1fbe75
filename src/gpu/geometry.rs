//! The geometry pass: resident pages into depth, drawable, normal and colour.

use super::context::Context;
use super::memory::Slabs;
use super::pages::{PageInputs, PagePipelines, PageShader, bind_pages, cleared, draw_all};
use super::target::{COLOUR, DRAWABLE, NOBODY, NORMAL, Targets};
use super::timer::Recording;

/// Draws what is opaque.
#[derive(Debug)]
pub(super) struct GeometryPass {
    pipelines: PagePipelines,
}

impl GeometryPass {
    /// For pages in a memory of this kind.
    pub fn new(context: &Context, pool: &Slabs) -> Self {
        let shader = PageShader {
            name: "geometry",
            fragment: "fragment_main",
            fragment_cut: "fragment_cut",
            targets: vec![Some(DRAWABLE.into()), Some(NORMAL.into()), Some(COLOUR.into())],
            writes_depth: true,
        };
        GeometryPass { pipelines: PagePipelines::new(context, pool, shader) }
    }

    /// Clears the targets and draws a list.
    pub fn record(&self, recording: &mut Recording, inputs: &PageInputs, targets: &Targets) {
        let Recording { context, encoder, timer } = recording;
        let nobody = wgpu::Color { r: NOBODY.into(), ..wgpu::Color::TRANSPARENT };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("geometry"),
            color_attachments: &[
                cleared(&targets.drawable.view, nobody),
                cleared(&targets.normal.view, wgpu::Color::TRANSPARENT),
                cleared(&targets.colour.view, wgpu::Color::TRANSPARENT),
            ],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &targets.depth.view,
                // Reverse-Z: 0 is farthest.
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: timer.render_pass("geometry"),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        if inputs.list.opaque.is_empty() {
            return;
        }
        let pipeline = self.pipelines.choose(context, inputs);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bind_pages(context, pipeline, inputs), &[]);
        pass.set_vertex_buffer(0, inputs.instances.slice(..));
        draw_all(context, &mut pass, &inputs.list.opaque);
    }
}

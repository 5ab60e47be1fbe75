//! The geometry pass: resident pages into depth, drawable, normal and colour.

use wgpu::{BufferUsages, RenderPipeline};

use super::context::Context;
use super::instance::{Draw, DrawList, Instance};
use super::memory::{SLABS, Slabs};
use super::shader::{POOL_CONSTANTS, module_of};
use super::target::{COLOUR, DEPTH, DRAWABLE, NOBODY, NORMAL, Targets};
use super::timer::Recording;

/// Draws what is opaque.
#[derive(Debug)]
pub struct GeometryPass {
    pipeline: RenderPipeline,
}

impl GeometryPass {
    /// For pages in a memory of this kind.
    pub fn new(context: &Context, pool: &Slabs) -> Self {
        let module = module_of(context, "geometry");
        let constants = pool.constants(POOL_CONSTANTS);
        let options = wgpu::PipelineCompilationOptions {
            constants: &constants,
            zero_initialize_workgroup_memory: true,
        };
        let pipeline = context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("geometry"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex_main"),
                compilation_options: options.clone(),
                buffers: &[Some(Instance::layout())],
            },
            // Both sides are drawn.
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment_main"),
                compilation_options: options,
                targets: &[Some(DRAWABLE.into()), Some(NORMAL.into()), Some(COLOUR.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        GeometryPass { pipeline }
    }

    /// Clears the targets and draws a list, given the buffer of its instances. `view` is a uniform buffer with a [`super::view::ViewUniform`].
    pub fn record(
        &self,
        recording: &mut Recording,
        pool: &Slabs,
        (list, instances): (&DrawList, &wgpu::Buffer),
        view: &wgpu::Buffer,
        targets: &Targets,
    ) {
        let Recording { context, encoder, timer } = recording;
        let clear = |view, value: f64| {
            let color = wgpu::Color { r: value, g: 0.0, b: 0.0, a: 0.0 };
            let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(color), store: wgpu::StoreOp::Store };
            Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("geometry"),
            color_attachments: &[
                clear(&targets.drawable.view, NOBODY.into()),
                clear(&targets.normal.view, 0.0),
                clear(&targets.colour.view, 0.0),
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
        if list.opaque.is_empty() {
            return;
        }
        let group = bind_pages(context, &self.pipeline, pool, view);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_vertex_buffer(0, instances.slice(..));
        draw_all(context, &mut pass, &list.opaque);
    }
}

/// Bindings of `shaders/page.wgsl` and the view after them.
pub(super) fn bind_pages(
    context: &Context,
    pipeline: &RenderPipeline,
    pool: &Slabs,
    view: &wgpu::Buffer,
) -> wgpu::BindGroup {
    let resources = pool.bindings().into_iter().chain([view.as_entire_binding()]);
    let entries: Vec<wgpu::BindGroupEntry> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    debug_assert_eq!(entries.len(), SLABS + 1);
    context.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("pages"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    })
}

/// All draws at once where the adapter can, or one by one.
pub(super) fn draw_all(context: &Context, pass: &mut wgpu::RenderPass, draws: &[Draw]) {
    if context.has_indirect {
        let arguments = context.buffer("draws", bytemuck::cast_slice(draws), BufferUsages::INDIRECT);
        pass.multi_draw_indirect(&arguments, 0, draws.len() as u32);
        return;
    }
    for draw in draws {
        pass.draw(0..draw.vertices, draw.first_instance..draw.first_instance + draw.instances);
    }
}

//! What both passes share that draw pages: pipelines, bindings, draws.

use std::sync::OnceLock;

use wgpu::{BindGroup, Buffer, BufferUsages, ColorTargetState, RenderPass, RenderPipeline};

use super::clip::ClipPlanes;
use super::context::Context;
use super::instance::{Draw, DrawList, Instance};
use super::memory::Slabs;
use super::shader::{POOL_CONSTANTS, module_of};
use super::target::DEPTH;

/// What a pass draws, and with what.
#[derive(Clone, Copy, Debug)]
pub(super) struct PageInputs<'a> {
    /// Where pages lie.
    pub pool: &'a Slabs,
    /// What is drawn.
    pub list: &'a DrawList,
    /// All of its instances.
    pub instances: &'a Buffer,
    /// [`super::view::ViewUniform`].
    pub view: &'a Buffer,
    /// What is cut away.
    pub clip: &'a ClipPlanes,
}

/// How pages become pixels.
#[derive(Debug)]
pub(super) struct PageShader {
    /// Of `shader::PIPELINES`.
    pub name: &'static str,
    /// Its fragment shader.
    pub fragment: &'static str,
    /// The same where something is cut away.
    pub fragment_cut: &'static str,
    /// What that fills.
    pub targets: Vec<Option<ColorTargetState>>,
    /// What is farther is hidden.
    pub writes_depth: bool,
}

/// A pipeline, and another one where something is cut away, made when that first happens: looking at every pixel takes time.
#[derive(Debug)]
pub(super) struct PagePipelines {
    shader: PageShader,
    whole: RenderPipeline,
    cut: OnceLock<RenderPipeline>,
}

impl PagePipelines {
    /// For pages in a memory of this kind.
    pub fn new(context: &Context, pool: &Slabs, shader: PageShader) -> Self {
        let whole = pipeline(context, pool, &shader, false);
        PagePipelines { shader, whole, cut: OnceLock::new() }
    }

    /// The one that these inputs need.
    pub fn choose(&self, context: &Context, inputs: &PageInputs) -> &RenderPipeline {
        if inputs.clip.is_empty() {
            return &self.whole;
        }
        self.cut.get_or_init(|| pipeline(context, inputs.pool, &self.shader, true))
    }
}

fn pipeline(context: &Context, pool: &Slabs, shader: &PageShader, is_cut: bool) -> RenderPipeline {
    let module = module_of(context, shader.name);
    let [shift, slabs] = pool.constants(POOL_CONSTANTS);
    let constants = [shift, slabs, ClipPlanes::constant(is_cut)];
    let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
    context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(shader.name),
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
            depth_write_enabled: Some(shader.writes_depth),
            // Reverse-Z.
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(if is_cut { shader.fragment_cut } else { shader.fragment }),
            compilation_options: options,
            targets: &shader.targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Bindings of `shaders/page.wgsl`, and the view and clip planes after them.
pub(super) fn bind_pages(context: &Context, pipeline: &RenderPipeline, inputs: &PageInputs) -> BindGroup {
    let others = [inputs.view.as_entire_binding(), inputs.clip.binding()];
    let resources = inputs.pool.bindings().into_iter().chain(others);
    context.bind("pages", &pipeline.get_bind_group_layout(0), resources)
}

/// All draws at once where the adapter can, or one by one.
pub(super) fn draw_all(context: &Context, pass: &mut RenderPass, draws: &[Draw]) {
    if context.has_indirect {
        let arguments = context.buffer("draws", draws, BufferUsages::INDIRECT);
        pass.multi_draw_indirect(&arguments, 0, draws.len() as u32);
        return;
    }
    for draw in draws {
        pass.draw(0..draw.vertices, draw.first_instance..draw.first_instance + draw.instances);
    }
}

/// A target that is cleared first.
pub(super) fn cleared(
    view: &wgpu::TextureView,
    color: wgpu::Color,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(color), store: wgpu::StoreOp::Store };
    Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}

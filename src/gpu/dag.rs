//! The voxel DAG in the GPU's memory, as `shaders/dag.wgsl` reads it: nodes, leaf masks and brick counts in one space of addresses.

use bytemuck::{Pod, Zeroable};
use voxsight_voxel::dag::DagRef;
use wgpu::BufferUsages;

use super::clear::ClearBricks;
use super::context::{Context, GpuError};
use super::memory::Slabs;
use super::shader::DAG_CONSTANTS;

/// `Dag` of `shaders/dag.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct DagUniform {
    pub root: u32,
    pub height: u32,
    pub side: i32,
    pub leaves_at: u32,
    pub clear_slots: u32,
    pub counts_at: u32,
    pub counts_from: u32,
    pub padding_0: u32,
}

/// A DAG that shaders can read.
#[derive(Debug)]
pub struct GpuDag {
    slabs: Slabs,
    uniform: DagUniform,
    uniform_buffer: wgpu::Buffer,
    clear: wgpu::Buffer,
}

impl GpuDag {
    /// Copies a DAG.
    ///
    /// # Errors
    ///
    /// More than the adapter can hold in all its slabs.
    pub fn new(context: &Context, dag: &DagRef, clear: &ClearBricks) -> Result<Self, GpuError> {
        let (words, leaves): (&[u8], &[u8]) =
            (bytemuck::cast_slice(dag.words()), bytemuck::cast_slice(dag.leaves()));
        let (counts_from, counts) = dag.low_counts();
        let counts: &[u8] = bytemuck::cast_slice(counts);
        let slabs = Slabs::new(
            context,
            "bytes of the voxel DAG",
            (words.len() + leaves.len() + counts.len()) as u64,
        )?;
        slabs.write(context, 0, words);
        slabs.write(context, words.len() as u64, leaves);
        slabs.write(context, (words.len() + leaves.len()) as u64, counts);
        let uniform = DagUniform {
            root: dag.root().unwrap_or(0),
            height: dag.height(),
            side: if dag.root().is_some() { 1 << dag.log2() } else { 0 },
            // At most 2^32 - 1 words, which building guarantees.
            leaves_at: dag.words().len() as u32,
            clear_slots: clear.last_slot(),
            // Slabs have at most 2^32 words.
            counts_at: (dag.words().len() + 2 * dag.leaves().len()) as u32,
            counts_from: counts_from as u32,
            padding_0: 0,
        };
        Ok(GpuDag {
            slabs,
            uniform,
            uniform_buffer: context.uniform("dag", &uniform),
            clear: clear_buffer(context, clear)?,
        })
    }

    /// Other drawables are hidden or shown.
    ///
    /// # Errors
    ///
    /// More bricks than a buffer holds.
    pub fn set_clear(&mut self, context: &Context, clear: &ClearBricks) -> Result<(), GpuError> {
        let buffer = clear_buffer(context, clear)?;
        let uniform = DagUniform { clear_slots: clear.last_slot(), ..self.uniform };
        let uniform_buffer = context.uniform("dag", &uniform);
        // What could not be made must not be drawn with.
        context.check()?;
        (self.clear, self.uniform, self.uniform_buffer) = (buffer, uniform, uniform_buffer);
        Ok(())
    }

    /// Bytes of nodes, leaf masks and counts.
    pub fn bytes(&self) -> u64 {
        self.slabs.bytes()
    }

    /// What `shaders/dag.wgsl` needs to know.
    pub fn constants(&self) -> [(&'static str, f64); 2] {
        self.slabs.constants(DAG_CONSTANTS)
    }

    /// Bindings of group 1, for shaders that ask what casts a shadow.
    pub fn bind(&self, context: &Context, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        self.bind_with(context, layout, Some(&self.clear))
    }

    /// Bindings of group 1, for shaders that do not.
    pub fn bind_voxels(&self, context: &Context, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        self.bind_with(context, layout, None)
    }

    fn bind_with(
        &self,
        context: &Context,
        layout: &wgpu::BindGroupLayout,
        clear: Option<&wgpu::Buffer>,
    ) -> wgpu::BindGroup {
        let others = [Some(&self.uniform_buffer), clear];
        let others = others.into_iter().flatten().map(|buffer| buffer.as_entire_binding());
        context.bind("dag", layout, self.slabs.bindings().into_iter().chain(others))
    }
}

fn clear_buffer(context: &Context, clear: &ClearBricks) -> Result<wgpu::Buffer, GpuError> {
    let contents = clear.contents();
    context.check_bound("bytes of bricks that cast no shadow", size_of_val(&*contents) as u64)?;
    Ok(context.buffer("clear bricks", &contents, BufferUsages::STORAGE))
}

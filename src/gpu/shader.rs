//! Shader texts, and modules made of them.

use super::context::Context;

/// Pages, instances, decoding.
pub const PAGE: &str = include_str!("../../shaders/page.wgsl");
/// The constants of [`PAGE`], for [`super::memory::Slabs::constants`].
pub const POOL_CONSTANTS: [&str; 2] = ["POOL_SHIFT", "POOL_SLABS"];
/// Directions in 32 bits.
pub const OCTAHEDRAL: &str = include_str!("../../shaders/octahedral.wgsl");
/// The camera.
pub const VIEW: &str = include_str!("../../shaders/view.wgsl");
/// The geometry pass; after [`PAGE`], [`OCTAHEDRAL`] and [`VIEW`].
pub const GEOMETRY: &str = include_str!("../../shaders/geometry.wgsl");
/// Rays through the voxel DAG.
pub const DAG: &str = include_str!("../../shaders/dag.wgsl");
/// The constants of [`DAG`].
pub const DAG_CONSTANTS: [&str; 2] = ["DAG_SHIFT", "DAG_SLABS"];
/// Who owns voxels.
pub const OWNERS: &str = include_str!("../../shaders/owners.wgsl");
/// The constants of [`OWNERS`].
pub const OWNERS_CONSTANTS: [&str; 2] = ["OWNERS_SHIFT", "OWNERS_SLABS"];
/// The visibility query; after [`DAG`] and [`OWNERS`].
pub const QUERY: &str = include_str!("../../shaders/query.wgsl");
/// The shadow pass; after [`VIEW`], [`OCTAHEDRAL`] and [`DAG`].
pub const SHADOW: &str = include_str!("../../shaders/shadow.wgsl");
/// What smooths it; after [`VIEW`] and [`OCTAHEDRAL`].
pub const FILTER: &str = include_str!("../../shaders/filter.wgsl");
/// Clip planes; after [`VIEW`].
pub const CLIP: &str = include_str!("../../shaders/clip.wgsl");
/// What is selected or highlighted.
pub const MARKS: &str = include_str!("../../shaders/marks.wgsl");
/// Light on a surface.
pub const LIGHT: &str = include_str!("../../shaders/light.wgsl");
/// Transparent surfaces; after [`GEOMETRY`] and [`LIGHT`].
pub const GLASS: &str = include_str!("../../shaders/glass.wgsl");
/// The shading pass; after [`OCTAHEDRAL`], [`VIEW`], [`CLIP`], [`LIGHT`] and [`MARKS`].
pub const SHADE: &str = include_str!("../../shaders/shade.wgsl");

/// Makes a module of several texts, one after the other.
pub fn module(context: &Context, label: &str, texts: &[&str]) -> wgpu::ShaderModule {
    context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(texts.concat().into()),
    })
}

/// The texts of every pipeline, by name.
pub const PIPELINES: [(&str, &[&str]); 6] = [
    ("geometry", &[PAGE, OCTAHEDRAL, VIEW, CLIP, GEOMETRY]),
    ("glass", &[PAGE, OCTAHEDRAL, VIEW, CLIP, GEOMETRY, LIGHT, MARKS, GLASS]),
    ("shade", &[OCTAHEDRAL, VIEW, CLIP, LIGHT, MARKS, SHADE]),
    ("shadow", &[VIEW, CLIP, OCTAHEDRAL, DAG, SHADOW]),
    ("filter", &[VIEW, OCTAHEDRAL, FILTER]),
    ("query", &[DAG, OWNERS, QUERY]),
];

/// A compute pipeline of one of [`PIPELINES`].
pub(super) fn compute_pipeline(
    context: &Context,
    name: &str,
    entry_point: &str,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    context.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(name),
        layout: None,
        module: &module_of(context, name),
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}

/// The module of one of [`PIPELINES`].
pub(super) fn module_of(context: &Context, name: &str) -> wgpu::ShaderModule {
    let texts = PIPELINES.iter().find(|(label, _)| *label == name).map_or(&[][..], |(_, texts)| texts);
    module(context, name, texts)
}

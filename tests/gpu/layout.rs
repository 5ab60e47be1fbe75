//! Structures of the shaders and of the library lie in memory alike.

use naga::TypeInner;
use voxsight::gpu::dag::DagUniform;
use voxsight::gpu::instance::Instance;
use voxsight::gpu::light::LightUniform;
use voxsight::gpu::shader;
use voxsight::gpu::shadow::{FilterUniform, ShadowUniform};
use voxsight::gpu::view::ViewUniform;

/// Names and offsets of the members of a shader's structure, and its size.
fn members(texts: &[&str], name: &str) -> (Vec<(String, usize)>, usize) {
    let module = naga::front::wgsl::parse_str(&texts.concat()).unwrap();
    let named = |ty: &naga::Type| ty.name.as_deref() == Some(name);
    let (_, ty) = module.types.iter().find(|(_, ty)| named(ty)).unwrap();
    let TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no structure") };
    let list = members.iter().map(|m| (m.name.clone().unwrap(), m.offset as usize)).collect();
    (list, *span as usize)
}

/// The same of one of ours.
macro_rules! ours {
    ($type:ty: $($field:ident)*) => {
        (vec![$((stringify!($field).to_owned(), std::mem::offset_of!($type, $field))),*], size_of::<$type>())
    };
}

#[test]
fn instances_lie_in_memory_as_the_shader_reads_them() {
    let ours = ours!(Instance: column_x base_x column_y base_y column_z base_z fraction vertices_at translation
        indices_at index_log2 drawable colour padding_0);
    assert_eq!(members(&[shader::PAGE], "Instance"), ours);
}

#[test]
fn views_lie_in_memory_as_the_shader_reads_them() {
    let ours = ours!(ViewUniform: clip_x clip_y clip_z clip_w start near start_column far start_row width
        direction height direction_column padding_0 direction_row padding_1 forward padding_2);
    assert_eq!(members(&[shader::VIEW], "View"), ours);
}

#[test]
fn lights_dags_and_shadows_lie_in_memory_as_the_shaders_read_them() {
    let light = ours!(LightUniform: up key sun fill across sky sun_reflected has_shadows
        has_glass padding_0 padding_1 padding_2);
    assert_eq!(members(&[shader::LIGHT], "Light"), light);
    let dag = ours!(DagUniform: root height side leaves_at clear_slots padding_0 padding_1 padding_2);
    assert_eq!(members(&[shader::DAG], "Dag"), dag);
    let shadow = ours!(ShadowUniform: eye_voxel voxels_per_unit eye_fraction first_sample sun sun_cap samples
        has_sun has_sky reach);
    assert_eq!(members(&[shader::VIEW, shader::OCTAHEDRAL, shader::DAG, shader::SHADOW], "Shadow"), shadow);
    let filter = ours!(FilterUniform: samples radius has_sun has_sky);
    assert_eq!(members(&[shader::VIEW, shader::OCTAHEDRAL, shader::FILTER], "Filter"), filter);
}

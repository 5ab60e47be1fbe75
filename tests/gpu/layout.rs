//! Structures of the shaders and of the library lie in memory alike.

use naga::TypeInner;
use voxsight::gpu::dag::DagUniform;
use voxsight::gpu::instance::{ATTRIBUTES, Instance};
use voxsight::gpu::light::LightUniform;
use voxsight::gpu::owners::OwnersUniform;
use voxsight::gpu::query::{ListedRay, QueryUniform};
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

/// The texts of a pipeline.
fn texts_of(name: &str) -> &'static [&'static str] {
    shader::PIPELINES.iter().find(|(label, _)| *label == name).unwrap().1
}

/// The same of one of ours.
macro_rules! ours {
    ($type:ty: $($field:ident)*) => {
        (vec![$((stringify!($field).to_owned(), std::mem::offset_of!($type, $field))),*], size_of::<$type>())
    };
}

#[test]
fn instances_lie_in_memory_as_the_shader_reads_them() {
    let module = naga::front::wgsl::parse_str(shader::PAGE).unwrap();
    let (_, ty) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some("Instance")).unwrap();
    let TypeInner::Struct { members, .. } = &ty.inner else { panic!("Instance is no structure") };
    assert_eq!(members.len(), ATTRIBUTES.len());
    let mut end = 0;
    for (member, attribute) in members.iter().zip(&ATTRIBUTES) {
        let name = member.name.as_deref().unwrap();
        let Some(naga::Binding::Location { location, .. }) = member.binding else {
            panic!("{name} has no place")
        };
        assert_eq!((location, end), (attribute.shader_location, attribute.offset), "{name}");
        let (kind, words) = match module.types[member.ty].inner {
            TypeInner::Vector { size, scalar } => (scalar.kind, size as u64),
            TypeInner::Scalar(scalar) => (scalar.kind, 1),
            ref other => panic!("{name} is {other:?}"),
        };
        let format = format!("{:?}", attribute.format);
        let expected = match kind {
            naga::ScalarKind::Float => "Float32",
            naga::ScalarKind::Sint => "Sint32",
            _ => "Uint32",
        };
        assert!(format.starts_with(expected), "{name}: {format}");
        assert_eq!(attribute.format.size(), 4 * words, "{name}");
        end += attribute.format.size();
    }
    assert_eq!(end, size_of::<Instance>() as u64);
    let at = std::mem::offset_of!(Instance, vertices_at) as u64;
    assert_eq!(at, ATTRIBUTES[6].offset, "words of the page");
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
        has_glass has_caps padding_0 padding_1);
    assert_eq!(members(&[shader::LIGHT], "Light"), light);
    let dag = ours!(DagUniform: root height side leaves_at clear_slots counts_at counts_from padding_0);
    assert_eq!(members(&[shader::DAG], "Dag"), dag);
    let shadow = ours!(ShadowUniform: eye_voxel voxels_per_unit eye_fraction first_sample sun sun_cap samples
        has_sun has_sky reach is_first is_last padding_0 padding_1);
    assert_eq!(members(texts_of("shadow"), "Shadow"), shadow);
    let filter = ours!(FilterUniform: samples radius has_sun has_sky);
    assert_eq!(members(texts_of("filter"), "Filter"), filter);
    let texts = texts_of("query");
    let owners = ours!(OwnersUniform: pages directory_at padding_0 padding_1);
    assert_eq!(members(texts, "Owners"), owners);
    let ray = ours!(ListedRay: base t_end fraction padding_0 direction padding_1);
    assert_eq!(members(texts, "ListedRay"), ray);
    assert_eq!(members(texts, "Query"), ours!(QueryUniform: rays row drawables padding_0));
}

#[test]
fn every_shader_is_valid_without_any_adapter() {
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    for (name, texts) in shader::PIPELINES {
        let module = naga::front::wgsl::parse_str(&texts.concat()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let found = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
        assert!(found.is_ok(), "{name}: {found:?}");
        assert!(!module.entry_points.is_empty(), "{name}");
    }
}

/// The value of a constant of a shader, a number.
fn constant(texts: &[&str], name: &str) -> f64 {
    let module = naga::front::wgsl::parse_str(&texts.concat()).unwrap();
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).unwrap();
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::U32(value)) => value.into(),
        naga::Expression::Literal(naga::Literal::F32(value)) => value.into(),
        ref other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn constants_of_both_sides_are_the_same() {
    use voxsight::gpu::{marks, query, shadow, target, twin};
    for (name, texts) in shader::PIPELINES {
        let all = texts.concat();
        let expected = [
            ("NOBODY", target::NOBODY.into()),
            ("SELECTED", marks::SELECTED.into()),
            ("HIGHLIGHTED", marks::HIGHLIGHTED.into()),
            ("HIDDEN", query::HIDDEN.into()),
            ("TRANSPARENT", query::TRANSPARENT.into()),
            ("MOST_PASSED", twin::MOST_PASSED as f64),
            ("MAX_STACK", twin::MAX_STACK as f64),
            ("PARALLEL", twin::PARALLEL.into()),
            ("NEGLIGIBLE", twin::NEGLIGIBLE.into()),
            ("ENDLESS", query::ENDLESS),
            ("HEIGHT", shadow::HEIGHT),
        ];
        for (constant_name, value) in expected {
            if all.contains(&format!("const {constant_name}:")) {
                assert_eq!(constant(texts, constant_name), value, "{constant_name} of {name}");
            }
        }
        for (entry, side) in [("shadow", shadow::GROUP), ("filter", shadow::GROUP)] {
            if name == entry {
                let module = naga::front::wgsl::parse_str(&all).unwrap();
                assert_eq!(module.entry_points[0].workgroup_size, [side, side, 1], "{name}");
            }
        }
        if name == "query" {
            let module = naga::front::wgsl::parse_str(&all).unwrap();
            assert_eq!(module.entry_points[0].workgroup_size, [query::GROUP, 1, 1]);
        }
    }
    let texts = shader::PIPELINES.iter().flat_map(|(_, texts)| texts.iter()).copied().collect::<String>();
    let names = [
        "NOBODY",
        "SELECTED",
        "HIGHLIGHTED",
        "HIDDEN",
        "TRANSPARENT",
        "MOST_PASSED",
        "MAX_STACK",
        "PARALLEL",
        "NEGLIGIBLE",
        "ENDLESS",
        "HEIGHT",
    ];
    assert!(
        names.iter().all(|name| texts.contains(&format!("const {name}:"))),
        "a constant has another name"
    );
}

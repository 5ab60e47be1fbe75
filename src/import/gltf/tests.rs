//! The reader on small files written here, piece by piece.

use std::path::Path;

use glam::{DAffine3, DVec3};
use serde_json::{Value, json};

use super::*;
use crate::import::ImportOptions;
use crate::model::Colour;
use crate::progress::Silent;

fn read_bytes(folder: &Path, bytes: &[u8]) -> Result<Draft, ImportError> {
    let (options, path) = (ImportOptions::default(), folder.join("pump.glb"));
    read(&Source { name: "pump.glb", path: &path, bytes, depth: 0, options: &options, progress: &Silent })
}

fn read_json(document: &Value, bin: &[u8]) -> Result<Draft, ImportError> {
    read_bytes(Path::new("."), &glb(document, bin))
}

fn error_of(document: &Value, bin: &[u8]) -> String {
    read_json(document, bin).err().map(|e| e.to_string()).unwrap()
}

fn glb(document: &Value, bin: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, content) in [(b"JSON", json.as_slice()), (b"BIN\0", bin)] {
        file.extend((content.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(content);
    }
    file
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

const SQUARE: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.5];

/// A square of four vertices and six 16-bit indices.
fn square() -> (Value, Vec<u8>) {
    let mut bin = floats(&SQUARE);
    bin.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let document = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "square"}],
        "meshes": [{"name": "sheet", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 60}],
    });
    (document, bin)
}

fn positions(draft: &Draft) -> Vec<DVec3> {
    draft.parts[0].part.mesh.positions.clone()
}

fn square_positions() -> Vec<DVec3> {
    SQUARE.chunks(3).map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into())).collect()
}

#[test]
fn a_square_is_read_with_unit_and_axis() {
    let (document, bin) = square();
    let draft = read_json(&document, &bin).unwrap();
    assert_eq!(positions(&draft), square_positions());
    assert_eq!(draft.parts[0].part.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!((draft.up_axis, draft.metres_per_unit), (Some(UpAxis::Y), Some(1.0)));
    assert!(draft.findings.0.is_empty(), "{:?}", draft.findings);
}

#[test]
fn transforms_keep_every_digit_of_the_json() {
    let (mut document, bin) = square();
    let x = 435_440.123456789;
    document["nodes"] = json!([
        {"children": [1, 2], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, 90409.25, 0, 1]},
        {"mesh": 0, "name": " ", "rotation": [0, 0, 0.6, 0.6], "extras": {"number": "A-7"}},
        {"mesh": 0, "translation": [0.000000001, 0, 0], "scale": [-2, 1, 1]},
    ]);
    let draft = read_json(&document, &bin).unwrap();
    let names: Vec<_> = draft.nodes.iter().map(|n| n.name.as_str()).collect();
    assert_eq!(names, ["node 0", "node 1", "node 2"]);
    assert_eq!(draft.nodes[1].extras.as_deref(), Some(r#"{"number":"A-7"}"#));
    let placed = |node: usize| draft.nodes[node].object.as_ref().unwrap().world_from_part;
    assert_eq!(placed(1).translation, DVec3::new(x, 90409.25, 0.0));
    let turned = placed(1).transform_vector3(DVec3::X);
    assert!((turned - DVec3::Y).length() < 1e-12, "the quaternion is made a unit: {turned}");
    assert_eq!(placed(2).translation.x, x + 0.000000001);
    assert!(placed(2).matrix3.determinant() < 0.0, "mirrors stay mirrors");
    assert_eq!(draft.parts.len(), 1);
}

#[test]
fn primitives_of_one_colour_are_one_part_and_several_colours_are_child_nodes() {
    let (mut document, bin) = square();
    let primitive =
        |material: Value| json!({"attributes": {"POSITION": 0}, "indices": 1, "material": material});
    document["materials"] = json!([
        {"name": "steel", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.25]}, "alphaMode": "BLEND"},
        {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.25]}, "alphaMode": "MASK"},
        {"name": "also red", "extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}}},
    ]);
    document["meshes"][0]["primitives"] =
        json!([primitive(json!(1)), primitive(json!(0)), primitive(json!(2)), primitive(json!(1))]);
    document["nodes"][0]["children"] = json!([1]);
    document["nodes"].as_array_mut().unwrap().push(json!({"name": "after"}));
    let draft = read_json(&document, &bin).unwrap();
    let nodes: Vec<_> = draft
        .nodes
        .iter()
        .map(|n| (n.name.as_str(), n.parent, n.object.as_ref().map(|o| o.colour.0)))
        .collect();
    assert_eq!(
        nodes,
        [
            ("square", None, None),
            ("material 1", Some(0), Some([255, 0, 0, 255])),
            ("steel", Some(0), Some([188, 188, 188, 64])),
            ("after", Some(0), None),
        ]
    );
    assert_eq!(draft.parts[0].part.mesh.triangles.len(), 6);
    assert_eq!(draft.parts[0].part.mesh.positions.len(), 4, "a shared vertex buffer stays shared");

    document["meshes"][0]["primitives"] = json!([primitive(Value::Null)]);
    let draft = read_json(&document, &bin).unwrap();
    assert_eq!(draft.nodes[0].object.as_ref().unwrap().colour, Colour::default());
    document["meshes"][0]["primitives"] = json!([primitive(json!(3))]);
    assert!(error_of(&document, &bin).contains("one of 3 materials"));
}

#[test]
fn quantized_positions_are_decoded_normalized_or_not() {
    for (component, normalized, bytes, expected) in [
        (5120, false, vec![0_u8, 0, 0, 127, 0x80, 1, 2, 3, 4], [127.0, -128.0, 1.0]),
        (5120, true, vec![0, 0, 0, 127, 0x80, 0, 2, 3, 4], [1.0, -1.0, 0.0]),
        (5121, true, vec![0, 0, 0, 255, 51, 0, 2, 3, 4], [1.0, 0.2, 0.0]),
        (5123, false, vec![0, 0, 0, 0, 0, 0, 1, 1, 255, 255, 0, 0, 2, 0, 3, 0, 9, 0], [257.0, 65535.0, 0.0]),
        (5122, true, vec![0, 0, 0, 0, 0, 0, 1, 0x80, 0, 0x80, 0, 0, 2, 0, 3, 0, 9, 0], [-1.0, -1.0, 0.0]),
    ] {
        let (mut document, _) = square();
        document["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_materials_unlit"]);
        document["meshes"][0]["primitives"] = json!([{"attributes": {"POSITION": 0}}]);
        document["accessors"][0] = json!({"bufferView": 0, "componentType": component, "count": 3,
            "normalized": normalized, "type": "VEC3"});
        document["bufferViews"][0]["byteLength"] = json!(bytes.len());
        document["buffers"][0]["byteLength"] = json!(bytes.len());
        let draft = read_json(&document, &bytes).unwrap();
        assert_eq!(positions(&draft)[1], DVec3::from_array(expected), "component type {component}");
    }
}

#[test]
fn interleaved_vertices_and_sparse_replacements_are_read() {
    let (mut document, _) = square();
    let mut bin = Vec::new();
    for vertex in SQUARE.chunks(3) {
        bin.extend(floats(vertex));
        bin.extend(floats(&[9.0, 9.0]));
    }
    bin.truncate(72); // The last vertex lacks the rest of its stride.
    bin.extend([0_u8, 1, 2, 0, 2, 3, 3, 1]);
    bin.extend(floats(&[7.0, 7.0, 7.0, 5.0, 5.0, 5.0]));
    document["bufferViews"] = json!([
        {"buffer": 0, "byteLength": 72, "byteStride": 20},
        {"buffer": 0, "byteOffset": 72, "byteLength": 6},
        {"buffer": 0, "byteOffset": 78, "byteLength": 2},
        {"buffer": 0, "byteOffset": 80, "byteLength": 24},
    ]);
    document["buffers"][0]["byteLength"] = json!(104);
    document["accessors"][1]["componentType"] = json!(5121);
    assert_eq!(positions(&read_json(&document, &bin).unwrap()), square_positions());

    document["accessors"][0]["sparse"] =
        json!({"count": 2, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}});
    let mut expected = square_positions();
    expected[3] = DVec3::splat(7.0);
    expected[1] = DVec3::splat(5.0);
    assert_eq!(positions(&read_json(&document, &bin).unwrap()), expected);

    // Without a bufferView the rest is zero; the square keeps one triangle with three places.
    document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(positions(&read_json(&document, &bin).unwrap())[0], DVec3::ZERO);

    document["accessors"][0]["sparse"]["indices"]["componentType"] = json!(5126);
    assert!(error_of(&document, &bin).contains("unsigned whole indices"));
}

#[test]
fn strips_fans_and_lists_without_indices_turn_the_right_way() {
    let (mut document, bin) = square();
    for (mode, triangles) in
        [(4, vec![[0, 1, 2]]), (5, vec![[0, 1, 2], [1, 3, 2]]), (6, vec![[1, 2, 0], [2, 3, 0]])]
    {
        document["meshes"][0]["primitives"] = json!([{"attributes": {"POSITION": 0}, "mode": mode}]);
        let draft = read_json(&document, &bin).unwrap();
        // Vertices are numbered in the order of use; go back to the file's.
        let file_number = |i: u32| {
            let p = draft.parts[0].part.mesh.positions[i as usize];
            square_positions().iter().position(|&q| q == p).unwrap() as u32
        };
        let read: Vec<_> = draft.parts[0].part.mesh.triangles.iter().map(|t| t.map(file_number)).collect();
        assert_eq!(read, triangles, "mode {mode}");
        assert_eq!(draft.findings.0.len(), usize::from(mode == 4), "one vertex is left over");
    }
    document["meshes"][0]["primitives"][0]["mode"] = json!(1);
    let draft = read_json(&document, &bin).unwrap();
    assert_eq!(draft.findings.0["primitives skipped: points or lines"].count, 1);
    assert!(draft.nodes[0].object.is_none());
    document["meshes"][0]["primitives"][0]["mode"] = json!(7);
    assert!(error_of(&document, &bin).contains("mode from 0 to 6"));
}

#[test]
fn gpu_instances_become_child_nodes() {
    let (mut document, mut bin) = square();
    bin.extend(floats(&[10.0, 0.0, 0.0, 20.0, 0.0, 0.0]));
    // Half a turn about z, and none, as normalized bytes.
    bin.extend([0_u8, 0, 127, 0, 0, 0, 0, 127]);
    document["bufferViews"].as_array_mut().unwrap().extend([
        json!({"buffer": 0, "byteOffset": 60, "byteLength": 24}),
        json!({"buffer": 0, "byteOffset": 84, "byteLength": 8}),
    ]);
    document["accessors"].as_array_mut().unwrap().extend([
        json!({"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}),
        json!({"bufferView": 3, "componentType": 5120, "normalized": true, "count": 2, "type": "VEC4"}),
    ]);
    document["buffers"][0]["byteLength"] = json!(92);
    document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    document["nodes"][0]["translation"] = json!([435440.123456, 0, 0]);
    document["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2, "ROTATION": 3, "_ID": 0}}});
    let draft = read_json(&document, &bin).unwrap();
    let names: Vec<_> = draft.nodes.iter().map(|n| (n.name.as_str(), n.parent)).collect();
    assert_eq!(names, [("square", None), ("#0", Some(0)), ("#1", Some(0))]);
    let placed = |node: usize| draft.nodes[node].object.as_ref().unwrap().world_from_part;
    assert_eq!(placed(1).transform_point3(DVec3::X).x, 435440.123456 + 10.0 - 1.0);
    assert_eq!(placed(2), DAffine3::from_translation(DVec3::new(435440.123456 + 20.0, 0.0, 0.0)));

    document["accessors"][3]["count"] = json!(1);
    assert!(error_of(&document, &bin).contains("2 of each attribute"));
    // A thousand nodes that share a long list of nothing.
    document["accessors"][2] = json!({"componentType": 5126, "count": 1000, "type": "VEC3"});
    document["accessors"][3] = json!({"componentType": 5126, "count": 1000, "type": "VEC4"});
    let node = document["nodes"][0].clone();
    document["nodes"] = (0..1000).map(|_| node.clone()).collect();
    document["scenes"][0]["nodes"] = (0..1000).collect();
    assert!(error_of(&document, &bin).contains("instances"));
}

#[test]
fn many_nodes_that_share_a_mesh_of_many_colours_are_refused_before_they_are_made() {
    let (mut document, bin) = square();
    let colour =
        |i: usize| json!({"pbrMetallicRoughness": {"baseColorFactor": [i as f64 / 1000.0, 0, 0, 1]}});
    document["materials"] = (0..100).map(|i| colour(10 * i)).collect();
    let primitive = |i: usize| json!({"attributes": {"POSITION": 0}, "indices": 1, "material": i});
    document["meshes"][0]["primitives"] = (0..100).map(primitive).collect();
    let with_nodes = |count: usize| {
        let mut document = document.clone();
        document["nodes"] = (0..count).map(|_| json!({"mesh": 0})).collect();
        document["scenes"][0]["nodes"] = (0..count).collect();
        document
    };
    let colours = read_json(&with_nodes(1), &bin).unwrap().nodes.len() - 1;
    assert!(colours > 50, "{colours} differ in 8 bits");
    let draft = read_json(&with_nodes(200), &bin).unwrap();
    assert_eq!(draft.nodes.len(), 200 * (1 + colours));
    let error = error_of(&with_nodes(20_000), &bin);
    assert!(error.contains("pieces of meshes; its nodes share data beyond reason"), "{error}");
}

#[test]
fn extensions_that_change_geometry_are_refused_by_name_before_any_buffer_is_loaded() {
    let (mut document, bin) = square();
    document["buffers"][0]["uri"] = json!("gone.bin");
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "X_y"] {
        document["extensionsRequired"] = json!(["KHR_texture_basisu", name]);
        let error = error_of(&document, &bin);
        assert!(error.contains(name) && error.contains("export it again"), "{error}");
    }
    let (mut document, bin) = square();
    document["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression": {}});
    assert!(read_json(&document, &bin).is_ok(), "not required, and the plain data are there");
    document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert!(error_of(&document, &bin).contains("KHR_draco_mesh_compression"));
    let (mut document, bin) = square();
    document["bufferViews"][0] =
        json!({"buffer": 1, "byteLength": 48, "extensions": {"EXT_meshopt_compression": {}}});
    document["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 48}));
    assert!(error_of(&document, &bin).contains("EXT_meshopt_compression"));
}

#[test]
fn buffers_come_from_data_uris_and_files_beside_the_model_only() {
    let (mut document, bin) = square();
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("inner")).unwrap();
    std::fs::write(folder.path().join("outside.bin"), &bin).unwrap();
    let inner = folder.path().join("inner");
    std::fs::write(inner.join("a b.bin"), &bin).unwrap();
    let mut read_with = |uri: &str| {
        document["buffers"][0]["uri"] = json!(uri);
        read_bytes(&inner, document.to_string().as_bytes()).map_err(|e| e.to_string())
    };
    assert_eq!(read_with("./x/../a%20b.bin").unwrap().referred.bytes, 60);
    for uri in
        ["../outside.bin", "%2e%2e/outside.bin", "/etc/hostname", "file:///a", "http://a/b", "C:\\a", ""]
    {
        let error = read_with(uri).err().unwrap();
        assert!(error.contains("refers to"), "{uri}: {error}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path().join("outside.bin"), inner.join("link.bin")).unwrap();
        assert!(read_with("link.bin").err().unwrap().contains("symbolic link"));
    }
    assert!(read_with("gone.bin").err().unwrap().contains("gone.bin"));
    assert!(read_with("%zz").err().unwrap().contains("%XX"));
    assert!(read_with("data:text/plain,hello").err().unwrap().contains("base64"));
    assert!(read_with("data:;base64,AAAA").err().unwrap().contains("60 bytes, found 3"));
    let text: String = bin.iter().flat_map(|&b| [b >> 4, b & 15]).map(|d| char::from(b'A' + d)).collect();
    // Hexadecimal is not base64, but is long enough: it must be read, and its triangles are what they are.
    assert!(read_with(&format!("data:application/octet-stream;base64,{text}")).is_ok());
}

#[test]
fn broken_scenes_are_refused_by_node() {
    let (document, bin) = square();
    for (nodes, what) in [
        (json!([{"children": [0]}]), "node 0"),
        (json!([{"children": [1, 1]}, {}]), "node 1"),
        (json!([{"children": [1, 2]}, {"children": [2]}, {}]), "node 2"),
        (json!([{"children": [7]}]), "node 7"),
        (json!([{"mesh": 5}]), "mesh 5"),
    ] {
        let mut document = document.clone();
        document["nodes"] = nodes;
        let error = error_of(&document, &bin);
        assert!(error.contains(what), "{error}");
    }
    let mut deep = document.clone();
    deep["nodes"] =
        (0..300).map(|i| json!({"children": if i < 299 { vec![i + 1] } else { vec![] }})).collect();
    assert!(error_of(&deep, &bin).contains("256 levels"));
    let mut other = document.clone();
    other["scene"] = json!(3);
    assert!(error_of(&other, &bin).contains("one of 1 scenes"));
    // Without scenes the nodes that are nobody's child are shown.
    let mut none = document.clone();
    none.as_object_mut().unwrap().remove("scene");
    none["scenes"] = json!([]);
    none["nodes"] = json!([{"mesh": 0}, {"children": [0]}, {"children": [2]}]);
    let draft = read_json(&none, &bin).unwrap();
    assert_eq!(draft.nodes.iter().map(|n| n.name.as_str()).collect::<Vec<_>>(), ["node 1", "node 0"]);
    assert_eq!(draft.findings.0["nodes ignored: not in the default scene"].count, 1);
}

#[test]
fn absurd_numbers_are_refused_before_memory_is_taken() {
    let (document, bin) = square();
    let huge = 18_446_744_073_709_551_615_u64;
    for (pointer, value, what) in [
        ("/accessors/0/count", json!(huge), "accessor 0"),
        ("/accessors/1/count", json!(7), "accessor 1"),
        ("/accessors/0/byteOffset", json!(huge), "accessor 0"),
        ("/accessors/0/byteOffset", json!(1), "accessor 0"),
        ("/accessors/0/type", json!("MAT4"), "accessor 0"),
        ("/accessors/0/componentType", json!(5125), "accessor 0"),
        ("/accessors/1/componentType", json!(5126), "accessor 1"),
        ("/accessors/0/bufferView", json!(9), "one of 2 bufferViews"),
        ("/bufferViews/0/byteOffset", json!(huge), "bufferView 0"),
        ("/bufferViews/0/byteLength", json!(61), "bufferView 0"),
        ("/bufferViews/0/buffer", json!(1), "bufferView 0"),
        ("/buffers/0/byteLength", json!(61), "61 bytes, found 60"),
        ("/meshes/0/primitives/0/indices", json!(9), "accessor 9"),
        ("/asset/version", json!("1.0"), "asset.version"),
        ("/nodes/0/translation", json!(["a", 0, 0]), "column"),
    ] {
        let mut document = document.clone();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        document.pointer_mut(parent).unwrap()[key] = value;
        let error = error_of(&document, &bin);
        assert!(error.contains(what), "{pointer}: {error}");
    }
    let mut stride = document.clone();
    stride["bufferViews"][0]["byteStride"] = json!(0);
    assert!(error_of(&stride, &bin).contains("byteStride"));
    let mut zeros = document.clone();
    zeros["accessors"][0] = json!({"componentType": 5126, "count": 4_000_000_000_u64, "type": "VEC3"});
    assert!(error_of(&zeros, &bin).contains("without bufferView"));
    // Many different meshes over one accessor.
    let mut shared = document;
    shared["accessors"][1] =
        json!({"bufferView": 2, "componentType": 5121, "count": 60_000, "type": "SCALAR"});
    let view = json!({"buffer": 0, "byteOffset": 48, "byteLength": 60_000});
    shared["bufferViews"].as_array_mut().unwrap().push(view);
    shared["buffers"][0]["byteLength"] = json!(60_048);
    let primitive = json!({"attributes": {"POSITION": 0}, "indices": 1});
    let mesh = |i: usize| json!({"primitives": vec![primitive.clone(); i + 1]});
    shared["meshes"] = (0..40).map(mesh).collect();
    shared["nodes"] = (0..40).map(|i| json!({"mesh": i})).collect();
    shared["scenes"][0]["nodes"] = (0..40).collect();
    let mut long = bin;
    long.resize(60_048, 0);
    assert!(error_of(&shared, &long).contains("share data beyond reason"));
}

#[test]
fn every_cut_of_a_glb_is_an_error() {
    let (document, bin) = square();
    let file = glb(&document, &bin);
    for length in 0..file.len() {
        assert!(read_bytes(Path::new("."), &file[..length]).is_err(), "cut at {length}");
    }
}

#[test]
fn useless_transforms_drop_the_object_and_keep_the_node() {
    let (mut document, bin) = square();
    document["nodes"] = json!([
        {"mesh": 0},
        {"mesh": 0, "scale": [1, 0, 1]},
        {"mesh": 0, "rotation": [0, 0, 0, 0]},
        {"mesh": 0, "matrix": [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
    ]);
    document["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    let draft = read_json(&document, &bin).unwrap();
    let has_object: Vec<_> = draft.nodes.iter().map(|n| n.object.is_some()).collect();
    assert_eq!(has_object, [true, false, false, true]);
    assert_eq!(draft.findings.0.len(), 3, "{:?}", draft.findings);
}

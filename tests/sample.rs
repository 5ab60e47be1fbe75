//! The sample plant, its copies, and the GLB writer, seen from outside.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DMat4, DVec3, dvec3};
use serde_json::Value;
use voxsight::export::glb::{self, GlbError};
use voxsight::import::{ImportOptions, UpAxis, import};
use voxsight::model::{Colour, Mesh, Model, Node, Object, Part};
use voxsight::progress::{CancelFlag, Silent};
use voxsight::sample::{self, CopiesSettings, PlantSettings, SampleError};

fn settings(objects: u64, triangles: u64, seed: u64) -> PlantSettings {
    PlantSettings { objects, triangles, seed }
}

#[test]
fn the_plant_has_the_size_asked_for_within_ten_percent() {
    for (objects, triangles) in [
        (6, 1_000),
        (12, 1_000),
        (60, 10_000),
        (500, 40_000),
        (1_500, 375_000),
        (2_000, 500_000),
        (6_600, 1_000_000),
        (6_601, 2_000_000),
        (13_000, 4_000_000),
        (20_000, 1_200_000),
        (20_000, 60_000_000),
        (45_000, 12_000_000),
        (45_000, 16_000_000),
    ] {
        for seed in [1, 2] {
            let (got_objects, got_triangles) = sample::plant_size(&settings(objects, triangles, seed));
            let off = |got: u64, wanted: u64| (got as f64 / wanted as f64 - 1.0).abs();
            let what = format!(
                "{objects} objects, {triangles} triangles, seed {seed}: got {got_objects}, {got_triangles}"
            );
            assert!(off(got_objects, objects) < 0.1 && off(got_triangles, triangles) < 0.1, "{what}");
        }
    }
}

#[test]
fn counting_agrees_with_what_is_built() {
    for (objects, triangles, seed) in
        [(12, 1_000, 3), (700, 60_000, 4), (2_000, 500_000, 1), (7_000, 900_000, 5)]
    {
        let settings = settings(objects, triangles, seed);
        let plant = sample::plant(&settings);
        let built = (plant.objects.len() as u64, plant.placed_triangles());
        assert_eq!(sample::plant_size(&settings), built, "{settings:?}");
    }
}

#[test]
fn the_tree_is_in_pre_order_and_everything_is_used_and_named() {
    let plant = sample::plant(&settings(7_000, 700_000, 6));
    let mut path: Vec<u32> = Vec::new();
    for (id, node) in plant.nodes.iter().enumerate() {
        // Pre-order: the parent is on the path from the root to the node before.
        while path.last().copied() != node.parent {
            assert!(path.pop().is_some(), "node {id} {:?} stands outside its parent", node.name);
        }
        path.push(id as u32);
        assert!(!node.name.is_empty(), "node {id}");
        if let Some(extras) = &node.extras {
            assert!(serde_json::from_str::<Value>(extras).is_ok_and(|extras| extras.is_object()), "{extras}");
        }
    }
    let parents: BTreeSet<u32> = plant.nodes.iter().filter_map(|node| node.parent).collect();
    assert!(plant.objects.iter().all(|object| !parents.contains(&object.node)), "objects are leaves");
    assert!(plant.objects.windows(2).all(|pair| pair[0].node < pair[1].node), "objects in node order");
    let used: BTreeSet<u32> = plant.objects.iter().map(|object| object.part).collect();
    assert_eq!(used.len(), plant.parts.len());
    let roots: Vec<&str> =
        plant.nodes.iter().filter(|n| n.parent.is_none()).map(|n| n.name.as_str()).collect();
    assert_eq!(roots, ["AREA-100", "AREA-200"]);

    let paths: Vec<String> = plant.objects.iter().map(|object| plant.path(object.node)).collect();
    for wanted in
        ["/AREA-100/U-110 Pipe rack/", "\"-PL-", " spool 2", "BOLT M20x", "FL-6in-150#-WN-RF", "/P-1", "MCC-"]
    {
        assert!(paths.iter().any(|path| path.contains(wanted)), "no object with {wanted:?} in its path");
    }
    assert!(plant.objects.iter().any(|object| object.colour.0[3] < 255), "something is transparent");
    let bolts = plant.nodes.iter().filter(|node| node.name.starts_with("BOLT M")).count();
    assert!(bolts > 500, "{bolts} bolts");
    assert!(plant.parts.len() * 2 < plant.objects.len(), "most objects are instances");
}

#[test]
fn every_part_consists_of_closed_outward_shells_without_slivers_of_zero_area() {
    for (objects, triangles, seed) in [(3_000, 200_000, 7), (6_600, 1_600_000, 8), (300, 400_000, 9)] {
        for part in &sample::plant(&settings(objects, triangles, seed)).parts {
            check_closed(part, seed);
        }
    }
}

fn check_closed(part: &Part, seed: u64) {
    let (name, mesh) = (&part.name, &part.mesh);
    assert!(!mesh.triangles.is_empty(), "seed {seed}, {name}: no triangle");
    assert!(mesh.positions.iter().all(|position| position.is_finite()), "seed {seed}, {name}: not finite");
    let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
    let mut shell: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(shell: &mut [u32], mut at: u32) -> u32 {
        while shell[at as usize] != at {
            shell[at as usize] = shell[shell[at as usize] as usize];
            at = shell[at as usize];
        }
        at
    }
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((from, to)).or_default() += 1;
            let (from, to) = (root(&mut shell, from), root(&mut shell, to));
            shell[from as usize] = to;
        }
    }
    for (&(from, to), &times) in &edges {
        assert_eq!(times, 1, "seed {seed}, {name}: edge {from}-{to} has {times} triangles on one side");
        assert!(edges.contains_key(&(to, from)), "seed {seed}, {name}: edge {from}-{to} is open");
    }
    let mut volumes: HashMap<u32, f64> = HashMap::new();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        let normal = (b - a).cross(c - a);
        assert!(
            normal.length() > 1e-10,
            "seed {seed}, {name}: area {} of {a} {b} {c}",
            normal.length() / 2.0
        );
        // Relative to a vertex of the mesh, so that little is lost.
        let volume = (a - mesh.positions[0]).dot(normal) / 6.0;
        *volumes.entry(root(&mut shell, triangle[0])).or_default() += volume;
    }
    for volume in volumes.values() {
        assert!(*volume > 1e-8, "seed {seed}, {name}: a shell has volume {volume}");
    }
}

#[test]
fn placements_are_rigid_and_everything_stands_on_the_site() {
    let plant = sample::plant(&settings(6_600, 600_000, 10));
    for object in &plant.objects {
        let matrix = object.world_from_part.matrix3;
        let name = &plant.nodes[object.node as usize].name;
        let off = (matrix * matrix.transpose() - glam::DMat3::IDENTITY).to_cols_array();
        assert!(off.iter().all(|off| off.abs() < 1e-12) && matrix.determinant() > 0.0, "{name}: {matrix}");
        for position in &plant.parts[object.part as usize].mesh.positions {
            let at = object.world_from_part.transform_point3(*position);
            let inside = at.cmpge(dvec3(-3.0, -0.5, -1.0)).all() && at.cmple(dvec3(75.0, 28.0, 45.0)).all();
            assert!(inside, "{name} reaches {at}");
        }
    }
}

#[test]
fn the_cameras_look_at_the_plant() {
    let settings = PlantSettings::default();
    let (low, high) = bounds(&sample::plant(&settings));
    for camera in sample::cameras(&settings) {
        let [eye, target] = [camera.eye, camera.target].map(DVec3::from);
        let is_inside = eye.cmpgt(low).all() && eye.cmplt(high).all();
        assert_eq!(is_inside, camera.name != "overview", "{camera:?}");
        assert!(target.cmpgt(low).all() && target.cmplt(high).all(), "{camera:?}");
    }
}

fn bounds(model: &Model) -> (DVec3, DVec3) {
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for object in &model.objects {
        for position in &model.parts[object.part as usize].mesh.positions {
            let at = object.world_from_part.transform_point3(*position);
            bounds = (bounds.0.min(at), bounds.1.max(at));
        }
    }
    bounds
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_machine_and_another_seed_others() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |name: &str, seed: u64| {
        let path = folder.path().join(name);
        sample::write_plant(&settings(2_000, 200_000, seed), &path, &Silent).unwrap();
        std::fs::read(path).unwrap()
    };
    let first = bytes("a.glb", 1);
    assert_eq!(first, bytes("b.glb", 1));
    assert_ne!(first, bytes("c.glb", 2));
    // Found once; a change of the generator may change it, another machine must not.
    assert_eq!(xxhash_rust::xxh3::xxh3_64(&first), PLANT_HASH, "{:#x}", xxhash_rust::xxh3::xxh3_64(&first));
}

/// XXH3-64 of the GLB of 2,000 objects, 200,000 triangles, seed 1.
const PLANT_HASH: u64 = 0x5f56_1cae_8ff0_f9e7;

#[test]
fn one_file_and_a_folder_hold_the_same_plant() {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(14_000, 1_000_000, 11);
    let (objects, triangles) = sample::plant_size(&settings);
    let whole = sample::write_plant(&settings, &folder.path().join("whole.glb"), &Silent).unwrap();
    let areas = sample::write_plant(&settings, &folder.path().join("areas"), &Silent).unwrap();
    for summary in [&whole, &areas] {
        assert_eq!((summary.objects, summary.triangles), (objects, triangles));
        let on_disk: u64 = summary.files.iter().map(|file| std::fs::metadata(file).unwrap().len()).sum();
        assert_eq!(summary.bytes, on_disk);
    }
    assert_eq!(whole.files.len(), 1);
    assert_eq!(areas.files.len(), 3);
    let placed = |files: &[PathBuf]| {
        let mut names: Vec<String> = Vec::new();
        for file in files {
            let glb = Glb::open(file);
            let nodes = glb.json["nodes"].as_array().unwrap();
            let shown = nodes.iter().filter(|node| node.get("mesh").is_some());
            names.extend(shown.map(|node| node["name"].as_str().unwrap().to_owned()));
        }
        names
    };
    assert_eq!(placed(&whole.files), placed(&areas.files));
}

/// A GLB as a reader of its own would see it: checked while it is read.
struct Glb {
    json: Value,
    bin: Vec<u8>,
}

impl Glb {
    fn open(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let json_end = 20 + word(12);
        assert_eq!((&bytes[16..20], json_end % 4), (&b"JSON"[..], 0));
        let json: Value = serde_json::from_slice(&bytes[20..json_end]).unwrap();
        assert_eq!(
            (word(json_end) + json_end + 8, &bytes[json_end + 4..json_end + 8]),
            (bytes.len(), &b"BIN\0"[..])
        );
        let bin = bytes[json_end + 8..].to_vec();
        assert_eq!(json["buffers"][0]["byteLength"].as_u64(), Some(bin.len() as u64));
        Glb { json, bin }
    }

    fn accessor(&self, id: u64) -> (&Value, &[u8]) {
        let accessor = &self.json["accessors"][id as usize];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let offset = view["byteOffset"].as_u64().unwrap() as usize;
        assert_eq!(offset % 4, 0);
        (accessor, &self.bin[offset..offset + view["byteLength"].as_u64().unwrap() as usize])
    }

    /// Positions and corners of a mesh; checks counts, bounds and that every corner exists.
    fn mesh(&self, id: u64) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let primitive = &self.json["meshes"][id as usize]["primitives"][0];
        let (accessor, bytes) = self.accessor(primitive["attributes"]["POSITION"].as_u64().unwrap());
        assert_eq!(
            (accessor["componentType"].as_u64(), accessor["type"].as_str()),
            (Some(5126), Some("VEC3"))
        );
        let floats: Vec<f32> =
            bytes.chunks(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        let positions: Vec<[f32; 3]> = floats.as_chunks::<3>().0.to_vec();
        assert_eq!(
            (accessor["count"].as_u64(), bytes.len()),
            (Some(positions.len() as u64), positions.len() * 12)
        );
        for axis in 0..3 {
            let along = || positions.iter().map(|position| position[axis]);
            let (low, high) = (along().fold(f32::MAX, f32::min), along().fold(f32::MIN, f32::max));
            assert_eq!(accessor["min"][axis].as_f64(), Some(f64::from(low)));
            assert_eq!(accessor["max"][axis].as_f64(), Some(f64::from(high)));
        }
        let (accessor, bytes) = self.accessor(primitive["indices"].as_u64().unwrap());
        let corners: Vec<u32> = match accessor["componentType"].as_u64() {
            Some(5123) => {
                bytes.chunks(2).map(|two| u32::from(u16::from_le_bytes(two.try_into().unwrap()))).collect()
            }
            Some(5125) => bytes.chunks(4).map(|four| u32::from_le_bytes(four.try_into().unwrap())).collect(),
            other => panic!("component type {other:?}"),
        };
        assert_eq!(accessor["count"].as_u64(), Some(corners.len() as u64));
        assert!(corners.iter().all(|corner| (*corner as usize) < positions.len()));
        (positions, corners.as_chunks::<3>().0.to_vec())
    }

    /// Nodes that show something: name, mesh, placement. Checks that each node has one parent at most.
    fn placed(&self) -> Vec<(String, u64, DMat4)> {
        let nodes = self.json["nodes"].as_array().unwrap();
        let mut parent = vec![None; nodes.len()];
        for (id, node) in nodes.iter().enumerate() {
            for child in node["children"].as_array().into_iter().flatten() {
                let child = child.as_u64().unwrap() as usize;
                assert_eq!(parent[child].replace(id), None, "node {child} has two parents");
            }
        }
        let roots: Vec<u64> =
            (0..nodes.len()).filter(|id| parent[*id].is_none()).map(|id| id as u64).collect();
        assert_eq!(self.json["scenes"][0]["nodes"], serde_json::json!(roots));
        let matrix = |node: &Value| match node.get("matrix") {
            Some(matrix) => DMat4::from_cols_array(&serde_json::from_value(matrix.clone()).unwrap()),
            None => DMat4::IDENTITY,
        };
        let shown =
            nodes.iter().enumerate().filter_map(|(id, node)| Some((id, node, node.get("mesh")?.as_u64()?)));
        shown
            .map(|(id, node, mesh)| {
                let mut at = matrix(node);
                let mut up = parent[id];
                while let Some(id) = up {
                    at = matrix(&nodes[id]) * at;
                    up = parent[id];
                }
                (node["name"].as_str().unwrap().to_owned(), mesh, at)
            })
            .collect()
    }
}

#[test]
fn a_written_model_reads_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.glb");
    let plant = sample::plant(&settings(1_500, 150_000, 12));
    let length = glb::write_model(&path, &plant, &Silent).unwrap();
    assert_eq!(length, std::fs::metadata(&path).unwrap().len());
    let glb = Glb::open(&path);
    let placed = glb.placed();
    assert_eq!(placed.len(), plant.objects.len());
    for (object, (name, mesh, world_from_mesh)) in plant.objects.iter().zip(&placed) {
        assert_eq!(&plant.nodes[object.node as usize].name, name);
        assert_eq!(DMat4::from(object.world_from_part), *world_from_mesh, "{name}: exact through JSON");
        let (positions, triangles) = glb.mesh(*mesh);
        let part = &plant.parts[object.part as usize];
        assert_eq!(triangles, part.mesh.triangles, "{name}");
        let expected: Vec<[f32; 3]> = part.mesh.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        assert_eq!(positions, expected, "{name}");
        let material = &glb.json["meshes"][*mesh as usize]["primitives"][0]["material"];
        let material = &glb.json["materials"][material.as_u64().unwrap() as usize];
        let factor = &material["pbrMetallicRoughness"]["baseColorFactor"];
        let factor: [f64; 4] = serde_json::from_value(factor.clone()).unwrap();
        assert_eq!(Colour::from_linear(factor), object.colour, "{name}");
        assert_eq!(material["alphaMode"] == "BLEND", object.colour.0[3] < 255, "{name}");
    }
    for (node, json) in plant.nodes.iter().zip(glb.json["nodes"].as_array().unwrap()) {
        let extras = node.extras.as_ref().map(|extras| serde_json::from_str::<Value>(extras).unwrap());
        assert_eq!(json.get("extras"), extras.as_ref());
    }
    // Instancing is kept: two accessors a part.
    assert_eq!(glb.json["accessors"].as_array().unwrap().len(), 2 * plant.parts.len());
}

/// A tetrahedron around `centre`.
fn small_part(centre: DVec3) -> Part {
    small_part_of_size(centre, 1.0)
}

fn small_part_of_size(centre: DVec3, size: f64) -> Part {
    let corners = [dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 0.0), dvec3(0.0, 1.0, 0.0), dvec3(0.0, 0.0, 1.0)];
    let positions = corners.iter().map(|corner| *corner * size + centre).collect();
    let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    Part { name: "tetrahedron".into(), mesh: Mesh { positions, triangles } }
}

fn model_of(parts: Vec<Part>, world_from_part: DAffine3) -> Model {
    let node = |(id, part): (usize, &Part)| Node { name: format!("{} {id}", part.name), ..Node::default() };
    let nodes = parts.iter().enumerate().map(node).collect();
    let object = |id: u32| Object { node: id, part: id, world_from_part, colour: Colour::default() };
    Model { nodes, objects: (0..parts.len() as u32).map(object).collect(), parts }
}

#[test]
fn a_part_at_map_coordinates_keeps_its_shape() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("far.glb");
    let far = dvec3(436_090.123, 12.5, -91_454.789);
    let model = model_of(vec![small_part(far)], DAffine3::from_translation(dvec3(0.25, 0.0, 0.0)));
    glb::write_model(&path, &model, &Silent).unwrap();
    let glb = Glb::open(&path);
    let [(_, mesh, world_from_mesh)] = &glb.placed()[..] else { panic!("one object") };
    let (positions, _) = glb.mesh(*mesh);
    for (written, position) in positions.iter().zip(&model.parts[0].mesh.positions) {
        let at = world_from_mesh.transform_point3(glam::Vec3::from(*written).as_dvec3());
        let expected = model.objects[0].world_from_part.transform_point3(*position);
        assert!((at - expected).length() < 1e-6, "{at} instead of {expected}");
    }
}

#[test]
fn indices_are_short_up_to_65535_vertices() {
    let folder = tempfile::tempdir().unwrap();
    for (vertices, kind) in [(65_535_u32, 5123), (65_536, 5125)] {
        let mut part = small_part(DVec3::ZERO);
        part.mesh.positions.resize(vertices as usize, DVec3::ONE);
        part.mesh.triangles.push([0, 1, vertices - 1]);
        let path = folder.path().join(format!("{vertices}.glb"));
        glb::write_model(&path, &model_of(vec![part.clone()], DAffine3::IDENTITY), &Silent).unwrap();
        let glb = Glb::open(&path);
        assert_eq!(glb.json["accessors"][1]["componentType"], kind);
        assert_eq!(glb.mesh(0).1, part.mesh.triangles);
    }
}

#[test]
fn a_part_without_triangles_leaves_its_node_and_no_accessor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.glb");
    let empty = Part { name: "empty".into(), mesh: Mesh::default() };
    let model = model_of(vec![empty.clone(), small_part(DVec3::ZERO)], DAffine3::IDENTITY);
    glb::write_model(&path, &model, &Silent).unwrap();
    let glb = Glb::open(&path);
    assert_eq!(glb.placed().len(), 1);
    assert_eq!(glb.json["nodes"].as_array().unwrap().len(), 2);
    assert_eq!(glb.mesh(0).1.len(), 4);
    let error = glb::write_model(&path, &model_of(vec![empty], DAffine3::IDENTITY), &Silent).unwrap_err();
    assert!(matches!(error, GlbError::Empty { .. }), "{error}");
}

#[test]
fn what_cannot_be_written_is_refused_and_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.glb");
    std::fs::write(&path, "old").unwrap();
    let good = model_of(vec![small_part(DVec3::ZERO)], DAffine3::IDENTITY);
    let refused = |change: &dyn Fn(&mut Model)| {
        let mut model = good.clone();
        change(&mut model);
        glb::write_model(&path, &model, &Silent).unwrap_err()
    };
    let huge = refused(&|model| model.parts[0].mesh.positions[1].x = 1e39);
    assert!(matches!(&huge, GlbError::NotFinite { what, .. } if what.contains("tetrahedron")), "{huge}");
    let lost = refused(&|model| model.objects[0].world_from_part.translation.y = f64::NAN);
    assert!(matches!(&lost, GlbError::NotFinite { what, .. } if what.contains("tetrahedron 0")), "{lost}");
    let broken = refused(&|model| model.nodes[0].extras = Some("{\"dn\": ".into()));
    assert!(matches!(&broken, GlbError::Extras { node, .. } if node == "tetrahedron 0"), "{broken}");
    let stop = AtomicBool::new(true);
    let cancelled = glb::write_model(&path, &good, &CancelFlag(&stop)).unwrap_err();
    assert!(matches!(cancelled, GlbError::Cancelled { .. }), "{cancelled}");
    let nowhere = glb::write_model(&folder.path().join("no/such/folder.glb"), &good, &Silent).unwrap_err();
    assert!(
        matches!(nowhere, GlbError::Io { .. }) && nowhere.to_string().contains("folder.glb"),
        "{nowhere}"
    );

    assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
}

#[test]
fn a_plant_too_large_for_one_file_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.glb");
    let error = sample::write_plant(&settings(400_000, 4_000_000_000, 1), &path, &Silent).unwrap_err();
    assert!(matches!(error, SampleError::Glb(GlbError::TooLarge { .. })), "{error}");
    assert!(error.to_string().contains("folder"), "{error}");
    let error = sample::write_plant(&settings(10, 1_000_000, 1), &path, &Silent).unwrap_err();
    assert!(matches!(error, SampleError::Setting { value: 100_000.0, .. }), "{error}");
    assert!(sample::plant_size(&settings(10, u64::MAX, 1)).1 <= 100_000);
}

#[test]
fn a_folder_that_holds_something_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("other.glb"), "mine").unwrap();
    let error = sample::write_plant(&settings(100, 10_000, 1), folder.path(), &Silent).unwrap_err();
    assert!(matches!(error, SampleError::NotEmpty { .. }), "{error}");
    let model = model_of(vec![small_part(DVec3::ZERO)], DAffine3::IDENTITY);
    let error = sample::write_copies(&model, &CopiesSettings::default(), folder.path(), &Silent).unwrap_err();
    assert!(matches!(error, SampleError::NotEmpty { .. }), "{error}");
}

#[test]
fn copies_are_the_matrix_product_in_f64_and_share_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = sample::plant(&settings(250, 25_000, 13));
    // One mirrored placement: its triangles must be turned back.
    let mirrored = &mut model.objects[40].world_from_part;
    *mirrored *= DAffine3::from_scale(dvec3(1.0, -1.0, 1.0));
    for (name, overlap) in [("apart", None), ("packed", Some(0.8))] {
        let settings = CopiesSettings { copies: 3, overlap, ..CopiesSettings::default() };
        let output = folder.path().join(name);
        let summary = sample::write_copies(&model, &settings, &output, &Silent).unwrap();
        assert_eq!(summary.objects, 3 * model.objects.len() as u64);
        assert_eq!(summary.triangles, 3 * model.placed_triangles());
        let placements = sample::copy_placements(&model, &settings);
        assert_eq!(placements[0], DAffine3::IDENTITY);
        let mut known = BTreeSet::new();
        for (copy, world_from_model) in placements.iter().enumerate() {
            let glb = Glb::open(&output.join(format!("copy{copy}.glb")));
            assert_eq!(glb.json["nodes"][0]["name"], format!("copy{copy}"));
            assert_eq!(glb.json["scenes"][0]["nodes"], serde_json::json!([0]));
            let placed = glb.placed();
            let meshes: BTreeSet<u64> = placed.iter().map(|(_, mesh, _)| *mesh).collect();
            assert_eq!(meshes.len(), model.objects.len());
            let primitives =
                || meshes.iter().map(|mesh| &glb.json["meshes"][*mesh as usize]["primitives"][0]);
            let accessors: BTreeSet<u64> = primitives()
                .flat_map(|p| [p["attributes"]["POSITION"].as_u64().unwrap(), p["indices"].as_u64().unwrap()])
                .collect();
            assert_eq!(accessors.len(), 2 * model.objects.len(), "no accessor is shared");
            for (object, (name, mesh, world_from_mesh)) in model.objects.iter().zip(&placed) {
                // Rotation and scale are baked; the node only moves.
                let origin = world_from_mesh.w_axis.truncate();
                assert_eq!(*world_from_mesh, DMat4::from_translation(origin), "{name}");
                let world_from_part = *world_from_model * object.world_from_part;
                let part = &model.parts[object.part as usize];
                let (positions, triangles) = glb.mesh(*mesh);
                assert_eq!(positions.len(), part.mesh.positions.len());
                for (written, position) in positions.iter().zip(&part.mesh.positions) {
                    let expected = world_from_part.transform_point3(*position) - origin;
                    assert_eq!(*written, expected.as_vec3().to_array(), "{name}");
                }
                let bits: Vec<_> = positions.iter().flatten().map(|c| c.to_bits()).collect();
                assert!(known.insert(bits), "{name} has the vertices of another object");
                let world = |corner: u32| glam::Vec3::from(positions[corner as usize]).as_dvec3();
                let volume = triangles.iter().map(|&[a, b, c]| {
                    (world(a) - world(0)).dot((world(b) - world(a)).cross(world(c) - world(a)))
                });
                assert!(volume.sum::<f64>() > 0.0, "{name} is inside out");
            }
        }
    }
}

#[test]
fn copies_at_map_coordinates_are_as_fine_as_at_the_origin() {
    let map = dvec3(90_409.251, 435_440.123_456, -3.2);
    let tiny = |x: f64| small_part_of_size(map + dvec3(x, 0.0, 0.0), 0.01);
    let mut model = model_of(vec![tiny(0.0), tiny(0.5)], DAffine3::IDENTITY);
    // The second object below the first one: nodes move what is below them.
    let below = model.objects[1].node as usize;
    model.nodes[below].parent = Some(model.objects[0].node);
    let folder = tempfile::tempdir().unwrap();
    let settings = CopiesSettings { copies: 2, up: UpAxis::Z, ..CopiesSettings::default() };
    let output = folder.path().join("copies");
    sample::write_copies(&model, &settings, &output, &Silent).unwrap();
    let imported = import(&[output], &ImportOptions::default(), &Silent).unwrap();
    assert!(imported.findings.0.keys().all(|what| !what.contains("dropped")), "{:?}", imported.findings);
    let copies = &imported.model;
    assert_eq!((copies.parts.len(), copies.objects.len()), (4, 4));
    let placements = sample::copy_placements(&model, &settings);
    let expected = placements.iter().flat_map(|placement| model.objects.iter().map(move |o| (placement, o)));
    for ((placement, original), written) in expected.zip(&copies.objects) {
        let world = |model: &Model, object: &Object, by: &DAffine3| -> BTreeSet<[i64; 3]> {
            let nanometres = |p: &DVec3| {
                let at = by.transform_point3(object.world_from_part.transform_point3(*p));
                ((at - map) * 1e8).round().as_i64vec3().to_array()
            };
            model.parts[object.part as usize].mesh.positions.iter().map(nanometres).collect()
        };
        let (a, b) = (world(&model, original, placement), world(copies, written, &DAffine3::IDENTITY));
        assert_eq!(a.len(), b.len());
        let near = |p: &[i64; 3]| b.iter().any(|q| (0..3).all(|k| (p[k] - q[k]).abs() <= 2));
        assert!(a.iter().all(near), "{a:?} {b:?}");
    }
}

#[test]
fn copies_stand_upright_on_any_axis() {
    // Longest upwards: the pitch is the larger of the other two sizes.
    for (up_axis, up) in [(UpAxis::X, DVec3::X), (UpAxis::Y, DVec3::Y), (UpAxis::Z, DVec3::Z)] {
        let mut part = small_part(dvec3(5.0, 6.0, 7.0));
        part.mesh.positions.iter_mut().for_each(|p| *p += up * 9.0 * p.dot(up));
        let model = model_of(vec![part.clone()], DAffine3::IDENTITY);
        let settings = CopiesSettings { copies: 4, up: up_axis, ..CopiesSettings::default() };
        let placements = sample::copy_placements(&model, &settings);
        let positions = &part.mesh.positions;
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let centre = (low + high) / 2.0;
        for (copy, placement) in placements.iter().enumerate() {
            let tilt_deg = placement.transform_vector3(up).angle_between(up).to_degrees();
            assert!((tilt_deg - [0.0, 3.0][copy % 2]).abs() < 1e-6, "{up_axis:?} copy {copy}: {tilt_deg}");
            let moved = placement.transform_point3(centre) - centre;
            let expected = 1.1 * ((copy % 2) as f64).hypot((copy / 2) as f64);
            assert!(moved.dot(up).abs() < 1e-9 && (moved.length() - expected).abs() < 1e-9, "{moved}");
        }
    }
}

#[test]
fn copies_are_turned_scaled_and_spaced_as_promised() {
    let model = model_of(vec![small_part(dvec3(5.0, 6.0, 7.0))], DAffine3::IDENTITY);
    let settings = CopiesSettings { copies: 7, overlap: Some(0.8), ..CopiesSettings::default() };
    let placements = sample::copy_placements(&model, &settings);
    let centre = dvec3(5.5, 6.5, 7.5);
    for (copy, placement) in placements.iter().enumerate() {
        let cell = dvec3((copy % 3) as f64, 0.0, (copy / 3) as f64) * 0.8;
        assert!((placement.transform_point3(centre) - (centre + cell)).length() < 1e-12, "copy {copy}");
        let scale = 1.0 + 0.01 * copy as f64;
        let determinant = placement.matrix3.determinant();
        assert!((determinant - scale * scale * scale).abs() < 1e-9, "copy {copy}: {determinant}");
        let up = placement.transform_vector3(DVec3::Y).normalize_or_zero();
        let tilt_deg = up.angle_between(DVec3::Y).to_degrees();
        assert!((tilt_deg - if copy % 2 == 1 { 3.0 } else { 0.0 }).abs() < 1e-6, "copy {copy}: {tilt_deg}");
        let along = placement.transform_vector3(DVec3::X);
        let turn_deg = (-along.z).atan2(along.x).to_degrees().rem_euclid(360.0);
        let expected = (60.0 * copy as f64).rem_euclid(360.0);
        assert!((turn_deg - expected).abs() < 1e-6 || copy % 6 == 0, "copy {copy}: {turn_deg}");
    }
    let apart = sample::copy_placements(&model, &CopiesSettings { copies: 2, ..CopiesSettings::default() });
    assert!((apart[1].transform_point3(centre) - centre).distance(dvec3(1.1, 0.0, 0.0)) < 1e-12);
    let folder = tempfile::tempdir().unwrap();
    for overlap in [0.0, -1.0, f64::NAN] {
        let settings = CopiesSettings { copies: 2, overlap: Some(overlap), ..CopiesSettings::default() };
        let error = sample::write_copies(&model, &settings, folder.path(), &Silent).unwrap_err();
        assert!(matches!(error, SampleError::Setting { .. }), "{error}");
    }
}

#[test]
fn a_copy_too_large_for_one_file_is_split_without_loss() {
    let folder = tempfile::tempdir().unwrap();
    let model = sample::plant(&settings(300, 30_000, 14));
    let whole = CopiesSettings { copies: 1, ..CopiesSettings::default() };
    let split = CopiesSettings { max_file_bytes: 200_000, ..whole };
    let whole = sample::write_copies(&model, &whole, &folder.path().join("whole"), &Silent).unwrap();
    let split = sample::write_copies(&model, &split, &folder.path().join("split"), &Silent).unwrap();
    assert_eq!(whole.files.len(), 1);
    assert!(split.files.len() > 2, "{:?}", split.files);
    let content = |files: &[PathBuf]| -> Vec<(String, Vec<[f32; 3]>)> {
        let read = |file: &PathBuf| {
            let glb = Glb::open(file);
            assert_eq!(glb.json["nodes"][0]["name"], "copy0");
            glb.placed().into_iter().map(move |(name, mesh, _)| (name, glb.mesh(mesh).0)).collect::<Vec<_>>()
        };
        files.iter().flat_map(read).collect()
    };
    assert_eq!(content(&whole.files), content(&split.files));
}

#[test]
fn an_object_below_another_objects_node_is_placed_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nested.glb");
    let mut model = sample::plant(&PlantSettings { objects: 3, triangles: 300, seed: 1 });
    let placed = |x: f64| DAffine3::from_translation(DVec3::new(x, 2.0, 3.0)) * DAffine3::from_rotation_y(x);
    let part = model.objects[0].part;
    let names = ["outer", "between", "inner"];
    model.nodes = (0..3u32)
        .map(|i| Node { name: names[i as usize].to_owned(), parent: i.checked_sub(1), extras: None })
        .collect();
    model.objects = [(0, 10.0), (2, 25.0)]
        .map(|(node, x)| Object { node, part, world_from_part: placed(x), colour: Colour::default() })
        .to_vec();
    model.parts.truncate(part as usize + 1);
    glb::write_model(&path, &model, &Silent).unwrap();
    let back = import(&[path], &ImportOptions::default(), &Silent).unwrap().model;
    assert_eq!(back.objects.len(), 2);
    for (object, x) in back.objects.iter().zip([10.0, 25.0]) {
        assert!(object.world_from_part.abs_diff_eq(placed(x), 1e-12), "{:?}", object.world_from_part);
    }
}

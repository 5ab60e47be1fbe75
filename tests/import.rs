//! The importer as users call it: real models, damaged models, folders, hostile files.
//!
//! Real models are in the folder `VOXSIGHT_MODELS` (default: `../shared/models` beside the checkout);
//! without it those tests say that they are skipped.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking, as tests do")]

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use glam::DVec3;
use oorandom::Rand64;
use ply_rs_bw::ply::Property;
use rayon::prelude::*;
use voxsight::import::{Format, ImportError, ImportOptions, Imported, UpAxis, import};
use voxsight::model::{Model, Part};
use voxsight::progress::{CancelFlag, Silent};

/// A file of the model folder, and what must come out of it.
struct Expected {
    file: &'static str,
    /// The README's parts; where a part has several colours, its colours.
    objects: usize,
    /// Triangles with instancing expanded, README.
    placed: u64,
    /// Triangles of all meshes in the file, README.
    in_file: u64,
    /// What is stored: fewer where the file repeats a geometry bit by bit.
    stored: u64,
}

const fn expected(file: &'static str, objects: usize, placed: u64, in_file: u64, stored: u64) -> Expected {
    Expected { file, objects, placed, in_file, stored }
}

const MODELS: [Expected; 25] = [
    expected("assembly/ucs_falcon_10179_hires.glb", 5_183, 14_116_227, 951_535, 814_867),
    expected("assembly/ucs_falcon_10179.glb", 5_183, 5_171_075, 352_923, 304_975),
    expected("assembly/saturn_v_21309.glb", 1_845, 1_010_525, 138_574, 109_175),
    expected("assembly/kings_castle_6080.glb", 850, 466_460, 150_920, 137_124),
    expected("assembly/ferrari_f40_10248.glb", 1_170, 569_849, 171_266, 134_394),
    expected("assembly/huldra_WD1-PSUP.glb", 2_185, 167_612, 167_612, 32_440),
    expected("assembly/kicad_lib_Inductor_THT_Package_QFP.glb", 515, 2_188_717, 2_188_717, 2_142_069),
    expected("assembly/kicad_lib_Capacitor_THT.glb", 905, 1_578_030, 1_578_030, 1_564_102),
    expected("assembly/kicad_video_board.glb", 480, 198_030, 86_664, 86_664),
    expected("assembly/kicad_pic_programmer_board.glb", 121, 182_139, 73_889, 73_889),
    expected("assembly/step_as1_pe_203.glb", 18, 23_424, 23_424, 9_176),
    expected("assembly/step_as1-oc-214.glb", 18, 10_384, 10_384, 4_128),
    expected("assembly/ifc_bimwhale_LargeBuilding.glb", 182, 36_274, 36_274, 21_388),
    expected("assembly/openfoam_motorBike.obj", 67, 331_653, 331_653, 331_653),
    expected("robot/unitree_go1.glb", 39, 684_754, 684_754, 452_827),
    expected("scan/stanford_armadillo.ply", 1, 345_944, 345_944, 345_944),
    expected("scan/stanford_bunny_zipper.ply", 1, 69_451, 69_451, 69_451),
    expected("scene/conference.obj", 41, 331_179, 331_179, 331_179),
    expected("ill/citygml_rotterdam_delfshaven_RD.obj", 853, 37_517, 37_517, 37_517),
    expected("ill/trimesh_chair_model.obj", 4, 12_756, 12_756, 12_756),
    expected("ill/trimesh_capsule.obj", 1, 10_200, 10_200, 10_200),
    expected("ill/trimesh_cycloidal.ply", 1, 43_368, 43_368, 43_368),
    expected("ill/trimesh_bunny.ply", 1, 16_301, 16_301, 16_301),
    expected("ill/trimesh_busted.STL", 1, 3_878, 3_878, 3_878),
    expected("ill/trimesh_soup.stl", 1, 100, 100, 100),
];

fn models() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    let folder = std::env::var_os("VOXSIGHT_MODELS").map_or_else(beside, PathBuf::from);
    if folder.join("README.md").is_file() {
        return Some(folder);
    }
    // Not `println`, of which nothing is seen when the test passes.
    let _ =
        writeln!(std::io::stderr(), "SKIPPED: no real models in {} (set VOXSIGHT_MODELS)", folder.display());
    None
}

fn import_one(path: &Path) -> Result<Imported, ImportError> {
    import(&[path.to_owned()], &ImportOptions::default(), &Silent)
}

/// The promises of `model.rs` and of [`Imported`].
fn assert_promises(imported: &Imported, what: &str) {
    let Model { nodes, parts, objects } = &imported.model;
    let mut open: Vec<u32> = Vec::new();
    for (id, node) in nodes.iter().enumerate() {
        assert!(!node.name.trim().is_empty(), "{what}: node {id} has no name");
        while open.last().copied() != node.parent {
            assert!(open.pop().is_some(), "{what}: node {id} is not in depth-first order");
        }
        open.push(id as u32);
    }
    for part in parts {
        let vertices = part.mesh.positions.len();
        assert!(!part.mesh.triangles.is_empty(), "{what}: empty part {}", part.name);
        assert!(part.mesh.positions.iter().all(|p| p.is_finite()), "{what}: {}", part.name);
        let mut is_used = vec![false; vertices];
        for &[a, b, c] in &part.mesh.triangles {
            assert!(a != b && b != c && c != a, "{what}: repeated corner");
            [a, b, c].into_iter().for_each(|i| is_used[i as usize] = true);
        }
        assert!(is_used.iter().all(|&used| used), "{what}: unused vertex in {}", part.name);
    }
    let mut is_used = vec![false; parts.len()];
    for object in objects {
        is_used[object.part as usize] = true;
        assert!(object.world_from_part.is_finite() && (object.node as usize) < nodes.len(), "{what}");
    }
    assert!(is_used.iter().all(|&used| used), "{what}: unused part");
    assert!(objects.windows(2).all(|pair| pair[0].node < pair[1].node), "{what}: objects out of order");
    assert!(!objects.is_empty(), "{what}: no object");
    for source in &imported.sources {
        assert!(!Path::new(&source.name).is_absolute() && !source.name.contains(".."), "{}", source.name);
    }
}

#[test]
fn real_models_have_the_counts_of_their_readme() {
    let Some(folder) = models() else { return };
    for Expected { file, objects, placed, in_file, stored } in &MODELS {
        let start = Instant::now();
        let imported = import_one(&folder.join(file)).unwrap_or_else(|e| panic!("{e}"));
        println!("{file}: {:?}", start.elapsed());
        assert_promises(&imported, file);
        let model = &imported.model;
        let counts = (model.objects.len(), model.placed_triangles(), model.unique_triangles());
        assert_eq!(counts, (*objects, *placed, *stored), "{file}: {:?}", imported.findings);
        assert!(stored <= in_file);
        let is_gltf = matches!(imported.sources[0].format, Format::Glb);
        assert_eq!(imported.up_axis, is_gltf.then_some(UpAxis::Y));
        assert_eq!(imported.metres_per_unit, is_gltf.then_some(1.0));
        // The only repair that these need: 18 meshes of lines in one STEP conversion.
        let dropped: u64 =
            imported.findings.0.iter().filter(|f| f.0.contains("dropped")).map(|f| f.1.count).sum();
        assert_eq!(dropped, if file.contains("as1_pe") { 18 } else { 0 }, "{file}: {:?}", imported.findings);
    }
}

#[test]
fn a_plant_lies_where_its_readme_says() {
    let Some(folder) = models() else { return };
    let Model { parts, objects, .. } =
        import_one(&folder.join("assembly/huldra_WD1-PSUP.glb")).unwrap().model;
    let points = || {
        objects.iter().flat_map(|o| {
            let positions = &parts[o.part as usize].mesh.positions;
            positions.iter().map(|&p| o.world_from_part.transform_point3(p))
        })
    };
    let low = points().fold(DVec3::INFINITY, DVec3::min);
    let high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
    let (readme_low, readme_high) = (DVec3::new(89.5, 31.6, -312.0), DVec3::new(111.0, 35.5, -289.0));
    assert!((low - readme_low).abs().max_element() < 0.6, "{low}");
    assert!((high - readme_high).abs().max_element() < 0.6, "{high}");
}

#[test]
fn the_same_bits_come_out_for_any_number_of_threads() {
    let Some(folder) = models() else { return };
    for file in ["assembly/kicad_video_board.glb", "ill", "assembly/openfoam_motorBike.obj"] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| import_one(&folder.join(file)).unwrap())
        };
        let one = with(1);
        assert_promises(&one, file);
        assert_eq!(one, with(5), "{file}");
    }
}

/// Corner coordinates of all triangles, in order.
fn soup(model: &Model) -> Vec<[DVec3; 3]> {
    let of_part = |part: &Part| {
        let at = |i: u32| part.mesh.positions[i as usize];
        part.mesh.triangles.iter().map(|t| t.map(at)).collect::<Vec<_>>()
    };
    model.objects.iter().flat_map(|o| of_part(&model.parts[o.part as usize])).collect()
}

#[test]
fn obj_files_are_read_as_tobj_reads_them() {
    let Some(folder) = models() else { return };
    for Expected { file, .. } in MODELS.iter().filter(|m| m.file.ends_with(".obj")) {
        let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
        let (theirs, _) = tobj::load_obj(folder.join(file), &options).unwrap();
        let ours = import_one(&folder.join(file)).unwrap().model;
        let names = |model: &Model| -> Vec<String> {
            model.objects.iter().map(|o| model.nodes[o.node as usize].name.clone()).collect()
        };
        let stem = Path::new(file).file_stem().unwrap().to_str().unwrap();
        let their_names: Vec<_> = theirs.iter().map(|m| m.name.replace("unnamed_object", stem)).collect();
        assert_eq!(names(&ours), their_names, "{file}");
        let at = |m: &tobj::Mesh, i: u32| DVec3::from_slice(&m.positions[3 * i as usize..][..3]);
        let theirs: Vec<[DVec3; 3]> = theirs
            .iter()
            .flat_map(|m| m.mesh.indices.chunks(3).map(|t| [0, 1, 2].map(|k| at(&m.mesh, t[k]))))
            .collect();
        let ours = soup(&ours);
        assert_eq!(ours.len(), theirs.len(), "{file}");
        // tobj fans all polygons; this one has quads, some of them concave.
        let differing = ours.iter().zip(&theirs).filter(|(a, b)| a != b).count();
        let allowed = if file.contains("conference") { 2 * 342 } else { 0 };
        assert!(differing <= allowed, "{file}: {differing} triangles differ");
    }
}

#[test]
fn stl_files_are_read_as_stl_io_reads_them() {
    let Some(folder) = models() else { return };
    for file in ["1002_tray_bottom.STL", "busted.STL", "featuretype.STL", "idler_riser.STL", "soup.stl"] {
        let path = folder.join(format!("ill/trimesh_{file}"));
        let theirs = stl_io::read_stl(&mut fs::File::open(&path).unwrap()).unwrap();
        let ours = import_one(&path).unwrap();
        assert_promises(&ours, file);
        let ours: Vec<_> = soup(&ours.model).iter().map(|t| t.map(|p| p.as_vec3().to_array())).collect();
        let corners = |t: &stl_io::IndexedTriangle| t.vertices.map(|i| theirs.vertices[i].0);
        let is_degenerate = |t: &[[f32; 3]; 3]| t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
        let theirs: Vec<_> = theirs.faces.iter().map(corners).filter(|t| !is_degenerate(t)).collect();
        assert_eq!(ours, theirs, "{file}");
    }
}

#[test]
fn ply_files_are_read_as_ply_rs_reads_them() {
    let Some(folder) = models() else { return };
    for Expected { file, .. } in MODELS.iter().filter(|m| m.file.ends_with(".ply")) {
        let parser = ply_rs_bw::parser::Parser::<ply_rs_bw::ply::DefaultElement>::new();
        let theirs = parser.read_ply(&mut fs::File::open(folder.join(file)).unwrap()).unwrap();
        let point = |i: i32| {
            let vertex = &theirs.payload["vertex"][i as usize];
            ["x", "y", "z"].map(|axis| match vertex[axis] {
                Property::Float(value) => value,
                ref other => panic!("{other:?}"),
            })
        };
        let theirs: Vec<_> = theirs.payload["face"]
            .iter()
            .map(|face| match &face["vertex_indices"] {
                Property::ListInt(corners) => [0, 1, 2].map(|k| point(corners[k])),
                other => panic!("{other:?}"),
            })
            .collect();
        let ours = import_one(&folder.join(file)).unwrap();
        let ours: Vec<_> = soup(&ours.model).iter().map(|t| t.map(|p| p.as_vec3().to_array())).collect();
        assert_eq!(ours, theirs, "{file}");
    }
}

/// Writes damaged copies and imports them: any error is fine, a panic or a long time is not.
fn survives(name: &str, bytes: &[u8], what: &str) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    let start = Instant::now();
    if let Ok(imported) = import_one(&path) {
        assert_promises(&imported, what);
    }
    let elapsed = start.elapsed();
    assert!(elapsed < Duration::from_secs(30), "{what}: {elapsed:?}");
}

/// Bytes that steer the reading: the JSON of a GLB, the header of a PLY or STL, the first lines of an OBJ. Most damage
/// is done there: it goes deepest, and a file that is refused early costs little.
fn steering_bytes(name: &str, bytes: &[u8]) -> usize {
    if name.ends_with(".obj") {
        return bytes.len().min(65_536);
    }
    let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    if bytes.starts_with(b"glTF") { 20 + json } else { 400 }.min(bytes.len())
}

/// A GLB that was cut and says so, to get past the first check.
fn with_honest_length(mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.starts_with(b"glTF") && bytes.len() > 28 {
        let length = bytes.len() as u32;
        let bin = 20 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        bytes[8..12].copy_from_slice(&length.to_le_bytes());
        if bin + 8 <= bytes.len() {
            bytes[bin..bin + 4].copy_from_slice(&(length - bin as u32 - 8).to_le_bytes());
        }
    }
    bytes
}

#[test]
fn damaged_models_neither_panic_nor_hang() {
    const FLIPS: u64 = 200;
    const SEED: u64 = 20_261;
    let Some(folder) = models() else { return };
    let mut files: Vec<PathBuf> = Vec::new();
    for sub in fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir()) {
        files.extend(fs::read_dir(sub).unwrap().map(|e| e.unwrap().path()));
    }
    files.retain(|path| Format::from_extension(path).is_some());
    files.sort();
    assert!(files.len() >= 25);
    for path in &files {
        let start = Instant::now();
        let name = path.file_name().unwrap().to_str().unwrap();
        let bytes = fs::read(path).unwrap();
        let steering = steering_bytes(name, &bytes) as u64;
        (0..50 + FLIPS).into_par_iter().for_each(|run: u64| {
            let mut random = Rand64::new((u128::from(SEED) << 64) + u128::from(run));
            if run < 50 {
                let length = random.rand_range(0..bytes.len() as u64) as usize;
                let cut = bytes[..length].to_vec();
                let cut = if run.is_multiple_of(2) { cut } else { with_honest_length(cut) };
                survives(name, &cut, &format!("{name} cut at {length} (seed {SEED}, run {run})"));
            } else {
                let mut damaged = bytes.clone();
                for _ in 0..1 + random.rand_range(0..6) {
                    let end = if random.rand_range(0..10) > 0 { steering } else { bytes.len() as u64 };
                    let at = random.rand_range(0..end) as usize;
                    damaged[at] = match random.rand_range(0..3) {
                        // A number stays a number, so that the JSON stays JSON and the damage goes deeper.
                        0 | 1 if damaged[at].is_ascii_digit() => b'0' + random.rand_range(0..10) as u8,
                        0 => damaged[at] ^ (1 << random.rand_range(0..8)),
                        1 => b"0123456789-.e,:[]{}\"\n \0\xFF"[random.rand_range(0..24) as usize],
                        _ => random.rand_range(0..256) as u8,
                    };
                }
                survives(name, &damaged, &format!("{name} flipped (seed {SEED}, run {run})"));
            }
        });
        println!("{name}: 50 cuts, {FLIPS} flips, {:?}", start.elapsed());
    }
}

#[test]
fn the_hash_of_a_source_covers_the_files_it_refers_to() {
    let folder =
        folder_of(&[("a.obj", &format!("mtllib a.mtl\n{OBJ}")), ("a.mtl", "newmtl x\n"), ("b.obj", OBJ)]);
    let hash = |name: &str| import_one(&folder.path().join(name)).unwrap().sources[0].xxh3;
    let (before, alone) = (hash("a.obj"), hash("b.obj"));
    assert_eq!(alone, xxhash_rust::xxh3::xxh3_64(OBJ.as_bytes()));
    fs::write(folder.path().join("a.mtl"), "newmtl y\n").unwrap();
    assert_ne!(hash("a.obj"), before);
}

/// A folder that vanishes with the test.
fn folder_of(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    folder
}

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const STL: &str = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
    endloop\nendfacet\nendsolid s\n";

fn gltf(node: &str) -> String {
    // Three vertices, floats: 0 0 0, 1 0 0, 0 1 0.
    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,{node}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],
        "buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#
    )
}

#[test]
fn map_coordinates_keep_a_nanometre_in_every_format() {
    const X: f64 = 435_440.123_456_789;
    let vertices = [(X, 0), (X + 1.0, 0), (X, 1)];
    let obj: String = vertices.iter().map(|(x, y)| format!("v {x} {y} 0\n")).collect();
    let stl: String = vertices.iter().map(|(x, y)| format!("vertex {x} {y} 0\n")).collect();
    let ply: String = vertices.iter().map(|(x, y)| format!("{x} {y} 0\n")).collect();
    let ply_header = |kind| {
        format!(
            "ply\nformat {kind} 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let mut binary = ply_header("binary_big_endian").into_bytes();
    for (x, y) in vertices {
        binary.extend(x.to_be_bytes());
        binary.extend(f64::from(y).to_be_bytes());
        binary.extend([0; 4]);
    }
    binary.extend([3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2]);
    let matrix = format!(r#""matrix":[1,0,0,0,0,1,0,0,0,0,1,0,{X},0,0,1]"#);
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [
        ("a.obj", format!("{obj}f 1 2 3\n").into_bytes()),
        (
            "b.stl",
            format!("solid\nfacet normal 0 0 1\nouter loop\n{stl}endloop\nendfacet\nendsolid\n").into_bytes(),
        ),
        ("c.ply", format!("{}{ply}3 0 1 2\n", ply_header("ascii")).into_bytes()),
        ("d.ply", binary),
        ("e.gltf", gltf(&matrix).into_bytes()),
        ("f.gltf", gltf(&format!(r#""translation":[{X},0,0]"#)).into_bytes()),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let imported = import_one(&path).unwrap_or_else(|e| panic!("{e}"));
        let object = &imported.model.objects[0];
        let part = &imported.model.parts[object.part as usize];
        for (&(x, y), &p) in vertices.iter().zip(&part.mesh.positions) {
            let world = object.world_from_part.transform_point3(p);
            let error = (world - DVec3::new(x, f64::from(y), 0.0)).abs().max_element();
            assert!(error < 1e-9, "{name}: {world} is off by {error}");
        }
    }
}

fn tree(imported: &Imported) -> Vec<String> {
    let model = &imported.model;
    let carries = |id: u32| if model.objects.iter().any(|o| o.node == id) { " *" } else { "" };
    (0..model.nodes.len() as u32).map(|id| model.path(id) + carries(id)).collect()
}

#[test]
fn a_folder_tree_is_the_assembly_tree_and_equal_parts_are_stored_once() {
    let folder = folder_of(&[
        ("plant/b/pump.STL", STL),
        ("plant/b/readme.txt", "hello"),
        ("plant/a.obj", OBJ),
        ("plant/empty/x/notes.pdf", ""),
        ("plant/c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\ng one\nf 1 2 3\ng two\nf 3 2 1\n"),
        ("plant/d.gltf", &gltf(r#""name":"valve""#)),
    ]);
    let plant = folder.path().join("plant");
    let imported = import_one(&plant).unwrap();
    assert_promises(&imported, "plant");
    assert_eq!(
        tree(&imported),
        [
            "/plant",
            "/plant/a.obj *",
            "/plant/b",
            "/plant/b/pump.STL *",
            "/plant/c.obj",
            "/plant/c.obj/one *",
            "/plant/c.obj/two *",
            "/plant/d.gltf",
            "/plant/d.gltf/valve *",
        ]
    );
    assert_eq!(imported.model.parts.len(), 2, "only one triangle turns the other way");
    let sources: Vec<_> = imported.sources.iter().map(|s| (s.name.as_str(), s.format)).collect();
    let expected = [
        ("a.obj", Format::Obj),
        ("b/pump.STL", Format::Stl),
        ("c.obj", Format::Obj),
        ("d.gltf", Format::Gltf),
    ];
    assert_eq!(sources, expected);
    assert_eq!((imported.up_axis, imported.metres_per_unit), (None, None));
    let skipped = &imported.findings.0["files that are no models by their extension: read only where a model refers to them"];
    assert_eq!((skipped.count, skipped.first.as_str()), (2, "b/readme.txt"));
    assert!(imported.findings.0.keys().any(|what| what.contains("disagree")));

    let inputs = [plant.join("d.gltf"), plant.join("b")];
    let imported = import(&inputs, &ImportOptions::default(), &Silent).unwrap();
    assert_eq!(tree(&imported), ["/d.gltf", "/d.gltf/valve *", "/b", "/b/pump.STL *"]);
    assert_eq!(imported.sources[1].name, "b/pump.STL");

    let imported = import_one(&plant.join("d.gltf")).unwrap();
    assert_eq!(tree(&imported), ["/valve *"]);
    assert_eq!((imported.up_axis, imported.metres_per_unit), (Some(UpAxis::Y), Some(1.0)));
}

#[test]
fn inputs_without_a_model_are_errors_that_say_so() {
    let folder = folder_of(&[
        ("none/a.txt", "a"),
        ("none/b/c.bin", ""),
        (
            "cloud.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n",
        ),
        ("flat.gltf", &gltf(r#""scale":[1,0,1]"#)),
        ("far.obj", "v 2e15 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("notes.txt", "hello"),
        ("empty.glb", ""),
    ]);
    for (name, says) in [
        ("none", "no model among its 3 files"),
        ("cloud.ply", "no triangles: point clouds"),
        ("flat.gltf", "singular"),
        ("far.obj", "beyond 1e15"),
        ("notes.txt", "unknown format"),
        ("empty.glb", "is empty"),
        ("gone.glb", "cannot be read"),
    ] {
        let error = import_one(&folder.path().join(name)).unwrap_err().to_string();
        assert!(error.contains(says), "{name}: {error}");
    }
    assert!(matches!(import(&[], &ImportOptions::default(), &Silent), Err(ImportError::NoInput)));
}

#[test]
fn content_decides_over_the_extension_and_that_is_reported() {
    let folder = folder_of(&[("part.obj", STL)]);
    let imported = import_one(&folder.path().join("part.obj")).unwrap();
    assert_eq!(imported.sources[0].format, Format::Stl);
    assert!(imported.findings.0.contains_key("files read by their content, not by their extension"));
}

#[cfg(unix)]
#[test]
fn symbolic_links_do_not_lead_out_of_the_folder_nor_in_circles() {
    use std::os::unix::fs::symlink;
    let folder = folder_of(&[("in/a.obj", OBJ), ("out/b.obj", OBJ)]);
    let inside = folder.path().join("in");
    symlink(folder.path().join("out/b.obj"), inside.join("b.obj")).unwrap();
    symlink(folder.path().join("out"), inside.join("out")).unwrap();
    symlink(&inside, inside.join("circle")).unwrap();
    symlink(inside.join("a.obj"), inside.join("again.obj")).unwrap();
    symlink("nowhere.obj", inside.join("dead.obj")).unwrap();
    let imported = import_one(&inside).unwrap();
    assert_eq!(tree(&imported), ["/in", "/in/a.obj *", "/in/again.obj *"]);
    let count = |what: &str| imported.findings.0.iter().find(|f| f.0.contains(what)).map(|f| f.1.count);
    assert_eq!(count("leave the input folder"), Some(2));
    assert_eq!(count("another folder"), Some(1));
    assert_eq!(count("nowhere"), Some(1));
}

#[test]
fn limits_of_depth_nodes_and_triangles_are_errors() {
    let folder = folder_of(&[("a/b/c/d.obj", OBJ), ("a/e.obj", OBJ)]);
    let with = |options: ImportOptions| import(&[folder.path().join("a")], &options, &Silent);
    let standard = ImportOptions::default;
    assert!(with(standard()).is_ok());
    for (options, says) in [
        (ImportOptions { max_depth: 2, ..standard() }, "more than 2"),
        (ImportOptions { max_nodes: 4, ..standard() }, "more than 4 nodes"),
        (ImportOptions { max_triangles: 1, ..standard() }, "more than 1 triangles;"),
        (ImportOptions { max_placed_triangles: 1, ..standard() }, "more than 1 triangles placed"),
    ] {
        let error = with(options).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn a_cancelled_import_stops() {
    let folder = folder_of(&[("a.obj", OBJ)]);
    let stop = AtomicBool::new(true);
    let outcome = import(&[folder.path().join("a.obj")], &ImportOptions::default(), &CancelFlag(&stop));
    assert!(matches!(outcome, Err(ImportError::Cancelled)));
}

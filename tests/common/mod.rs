//! What several test files share: models, scenes, cameras, and a ray caster that shares nothing with the library's.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests; each uses its own part"
)]

pub mod brute_force;
pub mod cameras;
mod random;

#[allow(unused_imports, reason = "not by all")]
pub use random::Random;

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use voxsight::import::{ImportOptions, import};
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Mesh, Model, Node, Object, Part};
use voxsight::prepare::{BuildSettings, Resolution, build};
use voxsight::progress::Silent;
use voxsight::report::Findings;
use voxsight::scene::Scene;

/// The folder of real models; says so when there is none.
pub fn models_folder() -> Option<PathBuf> {
    let folder = std::env::var_os("VOXSIGHT_MODELS")
        .map(PathBuf::from)
        .unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models"));
    if folder.is_dir() {
        return Some(folder);
    }
    // Not `eprintln`, of which nothing is seen when the test passes.
    let _ =
        writeln!(std::io::stderr(), "SKIPPED: no real models in {} (set VOXSIGHT_MODELS)", folder.display());
    None
}

/// All model files below the folder, sorted.
pub fn model_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            if path.is_dir() {
                open.push(path);
            } else if ["glb", "gltf", "obj", "ply", "stl"].contains(&extension.as_str()) {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// Imports a file and builds it into `output`.
pub fn build_file(file: &Path, log2: u32, output: &Path) {
    let imported = import(&[file.to_owned()], &ImportOptions::default(), &Silent).unwrap();
    build_model(imported.model, log2, output);
}

/// Builds a model into `output`.
pub fn build_model(model: Model, log2: u32, output: &Path) {
    let settings = BuildSettings { resolution: Resolution::Log2(log2), ..BuildSettings::default() };
    build(model, Vec::new(), Findings::default(), &settings, output, &Silent).unwrap();
}

/// Opens a built scene for queries.
pub fn load(path: &Path) -> LoadedScene {
    LoadedScene::new(Scene::open(path).unwrap(), &Silent).unwrap()
}

/// A model of `count` objects: boxes, tetrahedra and sheets, placed, turned, stretched, some mirrored, some
/// transparent, around a far-off centre.
pub fn random_model(seed: u64, count: u32, centre: DVec3) -> Model {
    let mut random = oorandom::Rand64::new(seed.into());
    let mut unit = || DVec3::new(random.rand_float(), random.rand_float(), random.rand_float());
    let shapes = [cuboid(), tetrahedron(), sheet(12)];
    let mut model = Model::default();
    for (i, mesh) in shapes.into_iter().enumerate() {
        model.parts.push(Part { name: format!("shape {i}"), mesh });
    }
    for i in 0..count {
        let (at, angles, scale) = (unit() * 20.0, unit() * 6.3, unit() * 2.5 + DVec3::splat(0.05));
        let mirror = if i % 5 == 0 { DVec3::new(-1.0, 1.0, 1.0) } else { DVec3::ONE };
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, angles.x, angles.y, angles.z);
        model.nodes.push(Node { name: format!("object {i}"), ..Node::default() });
        model.objects.push(Object {
            node: i,
            part: i % 3,
            world_from_part: DAffine3::from_scale_rotation_translation(scale * mirror, turn, centre + at),
            colour: Colour([(i * 37) as u8, (i * 91) as u8, 128, if i % 7 == 3 { 90 } else { 255 }]),
        });
    }
    model
}

/// A mesh of these corners.
pub fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Mesh {
    Mesh { positions: positions.iter().map(|&p| p.into()).collect(), triangles: triangles.to_vec() }
}

/// The box from -1 to 1.
pub fn cuboid() -> Mesh {
    let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 1 { 1.0 } else { -1.0 });
    let corners: Vec<[f64; 3]> = (0..8).map(corner).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> =
        faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).collect();
    mesh(&corners, &triangles)
}

fn tetrahedron() -> Mesh {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 1.3, 0.1], [0.3, 0.3, 0.9]];
    mesh(&corners, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
}

/// A wavy sheet of n x n cells.
pub fn sheet(n: u32) -> Mesh {
    let at = |i: u32, j: u32| {
        let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
        [x, y, 0.1 * (7.0 * x).sin() * (5.0 * y).cos()]
    };
    let positions: Vec<[f64; 3]> = (0..=n).flat_map(|j| (0..=n).map(move |i| at(i, j))).collect();
    let id = |i: u32, j: u32| j * (n + 1) + i;
    let cell = |i: u32, j: u32| {
        [[id(i, j), id(i + 1, j), id(i + 1, j + 1)], [id(i, j), id(i + 1, j + 1), id(i, j + 1)]]
    };
    let triangles: Vec<[u32; 3]> = (0..n).flat_map(|j| (0..n).flat_map(move |i| cell(i, j))).collect();
    mesh(&positions, &triangles)
}

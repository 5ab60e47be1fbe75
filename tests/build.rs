//! The whole preparation: same bytes always, the promises of the levels, and what a killed build leaves.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use common::{build_model, model_files, models_folder, random_model};
use glam::DVec3;
use voxsight::container::{Container, verify};
use voxsight::import::{ImportOptions, import};
use voxsight::prepare::build::BuildError;
use voxsight::prepare::part::TRIANGLES_DROPPED;
use voxsight::prepare::{BuildSettings, Resolution, build};
use voxsight::progress::Silent;
use voxsight::report::Findings;
use voxsight::sample::{PlantSettings, plant};
use voxsight::scene::Scene;

fn bytes_with_threads(threads: usize, model: &voxsight::model::Model, path: &Path) -> Vec<u8> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| build_model(model.clone(), 10, path));
    std::fs::read(path).unwrap()
}

#[test]
fn one_two_and_seven_threads_write_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let settings = PlantSettings { objects: 300, triangles: 60_000, seed: 4 };
    for model in [random_model(3, 50, DVec3::splat(1e6)), plant(&settings)] {
        let one = bytes_with_threads(1, &model, &path);
        assert_eq!(one, bytes_with_threads(2, &model, &path));
        assert_eq!(one, bytes_with_threads(7, &model, &path));
    }
}

#[test]
fn every_real_model_keeps_the_promises_of_quantization_and_levels() {
    let Some(models) = models_folder() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let mut vertices_checked = 0u64;
    for file in model_files(&models) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let imported = import(&[file], &ImportOptions::default(), &Silent).unwrap();
        let model = imported.model.clone();
        build_model(imported.model, 7, &path);
        verify(&path, &Silent).unwrap();
        let scene = Scene::open(&path).unwrap();
        vertices_checked += check_positions(&name, &model, &scene);
        check_levels(&name, &scene);
    }
    println!("{vertices_checked} vertices checked");
    assert!(vertices_checked > 1_000_000);
}

/// Every input vertex of every object has a decoded vertex within half a step along each axis of its part.
fn check_positions(name: &str, model: &voxsight::model::Model, scene: &Scene) -> u64 {
    let mut checked_parts = vec![false; model.parts.len()];
    let (mut checked, mut missing) = (0, 0);
    for (id, object) in model.objects.iter().enumerate() {
        if std::mem::replace(&mut checked_parts[object.part as usize], true) {
            continue;
        }
        let record = &scene.objects()[id];
        let part = &scene.parts()[record.part as usize];
        // Imported part space to stored part space: placements differ by a translation.
        let shift = scene.world_from_part(id as u32).inverse() * object.world_from_part;
        let step = DVec3::from(part.step.map(f64::from));
        let cell = |p: DVec3| [0, 1, 2].map(|k| (p[k] / step[k]).round() as i64);
        let mut stored = std::collections::HashMap::<[i64; 3], ()>::new();
        for chunk in &scene.chunks()[part.first_chunk as usize..][..part.chunk_count as usize] {
            let mesh = scene.level_mesh(chunk.first_level).unwrap();
            for position in scene.level_positions(chunk.first_level, &mesh) {
                stored.insert(cell(position.as_dvec3()), ());
            }
        }
        let mesh = &model.parts[object.part as usize].mesh;
        let mut used: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        // Composing placements rounds by about 2^-50 of the coordinates; the strict promise is tested on the part alone.
        let slack = |p: DVec3| 1e-9 * step + 1e-12 * p.abs().max(object.world_from_part.translation.abs());
        for vertex in used {
            let p = shift.transform_point3(mesh.positions[vertex as usize]);
            let near = |k: usize| {
                let (low, high) = (
                    (p[k] - 0.5 * step[k] - slack(p)[k]) / step[k],
                    (p[k] + 0.5 * step[k] + slack(p)[k]) / step[k],
                );
                low.ceil() as i64..=high.floor() as i64
            };
            let found = near(0).any(|x| near(1).any(|y| near(2).any(|z| stored.contains_key(&[x, y, z]))));
            missing += u64::from(!found);
            checked += 1;
        }
    }
    // The corners of triangles that were dropped as thinner than a step may be gone, nothing else.
    let dropped = scene.report().findings.0.get(TRIANGLES_DROPPED).map_or(0, |finding| finding.count);
    assert!(
        missing <= 3 * dropped,
        "{name}: {missing} vertices are not stored, {dropped} triangles were dropped"
    );
    checked
}

fn check_levels(name: &str, scene: &Scene) {
    for chunk in scene.chunks() {
        let levels = &scene.levels()[chunk.first_level as usize..][..chunk.level_count as usize];
        assert_eq!(levels[0].error, 0.0, "{name}");
        for pair in levels.windows(2) {
            assert!(pair[1].error >= pair[0].error, "{name}: errors shrink");
            let ratio = f64::from(pair[1].triangle_count) / f64::from(pair[0].triangle_count);
            assert!(ratio < 0.9, "{name}: a level saves too little: {ratio}");
        }
    }
}

#[test]
fn a_build_over_its_memory_limit_stops_and_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    std::fs::write(&path, b"old").unwrap();
    let settings =
        BuildSettings { resolution: Resolution::Log2(9), memory: Some(1 << 20), ..BuildSettings::default() };
    let model = random_model(1, 20, DVec3::ZERO);
    let error = build(model, Vec::new(), Findings::default(), &settings, &path, &Silent).unwrap_err();
    assert!(matches!(error, BuildError::Memory { .. }), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_build_killed_at_any_moment_leaves_the_old_file_and_the_next_one_works() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("plant.glb");
    let scene = folder.path().join("plant.vxs");
    let settings = PlantSettings { objects: 300, triangles: 80_000, seed: 2 };
    voxsight::sample::write_plant(&settings, &model, &Silent).unwrap();
    let start = || {
        Command::new(env!("CARGO_BIN_EXE_voxsight"))
            .args(["build", "--quiet", "--resolution", "2048", "-o"])
            .args([&scene, &model])
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    };
    std::fs::write(&scene, b"old").unwrap();
    let mut killed = 0;
    for milliseconds in [1, 5, 10, 20, 40, 70, 100, 150, 220, 300, 400, 550, 700, 900, 1200] {
        let mut child = start();
        std::thread::sleep(Duration::from_millis(milliseconds));
        child.kill().unwrap();
        if child.wait().unwrap().success() {
            break;
        }
        killed += 1;
        let now = std::fs::read(&scene).unwrap();
        assert!(now == b"old" || Container::open(&scene).is_ok(), "half a file after {milliseconds} ms");
    }
    assert!(killed >= 4, "only {killed} builds were killed before they ended");
    assert!(start().wait().unwrap().success());
    verify(&scene, &Silent).unwrap();
    let mut left: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["plant.glb", "plant.vxs"], "the killed builds' temporary files are gone");
}

#[test]
fn the_position_error_counts_in_the_models_units_whatever_the_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    for scale in [1e-3, 1.0, 1000.0] {
        let mut model = random_model(8, 3, DVec3::ZERO);
        for object in &mut model.objects {
            object.world_from_part = glam::DAffine3::from_scale(DVec3::splat(scale));
            // The sheet, of small triangles: a triangle cannot be split.
            object.part = 0;
        }
        model.parts.drain(..2);
        let wanted = 3e-6 * scale;
        let settings = BuildSettings {
            resolution: Resolution::Log2(7),
            max_position_error: Some(wanted),
            ..BuildSettings::default()
        };
        let outcome = build(model, Vec::new(), Findings::default(), &settings, &path, &Silent).unwrap();
        let error = outcome.report.statistics["largest_position_error"].as_f64().unwrap();
        assert!(error <= wanted && error > wanted / 4.0, "scale {scale}: {error} for {wanted}");
    }
}

#[test]
fn an_object_that_is_only_a_point_is_built_and_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let mut model = random_model(8, 1, DVec3::new(70.0, 3.0, 4e5));
    model.parts.truncate(1);
    model.parts[0].mesh.positions.iter_mut().for_each(|p| *p = DVec3::ONE);
    build_model(model, 7, &path);
    verify(&path, &Silent).unwrap();
    let scene = Scene::open(&path).unwrap();
    assert!(scene.meta().dag.voxel_count >= 1);
    assert_eq!(scene.find("object 0").count(), 1);
}

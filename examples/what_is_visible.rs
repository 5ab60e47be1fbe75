//! The library way from a model file to what a camera sees: import, build, open, query.
//!
//! `cargo run --release --example what_is_visible -- MODEL.glb`

use std::error::Error;
use std::path::PathBuf;

use glam::DVec3;
use voxsight::camera::Camera;
use voxsight::import::{ImportOptions, import};
use voxsight::loaded::LoadedScene;
use voxsight::prepare::{BuildSettings, build};
use voxsight::progress::Silent;
use voxsight::scene::Scene;
use voxsight::visibility::{Method, QuerySettings, query};

fn main() -> Result<(), Box<dyn Error>> {
    let model = std::env::args_os().nth(1).map(PathBuf::from).ok_or("usage: what_is_visible MODEL")?;
    let scene_file = std::env::temp_dir().join("what_is_visible.vxs");

    let imported = import(&[model], &ImportOptions::default(), &Silent)?;
    build(imported.model, Vec::new(), imported.findings, &BuildSettings::default(), &scene_file, &Silent)?;

    let loaded = LoadedScene::new(Scene::open(&scene_file)?, &Silent)?;
    let scene = loaded.scene();
    let bounds = scene.meta().bounds;
    let from = DVec3::new(0.8, 0.6, 0.7);
    let camera = Camera::around(bounds.min.into(), bounds.max.into(), from, DVec3::Y, 1024, 1024);

    let answer = query(&loaded.query(), &camera.rays()?, Method::Hybrid, &QuerySettings::default());
    let mut objects: Vec<(u32, u64)> = answer.by_object(|d| scene.drawable_object(d)).into_iter().collect();
    objects.sort_by_key(|&(_, samples)| std::cmp::Reverse(samples));
    println!("{} of {} objects are visible; the largest:", objects.len(), scene.objects().len());
    for (object, samples) in objects.into_iter().take(10) {
        println!("{samples:>9} px  {}", scene.node_path(scene.objects()[object as usize].node));
    }
    Ok(())
}

//! What is picked in drawn frames is what rays through all triangles meet.

use std::sync::Arc;

use glam::DVec2;
use voxsight::camera::Camera;
use voxsight::gpu::Context;
use voxsight::gpu::marks::Marks;
use voxsight::loaded::LoadedScene;
use voxsight::render::Lighting;
use voxsight::shown::Shown;
use voxsight::viewer::pick::PickImage;
use voxsight::viewer::viewport::found;
use voxsight::walkthrough::{Latency, Look, WalkSettings, Walkthrough};

use super::common::{Random, build_file, load, models_folder};
use super::context;
use super::walks::settle;

const SIZE: (u32, u32) = (512, 512);
const CLICKS: u32 = 10_000;

/// The viewer's own levels of detail, waited for.
fn as_viewed() -> WalkSettings {
    WalkSettings { latency: Latency::None, ahead: 0.0, wait: true, ..WalkSettings::default() }
}

/// Clicks at random pixels of frames from some directions. How many were made on something, and how many picked another object than
/// the ray there meets.
fn clicks(context: &Context, scene: &Arc<LoadedScene>, seed: u64) -> (u32, u32) {
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (bounds.min.into(), bounds.max.into());
    let up = scene.scene().meta().settings.up.unit();
    let lighting = Lighting::headlight();
    let marks = Marks::default();
    let look = Look { lighting: &lighting, up, marks: &marks, shadows: None, caps: false };
    let mut walk = Walkthrough::new(Arc::clone(scene), context, as_viewed()).unwrap();
    let shown = Shown::all(Arc::clone(scene));
    let mut random = Random::new(seed);
    let (mut hits, mut wrong) = (0, 0);
    for _ in 0..4 {
        let mut camera = Camera::around(min, max, random.vector(), up, SIZE.0, SIZE.1);
        // Half of them so near that much of the scene is beside the picture.
        let near = if random.below(2) == 0 { 0.8 } else { 0.4 };
        camera.eye = glam::DVec3::from(camera.eye).lerp(camera.target.into(), near).into();
        settle(&mut walk, &camera, &look);
        let rays = camera.rays().unwrap();
        let drawables: Vec<u32> = walk.renderer().targets().drawable.read(context).unwrap();
        let reversed: Vec<f32> = walk.renderer().targets().depth.read(context).unwrap();
        let depths: Vec<f32> = reversed.iter().map(|reversed| -reversed).collect();
        let image = PickImage::new(&drawables, &depths, SIZE).unwrap();
        let object = |drawable: u32| scene.scene().drawable_object(drawable);
        for _ in 0..CLICKS / 4 {
            let cursor = DVec2::new(f64::from(random.below(SIZE.0)), f64::from(random.below(SIZE.1))) + 0.5;
            let picked = found(&shown, &image, &rays, cursor, 0).map(|picked| object(picked.drawable));
            let expected = shown.closest(&rays.ray(cursor.x, cursor.y));
            let expected = expected.map(|hit| (object(hit.drawable), hit.t));
            hits += u32::from(expected.is_some());
            let is_same = picked == expected.map(|(object, _)| object);
            let is_tie = || picked.is_some_and(|picked| is_tie(&shown, &rays, cursor, picked, expected));
            wrong += u32::from(!is_same && !is_tie());
        }
    }
    (hits, wrong)
}

/// Does the ray meet this object as near as what it meets first?
fn is_tie(
    shown: &Shown,
    rays: &voxsight::camera::CameraRays,
    at: DVec2,
    object: u32,
    first: Option<(u32, f64)>,
) -> bool {
    let ray = rays.ray(at.x, at.y);
    let scene = shown.scene();
    let own = scene.scene().object_drawables(object);
    let nearest = own.filter_map(|drawable| scene.query().exact.closest_of(drawable, &ray)).map(|hit| hit.t);
    let nearest = nearest.reduce(f64::min);
    nearest.zip(first).is_some_and(|(own, (_, first))| (own - first).abs() <= 1e-9 * first.abs().max(1.0))
}

#[test]
fn ten_thousand_clicks_pick_what_exact_sees() {
    let (Some(context), Some(models)) = (context(), models_folder()) else { return };
    let folder = tempfile::tempdir().unwrap();
    for (seed, name) in
        ["huldra_WD1-PSUP.glb", "kings_castle_6080.glb", "kicad_video_board.glb"].iter().enumerate()
    {
        let path = folder.path().join("scene.vxs");
        build_file(&models.join("assembly").join(name), 9, &path);
        let scene = Arc::new(load(&path));
        let (hits, wrong) = clicks(context, &scene, seed as u64);
        println!("{name}: {CLICKS} clicks, {hits} on something, {wrong} picked something else");
        assert!(hits > CLICKS / 20 && wrong == 0, "{name}: {wrong} of {hits}");
    }
}

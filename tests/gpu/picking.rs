//! What is picked in drawn frames is what rays through all triangles meet.

use std::sync::Arc;

use glam::{DAffine3, DVec2, DVec3};
use voxsight::camera::{Camera, Plane};
use voxsight::filter::Filter;
use voxsight::gpu::Context;
use voxsight::gpu::marks::Marks;
use voxsight::loaded::LoadedScene;
use voxsight::moved::Motions;
use voxsight::render::Lighting;
use voxsight::sample::{PlantSettings, plant};
use voxsight::shown::Shown;
use voxsight::viewer::pick::PickImage;
use voxsight::viewer::viewport::found;
use voxsight::walkthrough::{Latency, Look, WalkSettings, Walkthrough};

use super::common::{Random, build_file, build_model, load, models_folder};
use super::context;
use super::walks::settle;

const SIZE: (u32, u32) = (512, 512);
const CLICKS: u32 = 10_000;

/// The viewer's own levels of detail, waited for.
fn as_viewed() -> WalkSettings {
    WalkSettings { latency: Latency::None, ahead: 0.0, wait: true, ..WalkSettings::default() }
}

/// What a frame shows, to be picked from.
struct Picture {
    drawables: Vec<u32>,
    /// Only their order counts.
    depths: Vec<f32>,
}

impl Picture {
    fn of(walk: &Walkthrough, context: &Context) -> Self {
        let targets = walk.renderer().targets();
        let reversed: Vec<f32> = targets.depth.read(context).unwrap();
        let depths = reversed.iter().map(|reversed| -reversed).collect();
        Picture { drawables: targets.drawable.read(context).unwrap(), depths }
    }

    fn image(&self) -> PickImage<'_> {
        PickImage::new(&self.drawables, &self.depths, SIZE).unwrap()
    }
}

/// Clicks at random pixels of frames from some directions. How many were made on something, and how many picked another object than
/// the ray there meets; how many picked something that is shown where the ray just misses it.
fn clicks(context: &Context, scene: &Arc<LoadedScene>, seed: u64) -> (u32, u32, u32) {
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (bounds.min.into(), bounds.max.into());
    let up = scene.scene().meta().settings.up.unit();
    let lighting = Lighting::headlight();
    let marks = Marks::default();
    let look = Look { lighting: &lighting, up, marks: &marks, shadows: None, caps: false };
    let mut walk = Walkthrough::new(Arc::clone(scene), context, as_viewed()).unwrap();
    let shown = Shown::all(Arc::clone(scene));
    let mut random = Random::new(seed);
    let (mut hits, mut wrong, mut borders) = (0, 0, 0);
    for _ in 0..4 {
        let mut camera = Camera::around(min, max, random.vector(), up, SIZE.0, SIZE.1);
        // Half of them so near that much of the scene is beside the picture.
        let near = if random.below(2) == 0 { 0.8 } else { 0.4 };
        camera.eye = DVec3::from(camera.eye).lerp(camera.target.into(), near).into();
        settle(&mut walk, &camera, &look);
        let rays = camera.rays().unwrap();
        let picture = Picture::of(&walk, context);
        let image = picture.image();
        let object = |drawable: u32| scene.scene().drawable_object(drawable);
        for _ in 0..CLICKS / 4 {
            let cursor = DVec2::new(f64::from(random.below(SIZE.0)), f64::from(random.below(SIZE.1))) + 0.5;
            let picked = found(&shown, &image, &rays, cursor, 0).map(|picked| object(picked.drawable));
            let expected = shown.closest(&rays.ray(cursor.x, cursor.y));
            let expected = expected.map(|hit| (object(hit.drawable), hit.t));
            hits += u32::from(expected.is_some());
            let is_same = picked == expected.map(|(object, _)| object);
            let is_tie = || picked.is_some_and(|picked| is_tie(&shown, &rays, cursor, picked, expected));
            // The ray meets nothing, and a pixel on the border of something shows it.
            let is_border = || {
                let around = (0..9).map(|i| DVec2::new(f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0));
                let near = |offset: DVec2| {
                    let at = cursor + offset;
                    shown.closest(&rays.ray(at.x, at.y)).map(|hit| object(hit.drawable))
                };
                expected.is_none() && around.map(near).any(|near| near == picked)
            };
            borders += u32::from(!is_same && is_border());
            if !is_same && !is_tie() && !is_border() {
                println!("seed {seed}, {cursor}: {picked:?} instead of {expected:?}");
                wrong += 1;
            }
        }
    }
    (hits, wrong, borders)
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
        let (hits, wrong, borders) = clicks(context, &scene, seed as u64);
        println!(
            "{name}: {CLICKS} clicks, {hits} on something, {wrong} picked something else, {borders} a border"
        );
        assert!(hits > CLICKS / 20 && wrong == 0 && borders < 5, "{name}: {wrong} of {hits}");
    }
}

#[test]
fn clicks_beside_and_on_what_was_changed_pick_what_is_near_and_shown() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(plant(&PlantSettings { objects: 400, triangles: 40_000, seed: 3 }), 9, &path);
    let scene = Arc::new(load(&path));
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let mut filter = Filter::default();
    filter.clip_by(Plane { normal: DVec3::new(-1.0, 0.0, 0.2), point: 0.5 * (min + max) });
    let hide = |object: u32, filter: &mut Filter| {
        scene.scene().object_drawables(object).for_each(|drawable| filter.set_hidden(drawable, true));
    };
    (0..400).step_by(5).for_each(|object| hide(object, &mut filter));
    let motions: Motions = (0..400)
        .step_by(3)
        .map(|object| (object, DAffine3::from_translation(DVec3::new(-3.0, 1.0, 2.0))))
        .collect();
    let shown = Arc::new(Shown::new(Arc::clone(&scene), filter, motions));
    let mut walk = Walkthrough::new(Arc::clone(&scene), context, as_viewed()).unwrap();
    walk.set_shown(Arc::clone(&shown)).unwrap();
    let mut camera = Camera::around(min, max, DVec3::new(1.0, 0.5, 0.7), DVec3::Y, SIZE.0, SIZE.1);
    camera.eye = DVec3::from(camera.eye).lerp(camera.target.into(), 0.4).into();
    let (lighting, marks) = (Lighting::headlight(), Marks::default());
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows: None, caps: false };
    settle(&mut walk, &camera, &look);
    let rays = camera.rays().unwrap();
    let picture = Picture::of(&walk, context);
    let image = picture.image();
    let object = |drawable: u32| scene.scene().drawable_object(drawable);
    let mut random = Random::new(17);
    let (mut hits, mut beside, mut moved) = (0, 0, 0);
    for round in 0..600 {
        let cursor = DVec2::new(f64::from(random.below(SIZE.0)), f64::from(random.below(SIZE.1))) + 0.5;
        let picked = found(&shown, &image, &rays, cursor, 6);
        let at = |x: f64, y: f64| {
            shown.closest(&rays.ray(cursor.x + x, cursor.y + y)).map(|hit| object(hit.drawable))
        };
        let Some(picked) = picked else {
            assert_eq!(at(0.0, 0.0), None, "round {round}");
            continue;
        };
        // Half a pixel apart: what is picked is shown within the radius, and a pixel for what is thinner than one.
        let offsets = || (-15..=15).map(|step| 0.5 * f64::from(step));
        let is_near = offsets().any(|y| offsets().any(|x| at(x, y) == Some(object(picked.drawable))));
        assert!(is_near, "round {round}, {cursor}: {picked:?}");
        assert!(!shown.filter().is_hidden(picked.drawable));
        hits += 1;
        beside += u32::from(at(0.0, 0.0) != Some(object(picked.drawable)));
        moved += u32::from(shown.motions().contains_key(&object(picked.drawable)));
    }
    println!("{hits} clicks picked something, {beside} beside the cursor, {moved} moved things");
    assert!(hits > 50 && beside > 10 && moved > 20, "{hits} {beside} {moved}");
}

//! Queries over frames, with fewer rays than pixels, and with rays where drawables change, against plain queries with all
//! the same rays.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::path::Path;

use common::{build_model, load, random_model};
use glam::DVec3;
use voxsight::camera::{Camera, CameraRays};
use voxsight::loaded::LoadedScene;
use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight::visibility::coherent::{CoherentQuery, CoherentSettings};
use voxsight::visibility::culling::{CulledFrame, Culling};
use voxsight::visibility::{Method, QuerySettings, RayMethod, RaysPerPixel, VisibleSet, accuracy, query};

/// Fractions of a ray in the sample counts of a coherent query.
const PER_RAY: u32 = 256;

fn small_plant(folder: &Path) -> LoadedScene {
    let path = folder.join("plant.vxs");
    let settings = PlantSettings { objects: 600, triangles: 60_000, ..PlantSettings::default() };
    build_model(plant(&settings), 9, &path);
    load(&path)
}

fn random_scene(seed: u64, folder: &Path) -> LoadedScene {
    let path = folder.join(format!("{seed}.vxs"));
    build_model(random_model(seed, 120, DVec3::ZERO), 8, &path);
    load(&path)
}

/// From outside, `turn` around the scene (radians), `near` times as far as all of it would need.
fn camera(loaded: &LoadedScene, turn: f64, near: f64, size: (u32, u32)) -> CameraRays {
    let bounds = loaded.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let from = DVec3::new(turn.cos(), 0.4, turn.sin());
    let camera = Camera::around(min, max, from, DVec3::Y, size.0, size.1);
    let centre = 0.5 * (min + max);
    let eye = centre + near * (DVec3::from(camera.eye) - centre);
    Camera { eye: eye.into(), ..camera }.rays().unwrap()
}

fn frame(culling: &mut CoherentQuery, loaded: &LoadedScene, camera: &CameraRays) -> CulledFrame {
    culling.frame(&loaded.query(), camera, &Silent).unwrap()
}

fn coherent(method: RayMethod, rays: &str) -> CoherentQuery {
    CoherentQuery::of(method, rays.parse().unwrap())
}

fn cast_rays(frame: &CulledFrame) -> bool {
    frame.stages.iter().any(|stage| stage.stage == "rays")
}

#[test]
fn frames_of_a_still_camera_add_up_to_one_query_with_all_their_rays() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..4 {
        let loaded = random_scene(seed, folder.path());
        let camera = camera(&loaded, seed as f64, 0.6, (90, 70));
        for method in [Method::Voxel, Method::Hybrid, Method::Exact] {
            let mut culling = coherent(method.ray_method().unwrap(), "1");
            let mut rays_before = 0;
            for frames in 1..=5u32 {
                let found = frame(&mut culling, &loaded, &camera).found;
                let settings =
                    QuerySettings { rays_per_pixel: RaysPerPixel::rays(frames), ..QuerySettings::default() };
                let at_once = query(&loaded.query(), &camera, method, &settings);
                let place = format!("seed {seed}, {method:?}, {frames} frames");
                assert_eq!(found.visible, at_once.visible, "{place}");
                assert_eq!(found.rays, at_once.rays - rays_before, "{place}");
                rays_before = at_once.rays;
                assert_eq!(found.weight, at_once.weight * u64::from(PER_RAY), "{place}");
                assert_eq!(found.hits, at_once.hits * u64::from(PER_RAY), "{place}");
                let samples: Vec<u32> = at_once.samples.iter().map(|n| n * PER_RAY).collect();
                assert_eq!(found.samples, samples, "{place}");
            }
        }
    }
}

#[test]
fn as_many_still_frames_as_a_cell_has_pixels_are_one_frame_of_a_ray_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    for (seed, cell) in [(0, 4u32), (1, 9), (2, 16), (3, 64)] {
        let loaded = random_scene(seed, folder.path());
        let camera = camera(&loaded, seed as f64, 0.6, (91, 70));
        let mut culling = coherent(RayMethod::Hybrid, &format!("1/{cell}"));
        // Twice around the cell: one ray a pixel, then two.
        for round in 1..=2 {
            let frames = (0..cell).map(|_| frame(&mut culling, &loaded, &camera).found);
            let found = frames.last().unwrap();
            let rays_per_pixel = RaysPerPixel::rays(round);
            let settings = QuerySettings { rays_per_pixel, ..QuerySettings::default() };
            let at_once = query(&loaded.query(), &camera, Method::Hybrid, &settings);
            let place = format!("seed {seed}, {round} times {cell} frames");
            assert_eq!(found.visible, at_once.visible, "{place}");
            assert_eq!(found.weight, at_once.weight * u64::from(PER_RAY), "{place}");
            let samples: Vec<u32> = at_once.samples.iter().map(|n| n * PER_RAY).collect();
            assert_eq!(found.samples, samples, "{place}");
        }
    }
}

#[test]
fn sixteen_still_frames_of_a_sixteenth_see_about_what_one_whole_frame_sees() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = small_plant(folder.path());
    let (mut whole, mut sum) = (0.0, 0.0);
    for view in 0..6 {
        let camera = camera(&loaded, f64::from(view), 0.3, (256, 192));
        let fine = QuerySettings {
            rays_per_pixel: RaysPerPixel::rays(16),
            first_sample: 1 << 20,
            ..QuerySettings::default()
        };
        let reference = query(&loaded.query(), &camera, Method::Exact, &fine);
        let lost = |found: &VisibleSet| accuracy(&reference, found, 256 * 192, |_| 1).lost_pixels;
        let mut culling = coherent(RayMethod::Hybrid, "1/16");
        let first = lost(&frame(&mut culling, &loaded, &camera).found);
        let mut last = first;
        for _ in 1..16 {
            last = lost(&frame(&mut culling, &loaded, &camera).found);
        }
        assert!(last < 0.5 * first, "view {view}: {first} of the pixels were lost at first, {last} at last");
        let once = query(&loaded.query(), &camera, Method::Hybrid, &QuerySettings::default());
        (whole, sum) = (whole + lost(&once), sum + last);
    }
    assert!(sum <= 1.1 * whole, "lost pixels: {sum} of sixteen sixteenths, {whole} of one ray a pixel");
}

#[test]
fn a_still_camera_casts_no_rays_once_it_has_enough_and_a_changed_view_does() {
    let folder = tempfile::tempdir().unwrap();
    let mut loaded = random_scene(7, folder.path());
    let camera_a = camera(&loaded, 0.3, 0.7, (64, 64));
    let mut culling = coherent(RayMethod::Hybrid, "4");
    let frames: Vec<CulledFrame> = (0..8).map(|_| frame(&mut culling, &loaded, &camera_a)).collect();
    let casting = frames.iter().take_while(|frame| cast_rays(frame)).count();
    assert_eq!(casting, 4, "16 rays a pixel are enough");
    let resting = VisibleSet { rays: 0, ..frames[3].found.clone() };
    assert!(frames[4..].iter().all(|f| !cast_rays(f) && f.found == resting));
    // Hiding what covers most is another view, and shows at once.
    let samples = &frames[3].found.samples;
    let largest = (0..).zip(samples).max_by_key(|&(_, n)| n).map(|(drawable, _)| drawable).unwrap();
    loaded.filter_mut().set_hidden(largest, true);
    let hidden = frame(&mut culling, &loaded, &camera_a);
    assert!(cast_rays(&hidden) && !hidden.found.visible[largest as usize]);
    loaded.filter_mut().set_hidden(largest, false);
    assert!(frame(&mut culling, &loaded, &camera_a).found.visible[largest as usize]);
    // And another camera.
    assert!(cast_rays(&frame(&mut culling, &loaded, &camera(&loaded, 0.31, 0.7, (64, 64)))));
}

#[test]
fn a_moving_camera_keeps_what_it_saw_until_it_is_out_of_view_or_hidden_for_long() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = small_plant(folder.path());
    let mut culling = coherent(RayMethod::Hybrid, "1/16");
    let window = CoherentSettings::new(RayMethod::Hybrid, "1/16".parse().unwrap()).window;
    let fine = |camera: &CameraRays| {
        let rays_per_pixel = RaysPerPixel::rays(4);
        query(&loaded.query(), camera, Method::Exact, &QuerySettings { rays_per_pixel, ..Default::default() })
    };
    let at = |step: u32| camera(&loaded, 0.002 * f64::from(step), 0.3, (200, 150));
    let mut seen_in_window = Vec::new();
    let (mut lost, mut lost_alone) = (0.0, 0.0);
    for step in 0..40 {
        let found = frame(&mut culling, &loaded, &at(step)).found;
        let frustum = query(&loaded.query(), &at(step), Method::Frustum, &QuerySettings::default());
        let is_in = |d: &usize| found.visible[*d];
        assert!(
            (0..found.visible.len()).filter(is_in).all(|d| frustum.visible[d]),
            "step {step}: out of view"
        );
        let truth = fine(&at(step));
        let alone = QuerySettings {
            rays_per_pixel: "1/16".parse().unwrap(),
            first_sample: step,
            ..QuerySettings::default()
        };
        let alone = query(&loaded.query(), &at(step), Method::Hybrid, &alone);
        let error = |found: &VisibleSet| accuracy(&truth, found, 200 * 150, |_| 1).lost_pixels;
        if step >= window {
            (lost, lost_alone) = (lost + error(&found), lost_alone + error(&alone));
        }
        seen_in_window.push(truth.visible);
        // Nothing stays that no frame of the window can have seen (a finer query's answer stands for the frames').
        let since = seen_in_window.len().saturating_sub(window as usize + 1);
        let stale = (0..found.visible.len())
            .filter(|&d| found.visible[d] && !seen_in_window[since..].iter().any(|seen| seen[d]))
            .count();
        assert!(stale <= 2, "step {step}: {stale} drawables that were not visible for {window} frames");
    }
    assert!(lost < 0.3 * lost_alone, "lost pixels {lost}, {lost_alone} without the frames before");
    // Turning round: nothing of the other side stays.
    let bounds = loaded.scene().meta().bounds;
    let away = Camera {
        eye: bounds.max,
        target: [0, 1, 2].map(|k| 2.0 * bounds.max[k] - bounds.min[k]),
        ..Camera::around(bounds.min.into(), bounds.max.into(), DVec3::X, DVec3::Y, 64, 64)
    };
    let found = frame(&mut culling, &loaded, &away.rays().unwrap()).found;
    assert_eq!(found.visible_count(), 0);
}

#[test]
fn threads_do_not_change_what_a_moving_camera_sees() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = small_plant(folder.path());
    let walk = |threads: usize| -> Vec<VisibleSet> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut culling = coherent(RayMethod::Hybrid, "1/16");
            let cameras = (0..10).map(|step| camera(&loaded, 0.01 * f64::from(step), 0.4, (120, 90)));
            cameras.map(|camera| frame(&mut culling, &loaded, &camera).found).collect()
        })
    };
    let one = walk(1);
    assert!(one == walk(2), "two threads see something else");
    assert!(one == walk(5), "five threads see something else");
}

#[test]
fn adaptive_rays_find_no_less_than_one_ray_and_no_more_than_all() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = small_plant(folder.path());
    let (mut saved, mut all_rays) = (0u64, 0u64);
    for view in 0..5 {
        let camera = camera(&loaded, 1.3 * f64::from(view), 0.3, (203, 155));
        let ask = |rays, adaptive| {
            let rays_per_pixel = RaysPerPixel::rays(rays);
            query(
                &loaded.query(),
                &camera,
                Method::Hybrid,
                &QuerySettings { rays_per_pixel, adaptive, ..QuerySettings::default() },
            )
        };
        let (once, adapted, all) = (ask(1, false), ask(8, true), ask(8, false));
        assert_eq!(adapted.weight, all.weight, "view {view}");
        assert!(once.rays <= adapted.rays && adapted.rays < all.rays, "view {view}: {} rays", adapted.rays);
        for d in 0..all.visible.len() {
            assert!(adapted.visible[d] || !once.visible[d], "view {view}: {d} is lost");
            assert!(all.visible[d] || !adapted.visible[d], "view {view}: {d} is made up");
        }
        // Sample counts change only by what a tile of one drawable hides between its first samples.
        let apart: u64 =
            adapted.samples.iter().zip(&all.samples).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        (saved, all_rays) = (saved + apart, all_rays + all.rays);
    }
    assert!(saved < all_rays / 100, "{saved} of {all_rays} samples differ");
}

#[test]
fn adaptive_rays_are_spared_at_one_ray_a_pixel_and_less() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = small_plant(folder.path());
    let (mut cast, mut whole) = (0, 0);
    for (view, rays) in [(0, "1"), (1, "1"), (2, "1/4"), (3, "1/16"), (4, "1/7")] {
        let camera = camera(&loaded, 1.3 * f64::from(view), 0.3, (203, 155));
        let ask = |adaptive| {
            let settings =
                QuerySettings { rays_per_pixel: rays.parse().unwrap(), adaptive, ..QuerySettings::default() };
            query(&loaded.query(), &camera, Method::Hybrid, &settings)
        };
        let (adapted, all) = (ask(true), ask(false));
        // Every ray is counted, cast or not, and nothing is made up.
        assert_eq!((adapted.weight, all.weight), (all.rays, all.rays), "{rays}");
        assert!((0..all.visible.len()).all(|d| all.visible[d] || !adapted.visible[d]), "{rays}: made up");
        let apart: u64 =
            adapted.samples.iter().zip(&all.samples).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        assert!(apart < all.rays / 50, "{rays}: {apart} of {} samples differ", all.rays);
        (cast, whole) = (cast + adapted.rays, whole + all.rays);
    }
    assert!(cast < whole * 3 / 4, "{cast} of {whole} rays were cast");
}

#[test]
fn a_fraction_of_a_ray_sees_a_part_of_what_its_rays_can_see() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = small_plant(folder.path());
    let camera = camera(&loaded, 2.0, 0.4, (211, 97));
    let mut before = usize::MAX;
    for rays in ["1", "1/4", "1/16", "1/64"] {
        let ask = |method| {
            let rays_per_pixel: RaysPerPixel = rays.parse().unwrap();
            query(&loaded.query(), &camera, method, &QuerySettings { rays_per_pixel, ..Default::default() })
        };
        let (exact, hybrid) = (ask(Method::Exact), ask(Method::Hybrid));
        assert_eq!(hybrid, exact, "{rays}");
        assert!(exact.visible_count() < before, "{rays}: {} visible", exact.visible_count());
        before = exact.visible_count();
    }
}

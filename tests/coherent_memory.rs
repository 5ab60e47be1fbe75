//! What a query over frames remembers, and whose answer it gives: cancelled frames, other scenes, questions, forgetting.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use common::{build_model, cuboid, load, random_model, sheet};
use glam::{DAffine3, DVec3};
use voxsight::camera::{Camera, CameraRays, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Mesh, Model, Node, Object, Part};
use voxsight::progress::{Progress, Silent};
use voxsight::visibility::coherent::{CoherentError, CoherentQuery, CoherentSettings};
use voxsight::visibility::culling::{CulledFrame, Culling};
use voxsight::visibility::{Method, QuerySettings, RayMethod, RaysPerPixel, query};

/// Cancels when it is asked for the n-th time.
struct CancelAt(AtomicU32);

impl Progress for CancelAt {
    fn stage(&self, _name: &str, _total: u64, _unit: &str) {}
    fn advance(&self, _count: u64) {}
    fn is_cancelled(&self) -> bool {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
    }
}

fn frame(culling: &mut CoherentQuery, loaded: &LoadedScene, camera: &CameraRays) -> CulledFrame {
    culling.frame(&loaded.query(), camera, &Silent).unwrap()
}

fn cancelled(culling: &mut CoherentQuery, loaded: &LoadedScene, camera: &CameraRays, at: u32) -> bool {
    culling.frame(&loaded.query(), camera, &CancelAt(at.into())).is_none()
}

fn cast_rays(frame: &CulledFrame) -> bool {
    frame.stages.iter().any(|stage| stage.stage == "rays")
}

fn random_scene(seed: u64, folder: &Path) -> LoadedScene {
    let path = folder.join(format!("{seed}.vxs"));
    build_model(random_model(seed, 120, DVec3::ZERO), 8, &path);
    load(&path)
}

/// Around a random scene.
fn camera(turn: f64) -> CameraRays {
    let (min, max) = (DVec3::splat(-1.0), DVec3::splat(21.0));
    Camera::around(min, max, DVec3::new(turn.cos(), 0.4, turn.sin()), DVec3::Y, 72, 64).rays().unwrap()
}

/// Looks along -z from there, 90 degrees wide.
fn looking_ahead(eye: DVec3) -> CameraRays {
    let projection = Projection::Perspective { fov_y_deg: 90.0 };
    let target = (eye - DVec3::Z).into();
    Camera { eye: eye.into(), target, up: [0.0, 1.0, 0.0], projection, width: 64, height: 64 }.rays().unwrap()
}

/// One object a mesh, where the mesh is.
fn scene_of(meshes: Vec<Mesh>, log2: u32) -> LoadedScene {
    let mut model = Model::default();
    for (part, mesh) in (0..).zip(meshes) {
        model.parts.push(Part { name: format!("part {part}"), mesh });
        model.nodes.push(Node { name: format!("object {part}"), ..Node::default() });
        let (world_from_part, colour) = (DAffine3::IDENTITY, Colour::default());
        model.objects.push(Object { node: part, part, world_from_part, colour });
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(model, log2, &path);
    load(&path)
}

fn placed(mut mesh: Mesh, size: DVec3, at: DVec3) -> Mesh {
    mesh.positions.iter_mut().for_each(|p| *p = at + size * *p);
    mesh
}

#[test]
fn an_answer_belongs_to_its_view_whatever_was_cancelled_between() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = random_scene(3, folder.path());
    let (here, there) = (camera(0.0), camera(2.5));
    let mut culling = CoherentQuery::of(RayMethod::Hybrid, RaysPerPixel::rays(16));
    let at_first = frame(&mut culling, &loaded, &here).found;
    assert!(!cast_rays(&frame(&mut culling, &loaded, &here)), "16 rays a pixel are enough");
    assert!(cancelled(&mut culling, &loaded, &there, 0));
    let moved = frame(&mut culling, &loaded, &there);
    assert!(cast_rays(&moved) && moved.found.visible != at_first.visible);
    let mut undisturbed = CoherentQuery::of(RayMethod::Hybrid, RaysPerPixel::rays(16));
    frame(&mut undisturbed, &loaded, &here);
    assert_eq!(moved.found, frame(&mut undisturbed, &loaded, &there).found);
    // Back at once, after a frame there that was cancelled: the answer of here still stands.
    let mut culling = CoherentQuery::of(RayMethod::Hybrid, RaysPerPixel::rays(16));
    frame(&mut culling, &loaded, &here);
    assert!(cancelled(&mut culling, &loaded, &there, 5));
    let back = frame(&mut culling, &loaded, &here);
    assert!(!cast_rays(&back) && back.found.visible == at_first.visible);
}

#[test]
fn a_cancelled_frame_leaves_no_trace_wherever_it_is_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = random_scene(4, folder.path());
    let mut in_questions = 0;
    for (rays, tiles) in [("1", 9 * 8), ("1/4", 5 * 4)] {
        let of = || CoherentQuery::of(RayMethod::Hybrid, rays.parse().unwrap());
        let (mut plain, mut disturbed) = (of(), of());
        for step in 0..14 {
            // Moves for a while, then stands still.
            let camera = camera(0.05 * f64::from(step.min(8)));
            let expected = frame(&mut plain, &loaded, &camera);
            let mut at = 0;
            let found = loop {
                match disturbed.frame(&loaded.query(), &camera, &CancelAt(at.into())) {
                    Some(frame) => break frame,
                    // Every place near the end of the image's rays, where the questions begin.
                    None => at += if at + 13 < tiles { 13 } else { 1 },
                }
                // What another view costs, too.
                assert!(cancelled(&mut disturbed, &loaded, &self::camera(3.0), 2));
            };
            assert_eq!(found.found, expected.found, "{rays}, step {step}, cancelled up to {at}");
            in_questions += u32::from(at > tiles);
        }
    }
    // What was cancelled after the image's tiles was asking questions.
    assert!(in_questions > 3, "{in_questions}");
}

#[test]
fn cancelled_frames_are_no_rays_of_the_view() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = random_scene(5, folder.path());
    let mut culling = CoherentQuery::of(RayMethod::Hybrid, RaysPerPixel::rays(4));
    let mut casting = 0;
    for _ in 0..7 {
        casting += u32::from(cast_rays(&frame(&mut culling, &loaded, &camera(1.0))));
        if casting < 4 {
            assert!(cancelled(&mut culling, &loaded, &camera(1.0), 3));
        }
    }
    assert_eq!(casting, 4, "16 rays a pixel are enough, and 4 frames have them");
}

#[test]
fn another_scene_of_as_many_drawables_is_another_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (one, other) = (random_scene(6, folder.path()), random_scene(7, folder.path()));
    let (camera, rays) = (camera(0.4), RaysPerPixel::rays(16));
    assert_eq!(one.scene().drawables().len(), other.scene().drawables().len());
    let mut culling = CoherentQuery::of(RayMethod::Hybrid, rays);
    let first = frame(&mut culling, &one, &camera).found;
    let found = frame(&mut culling, &other, &camera).found;
    let expected = frame(&mut CoherentQuery::of(RayMethod::Hybrid, rays), &other, &camera).found;
    assert_eq!(found, expected);
    assert_ne!(found, first);
    // And the same again after a reset.
    culling.reset();
    assert_eq!(frame(&mut culling, &other, &camera).found, expected);
}

#[test]
fn settings_that_make_no_query_are_refused() {
    let good = CoherentSettings::new(RayMethod::Voxel, RaysPerPixel::ONE);
    assert!(CoherentQuery::new(good).is_ok());
    let error = CoherentQuery::new(CoherentSettings { decay: 1.5, ..good }).err();
    assert_eq!(error, Some(CoherentError::Decay(1.5)));
}

#[test]
fn rays_are_those_of_the_frame_with_its_questions() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = random_scene(8, folder.path());
    let mut culling = CoherentQuery::of(RayMethod::Hybrid, "1/16".parse().unwrap());
    let image = 72 * 64 / 16;
    assert_eq!(frame(&mut culling, &loaded, &camera(0.0)).found.rays, image, "nothing to ask after yet");
    let mut asked = 0;
    for step in 1..8 {
        let rays = frame(&mut culling, &loaded, &camera(0.02 * f64::from(step))).found.rays;
        assert!((image..=image + image / 4).contains(&rays), "{rays} rays");
        asked += rays - image;
    }
    assert!(asked > 0);
    let alone = query(&loaded.query(), &camera(0.0), Method::Exact, &QuerySettings::default());
    assert_eq!((alone.rays, alone.weight), (72 * 64, 72 * 64));
}

/// Eight boxes in a row, of very different sizes, and a wall at z = 5, before which and behind which cameras stand. (The
/// wall is object 8.)
fn boxes_behind_a_wall() -> (LoadedScene, CameraRays, CameraRays) {
    let size = |i: u32| 0.1 + 0.05 * f64::from(i * 3 % 8);
    let mut meshes: Vec<Mesh> = (0..8)
        .map(|i| placed(cuboid(), DVec3::splat(size(i)), DVec3::new(f64::from(i) - 3.5, 0.0, 0.0)))
        .collect();
    meshes.push(placed(cuboid(), DVec3::new(20.0, 20.0, 0.1), DVec3::new(0.0, 0.0, 5.0)));
    (scene_of(meshes, 8), looking_ahead(DVec3::new(0.0, 0.0, 4.5)), looking_ahead(DVec3::new(0.0, 0.0, 7.0)))
}

/// A query that has seen all boxes and stands behind the wall now, after the first frame there; rays of a frame there.
fn behind_the_wall(settings: CoherentSettings) -> (CoherentQuery, LoadedScene, CameraRays, CulledFrame) {
    let (loaded, before, behind) = boxes_behind_a_wall();
    let mut culling = CoherentQuery::new(settings).unwrap();
    // At 1/16 ray per pixel, every pixel in 16 frames.
    let seen = (0..16).map(|_| frame(&mut culling, &loaded, &before).found).last().unwrap();
    assert_eq!(seen.visible, [[true; 8].as_slice(), &[false]].concat(), "all boxes before the wall");
    let first = frame(&mut culling, &loaded, &behind);
    assert_eq!(first.found.samples[..8].iter().filter(|&&n| n > 0).count() as u32, {
        // What is kept keeps its decayed samples.
        first.found.visible[..8].iter().filter(|&&visible| visible).count() as u32
    });
    (culling, loaded, behind, first)
}

fn settings() -> CoherentSettings {
    CoherentSettings { window: 60, ..CoherentSettings::new(RayMethod::Hybrid, "1/16".parse().unwrap()) }
}

#[test]
fn one_question_a_frame_asks_after_the_weightiest() {
    // 256 rays a frame: a question. Whoever is asked after once in vain is gone.
    let one = CoherentSettings { questions: 1.0 / 256.0, patience: 1, ..settings() };
    let (mut culling, loaded, behind, mut last) = behind_the_wall(one);
    // Xue et al. 2016, equation 4.
    let weight = |&drawable: &usize| {
        let (min, max) = loaded.query().exact.drawable_box(drawable as u32);
        let distance = (0.5 * (min + max) - behind.eye()).length();
        (0.5 * (max - min).length() / distance).atan().to_radians()
    };
    let mut order: Vec<usize> = (0..8).collect();
    order.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    assert_ne!(order, [0, 1, 2, 3, 4, 5, 6, 7], "an order that numbers alone would give shows nothing");
    for asked in 1..=8 {
        let gone: Vec<usize> = (0..8).filter(|&d| !last.found.visible[d]).collect();
        let mut expected = order[..asked].to_vec();
        expected.sort_unstable();
        assert_eq!(gone, expected, "after {asked} questions");
        assert_eq!(last.found.rays, 256 + 1, "after {asked} questions");
        last = frame(&mut culling, &loaded, &behind);
    }
    assert_eq!(last.found.rays, 256, "nobody is left to ask after");
}

#[test]
fn patience_is_the_questions_in_vain_that_a_drawable_outlives_but_one() {
    for patience in [1, 2, 5] {
        let all = CoherentSettings { questions: 1.0, patience, ..settings() };
        let (mut culling, loaded, behind, mut last) = behind_the_wall(all);
        for asked in 1..=patience {
            let kept = last.found.visible[..8].iter().filter(|&&visible| visible).count();
            assert_eq!(kept, if asked < patience { 8 } else { 0 }, "asked {asked} of {patience} times");
            last = frame(&mut culling, &loaded, &behind);
        }
    }
}

#[test]
fn the_window_alone_forgets_when_nobody_asks() {
    let silent = CoherentSettings { questions: 0.0, window: 5, ..settings() };
    let (mut culling, loaded, behind, mut last) = behind_the_wall(silent);
    let mut kept = Vec::new();
    for _ in 0..30 {
        kept.push(last.found.visible[..8].iter().filter(|&&visible| visible).count());
        last = frame(&mut culling, &loaded, &behind);
    }
    // The last frame before the wall saw most of the boxes, or all; those leave after five frames, the first at once or later.
    assert!(kept.is_sorted_by(|a, b| a >= b), "{kept:?}");
    assert!(kept[4] > 0 && kept[5] == 0, "{kept:?}");
    assert_eq!(last.found.rays, 256);
}

#[test]
fn samples_of_a_moving_camera_decay() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = random_scene(9, folder.path());
    for decay in [0.0, 0.5, 1.0] {
        let settings =
            CoherentSettings { decay, ..CoherentSettings::new(RayMethod::Hybrid, RaysPerPixel::ONE) };
        let mut culling = CoherentQuery::new(settings).unwrap();
        let mut expected = vec![0.0; loaded.scene().drawables().len()];
        let mut weight = 0.0;
        for step in 0..4 {
            let camera = camera(0.01 * f64::from(step));
            let found = frame(&mut culling, &loaded, &camera).found;
            let alone = QuerySettings { first_sample: step, ..QuerySettings::default() };
            let alone = query(&loaded.query(), &camera, Method::Hybrid, &alone);
            weight = decay * weight + alone.weight as f64;
            assert_eq!(found.weight, (256.0 * weight) as u64, "decay {decay}, step {step}");
            for (d, sum) in expected.iter_mut().enumerate() {
                *sum = if found.visible[d] { decay * *sum } else { 0.0 } + f64::from(alone.samples[d]);
                assert_eq!(found.samples[d], (256.0 * *sum) as u32, "decay {decay}, step {step}, {d}");
            }
        }
    }
}

#[test]
fn chunks_of_a_giant_part_leave_with_their_own_boxes() {
    // A sheet 40 wide whose chunks lie side by side, so near that the camera sees one of them at either end.
    let giant = placed(sheet(200), DVec3::new(40.0, 20.0, 1.0), DVec3::new(-20.0, -10.0, 0.0));
    let loaded = scene_of(vec![giant], 8);
    let exact = loaded.query().exact;
    assert!(exact.drawable_count() >= 2, "{} chunks", exact.drawable_count());
    let mut culling = CoherentQuery::of(RayMethod::Hybrid, RaysPerPixel::ONE);
    let mut left = 0;
    let mut before: Vec<bool> = Vec::new();
    for x in [-12.0, -4.0, 4.0, 12.0] {
        let camera = looking_ahead(DVec3::new(x, 0.0, 5.0));
        let found = frame(&mut culling, &loaded, &camera).found;
        for d in (0..exact.drawable_count()).filter(|&d| found.visible[d as usize]) {
            let (min, max) = exact.drawable_box(d);
            assert!(
                camera.frustum().iter().all(|plane| plane.reaches(min, max)),
                "x {x}: {d} is out of view"
            );
        }
        left += before.iter().zip(&found.visible).filter(|&(&before, &now)| before && !now).count();
        before = found.visible;
    }
    assert!(left > 0, "no chunk ever left the view");
}

//! The frame loop: what it shows at the end is right, whatever the budget, the upload and the latency.

use std::sync::Arc;

use glam::DVec3;
use voxsight::camera::{Camera, Plane, Projection};
use voxsight::filter::Filter;
use voxsight::gpu::check::{Difference, compare, expected};
use voxsight::gpu::marks::{HIGHLIGHTED, Marks, SELECTED};
use voxsight::gpu::shadow::ShadowSettings;
use voxsight::gpu::{Context, ContextSettings};
use voxsight::loaded::LoadedScene;
use voxsight::lod::density::DensitySettings;
use voxsight::moved::Motions;
use voxsight::progress::Silent;
use voxsight::render::{KeyLight, Lighting, NOBODY, Sun};
use voxsight::sample::{PlantSettings, plant};
use voxsight::shown::Shown;
use voxsight::streaming::StreamSettings;
use voxsight::visibility::coherent::CoherentSettings;
use voxsight::visibility::{RayMethod, RaysPerPixel};
use voxsight::walkthrough::{FrameRecord, Latency, Look, Upload, WalkSettings, Walkthrough};

use super::common::{build_model, load};
use super::context;

const SIZE: (u32, u32) = (192, 120);

fn plant_scene() -> Arc<LoadedScene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let settings = PlantSettings { objects: 2000, triangles: 300_000, ..PlantSettings::default() };
    build_model(plant(&settings), 10, &path);
    Arc::new(load(&path))
}

/// Cameras above the scene, `step` apart, looking down on its middle.
fn above(scene: &LoadedScene, step: f64, frame: u32) -> Camera {
    let bounds = scene.scene().meta().bounds;
    let centre = 0.5 * (DVec3::from(bounds.min) + DVec3::from(bounds.max));
    let size = (DVec3::from(bounds.max) - DVec3::from(bounds.min)).max_element();
    let eye = centre + DVec3::new(0.1 * size + step * f64::from(frame), 0.12 * size, 0.2 * size);
    Camera {
        eye: eye.into(),
        target: (eye - DVec3::new(0.1, 0.12, 0.2) * size).into(),
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 70.0 },
        width: SIZE.0,
        height: SIZE.1,
    }
}

/// The finest levels of all that every pixel's ray sees.
pub fn finest() -> WalkSettings {
    WalkSettings {
        query: CoherentSettings::new(RayMethod::Hybrid, RaysPerPixel::ONE),
        lod: DensitySettings { budget: u64::MAX, pixel_error: 0.0, ..DensitySettings::default() },
        latency: Latency::None,
        ahead: 0.0,
        wait: true,
        ..WalkSettings::default()
    }
}

/// Draws frames of a camera until all that is wanted is drawn.
pub fn settle(walk: &mut Walkthrough, camera: &Camera, look: &Look) -> FrameRecord {
    for _ in 0..200 {
        let record = walk.frame(camera, false, None, look).unwrap();
        if record.missing == 0 && record.substituted == 0 && record.delta == [0; 3] {
            return record;
        }
    }
    panic!("no end of changes");
}

fn drawables(walk: &Walkthrough, context: &Context) -> Vec<u32> {
    walk.renderer().targets().drawable.read(context).unwrap()
}

fn picture(walk: &Walkthrough, context: &Context) -> Vec<[u8; 4]> {
    walk.renderer().targets().picture.read(context).unwrap()
}

fn difference(walk: &Walkthrough, context: &Context, camera: &Camera) -> Difference {
    let rays = camera.rays().unwrap();
    let expected = expected(walk.shown(), &rays, &Silent).unwrap();
    compare(&expected, &drawables(walk, context), rays.size()).0
}

/// Leaves out what a filter says.
fn leave_out(walk: &mut Walkthrough, filter: Filter) {
    let shown = Shown::new(Arc::clone(walk.shown().scene()), filter, Motions::new());
    walk.set_shown(Arc::new(shown)).unwrap();
}

#[test]
fn a_walk_shows_what_exact_sees() {
    let Some(context) = context() else { return };
    let scene = plant_scene();
    let lighting = Lighting::headlight();
    let marks = Marks::default();
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows: None, caps: false };
    let mut walk = Walkthrough::new(Arc::clone(&scene), context, finest()).unwrap();
    let mut differ = 0.0;
    for stop in 0..4 {
        let camera = above(&scene, 0.7, stop);
        let record = settle(&mut walk, &camera, &look);
        assert!(record.age == 0 && record.drawn > 20 && record.failed == 0, "{record:?}");
        let found = difference(&walk, context, &camera);
        assert_eq!((found.off_silhouettes, found.lost), (0, 0), "stop {stop}: {found:?}");
        differ += found.differ as f64 / found.pixels as f64 / 4.0;
    }
    println!("{:.4} % of the pixels differ", 100.0 * differ);
    assert!(differ <= 0.002, "{differ}");
}

#[test]
fn every_upload_and_both_ways_of_drawing_show_the_same() {
    let Some(context) = context() else { return };
    let scene = plant_scene();
    let lighting = Lighting::sunny(DVec3::new(0.4, 1.0, 0.3));
    let marks = Marks::default();
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows: None, caps: false };
    let direct = Context::new(&ContextSettings { direct_draws: true, ..Default::default() }).unwrap();
    let mut first: Option<Vec<[u8; 4]>> = None;
    let mut written = Vec::new();
    for (context, upload) in
        [(context, Upload::Delta), (context, Upload::Full), (context, Upload::Each), (&direct, Upload::Delta)]
    {
        // Room for some of what is seen along the way, so that pages come, go and are moved.
        let stream = StreamSettings { budget: 340 << 10, upload: 256 << 10, ..StreamSettings::default() };
        let settings = WalkSettings { upload, stream, ..finest() };
        let mut walk = Walkthrough::new(Arc::clone(&scene), context, settings).unwrap();
        let (mut bytes, mut moved, mut evicted) = (0, 0, 0);
        for frame in 0..30 {
            let record = walk.frame(&above(&scene, 0.5, frame), frame == 0, None, &look).unwrap();
            assert!(record.resident <= stream.budget, "{record:?}");
            bytes += record.written;
            moved += record.moved;
            evicted += record.evicted;
        }
        println!("{upload:?}: {moved} bytes moved, {evicted} given up");
        assert!(moved > 0 && evicted > 0, "{upload:?}: {moved} bytes moved, {evicted} given up");
        let record = settle(&mut walk, &above(&scene, 0.05, 0), &look);
        assert!(record.drawn > 20);
        written.push(bytes);
        let found = picture(&walk, context);
        match &first {
            None => first = Some(found),
            Some(first) => assert!(*first == found, "{upload:?}: another picture"),
        }
    }
    println!("bytes written: {written:?}");
    assert!(written[1] > 3 * written[0] && written[2] > 3 * written[0], "{written:?}");
}

#[test]
fn absurd_budgets_are_kept_and_teleports_survived() {
    let Some(context) = context() else { return };
    let scene = plant_scene();
    let lighting = Lighting::headlight();
    let marks = Marks::default();
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows: None, caps: false };
    for budget in [1 << 12, 1 << 16, 1 << 18] {
        let stream = StreamSettings { budget, upload: 5001, ..StreamSettings::default() };
        let lod = DensitySettings { budget: 20_000, ..DensitySettings::default() };
        let settings =
            WalkSettings { stream, lod, latency: Latency::Newest, ahead: 5.0, ..WalkSettings::default() };
        let mut walk = Walkthrough::new(Arc::clone(&scene), context, settings).unwrap();
        for frame in 0..24 {
            let camera = above(&scene, if frame % 8 == 7 { -2.0 } else { 0.1 }, frame);
            let record = walk.frame(&camera, frame % 8 == 7, None, &look).unwrap();
            assert!(record.resident <= budget && record.triangles <= 20_000, "{record:?}");
        }
        // Newer answers are drawn as they come.
        let camera = above(&scene, 0.1, 3);
        let is_fresh = (0..500).any(|_| walk.frame(&camera, false, None, &look).unwrap().age < 10);
        assert!(is_fresh, "only old answers are drawn");
    }
}

#[test]
fn hidden_parts_vanish_with_their_shadows_and_marks_show() {
    let Some(context) = context() else { return };
    let scene = plant_scene();
    // Hard shadows: the same rays in every frame.
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 0.0 };
    let lighting = Lighting { key: KeyLight::Sun(sun), ..Lighting::sunny(sun.direction) };
    let none = Marks::default();
    let shadows = Some(ShadowSettings { samples: 4, smooth: false });
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &none, shadows, caps: false };
    let mut walk = Walkthrough::new(Arc::clone(&scene), context, finest()).unwrap();
    walk.load_voxels().unwrap();
    let camera = above(&scene, 0.0, 0);
    settle(&mut walk, &camera, &look);
    let (before, picture_before) = (drawables(&walk, context), picture(&walk, context));
    // What covers most of the picture, but for the ground.
    let mut counts = std::collections::HashMap::new();
    let is_tall = |drawable: u32| {
        let (min, max) = scene.query().exact.drawable_box(drawable);
        max.y - min.y > 1.0
    };
    before.iter().filter(|&&d| d != NOBODY && is_tall(d)).for_each(|&d| *counts.entry(d).or_insert(0) += 1);
    let (&largest, &pixels) = counts.iter().max_by_key(|(drawable, count)| (**count, **drawable)).unwrap();

    let mut marks = Marks::default();
    marks.set(largest, SELECTED | HIGHLIGHTED, true);
    let marked_look = Look { marks: &marks, ..look };
    walk.frame(&camera, false, None, &marked_look).unwrap();
    let marked = picture(&walk, context);
    let changed = |d: u32| {
        before
            .iter()
            .zip(picture_before.iter().zip(&marked))
            .filter(|(id, (a, b))| **id == d && a != b)
            .count()
    };
    assert!(changed(largest) > pixels / 2, "{} of {pixels} pixels are tinted", changed(largest));
    let mut filter = Filter::default();
    filter.set_hidden(largest, true);
    leave_out(&mut walk, filter);
    settle(&mut walk, &camera, &look);
    let after = drawables(&walk, context);
    assert!(!after.contains(&largest), "it is still drawn");
    let found = difference(&walk, context, &camera);
    assert_eq!(found.lost, 0, "{found:?}");
    // Its shadow is gone where it was the only thing before the sun: nothing got darker, something lighter.
    let shares = |walk: &Walkthrough| -> Vec<[f32; 2]> {
        bytemuck::pod_collect_to_vec(&context.read(walk.renderer().reached().unwrap()).unwrap())
    };
    let hidden = shares(&walk);
    leave_out(&mut walk, Filter::default());
    settle(&mut walk, &camera, &look);
    let shown = shares(&walk);
    // More rays of a still camera may have found more meanwhile.
    let again = drawables(&walk, context);
    let same = |index: usize| again[index] == after[index] && after[index] != NOBODY;
    let lighter = (0..hidden.len()).filter(|&i| same(i) && hidden[i][0] > shown[i][0]).count();
    let darker = (0..hidden.len()).filter(|&i| same(i) && hidden[i][0] < shown[i][0] - 0.5).count();
    println!("{lighter} pixels lighter, {darker} darker without drawable {largest}");
    assert!(darker == 0 && lighter > 0, "{lighter} {darker}");
    // Cut through the middle: drawn as `exact` sees it.
    let bounds = scene.scene().meta().bounds;
    let centre = 0.5 * (DVec3::from(bounds.min) + DVec3::from(bounds.max));
    let mut cutting = Filter::default();
    cutting.clip_by(Plane { normal: DVec3::new(-1.0, 0.0, 0.3), point: centre });
    leave_out(&mut walk, cutting);
    settle(&mut walk, &camera, &look);
    let found = difference(&walk, context, &camera);
    assert!(found.lost == 0 && found.off_silhouettes == 0, "{found:?}");
    let kept = drawables(&walk, context).iter().zip(&again).filter(|(cut, whole)| cut == whole).count();
    assert!(
        kept < again.len() * 9 / 10,
        "nothing is cut away: {kept} of {} pixels are the same",
        again.len()
    );
    leave_out(&mut walk, Filter::default());
    settle(&mut walk, &camera, &look);
    // A camera that moves sideways sees other shadows, though it looks the same way.
    let mut gathered = 0;
    for _ in 0..40 {
        walk.frame(&camera, false, None, &look).unwrap();
        gathered = walk.renderer().shadow_samples();
        // Not in every frame: it begins anew where more is found.
        if gathered > 4 {
            break;
        }
    }
    assert!(gathered > 4, "a still camera gathers nothing");
    walk.frame(&above(&scene, 0.1, 1), false, None, &look).unwrap();
    assert_eq!(walk.renderer().shadow_samples(), 4);
}

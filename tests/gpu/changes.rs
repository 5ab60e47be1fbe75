//! What a user moves and looks through, drawn and shadowed where it now is.

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use voxsight::camera::{Camera, Plane, Projection};
use voxsight::filter::Filter;
use voxsight::gpu::check::{self, expected};
use voxsight::gpu::marks::Marks;
use voxsight::gpu::shadow::ShadowSettings;
use voxsight::gpu::target::NOBODY;
use voxsight::loaded::LoadedScene;
use voxsight::lod::density::DensitySettings;
use voxsight::model::Model;
use voxsight::moved::Motions;
use voxsight::prepare::{self, BuildSettings, Resolution};
use voxsight::progress::Silent;
use voxsight::render::{KeyLight, Lighting, Sky, Sun};
use voxsight::report::Findings;
use voxsight::shown::Shown;
use voxsight::walkthrough::{Look, Walkthrough};

use super::common::{build_model, load, random_model};
use super::context;
use super::walks::{finest, settle};

const SIZE: (u32, u32) = (480, 360);

/// Hard shadows, of which one ray is all.
fn hard() -> (Lighting, ShadowSettings) {
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 0.0 };
    let lighting = Lighting { key: KeyLight::Sun(sun), ..Lighting::sunny(sun.direction) };
    (lighting, ShadowSettings { samples: 1, smooth: false })
}

/// Soft ones of a wide sun and of an occluded sky, in more samples than a dispatch has.
fn soft() -> (Lighting, ShadowSettings) {
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 4.0 };
    let sky = Sky::Occluded { reach: 3.0 };
    let lighting = Lighting { key: KeyLight::Sun(sun), sky, areas: Vec::new(), fill: 1.0 };
    (lighting, ShadowSettings { samples: 6, smooth: false })
}

/// What a settled frame shows: drawables, shares of sun and sky.
fn settled(
    context: &voxsight::gpu::Context,
    scene: &Arc<LoadedScene>,
    camera: &Camera,
    changes: Option<(&Filter, &Motions)>,
    (lighting, shadows): &(Lighting, ShadowSettings),
) -> (Vec<u32>, Vec<[f32; 2]>) {
    let mut walk = Walkthrough::new(Arc::clone(scene), context, finest()).unwrap();
    walk.load_voxels().unwrap();
    if let Some((filter, motions)) = changes {
        // Something else a moment before: what is worked out for it is given up.
        let before = Motions::from([(1, DAffine3::from_translation(DVec3::Y))]);
        for motions in [&before, motions] {
            let shown = Shown::new(Arc::clone(scene), filter.clone(), motions.clone());
            walk.set_shown(Arc::new(shown)).unwrap();
        }
    }
    let marks = Marks::default();
    let shadows = Some(*shadows);
    let look = Look { lighting, up: DVec3::Y, marks: &marks, shadows, caps: false };
    settle(&mut walk, camera, &look);
    assert!(walk.shadow_fault().is_none() && !walk.is_finding_casters());
    // And nothing is amiss by the check that users have.
    let rays = camera.rays().unwrap();
    let targets = walk.renderer().targets();
    let drawables: Vec<u32> = targets.drawable.read(context).unwrap();
    let expected = expected(walk.shown(), &rays, &Silent).unwrap();
    let (difference, _) = check::compare(&expected, &drawables, rays.size());
    assert!(difference.lost == 0 && difference.off_silhouettes == 0, "{difference:?}");
    assert!(difference.differ * 500 <= difference.pixels, "{difference:?}");
    let reached: Vec<[f32; 2]> =
        bytemuck::pod_collect_to_vec(&context.read(walk.renderer().reached().unwrap()).unwrap());
    (drawables, reached)
}

/// The scene without glass, so that drawables tell all.
fn model(seed: u64) -> Model {
    let mut model = random_model(seed, 60, DVec3::new(1e5, -2e5, 3e4));
    model.objects.iter_mut().for_each(|object| object.colour.0[3] = 255);
    model
}

/// With voxels of the same size, however far things are apart.
fn build(model: Model, path: &Path) {
    let resolution = Resolution::VoxelSize(0.05);
    let settings = BuildSettings { resolution, ..BuildSettings::default() };
    prepare::build(model, Vec::new(), Findings::default(), &settings, path, &Silent).unwrap();
}

#[test]
fn moved_parts_look_as_if_they_had_been_built_there() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build(model(3), &path);
    let before = Arc::new(load(&path));
    let bounds = before.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let perspective = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, SIZE.0, SIZE.1);
    let height = 1.5 * (max - min).max_element();
    let parallel = Camera { projection: Projection::Orthographic { height }, ..perspective };
    // A third of the objects, turned and pushed about.
    let mut motions = Motions::new();
    for object in (0..60).step_by(3) {
        let record = &before.scene().objects()[object as usize];
        let centre = 0.5 * (DVec3::from(record.min) + DVec3::from(record.max));
        let turn = DAffine3::from_quat(DQuat::from_rotation_y(0.3 + f64::from(object)));
        // Some of them far out of the scene, before and behind it.
        let far = if object % 9 == 0 { 12.0 } else { 1.0 };
        let push = 0.1 * far * (max - min) * DVec3::new(1.0, 0.4, -1.0) * f64::from(object % 7) / 7.0;
        let about = DAffine3::from_translation(centre + push) * turn * DAffine3::from_translation(-centre);
        motions.insert(object, about);
    }
    let mut built = model(3);
    for (&object, motion) in &motions {
        let placed = &mut built.objects[object as usize].world_from_part;
        *placed = *motion * *placed;
    }
    let elsewhere = folder.path().join("moved.vxs");
    build(built, &elsewhere);
    let after = Arc::new(load(&elsewhere));
    for (camera, light) in [(perspective, hard()), (parallel, hard()), (perspective, soft())] {
        compare(context, &before, &after, &camera, &motions, &light);
    }
}

/// Moved in the viewer against built there.
fn compare(
    context: &voxsight::gpu::Context,
    before: &Arc<LoadedScene>,
    after: &Arc<LoadedScene>,
    camera: &Camera,
    motions: &Motions,
    light: &(Lighting, ShadowSettings),
) {
    let (still, light_still) = settled(context, before, camera, None, light);
    let (expected, light_expected) = settled(context, after, camera, None, light);
    let (found, light_found) = settled(context, before, camera, Some((&Filter::default(), motions)), light);
    // Objects, not drawables: parts that are built anew may be cut into other chunks.
    let objects = |scene: &LoadedScene, drawables: &[u32]| -> Vec<u32> {
        drawables
            .iter()
            .map(|&d| if d == NOBODY { NOBODY } else { scene.scene().drawable_object(d) })
            .collect()
    };
    let (still, expected, found) =
        (objects(before, &still), objects(after, &expected), objects(before, &found));
    let share =
        |a: &[u32], b: &[u32]| a.iter().zip(b).filter(|(a, b)| a != b).count() as f64 / a.len() as f64;
    println!(
        "{:.4} of the pixels differ; unmoved, {:.4}",
        share(&expected, &found),
        share(&expected, &still)
    );
    assert!(share(&expected, &still) > 0.03, "much was moved");
    assert!(share(&expected, &found) <= 0.002, "{}", share(&expected, &found));
    // Shadows by voxels of another grid, which is as fine: edges differ by a voxel. On what has not moved, they changed.
    let pixels = || (0..expected.len()).filter(|&i| expected[i] == found[i] && expected[i] != NOBODY);
    let differ = |other: &[[f32; 2]], of: &[usize]| {
        let is_otherwise = |a: f32, b: f32| (a - b).abs() > 0.4;
        let differs = |i: usize| (0..2).any(|kind| is_otherwise(light_expected[i][kind], other[i][kind]));
        of.iter().filter(|&&i| differs(i)).count()
    };
    let unmoved: Vec<usize> =
        pixels().filter(|&i| still[i] == found[i] && !motions.contains_key(&found[i])).collect();
    let (now, unchanged) = (differ(&light_found, &unmoved), differ(&light_still, &unmoved));
    println!("of {} pixels of unmoved parts {now} are lit otherwise, {unchanged} as before", unmoved.len());
    assert!(unchanged > 100 && now * 3 < unchanged, "{now} {unchanged}");
    let all: Vec<usize> = pixels().collect();
    assert!(differ(&light_found, &all) < all.len() / 20);
}

#[test]
fn what_is_looked_through_hides_nothing_and_casts_no_shadow() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(model(4), 8, &path);
    let scene = Arc::new(load(&path));
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let camera = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, SIZE.0, SIZE.1);
    let drawables = scene.scene().drawables().len() as u32;
    let (mut through, mut hidden) = (Filter::default(), Filter::default());
    for drawable in (0..drawables).step_by(2) {
        through.set_seen_through(drawable, true);
        hidden.set_hidden(drawable, true);
    }
    // What is opaque is drawn as if the rest were hidden, and so are its shadows.
    let none = Motions::new();
    let (a, sun_a) = settled(context, &scene, &camera, Some((&through, &none)), &hard());
    let (b, sun_b) = settled(context, &scene, &camera, Some((&hidden, &none)), &hard());
    assert!(a == b, "{} pixels differ", a.iter().zip(&b).filter(|(a, b)| a != b).count());
    assert!(sun_a == sun_b, "other shadows");
    let (all, _) = settled(context, &scene, &camera, None, &hard());
    assert!(all != a, "something was in the way");
}

#[test]
fn what_was_moved_is_hidden_cut_and_looked_through_where_it_is() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(model(6), 8, &path);
    let scene = Arc::new(load(&path));
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let camera = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, SIZE.0, SIZE.1);
    let motions: Motions =
        (0..60).step_by(2).map(|object| (object, DAffine3::from_translation(0.2 * (max - min)))).collect();
    let mut filter = Filter::default();
    let drawables = |objects: [u32; 2]| objects.into_iter().flat_map(|o| scene.scene().object_drawables(o));
    let hidden: Vec<u32> = drawables([4, 5]).collect();
    let through: Vec<u32> = drawables([6, 7]).collect();
    hidden.iter().for_each(|&drawable| filter.set_hidden(drawable, true));
    through.iter().for_each(|&drawable| filter.set_seen_through(drawable, true));
    filter.clip_by(Plane { normal: DVec3::new(-1.0, 0.2, 0.0), point: 0.5 * (min + max) });
    // `settled` compares the picture with rays through the triangles as they are shown.
    let (found, _) = settled(context, &scene, &camera, Some((&filter, &motions)), &soft());
    assert!(hidden.iter().chain(&through).all(|drawable| !found.contains(drawable)));
    let is_moved =
        |&drawable: &u32| drawable != NOBODY && scene.scene().drawable_object(drawable).is_multiple_of(2);
    assert!(found.iter().filter(|drawable| is_moved(drawable)).count() > 1000, "moved parts are seen");
}

#[test]
fn a_frozen_picture_stays_whatever_is_asked_of_it() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(model(7), 8, &path);
    let scene = Arc::new(load(&path));
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (bounds.min.into(), bounds.max.into());
    let camera = |from: DVec3| Camera::around(min, max, from, DVec3::Y, SIZE.0, SIZE.1);
    let (here, there) = (camera(DVec3::new(1.0, 0.6, 0.7)), camera(DVec3::new(-1.0, 0.3, -0.7)));
    let (lighting, _) = hard();
    let marks = Marks::default();
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows: None, caps: false };
    let mut walk = Walkthrough::new(Arc::clone(&scene), context, finest()).unwrap();
    settle(&mut walk, &here, &look);
    let drawn = walk.drawn().to_vec();
    walk.set_frozen(true);
    // A jump, and fewer triangles.
    walk.set_limits(DensitySettings { budget: 100, ..DensitySettings::default() });
    for is_cut in [true, false] {
        walk.frame(&there, is_cut, None, &look).unwrap();
        assert_eq!(walk.drawn(), drawn);
    }
    walk.set_frozen(false);
    settle(&mut walk, &there, &look);
    assert_ne!(walk.drawn(), drawn);
}

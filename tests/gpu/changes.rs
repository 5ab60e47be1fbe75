//! What a user moves and looks through, drawn and shadowed where it now is.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use voxsight::camera::{Camera, Projection};
use voxsight::filter::Filter;
use voxsight::gpu::marks::Marks;
use voxsight::gpu::shadow::ShadowSettings;
use voxsight::gpu::target::NOBODY;
use voxsight::loaded::LoadedScene;
use voxsight::lod::density::DensitySettings;
use voxsight::model::Model;
use voxsight::moved::{Motions, Moved};
use voxsight::render::{KeyLight, Lighting, Sun};
use voxsight::visibility::coherent::CoherentSettings;
use voxsight::visibility::{RayMethod, RaysPerPixel};
use voxsight::walkthrough::{Latency, Look, WalkSettings, Walkthrough};

use super::common::{build_model, load, random_model};
use super::context;

const SIZE: (u32, u32) = (480, 360);

/// What a settled frame shows: drawables, shares of the sun.
fn settled(
    context: &voxsight::gpu::Context,
    scene: &Arc<LoadedScene>,
    camera: &Camera,
    changes: Option<(&Filter, &Motions)>,
) -> (Vec<u32>, Vec<f32>) {
    let settings = WalkSettings {
        query: CoherentSettings::new(RayMethod::Hybrid, RaysPerPixel::ONE),
        lod: DensitySettings { budget: u64::MAX, pixel_error: 0.0, ..DensitySettings::default() },
        latency: Latency::None,
        ahead: 0.0,
        wait: true,
        ..WalkSettings::default()
    };
    let mut walk = Walkthrough::new(Arc::clone(scene), context, settings).unwrap();
    walk.load_voxels().unwrap();
    if let Some((filter, motions)) = changes {
        let moved = Arc::new(Moved::new(scene, motions, filter));
        walk.set_changes(filter.clone(), Some(moved)).unwrap();
    }
    // Hard shadows: one ray is all.
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 0.0 };
    let lighting = Lighting { key: KeyLight::Sun(sun), ..Lighting::sunny(sun.direction) };
    let marks = Marks::default();
    let shadows = Some(ShadowSettings { samples: 1, smooth: false });
    let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows };
    let has_settled = (0..100).any(|_| {
        let record = walk.frame(camera, false, None, &look).unwrap();
        record.missing == 0 && record.substituted == 0 && record.delta == [0; 3]
    });
    assert!(has_settled && !walk.is_finding_casters());
    assert!(walk.shadow_fault().is_none());
    let targets = walk.renderer().targets();
    let reached: Vec<[f32; 2]> =
        bytemuck::pod_collect_to_vec(&context.read(walk.renderer().reached().unwrap()).unwrap());
    (targets.drawable.read(context).unwrap(), reached.iter().map(|shares| shares[0]).collect())
}

/// The scene without glass, so that drawables tell all.
fn model(seed: u64) -> Model {
    let mut model = random_model(seed, 60, DVec3::new(1e5, -2e5, 3e4));
    model.objects.iter_mut().for_each(|object| object.colour.0[3] = 255);
    model
}

#[test]
fn moved_parts_look_as_if_they_had_been_built_there() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(model(3), 9, &path);
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
    build_model(built, 9, &elsewhere);
    let after = Arc::new(load(&elsewhere));
    for camera in [perspective, parallel] {
        compare(context, &before, &after, &camera, &motions);
    }
}

/// Moved in the viewer against built there.
fn compare(
    context: &voxsight::gpu::Context,
    before: &Arc<LoadedScene>,
    after: &Arc<LoadedScene>,
    camera: &Camera,
    motions: &Motions,
) {
    let (still, sun_still) = settled(context, before, camera, None);
    let (expected, sun_expected) = settled(context, after, camera, None);
    let (found, sun_found) = settled(context, before, camera, Some((&Filter::default(), motions)));
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
    let differ = |other: &[f32], of: &[usize]| {
        of.iter().filter(|&&i| (sun_expected[i] > 0.5) != (other[i] > 0.5)).count()
    };
    let unmoved: Vec<usize> =
        pixels().filter(|&i| still[i] == found[i] && !motions.contains_key(&found[i])).collect();
    let (now, unchanged) = (differ(&sun_found, &unmoved), differ(&sun_still, &unmoved));
    println!("of {} pixels of unmoved parts {now} are lit otherwise, {unchanged} as before", unmoved.len());
    assert!(unchanged > 100 && now * 3 < unchanged, "{now} {unchanged}");
    let all: Vec<usize> = pixels().collect();
    assert!(differ(&sun_found, &all) < all.len() / 20);
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
    let (a, sun_a) = settled(context, &scene, &camera, Some((&through, &none)));
    let (b, sun_b) = settled(context, &scene, &camera, Some((&hidden, &none)));
    assert!(a == b, "{} pixels differ", a.iter().zip(&b).filter(|(a, b)| a != b).count());
    assert!(sun_a == sun_b, "other shadows");
    let (all, _) = settled(context, &scene, &camera, None);
    assert!(all != a, "something was in the way");
}

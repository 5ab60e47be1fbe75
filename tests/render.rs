//! The renderer: what casts shadows, and that it stops when asked.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::sync::atomic::AtomicBool;

use common::{build_model, cuboid, load, random_model};
use glam::{DAffine3, DVec3};
use voxsight::camera::{Camera, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Model, Node, Object, Part};
use voxsight::progress::{CancelFlag, Silent};
use voxsight::render::{KeyLight, Lighting, RenderSettings, Shadows, Sky, Sun, render};
use voxsight::visibility::{Method, QuerySettings, query_until};

/// A floor, and above it, out of the camera's sight, a box with this alpha.
fn floor_and_box(alpha: u8) -> Model {
    let part = Part { name: "box".to_owned(), mesh: cuboid() };
    let mut model = Model { parts: vec![part], ..Model::default() };
    for (scale, at, alpha) in
        [(DVec3::new(10.0, 0.1, 10.0), DVec3::ZERO, 255), (DVec3::ONE, DVec3::Y * 8.0, alpha)]
    {
        let node = model.nodes.len() as u32;
        model.nodes.push(Node { name: format!("box {node}"), ..Node::default() });
        let world_from_part = DAffine3::from_translation(at) * DAffine3::from_scale(scale);
        model.objects.push(Object { node, part: 0, world_from_part, colour: Colour([200, 200, 200, alpha]) });
    }
    model
}

fn picture(loaded: &LoadedScene, shadows: Shadows) -> image::RgbImage {
    let camera = Camera {
        eye: [0.0, 4.0, 0.0],
        target: [0.0; 3],
        up: [0.0, 0.0, -1.0],
        projection: Projection::Perspective { fov_y_deg: 70.0 },
        width: 64,
        height: 64,
    };
    let sun = Sun { direction: DVec3::Y, angle_deg: 0.0 };
    let lighting = Lighting { key: KeyLight::Sun(sun), sky: Sky::Plain, areas: Vec::new(), fill: 1.0 };
    let settings = RenderSettings { samples_per_pixel: 1, lighting, shadows, up: DVec3::Y, seed: 0 };
    render(&loaded.picture(), &camera.rays().unwrap(), &settings, &Silent).unwrap()
}

#[test]
fn an_opaque_box_casts_the_same_shadow_by_voxels_and_triangles_and_glass_casts_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    for (alpha, casts) in [(255, true), (60, false)] {
        build_model(floor_and_box(alpha), 9, &path);
        let loaded = load(&path);
        let lit = picture(&loaded, Shadows::None);
        let differing = |a: &image::RgbImage, b: &image::RgbImage| {
            a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count()
        };
        let exact = picture(&loaded, Shadows::Exact);
        let voxel = picture(&loaded, Shadows::Voxel);
        let shadow = differing(&lit, &exact);
        assert_eq!(shadow > 100, casts, "alpha {alpha}: {shadow} pixels in shadow");
        // A voxel (0.04 units) is a third of a pixel: only the shadow's border may differ.
        let border = differing(&exact, &voxel);
        assert!(border <= if casts { 90 } else { 0 }, "alpha {alpha}: {border} pixels differ");
    }
}

#[test]
fn pictures_and_queries_stop_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(1, 10, DVec3::ZERO), 7, &path);
    let loaded = load(&path);
    let camera =
        Camera::around(DVec3::ZERO, DVec3::splat(20.0), DVec3::ONE, DVec3::Y, 64, 64).rays().unwrap();
    let settings = RenderSettings {
        samples_per_pixel: 1,
        lighting: Lighting::headlight(),
        shadows: Shadows::None,
        up: DVec3::Y,
        seed: 0,
    };
    for (stop, expected) in [(true, false), (false, true)] {
        let flag = AtomicBool::new(stop);
        let progress = CancelFlag(&flag);
        assert_eq!(render(&loaded.picture(), &camera, &settings, &progress).is_some(), expected);
        for method in [Method::Voxel, Method::Hybrid, Method::Exact] {
            let answer = query_until(&loaded.query(), &camera, method, &QuerySettings::default(), &progress);
            assert_eq!(answer.is_some(), expected, "{method:?}");
        }
    }
}

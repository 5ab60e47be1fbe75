//! The queries against a ray caster that shares nothing with them, and against each other.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use common::brute_force::{FlatScene, compare_with_brute_force};
use common::cameras::cameras;
use common::{build_file, build_model, load, model_files, models_folder, random_model};
use glam::DVec3;
use voxsight::camera::{Camera, Plane, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::scene::Scene;
use voxsight::visibility::{Method, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query};

fn ask(loaded: &LoadedScene, camera: &Camera, method: Method, rays_per_pixel: u32) -> VisibleSet {
    let rays_per_pixel = RaysPerPixel::rays(rays_per_pixel);
    let settings = QuerySettings { rays_per_pixel, ..QuerySettings::default() };
    query(&loaded.query(), &camera.rays().unwrap(), method, &settings)
}

#[test]
fn exact_agrees_with_brute_force_on_random_scenes_near_and_far_from_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    for (seed, centre) in [(1, DVec3::ZERO), (2, DVec3::new(4.3e5, 5.2e6, -80.0)), (3, DVec3::splat(-1e7))] {
        let path = folder.path().join(format!("{seed}.vxs"));
        build_model(random_model(seed, 60, centre), 9, &path);
        let loaded = load(&path);
        let flat = FlatScene::new(loaded.scene());
        let mut seen = 0;
        for camera in cameras(&loaded, (97, 61)) {
            let agreement = compare_with_brute_force(&format!("seed {seed}"), &loaded, &flat, &camera, 1);
            assert_eq!(agreement.doubtful, 0, "seed {seed}");
            seen += agreement.hits;
        }
        assert!(seen > 1200, "seed {seed}: only {seen} pixels hit anything");
    }
}

#[test]
fn exact_agrees_with_brute_force_on_every_small_real_model() {
    let Some(models) = models_folder() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut compared = 0;
    for file in model_files(&models) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let path = folder.path().join("scene.vxs");
        if std::fs::metadata(&file).unwrap().len() > 3_000_000 {
            continue;
        }
        build_file(&file, 8, &path);
        let loaded = load(&path);
        if loaded.scene().meta().counts.placed_triangles > 600_000 {
            continue;
        }
        let flat = FlatScene::new(loaded.scene());
        for camera in cameras(&loaded, (64, 48)) {
            let agreement = compare_with_brute_force(&name, &loaded, &flat, &camera, 1);
            assert!(agreement.hits > 0, "{name}: nothing seen");
            assert!(agreement.doubtful * 100 <= agreement.hits, "{name}: {agreement:?}");
            println!("{name}: {agreement:?}");
        }
        compared += 1;
    }
    assert!(compared >= 12, "only {compared} models compared");
}

#[test]
fn hybrid_finds_what_exact_finds_sample_by_sample() {
    let folder = tempfile::tempdir().unwrap();
    for (seed, log2, centre) in
        [(1, 6, DVec3::ZERO), (2, 9, DVec3::new(4e5, 5e6, 0.0)), (3, 11, DVec3::splat(1e7))]
    {
        let path = folder.path().join(format!("{seed}.vxs"));
        build_model(random_model(seed, 80, centre), log2, &path);
        let loaded = load(&path);
        for camera in cameras(&loaded, (160, 120)) {
            let exact = ask(&loaded, &camera, Method::Exact, 2);
            let hybrid = ask(&loaded, &camera, Method::Hybrid, 2);
            assert!(exact.hits > 2000, "seed {seed}: too few hits");
            assert_eq!(hybrid, exact, "seed {seed}, 2^{log2} voxels");
        }
    }
}

#[test]
fn voxel_misses_little_and_frustum_misses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(5, 100, DVec3::ZERO), 11, &path);
    let loaded = load(&path);
    for camera in cameras(&loaded, (200, 150)) {
        let fine = QuerySettings {
            rays_per_pixel: RaysPerPixel::rays(4),
            first_sample: 1,
            ..QuerySettings::default()
        };
        let reference = query(&loaded.query(), &camera.rays().unwrap(), Method::Exact, &fine);
        let check = |method| accuracy(&reference, &ask(&loaded, &camera, method, 1), 200 * 150, |_| 1);
        let voxel = check(Method::Voxel);
        assert!(voxel.lost_pixels < 0.01, "{voxel:?}");
        let frustum = check(Method::Frustum);
        assert_eq!((frustum.wrongly_hidden, frustum.lost_pixels), (0, 0.0));
    }
}

#[test]
fn hidden_drawables_and_what_is_cut_away_are_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    for (seed, centre) in [(8, DVec3::ZERO), (9, DVec3::new(4.3e5, -5.2e6, 80.0))] {
        build_model(random_model(seed, 400, centre), 9, &path);
        let mut loaded = load(&path);
        let all: Vec<_> =
            cameras(&loaded, (97, 61)).iter().map(|camera| ask(&loaded, camera, Method::Exact, 1)).collect();
        let bounds = loaded.scene().meta().bounds;
        let middle = 0.5 * (DVec3::from(bounds.min) + DVec3::from(bounds.max));
        let drawables = loaded.scene().drawables().len() as u32;
        (0..drawables).step_by(3).for_each(|d| loaded.filter_mut().set_hidden(d, true));
        // An opened section: a slanted cut through the middle, and the floor gone.
        loaded.filter_mut().clip_by(Plane { normal: DVec3::new(-1.0, 0.2, -0.4), point: middle });
        loaded.filter_mut().clip_by(Plane { normal: DVec3::Y * 3.0, point: middle - 5.0 * DVec3::Y });
        let flat = FlatScene::new(loaded.scene());
        let mut seen = 0;
        for (camera, all) in cameras(&loaded, (97, 61)).iter().zip(&all) {
            let name = format!("seed {seed}, {:?}", camera.projection);
            seen += compare_with_brute_force(&name, &loaded, &flat, camera, 1).hits;
            let exact = ask(&loaded, camera, Method::Exact, 1);
            assert_ne!(exact, *all, "{name}: the filter changes nothing");
            assert_eq!(ask(&loaded, camera, Method::Hybrid, 1), exact, "{name}");
            for method in [Method::Voxel, Method::Frustum] {
                let answer = ask(&loaded, camera, method, 1);
                let shown = (0..drawables).step_by(3).filter(|&d| answer.visible[d as usize]).count();
                assert_eq!(shown, 0, "{name}: {method:?} shows hidden drawables");
            }
            let boxes = ask(&loaded, camera, Method::Frustum, 1);
            let lost = accuracy(&exact, &boxes, 97 * 61, |_| 1).wrongly_hidden;
            assert_eq!(lost, 0, "{name}: frustum lost what is there");
        }
        assert!(seen > 600, "seed {seed}: only {seen} pixels hit anything");
    }
}

#[test]
fn answers_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(6, 60, DVec3::ZERO), 9, &path);
    let loaded = load(&path);
    let camera = cameras(&loaded, (120, 90))[0];
    for method in [Method::Voxel, Method::Hybrid, Method::Exact, Method::Frustum] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| ask(&loaded, &camera, method, 1))
        };
        let one = with(1);
        assert_eq!(one, with(2), "{method:?}");
        assert_eq!(one, with(7), "{method:?}");
    }
}

#[test]
fn what_is_behind_glass_is_seen_and_so_is_the_glass() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let mut model = random_model(7, 2, DVec3::ZERO);
    model.parts.truncate(1);
    for (object, (z, alpha)) in model.objects.iter_mut().zip([(0.0, 255), (5.0, 80)]) {
        object.part = 0;
        object.world_from_part = glam::DAffine3::from_translation(DVec3::new(0.0, 0.0, z));
        object.colour.0[3] = alpha;
    }
    build_model(model, 8, &path);
    let loaded = load(&path);
    let camera = Camera {
        eye: [0.0, 0.0, 20.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 2.0 },
        width: 32,
        height: 32,
    };
    for method in [Method::Voxel, Method::Hybrid, Method::Exact] {
        let answer = ask(&loaded, &camera, method, 1);
        assert_eq!(answer.samples, [1024, 1024], "{method:?}");
    }
    let scene: &Scene = loaded.scene();
    assert_eq!(scene.objects().len(), 2);
}

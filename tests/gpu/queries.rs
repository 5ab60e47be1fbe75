//! The visibility query on the GPU: the counts of its twin on the same rays, and nearly those of the CPU's query.

use glam::DVec3;
use voxsight::camera::{Camera, Plane};
use voxsight::gpu::query::GpuQuery;
use voxsight::gpu::twin;
use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight::visibility::culling::Culling;
use voxsight::visibility::{Method, QueryScene, QuerySettings, VisibleSet, query};

use super::common::{build_model, load, random_model};
use super::context;

/// Asks the GPU, and checks the answer against the twin's.
fn checked(gpu: &GpuQuery, scene: &QueryScene, camera: &Camera, name: &str) -> VisibleSet {
    let camera = camera.rays().unwrap();
    let (rays, count) = gpu.rays(scene, &camera);
    let pending = gpu.ask(scene, &rays, count).unwrap();
    // Without waiting, until it is there.
    let found = loop {
        if let Some(found) = gpu.poll(&pending).unwrap() {
            break found;
        }
        std::thread::yield_now();
    };
    let twin = twin::count(scene, &rays);
    assert_eq!(found.samples, twin.samples, "{name}: samples");
    assert_eq!(found.visible, twin.seen, "{name}: seen");
    assert_eq!((found.hits, found.rays), (twin.hits.into(), count), "{name}: hits");
    assert!(gpu.poll(&pending).is_err(), "an answer is fetched once");
    found
}

#[test]
fn counts_are_those_of_the_twin_and_nearly_those_in_f64() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let settings = PlantSettings { objects: 2000, triangles: 200_000, ..PlantSettings::default() };
    for (name, log2) in [("glass and shapes", 8), ("glass and shapes, fine", 11), ("plant", 10)] {
        match name {
            "plant" => build_model(plant(&settings), log2, &path),
            _ => build_model(random_model(9, 80, DVec3::new(1e5, -2e5, 3e4)), log2, &path),
        }
        let mut loaded = load(&path);
        let bounds = loaded.scene().meta().bounds;
        let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
        let outside = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, 200, 140);
        let centre = 0.5 * (min + max);
        let inside = Camera { eye: (centre + 0.01 * (max - min)).into(), target: max.into(), ..outside };
        let settings = QuerySettings { rays_per_pixel: "2".parse().unwrap(), ..QuerySettings::default() };
        let mut small = context.clone();
        let bytes = 4 * loaded.query().dag.words().len() as u64;
        small.limit_bindings((bytes / 2).next_power_of_two().max(1 << 14));
        for (context, kind) in [(context, "one slab"), (&small, "paged")] {
            let mut gpu = GpuQuery::new(context, &loaded.query(), settings).unwrap();
            for camera in [outside, inside] {
                let scene = loaded.query();
                let found = checked(&gpu, &scene, &camera, name);
                let rays = camera.rays().unwrap();
                let cpu = query(&scene, &rays, Method::Voxel, &settings);
                let off: u64 =
                    found.samples.iter().zip(&cpu.samples).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
                println!("{name}, {kind}: {} rays, {} hits, {off} samples off f64's", found.rays, found.hits);
                assert_eq!(found.rays, cpu.rays);
                assert!(found.hits > 500 && off as f64 <= 0.005 * found.hits as f64, "{name}: {off}");
                let framed = gpu.frame(&scene, &rays, &Silent).unwrap();
                assert_eq!(framed.found, found);
            }
        }
        // Hidden, and cut away.
        let seen = query(&loaded.query(), &outside.rays().unwrap(), Method::Voxel, &settings);
        let hidden: Vec<u32> =
            (0..).zip(&seen.visible).filter(|(_, v)| **v).map(|(d, _)| d).step_by(3).collect();
        hidden.iter().for_each(|&drawable| loaded.filter_mut().set_hidden(drawable, true));
        loaded.filter_mut().clip_by(Plane { normal: DVec3::new(-1.0, 0.2, 0.1), point: centre });
        let scene = loaded.query();
        let gpu = GpuQuery::new(context, &scene, settings).unwrap();
        let found = checked(&gpu, &scene, &outside, name);
        assert!(
            hidden.iter().all(|&drawable| !found.visible[drawable as usize]),
            "{name}: hidden ones are seen"
        );
        assert!(found.visible_count() > 3 && found.visible_count() < seen.visible_count(), "{name}");
    }
}

//! The voxel core on the sample plant: voxelization (triangles and voxels a second) and scalar ray casting (rays a
//! second), beside obvhs through the triangles. Medians of five; the answers are checked before anything is timed.
//!
//! `cargo bench --bench voxel -- [--resolution-log2 12]`
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::Instant;

use common::{build_model, load};
use voxsight::camera::{Camera, Projection};
use voxsight::sample::{PlantSettings, cameras, plant};
use voxsight::visibility::{Method, QuerySettings, query};

const RUNS: usize = 5;

fn median_seconds(mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..RUNS)
        .map(|_| {
            let started = Instant::now();
            work();
            started.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[RUNS / 2]
}

fn main() {
    let mut args = std::env::args().skip_while(|a| a != "--resolution-log2");
    let log2 = args.nth(1).map_or(12, |text| text.parse().unwrap());
    let settings = PlantSettings::default();
    let model = plant(&settings);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.vxs");

    let triangles = model.placed_triangles() as f64;
    let seconds = median_seconds(|| build_model(model.clone(), log2, &path));
    let loaded = load(&path);
    let voxels = loaded.scene().meta().dag.voxel_count as f64;
    println!(
        "build plant 2,000 objects, 2^{log2}: {seconds:.2} s, {:.2} M triangles/s, {:.1} M voxels/s",
        triangles / seconds / 1e6,
        voxels / seconds / 1e6
    );

    for view in cameras(&settings) {
        let camera = Camera {
            eye: view.eye,
            target: view.target,
            up: view.up,
            projection: Projection::Perspective { fov_y_deg: view.fov_y_deg },
            width: 512,
            height: 512,
        };
        let rays = camera.rays().unwrap();
        let scene = loaded.query();
        let ask = |method| query(&scene, &rays, method, &QuerySettings::default());
        let exact = ask(Method::Exact);
        assert_eq!(ask(Method::Hybrid), exact, "hybrid differs from exact: its time means nothing");
        for method in [Method::Voxel, Method::Hybrid, Method::Exact] {
            let seconds = median_seconds(|| {
                black_box(ask(method));
            });
            let rate = exact.rays as f64 / seconds / 1e6;
            println!("{:<9} {method:?}: {rate:.2} Mrays/s, {} hits", view.name, exact.hits);
        }
    }
}

//! What a visibility query takes, and how wrong it is: every method at one ray per pixel over the six views of the bench of
//! rays, beside obvhs through all level-0 triangles in one hierarchy (the better of CWBVH and BVH2).
//!
//! `cargo bench --bench visibility -- [--size 1024] [--runs 5] [--resolution-log2 12] [--threads N] [--only METHOD] [SCENE.vxs|MODEL..]`
//! Without scenes: the sample plant of a million triangles. `hybrid` is compared with `exact` before it is timed; lost
//! pixels are those of DESIGN's definition, against 16 other exact rays per pixel.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "rays/rivals.rs"]
#[allow(dead_code, reason = "made for the bench of rays, which uses all of it")]
mod rivals;
#[path = "rays/views.rs"]
#[allow(dead_code, reason = "made for the bench of rays, which uses all of it")]
mod views;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use voxsight::camera::{Camera, CameraRays, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::sample::{PlantSettings, plant};
use voxsight::visibility::{Method, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query};

use rivals::Rivals;
use views::views;

struct Options {
    size: usize,
    runs: usize,
    log2: u32,
    threads: usize,
    /// This method alone, so many times for each view, for a profiler.
    only: Option<Method>,
    scenes: Vec<PathBuf>,
}

fn options() -> Options {
    let mut options = Options { size: 1024, runs: 5, log2: 12, threads: 0, only: None, scenes: Vec::new() };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        if arg == "--only" {
            options.only = Some(match args.next().as_deref() {
                Some("exact") => Method::Exact,
                Some("voxel") => Method::Voxel,
                _ => Method::Hybrid,
            });
            continue;
        }
        let mut value = || args.next().expect("a value").parse::<usize>().expect("a number");
        match arg.as_str() {
            "--bench" => {}
            "--size" => options.size = value(),
            "--runs" => options.runs = value(),
            "--resolution-log2" => options.log2 = value() as u32,
            "--threads" => options.threads = value(),
            path => options.scenes.push(path.into()),
        }
    }
    options
}

fn main() {
    let options = options();
    rayon::ThreadPoolBuilder::new().num_threads(options.threads).build_global().unwrap();
    let folder = tempfile::tempdir().unwrap();
    if options.scenes.is_empty() {
        let path = folder.path().join("plant.vxs");
        let settings = PlantSettings { objects: 4_000, triangles: 1_000_000, ..PlantSettings::default() };
        common::build_model(plant(&settings), options.log2, &path);
        run(&options, &path);
    }
    for scene in &options.scenes {
        if scene.extension().is_some_and(|e| e == "vxs") {
            run(&options, scene);
        } else {
            let path = folder.path().join("model.vxs");
            common::build_file(scene, options.log2, &path);
            println!("{}", scene.display());
            run(&options, &path);
        }
    }
}

/// Median of some runs, milliseconds.
fn milliseconds(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let started = Instant::now();
            work();
            started.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    0.5 * (times[(runs - 1) / 2] + times[runs / 2])
}

fn run(options: &Options, path: &Path) {
    let loaded: LoadedScene = common::load(path);
    let scene = loaded.query();
    println!(
        "{}: 2^{}, {} triangles, {} threads; milliseconds, and lost pixels in percent",
        path.display(),
        scene.grid.log2,
        loaded.scene().meta().counts.placed_triangles,
        rayon::current_num_threads()
    );
    if let Some(method) = options.only {
        for view in views(loaded.scene(), options.size) {
            let rays = camera(&view.camera, options.size);
            let time = milliseconds(options.runs, || {
                black_box(query(&scene, &rays, method, &QuerySettings::default()));
            });
            println!("{}: {time:.1}", view.name);
        }
        return;
    }
    println!("| view | obvhs | exact | hybrid | voxel | hybrid to obvhs |\n|{}", " --- |".repeat(6));
    let rivals = Rivals::build(loaded.scene());
    let pixels = (options.size * options.size) as u64;
    for view in views(loaded.scene(), options.size) {
        let rays = camera(&view.camera, options.size);
        let ask = |method, settings: &QuerySettings| query(&scene, &rays, method, settings);
        let once = QuerySettings::default();
        let fine = QuerySettings { rays_per_pixel: RaysPerPixel::rays(16), first_sample: 1, ..once };
        let reference = ask(Method::Exact, &fine);
        let lost = |answer: &VisibleSet| {
            100.0 * accuracy(&reference, answer, pixels, |d| scene.exact.triangle_count(d)).lost_pixels
        };
        assert_eq!(
            ask(Method::Hybrid, &once),
            ask(Method::Exact, &once),
            "hybrid differs from exact: its time means nothing"
        );
        let mut row = format!("| {} ", view.name);
        let wide = milliseconds(options.runs, || {
            black_box(rivals.cwbvh(loaded.scene(), &view.camera));
        });
        let binary = milliseconds(options.runs, || {
            black_box(rivals.bvh2(loaded.scene(), &view.camera));
        });
        let obvhs = wide.min(binary);
        row += &format!("| {obvhs:.1} ");
        let mut hybrid = 0.0;
        for method in [Method::Exact, Method::Hybrid, Method::Voxel] {
            let time = milliseconds(options.runs, || {
                black_box(ask(method, &once));
            });
            if method == Method::Hybrid {
                hybrid = time;
            }
            row += &format!("| {time:.1}, {:.4} ", lost(&ask(method, &once)));
        }
        println!("{row}| {:.2} |", obvhs / hybrid);
    }
}

/// The same rays.
fn camera(pinhole: &views::Pinhole, size: usize) -> CameraRays {
    let camera = Camera {
        eye: pinhole.eye.into(),
        target: pinhole.target.into(),
        up: pinhole.up.into(),
        projection: Projection::Perspective { fov_y_deg: 60.0 },
        width: size as u32,
        height: size as u32,
    };
    camera.rays().unwrap()
}

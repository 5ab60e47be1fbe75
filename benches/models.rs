//! Every real model through the main job: build (own process, so that its peak memory is its own), verify, and what
//! three cameras see by `voxel`, `hybrid` and `exact` at 1 ray per pixel, against 16 exact rays per pixel.
//!
//! `cargo bench --bench models -- [--size 512] [--resolution 4096] [NAME ...]` prints a Markdown table; the folder of
//! models is `VOXSIGHT_MODELS`, default `../shared/models`. Errors are the worst of the three cameras; times are sums.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::process::Command;
use std::time::Instant;

use common::{load, model_files, models_folder};
use glam::DVec3;
use voxsight::camera::{Camera, Projection};
use voxsight::container::verify;
use voxsight::loaded::LoadedScene;
use voxsight::progress::Silent;
use voxsight::visibility::{Accuracy, Method, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query};

/// Worst errors over the cameras, and time, of one method.
#[derive(Default)]
struct Row {
    lost_pixels: f64,
    hidden_16_px: f64,
    hidden: f64,
    seconds: f64,
    /// Lost pixels less what the floor allows (1.2 times, and 0.02 percentage points), worst camera.
    over_the_bound: f64,
}

fn main() {
    let mut size = 512;
    let mut resolution = "4096".to_owned();
    let mut names = Vec::new();
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--size" => size = args.next().unwrap().parse().unwrap(),
            "--resolution" => resolution = args.next().unwrap(),
            _ => names.push(arg),
        }
    }
    let Some(models) = models_folder() else { return };
    println!(
        "| model | triangles | objects | build s | Mtri/s | file MB | geometry B/tri | bits/voxel | owners B/brick | \
         peak MB | floor lost % | hybrid lost % | voxel lost % | floor / hybrid / voxel hidden >= 16 px % | \
         exact / hybrid / voxel s | hybrid within bound |"
    );
    println!("|{}", " --- |".repeat(16));
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.vxs");
    let mut worst: f64 = f64::NEG_INFINITY;
    for file in model_files(&models) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        if !names.is_empty() && !names.iter().any(|wanted| name.contains(wanted.as_str())) {
            continue;
        }
        let output = Command::new(env!("CARGO_BIN_EXE_voxsight"))
            .args(["build", "--quiet", "--json", "--resolution", &resolution, "-o"])
            .args([&scene, &file])
            .output()
            .unwrap();
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        verify(&scene, &Silent).unwrap();
        let loaded = load(&scene);
        let [floor, hybrid, voxel] = measure(&loaded, size);
        worst = worst.max(hybrid.over_the_bound);
        print_row(&name, &report, &loaded, &floor, &hybrid, &voxel);
    }
    println!("\nhybrid's lost pixels less 1.2 x floor + 0.02 points, worst: {:.4} points", 100.0 * worst);
}

/// `exact` (the sampling floor), `hybrid` and `voxel` at 1 ray per pixel over three cameras.
fn measure(loaded: &LoadedScene, size: u32) -> [Row; 3] {
    let mut rows = [Row::default(), Row::default(), Row::default()];
    rows.iter_mut().for_each(|row| row.over_the_bound = f64::NEG_INFINITY);
    for camera in cameras(loaded, size) {
        let rays = camera.rays().unwrap();
        let scene = loaded.query();
        // The reference begins after the answers' sample: they share no ray.
        let fine = QuerySettings {
            rays_per_pixel: RaysPerPixel::rays(16),
            first_sample: 1,
            ..QuerySettings::default()
        };
        let reference = query(&scene, &rays, Method::Exact, &fine);
        let pixels = u64::from(size) * u64::from(size);
        let compare =
            |answer: &VisibleSet| accuracy(&reference, answer, pixels, |d| scene.exact.triangle_count(d));
        let mut floor = None;
        for (row, method) in rows.iter_mut().zip([Method::Exact, Method::Hybrid, Method::Voxel]) {
            let started = Instant::now();
            let answer = query(&scene, &rays, method, &QuerySettings::default());
            row.seconds += started.elapsed().as_secs_f64();
            let found: Accuracy = compare(&answer);
            let floor = *floor.get_or_insert(found.lost_pixels);
            row.lost_pixels = row.lost_pixels.max(found.lost_pixels);
            row.hidden = row.hidden.max(found.wrongly_hidden_rate());
            row.hidden_16_px = row.hidden_16_px.max(found.classes[2].rate());
            row.over_the_bound = row.over_the_bound.max(found.lost_pixels - 1.2 * floor - 0.0002);
        }
    }
    rows
}

/// Two from outside, one from within the box.
fn cameras(loaded: &LoadedScene, size: u32) -> [Camera; 3] {
    let bounds = loaded.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let outside = Camera::around(min, max, DVec3::new(0.7, 0.5, 0.9), DVec3::Y, size, size);
    let other_side = Camera::around(min, max, DVec3::new(-0.9, 0.3, -0.4), DVec3::Y, size, size);
    let inside = DVec3::from(outside.eye).lerp(min + 0.5 * (max - min), 0.85);
    [
        outside,
        other_side,
        Camera { eye: inside.into(), projection: Projection::Perspective { fov_y_deg: 75.0 }, ..outside },
    ]
}

fn print_row(
    name: &str,
    report: &serde_json::Value,
    loaded: &LoadedScene,
    floor: &Row,
    hybrid: &Row,
    voxel: &Row,
) {
    let number = |path: &str| report.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
    let container = loaded.scene().container();
    let geometry = container.section_length(voxsight::container::layout::SectionKind::Geometry);
    let stages = report["stages"].as_array().unwrap();
    let peak = stages.iter().filter_map(|stage| stage["peak_bytes"].as_f64()).fold(0.0, f64::max);
    println!(
        "| {name} | {} | {} | {:.2} | {:.2} | {:.1} | {:.2} | {:.2} | {:.2} | {:.0} | {:.4} | {:.4} | {:.4} | \
         {:.2} / {:.2} / {:.2} | {:.2} / {:.2} / {:.2} | {} |",
        number("/meta/counts/placed_triangles"),
        number("/meta/counts/objects"),
        number("/seconds"),
        number("/triangles_per_second") / 1e6,
        number("/file_bytes") / 1e6,
        geometry as f64 / number("/meta/counts/unique_triangles"),
        number("/report/statistics/dag_bits_per_voxel"),
        number("/report/statistics/owner_bytes") / number("/meta/dag/brick_count"),
        peak / 1e6,
        100.0 * floor.lost_pixels,
        100.0 * hybrid.lost_pixels,
        100.0 * voxel.lost_pixels,
        100.0 * floor.hidden_16_px,
        100.0 * hybrid.hidden_16_px,
        100.0 * voxel.hidden_16_px,
        floor.seconds,
        hybrid.seconds,
        voxel.seconds,
        if hybrid.over_the_bound <= 0.0 { "yes" } else { "NO" },
    );
}

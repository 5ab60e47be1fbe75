//! A walk without a GPU: what each frame asks, selects, streams, and how long that takes; the memory is plain.
//!
//! `cargo bench --bench streaming -- [--triangles 4M] [--budget-mb 64] [--upload-mb 4] [--size 1024x640] [--rays 16] [--frames 200]
//! [--step 0.05] [--ahead 10] [SCENE.vxs]`
//! The path: around the plant from outside, a cut to the place where people stand under its first rack, and along it, `--step` metres a
//! frame. Without a scene: the sample plant of 12 M triangles. Queries cast one ray for `--rays` pixels and keep what they found.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use voxsight::camera::{Camera, Projection};
use voxsight::lod::density::{self, DensitySettings};
use voxsight::lod::{Choice, ChunkLevels, Selection, candidates};
use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight::scene::Scene;
use voxsight::streaming::{ContainerPages, Frame, Loader, Priority, StreamSettings, Streamer, predicted};
use voxsight::visibility::coherent::CoherentQuery;
use voxsight::visibility::culling::Culling;
use voxsight::visibility::{Method, QuerySettings, RayMethod, RaysPerPixel, query};

struct Options {
    triangles: u64,
    budget: u64,
    upload: u64,
    size: (u32, u32),
    rays: u32,
    frames: u32,
    step: f64,
    /// Frames between now and the predicted camera; 0 for none.
    ahead: f64,
    scene: Option<PathBuf>,
}

fn options() -> Options {
    let mut options = Options {
        triangles: 4_000_000,
        budget: 64 << 20,
        upload: 4 << 20,
        size: (1024, 640),
        rays: 16,
        frames: 200,
        step: 0.05,
        ahead: 10.0,
        scene: None,
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().expect("a value");
        match arg.as_str() {
            "--bench" => {}
            "--triangles" => options.triangles = value().parse().expect("a number"),
            "--budget-mb" => options.budget = value().parse::<u64>().expect("a number") << 20,
            "--upload-mb" => options.upload = value().parse::<u64>().expect("a number") << 20,
            "--size" => {
                let text = value();
                let (width, height) = text.split_once('x').expect("WxH");
                options.size = (width.parse().expect("a number"), height.parse().expect("a number"));
            }
            "--rays" => options.rays = value().parse().expect("a number"),
            "--frames" => options.frames = value().parse().expect("a number"),
            "--ahead" => options.ahead = value().parse().expect("frames"),
            "--step" => options.step = value().parse().expect("metres"),
            scene => options.scene = Some(scene.into()),
        }
    }
    options
}

/// The camera of a frame, and whether it has jumped.
fn camera(options: &Options, frame: u32, bounds: (DVec3, DVec3)) -> (Camera, bool) {
    let outside = options.frames / 4;
    let (min, max) = bounds;
    let (width, height) = options.size;
    let up = [0.0, 1.0, 0.0];
    if frame < outside {
        let turn = 0.6 + 0.3 * f64::from(frame) / f64::from(outside.max(1));
        let from = DVec3::new(turn.cos(), 0.5, turn.sin());
        (Camera::around(min, max, from, DVec3::Y, width, height), frame == 0)
    } else {
        let x = 1.6 + options.step * f64::from(frame - outside);
        let eye = [x, 1.9, 15.2];
        let projection = Projection::Perspective { fov_y_deg: 60.0 };
        (Camera { eye, target: [x + 12.8, 3.4, 17.0], up, projection, width, height }, frame == outside)
    }
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

fn main() {
    let options = options();
    let folder = tempfile::tempdir().unwrap();
    let path = options.scene.clone().unwrap_or_else(|| {
        let path = folder.path().join("plant.vxs");
        let settings = PlantSettings { objects: 45_000, triangles: 12_000_000, ..PlantSettings::default() };
        common::build_model(plant(&settings), 12, &path);
        path
    });
    let loaded = common::load(&path);
    let pages = Arc::new(ContainerPages(Arc::new(Scene::open(&path).unwrap())));
    let loader = Loader::new(Arc::clone(&pages) as _, 1).unwrap();
    let levels = ChunkLevels::new(loaded.scene());
    let settings =
        StreamSettings { budget: options.budget, upload: options.upload, ..StreamSettings::default() };
    let mut memory = vec![0; options.budget as usize];
    let mut streamer = Streamer::new(settings);
    let scene = loaded.query();
    let bounds = loaded.scene().meta().bounds;
    let bounds = (bounds.min.into(), bounds.max.into());
    let rays_per_pixel: RaysPerPixel = format!("1/{}", options.rays).parse().unwrap();
    let mut visible = CoherentQuery::of(RayMethod::Hybrid, rays_per_pixel);
    let (mut last, mut before): (Option<Selection>, Option<Camera>) = (None, None);
    let (mut substituted, mut drawn) = (0u64, 0u64);
    let mut times = [const { Vec::new() }; 4];
    let (mut smooth, mut since_cut, mut missing_late) = (Vec::new(), 0u32, 0u32);
    println!(
        "| frame | visible | drawn | substituted | missing | triangles | written KB | resident MB | query ms | select ms | stream ms |\n|{}",
        " --- |".repeat(11)
    );
    for frame in 0..options.frames {
        let (camera, is_cut) = camera(&options, frame, bounds);
        let rays = camera.rays().unwrap();
        let started = Instant::now();
        let seen = visible.frame(&scene, &rays, &Silent).unwrap().found;
        let query_ms = started.elapsed().as_secs_f64() * 1e3;

        let started = Instant::now();
        let views = candidates(scene.exact, &rays, &seen);
        let lod = DensitySettings { budget: options.triangles, ..DensitySettings::default() };
        let selection = density::select(&levels, &views, &lod, last.as_ref());
        assert!(selection.triangles <= options.triangles, "over the budget of triangles");
        let select_ms = started.elapsed().as_secs_f64() * 1e3;

        let priority =
            |choice: &Choice| Priority { choice: *choice, samples: seen.samples[choice.drawable as usize] };
        let wanted: Vec<Priority> = selection.choices.iter().map(priority).collect();
        let in_view = query(&scene, &rays, Method::Frustum, &QuerySettings::default());
        let in_frustum: Vec<u32> = (0..).zip(&in_view.visible).filter(|(_, v)| **v).map(|(d, _)| d).collect();
        let started = Instant::now();
        // What will be seen soon, at the levels that it will have then.
        let soon = before.filter(|_| !is_cut && options.ahead > 0.0);
        let soon = soon.and_then(|before| predicted(&before, &camera, options.ahead));
        let expected: Vec<Priority> = soon.map_or_else(Vec::new, |soon| {
            let rays = soon.rays().unwrap();
            let few = QuerySettings { rays_per_pixel, ..QuerySettings::default() };
            let seen = query(&scene, &rays, Method::Voxel, &few);
            let selection = density::select(&levels, &candidates(scene.exact, &rays, &seen), &lod, None);
            let samples = |choice: &Choice| seen.samples[choice.drawable as usize];
            selection.choices.iter().map(|c| Priority { choice: *c, samples: samples(c) }).collect()
        });
        before = Some(camera);
        let predict_ms = started.elapsed().as_secs_f64() * 1e3;
        let started = Instant::now();
        let what = Frame { wanted: &wanted, in_frustum: &in_frustum, expected: &expected };
        let bytes_of = |page: u32| pages.bytes_of(page);
        let (report, requests) = streamer.frame(&levels, &what, &bytes_of, loader.fetch(), &mut memory);
        loader.request(&requests);
        let stream_ms = started.elapsed().as_secs_f64() * 1e3;
        assert!(report.resident <= options.budget && report.failed.is_empty());

        since_cut = if is_cut { 0 } else { since_cut + 1 };
        if since_cut > 3 {
            missing_late += report.missing;
        }
        if since_cut > 30 {
            substituted += u64::from(report.substituted);
            drawn += report.drawn.len() as u64;
            smooth.push(100.0 * report.written as f64 / report.resident as f64);
        }
        for (times, time) in times.iter_mut().zip([query_ms, select_ms, predict_ms, stream_ms]) {
            times.push(time);
        }
        if since_cut < 6 || frame % 20 == 0 {
            println!(
                "| {frame}{} | {} | {} | {} | {} | {} | {:.0} | {:.2} | {query_ms:.1} | {select_ms:.2} | {stream_ms:.2} |",
                if is_cut { ", cut" } else { "" },
                views.len(),
                report.drawn.len(),
                report.substituted,
                report.missing,
                selection.triangles,
                report.written as f64 / 1e3,
                report.resident as f64 / 1e6,
            );
        }
        last = Some(selection);
    }
    for (name, times) in ["query", "select", "predict", "stream"].iter().zip(&mut times) {
        let [half, most, worst] = [0.5, 0.95, 1.0].map(|share| percentile(times, share));
        println!("{name}: median {half:.2} ms, 95 % {most:.2}, worst {worst:.2}");
    }
    let mean = smooth.iter().sum::<f64>() / smooth.len().max(1) as f64;
    println!(
        "written in smooth motion: {mean:.3} % of what is resident a frame, 95 % {:.3}",
        percentile(&mut smooth, 0.95)
    );
    println!(
        "drawn coarser or finer than wanted in smooth motion: {substituted} of {drawn}, all frames together"
    );
    println!("missing later than 3 frames after a cut: {missing_late}");
}

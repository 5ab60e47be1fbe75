//! Box-based occlusion culling: M triangles/s of the depth rasterizer with everything as occluder, then the stages of
//! `hzm` and `hzb` with both errors against `exact` at 16 rays per pixel. Depth images are compared with
//! rays before anything is timed.
//!
//! `cargo bench --bench occlusion -- [--size 1024] [--runs 9] [--view outside] [SCENE.vxs|MODEL..]`
//! Without scenes: the sample plant of a million triangles.
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

use fearless_simd::Level;
use glam::DVec3;
use voxsight::camera::{Camera, CameraRays, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::occlusion::OcclusionScene;
use voxsight::occlusion::hzb::{Hzb, HzbSettings};
use voxsight::occlusion::hzm::{Hzm, HzmSettings};
use voxsight::occlusion::raster::{DepthImage, Rasterizer};
use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight::visibility::culling::{CulledFrame, Culling};
use voxsight::visibility::{Jitter, Method, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query};

struct Options {
    size: u32,
    runs: usize,
    view: Option<String>,
    scenes: Vec<PathBuf>,
}

fn options() -> Options {
    let mut options = Options { size: 1024, runs: 9, view: None, scenes: Vec::new() };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().expect("a value");
        match arg.as_str() {
            "--bench" => {}
            "--size" => options.size = value().parse().unwrap(),
            "--runs" => options.runs = value().parse().unwrap(),
            "--view" => options.view = Some(value()),
            path => options.scenes.push(path.into()),
        }
    }
    options
}

fn main() {
    let options = options();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    if options.scenes.is_empty() {
        let settings = PlantSettings { objects: 4_000, triangles: 1_000_000, ..PlantSettings::default() };
        common::build_model(plant(&settings), 8, &path);
        run(&options, "plant, 1 M triangles", &common::load(&path));
    }
    for scene in &options.scenes {
        let name = scene.display().to_string();
        if scene.extension().is_some_and(|e| e == "vxs") {
            run(&options, &name, &common::load(scene));
        } else {
            common::build_file(scene, 8, &path);
            run(&options, &name, &common::load(&path));
        }
    }
}

/// From outside, and twice from inside at the height of people: across, and along the longer side.
fn views(loaded: &LoadedScene, size: u32) -> Vec<(&'static str, Camera)> {
    let bounds = loaded.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let (centre, extent) = (0.5 * (min + max), max - min);
    let outside = Camera::around(min, max, DVec3::new(-0.6, -0.7, 0.4), DVec3::Z, size, size);
    let inside = |eye: DVec3, towards: DVec3| Camera {
        eye: eye.into(),
        target: (eye + towards).into(),
        projection: Projection::Perspective { fov_y_deg: 60.0 },
        ..outside
    };
    let long = if extent.x >= extent.y { DVec3::X } else { DVec3::Y };
    let low = centre - DVec3::Z * 0.3 * extent.z;
    vec![
        ("outside", outside),
        ("inside", inside(low + DVec3::new(0.2, 0.15, 0.0) * extent, DVec3::new(-1.0, -0.7, -0.05))),
        ("along", inside(low - 0.42 * extent * long, long + DVec3::new(0.01, 0.02, -0.003))),
    ]
}

fn run(options: &Options, name: &str, loaded: &LoadedScene) {
    let exact = loaded.query().exact;
    let started = Instant::now();
    let scene = Arc::new(OcclusionScene::new(exact));
    let scene_ms = 1e3 * started.elapsed().as_secs_f64();
    let started = Instant::now();
    let candidates = Hzm::new(scene.clone(), exact, HzmSettings::default()).candidate_count();
    let compactness_ms = 1e3 * started.elapsed().as_secs_f64();
    let triangles: u64 = (0..exact.drawable_count()).map(|d| u64::from(exact.triangle_count(d))).sum();
    println!(
        "{name}: {} drawables, {triangles} triangles; scene {scene_ms:.0} ms, compactness {compactness_ms:.0} ms, {candidates} candidates",
        exact.drawable_count()
    );
    for (view, camera) in views(loaded, options.size) {
        if options.view.as_ref().is_some_and(|name| name != view) {
            continue;
        }
        let rays = camera.rays().unwrap();
        let covered = check(&scene, loaded, &rays);
        println!("\n{view}: {:.1} % of the pixels covered", 100.0 * covered);
        raster(options, &scene, loaded, &rays, triangles);
        methods(options, &scene, loaded, &rays);
    }
}

/// The depth image of everything is what rays through the centres of every 7th pixel say. Returns the part that is covered.
fn check(scene: &OcclusionScene, loaded: &LoadedScene, rays: &CameraRays) -> f64 {
    let (view, (width, height), query) = (scene.view(rays), rays.size(), loaded.query());
    let mut image = DepthImage::new(width, height);
    let all = 0..query.exact.drawable_count();
    scene.draw(&mut Rasterizer::default(), all, &view, query.filter, &mut image);
    let (mut pixels, mut hits, mut ties) = (0, 0, 0);
    for row in (0..height).step_by(7) {
        for column in (0..width).step_by(7) {
            let ray = rays.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let hit = query.exact.closest_through(&ray, query.filter, |_| {});
            let expected = hit
                .map_or(f64::NEG_INFINITY, |hit| view.point(ray.at(hit.t)).a / view.point(ray.at(hit.t)).h);
            let found = f64::from(image.at(column, row));
            let same = found == expected || ((1.0 - 5e-4)..(1.0 + 1e-6)).contains(&(found / expected));
            (pixels, hits, ties) = (pixels + 1, hits + u32::from(hit.is_some()), ties + u32::from(!same));
        }
    }
    assert!(ties <= 1, "wrong depth at {ties} of {pixels} pixels: timing means nothing");
    f64::from(hits) / f64::from(pixels)
}

/// All triangles as occluders, as NOTES on other rasterizers have it: what is outside of the image counts too.
fn raster(
    options: &Options,
    scene: &OcclusionScene,
    loaded: &LoadedScene,
    rays: &CameraRays,
    triangles: u64,
) {
    let (view, (width, height), query) = (scene.view(rays), rays.size(), loaded.query());
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let all = rayon::ThreadPoolBuilder::new().build().unwrap();
    let levels = [(Level::baseline(), &one), (Level::new(), &one), (Level::new(), &all)];
    for (level, pool) in levels {
        let mut rasterizer = Rasterizer::new(level);
        let mut image = DepthImage::new(width, height);
        let seconds = median((0..options.runs).map(|_| {
            let started = Instant::now();
            pool.install(|| {
                image.clear(width, height);
                let all = 0..query.exact.drawable_count();
                scene.draw(&mut rasterizer, all, &view, query.filter, &mut image);
            });
            started.elapsed().as_secs_f64()
        }));
        println!(
            "  raster, everything, {level:?}, {} threads: {:.2} ms, {:.1} M triangles/s",
            pool.current_num_threads(),
            1e3 * seconds,
            triangles as f64 / seconds / 1e6
        );
    }
}

fn methods(options: &Options, scene: &Arc<OcclusionScene>, loaded: &LoadedScene, rays: &CameraRays) {
    let (exact, (width, height)) = (loaded.query().exact, rays.size());
    let pixels = u64::from(width) * u64::from(height);
    let settings = QuerySettings { rays_per_pixel: RaysPerPixel::rays(16), ..QuerySettings::default() };
    let reference = query(&loaded.query(), rays, Method::Exact, &settings);
    let middles = QuerySettings { jitter: Jitter::Regular, ..QuerySettings::default() };
    let centres = query(&loaded.query(), rays, Method::Exact, &middles);
    let frustum = query(&loaded.query(), rays, Method::Frustum, &QuerySettings::default());
    let report = |name: &str, answer: &VisibleSet| {
        let found = accuracy(&reference, answer, pixels, |drawable| exact.triangle_count(drawable));
        println!(
            "  {name}: {} shown of {} visible; wrongly hidden {} ({:.3} %), lost pixels {:.5} %; needlessly drawn {} ({:.1} %)",
            found.answer,
            found.reference,
            found.wrongly_hidden,
            100.0 * found.wrongly_hidden_rate(),
            100.0 * found.lost_pixels,
            found.needlessly_drawn,
            100.0 * found.needlessly_drawn_rate()
        );
    };
    report("frustum", &frustum);
    report("exact, 1 ray (the sampling floor)", &centres);
    let hzm = |active_occluders, compactness_threshold, finer_levels| {
        let settings =
            HzmSettings { active_occluders, compactness_threshold, finer_levels, ..HzmSettings::default() };
        Box::new(Hzm::new(scene.clone(), exact, settings)) as Box<dyn Culling>
    };
    let hzb = |finer_levels| {
        let settings = HzbSettings { finer_levels, ..HzbSettings::default() };
        Box::new(Hzb::new(scene.clone(), settings)) as Box<dyn Culling>
    };
    let all = [
        ("hzm", hzm(16, 0.6, 0)),
        ("hzm, CT 0.3", hzm(16, 0.3, 0)),
        ("hzm, 256 occluders", hzm(256, 0.6, 0)),
        ("hzm, 2 finer levels", hzm(16, 0.6, 2)),
        ("hzb", hzb(0)),
        ("hzb, 1 finer level", hzb(1)),
        ("hzb, 2 finer levels", hzb(2)),
        ("hzb, to the pixel", hzb(32)),
    ];
    for (name, mut method) in all {
        let mut ask = || method.frame(&loaded.query(), rays, &Silent).unwrap();
        let first = ask();
        let frames: Vec<CulledFrame> = (0..options.runs).map(|_| ask()).collect();
        let missed =
            centres.visible.iter().zip(&frames[0].found.visible).filter(|(seen, shown)| **seen && !**shown);
        assert!(missed.count() <= 1, "{name} hides what a ray through a centre meets");
        report(name, &frames[0].found);
        print!(
            "    first frame {:.2} ms; then {:.2} ms:",
            1e3 * first.seconds(),
            1e3 * median(frames.iter().map(CulledFrame::seconds))
        );
        for (k, stage) in frames[0].stages.iter().enumerate() {
            print!(" {} {:.2},", stage.stage, 1e3 * median(frames.iter().map(|f| f.stages[k].seconds)));
        }
        println!(" {} threads", rayon::current_num_threads());
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

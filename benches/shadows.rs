//! Time of shadow rays against their error: voxels at several resolutions, `hybrid` and `exact`, of a sun and an occluded sky.
//!
//! `cargo bench --bench shadows -- [--size 384] [--spp 1,4,16,64] [--log2 11,12,13] [--sun-angle 0.53] [--chart OUT.svg]
//! [[--view inside] MODEL..]`
//! A view (of the bench of rays; `outside` is all of the model from a corner above) holds for the models after it. Without models: the sample plant of 12 M triangles, inside.
//! Prints what `voxsight render --report` prints; the chart has a row for each model.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "rays/views.rs"]
#[allow(dead_code, reason = "made for the bench of rays, which uses all of it")]
mod views;

use std::path::PathBuf;

use glam::DVec3;
use voxsight::camera::{Camera, Projection};
use voxsight::lab::chart::{Chart, charts_svg};
use voxsight::lab::shadows::{PictureReport, ShadowRun, panels};
use voxsight::loaded::LoadedScene;
use voxsight::progress::Silent;
use voxsight::render::{KeyLight, Lighting, RenderSettings, SUN_ANGLE_DEG, Shadows, Sky, Sun};
use voxsight::sample::{PlantSettings, plant};

/// The sky is occluded by what is within this share of the model's diagonal.
const REACH: f64 = 0.03;

struct Options {
    size: u32,
    samples: Vec<u32>,
    log2: Vec<u32>,
    sun_angle: f64,
    chart: Option<PathBuf>,
    /// Models, and from where.
    models: Vec<(Option<PathBuf>, String)>,
}

fn options() -> Options {
    let mut options = Options {
        size: 384,
        samples: vec![1, 4, 16, 64],
        log2: vec![11, 12, 13],
        sun_angle: SUN_ANGLE_DEG,
        chart: None,
        models: Vec::new(),
    };
    let numbers = |text: String| text.split(',').map(|n| n.parse().expect("a number")).collect();
    let mut view = "inside".to_owned();
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().expect("a value");
        match arg.as_str() {
            "--bench" => {}
            "--size" => options.size = value().parse().expect("a number"),
            "--spp" => options.samples = numbers(value()),
            "--log2" => options.log2 = numbers(value()),
            "--sun-angle" => options.sun_angle = value().parse().expect("degrees"),
            "--chart" => options.chart = Some(value().into()),
            "--view" => view = value(),
            "plant" => options.models.push((None, view.clone())),
            model => options.models.push((Some(model.into()), view.clone())),
        }
    }
    if options.models.is_empty() {
        options.models.push((None, view));
    }
    options
}

fn main() {
    let options = options();
    let folder = tempfile::tempdir().unwrap();
    let mut charts: Vec<Chart> = Vec::new();
    for (model, view) in &options.models {
        let scene = |&log2: &u32| -> LoadedScene {
            let path = folder.path().join(format!("{log2}.vxs"));
            match model {
                Some(model) => common::build_file(model, log2, &path),
                None => {
                    let settings =
                        PlantSettings { objects: 45_000, triangles: 12_000_000, ..PlantSettings::default() };
                    common::build_model(plant(&settings), log2, &path);
                }
            }
            common::load(&path)
        };
        let name = model.as_ref().and_then(|model| model.file_stem()).map(|stem| stem.to_string_lossy());
        let name = format!("{}, {view}", name.unwrap_or("plant".into()));
        let scenes: Vec<LoadedScene> = options.log2.iter().map(scene).collect();
        let pictures = run(&options, &scenes, view);
        println!("{name}");
        print(&pictures);
        // One curve for hybrid is enough: at every resolution it is wrong by next to nothing.
        let finest = options.log2.iter().max().map(|log2| 1 << log2);
        let shown = pictures.into_iter().filter(|p| p.shadows != "hybrid" || p.resolution == finest);
        charts.extend(panels(&name, &shown.collect::<Vec<_>>()));
    }
    if let Some(path) = &options.chart {
        std::fs::write(path, charts_svg(&charts, 1400, 2).unwrap()).unwrap();
    }
}

fn run(options: &Options, scenes: &[LoadedScene], view: &str) -> Vec<PictureReport> {
    let finest = scenes.last().expect("a resolution");
    let meta = finest.scene().meta();
    let (bounds, up) = (meta.bounds, meta.settings.up.unit());
    let camera = match view {
        "outside" => {
            let side = DVec3::new(up.y, up.z, up.x);
            let from = 0.55 * up + 0.8 * side + 0.6 * up.cross(side);
            Camera::around(bounds.min.into(), bounds.max.into(), from, up, options.size, options.size)
        }
        name => {
            let views = views::views(finest.scene(), options.size as usize);
            let view = views.iter().find(|view| view.name == name);
            let pinhole = &view.expect("a view: outside, or one of the bench of rays").camera;
            Camera {
                eye: pinhole.eye.into(),
                target: pinhole.target.into(),
                up: up.into(),
                projection: Projection::Perspective { fov_y_deg: 60.0 },
                width: options.size,
                height: options.size,
            }
        }
    };
    let diagonal = (DVec3::from(bounds.max) - DVec3::from(bounds.min)).length();
    let direction = Sun::default_direction(up);
    let settings = RenderSettings {
        samples_per_pixel: 1,
        lighting: Lighting {
            key: KeyLight::Sun(Sun { direction, angle_deg: options.sun_angle }),
            sky: Sky::Occluded { reach: REACH * diagonal },
            areas: Vec::new(),
            fill: 1.0,
        },
        shadows: Shadows::HYBRID,
        up,
        seed: 0,
    };
    let camera = camera.rays().unwrap();
    let run = ShadowRun { scenes, camera: &camera, settings: &settings, samples: &options.samples };
    run.run(&Silent).unwrap().pictures.into_iter().map(|picture| picture.report).collect()
}

fn print(pictures: &[PictureReport]) {
    println!(
        "| shadows | samples | light | M rays a second and thread | wrongly dark, % | wrongly lit, % | penumbra error, % | error against converged, % |\n|{}",
        " --- |".repeat(8)
    );
    for picture in pictures {
        let name = match picture.resolution {
            Some(side) => format!("{} {side}^3", picture.shadows),
            None => picture.shadows.to_owned(),
        };
        for (light, time) in picture.lights.iter().zip(&picture.time) {
            let same = light.same_samples.unwrap_or_default();
            println!(
                "| {name} | {} | {} | {:.2} | {:.3} | {:.3} | {:.2} | {:.3} |",
                picture.samples_per_pixel,
                light.light,
                time.mrays,
                100.0 * same.wrongly_dark,
                100.0 * same.wrongly_lit,
                100.0 * same.penumbra_error,
                100.0 * light.converged.mean_error
            );
        }
    }
}

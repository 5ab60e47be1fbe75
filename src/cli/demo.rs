//! `voxsight demo`: the whole way, from a model to what a camera sees, on an embedded sample plant.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use glam::DVec3;
use serde::Serialize;

use super::Failure;
use super::numbers::{parse_resolution, parse_size};
use super::output::{human_bytes, print_out, write_json, write_png};
use super::progress::TerminalProgress;
use crate::camera::{Camera, CameraRays, Projection};
use crate::container::Axis;
use crate::human::grouped;
use crate::loaded::LoadedScene;
use crate::prepare::{BuildOutcome, BuildSettings, Resolution, build};
use crate::progress::Progress;
use crate::render::{Lighting, RenderSettings, Shadows, Sun, render};
use crate::report::Findings;
use crate::sample::{PlantSettings, SampleCamera, cameras, plant};
use crate::scene::Scene;
use crate::visibility::{Accuracy, Method, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query_until};

/// Rays per pixel of the reference.
const REFERENCE_RAYS: u32 = 16;
/// Times each query is run; the median counts.
const TIMED_RUNS: usize = 3;

/// Flags of `demo`.
#[derive(Args)]
pub struct Demo {
    /// Folder for everything that the demo makes
    #[arg(long, default_value = "voxsight-demo", value_name = "DIR")]
    out: PathBuf,
    /// Voxels along the side of the grid
    #[arg(long, default_value = "4096", value_parser = parse_resolution, value_name = "N")]
    resolution: u32,
    /// Image size of its cameras
    #[arg(long, default_value = "1024x640", value_parser = parse_size, value_name = "WxH")]
    size: (u32, u32),
    /// Another seed is another plant
    #[arg(long, default_value = "1", value_name = "N")]
    seed: u64,
}

/// One method's answer beside the reference.
#[derive(Serialize)]
struct Row {
    method: Method,
    /// Median of several runs.
    milliseconds: f64,
    visible: usize,
    accuracy: Accuracy,
}

impl Demo {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        let started = Instant::now();
        std::fs::create_dir_all(&self.out)
            .map_err(|error| format!("{}: cannot make this folder: {error}", self.out.display()))?;
        let plant_settings = PlantSettings { seed: self.seed, ..PlantSettings::default() };
        let views = cameras(&plant_settings).map(|view| (view.name, camera(&view, self.size)));

        let scene_path = self.out.join("plant.vxs");
        let outcome = self.build(&plant_settings, &scene_path, progress)?;
        let loaded = LoadedScene::new(Scene::open(&scene_path)?, progress)?;
        for (name, camera) in &views {
            write_json(&self.out.join(format!("{name}.json")), camera)?;
        }
        let (_, inside) = views[0];
        let rows = compare(&loaded, &inside.rays()?, progress)?;
        write_json(&self.out.join("inside-accuracy.json"), &rows)?;
        for (name, camera) in &views {
            picture(&loaded, camera, &self.out.join(format!("{name}.png")), progress)?;
        }
        progress.finish();
        summary(&outcome, &rows, &inside, &self.out, started.elapsed().as_secs_f64())
    }

    fn build(
        &self,
        plant_settings: &PlantSettings,
        scene_path: &Path,
        progress: &TerminalProgress,
    ) -> Result<BuildOutcome, Failure> {
        progress.stage("generate the plant", 0, "");
        let model = plant(plant_settings);
        let settings = BuildSettings {
            resolution: Resolution::Log2(self.resolution),
            up: Axis::Y,
            ..BuildSettings::default()
        };
        Ok(build(model, Vec::new(), Findings::default(), &settings, scene_path, progress)?)
    }
}

fn camera(view: &SampleCamera, (width, height): (u32, u32)) -> Camera {
    let SampleCamera { eye, target, up, fov_y_deg, .. } = *view;
    Camera { eye, target, up, projection: Projection::Perspective { fov_y_deg }, width, height }
}

/// Runs every method on one view, timed, and compares each with the reference.
fn compare(loaded: &LoadedScene, rays: &CameraRays, progress: &dyn Progress) -> Result<Vec<Row>, Failure> {
    let scene = loaded.query();
    let (width, height) = rays.size();
    let pixels = u64::from(width) * u64::from(height);
    progress.stage("reference query, 16 rays per pixel", pixels, "pixels");
    // Rays of its own: none is shared with the answers.
    let fine = QuerySettings {
        rays_per_pixel: RaysPerPixel::rays(REFERENCE_RAYS),
        first_sample: 1,
        ..QuerySettings::default()
    };
    let reference = query_until(&scene, rays, Method::Exact, &fine, progress).ok_or("stopped")?;
    let mut rows = Vec::new();
    for method in [Method::Frustum, Method::Voxel, Method::Hybrid, Method::Exact] {
        let name = format!("query by {}", format!("{method:?}").to_lowercase());
        progress.stage(&name, pixels * TIMED_RUNS as u64, "pixels");
        let ask = || query_until(&scene, rays, method, &QuerySettings::default(), progress);
        let (answer, milliseconds) = timed(ask).ok_or("stopped")?;
        let accuracy = accuracy(&reference, &answer, pixels, |drawable| scene.exact.triangle_count(drawable));
        rows.push(Row { method, milliseconds, visible: answer.visible_count(), accuracy });
    }
    Ok(rows)
}

/// The answer, and the median of several runs in milliseconds; `None` when cancelled.
fn timed(mut ask: impl FnMut() -> Option<VisibleSet>) -> Option<(VisibleSet, f64)> {
    let mut times = [0.0; TIMED_RUNS];
    let mut last = None;
    for time in &mut times {
        let started = Instant::now();
        let answer = ask()?;
        *time = started.elapsed().as_secs_f64() * 1e3;
        last = Some(answer);
    }
    times.sort_by(f64::total_cmp);
    last.map(|answer| (answer, times[TIMED_RUNS / 2]))
}

fn picture(
    loaded: &LoadedScene,
    camera: &Camera,
    path: &Path,
    progress: &TerminalProgress,
) -> Result<(), Failure> {
    let settings = RenderSettings {
        samples_per_pixel: 4,
        lighting: Lighting::sunny(Sun::default_direction(DVec3::Y)),
        shadows: Shadows::HYBRID,
        up: DVec3::Y,
        seed: 0,
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    progress.stage(&format!("render {name}"), u64::from(camera.width) * u64::from(camera.height), "pixels");
    let image = render(&loaded.picture(), &camera.rays()?, &settings, progress);
    write_png(path, &image.ok_or("stopped")?)
}

fn summary(
    outcome: &BuildOutcome,
    rows: &[Row],
    camera: &Camera,
    folder: &Path,
    seconds: f64,
) -> Result<(), Failure> {
    let counts = &outcome.meta.counts;
    let scene_bytes = std::fs::metadata(folder.join("plant.vxs"))?.len();
    let build_seconds: f64 = outcome.stages.iter().map(|stage| stage.seconds).sum();
    print_out!(
        "A plant of {} objects and {} triangles ({} stored once), built in {build_seconds:.1} s:\n\
         {}, {} voxels at {}^3.\n",
        grouped(counts.objects),
        grouped(counts.placed_triangles),
        grouped(counts.unique_triangles),
        human_bytes(scene_bytes),
        grouped(outcome.meta.dag.voxel_count),
        outcome.meta.settings.resolution,
    )?;
    print_out!(
        "What a camera inside it sees, 1 ray per pixel, {} x {} (reference: {REFERENCE_RAYS} exact rays per pixel):",
        camera.width,
        camera.height
    )?;
    print_out!(
        "method     visible   time        wrongly hidden   of >= 16 px   lost pixels   needlessly drawn"
    )?;
    for row in rows {
        let large = row.accuracy.classes.last().map_or(0.0, |class| class.rate());
        print_out!(
            "{:<9} {:>8} {:>8.1} ms {:>15.2} % {:>11.2} % {:>11.4} % {:>16.2} %",
            format!("{:?}", row.method).to_lowercase(),
            grouped(row.visible as u64),
            row.milliseconds,
            100.0 * row.accuracy.wrongly_hidden_rate(),
            100.0 * large,
            100.0 * row.accuracy.lost_pixels,
            100.0 * row.accuracy.needlessly_drawn_rate(),
        )?;
    }
    print_out!("(what exact itself loses at 1 ray per pixel is the sampling floor)\n")?;
    let folder = folder.display();
    print_out!(
        "In {folder}: plant.vxs; inside, deck and overview as .png, their cameras as .json; inside-accuracy.json. {seconds:.1} s in all."
    )?;
    print_out!("Next (voxsight stands for `cargo run --release --`):")?;
    print_out!("      voxsight find {folder}/plant.vxs pump")?;
    print_out!("      voxsight visible {folder}/plant.vxs --camera {folder}/inside.json")?;
    Ok(())
}

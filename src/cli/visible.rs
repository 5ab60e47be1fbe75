//! `voxsight visible`: what a camera sees.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::Failure;
use super::output::{check_output, print_out, write_json};
use super::progress::TerminalProgress;
use super::render::camera_or_overview;
use crate::camera::CameraRays;
use crate::human::grouped;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::visibility::{Accuracy, Method, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query_until};

/// Rays per pixel of the reference that `--check` compares with.
const REFERENCE_RAYS_PER_PIXEL: u32 = 16;
/// What is said after Ctrl-C.
const STOPPED: &str = "stopped; nothing was written";
/// Objects printed without `--json`.
const PRINTED_OBJECTS: usize = 20;

/// Flags of `visible`.
#[derive(Args)]
pub struct Visible {
    /// The scene
    scene: PathBuf,
    /// Camera file (JSON); without one the camera sees the whole scene from a corner
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Write the camera that was used, to begin from
    #[arg(long, value_name = "CAM.json")]
    save_camera: Option<PathBuf>,
    /// How visibility is found
    #[arg(long, default_value = "hybrid")]
    method: MethodName,
    /// Rays per pixel, such as 4 or 1/16
    #[arg(long, default_value = "1", value_name = "N")]
    rays_per_pixel: RaysPerPixel,
    /// Spend rays only where drawables change: one ray per pixel, or a quarter of fewer, and the rest where they differ
    #[arg(long)]
    adaptive: bool,
    /// Another seed is another jitter of the rays
    #[arg(long, default_value = "0", value_name = "N")]
    seed: u16,
    /// Compare with `exact` at 16 rays per pixel and print both errors
    #[arg(long)]
    check: bool,
    /// Write the answer to a JSON file, - for standard output
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum MethodName {
    Voxel,
    Hybrid,
    Exact,
    Frustum,
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Voxel => Method::Voxel,
            MethodName::Hybrid => Method::Hybrid,
            MethodName::Exact => Method::Exact,
            MethodName::Frustum => Method::Frustum,
        }
    }
}

impl Visible {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        let method = Method::from(self.method);
        for output in self.json.iter().chain(&self.save_camera) {
            check_output(output, &["json"])?;
        }
        let scene = Scene::open(&self.scene)?;
        let camera = camera_or_overview(self.camera.as_deref(), &scene)?;
        let rays = camera.rays()?;
        if let Some(path) = &self.save_camera {
            write_json(path, &camera)?;
        }
        let loaded = LoadedScene::new(scene, progress)?;
        let first_sample = u32::from(self.seed).saturating_mul(self.rays_per_pixel.samples());
        let settings = QuerySettings {
            rays_per_pixel: self.rays_per_pixel,
            first_sample,
            adaptive: self.adaptive,
            ..QuerySettings::default()
        };

        let pixels = u64::from(camera.width) * u64::from(camera.height);
        progress.stage("query", pixels, "pixels");
        let started = Instant::now();
        let answer = query_until(&loaded.query(), &rays, method, &settings, progress).ok_or(STOPPED)?;
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        let checked = match self.check {
            false => None,
            true => {
                progress.stage("reference", pixels, "pixels");
                let next_sample = first_sample.saturating_add(self.rays_per_pixel.samples());
                Some(check(&loaded, &rays, &answer, next_sample, progress).ok_or(STOPPED)?)
            }
        };
        progress.finish();

        let scene = loaded.scene();
        let objects = sorted_objects(scene, &answer);
        if let Some(path) = &self.json {
            let list = objects.iter().map(|&(object, samples)| {
                let node = scene.objects()[object as usize].node;
                json!({
                    "id": object,
                    "path": scene.node_path(node),
                    "name": scene.name(scene.nodes()[node as usize].name),
                    "samples": samples,
                })
            });
            let mut value = json!({
                "method": method,
                "camera": camera,
                "rays": answer.rays,
                "weight": answer.weight,
                "elapsed_ms": elapsed_ms,
                "objects": list.collect::<Vec<_>>(),
            });
            if let Some(checked) = &checked {
                value["accuracy"] = serde_json::to_value(checked)?;
            }
            write_json(path, &value)?;
            if path.as_os_str() == "-" {
                return Ok(());
            }
        }
        let spared = match answer.weight.saturating_sub(answer.rays) {
            0 => String::new(),
            spared => format!(" ({} spared)", grouped(spared)),
        };
        print_out!(
            "{} of {} objects visible, {} rays{spared} in {elapsed_ms:.1} ms",
            grouped(objects.len() as u64),
            grouped(scene.objects().len() as u64),
            grouped(answer.rays),
        )?;
        if objects.is_empty() {
            let bounds = scene.meta().bounds;
            print_out!(
                "Does the camera look at the model? It lies from {:?} to {:?}.",
                bounds.min,
                bounds.max
            )?;
        }
        if let Some(checked) = &checked {
            print_accuracy(checked)?;
        }
        if self.json.is_none() {
            for &(object, samples) in objects.iter().take(PRINTED_OBJECTS) {
                print_out!("{samples:>9}  {}", scene.node_path(scene.objects()[object as usize].node))?;
            }
            if objects.len() > PRINTED_OBJECTS {
                print_out!("... and {} more; --json FILE writes them all", objects.len() - PRINTED_OBJECTS)?;
            }
        }
        Ok(())
    }
}

/// Compares an answer with the reference of the same camera, whose jitter begins at `first_sample`: after the answer's,
/// so that they share no ray. `None` when cancelled.
fn check(
    loaded: &LoadedScene,
    rays: &CameraRays,
    answer: &VisibleSet,
    first_sample: u32,
    progress: &dyn Progress,
) -> Option<Accuracy> {
    let settings = QuerySettings {
        rays_per_pixel: RaysPerPixel::rays(REFERENCE_RAYS_PER_PIXEL),
        first_sample,
        ..QuerySettings::default()
    };
    let scene = loaded.query();
    let reference = query_until(&scene, rays, Method::Exact, &settings, progress)?;
    let (width, height) = rays.size();
    let pixels = u64::from(width) * u64::from(height);
    Some(accuracy(&reference, answer, pixels, |drawable| scene.exact.triangle_count(drawable)))
}

/// Visible objects, most samples first, then by id.
fn sorted_objects(scene: &Scene, answer: &VisibleSet) -> Vec<(u32, u64)> {
    let mut objects: Vec<(u32, u64)> =
        answer.by_object(|drawable| scene.drawable_object(drawable)).into_iter().collect();
    objects.sort_by_key(|&(object, samples)| (std::cmp::Reverse(samples), object));
    objects
}

fn print_accuracy(checked: &Accuracy) -> Result<(), Failure> {
    print_out!(
        "wrongly hidden    {:.3} % of drawables ({} of {}), lost pixels {:.4} %",
        100.0 * checked.wrongly_hidden_rate(),
        grouped(checked.wrongly_hidden),
        grouped(checked.reference),
        100.0 * checked.lost_pixels
    )?;
    for class in &checked.classes {
        print_out!(
            "  of at least {:>2} px {:.3} % ({} of {})",
            class.at_least_px,
            100.0 * class.rate(),
            grouped(class.wrongly_hidden),
            grouped(class.reference)
        )?;
    }
    print_out!(
        "needlessly drawn  {:.3} % of drawables ({} of {}), {} triangles",
        100.0 * checked.needlessly_drawn_rate(),
        grouped(checked.needlessly_drawn),
        grouped(checked.answer),
        grouped(checked.needless_triangles)
    )
}

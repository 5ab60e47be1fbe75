//! `voxsight visible`: what a camera sees.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::Failure;
use super::numbers::parse_rays;
use super::output::{human_count, print_out, read_camera, write_json};
use super::progress::TerminalProgress;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::visibility::{Accuracy, Method, QuerySettings, VisibleSet, accuracy, query};

/// Rays per pixel of the reference that `--check` compares with.
const REFERENCE_RAYS_PER_PIXEL: u32 = 16;
/// Objects printed without `--json`.
const PRINTED_OBJECTS: usize = 20;

/// Flags of `visible`.
#[derive(Args)]
pub struct Visible {
    /// The scene
    scene: PathBuf,
    /// Camera file (JSON)
    #[arg(long, value_name = "CAM.json")]
    camera: PathBuf,
    /// How visibility is found
    #[arg(long, default_value = "hybrid")]
    method: MethodName,
    /// Rays per pixel
    #[arg(long, default_value = "1", value_parser = parse_rays, value_name = "N")]
    rays_per_pixel: u32,
    /// hybrid: accept a voxel without asking its triangles when it is smaller than so many pixels
    #[arg(long, default_value = "0", value_name = "PX")]
    accept_below: f64,
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
        if !(self.accept_below >= 0.0 && self.accept_below.is_finite()) {
            return Err("--accept-below takes a number of pixels, 0 or more".into());
        }
        let camera = read_camera(&self.camera)?;
        let rays = camera.rays()?;
        let loaded = LoadedScene::new(Scene::open(&self.scene)?, progress)?;
        let method = Method::from(self.method);
        let settings =
            QuerySettings { rays_per_pixel: self.rays_per_pixel, accept_below_px: self.accept_below };

        progress.stage("query", 0, "");
        let started = Instant::now();
        let answer = query(&loaded.query(), &rays, method, &settings);
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        let checked = self.check.then(|| {
            progress.stage("reference", 0, "");
            check(&loaded, &rays, &answer)
        });
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
        print_out!(
            "{} of {} objects visible, {} rays in {elapsed_ms:.1} ms",
            human_count(objects.len() as u64),
            human_count(scene.objects().len() as u64),
            human_count(answer.rays),
        )?;
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

/// Compares an answer with the reference of the same camera.
pub(super) fn check(loaded: &LoadedScene, rays: &crate::camera::CameraRays, answer: &VisibleSet) -> Accuracy {
    let settings = QuerySettings { rays_per_pixel: REFERENCE_RAYS_PER_PIXEL, ..QuerySettings::default() };
    let scene = loaded.query();
    let reference = query(&scene, rays, Method::Exact, &settings);
    let (width, height) = rays.size();
    let pixels = u64::from(width) * u64::from(height);
    accuracy(&reference, answer, pixels, |drawable| scene.exact.triangle_count(drawable))
}

/// Visible objects, most samples first, then by id.
fn sorted_objects(scene: &Scene, answer: &VisibleSet) -> Vec<(u32, u64)> {
    let mut objects: Vec<(u32, u64)> =
        answer.by_object(|drawable| scene.drawable_object(drawable)).into_iter().collect();
    objects.sort_by_key(|&(object, samples)| (std::cmp::Reverse(samples), object));
    objects
}

pub(super) fn print_accuracy(checked: &Accuracy) -> Result<(), Failure> {
    print_out!(
        "wrongly hidden    {:.3} % of drawables ({} of {}), lost pixels {:.4} %",
        100.0 * checked.wrongly_hidden_rate(),
        human_count(checked.wrongly_hidden),
        human_count(checked.reference),
        100.0 * checked.lost_pixels
    )?;
    for class in &checked.classes {
        print_out!(
            "  of at least {:>2} px {:.3} % ({} of {})",
            class.at_least_px,
            100.0 * class.rate(),
            human_count(class.wrongly_hidden),
            human_count(class.reference)
        )?;
    }
    print_out!(
        "needlessly drawn  {:.3} % of drawables ({} of {}), {} triangles",
        100.0 * checked.needlessly_drawn_rate(),
        human_count(checked.needlessly_drawn),
        human_count(checked.answer),
        human_count(checked.needless_triangles)
    )
}

//! `voxsight render`: a picture, object ids, or depth.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;

use super::Failure;
use super::numbers::{parse_rays, parse_size, parse_vector};
use super::output::{check_output, print_out, read_camera, write_json, write_png};
use super::progress::TerminalProgress;
use crate::camera::Camera;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::render::{Light, RenderSettings, Shadows, render, render_depth, render_ids};
use crate::scene::Scene;

/// Flags of `render`.
#[derive(Args)]
pub struct Render {
    /// The scene
    scene: PathBuf,
    /// Camera file (JSON); without one the camera sees the whole scene from a corner
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Write the camera that was used, to begin from
    #[arg(long, value_name = "CAM.json")]
    save_camera: Option<PathBuf>,
    /// Image size; the camera's if left out
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<(u32, u32)>,
    /// Where the light comes from
    #[arg(long, default_value = "sun")]
    light: LightName,
    /// Direction towards the sun, world axes; from the upper left by default
    #[arg(long, value_parser = parse_vector, value_name = "X,Y,Z", allow_hyphen_values = true)]
    sun: Option<[f64; 3]>,
    /// How the sun's shadows are found [default: voxel]
    #[arg(long)]
    shadows: Option<ShadowName>,
    /// Samples per pixel
    #[arg(long, default_value = "4", value_parser = parse_rays, value_name = "N")]
    spp: u32,
    /// Write object ids as colours instead: (id + 1) * 0x9E3779 mod 2^24, red lowest
    #[arg(long, conflicts_with_all = ["depth", "light", "sun", "shadows", "spp"])]
    ids: bool,
    /// Write depth instead: 16 bits, 0 = nothing, 1 = nearest, 65535 = farthest, linear; the range is printed
    #[arg(long, conflicts_with_all = ["light", "sun", "shadows", "spp"])]
    depth: bool,
    /// The picture to write (PNG)
    #[arg(long, short, value_name = "OUT.png")]
    output: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
enum LightName {
    Headlight,
    Sun,
}

#[derive(Clone, Copy, ValueEnum)]
enum ShadowName {
    None,
    Voxel,
    Exact,
}

impl Render {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        check_output(&self.output, "png")?;
        if let Some(path) = &self.save_camera {
            check_output(path, "json")?;
        }
        if matches!(self.light, LightName::Headlight) && (self.sun.is_some() || self.shadows.is_some()) {
            return Err(
                "a headlight casts no shadows: leave out --sun and --shadows, or use --light sun".into()
            );
        }
        let scene = Scene::open(&self.scene)?;
        let mut camera = camera_or_overview(self.camera.as_deref(), &scene)?;
        if let Some((width, height)) = self.size {
            (camera.width, camera.height) = (width, height);
        }
        let rays = camera.rays()?;
        if let Some(path) = &self.save_camera {
            write_json(path, &camera)?;
        }
        let up = scene.meta().settings.up.unit();
        let loaded = LoadedScene::new(scene, progress)?;
        progress.stage("render", u64::from(camera.width) * u64::from(camera.height), "pixels");
        const STOPPED: &str = "stopped; nothing was written";
        if self.depth {
            let depth = render_depth(&loaded.picture(), &rays, progress).ok_or(STOPPED)?;
            progress.finish();
            print_out!(
                "depth 1 = {}, 65535 = {} {}",
                depth.near,
                depth.far,
                loaded.scene().meta().settings.unit
            )?;
            return write_png(&self.output, &depth.image);
        }
        let image = if self.ids {
            render_ids(&loaded.picture(), &rays, |d| loaded.scene().drawable_object(d), progress)
        } else {
            render(&loaded.picture(), &rays, &self.settings(up), progress)
        };
        progress.finish();
        write_png(&self.output, &image.ok_or(STOPPED)?)
    }

    fn settings(&self, up: DVec3) -> RenderSettings {
        RenderSettings {
            samples_per_pixel: self.spp,
            light: match self.light {
                LightName::Headlight => Light::Headlight,
                LightName::Sun => Light::Sun(self.sun.map_or_else(|| default_sun(up), DVec3::from)),
            },
            shadows: match self.shadows {
                Some(ShadowName::None) => Shadows::None,
                Some(ShadowName::Voxel) | None => Shadows::Voxel,
                Some(ShadowName::Exact) => Shadows::Exact,
            },
            up,
        }
    }
}

/// The camera of a file, or the overview of the scene.
pub(super) fn camera_or_overview(path: Option<&Path>, scene: &Scene) -> Result<Camera, Failure> {
    match path {
        Some(path) => read_camera(path),
        None => Ok(overview(scene)),
    }
}

/// High up and to the side.
pub(super) fn default_sun(up: DVec3) -> DVec3 {
    let side = DVec3::new(up.y, up.z, up.x);
    up + 0.45 * side + 0.3 * up.cross(side)
}

/// The whole scene from a corner above.
fn overview(scene: &Scene) -> Camera {
    let bounds = scene.meta().bounds;
    let up = scene.meta().settings.up.unit();
    let side = DVec3::new(up.y, up.z, up.x);
    let from = 0.55 * up + 0.8 * side + 0.6 * up.cross(side);
    Camera::around(bounds.min.into(), bounds.max.into(), from, up, 1280, 960)
}

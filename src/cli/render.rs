//! `voxsight render`: a picture or a sequence of them, object ids, or depth.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Args;
use glam::DVec3;
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

use super::light::{KeyName, LightFlags, SkyName};
use super::numbers::{parse_frames, parse_rays, parse_size};
use super::output::{check_output, human_bytes, print_out, read_camera, write_json};
use super::path::{FRAME, frame_name, read_views};
use super::progress::TerminalProgress;
use super::shadow_report::shadow_report;
use super::{Failure, usage};
use crate::camera::Camera;
use crate::human::grouped;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::render::file::{
    DepthRange, Fingerprint, Format, Written, depth_range_of, is_for_streams, render_to_file,
    render_to_stream, unfinished,
};
use crate::render::{LightKind, MAX_SAMPLES, PIXELS_VERSION, RenderSettings, Renderer, ShadowCost};
use crate::scene::Scene;

/// Flags of `render`.
#[derive(Args)]
pub struct Render {
    /// The scene; with --report also the same model built at other resolutions
    #[arg(required = true, value_name = "SCENE.vxs")]
    scenes: Vec<PathBuf>,
    /// Camera file (JSON); without one the camera sees the whole scene from a corner
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Frames along a camera path instead: {"keyframes":[{"t":0,"eye":..as in a camera file..},{"t":2,..}],"fps":30}, where "cut":true
    /// jumps, or a plain list of cameras; -o names them, with {frame} where the number goes
    #[arg(long, value_name = "PATH.json", conflicts_with_all = ["camera", "save_camera", "ids", "depth"])]
    path: Option<PathBuf>,
    /// Of the path, these frames only, such as 0-299: shards of a sequence are the same pictures
    #[arg(long, value_name = "A-B", requires = "path", value_parser = parse_frames)]
    frames: Option<Range<usize>>,
    /// Write the camera that was used, to begin from
    #[arg(long, value_name = "CAM.json")]
    save_camera: Option<PathBuf>,
    /// Image size; the camera's if left out
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<(u32, u32)>,
    #[command(flatten)]
    light: LightFlags,
    /// Samples per pixel; with --report several, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "4", value_parser = parse_rays, value_name = "N")]
    spp: Vec<u32>,
    /// Another seed, other samples
    #[arg(long, default_value = "0", value_name = "N")]
    seed: u32,
    /// Bits a value of a PNG: 8 or 16 [default: 8]
    #[arg(long, value_name = "BITS", value_parser = ["8", "16"])]
    bits: Option<String>,
    /// Write object ids as colours instead: (id + 1) * 0x9E3779 mod 2^24, red lowest
    #[arg(long, conflicts_with_all = ["depth", "light", "sun", "sun_angle", "sky", "areas", "fill", "shadows", "shadow_tolerance", "spp", "seed", "bits"])]
    ids: bool,
    /// Write depth instead: 16 bits, 0 = nothing, 1 = nearest, 65535 = farthest, linear; the range is printed, and stands in the
    /// file as text
    #[arg(long, conflicts_with_all = ["light", "sun", "sun_angle", "sky", "areas", "fill", "shadows", "shadow_tolerance", "spp", "seed", "bits"])]
    depth: bool,
    /// The picture to write: PNG, or EXR (linear, with depth, normals and object ids)
    #[arg(long, short, value_name = "OUT.png|OUT.exr", required_unless_present = "report")]
    output: Option<PathBuf>,
    /// Instead of a picture: every way of casting shadow rays against exact, as figures, chart and difference pictures
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["output", "path", "ids", "depth", "save_camera", "shadows", "bits"])]
    report: Option<PathBuf>,
}

impl Render {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        self.light.check()?;
        if self.spp.iter().any(|&samples| samples > MAX_SAMPLES) {
            return Err(usage(format!("--spp: at most {MAX_SAMPLES} samples per pixel")));
        }
        let Some(output) = &self.output else { return self.shadow_report(progress) };
        let ([scene], [_]) = (self.scenes.as_slice(), self.spp.as_slice()) else {
            return Err(usage("a picture is of one scene and one number of samples; --report takes several"));
        };
        let format = self.format(output)?;
        if let Some(path) = &self.save_camera {
            check_output(path, &["json"])?;
        }
        let frames = self.read_path()?;
        let scene = Scene::open(scene)?;
        let settings = self.settings(&scene)?;
        if let Some(cameras) = frames {
            let loaded = LoadedScene::new(scene, progress)?;
            return self.sequence(&loaded, &cameras, &settings, (output, format), progress);
        }
        let camera = self.camera(&scene)?;
        let of_file = |error: &dyn std::fmt::Display| match &self.camera {
            Some(file) => format!("{}: {error}", file.display()),
            None => error.to_string(),
        };
        let rays = camera.rays().map_err(|error| of_file(&error))?;
        if let Some(path) = &self.save_camera {
            write_json(path, &camera)?;
        }
        let loaded = LoadedScene::new(scene, progress)?;
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        progress.stage("render", pixels, "pixels");
        if is_stream(output) {
            let picture = loaded.picture();
            let renderer = Renderer::new(&picture, &rays, &settings);
            return stream(&renderer, output, format, &loaded, progress);
        }
        let written = self.picture(&loaded, &camera, &settings, (output, format), progress)?;
        progress.finish();
        if format == Format::Depth
            && let Some(DepthRange { near, far }) = depth_range_of(output)
            && near <= far
        {
            print_out!("depth 1 = {near}, 65535 = {far} {}", loaded.scene().meta().settings.unit)?;
        }
        tell(output, &written)
    }

    fn camera(&self, scene: &Scene) -> Result<Camera, Failure> {
        let mut camera = camera_or_overview(self.camera.as_deref(), scene)?;
        if let Some((width, height)) = self.size {
            (camera.width, camera.height) = (width, height);
        }
        Ok(camera)
    }

    /// Every way of casting shadow rays, side by side.
    fn shadow_report(&self, progress: &TerminalProgress) -> Result<(), Failure> {
        let Some(folder) = &self.report else { return Err("neither --output nor --report was given".into()) };
        let has_shadows = self.light.light == KeyName::Sun
            || self.light.sky == Some(SkyName::Occluded)
            || self.light.areas.is_some();
        if !has_shadows {
            return Err(
                "there is no light that casts shadows: use --light sun, --sky occluded or --areas".into()
            );
        }
        let opened: Vec<Scene> = self.scenes.iter().map(Scene::open).collect::<Result<_, _>>()?;
        let Some(first) = opened.first() else { return Err("no scene was named".into()) };
        let (camera, settings) = (self.camera(first)?, self.settings(first)?);
        shadow_report(folder, opened, &camera, &settings, &self.spp, progress)
    }

    /// By the output's name; refuses what cannot be.
    fn format(&self, output: &Path) -> Result<Format, Failure> {
        if self.path.is_some() && !output.to_string_lossy().contains(FRAME) {
            return Err(usage(format!("{}: a sequence needs {FRAME} in its name", output.display())));
        }
        check_output(output, if self.ids || self.depth { &["png"] } else { &["png", "exr"] })?;
        let is_exr = output.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let format = match self.bits.as_deref() {
            _ if self.ids => Format::Ids,
            _ if self.depth => Format::Depth,
            Some(_) if is_exr => return Err(usage("--bits is about PNG: EXR has 16-bit floats")),
            Some("16") => Format::Png16,
            _ if is_exr => Format::Exr,
            _ => Format::Png8,
        };
        if is_stream(output) && !is_for_streams(format) {
            return Err(usage("--depth and EXR need a file: what comes first is known last; name one"));
        }
        Ok(format)
    }

    fn settings(&self, scene: &Scene) -> Result<RenderSettings, Failure> {
        let settings = &scene.meta().settings;
        let up = settings.up.unit();
        if self.ids || self.depth {
            return Ok(RenderSettings::middles(up));
        }
        let metres = super::numbers::metres_of_unit(&settings.unit)
            .ok_or_else(|| format!("the scene's unit \"{}\" is not known", settings.unit))?;
        let settings = RenderSettings {
            samples_per_pixel: self.spp.first().copied().unwrap_or(1),
            lighting: self.light.lighting(up, metres)?,
            shadows: self.light.shadows(),
            up,
            seed: self.seed,
        };
        settings.check().map_err(|error| usage(error.to_string()))?;
        Ok(settings)
    }

    /// The cameras of all frames.
    fn read_path(&self) -> Result<Option<Vec<Camera>>, Failure> {
        let Some(file) = &self.path else { return Ok(None) };
        Ok(Some(read_views(file, self.size)?.into_iter().map(|view| view.camera).collect()))
    }

    /// Renders frames of a path, one file each.
    fn sequence(
        &self,
        loaded: &LoadedScene,
        cameras: &[Camera],
        settings: &RenderSettings,
        (output, format): (&Path, Format),
        progress: &TerminalProgress,
    ) -> Result<(), Failure> {
        let frames = self.frames.clone().unwrap_or(0..cameras.len());
        if frames.end > cameras.len() {
            return Err(format!("--frames: the path has frames 0 to {}", cameras.len() - 1).into());
        }
        let (mut new, mut before) = (0, 0);
        for frame in frames.clone() {
            let camera = &cameras[frame];
            let name = frame_name(output, frame, cameras.len());
            let pixels = u64::from(camera.width) * u64::from(camera.height);
            progress.stage(&format!("frame {frame} of {}", cameras.len()), pixels, "pixels");
            // Other samples in each frame, noise that stands still would look like dirt on the glass; and none of another seed's.
            let seed = xxh3_64(format!("{} {frame}", settings.seed).as_bytes()) as u32;
            let settings = RenderSettings { seed, ..settings.clone() };
            match self.picture(loaded, camera, &settings, (&name, format), progress)? {
                Written::New { .. } => new += 1,
                Written::Before => before += 1,
            }
        }
        progress.finish();
        print_out!("frames {} to {}: {new} rendered, {before} were there", frames.start, frames.end - 1)
    }

    /// Renders one picture into a file.
    fn picture(
        &self,
        loaded: &LoadedScene,
        camera: &Camera,
        settings: &RenderSettings,
        (path, format): (&Path, Format),
        progress: &TerminalProgress,
    ) -> Result<Written, Failure> {
        let rays = camera.rays()?;
        let picture = loaded.picture();
        let renderer = Renderer::new(&picture, &rays, settings);
        let object_of = |drawable| loaded.scene().drawable_object(drawable);
        // Floats are written so that they read back the same: equal text is equal settings.
        let told = format!(
            "{PIXELS_VERSION} {:032x} {} {settings:?}",
            loaded.scene().container().fingerprint(),
            serde_json::to_string(camera)?
        );
        let fingerprint = Fingerprint(xxh3_128(told.as_bytes()));
        Ok(render_to_file(&renderer, path, format, fingerprint, &object_of, progress)?)
    }
}

/// Is it no file: stdout, a pipe, a device?
fn is_stream(path: &Path) -> bool {
    path == Path::new("-") || crate::atomic_file::is_special(path)
}

/// Renders into stdout, a pipe or a device.
fn stream(
    renderer: &Renderer,
    output: &Path,
    format: Format,
    loaded: &LoadedScene,
    progress: &TerminalProgress,
) -> Result<(), Failure> {
    let object_of = |drawable| loaded.scene().drawable_object(drawable);
    let written = match output == Path::new("-") {
        true => render_to_stream(renderer, format, &object_of, &mut std::io::stdout().lock(), progress),
        false => File::options()
            .write(true)
            .open(output)
            .and_then(|mut file| render_to_stream(renderer, format, &object_of, &mut file, progress)),
    };
    progress.finish();
    written.map_err(|error| match progress.is_cancelled() {
        true => "stopped".into(),
        false => format!("{}: cannot write: {error}", output.display()).into(),
    })
}

/// What came of a picture, for people.
fn tell(path: &Path, written: &Written) -> Result<(), Failure> {
    for part in unfinished(path) {
        let bytes = part.metadata().map_or(0, |metadata| metadata.len());
        print_out!("{}: unfinished, with other settings ({})", part.display(), human_bytes(bytes))?;
    }
    match written {
        Written::Before => print_out!("{}: is this picture already", path.display()),
        Written::New { resumed_rows, cost } => {
            if *resumed_rows > 0 {
                print_out!("{}: {resumed_rows} rows were there from before", path.display())?;
            }
            tell_cost(cost)
        }
    }
}

fn tell_cost(cost: &ShadowCost) -> Result<(), Failure> {
    for kind in LightKind::ALL {
        let (rays, time) = (cost.rays[kind as usize], cost.time[kind as usize].as_secs_f64());
        if rays > 0 && time > 0.0 {
            let name = kind.name();
            let rate = rays as f64 / time * 1e-6;
            print_out!("{name}: {} shadow rays, {rate:.2} M a second and thread", grouped(rays))?;
        }
    }
    Ok(())
}

/// The camera of a file, or the overview of the scene.
pub(super) fn camera_or_overview(path: Option<&Path>, scene: &Scene) -> Result<Camera, Failure> {
    match path {
        Some(path) => read_camera(path),
        None => Ok(overview(scene)),
    }
}

/// The whole scene from a corner above.
fn overview(scene: &Scene) -> Camera {
    let bounds = scene.meta().bounds;
    let up = scene.meta().settings.up.unit();
    let side = DVec3::new(up.y, up.z, up.x);
    let from = 0.55 * up + 0.8 * side + 0.6 * up.cross(side);
    Camera::around(bounds.min.into(), bounds.max.into(), from, up, 1280, 960)
}

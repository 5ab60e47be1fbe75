//! `voxsight render`: a picture or a sequence of them, object ids, or depth.

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Deserialize;
use xxhash_rust::xxh3::xxh3_128;

use super::Failure;
use super::numbers::{Length, parse_frames, parse_length, parse_rays, parse_size, parse_vector};
use super::output::{check_output, print_out, read_camera, write_json, write_png};
use super::progress::TerminalProgress;
use super::shadow_report::shadow_report;
use crate::camera::Camera;
use crate::lab::keyframes::CameraPath;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::render::file::{Fingerprint, Format, Written, depth_range, render_to_file};
use crate::render::{
    AreaLight, DepthRange, KeyLight, LightKind, Lighting, MAX_SAMPLES, PIXELS_VERSION, RenderSettings,
    Renderer, SUN_ANGLE_DEG, ShadowCost, Shadows, Sky, Sun,
};
use crate::scene::Scene;

/// Where the number of a frame stands in a name.
const FRAME: &str = "{frame}";
/// Digits of it, at least.
const FRAME_DIGITS: usize = 4;

/// Flags of `render`.
#[derive(Args)]
pub struct Render {
    /// The scene; with --report also the same model built at other resolutions
    #[arg(required = true, value_name = "SCENE.vxs")]
    scenes: Vec<PathBuf>,
    /// Camera file (JSON); without one the camera sees the whole scene from a corner
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Frames along a camera path instead: -o names them, with {frame} where the number goes
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
    /// Bits a value of a PNG: 8 or 16
    #[arg(long, default_value = "8", value_name = "BITS", value_parser = ["8", "16"])]
    bits: String,
    /// Write object ids as colours instead: (id + 1) * 0x9E3779 mod 2^24, red lowest
    #[arg(long, conflicts_with_all = ["depth", "light", "sun", "sun_angle", "sky", "areas", "fill", "shadows", "spp", "seed", "bits"])]
    ids: bool,
    /// Write depth instead: 16 bits, 0 = nothing, 1 = nearest, 65535 = farthest, linear; the range is printed
    #[arg(long, conflicts_with_all = ["light", "sun", "sun_angle", "sky", "areas", "fill", "shadows", "spp", "seed", "bits"])]
    depth: bool,
    /// The picture to write: PNG, or EXR (linear, with depth, normals and object ids)
    #[arg(long, short, value_name = "OUT.png|OUT.exr", required_unless_present = "report")]
    output: Option<PathBuf>,
    /// Instead of a picture: every way of casting shadow rays against exact, as figures, chart and difference pictures
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["output", "path", "ids", "depth", "save_camera", "shadows", "bits"])]
    report: Option<PathBuf>,
}

/// Flags about light and shadow.
#[derive(Args)]
struct LightFlags {
    /// The strongest light
    #[arg(long, default_value = "sun")]
    light: KeyName,
    /// Direction towards the sun, world axes; from the upper left by default
    #[arg(long, value_parser = parse_vector, value_name = "X,Y,Z", allow_hyphen_values = true)]
    sun: Option<[f64; 3]>,
    /// Angle across the sun, degrees: the wider, the softer its shadows; 0 for hard ones [default: 0.53]
    #[arg(long, value_name = "DEG")]
    sun_angle: Option<f64>,
    /// The light from above: plain, none, or occluded by what is near (ambient occlusion) [default: plain]
    #[arg(long)]
    sky: Option<SkyName>,
    /// How far away things occlude the sky, such as 5m [default: any distance]
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    sky_reach: Option<Length>,
    /// Shining rectangles: a JSON list of {"corner":[x,y,z],"edge_u":[x,y,z],"edge_v":[x,y,z],"radiance":[r,g,b]}
    #[arg(long, value_name = "AREAS.json")]
    areas: Option<PathBuf>,
    /// A little light from the eye and the side, so that shapes in the shade keep their form, 0 to 1 [default: 1 with a sun]
    #[arg(long, value_name = "SHARE")]
    fill: Option<f64>,
    /// How shadows are found [default: hybrid]
    #[arg(long)]
    shadows: Option<ShadowName>,
    /// With --shadows hybrid: by how much of its width a penumbra may be wrong, 0 to 1 [default: 0.0625]
    #[arg(long, value_name = "SHARE")]
    shadow_tolerance: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum KeyName {
    Headlight,
    Sun,
    None,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum SkyName {
    Plain,
    Occluded,
    None,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ShadowName {
    None,
    /// Voxels only: quickest
    Voxel,
    /// Voxels far away, triangles where it matters
    Hybrid,
    /// Triangles only
    Exact,
}

/// A rectangle as a file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AreaFile {
    corner: [f64; 3],
    edge_u: [f64; 3],
    edge_v: [f64; 3],
    radiance: [f64; 3],
}

impl LightFlags {
    /// Refuses what does not go together.
    fn check(&self) -> Result<(), Failure> {
        let no_sun = self.sun.is_some() || self.sun_angle.is_some();
        if self.light != KeyName::Sun && no_sun {
            return Err("--sun and --sun-angle are about the sun: leave them out, or use --light sun".into());
        }
        let shadowy =
            self.shadows.is_some() || self.sky.is_some() || self.areas.is_some() || self.fill.is_some();
        if self.light == KeyName::Headlight && shadowy {
            return Err(
                "a headlight is all the light there is, and casts no shadows: leave out --shadows, --sky, \
                        --areas and --fill, or use --light sun or none"
                    .into(),
            );
        }
        if self.sky_reach.is_some() && self.sky != Some(SkyName::Occluded) {
            return Err("--sky-reach is about --sky occluded".into());
        }
        if self.shadow_tolerance.is_some() && !matches!(self.shadows, Some(ShadowName::Hybrid) | None) {
            return Err("--shadow-tolerance is about --shadows hybrid".into());
        }
        if self.sun_angle.is_some_and(|angle| !(0.0..180.0).contains(&angle)) {
            return Err("--sun-angle: expected 0 to 180 degrees".into());
        }
        if self.fill.is_some_and(|share| !(0.0..=1.0).contains(&share)) {
            return Err("--fill: expected 0 to 1".into());
        }
        if self.shadow_tolerance.is_some_and(|share| !(0.0..=1.0).contains(&share)) {
            return Err("--shadow-tolerance: expected 0 to 1".into());
        }
        if self.sun.is_some_and(|sun| DVec3::from(sun).try_normalize().is_none()) {
            return Err("--sun: expected a direction, not 0,0,0".into());
        }
        Ok(())
    }

    /// The light; lengths are in model units.
    fn lighting(&self, up: DVec3, metres_per_unit: f64) -> Result<Lighting, Failure> {
        let key = match self.light {
            KeyName::Headlight => return Ok(Lighting::headlight()),
            KeyName::None => KeyLight::None,
            KeyName::Sun => KeyLight::Sun(Sun {
                direction: self.sun.map_or_else(|| default_sun(up), DVec3::from),
                angle_deg: self.sun_angle.unwrap_or(SUN_ANGLE_DEG),
            }),
        };
        let sky = match self.sky {
            Some(SkyName::Plain) | None => Sky::Plain,
            Some(SkyName::None) => Sky::None,
            Some(SkyName::Occluded) => Sky::Occluded {
                reach: self.sky_reach.map_or(f64::INFINITY, |length| length.in_units(metres_per_unit)),
            },
        };
        let areas = self.areas.as_deref().map(read_areas).transpose()?.unwrap_or_default();
        let fill = self.fill.unwrap_or(if self.light == KeyName::Sun { 1.0 } else { 0.0 });
        Ok(Lighting { key, sky, areas, fill })
    }

    fn shadows(&self) -> Shadows {
        match self.shadows {
            Some(ShadowName::None) => Shadows::None,
            Some(ShadowName::Voxel) => Shadows::Voxel,
            Some(ShadowName::Exact) => Shadows::Exact,
            Some(ShadowName::Hybrid) | None => match self.shadow_tolerance {
                Some(tolerance) => Shadows::Hybrid { tolerance },
                None => Shadows::HYBRID,
            },
        }
    }
}

fn read_areas(path: &Path) -> Result<Vec<AreaLight>, Failure> {
    const EXAMPLE: &str = r#"[{"corner":[0,0,3],"edge_u":[1,0,0],"edge_v":[0,-1,0],"radiance":[8,8,8]}]"#;
    let told = |what: String| -> Failure {
        format!("{}: {what}; expected a list such as {EXAMPLE}", path.display()).into()
    };
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: cannot read: {e}", path.display()))?;
    let areas: Vec<AreaFile> = serde_json::from_str(&text).map_err(|error| told(error.to_string()))?;
    let area = |(number, area): (usize, AreaFile)| {
        let AreaFile { corner, edge_u, edge_v, radiance } = area;
        let light = AreaLight {
            corner: corner.into(),
            edge_u: edge_u.into(),
            edge_v: edge_v.into(),
            radiance: radiance.into(),
        };
        let across = light.edge_u.cross(light.edge_v);
        if !(across.is_finite() && across.length() > 0.0 && light.corner.is_finite()) {
            return Err(told(format!("rectangle {number} has no area")));
        }
        if !(light.radiance.is_finite() && light.radiance.min_element() >= 0.0) {
            return Err(told(format!("rectangle {number} shines with {radiance:?}")));
        }
        Ok(light)
    };
    areas.into_iter().enumerate().map(area).collect()
}

impl Render {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        self.light.check()?;
        if self.spp.iter().any(|&samples| samples > MAX_SAMPLES) {
            return Err(format!("--spp: at most {MAX_SAMPLES} samples per pixel").into());
        }
        let Some(output) = &self.output else { return self.shadow_report(progress) };
        let ([scene], [_]) = (self.scenes.as_slice(), self.spp.as_slice()) else {
            return Err("a picture is of one scene and one number of samples; --report takes several".into());
        };
        let format = self.format(output)?;
        if let Some(path) = &self.save_camera {
            check_output(path, "json")?;
        }
        let frames = self.read_path()?;
        let scene = Scene::open(scene)?;
        let settings = self.settings(&scene)?;
        if let Some(cameras) = frames {
            let loaded = LoadedScene::new(scene, progress)?;
            return self.sequence(&loaded, &cameras, &settings, (output, format), progress);
        }
        let camera = self.camera(&scene)?;
        let rays = camera.rays()?;
        if let Some(path) = &self.save_camera {
            write_json(path, &camera)?;
        }
        let loaded = LoadedScene::new(scene, progress)?;
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        const STOPPED: &str = "stopped; nothing was written";
        let picture = loaded.picture();
        let renderer = Renderer::new(&picture, &rays, &settings);
        let format = if self.depth {
            progress.stage("range of depths", pixels, "pixels");
            let range = depth_range(&renderer, progress).ok_or(STOPPED)?;
            let DepthRange { near, far } = range;
            let unit = &loaded.scene().meta().settings.unit;
            let told = match near <= far {
                true => format!("depth 1 = {near}, 65535 = {far} {unit}"),
                false => "the picture shows nothing".to_owned(),
            };
            match output == Path::new("-") {
                // The picture itself goes there.
                true => eprintln!("{told}"),
                false => print_out!("{told}")?,
            }
            Format::Depth(range)
        } else {
            format
        };
        progress.stage("render", pixels, "pixels");
        if is_stream(output) {
            // Nothing to go on from later: the whole picture at once.
            let (film, _) = renderer.rows(0..camera.height, progress).ok_or(STOPPED)?;
            progress.finish();
            return match format {
                Format::Png8 => write_png(output, &film.to_rgb8()),
                Format::Ids => write_png(output, &film.to_ids(|d| loaded.scene().drawable_object(d))),
                Format::Depth(range) => write_png(output, &film.to_depths(range)),
                Format::Png16 | Format::Exr => {
                    Err("to stdout, pipes and devices goes PNG with 8 bits; name a file for more".into())
                }
            };
        }
        let written = self.picture(&loaded, &camera, &settings, (output, format), progress)?;
        progress.finish();
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
            return Err(format!("{}: a sequence needs {FRAME} in its name", output.display()).into());
        }
        let is_exr = output.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        if is_exr && !self.ids && !self.depth {
            check_output(output, "exr")?;
            return Ok(Format::Exr);
        }
        check_output(output, "png")?;
        Ok(match self.bits.as_str() {
            _ if self.ids => Format::Ids,
            "16" => Format::Png16,
            _ => Format::Png8,
        })
    }

    fn settings(&self, scene: &Scene) -> Result<RenderSettings, Failure> {
        let settings = &scene.meta().settings;
        let up = settings.up.unit();
        if self.ids || self.depth {
            return Ok(RenderSettings::middles(up));
        }
        let metres = super::numbers::metres_of_unit(&settings.unit)
            .ok_or_else(|| format!("the scene's unit \"{}\" is not known", settings.unit))?;
        Ok(RenderSettings {
            samples_per_pixel: self.spp.first().copied().unwrap_or(1),
            lighting: self.light.lighting(up, metres)?,
            shadows: self.light.shadows(),
            up,
            seed: self.seed,
        })
    }

    /// The cameras of all frames.
    fn read_path(&self) -> Result<Option<Vec<Camera>>, Failure> {
        let Some(file) = &self.path else { return Ok(None) };
        let told = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
        let text = std::fs::read_to_string(file).map_err(|error| told(&error))?;
        let path = CameraPath::from_json(&text, self.size).map_err(|error| told(&error))?;
        let views = path.views().map_err(|error| told(&error))?;
        Ok(Some(views.into_iter().map(|view| view.camera).collect()))
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
        let digits = cameras.len().saturating_sub(1).to_string().len().max(FRAME_DIGITS);
        let (mut new, mut before) = (0, 0);
        for frame in frames.clone() {
            let camera = &cameras[frame];
            let name = output.to_string_lossy().replace(FRAME, &format!("{frame:0digits$}"));
            let pixels = u64::from(camera.width) * u64::from(camera.height);
            progress.stage(&format!("frame {frame} of {}", cameras.len()), pixels, "pixels");
            // Other samples in each frame: noise that stands still would look like dirt on the glass.
            let settings =
                RenderSettings { seed: settings.seed.wrapping_add(frame as u32), ..settings.clone() };
            match self.picture(loaded, camera, &settings, (Path::new(&name), format), progress)? {
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

/// What came of a picture, for people.
fn tell(path: &Path, written: &Written) -> Result<(), Failure> {
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
            let name = format!("{kind:?}").to_lowercase();
            let rate = rays as f64 / time * 1e-6;
            print_out!("{name}: {:.1} M shadow rays, {rate:.2} M a second and thread", rays as f64 * 1e-6)?;
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

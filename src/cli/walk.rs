//! `voxsight walk`: draws a camera path off screen, and tells what every frame took.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use image::RgbaImage;

use super::light::LightFlags;
use super::numbers::{metres_of_unit, parse_bytes, parse_count, parse_frames, parse_size};
use super::output::{check_output, human_bytes, print_json, print_out, write_json, write_png, write_whole};
use super::path::{FRAME, frame_name, read_views};
use super::progress::TerminalProgress;
use super::walk_summary::{Checked, SETTLING, Summary};
use super::{Failure, usage};
use crate::camera::Camera;
use crate::gpu::check::{compare, expected};
use crate::gpu::marks::Marks;
use crate::gpu::shadow::ShadowSettings;
use crate::gpu::{Context, ContextSettings};
use crate::human::grouped;
use crate::lab::space::Space;
use crate::lab::views::{View, ViewSettings};
use crate::lab::walk::walk;
use crate::loaded::LoadedScene;
use crate::lod::density::DensitySettings;
use crate::progress::Progress;
use crate::render::Lighting;
use crate::scene::Scene;
use crate::streaming::StreamSettings;
use crate::visibility::coherent::CoherentSettings;
use crate::visibility::{RayMethod, RaysPerPixel};
use crate::walkthrough::{
    FrameRecord, Latency, Look, Upload, WalkSettings, Walkthrough, csv_header, csv_line,
};

/// Flags of `walk`.
#[derive(Args)]
pub struct Walk {
    /// The scene
    #[arg(value_name = "SCENE.vxs")]
    scene: PathBuf,
    /// The camera path: keyframes, or a list of cameras, as `render --path` takes it
    #[arg(long, value_name = "PATH.json", required_unless_present = "walk", conflicts_with = "walk")]
    path: Option<PathBuf>,
    /// Frames of a random walk through the model instead, 30 a second
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    walk: Option<u32>,
    /// Another seed, another random walk
    #[arg(long, default_value = "1", value_name = "N")]
    seed: u64,
    /// These frames only, such as 0-299
    #[arg(long, value_name = "A-B", value_parser = parse_frames)]
    frames: Option<Range<usize>>,
    /// Picture size [default: 1024x1024, or that of the path's cameras]
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<(u32, u32)>,
    /// Bytes of geometry on the GPU, at most
    #[arg(long, visible_alias = "budget-bytes", default_value = "256M", value_parser = parse_bytes, value_name = "BYTES")]
    budget: u64,
    /// Bytes copied there in a frame, at most
    #[arg(long, default_value = "8M", value_parser = parse_bytes, value_name = "BYTES")]
    upload: u64,
    /// Triangles drawn in a frame, at most
    #[arg(long, visible_alias = "budget-triangles", default_value = "4M", value_parser = parse_count, value_name = "N")]
    triangles: u64,
    /// By how many pixels a level of detail may be wrong; 0 for the finest only
    #[arg(long, default_value = "0.5", value_name = "PIXELS")]
    pixel_error: f64,
    /// Drawables with fewer pixels are not drawn
    #[arg(long, default_value = "0", value_name = "PIXELS")]
    least_pixels: f64,
    /// Rays per pixel and frame that ask what is visible, such as 1/16 or 1
    #[arg(long, default_value = "1/16", value_name = "R")]
    rays: RaysPerPixel,
    /// newest: draw the newest answer of what is visible; none: wait for each frame's own
    #[arg(long, default_value = "newest")]
    latency: LatencyName,
    /// What is sent to the GPU: what changes (delta), all that is drawn every frame (full), the same one by one (each)
    #[arg(long, default_value = "delta")]
    streaming: UploadName,
    /// Load what will be seen so many frames later; 0 for nothing
    #[arg(long, default_value = "10", value_name = "FRAMES")]
    ahead: u32,
    /// Predict from the motion where the camera will be, as in a viewer, though the path is known
    #[arg(long)]
    unknown_route: bool,
    #[command(flatten)]
    light: LightFlags,
    /// With --shadows voxel: rays to each light for each pixel and frame [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    samples: Option<u32>,
    /// Compare the drawables of every frame with those that rays through the triangles find
    #[arg(long)]
    check: bool,
    /// A folder for the table of all frames, walk.csv, and the summary, walk.json
    #[arg(long, value_name = "DIR", conflicts_with = "csv")]
    out: Option<PathBuf>,
    /// The table alone: a line for each frame
    #[arg(long, value_name = "OUT.csv")]
    csv: Option<PathBuf>,
    /// Write every frame, {frame} where its number goes
    #[arg(long, short, value_name = "OUT-{frame}.png")]
    output: Option<PathBuf>,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
    /// Part of the name of the graphics adapter to use
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

/// The summary in a folder of results.
const SUMMARY: &str = "walk.json";

#[derive(Clone, Copy, ValueEnum)]
enum LatencyName {
    None,
    Newest,
}

#[derive(Clone, Copy, ValueEnum)]
enum UploadName {
    Delta,
    Full,
    Each,
}

impl Walk {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        let has_shadows = self.light.check_for_gpu()?;
        if self.samples.is_some() && !has_shadows {
            return Err(usage("--samples are of shadows: add --shadows voxel or --sky occluded"));
        }
        self.check_outputs()?;
        let settings = self.settings()?;
        let path = self.path.as_deref().map(|file| read_views(file, self.size)).transpose()?;
        // Before anything that takes long: without a driver there is nothing to do.
        let context = Context::new(&ContextSettings { adapter: self.adapter.clone(), ..Default::default() })?;
        let scene = Arc::new(LoadedScene::new(Scene::open(&self.scene)?, progress)?);
        let views = match path {
            Some(views) => views,
            None => self.random_walk(&scene)?,
        };
        let frames = self.frames.clone().unwrap_or(0..views.len());
        if frames.start >= views.len() || frames.end > views.len() {
            return Err(usage(format!("--frames: the path has frames 0-{}", views.len() - 1)));
        }
        let meta = &scene.scene().meta().settings;
        let metres = metres_of_unit(&meta.unit)
            .ok_or_else(|| format!("the scene's unit \"{}\" is not known", meta.unit))?;
        let lighting = self.light.lighting(meta.up.unit(), metres)?;
        if let Some(folder) = &self.out {
            make_folder(folder)?;
        }
        let mut walk = Walkthrough::new(Arc::clone(&scene), &context, settings)?;
        if has_shadows {
            progress.stage("load voxels", 0, "");
            walk.load_voxels()?;
        }
        let shadows =
            has_shadows.then_some(ShadowSettings { samples: self.samples.unwrap_or(1), smooth: true });
        let run = Run { flags: &self, scene: &scene, views: &views, lighting: &lighting, shadows };
        let summary = run.frames(frames, &mut walk, &context, progress)?;
        progress.finish();
        for (page, error) in walk.failed() {
            progress.remark(&format!("level {page} could not be loaded: {error}"));
        }
        if let Some(folder) = &self.out {
            write_json(&folder.join(SUMMARY), &summary)?;
        }
        if self.json {
            return print_json(&summary);
        }
        print_summary(&summary, &self)
    }

    fn check_outputs(&self) -> Result<(), Failure> {
        if let Some(csv) = &self.csv {
            check_output(csv, &["csv"])?;
        }
        if let Some(output) = &self.output {
            check_output(output, &["png"])?;
            if !output.to_string_lossy().contains(FRAME) {
                return Err(usage(format!("{}: frames need {FRAME} in their names", output.display())));
            }
        }
        Ok(())
    }

    /// Where the table goes.
    fn table(&self) -> Option<PathBuf> {
        self.csv.clone().or_else(|| self.out.as_ref().map(|folder| folder.join("walk.csv")))
    }

    fn settings(&self) -> Result<WalkSettings, Failure> {
        if !(self.pixel_error >= 0.0 && self.least_pixels >= 0.0) {
            return Err(usage("--pixel-error and --least-pixels are 0 or more"));
        }
        let stream = StreamSettings { budget: self.budget, upload: self.upload, ..StreamSettings::default() };
        if stream.budget < 1 << 16 || stream.upload < 1 << 12 {
            return Err(usage("--budget is at least 64K, --upload at least 4K"));
        }
        Ok(WalkSettings {
            query: CoherentSettings::new(RayMethod::Hybrid, self.rays),
            lod: DensitySettings {
                budget: self.triangles,
                pixel_error: self.pixel_error,
                least_pixels: self.least_pixels,
                ..DensitySettings::default()
            },
            stream,
            latency: match self.latency {
                LatencyName::None => Latency::None,
                LatencyName::Newest => Latency::Newest,
            },
            upload: match self.streaming {
                UploadName::Delta => Upload::Delta,
                UploadName::Full => Upload::Full,
                UploadName::Each => Upload::Each,
            },
            ahead: self.ahead.into(),
            wait: true,
        })
    }

    fn random_walk(&self, scene: &LoadedScene) -> Result<Vec<View>, Failure> {
        let space = Space::new(scene.query(), scene.scene().meta());
        let count = self.walk.unwrap_or(1);
        let settings = ViewSettings { count, seed: self.seed, size: self.size.unwrap_or((1024, 1024)) };
        Ok(walk(&space, &settings)?.0)
    }
}

/// Makes a folder for results, without the summary of an earlier walk: a walk that is stopped writes none.
fn make_folder(folder: &Path) -> Result<(), Failure> {
    let told = |error: std::io::Error| format!("{}: cannot be written to: {error}", folder.display());
    std::fs::create_dir_all(folder).map_err(told)?;
    match std::fs::remove_file(folder.join(SUMMARY)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(told(error).into()),
        _ => Ok(()),
    }
}

/// What the frames of a walk share.
struct Run<'a> {
    flags: &'a Walk,
    scene: &'a LoadedScene,
    views: &'a [View],
    lighting: &'a Lighting,
    shadows: Option<ShadowSettings>,
}

impl Run<'_> {
    /// Draws all frames; the table is written when they are done, or stopped.
    fn frames(
        &self,
        frames: Range<usize>,
        walk: &mut Walkthrough,
        context: &Context,
        progress: &TerminalProgress,
    ) -> Result<Summary, Failure> {
        let marks = Marks::default();
        let look = Look {
            lighting: self.lighting,
            up: self.scene.scene().meta().settings.up.unit(),
            marks: &marks,
            shadows: self.shadows,
            caps: false,
        };
        let mut summary = Summary::new(context, self.flags.budget, self.flags.triangles);
        let mut table = csv_header();
        if self.flags.check {
            table += ",check_pixels,check_differ,check_off_silhouettes,check_lost";
        }
        table.push('\n');
        progress.stage("walk", frames.len() as u64, "frames");
        let mut frame = |number: usize| -> Result<(), Failure> {
            let view = &self.views[number];
            let is_cut = view.starts_anew || number == frames.start;
            let record = walk.frame(&view.camera, is_cut, self.later(number), &look)?;
            // The path's number, as pictures have it.
            let record = FrameRecord { frame: number as u64, ..record };
            let checked = self.check(walk, context, &view.camera, progress)?;
            if self.flags.check && checked.is_none() {
                // Stopped amid it.
                return Ok(());
            }
            table += &csv_line(&record);
            if let Some(Checked { difference, .. }) = &checked {
                table += &format!(
                    ",{},{},{},{}",
                    difference.pixels, difference.differ, difference.off_silhouettes, difference.lost
                );
            }
            table.push('\n');
            summary.add(&record, checked);
            if let Some(output) = &self.flags.output {
                self.write_picture(walk, context, view, &frame_name(output, number, self.views.len()))?;
            }
            progress.advance(1);
            Ok(())
        };
        let done = frames.clone().take_while(|_| !progress.is_cancelled()).try_for_each(&mut frame);
        // What was measured is kept, whatever came then.
        let csv = self.flags.table().map_or(Ok(()), |csv| write_whole(&csv, table.as_bytes()));
        done?;
        csv?;
        if progress.is_cancelled() {
            return Err(format!("stopped after {} of {} frames", summary.frames(), frames.len()).into());
        }
        summary.finish();
        Ok(summary)
    }

    /// Where the camera will be, as far as it is known.
    fn later(&self, number: usize) -> Option<Camera> {
        let later = self.views.get(number + self.flags.ahead as usize).or(self.views.last());
        later.filter(|_| !self.flags.unknown_route && self.flags.ahead > 0).map(|view| view.camera)
    }

    fn check(
        &self,
        walk: &Walkthrough,
        context: &Context,
        camera: &Camera,
        progress: &TerminalProgress,
    ) -> Result<Option<Checked>, Failure> {
        if !self.flags.check {
            return Ok(None);
        }
        let found: Vec<u32> = walk.renderer().targets().drawable.read(context)?;
        let quiet = crate::progress::Quiet(progress);
        let rays = camera.rays()?;
        let expected = expected(walk.shown(), &rays, &quiet);
        Ok(expected.map(|expected| Checked { difference: compare(&expected, &found, rays.size()).0 }))
    }

    fn write_picture(
        &self,
        walk: &Walkthrough,
        context: &Context,
        view: &View,
        path: &Path,
    ) -> Result<(), Failure> {
        let texels: Vec<[u8; 4]> = walk.renderer().targets().picture.read(context)?;
        let picture = RgbaImage::from_raw(view.camera.width, view.camera.height, texels.into_flattened())
            .ok_or("the picture read back is too short")?;
        write_png(path, &image::DynamicImage::ImageRgba8(picture).to_rgb8())
    }
}

fn print_summary(summary: &Summary, flags: &Walk) -> Result<(), Failure> {
    print_out!("{} frames on {} ({})", summary.frames(), summary.adapter, summary.adapter_kind)?;
    print_out!("{:<10} {:>9} {:>9} {:>9} {:>9}   milliseconds", "", "median", "95 %", "99 %", "worst")?;
    for stage in &summary.stages {
        print_out!(
            "{:<10} {:>9.2} {:>9.2} {:>9.2} {:>9.2}",
            stage.name,
            stage.median,
            stage.p95,
            stage.p99,
            stage.worst
        )?;
    }
    print_out!(
        "{:.1} frames a second; {:.1} over the slowest hundredth of the frames",
        summary.frames_per_second,
        summary.one_percent_low
    )?;
    print_out!(
        "geometry: {} resident (at most {} of {}), {} written in all, {} in the worst frame",
        human_bytes(summary.resident_mean),
        human_bytes(summary.resident_most),
        human_bytes(flags.budget),
        human_bytes(summary.written),
        human_bytes(summary.written_most)
    )?;
    if let Some(share) = summary.written_share_in_motion {
        print_out!(
            "written a frame, later than 30 frames after a cut: {:.3} % of what is resident",
            100.0 * share
        )?;
    }
    print_out!(
        "triangles: {} a frame, at most {} of {}; missing drawables: {} in all, {} later than 3 frames after a cut",
        grouped(summary.triangles_mean),
        grouped(summary.triangles_most),
        grouped(flags.triangles),
        summary.missing,
        summary.missing_late
    )?;
    if summary.failed_pages > 0 {
        print_out!("{} levels could not be loaded: `voxsight verify` tells more", summary.failed_pages)?;
    }
    if let Some(check) = &summary.check {
        match &check.settled {
            Some(settled) => print_out!(
                "against exact: {:.4} % of the pixels differ (worst frame {:.4} %), {:.4} % away from silhouettes, without cuts and the \
                 {SETTLING} frames after each",
                100.0 * settled.differ_mean,
                100.0 * settled.differ_worst,
                100.0 * settled.off_silhouettes_mean
            )?,
            None => print_out!("against exact: no frame is later than {SETTLING} frames after a cut")?,
        }
        if let Some(settling) = check.differ_after_cuts {
            print_out!("in cuts and the {SETTLING} frames after each {:.4} % differ", 100.0 * settling)?;
        }
        print_out!("{} drawables of 16 pixels and more lost in all frames", check.lost)?;
    }
    Ok(())
}

//! `voxsight compare`: run time against error of several methods over many views, as a report.

use std::io::Cursor;
use std::path::PathBuf;

use clap::Args;
use image::RgbImage;

use super::numbers::{parse_rays, parse_size};
use super::output::print_out;
use super::path::read_path;
use super::progress::TerminalProgress;
use super::{Failure, usage};
use crate::lab::csv::frames_csv;
use crate::lab::folder::{REPORT_JSON, check_folder, write_folder};
use crate::lab::keyframes::CameraPath;
use crate::lab::methods::{FLOOR, MethodKind};
use crate::lab::page::{PageParts, WorstPage, page, percent};
use crate::lab::picture::{WorstPictures, at_most_wide, worst_pictures};
use crate::lab::plots::{frames, pareto, spread, stages};
use crate::lab::report::{Report, ReportSettings};
use crate::lab::run::{Contestant, LEAST_REFERENCE_RAYS, Outcome, RunSettings, run};
use crate::lab::space::Space;
use crate::lab::views::{Rejected, View, ViewSettings, random_views};
use crate::lab::walk::walk;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::visibility::{Method, RaysPerPixel};

/// Width of pictures in the page; the files beside it have the size of the views.
const PAGE_PICTURE_WIDTH: u32 = 640;
/// What is said after Ctrl-C.
const STOPPED: &str = "stopped; nothing was written";

/// Flags of `compare`.
#[derive(Args)]
pub struct Compare {
    /// The scene, and the same model built at other resolutions
    #[arg(required = true, value_name = "SCENE.vxs")]
    scenes: Vec<PathBuf>,
    /// Methods, separated by commas; exact is always among them: it is the sampling floor
    #[arg(long, value_delimiter = ',', default_value = "frustum,hzm,hzb,voxel,hybrid", value_name = "A,B,C")]
    methods: Vec<String>,
    /// Rays per pixel, separated by commas, such as 1/16,1,4
    #[arg(long, value_delimiter = ',', default_value = "1", value_name = "R,...")]
    rays: Vec<RaysPerPixel>,
    /// Random views inside the model; every fifth is from outside
    #[arg(long, default_value = "100", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    views: u32,
    /// Frames along a camera path instead
    #[arg(long, value_name = "PATH.json", conflicts_with_all = ["views", "walk"])]
    path: Option<PathBuf>,
    /// Frames of a random walk through the model instead, 30 a second
    #[arg(long, value_name = "N", conflicts_with = "views", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    walk: Option<u32>,
    /// Another seed, other views
    #[arg(long, default_value = "1", value_name = "N")]
    seed: u64,
    /// Image size [default: 1024x1024, or that of the path's cameras]
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<(u32, u32)>,
    /// Rays per pixel of the reference, 16 or more
    #[arg(long, default_value = "16", value_parser = parse_rays, value_name = "N")]
    reference_rays: u32,
    /// What casts the reference's rays: hybrid gives the answers of exact sooner (checked on the first view)
    #[arg(long, default_value = "exact", value_name = "METHOD")]
    reference: ReferenceName,
    /// Passes over all views; the median time counts
    #[arg(long, default_value = "3", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Frames that each view is shown to methods that keep what they found: judged by the last, timed over all
    #[arg(long, default_value = "1", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    still: u32,
    /// Folder for the report: new, empty, or with an earlier report
    #[arg(long, short, alias = "out", value_name = "FOLDER")]
    output: PathBuf,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ReferenceName {
    Exact,
    Hybrid,
}

impl From<ReferenceName> for Method {
    fn from(name: ReferenceName) -> Self {
        match name {
            ReferenceName::Exact => Method::Exact,
            ReferenceName::Hybrid => Method::Hybrid,
        }
    }
}

impl Compare {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        check_folder(&self.output)?;
        if self.reference_rays < LEAST_REFERENCE_RAYS {
            return Err(
                format!("--reference-rays {}: a reference needs at least 16", self.reference_rays).into()
            );
        }
        let kinds = self.kinds()?;
        let path = self.read_path()?;
        let opened: Vec<Scene> = self.scenes.iter().map(Scene::open).collect::<Result<_, _>>()?;
        let scenes: Vec<LoadedScene> =
            opened.into_iter().map(|scene| LoadedScene::new(scene, progress)).collect::<Result<_, _>>()?;
        let mut contestants = self.contestants(&kinds, &scenes)?;
        let Some(first) = scenes.first() else { return Err("no scene was named".into()) };

        let (views, rejected) = self.draw_views(path, first)?;
        let settings = RunSettings {
            reference_rays: self.reference_rays,
            repeats: self.repeats,
            reference_method: self.reference.into(),
            frames_a_view: self.still,
        };
        let outcome = run(first, &views, &mut contestants, &settings, progress)?;
        let report_settings =
            ReportSettings { views: self.source(), is_path: self.is_path(), seed: self.seed, run: settings };
        let mut report = Report::new(&scenes, views, rejected, report_settings, &outcome);
        let files = files(first, &mut report, &outcome, progress)?;
        if progress.is_cancelled() {
            return Err(STOPPED.into());
        }
        write_folder(&self.output, &files)?;
        progress.finish();
        self.print(&report)
    }

    /// The methods asked for, and the floor.
    fn kinds(&self) -> Result<Vec<&'static MethodKind>, Failure> {
        let mut kinds: Vec<&'static MethodKind> = Vec::new();
        for name in self.methods.iter().map(|name| name.trim()).chain([FLOOR]) {
            let kind = MethodKind::named(name).map_err(|error| usage(error.to_string()))?;
            if !kinds.iter().any(|other| other.name == kind.name) {
                kinds.push(kind);
            }
        }
        Ok(kinds)
    }

    /// Every method with every parameter that it has.
    fn contestants<'s>(
        &self,
        kinds: &[&MethodKind],
        scenes: &'s [LoadedScene],
    ) -> Result<Vec<Contestant<'s>>, Failure> {
        let mut contestants: Vec<Contestant<'s>> = Vec::new();
        for kind in kinds {
            let scenes = if kind.uses_voxels { scenes } else { scenes.get(..1).unwrap_or_default() };
            let rays = if kind.takes_rays { self.rays.as_slice() } else { &[RaysPerPixel::ONE] };
            for scene in scenes {
                for &rays in rays {
                    let variant = kind.variant(scene, rays);
                    if !contestants.iter().any(|other| other.variant == variant) {
                        contestants.push(Contestant { variant, scene, culling: kind.make(scene, rays) });
                    }
                }
            }
        }
        Ok(contestants)
    }

    fn read_path(&self) -> Result<Option<CameraPath>, Failure> {
        let Some(file) = &self.path else { return Ok(None) };
        Ok(Some(read_path(file, self.size)?))
    }

    fn draw_views(
        &self,
        path: Option<CameraPath>,
        scene: &LoadedScene,
    ) -> Result<(Vec<View>, Option<Rejected>), Failure> {
        if let Some(path) = path {
            return Ok((path.views()?, None));
        }
        let space = Space::new(scene.query(), scene.scene().meta());
        let count = self.walk.unwrap_or(self.views);
        let settings = ViewSettings { count, seed: self.seed, size: self.size.unwrap_or((1024, 1024)) };
        let draw = if self.walk.is_some() { walk } else { random_views };
        let (views, rejected) = draw(&space, &settings)?;
        Ok((views, Some(rejected)))
    }

    fn is_path(&self) -> bool {
        self.path.is_some() || self.walk.is_some()
    }

    /// Where the views come from.
    fn source(&self) -> String {
        match (&self.path, self.walk) {
            (Some(path), _) => {
                format!("the camera path {}", path.file_name().unwrap_or_default().to_string_lossy())
            }
            (None, Some(frames)) => format!("a walk of {frames} frames"),
            (None, None) => format!("{} random views", self.views),
        }
    }

    fn print(&self, report: &Report) -> Result<(), Failure> {
        print_out!(
            "{:<28} {:>10} {:>12} {:>12} {:>12} {:>16} {:>12}",
            "method",
            "ms, median",
            "lost pixels",
            "worst view",
            "x floor",
            "hidden >= 16 px",
            "needless"
        )?;
        for method in &report.methods {
            let ratio = method.times_the_floor.map_or_else(|| "-".into(), |ratio| format!("{ratio:.2}"));
            print_out!(
                "{:<28} {:>10.2} {:>12} {:>12} {:>12} {:>16} {:>12}",
                method.variant.to_string(),
                1e3 * method.time.distribution.median,
                percent(method.lost_pixels.mean),
                percent(method.lost_pixels.worst),
                ratio,
                percent(method.classes.last().map_or(0.0, |class| class.wrongly_hidden.mean)),
                percent(method.needlessly_drawn.mean),
            )?;
        }
        print_out!(
            "({} of {}; means over views; exact is the sampling floor)\nThe report: {}",
            report.settings.views,
            report.views.first().map_or_else(String::new, |view| {
                format!("{} x {}", view.view.camera.width, view.view.camera.height)
            }),
            self.output.join("report.html").display()
        )
    }
}

/// All files of the report.
fn files(
    scene: &LoadedScene,
    report: &mut Report,
    outcome: &Outcome,
    progress: &TerminalProgress,
) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    let mut worst = Vec::new();
    let representatives = report.representatives();
    progress.stage("pictures of the worst views", 0, "");
    for index in representatives {
        let Some((view, answer)) = &outcome.methods[index].worst else { continue };
        let method = &report.methods[index];
        if method.lost_pixels.worst == 0.0 {
            continue;
        }
        let camera = report.views[*view].view.camera.rays()?;
        let query = report.settings.run.reference_query();
        let pictures = worst_pictures(scene, &camera, &query, answer, progress).ok_or(STOPPED)?;
        let WorstPictures { reference, answer, detail, lost_pixels } = pictures;
        let shown = |image: &RgbImage| png(&at_most_wide(image, PAGE_PICTURE_WIDTH));
        worst.push(WorstPage {
            method: index,
            reference: shown(&reference)?,
            answer: shown(&answer)?,
            detail: png(&detail)?,
            lost_pixels,
        });
        for (what, image) in [("reference", &reference), ("lost", &answer), ("detail", &detail)] {
            files.push((format!("worst-{}-{what}.png", method.variant.method), png(image)?));
        }
    }
    let frames = report.settings.is_path.then(|| frames(report)).transpose()?;
    let parts = PageParts {
        pareto: pareto(report)?,
        stages: stages(report)?,
        spread: spread(report)?,
        frames,
        worst,
    };
    for (name, svg) in [("pareto", &parts.pareto), ("stages", &parts.stages), ("spread", &parts.spread)] {
        files.push((format!("{name}.svg"), svg.clone().into_bytes()));
    }
    if let Some(svg) = &parts.frames {
        files.push(("frames.svg".into(), svg.clone().into_bytes()));
    }
    files.push(("frames.csv".into(), frames_csv(report).into_bytes()));
    files.push(("report.html".into(), page(report, &parts).into_bytes()));
    report.files = files.iter().map(|(name, _)| name.clone()).chain([REPORT_JSON.to_owned()]).collect();
    files.push((REPORT_JSON.into(), report.to_json()?.into_bytes()));
    Ok(files)
}

fn png(image: &RgbImage) -> Result<Vec<u8>, Failure> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

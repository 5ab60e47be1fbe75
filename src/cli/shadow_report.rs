//! `voxsight render --report`: every way of casting shadow rays against triangles, as figures, chart and pictures.

use std::io::Cursor;
use std::path::Path;

use image::RgbImage;
use serde::Serialize;

use super::Failure;
use super::output::print_out;
use super::progress::TerminalProgress;
use crate::camera::Camera;
use crate::lab::folder::{REPORT_JSON, check_folder, write_folder};
use crate::lab::page::percent;
use crate::lab::run::check_same_model;
use crate::lab::shadows::{
    FORMAT, KindTime, Picture, PictureReport, ShadowOutcome, ShadowRun, chart, difference, flip,
};
use crate::loaded::LoadedScene;
use crate::render::{KeyLight, RenderSettings, Shadows, Sky};
use crate::scene::Scene;

#[derive(Serialize)]
struct Report<'a> {
    format: &'static str,
    voxsight: &'static str,
    files: Vec<String>,
    scenes: Vec<String>,
    camera: &'a Camera,
    light: LightReport,
    converged_samples: u32,
    pictures: Vec<&'a PictureReport>,
    /// What differs from run to run: in the order of the pictures, light by light.
    times: Vec<&'a [KindTime]>,
}

/// What shines, as a report tells it: world space, model units.
#[derive(Serialize)]
struct LightReport {
    /// Towards the sun; missing where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    sun: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sun_angle_deg: Option<f64>,
    /// `none`, `plain` or `occluded`.
    sky: &'static str,
    /// Missing where the sky is occluded from any distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    sky_reach: Option<f64>,
    areas: Vec<AreaReport>,
    /// Of `hybrid`: share of a penumbra's width.
    tolerance: Option<f64>,
    seed: u32,
}

#[derive(Serialize)]
struct AreaReport {
    corner: [f64; 3],
    edge_u: [f64; 3],
    edge_v: [f64; 3],
    radiance: [f64; 3],
}

impl LightReport {
    fn new(settings: &RenderSettings) -> Self {
        let sun = match settings.lighting.key {
            KeyLight::Sun(sun) => Some(sun),
            KeyLight::Headlight | KeyLight::None => None,
        };
        let (sky, sky_reach) = match settings.lighting.sky {
            Sky::None => ("none", None),
            Sky::Plain => ("plain", None),
            Sky::Occluded { reach } => ("occluded", reach.is_finite().then_some(reach)),
        };
        let areas = settings.lighting.areas.iter().map(|area| AreaReport {
            corner: area.corner.into(),
            edge_u: area.edge_u.into(),
            edge_v: area.edge_v.into(),
            radiance: area.radiance.into(),
        });
        let tolerance = match settings.shadows {
            Shadows::Hybrid { tolerance } => Some(tolerance),
            Shadows::None | Shadows::Voxel | Shadows::Exact => None,
        };
        LightReport {
            sun: sun.map(|sun| sun.direction.into()),
            sun_angle_deg: sun.map(|sun| sun.angle_deg),
            sky,
            sky_reach,
            areas: areas.collect(),
            tolerance,
            seed: settings.seed,
        }
    }
}

/// Renders, judges, writes the folder and prints the figures.
pub fn shadow_report(
    folder: &Path,
    opened: Vec<Scene>,
    camera: &Camera,
    settings: &RenderSettings,
    samples: &[u32],
    progress: &TerminalProgress,
) -> Result<(), Failure> {
    check_folder(folder)?;
    let rays = camera.rays()?;
    let scenes: Vec<LoadedScene> =
        opened.into_iter().map(|scene| LoadedScene::new(scene, progress)).collect::<Result<_, _>>()?;
    if let [first, others @ ..] = scenes.as_slice() {
        others.iter().try_for_each(|other| check_same_model(first, other))?;
    }
    let run = ShadowRun { scenes: &scenes, camera: &rays, settings, samples };
    let outcome = run.run(progress).ok_or("stopped; nothing was written")?;
    progress.finish();
    let mut files = pictures(&outcome)?;
    let reports: Vec<PictureReport> = outcome.pictures.iter().map(|picture| picture.report.clone()).collect();
    files.push(("shadows.svg".into(), chart(&reports)?.into_bytes()));
    let report = Report {
        format: FORMAT,
        voxsight: env!("CARGO_PKG_VERSION"),
        files: files.iter().map(|(name, _)| name.clone()).chain([REPORT_JSON.to_owned()]).collect(),
        scenes: scenes.iter().map(|scene| scene.scene().container().path().display().to_string()).collect(),
        camera,
        light: LightReport::new(settings),
        converged_samples: outcome.converged_samples,
        pictures: reports.iter().collect(),
        times: reports.iter().map(|picture| picture.time.as_slice()).collect(),
    };
    let mut text = serde_json::to_string_pretty(&report)?;
    text.push('\n');
    files.push((REPORT_JSON.into(), text.into_bytes()));
    write_folder(folder, &files)?;
    print(&reports)?;
    print_out!(
        "In {}: report.json, shadows.svg, the pictures, and where their shadows differ.",
        folder.display()
    )
}

/// The pictures with most samples, and how they differ from `exact`.
fn pictures(outcome: &ShadowOutcome) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let mut files = vec![("converged.png".to_owned(), png(&outcome.converged.to_rgb8())?)];
    let best = outcome.pictures.iter().filter_map(|Picture { report, film }| Some((report, film.as_ref()?)));
    let Some((_, exact)) = best.clone().find(|(report, _)| report.resolution.is_none()) else {
        return Ok(files);
    };
    for (report, film) in best {
        let name = match report.resolution {
            Some(side) => format!("{}-{side}", report.shadows),
            None => report.shadows.to_owned(),
        };
        files.push((format!("{name}.png"), png(&film.to_rgb8())?));
        if report.resolution.is_some() {
            files.push((format!("{name}-difference.png"), png(&difference(film, exact))?));
            files.push((format!("{name}-flip.png"), png(&flip(film, exact).1)?));
        }
    }
    Ok(files)
}

fn png(image: &RgbImage) -> Result<Vec<u8>, Failure> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// One line a picture and light.
fn print(reports: &[PictureReport]) -> Result<(), Failure> {
    print_out!(
        "shadows        samples  light  M rays  M/s a thread  wrongly dark  lit loses  wrongly lit  penumbra error  FLIP    error, converged"
    )?;
    for picture in reports {
        let name = match picture.resolution {
            Some(side) => format!("{} {side}\u{b3}", picture.shadows),
            None => picture.shadows.to_owned(),
        };
        let flip = picture.flip_same_samples.map_or_else(|| "\u{2013}".into(), |flip| format!("{flip:.4}"));
        for (light, time) in picture.lights.iter().zip(&picture.time) {
            let same = |figure: &dyn Fn(&crate::lab::shadows::ShadowErrors) -> f64| {
                light
                    .same_samples
                    .as_ref()
                    .map_or_else(|| "\u{2013}".into(), |errors| percent(figure(errors)))
            };
            // With one sample there is no penumbra to be wrong about.
            let has_penumbra = light.same_samples.as_ref().is_some_and(|errors| errors.penumbra > 0);
            let penumbra = match has_penumbra {
                true => same(&|errors| errors.penumbra_error),
                false => "\u{2013}".into(),
            };
            print_out!(
                "{name:<14} {:>7}  {:<5} {:>7.2} {:>13.2} {:>13} {:>10} {:>12} {:>15}  {flip:<6} {:>17}",
                picture.samples_per_pixel,
                light.light,
                light.rays as f64 * 1e-6,
                time.mrays,
                same(&|errors| errors.wrongly_dark),
                same(&|errors| errors.lit_loss),
                same(&|errors| errors.wrongly_lit),
                penumbra,
                percent(light.converged.mean_error),
            )?;
        }
    }
    Ok(())
}

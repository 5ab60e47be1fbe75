//! Shadows: what ways of casting shadow rays cost, and how wrong they are (DESIGN.md, section 7).
//!
//! Pictures differ in their shadow rays alone: same camera, same samples of pixels and lights. Each is judged twice. Against
//! `exact` with the same samples: what the voxels do wrong. Against a converged picture, `exact` with many other samples: what
//! a user sees, noise and all; this is what time is plotted against.

use serde::Serialize;

use super::chart::{Axis, Chart, Curve, Point, charts_svg};
use super::plots::plain;
use super::svg::{GREY, SvgError};
use crate::camera::CameraRays;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::render::{Film, FilmPixel, LightKind, MAX_SAMPLES, RenderSettings, Renderer, ShadowCost, Shadows};

/// First field of a report's JSON: what it is, and the version of its fields.
pub const FORMAT: &str = "voxsight-shadows 1";

/// Width of the chart, pixels.
const WIDTH: u32 = 960;
/// Samples of the converged picture: so many times those of the best one, and no fewer than [`LEAST_REFERENCE`].
const REFERENCE_FACTOR: u32 = 4;
const LEAST_REFERENCE: u32 = 64;

/// Errors of one kind of light over the pixels of a picture that are lit by it in the reference or could be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ShadowErrors {
    /// Pixels that the reference has in full light.
    pub lit: u64,
    /// Of these the fraction that has less than half of it.
    pub wrongly_dark: f64,
    /// Mean light that these lack, 0 to 1.
    pub lit_loss: f64,
    /// Pixels that the reference has in full shadow.
    pub dark: u64,
    /// Of these the fraction with more than half of the light: leaks.
    pub wrongly_lit: f64,
    /// Mean light that these have, 0 to 1.
    pub dark_gain: f64,
    /// Pixels in between.
    pub penumbra: u64,
    /// Mean difference of visibility there, 0 to 1.
    pub penumbra_error: f64,
    /// Mean difference of visibility over all these pixels.
    pub mean_error: f64,
}

/// Compares the visibility of one kind of light pixel by pixel. Pixels that cast no such ray in either are left out.
pub fn shadow_errors(answer: &Film, reference: &Film, kind: LightKind) -> ShadowErrors {
    let mut errors = ShadowErrors::default();
    let (mut dark, mut lit) = (0u64, 0u64);
    let mut all = 0u64;
    for (pixel, truth) in visible(answer, reference, kind) {
        let difference = (pixel - truth).abs();
        all += 1;
        errors.mean_error += difference;
        if truth == 1.0 {
            errors.lit += 1;
            errors.lit_loss += difference;
            dark += u64::from(pixel < 0.5);
        } else if truth == 0.0 {
            errors.dark += 1;
            errors.dark_gain += difference;
            lit += u64::from(pixel > 0.5);
        } else {
            errors.penumbra += 1;
            errors.penumbra_error += difference;
        }
    }
    let share = |part: f64, whole: u64| if whole == 0 { 0.0 } else { part / whole as f64 };
    ShadowErrors {
        lit_loss: share(errors.lit_loss, errors.lit),
        dark_gain: share(errors.dark_gain, errors.dark),
        wrongly_dark: share(dark as f64, errors.lit),
        wrongly_lit: share(lit as f64, errors.dark),
        penumbra_error: share(errors.penumbra_error, errors.penumbra),
        mean_error: share(errors.mean_error, all),
        ..errors
    }
}

/// Visibility of the light in the answer and in the reference, where both have one.
fn visible<'f>(
    answer: &'f Film,
    reference: &'f Film,
    kind: LightKind,
) -> impl Iterator<Item = (f64, f64)> + 'f {
    let of = move |pixel: &FilmPixel| pixel.shadow[kind as usize].visibility();
    answer.pixels.iter().zip(&reference.pixels).filter_map(move |(a, r)| Some((of(a)?, of(r)?)))
}

/// One kind of light in one picture.
#[derive(Clone, Debug, Serialize)]
pub struct KindReport {
    /// `sun`, `sky` or `area`.
    pub light: &'static str,
    /// Shadow rays.
    pub rays: u64,
    /// Against `exact` with the same samples; `None` for `exact` itself.
    pub same_samples: Option<ShadowErrors>,
    /// Against the converged picture.
    pub converged: ShadowErrors,
}

/// One picture.
#[derive(Clone, Debug, Serialize)]
pub struct PictureReport {
    /// `voxel`, `hybrid` or `exact`.
    pub shadows: &'static str,
    /// Voxels a side; `None` for `exact`.
    pub resolution: Option<u32>,
    /// Samples per pixel.
    pub samples_per_pixel: u32,
    /// Light by light.
    pub lights: Vec<KindReport>,
    /// FLIP against `exact` with the same samples: mean over the pixels.
    pub flip_same_samples: Option<f64>,
    /// FLIP against the converged picture.
    pub flip_converged: f64,
    /// Kept apart: what differs from run to run.
    #[serde(skip)]
    pub time: Vec<KindTime>,
}

/// What the shadow rays of one kind of light took.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct KindTime {
    /// Seconds, all threads together.
    pub thread_seconds: f64,
    /// Rays a second and thread, millions.
    pub mrays: f64,
}

/// A picture with its report.
pub struct Picture {
    /// Figures.
    pub report: PictureReport,
    /// Pixels; only of the pictures with most samples, as they take much memory.
    pub film: Option<Film>,
}

/// What is compared.
pub struct ShadowRun<'a> {
    /// The same model at several resolutions; `exact` is asked about the first.
    pub scenes: &'a [LoadedScene],
    /// Where from.
    pub camera: &'a CameraRays,
    /// Light, and everything but samples; [`Shadows::Hybrid`] as it shall be compared, or the usual one.
    pub settings: &'a RenderSettings,
    /// Samples per pixel, one after the other.
    pub samples: &'a [u32],
}

/// All pictures of a run.
pub struct ShadowOutcome {
    /// `exact` first, for each number of samples.
    pub pictures: Vec<Picture>,
    /// The converged picture.
    pub converged: Film,
    /// Its samples per pixel.
    pub converged_samples: u32,
}

impl ShadowRun<'_> {
    /// Renders everything; `None` when cancelled.
    pub fn run(&self, progress: &dyn Progress) -> Option<ShadowOutcome> {
        let first = self.scenes.first()?;
        let most = self.samples.iter().copied().max().unwrap_or(1);
        let converged_samples = most.saturating_mul(REFERENCE_FACTOR).clamp(LEAST_REFERENCE, MAX_SAMPLES);
        // Another seed: it shares no sample with the others.
        let converged = RenderSettings {
            samples_per_pixel: converged_samples,
            shadows: Shadows::Exact,
            seed: !self.settings.seed,
            ..self.settings.clone()
        };
        let (converged, _) = self.picture(first, &converged, "converged", progress)?;
        let mut pictures: Vec<Picture> = Vec::new();
        for &samples in self.samples {
            let settings =
                |shadows| RenderSettings { samples_per_pixel: samples, shadows, ..self.settings.clone() };
            let told = format!("exact, {samples} samples");
            let (exact, cost) = self.picture(first, &settings(Shadows::Exact), &told, progress)?;
            let report = picture_report("exact", None, samples, (&exact, &cost), None, &converged);
            let keep = |film: &Film| (samples == most).then(|| film.clone());
            pictures.push(Picture { report, film: keep(&exact) });
            for scene in self.scenes {
                let side = scene.scene().grid().side();
                let hybrid = match self.settings.shadows {
                    hybrid @ Shadows::Hybrid { .. } => hybrid,
                    _ => Shadows::HYBRID,
                };
                for (shadows, way) in [(Shadows::Voxel, "voxel"), (hybrid, "hybrid")] {
                    let told = format!("{way} {side}\u{b3}, {samples} samples");
                    let (film, cost) = self.picture(scene, &settings(shadows), &told, progress)?;
                    let report =
                        picture_report(way, Some(side), samples, (&film, &cost), Some(&exact), &converged);
                    pictures.push(Picture { report, film: keep(&film) });
                }
            }
        }
        Some(ShadowOutcome { pictures, converged, converged_samples })
    }

    fn picture(
        &self,
        scene: &LoadedScene,
        settings: &RenderSettings,
        told: &str,
        progress: &dyn Progress,
    ) -> Option<(Film, ShadowCost)> {
        let (width, height) = self.camera.size();
        progress.stage(told, u64::from(width) * u64::from(height), "pixels");
        Renderer::new(&scene.picture(), self.camera, settings).rows(0..height, progress)
    }
}

fn picture_report(
    shadows: &'static str,
    resolution: Option<u32>,
    samples_per_pixel: u32,
    (film, cost): (&Film, &ShadowCost),
    exact: Option<&Film>,
    converged: &Film,
) -> PictureReport {
    let kinds = LightKind::ALL.into_iter().filter(|&kind| cost.rays[kind as usize] > 0);
    let light = |kind: LightKind| KindReport {
        light: kind.name(),
        rays: cost.rays[kind as usize],
        same_samples: exact.map(|exact| shadow_errors(film, exact, kind)),
        converged: shadow_errors(film, converged, kind),
    };
    let time = |kind: LightKind| {
        let seconds = cost.time[kind as usize].as_secs_f64();
        KindTime {
            thread_seconds: seconds,
            mrays: cost.rays[kind as usize] as f64 / seconds.max(1e-9) * 1e-6,
        }
    };
    PictureReport {
        shadows,
        resolution,
        samples_per_pixel,
        lights: kinds.clone().map(light).collect(),
        flip_same_samples: exact.map(|exact| flip(film, exact).0),
        flip_converged: flip(film, converged).0,
        time: kinds.map(time).collect(),
    }
}

/// FLIP (Andersson et al. 2020) between two pictures as screens show them: its mean, and its map in colours.
pub fn flip(answer: &Film, reference: &Film) -> (f64, image::RgbImage) {
    let picture = |film: &Film| {
        let image = film.to_rgb8();
        nv_flip::FlipImageRgb8::with_data(image.width(), image.height(), &image)
    };
    let map = nv_flip::flip(picture(reference), picture(answer), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    let mean = nv_flip::FlipPool::from_image(&map).mean();
    let shown = map.apply_color_lut(&nv_flip::magma_lut());
    let bytes = shown.to_vec();
    let at = |x: u32, y: u32| {
        let start = 3 * (y as usize * shown.width() as usize + x as usize);
        image::Rgb([bytes[start], bytes[start + 1], bytes[start + 2]])
    };
    (f64::from(mean), image::RgbImage::from_fn(shown.width(), shown.height(), at))
}

/// Where shadows differ: red is darker than it should be, blue lighter, the stronger the more; grey is right.
pub fn difference(answer: &Film, reference: &Film) -> image::RgbImage {
    let grey = reference.to_rgb8();
    image::RgbImage::from_fn(grey.width(), grey.height(), |x, y| {
        let place = y as usize * answer.width as usize + x as usize;
        let wrong = |kind: LightKind| {
            let of = |film: &Film| film.pixels[place].shadow[kind as usize].visibility();
            Some(of(answer)? - of(reference)?)
        };
        // Of the lights the one that is most wrong.
        let wrong = LightKind::ALL.into_iter().filter_map(wrong);
        let wrong = wrong.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
        let [r, g, b] = grey.get_pixel(x, y).0.map(f64::from);
        let ground = 0.4 * (r + g + b) / 3.0 + 0.6 * 235.0;
        let share = wrong.abs().min(1.0);
        let towards = if wrong < 0.0 { [214.0, 39.0, 40.0] } else { [31.0, 87.0, 214.0] };
        // Small differences are shown somewhat larger.
        let share = share.sqrt() * (1.0 - 0.5 * (1.0 - share));
        image::Rgb(towards.map(|c| (ground + (c - ground) * share).round() as u8))
    })
}

/// Time of shadow rays against error, a panel for each light, a curve for each way and resolution.
///
/// # Errors
///
/// Drawing failed.
pub fn chart(pictures: &[PictureReport]) -> Result<String, SvgError> {
    charts_svg(&panels("", pictures), WIDTH, 1)
}

/// The panels of [`chart`], with what is shown in their titles.
pub fn panels(name: &str, pictures: &[PictureReport]) -> Vec<Chart> {
    let mut lights: Vec<&'static str> = Vec::new();
    for light in pictures.iter().flat_map(|picture| &picture.lights) {
        if !lights.contains(&light.light) {
            lights.push(light.light);
        }
    }
    let name = if name.is_empty() { String::new() } else { format!("{name}: ") };
    lights.into_iter().map(|light| panel(&name, pictures, light)).collect()
}

fn panel(name: &str, pictures: &[PictureReport], light: &str) -> Chart {
    let mut curves: Vec<Curve> = Vec::new();
    for picture in pictures {
        let curve = match picture.resolution {
            Some(side) => format!("{} {side}\u{b3}", picture.shadows),
            None => picture.shadows.to_owned(),
        };
        let found = picture.lights.iter().zip(&picture.time).find(|(kind, _)| kind.light == light);
        let Some((kind, time)) = found else { continue };
        let point = Point {
            x: time.thread_seconds,
            y: 100.0 * kind.converged.mean_error,
            label: picture.samples_per_pixel.to_string(),
        };
        let is_dashed = picture.resolution.is_none();
        match curves.iter_mut().find(|known| known.name == curve) {
            Some(known) => known.points.push(point),
            None => {
                let colour = if is_dashed { GREY } else { curves.len() % GREY };
                curves.push(Curve { name: curve, colour, is_dashed, points: vec![point] });
            }
        }
    }
    Chart {
        title: format!("{name}shadows of the {light}, by samples a pixel"),
        x: Axis {
            label: "seconds of shadow rays, threads together".into(),
            name: plain,
            marks_at_points: false,
        },
        y: Axis { label: "mean error of visibility, %".into(), name: plain, marks_at_points: false },
        curves,
    }
}

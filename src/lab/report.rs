//! Everything that a comparison tells, as one value: JSON, CSV, charts and the page are made from it.

use serde::Serialize;

use super::lost::LostObject;
use super::methods::{FLOOR, Variant};
use super::run::{FrameResult, FrameTime, MethodResult, Outcome, RunSettings, ViewFacts};
use super::statistics::Distribution;
use super::views::{Rejected, View};
use crate::loaded::LoadedScene;
use crate::scene::Scene;
use crate::visibility::culling::StageTime;
use crate::visibility::{Accuracy, ClassError};

/// First field of a report's JSON: what it is, and the version of its fields.
pub const FORMAT: &str = "voxsight-compare 1";

/// A comparison. Serialized it has no times; [`Report::to_json`] adds them under `times`.
#[derive(Serialize)]
pub struct Report {
    /// [`FORMAT`].
    pub format: &'static str,
    /// Version of the program.
    pub voxsight: &'static str,
    /// Every file of the report's folder.
    pub files: Vec<String>,
    /// How it was run.
    pub settings: ReportSettings,
    /// The scenes, first the one that the reference was asked about.
    pub scenes: Vec<SceneReport>,
    /// What was turned down when views were drawn.
    pub rejected: Option<Rejected>,
    /// The views and what the reference saw.
    pub views: Vec<ViewReport>,
    /// Method by method.
    pub methods: Vec<MethodReport>,
}

/// How a comparison was run.
#[derive(Clone, Debug, Serialize)]
pub struct ReportSettings {
    /// Where the views come from, for people.
    pub views: String,
    /// The views are frames of one way, in order.
    pub is_path: bool,
    /// Seed of the views.
    pub seed: u64,
    /// Reference and repetitions.
    #[serde(flatten)]
    pub run: RunSettings,
}

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneReport {
    /// File name without folders.
    pub file: String,
    /// Voxels a side.
    pub resolution: u32,
    /// Side of a voxel, model units.
    pub voxel_size: f64,
    /// The model's unit.
    pub unit: String,
    /// Placed occurrences.
    pub objects: u64,
    /// Units of visibility.
    pub drawables: u64,
    /// Triangles, instancing expanded.
    pub triangles: u64,
}

impl SceneReport {
    /// Describes a scene.
    pub fn of(scene: &Scene) -> Self {
        let (meta, path) = (scene.meta(), scene.container().path());
        SceneReport {
            file: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
            resolution: scene.grid().side(),
            voxel_size: meta.grid.voxel_size,
            unit: meta.settings.unit.clone(),
            objects: meta.counts.objects,
            drawables: scene.drawables().len() as u64,
            triangles: meta.counts.placed_triangles,
        }
    }
}

/// A view and what there is to see.
#[derive(Clone, Debug, Serialize)]
pub struct ViewReport {
    /// Name and camera.
    #[serde(flatten)]
    pub view: View,
    /// What the reference saw.
    #[serde(flatten)]
    pub facts: ViewFacts,
}

/// A lost object by name.
#[derive(Clone, Debug, Serialize)]
pub struct NamedLoss {
    /// Where it is in the assembly tree.
    pub path: String,
    /// Id, pixels, views.
    #[serde(flatten)]
    pub lost: LostObject,
}

/// Wrongly hidden of one pixel class.
#[derive(Clone, Debug, Serialize)]
pub struct ClassReport {
    /// Least reference pixels of a drawable.
    pub at_least_px: f64,
    /// Fraction wrongly hidden, over views.
    pub wrongly_hidden: Distribution,
    /// Views in which one of the class was lost.
    pub views_with_loss: u64,
}

/// One view by one method.
#[derive(Clone, Debug, Serialize)]
pub struct FrameReport {
    /// Both errors.
    #[serde(flatten)]
    pub accuracy: Accuracy,
    /// Rays cast, all frames in which the view was shown together.
    pub rays: u64,
    /// Visible objects of at most 200 vertices, and those of them that are wrongly hidden.
    pub small: ClassError,
    /// Lost objects, most pixels first; the first 20.
    pub lost: Vec<NamedLoss>,
    /// How many there are.
    pub lost_objects: u64,
}

/// One method.
#[derive(Clone, Debug, Serialize)]
pub struct MethodReport {
    /// What it is.
    #[serde(flatten)]
    pub variant: Variant,
    /// It is the truth at its rays: what triangles tell with these rays in one frame.
    pub is_floor: bool,
    /// Fraction of reference samples lost.
    pub lost_pixels: Distribution,
    /// Mean lost pixels over those of the floor with the same rays; `None` without rays, when the floor loses nothing, and
    /// for a method that keeps what the rays of other frames found.
    pub times_the_floor: Option<f64>,
    /// Rays that a view took, all frames in which it was shown together: means over views.
    pub rays_cast: f64,
    /// Fraction of visible drawables wrongly hidden.
    pub wrongly_hidden: Distribution,
    /// The same by pixel class.
    pub classes: Vec<ClassReport>,
    /// Fraction of drawn drawables needlessly drawn.
    pub needlessly_drawn: Distribution,
    /// Fraction of drawn triangles needlessly drawn.
    pub needless_triangles: Distribution,
    /// Fraction of what is in the view pyramid and was left out: what the method spares. Like every figure, of the views
    /// that have one: here those with anything in the pyramid.
    pub culled: Distribution,
    /// Of what is in the view pyramid and hidden, the fraction that was left out: what occlusion culling achieves of what
    /// exact occlusion culling would (Peng and Cao 2013, table 4). Of the views that hide anything.
    pub culled_of_hidden: Distribution,
    /// Fraction of visible objects of at most 200 vertices that are wrongly hidden (Xue et al. 2016, section 4.1).
    pub small_wrongly_hidden: Distribution,
    /// Mean relative error of sample counts; only the views that have one. `None` when none has.
    pub sample_count_error: Option<Distribution>,
    /// Views in which anything was lost.
    pub views_with_loss: u64,
    /// View with the most lost pixels.
    pub worst_view: usize,
    /// Every lost object, most pixels first.
    pub lost: Vec<NamedLoss>,
    /// View by view.
    pub frames: Vec<FrameReport>,
    /// Kept apart: the one thing that differs from run to run.
    #[serde(skip)]
    pub time: TimeReport,
}

/// Times of one method.
#[derive(Clone, Debug, Default, Serialize)]
pub struct TimeReport {
    /// Seconds a view.
    #[serde(flatten)]
    pub distribution: Distribution,
    /// Mean seconds a view of each stage.
    pub stages: Vec<StageTime>,
    /// View by view.
    pub frames: Vec<FrameTime>,
}

/// All times of a report.
#[derive(Serialize)]
struct Times<'a> {
    threads: usize,
    methods: Vec<&'a TimeReport>,
}

#[derive(Serialize)]
struct WithTimes<'a> {
    #[serde(flatten)]
    report: &'a Report,
    times: Times<'a>,
}

impl Report {
    /// Gathers what a run found. `scenes` begins with the scene of the reference.
    pub fn new(
        scenes: &[LoadedScene],
        views: Vec<View>,
        rejected: Option<Rejected>,
        settings: ReportSettings,
        outcome: &Outcome,
    ) -> Self {
        let facts = outcome.views.iter().cloned();
        let views: Vec<ViewReport> =
            views.into_iter().zip(facts).map(|(view, facts)| ViewReport { view, facts }).collect();
        let mut report = Report {
            format: FORMAT,
            voxsight: env!("CARGO_PKG_VERSION"),
            files: Vec::new(),
            settings,
            scenes: scenes.iter().map(|loaded| SceneReport::of(loaded.scene())).collect(),
            rejected,
            methods: Vec::new(),
            views,
        };
        if let Some(first) = scenes.first() {
            let methods = outcome.methods.iter();
            report.methods =
                methods.map(|method| method_report(first.scene(), &report.views, method)).collect();
        }
        report.compare_with_floor();
        report
    }

    /// Everything, times under `times`, as JSON.
    ///
    /// # Errors
    ///
    /// A number that JSON cannot hold.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        let methods = self.methods.iter().map(|method| &method.time).collect();
        let times = Times { threads: rayon::current_num_threads(), methods };
        let mut text = serde_json::to_string_pretty(&WithTimes { report: self, times })?;
        text.push('\n');
        Ok(text)
    }

    /// For each method name the variant that stands for it: 1 ray per pixel or next to it, of the finest voxels.
    pub fn representatives(&self) -> Vec<usize> {
        let mut chosen: Vec<usize> = Vec::new();
        let far_from_one = |index: usize| {
            let variant = &self.methods[index].variant;
            let rays = variant.rays_per_pixel.map_or(1.0, |rays| rays.get());
            (rays.log2().abs(), u32::MAX - variant.resolution.unwrap_or(0))
        };
        for index in 0..self.methods.len() {
            let name = &self.methods[index].variant.method;
            match chosen.iter_mut().find(|other| self.methods[**other].variant.method == *name) {
                Some(other) if far_from_one(index) < far_from_one(*other) => *other = index,
                Some(_) => {}
                None => chosen.push(index),
            }
        }
        chosen
    }

    /// Pixels of a view: the mean over views.
    pub fn pixels_a_view(&self) -> f64 {
        let pixels = self
            .views
            .iter()
            .map(|view| f64::from(view.view.camera.width) * f64::from(view.view.camera.height));
        pixels.sum::<f64>() / self.views.len().max(1) as f64
    }

    /// The floor with the same rays.
    pub fn floor_of(&self, method: &MethodReport) -> Option<&MethodReport> {
        let rays = method.variant.rays_per_pixel?;
        self.methods.iter().find(|floor| floor.is_floor && floor.variant.rays_per_pixel == Some(rays))
    }

    fn compare_with_floor(&mut self) {
        let ratios: Vec<Option<f64>> = self
            .methods
            .iter()
            .map(|method| {
                let floor = self.floor_of(method)?.lost_pixels.mean;
                (floor > 0.0 && !method.variant.keeps_state).then(|| method.lost_pixels.mean / floor)
            })
            .collect();
        for (method, ratio) in self.methods.iter_mut().zip(ratios) {
            method.times_the_floor = ratio;
        }
    }
}

fn method_report(scene: &Scene, views: &[ViewReport], result: &MethodResult) -> MethodReport {
    // A share of nothing is no share: views without anything visible, drawn or of a class do not count there.
    let over = |whole: &dyn Fn(&Accuracy) -> u64, figure: &dyn Fn(&Accuracy) -> f64| {
        let frames = result.frames.iter().map(|frame| &frame.accuracy);
        Distribution::of_some(frames.map(|accuracy| (whole(accuracy) > 0).then(|| figure(accuracy))))
    };
    let seen = |accuracy: &Accuracy| accuracy.reference;
    let drawn = |accuracy: &Accuracy| accuracy.answer;
    let classes = result.frames.first().map_or(0, |frame| frame.accuracy.classes.len());
    let class_report = |class: usize| ClassReport {
        at_least_px: result.frames.first().map_or(0.0, |frame| frame.accuracy.classes[class].at_least_px),
        wrongly_hidden: over(&|accuracy| accuracy.classes[class].reference, &|accuracy| {
            accuracy.classes[class].rate()
        }),
        views_with_loss: count(result, |accuracy| accuracy.classes[class].wrongly_hidden > 0),
    };
    let culled = result.frames.iter().zip(views).map(|(frame, view)| {
        let in_frustum = view.facts.in_frustum;
        left_out(frame.accuracy.answer.min(in_frustum), in_frustum)
    });
    let culled_of_hidden = result.frames.iter().zip(views).map(|(frame, view)| {
        // What the reference sees without being in the view pyramid by rounding is hidden by nobody.
        let hidden = view.facts.in_frustum.saturating_sub(view.facts.reference);
        left_out(frame.accuracy.needlessly_drawn.min(hidden), hidden)
    });
    MethodReport {
        variant: result.variant.clone(),
        is_floor: result.variant.method == FLOOR,
        lost_pixels: over(&seen, &|accuracy| accuracy.lost_pixels),
        times_the_floor: None,
        rays_cast: Distribution::of(&result.frames.iter().map(|frame| frame.rays as f64).collect::<Vec<_>>())
            .mean,
        wrongly_hidden: over(&seen, &Accuracy::wrongly_hidden_rate),
        classes: (0..classes).map(class_report).collect(),
        needlessly_drawn: over(&drawn, &Accuracy::needlessly_drawn_rate),
        needless_triangles: over(&drawn, &Accuracy::needless_triangle_rate),
        culled: Distribution::of_some(culled),
        culled_of_hidden: Distribution::of_some(culled_of_hidden),
        small_wrongly_hidden: Distribution::of_some(
            result.frames.iter().map(|frame| (frame.small.reference > 0).then(|| frame.small.rate())),
        ),
        sample_count_error: sample_count_error(result),
        views_with_loss: count(result, |accuracy| accuracy.wrongly_hidden > 0),
        worst_view: result.worst.as_ref().map_or(0, |(view, _)| *view),
        lost: named(scene, &result.lost),
        frames: result.frames.iter().map(|frame| frame_report(scene, frame)).collect(),
        time: time_report(&result.times),
    }
}

fn count(result: &MethodResult, is_counted: impl Fn(&Accuracy) -> bool) -> u64 {
    result.frames.iter().filter(|frame| is_counted(&frame.accuracy)).count() as u64
}

/// The fraction of `all` that was not drawn; `None` of nothing.
fn left_out(drawn: u64, all: u64) -> Option<f64> {
    (all > 0).then(|| (all - drawn) as f64 / all as f64)
}

/// Views without such drawables have no such error.
fn sample_count_error(result: &MethodResult) -> Option<Distribution> {
    let found = Distribution::of_some(result.frames.iter().map(|frame| frame.accuracy.sample_count_error));
    (found.views > 0).then_some(found)
}

fn frame_report(scene: &Scene, frame: &FrameResult) -> FrameReport {
    FrameReport {
        accuracy: frame.accuracy.clone(),
        rays: frame.rays,
        small: frame.small,
        lost: named(scene, &frame.lost),
        lost_objects: frame.lost_objects,
    }
}

fn named(scene: &Scene, lost: &[LostObject]) -> Vec<NamedLoss> {
    let path = |object: u32| scene.node_path(scene.objects()[object as usize].node);
    lost.iter().map(|&lost| NamedLoss { path: path(lost.object), lost }).collect()
}

fn time_report(frames: &[FrameTime]) -> TimeReport {
    let seconds: Vec<f64> = frames.iter().map(|frame| frame.seconds).collect();
    let mut stages: Vec<StageTime> = Vec::new();
    for stage in frames.iter().flat_map(|frame| &frame.stages) {
        match stages.iter_mut().find(|sum| sum.stage == stage.stage) {
            Some(sum) => sum.seconds += stage.seconds,
            None => stages.push(*stage),
        }
    }
    for stage in &mut stages {
        stage.seconds /= frames.len() as f64;
    }
    TimeReport { distribution: Distribution::of(&seconds), stages, frames: frames.to_vec() }
}

//! The run itself: references, then every method over every view, timed, with both errors.
//!
//! References come first. Then, as often as asked for, each method goes through all views in a row, as it would in use
//! (its own data in the caches, its own state from frame to frame); of a view's times the median counts (of an even number
//! the quicker one in the middle, whose stages add up). Passes are
//! the outer loop, so that a machine that is slower for a while is so for every method.

use glam::DVec3;
use serde::Serialize;

use super::lost::{LostObject, LostTotals, lost_samples, sorted_view};
use super::methods::{MethodError, Variant};
use super::views::View;
use crate::camera::{CameraError, CameraRays};
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::visibility::culling::{CulledFrame, Culling, StageTime};
use crate::visibility::{
    Accuracy, ClassError, Method, QueryScene, QuerySettings, RaysPerPixel, VisibleSet, accuracy, query_until,
};

/// Jitter of the reference begins here ([`QuerySettings::first_sample`]): past what any answer uses, even over a long
/// path with a new jitter every frame, so that they share no ray.
pub const FIRST_REFERENCE_SAMPLE: u32 = 1 << 24;
/// Fewer reference rays per pixel are no reference (DESIGN.md, section 7).
pub const LEAST_REFERENCE_RAYS: u32 = 16;
/// Lost objects kept for each view; the sums over all views are of all of them.
const LOST_KEPT_PER_VIEW: usize = 20;

/// Vertices of a small object. Xue et al. 2016 (section 4.1) found visible objects, "which typically have 200 vertices or
/// less", to be taken for hidden 7 % of the time by voxels and 38 % of the time by boxes.
pub const SMALL_VERTICES: u32 = 200;

/// How a comparison is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct RunSettings {
    /// Rays per pixel of the reference, at least [`LEAST_REFERENCE_RAYS`].
    pub reference_rays: u32,
    /// Passes over all views; the median time of each view counts. At least 1.
    pub repeats: u32,
    /// What casts the reference's rays: `exact`, or `hybrid`, which gives the same answers sooner. That it does is checked
    /// on the first view.
    pub reference_method: Method,
    /// Frames that each view is shown to a method that keeps what it found, at least 1: it is judged by the last, and the
    /// time is that of all of them together.
    pub frames_a_view: u32,
}

impl Default for RunSettings {
    fn default() -> Self {
        RunSettings {
            reference_rays: LEAST_REFERENCE_RAYS,
            repeats: 3,
            reference_method: Method::Exact,
            frames_a_view: 1,
        }
    }
}

impl RunSettings {
    /// The query that is the truth.
    pub fn reference_query(&self) -> QuerySettings {
        QuerySettings {
            rays_per_pixel: RaysPerPixel::rays(self.reference_rays),
            first_sample: FIRST_REFERENCE_SAMPLE,
            ..QuerySettings::default()
        }
    }
}

/// Why a comparison failed.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// Stopped on request.
    #[error("stopped; nothing was written")]
    Cancelled,
    /// A view's camera.
    #[error("view \"{view}\": {source}")]
    Camera {
        /// Its name.
        view: String,
        /// What is wrong.
        source: CameraError,
    },
    /// Scenes that are compared with each other are of different models.
    #[error("{file} is not the same model as the first scene: {what} differ")]
    OtherModel {
        /// The scene that is other.
        file: String,
        /// In what.
        what: &'static str,
    },
    /// A method or its parameters.
    #[error(transparent)]
    Method(#[from] MethodError),
    /// `hybrid` was to be the reference and is not what `exact` is.
    #[error(
        "view \"{view}\": hybrid does not answer as exact does, and cannot be the reference: please report this"
    )]
    Reference {
        /// Name of the view.
        view: String,
    },
    /// Too few reference rays, no views, no repetition.
    #[error("{0}")]
    Settings(&'static str),
}

/// A method that takes part.
pub struct Contestant<'s> {
    /// What it is, for tables.
    pub variant: Variant,
    /// The scene that it is asked about; all are of the same model.
    pub scene: &'s LoadedScene,
    /// The method.
    pub culling: Box<dyn Culling>,
}

/// What the reference saw of a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewFacts {
    /// Drawables whose boxes meet the view pyramid: what would be drawn without occlusion culling.
    pub in_frustum: u64,
    /// Level-0 triangles of these.
    pub frustum_triangles: u64,
    /// Drawables with a reference sample.
    pub reference: u64,
    /// Fraction of the image that shows the model.
    pub coverage: f64,
}

/// One method's answer for one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameResult {
    /// Both errors.
    pub accuracy: Accuracy,
    /// Rays cast, all frames in which the view was shown together.
    pub rays: u64,
    /// Of visible objects with at most [`SMALL_VERTICES`] vertices: how many, and how many of them are wrongly hidden.
    pub small: ClassError,
    /// Lost objects, most pixels first; the first 20.
    pub lost: Vec<LostObject>,
    /// How many there are.
    pub lost_objects: u64,
}

/// What one view took: the median pass.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameTime {
    /// All stages together, seconds.
    pub seconds: f64,
    /// The stages of that pass.
    pub stages: Vec<StageTime>,
}

/// Everything about one method.
pub struct MethodResult {
    /// What it is.
    pub variant: Variant,
    /// View by view.
    pub frames: Vec<FrameResult>,
    /// View by view.
    pub times: Vec<FrameTime>,
    /// Lost objects over all views, most pixels first.
    pub lost: Vec<LostObject>,
    /// The view with the most lost pixels, then the most wrongly hidden drawables, then the first; and the answer for
    /// it. `None` only without views.
    pub worst: Option<(usize, VisibleSet)>,
}

/// A finished run.
pub struct Outcome {
    /// View by view.
    pub views: Vec<ViewFacts>,
    /// Method by method, as given.
    pub methods: Vec<MethodResult>,
}

/// Runs every contestant over every view. The reference is asked about `scene`. The references of all views are kept:
/// 5 bytes for each drawable and view.
///
/// # Errors
///
/// Cancelled; a camera that cannot be used; settings that make no comparison; scenes of different models.
pub fn run(
    scene: &LoadedScene,
    views: &[View],
    contestants: &mut [Contestant],
    settings: &RunSettings,
    progress: &dyn Progress,
) -> Result<Outcome, LabError> {
    check(scene, views, contestants, settings)?;
    let cameras: Vec<CameraRays> = views
        .iter()
        .map(|view| view.camera.rays().map_err(|source| LabError::Camera { view: view.name.clone(), source }))
        .collect::<Result<_, _>>()?;

    if settings.reference_method == Method::Hybrid {
        check_reference(scene, views, &cameras, progress)?;
    }
    progress.stage("reference", views.len() as u64, "views");
    let references: Vec<VisibleSet> = cameras
        .iter()
        .map(|camera| {
            let query = settings.reference_query();
            let found =
                query_until(&scene.query(), camera, settings.reference_method, &query, &Quiet(progress));
            progress.advance(1);
            found.ok_or(LabError::Cancelled)
        })
        .collect::<Result<_, _>>()?;

    let mut sheets: Vec<Sheet> = contestants.iter().map(|_| Sheet::default()).collect();
    for pass in 0..settings.repeats {
        let name = format!("pass {} of {}", pass + 1, settings.repeats);
        progress.stage(&name, (views.len() * contestants.len()) as u64, "frames");
        for (contestant, sheet) in contestants.iter_mut().zip(&mut sheets) {
            let query = contestant.scene.query();
            for (index, (view, camera)) in views.iter().zip(&cameras).enumerate() {
                if view.starts_anew {
                    contestant.culling.reset();
                }
                let culling = &mut contestant.culling;
                let times = if culling.keeps_state() { settings.frames_a_view } else { 1 };
                let shown = show(culling.as_mut(), &query, camera, times, progress)?;
                if pass == 0 {
                    sheet.judge(scene, camera, &references[index], &shown, settings);
                }
                sheet.time(index, shown.time);
                progress.advance(1);
            }
        }
    }
    let facts = cameras.iter().zip(&references);
    let views = facts.map(|(camera, reference)| view_facts(&scene.query(), camera, reference)).collect();
    let methods = contestants.iter().zip(sheets).map(|(contestant, sheet)| {
        sheet.finish(contestant.variant.clone(), f64::from(settings.reference_rays))
    });
    Ok(Outcome { views, methods: methods.collect() })
}

/// A view that was shown for some frames.
struct Shown {
    /// The last answer.
    found: VisibleSet,
    /// Of all frames.
    rays: u64,
    /// Of all frames.
    time: FrameTime,
}

/// Shows a view for some frames.
fn show(
    culling: &mut dyn Culling,
    scene: &QueryScene,
    camera: &CameraRays,
    frames: u32,
    progress: &dyn Progress,
) -> Result<Shown, LabError> {
    let mut next = || {
        let frame = culling.frame(scene, camera, &Quiet(progress));
        frame.filter(|_| !progress.is_cancelled()).ok_or(LabError::Cancelled)
    };
    let CulledFrame { mut found, mut stages } = next()?;
    let mut rays = found.rays;
    for _ in 1..frames {
        let frame = next()?;
        for stage in frame.stages {
            match stages.iter_mut().find(|sum| sum.stage == stage.stage) {
                Some(sum) => sum.seconds += stage.seconds,
                None => stages.push(stage),
            }
        }
        rays += frame.found.rays;
        found = frame.found;
    }
    let seconds = stages.iter().map(|stage| stage.seconds).sum();
    Ok(Shown { found, rays, time: FrameTime { seconds, stages } })
}

/// Does `hybrid` answer as `exact` does? Asked of the first view that sees anything.
fn check_reference(
    scene: &LoadedScene,
    views: &[View],
    cameras: &[CameraRays],
    progress: &dyn Progress,
) -> Result<(), LabError> {
    for (view, camera) in views.iter().zip(cameras) {
        let ask = |method| {
            query_until(&scene.query(), camera, method, &QuerySettings::default(), &Quiet(progress))
                .ok_or(LabError::Cancelled)
        };
        let exact = ask(Method::Exact)?;
        if ask(Method::Hybrid)? != exact {
            return Err(LabError::Reference { view: view.name.clone() });
        }
        if exact.hits > 0 {
            break;
        }
    }
    Ok(())
}

fn check(
    scene: &LoadedScene,
    views: &[View],
    contestants: &[Contestant],
    settings: &RunSettings,
) -> Result<(), LabError> {
    if settings.reference_rays < LEAST_REFERENCE_RAYS {
        return Err(LabError::Settings("a reference has at least 16 rays per pixel"));
    }
    if !matches!(settings.reference_method, Method::Exact | Method::Hybrid) {
        return Err(LabError::Settings("the reference is exact, or hybrid, which answers the same"));
    }
    if settings.frames_a_view == 0 {
        return Err(LabError::Settings("a view is shown for at least one frame"));
    }
    if settings.repeats == 0 {
        return Err(LabError::Settings("a comparison needs at least one pass"));
    }
    if views.is_empty() || contestants.is_empty() {
        return Err(LabError::Settings("a comparison needs a view and a method"));
    }
    contestants.iter().try_for_each(|contestant| check_same_model(scene, contestant.scene))
}

/// Are both scenes of the same model, whatever their voxels?
///
/// # Errors
///
/// They are not: says in what they differ.
pub fn check_same_model(first: &LoadedScene, other: &LoadedScene) -> Result<(), LabError> {
    let (a, b) = (first.scene(), other.scene());
    let same_objects = a.objects().len() == b.objects().len()
        && a.objects().iter().zip(b.objects()).all(|(x, y)| {
            (x.part, x.world_from_part) == (y.part, y.world_from_part)
                && DVec3::from(x.min) == DVec3::from(y.min)
                && DVec3::from(x.max) == DVec3::from(y.max)
        });
    let what = if a.drawables() != b.drawables() {
        "drawables"
    } else if !same_objects {
        "objects or their places"
    } else if a.meta().counts.placed_triangles != b.meta().counts.placed_triangles {
        "triangles"
    } else {
        return Ok(());
    };
    Err(LabError::OtherModel { file: b.container().path().display().to_string(), what })
}

fn view_facts(scene: &QueryScene, camera: &CameraRays, reference: &VisibleSet) -> ViewFacts {
    let frustum = crate::visibility::query(scene, camera, Method::Frustum, &QuerySettings::default());
    let inside = (0..).zip(&frustum.visible).filter_map(|(drawable, &visible)| visible.then_some(drawable));
    ViewFacts {
        in_frustum: frustum.visible_count() as u64,
        frustum_triangles: inside.map(|drawable| u64::from(scene.exact.triangle_count(drawable))).sum(),
        reference: reference.visible_count() as u64,
        coverage: reference.hits as f64 / reference.weight.max(1) as f64,
    }
}

/// Visible objects of few vertices, and how many of them an answer lacks altogether.
fn small_objects(scene: &LoadedScene, reference: &VisibleSet, answer: &VisibleSet) -> ClassError {
    let scene = scene.scene();
    let mut small = ClassError { at_least_px: 0.0, reference: 0, wrongly_hidden: 0 };
    for (object, record) in (0..).zip(scene.objects()) {
        let drawables = scene.object_drawables(object);
        if !drawables.clone().any(|d| reference.samples[d as usize] > 0) {
            continue;
        }
        let part = &scene.parts()[record.part as usize];
        let chunks = &scene.chunks()[part.first_chunk as usize..][..part.chunk_count as usize];
        let vertices =
            chunks.iter().map(|chunk| u64::from(scene.levels()[chunk.first_level as usize].vertex_count));
        if vertices.sum::<u64>() <= u64::from(SMALL_VERTICES) {
            small.reference += 1;
            small.wrongly_hidden += u64::from(!drawables.into_iter().any(|d| answer.visible[d as usize]));
        }
    }
    small
}

/// What is noted of one method during the run.
#[derive(Default)]
struct Sheet {
    frames: Vec<FrameResult>,
    /// By view, then by pass.
    times: Vec<Vec<FrameTime>>,
    lost: LostTotals,
    worst: Option<(usize, VisibleSet)>,
}

impl Sheet {
    /// Compares the answer for the next view with the reference.
    fn judge(
        &mut self,
        scene: &LoadedScene,
        camera: &CameraRays,
        reference: &VisibleSet,
        shown: &Shown,
        settings: &RunSettings,
    ) {
        let answer = &shown.found;
        let (width, height) = camera.size();
        let pixels = u64::from(width) * u64::from(height);
        let exact = scene.query().exact;
        let accuracy = accuracy(reference, answer, pixels, |drawable| exact.triangle_count(drawable));
        let lost = lost_samples(reference, answer, |drawable| scene.scene().drawable_object(drawable));
        self.lost.add(&lost);
        let small = small_objects(scene, reference, answer);
        let is_worse = self.worst.as_ref().is_none_or(|(index, _)| {
            let worst = &self.frames[*index].accuracy;
            (accuracy.lost_pixels, accuracy.wrongly_hidden) > (worst.lost_pixels, worst.wrongly_hidden)
        });
        if is_worse {
            self.worst = Some((self.frames.len(), answer.clone()));
        }
        let mut objects = sorted_view(&lost, f64::from(settings.reference_rays));
        objects.truncate(LOST_KEPT_PER_VIEW);
        let (rays, lost_objects) = (shown.rays, lost.len() as u64);
        self.frames.push(FrameResult { accuracy, rays, small, lost: objects, lost_objects });
    }

    fn time(&mut self, view: usize, time: FrameTime) {
        if self.times.len() <= view {
            self.times.resize(view + 1, Vec::new());
        }
        self.times[view].push(time);
    }

    fn finish(self, variant: Variant, samples_per_pixel: f64) -> MethodResult {
        MethodResult {
            variant,
            times: self.times.into_iter().map(median_pass).collect(),
            lost: self.lost.sorted(samples_per_pixel),
            frames: self.frames,
            worst: self.worst,
        }
    }
}

/// The pass in the middle (the quicker one of two), with its own stages, which so add up.
fn median_pass(mut passes: Vec<FrameTime>) -> FrameTime {
    passes.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    let middle = passes.len().saturating_sub(1) / 2;
    passes.into_iter().nth(middle).unwrap_or(FrameTime { seconds: 0.0, stages: Vec::new() })
}

/// Hands on that the work should stop, and tells nothing: what a bar costs is not the method's time.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn stage(&self, _name: &str, _total: u64, _unit: &str) {}
    fn advance(&self, _count: u64) {}
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

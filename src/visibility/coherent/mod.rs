//! Visibility over frames: few rays a frame, and what they find is kept while it can still be true.
//!
//! Each frame casts its rays at other points of the pixels. At 1/n ray per pixel, n a square, n frames cast exactly the rays
//! of one frame of one ray per pixel; at other fractions about so (see [`RaysPerPixel`]). While the camera stands still,
//! samples add up, and nothing is forgotten; when all was sampled often enough, the answer stands and no ray is
//! cast. While it moves:
//!
//! - what was seen stays in the answer for [`CoherentSettings::window`] frames, as long as its box is in the view;
//! - sample counts decay ([`CoherentSettings::decay`]), so that they follow the camera;
//! - what this frame's rays did not meet is *asked after*: one ray to the point where it was last seen. There are
//!   seldom rays for all: the drawables that look largest come first (Xue et al. 2016, equation 4). A
//!   drawable that is asked after in vain too often is gone.
//!
//! So recall grows with time, what comes into view is found by chance as soon as its pixels allow, and what is hidden
//! leaves within the window.
//!
//! A camera *stands still* when it and the filter are those of the frame before, bit for bit. Any tolerance would let
//! an answer that is final, and costs nothing, stand for another view; a camera that only trembles has its samples
//! decay, which costs rays and loses nothing that is kept.
//!
//! A frame that is cancelled changes nothing: the next one goes on from the last whole one. What is known is of one
//! scene, told by its triangles ([`crate::exact::ExactScene::id`]), and a frame of another scene is a first one. (The
//! voxels are taken to be of the same triangles; whoever changes them alone calls [`Culling::reset`].)

mod memory;
mod settings;

use glam::DVec3;

pub use settings::{CoherentError, CoherentSettings};

use self::memory::{Lesson, Memory};
use super::culling::{CulledFrame, Culling, timed};
use super::frustum::in_planes;
use super::source::{ImageRays, ListedRays};
use super::tally::{Tally, TallyPool};
use super::{QueryScene, QuerySettings, RayMethod, RaysPerPixel, cast};
use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::progress::Progress;
use crate::ray::Ray;

/// Rays of a batch of questions: neighbours on the screen by and large.
const QUESTIONS_PER_BATCH: usize = 64;

/// The view of the last whole frame.
struct View {
    scene: u64,
    camera: CameraRays,
    filter: Filter,
    /// First frame of this view: since then the camera has stood still.
    since: u32,
    /// Rays of the image cast since then.
    rays: u64,
}

impl View {
    fn is_of(&self, scene: &QueryScene, camera: &CameraRays) -> bool {
        self.scene == scene.exact.id() && self.camera == *camera && self.filter == *scene.filter
    }
}

/// A query that keeps what it found. Its answers count in fractions of a ray, since counts decay: their ratios are what
/// those of any other query are.
pub struct CoherentQuery {
    settings: CoherentSettings,
    memory: Memory,
    /// `None` before the first frame.
    view: Option<View>,
    tallies: TallyPool,
}

impl CoherentQuery {
    /// With settings that have served well; nothing known yet.
    pub fn of(method: RayMethod, rays_per_pixel: RaysPerPixel) -> Self {
        Self::blank(CoherentSettings::new(method, rays_per_pixel))
    }

    /// Nothing known yet.
    ///
    /// # Errors
    ///
    /// A setting out of its range.
    pub fn new(settings: CoherentSettings) -> Result<Self, CoherentError> {
        settings.check()?;
        Ok(Self::blank(settings))
    }

    fn blank(settings: CoherentSettings) -> Self {
        CoherentQuery { settings, memory: Memory::default(), view: None, tallies: TallyPool::default() }
    }

    /// Is this the view of the frame before? What is known of another scene is forgotten.
    fn begin(&mut self, scene: &QueryScene, camera: &CameraRays) -> bool {
        if self.view.as_ref().is_none_or(|view| view.scene != scene.exact.id()) {
            self.view = None;
            self.memory = Memory::new(scene.exact.drawable_count());
        }
        self.view.as_ref().is_some_and(|view| view.is_of(scene, camera))
    }

    /// Has this view had rays enough?
    fn has_enough(&self, camera: &CameraRays) -> bool {
        let (width, height) = camera.size();
        let enough = self.settings.enough * f64::from(width) * f64::from(height);
        self.view.as_ref().is_some_and(|view| view.rays as f64 >= enough)
    }

    /// Sorts what is kept and was not seen by this view, this frame's rays (`seen`) among them.
    fn survey(&self, scene: &QueryScene, camera: &CameraRays, is_still: bool, seen: &Tally) -> Unseen {
        let frustum = camera.frustum();
        let frame = self.memory.frame + 1;
        let since = self.view.as_ref().filter(|_| is_still).map_or(frame, |view| view.since);
        let mut unseen = Unseen::default();
        for (drawable, known) in self.memory.kept() {
            if known.seen >= since || seen.has(drawable) {
                continue;
            }
            let (min, max) = scene.exact.drawable_box(drawable);
            let stays = frame - known.seen <= self.settings.window
                && !scene.filter.is_hidden(drawable)
                && in_planes(scene.exact, drawable, frustum.iter().chain(scene.filter.clip_planes()));
            if !stays {
                unseen.gone.push(drawable);
            } else if frustum.iter().all(|plane| plane.reaches(known.point, known.point)) {
                // (A ray to a point out of view would say what is there.)
                unseen.doubtful.push((apparent_size(min, max, camera.eye()), drawable));
            }
        }
        unseen
    }

    /// Casts one ray to where each of these was last seen.
    fn ask(
        &self,
        scene: &QueryScene,
        camera: &CameraRays,
        asked: &[u32],
        progress: &dyn Progress,
    ) -> Option<Tally> {
        if asked.is_empty() {
            return Some(self.tallies.take(scene.exact.drawable_count(), true));
        }
        let ray = |&drawable: &u32| (drawable, ray_to(camera, self.memory.point(drawable)));
        let mut questions: Vec<(u64, u32, Ray)> =
            asked.iter().map(ray).map(|(drawable, ray)| (tile_of(camera, &ray), drawable, ray)).collect();
        // Neighbours on the screen, by and large, are asked together.
        questions.sort_unstable_by_key(|&(tile, drawable, _)| (tile, drawable));
        let rays: Vec<Ray> = questions.iter().map(|&(_, _, ray)| ray).collect();
        let source = ListedRays { rays: &rays, per_batch: QUESTIONS_PER_BATCH, filter: scene.filter };
        cast(scene, self.settings.method, &source, true, &self.tallies, progress)
    }

    /// Takes in a whole frame of this view.
    fn commit(&mut self, scene: &QueryScene, camera: &CameraRays, lesson: &Lesson) {
        self.memory.learn(lesson, &self.settings);
        let rays = lesson.seen.found.rays;
        match &mut self.view {
            Some(view) if lesson.is_still => view.rays += rays,
            view => {
                let (scene, filter) = (scene.exact.id(), scene.filter.clone());
                *view = Some(View { scene, camera: *camera, filter, since: self.memory.frame, rays });
            }
        }
    }
}

/// What is kept and not seen.
#[derive(Default)]
struct Unseen {
    /// Out of view, hidden by the user, or not seen for too long.
    gone: Vec<u32>,
    /// What can be asked after, with its [`apparent_size`].
    doubtful: Vec<(f64, u32)>,
}

impl Unseen {
    /// The largest of the doubtful, `most` of them.
    fn largest(&mut self, most: usize) -> Vec<u32> {
        if self.doubtful.len() > most {
            self.doubtful.select_nth_unstable_by(most, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            self.doubtful.truncate(most);
        }
        self.doubtful.iter().map(|&(_, drawable)| drawable).collect()
    }
}

/// How large the sphere around a box looks: (R/d)^2, R its radius and d its distance.
///
/// Xue et al. 2016, equation 4, weigh objects by (pi/180) arctan(R/d). We only order by it, and this grows as that does;
/// `atan` differs in its last bits from platform to platform, and so would the order. And we weigh drawables by their own
/// boxes: the chunks of a part that is all over the scene are not all as near as the part.
fn apparent_size(min: DVec3, max: DVec3, eye: DVec3) -> f64 {
    0.25 * (max - min).length_squared() / (0.5 * (min + max) - eye).length_squared()
}

/// The camera's ray through a point.
fn ray_to(camera: &CameraRays, point: DVec3) -> Ray {
    let ahead = point - camera.eye();
    if camera.is_parallel() {
        Ray::new(point - camera.forward() * ahead.dot(camera.forward()), camera.forward())
    } else {
        Ray::new(camera.eye(), ahead)
    }
}

/// Numbers the tiles of 64 x 64 pixels, row by row, for a ray of the camera.
fn tile_of(camera: &CameraRays, ray: &Ray) -> u64 {
    let (right, down) = camera.pixel_steps();
    let depth = ray.direction.dot(camera.forward()).abs().max(f64::MIN_POSITIVE);
    let across = ray.direction / depth + ray.origin - camera.eye();
    let tile = |step: DVec3| (across.dot(step) / step.length_squared() / 64.0) as i32 + (1 << 20);
    (tile(down) as u64) << 32 | tile(right) as u64
}

impl Culling for CoherentQuery {
    fn name(&self) -> String {
        match self.settings.method {
            RayMethod::Voxel => "coherent-voxel",
            RayMethod::Exact => "coherent-exact",
            RayMethod::Hybrid => "coherent",
        }
        .to_owned()
    }

    fn reset(&mut self) {
        self.view = None;
        self.memory = Memory::default();
    }

    fn keeps_state(&self) -> bool {
        true
    }

    fn frame(
        &mut self,
        scene: &QueryScene,
        camera: &CameraRays,
        progress: &dyn Progress,
    ) -> Option<CulledFrame> {
        let camera = &scene.exact.brought_near(camera);
        let mut stages = Vec::new();
        let is_still = timed(&mut stages, "begin", || self.begin(scene, camera));
        if is_still && self.has_enough(camera) {
            let found = timed(&mut stages, "answer", || self.memory.answer(0));
            return Some(CulledFrame { found, stages });
        }
        let CoherentSettings { method, rays_per_pixel, questions, .. } = self.settings;
        let first_sample = self.memory.frame.wrapping_mul(rays_per_pixel.samples());
        let settings = QuerySettings { rays_per_pixel, first_sample, ..QuerySettings::default() };
        let seen = timed(&mut stages, "rays", || {
            let source = ImageRays::new(scene, camera, &settings);
            cast(scene, method, &source, true, &self.tallies, progress)
        })?;
        let (unseen, asked, met) = timed(&mut stages, "questions", || {
            let mut unseen = self.survey(scene, camera, is_still, &seen);
            let asked = unseen.largest((seen.found.rays as f64 * questions) as usize);
            let met = self.ask(scene, camera, &asked, progress)?;
            Some((unseen, asked, met))
        })?;
        let found = timed(&mut stages, "answer", || {
            let lesson = Lesson { seen: &seen, met: &met, asked: &asked, gone: &unseen.gone, is_still };
            self.commit(scene, camera, &lesson);
            let rays = seen.found.rays + met.found.rays;
            self.tallies.give(seen);
            self.tallies.give(met);
            self.memory.answer(rays)
        });
        Some(CulledFrame { found, stages })
    }
}

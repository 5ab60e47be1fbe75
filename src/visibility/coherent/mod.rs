//! Visibility over frames: few rays a frame, and what they find is kept while it can still be true.
//!
//! Each frame casts its rays at other points of the pixels (an R2 sequence over the frames), so that n frames of 1/n ray
//! per pixel see what one frame of one ray per pixel sees. While the camera stands still, samples add up, and nothing is
//! forgotten; when all was sampled often enough, the answer stands and no ray is cast. While it moves:
//!
//! - what was seen stays in the answer for [`CoherentSettings::window`] frames, as long as its box is in the view;
//! - sample counts decay ([`CoherentSettings::decay`]), so that they follow the camera;
//! - what this frame's rays did not meet is *asked after*: one ray to the point where it was last seen. There are
//!   seldom rays for all: the drawables with the greatest weight (pi/180) arctan(R/d) come first, R the radius and d the
//!   distance of the object's box (Xue et al. 2016, equation 4). A drawable that is asked after in vain too often is gone.
//!
//! So recall grows with time, what comes into view is found by chance as soon as its pixels allow, and what is hidden
//! leaves within the window.

use glam::DVec3;

use super::culling::{CulledFrame, Culling, timed};
use super::source::{ImageRays, ListedRays};
use super::tally::{Sighting, Tally};
use super::{Method, QueryScene, QuerySettings, RaysPerPixel, VisibleSet, cast};
use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::progress::Progress;
use crate::ray::Ray;

/// Sample counts are kept in fractions of a ray, which decay.
const PER_RAY: f64 = 256.0;

/// Rays of a batch of questions: neighbours on the screen by and large.
const QUESTIONS_PER_BATCH: usize = 64;

/// How a coherent query trades rays for time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoherentSettings {
    /// `voxel`, `hybrid` or `exact`: what each ray does.
    pub method: Method,
    /// Rays per pixel in each frame.
    pub rays_per_pixel: RaysPerPixel,
    /// Frames for which a drawable stays visible after it was last seen by a moving camera.
    pub window: u32,
    /// What is left of a sample count after a frame of a moving camera, 0 to 1.
    pub decay: f64,
    /// Drawables asked after in a frame, at most, as a fraction of the frame's rays.
    pub questions: f64,
    /// A drawable asked after so often in vain is gone.
    pub patience: u32,
    /// Rays per pixel, over all frames of a camera that stands still, after which no more are cast.
    pub enough: f64,
}

impl CoherentSettings {
    /// Settings that have served well for this many rays a frame: a window in which every pixel gets a ray.
    pub fn new(method: Method, rays_per_pixel: RaysPerPixel) -> Self {
        let frames_per_pixel = (1.0 / rays_per_pixel.get()).ceil();
        CoherentSettings {
            method,
            rays_per_pixel,
            window: (frames_per_pixel as u32).clamp(8, 64),
            decay: 0.8,
            questions: 0.25,
            patience: 3,
            enough: 16.0,
        }
    }
}

/// What is known of a drawable.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    /// Frame in which it was last seen, counted from 1; 0: never.
    seen: u32,
    /// Times that it was asked after in vain since.
    in_vain: u32,
    /// Decaying sum of its samples, in [`PER_RAY`]ths of a ray.
    samples: f64,
    /// Where it was last seen, world space.
    point: DVec3,
}

/// The view of the frame before.
#[derive(Clone, Debug, PartialEq)]
struct View {
    camera: CameraRays,
    filter: Filter,
}

/// A query that keeps what it found. Its answers count rays, hits and samples in 256ths, since they decay: their ratios are
/// what those of any other query are.
pub struct CoherentQuery {
    settings: CoherentSettings,
    known: Vec<Known>,
    /// Drawables with [`Known::seen`] not 0.
    kept: Vec<u32>,
    last: Option<View>,
    frame: u32,
    /// First frame of this view: since then the camera has stood still.
    still_since: u32,
    /// Decaying sum of the rays, as [`Known::samples`].
    rays: f64,
    hits: f64,
    answer: Option<VisibleSet>,
}

impl CoherentQuery {
    /// Nothing known yet.
    pub fn new(settings: CoherentSettings) -> Self {
        CoherentQuery {
            settings,
            known: Vec::new(),
            kept: Vec::new(),
            last: None,
            frame: 0,
            still_since: 0,
            rays: 0.0,
            hits: 0.0,
            answer: None,
        }
    }

    /// Rays per pixel that this view has had.
    fn rays_so_far(&self) -> f64 {
        f64::from(self.frame - self.still_since + 1) * self.settings.rays_per_pixel.get()
    }

    /// Begins a frame: forgets what a moving camera forgets. Returns whether the last answer still stands: the view is
    /// the same and has had rays enough.
    fn begin(&mut self, scene: &QueryScene, camera: &CameraRays) -> bool {
        let view = View { camera: *camera, filter: scene.filter.clone() };
        let drawables = scene.exact.drawable_count() as usize;
        if self.known.len() != drawables {
            *self = CoherentQuery::new(self.settings);
            self.known.resize(drawables, Known::default());
        }
        let is_still = self.last.as_ref() == Some(&view);
        if is_still && self.rays_so_far() >= self.settings.enough {
            return true;
        }
        self.frame += 1;
        if !is_still {
            self.still_since = self.frame;
            self.last = Some(view);
            self.rays *= self.settings.decay;
            self.hits *= self.settings.decay;
            for &drawable in &self.kept {
                self.known[drawable as usize].samples *= self.settings.decay;
            }
        }
        false
    }

    /// Takes in what the frame's rays met.
    fn learn(&mut self, tally: &Tally, counts: bool) {
        let Some(sightings) = &tally.sightings else { return };
        for (drawable, sighting) in sightings.iter().enumerate() {
            let Some(Sighting { point, .. }) = sighting else { continue };
            let known = &mut self.known[drawable];
            if known.seen == 0 {
                self.kept.push(drawable as u32);
            }
            (known.seen, known.in_vain, known.point) = (self.frame, 0, *point);
            if counts {
                known.samples += f64::from(tally.found.samples[drawable]) * PER_RAY;
            }
        }
        if counts {
            self.rays += tally.found.rays as f64 * PER_RAY;
            self.hits += tally.found.hits as f64 * PER_RAY;
        }
    }

    /// Drops what is out of view, hidden, or was not seen for too long; returns what can be asked after, with its weight:
    /// the rest that this view has not shown yet and whose point is in view.
    fn prune(&mut self, scene: &QueryScene, camera: &CameraRays) -> Vec<(f64, u32)> {
        let frustum = camera.frustum();
        let mut unseen = Vec::new();
        let CoherentQuery { known, kept, settings, .. } = self;
        kept.retain(|&drawable| {
            let known = &mut known[drawable as usize];
            let (min, max) = scene.object_box(drawable);
            let is_in_view = scene.filter.reaches(min, max)
                && !scene.filter.is_hidden(drawable)
                && frustum.iter().all(|plane| plane.reaches(min, max));
            let is_seen = known.seen >= self.still_since;
            let stays = is_in_view
                && (is_seen
                    || self.frame - known.seen <= settings.window && known.in_vain < settings.patience);
            if !stays {
                *known = Known::default();
            } else if !is_seen && frustum.iter().all(|plane| plane.reaches(known.point, known.point)) {
                // (A ray to a point out of view would say what is there.)
                unseen.push((weight(min, max, camera), drawable));
            }
            stays
        });
        unseen
    }

    /// Asks after the weightiest of `unseen`.
    fn ask(
        &mut self,
        scene: &QueryScene,
        camera: &CameraRays,
        mut unseen: Vec<(f64, u32)>,
        most: usize,
        progress: &dyn Progress,
    ) -> Option<()> {
        if most == 0 {
            return Some(());
        }
        if unseen.len() > most {
            unseen.select_nth_unstable_by(most, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            unseen.truncate(most);
        }
        let (right, up) = camera.pixel_steps();
        let mut questions: Vec<(u64, u32, Ray)> = unseen
            .iter()
            .map(|&(_, drawable)| {
                let ray = ray_to(camera, self.known[drawable as usize].point);
                // Neighbours on the screen, by and large, are asked together: tiles of 64 pixels.
                let across = ray.direction / ray.direction.dot(camera.forward()).abs().max(f64::MIN_POSITIVE)
                    + ray.origin
                    - camera.eye();
                let tile = |step: DVec3| (across.dot(step) / step.length_squared() / 64.0) as i32 + (1 << 20);
                ((tile(up) as u64) << 32 | tile(right) as u64, drawable, ray)
            })
            .collect();
        questions.sort_unstable_by_key(|&(tile, drawable, _)| (tile, drawable));
        for &(_, drawable, _) in &questions {
            self.known[drawable as usize].in_vain += 1;
        }
        let rays: Vec<Ray> = questions.iter().map(|&(_, _, ray)| ray).collect();
        let source = ListedRays { rays: &rays, per_batch: QUESTIONS_PER_BATCH, filter: scene.filter };
        let tally = cast(scene, self.settings.method, &source, true, progress)?;
        // They were aimed: they say what is there, not how much of it.
        self.learn(&tally, false);
        Some(())
    }

    /// The answer as it stands.
    fn answer(&self) -> VisibleSet {
        let mut found = VisibleSet::new(self.known.len() as u32);
        (found.rays, found.hits) = (self.rays as u64, self.hits as u64);
        for &drawable in &self.kept {
            found.visible[drawable as usize] = true;
            found.samples[drawable as usize] = self.known[drawable as usize].samples as u32;
        }
        found
    }
}

/// Xue et al. 2016, equation 4: (pi/180) arctan(R/d), for the sphere around a box.
fn weight(min: DVec3, max: DVec3, camera: &CameraRays) -> f64 {
    let radius = 0.5 * (max - min).length();
    let distance = (0.5 * (min + max) - camera.eye()).length();
    (radius / distance).atan().to_radians()
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

impl Culling for CoherentQuery {
    fn name(&self) -> String {
        match self.settings.method {
            Method::Voxel => "coherent-voxel",
            Method::Exact => "coherent-exact",
            Method::Hybrid | Method::Frustum => "coherent",
        }
        .to_owned()
    }

    fn reset(&mut self) {
        *self = CoherentQuery::new(self.settings);
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
        let mut stages = Vec::new();
        let stands = timed(&mut stages, "begin", || self.begin(scene, camera));
        if let Some(answer) = self.answer.as_ref().filter(|_| stands) {
            return Some(CulledFrame { found: answer.clone(), stages });
        }
        let settings = QuerySettings {
            rays_per_pixel: self.settings.rays_per_pixel,
            first_sample: (self.frame - 1).wrapping_mul(self.settings.rays_per_pixel.samples()),
            ..QuerySettings::default()
        };
        timed(&mut stages, "rays", || {
            let source = ImageRays::new(scene, camera, &settings);
            let tally = cast(scene, self.settings.method, &source, true, progress)?;
            self.learn(&tally, true);
            let most = (tally.found.rays as f64 * self.settings.questions) as usize;
            Some(most)
        })
        .and_then(|most| {
            timed(&mut stages, "questions", || {
                let unseen = self.prune(scene, camera);
                self.ask(scene, camera, unseen, most, progress)
            })
        })?;
        let found = timed(&mut stages, "answer", || self.answer());
        self.answer = Some(found.clone());
        Some(CulledFrame { found, stages })
    }
}

//! Occlusion culling with a hierarchical Z-map: Peng and Cao, "Integrating Occlusion Culling with Parallel LOD for
//! Rendering Complex 3D Environments on GPU", 2013, section 6.
//!
//! Before: drawables that fill their boxes well ([`super::compactness`]) are candidates. Each frame: candidates in the frustum are
//! weighted (eq. 3), the best few drawn at full detail into a depth image, and every drawable's box tested
//! against at most 2 x 2 texels of its pyramid (eq. 5).
//!
//! We differ, each time in favour of the method: frustum and tests take the oriented box instead of the axis-aligned one;
//! active occluders are tested too, so that one behind another is hidden; the map has the size of the image instead of 512 x 512; a
//! flat box is given a little thickness, for else the best occluders, walls and plates, would weigh nothing. The oriented box is
//! the chunk's box in the space of its part.

use std::cmp::Reverse;
use std::sync::Arc;

use rayon::prelude::*;

use super::boxes::{OrientedBox, Sight};
use super::compactness::{compactness, covered};
use super::frame::{Workspace, answer};
use super::scene::OcclusionScene;
use super::view::View;
use crate::camera::CameraRays;
use crate::exact::ExactScene;
use crate::filter::Filter;
use crate::progress::Progress;
use crate::visibility::QueryScene;
use crate::visibility::culling::{CulledFrame, Culling, timed};

/// Least thickness of a box in its volume, and least distance, as a part of its longest side.
const LEAST: f64 = 1e-3;

/// Parameters, named as in the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HzmSettings {
    /// CT: candidates have a compactness above it. 0.55 and 0.88 in the paper (table 1).
    pub compactness_threshold: f64,
    /// k: size of the active occluder set. 20 and 15 in the paper.
    pub active_occluders: usize,
    /// PET: drawables whose bounds on the screen are below so many pixels of area are left out. 1 in the paper, where the selection of
    /// levels of detail does it; 0, the default, leaves out nothing that could be seen.
    pub pixel_error_threshold: f32,
    /// Levels of the pyramid below the paper's that are asked when that does not hide a box; 0 in the paper.
    pub finer_levels: u32,
}

impl Default for HzmSettings {
    fn default() -> Self {
        HzmSettings {
            compactness_threshold: 0.6,
            active_occluders: 16,
            pixel_error_threshold: 0.0,
            finer_levels: 0,
        }
    }
}

/// Peng and Cao's culling.
pub struct Hzm {
    scene: Arc<OcclusionScene>,
    settings: HzmSettings,
    /// COS, the candidate occluder set.
    candidates: Vec<Candidate>,
    workspace: Workspace,
}

struct Candidate {
    drawable: u32,
    /// V: volume of the axis-aligned box.
    volume: f64,
    /// N: normal of the largest face of the oriented box, length 1.
    normal: glam::DVec3,
    /// Half extents of the axis-aligned box.
    half: glam::DVec3,
}

impl Hzm {
    /// Computes compactness and candidates, on all threads. `exact` is what `scene` was made of.
    pub fn new(scene: Arc<OcclusionScene>, exact: &ExactScene, settings: HzmSettings) -> Self {
        let parts: Vec<[f64; 3]> = scene
            .meshes()
            .par_iter()
            .zip(exact.chunks())
            .map(|(mesh, chunk)| {
                let (min, max) = chunk.bounds();
                covered(mesh, min, max)
            })
            .collect();
        let candidate = |drawable: u32, placed: &OrientedBox| {
            let parts = parts[scene.chunk_of(drawable) as usize];
            let is_compact = compactness(parts, placed) > settings.compactness_threshold;
            (is_compact && scene.occludes(drawable)).then(|| Candidate::new(drawable, placed))
        };
        let candidates =
            (0..).zip(scene.boxes()).filter_map(|(drawable, placed)| candidate(drawable, placed)).collect();
        Hzm { scene, settings, candidates, workspace: Workspace::new() }
    }

    /// Size of the candidate occluder set.
    pub fn candidate_count(&self) -> usize {
        self.candidates.len()
    }

    /// AOS: the candidates in the frustum that weigh most, heaviest first; none that is looked through.
    fn active_occluders(&self, view: &View, filter: &Filter) -> Vec<u32> {
        let in_frustum = |candidate: &&Candidate| {
            let sight = self.workspace.sights.get(candidate.drawable as usize);
            sight.is_some_and(|s| *s != Sight::Outside) && !filter.is_seen_through(candidate.drawable)
        };
        let mut weights: Vec<(f64, u32)> = self
            .candidates
            .par_iter()
            .with_min_len(1024)
            .filter(in_frustum)
            .map(|candidate| {
                let placed = &self.scene.boxes()[candidate.drawable as usize];
                (candidate.weight(placed, view), candidate.drawable)
            })
            .collect();
        let heaviest_first = |a: &(f64, u32), b: &(f64, u32)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
        let count = self.settings.active_occluders.min(weights.len());
        if count < weights.len() {
            weights.select_nth_unstable_by(count, heaviest_first);
            weights.truncate(count);
        }
        weights.sort_unstable_by(heaviest_first);
        weights.into_iter().map(|(_, drawable)| drawable).collect()
    }
}

impl Candidate {
    fn new(drawable: u32, placed: &OrientedBox) -> Self {
        let half = placed.aligned_half();
        let thick = half.max(glam::DVec3::splat(LEAST * half.max_element()));
        let [a, b, c] = placed.half;
        let faces = [b.cross(c), c.cross(a), a.cross(b)];
        // The first of equals, by value: the order does not hang on rounding alone.
        let largest = (0..3).max_by_key(|&k| (faces[k].length_squared().to_bits(), Reverse(k)));
        let normal = largest.map_or(glam::DVec3::ZERO, |k| faces[k].normalize_or_zero());
        Candidate { drawable, volume: 8.0 * thick.x * thick.y * thick.z, normal, half }
    }

    /// Eq. 3: V |N . E| / D.
    fn weight(&self, placed: &OrientedBox, view: &View) -> f64 {
        let from_eye = placed.centre - view.eye();
        let distance = if view.is_parallel() {
            // From the plane of the eye: nothing is farther sideways.
            from_eye.dot(view.forward()) - self.half.dot(view.forward().abs())
        } else {
            (from_eye.abs() - self.half).max(glam::DVec3::ZERO).length()
        };
        let distance = distance.max(LEAST * self.half.max_element());
        self.volume * self.normal.dot(view.forward()).abs() / distance
    }
}

impl Culling for Hzm {
    fn name(&self) -> String {
        "hzm".to_owned()
    }

    fn frame(
        &mut self,
        scene: &QueryScene,
        camera: &CameraRays,
        progress: &dyn Progress,
    ) -> Option<CulledFrame> {
        let mut stages = Vec::new();
        let view = self.scene.view(camera);
        let (width, height) = camera.size();
        let filter = scene.filter;
        timed(&mut stages, "frustum", || self.scene.sights(&view, filter, &mut self.workspace.sights));
        let occluders = timed(&mut stages, "select", || self.active_occluders(&view, filter));
        if progress.is_cancelled() {
            return None;
        }
        let Hzm { scene, settings, workspace, .. } = self;
        timed(&mut stages, "raster", || {
            workspace.pyramid.clear(width, height);
            workspace.draw(scene, occluders, &view, filter);
        });
        timed(&mut stages, "pyramid", || workspace.pyramid.build());
        let visible = timed(&mut stages, "test", || {
            let least = settings.pixel_error_threshold;
            let is_candidate = |sight: &Sight| match sight {
                Sight::Outside => false,
                Sight::AtEye => true,
                Sight::Covers(seen) => seen.area >= least,
            };
            let mut visible: Vec<bool> = workspace.sights.iter().map(is_candidate).collect();
            workspace.test(settings.finer_levels, &mut visible);
            visible
        });
        Some(CulledFrame { found: answer(visible), stages })
    }
}

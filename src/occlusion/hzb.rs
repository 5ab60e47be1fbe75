//! Two-pass occlusion culling with a hierarchical Z-buffer, as engines do today (Haar and Aaltonen, "GPU-Driven
//! Rendering Pipelines", 2015; Karis, "Nanite: A Deep Dive", 2021).
//!
//! What was visible in the last frame is drawn into a depth image of this frame; everything in the frustum is tested; what is newly visible is
//! drawn too, and what passed is tested again. So a drawable that appears is found in the frame in which it
//! appears, and no depth of an older frame is ever trusted.
//!
//! The first frame has no last one: it begins with the nearest drawables in the frustum, up to a number of triangles; the second
//! pass adds what these do not hide.

use std::sync::Arc;

use super::boxes::Sight;
use super::frame::{Workspace, answer};
use super::scene::OcclusionScene;
use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::progress::Progress;
use crate::visibility::QueryScene;
use crate::visibility::culling::{CulledFrame, Culling, timed};

/// Parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HzbSettings {
    /// Level-0 triangles that a first frame begins with.
    pub first_frame_triangles: u64,
    /// Levels of the pyramid below the one where a box spans 2 x 2 texels that are asked when that does not hide it. Enough of
    /// them ask every pixel.
    pub finer_levels: u32,
}

impl Default for HzbSettings {
    fn default() -> Self {
        HzbSettings { first_frame_triangles: 250_000, finer_levels: 2 }
    }
}

/// Two-pass culling.
pub struct Hzb {
    scene: Arc<OcclusionScene>,
    settings: HzbSettings,
    /// What was visible in the last frame; empty before a first frame.
    last: Vec<bool>,
    workspace: Workspace,
}

impl Hzb {
    /// Ready for a first frame.
    pub fn new(scene: Arc<OcclusionScene>, settings: HzbSettings) -> Self {
        Hzb { scene, settings, last: Vec::new(), workspace: Workspace::new() }
    }

    /// The occluders of a first frame; none that is looked through.
    fn nearest_first(&self, filter: &Filter) -> Vec<bool> {
        let sights = &self.workspace.sights;
        let mut nearest: Vec<(f32, u32)> = (0..)
            .zip(sights)
            .filter(|&(drawable, _)| self.scene.occludes(drawable) && !filter.is_seen_through(drawable))
            .filter_map(|(drawable, sight)| match sight {
                Sight::Outside => None,
                Sight::AtEye => Some((f32::INFINITY, drawable)),
                Sight::Covers(seen) => Some((seen.nearest, drawable)),
            })
            .collect();
        nearest.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut chosen = vec![false; sights.len()];
        let mut triangles = 0;
        for (_, drawable) in nearest {
            triangles += u64::from(self.scene.triangle_count(drawable));
            chosen[drawable as usize] = true;
            if triangles >= self.settings.first_frame_triangles {
                break;
            }
        }
        chosen
    }
}

/// Drawables for which the flag is set.
fn set(flags: &[bool]) -> impl Iterator<Item = u32> + '_ {
    (0..).zip(flags).filter(|(_, set)| **set).map(|(drawable, _)| drawable)
}

impl Culling for Hzb {
    fn name(&self) -> String {
        "hzb".to_owned()
    }

    fn reset(&mut self) {
        self.last.clear();
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
        let view = self.scene.view(camera);
        let (width, height) = camera.size();
        let filter = scene.filter;
        let occluders = timed(&mut stages, "frustum", || {
            self.scene.sights(&view, filter, &mut self.workspace.sights);
            let in_frustum: Vec<bool> = self.workspace.sights.iter().map(|s| *s != Sight::Outside).collect();
            if self.last.is_empty() {
                self.last = self.nearest_first(filter);
            }
            let occluders = self.last.iter().zip(&in_frustum).map(|(&last, &is_in)| last && is_in).collect();
            self.last = in_frustum;
            occluders
        });
        let occluders: Vec<bool> = occluders;
        // From here on `last` is what is not yet known to be hidden.
        let Hzb { scene, settings, last: visible, workspace } = self;
        timed(&mut stages, "raster", || {
            workspace.pyramid.clear(width, height);
            workspace.draw(scene, set(&occluders), &view, filter);
        });
        timed(&mut stages, "pyramid", || workspace.pyramid.build());
        timed(&mut stages, "test", || workspace.test(settings.finer_levels, visible));
        if progress.is_cancelled() {
            return None;
        }
        timed(&mut stages, "raster 2", || {
            let is_new: Vec<bool> =
                visible.iter().zip(&occluders).map(|(&visible, &drawn)| visible && !drawn).collect();
            workspace.draw(scene, set(&is_new), &view, filter);
        });
        timed(&mut stages, "pyramid 2", || workspace.pyramid.build());
        timed(&mut stages, "test 2", || workspace.test(settings.finer_levels, visible));
        Some(CulledFrame { found: answer(visible.clone()), stages })
    }
}

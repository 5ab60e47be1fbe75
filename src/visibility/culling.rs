//! Methods of finding what is visible, side by side: one trait, frame after frame, with what each frame cost.

use std::time::Instant;

use super::{Method, QueryScene, QuerySettings, VisibleSet, query_until};
use crate::camera::CameraRays;
use crate::progress::Progress;

/// One way to find what is visible. It may keep what it found in one frame for the next.
pub trait Culling: Send {
    /// Name in tables and files: lower case, no spaces.
    fn name(&self) -> String;

    /// Forgets the frames before: the next one is a first one.
    fn reset(&mut self) {}

    /// Does a frame depend on the frames before?
    fn keeps_state(&self) -> bool {
        false
    }

    /// What the camera sees; `None` when cancelled.
    fn frame(
        &mut self,
        scene: &QueryScene,
        camera: &CameraRays,
        progress: &dyn Progress,
    ) -> Option<CulledFrame>;
}

/// The answer for one frame, and what it took.
#[derive(Clone, Debug)]
pub struct CulledFrame {
    /// The answer. Methods that cast no rays give no samples.
    pub found: VisibleSet,
    /// Stages in their order.
    pub stages: Vec<StageTime>,
}

impl CulledFrame {
    /// All stages together, seconds.
    pub fn seconds(&self) -> f64 {
        self.stages.iter().map(|stage| stage.seconds).sum()
    }
}

/// Wall-clock time of one stage.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct StageTime {
    /// What was done: lower case, the same every frame.
    pub stage: &'static str,
    /// How long it took.
    pub seconds: f64,
}

/// Runs one stage and adds its time.
pub fn timed<T>(stages: &mut Vec<StageTime>, stage: &'static str, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = work();
    stages.push(StageTime { stage, seconds: started.elapsed().as_secs_f64() });
    result
}

/// A query that starts anew every frame: `frustum`, `exact`, `voxel`, `hybrid` without coherence.
pub struct FreshQuery {
    /// How.
    pub method: Method,
    /// With what rays.
    pub settings: QuerySettings,
}

impl Culling for FreshQuery {
    fn name(&self) -> String {
        match self.method {
            Method::Frustum => "frustum",
            Method::Exact => "exact",
            Method::Voxel => "voxel",
            Method::Hybrid if self.settings.adaptive => "adaptive",
            Method::Hybrid => "hybrid",
        }
        .to_owned()
    }

    fn frame(
        &mut self,
        scene: &QueryScene,
        camera: &CameraRays,
        progress: &dyn Progress,
    ) -> Option<CulledFrame> {
        let mut stages = Vec::new();
        let stage = if self.method == Method::Frustum { "boxes" } else { "rays" };
        let found =
            timed(&mut stages, stage, || query_until(scene, camera, self.method, &self.settings, progress))?;
        Some(CulledFrame { found, stages })
    }
}

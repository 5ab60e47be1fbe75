//! View-frustum culling: the baseline without occlusion.

use super::{QueryScene, VisibleSet};
use crate::camera::CameraRays;

/// Every drawable of every object whose box meets the view pyramid. Conservative: a box that is outside of no single
/// plane counts as inside.
pub(super) fn in_frustum(scene: &QueryScene, camera: &CameraRays) -> VisibleSet {
    let mut found = VisibleSet::new(scene.exact.drawable_count());
    let frustum = camera.frustum();
    for (min, max, drawables) in scene.object_boxes {
        if !scene.filter.reaches(*min, *max) {
            continue;
        }
        if frustum.iter().all(|plane| plane.reaches(*min, *max)) {
            for drawable in drawables.clone().filter(|&drawable| !scene.filter.is_hidden(drawable)) {
                found.visible[drawable as usize] = true;
            }
        }
    }
    found
}

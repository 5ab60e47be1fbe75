//! View-frustum culling: the baseline without occlusion.

use glam::DVec3;

use super::{QueryScene, VisibleSet};
use crate::camera::CameraRays;

/// Every drawable of every object whose box meets the view pyramid. Conservative: a box that is outside of no single
/// plane counts as inside.
pub(super) fn in_frustum(scene: &QueryScene, camera: &CameraRays) -> VisibleSet {
    let mut found = VisibleSet::new(scene.exact.drawable_count());
    let normals = camera.frustum_normals();
    for (min, max, drawables) in scene.object_boxes {
        if normals.iter().all(|normal| reaches(*normal, camera.eye(), *min, *max)) {
            found.visible[drawables.start as usize..drawables.end as usize].fill(true);
        }
    }
    found
}

/// Is any corner of the box on the inner side of the plane through `point`?
fn reaches(normal: DVec3, point: DVec3, min: DVec3, max: DVec3) -> bool {
    let farthest = DVec3::select(normal.cmpge(DVec3::ZERO), max, min);
    normal.dot(farthest - point) >= 0.0
}

//! View-frustum culling: the baseline without occlusion.

use glam::DMat3;

use super::{QueryScene, VisibleSet};
use crate::camera::{CameraRays, Plane};
use crate::exact::ExactScene;

/// Every drawable whose box meets the view pyramid: that of its object, and unless all of that is inside, its own in the
/// space of its part. Conservative: a box that is outside of no single plane counts as inside.
pub(super) fn in_frustum(scene: &QueryScene, camera: &CameraRays) -> VisibleSet {
    let mut found = VisibleSet::new(scene.exact.drawable_count());
    let frustum = camera.frustum();
    for (min, max, drawables) in scene.object_boxes {
        let planes = frustum.iter().chain(scene.filter.clip_planes());
        if !planes.clone().all(|plane| plane.reaches(*min, *max)) {
            continue;
        }
        let crossed: Vec<&Plane> = planes.filter(|plane| !plane.holds(*min, *max)).collect();
        for drawable in drawables.clone().filter(|&drawable| !scene.filter.is_hidden(drawable)) {
            found.visible[drawable as usize] = in_planes(scene.exact, drawable, crossed.iter().copied());
        }
    }
    found
}

/// Is any part of a drawable's box, in the space of its part, inside of each plane?
pub(super) fn in_planes<'p>(
    exact: &ExactScene,
    drawable: u32,
    planes: impl Iterator<Item = &'p Plane> + Clone,
) -> bool {
    // Most are quite in or quite out, as the box along the world's axes tells.
    let (min, max) = exact.drawable_box(drawable);
    if !planes.clone().all(|plane| plane.reaches(min, max)) {
        return false;
    }
    let mut crossed = planes.filter(|plane| !plane.holds(min, max)).peekable();
    if crossed.peek().is_none() {
        return true;
    }
    let (min, max) = exact.chunks()[exact.chunk_of(drawable) as usize].bounds();
    let world_from_part = exact.world_from_part(drawable);
    let centre = world_from_part.transform_point3(min + 0.5 * (max - min));
    let axes = world_from_part.matrix3 * DMat3::from_diagonal(0.5 * (max - min));
    crossed.all(|plane| {
        let half = (axes.transpose() * plane.normal).abs().element_sum();
        // A few units in the last place of what was added up.
        let rounding =
            8.0 * f64::EPSILON * plane.normal.length() * (centre - plane.point).length().max(centre.length());
        plane.normal.dot(centre - plane.point) + half + rounding >= 0.0
    })
}

//! A drawn frame against what rays through the triangles say.

use std::collections::HashMap;

use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::render::{RenderScene, RenderSettings, Renderer};
use crate::visibility::QueryScene;

/// How a frame's drawables differ from those of `exact`, through the middles of pixels; of what is opaque.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Difference {
    /// Compared.
    pub pixels: u64,
    /// Of another drawable, or of none.
    pub differ: u64,
    /// Of these, those with no silhouette beside them: no rounding, and no level of detail that is fine enough, explains them.
    pub off_silhouettes: u64,
    /// Drawables that `exact` sees in at least 16 pixels and the frame in none.
    pub lost: u64,
}

/// Pixels from which on a user misses a drawable.
const MISSED: u32 = 16;

/// Asks `exact` and compares; `None` when cancelled. `drawables` are those of the frame, row by row.
pub fn check(
    scene: &LoadedScene,
    filter: &Filter,
    camera: &CameraRays,
    drawables: &[u32],
    progress: &dyn Progress,
) -> Option<Difference> {
    let query = QueryScene { filter, ..scene.query() };
    let mut opaque = filter.clone();
    let glass = (0..query.exact.drawable_count()).filter(|&drawable| query.is_transparent(drawable));
    glass.for_each(|drawable| opaque.set_hidden(drawable, true));
    let picture = scene.picture();
    let picture = RenderScene { query: QueryScene { filter: &opaque, ..picture.query }, ..picture };
    let settings = RenderSettings::middles(glam::DVec3::Y);
    let (width, height) = camera.size();
    let (film, _) = Renderer::new(&picture, camera, &settings).rows(0..height, progress)?;
    let expected: Vec<u32> = film.pixels.iter().map(|pixel| pixel.drawable).collect();
    Some(compare(&expected, drawables, (width, height)))
}

/// Compares two images of drawables.
pub fn compare(expected: &[u32], found: &[u32], (width, height): (u32, u32)) -> Difference {
    debug_assert!(expected.len() == found.len() && expected.len() == width as usize * height as usize);
    let mut difference = Difference { pixels: expected.len() as u64, ..Difference::default() };
    let mut counts: HashMap<u32, (u32, u32)> = HashMap::new();
    for (index, (&expected_here, &found_here)) in expected.iter().zip(found).enumerate() {
        counts.entry(expected_here).or_default().0 += 1;
        counts.entry(found_here).or_default().1 += 1;
        if expected_here == found_here {
            continue;
        }
        difference.differ += 1;
        let (x, y) = (index as u32 % width, index as u32 / width);
        let around = |at: u32, size: u32| at.saturating_sub(1)..=(at + 1).min(size - 1);
        let is_silhouette = around(y, height)
            .any(|y| around(x, width).any(|x| expected[(y * width + x) as usize] != expected_here));
        difference.off_silhouettes += u64::from(!is_silhouette);
    }
    counts.remove(&crate::render::NOBODY);
    difference.lost =
        counts.values().filter(|&&(expected, found)| expected >= MISSED && found == 0).count() as u64;
    difference
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::NOBODY;

    #[test]
    fn differences_are_told_apart_by_silhouettes_and_what_is_lost() {
        // Drawable 1 on the left half, 2 on the right, and nothing below.
        let (width, height) = (10, 8);
        let at = |x: u32, y: u32| if y >= 6 { NOBODY } else { 1 + u32::from(x >= 5) };
        let expected: Vec<u32> = (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect();
        let same = compare(&expected, &expected, (width, height));
        assert_eq!(same, Difference { pixels: 80, ..Difference::default() });
        let mut found = expected.clone();
        found[4] = 2; // on the border of both
        found[11] = 7; // amid drawable 1
        let some = compare(&expected, &found, (width, height));
        assert_eq!(some, Difference { pixels: 80, differ: 2, off_silhouettes: 1, lost: 0 });
        let without: Vec<u32> = expected.iter().map(|&d| if d == 2 { NOBODY } else { d }).collect();
        let gone = compare(&expected, &without, (width, height));
        assert_eq!((gone.differ, gone.lost), (30, 1));
    }
}

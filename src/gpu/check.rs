//! A drawn frame against what rays through the triangles say.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::camera::CameraRays;
use crate::progress::Progress;
use crate::render::{RenderScene, RenderSettings, Renderer};
use crate::shown::Shown;
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

/// What `exact` sees through the middle of each pixel, row by row, of what is opaque; `None` when cancelled.
pub fn expected(shown: &Shown, camera: &CameraRays, progress: &dyn Progress) -> Option<Vec<u32>> {
    let query = shown.unmoved();
    let mut opaque = query.filter.clone();
    let glass = (0..query.exact.drawable_count()).filter(|&drawable| query.is_transparent(drawable));
    glass.for_each(|drawable| opaque.set_hidden(drawable, true));
    let picture = shown.scene().picture();
    let picture = RenderScene { query: QueryScene { filter: &opaque, ..picture.query }, ..picture };
    let settings = RenderSettings::middles(glam::DVec3::Y);
    let (width, height) = camera.size();
    let (film, _) = Renderer::new(&picture, camera, &settings).rows(0..height, progress)?;
    let Some(moved) = shown.moved() else {
        return Some(film.pixels.iter().map(|pixel| pixel.drawable).collect());
    };
    let of_pixel = |(index, pixel): (usize, &crate::render::FilmPixel)| {
        let (x, y) = (index % width as usize, index / width as usize);
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let before = moved.closest_through(&ray, |_| ()).filter(|hit| hit.t < pixel.depth.into());
        before.map_or(pixel.drawable, |hit| hit.drawable)
    };
    Some(film.pixels.par_iter().enumerate().map(of_pixel).collect())
}

/// How wrong a pixel is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Fault {
    /// Not at all.
    #[default]
    None,
    /// Another drawable, beside a silhouette.
    Silhouette,
    /// Another drawable, away from silhouettes.
    Wrong,
    /// Of a drawable that is lost.
    Lost,
}

/// Compares two images of drawables, row by row: in all, and pixel by pixel.
pub fn compare(expected: &[u32], found: &[u32], (width, height): (u32, u32)) -> (Difference, Vec<Fault>) {
    debug_assert!(expected.len() == found.len() && expected.len() == width as usize * height as usize);
    let mut difference = Difference { pixels: expected.len() as u64, ..Difference::default() };
    let mut faults = vec![Fault::None; expected.len()];
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
        faults[index] = if is_silhouette { Fault::Silhouette } else { Fault::Wrong };
    }
    counts.remove(&crate::render::NOBODY);
    counts.retain(|_, &mut (expected, found)| expected >= MISSED && found == 0);
    difference.lost = counts.len() as u64;
    if !counts.is_empty() {
        let lost = faults.iter_mut().zip(expected).filter(|(_, drawable)| counts.contains_key(drawable));
        lost.for_each(|(fault, _)| *fault = Fault::Lost);
    }
    (difference, faults)
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
        let (same, faults) = compare(&expected, &expected, (width, height));
        assert_eq!(same, Difference { pixels: 80, ..Difference::default() });
        assert!(faults.iter().all(|&fault| fault == Fault::None));
        let mut found = expected.clone();
        found[4] = 2; // on the border of both
        found[11] = 7; // amid drawable 1
        let (some, faults) = compare(&expected, &found, (width, height));
        assert_eq!(some, Difference { pixels: 80, differ: 2, off_silhouettes: 1, lost: 0 });
        assert_eq!((faults[4], faults[11], faults[12]), (Fault::Silhouette, Fault::Wrong, Fault::None));
        let without: Vec<u32> = expected.iter().map(|&d| if d == 2 { NOBODY } else { d }).collect();
        let (gone, faults) = compare(&expected, &without, (width, height));
        assert_eq!((gone.differ, gone.lost), (30, 1));
        let lost = expected.iter().zip(&faults).all(|(&d, &fault)| (d == 2) == (fault == Fault::Lost));
        assert!(lost);
    }
}

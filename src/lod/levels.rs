//! The levels of the container: those of each drawable's chunk.

use glam::DMat3;

use super::{Level, System};
use crate::container::layout::LevelRecord;
use crate::scene::Scene;

/// Discrete levels of chunks; their pages are the container's levels.
#[derive(Debug)]
pub struct ChunkLevels {
    pages: Vec<Page>,
    drawables: Vec<Placed>,
}

/// What selection asks about a page.
#[derive(Clone, Copy, Debug)]
struct Page {
    triangles: u32,
    vertices: u32,
    /// Part units.
    error: f32,
}

#[derive(Clone, Copy, Debug)]
struct Placed {
    first_level: u32,
    level_count: u32,
    /// Part units to world units, at most.
    scale: f32,
}

impl ChunkLevels {
    /// Of an opened scene.
    pub fn new(scene: &Scene) -> Self {
        let scales: Vec<f64> = (0..scene.objects().len() as u32)
            .map(|object| largest_stretch(scene.world_from_part(object).matrix3))
            .collect();
        let placed = |drawable: &crate::scene::Drawable| {
            let chunk = &scene.chunks()[drawable.chunk as usize];
            Placed {
                first_level: chunk.first_level,
                level_count: chunk.level_count,
                // Rounded up: an error must not look smaller than it is.
                scale: (scales[drawable.object as usize] as f32).next_up(),
            }
        };
        let page = |record: &LevelRecord| Page {
            triangles: record.triangle_count,
            vertices: record.vertex_count,
            error: record.error,
        };
        ChunkLevels {
            pages: scene.levels().iter().map(page).collect(),
            drawables: scene.drawables().iter().map(placed).collect(),
        }
    }
}

impl System for ChunkLevels {
    fn drawable_count(&self) -> u32 {
        self.drawables.len() as u32
    }

    fn page_count(&self) -> u32 {
        self.pages.len() as u32
    }

    fn level_count(&self, drawable: u32) -> u32 {
        self.drawables[drawable as usize].level_count
    }

    fn level(&self, drawable: u32, level: u32) -> Level {
        let Placed { first_level, level_count, scale } = self.drawables[drawable as usize];
        debug_assert!(level < level_count, "drawable {drawable} has {level_count} levels, not {level}");
        let page = first_level + level;
        let Page { triangles, vertices, error } = self.pages[page as usize];
        Level { triangles, vertices, error: f64::from(error) * f64::from(scale), page }
    }
}

/// By how much a linear map stretches a vector at most: its largest singular value.
pub(crate) fn largest_stretch(map: DMat3) -> f64 {
    // The largest eigenvalue of the symmetric matrix, by the trigonometric formula (Smith 1961).
    let square = map.transpose() * map;
    let at = |i: usize, j: usize| square.col(j)[i];
    let off = at(0, 1).powi(2) + at(0, 2).powi(2) + at(1, 2).powi(2);
    let mean = (at(0, 0) + at(1, 1) + at(2, 2)) / 3.0;
    let spread = (0..3).map(|i| (at(i, i) - mean).powi(2)).sum::<f64>() + 2.0 * off;
    let p = (spread / 6.0).sqrt();
    // Where it is a multiple of the unit matrix but for rounding, all eigenvalues are the same.
    if p <= mean * 1e-12 {
        return (mean + p).sqrt();
    }
    let shifted = (square - DMat3::from_diagonal(glam::DVec3::splat(mean))) * p.recip();
    let angle = (0.5 * shifted.determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    (mean + 2.0 * p * angle.cos()).sqrt()
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    #[test]
    fn the_largest_stretch_is_that_of_the_longest_axis() {
        let mut random = oorandom::Rand64::new(3);
        for round in 0..2000 {
            let mut number = || random.rand_float() * 2.0 - 1.0;
            let turn =
                |a: f64, b: f64, c: f64, d: f64| DMat3::from_quat(DQuat::from_xyzw(a, b, c, d).normalize());
            let stretches = match round % 4 {
                0 => DVec3::ONE * 7.0,
                1 => DVec3::new(3.0, 3.0, 0.0),
                2 => DVec3::new(1.0, 1.0 + 1e-9 * number(), -2.0),
                _ => DVec3::new(number(), number(), number()) * 100.0,
            };
            let (left, right) =
                (turn(number(), number(), number(), number()), turn(number(), number(), number(), number()));
            let found = largest_stretch(left * DMat3::from_diagonal(stretches) * right);
            let expected = stretches.abs().max_element();
            assert!(
                (found - expected).abs() <= 1e-6 * expected,
                "round {round}: {found}, expected {expected}"
            );
        }
    }
}

//! The levels of detail of a chunk: quadric-error edge collapse (Garland and Heckbert 1997) by meshoptimizer.
//!
//! Each level is simplified from the one before to half its triangles. Vertices are never moved, only left out, so
//! that a level needs no vertices of its own and borders stay on the grid.
//!
//! Borders between chunks are locked. With one of meshoptimizer's steps a level is the image of level 0 under a map of
//! vertices to vertices, less the triangles that became degenerate; the boundary of such an image is the image of the
//! boundary (modulo 2), and locked vertices stay: so any mix of levels fits together. Pruning is not such a map and is
//! left out where a chunk has neighbours. Open edges of the input are not locked; meshoptimizer weighs them ten times
//! and moves them only along themselves.
//!
//! Cost of a chain, measured on a sphere of 211,600 triangles, one core: 2.6 microseconds a triangle of level 0, about
//! half in the simplifier and half in measuring its errors.

use glam::{DVec3, Vec3};
use meshopt::SimplifyOptions;

use super::chunk::Bounds;
use super::deviation::{Surface, deviation};

/// Chunks of at most this many triangles get no coarser levels: a level costs a record of 40 bytes and its own draw,
/// as much as it saves.
pub const MAX_TRIANGLES_WITHOUT_LEVELS: usize = 24;
/// The chain ends when a level has at most this many triangles: what a box needs.
const LAST_LEVEL_TRIANGLES: usize = 12;
/// A level with more than this share of the finer one's triangles is not worth its bytes.
const STALLED: f64 = 0.85;
/// The chain ends before a level's error exceeds this share of the chunk's longest side.
const MAX_ERROR_SHARE: f64 = 0.5;
/// Deviation is measured against the level this many finer and that level's error is added. On smooth surfaces an
/// error quadruples in two levels, so that the sum is at most a third too large; measuring every level against level 0
/// would take four times as many distances; against the next finer level alone errors would come out twice too large.
const REFERENCE_DISTANCE: usize = 2;

/// A level before its vertices are packed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Level {
    /// Corners as indices into the vertices of level 0.
    pub triangles: Vec<[u32; 3]>,
    /// Geometric error in part units, as [`chain`] defines it.
    pub error: f64,
}

/// Levels of a chunk with these vertices (part space, decoded), finest first; level 0 is `triangles`.
///
/// `locked` vertices stay in all levels in which a triangle needs them. The number of triangles falls strictly,
/// errors never fall and are finite, and no level is empty.
///
/// The error of a level is the distance measured to the surface two levels finer (see [`mod@super::deviation`]) plus
/// that level's own error, and no less than the next finer level's. Where a whole piece went, nothing can be measured,
/// and the simplifier's figure is taken: for a pruned piece its radius. (That figure is not used otherwise. It contains
/// 3e-4 of the length of collapsed edges for regularity, so that a plane or the wall of a cylinder, which most of a
/// CAD model is, would never be free of error.)
pub(super) fn chain(positions: &[Vec3], triangles: Vec<[u32; 3]>, locked: &[bool]) -> Vec<Level> {
    let exact: Vec<DVec3> = positions.iter().map(|p| p.as_dvec3()).collect();
    let max_error = Bounds::of(exact.iter().copied()).extent().max_element() * MAX_ERROR_SHARE;
    let mut levels = vec![Level { triangles, error: 0.0 }];
    if levels[0].triangles.len() <= MAX_TRIANGLES_WITHOUT_LEVELS {
        return levels;
    }
    let simplifier = Simplifier {
        positions: positions.iter().map(|p| p.to_array()).collect(),
        locked,
        has_locked: locked.contains(&true),
        max_error,
    };
    let mut surfaces: Vec<Surface> = vec![Surface::new(levels[0].triangles.clone(), positions.len())];
    while let (Some(finer), Some(surface)) = (levels.last(), surfaces.last()) {
        if finer.triangles.len() <= LAST_LEVEL_TRIANGLES {
            break;
        }
        let Some((triangles, estimate)) = simplifier.halve(surface.triangles()) else { break };
        let coarse = Surface::new(triangles, positions.len());
        let reference = surfaces.len().saturating_sub(REFERENCE_DISTANCE);
        let base = levels[reference].error;
        let measured = deviation(&surfaces[reference], &coarse, &exact, finer.error - base);
        let lost = if measured.has_lost_pieces { estimate } else { 0.0 };
        let error = (base + measured.distance).max(finer.error).max(lost);
        if !error.is_finite() || error > max_error {
            break;
        }
        levels.push(Level { triangles: coarse.triangles().to_vec(), error });
        surfaces.push(coarse);
    }
    levels
}

struct Simplifier<'a> {
    positions: Vec<[f32; 3]>,
    locked: &'a [bool],
    has_locked: bool,
    /// Part units.
    max_error: f64,
}

impl Simplifier<'_> {
    /// About half the triangles, and the estimated error in part units; `None` when simplification stalls.
    fn halve(&self, triangles: &[[u32; 3]]) -> Option<(Vec<[u32; 3]>, f64)> {
        let enough = (triangles.len() as f64 * STALLED) as usize;
        let is_level = |(coarse, _): &(Vec<[u32; 3]>, f64)| !coarse.is_empty() && coarse.len() <= enough;
        let usual = self.simplify(triangles, SimplifyOptions::None);
        if is_level(&usual) {
            return Some(usual);
        }
        // Stalled by vertices with unclear topology (edges of three triangles, faces turned inside out), which are
        // locked unless permitted to move, or by many small pieces, which only pruning can thin out.
        let prune = if self.has_locked { SimplifyOptions::None } else { SimplifyOptions::Prune };
        Some(self.simplify(triangles, SimplifyOptions::Permissive | prune)).filter(is_level)
    }

    fn simplify(&self, triangles: &[[u32; 3]], options: SimplifyOptions) -> (Vec<[u32; 3]>, f64) {
        let target = (triangles.len() / 2).max(LAST_LEVEL_TRIANGLES.min(triangles.len()));
        let mut estimate = 0.0f32;
        let indices = meshopt::simplify_with_locks_decoder(
            bytemuck::cast_slice(triangles),
            &self.positions,
            self.locked,
            target * 3,
            self.max_error as f32,
            // Sparse: the work is in proportion to the triangles left, not to the vertices of level 0.
            options | SimplifyOptions::ErrorAbsolute | SimplifyOptions::Sparse,
            Some(&mut estimate),
        );
        let (coarse, _) = indices.as_chunks::<3>();
        (coarse.to_vec(), f64::from(estimate))
    }
}

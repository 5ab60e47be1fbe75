//! Conservative overlap of triangles with voxels, bricks and blocks, in exact integer arithmetic, 64 cells at a time.
//!
//! A triangle and a box overlap unless one of 13 axes separates them: the three box normals, the triangle's normal,
//! and the nine cross products of the triangle's edges with the box's axes (Akenine-Möller, "Fast 3D Triangle-Box
//! Overlap Testing", 2001; the grouping into three 2D tests and a plane test is that of Schwarz and Seidel, "Fast
//! Parallel Surface and Solid Voxelization on GPUs", 2010). All tests are two-sided intervals, so that degenerate
//! triangles (segments, points) need no case of their own, and nothing is ever rounded.
//!
//! # One test for all axes and all cell sizes
//!
//! Vertices are snapped to steps of 1/256 voxel, and each box is widened by one step on every side. Take an axis n with
//! P and N the sums of its positive and its negative components, the triangle's interval `[l, h]` on it, and cells of
//! L = 256 * 2^k steps. The widened cell with index I (a vector) has its low corner at `L I - 1` and spans L + 2 steps, so
//! that its interval is `L (n . I) - (P + N) + [N (L + 2), P (L + 2)]`, and it overlaps the triangle's when
//!
//! > `ceil((l - d) / L) - P  <=  n . I  <=  floor((h + d) / L) - N`, where d = P - N.
//!
//! So a test is one linear function of cell indices between two integers, the function is the same for all sizes, and
//! since floors nest, the bounds of a size are shifts of those for voxels. The 4x4 columns of a projection (a bit each)
//! are 16 lanes: one addition and one comparison an edge. Every level of the way down from a triangle's window through
//! cells of 64, 16 and 4 voxels to voxels is the same code, and exact, so that only what the triangle touches is visited;
//! cells of which all voxels pass the edge tests (`covered`) leave only the plane to test below. A triangle that is flat
//! along an axis or stays within one voxel there is a 2D problem, in two axes it is its box.
//!
//! # Why it is exact
//!
//! With coordinates in `0 ..= 2^25` (the largest grid: 2^17 voxels), relative to a window's corner, in steps:
//!
//! - an edge axis has two components, each up to 2^25, so that d <= 2^26; its products with positions stay below 2^51 and `l`, `h`, d
//!   and their sums below 2^53: i64, or i32 where all positions are below 2^14. In a window of w voxels a side `n . I` lies
//!   in `[N w, P w]`; bounds are clamped to one past that, which no test can tell, and then all is i32 while
//!   `d (1.25 w + 2) + 4 < 2^31` (`fits_32_bits`): for windows of 16 voxels always (2^26 * 22 + 4 < 2^31), of 256 voxels
//!   for triangles whose two largest extents sum to 26,000 voxels. Where it does not hold, cells are tested one by one in 64 bits until it does;
//! - the triangle's normal has components up to 2^50, twice the area of a projection into a square of side 2^25. Its
//!   product with a position and the interval are i128, formed once per triangle; divided by 256 and clamped to the window
//!   they are below 2^58 (3 2^50 * 16 voxels, or the above times the extent): i64. Inside 64 cells they are i32 where
//!   d < 2^28 (triangles up to 1,100 square voxels at least), else i64;
//! - a two-sided test `0 <= t <= w` with `|t|`, w < 2^31 is the signed comparison `t - 2^31 < w + 1 - 2^31` in wrapping
//!   arithmetic: a negative t becomes at least 2^32 - |t|, above w.
//!
//! # Why nothing is missed
//!
//! Snapping moves a vertex by at most half a step per axis (and the f64 placement before it by far less:
//! [`crate::grid::GridError::TooFine`]). A point of the real triangle is a convex combination of its vertices; the same
//! combination of the snapped ones lies within half a step of it on each axis, and so inside the box widened by a whole
//! step if the point lies in the voxel: **no voxel touched by the real triangle is missed**.
//!
//! # What is too much
//!
//! A voxel that is found and not touched lies within 1.5 steps (6/1000 voxel) of the real triangle on each axis: half a
//! step that snapping moved a vertex, and one that the box was widened by. That is a step more than the half step that
//! snapping costs. Hardly more than half a step of widening would do for the promise above; the other half is what lets a ray walk
//! that is off by 2^-10 voxel enter a voxel that knows the triangle all the same.

mod axes;
mod bits;
mod descent;
mod plane;
mod projection;

use fearless_simd::{Level, dispatch};

use self::bits::per_axis;
use self::descent::Region;
use self::projection::KEPT_AXES;
use super::SnappedTriangle;
use crate::grid::SUBVOXELS;
use crate::raycast::Instructions;

/// Widening of each box, in snapping steps.
const WIDEN: i32 = 1;
/// log2 of the steps a voxel.
const STEPS_LOG2: u32 = SUBVOXELS.trailing_zeros();

/// A snapped triangle, ready for overlap tests.
#[derive(Clone, Copy, Debug)]
pub struct TriangleOverlap {
    vertices: SnappedTriangle,
    /// Low and high corner in steps.
    min: [i32; 3],
    max: [i32; 3],
}

impl TriangleOverlap {
    /// From snapped vertices, in steps of 1/256 voxel, each coordinate in `0 ..= 2^25`.
    #[inline(always)]
    pub fn new(vertices: SnappedTriangle) -> Self {
        let [a, b, c] = vertices;
        let min = per_axis(|k| a[k].min(b[k]).min(c[k]));
        let max = per_axis(|k| a[k].max(b[k]).max(c[k]));
        TriangleOverlap { vertices, min, max }
    }

    /// First and last cell of `2^shift` voxels that its widened box touches, per axis; may lie outside the grid by one.
    #[inline(always)]
    pub fn cell_range(&self, shift: u32) -> ([i32; 3], [i32; 3]) {
        let size_log2 = shift + STEPS_LOG2;
        // A cell [a, b] touches when a - WIDEN <= max and b + WIDEN >= min; floor((m - 1) / s) = ceil(m / s) - 1.
        let low = per_axis(|k| (self.min[k] - WIDEN - 1) >> size_log2);
        let high = per_axis(|k| (self.max[k] + WIDEN) >> size_log2);
        (low, high)
    }

    /// Extent of its box in steps.
    #[inline(always)]
    fn extent(&self) -> [i32; 3] {
        per_axis(|k| self.max[k] - self.min[k])
    }

    /// Does it touch the cell of `2^shift` voxels whose low corner is voxel `corner`?
    ///
    /// One cell at a time, straight from the 13 axes: the reference of [`Self::for_each_brick`].
    pub fn touches_cell(&self, corner: [i32; 3], shift: u32) -> bool {
        let v = per_axis(|i| per_axis(|k| i64::from(self.vertices[i][k])));
        let low = per_axis(|k| i64::from(corner[k]) * i64::from(SUBVOXELS) - i64::from(WIDEN));
        let size = (i64::from(SUBVOXELS) << shift) + 2 * i64::from(WIDEN);
        let outside = |k: usize| low[k] > i64::from(self.max[k]) || low[k] + size < i64::from(self.min[k]);
        if outside(0) || outside(1) || outside(2) {
            return false;
        }
        for (a, b) in KEPT_AXES {
            for e in 0..3 {
                let (start, end, apex) = (v[e], v[(e + 1) % 3], v[(e + 2) % 3]);
                let (normal_a, normal_b) = (start[b] - end[b], end[a] - start[a]);
                let project = |p: [i64; 3]| normal_a * p[a] + normal_b * p[b];
                // Both ends of the edge project to the same value.
                let (on_edge, opposite, at_low) = (project(start), project(apex), project(low));
                let highest = at_low + (normal_a.max(0) + normal_b.max(0)) * size;
                let lowest = at_low + (normal_a.min(0) + normal_b.min(0)) * size;
                if highest < on_edge.min(opposite) || lowest > on_edge.max(opposite) {
                    return false;
                }
            }
        }
        let p = per_axis(|k| v[1][k] - v[0][k]);
        let q = per_axis(|k| v[2][k] - v[0][k]);
        let [x, y, z] = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        let product = |n: i64, k: usize| i128::from(n) * i128::from(low[k] - v[0][k]);
        let at_low = product(x, 0) + product(y, 1) + product(z, 2);
        let highest = at_low + i128::from(x.max(0) + y.max(0) + z.max(0)) * i128::from(size);
        let lowest = at_low + i128::from(x.min(0) + y.min(0) + z.min(0)) * i128::from(size);
        lowest <= 0 && highest >= 0
    }

    /// Calls `visit(corner, mask)` for the bricks that it touches within the cell of `2^shift` voxels (at least 4) at
    /// `cell` and within a grid of `side` voxels, each once, in no particular order. Bit x + 4 y + 16 z of a mask is the
    /// voxel (x, y, z) of the brick; no mask is empty.
    pub fn for_each_brick(
        &self,
        cell: [i32; 3],
        shift: u32,
        side: i32,
        visit: &mut impl FnMut([i32; 3], u64),
    ) {
        self.for_each_brick_in(Region::cell(cell, shift, side), visit);
    }

    /// [`Self::for_each_brick`] with these instructions, or with lesser ones where the processor lacks them, instead of the
    /// best: the same bits come out of all. For tests and measurements.
    pub fn for_each_brick_with(
        &self,
        instructions: Instructions,
        cell: [i32; 3],
        shift: u32,
        side: i32,
        visit: &mut impl FnMut([i32; 3], u64),
    ) {
        let clip = Region::cell(cell, shift, side);
        dispatch!(level_of(instructions), simd => descent::for_each_brick(simd, self, clip, visit));
    }

    fn for_each_brick_in(&self, clip: Region, visit: &mut impl FnMut([i32; 3], u64)) {
        dispatch!(Level::new(), simd => descent::for_each_brick(simd, self, clip, visit));
    }
}

/// The SIMD level of these instructions, or the next lower one that the processor has.
fn level_of(instructions: Instructions) -> Level {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        let best = Level::new();
        let (avx512, avx2) = (best.as_avx512().map(Level::Avx512), best.as_avx2().map(Level::Avx2));
        let chosen = match instructions {
            Instructions::Avx512 => avx512.or(avx2),
            Instructions::Avx2 => avx2,
            Instructions::Portable => None,
        };
        chosen.unwrap_or(Level::baseline())
    }
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    {
        let (Instructions::Portable | Instructions::Avx2 | Instructions::Avx512) = instructions;
        Level::baseline()
    }
}

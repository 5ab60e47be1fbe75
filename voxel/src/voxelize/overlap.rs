//! Conservative overlap of triangles with voxels, bricks and blocks, in exact integer arithmetic.
//!
//! A triangle and a box overlap unless one of 13 axes separates them: the three box normals, the triangle's normal,
//! and the nine cross products of the triangle's edges with the box's axes (Akenine-Möller, "Fast 3D Triangle-Box
//! Overlap Testing", 2001; the grouping into three 2D tests and a plane test is that of Schwarz and Seidel, "Fast
//! Parallel Surface and Solid Voxelization on GPUs", 2010). We differ: all tests are two-sided intervals, so that
//! degenerate triangles (segments, points) need no case of their own, and nothing is ever rounded:
//!
//! - vertices are snapped to 1/256 voxel, integers below 2^25 for the largest grid (2^17 voxels);
//! - a 2D edge test is a sum of two products of numbers below 2^26: below 2^53, exact in i64;
//! - a component of the normal is twice the area of the triangle's projection into a square of side 2^25: at most 2^50.
//!   Its product with a position below 2^26, and the sum of three of them, stay below 2^78: formed once per triangle and
//!   brick in i128. Steps inside a brick (at most 3 voxels of 2^8 an axis) sum to less than 2^62: exact in i64.
//!
//! Each box is widened by one step (1/256 voxel) on every side. Snapping moves a vertex by at most half a step per axis
//! (and the f64 placement before it by far less: [`crate::grid::GridError::TooFine`]), so every point of the *unsnapped*
//! triangle lies within a step of the snapped one: **no voxel touched by the real triangle is missed**. A false
//! positive is no farther from the real triangle than 1.5 steps: half a step more than snapping alone would give, so
//! that a ray walk that is off by 2^-10 voxel still enters a voxel that knows the triangle.

use wide::i32x4;

use super::for_each_cell;
use crate::grid::SUBVOXELS;

/// Widening of each box, in snapping steps.
const WIDEN: i64 = 1;
/// Above this many candidate bricks a triangle is narrowed down through coarser cells first.
const DIRECT_BRICKS: i64 = 16;
const STEPS: i64 = SUBVOXELS as i64;
const SHIFT: u32 = STEPS.trailing_zeros();
/// Side of a widened voxel, in steps.
const VOXEL_SIZE: i64 = STEPS + 2 * WIDEN;

/// The two coordinates that stay when axis 0, 1, 2 (x, y, z) is projected away.
const KEPT_AXES: [(usize, usize); 3] = [(1, 2), (0, 2), (0, 1)];

/// One separating axis within a coordinate plane: the normal of a projected edge, and the interval of the triangle on it.
#[derive(Clone, Copy, Default)]
struct EdgeAxis {
    normal: [i64; 2],
    low: i64,
    high: i64,
    /// [`EdgeAxis::bounds`] of voxels.
    voxel_bounds: (i64, i64),
}

impl EdgeAxis {
    fn new(normal: [i64; 2], a: i64, b: i64) -> Self {
        let axis = EdgeAxis { normal, low: a.min(b), high: a.max(b), voxel_bounds: (0, 0) };
        EdgeAxis { voxel_bounds: axis.bounds(VOXEL_SIZE), ..axis }
    }

    /// Bounds of the value at a box's low corner for which a box of `size` overlaps the triangle's interval.
    #[inline]
    fn bounds(&self, size: i64) -> (i64, i64) {
        let [na, nb] = self.normal;
        (self.low - (na.max(0) + nb.max(0)) * size, self.high - (na.min(0) + nb.min(0)) * size)
    }
}

/// A snapped triangle, set up for overlap tests.
pub struct TriangleOverlap {
    first: [i64; 3],
    /// Low and high corner in steps.
    min: [i64; 3],
    max: [i64; 3],
    edge_axes: [[EdgeAxis; 3]; 3],
    normal: [i64; 3],
}

impl TriangleOverlap {
    /// From snapped vertices, in steps of 1/256 voxel, each coordinate in `0 ..= 2^25`.
    pub fn new(vertices: [[i32; 3]; 3]) -> Self {
        let v = vertices.map(|p| p.map(i64::from));
        let edge = |a: usize, b: usize| [0, 1, 2].map(|k| v[b][k] - v[a][k]);
        let edges = [edge(0, 1), edge(1, 2), edge(2, 0)];
        let mut edge_axes = [[EdgeAxis::default(); 3]; 3];
        for (plane, (a, b)) in KEPT_AXES.into_iter().enumerate() {
            for (e, edge) in edges.iter().enumerate() {
                let normal = [-edge[b], edge[a]];
                let project = |p: &[i64; 3]| normal[0] * p[a] + normal[1] * p[b];
                // Both ends of the edge project to the same value.
                let (on_edge, opposite) = (project(&v[e]), project(&v[(e + 2) % 3]));
                edge_axes[plane][e] = EdgeAxis::new(normal, on_edge, opposite);
            }
        }
        let [p, q] = [edges[0], edges[1]];
        let normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        let min = [0, 1, 2].map(|k| v[0][k].min(v[1][k]).min(v[2][k]));
        let max = [0, 1, 2].map(|k| v[0][k].max(v[1][k]).max(v[2][k]));
        TriangleOverlap { first: v[0], min, max, edge_axes, normal }
    }

    /// First and last cell of `2^shift` voxels that its widened box touches, per axis; may lie outside the grid by one.
    #[inline]
    pub fn cell_range(&self, shift: u32) -> ([i32; 3], [i32; 3]) {
        let size_log2 = shift + STEPS.trailing_zeros();
        // A cell [a, b] touches when a - WIDEN <= max and b + WIDEN >= min; floor((m - 1) / s) = ceil(m / s) - 1.
        let low = self.min.map(|c| ((c - WIDEN - 1) >> size_log2) as i32);
        let high = self.max.map(|c| ((c + WIDEN) >> size_log2) as i32);
        (low, high)
    }

    /// Does it touch the cell of `2^shift` voxels whose low corner is voxel `corner`?
    pub fn touches_cell(&self, corner: [i32; 3], shift: u32) -> bool {
        let low = corner.map(|c| i64::from(c) * STEPS - WIDEN);
        let size = (STEPS << shift) + 2 * WIDEN;
        let outside = |k: usize| low[k] > self.max[k] || low[k] + size < self.min[k];
        if outside(0) || outside(1) || outside(2) {
            return false;
        }
        for (plane, (a, b)) in KEPT_AXES.into_iter().enumerate() {
            for axis in &self.edge_axes[plane] {
                let at_low = axis.normal[0] * low[a] + axis.normal[1] * low[b];
                let (at_least, at_most) = axis.bounds(size);
                if at_low < at_least || at_low > at_most {
                    return false;
                }
            }
        }
        let at_low = self.plane_at(low);
        let size = i128::from(size);
        let reach =
            |pick: fn(i64) -> i64| self.normal.iter().map(|&n| i128::from(pick(n))).sum::<i128>() * size;
        at_low + reach(|n| n.max(0)) >= 0 && at_low + reach(|n| n.min(0)) <= 0
    }

    /// Calls `visit(corner, mask)` for the bricks that it touches within the cell of `2^shift` voxels (at least 4) at
    /// `cell` and within a grid of `side` voxels: directly, or through sub-cells of a quarter of the side.
    pub fn for_each_brick(
        &self,
        cell: [i32; 3],
        shift: u32,
        side: i32,
        visit: &mut impl FnMut([i32; 3], u64),
    ) {
        let candidates = |sub: u32| {
            let (low, high) = self.cell_range(sub);
            let first = [0, 1, 2].map(|k| low[k].max(cell[k] >> sub));
            let end = cell.map(|c| (c + (1 << shift)).min(side));
            let last = [0, 1, 2].map(|k| high[k].min((end[k] - 1) >> sub));
            (first, last)
        };
        let (first, last) = candidates(2);
        let bricks: i64 = (0..3).map(|k| i64::from((last[k] - first[k] + 1).max(0))).product();
        if shift > 2 && bricks > DIRECT_BRICKS {
            let sub = shift - 2;
            let (first, last) = candidates(sub);
            for_each_cell(first, last, |at| {
                let corner = at.map(|c| c << sub);
                if sub == 2 || self.touches_cell(corner, sub) {
                    self.for_each_brick(corner, sub, side, visit);
                }
            });
            return;
        }
        for_each_cell(first, last, |at| {
            let brick = at.map(|c| c << 2);
            let mask = self.brick_mask(brick);
            if mask != 0 {
                visit(brick, mask);
            }
        });
    }

    /// The voxels that it touches of the 4x4x4 brick whose low corner is voxel `corner`: bit x + 4 y + 16 z.
    pub fn brick_mask(&self, corner: [i32; 3]) -> u64 {
        let low = corner.map(|c| i64::from(c) * STEPS - WIDEN);
        let size = VOXEL_SIZE;

        // Voxels whose extent along an axis meets the triangle's.
        let (mut from, mut to) = ([0usize; 3], [0usize; 3]);
        for k in 0..3 {
            // Voxel i spans low + i STEPS to low + i STEPS + size.
            let first = (self.min[k] - low[k] - size + STEPS - 1) >> SHIFT;
            let last = (self.max[k] - low[k]) >> SHIFT;
            if last < 0 || first > 3 {
                return 0;
            }
            from[k] = first.max(0) as usize;
            to[k] = last.min(3) as usize + 1;
        }
        if from[0] + 1 == to[0]
            && from[1] + 1 == to[1]
            && from[2] + 1 == to[2]
            && self.is_within(low, size, from)
        {
            return 1 << (from[0] + 4 * from[1] + 16 * from[2]);
        }

        let mut mask = spread_yz(self.columns(0, low, from, to));
        if mask == 0 {
            return 0;
        }
        mask &= spread_xz(self.columns(1, low, from, to));
        if mask == 0 {
            return 0;
        }
        mask &= spread_xy(self.columns(2, low, from, to));

        // Plane of the triangle: value at a voxel's low corner = base + steps; overlap when
        // -sum(max(n, 0)) size <= value <= -sum(min(n, 0)) size. Bounds saturate, steps stay below 2^63.
        let base = self.plane_at(low);
        let saturate = |v: i128| v.clamp(i64::MIN.into(), i64::MAX.into()) as i64;
        let positive: i64 = self.normal.iter().map(|n| n.max(&0) * size).sum();
        let negative: i64 = self.normal.iter().map(|n| n.min(&0) * size).sum();
        let at_least = saturate(-i128::from(positive) - base);
        let at_most = saturate(-i128::from(negative) - base);
        let [nx, ny, nz] = self.normal.map(|n| n * STEPS);
        let mut left = mask;
        while left != 0 {
            let bit = left.trailing_zeros();
            left &= left - 1;
            let (x, y, z) = (i64::from(bit & 3), i64::from(bit >> 2 & 3), i64::from(bit >> 4));
            let value = nx * x + ny * y + nz * z;
            if value < at_least || value > at_most {
                mask &= !(1 << bit);
            }
        }
        mask
    }

    /// Is the whole triangle inside voxel `cell` of the brick at `low` (both widened)?
    fn is_within(&self, low: [i64; 3], size: i64, cell: [usize; 3]) -> bool {
        (0..3).all(|k| {
            let start = low[k] + cell[k] as i64 * STEPS;
            start <= self.min[k] && start + size >= self.max[k]
        })
    }

    /// 2D test of the 4x4 columns along axis `plane`: bit a + 4 b over the two kept coordinates.
    #[inline]
    fn columns(&self, plane: usize, low: [i64; 3], from: [usize; 3], to: [usize; 3]) -> u16 {
        let (a, b) = KEPT_AXES[plane];
        let span = |k: usize| (1u16 << to[k]) - (1u16 << from[k]);
        let mut mask = (span(a) * 0x1111) & rows(span(b));
        for axis in &self.edge_axes[plane] {
            let [na, nb] = axis.normal;
            let base = na * low[a] + nb * low[b];
            // Bounds of the steps from the brick's low corner to a column's.
            let (at_least, at_most) = (axis.voxel_bounds.0 - base, axis.voxel_bounds.1 - base);
            let (step_a, step_b) = (na * STEPS, nb * STEPS);
            let least = 3 * (step_a.min(0) + step_b.min(0));
            let most = 3 * (step_a.max(0) + step_b.max(0));
            if at_least > most || at_most < least {
                return 0;
            }
            if at_least <= least && at_most >= most {
                continue;
            }
            mask &= if most - least <= i64::from(i32::MAX) {
                // Steps fit in 32 bits, so that bounds may saturate there: four columns at a time.
                let narrow = |v: i64| v.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
                columns_between(step_a as i32, step_b as i32, narrow(at_least), narrow(at_most))
            } else {
                columns_between_wide(step_a, step_b, at_least, at_most)
            };
            if mask == 0 {
                return 0;
            }
        }
        mask
    }

    /// Signed value of the triangle's plane at a point in steps, exact.
    fn plane_at(&self, point: [i64; 3]) -> i128 {
        (0..3).map(|k| i128::from(self.normal[k]) * i128::from(point[k] - self.first[k])).sum()
    }
}

/// Columns (i, j) with `at_least <= i step_a + j step_b <= at_most`: bit i + 4 j. Four lanes a row.
#[inline]
fn columns_between(step_a: i32, step_b: i32, at_least: i32, at_most: i32) -> u16 {
    let (low, high, down) = (i32x4::splat(at_least), i32x4::splat(at_most), i32x4::splat(step_b));
    let mut row = i32x4::new([0, step_a, 2 * step_a, 3 * step_a]);
    let mut outside = 0;
    for j in 0..4 {
        outside |= (row.simd_lt(low) | row.simd_gt(high)).to_bitmask() << (4 * j);
        // The fourth addition may wrap; its result is not used.
        row += down;
    }
    !(outside as u16)
}

/// The same for triangles longer than about 2,700 voxels; the oracle of the fast one.
fn columns_between_wide(step_a: i64, step_b: i64, at_least: i64, at_most: i64) -> u16 {
    let inside = |bit: &i64| {
        let value = (bit & 3) * step_a + (bit >> 2) * step_b;
        value >= at_least && value <= at_most
    };
    (0..16).filter(inside).fold(0, |mask, bit| mask | 1 << bit)
}

/// Row bits to whole rows of four columns.
#[inline]
fn rows(bits: u16) -> u16 {
    // Bits 0, 1, 2, 3 to bits 0, 4, 8, 12.
    let spread = (bits & 1) | (bits & 2) << 3 | (bits & 4) << 6 | (bits & 8) << 9;
    spread * 0xf
}

/// Columns along z (bit x + 4 y) to voxels.
fn spread_xy(mask: u16) -> u64 {
    u64::from(mask) * 0x0001_0001_0001_0001
}

/// Columns along y (bit x + 4 z) to voxels.
fn spread_xz(mask: u16) -> u64 {
    let m = u64::from(mask);
    let rows = (m & 0xf) | (m & 0xf0) << 12 | (m & 0xf00) << 24 | (m & 0xf000) << 36;
    rows * 0x1111
}

/// Columns along x (bit y + 4 z) to voxels.
fn spread_yz(mask: u16) -> u64 {
    let mut m = u64::from(mask);
    m = (m | m << 24) & 0x0000_00ff_0000_00ff;
    m = (m | m << 12) & 0x000f_000f_000f_000f;
    m = (m | m << 6) & 0x0303_0303_0303_0303;
    m = (m | m << 3) & 0x1111_1111_1111_1111;
    m * 0xf
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All 13 axes, straight from the definition, in i128: the oracle.
    fn overlaps_by_definition(v: [[i32; 3]; 3], low: [i64; 3], high: [i64; 3]) -> bool {
        let v = v.map(|p| p.map(i128::from));
        let sub = |a: [i128; 3], b: [i128; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        let cross = |a: [i128; 3], b: [i128; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let edges = [sub(v[1], v[0]), sub(v[2], v[1]), sub(v[0], v[2])];
        let units = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
        let mut axes = vec![cross(edges[0], edges[1])];
        axes.extend(units);
        axes.extend(edges.iter().flat_map(|&e| units.map(|u| cross(e, u))));
        axes.iter().all(|axis| {
            let dot = |p: [i128; 3]| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
            let triangle = v.map(dot);
            let corners: Vec<i128> = (0..8)
                .map(|c| dot([0, 1, 2].map(|k| i128::from(if c >> k & 1 == 1 { high[k] } else { low[k] }))))
                .collect();
            let (t_low, t_high) = (triangle.iter().min(), triangle.iter().max());
            t_low <= corners.iter().max() && t_high >= corners.iter().min()
        })
    }

    fn random_triangle(random: &mut oorandom::Rand64, corner: [i32; 3]) -> [[i32; 3]; 3] {
        // From below a voxel to far across the grid; every fourth is degenerate or lies in a voxel plane.
        let reach = 1i64 << random.rand_range(4..26);
        let near = |random: &mut oorandom::Rand64, c: i32| {
            let span = random.rand_range(0..2 * reach as u64) as i64 - reach;
            (i64::from(c) * STEPS + 512 + span).clamp(0, 1 << 25) as i32
        };
        let mut v = [[0; 3]; 3].map(|_: [i32; 3]| corner.map(|c| near(random, c)));
        match random.rand_range(0..12) {
            0 => v[1] = v[0],
            1 => v = [v[0]; 3],
            2 => v.iter_mut().for_each(|p| p[1] = corner[1] * 256 + 256),
            3 => v.iter_mut().for_each(|p| *p = p.map(|c| c & !255)),
            4 => v[2] = [0, 1, 2].map(|k| (v[0][k] + v[1][k]) / 2),
            _ => {}
        }
        v
    }

    #[test]
    fn columns_in_32_bits_agree_with_those_in_64() {
        let mut random = oorandom::Rand64::new(3);
        for round in 0..200_000 {
            let reach = 1u64 << random.rand_range(1..28);
            let mut pick = || random.rand_range(0..2 * reach) as i32 - reach as i32;
            let (a, b, low, high) = (pick(), pick(), pick(), pick());
            let fast = columns_between(a, b, low, high);
            assert_eq!(
                fast,
                columns_between_wide(a.into(), b.into(), low.into(), high.into()),
                "seed 3, round {round}"
            );
        }
    }

    #[test]
    fn brick_masks_and_cells_agree_with_the_thirteen_axes_in_i128() {
        let mut random = oorandom::Rand64::new(7);
        let mut touched = 0u64;
        for round in 0..60_000 {
            let corner = [0; 3].map(|_| (random.rand_range(0..(1 << 15)) * 4) as i32);
            let vertices = random_triangle(&mut random, corner);
            let triangle = TriangleOverlap::new(vertices);
            let mask = triangle.brick_mask(corner);
            touched += u64::from(mask != 0);
            for bit in 0..64 {
                let voxel = [corner[0] + (bit & 3), corner[1] + (bit >> 2 & 3), corner[2] + (bit >> 4)];
                let low = voxel.map(|c| i64::from(c) * STEPS - WIDEN);
                let expected = overlaps_by_definition(vertices, low, low.map(|c| c + STEPS + 2 * WIDEN));
                assert_eq!(
                    mask >> bit & 1 == 1,
                    expected,
                    "seed 7, round {round}: {vertices:?} voxel {voxel:?}"
                );
            }
            for shift in [0, 2, 4, 8] {
                let cell = corner.map(|c| c >> shift << shift);
                let low = cell.map(|c| i64::from(c) * STEPS - WIDEN);
                let high = low.map(|c| c + (STEPS << shift) + 2 * WIDEN);
                let expected = overlaps_by_definition(vertices, low, high);
                assert_eq!(triangle.touches_cell(cell, shift), expected, "round {round}, cells of 2^{shift}");
                let (first, last) = triangle.cell_range(shift);
                let inside = (0..3).all(|k| (first[k]..=last[k]).contains(&(cell[k] >> shift)));
                assert!(inside || !expected, "round {round}: a touched cell lies outside the cell range");
            }
        }
        assert!(touched > 20_000, "too few triangles touch the brick to mean anything: {touched}");
    }
}

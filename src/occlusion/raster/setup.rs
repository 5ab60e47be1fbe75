//! Triangles of a part to edge functions and a plane of nearness, sixteen at a time.
//!
//! # Homogeneous edges
//!
//! With v = (X, Y, H) of a corner ([`crate::occlusion::view`]), the edge opposite to corner i is the function
//! E_i(column, row) = (v_j x v_k) . (column, row, 1), positive inside once multiplied by the sign of v_0 . (v_1 x v_2):
//! Olano and Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates", 1997. A point with all three
//! not negative is in front of the eye by itself, so that no triangle is ever clipped at a near plane. Two triangles
//! get their common edge with exactly opposite coefficients (as in [`crate::exact::intersect`]; no fused
//! multiply-add, whose rounding has sides), and points on an edge are inside: no pixel falls between them.
//!
//! Nearness is a plane over the image. Its coefficients come from differences of corners, which keep their
//! digits for triangles much smaller than a pixel.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16, f64x8};

use super::Screen;
use crate::occlusion::mesh::{LANES, TriangleBlock};
use crate::occlusion::view::{Homogeneous, LEAST_H, PartView};

/// Bound on the rounding of an f32 edge function whose terms add up to at most 1, see [`Batch::edges`]: two roundings of
/// each coefficient, three of each product and sum, 2^-24 each, is below 2^-21; twice that.
pub(super) const DOUBT: f32 = 1.0 / (1 << 20) as f32;

/// Bound on the rounding of a plane of nearness in f32, as a part of the sum of its terms.
const NEARNESS_ERROR: f32 = 1.0 / (1 << 21) as f32;

/// A plane whose terms add up to more than so many times the nearness itself (parallel: than so many scenes) is evaluated in
/// f64: what rounding takes away stays below 2^-11 of nearness (parallel: below 2^-15 of the scene). Only triangles seen
/// almost along their plane come near that.
const STEEP: f32 = 1024.0;
const STEEP_PARALLEL: f32 = 64.0;

/// What is known of the triangles of a block. Lanes that are in no mask hold anything.
pub(super) struct Batch {
    /// First and last column and row whose pixels the triangle may cover.
    pub left: [f32; LANES],
    pub right: [f32; LANES],
    pub top: [f32; LANES],
    pub bottom: [f32; LANES],
    /// Edge functions from the first pixel on: per column, per row, at it (plus [`DOUBT`]). Scaled so that their terms
    /// add up to at most 1 within the bounds.
    pub edges: [[[f32; LANES]; 3]; 3],
    /// Nearness from the first pixel on: per column, per row, at it (less the bound of the rounding).
    pub nearness: [[f32; LANES]; 3],
    /// Edge functions of the image: per column, per row, at pixel (0, 0). They decide what f32 leaves in doubt.
    pub exact: [[[f64; LANES]; 3]; 3],
}

/// Lanes with a triangle, as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Found {
    /// All is in the batch.
    pub fast: u32,
    /// To be done one by one ([`super::careful`]): corners at the eye or behind it, or a steep plane.
    pub careful: u32,
}

impl Batch {
    pub fn new() -> Self {
        let lanes = [0.0; LANES];
        Batch {
            left: lanes,
            right: lanes,
            top: lanes,
            bottom: lanes,
            edges: [[lanes; 3]; 3],
            nearness: [lanes; 3],
            exact: [[[0.0; LANES]; 3]; 3],
        }
    }
}

/// One coordinate of eight triangles' corner, and of the other eight's.
type Halves<S> = [f64x8<S>; 2];

#[inline(always)]
fn narrow<S: Simd>([low, high]: Halves<S>) -> f32x16<S> {
    low.narrow(high)
}

#[inline(always)]
fn cross<S: Simd>(a: [f64x8<S>; 3], b: [f64x8<S>; 3]) -> [f64x8<S>; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn minus<S: Simd>(a: [f64x8<S>; 3], b: [f64x8<S>; 3]) -> [f64x8<S>; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A row of the view, of eight points and eight more.
#[inline(always)]
fn along<S: Simd>(point: &[Halves<S>; 3], m: &[f64; 4]) -> Halves<S> {
    let [x, y, z] = point;
    [x[0] * m[0] + y[0] * m[1] + z[0] * m[2] + m[3], x[1] * m[0] + y[1] * m[1] + z[1] * m[2] + m[3]]
}

#[inline(always)]
fn wide<S: Simd>(simd: S, values: &[f32; LANES]) -> Halves<S> {
    let (low, high) = f32x16::from_slice(simd, values).widen();
    [low, high]
}

/// One corner of all triangles: X, Y and the third coordinate.
#[inline(always)]
fn corner<S: Simd>(simd: S, part: &PartView, block: &TriangleBlock, k: usize) -> [Halves<S>; 3] {
    let point = [wide(simd, &block[3 * k]), wide(simd, &block[3 * k + 1]), wide(simd, &block[3 * k + 2])];
    [along(&point, &part.m[0]), along(&point, &part.m[1]), along(&point, &part.m[2])]
}

/// First and last pixel centre between three corners, from 0 to `last`, in f32: made wider by more than is rounded.
#[inline(always)]
fn bounds<S: Simd>(simd: S, [a, b, c]: [f32x16<S>; 3], last: f32) -> (f32x16<S>, f32x16<S>) {
    const WIDEN: f32 = 1.0 / (1 << 21) as f32;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let low = (low - low.abs() * WIDEN).ceil().max(f32x16::splat(simd, 0.0));
    let high = (high + high.abs() * WIDEN).floor().min(f32x16::splat(simd, last));
    (low, high)
}

/// The first or the second eight triangles' corner, over (X, Y, third).
#[inline(always)]
fn half_of<S: Simd>(corner: &[Halves<S>; 3], half: usize) -> [f64x8<S>; 3] {
    [corner[0][half], corner[1][half], corner[2][half]]
}

/// Sets up a block. Triangles that cover no pixel's centre are dropped, as far as that is seen at once.
///
/// No closures here: what is not inlined is not compiled for the instructions of `S`.
#[inline(always)]
pub(super) fn set_up<S: Simd, const PARALLEL: bool>(
    simd: S,
    part: &PartView,
    screen: Screen,
    block: &TriangleBlock,
    batch: &mut Batch,
) -> Found {
    let zero = f32x16::splat(simd, 0.0);
    let one = f32x16::splat(simd, 1.0);
    let corners = [corner(simd, part, block, 0), corner(simd, part, block, 1), corner(simd, part, block, 2)];

    let mut present = u32::from(u16::MAX);
    let mut careful = 0;
    let mut x = [narrow(corners[0][0]), narrow(corners[1][0]), narrow(corners[2][0])];
    let mut y = [narrow(corners[0][1]), narrow(corners[1][1]), narrow(corners[2][1])];
    let mut farthest_h = one;
    if !PARALLEL {
        let h = [narrow(corners[0][2]), narrow(corners[1][2]), narrow(corners[2][2])];
        let least = h[0].min(h[1]).min(h[2]);
        farthest_h = h[0].max(h[1]).max(h[2]);
        let in_front = least.simd_ge(f32x16::splat(simd, LEAST_H as f32)).to_bitmask() as u32;
        careful = !in_front & farthest_h.simd_gt(zero).to_bitmask() as u32;
        present = in_front;
        for k in 0..3 {
            let inverse = one / h[k];
            (x[k], y[k]) = (x[k] * inverse, y[k] * inverse);
        }
    }
    let (left, right) = bounds(simd, x, screen.last_column);
    let (top, bottom) = bounds(simd, y, screen.last_row);
    let (wide, tall) = (right - left, bottom - top);
    present &= wide.min(tall).simd_ge(zero).to_bitmask() as u32;
    if present == 0 {
        return Found { fast: 0, careful };
    }
    left.store_slice(&mut batch.left);
    right.store_slice(&mut batch.right);
    top.store_slice(&mut batch.top);
    bottom.store_slice(&mut batch.bottom);

    let (columns, rows) = (left.widen(), top.widen());
    let mut edges = [[[f64x8::splat(simd, 0.0); 2]; 3]; 3];
    let mut plane = [[f64x8::splat(simd, 0.0); 2]; 3];
    let mut solid = 0;
    for half in 0..2 {
        let one = f64x8::splat(simd, 1.0);
        let (column, row) = if half == 0 { (columns.0, rows.0) } else { (columns.1, rows.1) };
        // In parallel projection over (column, row, nearness), else over (X, Y, H).
        let c = [half_of(&corners[0], half), half_of(&corners[1], half), half_of(&corners[2], half)];
        let normal = cross(minus(c[1], c[0]), minus(c[2], c[0]));
        let determinant = if PARALLEL {
            normal[2]
        } else {
            c[0][0] * normal[0] + c[0][1] * normal[1] + c[0][2] * normal[2]
        };
        solid |= (determinant.abs().simd_gt(f64x8::splat(simd, 0.0)).to_bitmask() as u32) << (8 * half);
        let inverse = one / determinant;
        if PARALLEL {
            plane[0][half] = -(normal[0] * inverse);
            plane[1][half] = -(normal[1] * inverse);
            plane[2][half] = c[0][2] + plane[0][half] * (column - c[0][0]) + plane[1][half] * (row - c[0][1]);
        } else {
            plane[0][half] = normal[0] * inverse;
            plane[1][half] = normal[1] * inverse;
            plane[2][half] = (column * normal[0] + row * normal[1] + normal[2]) * inverse;
        }
        let sign = one.copysign(determinant);
        let mut v = c;
        if PARALLEL {
            (v[0][2], v[1][2], v[2][2]) = (one, one, one);
        }
        #[allow(clippy::needless_range_loop, reason = "edges of two arrays at once")]
        for i in 0..3 {
            let edge = cross(v[(i + 1) % 3], v[(i + 2) % 3]);
            for axis in 0..3 {
                edges[i][axis][half] = edge[axis] * sign;
                edges[i][axis][half].store_slice(&mut batch.exact[i][axis][8 * half..8 * half + 8]);
            }
            let [per_column, per_row, at_zero] = edges[i];
            edges[i][2][half] = column * per_column[half] + row * per_row[half] + at_zero[half];
        }
    }
    present &= solid;

    // To f32, every edge scaled so that its terms within the bounds add up to at most 1.
    let mut least_at_first = one;
    #[allow(clippy::needless_range_loop, reason = "edges of two arrays at once")]
    for i in 0..3 {
        let (per_column, per_row) = (narrow(edges[i][0]), narrow(edges[i][1]));
        let at_first = narrow(edges[i][2]);
        let terms = at_first.abs() + per_column.abs() * wide + per_row.abs() * tall;
        // More than nothing, for the pixel that lies on its own edge.
        let scale = one / (terms + f32x16::splat(simd, 1e-30));
        let at_first = at_first * scale + f32x16::splat(simd, DOUBT);
        (per_column * scale).store_slice(&mut batch.edges[i][0]);
        (per_row * scale).store_slice(&mut batch.edges[i][1]);
        at_first.store_slice(&mut batch.edges[i][2]);
        least_at_first = least_at_first.min(at_first);
    }
    // Many have one pixel within their bounds, and do not cover it.
    let single = wide.max(tall).simd_le(zero).to_bitmask() as u32;
    present &= !(single & least_at_first.simd_lt(zero).to_bitmask() as u32);

    let (per_column, per_row, at_first) = (narrow(plane[0]), narrow(plane[1]), narrow(plane[2]));
    let terms = at_first.abs() + per_column.abs() * wide + per_row.abs() * tall;
    let limit = f32x16::splat(simd, if PARALLEL { STEEP_PARALLEL } else { STEEP });
    let steep = !(terms * farthest_h).simd_le(limit).to_bitmask() as u32;
    per_column.store_slice(&mut batch.nearness[0]);
    per_row.store_slice(&mut batch.nearness[1]);
    (at_first - terms * NEARNESS_ERROR).store_slice(&mut batch.nearness[2]);
    Found { fast: present & !steep, careful: careful | (present & steep) }
}

/// One triangle in f64: what is decided by. The same operations as in [`set_up`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Exact {
    /// Edge functions: per column, per row, at pixel (0, 0).
    pub edges: [[f64; 3]; 3],
    /// Nearness, likewise.
    pub nearness: [f64; 3],
    /// Bounds on nearness: of the corners where all are in front of the eye.
    pub nearest: f64,
}

impl Exact {
    /// `None` for a triangle without area in the image.
    pub fn new(corners: [Homogeneous; 3], is_parallel: bool) -> Option<Self> {
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        let v = corners.map(|c| [c.x, c.y, c.h]);
        let c = if is_parallel { corners.map(|c| [c.x, c.y, c.a]) } else { v };
        let normal = cross(minus(c[1], c[0]), minus(c[2], c[0]));
        let determinant = if is_parallel {
            normal[2]
        } else {
            c[0][0] * normal[0] + c[0][1] * normal[1] + c[0][2] * normal[2]
        };
        if determinant.is_nan() || determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let nearness = if is_parallel {
            let (a, b) = (-(normal[0] * inverse), -(normal[1] * inverse));
            [a, b, c[0][2] - a * c[0][0] - b * c[0][1]]
        } else {
            normal.map(|n| n * inverse)
        };
        let sign = 1f64.copysign(determinant);
        let edge = |j: usize, k: usize| cross(v[j], v[k]).map(|e| e * sign);
        let all_in_front = corners.iter().all(|c| c.h >= LEAST_H);
        let nearest = corners.iter().map(|c| c.a / c.h).fold(f64::NEG_INFINITY, f64::max);
        Some(Exact {
            edges: [edge(1, 2), edge(2, 0), edge(0, 1)],
            nearness,
            nearest: if all_in_front { nearest } else { f64::INFINITY },
        })
    }

    /// Is the centre of the pixel inside, or on an edge?
    #[inline(always)]
    pub fn covers(&self, column: f64, row: f64) -> bool {
        self.edges.iter().all(|edge| linear(edge, column, row) >= 0.0)
    }

    /// Nearness at the centre of a pixel that it covers, an f32 that is not nearer.
    #[inline(always)]
    pub fn nearness_at(&self, column: f64, row: f64) -> f32 {
        let nearness = linear(&self.nearness, column, row).min(self.nearest);
        (nearness - nearness.abs() * (1.0 / (1u64 << 23) as f64)) as f32
    }
}

/// A function of the image, given by its rise per column, per row, and its value at pixel (0, 0).
#[inline(always)]
pub(super) fn linear(function: &[f64; 3], column: f64, row: f64) -> f64 {
    column * function[0] + row * function[1] + function[2]
}

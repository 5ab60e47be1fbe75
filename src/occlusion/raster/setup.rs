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

/// A plane whose terms add up to more than so many times the nearness itself is evaluated in f64: what rounding takes
/// away from nearness stays below 2^-15 of it (perspective), or of the scene (parallel).
const STEEP: f32 = 64.0;

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

/// Sets up a block. Triangles that cover no pixel's centre are dropped.
#[inline(always)]
pub(super) fn set_up<S: Simd, const PARALLEL: bool>(
    simd: S,
    part: &PartView,
    screen: Screen,
    block: &TriangleBlock,
    batch: &mut Batch,
) -> Found {
    let splat = |value: f32| f32x16::splat(simd, value);
    // Corners: x, y and the third coordinate.
    let corner = |k: usize| -> [Halves<S>; 3] {
        let wide = |row: usize| f32x16::from_slice(simd, &block[3 * k + row]).widen();
        let (x, y, z) = (wide(0), wide(1), wide(2));
        let along = |m: &[f64; 4]| -> Halves<S> {
            let low = x.0 * m[0] + y.0 * m[1] + z.0 * m[2] + m[3];
            let high = x.1 * m[0] + y.1 * m[1] + z.1 * m[2] + m[3];
            [low, high]
        };
        [along(&part.m[0]), along(&part.m[1]), along(&part.m[2])]
    };
    let corners = [corner(0), corner(1), corner(2)];

    // Bounds in pixels, in f32, made wider by more than they are rounded.
    let mut present = u32::from(u16::MAX);
    let mut careful = 0;
    let (mut x, mut y) = (corners.map(|c| narrow(c[0])), corners.map(|c| narrow(c[1])));
    let mut farthest_h = splat(1.0);
    if !PARALLEL {
        let h = corners.map(|c| narrow(c[2]));
        let least = h[0].min(h[1]).min(h[2]);
        farthest_h = h[0].max(h[1]).max(h[2]);
        let in_front = least.simd_ge(splat(LEAST_H as f32)).to_bitmask() as u32;
        careful = !in_front & farthest_h.simd_gt(splat(0.0)).to_bitmask() as u32;
        present = in_front;
        for k in 0..3 {
            let inverse = splat(1.0) / h[k];
            (x[k], y[k]) = (x[k] * inverse, y[k] * inverse);
        }
    }
    const WIDEN: f32 = 1.0 / (1 << 21) as f32;
    let bounds = |c: [f32x16<S>; 3], last: f32| {
        let (low, high) = (c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
        let low = (low - low.abs() * WIDEN).ceil().max(splat(0.0));
        let high = (high + high.abs() * WIDEN).floor().min(splat(last));
        (low, high)
    };
    let (left, right) = bounds(x, screen.last_column);
    let (top, bottom) = bounds(y, screen.last_row);
    let (wide, tall) = (right - left, bottom - top);
    present &= wide.min(tall).simd_ge(splat(0.0)).to_bitmask() as u32;
    if present == 0 {
        return Found { fast: 0, careful };
    }
    left.store_slice(&mut batch.left);
    right.store_slice(&mut batch.right);
    top.store_slice(&mut batch.top);
    bottom.store_slice(&mut batch.bottom);

    let (from_column, from_row) = (left.widen(), top.widen());
    let mut edges = [[[f64x8::splat(simd, 0.0); 2]; 3]; 3];
    let mut plane = [[f64x8::splat(simd, 0.0); 2]; 3];
    let mut solid = 0;
    for half in 0..2 {
        let one = f64x8::splat(simd, 1.0);
        let zero = f64x8::splat(simd, 0.0);
        let of = |k: usize| [corners[k][0][half], corners[k][1][half], corners[k][2][half]];
        let flat = |c: [f64x8<S>; 3]| if PARALLEL { [c[0], c[1], one] } else { c };
        let c = [of(0), of(1), of(2)];
        let v = c.map(flat);
        let (column, row) = if half == 0 { (from_column.0, from_row.0) } else { (from_column.1, from_row.1) };
        // In parallel projection over (column, row, nearness), else over (X, Y, H): the plane of the triangle.
        let normal = cross(minus(c[1], c[0]), minus(c[2], c[0]));
        let determinant = if PARALLEL {
            normal[2]
        } else {
            c[0][0] * normal[0] + c[0][1] * normal[1] + c[0][2] * normal[2]
        };
        solid |= (determinant.abs().simd_gt(zero).to_bitmask() as u32) << (8 * half);
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
        for (i, (j, k)) in [(1, 2), (2, 0), (0, 1)].into_iter().enumerate() {
            let edge = cross(v[j], v[k]);
            for axis in 0..3 {
                let value = edge[axis] * sign;
                value.store_slice(&mut batch.exact[i][axis][8 * half..8 * half + 8]);
                edges[i][axis][half] = value;
            }
            let [per_column, per_row, at_zero] = edges[i];
            edges[i][2][half] = column * per_column[half] + row * per_row[half] + at_zero[half];
        }
    }
    present &= solid;

    // To f32, every edge scaled so that its terms within the bounds add up to at most 1.
    for (i, edge) in edges.into_iter().enumerate() {
        let [per_column, per_row, at_first] = edge.map(narrow);
        let terms = at_first.abs() + per_column.abs() * wide + per_row.abs() * tall;
        // More than nothing, for the pixel that lies on its own edge.
        let scale = splat(1.0) / (terms + splat(1e-30));
        (per_column * scale).store_slice(&mut batch.edges[i][0]);
        (per_row * scale).store_slice(&mut batch.edges[i][1]);
        (at_first * scale + splat(DOUBT)).store_slice(&mut batch.edges[i][2]);
    }
    let [per_column, per_row, at_first] = plane.map(narrow);
    let terms = at_first.abs() + per_column.abs() * wide + per_row.abs() * tall;
    let steep = !(terms * farthest_h).simd_le(splat(STEEP)).to_bitmask() as u32;
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

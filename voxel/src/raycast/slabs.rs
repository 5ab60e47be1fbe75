//! SIMD tests of rays against the 64 children of a node, and of many rays against one cell, in f32.
//!
//! All coordinates here are *mirrored*: along the axes on which a ray falls, the tree is turned around, so that every
//! direction is positive or 0 and children in rising order of their bits come front to back (a child that a ray crosses
//! later never has a lower bit).
//!
//! # Error bound
//!
//! Origins lie within -T ..= 2T of a tree of T voxels a side. With u = 2^-24 and everything in voxels (t times the
//! direction): rounding the origin costs at most 2T u, its product with the reciprocal 2T u, the reciprocal itself and
//! its product with the plane T u each, their sum 3T u, the steps to the node's other planes 4T u: less than 16T u =
//! 2^-20 T voxels in all. So planes moved by that much ([`MARGIN`]) give a test that never misses (moved
//! apart) or one that is never wrong (moved together).

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16};

use super::ray::Walk;
use crate::bits::{spread_xy, spread_xz, spread_yz};

/// By how much of the tree's side planes are moved.
pub(super) const MARGIN: f64 = 1.0 / (1u64 << 20) as f64;

/// An f32 that is not above t.
#[inline(always)]
pub(super) fn rounded_down(t: f64) -> f32 {
    (t - t.abs() * (1.0 / (1u64 << 22) as f64)) as f32
}

/// An f32 that is not below t.
#[inline(always)]
pub(super) fn rounded_up(t: f64) -> f32 {
    (t + t.abs() * (1.0 / (1u64 << 22) as f64)) as f32
}

/// Positions of 4x4 columns: 0 1 2 3 0 1 2 3 ... and 0 0 0 0 1 1 1 1 ...
#[derive(Clone, Copy)]
pub(super) struct Columns<S: Simd> {
    fast: f32x16<S>,
    slow: f32x16<S>,
}

impl<S: Simd> Columns<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let fast = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0f32];
        let slow = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0f32];
        Columns { fast: f32x16::from_slice(simd, &fast), slow: f32x16::from_slice(simd, &slow) }
    }

    /// The instructions in use.
    #[inline(always)]
    pub fn witness(self) -> S {
        self.fast.token()
    }
}

/// A ray in mirrored f32 coordinates: it meets the plane at c at `c * inverse + shift`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RaySlabs {
    pub inverse: [f32; 3],
    /// Shift of planes moved towards the ray's start: entries that are never too late.
    pub early: [f32; 3],
    /// Shift of planes moved away from it: exits that are never too early.
    pub late: [f32; 3],
    pub t_min: f32,
    pub t_max: f32,
}

impl RaySlabs {
    #[inline(always)]
    pub fn new(walk: &Walk, tree_side: f64) -> Self {
        let margin = MARGIN * tree_side;
        let mut slabs = RaySlabs { t_max: rounded_up(walk.t_end), ..Default::default() };
        for k in 0..3 {
            let origin = if walk.rises(k) { walk.base[k] } else { tree_side - walk.base[k] };
            let inverse = walk.inverse[k].abs();
            slabs.inverse[k] = inverse as f32;
            slabs.early[k] = (-(origin + margin) * inverse) as f32;
            slabs.late[k] = (-(origin - margin) * inverse) as f32;
        }
        slabs
    }

    /// The children of `size` voxels, of the node at `corner`, that the ray may cross.
    #[inline(always)]
    pub fn children<S: Simd>(&self, columns: Columns<S>, corner: [f32; 3], size: f32) -> u64 {
        let simd = columns.witness();
        crossed(
            self.axis(columns.fast, 0, corner[0], size),
            self.axis(columns.slow, 1, corner[1], size),
            self.axis(columns.fast, 1, corner[1], size),
            self.axis(columns.slow, 2, corner[2], size),
            f32x16::splat(simd, self.t_min),
            f32x16::splat(simd, self.t_max),
        )
    }

    #[inline(always)]
    fn axis<S: Simd>(&self, pattern: f32x16<S>, k: usize, corner: f32, size: f32) -> Axis<S> {
        let simd = pattern.token();
        let step = f32x16::splat(simd, size * self.inverse[k]);
        let near = f32x16::splat(simd, corner * self.inverse[k] + self.early[k]);
        let far = f32x16::splat(simd, (corner + size) * self.inverse[k] + self.late[k]);
        Axis { near: pattern.mul_add(step, near), far: pattern.mul_add(step, far) }
    }
}

/// The rays of a tile together: bounds of their origins and reciprocals.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TileSlabs {
    /// Greatest origin, moved up.
    pub high: [f32; 3],
    /// Least origin, moved down.
    pub low: [f32; 3],
    pub least_inverse: [f32; 3],
    pub greatest_inverse: [f32; 3],
    pub t_min: f32,
    pub t_max: f32,
}

impl TileSlabs {
    /// The children of `size` voxels, of the node at `corner`, that a ray of the tile may cross.
    #[inline(always)]
    pub fn children<S: Simd>(&self, columns: Columns<S>, corner: [f32; 3], size: f32) -> u64 {
        let simd = columns.witness();
        crossed(
            self.axis(columns.fast, 0, corner[0], size),
            self.axis(columns.slow, 1, corner[1], size),
            self.axis(columns.fast, 1, corner[1], size),
            self.axis(columns.slow, 2, corner[2], size),
            f32x16::splat(simd, self.t_min),
            f32x16::splat(simd, self.t_max),
        )
    }

    #[inline(always)]
    fn axis<S: Simd>(&self, pattern: f32x16<S>, k: usize, corner: f32, size: f32) -> Axis<S> {
        let simd = pattern.token();
        let least = f32x16::splat(simd, self.least_inverse[k]);
        let greatest = f32x16::splat(simd, self.greatest_inverse[k]);
        let step = f32x16::splat(simd, size);
        let to_near = pattern.mul_add(step, f32x16::splat(simd, corner - self.high[k]));
        let to_far = pattern.mul_add(step, f32x16::splat(simd, corner + size - self.low[k]));
        Axis { near: (to_near * least).min(to_near * greatest), far: (to_far * least).max(to_far * greatest) }
    }
}

/// Entries and exits of the four layers of one axis, spread over 4x4 columns.
struct Axis<S: Simd> {
    near: f32x16<S>,
    far: f32x16<S>,
}

/// A cell is crossed when the latest entry is before the earliest exit: when that is so for each pair of axes. Pairs
/// are 4x4 columns, 16 lanes: 6 comparisons instead of 64 cells' maxima and minima.
#[inline(always)]
fn crossed<S: Simd>(
    x_fast: Axis<S>,
    y_slow: Axis<S>,
    y_fast: Axis<S>,
    z_slow: Axis<S>,
    t_min: f32x16<S>,
    t_max: f32x16<S>,
) -> u64 {
    // Every exit is compared with one of these, and every entry with one of those below.
    let x_near = x_fast.near.max(t_min);
    let y_near = y_slow.near.max(t_min);
    let x_far = x_fast.far.min(t_max);
    let y_far = y_slow.far.min(t_max);
    let xy = both(x_near, y_far, y_near, x_far);
    let xz = both(x_near, z_slow.far, z_slow.near, x_far);
    let yz = both(y_fast.near, z_slow.far, z_slow.near, y_fast.far);
    spread_xy(xy) & spread_xz(xz) & spread_yz(yz)
}

/// Lanes where a <= b and c <= d.
#[inline(always)]
fn both<S: Simd>(a: f32x16<S>, b: f32x16<S>, c: f32x16<S>, d: f32x16<S>) -> u16 {
    (a.simd_le(b) & c.simd_le(d)).to_bitmask() as u16
}

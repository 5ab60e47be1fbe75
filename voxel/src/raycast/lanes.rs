//! The rays of a packet side by side in f32, tested together against cells.
#![allow(clippy::needless_range_loop, reason = "lanes and axes of several arrays at once")]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16, f64x8};

use super::PACKET_RAYS;
use super::ray::{RayLanes, Walks};
use super::slabs::{MARGIN, RaySlabs, TileSlabs, rounded_down, rounded_up};
use crate::bits::SetBits;

/// Rays a SIMD register of f32, and of f64.
const F32_LANES: usize = 16;
const F64_LANES: usize = 8;

/// Rays of one octant, re-based at a common t and mirrored; see [`super::slabs`] for coordinates and error bounds.
///
/// A ray meets the plane at c at `c * inverse + shift`.
#[derive(Clone, Debug)]
pub(super) struct Lanes {
    inverse: [[f32; PACKET_RAYS]; 3],
    /// Of planes moved towards the ray's start, and away from it.
    early: [[f32; PACKET_RAYS]; 3],
    late: [[f32; PACKET_RAYS]; 3],
    t_min: [f32; PACKET_RAYS],
    t_max: [f32; PACKET_RAYS],
    /// Where the lanes' parameter begins, in that of the rays.
    t_start: f64,
    /// All of them together.
    pub tile: TileSlabs,
}

impl Lanes {
    /// Nothing yet.
    pub fn new() -> Self {
        let empty = [[0.0; PACKET_RAYS]; 3];
        Lanes {
            inverse: empty,
            early: empty,
            late: empty,
            t_min: empty[0],
            t_max: empty[0],
            t_start: 0.0,
            tile: TileSlabs::default(),
        }
    }

    /// Sets up `rays`, all of one octant. Returns those that do not fit into f32 beside the others.
    #[inline(always)]
    pub fn set_up<S: Simd>(
        &mut self,
        simd: S,
        walks: &Walks<PACKET_RAYS>,
        rays: u64,
        flip: u32,
        tree_side: f64,
    ) -> u64 {
        let mut t_start = f64::INFINITY;
        for i in SetBits(rays) {
            let t = walks.t_base[i as usize];
            t_start = if t < t_start { t } else { t_start };
        }
        self.t_start = t_start;
        let mut farthest = [0.0f64; PACKET_RAYS];
        for i in 0..PACKET_RAYS {
            let ahead = walks.t_base[i] - t_start;
            self.t_min[i] = rounded_down(ahead);
            self.t_max[i] = rounded_up(ahead + walks.t_end[i]);
        }
        for k in 0..3 {
            let sign = if flip >> k & 1 == 0 { 1.0 } else { -1.0 };
            let offset = if flip >> k & 1 == 0 { 0.0 } else { tree_side };
            for i in 0..PACKET_RAYS {
                let moved = (walks.t_base[i] - t_start) * walks.direction[k][i];
                farthest[i] = if moved.abs() > farthest[i] { moved.abs() } else { farthest[i] };
                // Origins, for the time being.
                self.early[k][i] = (offset + sign * (walks.base[k][i] - moved)) as f32;
                self.inverse[k][i] = walks.inverse[k][i].abs() as f32;
            }
        }
        let apart = rays & mask(simd, &farthest, |lanes| lanes.simd_gt(f64x8::splat(simd, tree_side)));
        let together = rays & !apart;
        if together == 0 {
            return apart;
        }
        // Lanes without a ray repeat one that is there: no test needs to know.
        let some = together.trailing_zeros() as usize;
        for i in SetBits(!together) {
            let i = i as usize;
            for k in 0..3 {
                self.early[k][i] = self.early[k][some];
                self.inverse[k][i] = self.inverse[k][some];
            }
            self.t_min[i] = self.t_min[some];
            self.t_max[i] = self.t_max[some];
        }
        let margin = (MARGIN * tree_side) as f32;
        for k in 0..3 {
            let origins = extremes(simd, &self.early[k]);
            self.tile.low[k] = origins.0 - margin;
            self.tile.high[k] = origins.1 + margin;
            (self.tile.least_inverse[k], self.tile.greatest_inverse[k]) = extremes(simd, &self.inverse[k]);
            for i in 0..PACKET_RAYS {
                let (origin, inverse) = (self.early[k][i], self.inverse[k][i]);
                self.early[k][i] = -(origin + margin) * inverse;
                self.late[k][i] = -(origin - margin) * inverse;
            }
        }
        self.tile.t_min = extremes(simd, &self.t_min).0;
        self.tile.t_max = extremes(simd, &self.t_max).1;
        apart
    }

    /// Where the lanes' parameter begins, in that of the rays.
    pub fn t_start(&self) -> f64 {
        self.t_start
    }

    /// Ends a ray at `t`, in the rays' own parameter, if that is before its end.
    #[inline(always)]
    pub fn shorten(&mut self, ray: usize, t: f64) {
        let end = rounded_up(t - self.t_start);
        if end < self.t_max[ray] {
            self.t_max[ray] = end;
        }
    }

    /// One of the rays, to go on alone.
    #[inline(always)]
    pub fn slabs(&self, ray: usize) -> RaySlabs {
        let (inverse, early, late) = (&self.inverse, &self.early, &self.late);
        RaySlabs {
            inverse: [inverse[0][ray], inverse[1][ray], inverse[2][ray]],
            early: [early[0][ray], early[1][ray], early[2][ray]],
            late: [late[0][ray], late[1][ray], late[2][ray]],
            t_min: self.t_min[ray],
            t_max: self.t_max[ray],
        }
    }

    /// Those of `rays` that may cross the cell of `size` voxels at a mirrored corner; with `SURE`, those that certainly
    /// do.
    #[inline(always)]
    pub fn crossing<S: Simd, const SURE: bool>(
        &self,
        simd: S,
        rays: u64,
        corner: [f32; 3],
        size: f32,
    ) -> u64 {
        // Planes moved apart, or together.
        let (near, far) = if SURE { (&self.late, &self.early) } else { (&self.early, &self.late) };
        let mut found = 0;
        for group in 0..PACKET_RAYS / F32_LANES {
            let start = group * F32_LANES;
            if rays >> start & 0xffff == 0 {
                continue;
            }
            let x = self.slab(simd, 0, &near[0], &far[0], start, corner[0], size);
            let y = self.slab(simd, 1, &near[1], &far[1], start, corner[1], size);
            let z = self.slab(simd, 2, &near[2], &far[2], start, corner[2], size);
            let (mut t_min, mut t_max) = (load(simd, &self.t_min, start), load(simd, &self.t_max, start));
            if SURE {
                const SLACK: f32 = 1.0 / (1 << 20) as f32;
                t_min *= f32x16::splat(simd, 1.0 + SLACK);
                t_max *= f32x16::splat(simd, 1.0 - SLACK);
            }
            let t_in = x.0.max(y.0).max(z.0.max(t_min));
            let t_out = x.1.min(y.1).min(z.1.min(t_max));
            let crossed = if SURE { t_in.simd_lt(t_out) } else { t_in.simd_le(t_out) };
            found |= crossed.to_bitmask() << start;
        }
        found & rays
    }

    /// Entries into and exits from a slab between two planes of axis k, for one register of rays.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "one slab of one register, all of it")]
    fn slab<S: Simd>(
        &self,
        simd: S,
        k: usize,
        near: &[f32; PACKET_RAYS],
        far: &[f32; PACKET_RAYS],
        start: usize,
        low: f32,
        size: f32,
    ) -> (f32x16<S>, f32x16<S>) {
        let inverse = load(simd, &self.inverse[k], start);
        let t_in = f32x16::splat(simd, low).mul_add(inverse, load(simd, near, start));
        let t_out = f32x16::splat(simd, low + size).mul_add(inverse, load(simd, far, start));
        (t_in, t_out)
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, lanes: &[f32; PACKET_RAYS], start: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &lanes[start..start + F32_LANES])
}

/// Least and greatest.
#[inline(always)]
fn extremes<S: Simd>(simd: S, lanes: &[f32; PACKET_RAYS]) -> (f32, f32) {
    let [a, b, c, d] =
        [load(simd, lanes, 0), load(simd, lanes, 16), load(simd, lanes, 32), load(simd, lanes, 48)];
    (a.min(b).min(c.min(d)).reduce_min(), a.max(b).max(c.max(d)).reduce_max())
}

/// Lanes for which a test holds.
#[inline(always)]
fn mask<S: Simd>(
    simd: S,
    lanes: &[f64; PACKET_RAYS],
    test: impl Fn(f64x8<S>) -> fearless_simd::mask64x8<S>,
) -> u64 {
    let mut found = 0;
    for group in 0..PACKET_RAYS / F64_LANES {
        let start = group * F64_LANES;
        found |= test(f64x8::from_slice(simd, &lanes[start..start + F64_LANES])).to_bitmask() << start;
    }
    found
}

/// Is any lane not a number? Least and greatest would mean nothing then.
#[inline(always)]
fn has_nan<S: Simd>(simd: S, lanes: &[f64; PACKET_RAYS]) -> bool {
    mask(simd, lanes, |x| x.simd_eq(x)) != u64::MAX
}

/// Least and greatest, of numbers.
#[inline(always)]
fn extremes_f64<S: Simd>(simd: S, lanes: &[f64; PACKET_RAYS]) -> (f64, f64) {
    let mut least = f64x8::from_slice(simd, &lanes[..F64_LANES]);
    let mut greatest = least;
    for group in 1..PACKET_RAYS / F64_LANES {
        let start = group * F64_LANES;
        let lanes = f64x8::from_slice(simd, &lanes[start..start + F64_LANES]);
        (least, greatest) = (least.min(lanes), greatest.max(lanes));
    }
    (least.reduce_min(), greatest.reduce_max())
}

impl RayLanes<PACKET_RAYS> {
    /// The octant of all rays and their common bounds, straight from what was given; `None` when they go to several
    /// octants, are too far off or too oddly scaled for f32, or not numbers.
    ///
    /// Rays from one eye keep one origin here, however far it is: these bounds are tighter than those of rays that
    /// were re-based one by one.
    #[inline(always)]
    pub fn tile<S: Simd>(&self, simd: S, tree_side: f64) -> Option<(u32, TileSlabs)> {
        const STEEP: f64 = 1.0 / (1u64 << 20) as f64;
        let mut tile = TileSlabs::default();
        let mut flip = 0;
        if has_nan(simd, &self.t_min) || has_nan(simd, &self.t_max) {
            return None;
        }
        for k in 0..3 {
            if has_nan(simd, &self.direction[k]) || has_nan(simd, &self.origin[k]) {
                return None;
            }
            let (least, greatest) = extremes_f64(simd, &self.direction[k]);
            let (low, high) = extremes_f64(simd, &self.origin[k]);
            let falls = greatest < 0.0;
            let (slow, fast) = if falls { (-greatest, -least) } else { (least, greatest) };
            let farthest = if high > -low { high } else { -low };
            if !(slow > STEEP && fast < 1.0 / STEEP && farthest <= 16.0 * tree_side) {
                return None;
            }
            // Twice as far, twice the error.
            let margin = MARGIN * if farthest > 2.0 * tree_side { farthest } else { 2.0 * tree_side };
            let (low, high) = if falls { (tree_side - high, tree_side - low) } else { (low, high) };
            tile.low[k] = (low - margin) as f32;
            tile.high[k] = (high + margin) as f32;
            tile.least_inverse[k] = (1.0 / fast) as f32;
            tile.greatest_inverse[k] = (1.0 / slow) as f32;
            flip |= u32::from(falls) << k;
        }
        tile.t_min = rounded_down(extremes_f64(simd, &self.t_min).0);
        tile.t_max = rounded_up(extremes_f64(simd, &self.t_max).1);
        Some((flip, tile))
    }
}

/// Which rays of a packet meet the grid, which of them with a parameter of their own, and which fall along each axis.
pub(super) struct Kinds {
    pub inside: u64,
    pub scaled: u64,
    falls: [u64; 3],
}

impl Kinds {
    #[inline(always)]
    pub fn new<S: Simd>(simd: S, walks: &Walks<PACKET_RAYS>, count: usize) -> Self {
        let present = if count == 0 { 0 } else { u64::MAX >> (PACKET_RAYS - count) };
        let zero = f64x8::splat(simd, 0.0);
        let one = f64x8::splat(simd, 1.0);
        let inside = present & mask(simd, &walks.t_end, |t| t.simd_ge(zero));
        Kinds {
            inside,
            scaled: inside & !mask(simd, &walks.scale, |s| s.simd_eq(one)),
            falls: [
                mask(simd, &walks.inverse[0], |i| i.simd_lt(zero)),
                mask(simd, &walks.inverse[1], |i| i.simd_lt(zero)),
                mask(simd, &walks.inverse[2], |i| i.simd_lt(zero)),
            ],
        }
    }

    /// The octant of a ray: axes along which it falls, x, y, z = 1, 2, 4.
    #[inline(always)]
    pub fn flip(&self, ray: u32) -> u32 {
        let falls = |k: usize| (self.falls[k] >> ray & 1) as u32;
        falls(0) | falls(1) << 1 | falls(2) << 2
    }

    /// Rays of that octant.
    #[inline(always)]
    pub fn of_octant(&self, flip: u32) -> u64 {
        let along = |k: usize| if flip >> k & 1 != 0 { self.falls[k] } else { !self.falls[k] };
        along(0) & along(1) & along(2)
    }
}

//! The triangle's plane, tested against 4x4x4 cells at a time.

use fearless_simd::{Simd, i32x16, i64x8, prelude::*};

use super::STEPS_LOG2;
use super::bits::per_axis;
use super::projection::steps_of;

/// Below this sum d of the normal's components (in magnitude), tests of 4x4x4 cells fit in 32 bits: a first value is
/// clamped to one past where its cells, 3 d apart at most, can reach the bounds, 1.01 d apart: 4.1 d in all.
const NARROW: i64 = 1 << 28;

/// The plane of a triangle within a window.
#[derive(Clone, Copy)]
pub(super) struct Plane<S: Simd> {
    /// Cross product of two edges, square steps.
    normal: [i64; 3],
    /// `normal . point` of the plane, widened by one step on both sides and in units of 256 steps, rounded inwards.
    low: i64,
    high: i64,
    /// Sums of the positive and of the negative components of the normal.
    positive: i64,
    negative: i64,
    steps: Steps<S>,
}

/// What a layer's cells add to the value of its first one.
#[derive(Clone, Copy)]
enum Steps<S: Simd> {
    /// The 16 cells of a layer, bit x + 4 y.
    Narrow(i32x16<S>),
    /// The first 8 cells of a layer.
    Wide(i64x8<S>),
}

/// Interval of a cell's value for cells of one size: `0 <= value + offset <= width`.
#[derive(Clone, Copy)]
pub(super) struct PlaneBounds {
    pub offset: i64,
    /// -1 when nothing lies between the bounds.
    width: i64,
}

impl<S: Simd> Plane<S> {
    /// The plane of the triangle with corners `v`, in steps from the low corner of a window of `width` voxels. That of a
    /// degenerate triangle overlaps everything.
    #[inline(always)]
    pub fn new(simd: S, v: &[[i32; 3]; 3], width: i32) -> Self {
        let v = per_axis(|i| per_axis(|k| i64::from(v[i][k])));
        let p = per_axis(|k| v[1][k] - v[0][k]);
        let q = per_axis(|k| v[2][k] - v[0][k]);
        let [x, y, z] = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        let positive = x.max(0) + y.max(0) + z.max(0);
        let negative = x.min(0) + y.min(0) + z.min(0);
        let product = |n: i64, k: usize| i128::from(n) * i128::from(v[0][k]);
        let at = product(x, 0) + product(y, 1) + product(z, 2);
        let widening = i128::from(positive - negative);
        // Past the values in the window no bound makes a difference.
        let width = i64::from(width);
        let clamp = |c: i128| c.clamp((negative * width - 1).into(), (positive * width + 1).into()) as i64;
        let low = clamp(-((widening - at) >> STEPS_LOG2));
        let high = clamp((at + widening) >> STEPS_LOG2);
        let steps = if positive - negative < NARROW {
            Steps::Narrow(steps_of(simd, x as i32, y as i32))
        } else {
            Steps::Wide(i64x8::simd_from(simd, [0, x, 2 * x, 3 * x, y, y + x, y + 2 * x, y + 3 * x]))
        };
        Plane { normal: [x, y, z], low, high, positive, negative, steps }
    }

    /// Bounds of the values of cells of `2^level` voxels that overlap the plane.
    #[inline(always)]
    pub fn touching(&self, level: u32) -> PlaneBounds {
        let low = -(-self.low >> level) - self.positive;
        let high = (self.high >> level) - self.negative;
        PlaneBounds { offset: -low, width: (high - low).max(-1) }
    }

    /// Value of the first cell within cell `at`, 0 to 3 an axis; `first_cell` is that of the first cell within (0, 0, 0),
    /// four times the value of (0, 0, 0) itself.
    #[inline(always)]
    pub fn descend(&self, first_cell: i64, at: [i32; 3]) -> i64 {
        let along = |k: usize| self.normal[k] * i64::from(at[k] << 2);
        first_cell + along(0) + along(1) + along(2)
    }

    /// Cells of the 4x4x4 that lie within the bounds: bit x + 4 y + 16 z. `offset_value` is the first one's value plus the
    /// bounds' offset.
    #[inline(always)]
    pub fn cells(&self, offset_value: i64, bounds: &PlaneBounds) -> u64 {
        let [_, y, z] = self.normal;
        // The two-sided test as one signed comparison, as in `EdgeBounds::between`.
        match &self.steps {
            Steps::Narrow(steps) => {
                let (least, most) = (-3 * self.positive - 1, bounds.width - 3 * self.negative + 1);
                let mut first = i32::MIN.wrapping_add(offset_value.clamp(least, most) as i32);
                let limit = i32::MIN + (bounds.width + 1) as i32;
                let z = z as i32;
                let mut mask = (*steps + first).simd_lt(limit).to_bitmask();
                first = first.wrapping_add(z);
                mask |= (*steps + first).simd_lt(limit).to_bitmask() << 16;
                first = first.wrapping_add(z);
                mask |= (*steps + first).simd_lt(limit).to_bitmask() << 32;
                first = first.wrapping_add(z);
                mask | (*steps + first).simd_lt(limit).to_bitmask() << 48
            }
            Steps::Wide(steps) => {
                let mut first = i64::MIN.wrapping_add(offset_value);
                let limit = i64::MIN + bounds.width + 1;
                let mut mask = 0;
                for layer in 0..4 {
                    let near = (*steps + first).simd_lt(limit).to_bitmask();
                    let far = (*steps + first.wrapping_add(2 * y)).simd_lt(limit).to_bitmask();
                    mask |= (near | far << 8) << (16 * layer);
                    first = first.wrapping_add(z);
                }
                mask
            }
        }
    }
}

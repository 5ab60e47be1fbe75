//! The triangle's plane, tested against 4x4x4 cells at a time.

use fearless_simd::{Simd, i32x16, i64x8, prelude::*};

use super::STEPS_LOG2;

/// Below this sum of the normal's components the values inside 4x4x4 cells fit in 32 bits.
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

/// Interval of a cell's value, both ends included, for cells of one size.
#[derive(Clone, Copy, Default)]
pub(super) struct PlaneBounds {
    low: i64,
    high: i64,
}

impl<S: Simd> Plane<S> {
    /// The plane of the triangle with corners `v`, in steps from the low corner of a window of `width` voxels. `None` when
    /// its normal is zero or along an axis: then the box tests say the same.
    #[inline(always)]
    pub fn new(simd: S, v: &[[i32; 3]; 3], width: i32) -> Option<Self> {
        let v = v.map(|p| p.map(i64::from));
        let p = [0, 1, 2].map(|k| v[1][k] - v[0][k]);
        let q = [0, 1, 2].map(|k| v[2][k] - v[0][k]);
        let normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        if normal.iter().filter(|&&n| n != 0).count() < 2 {
            return None;
        }
        let positive: i64 = normal.iter().map(|&n| n.max(0)).sum();
        let negative: i64 = normal.iter().map(|&n| n.min(0)).sum();
        let at: i128 = (0..3).map(|k| i128::from(normal[k]) * i128::from(v[0][k])).sum();
        let widening = i128::from(positive - negative);
        // Past the values in the window no bound makes a difference.
        let width = i64::from(width);
        let clamp =
            |c: i128| c.clamp((negative * width - 1).into(), (positive * width + 1).into()) as i64;
        let low = clamp(-((widening - at) >> STEPS_LOG2));
        let high = clamp((at + widening) >> STEPS_LOG2);
        let [x, y, _] = normal;
        let steps = if positive - negative < NARROW {
            let (x, y) = (x as i32, y as i32);
            let across = i32x16::simd_from(simd, [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]);
            let down = i32x16::simd_from(simd, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3]);
            Steps::Narrow(across * x + down * y)
        } else {
            Steps::Wide(i64x8::simd_from(simd, [0, x, 2 * x, 3 * x, y, y + x, y + 2 * x, y + 3 * x]))
        };
        Some(Plane { normal, low, high, positive, negative, steps })
    }

    /// Bounds of the values of cells of `2^level` voxels that overlap the plane.
    #[inline(always)]
    pub fn touching(&self, level: u32) -> PlaneBounds {
        PlaneBounds {
            low: -(-self.low >> level) - self.positive,
            high: (self.high >> level) - self.negative,
        }
    }

    /// Value of the first cell within cell `at`, 0 to 3 an axis, of the 4x4x4 whose first has `value`.
    #[inline(always)]
    pub fn descend(&self, value: i64, at: [i32; 3]) -> i64 {
        let [x, y, z] = at.map(i64::from);
        (value + self.normal[0] * x + self.normal[1] * y + self.normal[2] * z) << 2
    }

    /// Cells of the 4x4x4 whose first has `value` that lie within the bounds: bit x + 4 y + 16 z.
    #[inline(always)]
    pub fn cells(&self, value: i64, bounds: PlaneBounds) -> u64 {
        let (low, high) = (bounds.low - value, bounds.high - value);
        let [_, y, z] = self.normal;
        match &self.steps {
            Steps::Narrow(steps) => {
                // The cells add 3 negative ..= 3 positive, below 2^30 in magnitude: clamped to one past that, bounds
                // and differences stay below 2^31. As in `EdgeBounds::between`, one signed comparison tests both.
                let (least, most) = (3 * self.negative, 3 * self.positive);
                let low = low.clamp(least, most + 1) as i32;
                let high = high.clamp(least - 1, most) as i32;
                let limit = i32::MIN + (high - low + 1).max(0);
                let mut first = i32::MIN.wrapping_sub(low);
                let mut mask = 0;
                for layer in 0..4 {
                    mask |= (*steps + first).simd_lt(limit).to_bitmask() << (16 * layer);
                    first = first.wrapping_add(z as i32);
                }
                mask
            }
            Steps::Wide(steps) => {
                let (least, most) = (3 * self.negative, 3 * self.positive);
                let low = low.clamp(least, most + 1);
                let high = high.clamp(least - 1, most);
                let limit = i64::MIN + (high - low + 1).max(0);
                let mut first = i64::MIN.wrapping_sub(low);
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

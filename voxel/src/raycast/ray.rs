//! A ray of grid space, and its walk from plane to plane.

use glam::DVec3;

/// Direction components below this fraction of the largest are taken as 0: over the largest grid they move the ray by
/// less than 2^-40 voxel.
const NEGLIGIBLE: f64 = 1.0 / (1u64 << 60) as f64;

/// A ray of grid space: the points `origin + t direction` for `t` in `t_min ..= t_max`.
///
/// The direction may have any length but 0; `t` counts in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridRay {
    /// Any finite point, in voxels from the grid's low corner.
    pub origin: DVec3,
    /// Any finite vector; a zero vector hits nothing.
    pub direction: DVec3,
    /// Start; not negative in most uses, but may be.
    pub t_min: f64,
    /// End; infinity is fine.
    pub t_max: f64,
}

impl GridRay {
    /// From `origin` on without end.
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        GridRay { origin, direction, t_min: 0.0, t_max: f64::INFINITY }
    }

    /// Clips the ray to the grid of `side` voxels and re-bases it at its entry. `None` when it passes by.
    pub(super) fn enter(&self, side: f64) -> Option<Walk> {
        let largest = self.direction.abs().max_element();
        if !(largest > 0.0 && largest.is_finite() && self.origin.is_finite()) {
            return None;
        }
        // The power of two below the largest component, so that the division is exact: it becomes 1 to 2.
        let exponent = largest.to_bits() & f64::INFINITY.to_bits();
        let scale = f64::from_bits(exponent.max(1));
        let direction = (self.direction / scale).map(|d| if d.abs() < NEGLIGIBLE { 0.0 } else { d });
        let (mut t_in, mut t_out) = (self.t_min * scale, self.t_max * scale);
        if t_in.is_nan() || t_out.is_nan() {
            return None;
        }
        for k in 0..3 {
            if direction[k] == 0.0 {
                if !(0.0..=side).contains(&self.origin[k]) {
                    return None;
                }
                continue;
            }
            let (a, b) = (-self.origin[k] / direction[k], (side - self.origin[k]) / direction[k]);
            t_in = t_in.max(a.min(b));
            t_out = t_out.min(a.max(b));
        }
        if t_in > t_out {
            return None;
        }
        let t_base = t_in;
        let base = (self.origin + t_base * direction).clamp(DVec3::ZERO, DVec3::splat(side));
        let start = [0, 1, 2].map(|k| {
            // Not negative, so that truncation is the floor.
            let c = base[k] as i32;
            // On a plane and going down: the ray's first voxel is the one below.
            if f64::from(c) == base[k] && direction[k] < 0.0 { c - 1 } else { c }
        });
        let inverse = direction.map(|d| if d == 0.0 { 0.0 } else { d.recip() });
        Some(Walk { base, direction, inverse, start, t_start: 0.0, t_end: t_out - t_base, t_base, scale })
    }
}

/// A ray re-based at its entry into the grid; its parameter counts from there.
pub(super) struct Walk {
    base: DVec3,
    direction: DVec3,
    inverse: DVec3,
    pub start: [i32; 3],
    pub t_start: f64,
    pub t_end: f64,
    t_base: f64,
    scale: f64,
}

impl Walk {
    /// Parameter of the caller's ray.
    pub fn ray_t(&self, t: f64) -> f64 {
        (self.t_base + t) / self.scale
    }

    /// The axis and the parameter at which the ray leaves a cell of `size` voxels.
    #[inline(always)]
    pub fn exit(&self, low: [i32; 3], size: i32) -> (usize, f64) {
        let at = |k: usize| {
            if self.direction[k] == 0.0 {
                return f64::INFINITY;
            }
            let plane = if self.direction[k] > 0.0 { low[k] + size } else { low[k] };
            (f64::from(plane) - self.base[k]) * self.inverse[k]
        };
        let (x, y, z) = (at(0), at(1), at(2));
        if x <= y && x <= z {
            (0, x)
        } else if y <= z {
            (1, y)
        } else {
            (2, z)
        }
    }

    /// The voxel entered at `t` when leaving the cell (low, size) across its plane along `axis`, coming from `before`.
    #[inline(always)]
    pub fn voxel_after(&self, t: f64, axis: usize, before: [i32; 3], low: [i32; 3], size: i32) -> [i32; 3] {
        let mut voxel = [0; 3];
        for k in 0..3 {
            let rises = self.direction[k] > 0.0;
            voxel[k] = if k == axis {
                if rises { low[k] + size } else { low[k] - 1 }
            } else {
                // Within the cell that it leaves, and never back: rounding moves it by far less than 2^-10 voxel.
                // Truncation is the floor here: what is below 0 is clamped anyway.
                let c = (self.base[k] + t * self.direction[k]) as i32;
                if rises { c.clamp(before[k], low[k] + size - 1) } else { c.clamp(low[k], before[k]) }
            };
        }
        voxel
    }
}

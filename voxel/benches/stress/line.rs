//! A ray with its direction scaled to a length that f64 likes, by a power of two, which is exact.

use glam::DVec3;
use voxsight_voxel::raycast::GridRay;

/// The largest component of the direction is in 1 .. 2; t counts in it.
pub struct Line {
    pub origin: DVec3,
    pub direction: DVec3,
    pub t_min: f64,
    pub t_max: f64,
    exponent: i32,
}

impl Line {
    /// `None` for a ray without a direction, which meets nothing.
    pub fn new(ray: &GridRay) -> Option<Self> {
        let largest = ray.direction.abs().max_element();
        let exponent = if largest > 0.0 { exponent(largest) } else { return None };
        Some(Line {
            origin: ray.origin,
            direction: DVec3::from_array(ray.direction.to_array().map(|d| scaled(d, -exponent))),
            t_min: scaled(ray.t_min, exponent),
            t_max: scaled(ray.t_max, exponent),
            exponent,
        })
    }

    /// The line's parameter, of the ray's.
    pub fn parameter(&self, t: f64) -> f64 {
        scaled(t, self.exponent)
    }

    /// The ray's parameter, of the line's.
    fn ray_parameter(&self, t: f64) -> f64 {
        scaled(t, -self.exponent)
    }

    /// The largest |t|, in the ray's parameter, at which the ray is in a grid of `side` voxels: t is computed from its entry there, so
    /// that this is what its rounding goes with.
    pub fn reach(&self, side: f64) -> f64 {
        let inside = self.inside(DVec3::ZERO, DVec3::splat(side));
        inside.map_or(0.0, |(t_in, t_out)| self.ray_parameter(t_in.abs().max(t_out.abs())))
    }

    /// The interval of t in which the line is inside a box, faces included.
    pub fn inside(&self, low: DVec3, high: DVec3) -> Option<(f64, f64)> {
        let (mut t_in, mut t_out) = (self.t_min, self.t_max);
        for k in 0..3 {
            let (o, d) = (self.origin[k], self.direction[k]);
            if d == 0.0 {
                if o < low[k] || o > high[k] {
                    return None;
                }
            } else {
                let (a, b) = ((low[k] - o) / d, (high[k] - o) / d);
                t_in = t_in.max(a.min(b));
                t_out = t_out.min(a.max(b));
            }
        }
        (t_in <= t_out).then_some((t_in, t_out))
    }
}

/// e of 2^e <= x < 2^(e + 1); x positive.
fn exponent(x: f64) -> i32 {
    match (x.to_bits() >> 52 & 0x7ff) as i32 {
        0 => exponent(x * power(54)) - 54,
        biased => biased - 1023,
    }
}

/// x 2^n, n in -2000 ..= 2000.
pub fn scaled(x: f64, n: i32) -> f64 {
    // In two steps: the power alone may be too large.
    x * power(n / 2) * power(n - n / 2)
}

/// 2^n, n in -1022 ..= 1023.
pub fn power(n: i32) -> f64 {
    f64::from_bits(((1023 + n) as u64) << 52)
}

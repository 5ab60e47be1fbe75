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
    pub fn new(ray: &GridRay) -> Self {
        let exponent = exponent(ray.direction.abs().max_element());
        Line {
            origin: ray.origin,
            direction: DVec3::from_array(ray.direction.to_array().map(|d| scaled(d, -exponent))),
            t_min: scaled(ray.t_min, exponent),
            t_max: scaled(ray.t_max, exponent),
            exponent,
        }
    }

    /// The line's parameter, of the ray's.
    pub fn parameter(&self, t: f64) -> f64 {
        scaled(t, self.exponent)
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

//! The exact oracle: a ray of few bits against a voxel, in whole numbers.
//!
//! Lengths count in a *unit* of 2^(E + KNOWN) voxel, 2^E being above all coordinates, so that coordinates keep 50 bits and f64 knows
//! the ray to 1 unit. The direction D is in whole numbers of up to 24 bits, t counts in them. Every plane is
//! met at a fraction N/D, N below 2^73 and D below 2^24, so that no product below exceeds 2^126.

use voxsight_voxel::raycast::GridRay;

use super::oracles::{KNOWN, Oracle};

/// Bits of the direction's components.
const DIRECTION_BITS: u32 = 24;
/// Bits after the point of the ray's ends.
const END_BITS: i32 = 12;
/// Components below this fraction of the largest (2^n) are taken as 0: over the whole ray they move it by less than
/// 2^-50 voxel.
const NOTHING: i32 = -100;

/// numerator / denominator, denominator positive.
#[derive(Clone, Copy)]
struct Fraction(i128, i128);

impl Fraction {
    fn is_below(self, other: Fraction) -> bool {
        self.0 * other.1 < other.0 * self.1
    }
    fn max(self, other: Fraction) -> Fraction {
        if self.is_below(other) { other } else { self }
    }
    fn min(self, other: Fraction) -> Fraction {
        if other.is_below(self) { other } else { self }
    }
    fn value(self) -> f64 {
        self.0 as f64 / self.1 as f64
    }
}

/// A ray in whole numbers.
pub struct ExactLine {
    origin: [i128; 3],
    direction: [i128; 3],
    t_min: Fraction,
    t_max: Fraction,
    /// Units a voxel.
    voxel: i128,
    /// Of the direction, 2^-10; rounded down.
    length: i128,
    /// Its parameter is that of the ray times 2^this.
    exponent: i32,
}

impl ExactLine {
    /// `None` where the ray has too many bits.
    pub fn new(ray: &GridRay, side: f64) -> Option<Self> {
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let reach = origin.iter().fold(side, |reach, c| reach.max(c.abs()));
        let unit = Binary::new(reach).exponent_above() + KNOWN;
        let whole = |x: f64| Binary::new(x).shifted(-unit).whole(52);

        let parts = direction.map(Binary::new);
        let largest = parts.iter().filter(|part| part.mantissa != 0).map(Binary::exponent_above).max()?;
        let counts = |part: &&Binary| part.mantissa != 0 && part.exponent_above() > largest + NOTHING;
        let exponent = parts.iter().filter(counts).map(|part| part.exponent).min()?;
        let component = |part: Binary| {
            if counts(&&part) { part.shifted(-exponent).whole(DIRECTION_BITS) } else { Some(0) }
        };
        let direction = [component(parts[0])?, component(parts[1])?, component(parts[2])?];
        let end = |t: f64| Binary::new(t).shifted(exponent - unit).fraction();
        let squared: i128 = direction.iter().map(|d| d * d).sum();
        Some(ExactLine {
            origin: [whole(origin[0])?, whole(origin[1])?, whole(origin[2])?],
            direction,
            t_min: end(ray.t_min)?,
            t_max: end(ray.t_max)?,
            voxel: 1 << -unit,
            length: (squared << 20).isqrt(),
            exponent: exponent - unit,
        })
    }

    /// The interval of t inside the voxel without a margin of that many units. Where the ray stays in a plane, whether
    /// the faces count is decided by `closed`.
    fn inside(&self, voxel: [i32; 3], margin: i128, closed: bool) -> Option<(Fraction, Fraction)> {
        let (mut t_in, mut t_out) = (self.t_min, self.t_max);
        for (k, &cell) in voxel.iter().enumerate() {
            let low = i128::from(cell) * self.voxel + margin - self.origin[k];
            let high = i128::from(cell + 1) * self.voxel - margin - self.origin[k];
            let d = self.direction[k];
            if d == 0 {
                let within = if closed { low <= 0 && 0 <= high } else { low < 0 && 0 < high };
                if !within {
                    return None;
                }
            } else {
                let (near, far) = if d > 0 { (low, high) } else { (-high, -low) };
                t_in = t_in.max(Fraction(near, d.abs()));
                t_out = t_out.min(Fraction(far, d.abs()));
            }
        }
        (!t_out.is_below(t_in)).then_some((t_in, t_out))
    }

    /// Where the ray enters, if it stays inside for more than 2^-10 voxel.
    fn long(&self, voxel: [i32; 3], margin: i128) -> Option<f64> {
        let (t_in, t_out) = self.inside(voxel, margin, false)?;
        let stay = t_out.0 * t_in.1 - t_in.0 * t_out.1;
        // Both sides in units / 2^10.
        (stay * self.length > self.voxel * (t_in.1 * t_out.1)).then_some(t_in.value())
    }
}

impl Oracle for ExactLine {
    fn parameter(&self, t: f64) -> f64 {
        super::line::scaled(t, self.exponent)
    }

    fn must_meet(&self, voxel: [i32; 3]) -> Option<f64> {
        self.long(voxel, 1)
    }

    fn must_meet_any_depth(&self, voxel: [i32; 3]) -> bool {
        self.long(voxel, 0).is_some()
    }

    fn may_meet(&self, voxel: [i32; 3]) -> Option<(f64, f64)> {
        let (t_in, t_out) = self.inside(voxel, -(self.voxel >> 10), true)?;
        Some((t_in.value(), t_out.value()))
    }
}

/// mantissa 2^exponent, mantissa odd or 0.
#[derive(Clone, Copy)]
struct Binary {
    mantissa: i64,
    exponent: i32,
    infinite: bool,
}

impl Binary {
    fn new(x: f64) -> Self {
        let bits = x.to_bits();
        let biased = (bits >> 52 & 0x7ff) as i32;
        let fraction = (bits & ((1 << 52) - 1)) as i64;
        let (mantissa, exponent) =
            if biased == 0 { (fraction, -1074) } else { (fraction | 1 << 52, biased - 1075) };
        let zeros = if mantissa == 0 { 0 } else { mantissa.trailing_zeros() };
        let mantissa = (mantissa >> zeros) * if x < 0.0 { -1 } else { 1 };
        Binary { mantissa, exponent: exponent + zeros as i32, infinite: x.is_infinite() }
    }

    /// n of 2^(n - 1) <= |x| < 2^n.
    fn exponent_above(&self) -> i32 {
        self.exponent + (64 - self.mantissa.unsigned_abs().leading_zeros()) as i32
    }

    /// Times a power of two.
    fn shifted(self, n: i32) -> Self {
        Binary { exponent: self.exponent + n, ..self }
    }

    /// As a whole number of at most that many bits.
    fn whole(self, bits: u32) -> Option<i128> {
        if self.mantissa == 0 {
            return Some(0);
        }
        (self.exponent >= 0 && self.exponent_above() <= bits as i32)
            .then(|| i128::from(self.mantissa) << self.exponent)
    }

    /// As an end of a ray: beyond 2^56 units there is nothing.
    fn fraction(self) -> Option<Fraction> {
        if self.mantissa == 0 {
            return Some(Fraction(0, 1));
        }
        if self.infinite || self.exponent_above() > 56 {
            return Some(Fraction(i128::from(self.mantissa.signum()) << 56, 1));
        }
        if self.exponent >= 0 {
            return Some(Fraction(i128::from(self.mantissa) << self.exponent, 1));
        }
        (self.exponent >= -END_BITS).then(|| Fraction(i128::from(self.mantissa), 1 << -self.exponent))
    }
}

//! What a ray must meet and may meet: exactly on small grids, in f64 on large ones; and how answers are judged.
//!
//! A voxel *must* be met when the ray is inside it, deeper than f64 can resolve the ray ([`KNOWN`] of the distance of
//! its origin), for more than 2^-10 voxel of its length. It *may* be met when the ray passes within 2^-10 voxel.

use super::line::{Line, power};
use glam::DVec3;

/// The part of a ray's largest coordinate to which f64 knows where the ray is: some roundings of 2^-53 each.
pub const KNOWN: i32 = -49;

/// Either oracle, for one ray. t is its own, see [`Oracle::parameter`].
pub trait Oracle {
    /// Its parameter, of the ray's.
    fn parameter(&self, t: f64) -> f64;

    /// Where the ray enters a voxel that it must meet.
    fn must_meet(&self, voxel: [i32; 3]) -> Option<f64>;

    /// Like [`Oracle::must_meet`] for any depth, however small; false where the oracle cannot know.
    fn must_meet_any_depth(&self, voxel: [i32; 3]) -> bool;

    /// Where the ray is within 2^-10 of the voxel: an interval of t.
    fn may_meet(&self, voxel: [i32; 3]) -> Option<(f64, f64)>;
}

/// By slab tests in f64.
pub struct FloatOracle<'a> {
    line: &'a Line,
    /// To which depth f64 knows the ray, voxels.
    known: f64,
    length: f64,
}

impl<'a> FloatOracle<'a> {
    pub fn new(line: &'a Line, side: f64) -> Self {
        let known = line.origin.abs().max_element().max(side) * power(KNOWN);
        FloatOracle { line, known, length: line.direction.length() }
    }

    /// The ray's interval in the voxel without a margin of that many voxels.
    fn inside(&self, voxel: [i32; 3], margin: f64) -> Option<(f64, f64)> {
        let low = DVec3::from_array(voxel.map(f64::from));
        self.line.inside(low + margin, low + (1.0 - margin))
    }
}

impl Oracle for FloatOracle<'_> {
    fn parameter(&self, t: f64) -> f64 {
        self.line.parameter(t)
    }

    fn must_meet(&self, voxel: [i32; 3]) -> Option<f64> {
        let (t_in, t_out) = self.inside(voxel, self.known)?;
        ((t_out - t_in) * self.length > power(-10) + self.known).then_some(t_in)
    }

    fn must_meet_any_depth(&self, _: [i32; 3]) -> bool {
        false
    }

    fn may_meet(&self, voxel: [i32; 3]) -> Option<(f64, f64)> {
        self.inside(voxel, -power(-10))
    }
}

/// What is wrong with the voxels that a ray met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verdict {
    /// Voxels that it had to meet and did not.
    pub missed: u64,
    /// Voxels that it could not meet, or not at that t; and first hits behind a voxel that it had to meet.
    pub wrong: u64,
    /// Voxels that it crosses for more than 2^-10 voxel, but not as deep as f64 knows the ray, and did not meet: counted
    /// by the exact oracle only.
    pub grazed: u64,
}

/// Judges what the ray met, in order, against the voxels near it. `reach`: see [`super::line::Line::reach`].
pub fn judge(oracle: &impl Oracle, nearby: &[[i32; 3]], met: &[([i32; 3], f64)], reach: f64) -> Verdict {
    let rounding = power(-45) * oracle.parameter(reach);
    let mut verdict = Verdict::default();
    let mut first_due = f64::INFINITY;
    let mut found: Vec<[i32; 3]> = met.iter().map(|hit| hit.0).collect();
    found.sort_unstable();
    for voxel in nearby {
        let is_found = found.binary_search(voxel).is_ok();
        if let Some(t) = oracle.must_meet(*voxel) {
            first_due = first_due.min(t);
            verdict.missed += u64::from(!is_found);
        } else if !is_found {
            verdict.grazed += u64::from(oracle.must_meet_any_depth(*voxel));
        }
    }
    for (i, (voxel, t)) in met.iter().enumerate() {
        let Some((t_in, t_out)) = oracle.may_meet(*voxel) else {
            verdict.wrong += 1;
            continue;
        };
        // Where a direction is tiny, its parameter is beyond f64.
        let t = oracle.parameter(*t);
        let misplaced = t.is_finite() && (t < t_in - rounding || t > t_out + rounding);
        let late = i == 0 && t_in - rounding > first_due;
        verdict.wrong += u64::from(misplaced || late);
    }
    verdict
}

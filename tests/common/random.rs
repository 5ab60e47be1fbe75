//! Random numbers of tests, by a seed that they print.

use glam::DVec3;

/// Random numbers of a seed.
pub struct Random(oorandom::Rand64);

impl Random {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Random(oorandom::Rand64::new(seed.into()))
    }

    /// 0 to 1.
    pub fn unit(&mut self) -> f64 {
        self.0.rand_float()
    }

    /// Each coordinate -1 to 1.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Below `end`.
    pub fn below(&mut self, end: u32) -> u32 {
        self.0.rand_range(0..u64::from(end)) as u32
    }
}

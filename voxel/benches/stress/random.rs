//! Random numbers for one group of rays.

/// A stream that is a function of the seed and the group alone.
pub struct Random(oorandom::Rand64);

impl Random {
    pub fn new(seed: u64, group: u64) -> Self {
        Random(oorandom::Rand64::new(u128::from(mixed(seed ^ mixed(group)))))
    }

    /// A whole number below n.
    pub fn below(&mut self, n: u64) -> u64 {
        self.0.rand_range(0..n)
    }

    /// Any 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0.rand_u64()
    }

    /// In 0 .. 1.
    pub fn unit(&mut self) -> f64 {
        self.0.rand_float()
    }

    /// A whole number in -n ..= n.
    pub fn around_0(&mut self, n: u64) -> f64 {
        self.below(2 * n + 1) as f64 - n as f64
    }

    /// True once in n times.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    pub fn axis(&mut self) -> usize {
        self.below(3) as usize
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.one_in(2) { 1.0 } else { -1.0 }
    }

    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len() as u64) as usize]
    }
}

/// Spreads the bits of x over the whole word (splitmix64).
pub fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

//! Pseudo-random numbers that are the same on every machine and for ever.
//!
//! [`Rng`] is for everything. The other two are kept where the bytes of encoded files follow from them: other numbers would
//! give other files for the same source and seed. *Not done*: a crate, as none promises its sequence across versions.

/// splitmix64 (Steele, Lea and Flood 2014): every seed is as good as any other.
#[derive(Debug, Clone)]
pub struct Rng(u64);

impl Rng {
    /// The sequence of that seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Rng(seed)
    }

    /// The seed whose sequence is the rest of this one.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.0
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }

    /// A number in [0, 1].
    pub fn unit(&mut self) -> f64 {
        self.bits() as f64 / 2f64.powi(64)
    }

    /// A number in [`low`, `high`].
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A whole number below `end`; 0 where `end` is 0. Small ones are more likely by `end` / 2^33.
    pub fn below(&mut self, end: u32) -> u32 {
        ((self.bits() >> 33) % u64::from(end.max(1))) as u32
    }

    /// As [`Rng::below`], for places in a slice of less than 2^32 items.
    pub fn index(&mut self, len: usize) -> usize {
        self.below(u32::try_from(len).unwrap_or(u32::MAX)) as usize
    }

    /// Random bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.below(256) as u8).collect()
    }
}

/// xorshift64* (Vigna 2016): what codebooks are seeded with.
#[derive(Debug, Clone)]
pub struct XorShift(u64);

impl XorShift {
    /// The sequence of that seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        XorShift(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The linear congruential generator of Knuth's MMIX: what photographs are registered with.
#[derive(Debug, Clone)]
pub struct Congruential(u64);

impl Congruential {
    /// The sequence of that seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Congruential(seed)
    }

    /// A whole number below `end`, which is below 2^31.
    pub fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (((self.0 >> 33) * end as u64) >> 31) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first number for the seed 0 is that of the reference implementation.
    #[test]
    fn sequences_never_change() {
        let mut rng = Rng::new(0);
        assert_eq!([rng.bits(), rng.bits()], [0xe220_a839_7b1d_cdaf, 0x6e78_9e6a_a1b9_65f4]);
        let mut rng = Rng::new(7);
        assert_eq!([rng.below(100), rng.below(100), rng.below(0)], [10, 87, 0]);
        let mut shift = XorShift::new(7);
        assert_eq!([shift.unit(), shift.unit()], [0.40281460385623424, 0.4058412559879635]);
        let mut mmix = Congruential::new(7);
        assert_eq!([mmix.below(1000), mmix.below(1000), mmix.below(1000)], [493, 955, 906]);
    }

    #[test]
    fn numbers_stay_in_their_ranges_and_fill_them() {
        let mut rng = Rng::new(3);
        let mut seen = [0u32; 7];
        (0..7000).for_each(|_| seen[rng.below(7) as usize] += 1);
        assert!(seen.iter().all(|&count| (850..1150).contains(&count)), "{seen:?}");
        assert!((0..1000).all(|_| (2.0..=3.0).contains(&rng.between(2.0, 3.0))));
        assert_eq!((rng.bytes(5).len(), rng.index(0)), (5, 0));
    }
}

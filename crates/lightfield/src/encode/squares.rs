//! Sums of squared errors.

/// Squared errors and how many values they are of.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Squares {
    pub(crate) sum: f64,
    pub(crate) count: u64,
}

impl Squares {
    /// Counts `count` values with this sum.
    pub(crate) fn add(&mut self, sum: f64, count: u64) {
        self.sum += sum;
        self.count += count;
    }

    /// Counts what another one has.
    pub(crate) fn join(&mut self, other: Squares) {
        self.add(other.sum, other.count);
    }

    /// PSNR in dB of values from 0 to 1.
    pub(crate) fn psnr(&self) -> f64 {
        10.0 * (self.count.max(1) as f64 / self.sum.max(f64::MIN_POSITIVE)).log10()
    }
}

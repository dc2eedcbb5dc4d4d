//! Settings in order of quality: strides from a guess, then bisection. It asks nothing of the figures but that they rise.

use std::ops::RangeInclusive;

use super::{Goal, Measured};

/// What the search found.
#[derive(Debug, Clone)]
pub struct Found<T> {
    /// The setting.
    pub index: u32,
    /// What it measures.
    pub measured: Measured,
    /// What it made.
    pub value: T,
    /// Whether it meets the goal; if not it is the candidate that comes nearest.
    pub met: bool,
    /// How many candidates were made.
    pub evaluations: u32,
}

/// Most candidates that one search makes: strides across 16 bits, bisection of as many, with room for the ends.
const MAX_EVALUATIONS: u32 = 26;

/// Finds the setting in `range` that answers `goal` best.
///
/// Quality and size are taken to rise with the index. The search starts at `guess` and strides away from it, wider each time,
/// until the answer is between two settings; then it goes by bisection in the index's logarithm until the bracket is narrower
/// than `relative_step` of the index. So a good guess costs few candidates, and a bad one a few more than bisection would.
/// Ends of the range are tried when the bracket has closed on them and they are still unknown.
///
/// # Errors
/// Whatever `evaluate` returns, at once.
pub fn search<T, E>(
    goal: Goal,
    range: RangeInclusive<u32>,
    guess: u32,
    relative_step: f64,
    mut evaluate: impl FnMut(u32) -> Result<(Measured, T), E>,
) -> Result<Found<T>, E> {
    let (start, end) = (*range.start(), *range.end().max(range.start()));
    let (mut low, mut high) = (i64::from(start) - 1, i64::from(end) + 1);
    let mut index = guess.clamp(start, end);
    let mut best: Option<Found<T>> = None;
    let mut evaluations = 0;
    let mut stride = Stride::first(index);
    loop {
        let (measured, value) = evaluate(index)?;
        evaluations += 1;
        let met = goal.is_met(&measured);
        if best.as_ref().is_none_or(|best| goal.prefers(&measured, &best.measured)) {
            best = Some(Found { index, measured, value, met, evaluations });
        }
        // Larger settings help a quality goal that is missed and a size goal that is met.
        if met == matches!(goal, Goal::Bpp(_)) {
            low = i64::from(index);
        } else {
            high = i64::from(index);
        }
        let narrow = (high - low) as f64 <= 1.0 + relative_step * high as f64 && low >= i64::from(start);
        let closed = high - low <= 1 || (narrow && high <= i64::from(end)) || evaluations >= MAX_EVALUATIONS;
        let strode = stride.next(low, high, start, end);
        match strode.or_else(|| next_index(low, high, start, end)).filter(|_| !closed) {
            Some(next) => index = next,
            None => break,
        }
    }
    // The loop evaluates at least once, so `best` is there; the retry keeps the signature free of panics.
    match best {
        Some(found) => Ok(Found { evaluations, ..found }),
        None => evaluate(start).map(|(measured, value)| Found {
            index: start,
            measured,
            value,
            met: goal.is_met(&measured),
            evaluations: 1,
        }),
    }
}

/// How far the next setting lies from the guess while all that were tried lie to one side of the answer.
struct Stride(i64);

impl Stride {
    /// A thirty-second of the guess.
    fn first(guess: u32) -> Self {
        Stride(i64::from(guess / 32).max(1))
    }

    /// The next setting towards the open side of the bracket; `None` where neither side is open, or the stride leaves the range.
    fn next(&mut self, low: i64, high: i64, start: u32, end: u32) -> Option<u32> {
        let (start, end) = (i64::from(start), i64::from(end));
        let index = match (low < start, high > end) {
            (true, false) => high - self.0,
            (false, true) => low + self.0,
            _ => return None,
        };
        self.0 *= 4;
        u32::try_from(index).ok().filter(|_| (start..=end).contains(&index))
    }
}

/// The geometric middle of the bracket; `None` where nothing lies between.
fn next_index(low: i64, high: i64, start: u32, end: u32) -> Option<u32> {
    if high - low <= 1 {
        return None;
    }
    if high > i64::from(end) && low >= i64::from(end) / 2 {
        return Some(end);
    }
    let floor = low.max(i64::from(start)).max(1) as f64;
    let middle = (floor * high as f64).sqrt().round() as i64;
    u32::try_from(middle.clamp(low + 1, high - 1)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(index: u32) -> Result<(Measured, u32), std::convert::Infallible> {
        let measured = Measured {
            psnr: 10.0 * f64::from(index).log10(),
            bpp: f64::from(index) / 100.0,
            worst_block_rms: 1000.0 / f64::from(index),
        };
        Ok((measured, index))
    }

    #[test]
    fn finds_the_smallest_index_that_meets_a_quality_goal() {
        for guess in [1, 50, 1000] {
            let found = search(Goal::Psnr(20.0), 1..=1000, guess, 0.0, linear).unwrap();
            assert_eq!((found.index, found.met), (100, true), "guess {guess}");
            let found = search(Goal::Tolerance(5.0), 1..=1000, guess, 0.0, linear).unwrap();
            assert_eq!((found.index, found.met), (200, true));
        }
    }

    #[test]
    fn finds_the_largest_index_within_a_size_goal() {
        for guess in [1, 50, 1000] {
            let found = search(Goal::Bpp(3.337), 1..=1000, guess, 0.0, linear).unwrap();
            assert_eq!((found.index, found.met), (333, true), "guess {guess}");
        }
    }

    #[test]
    fn goals_out_of_reach_end_at_the_nearest_end() {
        let found = search(Goal::Psnr(99.0), 1..=1000, 10, 0.0, linear).unwrap();
        assert_eq!((found.index, found.met), (1000, false));
        let found = search(Goal::Bpp(0.001), 3..=1000, 10, 0.0, linear).unwrap();
        assert_eq!((found.index, found.met), (3, false));
        let found = search(Goal::Psnr(1.0), 5..=5, 10, 0.0, linear).unwrap();
        assert_eq!(found.index, 5);
    }

    #[test]
    fn a_good_guess_saves_candidates() {
        let near = search(Goal::Psnr(20.0), 1..=1000, 103, 0.0, linear).unwrap();
        let far = search(Goal::Psnr(20.0), 1..=1000, 1000, 0.0, linear).unwrap();
        assert!(near.evaluations <= 7 && far.evaluations <= 14, "{} {}", near.evaluations, far.evaluations);
        assert_eq!((near.index, far.index), (100, 100));
    }

    #[test]
    fn a_bad_guess_in_a_wide_range_is_made_up_for() {
        for guess in [1, 65_535] {
            let found = search(Goal::Bpp(400.0), 1..=65_535, guess, 0.0, linear).unwrap();
            assert_eq!((found.index, found.met), (40_000, true), "guess {guess}");
        }
    }

    #[test]
    fn a_relative_step_saves_candidates() {
        let exact = search(Goal::Psnr(20.0), 1..=100_000, 500, 0.0, linear).unwrap();
        let near = search(Goal::Psnr(20.0), 1..=100_000, 500, 0.05, linear).unwrap();
        assert!(near.evaluations < exact.evaluations);
        assert!(near.met && near.index <= 105);
    }
}

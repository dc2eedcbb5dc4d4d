//! Cancelling: work looks often whether it is to stop, and stops at the look that says so.

#![allow(clippy::panic, clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use texfold_core::{Cancel, EncodeError, Job};

use crate::full;

/// Time that is not told from none where a machine does other work.
const LEAST: Duration = Duration::from_millis(20);
/// Longest work between two looks that encoders promise.
const MOST_WORK: Duration = Duration::from_millis(200);
/// How much slower a machine may be that does other work too.
const NOISE: u32 = 5;
/// Runs before the longest pause counts: other work on the machine may stop any one of them for a while.
const TRIES: u32 = 3;
/// Moments at which work is cancelled: one, and in full runs all.
const MOMENTS: u32 = 6;

/// How often a run looks whether it is to stop.
#[derive(Debug, Clone, Copy)]
struct Looks {
    count: u64,
    /// Time between two looks, or between a look and the start or the end, at most.
    longest: Duration,
    whole: Duration,
}

/// Runs `work` whole, on one thread: what passes between two looks is then work.
fn looks(work: &(impl Fn(&mut Job<'_>) -> Result<(), EncodeError> + Sync)) -> Looks {
    let start = Instant::now();
    let last =
        Arc::new(Mutex::new((start, Looks { count: 0, longest: Duration::ZERO, whole: Duration::ZERO })));
    let look = |last: &Mutex<(Instant, Looks)>| {
        let mut last = last.lock().unwrap();
        let (before, now) = (last.0, Instant::now());
        last.1.longest = last.1.longest.max(now - before);
        last.1.count += 1;
        last.0 = now;
    };
    let seen = Arc::clone(&last);
    let cancel = Cancel::when(move || {
        look(&seen);
        false
    });
    alone(&cancel, work).unwrap();
    let count = last.lock().unwrap().1.count;
    // The end counts for pauses alone.
    look(&last);
    let found = last.lock().unwrap().1;
    Looks { count, whole: start.elapsed(), ..found }
}

/// Runs `work` on one thread.
fn alone(
    cancel: &Cancel,
    work: &(impl Fn(&mut Job<'_>) -> Result<(), EncodeError> + Sync),
) -> Result<(), EncodeError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| work(&mut Job::default().with_pool(&pool).with_cancel(cancel)))
}

/// Fails where `work` does not look for longer than the 0.2 s that encoders promise, times the slowness of a machine that does other
/// work too, or where it does not end with [`EncodeError::Cancelled`] when a look tells it to stop.
///
/// # Panics
/// As above, and where the work fails.
pub fn stops_soon(name: &str, work: impl Fn(&mut Job<'_>) -> Result<(), EncodeError> + Sync) {
    stops_within(name, |_| NOISE * MOST_WORK, &work);
}

/// As [`stops_soon`], for work without a look for longer than a quarter of its time.
///
/// # Panics
/// As there.
pub fn looks_often(name: &str, work: impl Fn(&mut Job<'_>) -> Result<(), EncodeError> + Sync) {
    stops_within(name, |whole| (whole / 4).max(LEAST), &work);
}

fn stops_within(
    name: &str,
    most: impl Fn(Duration) -> Duration,
    work: &(impl Fn(&mut Job<'_>) -> Result<(), EncodeError> + Sync),
) {
    let mut found = looks(work);
    let most = most(found.whole);
    for _ in 1..TRIES {
        if found.longest > most {
            found.longest = found.longest.min(looks(work).longest);
        }
    }
    assert!(found.longest <= most, "{name} works for {:?} without a look, {most:?} allowed", found.longest);
    assert!(found.count >= 4, "{name} looks {} times", found.count);
    for moment in 0..if full() { MOMENTS } else { 1 } {
        // Multiples of the golden ratio lie evenly and never meet.
        let share = (0.37 + f64::from(moment) * 0.618_033_988_75).fract();
        let left = AtomicU64::new((found.count as f64 * share) as u64);
        let stop =
            move || left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_err();
        let outcome = alone(&Cancel::when(stop), work);
        assert!(
            matches!(outcome, Err(EncodeError::Cancelled)),
            "{name} at {share:.2} of its looks: {outcome:?}"
        );
    }
}

//! Cancelling at random moments: work stops soon, wherever it is.

#![allow(clippy::panic, clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::time::{Duration, Instant};

use texfold_core::{Cancel, EncodeError, Job};

/// Work between two looks at whether to go on.
const MOST_WORK: Duration = Duration::from_millis(200);
/// How much slower a machine may be that does other work too.
const NOISE: u32 = 5;
/// Moments at which each encode is cancelled.
const MOMENTS: u32 = 6;

/// Time up to which work is run several times to know how long it takes.
const SHORT: Duration = Duration::from_secs(5);
/// Runs at a moment before it counts as slow: a machine that does other work may stop any one of them for a while.
const TRIES: u32 = 3;

/// How long `work` goes on when it is cancelled after `after`; `None` where it ends before.
fn goes_on(work: &impl Fn(&mut Job<'_>) -> Result<(), EncodeError>, after: Duration) -> Option<Duration> {
    let cancel = Cancel::default();
    let (outcome, ended, asked) = std::thread::scope(|scope| {
        let asked = scope.spawn(|| {
            std::thread::sleep(after);
            cancel.cancel();
            Instant::now()
        });
        let outcome = work(&mut Job::default().with_cancel(&cancel));
        (outcome, Instant::now(), asked.join().unwrap())
    });
    match outcome {
        Err(EncodeError::Cancelled) => Some(ended.saturating_duration_since(asked)),
        Ok(()) => None,
        Err(error) => panic!("{error}"),
    }
}

/// Cancels `work` at moments spread over the time that it takes, none of them at a regular distance, and fails where it
/// goes on for more than 0.2 s, which encoders promise, times what a machine may be slower that does other work too.
///
/// # Panics
/// Where the work goes on for longer, fails, or hardly takes long enough to be cancelled.
pub fn stops_soon(name: &str, work: impl Fn(&mut Job<'_>) -> Result<(), EncodeError>) {
    stops_within(name, NOISE * MOST_WORK, work);
}

/// As [`stops_soon`] with another time that the work may go on for.
///
/// # Panics
/// As there.
pub fn stops_within(name: &str, most: Duration, work: impl Fn(&mut Job<'_>) -> Result<(), EncodeError>) {
    let run = || {
        let start = Instant::now();
        work(&mut Job::default()).unwrap();
        start.elapsed()
    };
    // Of work that is soon done the shortest run tells how long it takes.
    let first = run();
    let whole = if first < SHORT { (1..TRIES).map(|_| run()).fold(first, Duration::min) } else { first };
    let mut cancelled = 0;
    for moment in 0..MOMENTS {
        // The golden ratio's multiples lie evenly and never meet.
        let after = whole.mul_f64((0.37 + f64::from(moment) * 0.618_033_988_75).fract());
        let mut least = None;
        for _ in 0..TRIES {
            let Some(waited) = goes_on(&work, after) else { continue };
            least = Some(least.map_or(waited, |least: Duration| least.min(waited)));
            if waited < most {
                break;
            }
        }
        println!("{name}: cancelled after {after:.2?} of {whole:.2?}, ended {least:.2?} later");
        assert!(least.is_none_or(|least| least < most), "{name}: {least:?} after {after:?}");
        cancelled += u32::from(least.is_some());
    }
    assert!(cancelled >= MOMENTS / 2, "{name}: cancelled {cancelled} times of {MOMENTS}");
}

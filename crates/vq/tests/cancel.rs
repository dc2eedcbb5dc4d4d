//! Cancelling at random moments: encoding stops soon, wherever it is.

#![allow(clippy::panic, clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::time::{Duration, Instant};

use texfold_core::image::{ImageSet, Raster};
use texfold_core::{Cancel, EncodeError, Encoder, Goal, Growable, Job, Limits, Texel};
use texfold_testkit::{frames, image};
use texfold_vq::{Vq, VqParams, VqSource};

/// Work between two looks at whether to go on.
const MOST_WORK: Duration = Duration::from_millis(200);
/// How much slower a machine may be that does other work too.
const NOISE: u32 = 5;
/// Moments at which each encode is cancelled.
const MOMENTS: u32 = 6;

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

/// Cancels `work` at moments spread over the time that it takes, none of them at a regular distance.
fn stops_soon(name: &str, work: impl Fn(&mut Job<'_>) -> Result<(), EncodeError>) {
    let start = Instant::now();
    work(&mut Job::default()).unwrap();
    let whole = start.elapsed();
    let mut cancelled = 0;
    for moment in 0..MOMENTS {
        // The golden ratio's multiples lie evenly and never meet.
        let after = whole.mul_f64((0.37 + f64::from(moment) * 0.618_033_988_75).fract());
        let mut least = None;
        for _ in 0..TRIES {
            let Some(waited) = goes_on(&work, after) else { continue };
            least = Some(least.map_or(waited, |least: Duration| least.min(waited)));
            if waited < NOISE * MOST_WORK {
                break;
            }
        }
        println!("{name}: cancelled after {after:.2?} of {whole:.2?}, ended {least:.2?} later");
        assert!(least.is_none_or(|least| least < NOISE * MOST_WORK), "{name}: {least:?} after {after:?}");
        cancelled += u32::from(least.is_some());
    }
    assert!(cancelled >= MOMENTS / 2, "{name}: cancelled {cancelled} times of {MOMENTS}");
}

fn upper_left(image: &Raster, side: u32) -> Raster {
    let texels: Vec<Texel> = (0..side * side).map(|i| image.texel(i % side, i / side)).collect();
    Raster::from_texels(side, side, image.info(), &texels).unwrap()
}

#[test]
fn encoding_stops_within_a_fifth_of_a_second() {
    let set = ImageSet::single(upper_left(&image("terrain"), 128));
    let sequence = frames("ripple");
    for (name, set, goal) in [
        ("quality", &set, Goal::Psnr(30.0)),
        ("bits", &sequence, Goal::Bpp(2.0)),
        ("tolerance", &set, Goal::Tolerance(12.0)),
    ] {
        let params = VqParams::default().with_goal(goal).with_mips(true);
        stops_soon(name, |job| match Vq::encode(VqSource::new(set), &params, job) {
            Err(EncodeError::Source(_)) => Ok(()),
            outcome => outcome.map(|_| ()),
        });
    }
}

#[test]
fn growing_stops_within_a_fifth_of_a_second() {
    let images = frames("ripple").images().to_vec();
    let first = ImageSet::single(images[0].clone());
    let params = VqParams::default().with_goal(Goal::Bpp(3.0));
    let texture = Vq::encode(VqSource::new(&first), &params, &mut Job::default()).unwrap();
    let rest = ImageSet::new((0..64).map(|frame| images[frame % images.len()].clone()).collect()).unwrap();
    stops_soon("growth", |job| Vq::add(&mut texture.clone(), VqSource::new(&rest), job));
}

#[test]
fn a_budget_that_is_too_small_is_refused_and_one_that_is_large_enough_is_given_back() {
    let set = ImageSet::single(image("odd_37x61"));
    let params = VqParams::default().with_goal(Goal::Bpp(4.0));
    let mut small = Job::new(Limits { bytes: 4 * 37 * 61, ..Limits::default() });
    assert!(matches!(Vq::encode(VqSource::new(&set), &params, &mut small), Err(EncodeError::Limit(_))));
    let limits = Limits { bytes: 64 * 37 * 61, ..Limits::default() };
    let mut job = Job::new(limits);
    for _ in 0..3 {
        Vq::encode(VqSource::new(&set), &params, &mut job).unwrap();
    }
    assert!(job.budget.take(limits.bytes).is_ok());
}

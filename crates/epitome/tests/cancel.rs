//! An encode that is cancelled at any moment stops soon.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use texfold_core::image::ImageSet;
use texfold_core::{Cancel, Effort, EncodeError, Encoder, Goal, Job};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};
use texfold_testkit::image;

/// Seconds of work that may pass between two looks at whether a job was cancelled, and the factor that a machine may
/// be slower than the one that they were measured on.
const MOST_WORK: f64 = 0.2;
const SLACK: f64 = 3.0;

/// Seconds of work that this process has done so far: of other processes' work nothing counts, where the system
/// tells.
fn work(since: Instant) -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |index: usize| fields.get(index).and_then(|field| field.parse::<f64>().ok());
    match (ticks(11), ticks(12)) {
        (Some(user), Some(system)) => (user + system) / 100.0,
        _ => since.elapsed().as_secs_f64(),
    }
}

/// Encodes and cancels after `seconds` of work; the work until it has stopped, or `None` where it was done before.
fn stopped_after(params: &EpitomeParams, seconds: f64) -> Option<f64> {
    let set = ImageSet::single(image("facade"));
    // One thread, so that work is time.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (cancel, done, start) = (Cancel::default(), AtomicBool::new(false), Instant::now());
    let before = work(start);
    std::thread::scope(|scope| {
        let watch = scope.spawn(|| {
            while work(start) < before + seconds && !done.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(1));
            }
            cancel.cancel();
            work(start)
        });
        let mut job = Job::default().with_pool(&pool).with_cancel(&cancel);
        let result = pool.install(|| Epitome::encode(EpitomeSource::new(&set), params, &mut job));
        let end = work(start);
        done.store(true, Ordering::Relaxed);
        let cancelled = watch.join().unwrap();
        match result {
            Ok(_) => None,
            Err(EncodeError::Cancelled) => Some(end - cancelled),
            Err(other) => panic!("{other}"),
        }
    })
}

#[test]
fn a_cancelled_encode_stops_soon() {
    let layers = EpitomeParams::new(Goal::Psnr(32.0)).with_layers(3).with_effort(Effort::Fast);
    let tolerance = EpitomeParams::new(Goal::Tolerance(8.0)).with_effort(Effort::Normal);
    let mut dice = 0x2545_f491_u32;
    let mut cancelled = 0;
    for params in [EpitomeParams::new(Goal::Psnr(32.0)).with_mips(true), layers, tolerance] {
        for _ in 0..5 {
            dice = dice.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let moment = f64::from(dice >> 16) / f64::from(1 << 16) * 4.0;
            let Some(work) = stopped_after(&params, moment) else { continue };
            assert!(
                work < SLACK * MOST_WORK,
                "{params:?}: {work} s of work after it was cancelled at {moment} s"
            );
            cancelled += 1;
        }
    }
    assert!(cancelled >= 5, "hardly an encode took long enough to be cancelled");
}

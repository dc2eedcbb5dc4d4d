//! Cancelling at random moments: registration and encoding stop soon, wherever they are.

#![allow(clippy::panic, clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::time::{Duration, Instant};

use glam::{DMat3, DVec2};
use texfold_core::image::Raster;
use texfold_core::{Cancel, EncodeError, Encoder, Job};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};
use texfold_zipmap::{PatchSource, PatchStack, ZipParams, Zipmap, masks, register};

/// Work between two looks at whether to go on.
const MOST_WORK: Duration = Duration::from_millis(200);
/// How much slower a machine may be that does other work too.
const NOISE: u32 = 5;
/// Moments at which each job is cancelled.
const MOMENTS: u32 = 6;
const SIZE: (u32, u32) = (320, 280);

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

/// A root and two close-ups.
fn stack() -> PatchStack {
    let leaves = Leaves::new(3, 60_000);
    let middle = DVec2::new(0.45, 0.55);
    let matrices = [2.5, 6.0].map(|zoom| close_up(middle, zoom, 0.3, DVec2::ZERO));
    let shot = |(matrix, seed): (&DMat3, u64)| {
        photograph(&leaves.view(matrix, SIZE, 2), SIZE, Lens { exposure: 1.0, noise: 0.01, seed })
    };
    let images: Vec<Raster> = matrices.iter().zip(2..).map(shot).collect();
    let patch = |(image, matrix)| PatchSource { image, matrix, mask: None, parent: None };
    let patches = matrices.into_iter().enumerate().map(patch).collect();
    PatchStack { root: shot((&DMat3::IDENTITY, 1)), images, patches }
}

#[test]
fn registration_masks_and_encoding_stop_within_a_fifth_of_a_second() {
    let stack = stack();
    let photos: Vec<Raster> = [&stack.root].into_iter().chain(&stack.images).cloned().collect();
    let params = ZipParams::default();
    stops_soon("registration", |job| register(&photos, job).map(|_| ()));
    stops_soon("encoding", |job| Zipmap::encode(&stack, &params, job).map(|_| ()));
    stops_soon("masks", |job| masks(&stack, &params, job).map(|_| ()));
}

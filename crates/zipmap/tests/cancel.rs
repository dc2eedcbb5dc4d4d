//! Registration and encoding look often whether they are to stop.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use glam::{DMat3, DVec2};
use texfold_core::image::Raster;
use texfold_core::{EncodeError, Encoded, Encoder, Job, Limits};
use texfold_testkit::cancel::stops_soon;
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};
use texfold_zipmap::{PatchSource, PatchStack, ZipParams, Zipmap, masks, register};

const SIZE: (u32, u32) = (320, 280);

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
fn registration_masks_and_encoding_stop_soon() {
    let stack = stack();
    let photos: Vec<Raster> = [&stack.root].into_iter().chain(&stack.images).cloned().collect();
    let params = ZipParams::default();
    stops_soon("registration", |job| register(&photos, job).map(|_| ()));
    stops_soon("encoding", |job| Zipmap::encode(&stack, &params, job).map(|_| ()));
    stops_soon("masks", |job| masks(&stack, &params, job).map(|_| ()));
}

#[test]
fn a_budget_that_is_too_small_is_refused_and_one_that_is_large_enough_is_given_back() {
    let (stack, params) = (stack(), ZipParams::default());
    let with = |bytes| {
        let mut job = Job::new(Limits { bytes, ..Limits::default() });
        let made = Zipmap::encode(&stack, &params, &mut job).map(drop);
        (made, job.budget.peak_bytes())
    };
    let (made, peak) = with(1 << 30);
    assert!(made.is_ok() && peak > 3 * 320 * 280 * 16, "{made:?}, {peak} bytes");
    assert!(matches!(with(peak - 1).0, Err(EncodeError::Limit(_))));
    let mut small = Job::new(Limits { bytes: peak - 1, ..Limits::default() });
    assert!(matches!(masks(&stack, &params, &mut small), Err(EncodeError::Limit(_))));
    let mut job = Job::new(Limits { bytes: peak, ..Limits::default() });
    for _ in 0..2 {
        Zipmap::encode(&stack, &params, &mut job).unwrap();
    }
}

#[test]
fn notes_name_what_is_not_usual() {
    let stack = stack();
    let settings = |params: &ZipParams| {
        Zipmap::encode(&stack, params, &mut Job::default()).unwrap().notes().settings.clone()
    };
    // As they stand in a `zipmap.toml`.
    let usual = settings(&ZipParams::default());
    assert!(!usual.contains("tau") && !usual.contains("merge"), "{usual}");
    assert_eq!(settings(&ZipParams::default().with_tau(0.25)), format!("{usual}, tau = 0.25"));
    assert_eq!(settings(&ZipParams::default().with_merge(false)), format!("{usual}, merge = false"));
}

//! Encodes that are cancelled at any moment stop soon, whatever they are doing.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use glam::Vec3;
use texfold_core::{Cancel, EncodeError, Job, Limits};
use texfold_lightfield::{
    Capture, Directions, Factors, FitMethod, LightModel, LightParams, Lightfield, Mesh, Updates,
};
use texfold_testkit::capture::{Look, camera, eyes, icosphere, photograph, sphere};

/// Work between two looks that encoders promise, for each of their threads.
const PROMISE: Duration = Duration::from_millis(200);
/// What the clock of processes and the end of a pool's loops may add, as a factor.
const NOISE: u32 = 2;
/// Moments for each way to encode.
const MOMENTS: u32 = 4;

/// One encode at a time: what the process has worked is then its work.
static ALONE: Mutex<()> = Mutex::new(());

/// What the process has worked so far, all threads together: other programs on the machine do not count. Where the system does
/// not tell, time that has passed.
fn worked(start: Instant) -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields 14 and 15 in hundredths of a second, counted after the name, which ends with the last bracket.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
    let ticks: u64 = fields.filter_map(|field| field.parse::<u64>().ok()).sum();
    if ticks > 0 { Duration::from_millis(10 * ticks) } else { start.elapsed() }
}

/// Two triangles in many photographs: each vertex has as many observations as there can be, so a check for each vertex is too few.
fn square() -> Capture {
    let side = 0.7;
    let corner = |x, y| Vec3::new(x, y, 0.0);
    let positions = vec![corner(-side, -side), corner(side, -side), corner(side, side), corner(-side, side)];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] };
    let from = |eye: Vec3| photograph(&mesh, Look::Glossy, camera(eye + 3.0 * Vec3::Z, 128));
    let views = eyes(24, 1.5, 0.0).into_iter().map(from).collect();
    Capture { mesh, views }
}

/// Cancels encodes at moments spread over the time that a whole one takes.
fn stops_soon(name: &str, capture: &Capture, params: &LightParams, simplified: bool) {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let encode = |job: &mut Job<'_>| match simplified {
        true => Lightfield::encode_simplified(capture, params, job).map(drop),
        false => Lightfield::encode_measured(capture, params, job).map(drop),
    };
    let start = Instant::now();
    encode(&mut Job::default()).unwrap();
    let whole = start.elapsed();
    let mut stopped = 0;
    for moment in 0..MOMENTS {
        // The golden ratio spreads moments evenly, and never alike.
        let share = (f64::from(moment + 1) * 0.618_034).fract();
        let cancel = Cancel::default();
        let (cancelled, result, late) = thread::scope(|scope| {
            let work = scope.spawn(|| (encode(&mut Job::default().with_cancel(&cancel)), worked(start)));
            thread::sleep(whole.mul_f64(share));
            let cancelled = worked(start);
            cancel.cancel();
            let (result, ended) = work.join().unwrap();
            (cancelled, result, ended)
        });
        if result.is_ok() {
            continue;
        }
        assert!(matches!(result, Err(EncodeError::Cancelled)), "{name} at {share:.2}: {result:?}");
        let took = late.saturating_sub(cancelled) / rayon::current_num_threads() as u32;
        assert!(
            took < PROMISE * NOISE,
            "{name} at {share:.2} of {whole:?} worked {took:?} before it stopped"
        );
        stopped += 1;
    }
    assert!(stopped > 1, "{name}: {stopped} of {MOMENTS} encodes were still at work in {whole:?}");
}

#[test]
fn fits_stop_soon_however_many_observations_a_vertex_has() {
    let capture = square();
    let params = LightParams::default().with_terms(6);
    stops_soon("scattered", &capture, &params, false);
    let plain = LightModel::default().with_factors(Factors::NonNegative);
    let updates = plain.with_updates(Updates::Multiplicative).with_chosen(false);
    stops_soon("multiplicative", &capture, &params.clone().with_terms(2).with_model(updates), false);
    let resampled = LightModel::default().with_fit(FitMethod::Resampled);
    stops_soon("resampled", &capture, &params.with_terms(2).with_model(resampled), false);
}

#[test]
fn shared_maps_codebooks_and_coarser_meshes_stop_soon() {
    let capture = sphere(Look::Glossy, 30, 48);
    let fit = FitMethod::Shared { regions: 1 };
    let shared = LightModel::default().with_fit(fit).with_directions(Directions::World);
    stops_soon("shared", &capture, &LightParams::default().with_terms(2).with_model(shared), false);
    let all = LightModel::default().with_chosen(false);
    let codewords = LightParams::default().with_terms(3).with_model(all).with_codewords(0.3);
    stops_soon("codewords", &capture, &codewords, false);
    let mesh = icosphere(3);
    let views = eyes(8, 4.0, 0.0).into_iter();
    let views = views.map(|eye| photograph(&mesh, Look::Glossy, camera(eye, 40))).collect();
    stops_soon("simplified", &Capture { mesh, views }, &LightParams::default(), true);
}

#[test]
fn what_photographs_and_maps_take_is_booked() {
    let capture = sphere(Look::Glossy, 24, 32);
    let with = |bytes| {
        let mut job = Job::new(Limits { bytes, ..Limits::default() });
        let made = Lightfield::encode_measured(&capture, &LightParams::default(), &mut job).map(drop);
        (made, job.budget.peak_bytes())
    };
    let (made, peak) = with(1 << 30);
    assert!(made.is_ok() && peak > 100_000, "{made:?}, {peak} bytes");
    assert!(matches!(with(peak - 1).0, Err(EncodeError::Limit(_))));
    assert!(with(peak).0.is_ok());
    // What one encode has booked is free for the next.
    let mut job = Job::new(Limits { bytes: peak, ..Limits::default() });
    for _ in 0..3 {
        assert!(Lightfield::encode_measured(&capture, &LightParams::default(), &mut job).is_ok());
    }
}

//! Fits and encodes look often whether they are to stop.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use glam::Vec3;
use texfold_core::{EncodeError, Job, Limits};
use texfold_lightfield::{
    Capture, Directions, Factors, FitMethod, LightModel, LightParams, Lightfield, Mesh, Updates,
};
use texfold_testkit::cancel::stops_soon;
use texfold_testkit::capture::{Look, camera, eyes, icosphere, photograph, sphere};

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

/// Encodes, with a simplified mesh where `simplified` says so.
fn stops(name: &str, capture: &Capture, params: &LightParams, simplified: bool) {
    stops_soon(name, |job| match simplified {
        true => Lightfield::encode_simplified(capture, params, job).map(drop),
        false => Lightfield::encode_measured(capture, params, job).map(drop),
    });
}

#[test]
fn fits_stop_soon_however_many_observations_a_vertex_has() {
    let capture = square();
    let params = LightParams::default().with_terms(6);
    stops("scattered", &capture, &params, false);
    let plain = LightModel::default().with_factors(Factors::NonNegative);
    let updates = plain.with_updates(Updates::Multiplicative).with_chosen(false);
    stops("multiplicative", &capture, &params.clone().with_terms(2).with_model(updates), false);
    let resampled = LightModel::default().with_fit(FitMethod::Resampled);
    stops("resampled", &capture, &params.with_terms(2).with_model(resampled), false);
}

#[test]
fn shared_maps_codebooks_and_coarser_meshes_stop_soon() {
    let capture = sphere(Look::Glossy, 30, 48);
    let fit = FitMethod::Shared { regions: 1 };
    let shared = LightModel::default().with_fit(fit).with_directions(Directions::World);
    stops("shared", &capture, &LightParams::default().with_terms(2).with_model(shared), false);
    let all = LightModel::default().with_chosen(false);
    let codewords = LightParams::default().with_terms(3).with_model(all).with_codewords(0.3);
    stops("codewords", &capture, &codewords, false);
    let mesh = icosphere(3);
    let views = eyes(8, 4.0, 0.0).into_iter();
    let views = views.map(|eye| photograph(&mesh, Look::Glossy, camera(eye, 40))).collect();
    stops("simplified", &Capture { mesh, views }, &LightParams::default(), true);
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

//! Encoding and growing look often whether they are to stop.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold_core::image::{ImageSet, Raster};
use texfold_core::{EncodeError, Encoder, Goal, Growable, Job, Limits, Texel};
use texfold_testkit::cancel::stops_soon;
use texfold_testkit::{frames, image};
use texfold_vq::{Vq, VqParams, VqSource};

fn upper_left(image: &Raster, side: u32) -> Raster {
    let texels: Vec<Texel> = (0..side * side).map(|i| image.texel(i % side, i / side)).collect();
    Raster::from_texels(side, side, image.info(), &texels).unwrap()
}

#[test]
fn encoding_stops_soon() {
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
fn growing_stops_soon() {
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

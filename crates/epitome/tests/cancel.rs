//! Encodes look often whether they are to stop.

#![cfg(feature = "encode")]

use texfold_core::image::ImageSet;
use texfold_core::{Effort, Encoder, Goal};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};
use texfold_testkit::cancel::stops_soon;
use texfold_testkit::image;

#[test]
fn mip_levels_layers_and_tolerances_stop_soon() {
    let set = ImageSet::single(image("facade"));
    let layers = EpitomeParams::new(Goal::Psnr(32.0)).with_layers(3).with_effort(Effort::Fast);
    for (name, params) in [
        ("mip levels", EpitomeParams::new(Goal::Psnr(32.0)).with_mips(true)),
        ("layers", layers),
        ("tolerance", EpitomeParams::new(Goal::Tolerance(8.0)).with_effort(Effort::Fast)),
    ] {
        stops_soon(name, |job| Epitome::encode(EpitomeSource::new(&set), &params, job).map(drop));
    }
}

//! What all codecs do to whole images stops soon when it is cancelled: mip levels are made and quality is measured.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold_bc::{Bc, BcParams, Content};
use texfold_core::image::{ImageSet, MipFilter, Raster, mip_chain_cancellable};
use texfold_core::metric::measure_for;
use texfold_core::{Encoder, Goal, Job, Texel};
use texfold_testkit::cancel::{looks_often, stops_soon};
use texfold_testkit::image;

/// Texels a side of the image whose levels are made and measured: four megatexels; and of the one that is encoded.
const SIDE: u32 = 2048;
const ENCODED_SIDE: u32 = 512;

/// An image side by side with itself.
fn tiled(side: u32) -> Raster {
    let tile = image("terrain");
    let (width, height) = (tile.size().width, tile.size().height);
    let texels: Vec<Texel> =
        (0..side * side).map(|i| tile.texel(i % side % width, i / side % height)).collect();
    Raster::from_texels(side, side, tile.info(), &texels).unwrap()
}

#[test]
fn mip_levels_measures_and_encoding_stop_soon() {
    let image = tiled(SIDE);
    let levels = image.size().full_levels();
    looks_often("mip levels", |job| {
        mip_chain_cancellable(&image, levels, MipFilter::Box, job.cancel_check()).map(drop)
    });
    let set = ImageSet::single(image);
    let params = BcParams::default().with_goal(Goal::Psnr(20.0)).with_content(Content::Raw);
    let texture = Bc::encode(&set, &params, &mut Job::default()).unwrap();
    looks_often("quality", |job| measure_for(Goal::default(), &set, &texture, job.cancel_check()).map(drop));
    let set = ImageSet::single(tiled(ENCODED_SIDE));
    let params = BcParams::default().with_goal(Goal::Psnr(30.0)).with_mips(true);
    stops_soon("encoding", |job| Bc::encode(&set, &params, job).map(drop));
}

//! What a model may do with content can be restricted: nothing that is left out is in the file, and goals are reached
//! without it.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use texfold_core::image::ImageSet;
use texfold_core::metric::measure;
use texfold_core::{Access, Effort, Encoded, Goal};
use texfold_epitome::{EpitomeParams, EpitomeTexture, IDENTITY, NEUTRAL, Transforms};
use texfold_testkit::image;

use crate::support;

const ALL: Transforms = Transforms::ALL;
const PSNR: f64 = 30.0;

/// An image, of the facade a part, encoded without some parts; it comes back from its file as it was.
fn encode(name: &str, transforms: Transforms, block: Option<u32>) -> EpitomeTexture {
    let set = if name == "facade" { support::facade() } else { ImageSet::single(image(name)) };
    let params = EpitomeParams::new(Goal::Psnr(PSNR))
        .with_access(Access::Texel)
        .with_block(block)
        .with_transforms(transforms)
        .with_effort(Effort::Fast);
    let texture = support::encode(&set, &params);
    let psnr = measure(&set, &texture).psnr;
    assert!(psnr >= PSNR, "{name} {transforms:?}: {psnr}");
    assert!(support::load(&support::file(&texture)).unwrap() == texture);
    texture
}

#[test]
fn positions_without_fractions_are_whole_texels() {
    let texture = encode("facade", Transforms { fractions: false, ..ALL }, None);
    assert_eq!(texture.map_format().fraction_bits, 0);
    assert_eq!(encode("facade", ALL, None).map_format().fraction_bits, 2);
}

#[test]
fn matrices_are_scales_and_mirrors_at_most() {
    let upright =
        |texture: &EpitomeTexture| texture.matrices().iter().all(|matrix| matrix[1] == 0 && matrix[2] == 0);
    let mirrored =
        |texture: &EpitomeTexture| texture.matrices().iter().any(|matrix| matrix[0] < 0 || matrix[3] < 0);
    let texture = encode("text_page", Transforms { affine: false, ..ALL }, None);
    assert!(upright(&texture) && mirrored(&texture), "{:?}", texture.matrices());
    let exact = |&value: &i16| [0, 8192, 4096, 2048].contains(&value.abs());
    assert!(texture.matrices().iter().flatten().all(exact), "{:?}", texture.matrices());
    let texture = encode("text_page", Transforms { affine: false, mirrors: false, ..ALL }, None);
    assert!(upright(&texture) && !mirrored(&texture), "{:?}", texture.matrices());
    assert!(!upright(&encode("text_page", ALL, None)), "everything is upright with everything allowed");
}

#[test]
fn tones_that_are_left_out_are_neutral() {
    let texture = encode("facade", Transforms { gain_offsets: false, ..ALL }, None);
    assert_eq!(texture.gain_offsets(), [NEUTRAL]);
    assert_eq!(texture.map_format().gain_offset_bits, 0);
    assert!(encode("facade", ALL, None).gain_offsets().len() > 1);
}

#[test]
fn content_of_its_own_place_and_size_is_plain_content() {
    let plain = Transforms { references: false, scales: false, ..ALL };
    let texture = encode("odd_37x61", plain, None);
    assert_eq!((texture.matrices(), texture.gain_offsets()), (&[IDENTITY][..], &[NEUTRAL][..]));
    let verdict = &texture.notes().verdict;
    assert!(verdict.contains("0% of the texels are drawn from content elsewhere, 0% from"), "{verdict}");
    assert!(texture.notes().settings.ends_with("without references, without scales"));
}

#[test]
fn leaves_of_one_side_without_a_quadtree() {
    // Sides at which content at a quarter of its size has no whole number of cells, too.
    for block in [8, 12, 16, 20, 32] {
        let texture = encode("odd_37x61", Transforms { quadtree: false, ..ALL }, Some(block));
        let format = texture.map_format();
        assert_eq!((format.split, format.block), (false, block));
    }
}

//! Goals of bits a texel name a format and a size, whatever the image's size; reports still count every bit.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use texfold_bc::{Bc, BcParams, BcTexture, Content};
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::metric::{measure, quality};
use texfold_core::rng::Rng;
use texfold_core::{Encoded, Encoder, Goal, ImageSize, Job};

/// Smooth colours with some noise, so that finer formats are better.
fn image(width: u32, height: u32) -> Raster {
    let mut rng = Rng::new(u64::from(width) << 32 | u64::from(height));
    let bytes: Vec<u8> = (0..width * height)
        .flat_map(|i| [i % width * 200 / width, i / width * 200 / height, 90])
        .map(|value| value as u8 + rng.below(40) as u8)
        .collect();
    Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes).unwrap()
}

fn encode(set: &ImageSet, params: &BcParams) -> BcTexture {
    Bc::encode(set, params, &mut Job::default()).unwrap()
}

#[test]
fn bits_a_texel_name_a_format_and_a_size_for_any_image() {
    for (width, height) in [(64, 64), (37, 61), (13, 100), (130, 70), (5, 7), (1, 1), (683, 9)] {
        let set = ImageSet::single(image(width, height));
        for (bpp, content, reduce_log2) in [
            (8.0, Content::Bc7, 0),
            (4.0, Content::Bc1, 0),
            (2.0, Content::Bc7, 1),
            (1.0, Content::Bc1, 1),
            (0.5, Content::Bc7, 2),
        ] {
            let texture = encode(&set, &BcParams::default().with_goal(Goal::Bpp(bpp)));
            let found = measure(&set, &texture).bpp;
            assert!(found <= bpp || width * height == 1, "{width}x{height} at {bpp}: {found}");
            let alike = (texture.content(), texture.reduce_log2()) == (content, reduce_log2);
            // Of images of a few texels, a smaller form may be as good.
            assert!(alike || width.min(height) < 8, "{width}x{height} at {bpp}: {texture:?}");
            let full = texture.reduce_log2() == 0 && (texture.content() == content);
            assert!(full || bpp < 4.0, "{width}x{height} at {bpp}: {:?}", texture.content());
        }
    }
}

#[test]
fn a_goal_just_below_a_format_does_not_reach_it() {
    let set = ImageSet::single(image(64, 64));
    let texture = encode(&set, &BcParams::default().with_goal(Goal::Bpp(3.99)));
    assert_ne!((texture.content(), texture.reduce_log2()), (Content::Bc1, 0));
}

#[test]
fn mip_levels_count() {
    let set = ImageSet::single(image(64, 64));
    let texture = encode(&set, &BcParams::default().with_goal(Goal::Bpp(4.0)).with_mips(true));
    assert_ne!((texture.content(), texture.reduce_log2()), (Content::Bc1, 0));
    let texture = encode(&set, &BcParams::default().with_goal(Goal::Bpp(5.34)).with_mips(true));
    assert_eq!((texture.content(), texture.reduce_log2()), (Content::Bc1, 0));
}

#[test]
fn memory_is_what_the_form_for_gpus_takes() {
    let size = |width, height| ImageSize { width, height };
    for mips in [false, true] {
        for content in [Content::Raw, Content::Bc1, Content::Bc7] {
            let set = ImageSet::new(vec![image(37, 61), image(3, 1), image(64, 8)]).unwrap();
            let params = BcParams::default().with_goal(Goal::Bpp(99.0)).with_content(content).with_mips(mips);
            let texture = encode(&set, &params);
            assert_eq!(texture.layout().images, [size(37, 61), size(3, 1), size(64, 8)]);
            assert_eq!(texture.memory(), texture.gpu().memory(), "{content:?} {mips}");
            assert_eq!(texture.memory().compressed, texture.footprint().bits_memory());
        }
    }
}

#[test]
fn blocks_are_no_nearer_to_images_than_the_images_reduced() {
    for name in ["facade", "noise", "ramp", "normal_map", "gray", "cutout", "zebra", "terrain"] {
        let set = ImageSet::single(texfold_testkit::image(name));
        for bpp in [0.05, 0.5, 1.0, 2.0] {
            let params = BcParams::default().with_goal(Goal::Bpp(bpp));
            let reduced = Bc::reduced(&set, &params, bpp, &mut Job::default()).unwrap();
            let of = |texture: &BcTexture| quality(&set, texture).color.psnr();
            let (blocks, reduced) = (of(&encode(&set, &params)), reduced.map(|reduced| of(&reduced)));
            assert!(
                reduced.is_none_or(|reduced| blocks < reduced + 0.3),
                "{name} at {bpp}: {blocks} dB of {reduced:?}"
            );
            assert_eq!(reduced.is_none(), bpp < 0.06, "{name} at {bpp}");
        }
        // Blocks at full size.
        assert!(Bc::reduced(&set, &BcParams::default(), 8.0, &mut Job::default()).unwrap().is_none());
    }
}

//! Images that a method built on repetition does not suit: verdicts and sizes of codec epitome as users meet it. The package
//! `texfold-checks` holds every codec to bounds on the same images and many more (`cargo xtask stability`).

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::core::metric::decode_image;
use texfold::{
    Access, AnyImage, Choice, Effort, EncodeError, EncodeSettings, Goal, Guidance, Job, bc::BcTexture,
    core::SourceError, encode_images, epitome::Epitome,
};
use texfold_testkit::image;

fn encode(set: &ImageSet) -> AnyImage {
    let settings = EncodeSettings {
        codec: Choice::of::<Epitome>(),
        goal: Goal::Psnr(30.0),
        effort: Effort::Fast,
        access: Some(Access::Texel),
        ..EncodeSettings::default()
    };
    encode_images(set, Guidance::default(), &settings, &mut Job::default()).unwrap()
}

fn bpp(image: &AnyImage, set: &ImageSet) -> f64 {
    image.as_encoded().memory().compressed as f64 / set.texel_count() as f64
}

/// An image whose texel at (x, y) is `shade`.
fn drawn(width: u32, height: u32, shade: impl Fn(u32, u32) -> [u8; 3]) -> Raster {
    let bytes: Vec<u8> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| shade(x, y)).collect();
    Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes).unwrap()
}

#[test]
fn noise_falls_back_to_plain_blocks_with_a_verdict() {
    let made = encode(&ImageSet::single(image("noise")));
    assert!(made.downcast_ref::<BcTexture>().is_some());
    assert!(made.as_encoded().notes().verdict.contains("epitome does not suit"));
}

#[test]
fn a_constant_costs_its_map_alone() {
    let set = ImageSet::single(image("constant"));
    let bpp = bpp(&encode(&set), &set);
    assert!(bpp < 1.0, "{bpp} bits a texel");
}

#[test]
fn a_black_image_needs_no_gain_of_nothing_by_nothing() {
    let made = encode(&ImageSet::single(image("black")));
    let decoded = decode_image(made.as_encoded(), 0, 0).unwrap();
    assert!(decoded.texels().all(|texel| texel.truncate().max_element() < 1.0 / 255.0));
}

#[test]
fn a_fully_transparent_image_stays_transparent() {
    let made = encode(&ImageSet::single(image("transparent")));
    let decoded = decode_image(made.as_encoded(), 0, 0).unwrap();
    assert!(decoded.texels().all(|texel| texel.w < 0.5 / 255.0));
}

#[test]
fn equal_leaves_by_the_thousand() {
    // A thousand equal leaves of 8x8 texels, and one that differs.
    let shade = |x: u32, y: u32| {
        if (x, y) == (100, 100) { [255, 0, 0] } else { [(x % 8 * 30) as u8, (y % 8 * 30) as u8, 128] }
    };
    let set = ImageSet::single(drawn(256, 256, shade));
    let bpp = bpp(&encode(&set), &set);
    assert!(bpp < 1.5, "{bpp} bits a texel");
}

#[test]
fn a_mask_of_the_wrong_size_is_named() {
    let set = ImageSet::single(image("odd_37x61"));
    let settings = EncodeSettings { codec: Choice::of::<Epitome>(), ..EncodeSettings::default() };
    for (width, height) in [(61, 37), (1, 1), (38, 61)] {
        let mask = drawn(width, height, |_, _| [255; 3]);
        let guidance = Guidance { content_from: Some(&mask), ..Guidance::default() };
        let error = encode_images(&set, guidance, &settings, &mut Job::default()).map(|_| ()).unwrap_err();
        let named = matches!(error, EncodeError::Source(SourceError::Guidance { map: "content mask", .. }));
        assert!(named && error.to_string().contains("same image"), "{error}");
    }
}

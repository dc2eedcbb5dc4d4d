//! Images that a method built on repetition does not suit, each with its bound, for codec epitome as users meet it.
//!
//! The bound of all of them: where plain blocks reach the goal so does the result, to within 0.1 dB, in no more memory and at
//! most a file header more on disk; every texel is a number; one thread and two give the same bytes.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold::image::{ColorSpace, ImageSet, Raster};
use texfold::metric::{decode_surface, quality};
use texfold::{
    Access, AnyImage, Bc, BcTexture, Choice, Effort, EncodeError, EncodeSettings, Epitome, Goal, Guidance,
    Job, SourceError, Texel, encode_images,
};
use texfold_testkit::image;

/// What every image is encoded for.
const GOAL: Goal = Goal::Psnr(30.0);
/// Room for what a file says beside its content: header, table of sections, parameters, notes.
const HEADER_BYTES: usize = 1024;

fn encode(set: &ImageSet, codec: Choice, access: Access, threads: usize) -> AnyImage {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let settings = EncodeSettings {
        codec,
        goal: GOAL,
        effort: Effort::Fast,
        access: Some(access),
        ..EncodeSettings::default()
    };
    let mut job = Job::default().with_pool(&pool);
    encode_images(set, Guidance::default(), &settings, &mut job).unwrap()
}

/// Holds a set to the bound, by block and by texel, and gives what was made by texel.
fn within_the_bound(set: &ImageSet) -> AnyImage {
    within_the_bound_by(set, Access::Block);
    within_the_bound_by(set, Access::Texel)
}

fn within_the_bound_by(set: &ImageSet, access: Access) -> AnyImage {
    let codec = Choice::of::<Epitome>();
    let (made, plain) = (encode(set, codec.clone(), access, 1), encode(set, Choice::of::<Bc>(), access, 1));
    let (found, least) = (quality(set, made.as_encoded()), quality(set, plain.as_encoded()));
    let wanted = least.color.psnr().min(30.0) - 0.1;
    assert!(found.color.psnr() >= wanted, "{:.2} dB, {wanted:.2} wanted", found.color.psnr());
    if let (Some(alpha), Some(least)) = (found.alpha, least.alpha) {
        assert!(alpha.psnr() >= least.psnr().min(30.0) - 0.1, "alpha {:.2} dB", alpha.psnr());
    }
    let bits = |image: &AnyImage| image.as_encoded().gpu().bits_memory();
    if least.color.psnr() >= 30.0 {
        assert!(bits(&made) <= bits(&plain), "{} bits, plain {}", bits(&made), bits(&plain));
    }
    let bytes = made.to_bytes();
    // Blocks of variable length are as small as they get, where plain blocks of a pattern shrink in a file.
    let of_plain = match access {
        Access::Block => plain.to_bytes().len().max(bits(&plain) as usize / 8),
        Access::Texel => plain.to_bytes().len(),
    };
    assert!(bytes.len() <= of_plain + HEADER_BYTES, "{access:?}: {} bytes, plain {of_plain}", bytes.len());
    for (surface, image) in (0u32..).zip(set.images()) {
        let decoded = decode_surface(made.as_encoded(), surface, 0).unwrap();
        assert_eq!(decoded.size(), image.size());
        assert!(decoded.texels().all(Texel::is_finite));
    }
    assert!(encode(set, codec, access, 2).to_bytes() == bytes, "two threads give other bytes");
    made
}

fn fixture(name: &str) -> AnyImage {
    within_the_bound(&ImageSet::single(image(name)))
}

fn bpp(image: &AnyImage, texels: f64) -> f64 {
    image.as_encoded().gpu().bits_memory() as f64 / texels
}

/// An image whose texel at (x, y) is `shade`.
fn drawn(width: u32, height: u32, shade: impl Fn(u32, u32) -> [u8; 3]) -> Raster {
    let bytes: Vec<u8> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| shade(x, y)).collect();
    Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes).unwrap()
}

#[test]
fn noise_is_left_to_plain_blocks_and_that_is_said() {
    let made = fixture("noise");
    assert!(made.downcast_ref::<BcTexture>().is_some());
    assert!(made.as_encoded().notes().verdict.contains("epitome does not suit"));
}

#[test]
fn zebra() {
    fixture("zebra");
}

#[test]
fn stripes_in_one_dimension() {
    fixture("stripes");
}

#[test]
fn a_smooth_ramp_is_no_clique_of_matches() {
    fixture("ramp");
}

#[test]
fn a_constant_costs_its_map_alone() {
    let made = fixture("constant");
    let texels = f64::from(image("constant").size().width * image("constant").size().height);
    assert!(bpp(&made, texels) < 1.0, "{} bits a texel", bpp(&made, texels));
}

#[test]
fn one_texel() {
    fixture("one_texel");
}

#[test]
fn three_by_five_texels() {
    fixture("odd_3x5");
}

#[test]
fn a_line_of_4097_texels() {
    let line = |x: u32| [(x * 7 % 251) as u8, (x / 16 % 256) as u8, 90];
    within_the_bound(&ImageSet::single(drawn(4097, 1, |x, _| line(x))));
    within_the_bound(&ImageSet::single(drawn(1, 4097, |_, y| line(y))));
}

#[test]
fn a_black_image_needs_no_gain_of_nothing_by_nothing() {
    let made = fixture("black");
    let decoded = decode_surface(made.as_encoded(), 0, 0).unwrap();
    assert!(decoded.texels().all(|texel| texel.truncate().max_element() < 1.0 / 255.0));
}

#[test]
fn a_fully_transparent_image_stays_transparent() {
    let hidden = drawn(64, 48, |x, y| [(x * 37 + y * 11) as u8, (x * y) as u8, (y * 5) as u8]);
    let clear: Vec<Texel> = hidden.texels().map(|texel| texel.truncate().extend(0.0)).collect();
    let mut info = hidden.info();
    info.channels = 4;
    info.alpha = texfold::image::Alpha::Straight;
    let made = within_the_bound(&ImageSet::single(Raster::from_texels(64, 48, info, &clear).unwrap()));
    let decoded = decode_surface(made.as_encoded(), 0, 0).unwrap();
    assert!(decoded.texels().all(|texel| texel.w < 0.5 / 255.0));
    fixture("transparent");
}

#[test]
fn tiles_smaller_than_a_leaf_and_off_its_grid() {
    for (across, down) in [(2, 2), (3, 3), (5, 7), (8, 6)] {
        let shade = |x: u32, y: u32| {
            let at = (x % across) * 53 + (y % down) * 97;
            [(at * 3 % 256) as u8, (at * 7 % 256) as u8, (at * 11 % 256) as u8]
        };
        within_the_bound(&ImageSet::single(drawn(96, 80, shade)));
    }
}

#[test]
fn equal_leaves_by_the_thousand() {
    // A thousand equal leaves of 8x8 texels, and one that differs.
    let shade = |x: u32, y: u32| {
        if (x, y) == (100, 100) { [255, 0, 0] } else { [(x % 8 * 30) as u8, (y % 8 * 30) as u8, 128] }
    };
    let made = within_the_bound(&ImageSet::single(drawn(256, 256, shade)));
    assert!(bpp(&made, 65536.0) < 1.5, "{} bits a texel", bpp(&made, 65536.0));
}

#[test]
fn a_set_of_unlike_images() {
    let smooth = drawn(70, 33, |x, y| [(x * 3) as u8, (y * 7) as u8, 128]);
    let set = ImageSet::new(vec![smooth, image("noise"), image("odd_3x5"), image("constant")]).unwrap();
    within_the_bound(&set);
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

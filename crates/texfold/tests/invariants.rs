//! What holds for every codec: regions equal samples, files equal what made them, figures equal the bytes.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use crate::support::{bc, epitome, fixture, small_textures, vq};
use proptest::prelude::*;
use texfold::core::metric::{decode_image, quality};
use texfold::{
    Choice, Content, Effort, EncodeError, EncodeSettings, Encoded, Goal, Guidance, ImageAddress, Job, Rect,
    RegionError, Texel,
    bc::BcParams,
    core::{Encoder, Stage},
    encode_images,
    epitome::{Epitome, EpitomeParams, EpitomeSource},
    vq::{Vq, VqParams, VqSource},
};
use texfold::{
    core::image::{ColorSpace, ImageSet, Raster},
    open,
};
use texfold_testkit::frames;

#[test]
fn a_file_gives_back_the_texture_that_was_stored() {
    for (name, _, texture) in small_textures() {
        let bytes = texture.to_bytes();
        let loaded = open(&bytes).unwrap().into_image().unwrap();
        assert_eq!(loaded.to_bytes(), bytes, "{name}");
        for level in 0..texture.as_encoded().layout().levels {
            let (made, read) =
                (decode_image(texture.as_encoded(), 0, level), decode_image(loaded.as_encoded(), 0, level));
            assert!(made.is_some() && made == read, "{name} level {level}");
        }
    }
}

#[test]
fn parts_add_up_to_the_file_and_to_what_a_gpu_holds() {
    for (name, _, texture) in small_textures() {
        let footprint = texture.as_encoded().footprint();
        assert_eq!(footprint.bits_disk(), 8 * texture.to_bytes().len() as u64, "{name}");
        assert_eq!(footprint.bits_memory(), texture.as_encoded().memory().compressed, "{name}");
    }
}

#[test]
fn a_sample_is_exact_where_content_is_raw() {
    let set = fixture("salient");
    let params = VqParams::default()
        .with_codebook((128, 64))
        .with_samples((1, 48))
        .with_content(Content::Raw)
        .with_effort(Effort::Fast);
    let texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
    let part = texture.samples()[0];
    for (y, x) in (0..part.side).flat_map(|y| (0..part.side).map(move |x| (y, x))) {
        let at = ImageAddress { image: 0, level: 0, x: part.source_x + x, y: part.source_y + y };
        let (source, decoded) = (set.images()[0].texel(at.x, at.y), texture.texel(at));
        assert!((source - decoded).abs().max_element() < 1e-6, "{at:?}: {source} {decoded}");
    }
}

#[test]
fn the_sample_of_a_salient_image_lies_on_the_salient_object() {
    let set = fixture("salient");
    let params = VqParams::default().with_codebook((128, 64)).with_samples((1, 48));
    let texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
    let part = texture.samples()[0];
    // The ball's centre lies right of and below the middle.
    let inside = |at: u32, start: u32| at + part.side > start + 20 && at < start + 140;
    assert!(inside(part.source_x, 90) && inside(part.source_y, 70), "{part:?}");
}

#[test]
fn a_painted_map_moves_the_sample() {
    let set = fixture("facade");
    let painted: Vec<u8> =
        (0..256 * 256u32).map(|i| if i % 256 < 64 && i / 256 >= 192 { 255 } else { 0 }).collect();
    let painted = Raster::from_u8(256, 256, 1, ColorSpace::Linear, &painted).unwrap();
    let weights =
        texfold::vq::GuidanceWeights { usability: 0.1, saliency: 0.1, distortion: 0.0, painted: 10.0 };
    let params = VqParams::default().with_codebook((128, 64)).with_samples((1, 64)).with_weights(weights);
    let source = VqSource { painted: Some(&painted), ..VqSource::new(&set) };
    let texture = Vq::encode(source, &params, &mut Job::default()).unwrap();
    let part = texture.samples()[0];
    assert!(part.source_x <= 16 && part.source_y >= 176, "{part:?}");
}

#[test]
fn importance_moves_error_away_from_what_matters() {
    let set = fixture("salient");
    let error = |importance: f32| {
        let params = VqParams::default()
            .with_codebook((64, 32))
            .with_samples((0, 0))
            .with_importance(importance)
            .with_content(Content::Raw);
        let texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
        let decoded = decode_image(&texture, 0, 0).unwrap();
        let map = texfold_vq_saliency(&set.images()[0]);
        salient_error(&set.images()[0], &decoded, &map)
    };
    let (even, weighted) = (error(0.0), error(2.0));
    assert!(weighted < 0.97 * even, "{weighted} {even}");
}

fn texfold_vq_saliency(image: &Raster) -> Vec<f32> {
    texfold_vq::saliency_map(image).iter().copied().collect()
}

/// Mean squared error of the most salient quarter.
fn salient_error(source: &Raster, decoded: &Raster, saliency: &[f32]) -> f64 {
    let mut sorted = saliency.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let threshold = sorted[sorted.len() / 4];
    let errors: Vec<f64> = source
        .texels()
        .zip(decoded.texels())
        .zip(saliency)
        .filter(|(_, saliency)| **saliency >= threshold)
        .map(|((a, b), _)| f64::from((a - b).truncate().length_squared()))
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn a_tolerance_holds_for_every_block() {
    for name in ["facade", "text_page", "stripes"] {
        let set = fixture(name);
        let settings = EncodeSettings {
            codec: Choice::of::<Vq>(),
            goal: Goal::Tolerance(16.0),
            ..EncodeSettings::default()
        };
        let texture = encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
        let worst = quality(&set, texture.as_encoded()).worst_block_rms;
        assert!(worst <= 16.0, "{name}: {worst}");
    }
}

#[test]
fn a_size_goal_is_never_exceeded() {
    for name in ["facade", "gray", "cutout", "odd_37x61"] {
        for bpp in [1.5, 2.5, 6.0] {
            for codec in [Choice::auto(), Choice::of::<Epitome>()] {
                let set = fixture(name);
                let goal = Goal::Bpp(bpp);
                let settings = EncodeSettings {
                    codec: codec.clone(),
                    goal,
                    effort: Effort::Fast,
                    ..EncodeSettings::default()
                };
                let made = encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
                let memory = made.as_encoded().memory();
                let bits = memory.goal as f64 / set.texel_count() as f64;
                assert!(bits <= bpp, "{name}, {codec:?}: {bits} of {bpp}");
                assert_eq!(memory, made.as_encoded().gpu().memory(), "{name}, {codec:?}");
            }
        }
    }
}

#[test]
fn unlike_images_share_a_codebook() {
    let named = texfold_testkit::image;
    let set =
        ImageSet::new(vec![named("odd_37x61"), named("gray"), named("odd_3x5"), named("odd_37x61")]).unwrap();
    let texture = vq(&set, &VqParams::default().with_goal(Goal::Bpp(6.0)));
    assert_eq!(texture.as_encoded().layout().images.len(), 4);
    assert_eq!(decode_image(texture.as_encoded(), 0, 0), decode_image(texture.as_encoded(), 3, 0));
    assert!(quality(&set, texture.as_encoded()).color.psnr() > 24.0);
}

#[test]
fn mip_levels_are_those_of_the_source() {
    let set = fixture("facade");
    let params = VqParams::default().with_goal(Goal::Bpp(6.0)).with_mips(true);
    let factored = EpitomeParams::new(Goal::Psnr(30.0)).with_mips(true).with_effort(Effort::Fast);
    let textures = [
        vq(&set, &params),
        bc(&set, &BcParams::default().with_goal(Goal::Bpp(6.0)).with_mips(true)),
        epitome(&set, &factored),
    ];
    let chain = texfold::core::image::mip_chain(&set.images()[0], 9, texfold::core::image::MipFilter::Box);
    for texture in textures {
        let name = texture.as_encoded().codec().name;
        assert_eq!(texture.as_encoded().layout().levels, 9);
        for (level, source) in chain.iter().enumerate().take(6) {
            let decoded = decode_image(texture.as_encoded(), 0, level as u32).unwrap();
            let psnr = texfold::core::metric::color_error(source, &decoded).psnr();
            assert!(psnr > 22.0, "{name} level {level}: {psnr}");
        }
    }
}

#[test]
fn progress_is_monotone_and_ends_at_one() {
    let set = fixture("gray");
    let mut seen: Vec<Stage> = Vec::new();
    let mut sink = |stage: Stage| seen.push(stage);
    let mut job = Job::default().with_progress(&mut sink);
    encode_images(&set, Guidance::default(), &EncodeSettings::default(), &mut job).unwrap();
    assert!(seen.windows(2).all(|pair| pair[0].done <= pair[1].done), "{seen:?}");
    assert_eq!(seen.last().map(|stage| stage.done), Some(1.0));
}

#[test]
fn a_cancelled_encode_stops() {
    let cancel = texfold::Cancel::default();
    cancel.cancel();
    let mut job = Job::default().with_cancel(&cancel);
    let outcome = encode_images(&fixture("gray"), Guidance::default(), &EncodeSettings::default(), &mut job);
    assert!(matches!(outcome, Err(EncodeError::Cancelled)));
}

#[test]
fn parameters_out_of_range_are_named() {
    let set = fixture("gray");
    let field = |params: VqParams| match Vq::encode(VqSource::new(&set), &params, &mut Job::default()) {
        Err(EncodeError::Params(error)) => error.field,
        other => panic!("{:?}", other.map(|_| ())),
    };
    assert_eq!(field(VqParams::default().with_codebook((512, 64))), "codebook");
    assert_eq!(field(VqParams::default().with_codebook((30, 64))), "codebook");
    assert_eq!(field(VqParams::default().with_samples((1, 7))), "samples");
    assert_eq!(field(VqParams::default().with_goal(Goal::Bpp(-1.0))), "bpp");
    assert_eq!(field(VqParams::default().with_importance(f32::NAN)), "importance");
    assert_eq!(field(VqParams::default().with_content(Content::Bc3)), "content");
    let field =
        |params: EpitomeParams| match Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default())
        {
            Err(EncodeError::Params(error)) => error.field,
            other => panic!("{:?}", other.map(|_| ())),
        };
    assert_eq!(field(EpitomeParams::new(Goal::Psnr(f64::NAN))), "psnr");
    assert_eq!(field(EpitomeParams::default().with_block(10)), "block");
    assert_eq!(field(EpitomeParams::default().with_content(Content::Bc5)), "channels");
}

#[test]
fn regions_outside_are_named() {
    let texture = vq(&frames("ripple"), &VqParams::default().with_codebook((32, 32)));
    let texture = texture.as_encoded();
    let rect = Rect { image: 0, level: 0, x: 30, y: 0, width: 20, height: 1 };
    let mut out = [Texel::ZERO; 20];
    assert_eq!(texture.decode(rect, &mut out), Err(RegionError::Outside { width: 40, height: 28 }));
    let image = Rect { image: 9, x: 0, ..rect };
    assert_eq!(texture.decode(image, &mut out), Err(RegionError::NoSuchImage { image: 9, images: 5 }));
    let short = texture.decode(Rect { x: 0, ..rect }, &mut out[..3]);
    assert_eq!(short, Err(RegionError::OutputLength { found: 3, needed: 20 }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn a_region_is_its_samples(x in 0u32..37, y in 0u32..61, width in 0u32..40, height in 0u32..64, level in 0u32..7) {
        {
            for (name, _, texture) in small_textures() {
                let texture = texture.as_encoded();
                let level = level % texture.layout().levels;
                let whole = texture.layout().whole(0, level).unwrap();
                let (x, y) = (x % whole.width, y % whole.height);
                let rect = Rect { image: 0, level, x, y, width: width.min(whole.width - x), height: height.min(whole.height - y) };
                let mut out = vec![Texel::ZERO; (rect.width * rect.height) as usize];
                texture.decode(rect, &mut out).unwrap();
                for (index, texel) in out.iter().enumerate() {
                    let at = ImageAddress { image: 0, level, x: x + index as u32 % rect.width, y: y + index as u32 / rect.width };
                    assert_eq!(*texel, texture.texel(at), "{name} {at:?}");
                }
            }
        }
    }
}

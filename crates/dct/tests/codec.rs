//! What the codec promises: goals, mip levels, layers, sets, every kind of pixel, forged files.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, MipFilter, PixelInfo, Raster, mip_chain};
use texfold_core::metric::{alpha_error, color_error, decode_image, measure, quality};
use texfold_core::rng::Rng;
use texfold_core::{
    Budget, Domain, Effort, Encoded, Encoder, Goal, Image2d, Job, Layers, Rect, Refine, Texel, TextureCodec,
};
use texfold_dct::{Dct, DctImages, DctParams};

fn image(name: &str) -> ImageSet {
    ImageSet::single(texfold_testkit::image(name))
}

fn encode(set: &ImageSet, params: &DctParams) -> DctImages {
    Dct::encode(set, params, &mut Job::default()).unwrap()
}

fn to(goal: Goal) -> DctParams {
    DctParams::default().with_goal(goal)
}

fn bytes(texture: &DctImages) -> Vec<u8> {
    let mut writer = SectionWriter::new(Dct::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

fn load(bytes: &[u8]) -> DctImages {
    let mut budget = Budget::default();
    Dct::load(&Sections::parse(bytes, &mut budget).unwrap(), &mut budget).unwrap()
}

#[test]
fn goals_are_met_and_little_more() {
    let set = image("terrain");
    for psnr in [28.0, 34.0, 40.0] {
        let texture = encode(&set, &to(Goal::Psnr(psnr)));
        let found = measure(&set, &texture);
        assert!((0.0..0.1).contains(&(found.psnr - psnr)), "{psnr}: {found:?}");
    }
    for bpp in [0.5, 1.0, 2.0, 4.0, 6.0] {
        let texture = encode(&set, &to(Goal::Bpp(bpp)));
        let found = measure(&set, &texture);
        assert!(found.bpp <= bpp && found.bpp > 0.97 * bpp, "{bpp}: {found:?}");
        // What is counted is what is held, and what the file has beside its notes and sections.
        assert_eq!(texture.memory(), texture.gpu().memory());
        let file = 8.0 * bytes(&texture).len() as f64 / set.texel_count() as f64;
        assert!(file > found.bpp && file < found.bpp + 0.1, "{file} {found:?}");
    }
    for tolerance in [24.0, 8.0] {
        let found = measure(&set, &encode(&set, &to(Goal::Tolerance(tolerance))));
        assert!(found.worst_block_rms <= tolerance, "{tolerance}: {found:?}");
    }
}

#[test]
fn the_nearest_is_given_where_no_step_meets_the_goal() {
    let tiny = ImageSet::single(texfold_testkit::image("odd_37x61"));
    let texture = encode(&tiny, &to(Goal::Psnr(200.0)));
    assert!(texture.notes().verdict.contains("out of reach"), "{}", texture.notes().verdict);
}

#[test]
fn every_level_is_as_good_as_the_goal_asks_and_all_cost_little() {
    for name in ["terrain", "facade", "salient"] {
        let set = image(name);
        let texture = encode(&set, &to(Goal::Psnr(36.0)).with_mips(true));
        let levels = set.full_levels();
        assert_eq!(texture.layout().levels, levels);
        let chain = mip_chain(&set.images()[0], levels, MipFilter::Box);
        for (level, wanted) in chain.iter().enumerate() {
            let decoded = decode_image(&texture, 0, level as u32).unwrap();
            let psnr = color_error(wanted, &decoded).psnr();
            assert!(psnr > 33.0, "{name}, level {level}: {psnr}");
        }
        let alone = encode(&set, &to(Goal::Psnr(36.0)));
        let ratio = measure(&set, &texture).bpp / measure(&set, &alone).bpp;
        assert!(ratio < 1.1, "{name}: {ratio}");
    }
}

#[test]
fn a_prefix_is_a_soft_image_and_takes_the_rest_as_it_arrives() {
    let set = image("terrain");
    let texture = encode(&set, &to(Goal::Psnr(36.0)).with_mips(true));
    let file = bytes(&texture);
    let has_base = |length: &usize| {
        Sections::parse(&file[..*length], &mut Budget::default()).is_ok_and(|part| part.has(*b"RBB0"))
    };
    let end = (0..file.len()).find(has_base).unwrap();
    assert!(end < file.len() / 6, "{end} of {}", file.len());
    let mut loaded = load(&file[..end]);
    assert_eq!(loaded.layers(), Layers { loaded: 1, total: 2 });
    assert!(loaded == texture.first_layers(1));
    let psnr = measure(&set, &loaded).psnr;
    assert!(psnr > 18.0 && psnr < 30.0, "{psnr}");
    let noted = f64::from(texture.notes().psnr_without[0].1);
    assert!((noted - psnr).abs() < 1e-3, "{noted} {psnr}");
    let mut budget = Budget::default();
    let whole = Sections::parse(&file, &mut budget).unwrap();
    assert_eq!(loaded.refine(&whole, &mut budget).unwrap(), ["base", "residual plane"]);
    assert!(loaded == texture && loaded.refine(&whole, &mut budget).unwrap().is_empty());
}

#[test]
fn every_kind_of_pixel_is_stored() {
    let size = (45u32, 30u32);
    for channels in 1..=4u8 {
        for depth in [Depth::Eight, Depth::Sixteen] {
            let count = size.0 * size.1 * u32::from(channels);
            let value =
                |i: u32| (0.5 + 0.4 * (i as f32 / 37.0).sin() * (i as f32 / 911.0).cos()).clamp(0.0, 1.0);
            let alpha = if channels % 2 == 0 { Alpha::Straight } else { Alpha::Opaque };
            let info = PixelInfo { channels, depth, color: ColorSpace::Srgb, alpha };
            let raster = Raster::new(size.0, size.1, info, (0..count).map(value).collect()).unwrap();
            let set = ImageSet::single(raster);
            let texture = encode(&set, &to(Goal::Psnr(38.0)));
            assert!(measure(&set, &texture).psnr >= 38.0, "{channels} {depth:?}");
            let loaded = load(&bytes(&texture));
            assert!(loaded == texture && loaded.layout().pixel == info);
            let rect = Rect { image: 0, level: 0, x: 5, y: 3, width: 21, height: 18 };
            let mut part = vec![Texel::ZERO; 21 * 18];
            loaded.decode(rect, &mut part).unwrap();
            for (index, texel) in part.into_iter().enumerate() {
                assert_eq!(texel, loaded.texel(<Image2d as Domain>::address(rect, index)));
            }
        }
    }
}

#[test]
fn gradients_of_16_bits_have_more_steps_than_8_bits_have() {
    let info = PixelInfo { channels: 1, depth: Depth::Sixteen, ..PixelInfo::default() };
    let data: Vec<f32> = (0..128 * 128).map(|i| 0.5 + (i % 128) as f32 / 128.0 / 64.0).collect();
    let set = ImageSet::single(Raster::new(128, 128, info, data).unwrap());
    let texture = encode(&set, &to(Goal::Bpp(4.0)));
    let decoded = decode_image(&texture, 0, 0).unwrap();
    let steps: std::collections::BTreeSet<u32> = decoded.values().map(f32::to_bits).collect();
    assert!(steps.len() > 60, "{} steps of 4 that 8 bits have", steps.len());
}

#[test]
fn images_of_a_set_share_a_step() {
    let names = ["terrain", "facade", "odd_37x61"];
    let set = ImageSet::new(names.map(texfold_testkit::image).to_vec()).unwrap();
    let texture = encode(&set, &to(Goal::Bpp(1.5)).with_mips(true));
    let found = measure(&set, &texture);
    assert!(found.bpp <= 1.5 && found.bpp > 1.47, "{found:?}");
    let images = texture.content().stages();
    let steps: Vec<u16> = images.iter().map(|image| image.form().quantiser.step).collect();
    // Stages of two images of 256x256 texels, and of one of 37x61: each is finer than the one before.
    let (first, second, third) = (steps[0], steps[1], steps[2]);
    assert_eq!(steps, [first, second, third, first, second, third, first, second]);
    assert!(third < second && second < first);
}

#[test]
fn alpha_is_coded_like_a_channel() {
    let opaque = texfold_testkit::image("terrain").with_channels(4);
    let texel = |(i, texel): (usize, Texel)| texel.truncate().extend((i % 256) as f32 / 255.0);
    let info = PixelInfo { channels: 4, alpha: Alpha::Straight, ..opaque.info() };
    let texels: Vec<Texel> = opaque.texels().enumerate().map(texel).collect();
    let set = ImageSet::single(Raster::from_texels(256, 256, info, &texels).unwrap());
    let texture = encode(&set, &to(Goal::Bpp(1.0)));
    let quality = quality(&set, &texture);
    assert!(quality.alpha.unwrap().psnr() > 40.0, "{quality:?}");
    let decoded = decode_image(&texture, 0, 0).unwrap();
    assert!(alpha_error(&set.images()[0], &decoded).is_some());
}

#[test]
fn more_bits_are_never_worse() {
    for name in ["terrain", "salient", "noise"] {
        let set = image(name);
        let mut before = 0.0;
        for step in 0..12 {
            let bpp = 0.2 * 1.3f64.powi(step);
            let found = measure(&set, &encode(&set, &to(Goal::Bpp(bpp)).with_effort(Effort::Fast)));
            assert!(found.psnr > before, "{name} at {bpp}: {found:?} after {before}");
            before = found.psnr;
        }
    }
}

#[test]
fn forged_files_decode_or_are_refused() {
    let set = image("odd_37x61");
    let texture = encode(&set, &to(Goal::Bpp(2.0)).with_mips(true));
    let mut rng = Rng::new(11);
    let (mut opened, mut refused) = (0, 0);
    for _ in 0..300 {
        // Past the checksums: sections are written again with damaged bytes.
        let mut out = SectionWriter::new(Dct::ID);
        texture.notes().write(&mut out);
        texfold_core::container::write_layout(texture.layout(), &mut out);
        let mut parts: Vec<Vec<u8>> = vec![Vec::new(), Vec::new()];
        for image in texture.content().stages() {
            parts[0].extend(image.base_bytes());
            parts[1].extend(image.detail_bytes());
        }
        for _ in 0..1 + rng.below(6) {
            let part = &mut parts[rng.below(2) as usize];
            let at = rng.below(part.len() as u32) as usize;
            part[at] = rng.below(256) as u8;
        }
        out.section("base", *b"RBB0", &parts[0]);
        out.section("residual plane", *b"RBD0", &parts[1]);
        let bytes = out.finish().bytes;
        let mut budget = Budget::default();
        let file = Sections::parse(&bytes, &mut budget).unwrap();
        match Dct::load(&file, &mut budget) {
            Ok(forged) => {
                opened += 1;
                for level in 0..forged.layout().levels {
                    let _ = decode_image(&forged, 0, level).unwrap();
                }
                let _ = (forged.gpu(), forged.footprint());
            }
            Err(_) => refused += 1,
        }
    }
    assert!(opened > 30 && refused > 30, "{opened} {refused}");
}

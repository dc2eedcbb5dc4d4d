//! What is encoded comes back: quality, size, determinism, and images that the method does not suit.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{encode, facade, file, load};
use glam::Vec2;
use texfold_bc::{Bc, Bc1Blocks, BcParams, Content, ContentPlanes};
use texfold_core::image::{ColorSpace, ImageSet, PixelInfo, Raster};
use texfold_core::metric::{decode_image, measure};
use texfold_core::{
    Access, Domain, Effort, EncodeError, Encoded, Encoder, Footprint, Goal, Image2d, ImageSize, Job, Limits,
    PlaneFormat, Rect, SharedSearch, SourceError, Texel,
};
use texfold_epitome::decode::texfold_epitome_bilinear;
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, ToleranceKind, worst_relative_error};
use texfold_testkit::image;

fn goal(goal: Goal) -> EpitomeParams {
    EpitomeParams::new(goal).with_access(Access::Texel).with_effort(Effort::Fast)
}

/// A 64x64 part of an image, 4 x 4 times.
fn tiles() -> ImageSet {
    let image = image("facade");
    let texel = |i: u32| image.texel(40 + i % 256 % 64, 40 + i / 256 % 64);
    let texels: Vec<Texel> = (0..256 * 256).map(texel).collect();
    ImageSet::single(Raster::from_texels(256, 256, image.info(), &texels).unwrap())
}

#[test]
fn a_file_comes_back_as_it_was() {
    let set = ImageSet::new(vec![image("facade"), image("odd_37x61")]).unwrap();
    for mips in [false, true] {
        let texture = encode(&set, &goal(Goal::Psnr(32.0)).with_mips(mips));
        let bytes = file(&texture);
        let loaded = load(&bytes).unwrap();
        assert!(loaded == texture);
        assert_eq!(file(&loaded), bytes);
        assert!(measure(&set, &loaded).psnr >= 32.0);
        let footprint = Footprint::measure(&loaded, &loaded.gpu());
        assert_eq!(footprint.bits_disk(), 8 * bytes.len() as u64);
        assert_eq!(loaded.footprint().bits_memory(), loaded.memory().compressed);
    }
}

#[test]
fn regions_are_their_samples() {
    let set = ImageSet::new(vec![image("text_page"), image("odd_37x61")]).unwrap();
    let texture = encode(&set, &goal(Goal::Psnr(30.0)).with_mips(true));
    for image in 0..2 {
        for level in 0..texture.layout().levels {
            let whole = texture.layout().whole(image, level).unwrap();
            let rect = Rect { x: whole.width / 3, width: whole.width - whole.width / 3, ..whole };
            let mut texels = vec![Texel::ZERO; (rect.width * rect.height) as usize];
            texture.decode(rect, &mut texels).unwrap();
            for (index, texel) in texels.iter().enumerate() {
                let at = Image2d::address(rect, index);
                assert_eq!(*texel, texture.texel(at), "{at:?}");
            }
        }
    }
}

#[test]
fn exact_repetition_costs_one_tile_and_a_map() {
    let set = tiles();
    for (content, bits) in [(Content::Raw, 24), (Content::Bc1, 4), (Content::Bc7, 8)] {
        let plain = BcParams::default().with_goal(Goal::Psnr(99.0)).with_content(content);
        let plain = measure(&set, &Bc::encode(&set, &plain, &mut Job::default()).unwrap()).psnr;
        let wanted = (plain - 0.05).min(60.0);
        let params = goal(Goal::Psnr(wanted)).with_content(content).with_effort(Effort::Normal);
        let texture = encode(&set, &params);
        assert!(measure(&set, &texture).psnr >= wanted, "{content:?}");
        let footprint = texture.footprint();
        let part =
            |name: &str| footprint.parts.iter().find(|part| part.name == name).map_or(0, |p| p.bits_memory);
        assert!(part("epitome") * 10 <= 11 * bits * 64 * 64, "{content:?}: {}", part("epitome"));
        // 64 blocks with a word and an entry each, the palettes, and what is left of the last row of words.
        assert!(part("map") <= 64 * (32 + 48) + 1024 + 2048, "{content:?}: {}", part("map"));
    }
}

#[test]
fn images_that_do_not_suit_are_correct_all_the_same() {
    let names = [
        "one_texel",
        "odd_3x5",
        "constant",
        "black",
        "ramp",
        "stripes",
        "zebra",
        "noise",
        "line_513x1",
        "column_1x259",
        "transparent",
        "cutout",
        "gray",
        "normal_map",
    ];
    for name in names {
        let image = image(name);
        let set = ImageSet::single(image.clone());
        let texture = encode(&set, &goal(Goal::Psnr(30.0)));
        let measured = measure(&set, &texture);
        // A block of random texels is beyond any block format.
        let plain = plain_psnr(&set);
        assert!(measured.psnr >= plain.min(30.0) - 0.1, "{name}: {measured:?}, plain {plain}");
        let decoded = decode_image(&texture, 0, 0).unwrap();
        assert!(decoded.texels().all(Texel::is_finite), "{name}");
        assert_eq!(decoded.size(), image.size(), "{name}");
    }
}

/// PSNR of the finest plain form of blocks.
fn plain_psnr(set: &ImageSet) -> f64 {
    let content = match set.info() {
        info if info.color == ColorSpace::Normal => Content::Bc5,
        info if info.channels == 1 => Content::Bc4,
        info if info.channels == 2 => Content::Bc5,
        _ => Content::Bc7,
    };
    let params = BcParams::default().with_goal(Goal::Psnr(99.0)).with_content(content);
    measure(set, &Bc::encode(set, &params, &mut Job::default()).unwrap()).psnr
}

#[test]
fn bits_within_a_budget() {
    let set = facade();
    let mut before = 0.0;
    for bpp in [1.0, 2.0, 3.0] {
        let measured = measure(&set, &encode(&set, &goal(Goal::Bpp(bpp))));
        assert!(measured.bpp <= bpp && measured.psnr > before, "{measured:?} within {bpp}");
        before = measured.psnr;
    }
}

#[test]
fn mip_levels_show_the_image() {
    for (name, goal_psnr, is_finer) in
        [("facade", 22.0, false), ("facade", 32.0, true), ("text_page", 32.0, false)]
    {
        let original = image(name).tagged(ColorSpace::Linear, texfold_core::image::Alpha::Opaque);
        let set = ImageSet::single(original);
        let texture = encode(&set, &goal(Goal::Psnr(goal_psnr)).with_mips(true));
        let form = texture.gpu();
        let coarse = form.planes.iter().find(|plane| plane.part == "mips").unwrap();
        assert_eq!(coarse.format == PlaneFormat::Bc7, is_finer, "{name}: {:?}", coarse.format);
        assert!(load(&file(&texture)).unwrap() == texture);
        let levels = texture.layout().levels;
        let decoded = decode_image(&texture, 0, 0).unwrap();
        let chain = texfold_core::image::mip_chain(&decoded, levels, texfold_core::image::MipFilter::Box);
        for (level, wanted) in (0..levels).zip(&chain) {
            let found = decode_image(&texture, 0, level).unwrap();
            assert_eq!(found.size(), wanted.size());
            let psnr = texfold_core::metric::color_error(wanted, &found).psnr();
            let least = if level == 0 { 60.0 } else { goal_psnr.min(30.0) };
            assert!(psnr >= least, "{name}, level {level}: {psnr}");
        }
    }
}

#[test]
fn every_block_is_within_the_tolerance() {
    for name in ["facade", "tile_repeat", "ramp", "noise", "odd_37x61"] {
        let set = ImageSet::single(image(name));
        let mut before = f64::INFINITY;
        for tolerance in [4.0, 10.0, 25.0] {
            let measured = measure(&set, &encode(&set, &goal(Goal::Tolerance(tolerance))));
            assert!(measured.worst_block_rms <= tolerance, "{name}: {measured:?} for {tolerance}");
            assert!(measured.bpp <= before * 1.02, "{name}: {measured:?} for {tolerance} after {before}");
            before = measured.bpp;
        }
    }
}

#[test]
fn every_block_is_within_a_relative_tolerance() {
    for (name, block) in [("facade", None), ("floor", Some(20)), ("ramp", Some(8)), ("odd_37x61", None)] {
        let set = ImageSet::single(image(name));
        let mut before = f64::INFINITY;
        for tolerance in [0.001, 0.003, 0.01] {
            let params = goal(Goal::Tolerance(tolerance)).with_tolerance_kind(ToleranceKind::Relative);
            let params = params.with_block(block);
            let texture = encode(&set, &params);
            let worst = worst_relative_error(&set, &texture, params.tolerance_block());
            assert!(worst <= tolerance, "{name}: {worst} for {tolerance}");
            let bpp = measure(&set, &texture).bpp;
            assert!(bpp <= before * 1.02, "{name}: {bpp} for {tolerance} after {before}");
            before = bpp;
        }
        // Something is shared at last, so that the bound was tested.
        assert!(before < 23.0 || name == "odd_37x61", "{name}: {before}");
    }
}

#[test]
fn blocks_of_every_side_cover_the_image() {
    let set = facade();
    for block in [8, 12, 16, 20, 28] {
        let params = goal(Goal::Tolerance(8.0)).with_block(block);
        let texture = encode(&set, &params);
        assert_eq!(texture.map_format().block, block);
        assert!(measure(&set, &texture).worst_block_rms <= 8.0, "block {block}");
        assert!(load(&file(&texture)).unwrap() == texture);
    }
}

#[test]
fn one_search_serves_several_goals() {
    let set = facade();
    let params = goal(Goal::Psnr(32.0));
    let search = Epitome::search(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    let mut before = 0.0;
    for psnr in [26.0, 29.0, 32.0, 35.0] {
        let texture = Epitome::encode_from(&search, Goal::Psnr(psnr), &mut Job::default()).unwrap();
        let measured = measure(&set, &texture);
        assert!(measured.psnr >= psnr && measured.bpp > before, "{measured:?} for {psnr}");
        before = measured.bpp;
    }
    let alone = encode(&set, &params);
    let shared = Epitome::encode_from(&search, Goal::Psnr(32.0), &mut Job::default()).unwrap();
    assert!(alone == shared);
}

#[test]
fn content_comes_from_the_mask_alone() {
    let image = image("facade");
    let set = ImageSet::single(image.clone());
    let inside = |i: u32| i % 256 < 128 && i / 256 < 128;
    let mask: Vec<u8> = (0..256 * 256).map(|i| if inside(i) { 255 } else { 0 }).collect();
    let mask = Raster::from_u8(256, 256, 1, ColorSpace::Linear, &mask).unwrap();
    let source = EpitomeSource { images: &set, content_from: Some(&mask), ..EpitomeSource::new(&set) };
    let params = goal(Goal::Psnr(34.0)).with_content(Content::Raw);
    let texture = Epitome::encode(source, &params, &mut Job::default()).unwrap();
    let cells: u32 = texture.epitomes().map(|epitome| epitome.size().0 * epitome.size().1).sum();
    // At most the mask's content at every scale.
    assert!(cells <= 128 * 128 * 49 / 16, "{cells} texels");
    let decoded = decode_image(&texture, 0, 0).unwrap();
    let part = |raster: &Raster, keep: bool| {
        let texels: Vec<Texel> =
            (0..256 * 256).filter(|&i| inside(i) == keep).map(|i| raster.texel(i % 256, i / 256)).collect();
        Raster::from_texels(texels.len() as u32, 1, raster.info(), &texels).unwrap()
    };
    let psnr =
        |keep: bool| texfold_core::metric::color_error(&part(&image, keep), &part(&decoded, keep)).psnr();
    // The facade's windows repeat: what lies outside is made of what lies inside, and looks like it.
    assert!(psnr(true) > 30.0 && psnr(false) > 15.0, "{} {}", psnr(true), psnr(false));
    let small = Raster::from_u8(2, 2, 1, ColorSpace::Linear, &[255; 4]).unwrap();
    let source = EpitomeSource { images: &set, content_from: Some(&small), ..EpitomeSource::new(&set) };
    let error = Epitome::encode(source, &params, &mut Job::default()).unwrap_err();
    assert!(error.to_string().contains("content mask"), "{error}");
}

#[test]
fn long_lines_and_unlike_sets() {
    let line: Vec<u8> = (0..4097 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let line = Raster::from_u8(4097, 1, 3, ColorSpace::Srgb, &line).unwrap();
    let set = ImageSet::new(vec![line, image("noise"), image("odd_3x5"), image("constant")]).unwrap();
    let texture = encode(&set, &goal(Goal::Psnr(28.0)));
    let (psnr, plain) = (measure(&set, &texture).psnr, plain_psnr(&set));
    assert!(psnr >= plain.min(28.0) - 0.1, "{psnr}, plain {plain}");
    assert!(load(&file(&texture)).unwrap() == texture);
}

#[test]
fn blocks_that_are_bc1_already_are_taken_over() {
    let image = image("odd_37x61");
    let ImageSize { width, height } = image.size();
    let texels: Vec<Texel> = image.texels().collect();
    let planes = ContentPlanes::encode(Content::Bc1, image.info(), (width, height), &texels, Effort::Fast);
    let blocks = vec![Bc1Blocks { size: image.size(), blocks: planes.planes()[0].1.clone() }];
    let decoded = Raster::from_texels(width, height, image.info(), &planes.decode()).unwrap();
    let set = ImageSet::single(decoded);
    let source = EpitomeSource { blocks: Some(&blocks), ..EpitomeSource::new(&set) };
    let texture = Epitome::encode(source, &goal(Goal::Psnr(60.0)), &mut Job::default()).unwrap();
    // Encoding the texels anew would lose some of what fast blocks show; the blocks themselves lose nothing.
    let psnr = measure(&set, &texture).psnr;
    assert!(psnr > 120.0, "{psnr}");
    let whole = EpitomeSource::new(&set);
    let anew = Epitome::encode(whole, &goal(Goal::Psnr(60.0)), &mut Job::default()).unwrap();
    assert!(texture.memory().compressed <= anew.memory().compressed);
    let short = vec![Bc1Blocks { size: image.size(), blocks: vec![0; 8] }];
    let source = EpitomeSource { blocks: Some(&short), ..EpitomeSource::new(&set) };
    let error = Epitome::encode(source, &goal(Goal::Psnr(60.0)), &mut Job::default()).unwrap_err();
    assert!(matches!(error, EncodeError::Source(SourceError::Length { found: 8, .. })), "{error}");
}

/// A tile 4x4 times, each time with a noise of its own of that many steps at most.
fn noisy_tiles(most: u32) -> Raster {
    const SIDE: u32 = 128;
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 16) % (2 * most + 1)
    };
    let wave = |at: u32, times: f32| (at as f32 * times * std::f32::consts::TAU / 32.0).sin();
    let tile =
        |x: u32, y: u32| (115.0 + 40.0 * wave(x, 1.0) * wave(y, 2.0) + 30.0 * wave(x + 2 * y, 3.0)) as u32;
    let bytes: Vec<u8> = (0..SIDE * SIDE)
        .flat_map(|i| {
            let value = tile(i % SIDE % 32, i / SIDE % 32);
            [value, value / 2 + 40, 230 - value].map(|value| (value + noise() - most) as u8)
        })
        .collect();
    Raster::from_u8(SIDE, SIDE, 3, ColorSpace::Srgb, &bytes).unwrap()
}

#[test]
fn content_is_fitted_to_all_who_read_it() {
    // Noise of -12 to 12 has a variance of 52. A reader of another tile sees that tile's noise and lacks its own,
    // which is 28 dB; a reader of the mean of all lacks its own only, which is 31 dB. With content as it is 8.7 bits
    // a texel are needed.
    let set = ImageSet::single(noisy_tiles(12));
    let params = goal(Goal::Psnr(30.0)).with_content(Content::Raw);
    let measured = measure(&set, &encode(&set, &params));
    assert!(measured.psnr >= 30.0 && measured.bpp < 7.0, "{measured:?}");
}

#[test]
fn a_set_of_one_scene_costs_less_than_its_images() {
    let whole = image("facade");
    let part = |left: u32| {
        let texels: Vec<Texel> = (0..192 * 192).map(|i| whole.texel(left + i % 192, 40 + i / 192)).collect();
        Raster::from_texels(192, 192, whole.info(), &texels).unwrap()
    };
    // The second photograph is the first one, 37 texels to the right.
    let params = goal(Goal::Psnr(32.0)).with_effort(Effort::Normal);
    let bits = |images: Vec<Raster>| {
        let set = ImageSet::new(images).unwrap();
        encode(&set, &params).memory().compressed as f64
    };
    let alone = bits(vec![part(0)]) + bits(vec![part(37)]);
    let together = bits(vec![part(0), part(37)]);
    assert!(together < 0.75 * alone, "{together} against {alone}");
}

/// Discs of one pattern, each rotated by its own angle.
fn rotated_discs() -> Raster {
    const SIDE: u32 = 192;
    let texel = |x: u32, y: u32| {
        let (disc, place) = ((x / 48, y / 48), (x % 48, y % 48));
        let at = (place.0 as f32 - 23.5, place.1 as f32 - 23.5);
        let (sin, cos) = ((disc.1 * 4 + disc.0) as f32 * 1.7).sin_cos();
        let (u, v) = (at.0 * cos + at.1 * sin, at.1 * cos - at.0 * sin);
        let wave = 0.5 + 0.2 * (0.4 * u).sin() + 0.15 * (0.3 * v + 0.1 * u * u.signum()).cos() + 0.006 * u;
        // Soft borders: hard ones are stairs that differ with the angle.
        let inside = ((23.0 - at.0.hypot(at.1)) / 8.0).clamp(0.0, 1.0);
        Texel::new(0.3, 0.35, 0.3, 1.0).lerp(Texel::new(wave, 0.9 * wave, 1.0 - wave, 1.0), inside)
    };
    let texels: Vec<Texel> = (0..SIDE * SIDE).map(|i| texel(i % SIDE, i / SIDE)).collect();
    Raster::from_texels(SIDE, SIDE, PixelInfo { channels: 3, ..image("facade").info() }, &texels).unwrap()
}

#[test]
fn what_is_rotated_is_stored_once_within_a_tolerance() {
    let set = ImageSet::single(rotated_discs());
    let params = goal(Goal::Tolerance(6.0)).with_effort(Effort::Normal);
    let texture = encode(&set, &params);
    assert!(measure(&set, &texture).worst_block_rms <= 6.0);
    let share = texture.memory().compressed as f64 / (24.0 * f64::from(192 * 192));
    assert!(share < 0.45, "{share}");
}

/// Mean step between neighbours across borders of 8x8 blocks, over the mean step elsewhere.
fn blockiness(at: impl Fn(u32, u32) -> Texel, side: u32, block: u32) -> f32 {
    let (mut border, mut inner) = ((0.0, 0u32), (0.0, 0u32));
    for y in 0..side {
        for x in 1..side {
            let step = (at(x, y) - at(x - 1, y)).truncate().length();
            let sum = if x % block == 0 { &mut border } else { &mut inner };
            *sum = (sum.0 + step, sum.1 + 1);
        }
    }
    (border.0 / border.1 as f32) / (inner.0 / inner.1 as f32)
}

#[test]
fn magnified_images_hardly_show_blocks() {
    let image = image("terrain");
    let set = ImageSet::single(image.clone());
    let texture = encode(&set, &goal(Goal::Psnr(32.0)));
    let view = texture.view(0);
    // Three pixels a texel; a block's border falls between two pixels.
    let side = 3 * image.size().width.min(image.size().height);
    let uv = |x: u32, y: u32| {
        let size = Vec2::new(image.size().width as f32, image.size().height as f32);
        (Vec2::new(x as f32, y as f32) + 0.5) / 3.0 / size
    };
    let found = |x, y| texfold_epitome_bilinear(&view, uv(x, y), 0);
    let ratio = blockiness(found, side, 24);
    // 1 is the aim. Content at a fraction of its size ends flat at the leaf's edge, which leaves a trace of blocks.
    assert!(ratio <= 1.25, "{ratio}");
    let nearest = |x, y| texfold_epitome::decode::texfold_epitome_nearest(&view, uv(x, y), 0);
    assert!(blockiness(nearest, side, 24) > 1.5, "the measure sees nothing");
}

#[test]
fn images_are_drawn_as_place_by_place() {
    let set = ImageSet::new(vec![image("facade"), image("odd_37x61")]).unwrap();
    let blocks = goal(Goal::Tolerance(20.0)).with_block(20);
    for params in [goal(Goal::Psnr(24.0)), goal(Goal::Psnr(34.0)), blocks] {
        let texture = encode(&set, &params);
        let windows = [
            (0, Vec2::ZERO, Vec2::ONE, (256, 256)),
            (0, Vec2::new(0.31, 0.4), Vec2::new(0.1, 0.05), (97, 61)),
            (1, Vec2::new(-0.4, -0.1), Vec2::new(2.0, 1.3), (150, 150)),
        ];
        for (image, corner, extent, size) in windows {
            let drawn = texture.draw(image, corner, extent, size);
            let view = texture.view(image);
            for (index, texel) in (0u32..).zip(&drawn) {
                let at = Vec2::new((index % size.0) as f32, (index / size.0) as f32) + 0.5;
                let uv = corner + at * extent / Vec2::new(size.0 as f32, size.1 as f32);
                let wanted = texfold_epitome_bilinear(&view, uv, 0);
                // Places are rounded otherwise, which counts most where content is steep.
                assert!(
                    (*texel - wanted).abs().max_element() < 2e-3,
                    "{params:?}, {uv}: {texel} for {wanted}"
                );
            }
        }
        assert!(texture.draw(9, Vec2::ZERO, Vec2::ONE, (2, 1)) == [Texel::ZERO; 2]);
    }
}

#[test]
fn an_encode_that_needs_more_memory_than_allowed_is_refused() {
    let set = ImageSet::single(image("facade"));
    // Texels of 16 bytes at nine scales, three times the area of the first, as they are and from two formats.
    let needed = 256 * 256 * 16 * 49 / 16 * 3;
    let with = |bytes: u64| {
        let mut job = Job::new(Limits { bytes, ..Limits::default() });
        let result = Epitome::encode(EpitomeSource::new(&set), &goal(Goal::Psnr(24.0)), &mut job);
        (matches!(result, Err(EncodeError::Limit(_))), job.budget.peak_bytes())
    };
    assert_eq!(with(needed - 1), (true, 0));
    assert_eq!(with(needed), (false, needed));
}

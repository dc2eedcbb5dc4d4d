//! Epitomes in blocks of variable length: goals, what repetition is worth, every kind of pixel, files.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{encode, file, load};
use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, PixelInfo, Raster};
use texfold_core::metric::{decode_image, measure};
use texfold_core::{
    Access, Domain, Effort, EncodeError, Encoded, Goal, Image2d, Job, Metric, Rect, SourceError, Texel,
};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};
use texfold_testkit::image;

fn params(goal: Goal) -> EpitomeParams {
    EpitomeParams::new(goal).with_effort(Effort::Fast)
}

fn single(raster: Raster) -> ImageSet {
    ImageSet::single(raster)
}

#[test]
fn goals_are_met_and_files_come_back() {
    let set = ImageSet::new(vec![image("facade"), image("odd_37x61")]).unwrap();
    for (goal, mips) in [(Goal::Psnr(33.0), false), (Goal::Psnr(33.0), true), (Goal::Bpp(1.5), true)] {
        let texture = encode(&set, &params(goal).with_mips(mips));
        assert_eq!(texture.gpu().access(), Access::Block);
        assert!(
            goal.is_met(&measure(&set, &texture)),
            "{goal:?}, mips {mips}: {:?}",
            measure(&set, &texture)
        );
        let bytes = file(&texture);
        let loaded = load(&bytes).unwrap();
        assert!(loaded == texture && file(&loaded) == bytes);
        assert_eq!(loaded.footprint().bits_disk(), 8 * bytes.len() as u64);
        assert_eq!(loaded.footprint().bits_memory(), loaded.memory().compressed);
    }
}

/// A bound that content of its own for each tile cannot meet: a sixteenth, a seam of a block around each chart, and the map.
#[test]
fn what_repeats_is_stored_once() {
    let tile = image("facade");
    let texel = |i: u32| tile.texel(40 + i % 256 % 64, 40 + i / 256 % 64);
    let texels: Vec<Texel> = (0..256 * 256).map(texel).collect();
    let tiles = single(Raster::from_texels(256, 256, tile.info(), &texels).unwrap());
    let bits =
        |access: Access| measure(&tiles, &encode(&tiles, &params(Goal::Psnr(34.0)).with_access(access))).bpp;
    let (block, texel) = (bits(Access::Block), bits(Access::Texel));
    let once = single(Raster::from_texels(64, 64, tile.info(), &texels_of(&tile)).unwrap());
    let alone = measure(&once, &encode(&once, &params(Goal::Psnr(34.0)))).bpp / 16.0;
    assert!(block < texel, "{block} bits by block, {texel} by texel");
    assert!(block < 3.0 * alone, "{block} bits for sixteen tiles, {alone} for one");
}

#[test]
fn a_search_that_needs_shared_content_ends_where_none_recurs() {
    let shared = |name: &str, effort: Effort| {
        let (set, params) = (single(image(name)), params(Goal::Bpp(1.0)).with_effort(effort));
        Epitome::encode_shared(EpitomeSource::new(&set), &params, &mut Job::default())
    };
    for effort in [Effort::Fast, Effort::High] {
        let error = shared("noise", effort).unwrap_err();
        assert!(matches!(error, EncodeError::Source(SourceError::OutOfReach { .. })), "{effort:?}: {error}");
    }
    let alone = encode(&single(image("tile_repeat")), &params(Goal::Bpp(1.0)));
    assert!(shared("tile_repeat", Effort::Fast).unwrap() == alone);
}

fn texels_of(tile: &Raster) -> Vec<Texel> {
    (0..64 * 64).map(|i| tile.texel(40 + i % 64, 40 + i / 64)).collect()
}

#[test]
fn every_kind_of_pixel_is_kept() {
    let facade = image("facade");
    let infos = [
        PixelInfo { channels: 1, depth: Depth::Eight, color: ColorSpace::Linear, alpha: Alpha::Opaque },
        PixelInfo { channels: 2, depth: Depth::Eight, color: ColorSpace::Srgb, alpha: Alpha::Straight },
        PixelInfo { channels: 4, depth: Depth::Eight, color: ColorSpace::Srgb, alpha: Alpha::Straight },
        PixelInfo { channels: 3, depth: Depth::Sixteen, color: ColorSpace::Linear, alpha: Alpha::Opaque },
    ];
    for info in infos {
        let texel = |i: u32| {
            let texel = facade.texel(i % 96 + 20, i / 96 + 50);
            let gray = if info.channels < 3 { Texel::splat(texel.x) } else { texel };
            gray.with_w(if info.alpha == Alpha::Opaque { 1.0 } else { (i % 96) as f32 / 95.0 })
        };
        let texels: Vec<Texel> = (0..96 * 70).map(texel).collect();
        let set = single(Raster::from_texels(96, 70, info, &texels).unwrap());
        let texture = encode(&set, &params(Goal::Psnr(36.0)).with_mips(true));
        assert_eq!(texture.gpu().access(), Access::Block, "{info:?}");
        assert!(measure(&set, &texture).psnr >= 36.0, "{info:?}");
        let drawn = decode_image(&texture, 0, 0).unwrap();
        let worst = (0..96 * 70u32).map(|i| (drawn.texel(i % 96, i / 96).w - texels[i as usize].w).abs());
        assert!(worst.fold(0.0, f32::max) < 0.1, "{info:?}: alpha");
    }
}

#[test]
fn regions_are_their_samples() {
    let set = single(image("odd_37x61"));
    let texture = encode(&set, &params(Goal::Psnr(30.0)).with_mips(true));
    for level in 0..texture.layout().levels {
        let whole = texture.layout().whole(0, level).unwrap();
        let part = Rect { x: whole.width / 3, width: whole.width.div_ceil(2), ..whole };
        let mut out = vec![Texel::ZERO; Image2d::len(part)];
        texture.decode(part, &mut out).unwrap();
        for (index, texel) in out.into_iter().enumerate() {
            assert_eq!(texel, texture.texel(Image2d::address(part, index)), "level {level}, {index}");
        }
    }
}

#[test]
fn edges_of_what_there_can_be() {
    for (width, height) in [(1, 1), (3, 5), (513, 1), (1, 259)] {
        let texels: Vec<Texel> =
            (0..width * height).map(|i| Texel::splat((i % 7) as f32 / 6.0).with_w(1.0)).collect();
        let set = single(Raster::from_texels(width, height, image("facade").info(), &texels).unwrap());
        let texture = encode(&set, &params(Goal::Psnr(30.0)).with_mips(true));
        assert!(measure(&set, &texture).psnr >= 30.0, "{width}x{height}");
        assert!(load(&file(&texture)).unwrap() == texture);
    }
}

#[test]
fn planes_where_blocks_cannot_be() {
    let set = single(image("odd_37x61"));
    let planes = [
        params(Goal::Tolerance(12.0)),
        params(Goal::Psnr(28.0)).with_layers(2),
        params(Goal::Psnr(28.0)).with_access(Access::Texel),
    ];
    for params in planes {
        assert_eq!(encode(&set, &params).gpu().access(), Access::Texel, "{params:?}");
    }
}

#[test]
fn high_effort_takes_planes_where_they_are_smaller() {
    let set = single(image("odd_37x61"));
    let goal = Goal::Psnr(28.0);
    let high = params(goal).with_effort(Effort::High);
    let measured = |params: &EpitomeParams| measure(&set, &encode(&set, params));
    let [best, block, texel] =
        [high.clone(), params(goal), high.clone().with_access(Access::Texel)].map(|params| measured(&params));
    assert!(goal.is_met(&best));
    assert!(best.bpp <= block.bpp * 1.05 && best.bpp <= texel.bpp, "{best:?} {block:?} {texel:?}");
}

#[test]
fn metrics_spread_errors_otherwise() {
    let set = single(image("facade"));
    let made = |metric: Metric| encode(&set, &params(Goal::Bpp(1.0)).with_metric(metric));
    let [plain, seen] = [Metric::Psnr, Metric::Perceptual].map(|metric| measure(&set, &made(metric)).psnr);
    assert!(plain > seen, "{plain} dB, {seen} dB for the eye");
}

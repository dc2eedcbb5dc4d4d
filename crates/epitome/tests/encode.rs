//! What is encoded comes back: quality, size, determinism, and pictures that the method does not suit.

use texfold_bc::{Bc, BcParams, Content};
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::metric::{decode_surface, measure};
use texfold_core::{
    Budget, Effort, Encoded, Footprint, Goal, Image2d, Job, Rect, SurfaceSize, Texel, TextureCodec,
};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
use texfold_testkit::picture;

fn encode(images: &ImageSet, params: &EpitomeParams) -> EpitomeTexture {
    Epitome::encode(EpitomeSource::new(images), params, &mut Job::default()).unwrap()
}

fn goal(goal: Goal) -> EpitomeParams {
    EpitomeParams { goal, effort: Effort::Fast, ..EpitomeParams::default() }
}

fn file(texture: &EpitomeTexture) -> Vec<u8> {
    let mut writer = SectionWriter::new(Epitome::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

fn load(bytes: &[u8]) -> EpitomeTexture {
    let mut budget = Budget::default();
    let sections = Sections::parse(bytes, &mut budget).unwrap();
    Epitome::load(&sections, &mut budget).unwrap()
}

/// A 64x64 part of a picture, 4 x 4 times.
fn tiles() -> ImageSet {
    let picture = picture("facade");
    let texel = |i: u32| picture.texel(40 + i % 256 % 64, 40 + i / 256 % 64);
    let texels: Vec<Texel> = (0..256 * 256).map(texel).collect();
    ImageSet::single(Raster::from_texels(256, 256, picture.info(), &texels).unwrap())
}

#[test]
fn a_file_comes_back_as_it_was() {
    let set = ImageSet::new(vec![picture("facade"), picture("odd_37x61")]).unwrap();
    for mips in [false, true] {
        let texture = encode(&set, &EpitomeParams { mips, ..goal(Goal::Psnr(32.0)) });
        let bytes = file(&texture);
        let loaded = load(&bytes);
        assert!(loaded == texture);
        assert_eq!(file(&loaded), bytes);
        assert!(measure(&set, &loaded).psnr >= 32.0);
        let footprint = Footprint::measure(&loaded, &loaded.gpu());
        assert_eq!(footprint.bits_disk(), 8 * bytes.len() as u64);
        assert_eq!(loaded.footprint().bits_memory(), loaded.gpu().bits_memory());
    }
}

#[test]
fn regions_are_their_samples() {
    let set = ImageSet::new(vec![picture("text_page"), picture("odd_37x61")]).unwrap();
    let texture = encode(&set, &EpitomeParams { mips: true, ..goal(Goal::Psnr(30.0)) });
    for surface in 0..2 {
        for level in 0..texture.layout().levels {
            let whole = texture.layout().whole(surface, level).unwrap();
            let rect = Rect { x: whole.width / 3, width: whole.width - whole.width / 3, ..whole };
            let mut texels = vec![Texel::ZERO; (rect.width * rect.height) as usize];
            texture.decode(rect, &mut texels).unwrap();
            for (index, texel) in texels.iter().enumerate() {
                let at = <Image2d as texfold_core::Domain>::address(rect, index);
                assert_eq!(*texel, texture.sample(at), "{at:?}");
            }
        }
    }
}

#[test]
fn exact_repetition_costs_one_tile_and_a_map() {
    let set = tiles();
    for (content, bits) in [(Content::Raw, 24), (Content::Bc1, 4), (Content::Bc7, 8)] {
        let plain = BcParams { goal: Goal::Psnr(99.0), content: Some(content), ..BcParams::default() };
        let plain = measure(&set, &Bc::encode(&set, &plain, &mut Job::default()).unwrap()).psnr;
        let wanted = (plain - 0.05).min(60.0);
        let params =
            EpitomeParams { content: Some(content), effort: Effort::Normal, ..goal(Goal::Psnr(wanted)) };
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
fn pictures_that_do_not_suit_are_correct_all_the_same() {
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
        let image = picture(name);
        let set = ImageSet::single(image.clone());
        let texture = encode(&set, &goal(Goal::Psnr(30.0)));
        let measured = measure(&set, &texture);
        // A block of random texels is beyond any block format.
        let plain = plain_psnr(&set);
        assert!(measured.psnr >= plain.min(30.0) - 0.1, "{name}: {measured:?}, plain {plain}");
        let decoded = decode_surface(&texture, 0, 0).unwrap();
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
    let params = BcParams { goal: Goal::Psnr(99.0), content: Some(content), ..BcParams::default() };
    measure(set, &Bc::encode(set, &params, &mut Job::default()).unwrap()).psnr
}

#[test]
fn bits_within_a_budget() {
    let set = ImageSet::single(picture("facade"));
    let mut before = 0.0;
    for bpp in [1.0, 2.0, 3.0] {
        let measured = measure(&set, &encode(&set, &goal(Goal::Bpp(bpp))));
        assert!(measured.bpp <= bpp && measured.psnr > before, "{measured:?} within {bpp}");
        before = measured.psnr;
    }
}

#[test]
fn the_number_of_threads_does_not_count() {
    let set = ImageSet::single(picture("facade"));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let params = EpitomeParams { effort: Effort::Normal, ..goal(Goal::Psnr(30.0)) };
        let mut job = Job::default().with_pool(&pool);
        file(&Epitome::encode(EpitomeSource::new(&set), &params, &mut job).unwrap())
    };
    assert!(with(1) == with(2));
}

#[test]
fn mip_levels_show_the_picture() {
    let picture = picture("facade").tagged(ColorSpace::Linear, texfold_core::image::Alpha::Opaque);
    let set = ImageSet::single(picture.clone());
    let texture = encode(&set, &EpitomeParams { mips: true, ..goal(Goal::Psnr(32.0)) });
    let levels = texture.layout().levels;
    let decoded = decode_surface(&texture, 0, 0).unwrap();
    let chain = texfold_core::image::mip_chain(&decoded, levels, texfold_core::image::MipFilter::Box);
    for (level, wanted) in (0..levels).zip(&chain) {
        let found = decode_surface(&texture, 0, level).unwrap();
        assert_eq!(found.size(), SurfaceSize { width: 256, height: 256 }.at_level(level));
        let psnr = texfold_core::metric::color_error(wanted, &found).psnr();
        // Hard edges of the drawing alias a little at level 3, where a texel is half of the smallest leaf's.
        let least = [60.0, 30.0, 30.0, 29.0].get(level as usize).copied().unwrap_or(24.0);
        assert!(psnr >= least, "level {level}: {psnr}");
    }
}

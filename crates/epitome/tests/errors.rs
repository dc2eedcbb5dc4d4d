//! Content with a residual plane.
#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{encode, file, load};
use texfold_bc::Family;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::measure;
use texfold_core::{
    Access, CancelCheck, Domain, Effort, EncodeError, Encoded, Encoder, Footprint, Goal, Image2d, Job,
    Metric, Texel,
};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
use texfold_residual::encode::counted_error_of;
use texfold_testkit::image;

fn params(goal: Goal, family: Family) -> EpitomeParams {
    EpitomeParams::new(goal).with_access(Access::Texel).with_family(family).with_effort(Effort::Fast)
}

/// The upper left of an image.
fn corner(name: &str, side: u32) -> Raster {
    let image = image(name);
    let texels: Vec<Texel> = (0..side * side).map(|i| image.texel(i % side, i / side)).collect();
    Raster::from_texels(side, side, image.info(), &texels).unwrap()
}

#[test]
fn images_without_hard_edges_need_fewer_bits_than_with_plain_content() {
    let set = ImageSet::single(corner("terrain", 128));
    let goal = Goal::Psnr(34.0);
    let plain = measure(&set, &encode(&set, &params(goal, Family::Bc)));
    let texture = encode(&set, &params(goal, Family::ErrorMap));
    let found = measure(&set, &texture);
    assert!(texture.errors().is_some());
    assert!(plain.psnr >= 34.0 && found.psnr >= 34.0, "{plain:?} {found:?}");
    assert!(found.bpp < plain.bpp, "{} of {}", found.bpp, plain.bpp);
}

#[test]
fn errors_count_for_the_eye_where_bits_are_the_goal() {
    for name in ["terrain", "facade"] {
        let set = ImageSet::single(corner(name, 128));
        let params = params(Goal::Bpp(1.5), Family::ErrorMap);
        let usual = encode(&set, &params);
        assert!(usual == encode(&set, &params.clone().with_metric(Metric::Perceptual)));
        let squares = encode(&set, &params.with_metric(Metric::Psnr));
        let counted =
            |texture, metric| counted_error_of(&set, texture, metric, CancelCheck::default()).unwrap();
        let by = |metric| (counted(&usual, metric), counted(&squares, metric));
        let (eye, plain) = (by(Metric::Perceptual), by(Metric::Psnr));
        assert!(eye.0 < 0.95 * eye.1, "{name}: {eye:?}");
        assert!(plain.0 > plain.1 && plain.0 < 1.25 * plain.1, "{name}: {plain:?}");
    }
}

#[test]
fn a_file_comes_back_as_it_was_on_any_number_of_threads() {
    let set = ImageSet::new(vec![corner("facade", 64), image("odd_37x61")]).unwrap();
    for mips in [false, true] {
        let params = params(Goal::Psnr(30.0), Family::ErrorMap).with_mips(mips);
        let texture = encode(&set, &params);
        assert!(measure(&set, &texture).psnr >= 30.0);
        let bytes = file(&texture);
        let loaded = load(&bytes).unwrap();
        assert!(loaded == texture);
        assert_eq!(file(&loaded), bytes);
        let footprint = Footprint::measure(&loaded, &loaded.gpu());
        assert_eq!(footprint.bits_disk(), 8 * bytes.len() as u64);
        assert_eq!(loaded.footprint().bits_memory(), loaded.memory().compressed);
        assert_eq!(loaded.footprint().bits_memory() > footprint_without_mips(&loaded), mips);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let mut single = Job::default().with_pool(&pool);
        let again = Epitome::encode(EpitomeSource::new(&set), &params, &mut single).unwrap();
        assert!(file(&again) == bytes, "another file on one thread");
    }
}

fn footprint_without_mips(texture: &EpitomeTexture) -> u64 {
    let footprint = texture.footprint();
    let mips = footprint.parts.iter().find(|part| part.name == "mips").map_or(0, |part| part.bits_memory);
    footprint.bits_memory() - mips
}

#[test]
fn regions_are_their_samples() {
    let set = ImageSet::single(corner("facade", 72));
    let texture = encode(&set, &params(Goal::Psnr(28.0), Family::ErrorMap));
    let whole = texture.layout().whole(0, 0).unwrap();
    let mut texels = vec![Texel::ZERO; Image2d::len(whole)];
    texture.decode(whole, &mut texels).unwrap();
    for (index, texel) in texels.iter().enumerate() {
        assert_eq!(*texel, texture.texel(Image2d::address(whole, index)));
    }
}

#[test]
fn what_an_error_map_cannot_hold_is_refused() {
    let refused = |set: &ImageSet, params: &EpitomeParams| {
        let result = Epitome::encode(EpitomeSource::new(set), params, &mut Job::default());
        matches!(result, Err(EncodeError::Params(_)))
    };
    let cutout = ImageSet::single(image("cutout"));
    assert!(refused(&cutout, &params(Goal::Psnr(30.0), Family::ErrorMap)));
    let plain = ImageSet::single(image("odd_37x61"));
    assert!(refused(&plain, &params(Goal::Tolerance(8.0), Family::ErrorMap)));
    let layers = params(Goal::Psnr(30.0), Family::ErrorMap).with_layers(2);
    assert!(refused(&plain, &layers));
}

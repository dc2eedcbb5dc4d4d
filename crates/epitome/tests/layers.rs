//! Progressive files: prefixes show coarser images, and further layers refine them.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{encode, facade, file, load};
use texfold_bc::Content;
use texfold_core::container::Sections;
use texfold_core::image::ImageSet;
use texfold_core::metric::{decode_image, measure};
use texfold_core::{
    Access, Budget, Effort, EncodeError, Encoded, Encoder, Goal, Job, Layers, LoadError, Refine,
};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
use texfold_testkit::{full, image};

fn params(layers: u32) -> EpitomeParams {
    let params = EpitomeParams::new(Goal::Psnr(32.0)).with_access(Access::Texel);
    params.with_effort(Effort::Fast).with_layers(layers)
}

/// Bytes of the shortest prefix with each number of layers.
fn ends(bytes: &[u8]) -> Vec<usize> {
    let loaded = |length: usize| load(&bytes[..length]).map_or(0, |texture| texture.layers().loaded);
    let total = loaded(bytes.len());
    let (mut ends, mut from) = (Vec::new(), 0);
    for layers in 1..=total {
        let (mut low, mut high) = (from, bytes.len());
        while low < high {
            let middle = (low + high) / 2;
            if loaded(middle) >= layers { high = middle } else { low = middle + 1 }
        }
        ends.push(low);
        from = low;
    }
    ends
}

#[test]
fn prefixes_are_finer_the_longer_they_are() {
    let set = facade();
    for mips in [false, true] {
        let texture = encode(&set, &params(4).with_mips(mips));
        let bytes = file(&texture);
        let ends = ends(&bytes);
        assert_eq!((ends.len(), ends.last()), (4, Some(&bytes.len())));
        let mut before = 0.0;
        for (layers, &end) in (1..).zip(&ends) {
            let loaded = load(&bytes[..end]).unwrap();
            assert_eq!(loaded.layers(), Layers { loaded: layers, total: 4 });
            assert!(loaded == texture.first_layers(layers), "mips {mips}, {layers} layers");
            let psnr = measure(&set, &loaded).psnr;
            assert!(psnr > before + 0.3, "mips {mips}, {layers} layers: {psnr} dB after {before}");
            before = psnr;
        }
        assert!(before >= 32.0, "{before}");
        // The whole is what comes back, and a prefix is a texture of its own.
        assert!(load(&bytes).unwrap() == texture);
        let prefix = load(&bytes[..ends[1]]).unwrap();
        assert!(load(&file(&prefix)).unwrap() == prefix);
        assert_eq!(prefix.footprint().bits_disk(), 8 * file(&prefix).len() as u64);
        assert_eq!(prefix.footprint().bits_memory(), prefix.memory().compressed);
    }
}

#[test]
fn layers_cost_little_and_the_finest_is_the_one_of_its_own() {
    // A table of sections for each layer weighs in a small file.
    let set = ImageSet::single(image("facade"));
    let (alone, layered) = (encode(&set, &params(1)), encode(&set, &params(3)));
    let share = file(&layered).len() as f64 / file(&alone).len() as f64;
    assert!(share <= 1.2, "{share}");
    let (alone, layered) = (measure(&set, &alone), measure(&set, &layered));
    assert!(layered.psnr >= 32.0 && layered.bpp <= 1.05 * alone.bpp, "{layered:?} {alone:?}");
}

#[test]
fn every_prefix_loads_or_names_what_is_missing() {
    let set = ImageSet::single(image("odd_37x61"));
    for mips in [false, true] {
        let bytes = file(&encode(&set, &params(3).with_mips(mips)));
        let first = ends(&bytes)[0];
        let mut before = 0;
        for length in 0..=bytes.len() {
            match load(&bytes[..length]) {
                Ok(texture) => {
                    let Layers { loaded, total } = texture.layers();
                    assert!(length >= first && total == 3 && loaded >= before, "{length}: {loaded}");
                    before = loaded;
                }
                Err(LoadError::Truncated { .. }) => assert!(length < first, "{length}"),
                Err(LoadError::NotTexfold) => assert_eq!(length, 0),
                Err(other) => panic!("{length}: {other}"),
            }
        }
        assert_eq!(before, 3);
    }
}

#[test]
fn layers_arrive_one_by_one() {
    let set = facade();
    let texture = encode(&set, &params(3).with_mips(true));
    let bytes = file(&texture);
    let ends = ends(&bytes);
    let mut refined = load(&bytes[..ends[0]]).unwrap();
    let mut budget = Budget::default();
    for layers in 2..=3 {
        // What has not arrived cannot be taken, and nothing changes.
        let before = refined.clone();
        let short = Sections::parse(&bytes[..ends[layers - 1] - 1], &mut budget).unwrap();
        assert!(matches!(refined.refine(&short, &mut budget), Err(LoadError::Truncated { .. })));
        assert!(refined == before);
        let longer = Sections::parse(&bytes[..ends[layers - 1]], &mut budget).unwrap();
        let changed = refined.refine(&longer, &mut budget).unwrap();
        assert!(refined == load(&bytes[..ends[layers - 1]]).unwrap(), "{layers} layers");
        // The planes that are named are those that changed.
        for part in ["map", "epitome", "fine epitome", "mips"] {
            let of = |texture: &EpitomeTexture| {
                let planes = texture.gpu().planes.into_iter().filter(|plane| plane.part == part);
                planes.map(|plane| (plane.width, plane.height, plane.data.into_owned())).collect::<Vec<_>>()
            };
            assert_eq!(changed.contains(&part), of(&before) != of(&refined), "{part}: {changed:?}");
        }
        assert_eq!(changed.contains(&"uniforms"), before.gpu().uniforms != refined.gpu().uniforms);
    }
    let whole = Sections::parse(&bytes, &mut budget).unwrap();
    assert!(refined.refine(&whole, &mut budget).unwrap().is_empty());
    assert!(refined == texture);
}

#[test]
fn layers_of_another_file_are_refused() {
    let bytes = file(&encode(&facade(), &params(3)));
    let other = file(&encode(&facade(), &params(3).with_goal(Goal::Psnr(30.0))));
    let alone = file(&encode(&facade(), &params(1)));
    let prefix = load(&bytes[..ends(&bytes)[0]]).unwrap();
    let mut budget = Budget::default();
    for other in [other, alone] {
        let mut refined = prefix.clone();
        let sections = Sections::parse(&other, &mut budget).unwrap();
        assert!(refined.refine(&sections, &mut budget).is_err());
        assert!(refined == prefix);
    }
}

#[test]
fn bits_within_a_budget_with_all_layers() {
    let set = facade();
    for content in if full() { &[None, Some(Content::Raw)][..] } else { &[None] } {
        let content = *content;
        let goal = Goal::Bpp(if content.is_some() { 6.0 } else { 2.0 });
        let texture = encode(&set, &params(3).with_goal(goal).with_content(content));
        let measured = measure(&set, &texture);
        assert!(goal.is_met(&measured), "{measured:?}");
        assert!(load(&file(&texture)).unwrap() == texture);
        let coarse = measure(&set, &texture.first_layers(1)).psnr;
        assert!(measured.psnr > coarse + 1.0, "{} {coarse}", measured.psnr);
    }
}

#[test]
fn layers_do_not_depend_on_the_number_of_threads() {
    let set = ImageSet::single(image("odd_37x61"));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut job = Job::default().with_pool(&pool);
        file(&Epitome::encode(EpitomeSource::new(&set), &params(3), &mut job).unwrap())
    };
    assert!(with(1) == with(2));
}

#[test]
fn sets_and_images_that_do_not_suit_have_layers_all_the_same() {
    let set = ImageSet::new(vec![image("noise"), image("odd_3x5"), image("constant")]).unwrap();
    let texture = encode(&set, &params(8));
    assert_eq!(texture.layers(), Layers { loaded: 8, total: 8 });
    for layers in 1..=8 {
        let bytes = file(&texture.first_layers(layers));
        let loaded = load(&bytes).unwrap();
        assert_eq!(loaded.layers().loaded, layers);
        for image in 0..3 {
            let decoded = decode_image(&loaded, image, 0).unwrap();
            assert!(decoded.texels().all(|texel| texel.is_finite()));
        }
    }
}

#[test]
fn layers_out_of_range_are_named() {
    let field = |params: EpitomeParams| match Epitome::encode(
        EpitomeSource::new(&facade()),
        &params,
        &mut Job::default(),
    ) {
        Err(EncodeError::Params(error)) => error.field,
        other => panic!("{:?}", other.map(|_| ())),
    };
    assert_eq!(field(params(0)), "layers");
    assert_eq!(field(params(9)), "layers");
    assert_eq!(field(params(2).with_goal(Goal::Tolerance(8.0))), "layers");
}

//! Light fields whose maps are in blocks of variable length.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

use glam::Vec3;
use texfold_bc::Content;
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::{Access, Budget, Encoded, Encoder, Job, LightAddress, TextureCodec};
use texfold_lightfield::{
    Capture, Directions, Factors, FitMethod, LightModel, LightParams, LightQuality, LightTexture, Lightfield,
    MapStorage, Renderer,
};
use texfold_testkit::capture::{Look, camera, eyes, sphere};

fn params(terms: u32) -> LightParams {
    LightParams::default().with_terms(terms)
}

fn encode(capture: &Capture, params: &LightParams) -> (LightTexture, LightQuality) {
    Lightfield::encode_measured(capture, params, &mut Job::default()).unwrap()
}

fn bytes(texture: &LightTexture) -> Vec<u8> {
    let mut writer = SectionWriter::new(texture.codec());
    texture.store(&mut writer);
    writer.finish().bytes
}

fn load(bytes: &[u8]) -> Option<LightTexture> {
    let mut budget = Budget::default();
    Lightfield::load(&Sections::parse(bytes, &mut budget).ok()?, &mut budget).ok()
}

fn colours(texture: &LightTexture) -> Vec<[u32; 4]> {
    let at =
        |triangle| LightAddress { triangle, barycentric: Vec3::new(0.2, 0.5, 0.3), direction: Vec3::ZERO };
    let places = (0..texture.layout().triangles).map(at);
    let seen = places
        .flat_map(|at| eyes(7, 1.0, 0.3).into_iter().map(move |direction| LightAddress { direction, ..at }));
    seen.map(|at| texture.texel(at).to_array().map(f32::to_bits)).collect()
}

/// Models of every kind of directions, signs and sharing.
fn models() -> [(LightModel, f32); 4] {
    let usual = LightModel::default();
    let regions = FitMethod::Shared { regions: 4 };
    [
        (usual, 1.0),
        (usual.with_factors(Factors::NonNegative), 1.0),
        (usual.with_fit(regions).with_directions(Directions::World), 1.0),
        (usual, 0.5),
    ]
}

#[test]
fn blocks_take_fewer_bits_than_raw_planes_at_no_less_than_the_quality_that_is_asked_for() {
    let capture = sphere(Look::Glossy, 60, 64);
    for (model, codewords) in models() {
        let params = params(2).with_model(model).with_codewords(codewords);
        let fitted = Lightfield::fit(&capture, &params, &mut Job::default()).unwrap();
        let of = |storage: MapStorage| {
            let (texture, quality) =
                fitted.store(storage.with_codewords(codewords), &mut Job::default()).unwrap();
            (texture.memory().compressed, quality.psnr, texture.access())
        };
        let raw = of(MapStorage::default().with_content(Content::Raw));
        for loss in [1.0, 3.0] {
            let blocks = of(MapStorage::default().with_loss(loss));
            println!("{model:?} {codewords} {loss}: {blocks:?}, raw {raw:?}");
            assert_eq!(blocks.2, Access::Block);
            assert!(blocks.1 >= raw.1 - loss, "{model:?}: {blocks:?}, raw {raw:?}");
            assert!(blocks.0 < raw.0, "{model:?}: {blocks:?}, raw {raw:?}");
        }
    }
}

#[test]
fn a_file_in_blocks_comes_back_and_its_prefixes_have_fewer_terms() {
    let (texture, _) = encode(&sphere(Look::Glossy, 24, 48), &params(2));
    assert_eq!((texture.access(), texture.content()), (Access::Block, None));
    let file = bytes(&texture);
    let whole = load(&file).unwrap();
    assert!(bytes(&whole) == file && colours(&whole) == colours(&texture));
    let footprint = whole.footprint();
    assert_eq!(footprint.bits_disk(), 8 * file.len() as u64);
    assert_eq!(footprint.bits_memory(), whole.memory().compressed);
    let mut seen = Vec::new();
    for length in (0..file.len()).step_by(61).chain([file.len() - 1]) {
        let Some(prefix) = load(&file[..length]) else { continue };
        let terms = prefix.layers().loaded - 1;
        let fewer = texture.clone().truncated(terms);
        assert!(colours(&prefix) == colours(&texture.clone().first_terms(terms)));
        assert!(colours(&prefix) == colours(&fewer));
        assert!(fewer.memory().compressed < texture.memory().compressed);
        seen.push(terms);
    }
    seen.dedup();
    assert_eq!(seen, [0, 1]);
}

#[test]
fn a_goal_of_quality_decides_terms_and_step() {
    let capture = sphere(Look::Glossy, 24, 48);
    let (raw, quality) = encode(&capture, &params(3).with_access(Access::Texel));
    let steps = quality.psnr_of_terms;
    // Between the mean alone and all terms.
    let of = |goal: f64| {
        let (texture, quality) = encode(&capture, &params(3).with_psnr(goal));
        assert!(quality.psnr >= goal, "{} for {goal}", quality.psnr);
        (texture.memory().compressed, texture.layout().terms)
    };
    let goals = [0.25, 0.5, 0.9].map(|part| steps[0] + part * (steps[3] - steps[0]));
    let found = goals.map(of);
    assert!(found.windows(2).all(|pair| pair[0].0 <= pair[1].0 && pair[0].1 <= pair[1].1), "{found:?}");
    assert!(found[2].0 < raw.memory().compressed / 2, "{found:?}");
    // Out of reach: as close as raw maps but for the loss.
    let (_, best) = encode(&capture, &params(3).with_psnr(99.0));
    assert!(best.psnr > steps[3] - 0.5, "{} {steps:?}", best.psnr);
}

#[test]
fn maps_that_blocks_do_not_pay_for_are_in_planes() {
    let few = params(0).with_sampling(0.125);
    let capture = sphere(Look::Diffuse, 6, 16);
    let (texture, quality) = encode(&capture, &few);
    let (_, raw) = encode(&capture, &few.with_content(Content::Raw));
    assert_eq!(texture.access(), Access::Texel);
    assert!(quality.psnr >= raw.psnr - 0.5, "{} {}", quality.psnr, raw.psnr);
    let verdict = &texture.notes().verdict;
    assert!(verdict.contains("Maps are in planes"), "{verdict}");
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let capture = sphere(Look::Glossy, 12, 32);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let texture = Lightfield::encode(&capture, &params(2), &mut Job::default().with_pool(&pool)).unwrap();
        assert_eq!(texture.access(), Access::Block);
        bytes(&texture)
    };
    let one = with(1);
    assert!(one == with(2) && one == with(3));
}

#[test]
fn views_in_blocks_are_near_those_of_raw_maps() {
    let capture = sphere(Look::Glossy, 60, 64);
    let fitted = Lightfield::fit(&capture, &params(2), &mut Job::default()).unwrap();
    let [raw, blocks] = [MapStorage::default().with_content(Content::Raw), MapStorage::default()]
        .map(|storage| fitted.store(storage, &mut Job::default()).unwrap().0);
    for eye in eyes(5, 4.0, 1.0) {
        let camera = camera(eye, 48);
        let [raw, blocks] = [&raw, &blocks].map(|texture| Renderer::new(texture).render(&camera));
        let apart = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|c| a[c].abs_diff(b[c])).fold(0, u8::max);
        let most = raw.iter().zip(&blocks).map(apart).fold(0, u8::max);
        // No speckles: errors stay those of a fine step.
        assert!(most <= 16, "{most} of 255");
    }
}

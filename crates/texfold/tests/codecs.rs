//! What holds for every codec of the table, with no word about any of them: files, regions, foreign bytes, budgets,
//! threads, cancellation, growth, shared searches, layers that arrive one by one.
//!
//! A codec that is added to the table is tested here as it is; one that does not take images adds a line to
//! [`file_of_other`].

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may fail as tests do")]

use std::sync::OnceLock;

use crate::support::{fixture, ways, zipmap};
use proptest::prelude::*;
use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::{decode_image, measure, quality};
use texfold::core::target::Measured;
use texfold::{
    Access, AnyImage, AnyTexture, Arrived, Arriving, BytesError, CODECS, Choice, Content, Effort,
    EncodeError, EncodeSettings, Encoded, Goal, Guidance, ImageAddress, Input, Job, Limits, LoadError,
    Metric, Rect, Registration, Texel, add_images,
    bc::Bc,
    core::{Budget, Image2d, LightAddress},
    dct::Dct,
    encode_images,
    encoding::{ENCODINGS, Encoding, ImageEncoder, search_images},
    epitome::Epitome,
    file_of,
    lightfield::{LightParams, Lightfield},
    open, open_from,
    progressive::Progressive,
    vq::Vq,
};
use texfold::{
    core::container::{CodecId, SectionWriter, Sections},
    open_with,
};
use texfold_testkit::cancel::stops_soon;
use texfold_testkit::capture::{Look, sphere};
use texfold_testkit::full;

/// More than any of these textures needs, far less than a forged size would take.
const LIMITS: Limits = Limits { texels: 1 << 20, bytes: 64 << 20, sections: 64 };
/// Goals that every codec of images is tried with.
const GOALS: [Goal; 2] = [Goal::Psnr(26.0), Goal::Bpp(2.5)];

fn settings(goal: Goal) -> EncodeSettings {
    EncodeSettings { goal, effort: Effort::Fast, ..EncodeSettings::default() }
}

fn encode(encoding: &Encoding, set: &ImageSet, goal: Goal) -> AnyImage {
    encoding.encode(set, Guidance::default(), &settings(goal), &mut Job::default()).unwrap()
}

/// A small file of a codec that does not take images.
fn file_of_other(codec: &Registration) -> Vec<u8> {
    match codec.takes {
        Input::Images => panic!("{} takes images", codec.id),
        Input::Stack => zipmap(&fixture("odd_37x61"), Content::Bc1).to_bytes(),
        Input::Capture => {
            use texfold::core::Encoder;
            let capture = sphere(Look::Glossy, 6, 24);
            let params = LightParams::default();
            file_of(&Lightfield::encode(&capture, &params, &mut Job::default()).unwrap())
        }
    }
}

/// Small files of every codec, by name.
fn files() -> &'static [(String, Vec<u8>)] {
    static FILES: OnceLock<Vec<(String, Vec<u8>)>> = OnceLock::new();
    FILES.get_or_init(|| {
        let set = fixture("odd_37x61");
        let of_images = ENCODINGS.iter().flat_map(|encoding| {
            GOALS.map(|goal| (format!("{} {goal:?}", encoding.id), encode(encoding, &set, goal).to_bytes()))
        });
        let others = CODECS.iter().filter(|codec| codec.takes != Input::Images);
        of_images.chain(others.map(|codec| (codec.id.to_string(), file_of_other(codec)))).collect()
    })
}

/// Whatever loads must decode everywhere.
fn exercise(texture: &AnyTexture) {
    match texture {
        AnyTexture::Image(image) => exercise_image(image.as_encoded()),
        AnyTexture::Light(light) => {
            for triangle in [0, light.layout().triangles / 2, u32::MAX] {
                let barycentric = glam::Vec3::new(0.2, 0.3, 0.5);
                let at = LightAddress { triangle, barycentric, direction: glam::Vec3::Z };
                assert!(light.texel(at).is_finite());
            }
            let _ = (light.gpu(), light.footprint());
        }
    }
}

fn exercise_image(texture: &dyn Encoded<Domain = Image2d>) {
    let layout = texture.layout();
    for (image, level) in
        (0..layout.images.len().min(4) as u32).flat_map(|s| (0..layout.levels).map(move |l| (s, l)))
    {
        for (x, y) in [(0, 0), (7, 3), (u32::MAX, u32::MAX)] {
            assert!(texture.texel(ImageAddress { image, level, x, y }).is_finite());
        }
    }
    if let Some(whole) =
        layout.whole(0, 0).filter(|whole| u64::from(whole.width) * u64::from(whole.height) < 1 << 14)
    {
        let mut texels = vec![Texel::ZERO; (whole.width * whole.height) as usize];
        texture.decode(whole, &mut texels).unwrap();
        assert!(texels.iter().all(|texel| texel.is_finite()));
    }
    let _ = (texture.gpu(), texture.footprint());
}

#[test]
fn files_name_their_codec_and_come_back_as_they_were_written() {
    for (name, bytes) in files() {
        let texture = open(bytes).unwrap();
        assert!(name.starts_with(texture.codec().name), "{name}");
        assert!(texture.to_bytes() == *bytes, "{name} is written otherwise than it was read");
        let read = open_from(bytes.as_slice(), &Limits::default()).unwrap();
        assert!(read.to_bytes() == *bytes, "{name} from a reader");
        let mut written = Vec::new();
        if let AnyTexture::Image(image) = read {
            assert_eq!(image.write_to(&mut written).unwrap(), bytes.len() as u64);
            assert!(written == *bytes, "{name} to a writer");
        }
    }
}

#[test]
fn a_reader_is_read_no_further_than_the_limits_allow() {
    let (_, bytes) = &files()[0];
    let few = Limits { bytes: bytes.len() as u64 / 2, ..Limits::default() };
    let endless = std::io::repeat(0x89);
    for error in [open_from(bytes.as_slice(), &few).unwrap_err(), open_from(endless, &few).unwrap_err()] {
        assert!(matches!(error, texfold::OpenError::Load(LoadError::Limit(_))), "{error}");
    }
}

#[test]
fn what_is_made_is_what_is_loaded_and_meets_its_goal() {
    /// The one path that every encoder takes.
    fn encoded_and_measured<C: ImageEncoder>(set: &ImageSet, goal: Goal) -> Measured {
        let params = settings(goal).params::<C>();
        let made = C::encode(C::source(set, Guidance::default()), &params, &mut Job::default()).unwrap();
        let loaded = open(&file_of(&made)).unwrap().into_image().unwrap();
        assert!(decode_image(&made, 0, 0) == decode_image(loaded.as_encoded(), 0, 0), "{} {goal:?}", C::ID);
        let (of_made, of_loaded) = (measure(set, &made), measure(set, loaded.as_encoded()));
        assert_eq!(of_made, of_loaded, "{} {goal:?}", C::ID);
        of_loaded
    }
    let set = fixture("odd_37x61");
    for goal in GOALS {
        let measured = [
            encoded_and_measured::<Bc>(&set, goal),
            encoded_and_measured::<Vq>(&set, goal),
            encoded_and_measured::<Epitome>(&set, goal),
            encoded_and_measured::<Progressive>(&set, goal),
            encoded_and_measured::<Dct>(&set, goal),
        ];
        assert_eq!(measured.len(), ENCODINGS.len(), "a codec is left out");
        for (encoding, measured) in ENCODINGS.iter().zip(measured) {
            assert!(goal.is_met(&measured), "{} {goal:?}: {measured:?}", encoding.id);
            assert_eq!(measure(&set, encode(encoding, &set, goal).as_encoded()), measured, "{}", encoding.id);
        }
    }
}

#[test]
fn every_cut_names_what_is_missing_or_leaves_fewer_layers() {
    for (name, bytes) in files() {
        let ends: Vec<u64> = Sections::parse(bytes, &mut Budget::default()).unwrap().ends().collect();
        let cuts = ends.iter().flat_map(|&end| [end - 1, end, end + 1]).chain([0, 1, 8, 30]);
        for length in cuts.filter(|&length| length < bytes.len() as u64) {
            match open_with(&bytes[..length as usize], &LIMITS) {
                Err(LoadError::Truncated { .. }) => {}
                Err(LoadError::NotTexfold) => assert_eq!(length, 0, "{name}"),
                Ok(texture) => {
                    let layers = match &texture {
                        AnyTexture::Image(image) => image.as_encoded().layers(),
                        AnyTexture::Light(light) => light.layers(),
                    };
                    assert!(layers.loaded < layers.total, "{name} cut to {length}: {layers:?}");
                    exercise(&texture);
                }
                Err(other) => panic!("{name} cut to {length} of {}: {other}", bytes.len()),
            }
        }
    }
}

#[test]
fn pieces_of_a_file_come_to_the_whole_in_layers() {
    for (name, bytes) in files() {
        let AnyTexture::Image(whole) = open(bytes).unwrap() else { continue };
        let codec = whole.registration().unwrap();
        for piece in [bytes.len(), 1000, 97] {
            let mut arriving = Arriving::new(LIMITS);
            let mut layers = 0;
            for piece in bytes.chunks(piece) {
                let arrived = arriving.push(piece).unwrap();
                let loaded = arriving.texture().map_or(0, |texture| texture.as_encoded().layers().loaded);
                assert_eq!(arrived != Arrived::Nothing, loaded > layers, "{name}: {arrived:?}");
                if layers > 0 && loaded > layers {
                    assert!(codec.refines() && matches!(arrived, Arrived::Planes(_)), "{name}: {arrived:?}");
                }
                layers = loaded;
            }
            let texture = arriving.into_texture().unwrap();
            assert!(texture.to_bytes() == *bytes, "{name} in pieces of {piece}");
            let (made, wanted) =
                (decode_image(texture.as_encoded(), 0, 0), decode_image(whole.as_encoded(), 0, 0));
            assert!(made == wanted, "{name} in pieces of {piece} decodes otherwise");
        }
    }
}

#[test]
fn a_budget_that_is_too_small_is_named_before_anything_is_decoded() {
    for (name, bytes) in files() {
        for bytes_allowed in [0, 64] {
            let limits = Limits { bytes: bytes_allowed, ..LIMITS };
            let refused = open_with(bytes, &limits).map(|texture| texture.codec());
            assert!(
                matches!(refused, Err(LoadError::Limit(_))),
                "{name} in {bytes_allowed} bytes: {refused:?}"
            );
        }
        let few = open_with(bytes, &Limits { sections: 1, ..LIMITS }).map(|texture| texture.codec());
        assert!(matches!(few, Err(LoadError::Limit(_))), "{name}: {few:?}");
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let set = fixture(if full() { "facade" } else { "odd_37x61" });
    let goals = [GOALS[0], GOALS[1], Goal::Tolerance(12.0)];
    for ((encoding, access), goal) in ways().flat_map(|way| goals.map(|goal| (way, goal))) {
        let effort = if full() { Effort::Normal } else { Effort::Fast };
        let settings = EncodeSettings { mips: true, effort, access: Some(access), ..settings(goal) };
        if encoding.check(&settings).is_err() {
            continue;
        }
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut job = Job::default().with_pool(&pool);
            let made = encoding.encode(&set, Guidance::default(), &settings, &mut job);
            made.map(|image| image.to_bytes()).map_err(|error| error.to_string())
        };
        let one = with(1);
        assert!(with(2) == one && with(3) == one, "{} {access:?} {goal:?}", encoding.id);
        assert!(one.is_ok(), "{} {access:?} {goal:?}: {:?}", encoding.id, one.err());
    }
}

#[test]
fn a_job_looks_often_whether_it_is_to_stop() {
    let set = fixture("facade");
    for (encoding, access) in ways() {
        let settings = EncodeSettings { access: Some(access), ..settings(Goal::Psnr(32.0)) };
        let name = format!("{} {access:?}", encoding.id);
        stops_soon(&name, |job| encoding.encode(&set, Guidance::default(), &settings, job).map(drop));
    }
}

#[test]
fn textures_grow_without_a_changed_texel_or_say_which_codec_can() {
    let (set, more) = (fixture("odd_37x61"), fixture("facade"));
    for encoding in &ENCODINGS {
        let mut image = encode(encoding, &set, GOALS[0]);
        let before = decode_image(image.as_encoded(), 0, 0);
        let added = add_images(&mut image, &more, Guidance::default(), &mut Job::default());
        assert!(decode_image(image.as_encoded(), 0, 0) == before, "{}", encoding.id);
        let images = image.as_encoded().layout().images.len();
        match added {
            Ok(()) => assert!(encoding.grows() && images == 2, "{}", encoding.id),
            Err(EncodeError::CannotGrow { codec, instead }) => {
                let instead = ENCODINGS.iter().find(|encoding| encoding.id.name == instead).unwrap();
                assert!(!encoding.grows() && codec == encoding.id && instead.grows());
            }
            // A set that has no room left says so and stays as it is.
            Err(EncodeError::Source(_)) => assert!(encoding.grows() && images == 1, "{}", encoding.id),
            Err(other) => panic!("{}: {other}", encoding.id),
        }
    }
}

#[test]
fn one_search_serves_several_goals() {
    let set = fixture("facade");
    for encoding in &ENCODINGS {
        let mut job = Job::default();
        let search =
            search_images(encoding, &set, Guidance::default(), &settings(Goal::Bpp(1.5)), &mut job).unwrap();
        for goal in [Goal::Bpp(2.5), Goal::Bpp(1.5)] {
            let from_search = search.encode(goal, &mut job).unwrap();
            let alone = encode(encoding, &set, goal);
            let (found, wanted) =
                (measure(&set, from_search.as_encoded()), measure(&set, alone.as_encoded()));
            assert!(goal.is_met(&found), "{} {goal:?}: {found:?}", encoding.id);
            assert!(found.psnr > wanted.psnr - 0.1, "{} {goal:?}: {found:?}, alone {wanted:?}", encoding.id);
        }
    }
}

#[test]
fn names_choose_their_codec_and_no_other_makes_the_file_but_plain_blocks() {
    let set = fixture("odd_37x61");
    for encoding in &ENCODINGS {
        let codec = Choice::named(encoding.id.name).unwrap();
        let settings = EncodeSettings { codec, ..settings(GOALS[0]) };
        let made = encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
        assert!([encoding.id.name, "bc"].contains(&made.codec().name), "{}", encoding.id);
    }
    assert!(Choice::named("lightfield").is_none() && Choice::named("").is_none());
}

#[test]
fn bytes_are_the_texels_rounded_and_bytes_between_rows_are_left() {
    for (name, bytes) in files() {
        let AnyTexture::Image(image) = open(bytes).unwrap() else { continue };
        let whole = image.as_encoded().layout().whole(0, 0).unwrap();
        let rect = Rect { x: 3, y: 1, width: whole.width.min(30), height: whole.height.min(50), ..whole };
        let rect = Rect { width: rect.width - 3, height: rect.height - 1, ..rect };
        let stride = 4 * rect.width as usize + 5;
        let mut out = vec![7; stride * (rect.height as usize - 1) + 4 * rect.width as usize];
        image.decode_rgba8(rect, &mut out, stride).unwrap();
        for (y, row) in (0..rect.height).zip(out.chunks(stride)) {
            for (x, pixel) in (0..rect.width).zip(row.chunks(4)) {
                let at = ImageAddress { image: 0, level: 0, x: rect.x + x, y: rect.y + y };
                assert_eq!(
                    pixel,
                    image.as_encoded().texel(at).to_array().map(texfold::core::image::to_u8),
                    "{name} {at:?}"
                );
            }
            assert!(row[4 * rect.width as usize..].iter().all(|&byte| byte == 7), "{name} row {y}");
        }
        let short = out.len() - 1;
        let refused = image.decode_rgba8(rect, &mut out[..short], stride);
        assert_eq!(refused, Err(BytesError::Length { found: short, needed: short + 1 }));
        let narrow = image.decode_rgba8(rect, &mut out, 4 * rect.width as usize - 1);
        assert!(matches!(narrow, Err(BytesError::Stride { .. })));
        let outside = image.decode_rgba8(Rect { y: whole.height, ..rect }, &mut out, stride);
        assert!(matches!(outside, Err(BytesError::Region(_))));
    }
}

#[test]
fn bytes_of_many_rows_are_those_of_each() {
    let pixels: Vec<u8> =
        (0..3 * 512 * 700u32).map(|at| (at.wrapping_mul(0x9E37_79B9) >> 24) as u8).collect();
    let raster = Raster::from_u8(512, 700, 3, texfold::ColorSpace::Srgb, &pixels).unwrap();
    let params = texfold::bc::BcParams::default().with_content(Content::Raw);
    let texture =
        <Bc as texfold::core::Encoder>::encode(&ImageSet::single(raster), &params, &mut Job::default());
    let AnyTexture::Image(image) = open(&file_of(&texture.unwrap())).unwrap() else { panic!("no image") };
    let rect = Rect { image: 0, level: 0, x: 2, y: 5, width: 509, height: 690 };
    for stride in [4 * 509, 4 * 509 + 3] {
        let mut out = vec![7; stride * 690];
        image.decode_rgba8(rect, &mut out, stride).unwrap();
        for (y, row) in out.chunks(stride).enumerate() {
            let wanted = &pixels[3 * (512 * (y + 5) + 2)..][..3 * 509];
            let found = row.chunks_exact(4).zip(wanted.chunks_exact(3));
            assert!(
                found.into_iter().all(|(found, wanted)| found[..3] == *wanted && found[3] == 255),
                "row {y}"
            );
        }
    }
}

/// The same file with the section `target` as `change` leaves it, and every checksum made right again, as an attacker
/// would.
fn rewritten(bytes: &[u8], target: usize, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut budget = Budget::default();
    let sections = Sections::parse(bytes, &mut budget).unwrap();
    let mut writer = SectionWriter::new(CodecId { number: sections.codec(), name: "" });
    let mut change = Some(change);
    let count = sections.ids().count();
    for (index, (id, _)) in sections.ids().enumerate() {
        let mut raw = sections.read(id, &mut budget).unwrap();
        if let Some(change) = change.take_if(|_| index == target % count) {
            change(&mut raw);
        }
        writer.section("", id, &raw);
    }
    writer.finish().bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn forged_files_give_an_error_or_a_texture_that_decodes(
        file in 0usize..1000, section in 0usize..64, at in 0.0f64..1.0, kind in 0u32..5, value in any::<u8>()
    ) {
        let (_, bytes) = &files()[file % files().len()];
        let forged = rewritten(bytes, section, |raw| {
            let at = ((at * raw.len() as f64) as usize).min(raw.len().saturating_sub(1));
            match kind {
                0 if !raw.is_empty() => raw[at] = value,
                1 if !raw.is_empty() => raw[at] ^= 1 << (value % 8),
                2 => raw.truncate(at),
                3 => raw.extend([value; 7]),
                _ if raw.len() >= at + 4 => raw[at..at + 4].copy_from_slice(&[0xff, 0xff, 0xff, 0x7f]),
                _ => raw.push(value),
            }
        });
        if let Ok(texture) = open_with(&forged, &LIMITS) {
            exercise(&texture);
        }
    }

    #[test]
    fn regions_equal_samples(
        file in 0usize..1000, level in 0u32..8, x in 0u32..4096, y in 0u32..4096, width in 1u32..40, height in 1u32..40
    ) {
        thread_local! { static IMAGES: Vec<(String, AnyImage)> = images(); }
        IMAGES.with(|images| {
            let (name, texture) = &images[file % images.len()];
            let texture = texture.as_encoded();
            let level = level % texture.layout().levels;
            let whole = texture.layout().whole(0, level).unwrap();
            let (x, y) = (x % whole.width, y % whole.height);
            let (width, height) = (width.min(whole.width - x), height.min(whole.height - y));
            let rect = Rect { image: 0, level, x, y, width, height };
            let mut out = vec![Texel::ZERO; (width * height) as usize];
            texture.decode(rect, &mut out).unwrap();
            for (index, texel) in (0..).zip(&out) {
                let at = ImageAddress { image: 0, level, x: x + index % width, y: y + index / width };
                assert_eq!(*texel, texture.texel(at), "{name} {at:?}");
            }
        });
    }
}

/// The files that hold images, loaded.
fn images() -> Vec<(String, AnyImage)> {
    let image =
        |(name, bytes): &(String, Vec<u8>)| Some((name.clone(), open(bytes).unwrap().into_image().ok()?));
    files().iter().filter_map(image).collect()
}

#[test]
fn settings_that_a_codec_does_not_follow_are_refused() {
    let set = fixture("odd_3x5");
    let refused = |codec: &str, settings: EncodeSettings| {
        let settings = EncodeSettings { codec: Choice::named(codec).unwrap(), ..settings };
        let made = encode_images(&set, Guidance::default(), &settings, &mut Job::default());
        match made.map(|made| made.codec()) {
            Err(EncodeError::Params(error)) => Some(error.field),
            _ => None,
        }
    };
    let usual = EncodeSettings::default;
    for (encoding, access) in
        ENCODINGS.iter().flat_map(|row| [Access::Block, Access::Texel].map(|way| (row, way)))
    {
        let is_refused = refused(encoding.id.name, EncodeSettings { access: Some(access), ..usual() });
        assert_eq!(is_refused.is_none(), encoding.accesses.contains(&access), "{encoding:?} {access:?}");
    }
    for encoding in &ENCODINGS {
        let is_refused = refused(encoding.id.name, EncodeSettings { metric: Some(Metric::Psnr), ..usual() });
        assert_eq!(is_refused.is_none(), encoding.has_metric, "{encoding:?}");
    }
    let bound = || EncodeSettings { goal: Goal::Tolerance(9.0), ..usual() };
    let by_block = || EncodeSettings { access: Some(Access::Block), ..bound() };
    for (codec, settings, field) in [
        ("dct", EncodeSettings { content: Some(Content::Bc1), ..usual() }, "content"),
        ("progressive", EncodeSettings { metric: Some(Metric::Psnr), ..bound() }, "metric"),
        ("epitome", by_block(), "access"),
        (
            "epitome",
            EncodeSettings { content: Some(Content::Bc1), goal: Goal::default(), ..by_block() },
            "access",
        ),
        (
            "epitome",
            EncodeSettings { access: Some(Access::Texel), metric: Some(Metric::Psnr), ..usual() },
            "metric",
        ),
        ("bc", EncodeSettings { goal: Goal::Bpp(-1.0), ..usual() }, "bpp"),
    ] {
        assert_eq!(refused(codec, settings.clone()), Some(field), "{codec} {settings:?}");
    }
}

#[test]
fn goals_of_quality_hold_for_alpha_as_for_colours() {
    // Hard borders of alpha: by colours alone progressive left it at 18 dB.
    let set = fixture("cutout");
    for (encoding, access) in ways() {
        let codec = Choice::named(encoding.id.name).unwrap();
        let settings = EncodeSettings { codec, access: Some(access), ..settings(Goal::Psnr(30.0)) };
        let made = encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
        let alpha = quality(&set, made.as_encoded()).alpha.map(|alpha| alpha.psnr());
        assert!(alpha >= Some(30.0), "{} {access:?}: {alpha:?}", encoding.id.name);
    }
}

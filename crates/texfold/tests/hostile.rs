//! Damaged files: every truncation and thousands of mutations give an error or a correct texture, never a panic.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use crate::support::forged::{rewritten, with_changed_section};
use crate::support::target::Forged;
use crate::support::{small_texture, small_textures, target};
use rayon::prelude::*;
use texfold::core::metric::decode_image;
use texfold::{
    AnyImage, Content, Encoded, ImageAddress, Limits, LoadError, Texel,
    bc::Bc,
    core::{Budget, Domain, Image2d, ImageLayout, TextureCodec},
};
use texfold::{
    AnyTexture,
    core::container::{SectionWriter, Sections},
    open_with,
};
use texfold_core::rng::Rng;
use texfold_testkit::full;

/// More than any of these textures needs, far less than a hostile size would take.
const LIMITS: Limits = Limits { texels: 1 << 20, bytes: 64 << 20, sections: 64 };

/// Files that are forged in each of two ways.
fn mutations() -> usize {
    if full() { 10_000 } else { 1000 }
}

/// Images of up to as many texels are decoded as a whole.
const WHOLE_TEXELS: usize = 1 << 14;

/// Whatever loads must decode everywhere.
fn exercise(texture: &dyn Encoded<Domain = Image2d>) {
    let layout = texture.layout().clone();
    for image in 0..layout.images.len().min(8) as u32 {
        for level in 0..layout.levels {
            let rect = layout.whole(image, level).unwrap();
            for (x, y) in
                [(0, 0), (rect.width - 1, rect.height - 1), (rect.width / 2, 0), (u32::MAX, u32::MAX)]
            {
                let texel = texture.texel(ImageAddress { image, level, x, y });
                assert!(texel.is_finite());
            }
        }
    }
    if let Some(whole) = layout.whole(0, 0).filter(|whole| Image2d::len(*whole) <= WHOLE_TEXELS) {
        let mut texels = vec![Texel::ZERO; Image2d::len(whole)];
        texture.decode(whole, &mut texels).unwrap();
        assert!(texels.iter().all(|texel| texel.is_finite()));
    }
    let _ = texture.gpu();
    let _ = texture.footprint();
}

/// A plain file of one image in content of that number, without blocks.
fn plain_file(number: u8) -> Vec<u8> {
    let layout = small_textures()[0].2.as_encoded().layout().clone();
    let images = vec![texfold::core::ImageSize { width: 37, height: 61 }];
    let mut out = SectionWriter::new(Bc::ID);
    texfold::core::Notes::default().write(&mut out);
    texfold::core::container::write_layout(&ImageLayout { images, levels: 1, ..layout }, &mut out);
    out.section("container", *b"BCFM", &[number, 0]);
    out.section("blocks", *b"BLKS", &[]);
    out.finish().bytes
}

#[test]
fn unknown_content_is_refused() {
    for number in Content::ALL.len()..=usize::from(u8::MAX) {
        let opened = open_with(&plain_file(number as u8), &LIMITS).and_then(AnyTexture::into_image);
        assert!(matches!(opened, Err(LoadError::Corrupt { .. })), "{number}: {opened:?}");
    }
}

#[test]
fn every_truncation_names_what_is_missing() {
    for (name, _, texture) in small_textures() {
        let bytes = texture.to_bytes();
        // Every length of the first kilobyte, where the table of sections is, and of the last; between them some.
        let is_inner = |length: usize| length > 1024 && length + 64 < bytes.len();
        for length in (0..bytes.len()).filter(|&length| full() || !is_inner(length) || length % 7 == 0) {
            match open_with(&bytes[..length], &LIMITS).and_then(AnyTexture::into_image) {
                Err(LoadError::Truncated { .. }) => {}
                Err(LoadError::NotTexfold) => assert_eq!(length, 0, "{name}"),
                // A file of layers may end after any of its layers.
                Ok(texture) if name == "epitome layers" => {
                    let layers = texture.as_encoded().layers();
                    assert!((1..3).contains(&layers.loaded) && layers.total == 3, "{length}: {layers:?}");
                    exercise(texture.as_encoded());
                }
                Ok(texture) if name.starts_with("progressive layers") || name.starts_with("dct layers") => {
                    assert_eq!(texture.as_encoded().layers(), texfold::core::Layers { loaded: 1, total: 2 });
                    exercise(texture.as_encoded());
                }
                other => panic!("{name} cut to {length} of {}: {other:?}", bytes.len()),
            }
        }
    }
}

#[test]
fn what_a_prefix_shows_is_stored_and_loads_again() {
    let mut prefixes = 0;
    for (name, _, texture) in small_textures() {
        let bytes = texture.to_bytes();
        let Ok(prefix) = open_with(&bytes[..bytes.len() - 1], &LIMITS).and_then(AnyTexture::into_image)
        else {
            continue;
        };
        let stored = prefix.to_bytes();
        let again = open_with(&stored, &LIMITS)
            .and_then(AnyTexture::into_image)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(again.to_bytes(), stored, "{name}");
        let shown = |texture: &AnyImage| decode_image(texture.as_encoded(), 0, 0).unwrap().to_bytes();
        assert!(shown(&again) == shown(&prefix), "{name} shows something else");
        prefixes += 1;
    }
    assert!(prefixes > 3, "{prefixes} textures with layers");
}

#[test]
fn flipped_bytes_are_noticed() {
    let mut rng = Rng::new(11);
    for (name, _, texture) in small_textures() {
        let bytes = texture.to_bytes();
        for _ in 0..500 {
            let mut damaged = bytes.clone();
            let at = rng.index(bytes.len());
            damaged[at] ^= 1 << rng.index(8);
            let opened = open_with(&damaged, &LIMITS).and_then(AnyTexture::into_image);
            assert!(opened.is_err(), "{name}: byte {at} changed unnoticed");
        }
    }
}

#[test]
fn forged_files_give_an_error_or_a_texture_that_decodes() {
    let mut rng = Rng::new(5);
    // Writing compresses, so each file is written once.
    let files: Vec<(String, Vec<u8>)> =
        small_textures().iter().map(|(name, _, texture)| (name.clone(), texture.to_bytes())).collect();
    let (mut refused, mut accepted) = (0, 0);
    for round in 0..mutations() {
        let (name, bytes) = &files[round % files.len()];
        let Some(forged) = with_changed_section(bytes, &mut rng) else { panic!("{name} cannot be read") };
        match open_with(&forged, &LIMITS).and_then(AnyTexture::into_image) {
            Ok(texture) => {
                accepted += 1;
                exercise(texture.as_encoded());
            }
            Err(_) => refused += 1,
        }
    }
    // Both happen: indices and notes may change within their ranges, sizes may not.
    assert!(
        refused > mutations() / 10 && accepted > mutations() / 100,
        "{refused} refused, {accepted} accepted"
    );
}

/// An instruction for [`target::open_forged`]: headers, which come first, as often as all else.
fn instruction(rng: &mut Rng) -> Vec<u8> {
    let reach = if rng.below(2) == 0 { 80 } else { 1 << 16 };
    let place = rng.below(reach) as u16;
    let most = if rng.below(8) == 0 { 300 } else { 12 };
    let length = rng.index(most);
    let head = [rng.below(256) as u8, rng.below(256) as u8, rng.below(256) as u8];
    let rest = |_| match rng.below(20) {
        edge @ 0..5 => [0, 1, 127, 128, 255][edge as usize],
        _ => rng.below(256) as u8,
    };
    let rest: Vec<u8> = (0..length).map(rest).collect();
    [head.as_slice(), &place.to_le_bytes(), &rest].concat()
}

/// `TEXFOLD_FORGED=1000000` makes as many files instead.
#[test]
fn forged_contents_give_an_error_or_a_texture_that_decodes() {
    forge(Forged::Blocks);
    forge(Forged::Sections);
}

fn forge(forged: Forged) {
    let runs = std::env::var("TEXFOLD_FORGED").map_or(mutations() as u64, |runs| runs.parse().unwrap());
    let run = |number: u64| {
        let data = instruction(&mut Rng::new(number));
        let loaded = std::panic::catch_unwind(|| target::open_forged(&data, forged).unwrap());
        loaded.map_err(|_| number)
    };
    let results: Vec<Result<bool, u64>> = (0..runs).into_par_iter().map(run).collect();
    let failed: Vec<&u64> = results.iter().filter_map(|result| result.as_ref().err()).take(9).collect();
    assert!(failed.is_empty(), "{forged:?}: instructions {failed:?} panic");
    let accepted = results.iter().filter(|result| **result == Ok(true)).count() as u64;
    // Both happen: streams may hold anything, headers may not.
    assert!(accepted > runs / 10 && accepted < runs - runs / 10, "{forged:?}: {accepted} of {runs} accepted");
}

#[test]
fn an_epitome_map_may_point_anywhere() {
    let alone = |name: &str| name.starts_with("epitome") && name != "epitome layers";
    for (name, _, texture) in small_textures().iter().filter(|(name, ..)| alone(name)) {
        let bytes = texture.to_bytes();
        let accept = |forged: &[u8], what: &str| {
            let texture = open_with(forged, &LIMITS).and_then(AnyTexture::into_image);
            exercise(texture.unwrap_or_else(|error| panic!("{name}, {what}: {error}")).as_encoded());
        };
        // Any 2x2 matrix and any gain and offset may stand in a palette, also those that flatten or enlarge most.
        for byte in [0x00, 0x01, 0x7f, 0x80, 0xff] {
            let forged = rewritten(&bytes, *b"EPPL", |raw| raw.fill(byte)).unwrap();
            accept(&forged, "another palette");
        }
        // Any place that the fields can hold may lie outside of the epitome.
        let sections = Sections::parse(&bytes, &mut Budget::default()).unwrap();
        let form = sections.read(*b"EPFM", &mut Budget::default()).unwrap();
        let most = |bits: u8| ((1u32 << bits) - 1) as u16;
        for (x, y) in [(0, 0), (most(form[2]), 0), (0, most(form[3])), (most(form[2]), most(form[3]))] {
            let at = [x.to_le_bytes(), y.to_le_bytes()].concat();
            // Places are stored as what differs from the leaf before, byte plane by byte plane.
            let forged = rewritten(&bytes, *b"EPEN", |raw| {
                let leaves = raw.len() / 7;
                raw[..4 * leaves].fill(0);
                for (plane, byte) in at.iter().enumerate() {
                    raw[plane * leaves] = *byte;
                }
            });
            accept(&forged.unwrap(), "all leaves at one place");
        }
    }
}

#[test]
fn forged_layers_are_refused_or_harmless() {
    let texture = small_texture("epitome layers");
    let bytes = texture.to_bytes();
    let open = |forged: &[u8]| open_with(forged, &LIMITS).and_then(AnyTexture::into_image);
    // A number of layers that no file has, or rows that the epitome has not.
    for (at, value) in [(0, 0), (0, 1), (0, 9), (0, 255), (1, 0), (1, 2), (2, 0xff), (4, 0xff)] {
        let forged = rewritten(&bytes, *b"EPLA", |raw| raw[at] = value).unwrap();
        assert!(matches!(open(&forged), Err(LoadError::Corrupt { .. })), "byte {at} is {value}");
    }
    // Of five layers the third has a list of cells, which this file has not: two have arrived. Of two the last brings all.
    let more = open(&rewritten(&bytes, *b"EPLA", |raw| raw[0] = 5).unwrap()).unwrap();
    assert_eq!(more.as_encoded().layers(), texfold::core::Layers { loaded: 2, total: 5 });
    exercise(more.as_encoded());
    assert!(open(&rewritten(&bytes, *b"EPLA", |raw| raw[0] = 2).unwrap()).is_err());
    // Lists of cells of another length, or with bits after the last.
    for change in [|raw: &mut Vec<u8>| raw.push(0), |raw: &mut Vec<u8>| _ = raw.pop()] {
        for id in [*b"EPC0", *b"EPE1", *b"EPA1", *b"EPA2"] {
            assert!(open(&rewritten(&bytes, id, change).unwrap()).is_err(), "{id:?}");
        }
    }
    let survive = |forged: &[u8]| match open(forged) {
        Ok(texture) => exercise(texture.as_encoded()),
        // Sections that are then too short end early.
        Err(LoadError::Corrupt { .. } | LoadError::Truncated { .. }) => {}
        Err(error) => panic!("{error}"),
    };
    // A list of other cells: content lands elsewhere, and leaves read cells that never arrive.
    survive(&rewritten(&bytes, *b"EPC0", |raw| raw.reverse()).unwrap());
    // Entries of the first layer that point elsewhere; those of further layers may follow them out of their fields.
    for byte in [0, 1] {
        let forged = rewritten(&bytes, *b"EPE0", |raw| {
            let leaves = raw.len() / 7;
            raw[..4 * leaves].fill(0);
            raw[0] = byte;
        });
        survive(&forged.unwrap());
    }
    // Rows that the finest map reads may be said to be fewer: it then reads the last of those.
    let form = |raw: &mut Vec<u8>| raw[1..5].copy_from_slice(&16u32.to_le_bytes());
    exercise(open(&rewritten(&bytes, *b"EPLA", form).unwrap()).unwrap().as_encoded());
}

#[test]
fn a_forged_model_is_refused_or_harmless() {
    let texture = small_texture("progressive layers");
    let bytes = texture.to_bytes();
    let open = |forged: &[u8]| open_with(forged, &LIMITS).and_then(AnyTexture::into_image);
    // Content that there is not, halvings, contrast of alpha in an opaque image, bits of the first class, and bits of classes beyond what a file may have.
    for (at, value) in [(0, 12), (1, 0), (1, 4), (1, 66), (2, 3), (2, 255), (17, 1), (21, 6), (24, 1)] {
        let forged = rewritten(&bytes, *b"RSF0", |raw| raw[at] = value).unwrap();
        assert!(matches!(open(&forged), Err(LoadError::Corrupt { .. })), "byte {at} is {value}");
    }
    // No residual plane where there is one, and the other way round.
    let none = |raw: &mut Vec<u8>| {
        raw[2] = 0;
        raw[17..].fill(0);
    };
    assert!(matches!(open(&rewritten(&bytes, *b"RSF0", none).unwrap()), Err(LoadError::Corrupt { .. })));
    // Any weights, any scales and any bits are some texture.
    let weights = |raw: &mut Vec<u8>| raw[3..17].fill(0xff);
    exercise(open(&rewritten(&bytes, *b"RSF0", weights).unwrap()).unwrap().as_encoded());
    let bits = |raw: &mut Vec<u8>| {
        let half = raw.len() / 2;
        raw[half..].fill(0xff);
    };
    exercise(open(&rewritten(&bytes, *b"RSP0", bits).unwrap()).unwrap().as_encoded());
    // Bits that are too few or too many, and a class that the model has not.
    for change in [|raw: &mut Vec<u8>| raw.push(0), |raw: &mut Vec<u8>| _ = raw.pop()] {
        for id in [*b"RSP0", *b"RSB0", *b"RSF0"] {
            assert!(open(&rewritten(&bytes, id, change).unwrap()).is_err(), "{id:?}");
        }
    }
    let classes = |raw: &mut Vec<u8>| raw[..4].fill(0xff);
    assert!(open(&rewritten(&bytes, *b"RSP0", classes).unwrap()).is_err());
}

#[test]
fn a_forged_zipmap_in_blocks_is_refused_or_harmless() {
    let texture = small_texture("zipmap, blocks");
    let bytes = texture.to_bytes();
    let open = |forged: &[u8]| open_with(forged, &LIMITS).and_then(AnyTexture::into_image);
    exercise(open(&bytes).unwrap().as_encoded());
    // One content in blocks and one not, no images, other sides of the first image, other levels.
    for (at, value) in [(0, 0), (1, 0), (3, 0), (7, 1), (9, 1), (11, 1), (2, 9)] {
        let forged = rewritten(&bytes, *b"ZMFM", |raw| raw[at] = value).unwrap();
        assert!(open(&forged).is_err(), "byte {at} is {value}");
    }
    for change in [|raw: &mut Vec<u8>| raw.push(0), |raw: &mut Vec<u8>| _ = raw.pop()] {
        for id in [*b"ZMFM", *b"RBB0", *b"RBD0", *b"RBB1", *b"RBD1"] {
            assert!(open(&rewritten(&bytes, id, change).unwrap()).is_err(), "{id:?}");
        }
    }
    // Streams of noise decode to something.
    let noise = |raw: &mut Vec<u8>| {
        raw.iter_mut().zip(0u32..).for_each(|(byte, i)| *byte = ((i * 40_503) >> 7) as u8);
    };
    exercise(open(&rewritten(&bytes, *b"RBD1", noise).unwrap()).unwrap().as_encoded());
    // A stack has no layers: a part of the file is refused by name.
    let cut = open(&bytes[..bytes.len() - 1]);
    assert!(matches!(cut, Err(LoadError::Truncated { .. })), "{cut:?}");
}

#[test]
fn a_forged_zipmap_is_refused_or_harmless() {
    let texture = small_texture("zipmap raw");
    let bytes = texture.to_bytes();
    let open = |forged: &[u8]| open_with(forged, &LIMITS).and_then(AnyTexture::into_image);
    let form = |at: usize, value: u8| rewritten(&bytes, *b"ZMFM", |raw| raw[at] = value).unwrap();
    // Three patches show one image. Contents that there are not or that have no soft alpha, another depth, sides and levels that a
    // image cannot have, and images that are not there.
    for (at, value) in [
        (0, 12),
        (0, 5),
        (1, 1),
        (1, 3),
        (2, 0),
        (2, 9),
        (2, 255),
        (4, 255),
        (6, 255),
        (8, 255),
        (11, 0),
        (11, 13),
        (12, 1),
    ] {
        assert!(open(&form(at, value)).is_err(), "byte {at} is {value}");
    }
    // Any matrix is drawn somehow: flat, mirrored, with its horizon inside, or far away. One that is no number is refused.
    let matrices: [[f32; 9]; 6] = [
        [0.0; 9],
        [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        [-1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -2.0, 0.0, 1.0],
        [f32::MAX, f32::MIN, f32::MAX, 1e-30, f32::MAX, 0.0, f32::MIN, f32::MAX, f32::MAX],
        [1e30, 0.0, -1e30, 0.0, 1e30, 0.0, 0.0, 0.0, 1e-30],
    ];
    let with_matrix = |matrix: [f32; 9]| {
        let numbers: Vec<u8> = matrix.into_iter().flat_map(f32::to_le_bytes).collect();
        rewritten(&bytes, *b"ZMFM", |raw| raw[14..50].copy_from_slice(&numbers)).unwrap()
    };
    for matrix in matrices {
        exercise(open(&with_matrix(matrix)).unwrap().as_encoded());
    }
    for wrong in [f32::NAN, f32::INFINITY] {
        assert!(matches!(open(&with_matrix([wrong; 9])), Err(LoadError::Corrupt { .. })));
    }
    // Planes that are too short or too long.
    for change in [|raw: &mut Vec<u8>| raw.push(0), |raw: &mut Vec<u8>| _ = raw.pop()] {
        for id in [*b"ZMFM", *b"ZMRT", *b"ZMPA"] {
            assert!(open(&rewritten(&bytes, id, change).unwrap()).is_err(), "{id:?}");
        }
    }
    // As many patches as there may be, each over all of the root, cost no more than tiles of bounded lists.
    let many = rewritten(&bytes, *b"ZMFM", |raw| {
        raw.truncate(3);
        raw.extend([0, 8, 0, 8]);
        raw.extend([1, 0, 1, 0, 1].repeat(2048));
        for image in 0..2048u16 {
            raw.extend(image.to_le_bytes());
            raw.extend([1f32, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0].map(f32::to_le_bytes).concat());
        }
    });
    let many = rewritten(&many.unwrap(), *b"ZMPA", |raw| *raw = vec![128; 4 * 2048]).unwrap();
    let texture = open_with(&many, &LIMITS).unwrap().into_image().unwrap();
    let texel = texture.as_encoded().texel(ImageAddress { image: 0, level: 0, x: 5, y: 5 });
    assert!(texel.is_finite());
}

#[test]
fn a_file_larger_than_the_limits_is_refused() {
    let (_, _, texture) = &small_textures()[0];
    let bytes = texture.to_bytes();
    let tight = Limits { texels: 10, ..LIMITS };
    assert!(matches!(open_with(&bytes, &tight).and_then(AnyTexture::into_image), Err(LoadError::Limit(_))));
    let tight = Limits { bytes: 300, ..LIMITS };
    assert!(matches!(open_with(&bytes, &tight).and_then(AnyTexture::into_image), Err(LoadError::Limit(_))));
}

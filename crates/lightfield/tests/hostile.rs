//! Files that are cut, damaged or forged: a named error, or a light field that decodes everywhere.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

use glam::Vec3;
use texfold_core::container::{CodecId, SectionWriter, Sections};
use texfold_core::rng::Rng;
use texfold_core::{Access, Budget, Encoded, Encoder, Job, LightAddress, Limits, LoadError, TextureCodec};
use texfold_lightfield::{LightParams, LightTexture, Lightfield};
use texfold_testkit::capture::{Look, eyes, sphere};

const LIMITS: Limits = Limits { texels: 1 << 24, bytes: 256 << 20, sections: 64 };

fn file(content: texfold_bc::Content, codewords: f32) -> Vec<u8> {
    let params = LightParams::default().with_terms(2).with_grid(8);
    stored(&params.with_content(content).with_codewords(codewords), 6, 16)
}

/// A file in blocks.
fn blocks() -> Vec<u8> {
    let bytes = stored(&LightParams::default().with_terms(2), 12, 32);
    assert_eq!(open(&bytes, &mut Budget::new(LIMITS)).unwrap().access(), Access::Block);
    bytes
}

fn stored(params: &LightParams, views: u32, side: u32) -> Vec<u8> {
    let texture =
        Lightfield::encode(&sphere(Look::Glossy, views, side), params, &mut Job::default()).unwrap();
    let mut writer = SectionWriter::new(Lightfield::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

fn open(bytes: &[u8], budget: &mut Budget) -> Result<LightTexture, LoadError> {
    Lightfield::load(&Sections::parse(bytes, budget)?, budget)
}

/// Whatever loads must decode everywhere.
fn exercise(texture: &LightTexture) {
    let last = texture.layout().triangles - 1;
    for triangle in [0, last / 2, last, u32::MAX] {
        for barycentric in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::splat(9.0), Vec3::NAN, Vec3::NEG_ONE] {
            for direction in eyes(4, 1.0, 0.0).into_iter().chain([Vec3::ZERO, Vec3::NAN, Vec3::INFINITY]) {
                let texel = texture.texel(LightAddress { triangle, barycentric, direction });
                assert!(texel.is_finite(), "{triangle} {barycentric} {direction}: {texel}");
            }
        }
    }
    let _ = texture.gpu();
    let _ = texture.footprint();
}

#[test]
fn every_cut_names_what_is_missing_or_leaves_whole_terms() {
    for bytes in [file(texfold_bc::Content::Raw, 1.0), blocks()] {
        let mut seen = Vec::new();
        for length in 0..bytes.len() {
            match open(&bytes[..length], &mut Budget::new(LIMITS)) {
                Err(LoadError::Truncated { .. }) => {}
                Err(LoadError::NotTexfold) => assert_eq!(length, 0),
                Ok(texture) => seen.push(texture.layers().loaded),
                other => panic!("cut to {length} of {}: {other:?}", bytes.len()),
            }
        }
        seen.dedup();
        assert_eq!(seen, [1, 2]);
    }
}

#[test]
fn flipped_bytes_are_noticed() {
    let mut rng = Rng::new(11);
    for bytes in [file(texfold_bc::Content::Bc1, 0.3), blocks()] {
        for _ in 0..300 {
            let mut damaged = bytes.clone();
            let at = rng.index(bytes.len());
            damaged[at] ^= 1 << rng.index(8);
            assert!(open(&damaged, &mut Budget::new(LIMITS)).is_err(), "byte {at} changed unnoticed");
        }
    }
}

#[test]
fn numbers_of_maps_that_do_not_exist_are_named() {
    let bytes = file(texfold_bc::Content::Raw, 0.3);
    let forged = |section: [u8; 4], change: &dyn Fn(&mut Vec<u8>)| {
        open(&rewritten(&bytes, section, change), &mut Budget::new(LIMITS)).map(|texture| texture.layers())
    };
    // Behind three scales of each of 42 vertices: whether maps are shared, eight counts, then the numbers.
    let first = 3 * 42;
    for (at, value) in [(first, 2), (first + 1, 255), (first + 33, 255), (first + 29, 255)] {
        let found = forged(*b"LFQ0", &|raw| raw[at] = value);
        assert!(matches!(found, Err(LoadError::Corrupt { .. })), "byte {at} is {value}: {found:?}");
    }
    assert!(forged(*b"LFQ0", &|raw| raw.truncate(first)).is_err());
    assert!(forged(*b"LFQ1", &|raw| raw.push(0)).is_err());
    // Scales that are there where no map is: then there are fewer numbers than maps shown.
    assert!(forged(*b"LFQ1", &|raw| raw[..first].fill(9)).is_err());
}

/// The same file with the section `target` as `change` leaves it, all checksums right.
fn rewritten(bytes: &[u8], target: [u8; 4], change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let mut budget = Budget::default();
    let sections = Sections::parse(bytes, &mut budget).unwrap();
    let mut writer = SectionWriter::new(CodecId { number: sections.codec(), name: "" });
    for (id, _) in sections.ids() {
        let mut raw = sections.read(id, &mut budget).unwrap();
        if id == target {
            change(&mut raw);
        }
        writer.section("", id, &raw);
    }
    writer.finish().bytes
}

#[test]
fn forged_files_give_an_error_or_a_light_field_that_decodes() {
    let mut rng = Rng::new(5);
    let (mut refused, mut accepted) = (0, 0);
    let files = [file(texfold_bc::Content::Raw, 1.0), file(texfold_bc::Content::Bc7, 0.3), blocks()];
    for bytes in files {
        let ids: Vec<[u8; 4]> =
            Sections::parse(&bytes, &mut Budget::default()).unwrap().ids().map(|(id, _)| id).collect();
        for _ in 0..300 {
            let target = ids[rng.index(ids.len())];
            let (at, kind, value) = (rng.index(1 << 20), rng.index(4), rng.index(256) as u8);
            let forged = rewritten(&bytes, target, |raw| {
                let at = at % raw.len().max(1);
                match kind {
                    0 | 1 if !raw.is_empty() => raw[at] = value,
                    2 => raw.truncate(at),
                    _ => raw.extend([value; 7]),
                }
            });
            let mut budget = Budget::new(LIMITS);
            match open(&forged, &mut budget) {
                Ok(texture) => {
                    accepted += 1;
                    exercise(&texture);
                }
                Err(_) => refused += 1,
            }
            assert!(budget.peak_bytes() <= LIMITS.bytes);
        }
    }
    assert!(refused > 100 && accepted > 50, "{refused} refused, {accepted} accepted");
}

#[test]
fn maps_half_in_blocks_and_blocks_that_are_missing_are_named() {
    let (bytes, planes) = (blocks(), file(texfold_bc::Content::Raw, 1.0));
    let refused = |forged: &[u8]| open(forged, &mut Budget::new(LIMITS)).is_err();
    // Contents of the mean and of the maps.
    for (bytes, at, value) in [(&bytes, 12, 0), (&bytes, 13, 0), (&planes, 12, 255), (&planes, 13, 255)] {
        assert!(refused(&rewritten(bytes, *b"LFFM", |raw| raw[at] = value)), "byte {at} is {value}");
    }
    for section in [*b"RBB0", *b"RBD0", *b"RBB1", *b"RBD1"] {
        assert!(refused(&rewritten(&bytes, section, |raw| raw.truncate(raw.len() - 1))));
        assert!(refused(&without(&bytes, section)), "{}", String::from_utf8_lossy(&section));
    }
    // An atlas that is wider than the images of its blocks.
    assert!(refused(&rewritten(&bytes, *b"LFFM", |raw| raw[14] += 8)));
}

/// The same file without the section `target`.
fn without(bytes: &[u8], target: [u8; 4]) -> Vec<u8> {
    let mut budget = Budget::default();
    let sections = Sections::parse(bytes, &mut budget).unwrap();
    let mut writer = SectionWriter::new(CodecId { number: sections.codec(), name: "" });
    for (id, _) in sections.ids().filter(|(id, _)| *id != target) {
        writer.section("", id, &sections.read(id, &mut budget).unwrap());
    }
    writer.finish().bytes
}

#[test]
fn counts_that_no_writer_writes_are_named() {
    let bytes = file(texfold_bc::Content::Raw, 1.0);
    let form = |at: usize, value: &[u8]| {
        let forged = rewritten(&bytes, *b"LFFM", |raw| raw[at..at + value.len()].copy_from_slice(value));
        open(&forged, &mut Budget::new(LIMITS)).map(|texture| texture.layers())
    };
    for (at, value) in [
        (0, &[0, 0, 0, 0][..]),
        (0, &[0xff, 0xff, 0xff, 0xff]),
        (4, &[0, 0, 0, 0]),
        (4, &[0xff, 0xff, 0xff, 0x7f]),
        (8, &[9]),
        (9, &[0]),
        (9, &[7]),
        (9, &[68]),
        (10, &[3]),
        (11, &[2]),
        (12, &[2]),
        (13, &[99]),
        (14, &[0, 0]),
        (16, &[2, 0]),
        (18, &[9, 0]),
        (18, &[0, 0x40]),
    ] {
        assert!(matches!(form(at, value), Err(LoadError::Corrupt { .. })), "byte {at} is {value:?}");
    }
    // A file that says it has more terms than it has is taken for one that was cut.
    assert_eq!(form(8, &[5]), Ok(texfold_core::Layers { loaded: 3, total: 6 }));
    // Places so far away that directions overflow, and sides so large that maps do not fit a texture.
    let far = rewritten(&bytes, *b"LFME", |raw| raw[..12 * 42].fill(0x7f));
    assert!(matches!(open(&far, &mut Budget::new(LIMITS)), Err(LoadError::Corrupt { .. })));
    let large =
        rewritten(&bytes, *b"LFME", |raw| raw.iter_mut().rev().skip(1).take(80).for_each(|side| *side = 7));
    assert!(matches!(open(&large, &mut Budget::new(LIMITS)), Err(LoadError::Corrupt { .. })));
    // All places alike: normals that cancel out, still finite.
    let flat = rewritten(&bytes, *b"LFME", |raw| raw[..12 * 42].fill(0));
    exercise(&open(&flat, &mut Budget::new(LIMITS)).unwrap());
}

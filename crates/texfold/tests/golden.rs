//! Files of format version 1 that must open and decode to the same picture for as long as that version is read.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::path::PathBuf;

use texfold::metric::decode_surface;
use texfold::{Budget, open_image};

fn golden(name: &str) -> PathBuf {
    texfold_testkit::fixtures_dir().join("golden").join(name)
}

/// The file's images equal the golden pictures, to the last 8-bit step.
fn assert_decodes(name: &str, pictures: &[String]) {
    let bytes = std::fs::read(golden(&format!("{name}.txf"))).unwrap();
    let texture = open_image(&bytes, &mut Budget::default()).unwrap();
    assert_eq!(texture.as_encoded().layout().surfaces.len(), pictures.len(), "{name}");
    for (surface, picture) in pictures.iter().enumerate() {
        let wanted = texfold_testkit::png(&golden(picture));
        let decoded = decode_surface(texture.as_encoded(), surface as u32, 0).unwrap();
        assert_eq!(decoded.size(), wanted.size(), "{name}");
        assert!(decoded.to_bytes() == wanted.to_bytes(), "{name}: {picture} decodes otherwise than before");
    }
}

#[test]
fn plain_bc7_decodes_as_ever() {
    assert_decodes("bc_bc7", &["bc_bc7.png".to_owned()]);
}

#[test]
fn vq_with_a_bc1_codebook_and_mips_decodes_as_ever() {
    assert_decodes("vq_bc1_mips", &["vq_bc1_mips.png".to_owned()]);
}

#[test]
fn a_vq_sequence_decodes_as_ever() {
    let frames: Vec<String> = (0..5).map(|frame| format!("vq_raw_sequence-{frame:03}.png")).collect();
    assert_decodes("vq_raw_sequence", &frames);
}

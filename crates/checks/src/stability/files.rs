//! Files that are cut, damaged or forged: every reader says so or shows a picture.

use std::time::Instant;

use texfold::core::metric::decode_image;
use texfold::{AnyTexture, Limits, core::Budget};
use texfold::{
    core::container::{CodecId, SectionWriter, Sections},
    open_with,
};
use texfold_testkit::fixtures_dir;
use texfold_testkit::rng::Rng;

use super::guard::guarded;
use super::record::{self, Check, Row};
use super::{Extent, Outcome};

/// More than any of the files needs, far less than a hostile size would take.
const LIMITS: Limits = Limits { texels: 1 << 18, bytes: 16 << 20, sections: 64 };
/// Damaged files of each kind, quick and full.
const FILES: [u32; 2] = [100, 2000];
/// What opening and decoding one may take, in seconds: the whole ones take a hundredth.
const LONGEST: f64 = 5.0;

/// How a file is damaged.
struct Regime {
    name: &'static str,
    about: &'static str,
    damage: fn(&[u8], &mut Rng) -> Option<Vec<u8>>,
}

const REGIMES: [Regime; 3] = [
    Regime { name: "files cut short", about: "the end is missing, at any byte", damage: cut },
    Regime { name: "files with flipped bits", about: "one to eight bits are wrong", damage: flipped },
    Regime {
        name: "forged files",
        about: "sections changed and every checksum made right again",
        damage: forged,
    },
];

fn cut(bytes: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    Some(bytes[..rng.index(bytes.len())].to_vec())
}

fn flipped(bytes: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    let mut wrong = bytes.to_vec();
    for _ in 0..=rng.index(8) {
        let at = rng.index(wrong.len());
        wrong[at] ^= 1 << rng.index(8);
    }
    Some(wrong)
}

fn forged(bytes: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    let mut budget = Budget::default();
    let sections = Sections::parse(bytes, &mut budget).ok()?;
    let ids: Vec<[u8; 4]> = sections.ids().map(|(id, _)| id).collect();
    let target = rng.index(ids.len());
    let mut writer = SectionWriter::new(CodecId { number: sections.codec(), name: "" });
    for (index, &id) in ids.iter().enumerate() {
        let mut raw = sections.read(id, &mut budget).ok()?;
        for _ in 0..if index == target { 1 + rng.index(3) } else { 0 } {
            let at = rng.index(raw.len().max(1));
            match rng.index(3) {
                0 if at < raw.len() => raw[at] = rng.index(256) as u8,
                1 => raw.truncate(at),
                _ => raw.splice(at.min(raw.len()).., [0xff, 0xff, 0xff, 0x7f]).for_each(drop),
            }
        }
        writer.section("", id, &raw);
    }
    Some(writer.finish().bytes)
}

/// What each regime is about.
pub(super) fn about() -> Vec<(&'static str, &'static str)> {
    REGIMES.iter().map(|regime| (regime.name, regime.about)).collect()
}

/// Every golden file damaged in every way.
///
/// # Errors
/// Where the golden files cannot be read.
pub(super) fn rows(extent: Extent, say: &mut dyn FnMut(Row)) -> Outcome<()> {
    let mut paths: Vec<_> = std::fs::read_dir(fixtures_dir().join("golden"))?
        .map(|entry| Ok(entry?.path()))
        .collect::<Outcome<_>>()?;
    paths.retain(|path| path.extension().is_some_and(|name| name == "txf"));
    paths.sort();
    for regime in &REGIMES {
        for path in &paths {
            let bytes = std::fs::read(path)?;
            let start = Instant::now();
            let outcome = damaged(&bytes, regime, FILES[usize::from(extent == Extent::Full)]);
            let codec = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let seconds = start.elapsed().as_secs_f64();
            say(Row { regime: regime.name, codec, outcome, seconds, pictures: Vec::new() });
        }
    }
    Ok(())
}

/// So many damaged files, each opened and decoded.
fn damaged(bytes: &[u8], regime: &Regime, files: u32) -> record::Outcome {
    let mut rng = Rng::new(bytes.len() as u64);
    let (mut panics, mut opened, mut slowest) = (0u32, 0u32, 0f64);
    let mut words = String::new();
    for _ in 0..files {
        let Some(wrong) = (regime.damage)(bytes, &mut rng) else { continue };
        let start = Instant::now();
        match guarded(|_| shown(&wrong)) {
            Ok(shown) => opened += u32::from(shown),
            Err(fault) => {
                panics += 1;
                words = fault;
            }
        }
        slowest = slowest.max(start.elapsed().as_secs_f64());
    }
    record::Outcome::Made {
        verdict: format!("{opened} of {files} open and are decoded, the others are refused. {words}"),
        psnr: f64::NAN,
        bpp: 8.0 * bytes.len() as f64,
        checks: vec![
            Check::most("panics", f64::from(panics), 0.0),
            Check::most("seconds of the slowest file", slowest, LONGEST),
        ],
    }
}

/// Whether a file opens; what opens is decoded and stored again.
fn shown(bytes: &[u8]) -> bool {
    let Ok(texture) = open_with(bytes, &LIMITS) else { return false };
    if let AnyTexture::Image(image) = &texture {
        let images = image.as_encoded().layout().images.len().min(2);
        for index in 0..images as u32 {
            let _ = decode_image(image.as_encoded(), index, 0);
        }
    }
    let _ = texture.to_bytes();
    true
}

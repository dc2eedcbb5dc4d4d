//! How `preset_dependent.txt` was made and measured: stopping probabilities of parts of images, at several sizes and bits a texel.
//!
//! Made anew it differs a little, as the encoder whose symbols are counted begins from it.

use super::fit::{StopBits, fit_from};
use super::symbols::Counts;
use super::{DctEncoder, DctSettings, DctSource};
use crate::context::TABLES;
use crate::tables::{Begin, PRESET_ZERO, SYMBOLS};
use texfold_core::{CancelCheck, Effort, Goal, ImageSize};

/// Symbols that each texture counts as.
const WEIGHT: f64 = 1e5;
/// Texels a side of the parts.
const SIDES: [u32; 3] = [64, 128, 256];
/// Bits a texel.
const BITS: [f64; 3] = [0.4, 1.0, 2.5];

/// Hands the counts of three parts of an image to `take`, for each of [`SIDES`] and [`BITS`].
fn each(path: &std::path::Path, mut take: impl FnMut(usize, usize, Counts)) {
    let Ok(image) = image::open(path) else { return };
    let image = image.to_rgb8();
    for (number, side) in SIDES.into_iter().enumerate() {
        for third in 0..3 {
            let (x, y) = (image.width() * third / 3, image.height() * third / 3);
            let part = image::imageops::crop_imm(&image, x, y, side, side).to_image();
            let size = ImageSize { width: part.width(), height: part.height() };
            let samples = part.iter().map(|&value| value.into()).collect();
            let source = DctSource::new(size, &[3], 8, samples).unwrap();
            for (rate, bits) in BITS.into_iter().enumerate() {
                let goal = Goal::Bpp(bits);
                let settings = DctSettings { goal, effort: Effort::Fast, ..DctSettings::default() };
                let encoder = DctEncoder::new(&source, &settings, CancelCheck::default()).unwrap();
                let Ok(texture) = encoder.encode() else { continue };
                take(number, rate, encoder.counts(texture.form().quantiser.step));
            }
        }
    }
}

/// Every second file, by name: the preset is made of these, and never measured on them.
fn files(odd: bool) -> Vec<std::path::PathBuf> {
    let folders = std::env::var("TEXFOLD_IMAGES").unwrap();
    let mut all = Vec::new();
    for folder in folders.split(':') {
        let mut found: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|p| p.is_file())
            .collect();
        found.sort();
        all.extend(found.into_iter().skip(usize::from(odd)).step_by(2));
    }
    all
}

/// Writes `preset_dependent.txt`: `TEXFOLD_IMAGES=folder:folder cargo test --release -p texfold-dct --lib training -- --ignored`.
#[test]
#[ignore = "needs photographs"]
fn preset_of_images() {
    let mut sums = vec![[0f64; SYMBOLS]; TABLES];
    for path in files(false) {
        each(&path, |_, _, counts| {
            let all: u32 = counts.iter().flatten().sum();
            let scale = WEIGHT / f64::from(all.max(1));
            let rows = sums.iter_mut().zip(&counts);
            rows.for_each(|(sums, counts)| {
                sums.iter_mut().zip(counts).for_each(|(s, &c)| *s += scale * f64::from(c));
            });
        });
    }
    let counts: Counts = sums.iter().map(|row| row.map(|sum| sum.round() as u32)).collect();
    let fitted = fit_from(&counts, Begin::Alike, &StopBits::new());
    let letters: String = fitted
        .all
        .iter()
        .flat_map(|stops| stops.values().iter().map(|&v| char::from(PRESET_ZERO + v)))
        .collect();
    std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/src/preset_dependent.txt"), letters).unwrap();
}

/// Prints bits of tables and symbols of files that the preset was not made of, from the preset as a share of those from tables that are alike.
#[test]
#[ignore = "needs photographs"]
fn bits_with_and_without() {
    let bits = StopBits::new();
    let mut sums = [[[0.0f64; 2]; BITS.len()]; SIDES.len()];
    for path in files(true) {
        each(&path, |side, rate, counts| {
            for (sum, begin) in sums[side][rate].iter_mut().zip([Begin::Alike, Begin::Preset]) {
                *sum += fit_from(&counts, begin, &bits).bits(&counts, &bits);
            }
        });
    }
    for (side, sums) in SIDES.iter().zip(sums) {
        for (rate, [alike, preset]) in BITS.iter().zip(sums) {
            println!("{side} at {rate}: {:.4}", preset / alike);
        }
    }
}

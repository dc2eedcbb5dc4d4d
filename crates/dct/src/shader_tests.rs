//! The functions of `block.wgsl`, on the CPU, give the texels of the decoder.
#![cfg(feature = "encode")]

use crate::MAX_CHANNELS;
use crate::context::{
    ESCAPE, ESCAPE_BITS, FIRST_END, FIRST_LAST, FIRST_ODD, LEVELS, NEXT_STATES, ODD_ROWS, SET_TABLES, SIGNS,
};
use crate::deblock::{FIRST_TAPS, OTHER_TAPS};
use crate::encode::{DctEncoder, DctSettings, DctSource};
use crate::gpu::{LEVEL_WORDS, SCAN_WORDS, SYMBOL_WORDS, TABLE_WORDS};
use crate::tables::{Begin, PROBABILITY_BITS, StoredStops};
use crate::{DctTexture, Stage};
use texfold_core::container::Reader;
use texfold_core::rng::Rng;
use texfold_core::{Budget, CancelCheck, ImageSize, Metric, Rect, String4};
use texfold_testkit::dct::*;

/// A texture of noise on a slope, with superblocks of that side, at that step.
fn texture((width, height): (u32, u32), groups: &[u8], depth: u8, log2: u8, step: u16) -> DctTexture {
    let mut rng = Rng::new(u64::from(step));
    let channels: u32 = groups.iter().map(|&channels| u32::from(channels)).sum();
    let scale = if depth > 8 { 257 } else { 1 };
    let sample = |at: u32| (at / channels % width / 2 + rng.below(60) + at % channels * 40).min(255) * scale;
    let samples = (0..width * height * channels).map(sample).map(|sample| sample as u16).collect();
    let source = DctSource::new(ImageSize { width, height }, groups, depth, samples).unwrap();
    let params = DctSettings::default().with_superblock_log2(log2).with_metric(Metric::Psnr);
    DctEncoder::new(&source, &params, CancelCheck::default()).unwrap().at_step(step).unwrap()
}

/// The decoder's texels of a rectangle, and the twin's.
fn both(texture: &DctTexture, rect: Rect) -> [Vec<u16>; 2] {
    let mut out = vec![0u16; (rect.width * rect.height) as usize * texture.form().channels()];
    texture.decode(rect, &mut out).unwrap();
    [out, decode(&texture.gpu(Stage::default()), rect).unwrap()]
}

fn whole(texture: &DctTexture) -> Rect {
    let ImageSize { width, height } = texture.form().size;
    Rect { image: 0, level: 0, x: 0, y: 0, width, height }
}

/// Columns and rows, channels of each group, bits of a sample, binary logarithm of a superblock's side, step.
type Shape = ((u32, u32), &'static [u8], u8, u8, u16);

#[test]
fn images_equal_those_of_the_decoder() {
    let shapes: [Shape; 6] = [
        ((1, 1), &[3], 8, 4, 2000),
        ((3, 5), &[1], 8, 5, 1200),
        ((129, 8), &[3, 1], 8, 4, 1600),
        ((37, 61), &[4], 16, 5, 3600),
        ((150, 200), &[2, 3], 8, 6, 800),
        ((40, 90), &[4, 4, 4, 4], 8, 6, 1800),
    ];
    for (size, groups, depth, log2, step) in shapes {
        for strength in [0, 1, 3] {
            let texture = texture(size, groups, depth, log2, step).with_deblocking(strength);
            let [wanted, found] = both(&texture, whole(&texture));
            assert!(wanted == found, "{size:?} {groups:?} {strength}");
        }
    }
}

/// Streams read as if quantisers were not dependent, by other tables: any bytes decode.
#[test]
fn independent_quantisers_equal_those_of_the_decoder() {
    for begin in [Begin::Alike, Begin::Preset] {
        let DctTexture { mut form, index, bytes, stream_bytes, .. } =
            texture((150, 200), &[2, 3], 8, 5, 1500);
        form.quantiser.is_dependent = false;
        form.intra = None;
        // All rows of tables as predicted.
        let stops = StoredStops { begin, is_dependent: false, bytes: vec![255; 4] };
        let texture = DctTexture::new(form, stops, index, bytes, stream_bytes);
        let [wanted, found] = both(&texture, whole(&texture));
        assert!(wanted == found, "{begin:?}");
    }
}

/// Streams of noise have all modes.
#[test]
fn all_intra_modes_equal_those_of_the_decoder() {
    let mut rng = Rng::new(8);
    for log2 in [4, 5, 6] {
        let DctTexture { mut form, stops, index, mut bytes, stream_bytes, .. } =
            texture((150, 200), &[2, 3], 8, log2, 1500);
        form.intra = Some([10, 20, 30]);
        bytes.iter_mut().for_each(|byte| *byte = rng.below(256) as u8);
        let texture = DctTexture::new(form, stops, index, bytes, stream_bytes);
        let [wanted, found] = both(&texture, whole(&texture));
        assert!(wanted == found, "superblocks of {log2}");
    }
}

#[test]
fn rectangles_equal_those_of_the_decoder() {
    let texture = texture((600, 140), &[3], 8, 4, 1680).with_deblocking(2);
    let mut rng = Rng::new(1);
    for _ in 0..30 {
        let (x, y) = (rng.below(600), rng.below(140));
        let (width, height) = (1 + rng.below(600 - x), 1 + rng.below(140 - y));
        let rect = Rect { x, y, width, height, ..whole(&texture) };
        let [wanted, found] = both(&texture, rect);
        assert!(wanted == found, "{rect:?}");
    }
}

#[test]
fn roots_are_rounded() {
    let near = |value: u32| [value.saturating_sub(1), value, value.saturating_add(1)];
    let squares =
        (0..=65535u32).flat_map(|root| near(root * root).into_iter().chain(near(root * root + root)));
    for value in squares.chain([u32::MAX, u32::MAX - 1, 1 << 31]) {
        assert_eq!(texfold_block_root(value), f64::from(value).sqrt().round() as u32, "{value}");
    }
}

#[test]
fn forged_streams_and_lengths_decode_alike() {
    let texture = texture((150, 70), &[3], 8, 5, 1200).with_deblocking(3);
    let bytes = texture.to_bytes();
    let streams = texture.gpu(Stage::default()).streams.len();
    let mut rng = Rng::new(7);
    for round in 0..60 {
        // The index stands before tables and streams; every other round forges it alone, and never the header.
        let mut forged = bytes.clone();
        let first = if round % 2 == 0 { bytes.len() - streams } else { 60 };
        let last = if round % 2 == 0 { bytes.len() } else { bytes.len() - streams };
        for _ in 0..1 + rng.below(40) {
            forged[first + rng.below((last - first) as u32) as usize] = rng.below(256) as u8;
        }
        let mut reader = Reader::new(String4(*b"TEST"), &forged);
        let Ok(texture) = DctTexture::read(&mut reader, &mut Budget::default()) else { continue };
        let [wanted, found] = both(&texture, whole(&texture));
        assert!(wanted == found, "round {round}");
    }
}

#[test]
fn plain_numbers_of_the_shader_are_those_of_the_decoder() {
    let words = [
        (TEXFOLD_BLOCK_SCAN, SCAN_WORDS),
        (TEXFOLD_BLOCK_LEVELS, LEVEL_WORDS),
        (TEXFOLD_BLOCK_SYMBOLS, SYMBOL_WORDS),
        (texfold_shaders::DCT_TABLES, TABLE_WORDS),
        (TEXFOLD_BLOCK_SET_TABLES, SET_TABLES),
        (TEXFOLD_BLOCK_ZONE_TABLES, LEVELS),
        (4 * TEXFOLD_BLOCK_SET_TABLES, FIRST_ODD),
        (TEXFOLD_BLOCK_ODD_TABLES, ODD_ROWS * LEVELS),
        (TEXFOLD_BLOCK_NEXT_EVEN, NEXT_STATES[0] as usize),
        (TEXFOLD_BLOCK_NEXT_ODD, NEXT_STATES[1] as usize),
        (TEXFOLD_BLOCK_FIRST_LAST, FIRST_LAST),
        (TEXFOLD_BLOCK_FIRST_END, FIRST_END),
        (TEXFOLD_BLOCK_ESCAPE, ESCAPE),
        (TEXFOLD_BLOCK_ESCAPE_BITS, ESCAPE_BITS as usize),
        (TEXFOLD_BLOCK_PROBABILITY_BITS, PROBABILITY_BITS as usize),
        (TEXFOLD_BLOCK_NOTES, texfold_shaders::BLOCK_NOTES as usize),
        (TEXFOLD_BLOCK_WORDS, texfold_shaders::BLOCK_WORDS as usize),
        (TEXFOLD_BLOCK_MAX_ROUNDS, 64 * 33 * MAX_CHANNELS),
        (16, SIGNS),
    ];
    for (number, (of_shader, of_decoder)) in words.into_iter().enumerate() {
        assert_eq!(of_shader as usize, of_decoder, "number {number}");
    }
    let first = [TEXFOLD_BLOCK_FIRST_NEAR, TEXFOLD_BLOCK_FIRST_FAR];
    let other = [TEXFOLD_BLOCK_OTHER_NEAR, TEXFOLD_BLOCK_OTHER_FAR];
    assert_eq!((FIRST_TAPS[..2].to_vec(), OTHER_TAPS[..2].to_vec()), (first.to_vec(), other.to_vec()));
}

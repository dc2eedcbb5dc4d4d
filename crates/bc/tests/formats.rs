//! Whole planes of every format against an independent decoder, regions against samples, and cells that are copied.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use proptest::prelude::*;
use texfold_bc::{Bc, BcParams, BcTexture, Content, ContentPlanes};
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, PixelInfo, Raster};
use texfold_core::rng::Rng;
use texfold_core::{
    Budget, Effort, Encoded, Encoder, Goal, ImageAddress, Job, Limits, LoadError, Rect, Texel, TextureCodec,
};

/// What an independent decoder may round otherwise (Direct3D 11.3 specification, 19.5).
const ROUNDING: f32 = 2.0 / 255.0;

fn pixel(channels: u8) -> PixelInfo {
    let alpha = if channels.is_multiple_of(2) { Alpha::Straight } else { Alpha::Opaque };
    PixelInfo { channels, depth: Depth::Eight, color: ColorSpace::Srgb, alpha }
}

/// A format, the channels of a source that it suits, and how another crate decodes its blocks of 4x4 RGBA texels.
type Case = (Content, u8, fn(&[u8]) -> [[u8; 4]; 16]);

fn rgba(block: &[u8], decode: fn(&[u8], &mut [u8], usize)) -> [[u8; 4]; 16] {
    let mut texels = [[0; 4]; 16];
    decode(block, texels.as_flattened_mut(), 16);
    texels
}

const CASES: [Case; 5] = [
    (Content::Bc1, 3, |block| rgba(block, bcdec_rs::bc1)),
    (Content::Bc3, 4, |block| rgba(block, bcdec_rs::bc3)),
    (Content::Bc7, 4, |block| rgba(block, bcdec_rs::bc7)),
    (Content::Bc4, 1, |block| {
        let mut gray = [0; 16];
        bcdec_rs::bc4(block, &mut gray, 4, false);
        gray.map(|gray| [gray, gray, gray, 255])
    }),
    (Content::Bc5, 2, |block| {
        let mut two = [[0; 2]; 16];
        bcdec_rs::bc5(block, two.as_flattened_mut(), 8, false);
        two.map(|[gray, alpha]| [gray, gray, gray, alpha])
    }),
];

fn noise(seed: u64, width: u32, height: u32) -> Vec<Texel> {
    let mut rng = Rng::new(seed);
    (0..width * height).map(|_| Texel::from_array([(); 4].map(|()| rng.unit() as f32))).collect()
}

#[test]
fn every_texel_of_a_plane_is_the_one_that_another_decoder_finds() {
    for (content, channels, decode) in CASES {
        for (width, height) in [(1, 1), (4, 4), (5, 3), (37, 18)] {
            let texels = noise(1, width, height);
            let planes =
                ContentPlanes::encode(content, pixel(channels), (width, height), &texels, Effort::Fast);
            let (format, bytes) = &planes.planes()[0];
            assert_eq!(bytes.len() as u64, format.bytes(width, height));
            let columns = width.div_ceil(4);
            for (index, texel) in planes.decode().iter().enumerate() {
                let (x, y) = (index as u32 % width, index as u32 / width);
                let start = (y / 4 * columns + x / 4) as usize * format.block_bytes() as usize;
                let block = decode(&bytes[start..start + format.block_bytes() as usize]);
                let mut other = block[(y % 4 * 4 + x % 4) as usize].map(|byte| f32::from(byte) / 255.0);
                if channels == 3 {
                    other[3] = 1.0;
                }
                let away = (*texel - Texel::from_array(other)).abs().max_element();
                assert!(away <= ROUNDING, "{content:?} {width}x{height} at {x}, {y}: {texel} {other:?}");
            }
        }
    }
}

#[test]
fn finer_formats_and_more_effort_are_no_worse() {
    let (width, height) = (32, 32);
    let smooth: Vec<Texel> = (0..width * height)
        .map(|i| Texel::new(i as f32 / 1024.0, (i % 32) as f32 / 32.0, 0.3, 1.0))
        .collect();
    let error = |content, effort| {
        let planes = ContentPlanes::encode(content, pixel(4), (width, height), &smooth, effort);
        planes.decode().iter().zip(&smooth).map(|(a, b)| (*a - *b).length_squared()).sum::<f32>()
    };
    let bc1 = error(Content::Bc1, Effort::Normal);
    // Two ramps across each other lie on no line of colours: 27 dB.
    assert!(bc1 < 2e-3 * 1024.0, "{bc1}");
    assert!(error(Content::Bc1, Effort::High) <= bc1 * 1.001);
    assert!(error(Content::Bc7, Effort::Normal) < 0.5 * bc1);
    assert!(error(Content::Raw, Effort::Fast) < 1024.0 * 4.0 * 0.5f32.powi(2) / 255.0f32.powi(2));
}

fn texture(content: Content, channels: u8, mips: bool, reduce_log2: u32) -> BcTexture {
    let raster = |seed, width, height| {
        let texels = noise(seed, width, height);
        Raster::from_texels(width, height, pixel(channels), &texels).unwrap()
    };
    let set = ImageSet::new(vec![raster(1, 37, 18), raster(2, 6, 41)]).unwrap();
    let params = BcParams::default()
        .with_goal(Goal::Bpp(99.0))
        .with_content(content)
        .with_mips(mips)
        .with_reduce_log2(reduce_log2)
        .with_effort(Effort::Fast);
    Bc::encode(&set, &params, &mut Job::default()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn a_region_is_its_samples(
        place in (0u32..64, 0u32..64, 1u32..64, 1u32..64), image in 0u32..2, level in 0u32..6,
    ) {
        thread_local! {
            static TEXTURES: Vec<BcTexture> = CASES
                .iter()
                .map(|&(content, channels, _)| (content, channels))
                .chain([(Content::Raw, 3)])
                .flat_map(|(content, channels)| [(content, channels, 0), (content, channels, 2)])
                // Plain bytes are never reduced.
                .filter(|&(content, _, reduce)| content != Content::Raw || reduce == 0)
                .map(|(content, channels, reduce)| texture(content, channels, true, reduce))
                .collect();
        }
        TEXTURES.with(|textures| {
            for texture in textures {
                let level = level % texture.layout().levels;
                let whole = texture.layout().whole(image, level).unwrap();
                let (x, y) = (place.0 % whole.width, place.1 % whole.height);
                let (width, height) = (place.2.min(whole.width - x), place.3.min(whole.height - y));
                let mut out = vec![Texel::ZERO; (width * height) as usize];
                texture.decode(Rect { image, level, x, y, width, height }, &mut out).unwrap();
                for (index, texel) in out.iter().enumerate() {
                    let (x, y) = (x + index as u32 % width, y + index as u32 / width);
                    assert_eq!(*texel, texture.texel(ImageAddress { image, level, x, y }), "{:?}", texture.content());
                }
            }
        });
    }

    #[test]
    fn cells_that_are_written_or_copied_change_nothing_else(
        seed in any::<u64>(), column in 0u32..5, row in 0u32..4, to in (0u32..7, 0u32..7), more in 0u32..2,
    ) {
        for (content, channels) in [(Content::Raw, 3), (Content::Bc1, 3), (Content::Bc5, 2), (Content::Bc7, 4)] {
            let encode = |seed, size: (u32, u32)| {
                ContentPlanes::encode(content, pixel(channels), size, &noise(seed, size.0, size.1), Effort::Fast)
            };
            let old = encode(seed, (20, 16));
            let fresh: [Texel; 16] = noise(seed ^ 1, 4, 4).try_into().unwrap();
            let height = 16 + 4 * more;
            let grown = old.with_cells(&[(4 * column, 4 * row, fresh)], height);
            prop_assert_eq!(grown.size(), (20, height));
            let (before, after) = (old.decode(), grown.decode());
            let alone = ContentPlanes::encode(content, pixel(channels), (4, 4), &fresh, Effort::Normal).decode();
            for (index, texel) in after.iter().enumerate().take(20 * 16) {
                let (x, y) = (index as u32 % 20, index as u32 / 20);
                let inside = x / 4 == column && y / 4 == row;
                let wanted = if inside { alone[(y % 4 * 4 + x % 4) as usize] } else { before[index] };
                prop_assert_eq!(*texel, wanted, "{:?} at {}, {}", content, x, y);
            }
            // Copied to another cell of other planes; those outside are left out.
            let mut copy = encode(seed ^ 2, (28, 24));
            let untouched = copy.decode();
            copy.copy_cells(&old, [((column, row), to), ((9, 9), (0, 0))]);
            for (index, texel) in copy.decode().iter().enumerate() {
                let (x, y) = (index as u32 % 28, index as u32 / 28);
                let inside = (x / 4, y / 4) == to && to.1 < 6;
                let from = (4 * row + y % 4) * 20 + 4 * column + x % 4;
                let wanted = if inside { before[from as usize] } else { untouched[index] };
                prop_assert_eq!(*texel, wanted, "{:?} at {}, {}", content, x, y);
            }
        }
    }
}

fn file(texture: &BcTexture) -> Vec<u8> {
    let mut writer = SectionWriter::new(Bc::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

#[test]
fn what_is_stored_is_loaded_within_a_budget() {
    for (content, channels, _) in CASES {
        let texture = texture(content, channels, true, 0);
        let bytes = file(&texture);
        let load = |limit: u64| {
            let mut budget = Budget::new(Limits { bytes: limit, ..Limits::default() });
            Sections::parse(&bytes, &mut budget).and_then(|sections| Bc::load(&sections, &mut budget))
        };
        assert_eq!(load(1 << 20), Ok(texture.clone()), "{content:?}");
        let held = texture.memory().compressed / 8;
        assert!(
            matches!(load(2 * held), Err(LoadError::Limit(_))),
            "planes, their copy and the section do not fit"
        );
    }
}

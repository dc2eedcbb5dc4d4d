//! The block form as a whole: images in, texels out.
#![cfg(feature = "encode")]

use std::sync::atomic::Ordering::Relaxed;

use texfold_core::container::{Reader, SectionWriter, Sections};
use texfold_core::image::PixelInfo;
use texfold_core::rng::Rng;
use texfold_core::{
    Budget, Cancel, CancelCheck, CodecId, Effort, EncodeError, Goal, ImageAddress, ImageLayout, ImageSize,
    Job, Limits, LoadError, Metric, Rect, RegionError, String4, Texel,
};

use super::encode::{DctEncoder, DctSettings, DctSource};
use crate::vectors::NARROW;
use texfold_core::container::ContentId;

use super::*;

const ID: String4 = String4(*b"TEST");

/// Smooth waves, an edge and some noise, the same for any size.
fn waves(width: u32, height: u32, groups: &[u8], depth: u8) -> DctSource {
    let mut rng = Rng::new(5);
    let channels: u8 = groups.iter().sum();
    let largest = if depth == 8 { 255.0 } else { 65535.0 };
    let mut samples = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (f64::from(x) / 11.0, f64::from(y) / 17.0);
            let edge = if x + 2 * y > width { 0.25 } else { 0.0 };
            for channel in 0..channels {
                let tint = f64::from(channel % 3) * 0.3;
                let value = 0.45 + 0.2 * (u + tint).sin() * v.cos() + edge * (1.0 - tint);
                samples.push(((value + 0.02 * rng.unit()) * largest) as u16);
            }
        }
    }
    DctSource::new(ImageSize { width, height }, groups, depth, samples).unwrap()
}

fn encoded(source: &DctSource, params: DctSettings) -> DctTexture {
    DctEncoder::new(source, &params, CancelCheck::default()).unwrap().encode().unwrap()
}

fn read(bytes: &[u8]) -> Result<DctTexture, LoadError> {
    let mut reader = Reader::new(ID, bytes);
    let texture = DctTexture::read(&mut reader, &mut Budget::default())?;
    reader.end()?;
    Ok(texture)
}

fn all_of(texture: &DctTexture) -> Rect {
    let ImageSize { width, height } = texture.form().size;
    Rect { image: 0, level: 0, x: 0, y: 0, width, height }
}

fn decoded(texture: &DctTexture, rect: Rect) -> Vec<u16> {
    let mut out = vec![0; rect.width as usize * rect.height as usize * texture.form().channels()];
    texture.decode(rect, &mut out).unwrap();
    out
}

fn psnr(source: &DctSource, texture: &DctTexture, largest: f64) -> f64 {
    let found = decoded(texture, all_of(texture));
    let sum: f64 = found.iter().zip(source.samples()).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2)).sum();
    10.0 * (largest * largest * found.len() as f64 / sum.max(1e-9)).log10()
}

#[test]
fn images_of_any_shape_come_back() {
    let shapes: [(u32, u32, &[u8], u8); 7] = [
        (1, 1, &[3], 8),
        (3, 5, &[1], 8),
        (70, 130, &[3], 8),
        (65, 9, &[3, 1], 8),
        (40, 33, &[2], 16),
        (17, 300, &[4, 4, 4, 4], 8),
        (129, 64, &[1, 2], 16),
    ];
    for (width, height, groups, depth) in shapes {
        let source = waves(width, height, groups, depth);
        let params = DctSettings::default().with_goal(Goal::Psnr(48.0)).with_metric(Metric::Psnr);
        let texture = encoded(&source, params);
        let reread = read(&texture.to_bytes()).unwrap();
        assert_eq!(reread.form(), texture.form());
        assert_eq!(decoded(&reread, all_of(&reread)), decoded(&texture, all_of(&texture)));
        let db = psnr(&source, &reread, if depth == 8 { 255.0 } else { 65535.0 });
        assert!(db >= 48.0, "{width}x{height}: {db}");
    }
}

/// The texture with another strength of deblocking, as a file says it.
fn with_strength(texture: &DctTexture, strength: u8) -> Result<DctTexture, LoadError> {
    let mut bytes = texture.clone().with_deblocking(1).to_bytes();
    // Behind version, sizes, depth, superblock, quantiser and intra modes.
    assert!(texture.form().intra.is_some());
    assert_eq!((bytes[0] % 2, bytes[15]), (0, 1));
    bytes[15] = strength;
    read(&bytes)
}

#[test]
fn strengths_of_deblocking_are_stored_and_others_refused() {
    let source = waves(70, 50, &[3, 1], 8);
    let params = DctSettings::default().with_metric(Metric::Psnr);
    let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
    let texture = encoder.at_step(1600).unwrap();
    let plain = texture.clone().with_deblocking(0);
    assert_eq!(plain.to_bytes()[0] % 2, 1, "an even version has deblocking");
    assert_eq!(read(&plain.to_bytes()).unwrap().form().deblocking, 0);
    let mut all = vec![decoded(&plain, all_of(&plain))];
    for strength in 1..=MAX_DEBLOCKING {
        let read = with_strength(&texture, strength).unwrap();
        assert_eq!(read.form().deblocking, strength);
        all.push(decoded(&read, all_of(&read)));
    }
    assert!(all.windows(2).all(|pair| pair[0] != pair[1]));
    for strength in [0, MAX_DEBLOCKING + 1, 255] {
        assert!(matches!(with_strength(&texture, strength), Err(LoadError::Corrupt { .. })), "{strength}");
    }
}

#[test]
fn probabilities_of_modes_beyond_the_largest_are_refused() {
    let texture = encoded(&waves(200, 140, &[3], 8), DctSettings::default().with_goal(Goal::Psnr(40.0)));
    assert!(texture.form().intra.is_some());
    let bytes = texture.to_bytes();
    for at in 12..15 {
        let mut forged = bytes.clone();
        forged[at] = 63;
        assert!(read(&forged).is_ok());
        forged[at] = 64;
        assert!(matches!(read(&forged), Err(LoadError::Corrupt { .. })));
    }
    // Modes are of dependent quantisers alone.
    let mut forged = bytes;
    forged[0] -= 8;
    assert!(matches!(read(&forged), Err(LoadError::Corrupt { .. })));
}

#[test]
fn lines_are_continued_by_intra_modes() {
    let size = ImageSize { width: 96, height: 96 };
    let angle = |at: u32| f64::from(at % 96) + 0.4 * f64::from(at / 96);
    let samples: Vec<u8> = (0..96 * 96).map(|at| (128.0 + 90.0 * (0.9 * angle(at)).sin()) as u8).collect();
    let source = DctSource::from_u8(size, &[1], &samples).unwrap();
    let params = DctSettings::default().with_metric(Metric::Psnr);
    let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
    let texture = encoder.at_step(1500).unwrap();
    assert!(texture.form().intra.is_some());
    // Of an image whose blocks' neighbours say nothing of them, no block has a mode.
    let flat = DctSource::from_u8(size, &[1], &vec![77; samples.len()]).unwrap();
    let encoder = DctEncoder::new(&flat, &params, CancelCheck::default()).unwrap();
    assert_eq!(encoder.at_step(1500).unwrap().form().intra, None);
}

/// A texture as `to_bytes` gave it of the fixture `cutout.png` at step 1700, without mip levels, and its texels then.
#[test]
fn a_deblocked_texture_decodes_as_ever() {
    let golden = |name: &str| texfold_testkit::fixtures_dir().join("golden").join(name);
    let texture = read(&std::fs::read(golden("block_deblocked.bin")).unwrap()).unwrap();
    assert!(texture.form().deblocking > 0);
    let found: Vec<u8> = decoded(&texture, all_of(&texture)).iter().map(|&sample| sample as u8).collect();
    assert!(found == texfold_testkit::png(&golden("block_deblocked.png")).to_bytes());
}

#[test]
fn deblocking_leaves_the_borders_of_superblocks() {
    let source = waves(96, 64, &[1], 8);
    let params = DctSettings::default().with_metric(Metric::Psnr);
    let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
    let texture = encoder.at_step(1800).unwrap();
    let plain = decoded(&texture.clone().with_deblocking(0), all_of(&texture));
    let filtered = decoded(&texture.clone().with_deblocking(3), all_of(&texture));
    let changed = |x: usize| (0..64).any(|y| plain[y * 96 + x] != filtered[y * 96 + x]);
    // Rows are filtered, too, but those far from borders of rows of blocks change by columns alone.
    let by_columns = |x: usize| {
        (0..64).filter(|y| (2..6).contains(&(y % 8))).any(|y| plain[y * 96 + x] != filtered[y * 96 + x])
    };
    assert!((0..96).any(changed));
    for x in (0..96).filter(|&x| by_columns(x)) {
        let border = (x + 2) / 8 * 8;
        assert!(border.abs_diff(x) <= 2 && border % 32 != 0, "column {x}");
    }
}

#[test]
fn regions_equal_the_whole() {
    let mut rng = Rng::new(9);
    for (log2, groups) in [(4, &[3u8, 1] as &[u8]), (5, &[3]), (6, &[1])] {
        let source = waves(300, 170, groups, 8);
        let params = DctSettings::default().with_goal(Goal::Psnr(40.0)).with_superblock_log2(log2);
        let texture = encoded(&source, params).with_deblocking(3);
        let (whole, channels) = (decoded(&texture, all_of(&texture)), source.channels());
        for _ in 0..60 {
            let (x, y) = (rng.below(300), rng.below(170));
            let rect = Rect {
                image: 0,
                level: 0,
                x,
                y,
                width: 1 + rng.below(300 - x),
                height: 1 + rng.below(170 - y),
            };
            let naive: Vec<u16> = (y..y + rect.height)
                .flat_map(|row| {
                    let first = (row as usize * 300 + x as usize) * channels;
                    whole[first..first + rect.width as usize * channels].to_vec()
                })
                .collect();
            assert!(decoded(&texture, rect) == naive, "{rect:?}");
        }
        let bytes: Vec<u8> = whole.iter().map(|&sample| sample as u8).collect();
        let mut out = vec![0u8; bytes.len()];
        texture.decode(all_of(&texture), &mut out).unwrap();
        assert!(out == bytes);
    }
}

/// Two images as content of a texture, with all mip levels.
#[test]
fn rgba_of_8_bits_are_the_channels() {
    for groups in [&[1u8][..], &[1, 1], &[3], &[3, 1], &[2], &[4]] {
        let texture = encoded(&waves(75, 41, groups, 8), DctSettings::default());
        let rect = Rect { x: 13, y: 6, width: 58, height: 31, ..all_of(&texture) };
        let samples = decoded(&texture, rect);
        let mut found = vec![[0; 4]; 58 * 31];
        texture.decode_rgba8(rect, &mut found).unwrap();
        for (found, wanted) in found.iter().zip(samples.chunks_exact(texture.form().channels())) {
            let wanted = match *wanted {
                [gray] => [gray, gray, gray, 255],
                [gray, alpha] => [gray, gray, gray, alpha],
                [red, green, blue] => [red, green, blue, 255],
                _ => [wanted[0], wanted[1], wanted[2], wanted[3]],
            };
            assert_eq!(found.map(u16::from), wanted, "{groups:?}");
        }
    }
}

fn content() -> DctContent {
    let params = DctSettings::default().with_goal(Goal::Psnr(38.0));
    let images = vec![ImageSize { width: 150, height: 90 }, ImageSize { width: 40, height: 70 }];
    let stages = images.iter().flat_map(|&size| stage_sizes(size, 8));
    let stages: Vec<DctTexture> =
        stages.map(|size| encoded(&waves(size.width, size.height, &[3, 1], 8), params)).collect();
    assert_eq!(stages.len(), 6);
    let pixel = PixelInfo { channels: 4, ..PixelInfo::default() };
    DctContent::new(ImageLayout::new(images, 8, pixel), stages).unwrap()
}

#[test]
fn lone_texels_equal_the_whole() {
    let content = content();
    for image in 0..2 {
        for level in 0..8 {
            let rect = content.layout().whole(image, level).unwrap();
            let mut whole = vec![Texel::ZERO; (rect.width * rect.height) as usize];
            content.decode(rect, &mut whole).unwrap();
            let mut rng = Rng::new(6);
            for _ in 0..300 {
                let (x, y) = (rng.below(rect.width), rng.below(rect.height));
                let found = content.texel(ImageAddress { image, level, x, y });
                assert_eq!(found, whole[(y * rect.width + x) as usize], "{image} {level} {x} {y}");
            }
            let last = content.texel(ImageAddress { image, level, x: u32::MAX, y: u32::MAX });
            assert_eq!(last, whole[whole.len() - 1]);
        }
    }
}

#[test]
fn content_comes_back_whole_and_as_a_prefix() {
    let content = content();
    let written = |content: &DctContent| {
        let mut out = SectionWriter::new(CodecId { number: 4, name: "progressive" });
        content.store(ContentId::ONLY, &mut out);
        out.finish().bytes
    };
    let loaded = |bytes: &[u8]| {
        let budget = &mut Budget::default();
        let file = Sections::parse(bytes, budget).unwrap();
        DctContent::load(content.layout(), ContentId::ONLY, &file, budget).unwrap()
    };
    let bytes = written(&content);
    assert!(loaded(&bytes) == content);
    let prefix = loaded(&bytes[..bytes.len() - 1]);
    assert!(prefix == content.base_alone() && prefix.layers().loaded == 1 && prefix.layers().total == 2);
    let budget = &mut Budget::default();
    let file = Sections::parse(&bytes, budget).unwrap();
    let refined = prefix.with_rest(ContentId::ONLY, &file, budget).unwrap().unwrap();
    assert!(refined == content);
    assert_eq!(refined.with_rest(ContentId::ONLY, &file, budget).unwrap(), None);
}

#[test]
fn without_its_last_superblocks_an_image_is_what_its_means_predict() {
    let source = waves(256, 128, &[3], 8);
    let texture = encoded(&source, DctSettings::default().with_goal(Goal::Psnr(42.0)));
    let mut base = texture.clone();
    // Two bases of a superblock each come first.
    let bases: usize = (0..2).map(|number| base.index.of(&base.bytes, number).len()).sum();
    assert!(2 * bases < base.bytes.len());
    base.bytes.truncate(bases);
    let (whole, rough) = (psnr(&source, &texture, 255.0), psnr(&source, &base, 255.0));
    assert!(whole >= 42.0 && rough > 20.0 && rough < 38.0, "{rough} dB of {whole}");
}

#[test]
fn bytes_are_the_same_for_any_number_of_threads() {
    let source = waves(200, 140, &[3], 8);
    let bytes = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| encoded(&source, DctSettings::default().with_goal(Goal::Bpp(1.0))).to_bytes())
    };
    assert_eq!(bytes(1), bytes(3));
}

#[test]
fn goals_are_met_and_more_bits_are_never_worse() {
    let source = waves(192, 128, &[3], 8);
    for effort in [Effort::Fast, Effort::Normal] {
        let params = DctSettings::default().with_effort(effort).with_metric(Metric::Psnr);
        let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
        let mut before = 0.0;
        // From 1.9 to 2.1 bits, where steps are as large as the noise, two steps next to each other differ by up to 7 % of the bits.
        for bits in [0.4, 0.5, 0.7, 1.0, 1.4, 2.2, 3.0, 5.0] {
            let texture = encoder.encode_for(Goal::Bpp(bits)).unwrap();
            let taken = 8.0 * texture.to_bytes().len() as f64 / (192.0 * 128.0);
            let db = psnr(&source, &texture, 255.0);
            assert!(taken <= bits && taken > 0.97 * bits, "{taken} of {bits}");
            assert!(db > before, "{db} after {before} at {bits}");
            before = db;
        }
        let mut fewer = 0;
        for db in [30.0, 33.0, 36.0, 40.0, 44.0] {
            let texture = encoder.encode_for(Goal::Psnr(db)).unwrap();
            let found = psnr(&source, &texture, 255.0);
            assert!((db..db + 0.4).contains(&found), "{found} for {db}");
            let length = texture.to_bytes().len();
            assert!(length > fewer);
            fewer = length;
        }
    }
    let encoder = DctEncoder::new(&source, &DctSettings::default(), CancelCheck::default()).unwrap();
    let texture = encoder.encode_for(Goal::Tolerance(3.0)).unwrap();
    let found = decoded(&texture, all_of(&texture));
    for (y, x) in (0..128).step_by(4).flat_map(|y| (0..192).step_by(4).map(move |x| (y, x))) {
        let errors = (0..4).flat_map(|row| {
            let first = ((y + row) * 192 + x) * 3;
            let pairs = found[first..first + 12].iter().zip(&source.samples()[first..first + 12]);
            pairs.map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2))
        });
        assert!(errors.sum::<f64>() <= 9.0 * 48.0, "block at {x}, {y}");
    }
}

#[test]
fn constant_images_take_their_header() {
    let source =
        DctSource::from_u8(ImageSize { width: 512, height: 512 }, &[3], &[77; 512 * 512 * 3]).unwrap();
    let texture = encoded(&source, DctSettings::default().with_goal(Goal::Psnr(50.0)));
    assert!(decoded(&texture, all_of(&texture)).iter().all(|&sample| sample == 77));
    let length = texture.to_bytes().len();
    assert!(length < 150, "{length} bytes");
}

#[test]
fn unreachable_goals_are_refused() {
    let source = waves(3, 5, &[3], 8);
    let encoder = DctEncoder::new(&source, &DctSettings::default(), CancelCheck::default()).unwrap();
    assert!(matches!(encoder.encode_for(Goal::Bpp(0.1)), Err(EncodeError::Source(_))));
    assert!(matches!(encoder.encode_for(Goal::Psnr(-1.0)), Err(EncodeError::Params(_))));
    let wrong = DctSettings::default().with_superblock_log2(7);
    assert!(DctEncoder::new(&source, &wrong, CancelCheck::default()).is_err());
}

#[test]
fn gradients_of_16_bits_keep_more_than_8() {
    let samples: Vec<u16> =
        (0..128 * 128u32).map(|at| (at % 128 * 150 + at / 128 * 40 + 9000) as u16).collect();
    let source = DctSource::new(ImageSize { width: 128, height: 128 }, &[1], 16, samples).unwrap();
    let texture = encoded(&source, DctSettings::default().with_goal(Goal::Psnr(80.0)));
    assert!(psnr(&source, &texture, 65535.0) >= 80.0);
    assert!(texture.to_bytes().len() < 2000, "{} bytes", texture.to_bytes().len());
}

#[test]
fn noise_and_saturated_edges_come_back() {
    let mut rng = Rng::new(1);
    let noise = rng.bytes(96 * 80 * 3);
    let edges: Vec<u8> = (0..96 * 80 * 3).map(|at| if at / 3 / 7 % 2 == 0 { 0 } else { 255 }).collect();
    for samples in [noise, edges] {
        let source = DctSource::from_u8(ImageSize { width: 96, height: 80 }, &[3], &samples).unwrap();
        let texture = encoded(&source, DctSettings::default().with_goal(Goal::Psnr(45.0)));
        assert!(psnr(&source, &texture, 255.0) >= 45.0);
    }
}

#[test]
fn forged_bytes_decode_or_are_refused() {
    let mut rng = Rng::new(4);
    let textures =
        [(61, 50, &[3u8] as &[u8], 4), (90, 40, &[2, 1], 5)].map(|(width, height, groups, log2)| {
            let source = waves(width, height, groups, 8);
            let params = DctSettings::default().with_effort(Effort::Fast).with_superblock_log2(log2);
            encoded(&source, params.with_goal(Goal::Psnr(38.0))).to_bytes()
        });
    let (mut refused, mut read_whole) = (0, 0);
    for round in 0..10_000 {
        let mut bytes = textures[round % 2].clone();
        match round % 5 {
            0 => bytes.truncate(rng.index(bytes.len())),
            1 => {
                let first = rng.index(bytes.len());
                let noise = rng.bytes(bytes.len() - first);
                bytes[first..].copy_from_slice(&noise);
            }
            _ => {
                for _ in 0..1 + rng.below(4) {
                    let at = if round % 2 == 0 { rng.index(100) } else { rng.index(bytes.len()) };
                    bytes[at] = rng.below(256) as u8;
                }
            }
        }
        let limits = Limits { texels: 1 << 16, bytes: 1 << 20, ..Limits::default() };
        let mut reader = Reader::new(ID, &bytes);
        match DctTexture::read(&mut reader, &mut Budget::new(limits)) {
            Ok(texture) => {
                read_whole += 1;
                decoded(&texture, all_of(&texture));
            }
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 1000 && read_whole > 1000, "{refused} refused, {read_whole} read");
}

#[test]
fn wrong_regions_are_named() {
    let texture = encoded(&waves(20, 10, &[1], 8), DctSettings::default());
    let rect = Rect { image: 0, level: 0, x: 15, y: 0, width: 6, height: 1 };
    assert_eq!(texture.decode(rect, &mut [0u8; 6]), Err(RegionError::Outside { width: 20, height: 10 }));
    let inside = Rect { x: 14, ..rect };
    assert_eq!(texture.decode(inside, &mut [0u8; 5]), Err(RegionError::OutputLength { found: 5, needed: 6 }));
    assert!(texture.decode(Rect { level: 1, ..inside }, &mut [0u8; 6]).is_err());
    assert!(texture.decode(Rect { image: 1, ..inside }, &mut [0u8; 6]).is_err());
}

#[test]
fn cancelled_jobs_end() {
    let source = waves(64, 64, &[3], 8);
    let cancel = Cancel::default();
    let job = Job::default().with_cancel(&cancel);
    let encoder = DctEncoder::new(&source, &DctSettings::default(), job.cancel_check()).unwrap();
    cancel.cancel();
    assert!(matches!(encoder.encode(), Err(EncodeError::Cancelled)));
    let again = DctEncoder::new(&source, &DctSettings::default(), job.cancel_check());
    assert!(matches!(again, Err(EncodeError::Cancelled)));
}

#[test]
fn a_band_shares_axes_with_colours() {
    use texfold_core::image::{Alpha, ColorSpace, PixelInfo, Raster};
    let rgb = texfold_testkit::image("terrain");
    let size = rgb.size();
    let texels: Vec<_> =
        rgb.texels().map(|texel| texel.truncate().extend(0.5 * (texel.x + texel.y))).collect();
    let length = |alpha| {
        let info = PixelInfo { channels: 4, color: ColorSpace::Linear, alpha, ..PixelInfo::default() };
        let image = Raster::from_texels(size.width, size.height, info, &texels).unwrap();
        let source = DctSource::from_raster(&image, info.depth).unwrap();
        let texture = encoded(&source, DctSettings::default().with_metric(Metric::Psnr));
        assert!(psnr(&source, &texture, 255.0) > 30.0);
        texture.to_bytes().len()
    };
    let (band, alpha) = (length(Alpha::Band), length(Alpha::Straight));
    // What colours predict costs next to nothing.
    assert!(band * 10 < alpha * 9, "{band} bytes, {alpha} as alpha");
}

#[test]
fn files_and_texels_are_those_of_any_processor() {
    let made = || {
        let mut made = Vec::new();
        for (groups, depth) in [(&[3u8][..], 8), (&[3, 1][..], 8), (&[2][..], 16)] {
            let texture = encoded(&waves(150, 131, groups, depth), DctSettings::default());
            made.push((texture.to_bytes(), decoded(&texture, all_of(&texture))));
        }
        made
    };
    let wide = made();
    NARROW.store(true, Relaxed);
    let narrow = made();
    NARROW.store(false, Relaxed);
    assert!(wide == narrow);
}

//! Textures in blocks: what the compute passes give equals what the CPU decodes, in every sample.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::gpu;
use glam::Vec4;
use texfold_core::container::{ContentId, Reader, Sections};
use texfold_core::image::{Alpha, ColorSpace, Depth, ImageLayout, PixelInfo};
use texfold_core::rng::Rng;
use texfold_core::{Budget, CancelCheck, ImageSize, Metric, Rect, RegionError, String4};
use texfold_dct::encode::{DctEncoder, DctSettings, DctSource};
use texfold_dct::{DctContent, DctTexture, Stage, stage_sizes};
use texfold_gpu::{DctChannel, DctDecoder, DctImage, Gpu, GpuError, wgpu};
use texfold_testkit::dct;
use texfold_testkit::full;

/// Edges of 16x16 texels, a slope and noise: blocks of all lengths.
fn source(width: u32, height: u32, groups: &[u8], depth: u8) -> DctSource {
    let mut rng = Rng::new(u64::from(width * height));
    let channels: u32 = groups.iter().map(|&channels| u32::from(channels)).sum();
    let scale = if depth > 8 { 257 } else { 1 };
    let mut samples = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let noise = if x / 40 % 2 == 0 { 4 } else { 90 };
            for channel in 0..channels {
                let slope = x / 2 + y / 3 * (channel + 1) % 90;
                let edge = (x / 16 + y / 16) % 2 * 60;
                samples.push(((slope + edge + rng.below(noise)).min(255) * scale) as u16);
            }
        }
    }
    DctSource::new(ImageSize { width, height }, groups, depth, samples).unwrap()
}

fn texture(source: &DctSource, log2: u8, step: u16, metric: Metric) -> DctTexture {
    let params = DctSettings::default().with_superblock_log2(log2).with_metric(metric);
    DctEncoder::new(source, &params, CancelCheck::default()).unwrap().at_step(step).unwrap()
}

/// The decoder of the adapter, or `None` where there is none and none is required.
fn decoder() -> Option<(&'static Gpu, DctDecoder)> {
    let gpu = gpu()?;
    Some((gpu, DctDecoder::new(gpu).unwrap()))
}

fn whole(texture: &DctTexture) -> Rect {
    let ImageSize { width, height } = texture.form().size;
    Rect { image: 0, level: 0, x: 0, y: 0, width, height }
}

/// What the CPU decodes, in the channels of a target.
fn wanted(texture: &DctTexture, rect: Rect, channels: [DctChannel; 4]) -> Vec<[u16; 4]> {
    let count = texture.form().channels();
    let mut samples = vec![0u16; (rect.width * rect.height) as usize * count];
    texture.decode(rect, &mut samples).unwrap();
    let largest = if texture.form().depth > 8 { u16::MAX } else { 255 };
    let of = |texel: &[u16], channel| match channel {
        DctChannel::Channel(channel) => texel[usize::from(channel)],
        DctChannel::Zero => 0,
        DctChannel::One => largest,
    };
    samples.chunks_exact(count).map(|texel| channels.map(|channel| of(texel, channel))).collect()
}

/// Fails where a rectangle on the GPU differs from the CPU's.
fn check(name: &str, gpu: &Gpu, decoder: &DctDecoder, texture: &DctTexture, image: &DctImage, rect: Rect) {
    let channels = image.colours();
    let found = decoder.decode_texels(gpu, image, rect, channels).unwrap();
    let wanted = wanted(texture, rect, channels);
    let first = found.iter().zip(&wanted).position(|(found, wanted)| found != wanted);
    let different = found.iter().zip(&wanted).filter(|(found, wanted)| found != wanted).count();
    if let Some(at) = first {
        panic!(
            "{name}, {rect:?}: texel {at} is {:?}, not {:?}; {different} texels differ",
            found[at], wanted[at]
        );
    }
    assert_eq!(found.len(), wanted.len(), "{name}");
}

fn check_all(name: &str, gpu: &Gpu, decoder: &DctDecoder, texture: &DctTexture) {
    let image = decoder.upload(gpu, &texture.gpu(Stage::default())).unwrap();
    check(name, gpu, decoder, texture, &image, whole(texture));
}

#[test]
fn mip_levels_equal_those_of_the_cpu() {
    let Some((gpu, decoder)) = decoder() else { return };
    let kinds: [(&[u8], u8, ColorSpace); 5] = [
        (&[3], 8, ColorSpace::Srgb),
        (&[3, 1], 8, ColorSpace::Srgb),
        (&[1], 16, ColorSpace::Linear),
        (&[3, 1], 16, ColorSpace::Srgb),
        (&[1, 1], 8, ColorSpace::Linear),
    ];
    for (number, (groups, depth, color)) in kinds.into_iter().enumerate() {
        for (width, height) in [(37, 61), (300, 200), (3, 5), (1, 9)] {
            let channels = groups.iter().sum();
            let deep = if depth > 8 { Depth::Sixteen } else { Depth::Eight };
            let alpha = if channels % 2 == 0 { Alpha::Straight } else { Alpha::Opaque };
            let pixel = PixelInfo { channels, depth: deep, color, alpha };
            let size = ImageSize { width, height };
            let layout = ImageLayout::new(vec![size], size.full_levels(), pixel);
            let log2 = 4 + number as u8 % 3;
            let stage = |size: ImageSize| {
                texture(
                    &source(size.width, size.height, groups, depth),
                    log2,
                    if depth > 8 { 3600 } else { 1520 },
                    Metric::Psnr,
                )
            };
            let stages = stage_sizes(size, layout.levels).into_iter().map(stage).collect();
            let content = DctContent::new(layout, stages).unwrap();
            check_levels(gpu, &decoder, &content);
        }
    }
}

/// Fails where a level of an image on the GPU differs from the CPU's.
fn check_levels(gpu: &Gpu, decoder: &DctDecoder, content: &DctContent) {
    for stage in content.gpu() {
        let image = decoder.upload(gpu, &stage).unwrap();
        for reduce in 0..stage.levels {
            let rect = content.layout().whole(0, stage.level + reduce).unwrap();
            let mut wanted = vec![Vec4::ZERO; (rect.width * rect.height) as usize];
            content.decode(rect, &mut wanted).unwrap();
            let largest = if stage.layout.depth > 8 { 65535.0 } else { 255.0 };
            let wanted =
                wanted.iter().map(|texel| (*texel * largest).to_array().map(|value| value.round() as u16));
            let rect = Rect { level: reduce, ..rect };
            let found = decoder.decode_texels(gpu, &image, rect, image.colours()).unwrap();
            let pixel = content.layout().pixel;
            assert!(wanted.eq(found), "{pixel:?}, {rect:?} of level {}: texels differ", stage.level);
        }
    }
}

#[test]
fn images_equal_those_of_the_cpu() {
    let Some((gpu, decoder)) = decoder() else { return };
    let sizes = [(1, 1), (3, 5), (37, 61), (129, 8), (300, 200)];
    let groups: [&[u8]; 4] = [&[1], &[3], &[4], &[3, 1]];
    for (number, &(width, height)) in sizes.iter().enumerate() {
        for (kind, groups) in groups.iter().enumerate() {
            let source = source(width, height, groups, 8);
            // Every side of superblocks and every quality comes with every size or with every kind of channels.
            let log2 = 4 + ((number + kind) % 3) as u8;
            let step = [1000, 1600, 2240][(number + 2 * kind) % 3];
            let metric = if kind % 2 == 0 { Metric::Perceptual } else { Metric::Psnr };
            let texture = texture(&source, log2, step, metric);
            check_all(&format!("{width}x{height} {groups:?} {log2} {step}"), gpu, &decoder, &texture);
        }
    }
}

#[test]
fn fixtures_equal_the_cpu_at_every_side_and_quality() {
    let Some((gpu, decoder)) = decoder() else { return };
    let names = if full() { &["facade", "terrain", "floor", "cloth"][..] } else { &["facade", "terrain"] };
    for name in names {
        let image = texfold_testkit::image(name);
        let source = DctSource::from_u8(image.size(), &[image.info().channels], &image.to_bytes()).unwrap();
        for (log2, step) in [(4, 256), (4, 2400), (5, 1200), (5, 1800), (6, 600), (6, 1520)] {
            let texture = texture(&source, log2, step, Metric::Psnr);
            check_all(&format!("{name} {log2} {step}"), gpu, &decoder, &texture);
        }
    }
}

/// Files of before quantisers were dependent.
#[test]
fn independent_quantisers_equal_the_cpu() {
    let Some((gpu, decoder)) = decoder() else { return };
    let bytes = std::fs::read(texfold_testkit::fixtures_dir().join("golden/dct_alpha.txf")).unwrap();
    let layout = texfold::open(&bytes).unwrap().into_image().unwrap().as_encoded().layout().clone();
    let file = Sections::parse(&bytes, &mut Budget::default()).unwrap();
    let content = DctContent::load(&layout, ContentId::ONLY, &file, &mut Budget::default()).unwrap();
    let texture = content.stages().first().unwrap();
    assert!(!texture.form().quantiser.is_dependent);
    check_all("independent", gpu, &decoder, texture);
}

/// The texture at that strength of deblocking, which its bytes say.
fn deblocked(texture: &DctTexture, strength: u8) -> DctTexture {
    let mut bytes = texture.to_bytes();
    // The strength stands behind version, sizes, depth, superblock, quantiser and intra modes, where there is one.
    let place = if texture.form().intra.is_some() { 15 } else { 12 };
    let parts = bytes[0] - 1;
    if parts & 1 > 0 {
        bytes.remove(place);
    }
    bytes[0] = 1 + (parts & !1) + u8::from(strength > 0);
    if strength > 0 {
        bytes.insert(place, strength);
    }
    DctTexture::read(&mut Reader::new(String4(*b"TEST"), &bytes), &mut Budget::default()).unwrap()
}

#[test]
fn deblocked_images_equal_those_of_the_cpu() {
    let Some((gpu, decoder)) = decoder() else { return };
    let red = [DctChannel::Channel(0), DctChannel::Channel(1), DctChannel::Zero, DctChannel::One];
    for (log2, depth, step, strength) in [(4, 8, 1600, 3), (5, 8, 1900, 1), (5, 16, 3900, 2), (6, 8, 1500, 2)]
    {
        let texture = texture(&source(131, 77, &[2, 1], depth), log2, step, Metric::Psnr);
        let [plain, texture] = [0, strength].map(|strength| deblocked(&texture, strength));
        let image = decoder.upload(gpu, &texture.gpu(Stage::default())).unwrap();
        for rect in [whole(&texture), Rect { x: 37, y: 21, width: 70, height: 50, ..whole(&texture) }] {
            let found = decoder.decode_texels(gpu, &image, rect, red).unwrap();
            assert!(found == wanted(&texture, rect, red), "{log2} {depth} {strength} {rect:?}");
            assert!(wanted(&plain, rect, red) != found, "nothing is deblocked");
        }
    }
}

#[test]
fn deep_samples_and_sixteen_channels_equal_the_cpu() {
    let Some((gpu, decoder)) = decoder() else { return };
    let deep = texture(&source(150, 70, &[3], 16), 5, 3600, Metric::Psnr);
    check_all("16 bits", gpu, &decoder, &deep);
    let many = texture(&source(90, 130, &[4, 3, 2, 1, 4, 2], 8), 6, 1320, Metric::Psnr);
    let image = decoder.upload(gpu, &many.gpu(Stage::default())).unwrap();
    for first in [0, 4, 8, 12] {
        let channels = [first + 3, first, first + 1, first + 2].map(DctChannel::Channel);
        let found = decoder.decode_texels(gpu, &image, whole(&many), channels).unwrap();
        assert!(found == wanted(&many, whole(&many), channels), "channels from {first}");
    }
    let constant = [DctChannel::One, DctChannel::Zero, DctChannel::Channel(15), DctChannel::One];
    let found = decoder.decode_texels(gpu, &image, whole(&many), constant).unwrap();
    assert!(found == wanted(&many, whole(&many), constant));
}

#[test]
fn rectangles_equal_those_of_the_cpu() {
    let Some((gpu, decoder)) = decoder() else { return };
    let mut rng = Rng::new(3);
    for log2 in [4, 5, 6] {
        let texture = texture(&source(700, 190, &[3], 8), log2, 1520, Metric::Psnr);
        let image = decoder.upload(gpu, &texture.gpu(Stage::default())).unwrap();
        for _ in 0..24 {
            let level = 0;
            let ImageSize { width, height } = texture.form().size;
            let (x, y) = (rng.below(width), rng.below(height));
            let (width, height) = (1 + rng.below(width - x), 1 + rng.below(height - y));
            let rect = Rect { image: 0, level, x, y, width, height };
            check(&format!("side {log2}"), gpu, &decoder, &texture, &image, rect);
        }
    }
}

#[test]
fn large_images_are_decoded_in_parts() {
    let Some((gpu, decoder)) = decoder() else { return };
    // 2400 x 2400 texels of four axes need 94 MB of scratch memory: two parts.
    let texture = texture(&source(2400, 2400, &[4], 8), 6, 2400, Metric::Psnr);
    let image = decoder.upload(gpu, &texture.gpu(Stage::default())).unwrap();
    let found = read_back(gpu, &decoder.decode(gpu, &image, whole(&texture), image.colours()).unwrap());
    assert!(found == wanted(&texture, whole(&texture), image.colours()));
}

/// Bytes of a texture whose rows need no padding.
fn read_back(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<[u16; 4]> {
    let (width, height) = (texture.width(), texture.height());
    let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    gpu.queue().submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = buffer.get_mapped_range(..).unwrap();
    let rows = bytes.chunks_exact(row as usize).flat_map(|line| line[..4 * width as usize].to_vec());
    let samples: Vec<u16> = rows.map(u16::from).collect();
    samples.as_chunks::<4>().0.to_vec()
}

#[test]
fn a_place_of_a_larger_texture_is_written_alone() {
    let Some((gpu, decoder)) = decoder() else { return };
    let texture = texture(&source(120, 90, &[3], 8), 5, 1520, Metric::Psnr);
    let image = decoder.upload(gpu, &texture.gpu(Stage::default())).unwrap();
    let pool = decoder.decode(gpu, &image, whole(&texture), image.colours()).unwrap();
    let before = wanted(&texture, whole(&texture), image.colours());
    let rect = Rect { image: 0, level: 0, x: 65, y: 33, width: 30, height: 20 };
    decoder.decode_into(gpu, &image, rect, image.colours(), &pool, [7, 11]).unwrap();
    let tile = wanted(&texture, rect, image.colours());
    let after = read_back(gpu, &pool);
    for (at, found) in after.iter().enumerate() {
        let (x, y) = (at % 120, at / 120);
        let inside = (7..37).contains(&x) && (11..31).contains(&y);
        let wanted = if inside { tile[(y - 11) * 30 + x - 7] } else { before[at] };
        assert_eq!(*found, wanted, "texel {x}, {y}");
    }
}

/// Streams of noise have all modes.
#[test]
fn all_intra_modes_give_what_the_cpu_gives() {
    let Some((gpu, decoder)) = decoder() else { return };
    let mut rng = Rng::new(12);
    for log2 in [4, 5, 6] {
        let texture = texture(&source(100, 75, &[3], 8), log2, 1520, Metric::Psnr);
        let mut bytes = texture.to_bytes();
        let first = bytes.len() - texture.gpu(Stage::default()).streams.len();
        bytes[first..].iter_mut().for_each(|byte| *byte = rng.below(256) as u8);
        // The header with modes, whether the texture has any or not.
        let stored = if texture.form().intra.is_some() { 3 } else { 0 };
        bytes.splice(12..12 + stored, [10, 20, 30]);
        bytes[0] += if stored > 0 { 0 } else { 32 };
        let mut reader = Reader::new(String4(*b"TEST"), &bytes);
        let texture = DctTexture::read(&mut reader, &mut Budget::default()).unwrap();
        check_all(&format!("superblocks of {log2}"), gpu, &decoder, &texture);
    }
}

#[test]
fn forged_and_truncated_streams_give_what_the_cpu_gives() {
    let Some((gpu, decoder)) = decoder() else { return };
    let mut rng = Rng::new(11);
    let mut read = 0;
    for round in 0..60u32 {
        let log2 = 4 + (round % 3) as u8;
        let depth = if round % 4 == 3 { 16 } else { 8 };
        let texture = texture(&source(100, 75, &[3], depth), log2, 1520, Metric::Psnr);
        let mut bytes = texture.to_bytes();
        let streams = texture.gpu(Stage::default()).streams.len();
        let first = bytes.len() - streams;
        match round % 3 {
            // Noise in the streams.
            0 => (0..1 + rng.below(60))
                .for_each(|_| bytes[first + rng.below(streams as u32) as usize] = rng.below(256) as u8),
            // Nothing but noise, or zeros: the longest blocks and the largest magnitudes.
            1 => bytes[first..].iter_mut().for_each(|byte| *byte = rng.below(256) as u8),
            // Noise in the index, behind the header of 48 bytes: streams of other lengths, which lie beyond the end. Six superblocks have a byte
            // each at least.
            _ => {
                (0..1 + rng.below(30)).for_each(|_| bytes[48 + rng.below(6) as usize] = rng.below(256) as u8);
            }
        }
        if round % 10 == 0 {
            bytes[first..].fill(0);
        }
        let mut reader = Reader::new(String4(*b"TEST"), &bytes);
        let Ok(texture) = DctTexture::read(&mut reader, &mut Budget::default()) else { continue };
        read += 1;
        check_all(&format!("round {round}"), gpu, &decoder, &texture);
    }
    assert!(read > 50, "only {read} forged textures were read");
    // Streams that end early: the index says what the bytes no longer hold.
    let texture = texture(&source(100, 75, &[3], 8), 5, 1520, Metric::Psnr);
    let blocks = texture.gpu(Stage::default());
    for kept in [0, 1, 2, 3, 5, blocks.streams.len() / 2, blocks.streams.len() - 1] {
        let mut cut = blocks.clone();
        cut.streams = &blocks.streams[..kept];
        cut.layout.stream_bytes = kept as u32;
        let image = decoder.upload(gpu, &cut).unwrap();
        let channels = [0, 1, 2, 2].map(DctChannel::Channel);
        let found = decoder.decode_texels(gpu, &image, whole(&texture), channels).unwrap();
        let wanted = dct::decode(&cut, whole(&texture)).unwrap();
        let wanted: Vec<[u16; 4]> =
            wanted.chunks_exact(3).map(|texel| [texel[0], texel[1], texel[2], texel[2]]).collect();
        assert!(found == wanted, "{kept} bytes");
    }
}

#[test]
fn what_is_not_there_is_refused() {
    let Some((gpu, decoder)) = decoder() else { return };
    let texture = texture(&source(40, 30, &[3], 8), 5, 1520, Metric::Psnr);
    let image = decoder.upload(gpu, &texture.gpu(Stage::default())).unwrap();
    let rect = whole(&texture);
    let colours = image.colours();
    let refused = |rect| decoder.decode_texels(gpu, &image, rect, colours).unwrap_err();
    assert!(matches!(
        refused(Rect { level: 3, ..rect }),
        GpuError::Region(RegionError::NoSuchLevel { level: 3, levels: 3 })
    ));
    assert!(matches!(refused(Rect { image: 1, ..rect }), GpuError::Region(RegionError::NoSuchImage { .. })));
    for outside in [
        Rect { width: 41, ..rect },
        Rect { y: 30, height: 1, ..rect },
        Rect { x: u32::MAX, ..rect },
        Rect { width: 0, ..rect },
    ] {
        assert!(matches!(refused(outside), GpuError::Region(RegionError::Outside { width: 40, height: 30 })));
    }
    let channels = [DctChannel::Channel(3); 4];
    let error = decoder.decode_texels(gpu, &image, rect, channels).unwrap_err();
    assert!(matches!(error, GpuError::NoSuchChannel { channel: 3, channels: 3 }));
    let target = decoder.decode(gpu, &image, rect, colours).unwrap();
    let error = decoder.decode_into(gpu, &image, rect, colours, &target, [1, 0]).unwrap_err();
    assert!(matches!(error, GpuError::Region(RegionError::Outside { width: 40, height: 30 })));
    let deep = self::texture(&source(40, 30, &[3], 16), 5, 3600, Metric::Psnr);
    let deep = decoder.upload(gpu, &deep.gpu(Stage::default())).unwrap();
    let error = decoder.decode_into(gpu, &deep, rect, colours, &target, [0, 0]).unwrap_err();
    assert!(matches!(error, GpuError::DctTarget { format: wgpu::TextureFormat::Rgba16Uint }));
}

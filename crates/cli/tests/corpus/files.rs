//! Small files of many forms, made by code.

use std::io::Cursor;

use dds::header::Header;
use image::codecs::{gif::GifEncoder, jpeg::JpegEncoder, png::PngEncoder, tiff, webp::WebPEncoder};
use image::{
    DynamicImage, ExtendedColorType, Frame, ImageEncoder, ImageFormat, Rgb32FImage, RgbImage, RgbaImage,
};
use moxcms::ColorProfile;
use tiff_crate::encoder::{TiffEncoder, colortype};
use tiff_crate::tags::Tag;

use ::tiff as tiff_crate;

pub(crate) const WIDTH: u32 = 8;
pub(crate) const HEIGHT: u32 = 6;

/// The texel that all images have at a place.
pub(crate) fn texel(x: u32, y: u32) -> [u8; 3] {
    [(x * 30) as u8, (y * 40) as u8, 100]
}

pub(crate) fn rgb() -> DynamicImage {
    DynamicImage::ImageRgb8(RgbImage::from_fn(WIDTH, HEIGHT, |x, y| image::Rgb(texel(x, y))))
}

/// Alpha of a half.
pub(crate) fn rgba() -> DynamicImage {
    DynamicImage::ImageRgba8(RgbaImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let [red, green, blue] = texel(x, y);
        image::Rgba([red, green, blue, 128])
    }))
}

pub(crate) fn of(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// Floats, all of them times `scale`.
pub(crate) fn float(format: ImageFormat, scale: f32) -> Vec<u8> {
    let at = |x, y| image::Rgb(texel(x, y).map(|value| f32::from(value) / 255.0 * scale));
    of(&DynamicImage::ImageRgb32F(Rgb32FImage::from_fn(WIDTH, HEIGHT, at)), format)
}

/// Floats with alpha, colours times alpha.
pub(crate) fn exr_with_alpha() -> Vec<u8> {
    let at = |x, y| {
        let [red, green, blue] = texel(x, y).map(|value| f32::from(value) / 255.0 * 0.5);
        image::Rgba([red, green, blue, 0.5])
    };
    let image = image::Rgba32FImage::from_fn(WIDTH, HEIGHT, at);
    of(&DynamicImage::ImageRgba32F(image), ImageFormat::OpenExr)
}

/// One channel: the place's number of 48, times a factor.
pub(crate) fn exr_gray(times: f32) -> Vec<u8> {
    use exr::prelude::{SpecificChannels, WritableImage};
    let value =
        |place: exr::math::Vec2<usize>| ((place.y() * WIDTH as usize + place.x()) as f32 / 48.0 * times,);
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(value);
    let mut bytes = Cursor::new(Vec::new());
    let size = (WIDTH as usize, HEIGHT as usize);
    exr::prelude::Image::from_channels(size, channels).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn frames(count: u8) -> Vec<Frame> {
    let frame = |number: u8| {
        let mut image = rgb().to_rgba8();
        image.put_pixel(0, 0, image::Rgba([number * 50, 0, 0, 255]));
        Frame::new(image)
    };
    (0..count).map(frame).collect()
}

pub(crate) fn gif(count: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    GifEncoder::new(&mut bytes).encode_frames(frames(count)).unwrap();
    bytes
}

pub(crate) fn apng(count: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, WIDTH, HEIGHT);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_animated(u32::from(count), 0).unwrap();
    let mut writer = encoder.write_header().unwrap();
    for frame in frames(count) {
        writer.write_image_data(frame.buffer()).unwrap();
    }
    writer.finish().unwrap();
    bytes
}

pub(crate) fn animated_webp(count: u8) -> Vec<u8> {
    let chunk = |name: &[u8; 4], data: &[u8]| {
        let mut chunk = [&name[..], &(data.len() as u32).to_le_bytes(), data].concat();
        chunk.resize(chunk.len() + data.len() % 2, 0);
        chunk
    };
    let three = |value: u32| value.to_le_bytes()[..3].to_vec();
    let size = [three(WIDTH - 1), three(HEIGHT - 1)].concat();
    let mut body = b"WEBP".to_vec();
    // The flag of animations.
    body.extend(chunk(b"VP8X", &[&[2, 0, 0, 0][..], &size].concat()));
    body.extend(chunk(b"ANIM", &[0; 6]));
    for frame in frames(count) {
        let still = of(&DynamicImage::ImageRgba8(frame.into_buffer()), ImageFormat::WebP);
        let head = [&[0; 6][..], &size, &three(100), &[0]].concat();
        body.extend(chunk(b"ANMF", &[&head[..], &still[12..]].concat()));
    }
    chunk(b"RIFF", &body)
}

/// Pages, each with a kind of its own: 0 is a page, 1 a smaller copy.
pub(crate) fn tiff_pages(kinds: &[u32], big: bool) -> Vec<u8> {
    fn write<K: tiff_crate::encoder::TiffKind>(
        mut encoder: TiffEncoder<&mut Cursor<Vec<u8>>, K>,
        kinds: &[u32],
    ) {
        for &kind in kinds {
            let mut page = encoder.new_image::<colortype::RGB8>(WIDTH, HEIGHT).unwrap();
            page.encoder().write_tag(Tag::NewSubfileType, kind).unwrap();
            page.write_data(rgb().as_bytes()).unwrap();
        }
    }
    let mut bytes = Cursor::new(Vec::new());
    if big {
        write(TiffEncoder::new_big(&mut bytes).unwrap(), kinds);
    } else {
        write(TiffEncoder::new(&mut bytes).unwrap(), kinds);
    }
    bytes.into_inner()
}

pub(crate) fn tiff_of<C: colortype::ColorType>(values: &[C::Inner]) -> Vec<u8>
where
    [C::Inner]: tiff_crate::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    TiffEncoder::new(&mut bytes).unwrap().write_image::<C>(WIDTH, HEIGHT, values).unwrap();
    bytes.into_inner()
}

/// A TIFF of one strip; each field is a tag with 16-bit values.
pub(crate) fn tiff_by_hand(fields: &[(u16, &[u16])], strip: &[u8]) -> Vec<u8> {
    tiff_in_chunks(fields, (273, 279), &[strip.to_vec()])
}

/// A TIFF of such strips or tiles, with the tags of their offsets and lengths.
fn tiff_in_chunks(fields: &[(u16, &[u16])], (offsets, lengths): (u16, u16), chunks: &[Vec<u8>]) -> Vec<u8> {
    let mut at = 8;
    let mut start = |chunk: &Vec<u8>| {
        let start = at;
        at += chunk.len() as u32;
        start
    };
    let starts: Vec<u32> = chunks.iter().map(&mut start).collect();
    let sizes: Vec<u32> = chunks.iter().map(|chunk| chunk.len() as u32).collect();
    let (mut extra_at, mut extra) = (at, Vec::new());
    let mut entries: Vec<(u16, Vec<u8>)> = Vec::new();
    let mut push = |tag: u16, kind: u8, count: usize, mut data: Vec<u8>| {
        let mut entry = [&tag.to_le_bytes()[..], &[kind, 0], &(count as u32).to_le_bytes()].concat();
        if data.len() > 4 {
            entry.extend(extra_at.to_le_bytes());
            extra_at += data.len() as u32;
            extra.extend(data);
        } else {
            data.resize(4, 0);
            entry.extend(data);
        }
        entries.push((tag, entry));
    };
    for (tag, values) in [(offsets, &starts), (lengths, &sizes), (278, &vec![HEIGHT]), (256, &vec![WIDTH])] {
        push(tag, 4, values.len(), values.iter().flat_map(|value| value.to_le_bytes()).collect());
    }
    for (tag, values) in fields {
        push(*tag, 3, values.len(), values.iter().flat_map(|value| value.to_le_bytes()).collect());
    }
    entries.sort();
    let mut file = [&b"II*\0"[..], &extra_at.to_le_bytes(), &chunks.concat(), &extra].concat();
    file.extend((entries.len() as u16).to_le_bytes());
    entries.iter().for_each(|(_, entry)| file.extend(entry));
    file.extend([0; 4]);
    file
}

/// A TIFF whose strip is a JPEG.
pub(crate) fn tiff_in_jpeg() -> Vec<u8> {
    let strip = jpeg(None);
    let fields: [(u16, &[u16]); 5] =
        [(257, &[HEIGHT as u16]), (258, &[8, 8, 8]), (259, &[7]), (262, &[6]), (277, &[3])];
    tiff_by_hand(&fields, &strip)
}

/// A TIFF with a palette of so many entries, where entry 1 is red 7, green 70 and blue 200 of 255.
pub(crate) fn tiff_with_palette(bits: u16) -> Vec<u8> {
    let entries = 1usize << bits;
    let mut palette = vec![0; 3 * entries];
    (palette[1], palette[entries + 1], palette[2 * entries + 1]) = (7 * 257, 70 * 257, 200 * 257);
    let fields: [(u16, &[u16]); 6] =
        [(257, &[HEIGHT as u16]), (258, &[bits]), (259, &[1]), (262, &[3]), (277, &[1]), (320, &palette)];
    tiff_by_hand(&fields, &[1; (WIDTH * HEIGHT) as usize])
}

/// How a TIFF stores the samples of a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Planes {
    /// Beside each other.
    Together,
    /// A strip for each.
    Strips,
    /// Tiles of 16x16 for each.
    Tiles,
}

/// A TIFF of so many bands of 8 bits, of which the first three are [`texel`]'s red, green and blue and others are
/// [`band`]; `kinds` are those of ExtraSamples.
pub(crate) fn tiff_of_bands(bands: u16, photometric: u16, planes: Planes, kinds: &[u16]) -> Vec<u8> {
    let value = |(x, y): (u32, u32), band: u16| match band {
        0..=2 => texel(x, y)[usize::from(band)],
        _ => self::band(x, y, band),
    };
    let texels = |width: u32, height: u32| (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)));
    let plane = |(width, height)| {
        move |band| texels(width, height).map(|place| value(place, band)).collect::<Vec<u8>>()
    };
    let chunks: Vec<Vec<u8>> = match planes {
        Planes::Together => {
            let texel = |place| (0..bands).map(move |band| value(place, band));
            vec![texels(WIDTH, HEIGHT).flat_map(texel).collect()]
        }
        Planes::Strips => (0..bands).map(plane((WIDTH, HEIGHT))).collect(),
        Planes::Tiles => (0..bands).map(plane((16, 16))).collect(),
    };
    let depths = vec![8; bands.into()];
    let planar = if planes == Planes::Together { 1 } else { 2 };
    let (height, side) = ([HEIGHT as u16], [16]);
    let mut fields: Vec<(u16, &[u16])> = vec![
        (257, &height),
        (258, &depths),
        (259, &[1]),
        (262, std::slice::from_ref(&photometric)),
        (277, std::slice::from_ref(&bands)),
        (284, std::slice::from_ref(&planar)),
        (338, kinds),
    ];
    if planes == Planes::Tiles {
        fields.extend([(322, &side[..]), (323, &side[..])]);
        return tiff_in_chunks(&fields, (324, 325), &chunks);
    }
    tiff_in_chunks(&fields, (273, 279), &chunks)
}

/// RGB and a band, with a damaged colour profile.
pub(crate) fn tiff_with_band_and_profile() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut image = encoder.new_image::<colortype::RGBA8>(WIDTH, HEIGHT).unwrap();
    image.encoder().write_tag(Tag::ExtraSamples, &[0u16][..]).unwrap();
    image.encoder().write_tag(Tag::IccProfile, &[7u8; 64][..]).unwrap();
    image.write_data(rgba().as_bytes()).unwrap();
    bytes.into_inner()
}

/// A sample of a band beside the colours.
pub(crate) fn band(x: u32, y: u32, band: u16) -> u8 {
    (10 + 9 * x + 5 * y + 7 * u32::from(band)) as u8
}

pub(crate) fn jpeg(profile: Option<Vec<u8>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 100);
    profile.map(|profile| encoder.set_icc_profile(profile)).transpose().unwrap();
    encoder.write_image(rgb().as_bytes(), WIDTH, HEIGHT, ExtendedColorType::Rgb8).unwrap();
    bytes
}

pub(crate) fn cmyk_jpeg() -> Vec<u8> {
    let inks = [0, 0, 0, 128].repeat((WIDTH * HEIGHT) as usize);
    let mut bytes = Vec::new();
    jpeg_encoder::Encoder::new(&mut bytes, 100)
        .encode(&inks, WIDTH as u16, HEIGHT as u16, jpeg_encoder::ColorType::Cmyk)
        .unwrap();
    bytes
}

/// A JPEG that is to be turned as this EXIF orientation asks for.
pub(crate) fn turned_jpeg(orientation: u8) -> Vec<u8> {
    let mut bytes = jpeg(None);
    // Big-endian TIFF with one directory of one entry: tag 0x0112, a short.
    let exif =
        [&b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation, 0, 0, 0, 0, 0, 0]]
            .concat();
    let segment = [&[0xff, 0xe1, 0, exif.len() as u8 + 2], &exif[..]].concat();
    bytes.splice(2..2, segment);
    bytes
}

pub(crate) fn display_p3() -> Vec<u8> {
    ColorProfile::new_display_p3().encode().unwrap()
}

pub(crate) fn srgb() -> Vec<u8> {
    ColorProfile::new_srgb().encode().unwrap()
}

/// A gray profile whose curve is a straight line.
pub(crate) fn linear_gray() -> Vec<u8> {
    ColorProfile::new_gray_with_gamma(1.0).encode().unwrap()
}

/// A file with a profile, by the encoder of its format.
pub(crate) fn with_profile(image: &DynamicImage, format: ImageFormat, profile: Vec<u8>) -> Vec<u8> {
    fn write(mut encoder: impl ImageEncoder, image: &DynamicImage, profile: Vec<u8>) {
        encoder.set_icc_profile(profile).unwrap();
        let color = image.color().into();
        encoder.write_image(image.as_bytes(), image.width(), image.height(), color).unwrap();
    }
    let mut bytes = Cursor::new(Vec::new());
    match format {
        ImageFormat::Png => write(PngEncoder::new(&mut bytes), image, profile),
        ImageFormat::WebP => write(WebPEncoder::new_lossless(&mut bytes), image, profile),
        _ => write(tiff::TiffEncoder::new(&mut bytes), image, profile),
    }
    bytes.into_inner()
}

/// A DDS file of one image.
pub(crate) fn dds_of(format: dds::Format, data: &[u8]) -> Vec<u8> {
    let mut file = b"DDS ".to_vec();
    Header::new_image(WIDTH, HEIGHT, format).to_raw().write(&mut file).unwrap();
    file.extend(data);
    file
}

/// A KTX2 file of one level, by the numbers of its format and of its supercompression.
pub(crate) fn ktx2_of(format: u32, scheme: u32, faces: u32, data: &[u8]) -> Vec<u8> {
    let mut file = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    for word in [format, 1, WIDTH, HEIGHT, 0, 0, faces, 1, scheme, 0, 0, 0, 0] {
        file.extend(word.to_le_bytes());
    }
    file.extend([0; 16]);
    for word in [104u64, data.len() as u64, data.len() as u64] {
        file.extend(word.to_le_bytes());
    }
    file.extend(data);
    file
}

/// Blocks of alpha or of one channel: all texels are `value`.
pub(crate) fn bc4_blocks(value: u8) -> Vec<u8> {
    [value, value, 0, 0, 0, 0, 0, 0].to_vec()
}

/// A block of colour: all texels are red.
pub(crate) fn red_block() -> Vec<u8> {
    [0, 0xf8, 0, 0xf8, 0, 0, 0, 0].to_vec()
}

/// An ASTC block of one colour.
pub(crate) fn astc_block(rgba: [u8; 4]) -> Vec<u8> {
    // A void extent without bounds, then 16 bits a channel.
    let colour = rgba.into_iter().flat_map(|value| [value, value]);
    [0xfc, 0xfd].into_iter().chain([0xff; 6]).chain(colour).collect()
}

/// A BC7 block of mode 5: all texels have these values of 7 bits, and this alpha.
pub(crate) fn bc7_block([red, green, blue]: [u8; 3], alpha: u8) -> Vec<u8> {
    // One bit of mode behind five zeros, two bits of rotation.
    let mut bits: u128 = 1 << 5;
    let mut at = 8;
    let mut put = |value: u8, count: u32| {
        bits |= u128::from(value) << at;
        at += count;
    };
    for value in [red, green, blue] {
        put(value, 7);
        put(value, 7);
    }
    put(alpha, 8);
    put(alpha, 8);
    bits.to_le_bytes().to_vec()
}

/// JPEG XL of 8x8 texels.
pub(crate) fn jxl() -> Vec<u8> {
    let text = "ff0a38000e80480802010000044b189b9c71840338800338204ac039050100204480081001224084fff7eff9efa131e79c6bed\
                736f922409015555555555d5ffffff73efebeeeeee86fff7eff9efa131e79c6bed736f922409015555555555d5ffffff73efeb\
                eeeeee86fff7eff9efa131e79c6bed736f922409015555555555d5ffffff73efebeeeeee86fff7eff9efa131e79c6bed736f92\
                2409015555555555d5ffffff73efebeeeeee3e002beb817aa01ea8c7eb817aa01ea8c7eb817aa01ea8c7eb817aa01ea8c7eb81\
                7aa01ea8c7eb817aa01ea8c7eb817aa01ea8c7eb817aa01ea8afe3f2e5cb972f5fbe9c173ce3f4f4f4f4f4f4f47200603900b0\
                1c00580e002c0700960300cb0100";
    (0..text.len() / 2).map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).unwrap()).collect()
}

//! Samples of TIFF texels: gray or RGB, alpha, and bands of their own, such as near infrared.
//!
//! ExtraSamples tells which samples are alpha. GDAL's metadata overrules it where it names a sample's colour interpretation:
//! aerial photographs in four bands are often stored as RGB with alpha, and as bands by that metadata alone.

use std::io::{BufRead, Seek};
use std::path::Path;

use image::DynamicImage;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::{PhotometricInterpretation, PlanarConfiguration, Tag};

use super::frames::Source;
use super::pixels::{damaged, floats, unit};
use crate::error::CliError;

/// Tag of GDAL's metadata: items in XML.
pub(crate) const GDAL_METADATA: Tag = Tag::Unknown(42112);
/// Most channels of an image: further bands are those of further images.
pub(crate) const MOST_CHANNELS: u16 = 4;
/// Most names of bands that a note has.
const MOST_NAMES: usize = 16;
/// Most letters of each.
const NAME_LENGTH: usize = 40;

/// Samples of a file's texels, some of which are bands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bands {
    /// Samples of a texel, at least 2.
    pub(crate) count: u16,
    /// Whether the first three are red, green and blue.
    pub(crate) is_rgb: bool,
}

impl Bands {
    /// Samples of a file's first image; `None` where they are gray or RGB, alone or with alpha, and for palettes and other colour
    /// models. RGB or gray with one more sample of which nothing is said has alpha: many writers of alpha say nothing.
    pub(crate) fn of<S: BufRead + Seek>(decoder: &mut Decoder<S>) -> Option<Bands> {
        let photometric = decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).ok()??;
        let is_rgb = photometric == PhotometricInterpretation::RGB.to_u16();
        let is_gray = photometric == PhotometricInterpretation::BlackIsZero.to_u16();
        let count = decoder.find_tag_unsigned::<u16>(Tag::SamplesPerPixel).ok()??;
        let colours = if is_rgb { 3 } else { 1 };
        if (!is_rgb && !is_gray) || count <= colours {
            return None;
        }
        let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).ok()?;
        let metadata = metadata(decoder);
        let is_alpha = || match interpretation(&metadata, colours) {
            Some(meaning) => meaning == "Alpha",
            None => extra.is_none_or(|extra| extra.iter().any(|kind| matches!(kind, 1 | 2))),
        };
        let usual = count == colours + 1 && is_alpha();
        (!usual).then_some(Bands { count, is_rgb })
    }

    /// Number of images of up to four channels that hold the bands.
    pub(crate) fn images(self) -> u16 {
        self.count.div_ceil(MOST_CHANNELS)
    }

    /// One sentence on how the bands are coded, with the names that the metadata gives them.
    pub(crate) fn note(self, metadata: &str) -> String {
        let mut named: Vec<(u16, &str)> =
            items(metadata, "description").filter(|&(band, _)| band < self.count).collect();
        named.sort_by_key(|&(band, _)| band);
        // Names are foreign text, and go to a terminal.
        let plain = |name: &str| name.chars().filter(|c| !c.is_control()).take(NAME_LENGTH).collect();
        let names: Vec<String> = named.into_iter().map(|(_, name)| plain(name)).collect();
        let names = match names.len() {
            0 => String::new(),
            1..=MOST_NAMES => format!(" ({})", names.join(", ")),
            more => format!(" ({} and {} more)", names[..MOST_NAMES].join(", "), more - MOST_NAMES),
        };
        let count = self.count;
        match self.images() {
            1 => format!("{count} bands{names} are the channels of the image, without alpha"),
            images => format!("{count} bands{names} are the channels of {images} images of up to four"),
        }
    }
}

/// GDAL's metadata of a file's first image; empty where there is none.
pub(crate) fn metadata<S: BufRead + Seek>(decoder: &mut Decoder<S>) -> String {
    decoder.get_tag_ascii_string(GDAL_METADATA).unwrap_or_default()
}

fn interpretation(metadata: &str, band: u16) -> Option<&str> {
    items(metadata, "colorinterp").find(|&(found, _)| found == band).map(|(_, text)| text)
}

/// Bands with the text of their item of that role, such as `<Item name="DESCRIPTION" sample="3" role="description">nir</Item>`,
/// in the order of the file.
fn items<'m>(metadata: &'m str, role: &str) -> impl Iterator<Item = (u16, &'m str)> {
    let role = format!("role=\"{role}\"");
    let items = metadata.split("<Item ").skip(1).filter_map(|item| item.split_once('>'));
    items.filter_map(move |(attributes, text)| {
        let mut attributes = attributes.split_whitespace();
        let is_wanted = attributes.clone().any(|attribute| attribute == role);
        let sample = attributes.find_map(|attribute| attribute.strip_prefix("sample=\"")?.strip_suffix('"'));
        let band = sample.filter(|_| is_wanted)?.parse().ok()?;
        Some((band, text.split('<').next()?.trim()))
    })
}

/// The storage of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sample {
    Byte,
    Sixteen,
    Float,
}

/// Samples of all texels, those of floats from 0 to 1 in 16 bits.
pub(super) struct Texels {
    pub(super) values: Vec<u16>,
    pub(super) sample: Sample,
    pub(super) is_planar: bool,
}

/// Reads texels of `count` samples chunk by chunk: the decoder fails at whole images of planes in tiles.
pub(super) fn texels_of(
    path: &Path,
    decoder: &mut Decoder<Box<dyn Source>>,
    count: u16,
) -> Result<Texels, CliError> {
    let failed = |error| damaged(path, error);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let planes = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(failed)?;
    let is_planar = planes == Some(PlanarConfiguration::Planar.to_u16());
    let (chunk_width, chunk_height) = decoder.chunk_dimensions();
    if chunk_width == 0 || chunk_height == 0 {
        return Err(failed(tiff::TiffError::IntSizeError));
    }
    let across = width.div_ceil(chunk_width);
    let a_plane = across * height.div_ceil(chunk_height);
    let (planes, samples) = if is_planar { (u32::from(count), 1) } else { (1, usize::from(count)) };
    // Of tiny chunks there could be more than are counted, and none is there.
    let count_all = a_plane.checked_mul(planes).ok_or_else(|| failed(tiff::TiffError::IntSizeError))?;
    let row = width as usize * samples;
    let mut values = vec![0u16; row * height as usize * planes as usize];
    let mut sample = Sample::Byte;
    for index in 0..count_all {
        let (columns, _) = decoder.chunk_data_dimensions(index);
        let read: Vec<u16> = match decoder.read_chunk(index).map_err(failed)? {
            DecodingResult::U8(values) => values.into_iter().map(u16::from).collect(),
            DecodingResult::U16(values) => {
                sample = Sample::Sixteen;
                values
            }
            other => {
                sample = Sample::Float;
                let what = || format!("{count} bands of these samples");
                let unread = || CliError::PixelFormat { path: path.to_owned(), what: what() };
                let values: Option<Vec<u16>> =
                    floats(other).ok_or_else(unread)?.into_iter().map(unit).collect();
                values.ok_or_else(|| CliError::HighRange { path: path.to_owned() })?
            }
        };
        let (plane, place) = (index / a_plane, index % a_plane);
        let (left, top) = (place % across * chunk_width, place / across * chunk_height);
        let length = columns.min(width - left) as usize * samples;
        let lines = chunk_height.min(height - top) as usize;
        let first = (plane as usize * height as usize + top as usize) * row + left as usize * samples;
        let from = read.chunks(columns.max(1) as usize * samples);
        let to = values[first..].chunks_mut(row);
        for (to, from) in to.zip(from).take(lines).filter(|(_, from)| from.len() >= length) {
            to[..length].copy_from_slice(&from[..length]);
        }
    }
    Ok(Texels { values, sample, is_planar })
}

/// The order of an image's samples.
pub(super) struct Form {
    pub(super) size: (u32, u32),
    pub(super) count: u16,
    /// Band by band instead of texel by texel.
    pub(super) is_planar: bool,
}

impl Form {
    /// Images of up to four bands each, made of their interleaved samples and number of channels.
    pub(super) fn split(
        &self,
        values: &[u16],
        image: impl Fn(Vec<u16>, u16) -> Option<DynamicImage>,
    ) -> Option<Vec<DynamicImage>> {
        let (texels, count) = (self.size.0 as usize * self.size.1 as usize, usize::from(self.count));
        let channels = self.count.min(MOST_CHANNELS);
        let one = |first: usize| {
            let value = |index: usize| {
                let (texel, band) = (index / usize::from(channels), first + index % usize::from(channels));
                let place = if self.is_planar { band * texels + texel } else { texel * count + band };
                if band < count { values[place] } else { 0 }
            };
            image((0..texels * usize::from(channels)).map(value).collect(), channels)
        };
        (0..count).step_by(usize::from(channels)).map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const METADATA: &str = r#"<GDALMetadata>
        <Item name="OVR_RESAMPLING_ALG">NEAREST</Item>
        <Item name="COLORINTERP" sample="3" role="colorinterp">Undefined</Item>
        <Item name="DESCRIPTION" sample="3" role="description"> near infrared </Item>
        <Item name="DESCRIPTION" sample="13" role="description">B12</Item>
    </GDALMetadata>"#;

    #[test]
    fn items_are_found_by_band_and_role() {
        assert_eq!(interpretation(METADATA, 3), Some("Undefined"));
        let names: Vec<_> = items(METADATA, "description").collect();
        assert_eq!(names, [(3, "near infrared"), (13, "B12")]);
        assert_eq!(interpretation("<Item sample=\"3\" role=\"colorinterp\"", 3), None);
        assert_eq!(interpretation("<Item sample=\"70000\" role=\"colorinterp\">Alpha</Item>", 4464), None);
    }

    #[test]
    fn notes_name_bands() {
        let four = Bands { count: 4, is_rgb: true };
        let text = "4 bands (near infrared) are the channels of the image, without alpha";
        assert_eq!(four.note(METADATA), text);
        let hostile = METADATA.replace("near infrared", &format!("\u{1b}[2J{}", "x".repeat(9999)));
        let text = four.note(&hostile);
        assert!(text.len() < 120 && !text.contains('\u{1b}'), "{text}");
        let many = Bands { count: 14, is_rgb: false };
        let text = "14 bands (near infrared, B12) are the channels of 4 images of up to four";
        assert_eq!(many.note(METADATA), text);
    }
}

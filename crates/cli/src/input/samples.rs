//! Samples of TIFF texels: gray or RGB, alpha, and bands of their own, such as near infrared.
//!
//! ExtraSamples tells which samples are alpha. GDAL's metadata overrules it where it names a sample's colour interpretation:
//! aerial photographs in four bands are often stored as RGB with alpha, and as bands by that metadata alone.

use std::io::{BufRead, Seek};

use tiff::decoder::Decoder;
use tiff::tags::{PhotometricInterpretation, Tag};

/// Tag of GDAL's metadata: items in XML.
pub(crate) const GDAL_METADATA: Tag = Tag::Unknown(42112);
/// Most channels of an image: further bands are those of further images.
pub(crate) const MOST_CHANNELS: u16 = 4;
/// Most names of bands that a note has.
const MOST_NAMES: usize = 16;

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
        let names: Vec<&str> =
            (0..self.count).filter_map(|band| item(metadata, band, "description")).collect();
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
    item(metadata, band, "colorinterp")
}

/// The text of a band's item of that role, such as `<Item name="DESCRIPTION" sample="3" role="description">nir</Item>`.
fn item<'m>(metadata: &'m str, band: u16, role: &str) -> Option<&'m str> {
    let (sample, role) = (format!("sample=\"{band}\""), format!("role=\"{role}\""));
    let items = metadata.split("<Item ").skip(1).filter_map(|item| item.split_once('>'));
    let mut texts = items.filter(|(attributes, _)| {
        let has = |wanted: &String| attributes.split_whitespace().any(|attribute| attribute == *wanted);
        has(&sample) && has(&role)
    });
    texts.next().and_then(|(_, text)| text.split('<').next()).map(str::trim)
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
        assert_eq!(item(METADATA, 3, "description"), Some("near infrared"));
        assert_eq!(item(METADATA, 13, "description"), Some("B12"));
        assert_eq!(item(METADATA, 1, "description"), None);
        assert_eq!(item("<Item sample=\"3\" role=\"colorinterp\"", 3, "colorinterp"), None);
    }

    #[test]
    fn notes_name_bands() {
        let four = Bands { count: 4, is_rgb: true };
        let text = "4 bands (near infrared) are the channels of the image, without alpha";
        assert_eq!(four.note(METADATA), text);
        let many = Bands { count: 14, is_rgb: false };
        let text = "14 bands (near infrared, B12) are the channels of 4 images of up to four";
        assert_eq!(many.note(METADATA), text);
    }
}

//! Cloud-optimised GeoTIFF (OGC 21-026): tiles compressed by Deflate, overviews, directories at the head of the file.
//!
//! The crate `tiff` writes a directory behind its image; readers over HTTP expect all directories in their first request. Layout: header,
//! directories from the image down to its smallest overview, texels from the smallest overview up to the image.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use texfold_core::{ImageSize, parallel};
use tiff::tags::Tag;

use crate::input::georeference::{Georeference, TagValue};

/// Texels a side of a tile: GDAL's default, and that of the largest image without overviews.
const TILE: u32 = 512;
/// Most bytes of a file with 32-bit offsets; a larger one is BigTIFF.
const CLASSIC: u64 = u32::MAX as u64;

/// An image as its samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Samples<'a> {
    pub size: ImageSize,
    /// Samples of a texel.
    pub channels: u16,
    /// Red, green and blue are the first three.
    pub is_rgb: bool,
    /// Alpha is the last one.
    pub has_alpha: bool,
    /// Bytes of a sample: 1, or 2 in the byte order of the machine.
    pub sample_bytes: usize,
    /// The sample that stands for no data.
    pub no_data: Option<u32>,
    pub bytes: &'a [u8],
}

/// The bytes of a file.
///
/// # Errors
/// Those of the Deflate encoder.
pub(super) fn encode(
    image: Samples<'_>,
    georeference: Option<&Georeference>,
) -> Result<Vec<u8>, std::io::Error> {
    let mut overviews: Vec<(ImageSize, Vec<u8>)> = Vec::new();
    loop {
        let finest = overviews.last().map_or(image, |level| image.level(level));
        if finest.size.width.max(finest.size.height) <= TILE {
            break;
        }
        overviews.push(finest.halved());
    }
    let levels: Vec<Samples<'_>> =
        std::iter::once(image).chain(overviews.iter().map(|level| image.level(level))).collect();
    let mut data = Vec::new();
    let mut tiles = vec![Vec::new(); levels.len()];
    for (level, tiles) in levels.iter().zip(&mut tiles).rev() {
        for tile in level.tiles()? {
            tiles.push((data.len() as u64, tile.len() as u64));
            data.extend(tile);
        }
    }
    let directories: Vec<Vec<Entry>> = levels
        .iter()
        .zip(&tiles)
        .enumerate()
        .map(|(number, (level, tiles))| level.entries(number > 0, tiles, georeference))
        .collect();
    let is_big = directories_of(&directories, true, 0).len() as u64 + data.len() as u64 > CLASSIC;
    // Offsets do not change the length.
    let first = directories_of(&directories, is_big, 0).len() as u64;
    let mut file = directories_of(&directories, is_big, first);
    file.append(&mut data);
    Ok(file)
}

impl<'a> Samples<'a> {
    /// An overview of the same samples.
    fn level<'b>(&self, (size, bytes): &'b (ImageSize, Vec<u8>)) -> Samples<'b>
    where
        'a: 'b,
    {
        Samples { size: *size, bytes, ..*self }
    }

    fn texel_bytes(&self) -> usize {
        self.sample_bytes * usize::from(self.channels)
    }

    /// The texel of that column and row, both cut to the image.
    fn texel(&self, column: u32, row: u32) -> &'a [u8] {
        let (column, row) = (column.min(self.size.width - 1), row.min(self.size.height - 1));
        let at = (row as usize * self.size.width as usize + column as usize) * self.texel_bytes();
        &self.bytes[at..at + self.texel_bytes()]
    }

    fn sample(&self, texel: &[u8], channel: usize) -> u32 {
        match self.sample_bytes {
            1 => texel[channel].into(),
            _ => u16::from_ne_bytes([texel[2 * channel], texel[2 * channel + 1]]).into(),
        }
    }

    /// Means of 2x2 texels, of colours weighted by alpha, and without samples that stand for no data; columns and rows at the border
    /// count twice where there is an odd number.
    fn halved(&self) -> (ImageSize, Vec<u8>) {
        let size = ImageSize { width: self.size.width.div_ceil(2), height: self.size.height.div_ceil(2) };
        let alpha = self.has_alpha.then(|| usize::from(self.channels) - 1);
        let rows = parallel::map(size.height as usize, |row| {
            let mut out = Vec::new();
            for column in 0..size.width {
                let near = [(0, 0), (1, 0), (0, 1), (1, 1)]
                    .map(|(across, down)| self.texel(2 * column + across, 2 * row as u32 + down));
                for channel in 0..usize::from(self.channels) {
                    let weighted = near.map(|texel| {
                        let sample = self.sample(texel, channel);
                        let weight = match alpha {
                            _ if self.no_data == Some(sample) => 0,
                            Some(alpha) if alpha != channel => self.sample(texel, alpha),
                            _ => 1,
                        };
                        (u64::from(weight), u64::from(sample))
                    });
                    let all: u64 = weighted.iter().map(|(weight, _)| weight).sum();
                    let sum: u64 = weighted.iter().map(|(weight, sample)| weight * sample).sum();
                    let plain: u64 = weighted.iter().map(|(_, sample)| sample).sum();
                    let mean = (sum + all / 2).checked_div(all).unwrap_or((plain + 2) / 4);
                    match self.sample_bytes {
                        1 => out.push(mean as u8),
                        _ => out.extend((mean as u16).to_ne_bytes()),
                    }
                }
            }
            out
        });
        (size, rows.concat())
    }

    /// Compressed tiles, row by row.
    fn tiles(&self) -> Result<Vec<Vec<u8>>, std::io::Error> {
        let (columns, rows) = self.tile_counts();
        let tiles = parallel::map((columns * rows) as usize, |number| {
            let place = (number as u32 % columns * TILE, number as u32 / columns * TILE);
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
            for row in place.1..place.1 + TILE {
                encoder.write_all(&self.differences(place.0, row))?;
            }
            encoder.finish()
        });
        tiles.into_iter().collect()
    }

    fn tile_counts(&self) -> (u32, u32) {
        (self.size.width.div_ceil(TILE), self.size.height.div_ceil(TILE))
    }

    /// A row of a tile, each sample less the one of the texel before it (TIFF's predictor 2), in little endian; texels beyond the
    /// image repeat its last ones.
    fn differences(&self, left: u32, row: u32) -> Vec<u8> {
        let mut out = Vec::new();
        let mut before = vec![0u32; self.channels.into()];
        for column in left..left + TILE {
            let texel = self.texel(column, row);
            for (channel, before) in before.iter_mut().enumerate() {
                let sample = self.sample(texel, channel);
                let difference = sample.wrapping_sub(*before);
                out.extend(&difference.to_le_bytes()[..self.sample_bytes]);
                *before = sample;
            }
        }
        out
    }

    /// Entries of the directory, in the order of tags; offsets of tiles count from the first byte behind all directories.
    fn entries(
        &self,
        is_overview: bool,
        tiles: &[(u64, u64)],
        georeference: Option<&Georeference>,
    ) -> Vec<Entry> {
        let short = |tag: Tag, value: u16| Entry::of(tag, TagValue::Shorts(&[value]));
        let long = |tag, value| Entry { tag, value: Value::Longs(vec![value]) };
        let channels = usize::from(self.channels);
        let alike = |tag, value| Entry::of(tag, TagValue::Shorts(&vec![value; channels]));
        let mut entries = vec![
            long(Tag::NewSubfileType.to_u16(), u64::from(is_overview)),
            long(Tag::ImageWidth.to_u16(), self.size.width.into()),
            long(Tag::ImageLength.to_u16(), self.size.height.into()),
            alike(Tag::BitsPerSample, 8 * self.sample_bytes as u16),
            short(Tag::Compression, DEFLATE),
            short(Tag::PhotometricInterpretation, if self.is_rgb { RGB } else { BLACK_IS_ZERO }),
            short(Tag::SamplesPerPixel, self.channels),
            short(Tag::PlanarConfiguration, INTERLEAVED),
            short(Tag::Predictor, DIFFERENCES),
            short(Tag::TileWidth, TILE as u16),
            short(Tag::TileLength, TILE as u16),
            Entry {
                tag: Tag::TileOffsets.to_u16(),
                value: Value::Offsets(tiles.iter().map(|tile| tile.0).collect()),
            },
            Entry {
                tag: Tag::TileByteCounts.to_u16(),
                value: Value::Longs(tiles.iter().map(|tile| tile.1).collect()),
            },
            alike(Tag::SampleFormat, UNSIGNED),
        ];
        let extra = channels - if self.is_rgb { 3 } else { 1 };
        if extra > 0 {
            let kind = if self.has_alpha { STRAIGHT_ALPHA } else { UNSPECIFIED };
            entries.push(Entry::of(Tag::ExtraSamples, TagValue::Shorts(&vec![kind; extra])));
        }
        // Readers take georeference and metadata from the image's directory, the value of no data from each.
        let tags = georeference.map(Georeference::tags).unwrap_or_default();
        let kept = tags.into_iter().filter(|(tag, _)| !is_overview || *tag == Tag::GdalNodata);
        entries.extend(kept.map(|(tag, value)| Entry::of(tag, value)));
        entries.sort_by_key(|entry| entry.tag);
        entries
    }
}

// Values of tags.
const DEFLATE: u16 = 8;
const RGB: u16 = 2;
const BLACK_IS_ZERO: u16 = 1;
const INTERLEAVED: u16 = 1;
const DIFFERENCES: u16 = 2;
const UNSIGNED: u16 = 1;
const UNSPECIFIED: u16 = 0;
const STRAIGHT_ALPHA: u16 = 2;

// Codes of types.
const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const DOUBLE: u16 = 12;
const LONG8: u16 = 16;

/// An entry of a directory.
#[derive(Debug)]
struct Entry {
    tag: u16,
    value: Value,
}

#[derive(Debug)]
enum Value {
    /// Bytes of a type, and the number of values in them.
    Bytes(u16, u64, Vec<u8>),
    /// Numbers below 2^32.
    Longs(Vec<u64>),
    /// Offsets from the first byte of texels.
    Offsets(Vec<u64>),
}

impl Entry {
    fn of(tag: Tag, value: TagValue<'_>) -> Entry {
        let tag = tag.to_u16();
        let value = match value {
            TagValue::Doubles(values) => Value::Bytes(
                DOUBLE,
                values.len() as u64,
                values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            ),
            TagValue::Shorts(values) => Value::Bytes(
                SHORT,
                values.len() as u64,
                values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            ),
            TagValue::Text(text) => {
                let bytes: Vec<u8> = text.bytes().chain([0]).collect();
                Value::Bytes(ASCII, bytes.len() as u64, bytes)
            }
        };
        Entry { tag, value }
    }

    /// Type, number of values and bytes, where texels begin at that offset.
    fn written(&self, is_big: bool, first: u64) -> (u16, u64, Vec<u8>) {
        let longs = |values: &[u64]| values.iter().flat_map(|&value| (value as u32).to_le_bytes()).collect();
        match &self.value {
            Value::Bytes(kind, count, bytes) => (*kind, *count, bytes.clone()),
            Value::Longs(values) => (LONG, values.len() as u64, longs(values)),
            Value::Offsets(values) => {
                let offsets: Vec<u64> = values.iter().map(|value| first + value).collect();
                let count = offsets.len() as u64;
                match is_big {
                    true => (LONG8, count, offsets.into_iter().flat_map(u64::to_le_bytes).collect()),
                    false => (LONG, count, longs(&offsets)),
                }
            }
        }
    }
}

/// Header and directories, each with its values behind it, where texels begin at offset `first`.
fn directories_of(directories: &[Vec<Entry>], is_big: bool, first: u64) -> Vec<u8> {
    let offset = if is_big { 8 } else { 4 };
    let number = |value: u64| value.to_le_bytes().into_iter().take(offset);
    let mut out = match is_big {
        false => [b"II", 42u16.to_le_bytes().as_slice(), &8u32.to_le_bytes()].concat(),
        true => [b"II", [43u16, 8, 0].map(u16::to_le_bytes).as_flattened(), &16u64.to_le_bytes()].concat(),
    };
    for (place, entries) in directories.iter().enumerate() {
        let count = entries.len() as u64;
        let count: Vec<u8> = count.to_le_bytes().into_iter().take(if is_big { 8 } else { 2 }).collect();
        // Tag and type, count, value or offset; behind all entries the offset of the next directory.
        let length = count.len() + entries.len() * (4 + 2 * offset) + offset;
        let behind = out.len() + length;
        let mut values: Vec<u8> = Vec::new();
        out.extend(count);
        for entry in entries {
            let (kind, count, mut bytes) = entry.written(is_big, first);
            out.extend([entry.tag.to_le_bytes(), kind.to_le_bytes()].as_flattened());
            out.extend(number(count));
            if bytes.len() <= offset {
                bytes.resize(offset, 0);
                out.extend(bytes);
            } else {
                out.extend(number((behind + values.len()) as u64));
                values.extend(bytes);
                values.resize(values.len().next_multiple_of(8), 0);
            }
        }
        let next = (behind + values.len()).next_multiple_of(8);
        out.extend(number(if place + 1 < directories.len() { next as u64 } else { 0 }));
        out.extend(values);
        out.resize(next, 0);
    }
    out
}

#[cfg(test)]
mod tests {
    use tiff::decoder::{Decoder, DecodingResult};

    use super::*;

    fn gray(size: (u32, u32), sample_bytes: usize, bytes: &[u8]) -> Samples<'_> {
        let size = ImageSize { width: size.0, height: size.1 };
        Samples { size, channels: 1, is_rgb: false, has_alpha: false, sample_bytes, no_data: None, bytes }
    }

    #[test]
    fn overviews_are_means_without_what_is_clear_or_no_data() {
        let (size, halved) = gray((3, 2), 1, &[10, 20, 31, 30, 41, 50]).halved();
        // The last column counts twice; halves are rounded up.
        assert_eq!((size.width, size.height, halved), (2, 1, vec![25, 41]));
        let image = Samples { no_data: Some(0), ..gray((4, 2), 1, &[0, 20, 0, 0, 30, 40, 0, 0]) };
        assert_eq!(image.halved().1, [30, 0]);
        let deep: Vec<u8> = [1000u16, 2000, 60_000, 65_535].into_iter().flat_map(u16::to_ne_bytes).collect();
        assert_eq!(gray((2, 2), 2, &deep).halved().1, 32_134u16.to_ne_bytes());
        let clear = [[200, 0], [100, 255], [7, 0], [50, 255]].concat();
        let image = Samples { channels: 2, has_alpha: true, ..gray((2, 2), 1, &clear) };
        assert_eq!(image.halved().1, [75, 128]);
    }

    #[test]
    fn large_files_have_64_bit_offsets() {
        let bytes: Vec<u8> = (0..700 * 3).map(|at| (at * 7 % 251) as u8).collect();
        let image = gray((700, 3), 1, &bytes);
        let tiles = image.tiles().unwrap();
        let mut places = Vec::new();
        let mut data = Vec::new();
        for tile in tiles {
            places.push((data.len() as u64, tile.len() as u64));
            data.extend(tile);
        }
        let directories = [image.entries(false, &places, None)];
        let first = directories_of(&directories, true, 0).len() as u64;
        let file = [directories_of(&directories, true, first), data].concat();
        assert_eq!(file[..4], *b"II\x2b\0");
        let mut decoder = Decoder::new(std::io::Cursor::new(file)).unwrap();
        assert!(matches!(decoder.read_image().unwrap(), DecodingResult::U8(found) if found == bytes));
    }
}

//! Images read in bands of rows: PNG by its rows and TIFF by its strips or tiles hold no more than a band and what a
//! strip or row of tiles holds; all else is decoded whole, as it is stored.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use image::DynamicImage;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo, Raster};
use texfold_core::{ImageSize, SourceError};
use tiff::decoder::{ChunkType, Decoder as TiffDecoder, DecodingResult};
use tiff::tags::{ByteOrder, PlanarConfiguration, Tag};

use super::pixels;
use super::samples;
use super::{Remarks, frames, profile};
use crate::error::CliError;
use crate::files;
use crate::settings::Settings;

/// Rows of an image.
#[derive(Debug)]
pub(crate) struct Band {
    path: PathBuf,
    width: u32,
    rows: u32,
    channels: u8,
    samples: Samples,
    color: ColorSpace,
    alpha: Option<Alpha>,
}

/// Values as they are stored, channels interleaved.
#[derive(Debug, Clone, PartialEq)]
enum Samples {
    Eight(Vec<u8>),
    Sixteen(Vec<u16>),
}

/// An image that is read from top to bottom.
#[derive(Debug)]
pub(crate) struct Bands {
    path: PathBuf,
    size: ImageSize,
    color: ColorSpace,
    alpha: Option<Alpha>,
    next: u32,
    source: Source,
}

enum Source {
    Whole(DynamicImage),
    /// What other readers gave.
    Texels(Raster),
    Png(Box<png::Reader<BufReader<File>>>),
    Tiff(Box<Tiff>),
}

impl std::fmt::Debug for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Source::Whole(_) => "Whole",
            Source::Texels(_) => "Texels",
            Source::Png(_) => "Png",
            Source::Tiff(_) => "Tiff",
        })
    }
}

/// Rows that are read at a time of a strip that is stored as it is.
const PLAIN_ROWS: u32 = 64;

/// A TIFF file with the rows of chunks that reach beyond the last band.
struct Tiff {
    decoder: TiffDecoder<BufReader<File>>,
    channels: u8,
    /// Whether the last channel is a band of its own and no alpha.
    has_band: bool,
    /// Columns and rows of a chunk, and chunks beside one another.
    chunk: (u32, u32),
    across: u32,
    /// Of strips that are stored as they are, the first byte and the bytes of each: of such ones some rows can be read.
    plain: Option<Vec<(u64, u64)>>,
    /// Rows from `first` on, whole.
    first: u32,
    held: Samples,
}

impl Bands {
    /// Opens a file; `whole` reads what this cannot.
    pub(crate) fn open(
        path: &Path,
        settings: &Settings,
        limit_bytes: u64,
        remarks: &mut Remarks,
        whole: impl FnOnce(&mut Remarks) -> Result<Raster, CliError>,
    ) -> Result<Bands, CliError> {
        let size = super::size_of(path)?;
        let head = super::head_of(path)?;
        let (mut color, mut alpha) = (settings.color, settings.alpha);
        let source = if super::container::Container::of(&head).is_some() {
            Source::Texels(whole(remarks)?)
        } else if let Some(source) = streamed(path, &head, color) {
            frames::warn_of_rest(path, &head, remarks);
            if matches!(&source, Source::Tiff(tiff) if tiff.has_band) {
                alpha = alpha.or(Some(Alpha::Band));
            }
            source
        } else {
            let decoded = pixels::decode(path, color, limit_bytes, remarks)?;
            color = decoded.color;
            if decoded.has_band {
                alpha = alpha.or(Some(Alpha::Band));
            }
            Source::Whole(decoded.image)
        };
        Ok(Bands { path: path.to_owned(), size, color, alpha, next: 0, source })
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> ImageSize {
        self.size
    }

    /// The next `rows` rows.
    pub(crate) fn next(&mut self, rows: u32) -> Result<Band, CliError> {
        let (width, top) = (self.size.width, self.next);
        self.next += rows;
        let (path, color, mut alpha) = (self.path.clone(), self.color, self.alpha);
        let (channels, samples) = match &mut self.source {
            Source::Whole(image) => {
                let band = image.crop_imm(0, top, width, rows);
                (band.color().channel_count(), samples_of(&path, &band)?)
            }
            Source::Texels(raster) => {
                let channels = raster.info().channels;
                alpha = alpha.or(Some(raster.info().alpha));
                let texels = (top..top + rows).flat_map(|y| (0..width).map(move |x| (x, y)));
                let raster = &*raster;
                let value = |(x, y)| (0..channels.into()).map(move |channel| raster.value(x, y, channel));
                let bytes = texels.flat_map(value).map(texfold_core::image::to_u8).collect();
                (channels, Samples::Eight(bytes))
            }
            Source::Png(reader) => png_rows(&path, reader, rows)?,
            Source::Tiff(tiff) => {
                let failed = |error: tiff::TiffError| tiff_fault(&path, error);
                (tiff.channels, tiff.rows(width, self.size.height, rows).map_err(failed)?)
            }
        };
        Ok(Band { path, width, rows, channels, samples, color, alpha })
    }
}

/// PNG and TIFF whose pixels are as they can be used; `None` for what other readers shall take, errors among it.
fn streamed(path: &Path, head: &[u8], color: ColorSpace) -> Option<Source> {
    let file = || Some(BufReader::new(files::open(path).ok()?));
    let keeps = |profile: Option<&[u8]>, channels: u8| {
        color != ColorSpace::Srgb || profile::keeps_values(profile, usize::from(channels))
    };
    if head.starts_with(b"\x89PNG") {
        let mut decoder = png::Decoder::new(file()?);
        decoder.set_transformations(png::Transformations::EXPAND);
        let reader = decoder.read_info().ok()?;
        let info = reader.info();
        let (channels, _) = reader.output_color_type();
        let usable = !info.interlaced
            && info.exif_metadata.is_none()
            && keeps(info.icc_profile.as_deref(), channels.samples() as u8);
        return usable.then(|| Source::Png(Box::new(reader)));
    }
    if frames::is_tiff(head) {
        let mut tiff = Tiff::open(file()?)?;
        let profile = tiff.decoder.get_tag_u8_vec(Tag::IccProfile).ok();
        return keeps(profile.as_deref(), tiff.channels).then(|| Source::Tiff(Box::new(tiff)));
    }
    None
}

fn samples_of(path: &Path, image: &DynamicImage) -> Result<Samples, CliError> {
    Ok(match image {
        DynamicImage::ImageLuma8(_)
        | DynamicImage::ImageLumaA8(_)
        | DynamicImage::ImageRgb8(_)
        | DynamicImage::ImageRgba8(_) => Samples::Eight(image.as_bytes().to_vec()),
        DynamicImage::ImageLuma16(image) => Samples::Sixteen(image.to_vec()),
        DynamicImage::ImageLumaA16(image) => Samples::Sixteen(image.to_vec()),
        DynamicImage::ImageRgb16(image) => Samples::Sixteen(image.to_vec()),
        DynamicImage::ImageRgba16(image) => Samples::Sixteen(image.to_vec()),
        _ => return Err(CliError::PixelFormat { path: path.to_owned(), what: "float samples".to_owned() }),
    })
}

fn png_rows(
    path: &Path,
    reader: &mut png::Reader<BufReader<File>>,
    rows: u32,
) -> Result<(u8, Samples), CliError> {
    let fault = |error: png::DecodingError| CliError::Rows { path: path.to_owned(), source: Box::new(error) };
    let (color, depth) = reader.output_color_type();
    let mut bytes = Vec::new();
    for _ in 0..rows {
        let row = reader.next_row().map_err(fault)?;
        let row = row.ok_or_else(|| CliError::Rows {
            path: path.to_owned(),
            source: Box::new(std::io::Error::from(std::io::ErrorKind::UnexpectedEof)),
        })?;
        bytes.extend_from_slice(row.data());
    }
    let samples = match depth {
        png::BitDepth::Sixteen => Samples::Sixteen(
            bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect(),
        ),
        _ => Samples::Eight(bytes),
    };
    Ok((color.samples() as u8, samples))
}

fn tiff_fault(path: &Path, error: tiff::TiffError) -> CliError {
    CliError::Rows { path: path.to_owned(), source: Box::new(error) }
}

impl Tiff {
    /// `None` where the pixels are not gray, RGB or RGBA of 8 or 16 bits, interleaved, and where rows are not stored from the top left.
    fn open(file: BufReader<File>) -> Option<Tiff> {
        let mut decoder = TiffDecoder::new(file).ok()?;
        let channels = match decoder.colortype().ok()? {
            tiff::ColorType::Gray(8 | 16) => 1,
            tiff::ColorType::GrayA(8 | 16) => 2,
            tiff::ColorType::RGB(8 | 16) => 3,
            tiff::ColorType::RGBA(8 | 16) => 4,
            _ => return None,
        };
        let orientation = decoder.find_tag_unsigned::<u16>(Tag::Orientation).ok()?;
        if orientation.is_some_and(|orientation| orientation > 1) {
            return None;
        }
        let planar = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).ok()?;
        if planar.is_some_and(|planar| planar != PlanarConfiguration::Chunky.to_u16()) {
            return None;
        }
        let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).ok()?;
        if format.is_some_and(|formats| formats.iter().any(|&format| format != 1)) {
            return None;
        }
        let chunk = decoder.chunk_dimensions();
        let (width, _) = decoder.dimensions().ok()?;
        let across = match decoder.get_chunk_type() {
            ChunkType::Strip => 1,
            ChunkType::Tile => width.div_ceil(chunk.0.max(1)),
        };
        let bands = samples::Bands::of(&mut decoder);
        if bands.is_some_and(|bands| !bands.is_rgb || bands.count != u16::from(channels)) {
            // Of RGB the decoder leaves out further samples.
            return None;
        }
        let plain = plain_strips(&mut decoder).filter(|_| chunk.1 > PLAIN_ROWS);
        let held = Samples::Eight(Vec::new());
        (chunk.0 > 0 && chunk.1 > 0).then_some(Tiff {
            decoder,
            channels,
            has_band: bands.is_some(),
            chunk,
            across,
            plain,
            first: 0,
            held,
        })
    }

    /// The next `rows` rows of the image, which has `height`.
    fn rows(&mut self, width: u32, height: u32, rows: u32) -> Result<Samples, tiff::TiffError> {
        let row = width as usize * usize::from(self.channels);
        while self.held_rows(row) < rows as usize && self.first + (self.held_rows(row) as u32) < height {
            match &self.plain {
                Some(_) => self.read_plain(height, row)?,
                None => self.read_chunks(width, height, row)?,
            }
        }
        self.first += rows;
        let count = rows as usize * row;
        let short = || tiff::TiffError::from(std::io::Error::from(std::io::ErrorKind::UnexpectedEof));
        match &mut self.held {
            Samples::Eight(held) if held.len() >= count => Ok(Samples::Eight(held.drain(..count).collect())),
            Samples::Sixteen(held) if held.len() >= count => {
                Ok(Samples::Sixteen(held.drain(..count).collect()))
            }
            _ => Err(short()),
        }
    }

    fn held_rows(&self, row: usize) -> usize {
        match &self.held {
            Samples::Eight(held) => held.len() / row.max(1),
            Samples::Sixteen(held) => held.len() / row.max(1),
        }
    }

    /// Appends the next rows of a strip that is stored as it is.
    fn read_plain(&mut self, height: u32, row: usize) -> Result<(), tiff::TiffError> {
        let top = self.first + self.held_rows(row) as u32;
        let (strip, line) = (top / self.chunk.1, top % self.chunk.1);
        let rows = PLAIN_ROWS.min(self.chunk.1 - line).min(height - top) as usize;
        let strip = self.plain.as_ref().and_then(|strips| strips.get(strip as usize)).copied();
        let invalid = || std::io::Error::from(std::io::ErrorKind::InvalidData);
        let (start, length) = strip.ok_or_else(invalid)?;
        let sixteen = matches!(
            self.decoder.colortype()?,
            tiff::ColorType::Gray(16)
                | tiff::ColorType::GrayA(16)
                | tiff::ColorType::RGB(16)
                | tiff::ColorType::RGBA(16)
        );
        let row_bytes = row as u64 * if sixteen { 2 } else { 1 };
        let first = u64::from(line) * row_bytes;
        if first + rows as u64 * row_bytes > length {
            return Err(invalid().into());
        }
        let order = self.decoder.byte_order();
        let reader = self.decoder.inner();
        reader.seek(SeekFrom::Start(start.saturating_add(first)))?;
        let mut bytes = vec![0; rows * row_bytes as usize];
        reader.read_exact(&mut bytes)?;
        if sixteen {
            let value = match order {
                ByteOrder::LittleEndian => u16::from_le_bytes,
                ByteOrder::BigEndian => u16::from_be_bytes,
            };
            let values = bytes.chunks_exact(2).map(|pair| value([pair[0], pair[1]]));
            match &mut self.held {
                Samples::Sixteen(held) => held.extend(values),
                Samples::Eight(_) => self.held = Samples::Sixteen(values.collect()),
            }
        } else if let Samples::Eight(held) = &mut self.held {
            held.extend(bytes);
        }
        Ok(())
    }

    /// Appends the next row of chunks.
    fn read_chunks(&mut self, width: u32, height: u32, row: usize) -> Result<(), tiff::TiffError> {
        let top = self.first + self.held_rows(row) as u32;
        let number = top / self.chunk.1 * self.across;
        let lines = self.chunk.1.min(height - top) as usize;
        let channels = usize::from(self.channels);
        for index in 0..self.across {
            let (columns, _) = self.decoder.chunk_data_dimensions(number + index);
            let (columns, left) = (columns.min(width) as usize, (index * self.chunk.0) as usize);
            match self.decoder.read_chunk(number + index)? {
                DecodingResult::U8(values) => {
                    if !matches!(self.held, Samples::Eight(_)) {
                        self.held = Samples::Eight(Vec::new());
                    }
                    if let Samples::Eight(held) = &mut self.held {
                        place(held, &values, (index == 0, left * channels, columns * channels), (row, lines));
                    }
                }
                DecodingResult::U16(values) => {
                    if !matches!(self.held, Samples::Sixteen(_)) {
                        self.held = Samples::Sixteen(Vec::new());
                    }
                    if let Samples::Sixteen(held) = &mut self.held {
                        place(held, &values, (index == 0, left * channels, columns * channels), (row, lines));
                    }
                }
                _ => return Err(std::io::Error::from(std::io::ErrorKind::InvalidData).into()),
            }
        }
        Ok(())
    }
}

/// First byte and bytes of each strip of an image whose values are stored as they are.
fn plain_strips(decoder: &mut TiffDecoder<BufReader<File>>) -> Option<Vec<(u64, u64)>> {
    let mut is_one_of = |tag, values: &[u16]| {
        decoder.find_tag_unsigned::<u16>(tag).is_ok_and(|value| values.contains(&value.unwrap_or(1)))
    };
    // No compression, no predictor, bits in order; gray from black or RGB.
    let plain = is_one_of(Tag::Compression, &[1])
        && is_one_of(Tag::Predictor, &[1])
        && is_one_of(Tag::FillOrder, &[1])
        && is_one_of(Tag::PhotometricInterpretation, &[1, 2]);
    if !plain || decoder.get_chunk_type() != ChunkType::Strip {
        return None;
    }
    let starts = decoder.get_tag_u64_vec(Tag::StripOffsets).ok()?;
    let lengths = decoder.get_tag_u64_vec(Tag::StripByteCounts).ok()?;
    Some(starts.into_iter().zip(lengths).collect())
}

/// Puts a chunk of `columns` values a line into the last `lines` rows of what is held; the first chunk makes them.
fn place<T: Copy + Default>(
    held: &mut Vec<T>,
    values: &[T],
    (first, left, columns): (bool, usize, usize),
    (row, lines): (usize, usize),
) {
    if first {
        held.resize(held.len() + row * lines, T::default());
    }
    let start = held.len() - row * lines;
    for (line, values) in values.chunks_exact(columns.max(1)).take(lines).enumerate() {
        let from = start + line * row + left;
        if let Some(to) = held.get_mut(from..from + columns) {
            to.copy_from_slice(values);
        }
    }
}

impl Band {
    /// Its last `rows` rows, and those of the band behind it below.
    pub(crate) fn followed(self, rows: u32, further: Band) -> Result<Band, CliError> {
        let mut kept = self.last(rows);
        match (&mut kept.samples, further.samples) {
            (Samples::Eight(own), Samples::Eight(more)) => own.extend(more),
            (Samples::Sixteen(own), Samples::Sixteen(more)) => own.extend(more),
            _ => {
                let source = std::io::Error::from(std::io::ErrorKind::InvalidData);
                return Err(CliError::Rows { path: kept.path, source: Box::new(source) });
            }
        }
        Ok(Band { rows: kept.rows + further.rows, ..kept })
    }

    fn values(&self) -> usize {
        match &self.samples {
            Samples::Eight(values) => values.len(),
            Samples::Sixteen(values) => values.len(),
        }
    }

    /// Its last `rows` rows.
    fn last(mut self, rows: u32) -> Band {
        let row = self.width as usize * usize::from(self.channels);
        let first = (self.rows.saturating_sub(rows) as usize * row).min(self.values());
        match &mut self.samples {
            Samples::Eight(own) => drop(own.drain(..first)),
            Samples::Sixteen(own) => drop(own.drain(..first)),
        }
        Band { rows: self.rows.min(rows), ..self }
    }

    /// The raster of some columns.
    pub(crate) fn cut(&self, left: u32, width: u32) -> Result<Raster, CliError> {
        self.cut_rows((left, width), (0, self.rows))
    }

    /// The raster of some columns and rows, each the first and how many.
    pub(crate) fn cut_rows(
        &self,
        (left, width): (u32, u32),
        (top, height): (u32, u32),
    ) -> Result<Raster, CliError> {
        let channels = usize::from(self.channels);
        let row = self.width as usize * channels;
        let (from, count) = (left as usize * channels, width as usize * channels);
        let lines = top as usize..(top + height) as usize;
        let info =
            |depth| PixelInfo { channels: self.channels, depth, color: self.color, alpha: Alpha::Band };
        let has_band = self.alpha == Some(Alpha::Band) && info(Depth::Eight).has_extra();
        let raster = match &self.samples {
            Samples::Eight(values) => {
                let cut: Vec<u8> = lines
                    .flat_map(|line| &values[line * row + from..line * row + from + count])
                    .copied()
                    .collect();
                if has_band {
                    // Opaque alpha is dropped, but no band.
                    let data = cut.into_iter().map(|byte| f32::from(byte) / 255.0).collect();
                    Raster::new(width, height, info(Depth::Eight), data)
                } else {
                    Raster::from_u8(width, height, self.channels, self.color, &cut)
                }
            }
            Samples::Sixteen(values) => {
                let cut: Vec<u16> = lines
                    .flat_map(|line| &values[line * row + from..line * row + from + count])
                    .copied()
                    .collect();
                if has_band {
                    let data = cut.into_iter().map(|value| f32::from(value) / 65535.0).collect();
                    Raster::new(width, height, info(Depth::Sixteen), data)
                } else {
                    Raster::from_u16(width, height, self.channels, self.color, &cut)
                }
            }
        };
        let unsuitable = |source: SourceError| CliError::Source { path: self.path.clone(), source };
        let raster = raster.map_err(unsuitable)?;
        let alpha = self.alpha.unwrap_or(raster.info().alpha);
        Ok(raster.tagged(self.color, alpha))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ColorName, Options};

    fn bands_equal_the_whole(path: &Path, rows: u32) {
        let settings = Options::of_pixels(Some(ColorName::Srgb), None).resolve(path).unwrap();
        let whole = pixels::read(path, settings.color, None, 1 << 32, &mut Remarks::default()).unwrap();
        let remarks = &mut Remarks::default();
        let mut bands = Bands::open(path, &settings, 1 << 32, remarks, |_| unreachable!()).unwrap();
        let size = bands.size();
        assert_eq!(size, whole.size());
        for top in (0..size.height).step_by(rows as usize) {
            let count = rows.min(size.height - top);
            let band = bands.next(count).unwrap();
            let left = size.width / 3;
            let cut = band.cut(left, size.width - left).unwrap();
            assert_eq!(cut.info(), whole.info());
            let equal =
                |y: u32| (left..size.width).all(|x| cut.texel(x - left, y) == whole.texel(x, top + y));
            assert!((0..count).all(equal), "{} from row {top}", path.display());
        }
    }

    #[test]
    fn bands_are_what_is_read_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let value = |i: usize| (i * 31 % 251) as u8;
        let rgb: Vec<u8> = (0..75 * 53 * 3).map(value).collect();
        let deep: Vec<u16> = rgb.iter().map(|&byte| u16::from(byte) * 200 + 7).collect();
        for extension in ["png", "tif", "bmp"] {
            let path = dir.path().join(format!("a.{extension}"));
            image::save_buffer(&path, &rgb, 75, 53, image::ExtendedColorType::Rgb8).unwrap();
            bands_equal_the_whole(&path, 16);
            let gray = dir.path().join(format!("g.{extension}"));
            image::save_buffer(&gray, &rgb[..75 * 53], 75, 53, image::ExtendedColorType::L8).unwrap();
            bands_equal_the_whole(&gray, 20);
        }
        for extension in ["png", "tif"] {
            let path = dir.path().join(format!("deep.{extension}"));
            let image: image::ImageBuffer<image::Rgb<u16>, Vec<u16>> =
                image::ImageBuffer::from_raw(75, 53, deep.clone()).unwrap();
            image.save(&path).unwrap();
            bands_equal_the_whole(&path, 9);
        }
    }

    /// A TIFF file, or a BigTIFF one, of one strip that is stored as it is.
    fn in_one_strip((width, height): (u16, u16), bits: u16, (is_big, is_reversed): (bool, bool)) -> Vec<u8> {
        let bytes = |value: u64, length: usize| {
            let mut bytes = value.to_le_bytes()[..length].to_vec();
            if is_reversed {
                bytes.reverse();
            }
            bytes
        };
        let strip_bytes = u64::from(width) * u64::from(height) * u64::from(bits / 8);
        let (header, count, word, entry) = if is_big { (16, 8, 8, 20) } else { (8, 2, 4, 12) };
        let start = (header + count + 9 * entry + word) as u64;
        let tags = [
            (256, u64::from(width)),
            (257, height.into()),
            (258, bits.into()),
            (259, 1),
            (262, 1),
            (273, start),
            (277, 1),
            (278, height.into()),
            (279, strip_bytes),
        ];
        let mut file = if is_reversed { b"MM".to_vec() } else { b"II".to_vec() };
        file.extend(bytes(if is_big { 43 } else { 42 }, 2));
        if is_big {
            file.extend([bytes(8, 2), bytes(0, 2)].concat());
        }
        file.extend(bytes(header as u64, word));
        file.extend(bytes(tags.len() as u64, count));
        for (tag, value) in tags {
            file.extend([bytes(tag, 2), bytes(4, 2), bytes(1, word), bytes(value, 4)].concat());
            file.extend(&vec![0; word - 4]);
        }
        file.extend(vec![0; word]);
        assert_eq!(file.len() as u64, start);
        let value = |i: u64| bytes(i * 31 % if bits == 8 { 251 } else { 65_521 }, usize::from(bits / 8));
        file.extend((0..strip_bytes / u64::from(bits / 8)).flat_map(value));
        file
    }

    #[test]
    fn long_strips_are_read_in_parts() {
        let dir = tempfile::tempdir().unwrap();
        for (is_big, is_reversed) in [(false, false), (false, true), (true, false), (true, true)] {
            for bits in [8, 16] {
                let path = dir.path().join("a.tif");
                std::fs::write(&path, in_one_strip((75, 253), bits, (is_big, is_reversed))).unwrap();
                bands_equal_the_whole(&path, 40);
                let Some(Source::Tiff(mut tiff)) =
                    streamed(&path, &super::super::head_of(&path).unwrap(), ColorSpace::Srgb)
                else {
                    panic!("not read in bands");
                };
                tiff.rows(75, 253, 10).unwrap();
                assert_eq!(tiff.held_rows(75), PLAIN_ROWS as usize - 10);
                tiff.plain.as_mut().unwrap()[0].1 -= 1;
                assert!(tiff.rows(75, 253, 243).is_err(), "the strip is too short");
            }
        }
    }

    #[test]
    fn strips_and_tiles_of_geographic_files_are_read() {
        let Some(data) = texfold_testkit::data_dir("bands of geographic TIFF files") else { return };
        for name in ["naip_m_4709963_20200831.tif", "landsat7_bahamas_RGB.byte.tif"] {
            bands_equal_the_whole(&data.join("remote").join(name), 100);
        }
    }
}

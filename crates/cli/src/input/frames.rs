//! Files of several images: animated GIF, WebP and PNG, and TIFF of several pages.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use image::codecs::{gif::GifDecoder, png::PngDecoder, webp::WebPDecoder};
use image::{AnimationDecoder, DynamicImage, Frames, ImageDecoder, ImageError, Limits};
use tiff::decoder::Decoder as TiffDecoder;
use tiff::tags::{PhotometricInterpretation, Tag};

use super::remarks::Remarks;
use crate::files;

/// First bytes of a TIFF file that say where its first directory is, in its longest form.
const TIFF_HEAD: usize = 16;
/// Bits of NewSubfileType of images that are no pages: smaller copies and masks.
const NO_PAGE: u32 = 1 | 4;

/// A file, or a page of it.
pub(super) trait Source: BufRead + Seek + Send {}
impl<S: BufRead + Seek + Send> Source for S {}

/// A form of files that may hold several images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Gif,
    WebP,
    Png,
    Tiff,
}

impl Form {
    fn of(head: &[u8]) -> Option<Form> {
        let starts = |magic: &[u8]| head.starts_with(magic);
        if starts(b"GIF8") {
            Some(Form::Gif)
        } else if starts(b"RIFF") && head.get(8..12) == Some(b"WEBP") {
            Some(Form::WebP)
        } else if starts(b"\x89PNG") {
            Some(Form::Png)
        } else {
            is_tiff(head).then_some(Form::Tiff)
        }
    }
}

pub(super) fn is_tiff(head: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| head.starts_with(*magic))
}

/// Number of images in a file. What cannot be read counts as one: its decoder names the fault.
pub(crate) fn count(path: &Path) -> usize {
    let found = || {
        let file = || Some(BufReader::new(files::open(path).ok()?));
        Some(match Form::of(&super::head_of(path).ok()?)? {
            Form::Gif => gif_frames(file()?),
            Form::WebP => webp_frames(file()?),
            Form::Png => {
                let reader = png::Decoder::new(file()?).read_info().ok()?;
                reader.info().animation_control().map_or(1, |control| control.num_frames as usize)
            }
            Form::Tiff => pages(path).len(),
        })
    };
    found().unwrap_or(1).max(1)
}

/// Warns of what is left out where the first image alone is taken.
pub(super) fn warn_of_rest(path: &Path, head: &[u8], remarks: &mut Remarks) {
    let count = count(path);
    let (what, taken) = match Form::of(head) {
        Some(Form::Tiff) => ("pages", "`--as set` takes all pages of one file"),
        _ => ("frames", "`--as sequence` takes all frames of one file, or a folder of frames"),
    };
    if count > 1 {
        remarks.warn(path, format!("the first of {count} {what} is taken; {taken}"));
    }
}

fn gif_frames(mut file: BufReader<File>) -> usize {
    let mut frames = 0;
    // A file that is cut has the frames up to there.
    let mut walk = || -> io::Result<()> {
        let table = |flags: u8| if flags & 0x80 == 0 { 0 } else { 3i64 << ((flags & 7) + 1) };
        let mut head = [0; 13];
        file.read_exact(&mut head)?;
        file.seek_relative(table(head[10]))?;
        loop {
            match byte(&mut file)? {
                0x2c => {
                    let mut place = [0; 9];
                    file.read_exact(&mut place)?;
                    file.seek_relative(table(place[8]))?;
                    frames += 1;
                }
                0x21 => {}
                _ => return Ok(()),
            }
            // The size of codes of an image, or the kind of an extension, before blocks.
            byte(&mut file)?;
            loop {
                match byte(&mut file)? {
                    0 => break,
                    length => file.seek_relative(i64::from(length))?,
                }
            }
        }
    };
    let _ = walk();
    frames
}

fn byte(file: &mut BufReader<File>) -> io::Result<u8> {
    let mut byte = [0];
    file.read_exact(&mut byte)?;
    Ok(byte[0])
}

fn webp_frames(mut file: BufReader<File>) -> usize {
    let mut frames = 0;
    let mut walk = || -> io::Result<()> {
        file.seek_relative(12)?;
        loop {
            let mut chunk = [0; 8];
            file.read_exact(&mut chunk)?;
            frames += usize::from(chunk.starts_with(b"ANMF"));
            let length = u32::from_le_bytes([chunk[4], chunk[5], chunk[6], chunk[7]]);
            file.seek_relative(i64::from(length) + i64::from(length & 1))?;
        }
    };
    let _ = walk();
    frames
}

/// Byte offsets of the directories of a TIFF file's pages, the first image's first.
pub(super) fn pages(path: &Path) -> Vec<u64> {
    let mut pages = Vec::new();
    let Some(file) = files::open(path).ok() else { return pages };
    let Some(mut decoder) = TiffDecoder::new(BufReader::new(file)).ok() else { return pages };
    loop {
        let kind = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).ok().flatten().unwrap_or(0);
        if let Some(at) = decoder.ifd_pointer().filter(|_| pages.is_empty() || kind & NO_PAGE == 0) {
            pages.push(at.0);
        }
        if !decoder.more_images() || decoder.next_image().is_err() {
            return pages;
        }
    }
}

/// The frames of an animation; `None` where a file holds none.
pub(super) fn of_animation(path: &Path, limits: Limits) -> Result<Option<Vec<DynamicImage>>, ImageError> {
    let Ok(head) = super::head_of(path) else { return Ok(None) };
    let file = || Ok::<_, ImageError>(BufReader::new(files::open(path)?));
    let frames: Frames<'_> = match Form::of(&head) {
        Some(Form::Gif) => {
            let mut decoder = GifDecoder::new(file()?)?;
            decoder.set_limits(limits.clone())?;
            decoder.into_frames()
        }
        Some(Form::WebP) => {
            let mut decoder = WebPDecoder::new(file()?)?;
            decoder.set_limits(limits.clone())?;
            if !decoder.has_animation() {
                return Ok(None);
            }
            decoder.into_frames()
        }
        Some(Form::Png) => {
            let decoder = PngDecoder::with_limits(file()?, limits.clone())?;
            if !decoder.is_apng()? {
                return Ok(None);
            }
            decoder.apng()?.into_frames()
        }
        _ => return Ok(None),
    };
    let mut left = limits;
    let taken = frames.map(|frame| {
        let image = DynamicImage::ImageRgba8(frame?.into_buffer());
        left.reserve(image.as_bytes().len() as u64)?;
        Ok(image)
    });
    taken.collect::<Result<Vec<_>, ImageError>>().map(Some)
}

/// Opens a file, as if the page whose directory is there were its first.
pub(super) fn open(path: &Path, page: Option<u64>) -> io::Result<Box<dyn Source>> {
    match page {
        None => Ok(Box::new(BufReader::new(files::open(path)?))),
        Some(_) => open_patched(path, page, None),
    }
}

/// As [`open`], as if the texels of the directory at byte `directory` were gray with bands: of RGB, the decoder leaves out what it
/// does not know the meaning of.
pub(super) fn open_as_gray(path: &Path, page: Option<u64>, directory: u64) -> io::Result<Box<dyn Source>> {
    open_patched(path, page, Some(directory))
}

fn open_patched(path: &Path, page: Option<u64>, gray: Option<u64>) -> io::Result<Box<dyn Source>> {
    let mut file = files::open(path)?;
    let mut head = Vec::new();
    (&mut file).take(TIFF_HEAD as u64).read_to_end(&mut head)?;
    let form = TiffForm { is_little: head.starts_with(b"I"), is_big: head.contains(&b'+') };
    let mut patches = Vec::new();
    if let Some(at) = page {
        let (place, length) = if form.is_big { (8, 8) } else { (4, 4) };
        patches.push((place, form.bytes(at, length)));
    }
    if let Some(directory) = gray {
        let place = form.value_of(&mut file, directory, Tag::PhotometricInterpretation.to_u16())?;
        patches.push((place, form.bytes(PhotometricInterpretation::BlackIsZero.to_u16().into(), 2)));
    }
    Ok(Box::new(BufReader::new(Patched { file, patches, at: 0 })))
}

/// Byte order and width of numbers.
#[derive(Clone, Copy)]
struct TiffForm {
    is_little: bool,
    is_big: bool,
}

impl TiffForm {
    fn bytes(self, value: u64, length: usize) -> Vec<u8> {
        if self.is_little {
            value.to_le_bytes()[..length].to_vec()
        } else {
            value.to_be_bytes()[8 - length..].to_vec()
        }
    }

    fn number(self, bytes: &[u8]) -> u64 {
        let digits = |sum, &byte: &u8| sum << 8 | u64::from(byte);
        if self.is_little { bytes.iter().rev().fold(0, digits) } else { bytes.iter().fold(0, digits) }
    }

    /// Byte offset of a tag's value in a directory that holds it in its entry.
    fn value_of(self, file: &mut File, directory: u64, tag: u16) -> io::Result<u64> {
        let (counter, entry, value) = if self.is_big { (8, 20, 12) } else { (2, 12, 8) };
        let mut count = [0; 8];
        file.seek(SeekFrom::Start(directory))?;
        file.read_exact(&mut count[..counter])?;
        let mut name = [0; 2];
        for index in 0..self.number(&count[..counter]).min(u64::from(u16::MAX)) {
            let at = directory.saturating_add(counter as u64 + index * entry);
            file.seek(SeekFrom::Start(at))?;
            file.read_exact(&mut name)?;
            if self.number(&name) == u64::from(tag) {
                return Ok(at + value);
            }
        }
        Err(io::Error::from(io::ErrorKind::InvalidData))
    }
}

/// A file with other bytes in places, none of which reaches into another.
struct Patched {
    file: File,
    patches: Vec<(u64, Vec<u8>)>,
    at: u64,
}

impl Read for Patched {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let within = |(start, bytes): &(u64, Vec<u8>)| {
            let from = usize::try_from(self.at.checked_sub(*start)?).ok()?;
            bytes.get(from..).filter(|rest| !rest.is_empty()).map(<[u8]>::to_vec)
        };
        let count = if let Some(rest) = self.patches.iter().find_map(within) {
            (&rest[..]).read(buffer)?
        } else {
            let next = self.patches.iter().filter_map(|(start, _)| start.checked_sub(self.at)).min();
            let most =
                next.and_then(|next| usize::try_from(next).ok()).unwrap_or(usize::MAX).min(buffer.len());
            self.file.seek(SeekFrom::Start(self.at))?;
            self.file.read(&mut buffer[..most])?
        };
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Patched {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = match to {
            SeekFrom::Current(by) => {
                self.at.checked_add_signed(by).ok_or(io::Error::from(io::ErrorKind::InvalidInput))?
            }
            to => self.file.seek(to)?,
        };
        Ok(self.at)
    }
}

//! Files of several images: animated GIF, WebP and PNG, and TIFF of several pages.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use image::codecs::{gif::GifDecoder, png::PngDecoder, webp::WebPDecoder};
use image::{AnimationDecoder, DynamicImage, Frames, ImageDecoder, ImageError, Limits};
use tiff::decoder::Decoder as TiffDecoder;
use tiff::tags::Tag;

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
    let mut file = files::open(path)?;
    let Some(at) = page else { return Ok(Box::new(BufReader::new(file))) };
    let mut head = Vec::new();
    (&mut file).take(TIFF_HEAD as u64).read_to_end(&mut head)?;
    head.resize(TIFF_HEAD, 0);
    let (little, big) = (head[0] == b'I', head.contains(&b'+'));
    let place = if big { 8..16 } else { 4..8 };
    let bytes = if little { at.to_le_bytes() } else { at.to_be_bytes() };
    let used = if big || little { 0 } else { 4 };
    let length = place.len();
    head[place].copy_from_slice(&bytes[used..used + length]);
    if !big {
        // What follows belongs to the file.
        head.truncate(8);
    }
    Ok(Box::new(BufReader::new(Page { file, head, at: 0 })))
}

/// A TIFF file with another head.
struct Page {
    file: File,
    head: Vec<u8>,
    at: u64,
}

impl Read for Page {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let own = usize::try_from(self.at).ok().and_then(|at| self.head.get(at..)).unwrap_or_default();
        let count = if own.is_empty() {
            self.file.seek(SeekFrom::Start(self.at))?;
            self.file.read(buffer)?
        } else {
            (&own[..]).read(buffer)?
        };
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Page {
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

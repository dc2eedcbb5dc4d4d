//! How an image's channels are laid into the planes that a GPU samples.

use std::borrow::Cow;

use glam::Vec4;
use texfold_core::container::Reader;
use texfold_core::image::PixelInfo;
use texfold_core::{LoadError, Plane, PlaneFormat, Texel};

use crate::decode_block;

/// How content is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Content {
    /// Plain bytes, one a channel: exact for 8-bit sources.
    Raw,
    /// RGB in 4 bits a texel; alpha as 1 bit.
    Bc1,
    /// RGB and smooth alpha in 8 bits a texel.
    Bc3,
    /// One channel in 4 bits a texel.
    Bc4,
    /// Two channels in 8 bits a texel: gray and alpha, or a normal's x and y.
    Bc5,
    /// RGB and alpha in 8 bits a texel, close to the source.
    Bc7,
}

impl Content {
    /// All kinds, in the order of their numbers in files.
    pub const ALL: [Content; 6] =
        [Content::Raw, Content::Bc1, Content::Bc3, Content::Bc4, Content::Bc5, Content::Bc7];

    /// Texels a side of the smallest part that can be copied whole: a block, also of plain bytes.
    pub const CELL_SIDE: u32 = 4;

    /// Name on the command line and in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Content::Raw => "raw",
            Content::Bc1 => "bc1",
            Content::Bc3 => "bc3",
            Content::Bc4 => "bc4",
            Content::Bc5 => "bc5",
            Content::Bc7 => "bc7",
        }
    }

    /// Its number in files.
    #[must_use]
    pub fn number(self) -> u8 {
        Content::ALL.iter().position(|&content| content == self).unwrap_or(0) as u8
    }

    /// The content of that number in a file.
    ///
    /// # Errors
    /// [`LoadError`] where there is none.
    pub fn read(reader: &mut Reader<'_>) -> Result<Content, LoadError> {
        let number = reader.u8()?;
        Content::ALL.get(usize::from(number)).copied().ok_or(reader.corrupt("unknown content"))
    }

    /// Bits of a cell, of all planes together.
    #[must_use]
    pub fn cell_bits(self, pixel: PixelInfo) -> u32 {
        let side = Content::CELL_SIDE;
        self.formats(pixel).0.iter().map(|format| 8 * format.bytes(side, side) as u32).sum()
    }
}

/// Formats among which a goal chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Family {
    /// What desktop GPUs draw, and plain bytes.
    #[default]
    Bc,
    /// A small base of the formats that desktop GPUs draw, with a residual plane, in codecs that store content so; others take
    /// what desktop GPUs draw.
    ErrorMap,
}

/// How a texel's channels come out of the planes; the numbers are those of
/// [`texfold_core::sample::texfold_swizzle`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Swizzle(pub u32);

/// An image stored as one or two planes.
#[derive(Debug, Clone, PartialEq)]
pub struct ContentPlanes {
    pub(crate) content: Content,
    pub(crate) swizzle: Swizzle,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) planes: Vec<(PlaneFormat, Vec<u8>)>,
}

impl Content {
    /// Whether the format can hold such pixels without losing a channel.
    #[must_use]
    pub fn fits(self, pixel: PixelInfo) -> bool {
        match self {
            Content::Raw | Content::Bc7 | Content::Bc1 => true,
            Content::Bc3 => pixel.has_extra(),
            Content::Bc4 => pixel.channels == 1,
            Content::Bc5 => {
                pixel.channels == 2
                    || (pixel.channels == 3 && pixel.color == texfold_core::image::ColorSpace::Normal)
            }
        }
    }

    /// The planes that hold such pixels, and how a texel is read from them.
    #[must_use]
    pub fn formats(self, pixel: PixelInfo) -> (Vec<PlaneFormat>, Swizzle) {
        use PlaneFormat as P;
        use texfold_core::sample as s;
        let alpha = if pixel.has_extra() { s::TEXFOLD_RGBA } else { s::TEXFOLD_RGB };
        let (formats, swizzle) = match (self, pixel.channels) {
            (Content::Raw, 1) => (vec![P::R8Unorm], s::TEXFOLD_GRAY),
            (Content::Raw, 2) => (vec![P::Rg8Unorm], s::TEXFOLD_GRAY_ALPHA),
            (Content::Raw, 3) => (vec![P::Rg8Unorm, P::R8Unorm], s::TEXFOLD_SPLIT),
            (Content::Raw, _) => (vec![P::Rgba8Unorm], s::TEXFOLD_RGBA),
            (Content::Bc1, _) => (vec![P::Bc1], alpha),
            (Content::Bc3, _) => (vec![P::Bc3], s::TEXFOLD_RGBA),
            (Content::Bc4, _) => (vec![P::Bc4], s::TEXFOLD_GRAY),
            (Content::Bc5, 2) => (vec![P::Bc5], s::TEXFOLD_GRAY_ALPHA),
            (Content::Bc5, _) => (vec![P::Bc5], s::TEXFOLD_NORMAL),
            (Content::Bc7, _) => (vec![P::Bc7], alpha),
        };
        (formats, Swizzle(swizzle))
    }

    /// Bits a texel of all planes together.
    #[must_use]
    pub fn bits_per_texel(self, pixel: PixelInfo) -> f64 {
        f64::from(self.cell_bits(pixel)) / f64::from(Content::CELL_SIDE.pow(2))
    }
}

impl ContentPlanes {
    /// From planes that exist already; `None` where a plane has another length than its size asks for.
    #[must_use]
    pub fn from_planes(
        content: Content,
        pixel: PixelInfo,
        (width, height): (u32, u32),
        planes: Vec<Vec<u8>>,
    ) -> Option<Self> {
        let (formats, swizzle) = content.formats(pixel);
        let fits =
            |(format, plane): (&PlaneFormat, &Vec<u8>)| plane.len() as u64 == format.bytes(width, height);
        if formats.len() != planes.len() || !formats.iter().zip(&planes).all(fits) {
            return None;
        }
        Some(ContentPlanes {
            content,
            swizzle,
            width,
            height,
            planes: formats.into_iter().zip(planes).collect(),
        })
    }

    /// How it is stored.
    #[must_use]
    pub fn content(&self) -> Content {
        self.content
    }

    /// How a texel is read from the planes.
    #[must_use]
    pub fn swizzle(&self) -> Swizzle {
        self.swizzle
    }

    /// Columns and rows in texels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Format and bytes of each plane.
    #[must_use]
    pub fn planes(&self) -> &[(PlaneFormat, Vec<u8>)] {
        &self.planes
    }

    /// The planes as a GPU takes them, for the part of that name.
    pub fn gpu_planes(&self, part: &'static str) -> impl Iterator<Item = Plane<'_>> {
        self.planes.iter().map(move |(format, bytes)| Plane {
            part,
            format: *format,
            width: self.width,
            height: self.height,
            levels: 1,
            data: Cow::Borrowed(bytes),
        })
    }

    /// Copies cells ([`Content::CELL_SIDE`]) from planes of the same content, each from a column and row to a column and row in
    /// cells; those outside of either are left out.
    pub fn copy_cells(
        &mut self,
        from: &ContentPlanes,
        cells: impl IntoIterator<Item = ((u32, u32), (u32, u32))> + Clone,
    ) {
        if from.content == self.content {
            self.copy(from, Content::CELL_SIDE, cells);
        }
    }

    /// As [`ContentPlanes::copy_cells`], texels of raw content, each from a column and row to a column and row.
    pub fn copy_texels(
        &mut self,
        from: &ContentPlanes,
        texels: impl IntoIterator<Item = ((u32, u32), (u32, u32))> + Clone,
    ) {
        if (from.content, self.content) == (Content::Raw, Content::Raw) {
            self.copy(from, 1, texels);
        }
    }

    /// Copies squares of `side` texels, a multiple of a block's side.
    fn copy(
        &mut self,
        from: &ContentPlanes,
        side: u32,
        cells: impl IntoIterator<Item = ((u32, u32), (u32, u32))> + Clone,
    ) {
        for ((kind, bytes), (_, source)) in self.planes.iter_mut().zip(&from.planes) {
            let (block, length) = (kind.block_side(), kind.block_bytes() as usize);
            let (lines, run) = (side / block, (side / block) as usize * length);
            let row = |width: u32| width.div_ceil(block) as usize * length;
            let start = |(x, y): (u32, u32), line: u32, width: u32| {
                (y * lines + line) as usize * row(width) + x as usize * run
            };
            for (old, new) in cells.clone() {
                for line in 0..lines {
                    let (old, new) = (start(old, line, from.width), start(new, line, self.width));
                    if let (Some(to), Some(from)) =
                        (bytes.get_mut(new..new + run), source.get(old..old + run))
                    {
                        to.copy_from_slice(from);
                    }
                }
            }
        }
    }

    /// Changes the bytes of each plane in place; told its format and its columns in texels.
    pub fn edit(&mut self, mut edit: impl FnMut(PlaneFormat, u32, &mut [u8])) {
        for (format, bytes) in &mut self.planes {
            edit(*format, self.width, bytes);
        }
    }

    /// All texels, row by row.
    #[must_use]
    pub fn decode(&self) -> Vec<Texel> {
        let (width, height) = (self.width as usize, self.height as usize);
        let expanded: Vec<Vec<Vec4>> =
            self.planes.iter().map(|(format, bytes)| decode_plane(*format, width, height, bytes)).collect();
        let second = expanded.last();
        let first = expanded.first().map(Vec::as_slice).unwrap_or_default();
        let texel = |(index, &a): (usize, &Vec4)| {
            let b = second.map_or(Vec4::ZERO, |plane| plane[index]);
            texfold_core::sample::texfold_swizzle(a, b, self.swizzle.0)
        };
        first.iter().enumerate().map(texel).collect()
    }
}

/// All texels of a plane, row by row; missing channels are 0, missing alpha is 1.
pub(crate) fn decode_plane(format: PlaneFormat, width: usize, height: usize, bytes: &[u8]) -> Vec<Vec4> {
    let mut texels = vec![Vec4::W; width * height];
    let side = format.block_side() as usize;
    let columns = width.div_ceil(side);
    for (index, block) in bytes.chunks_exact(format.block_bytes() as usize).enumerate() {
        let (left, top) = (index % columns * side, index / columns * side);
        let decoded = decode_block(format, block);
        for y in top..(top + side).min(height) {
            for x in left..(left + side).min(width) {
                texels[y * width + x] = decoded[(y - top) * side + x - left];
            }
        }
    }
    texels
}

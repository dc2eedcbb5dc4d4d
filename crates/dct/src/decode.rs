//! Textures as they are read: any rectangle, by superblock.

use std::ops::Range;

use texfold_core::{Cached, ImageSize, Rect, RegionError, parallel};

use crate::Bytes;
use crate::channels::{DctSample, write_channels, write_rgba};
use crate::context::Around;
use crate::deblock::deblock;
use crate::form::{DctForm, PlaneShape, Steps};
use crate::index::Index;
use crate::intra::{self, add_predictions, put};
use crate::plane::{Patch, PlaneDecoder};
use crate::scan::COEFFICIENTS;
use crate::tables::{StoredStops, Table};

/// A texture in blocks of variable length.
#[derive(Debug, Clone, PartialEq)]
pub struct DctTexture {
    pub(super) form: DctForm,
    /// Stopping probabilities of all tables, as stored.
    pub(super) stops: StoredStops,
    pub(super) index: Index,
    /// Bytes of all superblocks that are loaded: of the bases, or of the image, too.
    pub(super) bytes: Bytes,
    /// Bytes of all superblocks of the whole texture.
    pub(super) stream_bytes: u32,
    tools: Cached<Box<Tools>>,
    /// The means of the image's blocks.
    base: Cached<Option<Patch>>,
}

/// What superblocks are decoded with.
#[derive(Debug, Clone)]
pub(super) struct Tools {
    pub(super) tables: Vec<Table>,
    /// Steps of each plane.
    pub(super) steps: Vec<Steps>,
    pub(super) ranks: Vec<u8>,
    planes: Vec<PlaneShape>,
}

/// Writes texels of a row of a superblock from a place in it on, from samples of its axes and its side.
trait Write<T>: Fn(&DctForm, &[i32], usize, (usize, usize), &mut [T]) + Copy + Send + Sync {}

impl<T, F: Fn(&DctForm, &[i32], usize, (usize, usize), &mut [T]) + Copy + Send + Sync> Write<T> for F {}

/// Columns and rows of superblocks.
type Superblocks = (Range<usize>, Range<usize>);

/// A rectangle, and the superblocks that it needs.
#[derive(Debug, Clone)]
struct Region {
    rect: Rect,
    columns: Range<usize>,
    rows: Range<usize>,
}

impl DctTexture {
    /// The texture of such parts. `bytes` has as many as are loaded of `stream_bytes`.
    pub(super) fn new(
        form: DctForm,
        stops: StoredStops,
        index: Index,
        bytes: Bytes,
        stream_bytes: u32,
    ) -> Self {
        let (tools, base) = (Cached::default(), Cached::default());
        DctTexture { form, stops, index, bytes, stream_bytes, tools, base }
    }

    /// The same texture with other superblocks loaded: the bases' at least.
    pub(super) fn with_bytes(self, bytes: Bytes) -> Self {
        DctTexture { bytes, ..self }
    }

    /// The same texture, deblocked at another strength.
    #[cfg(feature = "encode")]
    pub(super) fn with_deblocking(mut self, strength: u8) -> Self {
        self.form.deblocking = strength;
        self
    }

    /// A superblock of the image before it is deblocked, as [`DctTexture::read_image`] gives it.
    #[cfg(feature = "encode")]
    pub(super) fn image_superblock(&self, place: (usize, usize)) -> Vec<i32> {
        let base = self.base.get_or_make(|| self.whole_base()).as_ref();
        let side = 1usize << self.form.superblock_log2;
        let mut samples = vec![0; self.tools().ranks.len() * side * side];
        self.read_image(place, base, &mut Around::default(), &mut samples);
        samples
    }

    /// Header.
    #[must_use]
    pub fn form(&self) -> &DctForm {
        &self.form
    }

    /// Whether all superblocks are loaded; without those of the image it is decoded from its bases.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.bytes.len() >= self.stream_bytes as usize
    }

    /// Whether the image has superblocks of its own, loaded or not.
    #[must_use]
    pub fn has_detail(&self) -> bool {
        self.base_length() < self.stream_bytes as usize
    }

    /// Columns and rows of the image's superblocks, and the bytes of each, row by row.
    #[must_use]
    pub fn superblock_bytes(&self) -> ((u32, u32), Vec<u32>) {
        let planes = self.form.planes();
        let first: usize = planes[1..].iter().map(PlaneShape::count).sum();
        let (columns, rows) = planes[0].superblocks;
        let length = |number: usize| self.index.of(&self.bytes, number).len() as u32;
        ((columns as u32, rows as u32), (first..first + columns * rows).map(length).collect())
    }

    /// Texels along a superblock's side.
    #[must_use]
    pub fn superblock_side(&self) -> u32 {
        1 << self.form.superblock_log2
    }

    /// The texture as it is before the image's own superblocks are loaded.
    #[must_use]
    pub fn base_alone(&self) -> DctTexture {
        let bytes = self.bytes[..self.base_length().min(self.bytes.len())].to_vec();
        DctTexture { bytes, ..self.clone() }
    }

    /// Bytes of the superblocks of all bases.
    pub(super) fn base_length(&self) -> usize {
        let planes = self.form.planes();
        let bases = planes[1..].iter().map(PlaneShape::count).sum();
        (self.index.start(bases) as usize).min(self.stream_bytes as usize)
    }

    /// Decodes a rectangle of the image; `out` holds its texels row by row, their channels side by side. `rect.image` and
    /// `rect.level` are 0.
    ///
    /// # Errors
    /// [`RegionError`] where the rectangle leaves the image or `out` has another length.
    pub fn decode<S: DctSample>(&self, rect: Rect, out: &mut [S]) -> Result<(), RegionError> {
        self.decode_texels(rect, self.form.channels(), out, write_channels)
    }

    /// The same as RGBA of 8 bits: gray in all three colours, 255 where there is no alpha. The texture has at most four channels of 8
    /// bits.
    pub(super) fn decode_rgba8(&self, rect: Rect, out: &mut [[u8; 4]]) -> Result<(), RegionError> {
        self.decode_texels(rect, 1, out, write_rgba)
    }

    /// Decodes a rectangle to so many items a texel, as `write` makes them of samples of axes.
    fn decode_texels<T: Send>(
        &self,
        rect: Rect,
        items: usize,
        out: &mut [T],
        write: impl Write<T>,
    ) -> Result<(), RegionError> {
        self.check(rect, out.len(), items)?;
        if rect.width == 0 || rect.height == 0 {
            return Ok(());
        }
        let side = 1usize << self.form.superblock_log2;
        let cover = |first: u32, count: u32| first as usize / side..((first + count) as usize).div_ceil(side);
        let (columns, rows) = (cover(rect.x, rect.width), cover(rect.y, rect.height));
        let region = &Region { rect, columns, rows };
        let base = self.base.get_or_make(|| self.whole_base()).as_ref();
        let line = rect.width as usize * items;
        let skipped = rect.y as usize % side;
        // The first row of superblocks may be cut; the rows that follow begin with whole ones.
        let (head, tail) =
            out.split_at_mut(if skipped == 0 { 0 } else { ((side - skipped) * line).min(out.len()) });
        if !head.is_empty() {
            self.decode_row(region, region.rows.start, base, items, head, write);
        }
        let first = region.rows.start + usize::from(skipped != 0);
        parallel::for_each_row(tail, side * line, |row, out| {
            self.decode_row(region, first + row, base, items, out, write);
        });
        Ok(())
    }

    fn check(&self, rect: Rect, length: usize, items: usize) -> Result<(), RegionError> {
        let size = self.form.size;
        let inside =
            |first: u32, count: u32, all: u32| first.checked_add(count).is_some_and(|end| end <= all);
        if rect.image != 0 {
            return Err(RegionError::NoSuchImage { image: rect.image, images: 1 });
        }
        if rect.level != 0 {
            return Err(RegionError::NoSuchLevel { level: rect.level, levels: 1 });
        }
        if !inside(rect.x, rect.width, size.width) || !inside(rect.y, rect.height, size.height) {
            return Err(RegionError::Outside { width: size.width, height: size.height });
        }
        let needed = rect.width as usize * rect.height as usize * items;
        if length != needed {
            return Err(RegionError::OutputLength { found: length, needed });
        }
        Ok(())
    }

    /// Decodes what a row of superblocks has of a region: its texels, row by row.
    fn decode_row<T>(
        &self,
        region: &Region,
        row: usize,
        base: Option<&Patch>,
        items: usize,
        out: &mut [T],
        write: impl Write<T>,
    ) {
        let Region { rect, columns, .. } = region;
        let side = 1usize << self.form.superblock_log2;
        let (left, right) = (rect.x as usize, (rect.x + rect.width) as usize);
        let top = (row * side).max(rect.y as usize);
        let line = rect.width as usize * items;
        let mut samples = vec![0i32; self.tools().ranks.len() * side * side];
        let mut around = Around::default();
        let limit = self.form.deblocking_limit(self.form.deblocking);
        for column in columns.clone() {
            self.read_image((column, row), base, &mut around, &mut samples);
            let blocks = self.tools().planes[0].blocks_in(column, row);
            deblock(&mut samples, side, blocks, &self.tools().ranks, limit);
            let (start, end) = ((column * side).max(left), ((column + 1) * side).min(right));
            for (number, out) in out.chunks_exact_mut(line).enumerate() {
                let inside = top + number - row * side;
                let texels = &mut out[(start - left) * items..(end - left) * items];
                write(&self.form, &samples, side, (start - column * side, inside), texels);
            }
        }
    }

    /// Reads a superblock of the image before it is deblocked: for each axis as many samples a side as a superblock has, of which
    /// those of blocks of the image are set.
    fn read_image(
        &self,
        (column, row): (usize, usize),
        base: Option<&Patch>,
        around: &mut Around,
        samples: &mut [i32],
    ) {
        let side = 1usize << self.form.superblock_log2;
        self.superblock(0, (column, row), base, around, |axis, (x, y), block| {
            let inside = (x - column * side / 8, y - row * side / 8);
            put(&mut samples[axis * side * side..], side, inside, block);
        });
        if self.form.intra.is_some() {
            let (columns, _) = self.tools().planes[0].blocks_in(column, row);
            add_predictions(samples, side, columns, around.modes.all());
        }
    }

    /// The image's means, or the image itself where it is a single block: columns and rows, samples texel by texel.
    pub(super) fn base_samples(&self) -> (ImageSize, Vec<u16>) {
        let channels = self.form.channels();
        let Some(base) = self.base.get_or_make(|| self.whole_base()) else {
            let ImageSize { width, height } = self.form.size;
            let mut out = vec![0; width as usize * height as usize * channels];
            // The whole image lies inside of itself.
            let _ = self.decode(Rect { image: 0, level: 0, x: 0, y: 0, width, height }, &mut out);
            return (self.form.size, out);
        };
        let (width, height) = base.size;
        let mut out = vec![0; width * height * channels];
        for (y, line) in out.chunks_exact_mut(width * channels).enumerate() {
            for (x, texel) in line.chunks_exact_mut(channels).enumerate() {
                let axes: Vec<i32> =
                    (0..channels).map(|axis| base.samples[(axis * height + y) * width + x]).collect();
                write_channels(&self.form, &axes, 1, (0, 0), texel);
            }
        }
        (ImageSize { width: width as u32, height: height as u32 }, out)
    }

    /// Reads a superblock of a plane.
    fn superblock(
        &self,
        plane: usize,
        place: (usize, usize),
        base: Option<&Patch>,
        around: &mut Around,
        put: impl FnMut(usize, (usize, usize), &[i32; COEFFICIENTS]),
    ) {
        let tools = self.tools();
        let shape = tools.planes[plane];
        // The coarsest plane comes first.
        let before: usize = tools.planes[plane + 1..].iter().map(PlaneShape::count).sum();
        let number = before + place.1 * shape.superblocks.0 + place.0;
        let decoder = PlaneDecoder {
            shape,
            is_base: plane > 0,
            tables: &tools.tables,
            steps: &tools.steps[plane],
            ranks: &tools.ranks,
            has_modes: plane == 0 && self.form.intra.is_some(),
            base,
        };
        decoder.superblock(place, self.index.of(&self.bytes, number), around, put);
    }

    /// What superblocks are decoded with, made when it is first needed.
    fn tools(&self) -> &Tools {
        self.tools.get_or_make(|| Box::new(self.make_tools()))
    }

    /// The tables of all symbols; `None` where no writer writes such bytes.
    fn tables(&self) -> Option<Vec<Table>> {
        let mut tables = self.stops.tables()?;
        tables.extend(self.form.intra.into_iter().flat_map(intra::tables));
        Some(tables)
    }

    /// What superblocks are decoded with.
    pub(super) fn make_tools(&self) -> Tools {
        let planes = self.form.planes();
        let steps = |plane: usize| Steps::new(&self.form.quantiser, plane, self.form.fraction());
        Tools {
            // Readers have checked what is stored.
            tables: self.tables().unwrap_or_default(),
            steps: (0..planes.len()).map(steps).collect(),
            ranks: self.form.ranks(),
            planes,
        }
    }

    /// The means of all blocks of the image.
    fn whole_base(&self) -> Option<Patch> {
        let (columns, rows) = self.tools().planes[0].superblocks;
        self.base_of(0, &(0..columns, 0..rows))
    }

    /// The means that superblocks of a plane need; `None` where it is a single block.
    fn base_of(&self, plane: usize, (columns, rows): &Superblocks) -> Option<Patch> {
        let planes = &self.tools().planes;
        let base = planes.get(plane + 1)?;
        let side = planes[plane].side;
        let texels = 8 * base.side;
        // With a mean more on each side.
        let cover = |range: &Range<usize>, all: u32| {
            let first = (range.start * side).saturating_sub(1);
            let last = (range.end * side + 1).min(all as usize);
            first / texels..last.div_ceil(texels)
        };
        let cover = (cover(columns, base.size.width), cover(rows, base.size.height));
        Some(self.patch(plane + 1, &cover))
    }

    /// Superblocks of a base, decoded.
    fn patch(&self, plane: usize, superblocks: &Superblocks) -> Patch {
        let base = self.base_of(plane, superblocks);
        let tools = self.tools();
        let shape = tools.planes[plane];
        let size = (shape.size.width as usize, shape.size.height as usize);
        let texels = 8 * shape.side;
        let (columns, rows) = superblocks;
        let origin = (columns.start * texels, rows.start * texels);
        let held =
            ((columns.end * texels).min(size.0) - origin.0, (rows.end * texels).min(size.1) - origin.1);
        let mut patch = Patch::new(size, origin, held, tools.ranks.len());
        let mut around = Around::default();
        for row in rows.clone() {
            for column in columns.clone() {
                self.superblock(plane, (column, row), base.as_ref(), &mut around, |axis, (x, y), block| {
                    patch.put(axis, x, y, block);
                });
            }
        }
        patch
    }
}

//! Textures as they are read: any rectangle, by superblock.

use std::ops::Range;

use texfold_core::{Rect, RegionError, parallel};

use super::Bytes;
use super::context::Around;
use super::form::{AXIS_BITS, BlockForm, Group, MAX_GROUP, PlaneShape, Steps};
use super::index::Index;
use super::plane::{Patch, PlaneDecoder};
use super::scan::COEFFICIENTS;
use super::tables::Table;

/// Most texels along a superblock's side.
const MAX_SIDE: usize = 64;

/// What samples are decoded to.
pub trait BlockSample: Copy + Default + Send + Sync + sealed::Sealed {
    /// The sample of a sum of that many fractional bits, between 0 and the largest one.
    fn of(sum: i32, shift: u32, largest: i32) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for u16 {}
}

impl BlockSample for u8 {
    #[inline(always)]
    fn of(sum: i32, shift: u32, largest: i32) -> u8 {
        if shift == 16 {
            // What is left has 16 bits, which SSE2 can clamp.
            return ((sum >> 16) as i16).clamp(0, largest as i16) as u8;
        }
        (sum >> shift).clamp(0, largest) as u8
    }
}

impl BlockSample for u16 {
    #[inline(always)]
    fn of(sum: i32, shift: u32, largest: i32) -> u16 {
        (sum >> shift).clamp(0, largest) as u16
    }
}

/// A texture in blocks of variable length.
#[derive(Debug, Clone)]
pub struct BlockTexture {
    pub(super) form: BlockForm,
    /// Stopping probabilities of all tables, as stored.
    pub(super) stops: Vec<u8>,
    pub(super) index: Index,
    pub(super) bytes: Bytes,
    planes: Vec<PlaneShape>,
    pub(super) tables: Vec<Table>,
    pub(super) steps: Vec<Steps>,
    ranks: Vec<u8>,
}

/// Columns and rows of superblocks.
type Superblocks = (Range<usize>, Range<usize>);

impl BlockTexture {
    /// The texture of such parts.
    pub(super) fn new(
        form: BlockForm,
        stops: Vec<u8>,
        tables: Vec<Table>,
        index: Index,
        bytes: Bytes,
    ) -> Self {
        let planes = form.planes();
        let steps =
            (0..planes.len()).map(|plane| Steps::new(&form.quantiser, plane, form.fraction())).collect();
        let ranks = form.ranks();
        BlockTexture { form, stops, index, bytes, planes, tables, steps, ranks }
    }

    /// Header.
    #[must_use]
    pub fn form(&self) -> &BlockForm {
        &self.form
    }

    /// Decodes a rectangle of the image; `out` holds its texels row by row, their channels side by side. `rect.surface` and
    /// `rect.level` are 0.
    ///
    /// # Errors
    /// [`RegionError`] where the rectangle leaves the image or `out` has another length.
    pub fn decode<S: BlockSample>(&self, rect: Rect, out: &mut [S]) -> Result<(), RegionError> {
        self.check(rect, out.len())?;
        if rect.width == 0 || rect.height == 0 {
            return Ok(());
        }
        let side = 1usize << self.form.superblock_log2;
        let cover = |first: u32, count: u32| first as usize / side..((first + count) as usize).div_ceil(side);
        let (columns, rows) = (cover(rect.x, rect.width), cover(rect.y, rect.height));
        let base = self.base_of(0, &(columns.clone(), rows.clone()));
        let line = rect.width as usize * self.form.channels();
        let skipped = rect.y as usize % side;
        // The first row of superblocks may be cut; the rows that follow begin with whole ones.
        let (head, tail) =
            out.split_at_mut(if skipped == 0 { 0 } else { ((side - skipped) * line).min(out.len()) });
        if !head.is_empty() {
            self.decode_row(rect, rows.start, &columns, base.as_ref(), &mut Around::default(), head);
        }
        let first = rows.start + usize::from(skipped != 0);
        parallel::for_each_row(tail, side * line, |row, out| {
            self.decode_row(rect, first + row, &columns, base.as_ref(), &mut Around::default(), out);
        });
        Ok(())
    }

    fn check(&self, rect: Rect, length: usize) -> Result<(), RegionError> {
        let size = self.form.size;
        let inside =
            |first: u32, count: u32, all: u32| first.checked_add(count).is_some_and(|end| end <= all);
        if rect.surface != 0 {
            return Err(RegionError::NoSuchSurface { surface: rect.surface, surfaces: 1 });
        }
        if rect.level != 0 {
            return Err(RegionError::NoSuchLevel { level: rect.level, levels: 1 });
        }
        if !inside(rect.x, rect.width, size.width) || !inside(rect.y, rect.height, size.height) {
            return Err(RegionError::Outside { width: size.width, height: size.height });
        }
        let needed = rect.width as usize * rect.height as usize * self.form.channels();
        if length != needed {
            return Err(RegionError::OutputLength { found: length, needed });
        }
        Ok(())
    }

    /// The means of all blocks of the image.
    pub(super) fn whole_base(&self) -> Option<Patch> {
        let (columns, rows) = self.planes[0].superblocks;
        self.base_of(0, &(0..columns, 0..rows))
    }

    /// Decodes one superblock of the image into as much room as its texels take.
    pub(super) fn decode_superblock(
        &self,
        (column, row): (u32, u32),
        base: Option<&Patch>,
        around: &mut Around,
        out: &mut [u16],
    ) {
        let side = 1u32 << self.form.superblock_log2;
        let (x, y) = (column * side, row * side);
        let (width, height) = ((self.form.size.width - x).min(side), (self.form.size.height - y).min(side));
        let rect = Rect { surface: 0, level: 0, x, y, width, height };
        let column = column as usize;
        self.decode_row(rect, row as usize, &(column..column + 1), base, around, out);
    }

    /// Decodes what a row of superblocks has of a rectangle: its texels, row by row.
    fn decode_row<S: BlockSample>(
        &self,
        rect: Rect,
        row: usize,
        columns: &Range<usize>,
        base: Option<&Patch>,
        around: &mut Around,
        out: &mut [S],
    ) {
        let side = 1usize << self.form.superblock_log2;
        let (left, right) = (rect.x as usize, (rect.x + rect.width) as usize);
        let top = (row * side).max(rect.y as usize);
        let line = rect.width as usize * self.form.channels();
        let mut samples = vec![0i32; self.ranks.len() * side * side];
        for column in columns.clone() {
            self.superblock(0, (column, row), base, around, |axis, (x, y), block| {
                let first = (axis * side + 8 * y - row * side) * side + 8 * x - column * side;
                for (line, values) in block.chunks_exact(8).enumerate() {
                    samples[first + line * side..][..8].copy_from_slice(values);
                }
            });
            let (start, end) = ((column * side).max(left), ((column + 1) * side).min(right));
            for (number, out) in out.chunks_exact_mut(line).enumerate() {
                let inside = top + number - row * side;
                let texels = (start - left) * self.form.channels()..(end - left) * self.form.channels();
                self.channels(&samples, side, (start - column * side, inside), &mut out[texels]);
            }
        }
    }

    /// Channels of texels in a row of a superblock, from a place in it on, from its axes.
    #[inline(never)]
    fn channels<S: BlockSample>(
        &self,
        samples: &[i32],
        side: usize,
        (column, row): (usize, usize),
        out: &mut [S],
    ) {
        let channels = self.form.channels();
        let count = out.len() / channels;
        let (mut axis, shift) = (0, self.form.fraction() + AXIS_BITS);
        let largest = (1i32 << self.form.depth) - 1;
        for group in &self.form.groups {
            let used = usize::from(group.channels);
            let rows: [&[i32]; MAX_GROUP] = std::array::from_fn(|rank| {
                let axis = axis + rank.min(used - 1);
                &samples[(axis * side + row) * side + column..][..count]
            });
            let turned = Turn { group, shift, largest };
            let mut planar = [[S::default(); MAX_SIDE]; MAX_GROUP];
            for (channel, plane) in planar[..used].iter_mut().enumerate() {
                turned.channel(channel, &rows, &mut plane[..count]);
            }
            if used == 3 && channels == 3 {
                let (texels, _) = out.as_chunks_mut::<3>();
                let [first, second, third, _] = &planar;
                for (texel, ((&a, &b), &c)) in texels.iter_mut().zip(first.iter().zip(second).zip(third)) {
                    *texel = [a, b, c];
                }
            } else {
                for (channel, plane) in planar[..used].iter().enumerate() {
                    let texels = out[axis + channel..].iter_mut().step_by(channels);
                    texels.zip(plane).for_each(|(out, &value)| *out = value);
                }
            }
            axis += used;
        }
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
        let shape = self.planes[plane];
        // The coarsest plane comes first.
        let before: usize = self.planes[plane + 1..].iter().map(PlaneShape::count).sum();
        let number = before + place.1 * shape.superblocks.0 + place.0;
        let decoder = PlaneDecoder {
            shape,
            is_base: plane > 0,
            tables: &self.tables,
            steps: &self.steps[plane],
            ranks: &self.ranks,
            base,
        };
        decoder.superblock(place, self.index.of(&self.bytes, number), around, put);
    }

    /// The means that superblocks of a plane need; `None` where it is a single block.
    fn base_of(&self, plane: usize, (columns, rows): &Superblocks) -> Option<Patch> {
        let base = self.planes.get(plane + 1)?;
        let side = self.planes[plane].side;
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
        let shape = self.planes[plane];
        let size = (shape.size.width as usize, shape.size.height as usize);
        let texels = 8 * shape.side;
        let (columns, rows) = superblocks;
        let origin = (columns.start * texels, rows.start * texels);
        let held =
            ((columns.end * texels).min(size.0) - origin.0, (rows.end * texels).min(size.1) - origin.1);
        let mut patch = Patch::new(size, origin, held, self.ranks.len());
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

/// What turns axes into the channels of a group.
#[derive(Clone, Copy)]
struct Turn<'a> {
    group: &'a Group,
    /// Fractional bits of the sums.
    shift: u32,
    /// Largest sample.
    largest: i32,
}

impl Turn<'_> {
    /// A channel of a row of texels from the group's axes. The loops are what compilers turn into vectors.
    fn channel<S: BlockSample>(&self, channel: usize, rows: &[&[i32]; MAX_GROUP], out: &mut [S]) {
        let weights = self.group.axes[channel].map(i32::from);
        let mean = i32::from(self.group.means[channel]).wrapping_shl(self.shift);
        let mean = mean.wrapping_add(1 << (self.shift - 1));
        let sample = |sum: i32| S::of(sum, self.shift, self.largest);
        let part = |value: &i32, axis: usize| value.wrapping_mul(weights[axis]);
        let [first, second, third, fourth] = *rows;
        match self.group.channels {
            1 => {
                for (out, a) in out.iter_mut().zip(first) {
                    *out = sample(mean.wrapping_add(part(a, 0)));
                }
            }
            2 => {
                for (out, (a, b)) in out.iter_mut().zip(first.iter().zip(second)) {
                    *out = sample(mean.wrapping_add(part(a, 0)).wrapping_add(part(b, 1)));
                }
            }
            3 => {
                for (out, ((a, b), c)) in out.iter_mut().zip(first.iter().zip(second).zip(third)) {
                    let sum = mean.wrapping_add(part(a, 0)).wrapping_add(part(b, 1));
                    *out = sample(sum.wrapping_add(part(c, 2)));
                }
            }
            _ => {
                let axes = first.iter().zip(second).zip(third.iter().zip(fourth));
                for (out, ((a, b), (c, d))) in out.iter_mut().zip(axes) {
                    let sum = mean.wrapping_add(part(a, 0)).wrapping_add(part(b, 1));
                    *out = sample(sum.wrapping_add(part(c, 2)).wrapping_add(part(d, 3)));
                }
            }
        }
    }
}

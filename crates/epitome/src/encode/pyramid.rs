//! What content may be: every image at full, half and quarter width and height, stored and decoded again.
//!
//! A smaller content is the one that linear interpolation turns into the image with the least squared error, not a
//! mean: the difference is up to 1 dB where it is used.

use glam::Vec4;
use rayon::prelude::*;
use texfold_bc::{Bc1Blocks, Content, ContentPlanes};
use texfold_core::image::{ImageSet, PixelInfo, Raster};
use texfold_core::{
    CancelCheck, Domain, Effort, EncodeError, Image2d, ImageSize, Metric, SourceError, Texel,
};
use texfold_match::Field;
use texfold_residual::encode::PlaneForm;
use texfold_residual::{BLOCK_SIDE, ResidualContent};

/// Bytes of a BC1 block.
const BC1_BYTES: u32 = 8;

/// Texels that content for a leaf has at least along each axis.
pub(crate) const LEAST_SIDE: u32 = 4;

/// By how much content is smaller than its image, as binary logarithms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Scale {
    pub(crate) across: u32,
    pub(crate) down: u32,
}

impl Scale {
    /// How much an error of content counts that is drawn once: the squares of the shares that interpolation gives to
    /// a texel.
    pub(super) fn weight(self) -> f32 {
        let along = |log2: u32| {
            let factor = 1 << log2;
            let share = |k: u32| (k as f32 + 0.5) / factor as f32;
            // Blended with one neighbour on either side, or, at full size, alone.
            if log2 == 0 { 1.0 } else { 2.0 * (0..factor).map(|k| share(k).powi(2)).sum::<f32>() }
        };
        along(self.across) * along(self.down)
    }
}

/// Scales that content of one layer is taken from: the first of [`SCALES`].
pub(crate) const SCALES_ALONE: usize = 9;
/// Numbers of the scales; 0 is the full size. The last serves coarse layers of layered files, where it is a quarter
/// of the next larger one's bits.
pub(crate) const SCALES: [Scale; 10] = [
    Scale { across: 0, down: 0 },
    Scale { across: 1, down: 0 },
    Scale { across: 0, down: 1 },
    Scale { across: 1, down: 1 },
    Scale { across: 2, down: 0 },
    Scale { across: 0, down: 2 },
    Scale { across: 2, down: 1 },
    Scale { across: 1, down: 2 },
    Scale { across: 2, down: 2 },
    Scale { across: 3, down: 3 },
];

/// One image at all scales.
#[derive(Debug)]
pub(crate) struct Pyramid {
    pub(crate) size: ImageSize,
    /// By scale; sides are padded to whole blocks by repeating the edge.
    pub(crate) source: Vec<Field>,
}

/// How content is to be stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Storage {
    /// As planes of one format, at one lambda for all cells.
    Planes(Content),
    /// As a base with a residual plane, each block as finely as its bits are worth at that lambda, judged by that metric.
    ErrorMap(f32, Metric),
    /// In blocks of variable length, where a bit is worth that lambda, judged by that metric.
    Blocks(f32, Metric),
}

impl Storage {
    /// The lambda that it is coded at, where each cell is coded as finely as its bits are worth.
    pub(crate) fn lambda(self) -> Option<f32> {
        match self {
            Storage::Planes(_) => None,
            Storage::ErrorMap(lambda, _) | Storage::Blocks(lambda, _) => Some(lambda),
        }
    }
}

/// What codes content whose cells differ in bits.
#[derive(Debug)]
pub(crate) enum Coder {
    /// A base with a residual plane of that form.
    ErrorMap(PlaneForm),
    /// Blocks of variable length, judged by that metric.
    Blocks(Metric),
}

impl Coder {
    /// What its errors are judged by.
    fn metric(&self) -> Metric {
        match self {
            Coder::ErrorMap(form) => form.metric(),
            Coder::Blocks(metric) => *metric,
        }
    }
}

/// At which scales images are stored.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScaleChoice {
    /// Sides of images are padded to multiples of so many texels.
    pub(crate) padding: u32,
    /// The first so many of [`SCALES`].
    pub(crate) scales: usize,
}

impl ScaleChoice {
    /// Bytes of an image's fields at all scales.
    pub(crate) fn field_bytes(self, size: ImageSize) -> u64 {
        let padded = |side: u32| u64::from(side.next_multiple_of(self.padding));
        let texels = padded(size.width) * padded(size.height);
        let of_scale = |scale: &Scale| texels >> (scale.across + scale.down);
        SCALES[..self.scales].iter().map(of_scale).sum::<u64>() * size_of::<Vec4>() as u64
    }
}

/// Content that its format cannot hold.
fn no_room() -> EncodeError {
    SourceError::Full { what: "a plane of 8192 x 8192 words" }.into()
}

/// Content of one format.
#[derive(Debug)]
pub(crate) struct Stored {
    /// Format of the planes, or of the base.
    pub(crate) content: Content,
    /// Where cells differ in bits: what codes them.
    pub(crate) coder: Option<Coder>,
    /// Texels a side of a cell, the unit of content; the last of a row may hang over the field's edge.
    pub(crate) cell: u32,
    /// Bits of a cell; of one as coarse as can be where there is a residual plane; 1 where cells are blocks of variable length.
    pub(crate) cell_bits: f32,
    /// Where cells differ in bits: those of each, in `cell_bits`.
    pub(crate) shares: Vec<f32>,
    /// First cell of each image and scale, among those of all formats.
    pub(super) bases: Vec<u32>,
    /// Number of cells.
    pub(crate) cells: u32,
    /// By image and scale; none where there is a coder.
    pub(crate) planes: Vec<Vec<ContentPlanes>>,
    /// The same, decoded.
    pub(crate) decoded: Vec<Vec<Field>>,
}

/// How the cells of a field in one format are numbered: row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct CellRows {
    /// Cells in a row.
    pub(crate) columns: u32,
    /// Number of the first.
    pub(crate) base: u32,
    /// Texels a side of each.
    pub(crate) side: u32,
}

impl CellRows {
    /// Number of the cell in that column and row.
    pub(crate) fn number(&self, column: u32, row: u32) -> u32 {
        self.base + row * self.columns + column
    }
}

/// Where a cell lies: in a field of one format, in a column and row of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct CellPlace {
    pub(crate) format: usize,
    pub(crate) image: usize,
    pub(crate) scale: usize,
    pub(crate) column: u32,
    pub(crate) row: u32,
}

/// All images at all scales, with the numbers of their cells.
#[derive(Debug)]
pub(crate) struct Space {
    pub(crate) pixel: PixelInfo,
    pub(crate) pyramids: Vec<Pyramid>,
    pub(crate) stored: Vec<Stored>,
}

impl Space {
    /// Images at all scales, stored in each of `storages`. Images that are BC1 already keep their `blocks`.
    ///
    /// # Errors
    /// [`SourceError::Full`] where a residual plane cannot hold such pixels, [`EncodeError::Cancelled`] where the job
    /// was cancelled.
    pub(crate) fn new(
        images: &ImageSet,
        blocks: Option<&[Bc1Blocks]>,
        storages: &[Storage],
        ScaleChoice { padding, scales }: ScaleChoice,
        effort: Effort,
        cancel: CancelCheck<'_>,
    ) -> Result<Self, EncodeError> {
        let pixel = images.info();
        let pyramids: Vec<Pyramid> =
            images.images().par_iter().map(|image| Pyramid::new(image, padding, scales, cancel)).collect();
        cancel.checkpoint()?;
        let mut space = Space { pixel, pyramids, stored: Vec::new() };
        for &storage in storages {
            let first = space.cells() as u32;
            let stored = match storage {
                Storage::Planes(content) => space.store(content, blocks, first, effort, cancel)?,
                Storage::ErrorMap(lambda, metric) => {
                    space.store_with_errors(lambda, metric, first, cancel)?.ok_or_else(no_room)?
                }
                Storage::Blocks(lambda, metric) => space.store_in_blocks(lambda, metric, first, cancel)?,
            };
            cancel.checkpoint()?;
            space.stored.push(stored);
        }
        Ok(space)
    }

    /// All content as planes of one format.
    fn store(
        &self,
        content: Content,
        blocks: Option<&[Bc1Blocks]>,
        first: u32,
        effort: Effort,
        cancel: CancelCheck<'_>,
    ) -> Result<Stored, EncodeError> {
        let store = |pyramid: &Pyramid| pyramid.store(content, self.pixel, effort, cancel);
        let mut planes: Vec<Vec<ContentPlanes>> =
            self.pyramids.par_iter().map(store).collect::<Result<_, _>>()?;
        for (scales, blocks) in planes.iter_mut().zip(blocks.unwrap_or(&[])) {
            if let Some(kept) = scales.first().and_then(|full| with_blocks(full, self.pixel, blocks)) {
                scales[0] = kept;
            }
        }
        let decode = |planes: &ContentPlanes| field(planes.size(), planes.decode());
        let decoded = planes.par_iter().map(|scales| scales.par_iter().map(decode).collect()).collect();
        let cell = Content::CELL_SIDE;
        let (bases, cells) = self.number_cells(cell, first);
        let cell_bits = content.cell_bits(self.pixel) as f32;
        Ok(Stored {
            content,
            coder: None,
            cell,
            cell_bits,
            shares: Vec::new(),
            bases,
            cells,
            planes,
            decoded,
        })
    }

    /// All content with residual planes, where a bit is worth `lambda`; `None` where such pixels have no residual plane.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the job was cancelled.
    fn store_with_errors(
        &self,
        lambda: f32,
        metric: Metric,
        first: u32,
        cancel: CancelCheck<'_>,
    ) -> Result<Option<Stored>, EncodeError> {
        let rasters: Option<Vec<Vec<Raster>>> =
            self.pyramids.iter().map(|pyramid| pyramid.rasters(self.pixel)).collect();
        let Some(rasters) = rasters else { return Ok(None) };
        let first_scales = rasters.iter().flat_map(|scales| scales.first());
        let Some(largest) = first_scales.max_by_key(|raster| raster.size().texels()) else { return Ok(None) };
        let Some(form) = PlaneForm::suited(largest, lambda, metric, Effort::Fast, cancel)? else {
            return Ok(None);
        };
        let encode = |(raster, scale): (&Raster, &Scale)| {
            let (levels, lambda) = (std::slice::from_ref(raster), lambda / scale.weight());
            form.encode(levels, lambda, &[], Effort::Fast, cancel)
        };
        let textures: Vec<Vec<ResidualContent>> = rasters
            .par_iter()
            .map(|scales| scales.par_iter().zip(&SCALES).map(encode).collect::<Result<_, EncodeError>>())
            .collect::<Result<_, _>>()?;
        let (bases, cells) = self.number_cells(BLOCK_SIDE, first);
        let cell_bits = form.block_bits(largest, 0);
        let mut shares = Vec::new();
        let mut decoded = Vec::new();
        for texture in textures.iter().flatten() {
            let blocks = texture.layout().images.iter().map(|size| blocks_of(*size)).sum();
            let mut classes = texture.classes(0);
            classes.resize(blocks, 0);
            shares.extend(classes.iter().map(|&class| form.block_bits(largest, class) / cell_bits));
        }
        for scales in &textures {
            let levels: Option<Vec<Field>> = scales.par_iter().map(decode_level).collect();
            let Some(levels) = levels else { return Ok(None) };
            decoded.push(levels);
        }
        let content = form.content();
        let (coder, cell, planes) = (Some(Coder::ErrorMap(form)), BLOCK_SIDE, Vec::new());
        Ok(Some(Stored { content, coder, cell, cell_bits, shares, bases, cells, planes, decoded }))
    }

    /// Stores the content whose cells differ in bits anew, where a bit is worth `lambda`; returns whether there is any.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the job was cancelled.
    pub(crate) fn store_again(&mut self, lambda: f32, cancel: CancelCheck<'_>) -> Result<bool, EncodeError> {
        let coded = |stored: &Stored| Some((stored.coder.as_ref()?.metric(), stored.bases[0]));
        let found = self.stored.iter().enumerate().find_map(|(index, stored)| Some((index, coded(stored)?)));
        let Some((index, (metric, first))) = found else { return Ok(false) };
        let again = match self.stored[index].coder {
            Some(Coder::Blocks(_)) => Some(self.store_in_blocks(lambda, metric, first, cancel)?),
            _ => self.store_with_errors(lambda, metric, first, cancel)?,
        };
        let is_stored = again.is_some();
        if let Some(again) = again {
            self.stored[index] = again;
        }
        Ok(is_stored)
    }

    /// Bits of a cell, by format.
    pub(crate) fn cell_bits(&self) -> Vec<f32> {
        self.stored.iter().map(|stored| stored.cell_bits).collect()
    }

    /// Where cells differ in bits: those of each, in bits of a cell of its format.
    pub(crate) fn shares(&self) -> Vec<f32> {
        if self.stored.iter().all(|stored| stored.shares.is_empty()) {
            return Vec::new();
        }
        let of = |stored: &Stored| match stored.shares.is_empty() {
            true => vec![1.0; stored.cells as usize],
            false => stored.shares.clone(),
        };
        self.stored.iter().flat_map(of).collect()
    }

    /// First cell of each image and scale where cells have that side, and how many there are.
    pub(super) fn number_cells(&self, cell: u32, first: u32) -> (Vec<u32>, u32) {
        let (mut bases, mut next) = (Vec::new(), first);
        for field in self.pyramids.iter().flat_map(|pyramid| &pyramid.source) {
            bases.push(next);
            next += (field.width as u32).div_ceil(cell) * (field.height as u32).div_ceil(cell);
        }
        (bases, next - first)
    }

    /// Bits of a cell of that format.
    pub(crate) fn bits_of(&self, format: usize, cell: u32) -> f32 {
        let stored = &self.stored[format];
        let share = stored.shares.get((cell - stored.bases[0]) as usize).copied().unwrap_or(1.0);
        share * stored.cell_bits
    }

    /// Number of cells of all formats.
    pub(crate) fn cells(&self) -> usize {
        self.stored.iter().map(|stored| stored.cells as usize).sum()
    }

    /// Number of scales.
    pub(crate) fn scales(&self) -> usize {
        self.pyramids.first().map_or(0, |pyramid| pyramid.source.len())
    }

    /// How the cells of a field are numbered in format `format`.
    pub(crate) fn rows_of(&self, format: usize, image: usize, scale: usize) -> CellRows {
        let (field, stored) = (&self.pyramids[image].source[scale], &self.stored[format]);
        let columns = (field.width as u32).div_ceil(stored.cell);
        CellRows { columns, base: stored.bases[image * self.scales() + scale], side: stored.cell }
    }

    /// Format of a cell.
    pub(crate) fn format_of(&self, cell: u32) -> usize {
        self.stored.partition_point(|stored| stored.bases[0] <= cell) - 1
    }

    /// Where a cell lies.
    pub(crate) fn locate(&self, cell: u32) -> CellPlace {
        let format = self.format_of(cell);
        let field = self.stored[format].bases.partition_point(|&base| base <= cell) - 1;
        let (image, scale) = (field / self.scales(), field % self.scales());
        let CellRows { columns, base, .. } = self.rows_of(format, image, scale);
        CellPlace { format, image, scale, column: (cell - base) % columns, row: (cell - base) / columns }
    }
}

impl Pyramid {
    fn new(image: &Raster, block: u32, scales: usize, cancel: CancelCheck<'_>) -> Self {
        let size = image.size();
        let (width, height) = (size.width.next_multiple_of(block), size.height.next_multiple_of(block));
        let texels = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| image.texel(x, y) * 255.0)
            .collect();
        let full = Field { width: width as usize, height: height as usize, texels };
        let source = SCALES[..scales]
            .par_iter()
            .map(|scale| {
                let across = reduce(&full, scale.across, Axis::Across, cancel);
                reduce(&across, scale.down, Axis::Down, cancel)
            })
            .collect();
        Pyramid { size, source }
    }

    /// All scales as images.
    fn rasters(&self, pixel: PixelInfo) -> Option<Vec<Raster>> {
        let raster = |field: &Field| {
            let texels: Vec<Texel> = field.texels.iter().map(|texel| *texel / 255.0).collect();
            Raster::from_texels(field.width as u32, field.height as u32, pixel, &texels).ok()
        };
        self.source.par_iter().map(raster).collect()
    }

    fn store(
        &self,
        content: Content,
        pixel: PixelInfo,
        effort: Effort,
        cancel: CancelCheck<'_>,
    ) -> Result<Vec<ContentPlanes>, EncodeError> {
        let store = |field: &Field| {
            let texels: Vec<Vec4> = field.texels.iter().map(|texel| *texel / 255.0).collect();
            let size = (field.width as u32, field.height as u32);
            ContentPlanes::encode_cancellable(content, pixel, size, &texels, effort, cancel)
        };
        self.source.iter().map(store).collect()
    }
}

/// Texels of 0 to 1 in 8-bit units.
fn field((width, height): (u32, u32), texels: Vec<Texel>) -> Field {
    let texels = texels.into_iter().map(|texel| texel * 255.0).collect();
    Field { width: width as usize, height: height as usize, texels }
}

/// The whole of a texture of one image, level 0.
fn decode_level(texture: &ResidualContent) -> Option<Field> {
    let rect = texture.layout().whole(0, 0)?;
    let mut texels = vec![Texel::ZERO; Image2d::len(rect)];
    texture.decode(rect, &mut texels);
    Some(field((rect.width, rect.height), texels))
}

/// Blocks of a residual plane for such an image.
fn blocks_of(size: ImageSize) -> usize {
    size.width.div_ceil(BLOCK_SIDE) as usize * size.height.div_ceil(BLOCK_SIDE) as usize
}

/// BC1 content with an image's own blocks in place of those that were made of its texels; `None` for other content.
fn with_blocks(full: &ContentPlanes, pixel: PixelInfo, image: &Bc1Blocks) -> Option<ContentPlanes> {
    if full.content() != Content::Bc1 {
        return None;
    }
    let (_, bytes) = full.planes().first()?;
    let row = |width: u32| (width.div_ceil(Content::CELL_SIDE) * BC1_BYTES) as usize;
    let mut bytes = bytes.clone();
    let own = image.blocks.chunks_exact(row(image.size.width));
    for (to, from) in bytes.chunks_exact_mut(row(full.size().0)).zip(own) {
        to.get_mut(..from.len())?.copy_from_slice(from);
    }
    ContentPlanes::from_planes(Content::Bc1, pixel, full.size(), vec![bytes])
}

/// Along what a field is made smaller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axis {
    Across,
    Down,
}

/// The field at 1/2^log2 of its width or height from which linear interpolation gives it back best.
fn reduce(field: &Field, log2: u32, axis: Axis, cancel: CancelCheck<'_>) -> Field {
    if log2 == 0 {
        return field.clone();
    }
    let factor = 1usize << log2;
    let across = axis == Axis::Across;
    let length = if across { field.width } else { field.height };
    let system = Interpolation::new(length / factor, factor);
    let (lines, line_step, step) =
        if across { (field.height, field.width, 1) } else { (field.width, 1, field.width) };
    let line = |line: usize| {
        if cancel.is_cancelled() {
            return vec![Vec4::ZERO; length / factor];
        }
        system.fit(|index| field.texels[line * line_step + index * step])
    };
    let reduced: Vec<Vec<Vec4>> = (0..lines).map(line).collect();
    if across {
        return Field { width: length / factor, height: field.height, texels: reduced.concat() };
    }
    let height = length / factor;
    let texels = (0..height).flat_map(|y| reduced.iter().map(move |column| column[y])).collect();
    Field { width: field.width, height, texels }
}

/// Normal equations of linear interpolation by a factor; tridiagonal, solved by Thomas' algorithm.
struct Interpolation {
    count: usize,
    factor: usize,
    /// Weights of the left of two content texels, by place between them.
    weights: Vec<f32>,
    /// What elimination leaves of the upper diagonal, and the inverse pivots.
    upper: Vec<f32>,
    pivots: Vec<f32>,
}

impl Interpolation {
    fn new(count: usize, factor: usize) -> Self {
        // Between the centres of two content texels lie `factor` texels; half a content texel lies beyond the last
        // ones.
        let weights: Vec<f32> = (0..factor).map(|k| 1.0 - (k as f32 + 0.5) / factor as f32).collect();
        let squared: f32 = weights.iter().map(|w| w * w).sum();
        let mixed: f32 = weights.iter().map(|w| w * (1.0 - w)).sum();
        let edge = factor as f32 * 0.5;
        let (mut upper, mut pivots) = (vec![0.0; count], vec![0.0; count]);
        for index in 0..count {
            let sides = f32::from(u8::from(index > 0)) + f32::from(u8::from(index + 1 < count));
            let diagonal = squared * sides + edge * (2.0 - sides);
            let before = if index > 0 { mixed * upper[index - 1] } else { 0.0 };
            pivots[index] = 1.0 / (diagonal - before);
            upper[index] = mixed * pivots[index];
        }
        Interpolation { count, factor, weights, upper, pivots }
    }

    fn fit(&self, at: impl Fn(usize) -> Vec4) -> Vec<Vec4> {
        let half = self.factor / 2;
        let mut right = vec![Vec4::ZERO; self.count];
        for index in 0..self.count * self.factor {
            let value = at(index);
            if index < half {
                right[0] += value;
                continue;
            }
            let (left, place) = ((index - half) / self.factor, (index - half) % self.factor);
            if left + 1 >= self.count {
                right[self.count - 1] += value;
                continue;
            }
            right[left] += value * self.weights[place];
            right[left + 1] += value * (1.0 - self.weights[place]);
        }
        let mixed: f32 = self.weights.iter().map(|w| w * (1.0 - w)).sum();
        for index in 0..self.count {
            let before = if index > 0 { right[index - 1] * mixed } else { Vec4::ZERO };
            right[index] = (right[index] - before) * self.pivots[index];
        }
        for index in (0..self.count.saturating_sub(1)).rev() {
            right[index] = right[index] - right[index + 1] * self.upper[index];
        }
        right.iter().map(|value| value.clamp(Vec4::ZERO, Vec4::splat(255.0))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_interpolation_can_show_is_found_exactly() {
        for factor in [2usize, 4] {
            let content: Vec<f32> = (0..8).map(|i| 20.0 + (i * i * 37 % 200) as f32).collect();
            let drawn = |index: usize| {
                let at = ((index as f32 + 0.5) / factor as f32 - 0.5).clamp(0.0, 7.0);
                let left = (at as usize).min(6);
                let weight = at - left as f32;
                Vec4::splat(content[left] * (1.0 - weight) + content[left + 1] * weight)
            };
            let found = Interpolation::new(8, factor).fit(drawn);
            for (found, wanted) in found.iter().zip(&content) {
                assert!((found.x - wanted).abs() < 0.01, "factor {factor}: {} {wanted}", found.x);
            }
        }
    }

    #[test]
    fn cells_are_found_again() {
        let image = texfold_testkit::image("odd_37x61");
        let space = Space::new(
            &ImageSet::single(image),
            None,
            &[Content::Bc1, Content::Bc7].map(Storage::Planes),
            ScaleChoice { padding: 32, scales: 9 },
            Effort::Fast,
            CancelCheck::default(),
        )
        .unwrap();
        for (format, scale, column, row) in [(0, 0, 0, 0), (1, 0, 15, 15), (0, 3, 7, 2), (1, 8, 3, 3)] {
            let number = space.rows_of(format, 0, scale).number(column, row);
            assert_eq!(space.locate(number), CellPlace { format, image: 0, scale, column, row });
        }
        assert_eq!((space.stored[0].cell_bits, space.stored[1].cell_bits), (64.0, 128.0));
    }
}

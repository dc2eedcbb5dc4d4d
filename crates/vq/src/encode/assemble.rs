//! Filling a codebook, storing it, and finding for each block what stands for it best in the stored form.

use ndarray::{Array2, Axis};
use rayon::prelude::*;
use texfold_bc::{Content, ContentPlanes};
use texfold_codebook::{Match, Search};
use texfold_core::image::{PixelInfo, Raster};
use texfold_core::{CancelCheck, Effort, EncodeError, Texel};

use super::blocks::{Blocks, channels_of, texel_of};
use crate::VqTexture;
use crate::grid::{CodebookPart, Grid};

/// A codebook before it is stored.
#[derive(Debug, Clone)]
pub(crate) struct Draft {
    pub(crate) grid: Grid,
    pub(crate) samples: Vec<CodebookPart>,
    /// One codeword a row, for the first free cells.
    pub(crate) codewords: Array2<f32>,
}

/// How a codebook is stored.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Storage {
    pub(crate) pixel: PixelInfo,
    pub(crate) content: Content,
    pub(crate) effort: Effort,
    /// Whether windows that lie across several codewords are listed too.
    pub(crate) straddling: bool,
}

/// A codebook as it ships: the planes, what they decode to, and everything in it that a block can point at.
#[derive(Debug, Clone)]
pub(crate) struct Stored {
    pub(crate) planes: ContentPlanes,
    pub(crate) texels: Vec<Texel>,
    /// Corners of the windows: those of samples first, then the codewords'.
    pub(crate) corners: Vec<[u8; 2]>,
    pub(crate) windows: Array2<f32>,
    /// How many of the windows lie in samples.
    pub(crate) sample_windows: usize,
}

impl Draft {
    /// All texels of the codebook; unused cells are 0.
    pub(crate) fn texels(&self, images: &[Raster]) -> Vec<Texel> {
        let (width, height) = self.grid.texels();
        let mut texels = vec![Texel::ZERO; (width * height) as usize];
        for part in &self.samples {
            let image = &images[part.image as usize];
            for (y, x) in (0..part.side).flat_map(|y| (0..part.side).map(move |x| (y, x))) {
                let texel = image.texel(part.source_x + x, part.source_y + y);
                texels[((part.y + y) * width + part.x + x) as usize] = texel;
            }
        }
        for (codeword, (x, y)) in self.codewords.rows().into_iter().zip(self.grid.free_cells(&self.samples)) {
            let values = codeword.to_vec();
            for (index, texel) in values.chunks_exact(values.len() / 16).enumerate() {
                let (row, column) = (y as usize + index / 4, x as usize + index % 4);
                texels[row * width as usize + column] = texel_of(texel);
            }
        }
        texels
    }

    /// Stores the codebook and lists what blocks can point at.
    pub(crate) fn store(
        &self,
        images: &[Raster],
        storage: Storage,
        cancel: CancelCheck<'_>,
    ) -> Result<Stored, EncodeError> {
        let Storage { pixel, content, effort, straddling } = storage;
        let texels = self.texels(images);
        let size = self.grid.texels();
        let planes = ContentPlanes::encode_cancellable(content, pixel, size, &texels, effort, cancel)?;
        let texels = planes.decode();
        let mut corners: Vec<[u8; 2]> = self.samples.iter().flat_map(sample_corners).collect();
        let sample_windows = corners.len();
        let cells = self.grid.free_cells(&self.samples);
        corners.extend(cells.iter().take(self.codewords.nrows()).map(|&(x, y)| [x as u8, y as u8]));
        if straddling {
            corners.extend(self.straddling_windows());
        }
        let windows = windows_at(&texels, self.grid.texels().0, &corners, usize::from(pixel.channels));
        Ok(Stored { planes, texels, corners, windows, sample_windows })
    }

    /// Corners of all windows that lie across cells and in no sample.
    fn straddling_windows(&self) -> Vec<[u8; 2]> {
        let (width, height) = self.grid.texels();
        let cells = self.grid.free_cells(&self.samples);
        // Cells without a codeword are at the end; windows that touch them would change when they are filled, so the
        // row of the first such cell is left out.
        let bottom = cells.get(self.codewords.nrows()).map_or(height, |&(_, y)| y);
        let in_sample = |x: u32, y: u32| {
            self.samples.iter().any(|part| {
                x >= part.x && x + 4 <= part.x + part.side && y >= part.y && y + 4 <= part.y + part.side
            })
        };
        (0..bottom.saturating_sub(3))
            .flat_map(|y| (0..width - 3).map(move |x| (x, y)))
            .filter(|&(x, y)| (x % 4 != 0 || y % 4 != 0) && !in_sample(x, y))
            .map(|(x, y)| [x as u8, y as u8])
            .collect()
    }

    /// Moves each codeword to the weighted mean of the blocks that use it; unused ones to the blocks that are worst
    /// off.
    pub(crate) fn average(
        &mut self,
        blocks: &Blocks,
        rows: &[usize],
        weights: &[f32],
        stored: &Stored,
        matches: &[Match],
    ) {
        let dims = self.codewords.ncols();
        let mut sums = Array2::<f64>::zeros(self.codewords.dim());
        let mut totals = vec![0f64; self.codewords.nrows()];
        for ((&row, found), &weight) in rows.iter().zip(matches).zip(weights) {
            let Some(index) = (found.index as usize).checked_sub(stored.sample_windows) else { continue };
            if index >= totals.len() {
                continue;
            }
            totals[index] += f64::from(weight);
            let mut sum = sums.row_mut(index);
            sum.iter_mut().zip(blocks.vector(row)).for_each(|(s, &v)| *s += f64::from(weight) * f64::from(v));
        }
        let mut worst: Vec<usize> = (0..rows.len()).collect();
        let share = |at: usize| matches[at].distance * weights[at];
        worst.sort_by(|&a, &b| share(b).total_cmp(&share(a)).then(a.cmp(&b)));
        let mut worst = worst.into_iter().filter(|&at| share(at) > 0.0);
        for (index, mut codeword) in self.codewords.axis_iter_mut(Axis(0)).enumerate() {
            if totals[index] > 0.0 {
                (0..dims).for_each(|k| codeword[k] = (sums[[index, k]] / totals[index]) as f32);
            } else if let Some(at) = worst.next() {
                codeword.iter_mut().zip(blocks.vector(rows[at])).for_each(|(c, &v)| *c = v);
            }
        }
    }
}

/// Corners of all windows that lie in a sample.
fn sample_corners(part: &CodebookPart) -> impl Iterator<Item = [u8; 2]> + use<> {
    let part = *part;
    (0..part.side - 3)
        .flat_map(move |y| (0..part.side - 3).map(move |x| [(part.x + x) as u8, (part.y + y) as u8]))
}

/// Corners of all windows of a texture's codebook that blocks may point at: those in samples, and the codewords'.
pub(crate) fn corners_of(texture: &VqTexture) -> (Vec<[u8; 2]>, Vec<[u8; 2]>) {
    let cells = Grid::of_texels(texture.codebook_size()).free_cells(texture.samples());
    let used = cells.len() - texture.parts.free_cells as usize;
    let codewords = cells.iter().take(used).map(|&(x, y)| [x as u8, y as u8]);
    (texture.samples().iter().flat_map(sample_corners).collect(), codewords.collect())
}

/// The 4x4 windows of a codebook at `corners`.
pub(crate) fn windows_at(texels: &[Texel], width: u32, corners: &[[u8; 2]], channels: usize) -> Array2<f32> {
    let dims = 16 * channels;
    let mut values = vec![0f32; corners.len() * dims];
    values.par_chunks_mut(dims).zip(corners).for_each(|(line, &[x, y])| {
        for (index, values) in line.chunks_exact_mut(channels).enumerate() {
            let (row, column) = (usize::from(y) + index / 4, usize::from(x) + index % 4);
            values.copy_from_slice(&channels_of(texels[row * width as usize + column], channels)[..channels]);
        }
    });
    Array2::from_shape_vec((corners.len(), dims), values).unwrap_or_else(|_| Array2::zeros((0, dims)))
}

/// The nearest of `windows` for each of the blocks `rows`.
pub(crate) fn assign(
    blocks: &Blocks,
    rows: &[usize],
    windows: ndarray::ArrayView2<'_, f32>,
    cancel: CancelCheck<'_>,
) -> Result<Vec<Match>, EncodeError> {
    let search = Search::new(windows);
    let nowhere = Match { index: 0, distance: f32::INFINITY };
    let nearest = |&row: &usize| {
        if cancel.is_cancelled() {
            return nowhere;
        }
        search.nearest(blocks.vector(row), f32::INFINITY).unwrap_or(nowhere)
    };
    let matches = rows.par_iter().with_min_len(64).map(nearest).collect();
    cancel.checkpoint().map(|()| matches)
}

//! Images cut into 4x4 blocks: vectors of 16 texels, channel by channel within a texel.
//!
//! Order: image by image, level by level, row by row. Blocks that hang over an edge repeat it and weigh as much as
//! the texels that lie inside.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use texfold_core::image::{ImageSet, MipFilter, Raster, mip_chain};
use texfold_core::{CancelCheck, EncodeError, ImageSize, Texel};

/// Texels of a block.
pub(crate) const BLOCK_TEXELS: usize = 16;

/// All blocks of all levels of a set of images.
#[derive(Debug, Clone)]
pub(crate) struct Blocks {
    /// One block a row.
    pub(crate) vectors: Array2<f32>,
    /// Share of each block that lies inside its level, 1/16 to 1.
    pub(crate) inside: Vec<f32>,
    /// First block of each image.
    pub(crate) starts: Vec<usize>,
    /// Blocks of level 0 of each image.
    pub(crate) level0: Vec<usize>,
    /// Size of each image.
    pub(crate) sizes: Vec<ImageSize>,
    pub(crate) channels: usize,
}

impl Blocks {
    pub(crate) fn cut(images: &ImageSet, levels: u32, cancel: CancelCheck<'_>) -> Result<Self, EncodeError> {
        let channels = usize::from(images.info().channels);
        let mut blocks = Blocks {
            vectors: Array2::zeros((0, BLOCK_TEXELS * channels)),
            inside: Vec::new(),
            starts: Vec::new(),
            level0: Vec::new(),
            sizes: images.images().iter().map(Raster::size).collect(),
            channels,
        };
        let mut values = Vec::new();
        for image in images.images() {
            blocks.starts.push(blocks.inside.len());
            let (columns, rows) = image.size().blocks();
            blocks.level0.push((columns * rows) as usize);
            cut_level(image, &mut values, &mut blocks.inside, cancel);
            cancel.checkpoint()?;
            if levels > 1 {
                for level in mip_chain(image, levels, MipFilter::Box).iter().skip(1) {
                    cut_level(level, &mut values, &mut blocks.inside, cancel);
                }
            }
            cancel.checkpoint()?;
        }
        let shape = (blocks.inside.len(), BLOCK_TEXELS * channels);
        blocks.vectors = Array2::from_shape_vec(shape, values).unwrap_or(blocks.vectors);
        Ok(blocks)
    }

    pub(crate) fn len(&self) -> usize {
        self.inside.len()
    }

    pub(crate) fn vector(&self, block: usize) -> &[f32] {
        let dims = self.vectors.ncols();
        self.vectors.as_slice().and_then(|all| all.get(block * dims..(block + 1) * dims)).unwrap_or_default()
    }

    /// Blocks of level 0 of image `image`.
    pub(crate) fn of_level0(&self, image: usize) -> std::ops::Range<usize> {
        self.starts[image]..self.starts[image] + self.level0[image]
    }

    /// Rows of the blocks that `choose` accepts, and which they are.
    pub(crate) fn subset(&self, rows: &[usize]) -> Array2<f32> {
        let dims = self.vectors.ncols();
        let mut values = vec![0.0; rows.len() * dims];
        values.par_chunks_mut(dims).zip(rows).for_each(|(line, &row)| line.copy_from_slice(self.vector(row)));
        Array2::from_shape_vec((rows.len(), dims), values).unwrap_or_else(|_| Array2::zeros((0, dims)))
    }

    pub(crate) fn view(&self) -> ArrayView2<'_, f32> {
        self.vectors.view()
    }
}

fn cut_level(level: &Raster, values: &mut Vec<f32>, inside: &mut Vec<f32>, cancel: CancelCheck<'_>) {
    let ImageSize { width, height } = level.size();
    let (columns, rows) = level.size().blocks();
    let dims = BLOCK_TEXELS * usize::from(level.info().channels);
    let first = values.len();
    values.resize(first + (columns * rows) as usize * dims, 0.0);
    let row_values = columns as usize * dims;
    values[first..].par_chunks_mut(row_values).enumerate().for_each(|(row, line)| {
        for (column, block) in line.chunks_exact_mut(dims).enumerate().filter(|_| !cancel.is_cancelled()) {
            window(level, column as u32 * 4, row as u32 * 4, block);
        }
    });
    let inside_of = |at: u32, end: u32| (end - at).min(4);
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        inside.push((inside_of(column * 4, width) * inside_of(row * 4, height)) as f32 / BLOCK_TEXELS as f32);
    }
}

/// The 4x4 window at (`x`, `y`) of an image, edges repeated.
pub(crate) fn window(image: &Raster, x: u32, y: u32, out: &mut [f32]) {
    let channels = usize::from(image.info().channels);
    for (texel, values) in out.chunks_exact_mut(channels).enumerate() {
        let (x, y) = (x + texel as u32 % 4, y + texel as u32 / 4);
        values.iter_mut().enumerate().for_each(|(channel, value)| *value = image.value(x, y, channel));
    }
}

/// The channels of a texel that blocks of so many channels hold.
pub(crate) fn channels_of(texel: Texel, channels: usize) -> [f32; 4] {
    match channels {
        2 => [texel.x, texel.w, 0.0, 0.0],
        _ => texel.to_array(),
    }
}

/// The texel that so many channels stand for.
pub(crate) fn texel_of(values: &[f32]) -> Texel {
    match *values {
        [gray] => Texel::new(gray, gray, gray, 1.0),
        [gray, alpha] => Texel::new(gray, gray, gray, alpha),
        [red, green, blue] => Texel::new(red, green, blue, 1.0),
        [red, green, blue, alpha] => Texel::new(red, green, blue, alpha),
        _ => Texel::ZERO,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::ColorSpace;

    #[test]
    fn blocks_at_the_edge_repeat_it_and_weigh_less() {
        let bytes: Vec<u8> = (0..5 * 3).map(|i| i * 10).collect();
        let image = Raster::from_u8(5, 3, 1, ColorSpace::Linear, &bytes).unwrap();
        let blocks = Blocks::cut(&ImageSet::single(image), 1, CancelCheck::default()).unwrap();
        assert_eq!(blocks.len(), 2);
        assert_eq!(blocks.inside, [12.0 / 16.0, 3.0 / 16.0]);
        assert_eq!(blocks.vector(1)[0], 40.0 / 255.0);
        assert_eq!(blocks.vector(1)[15], 140.0 / 255.0);
    }

    #[test]
    fn levels_follow_one_another() {
        let image = Raster::from_u8(16, 8, 3, ColorSpace::Linear, &[7; 16 * 8 * 3]).unwrap();
        let set = ImageSet::new(vec![image.clone(), image]).unwrap();
        let blocks = Blocks::cut(&set, 3, CancelCheck::default()).unwrap();
        assert_eq!(blocks.starts, [0, 11]);
        assert_eq!((blocks.len(), blocks.level0[1]), (22, 8));
        assert_eq!(blocks.of_level0(1), 11..19);
    }
}

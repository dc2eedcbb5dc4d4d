//! Usability of sample positions: how many blocks a window of the image could stand for (paper section 3.1).
//!
//! The paper compares every block with every other, O(n^2), in 180 s for 512x512 texels. Here blocks and windows are
//! first quantised to words of about the tolerance's size; a sample then stands for a word if it holds a window of that
//! word, and for as many blocks as the word has. Sliding a window over the words costs O(positions x side). Deviation:
//! "within tolerance" is taken word by word, not block by block. Tests hold the chosen position against the exhaustive
//! count.

use ndarray::Array2;
use rayon::prelude::*;
use texfold_codebook::{Search, Settings, build_unless};
use texfold_core::image::Raster;
use texfold_core::{CancelCheck, EncodeError, ImageSize};

use super::blocks::{Blocks, window};

/// Words that an image is quantised to: as many as a usual codebook has codewords.
const MAX_WORDS: usize = 1024;
/// Blocks that the words are learnt from.
const TRAINING_BLOCKS: usize = 8192;
/// Rounds of learning: words need only be about right.
const ROUNDS: u32 = 4;
/// Share of the distortion that a round must take away for another one.
const LEAST_GAIN: f64 = 0.02;
/// Start of the pseudo-random seeding: any will do.
const SEED: u64 = 1;
/// Windows looked at; above 512x512 their step widens.
const MAX_WINDOWS: u64 = 70_000;
/// A window stands for a word if its squared distance is at most this multiple of the words' mean distortion.
const REACH: f32 = 1.0;
/// No word: nothing within reach.
const NONE: u32 = u32::MAX;

/// Blocks and windows of all images, as words.
#[derive(Debug, Clone)]
pub(crate) struct Words {
    /// Word of each block of level 0; `NONE` never occurs.
    block_word: Vec<u32>,
    count: usize,
    /// Step between windows in texels, for each image.
    steps: Vec<u32>,
    /// Words of the windows of each image, by row and column of the step.
    windows: Vec<Array2<u32>>,
    /// Mean squared distance of blocks to their words: the size of a word.
    pub(crate) distortion: f32,
}

/// Usability by position, on a grid of `step` texels.
#[derive(Debug, Clone)]
pub(crate) struct UsabilityMap {
    pub(crate) step: u32,
    pub(crate) values: Array2<f32>,
}

impl Words {
    /// Quantises blocks of level 0 and windows of all images; `codewords` tells how fine a codebook is expected.
    pub(crate) fn new(
        images: &[Raster],
        blocks: &Blocks,
        codewords: usize,
        cancel: CancelCheck<'_>,
    ) -> Result<Self, EncodeError> {
        let rows: Vec<usize> = (0..images.len()).flat_map(|number| blocks.of_level0(number)).collect();
        let stride = rows.len().div_ceil(TRAINING_BLOCKS).max(1);
        let training: Vec<usize> = rows.iter().copied().step_by(stride).collect();
        let settings = Settings { rounds: ROUNDS, least_gain: LEAST_GAIN, seed: SEED };
        let count = codewords.clamp(1, MAX_WORDS);
        let (vectors, weights) = (blocks.subset(&training), vec![1.0; training.len()]);
        let built = build_unless(vectors.view(), &weights, count, settings, &|| cancel.is_cancelled());
        let words = built.ok_or(EncodeError::Cancelled)?.codewords;
        let search = Search::new(words.view());
        let matches: Vec<(u32, f32)> = rows
            .par_iter()
            .map(|&row| {
                if cancel.is_cancelled() {
                    return (0, 0.0);
                }
                search.nearest(blocks.vector(row), f32::INFINITY).map_or((0, 0.0), |m| (m.index, m.distance))
            })
            .collect();
        cancel.checkpoint()?;
        let distortion = matches.iter().map(|&(_, distance)| f64::from(distance)).sum::<f64>();
        let distortion = (distortion / matches.len().max(1) as f64) as f32;
        let texels: u64 = images.iter().map(|image| image.size().texels()).sum();
        let step = window_step(texels);
        let words = Words {
            block_word: matches.into_iter().map(|(word, _)| word).collect(),
            count: words.nrows(),
            steps: vec![step; images.len()],
            windows: images
                .iter()
                .map(|image| {
                    window_words(
                        image,
                        step,
                        &Reach { search: &search, distance: distortion * REACH, cancel },
                    )
                })
                .collect(),
            distortion,
        };
        cancel.checkpoint().map(|()| words)
    }

    /// For every position of a square of `side` texels in image `image`: how much of the blocks that weigh `weights`
    /// (one a block of level 0, all images) it could stand for.
    pub(crate) fn usability(&self, image: usize, side: u32, weights: &[f32]) -> UsabilityMap {
        let mut of_word = vec![0f32; self.count];
        for (&word, &weight) in self.block_word.iter().zip(weights) {
            of_word[word as usize] += weight;
        }
        let (windows, step) = (&self.windows[image], self.steps[image]);
        // Windows that lie inside a square of that side.
        let span = ((side.max(4) - 4) / step + 1) as usize;
        let (rows, columns) = windows.dim();
        if rows < span || columns < span {
            return UsabilityMap { step, values: Array2::zeros((0, 0)) };
        }
        let width = columns - span + 1;
        let lines: Vec<Vec<f32>> =
            (0..rows - span + 1).into_par_iter().map(|top| slide(windows, top, span, &of_word)).collect();
        let values = Array2::from_shape_fn((lines.len(), width), |(row, column)| lines[row][column]);
        UsabilityMap { step, values }
    }
}

/// Step between windows that keeps their number bearable: 2 texels as in the paper, more for large images.
fn window_step(texels: u64) -> u32 {
    [2u32, 4, 8, 16].into_iter().find(|&step| texels / u64::from(step * step) <= MAX_WINDOWS).unwrap_or(32)
}

/// How the word of a window is found.
struct Reach<'a> {
    search: &'a Search,
    /// Largest squared distance.
    distance: f32,
    cancel: CancelCheck<'a>,
}

fn window_words(image: &Raster, step: u32, reach: &Reach<'_>) -> Array2<u32> {
    let ImageSize { width, height } = image.size();
    if width < 4 || height < 4 {
        return Array2::from_elem((0, 0), NONE);
    }
    let (columns, rows) = ((width - 4) / step + 1, (height - 4) / step + 1);
    let dims = 16 * usize::from(image.info().channels);
    let words: Vec<u32> = (0..rows)
        .into_par_iter()
        .flat_map_iter(|row| {
            let mut vector = vec![0.0; dims];
            (0..columns).map(move |column| {
                if reach.cancel.is_cancelled() {
                    return NONE;
                }
                window(image, column * step, row * step, &mut vector);
                reach.search.nearest(&vector, reach.distance).map_or(NONE, |found| found.index)
            })
        })
        .collect();
    Array2::from_shape_vec((rows as usize, columns as usize), words)
        .unwrap_or_else(|_| Array2::from_elem((0, 0), NONE))
}

/// Usability of all positions of one row: counts of words enter and leave as the square moves right.
fn slide(windows: &Array2<u32>, top: usize, span: usize, of_word: &[f32]) -> Vec<f32> {
    let columns = windows.ncols();
    let mut present = vec![0u32; of_word.len()];
    let mut sum = 0f64;
    let mut line = Vec::new();
    let words_of =
        |column: usize| (top..top + span).map(move |row| windows[[row, column]]).filter(|&word| word != NONE);
    for right in 0..columns {
        for word in words_of(right) {
            present[word as usize] += 1;
            if present[word as usize] == 1 {
                sum += f64::from(of_word[word as usize]);
            }
        }
        if right + 1 < span {
            continue;
        }
        line.push(sum as f32);
        let left = right + 1 - span;
        for word in words_of(left) {
            present[word as usize] -= 1;
            if present[word as usize] == 0 {
                sum -= f64::from(of_word[word as usize]);
            }
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::{ColorSpace, ImageSet, to_u8};

    /// The upper left 128x128 texels of a fixture.
    fn corner(name: &str) -> Raster {
        let whole = texfold_testkit::image(name);
        let bytes: Vec<u8> = (0..128 * 128u32)
            .flat_map(|i| whole.texel(i % 128, i / 128).truncate().to_array().map(to_u8))
            .collect();
        Raster::from_u8(128, 128, 3, ColorSpace::Srgb, &bytes).unwrap()
    }

    /// The paper's count: blocks that some window inside the square represents within the tolerance.
    fn exhaustive(image: &Raster, blocks: &Blocks, side: u32, tolerance: f32) -> Array2<f32> {
        let size = image.size();
        let dims = blocks.vectors.ncols();
        let windows: Vec<(u32, u32, Vec<f32>)> = (0..=(size.height - 4) / 2)
            .flat_map(|row| (0..=(size.width - 4) / 2).map(move |column| (column * 2, row * 2)))
            .map(|(x, y)| {
                let mut vector = vec![0.0; dims];
                window(image, x, y, &mut vector);
                (x, y, vector)
            })
            .collect();
        let (rows, columns) = ((size.height - side) / 4 + 1, (size.width - side) / 4 + 1);
        let mut counts = Array2::zeros((rows as usize, columns as usize));
        for block in 0..blocks.len() {
            let near = |vector: &[f32]| {
                vector.iter().zip(blocks.vector(block)).map(|(a, b)| (a - b) * (a - b)).sum::<f32>()
                    <= tolerance
            };
            let hits: Vec<(u32, u32)> =
                windows.iter().filter(|(_, _, vector)| near(vector)).map(|&(x, y, _)| (x, y)).collect();
            for ((row, column), count) in counts.indexed_iter_mut() {
                let (left, top) = (column as u32 * 4, row as u32 * 4);
                let inside = |&(x, y): &(u32, u32)| {
                    x >= left && y >= top && x + 4 <= left + side && y + 4 <= top + side
                };
                *count += f32::from(u8::from(hits.iter().any(inside)));
            }
        }
        counts
    }

    #[test]
    fn the_best_position_is_nearly_as_usable_as_the_exhaustive_best() {
        for name in ["facade", "salient"] {
            let image = corner(name);
            let cancel = CancelCheck::default();
            let blocks = Blocks::cut(&ImageSet::single(image.clone()), 1, cancel).unwrap();
            let words = Words::new(std::slice::from_ref(&image), &blocks, 256, cancel).unwrap();
            let fast = words.usability(0, 32, &vec![1.0; blocks.len()]);
            let slow = exhaustive(&image, &blocks, 32, 2.0 * words.distortion);
            let ratio = 4 / fast.step as usize;
            let best = slow
                .indexed_iter()
                .max_by(|a, b| {
                    fast.values[[a.0.0 * ratio, a.0.1 * ratio]]
                        .total_cmp(&fast.values[[b.0.0 * ratio, b.0.1 * ratio]])
                })
                .map(|(_, &count)| count)
                .unwrap();
            let most = slow.iter().fold(0f32, |a, &b| a.max(b));
            assert!(best >= 0.85 * most, "{name}: {best} of {most}");
        }
    }

    #[test]
    fn an_image_smaller_than_the_sample_has_no_position() {
        let image = Raster::from_u8(3, 5, 1, ColorSpace::Srgb, &[9; 15]).unwrap();
        let cancel = CancelCheck::default();
        let blocks = Blocks::cut(&ImageSet::single(image.clone()), 1, cancel).unwrap();
        let words = Words::new(&[image], &blocks, 8, cancel).unwrap();
        assert_eq!(words.usability(0, 16, &[1.0; 2]).values.len(), 0);
    }
}

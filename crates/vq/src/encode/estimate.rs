//! What error a codebook of some size leaves at least, from a look at some blocks: for callers that choose among methods.

use std::collections::{HashMap, HashSet};

use rayon::prelude::*;
use texfold_bc::Content;
use texfold_core::image::{ImageSet, PixelInfo, Raster};
use texfold_core::principal_axes;
use texfold_core::{CancelCheck, EncodeError, Goal, ImageSize, Job, vectorised};

use super::blocks::BLOCK_TEXELS;
use super::contents;
use super::plan::MAX_CELLS;
use crate::{Vq, VqParams};

/// Blocks that are looked at.
const LOOKED_AT: usize = 512;
/// Blocks that those which stand for codewords are chosen from, at most.
const CANDIDATES: usize = 1 << 16;
/// Largest step of values, in 8-bit units: blocks whose values round to the same steps are alike.
const ALIKE: f64 = 8.0;
/// That step over the RMS error of a quality goal.
const ALIKE_OF_RMS: f64 = 1.6;
/// Share of the error of 4 steps along a line that 16 steps leave.
const FINE_STEPS: f64 = (3.0 / 15.0) * (3.0 / 15.0);
/// Values that are compared at once.
const LANES: usize = 8;
/// Most sweeps for the line of a block, and the share of its energy off the diagonal at which they end.
const MAX_SWEEPS: u32 = 10;
const OFF_DIAGONAL: f64 = 1e-12;
/// How much less squared error codewords that are learnt leave than as many blocks of the images.
const LEARNT: f64 = 0.4;

/// A block's number and values.
type Numbered = (usize, Vec<f32>);

impl Vq {
    /// Mean squared error, in 8-bit units, that images keep about at least within so many bits a texel, compressed: each of some
    /// blocks beside the nearest of as many others as there can be codewords; none where that many blocks differ at most. The time hardly
    /// depends on the images' size, unless few of their blocks differ: then all are counted.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`].
    pub fn least_error(
        images: &ImageSet,
        params: &VqParams,
        bpp: f64,
        job: &Job<'_>,
    ) -> Result<f64, EncodeError> {
        let forms = forms(images.info(), params)?;
        let (texels, room) = (images.texel_count() as f64, bpp - Vq::least_bpp(images, params));
        let all = Corners::of(images);
        let check = job.cancel_check();
        let channels = usize::from(images.info().channels);
        let found = job.install(|| {
            let looked_at = all.chosen(LOOKED_AT, all.count / (2 * LOOKED_AT));
            let alike = alike(params.goal) as f32;
            let stand_ins = most_frequent(all.chosen(CANDIDATES, 0), alike);
            let different = all.different(alike, check) as f64;
            // The fewer bits a codeword takes, the more there are.
            let words: Vec<f64> = forms
                .iter()
                .map(|form| (room * texels / form.bits).clamp(1.0, f64::from(MAX_CELLS)))
                .collect();
            let counts: Vec<usize> = words.iter().map(|&words| stand_ins.len().min(words as usize)).collect();
            let error = |block: &Numbered| nearest(block, &stand_ins, &counts);
            let errors: Vec<Vec<f32>> =
                looked_at.par_iter().filter(|_| !check.is_cancelled()).map(error).collect();
            let on_lines = looked_at.par_iter().map(|(_, block)| f64::from(off_line(block, channels)));
            // In order, whatever thread is first.
            let on_lines: Vec<f64> = on_lines.collect();
            let on_lines = on_lines.iter().sum::<f64>() / looked_at.len().max(1) as f64;
            let of = |(number, form): (usize, &Form)| {
                // What is a codeword itself has no error: those that nothing else serves.
                let share = (1.0 - words[number] / all.count as f64).max(0.0);
                let of_form = errors.iter().map(|errors| errors[number]).collect();
                let between =
                    if words[number].floor() < different { LEARNT * left_by(of_form, share) } else { 0.0 };
                between + form.off_line * on_lines
            };
            forms.iter().enumerate().map(of).fold(f64::INFINITY, f64::min)
        });
        job.checkpoint()?;
        Ok(found / (BLOCK_TEXELS * channels) as f64)
    }
}

/// A form of codewords.
struct Form {
    /// Bits of a codeword.
    bits: f64,
    /// Share of [`off_line`] that is left.
    off_line: f64,
}

/// Forms that the encoder tries for such pixels, the largest first.
fn forms(pixel: PixelInfo, params: &VqParams) -> Result<Vec<Form>, EncodeError> {
    let form = |content: Content| Form {
        bits: f64::from(content.cell_bits(pixel)),
        off_line: match content {
            Content::Raw => 0.0,
            Content::Bc5 | Content::Bc7 => FINE_STEPS,
            Content::Bc1 | Content::Bc3 | Content::Bc4 => 1.0,
        },
    };
    let mut forms: Vec<Form> = contents(pixel, params)?.into_iter().map(form).collect();
    forms.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    Ok(forms)
}

/// Squared error of a block whose texels are moved to a few steps of the line along which they differ most.
fn off_line(block: &[f32], channels: usize) -> f32 {
    let texels = || block.chunks_exact(channels);
    let mean: Vec<f32> = (0..channels)
        .map(|channel| texels().map(|texel| texel[channel]).sum::<f32>() / BLOCK_TEXELS as f32)
        .collect();
    let away =
        |texel: &[f32]| -> Vec<f32> { texel.iter().zip(&mean).map(|(value, mean)| value - mean).collect() };
    let mut products = vec![0.0f64; channels * channels];
    for away in texels().map(away) {
        for (row, first) in products.chunks_exact_mut(channels).zip(&away) {
            row.iter_mut().zip(&away).for_each(|(sum, second)| *sum += f64::from(first * second));
        }
    }
    let axes = principal_axes(&mut products, channels, MAX_SWEEPS, OFF_DIAGONAL);
    let along = |away: &[f32]| axes.iter().zip(away).map(|(a, &b)| *a as f32 * b).sum::<f32>();
    let places: Vec<f32> = texels().map(|texel| along(&away(texel))).collect();
    let (low, high) = places.iter().fold((0.0f32, 0.0f32), |(low, high), &at| (low.min(at), high.max(at)));
    let step = (high - low) / if channels == 1 { 7.0 } else { 3.0 };
    let rounded = |at: f32| if step > 0.0 { low + ((at - low) / step).round() * step } else { 0.0 };
    let left = |(texel, &at): (&[f32], &f32)| {
        let away = away(texel);
        let off: f32 = away.iter().map(|value| value * value).sum::<f32>() - at * at;
        off.max(0.0) + (at - rounded(at)).powi(2)
    };
    texels().zip(&places).map(left).sum()
}

/// Mean error where those of the worst blocks are gone but for a share of all.
fn left_by(mut errors: Vec<f32>, share: f64) -> f64 {
    errors.sort_by(f32::total_cmp);
    let left = (share * errors.len() as f64).ceil() as usize;
    errors.iter().take(left).map(|&error| f64::from(error)).sum::<f64>() / errors.len().max(1) as f64
}

/// Step of values, 1 to [`ALIKE`] in 8-bit units, that a goal does not tell apart; 1 keeps 8-bit values as they are.
fn alike(goal: Goal) -> f64 {
    match goal {
        Goal::Psnr(psnr) => (ALIKE_OF_RMS * 255.0 / 10f64.powf(psnr / 20.0)).clamp(1.0, ALIKE),
        _ => ALIKE,
    }
}

/// The values of a block in such steps.
fn rough(block: &[f32], alike: f32) -> Vec<u8> {
    block.iter().map(|value| (value / alike).round() as u8).collect()
}

/// One each of blocks that are alike, those of which there are most first.
fn most_frequent(blocks: Vec<Numbered>, alike: f32) -> Vec<Numbered> {
    let mut groups: HashMap<Vec<u8>, (usize, Numbered)> = HashMap::new();
    for (number, block) in blocks {
        groups.entry(rough(&block, alike)).or_insert((0, (number, block))).0 += 1;
    }
    let mut groups: Vec<(usize, Numbered)> = groups.into_values().collect();
    groups.sort_by_key(|(copies, (number, _))| (std::cmp::Reverse(*copies), *number));
    groups.into_iter().map(|(_, block)| block).collect()
}

/// Squared distances of a block to the nearest of the first so many others, without itself; the counts ascend.
fn nearest((number, block): &Numbered, others: &[Numbered], counts: &[usize]) -> Vec<f32> {
    vectorised(
        #[inline(always)]
        || {
            let (mut start, mut least) = (0, f32::INFINITY);
            let up_to = |&end: &usize| {
                for (other, values) in &others[start..end] {
                    if other != number {
                        least = least.min(distance(block, values, least));
                    }
                }
                start = end;
                least
            };
            counts.iter().map(up_to).collect()
        },
    )
}

/// Squared distance of two blocks; where it exceeds `most`, any number above `most`.
#[inline(always)]
fn distance(a: &[f32], b: &[f32], most: f32) -> f32 {
    let mut sum = 0.0;
    for (a, b) in a.chunks_exact(2 * LANES).zip(b.chunks_exact(2 * LANES)) {
        let mut lanes = [0.0; LANES];
        for lane in 0..LANES {
            let (first, second) = (a[lane] - b[lane], a[lane + LANES] - b[lane + LANES]);
            lanes[lane] = first * first + second * second;
        }
        sum += lanes.iter().sum::<f32>();
        if sum > most {
            break;
        }
    }
    sum
}

/// The blocks of all images by number.
struct Corners<'a> {
    images: &'a [Raster],
    /// First block of each image.
    starts: Vec<usize>,
    count: usize,
}

impl<'a> Corners<'a> {
    fn of(images: &'a ImageSet) -> Corners<'a> {
        let (mut starts, mut count) = (Vec::new(), 0);
        for image in images.images() {
            starts.push(count);
            let (columns, rows) = image.size().blocks();
            count += columns as usize * rows as usize;
        }
        Corners { images: images.images(), starts, count }
    }

    /// An even choice of at most `count` blocks.
    fn chosen(&self, count: usize, first: usize) -> Vec<Numbered> {
        let step = self.count.div_ceil(count).max(1);
        (first..self.count).step_by(step).map(|number| (number, self.block(number))).collect()
    }

    /// Number of blocks that are not alike, counted up to one more than there can be codewords: a part of a photograph has as many.
    fn different(&self, alike: f32, cancel: CancelCheck<'_>) -> usize {
        let mut seen = HashSet::new();
        for number in (0..self.count).take_while(|_| !cancel.is_cancelled()) {
            seen.insert(rough(&self.block(number), alike));
            if seen.len() > MAX_CELLS as usize {
                break;
            }
        }
        seen.len()
    }

    /// The values of a block in 8-bit units; blocks that hang over an edge repeat it.
    fn block(&self, number: usize) -> Vec<f32> {
        let index = self.starts.partition_point(|&start| start <= number) - 1;
        let (image, within) = (&self.images[index], number - self.starts[index]);
        let ImageSize { width, height } = image.size();
        let columns = image.size().blocks().0 as usize;
        let (left, top) = (4 * (within % columns) as u32, 4 * (within / columns) as u32);
        let channels = usize::from(image.info().channels);
        let texels = (0..4).flat_map(|y| (0..4).map(move |x| (left + x, top + y)));
        texels
            .flat_map(|(x, y)| {
                let texel = image.texel(x.min(width - 1), y.min(height - 1)) * 255.0;
                texel.to_array().into_iter().take(channels)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use texfold_core::Encoder;
    use texfold_core::rng::Rng;

    use super::*;
    use crate::VqSource;

    fn error_at(name: &str, bpp: f64) -> f64 {
        let set = ImageSet::single(texfold_testkit::image(name));
        Vq::least_error(&set, &VqParams::default(), bpp, &Job::default()).unwrap()
    }

    #[test]
    fn texels_on_a_line_are_kept_in_any_direction() {
        // Two colours of equal luma.
        let red_and_green = [[90.0, 10.0, 40.0], [10.0, 90.0, 40.0]];
        let block: Vec<f32> = (0..BLOCK_TEXELS).flat_map(|i| red_and_green[i % 2]).collect();
        assert!(off_line(&block, 3) < 1e-3, "{}", off_line(&block, 3));
        assert_eq!(off_line(&[7.0; 3 * BLOCK_TEXELS], 3), 0.0);
        let corners = [[0.0, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, 90.0, 0.0], [0.0, 0.0, 90.0]];
        let block: Vec<f32> = (0..BLOCK_TEXELS).flat_map(|i| corners[i % 4]).collect();
        assert!(off_line(&block, 3) > 1000.0);
    }

    #[test]
    fn the_nearest_of_several_counts_are_those_of_a_scan() {
        let mut random = Rng::new(7);
        let mut block = || (0..3 * BLOCK_TEXELS).map(|_| 255.0 * random.unit() as f32).collect::<Vec<f32>>();
        let others: Vec<Numbered> = (0..40).map(|number| (number, block())).collect();
        for block in &others {
            let scan = |count: usize| {
                let distance =
                    |other: &[f32]| block.1.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
                let apart = others[..count].iter().filter(|(number, _)| *number != block.0);
                apart.map(|(_, other)| distance(other)).fold(f32::INFINITY, f32::min)
            };
            for (found, count) in nearest(block, &others, &[0, 9, 9, 40]).into_iter().zip([0, 9, 9, 40]) {
                assert!(found == scan(count) || (found - scan(count)).abs() < 1.0, "{found} {}", scan(count));
            }
        }
    }

    #[test]
    fn few_blocks_that_differ_are_kept_as_they_are() {
        let set = ImageSet::single(texfold_testkit::image("tile_repeat"));
        let params = VqParams::default().with_goal(Goal::Psnr(60.0));
        let error = |bpp: f64| Vq::least_error(&set, &params, bpp, &Job::default()).unwrap();
        assert!(error(4.0) == 0.0 && error(1.5) > 1.0, "{} {}", error(4.0), error(1.5));
        let texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
        let found = texfold_core::metric::measure(&set, &texture);
        assert!(texture.content() == Content::Raw && found.psnr >= 60.0 && found.bpp < 3.0, "{found:?}");
    }

    #[test]
    fn more_codewords_leave_less_and_what_repeats_leaves_nothing() {
        assert!(error_at("tile_repeat", 2.0) < 40.0);
        assert!(error_at("noise", 2.0) > 1000.0);
        let ladder: Vec<f64> = [1.2, 1.8, 2.4, 3.6].map(|bpp| error_at("terrain", bpp)).to_vec();
        assert!(ladder.is_sorted_by(|a, b| a >= b), "{ladder:?}");
        assert!(error_at("terrain", 32.0) < 1.0);
    }
}

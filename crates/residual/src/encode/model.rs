//! The rate model that a texture's blocks share: which bits a rate class gives to which subband, and the subbands' weights.
//!
//! Every sensible way to share bits out is tried on a sample of the blocks; of each number of bits the one that most
//! blocks would take is kept. Cost: ways x sampled blocks.

use std::sync::LazyLock;

use rayon::prelude::*;

use super::transform::ResidualBlock;
use crate::decode::{BLOCK_CELLS, SUBBANDS};
use crate::rates::{MAX_RATES, RATE_CLASSES, RateModel, Rates, SUBBAND_COUNTS, WEIGHT_ONE};

/// What remains of a coefficient's squared error by its bits: measured on normal numbers of mixed scales, coded by the
/// trellis.
const LEFT: [f32; 6] = [1.0, 0.288, 0.081, 0.0245, 0.0075, 0.0024];

/// Most blocks that a model is made from.
const SAMPLE: usize = 1024;

/// Largest scale by number: 2^(15 / 2).
const MOST_SCALE: f32 = 181.02;
/// How much larger scales may be than the largest of the sample.
const HEADROOM: f32 = 1.6;
/// Least scale in 8-bit units that is told from smaller ones.
const LEAST_SCALE: f32 = 0.25;

/// Squared error that is left where coefficients get such bits.
pub(crate) fn left(energy: &[f32; SUBBANDS], rates: Rates) -> f32 {
    energy.iter().zip(rates.0).map(|(&energy, rate)| energy * LEFT[usize::from(rate)]).sum()
}

/// Coefficients of a subband in a block.
fn count(subband: usize) -> f32 {
    (BLOCK_CELLS * SUBBAND_COUNTS[subband]) as f32
}

/// All ways to share bits out in which coarser subbands get no fewer than finer ones.
static WAYS: LazyLock<Vec<Rates>> = LazyLock::new(|| {
    let mut ways = Vec::new();
    let most = MAX_RATES.map(|most| most as u8);
    for mean in 1..=most[0] {
        for coarse in 0..=mean.min(most[1]) {
            for edge in 0..=coarse.min(most[2]) {
                for diagonal in 0..=edge.min(most[3]) {
                    for chroma in 0..=mean.min(most[4]) {
                        for chroma_coarse in 0..=chroma.min(most[5]) {
                            for chroma_fine in 0..=chroma_coarse.min(most[6]) {
                                let rates =
                                    [mean, coarse, edge, diagonal, chroma, chroma_coarse, chroma_fine];
                                ways.push(Rates(rates));
                            }
                        }
                    }
                }
            }
        }
    }
    ways
});

/// A sample of the blocks, spread evenly.
fn sample(blocks: &[ResidualBlock]) -> Vec<&ResidualBlock> {
    blocks.iter().step_by(blocks.len().div_ceil(SAMPLE).max(1)).collect()
}

/// Factors on lambda at which classes are looked for, the first that fills a class first. Blocks differ in their
/// residuals by less than these factors within a search that starts near its answer.
const NEAR: [f32; 3] = [1.0, 0.4, 2.5];
/// The same for a search from an estimate: a factor of 16 is some 12 dB, more than any estimate is off.
const FAR: [f32; 7] = [1.0, 0.5, 2.0, 0.25, 4.0, 0.06, 16.0];
/// Rounds in which weights and the blocks' scales are fitted to each other; further ones change weights by less than the
/// 1/1024 that they are stored in.
const WEIGHT_ROUNDS: usize = 4;
/// Least weight of a subband beside the largest, so that a scale of 4 bits can still lift it over the rounding of 8 bits.
const LEAST_WEIGHT: f32 = 0.02;

/// Classes that no block takes at a lambda are those of blocks at others, so that other lambdas can be tried with a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// A little higher and lower lambdas.
    Near,
    /// All that a search may come to.
    Far,
}

/// The model for blocks of which class 1 has `class_bits` bits, where a bit is worth `lambda` of squared error.
#[must_use]
pub fn train(blocks: &[ResidualBlock], class_bits: u32, lambda: f32, reach: Reach) -> RateModel {
    let sample = sample(blocks);
    let mut model = RateModel { class_bits, ..RateModel::default() };
    let mut taken = [None; RATE_CLASSES];
    let factors: &[f32] = match reach {
        Reach::Near => &NEAR,
        Reach::Far => &FAR,
    };
    for factor in factors {
        for (taken, found) in taken.iter_mut().zip(favourites(&sample, class_bits, factor * lambda)) {
            *taken = taken.or(found);
        }
    }
    if reach == Reach::Far {
        fill(&mut taken, &sample, class_bits);
    }
    for (rates, taken) in model.classes.iter_mut().zip(taken) {
        *rates = taken.unwrap_or_default();
    }
    set_weights(&mut model, &sample, lambda);
    model
}

/// For each class the way that most blocks take at that lambda.
fn favourites(sample: &[&ResidualBlock], class_bits: u32, lambda: f32) -> [Option<Rates>; RATE_CLASSES] {
    let fits = |rates: &&Rates| {
        rates.bits().is_multiple_of(class_bits) && rates.bits() / class_bits < RATE_CLASSES as u32
    };
    let ways: Vec<Rates> = WAYS.iter().filter(fits).copied().collect();
    let choices: Vec<Option<usize>> = sample
        .par_iter()
        .map(|block| {
            let cost = |rates: Rates| left(&block.energy, rates) + lambda * rates.bits() as f32;
            let best = (0..ways.len()).min_by(|&a, &b| cost(ways[a]).total_cmp(&cost(ways[b])))?;
            (cost(ways[best]) < block.energy.iter().sum()).then_some(best)
        })
        .collect();
    let mut uses = vec![0u32; ways.len()];
    choices.iter().flatten().for_each(|&choice| uses[choice] += 1);
    let mut found = [None; RATE_CLASSES];
    let mut most = [0; RATE_CLASSES];
    for (&way, &uses) in ways.iter().zip(&uses) {
        let class = (way.bits() / class_bits) as usize;
        if uses > most[class] {
            (found[class], most[class]) = (Some(way), uses);
        }
    }
    found
}

/// Gives the classes that no block would take the way that leaves the least share of a block's error in the mean: single
/// blocks of a tolerance may need them.
fn fill(taken: &mut [Option<Rates>; RATE_CLASSES], sample: &[&ResidualBlock], class_bits: u32) {
    let share = |rates: Rates| -> f32 {
        let shares = sample.iter().map(|block| {
            let energy: f32 = block.energy.iter().sum();
            left(&block.energy, rates) / energy.max(1.0)
        });
        shares.sum()
    };
    for (class, taken) in (0..).zip(taken.iter_mut()).skip(1).filter(|(_, taken)| taken.is_none()) {
        let ways = WAYS.par_iter().filter(|rates| rates.bits() == class * class_bits);
        let shares = ways.map(|&rates| (share(rates), rates));
        *taken = shares.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|(_, rates)| rates);
    }
}

/// RMS of a block's coded coefficients, each divided by its subband's weight.
pub(crate) fn scale_of(energy: &[f32; SUBBANDS], rates: Rates, weights: &[f32; SUBBANDS]) -> f32 {
    let (mut sum, mut coefficients) = (0.0, 0.0);
    for subband in (0..SUBBANDS).filter(|&subband| rates.0[subband] > 0) {
        sum += energy[subband] / (weights[subband] * weights[subband]);
        coefficients += count(subband);
    }
    if coefficients > 0.0 { (sum / coefficients).sqrt() } else { 0.0 }
}

/// The weights under which a block's coefficients have one scale, in the mean of the blocks that code them.
fn set_weights(model: &mut RateModel, sample: &[&ResidualBlock], lambda: f32) {
    let classes = model.classes;
    let choices: Vec<Rates> = sample
        .par_iter()
        .map(|block| {
            let cost = |rates: Rates| left(&block.energy, rates) + lambda * rates.bits() as f32;
            classes.into_iter().min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or_default()
        })
        .collect();
    let mut weights = [1.0f32; SUBBANDS];
    let mut scales = Vec::new();
    for _ in 0..WEIGHT_ROUNDS {
        let (mut sums, mut uses) = ([0.0f64; SUBBANDS], [0.0f64; SUBBANDS]);
        scales.clear();
        for (block, &rates) in sample.iter().zip(&choices) {
            let scale = scale_of(&block.energy, rates, &weights);
            if scale < LEAST_SCALE {
                continue;
            }
            scales.push(scale);
            for subband in (0..SUBBANDS).filter(|&subband| rates.0[subband] > 0) {
                sums[subband] += f64::from(block.energy[subband] / count(subband) / (scale * scale));
                uses[subband] += 1.0;
            }
        }
        for subband in (0..SUBBANDS).filter(|&subband| uses[subband] > 0.0) {
            weights[subband] = ((sums[subband] / uses[subband]).sqrt() as f32).max(LEAST_WEIGHT);
        }
    }
    let largest = scales.into_iter().fold(0.0, f32::max) * HEADROOM;
    let unit = (largest / MOST_SCALE).max(LEAST_SCALE);
    model.weights = weights.map(|weight| (weight * unit * WEIGHT_ONE).round().clamp(1.0, 65535.0) as u16);
}

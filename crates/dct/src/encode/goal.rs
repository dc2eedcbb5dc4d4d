//! The step that meets a goal.

use std::borrow::Cow;

use texfold_core::target::{Measured, StepScale, search_step, search_step_estimated};
use texfold_core::{CancelCheck, Effort, EncodeError, Goal, Metric, ParamError, SourceError};

use super::code::{Estimate, LAMBDA, Looks, code, code_with_bits, estimate};
use super::error::{psnr, worst_block_rms};
use super::forward::{Block, Coefficients, coefficients};
use super::source::DctSource;
use super::strength::{Tried, deblocked, strongest};
use super::{cutout, intra};
use crate::decode::DctTexture;
use crate::form::{BASE_LOG2, DctForm, MAX_STEP, OCTAVE_STEPS, Quantiser, Steps};

/// Most blocks that a guess looks at, about.
const GUESSED: usize = 512;
/// Bits of a unit of [`intra::size`]: 1.9 to 3.2 on five fixtures at 0.1 to 10 bits a texel.
const SIZE_BITS: f64 = 2.4;
/// Distance to a goal, in octaves of bits, within which a guess is taken.
const GUESS_NEAR: f64 = 0.05;

/// Slope of the weights for the eye, in 1/64: 0.19 a unit of frequency. SSIMULACRA2 at 0.89, 1.28 and 2 bits, mean of four
/// photographs, without masking: 61.7, 72.7, 82.8 at 0 (34.6, 37.1, 40.5 dB); 67.8, 77.0, 85.1 at 14 (0.5 dB less); 68.4, 77.4,
/// 85.1 at 20 (0.7 dB less). With masking 12 has the quality of 20 without, and is 0.56 dB below 0.
/// These figures, and those of masking and deblocking, are of before quantisers were dependent.
/// *Not taken*: slopes for images or classes of blocks: the best of five for each of 11 images gives 0.05 points at 0.5, 1 and 2 bits more than the
/// best for all; 16, with intra modes 0.3 points more for 0.1 dB and 0.0015 of SSIM less.
const SLOPE: u8 = 12;

/// Step, in units of 8-bit samples, from which on the slope grows.
const SLOPE_FROM: f64 = 10.0;
/// What each further octave of the step adds to the slope: the fewer bits there are, the more of them belong to low frequencies.
/// SSIMULACRA2 at 0.25, 0.5, 1 and 2 bits, means of eight images and of eight that were held back: 9.9, 40.0, 64.1, 81.1 and 29.5, 56.4,
/// 74.8, 85.8 at 0; 13.6, 42.3, 65.1, 81.2 and 31.5, 57.5, 75.1, 85.9 at 4, for 0.2, 0.2, 0.1 and 0 dB; within 0.3 of that at 6.
const SLOPE_OCTAVE: f64 = 4.0;
/// Largest slope.
const MOST_SLOPE: f64 = 24.0;

/// Slope of the weights of a quantiser of that step, in units of 8-bit samples.
fn slope(metric: Metric, step: f64) -> u8 {
    match metric {
        Metric::Psnr => 0,
        Metric::Perceptual => {
            let octaves = (step / SLOPE_FROM).log2().max(0.0);
            (f64::from(SLOPE) + SLOPE_OCTAVE * octaves).min(MOST_SLOPE).round() as u8
        }
    }
}

/// How a texture is made.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct DctSettings {
    /// What is wanted. Bits are those of [`DctTexture::to_bytes`] a texel, PSNR is that of all channels together.
    pub goal: Goal,
    /// How long to look.
    pub effort: Effort,
    /// What errors count.
    pub metric: Metric,
    /// Binary logarithm of a superblock's side, 4 to 6.
    pub superblock_log2: u8,
}

impl Default for DctSettings {
    fn default() -> Self {
        DctSettings {
            goal: Goal::default(),
            effort: Effort::default(),
            metric: Metric::default(),
            superblock_log2: 5,
        }
    }
}

impl DctSettings {
    /// With that goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        DctSettings { goal, ..self }
    }

    /// With that effort.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        DctSettings { effort, ..self }
    }

    /// Judged by that metric.
    #[must_use]
    pub fn with_metric(self, metric: Metric) -> Self {
        DctSettings { metric, ..self }
    }

    /// With superblocks of that side.
    #[must_use]
    pub fn with_superblock_log2(self, superblock_log2: u8) -> Self {
        DctSettings { superblock_log2, ..self }
    }

    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        if !(4..=6).contains(&self.superblock_log2) {
            return Err(ParamError::new("superblock_log2", u32::from(self.superblock_log2), "4 to 6"));
        }
        Ok(())
    }
}

/// A source's coefficients, from which textures for any goal are made.
#[derive(Debug)]
pub struct DctEncoder<'a> {
    source: Cow<'a, DctSource>,
    params: DctSettings,
    form: DctForm,
    planes: Vec<Coefficients>,
    check: CancelCheck<'a>,
}

impl<'a> DctEncoder<'a> {
    /// Transforms the source.
    ///
    /// # Errors
    /// [`EncodeError`] for a parameter out of range, and where the job was cancelled.
    pub fn new(
        source: &'a DctSource,
        params: &DctSettings,
        check: CancelCheck<'a>,
    ) -> Result<Self, EncodeError> {
        Self::of(Cow::Borrowed(source), params, check)
    }

    /// As [`DctEncoder::new`], for textures of steps that the caller names: the source's samples are not kept.
    pub(super) fn of_steps(
        source: DctSource,
        params: &DctSettings,
        check: CancelCheck<'a>,
    ) -> Result<Self, EncodeError> {
        let mut encoder = Self::of(Cow::Owned(source), params, check)?;
        encoder.source.to_mut().samples = Vec::new();
        Ok(encoder)
    }

    fn of(
        source: Cow<'a, DctSource>,
        params: &DctSettings,
        check: CancelCheck<'a>,
    ) -> Result<Self, EncodeError> {
        params.check()?;
        let mut form = DctForm {
            size: source.size,
            depth: source.depth,
            superblock_log2: params.superblock_log2,
            base_log2: BASE_LOG2,
            quantiser: Quantiser::of_step(0),
            intra: None,
            deblocking: 0,
            groups: Vec::new(),
        };
        let planes = coefficients(&source, &mut form, check)?;
        Ok(DctEncoder { source, params: *params, form, planes, check })
    }

    /// The texture of that step, a number up to [`MAX_STEP`], deblocked as it is best.
    ///
    /// # Errors
    /// [`EncodeError`] where the job was cancelled.
    pub fn at_step(&self, step: u16) -> Result<DctTexture, EncodeError> {
        self.deblocked(code(&self.planes, &self.form_at(step), self.looks(), self.check)?)
    }

    /// As [`DctEncoder::at_step`], deblocked weakly: that takes the most bits.
    pub(super) fn measurable_at_step(&self, step: u16) -> Result<DctTexture, EncodeError> {
        Ok(code(&self.planes, &self.form_at(step), self.looks(), self.check)?.with_deblocking(1))
    }

    /// Bits and errors of [`DctEncoder::at_step`], estimated from a part of the superblocks.
    pub(super) fn estimate(&self, step: u16) -> Result<Estimate, EncodeError> {
        estimate(&self.planes, &self.form_at(step), self.params.metric, self.check)
    }

    /// Bits of [`DctEncoder::at_step`], guessed from the sizes of some coefficients. `None` with a cut-out, whose alpha takes other bits, and at
    /// effort fast: its search ends anywhere within 1 % of the bits, so that another begin gives another result.
    pub(super) fn guessed_bits(&self, step: u16) -> Option<f64> {
        let form = self.form_at(step);
        let plane = self
            .planes
            .first()
            .filter(|plane| plane.cutout.is_none() && self.params.effort != Effort::Fast)?;
        let steps = Steps::new(&form.quantiser, 0, form.fraction());
        let inverse: Block = std::array::from_fn(|at| if at > 0 { 1.0 / steps.size(at) } else { 0.0 });
        let blocks = plane.blocks.chunks_exact(form.channels());
        let stride = (blocks.len() / GUESSED).max(1);
        let share = blocks.len() as f64 / blocks.len().div_ceil(stride).max(1) as f64;
        let sizes = blocks.step_by(stride).flatten().map(|block| f64::from(intra::size(block, &inverse)));
        Some(SIZE_BITS * share * sizes.sum::<f64>())
    }

    /// Occurrences of symbols at a step.
    #[cfg(test)]
    pub(crate) fn counts(&self, step: u16) -> super::symbols::Counts {
        super::code::counts(&self.planes, &self.form_at(step), self.looks())
    }

    /// As [`DctEncoder::at_step`], with the bits of each 8x8 block, row by row: those of its own symbols, and an equal share of
    /// those of all means; what is beside them, header, tables and index, is left out.
    ///
    /// # Errors
    /// As there.
    pub fn at_step_with_bits(&self, step: u16) -> Result<(DctTexture, Vec<f32>), EncodeError> {
        let (texture, bits) = code_with_bits(&self.planes, &self.form_at(step), self.looks(), self.check)?;
        Ok((self.deblocked(texture)?, bits))
    }

    /// The texture deblocked as it is best.
    pub(super) fn deblocked(&self, texture: DctTexture) -> Result<DctTexture, EncodeError> {
        // The first plane is the image.
        let Some(image) = self.planes.first() else { return Ok(texture) };
        let stride = if self.params.effort == Effort::Fast { FAST_STRIDE } else { 1 };
        deblocked(texture, image, Tried { most: strongest(self.params.metric), stride }, self.check)
    }

    /// The step at which the encoder takes a bit to be worth a squared error of `lambda`, summed over the channels, in 8-bit units.
    #[must_use]
    pub fn step_of(&self, lambda: f64) -> u16 {
        step_of(lambda, unit_of(self.source.depth))
    }

    fn form_at(&self, step: u16) -> DctForm {
        let mut form = self.form.clone();
        let size = Quantiser::of_step(step.min(MAX_STEP)).step_size() / unit_of(self.source.depth);
        form.quantiser.step = step.min(MAX_STEP);
        form.quantiser.slope = slope(self.params.metric, size);
        if self.planes.first().is_some_and(|plane| plane.cutout.is_some()) {
            form.quantiser.step = (form.quantiser.step + cutout::SCALE_LOG2 * OCTAVE_STEPS).min(MAX_STEP);
            cutout::weigh(&mut form, size);
        }
        form
    }

    fn looks(&self) -> Looks {
        let passes = match self.params.effort {
            Effort::Fast => 1,
            Effort::Normal => 2,
            Effort::High => 3,
        };
        Looks { passes, metric: self.params.metric }
    }

    /// The texture that meets the goal: the best one within its bits, or the smallest one within its error.
    ///
    /// # Errors
    /// [`EncodeError`] where the job was cancelled or no step meets the goal.
    pub fn encode(&self) -> Result<DctTexture, EncodeError> {
        self.encode_for(self.params.goal)
    }

    /// As [`DctEncoder::encode`] for another goal.
    ///
    /// # Errors
    /// As there.
    pub fn encode_for(&self, goal: Goal) -> Result<DctTexture, EncodeError> {
        goal.check()?;
        let texels = self.source.size.texels();
        let found = search_step_estimated(
            goal,
            STEPS.at(self.params.effort),
            guessed_step(goal, self.first_step(), texels, |step| self.guessed_bits(step)),
            |step| Ok::<_, EncodeError>(self.estimate(step)?.measured(texels)),
            |step| {
                let texture = match goal {
                    Goal::Bpp(_) => self.measurable_at_step(step)?,
                    _ => self.at_step(step)?,
                };
                let measured = self.measured(&texture, goal);
                Ok((texture, measured))
            },
        )?;
        let found = found.filter(|found| found.met).ok_or(SourceError::OutOfReach {
            what: "no step meets the goal: header, index and tables take more bits, or rounding more error",
        })?;
        match goal {
            Goal::Bpp(_) => self.deblocked(found.value),
            _ => Ok(found.value),
        }
    }

    /// The step to begin a search with where nothing is known.
    pub(super) fn first_step(&self) -> u16 {
        first_step(self.source.depth)
    }

    /// A texture's measurement in the unit of the goal; the others are 0.
    fn measured(&self, texture: &DctTexture, goal: Goal) -> Measured {
        let mut measured = Measured::default();
        match goal {
            Goal::Bpp(_) => {
                measured.bpp = 8.0 * texture.to_bytes().len() as f64 / self.source.size.texels() as f64;
            }
            Goal::Psnr(_) => measured.psnr = psnr(&self.source, texture),
            Goal::Tolerance(_) => measured.worst_block_rms = worst_block_rms(&self.source, texture),
        }
        measured
    }
}

/// The step at which a bit is worth a squared error of `lambda`, summed over the channels, in 8-bit units, of which a sample has
/// `unit`.
#[must_use]
pub fn step_of(lambda: f64, unit: f64) -> u16 {
    Quantiser::nearest_step((lambda / f64::from(LAMBDA)).sqrt() * unit)
}

/// The squared error that a bit is worth at that step, in units of the samples: the inverse of [`DctEncoder::step_of`] for samples
/// of 8 bits.
#[must_use]
pub fn lambda_of(step: u16) -> f64 {
    let size = Quantiser::of_step(step).step_size();
    f64::from(LAMBDA) * size * size
}

/// Of so many superblocks one says how strongly all are deblocked where time is short.
const FAST_STRIDE: usize = 4;

/// First step of a search, in 8-bit units.
const FIRST_STEP: f64 = 24.0;

/// A unit of 8-bit samples in those of that depth.
pub(super) fn unit_of(depth: u8) -> f64 {
    if depth > 8 { 257.0 } else { 1.0 }
}

/// The number of the step to begin a search with, for samples of so many bits.
#[must_use]
pub fn first_step(depth: u8) -> u16 {
    Quantiser::nearest_step(FIRST_STEP * unit_of(depth))
}

/// The step at which guessed bits of so many texels meet a goal of bits, to begin a search with; `first` for other goals and where there is
/// no guess.
pub(super) fn guessed_step(goal: Goal, first: u16, texels: u64, bits: impl Fn(u16) -> Option<f64>) -> u16 {
    if !matches!(goal, Goal::Bpp(_)) {
        return first;
    }
    let scale = StepScale { near: GUESS_NEAR, jump: OCTAVE_STEPS / 4, ..STEPS };
    let measured = |step: u16| {
        let bpp = bits(step).ok_or(())? / texels as f64;
        Ok::<_, ()>((step, Measured { bpp, ..Measured::default() }))
    };
    search_step(goal, scale, first, measured).ok().flatten().map_or(first, |found| found.value)
}

/// The numbers of steps, for a search that ends within 0.2 % of the bits or 0.02 dB.
pub const STEPS: StepScale = StepScale { octave: OCTAVE_STEPS, most: MAX_STEP, near: 0.003, jump: 1 };

#[cfg(test)]
mod tests {
    use texfold_core::ImageSize;
    use texfold_core::rng::Rng;

    use super::*;

    #[test]
    fn a_part_of_the_image_says_what_the_whole_takes() {
        let size = ImageSize { width: 400, height: 352 };
        let mut rng = Rng::new(9);
        let sample = |at: u32| {
            let (x, y) = (f64::from(at / 3 % 400), f64::from(at / 1200));
            let wave = 100.0 + 60.0 * (x / 23.0 + y / 90.0).sin() * (y / 17.0).cos();
            (wave + f64::from(at % 3) * 12.0 + rng.unit() * (2.0 + 8.0 * x / 400.0)) as u8
        };
        let samples: Vec<u8> = (0..3 * 400 * 352).map(sample).collect();
        let source = DctSource::from_u8(size, &[3], &samples).unwrap();
        for metric in [Metric::Psnr, Metric::Perceptual] {
            let params = DctSettings::default().with_metric(metric);
            let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
            for step in [700, 900, 1100] {
                let texture = encoder.at_step(step).unwrap();
                let wanted = (encoder.measured(&texture, Goal::Bpp(1.0)).bpp, psnr(&source, &texture));
                let found = encoder.estimate(step).unwrap().measured(size.texels());
                let ratio = found.bpp / wanted.0;
                assert!((0.8..1.1).contains(&ratio), "{metric:?} {step}: {} bits of {}", found.bpp, wanted.0);
                assert!(
                    (found.psnr - wanted.1).abs() < 1.2,
                    "{metric:?} {step}: {} dB, {}",
                    found.psnr,
                    wanted.1
                );
            }
        }
    }

    #[test]
    fn estimates_hold_where_few_superblocks_are_busy() {
        let size = ImageSize { width: 512, height: 512 };
        let mut rng = Rng::new(3);
        let busy: Vec<bool> = (0..256).map(|_| rng.below(16) == 0).collect();
        let sample = |at: u32| {
            let (x, y) = (at % 512, at / 512);
            let noise = if busy[(y / 32 * 16 + x / 32) as usize] { 100 } else { 8 };
            (60 + x / 8 + rng.below(noise)) as u8
        };
        let samples: Vec<u8> = (0..512 * 512).map(sample).collect();
        let source = DctSource::from_u8(size, &[1], &samples).unwrap();
        let params = DctSettings::default().with_metric(Metric::Psnr).with_effort(Effort::Fast);
        let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
        for step in [1200, 1500, 1800] {
            let texture = encoder.at_step(step).unwrap();
            let (bpp, psnr) = (encoder.measured(&texture, Goal::Bpp(1.0)).bpp, psnr(&source, &texture));
            let found = encoder.estimate(step).unwrap().measured(size.texels());
            assert!((found.bpp / bpp - 1.0).abs() < 0.08, "{step}: {} bits of {bpp}", found.bpp);
            assert!((found.psnr - psnr).abs() < 0.5, "{step}: {} dB of {psnr}", found.psnr);
        }
    }

    #[test]
    fn slopes_grow_with_the_step_and_not_for_psnr() {
        let slopes: Vec<u8> =
            (0..12).map(|octave| slope(Metric::Perceptual, f64::from(1 << octave))).collect();
        assert!(slopes.is_sorted() && slopes[0] == SLOPE && f64::from(slopes[11]) == MOST_SLOPE);
        assert_eq!(slope(Metric::Perceptual, 2.0 * SLOPE_FROM), SLOPE + SLOPE_OCTAVE as u8);
        assert_eq!(slope(Metric::Psnr, 100.0), 0);
    }
}

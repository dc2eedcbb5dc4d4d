//! Images and their stages that share a step, so that errors are alike in all of them.

use texfold_core::{CancelCheck, EncodeError, Goal, ImageLayout, SourceError};

use super::code::Estimate;
use super::goal::{DctEncoder, DctSettings, first_step, guessed_step, unit_of};
use super::source::DctSource;
use crate::content::{DctContent, stage_sizes};
use crate::decode::DctTexture;
use crate::form::OCTAVE_STEPS;

/// How much finer each stage is coded than the one before, in steps (256 an octave): 4.5 dB, for a 64th of the texels. With few
/// texels, errors of single ones show.
pub const STAGE_FINER: u16 = 192;

/// The coefficients of the stages of several images, from which content for any goal is made.
#[derive(Debug)]
pub struct DctSetEncoder<'a> {
    layout: ImageLayout,
    stages: Vec<Stage<'a>>,
}

#[derive(Debug)]
struct Stage<'a> {
    encoder: DctEncoder<'a>,
    /// What is added to the set's step, in steps: the same error in parts of the range, divided by the root of its weight.
    offset: i32,
}

/// A stage of a map, and how it is coded.
#[derive(Debug)]
pub(super) struct MapStage {
    pub(super) source: DctSource,
    pub(super) settings: DctSettings,
    /// Weight of squared errors.
    pub(super) weight: f64,
}

impl<'a> DctSetEncoder<'a> {
    /// Transforms the stages ([`crate::stage_sizes`]) of the images of that layout, one image after the other; a source is dropped
    /// before the next is taken.
    ///
    /// # Errors
    /// [`EncodeError`] where there is no image, for a parameter out of range, where the job was cancelled, and those of the sources.
    pub fn new(
        layout: ImageLayout,
        sources: impl IntoIterator<Item = Result<DctSource, EncodeError>>,
        params: &DctSettings,
        check: CancelCheck<'a>,
    ) -> Result<Self, EncodeError> {
        let stages = sources
            .into_iter()
            .map(|source| Ok(MapStage { source: source?, settings: *params, weight: 1.0 }));
        DctSetEncoder::of_maps(layout, stages, check)
    }

    /// As [`DctSetEncoder::new`], of stages with settings and weights of their own. The step of a set is that of its first stage.
    pub(super) fn of_maps(
        layout: ImageLayout,
        stages: impl IntoIterator<Item = Result<MapStage, EncodeError>>,
        check: CancelCheck<'a>,
    ) -> Result<Self, EncodeError> {
        let mut first = None;
        let mut stage = |stage: Result<MapStage, EncodeError>| {
            let MapStage { source, settings, weight } = stage?;
            let unit = unit_of(source.depth) / weight.sqrt();
            let offset = f64::from(OCTAVE_STEPS) * (unit / *first.get_or_insert(unit)).log2();
            let encoder = DctEncoder::of_steps(source, &settings, check)?;
            Ok(Stage { encoder, offset: offset.round() as i32 })
        };
        let stages = stages.into_iter().map(&mut stage).collect::<Result<Vec<_>, EncodeError>>()?;
        if stages.is_empty() {
            return Err(SourceError::Empty.into());
        }
        Ok(DctSetEncoder { layout, stages })
    }

    /// All images with that step, a number up to [`crate::MAX_STEP`], and each further stage three quarters of an octave finer.
    ///
    /// # Errors
    /// [`EncodeError`] where the job was cancelled, or images do not fit the layout.
    pub fn at_step(&self, step: u16) -> Result<DctContent, EncodeError> {
        let stages = self.stages_at(step).map(|(encoder, step)| encoder.at_step(step));
        self.content(stages.collect::<Result<_, _>>()?)
    }

    /// As [`DctSetEncoder::at_step`], deblocked weakly: that takes the most bits.
    pub(super) fn measurable_at_step(&self, step: u16) -> Result<DctContent, EncodeError> {
        let stages = self.stages_at(step).map(|(encoder, step)| encoder.measurable_at_step(step));
        self.content(stages.collect::<Result<_, _>>()?)
    }

    /// Content of this encoder deblocked as it is best.
    pub(super) fn deblocked(&self, content: DctContent) -> Result<DctContent, EncodeError> {
        let stages = self.stages.iter().zip(content.into_stages());
        let stages = stages.map(|(stage, texture)| stage.encoder.deblocked(texture));
        self.content(stages.collect::<Result<_, _>>()?)
    }

    /// Bits and errors of [`DctSetEncoder::at_step`], estimated from a part of the superblocks; errors are those of first stages.
    ///
    /// # Errors
    /// [`EncodeError`] where the job was cancelled.
    pub fn estimate(&self, step: u16) -> Result<Estimate, EncodeError> {
        let mut sum = Estimate::default();
        for ((encoder, step), number) in self.stages_at(step).zip(self.numbers()) {
            let found = encoder.estimate(step)?;
            sum.bits += found.bits;
            if number == 0 {
                sum.squared_error = sum.squared_error + found.squared_error;
            }
        }
        Ok(sum)
    }

    /// Each stage's number in its image.
    fn numbers(&self) -> impl Iterator<Item = usize> {
        let counts = self.layout.images.iter().map(|&size| stage_sizes(size, self.layout.levels).len());
        counts.flat_map(|count| 0..count)
    }

    /// Each stage, and its step where that of the set is `step`.
    fn stages_at(&self, step: u16) -> impl Iterator<Item = (&DctEncoder<'a>, u16)> {
        self.stages.iter().zip(self.numbers()).map(move |(stage, number)| {
            let finer = i32::from(STAGE_FINER) * number as i32;
            let step = i32::from(step) + stage.offset - finer;
            (&stage.encoder, step.clamp(0, i32::from(u16::MAX)) as u16)
        })
    }

    fn content(&self, stages: Vec<DctTexture>) -> Result<DctContent, EncodeError> {
        let unlike = SourceError::Unlike { index: 0, what: "its size or channels" };
        DctContent::new(self.layout.clone(), stages).ok_or(unlike.into())
    }

    /// As [`DctEncoder::step_of`].
    #[must_use]
    pub fn step_of(&self, lambda: f64) -> u16 {
        self.stages.first().map_or(0, |stage| stage.encoder.step_of(lambda))
    }

    /// The step to begin a search for a goal with.
    #[must_use]
    pub fn first_step(&self, goal: Goal) -> u16 {
        let first = self.stages.first().map_or(first_step(8), |stage| stage.encoder.first_step());
        let bits = |step| self.stages_at(step).map(|(encoder, step)| encoder.guessed_bits(step)).sum();
        let texels = self.layout.images.iter().map(|size| size.texels()).sum();
        guessed_step(goal, first, texels, bits)
    }
}

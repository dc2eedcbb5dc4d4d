//! Images by block: all tiles with one step, with which the image as a whole answers the goal.
//!
//! A step a tile would give each the same PSNR, smooth ones finer steps than they need beside rough ones: more bits for the
//! same errors of the image, and noise that changes where tiles meet. The image is read once for each step that is measured,
//! so that no more than a tile of it is held, beside tiles as they are encoded.

use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::{SquaredError, quality};
use texfold_core::target::{FoundStep, Measured};
use texfold_core::{EncodeError, Encoded, Goal, ImageSize, Job};
use texfold_dct::{Dct, DctImages, DctParams};

use super::{Seen, SourceTile, TileSource, WriteError};

/// Most bytes of encoded tiles that are kept of a step.
const KEPT_BYTES: u64 = 96 << 20;

/// The errors and bits of tiles at a step: those of several are added up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepErrors {
    /// Bits that goals count.
    pub bits: u64,
    /// Texels.
    pub texels: u64,
    /// Error of colours; of no texel where the goal is one of bits, which needs no decoding.
    pub color: SquaredError,
    /// RMS error of the worst 4x4 block, in 8-bit units.
    pub worst_block_rms: f64,
}

impl StepErrors {
    /// Both together.
    #[must_use]
    pub fn and(self, other: StepErrors) -> StepErrors {
        StepErrors {
            bits: self.bits + other.bits,
            texels: self.texels + other.texels,
            color: self.color + other.color,
            worst_block_rms: self.worst_block_rms.max(other.worst_block_rms),
        }
    }

    /// What a goal is held against.
    #[must_use]
    pub fn measured(&self) -> Measured {
        Measured {
            psnr: self.color.psnr(),
            bpp: self.bits as f64 / self.texels.max(1) as f64,
            worst_block_rms: self.worst_block_rms,
        }
    }
}

impl std::iter::Sum for StepErrors {
    fn sum<I: Iterator<Item = StepErrors>>(all: I) -> StepErrors {
        all.fold(StepErrors::default(), StepErrors::and)
    }
}

/// A tile as it is encoded by block: without alpha where all of it is opaque, its errors held against `peak`
/// ([`Raster::peak`]), the image's largest.
#[must_use]
pub fn block_source(tile: Raster, peak: f32) -> ImageSet {
    ImageSet::single(without_plain_alpha(tile.with_peak(peak)))
}

/// The tile without alpha where all of it is opaque: it would have to be stored.
#[doc(hidden)]
#[must_use]
pub fn without_plain_alpha(tile: Raster) -> Raster {
    let opaque = tile.info().has_alpha() && tile.texels().all(|texel| texel.w >= 1.0);
    if opaque { tile.with_channels(tile.info().channels - 1) } else { tile }
}

/// The errors and bits of a tile ([`block_source`]) at a step, and the tile as [`block_tile`] takes it.
///
/// # Errors
/// [`EncodeError`].
pub fn step_errors(
    set: &ImageSet,
    params: &DctParams,
    step: u16,
) -> Result<(DctImages, StepErrors), EncodeError> {
    let images = Dct::encode_at_step(set, params, step, &mut Job::default())?;
    let mut errors =
        StepErrors { bits: images.memory().goal, texels: set.texel_count(), ..StepErrors::default() };
    if !matches!(params.goal, Goal::Bpp(_)) {
        let found = quality(set, &images);
        (errors.color, errors.worst_block_rms) = (found.color, found.worst_block_rms);
    }
    Ok((images, errors))
}

/// A tile ([`block_source`]) at the step of its image; `met`: whether the image answers the goal.
///
/// # Errors
/// [`EncodeError`].
pub fn block_tile(
    set: &ImageSet,
    params: &DctParams,
    step: u16,
    met: bool,
) -> Result<DctImages, EncodeError> {
    let images = Dct::encode_at_step(set, params, step, &mut Job::default())?;
    images.described(set, params, met, &Job::default())
}

/// Searches the step with which the tiles of an image together just meet the goal: the step, whether it does, and what `all` made at it. `all` gives
/// their errors at a step; the parts of tiles in `seen` say before where to look, so that it is asked for two steps mostly.
///
/// # Errors
/// [`WriteError::Encode`], and those of `all`.
pub fn search_tiles<T, E: From<WriteError>>(
    params: &DctParams,
    seen: &Seen,
    mut all: impl FnMut(u16) -> Result<(T, StepErrors), E>,
) -> Result<(u16, bool, T), E> {
    let samples: Vec<ImageSet> =
        seen.samples.iter().map(|sample| block_source(sample.clone(), seen.peak)).collect();
    let estimate = |step| {
        let errors = samples.iter().map(|sample| Ok(step_errors(sample, params, step)?.1));
        let sum = errors.sum::<Result<StepErrors, EncodeError>>().map_err(WriteError::from)?;
        Ok::<_, E>(sum.measured())
    };
    let at_step = |step| {
        let (made, errors) = all(step)?;
        Ok::<_, E>(((step, made), errors.measured()))
    };
    let found = match samples.is_empty() {
        true => Dct::search_step(params.goal, params.effort, seen.depth, at_step)?,
        false => Dct::search_step_estimated(params.goal, params.effort, seen.depth, estimate, at_step)?,
    };
    let FoundStep { value: (step, made), met, .. } = found.ok_or(WriteError::Changed)?;
    Ok((step, met, made))
}

/// The step of an image, and its tiles as the search has made them.
#[derive(Debug)]
pub struct FoundBlocks {
    /// The step.
    pub step: u16,
    /// Whether the image meets the goal.
    pub met: bool,
    /// All tiles, where they take at most [`KEPT_BYTES`].
    kept: Option<Vec<DctImages>>,
}

/// As [`search_tiles`], reading a source once for each step that is measured. It holds two steps' encoded tiles, of up to 96 MB each.
///
/// # Errors
/// [`WriteError::Encode`], and those of the source.
pub fn search_blocks<S: TileSource>(
    source: &S,
    params: &DctParams,
    seen: &Seen,
) -> Result<FoundBlocks, S::Error> {
    let (step, met, kept) = search_tiles(params, seen, |step| {
        let (mut all, mut kept, mut bits) = (StepErrors::default(), Some(Vec::new()), 0);
        source.each_tile(0, &mut |SourceTile { texels, .. }| {
            let found = step_errors(&block_source(texels, seen.peak), params, step);
            let (images, errors) = found.map_err(WriteError::from)?;
            all = all.and(errors);
            bits += images.memory().compressed;
            kept = kept.take().filter(|_| bits <= 8 * KEPT_BYTES);
            if let Some(kept) = &mut kept {
                kept.push(images);
            }
            Ok(())
        })?;
        Ok::<_, S::Error>((kept, all))
    })?;
    Ok(FoundBlocks { step, met, kept })
}

/// Hands the tiles of a source to `take`, at the step that [`search_blocks`] found: their places, as they were encoded, and encoded, which is not done
/// again where the search has kept them; the size of the image.
///
/// # Errors
/// [`WriteError::Encode`], and those of the source and of `take`.
pub fn encode_blocks<S: TileSource>(
    source: &S,
    params: &DctParams,
    FoundBlocks { step, met, kept }: FoundBlocks,
    seen: &Seen,
    mut take: impl FnMut((u32, u32), ImageSet, DctImages) -> Result<(), S::Error>,
) -> Result<ImageSize, S::Error> {
    let mut kept = kept.map(Vec::into_iter);
    source.each_tile(0, &mut |SourceTile { place, texels, .. }| {
        let set = block_source(texels, seen.peak);
        let images = match &mut kept {
            Some(kept) => {
                let is_same = |images: &DctImages| images.layout().images == [set.images()[0].size()];
                let images = kept.next().filter(is_same).ok_or(WriteError::Changed)?;
                images.described(&set, params, met, &Job::default())
            }
            None => block_tile(&set, params, step, met),
        };
        take(place, set, images.map_err(WriteError::from)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::Effort;

    #[test]
    fn tiles_that_a_search_kept_are_those_that_are_encoded_anew() {
        let image = texfold_testkit::strokes((1320, 40), 3, 5);
        let params = DctParams::default().with_goal(Goal::Psnr(32.0)).with_effort(Effort::Fast);
        let seen = Seen { peak: 1.0, ..Seen::default() };
        let files = |found: FoundBlocks| {
            let mut files = Vec::new();
            let size = encode_blocks(&image, &params, found, &seen, |place, _, images| {
                files.push((place, crate::file_of(&images)));
                Ok(())
            });
            assert_eq!(size.unwrap(), image.size());
            files
        };
        let found = search_blocks(&image, &params, &seen).unwrap();
        assert!(found.met && found.kept.as_ref().is_some_and(|kept| kept.len() == 2));
        let anew = FoundBlocks { step: found.step, met: found.met, kept: None };
        let found = files(found);
        assert!(found.len() == 2 && found == files(anew));
        // Of an image that has changed.
        let found = search_blocks(&image, &params, &seen).unwrap();
        let other = texfold_testkit::strokes((1300, 40), 3, 5);
        let changed = encode_blocks(&other, &params, found, &seen, |_, _, _| Ok(()));
        assert!(matches!(changed, Err(WriteError::Changed)));
    }
}

//! Incremental codewords (paper section 4.2): a block joins a codeword within tolerance, else it becomes one.
//!
//! Used for tolerance goals, where it bounds the error of every block, and for frames that are added later.

use texfold_bc::Content;
use texfold_codebook::Leaders;
use texfold_core::{EncodeError, SourceError};

use super::assemble::{Draft, assign};
use super::plan::MAX_CELLS;
use super::samples::{SampleSpec, sample_windows};
use super::single::{Prepared, by_brightness, usual_side};
use crate::VqTexture;
use crate::grid::{CodebookPart, Grid};

/// Rounding of a codeword to 8 bits moves a texel by at most half a step; sources of 8 bits are not moved at all.
const ROUNDING_RMS: f64 = 0.5;

/// Blocks that are looked at between two looks at whether to go on.
pub(crate) const ROWS_A_LOOK: usize = 256;

/// Squared distance of block vectors of `dims` numbers for an RMS error in 8-bit units.
pub(crate) fn squared_reach(rms: f64, dims: usize) -> f32 {
    ((rms / 255.0).powi(2) * dims as f64) as f32
}

/// The smallest codebook found whose every block is within `tolerance` (8-bit RMS): with the usual samples or
/// without, whichever needs fewer cells.
pub(crate) fn encode(
    prepared: &Prepared<'_>,
    content: Content,
    tolerance: f64,
) -> Result<VqTexture, EncodeError> {
    let eight_bit = prepared.layout.pixel.depth == texfold_core::image::Depth::Eight && !prepared.params.mips;
    let reach = if eight_bit { tolerance } else { (tolerance - ROUNDING_RMS).max(0.0) };
    let plain = draft(prepared, &[], reach)?;
    let usual = SampleSpec { count: 1, side: usual_side(plain.grid) };
    let samples = prepared.choose_samples(plain.grid, prepared.chosen_samples().unwrap_or(usual))?;
    let sampled = match samples[..] {
        [] => None,
        _ => fitting(draft(prepared, &samples, reach))?,
    };
    let draft = sampled.filter(|sampled| sampled.grid.cells() < plain.grid.cells()).unwrap_or(plain);
    let storage = prepared.storage(content, prepared.params.effort, false);
    let stored = draft.store(prepared.images(), storage, prepared.cancel)?;
    let all: Vec<usize> = (0..prepared.blocks.len()).collect();
    let matches = assign(&prepared.blocks, &all, stored.windows.view(), prepared.cancel)?;
    Ok(prepared.texture(&draft, stored, &matches))
}

/// A draft, or none where it is too large for a codebook.
fn fitting(draft: Result<Draft, EncodeError>) -> Result<Option<Draft>, EncodeError> {
    match draft {
        Err(EncodeError::Source(SourceError::OutOfReach { .. })) => Ok(None),
        draft => draft.map(Some),
    }
}

fn draft(prepared: &Prepared<'_>, samples: &[CodebookPart], rms: f64) -> Result<Draft, EncodeError> {
    let dims = prepared.blocks.vectors.ncols();
    let reach = squared_reach(rms, dims);
    let side = samples.iter().map(|part| part.side).max().unwrap_or(0);
    let sample_cells: u32 = samples.iter().map(|part| part.side * part.side / 16).sum();
    let mut leaders = Leaders::new(prepared.blocks.view());
    let windows = sample_windows(prepared.images(), samples);
    let search = (!samples.is_empty()).then(|| texfold_codebook::Search::new(windows.view()));
    for row in 0..prepared.blocks.len() {
        if row.is_multiple_of(ROWS_A_LOOK) {
            prepared.cancel.checkpoint()?;
        }
        let block = prepared.blocks.vector(row);
        if search.as_ref().is_some_and(|search| search.nearest(block, reach).is_some()) {
            continue;
        }
        leaders.join_or_add(block, reach);
        if leaders.len() as u32 + sample_cells > MAX_CELLS {
            let what = "a vq codebook of 4096 cells cannot hold this tolerance";
            return Err(SourceError::OutOfReach { what }.into());
        }
    }
    let codewords = by_brightness(leaders.into_codewords());
    let cells = codewords.nrows() as u32 + sample_cells;
    let grid = Grid::covering(cells.max(1), side / 4);
    Ok(Draft { grid, samples: samples.to_vec(), codewords })
}

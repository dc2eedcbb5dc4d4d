//! Incremental codewords (paper section 4.2): a block joins a codeword within tolerance, else it becomes one.
//!
//! Used for tolerance goals, where it bounds the error of every block, and for frames that are added later.

use texfold_bc::Content;
use texfold_codebook::Leaders;
use texfold_core::{EncodeError, SourceError};

use super::assemble::{Draft, assign};
use super::plan::{Grid, MAX_CELLS};
use super::samples::sample_windows;
use super::single::Prepared;
use crate::VqTexture;
use crate::encoded::CodebookPart;

/// Rounding of a codeword to 8 bits moves a texel by at most half a step; sources of 8 bits are not moved at all.
const ROUNDING_RMS: f64 = 0.5;

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
    let plain = draft(prepared, &[], reach);
    let samples = plain.as_ref().ok().map_or_else(Vec::new, |draft| {
        let spec = prepared.params.samples.unwrap_or((1, super::single::usual_side(draft.grid)));
        prepared.choose_samples(draft.grid, spec)
    });
    let sampled = if samples.is_empty() { None } else { draft(prepared, &samples, reach).ok() };
    let draft = match (plain, sampled) {
        (Ok(plain), Some(sampled)) if sampled.grid.cells() < plain.grid.cells() => sampled,
        (Ok(plain), _) => plain,
        (Err(error), _) => return Err(error),
    };
    let stored =
        draft.store(prepared.images(), (prepared.layout.pixel, content), prepared.params.effort, false);
    let all: Vec<usize> = (0..prepared.blocks.len()).collect();
    let matches = assign(&prepared.blocks, &all, stored.windows.view());
    Ok(prepared.texture(&draft, stored, &matches))
}

fn draft(prepared: &Prepared<'_>, samples: &[CodebookPart], rms: f64) -> Result<Draft, EncodeError> {
    let dims = prepared.blocks.vectors.ncols();
    let reach = squared_reach(rms, dims);
    let side = samples.iter().map(|part| part.side).max().unwrap_or(0);
    let sample_cells: u32 = samples.iter().map(|part| part.side * part.side / 16).sum();
    let mut leaders = Leaders::new(prepared.blocks.view());
    let shown = sample_windows(prepared.images(), samples);
    let search = (!samples.is_empty()).then(|| texfold_codebook::Search::new(shown.view()));
    for row in 0..prepared.blocks.len() {
        let block = prepared.blocks.vector(row);
        if search.as_ref().is_some_and(|search| search.nearest(block, reach).is_some()) {
            continue;
        }
        leaders.join_or_add(block, reach);
        if leaders.len() as u32 + sample_cells > MAX_CELLS {
            return Err(SourceError::Full { what: "the codebook of 4096 cells at this tolerance" }.into());
        }
    }
    let codewords = super::single::by_brightness(leaders.into_codewords());
    let cells = codewords.nrows() as u32 + sample_cells;
    let grid = Grid::covering(cells.max(1), side / 4);
    Ok(Draft { grid, samples: samples.to_vec(), codewords })
}

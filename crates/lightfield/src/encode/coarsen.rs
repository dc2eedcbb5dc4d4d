//! As few triangles and view maps as a scene needs: the mesh is part of the model. Maps on larger triangles are as fine, and fewer vertices have
//! view maps, so a coarser mesh is a smaller file, until it no longer has the object's shape. Where a PSNR is asked for, vertices share view
//! maps if these reach it in less memory.

use rayon::prelude::*;
use texfold_core::{CancelCheck, EncodeError, Encoded, Job, Notes};

use super::simplify::simplified_unless;
use super::squares::Squares;
use super::{LightQuality, encode, few_views};
use crate::params::LightParams;
use crate::{Capture, LightTexture, Lightfield, Photograph, Renderer};

/// Fewest triangles that are tried.
const LEAST: usize = 256;
/// Photographs that are drawn again to compare meshes, spread over the capture.
const VIEWS: usize = 8;
/// What half of the triangles may lose in dB.
const LOSS: f64 = 0.25;

impl Lightfield {
    /// As [`Lightfield::encode_measured`], on a mesh of as few triangles as the photographs need: half of them, and half again, while
    /// that reconstructs some photographs at [`LightParams::psnr`] or loses less than a quarter of a dB. With a PSNR and otherwise the usual
    /// model and storage, the vertices of 6, 24 or 96 regions share view maps in BC1, and places share codewords, where that reaches the PSNR in less memory.
    ///
    /// # Errors
    /// As [`texfold_core::Encoder::encode`].
    pub fn encode_simplified(
        source: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<(LightTexture, LightQuality), EncodeError> {
        encode_simplified(source, params, job)
    }
}

/// The capture on its mesh, or on the coarsest of a half, a quarter and so on of its triangles that reconstructs the photographs at the
/// goal or loses little against the one before.
fn encode_simplified(
    capture: &Capture,
    params: &LightParams,
    job: &mut Job<'_>,
) -> Result<(LightTexture, LightQuality), EncodeError> {
    let all = capture.mesh.triangles.len();
    let cancel = job.cancel_check();
    let own = job.within(0.0, 0.3, |job| encode(capture, params, job))?;
    let shared = job.within(0.3, 0.5, |job| match own.0.layout().terms {
        0 => Ok(None),
        _ => few_views::encode(capture, params, None, job),
    })?;
    let missed = params.psnr.is_some_and(|goal| own.1.psnr < goal);
    let bits = |texture: &LightTexture| texture.memory().compressed;
    let shared = shared.filter(|(_, (texture, _))| missed || bits(texture) < bits(&own.0));
    let regions = shared.as_ref().map(|(regions, _)| *regions);
    let (mut texture, mut quality) = shared.map_or(own, |(_, shared)| shared);
    let mut psnr = job.install(|| reconstructed(&texture, &capture.views, cancel));
    job.checkpoint()?;
    let mut tried: Option<Capture> = None;
    for halvings in (1..).take_while(|&halvings| all >> halvings >= LEAST) {
        let tried = tried.get_or_insert_with(|| capture.clone());
        tried.mesh = simplified_unless(&capture.mesh, all >> halvings, cancel);
        job.checkpoint()?;
        let share = |halvings: u32| 1.0 - 0.5f32.powi(halvings as i32);
        let made = job.within(share(halvings), share(halvings + 1), |job| match regions {
            Some(_) => {
                few_views::encode(tried, params, regions, job).map(|found| found.map(|(_, found)| found))
            }
            None => encode(tried, params, job).map(Some),
        });
        let (coarser, of_coarser) = match made {
            // A mesh may become too coarse to be seen, or for the goal.
            Err(EncodeError::Codec { .. }) | Ok(None) => break,
            Ok(Some(made)) => made,
            Err(error) => return Err(error),
        };
        let found = job.install(|| reconstructed(&coarser, &capture.views, cancel));
        job.checkpoint()?;
        let is_enough = params.psnr.is_some_and(|goal| found >= goal) || found >= psnr - LOSS;
        if !is_enough {
            break;
        }
        (texture, quality, psnr) = (coarser, of_coarser, found);
    }
    let texture = noted(texture, all, psnr);
    job.stage("done", 1.0)?;
    Ok((texture, quality))
}

/// PSNR in dB of some photographs drawn again, over the pixels that their masks keep; what the mesh does not cover is black. Of no
/// use once the job is cancelled.
fn reconstructed(texture: &LightTexture, views: &[Photograph], cancel: CancelCheck<'_>) -> f64 {
    let renderer = Renderer::new(texture);
    let step = views.len().div_ceil(VIEWS).max(1);
    let mut squares = Squares::default();
    for view in views.iter().step_by(step) {
        let width = view.camera.width as usize;
        let rows = view.pixels.par_chunks(width.max(1)).enumerate();
        let of_row = |(row, wanted): (usize, &[[u8; 4]])| {
            let mut drawn = vec![[0; 4]; wanted.len()];
            if !cancel.is_cancelled() {
                renderer.row(&view.camera, row, &mut drawn);
            }
            let mut squares = Squares::default();
            for (wanted, found) in wanted.iter().zip(&drawn).filter(|(wanted, _)| wanted[3] > 127) {
                let square = (0..3).map(|k| f64::from(wanted[k].abs_diff(found[k])).powi(2)).sum();
                squares.add(square, 3);
            }
            squares
        };
        // Sums of whole numbers: exact in any order.
        rows.map(of_row).collect::<Vec<Squares>>().into_iter().for_each(|row| squares.join(row));
    }
    10.0 * (65025.0 * squares.count.max(1) as f64 / squares.sum.max(1e-9)).log10()
}

/// The texture with a word on its mesh.
fn noted(texture: LightTexture, all: usize, psnr: f64) -> LightTexture {
    let count = texture.mesh().triangles.len();
    if count >= all {
        return texture;
    }
    let notes = texture.notes().clone();
    let verdict =
        format!("{} {count} of the {all} triangles show the photographs at {psnr:.2} dB.", notes.verdict);
    texture.with_notes(Notes { verdict, ..notes })
}

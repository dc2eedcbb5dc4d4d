//! In which formats content is stored, and how large blocks are then.

use texfold_bc::Content;
use texfold_bc::Family;
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::{Goal, ParamError};

use super::in_blocks::metric_of;
use super::pyramid::Storage;
use crate::EpitomeParams;

/// Side of a block whose leaves are chosen by rate and distortion, for content in planes.
const PLANE_BLOCK: u32 = 32;
/// The same for content in superblocks, whose cells have twice the side.
const SUPERBLOCK_BLOCK: u32 = 64;
/// Lambda that content with a residual plane or in blocks is first made for, in mean squared errors of a texel.
const FIRST_PRICE: f64 = 0.9;
/// The same where a size is requested.
const FIRST_GUESS: f32 = 40.0;

/// How content is stored.
pub(super) fn storages(pixel: PixelInfo, params: &EpitomeParams) -> Result<Vec<Storage>, ParamError> {
    let with_blocks = params.is_by_block();
    if !with_blocks && (params.family != Family::ErrorMap || params.content.is_some()) {
        return Ok(contents(pixel, params)?.into_iter().map(Storage::Planes).collect());
    }
    let lambda = match params.goal {
        Goal::Psnr(psnr) => 3.0 * 255.0 * 255.0 * FIRST_PRICE / 10f64.powf(psnr / 10.0),
        // Tolerances have no residual plane.
        Goal::Bpp(_) | Goal::Tolerance(_) => f64::from(FIRST_GUESS),
    };
    let metric = metric_of(params, pixel.color);
    if with_blocks {
        return Ok(vec![Storage::Blocks(lambda as f32, metric)]);
    }
    if !matches!(pixel.channels, 1 | 3) || pixel.color == ColorSpace::Normal {
        return Err(ParamError::new("channels", pixel.channels, "1 or 3 of colours, with a residual plane"));
    }
    // Hard edges between two colours are better off in plain blocks, all else by a residual plane. Both in one
    // texture need the same channels.
    let plain = (pixel.channels == 3).then_some(Storage::Planes(Content::Bc1));
    Ok(plain.into_iter().chain([Storage::ErrorMap(lambda as f32, metric)]).collect())
}

/// Formats that content is stored in.
fn contents(pixel: PixelInfo, params: &EpitomeParams) -> Result<Vec<Content>, ParamError> {
    // Blocks of a compressed format may break a tolerance by themselves.
    let usual = matches!(params.goal, Goal::Tolerance(_)).then_some(Content::Raw);
    if let Some(content) = params.content.or(usual) {
        let error = ParamError::new("channels", pixel.channels, "what the chosen content format can hold");
        return if content.fits(pixel) { Ok(vec![content]) } else { Err(error) };
    }
    Ok(match pixel.channels {
        1 => vec![Content::Bc4],
        2 => vec![Content::Bc5],
        3 if pixel.color == ColorSpace::Normal => vec![Content::Bc5],
        _ => vec![Content::Bc1, Content::Bc7],
    })
}

/// Side of a block for such content.
pub(super) fn block_of(storages: &[Storage]) -> u32 {
    let in_superblocks = storages.iter().any(|storage| matches!(storage, Storage::Blocks(..)));
    if in_superblocks { SUPERBLOCK_BLOCK } else { PLANE_BLOCK }
}

//! In which formats content is stored, and how large blocks are then.

use texfold_bc::Content;
use texfold_bc::Family;
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::{AstcBlock, Goal, ParamError};

use super::in_blocks::metric_of;
use super::pyramid::Storage;
use crate::EpitomeParams;

/// Side of a block whose leaves are chosen by rate and distortion: the first whose smallest leaves are whole cells of
/// all formats, where cells are larger than 4x4 texels; else the last.
const BLOCKS: [u32; 3] = [64, 48, 32];
/// ASTC content that is tried: at 1.7 bits a texel 6x6 is better than 8x8 by 2 dB where much repeats, and worse by as
/// much as 0.8 dB where little does. *Not taken*: 8x8 and 4x4 side by side, which is within 0.2 dB of 8x8 alone up to
/// 1.3 bits, and at 1.7 bits 0.8 dB below 6x6 where that is better.
pub(super) const ASTC: [AstcBlock; 2] = [AstcBlock::B8, AstcBlock::B6];
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
    let whole = |block: u32| storages.iter().all(|storage| (block / 4).is_multiple_of(storage.granularity()));
    let large = storages.iter().any(|storage| storage.granularity() > 4);
    BLOCKS.into_iter().find(|&block| large && whole(block)).unwrap_or(BLOCKS[2])
}

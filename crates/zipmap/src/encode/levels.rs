//! Mip levels of root and patches.
//!
//! A patch keeps its colours where it is transparent: they are blended with those beside them. Alpha is averaged by
//! itself, and is 0 on the border texels of every level (paper section 3), so that no seam shows and what is smaller
//! than a pixel vanishes.

use texfold_core::image::{Alpha, ColorSpace, MipFilter, PixelInfo, Raster, mip_chain_cancellable, to_u8};
use texfold_core::{CancelCheck, EncodeError, Texel};

use crate::parts::MAX_PATCH_LEVELS;

/// Sides up to which all texels are border.
const ALL_BORDER: u32 = 2;

fn bytes(texel: Texel) -> [u8; 4] {
    texel.to_array().map(to_u8)
}

/// The bytes of all texels of `image`, each as `texel` gives them, which is told its column and row.
fn bytes_of(
    image: &Raster,
    cancel: CancelCheck<'_>,
    texel: impl Fn(Texel, u32, u32) -> Texel,
) -> Result<Vec<[u8; 4]>, EncodeError> {
    let width = image.size().width.max(1);
    let mut all = Vec::new();
    all.reserve_exact(image.texels().len());
    for (index, colour) in image.texels().enumerate() {
        let (x, y) = (index as u32 % width, index as u32 / width);
        if x == 0 {
            cancel.checkpoint()?;
        }
        all.push(bytes(texel(colour, x, y)));
    }
    Ok(all)
}

/// All levels of the root that a file can hold.
pub(crate) fn of_root(
    root: &Raster,
    levels: u32,
    cancel: CancelCheck<'_>,
) -> Result<Vec<Vec<[u8; 4]>>, EncodeError> {
    let chain = mip_chain_cancellable(root, levels, MipFilter::Box, cancel)?;
    chain.iter().map(|level| bytes_of(level, cancel, |texel, _, _| texel)).collect()
}

/// Levels of a patch down to the last that has texels inside; none where the patch has none itself.
pub(crate) fn of_patch(
    texels: &[Texel],
    alpha: &[f32],
    (width, height): (u32, u32),
    info: PixelInfo,
    cancel: CancelCheck<'_>,
) -> Result<Vec<Vec<[u8; 4]>>, EncodeError> {
    let opaque = PixelInfo { channels: 3, alpha: Alpha::Opaque, ..info };
    let single = PixelInfo { channels: 1, color: ColorSpace::Linear, ..opaque };
    let short = width.min(height);
    let levels = (0..MAX_PATCH_LEVELS).take_while(|&level| short >> level > ALL_BORDER).count() as u32;
    if levels == 0 {
        return Ok(Vec::new());
    }
    let colours = Raster::from_texels(width, height, opaque, texels)?;
    let shares = Raster::new(width, height, single, alpha.to_vec())?;
    let colours = mip_chain_cancellable(&colours, levels, MipFilter::Box, cancel)?;
    let shares = mip_chain_cancellable(&shares, levels, MipFilter::Box, cancel)?;
    let level = |(colour, share): (&Raster, &Raster)| {
        let size = colour.size();
        bytes_of(colour, cancel, |texel, x, y| {
            let border = x == 0 || y == 0 || x + 1 == size.width || y + 1 == size.height;
            texel.truncate().extend(if border { 0.0 } else { share.value(x, y, 0) })
        })
    };
    colours.iter().zip(&shares).map(level).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_border_of_every_level_is_clear_and_the_inside_is_not() {
        let (width, height) = (37u32, 21u32);
        let count = (width * height) as usize;
        let info = PixelInfo { channels: 3, ..PixelInfo::default() };
        // Not a half, which lies between two bytes.
        let gray = Texel::splat(128.0 / 255.0);
        let none = CancelCheck::default();
        let levels = of_patch(&vec![gray; count], &vec![1.0; count], (width, height), info, none).unwrap();
        assert_eq!(levels.len(), 3);
        for (level, texels) in levels.iter().enumerate() {
            let (w, h) = (width >> level, height >> level);
            for (at, texel) in texels.iter().enumerate() {
                let (x, y) = (at as u32 % w, at as u32 / w);
                let border = x == 0 || y == 0 || x + 1 == w || y + 1 == h;
                assert_eq!(*texel, [128, 128, 128, if border { 0 } else { 255 }]);
            }
        }
        assert!(of_patch(&[Texel::ONE; 6], &[1.0; 6], (3, 2), info, none).unwrap().is_empty());
    }
}

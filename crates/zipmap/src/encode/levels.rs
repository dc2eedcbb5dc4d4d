//! Mip levels of root and patches.
//!
//! A patch keeps its colours where it is not shown: they are blended with those beside them. Alpha is averaged by
//! itself, and is 0 on the border texels of every level (paper section 3), so that no seam shows and what is smaller
//! than a pixel vanishes.

use texfold_core::Texel;
use texfold_core::image::{Alpha, ColorSpace, MipFilter, PixelInfo, Raster, mip_chain, to_u8};

use crate::encoded::MAX_PATCH_LEVELS;

/// Sides up to which all texels are border.
const ALL_BORDER: u32 = 2;

fn bytes(texel: Texel) -> [u8; 4] {
    texel.to_array().map(to_u8)
}

/// All levels of the root that a file can hold.
pub(crate) fn of_root(root: &Raster, levels: u32) -> Vec<Vec<[u8; 4]>> {
    let chain = mip_chain(root, levels, MipFilter::Box);
    chain.iter().map(|level| level.texels().map(bytes).collect()).collect()
}

/// Levels of a patch down to the last that has texels inside; none where the patch has none itself.
pub(crate) fn of_patch(
    texels: &[Texel],
    alpha: &[f32],
    (width, height): (u32, u32),
    info: PixelInfo,
) -> Vec<Vec<[u8; 4]>> {
    let opaque = PixelInfo { channels: 3, alpha: Alpha::Opaque, ..info };
    let single = PixelInfo { channels: 1, color: ColorSpace::Linear, ..opaque };
    let short = width.min(height);
    let levels = (0..MAX_PATCH_LEVELS).take_while(|&level| short >> level > ALL_BORDER).count() as u32;
    let colours = Raster::from_texels(width, height, opaque, texels);
    let shares = Raster::new(width, height, single, alpha.to_vec());
    let (Ok(colours), Ok(shares)) = (colours, shares) else { return Vec::new() };
    if levels == 0 {
        return Vec::new();
    }
    let chains = [colours, shares].map(|raster| mip_chain(&raster, levels, MipFilter::Box));
    let level = |(colour, share): (&Raster, &Raster)| {
        let size = colour.size();
        let both = colour.texels().zip(share.data()).enumerate();
        both.map(|(at, (texel, &alpha))| {
            let (x, y) = (at as u32 % size.width, at as u32 / size.width);
            let border = x == 0 || y == 0 || x + 1 == size.width || y + 1 == size.height;
            bytes(texel.truncate().extend(if border { 0.0 } else { alpha }))
        })
        .collect()
    };
    chains[0].iter().zip(&chains[1]).map(level).collect()
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
        let levels = of_patch(&vec![gray; count], &vec![1.0; count], (width, height), info);
        assert_eq!(levels.len(), 3);
        for (level, texels) in levels.iter().enumerate() {
            let (w, h) = (width >> level, height >> level);
            for (at, texel) in texels.iter().enumerate() {
                let (x, y) = (at as u32 % w, at as u32 / w);
                let border = x == 0 || y == 0 || x + 1 == w || y + 1 == h;
                assert_eq!(*texel, [128, 128, 128, if border { 0 } else { 255 }]);
            }
        }
        assert!(of_patch(&[Texel::ONE; 6], &[1.0; 6], (3, 2), info).is_empty());
    }
}

//! Images made of images: errors and thumbnails.

use texfold_core::Texel;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo, Raster};

/// How much larger errors are shown than they are.
pub(crate) const ERROR_GAIN: f32 = 8.0;

/// The signed error of the colour channels, [`ERROR_GAIN`] times as large, around middle gray.
pub(crate) fn error(source: &Raster, decoded: &Raster) -> Raster {
    let size = source.size();
    let channels = source.info().color_channels();
    let info = PixelInfo { channels, depth: Depth::Eight, color: ColorSpace::Linear, alpha: Alpha::Opaque };
    let texels: Vec<Texel> = (0..size.height)
        .flat_map(|y| (0..size.width).map(move |x| (x, y)))
        .map(|(x, y)| (decoded.texel(x, y) - source.texel(x, y)) * ERROR_GAIN + Texel::splat(0.5))
        .collect();
    // The size and the number of texels agree, and decoded values are finite.
    Raster::from_texels(size.width, size.height, info, &texels).unwrap_or_else(|_| source.clone())
}

/// The upper left `side` x `side` texels around the middle, or all of an image that is smaller.
pub(crate) fn crop(image: &Raster, side: u32) -> Raster {
    let size = image.size();
    let (width, height) = (size.width.min(side), size.height.min(side));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texels: Vec<Texel> = (top..top + height)
        .flat_map(|y| (left..left + width).map(move |x| (x, y)))
        .map(|(x, y)| image.texel(x, y))
        .collect();
    Raster::from_texels(width, height, image.info(), &texels).unwrap_or_else(|_| image.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_error_is_middle_gray_and_crops_are_central() {
        let bytes: Vec<u8> = (0..48).collect();
        let image = Raster::from_u8(4, 4, 3, ColorSpace::Srgb, &bytes).unwrap();
        assert!(error(&image, &image).to_bytes().iter().all(|&byte| byte == 128));
        let middle = crop(&image, 2);
        assert_eq!(middle.to_bytes(), [15, 16, 17, 18, 19, 20, 27, 28, 29, 30, 31, 32]);
        assert_eq!(crop(&image, 9), image);
    }
}

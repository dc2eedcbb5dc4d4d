//! Texels stored as content planes.

use texfold_core::image::{PixelInfo, Raster};
use texfold_core::{CancelCheck, EncodeError, PlaneFormat, Texel};

use super::blocks::{encode_cancellable, encode_plane};
use crate::{Content, ContentPlanes, Swizzle};

impl ContentPlanes {
    /// Stores `texels` (`width` x `height`, row by row) as `content`.
    #[must_use]
    pub fn encode(
        content: Content,
        pixel: PixelInfo,
        size: (u32, u32),
        texels: &[Texel],
        effort: texfold_core::Effort,
    ) -> Self {
        Self::encode_bands(content, pixel, size, || texels.iter().copied(), effort, CancelCheck::default())
    }

    /// As [`ContentPlanes::encode`], but stops soon after the job that `cancel` belongs to is cancelled.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where it was.
    pub fn encode_cancellable(
        content: Content,
        pixel: PixelInfo,
        size: (u32, u32),
        texels: &[Texel],
        effort: texfold_core::Effort,
        cancel: CancelCheck<'_>,
    ) -> Result<Self, EncodeError> {
        let planes = Self::encode_bands(content, pixel, size, || texels.iter().copied(), effort, cancel);
        cancel.checkpoint().map(|()| planes)
    }

    /// Planes of an image, as [`ContentPlanes::encode_cancellable`] makes them of texels.
    ///
    /// # Errors
    /// As there.
    pub fn encode_image(
        content: Content,
        image: &Raster,
        effort: texfold_core::Effort,
        cancel: CancelCheck<'_>,
    ) -> Result<Self, EncodeError> {
        let size = (image.size().width, image.size().height);
        let planes = Self::encode_bands(content, image.info(), size, || image.texels(), effort, cancel);
        cancel.checkpoint().map(|()| planes)
    }

    fn encode_bands<T: ExactSizeIterator<Item = Texel>>(
        content: Content,
        pixel: PixelInfo,
        (width, height): (u32, u32),
        texels: impl Fn() -> T,
        effort: texfold_core::Effort,
        cancel: CancelCheck<'_>,
    ) -> Self {
        let (formats, swizzle) = content.formats(pixel);
        let planes = formats
            .iter()
            .enumerate()
            .map(|(index, &format)| {
                let bytes = plane_bytes(texels(), swizzle, index);
                (format, encode_cancellable(format, width, height, &bytes, effort, cancel))
            })
            .collect();
        ContentPlanes { content, swizzle, width, height, planes }
    }

    /// The same planes with `height` rows (at least as many as now) and other texels in some 4x4 cells, each given by
    /// its corner; whatever is in no such cell keeps its bits, new rows start as 0.
    #[must_use]
    pub fn with_cells(&self, cells: &[(u32, u32, [Texel; 16])], height: u32) -> Self {
        let mut grown = self.clone();
        grown.height = height.max(self.height);
        for (index, (format, bytes)) in grown.planes.iter_mut().enumerate() {
            bytes.resize(format.bytes(self.width, grown.height) as usize, 0);
            for (x, y, texels) in cells {
                let block = plane_bytes(texels.iter().copied(), self.swizzle, index);
                let block = encode_plane(*format, 4, 4, &block, texfold_core::Effort::Normal);
                write_cell(bytes, *format, self.width, (*x, *y), &block);
            }
        }
        grown
    }
}

/// Puts an encoded 4x4 cell at a corner that is a multiple of 4.
fn write_cell(bytes: &mut [u8], format: PlaneFormat, width: u32, (x, y): (u32, u32), cell: &[u8]) {
    let (side, block) = (format.block_side(), format.block_bytes() as usize);
    let columns = width.div_ceil(side);
    let run = 4 / side as usize * block;
    for (row, values) in cell.chunks_exact(run).enumerate() {
        let start = ((y / side + row as u32) * columns + x / side) as usize * block;
        if let Some(place) = bytes.get_mut(start..start + run) {
            place.copy_from_slice(values);
        }
    }
}

/// RGBA bytes that plane `index` is encoded from.
fn plane_bytes(texels: impl ExactSizeIterator<Item = Texel>, swizzle: Swizzle, index: usize) -> Vec<u8> {
    use texfold_core::sample as s;
    let arrange = |texel: Texel| -> [f32; 4] {
        let [red, green, blue, alpha] = texel.to_array();
        match swizzle.0 {
            s::TEXFOLD_RGBA => [red, green, blue, alpha],
            s::TEXFOLD_GRAY_ALPHA => [red, alpha, 0.0, 1.0],
            s::TEXFOLD_SPLIT if index == 1 => [blue, 0.0, 0.0, 1.0],
            _ => [red, green, blue, 1.0],
        }
    };
    // One array a texel, so that the length is known before.
    texels.map(|texel| arrange(texel).map(texfold_core::image::to_u8)).collect::<Vec<_>>().into_flattened()
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::Effort;
    use texfold_core::image::{ColorSpace, Raster};
    use texfold_core::sample::texfold_normal_z;

    #[test]
    fn raw_content_is_exact_for_every_number_of_channels() {
        for channels in 1..=4u8 {
            let bytes: Vec<u8> = (0..7 * 5 * u32::from(channels)).map(|i| (i * 37 % 251) as u8).collect();
            let raster = Raster::from_u8(7, 5, channels, ColorSpace::Srgb, &bytes).unwrap();
            let texels: Vec<Texel> = raster.texels().collect();
            let planes = ContentPlanes::encode(Content::Raw, raster.info(), (7, 5), &texels, Effort::Normal);
            let stored: usize = planes.planes().iter().map(|(_, bytes)| bytes.len()).sum();
            assert_eq!(stored, 7 * 5 * usize::from(channels));
            let back = Raster::from_texels(7, 5, raster.info(), &planes.decode()).unwrap();
            assert_eq!(back.to_bytes(), bytes, "{channels} channels");
        }
    }

    #[test]
    fn a_normal_map_keeps_unit_length_in_bc5() {
        let bytes: Vec<u8> = (0..64).flat_map(|i| [100 + i, 160 - i, 240]).collect();
        let raster = Raster::from_u8(8, 8, 3, ColorSpace::Normal, &bytes).unwrap();
        let texels: Vec<Texel> = raster.texels().collect();
        let planes = ContentPlanes::encode(Content::Bc5, raster.info(), (8, 8), &texels, Effort::Normal);
        for texel in planes.decode() {
            let normal = texel.truncate() * 2.0 - 1.0;
            assert!((normal.length() - 1.0).abs() < 1e-3, "{normal}");
        }
        assert_eq!(texfold_normal_z(0.5, 0.5).z, 1.0);
    }
}

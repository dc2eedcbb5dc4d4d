//! What each image's shader needs to know: the uniform blocks.

use texfold_bc::ContentPlanes;
use texfold_core::ImageSize;
use texfold_core::address::TEXFOLD_CLAMP;
use texfold_core::sample::TEXFOLD_RGBA;

use crate::decode::TexfoldEpitomeParams;
use crate::format::blocks_of;
use crate::parts::{Parts, epitome_size};

impl Parts {
    /// What the shader needs to know of each image.
    pub(crate) fn uniforms(&self) -> Vec<TexfoldEpitomeParams> {
        let (format, map) = (&self.format, &self.map);
        let plain = (0..self.epitomes.len()).map(|epitome| self.drawn_size(epitome).into());
        let sizes: Vec<[u32; 2]> =
            plain.chain(self.errors.iter().map(|errors| epitome_size(errors))).collect();
        let sizes = match &self.blocks {
            Some(blocks) => vec![[blocks.size().width, blocks.size().height]],
            None => sizes,
        };
        let plane_size = |index: usize| sizes.get(index).or(sizes.first()).copied().unwrap_or([4, 4]);
        let plane_levels = self.errors.as_ref().map(|errors| errors.layout().levels);
        let plane_levels = plane_levels.or(self.blocks.as_ref().map(|blocks| blocks.epitome.layout().levels));
        let plane_levels = plane_levels.or_else(|| self.epitomes.first().map(|levels| levels.len() as u32));
        // Blocks are decoded to four channels.
        let swizzles = |planes: Option<&ContentPlanes>| match self.blocks {
            Some(_) => TEXFOLD_RGBA,
            None => planes.map_or(0, |planes| planes.swizzle().0),
        };
        let mut tree_start = 0;
        let image = |(index, &size): (usize, &ImageSize)| {
            let (columns, rows) = blocks_of(size, format.block);
            let params = TexfoldEpitomeParams {
                size: [size.width, size.height],
                levels: self.layout.levels,
                address_mode: TEXFOLD_CLAMP,
                swizzle: swizzles(self.epitomes.first().and_then(|levels| levels.first())),
                mixed: u32::from(format.mixed),
                block: format.block,
                split: u32::from(format.split),
                columns,
                tree_start,
                entry_start: map.entry_start as u32,
                entry_bytes: format.entry_bytes(),
                x_bits: format.x_bits,
                y_bits: format.y_bits,
                fraction_bits: format.fraction_bits,
                gain_offset_bits: format.gain_offset_bits,
                matrix_bits: format.matrix_bits,
                matrix_start: map.matrix_start as u32,
                gain_offset_start: map.gain_offset_start as u32,
                row_log2: map.row_log2,
                plane_a: plane_size(0),
                plane_b: plane_size(1),
                plane_levels: plane_levels.unwrap_or(1),
                coarse_swizzle: swizzles(self.coarse.get(index).and_then(|levels| levels.first())),
                cell: format.cell(),
                seam_width: format.seam_width,
            };
            tree_start += columns * rows;
            params
        };
        self.layout.images.iter().enumerate().map(image).collect()
    }
}

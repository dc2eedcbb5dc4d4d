//! ASTC by Arm's encoder: bands of blocks in parallel, each with a context of its own.

use ctt_astcenc::{Flags, Preset, Swizzle};
use rayon::prelude::*;
use texfold_core::{AstcBlock, Effort, PlaneFormat};

use crate::astc::{context, with_image};

/// Rows of blocks that one task encodes: a context costs as much as some hundred blocks, so tasks are large.
const BAND_ROWS: usize = 16;

/// Stores RGBA bytes in blocks, row by row; those that hang over the edge repeat it.
pub(crate) fn encode(block: AstcBlock, width: u32, _: u32, rgba: &[u8], effort: Effort) -> Vec<u8> {
    let preset = match effort {
        Effort::Fast => Preset::Fast,
        Effort::Normal => Preset::Medium,
        Effort::High => Preset::Thorough,
    };
    let bands: Vec<Vec<u8>> = rgba
        .par_chunks((width * block.side()) as usize * 4 * BAND_ROWS)
        .map(|band| {
            let height = (band.len() / (4 * width as usize)) as u32;
            let mut blocks = vec![0; PlaneFormat::Astc(block).bytes(width, height) as usize];
            // Fails only where memory does: the blocks are then illegal and show as such.
            if let Some(mut context) = context(block, preset, Flags::empty()) {
                let mut texels = band.to_vec();
                let done = with_image(width, height, &mut texels, |image| {
                    context.compress(image, Swizzle::IDENTITY, &mut blocks)
                });
                debug_assert!(done.is_ok(), "encoding to memory failed: {done:?}");
            }
            blocks
        })
        .collect();
    bands.concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode_plane;

    #[test]
    fn every_side_reproduces_an_image_better_the_smaller_its_blocks() {
        let image = texfold_testkit::image("facade");
        let (width, height) = (image.size().width, image.size().height);
        let rgba: Vec<u8> =
            image.texels().flat_map(|t| t.to_array().map(texfold_core::image::to_u8)).collect();
        let mut last = 0.0;
        for block in AstcBlock::ALL {
            let format = PlaneFormat::Astc(block);
            let bytes = encode_plane(format, width, height, &rgba, Effort::Fast);
            assert_eq!(bytes.len() as u64, format.bytes(width, height));
            let texels = crate::content::decode_plane(format, width as usize, height as usize, &bytes);
            let error: f32 = image.texels().zip(&texels).map(|(a, b)| (a - *b).length_squared()).sum();
            assert!(error > last, "{block:?}: {error} after {last}");
            last = error;
        }
        assert!(last / ((width * height) as f32) < 0.02, "12x12 blocks lose the image: {last}");
    }

    #[test]
    fn blocks_do_not_depend_on_the_number_of_threads() {
        let image = texfold_testkit::image("facade");
        let (width, height) = (image.size().width, image.size().height);
        let rgba: Vec<u8> =
            image.texels().flat_map(|t| t.to_array().map(texfold_core::image::to_u8)).collect();
        let encode = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| encode(AstcBlock::B4, width, height, &rgba, Effort::Fast))
        };
        assert_eq!(encode(1), encode(3));
    }
}

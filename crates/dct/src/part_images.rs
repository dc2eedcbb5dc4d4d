//! Images of the parts of a texture, for a person to look at.

use texfold_core::ImageSize;
use texfold_core::image::{PartImages, Raster};

use crate::DctImages;

/// Draws the parts of `images`, each with an image for each of theirs: "base", of 1/8 of the width and height, and "bits", the bytes of
/// superblocks: black none, through red and yellow to white, the most of the image. `None` only where an image cannot be made at all.
#[must_use]
pub fn part_images(images: &DctImages) -> Option<Vec<PartImages>> {
    let [mut bases, mut maps] = [Vec::new(), Vec::new()];
    let content = images.content();
    for index in 0..content.layout().images.len() as u32 {
        let image = content.stages_of(index).first()?;
        let (ImageSize { width, height }, texels) = content.base_texels(index)?;
        bases.push(Raster::from_texels(width, height, content.layout().pixel_of(index), &texels).ok()?);
        let ((columns, _), bytes) = image.superblock_bytes();
        let side = image.superblock_side();
        let most = bytes.iter().copied().max().unwrap_or(0).max(1) as f32;
        let share = |x: u32, y: u32| bytes[(y / side * columns + x / side) as usize] as f32 / most;
        maps.push(Raster::heat_map(image.form().size, share).ok()?);
    }
    Some(vec![PartImages { name: "base", images: bases }, PartImages { name: "bits", images: maps }])
}

#[cfg(test)]
#[cfg(feature = "encode")]
mod tests {
    use super::*;
    use crate::{Dct, DctParams};
    use texfold_core::image::ImageSet;
    use texfold_core::{Encoder, Goal, Job};

    fn sizes(rasters: &[Raster]) -> Vec<(u32, u32)> {
        rasters.iter().map(|raster| (raster.size().width, raster.size().height)).collect()
    }

    #[test]
    fn superblocks_are_as_bright_as_they_have_bytes() {
        let set = ImageSet::single(texfold_testkit::image("terrain"));
        let params = DctParams::default().with_goal(Goal::Bpp(1.0));
        let texture = Dct::encode(&set, &params, &mut Job::default()).unwrap();
        let parts = part_images(&texture).unwrap();
        let maps = PartImages::of(&parts, "bits");
        assert_eq!((sizes(maps), sizes(PartImages::of(&parts, "base"))), (vec![(256, 256)], vec![(32, 32)]));
        let image = &texture.content().stages()[0];
        let ((columns, rows), bytes) = image.superblock_bytes();
        assert_eq!((columns, rows), (8, 8));
        let most = bytes.iter().copied().max().unwrap() as f32;
        for (number, &bytes) in (0..).zip(&bytes) {
            let texel = maps[0].texel(number % 8 * 32 + 31, number / 8 * 32);
            let heat = texel.x + texel.y + texel.z;
            assert!((heat - 3.0 * bytes as f32 / most).abs() < 1e-5, "{number}");
        }
    }
}

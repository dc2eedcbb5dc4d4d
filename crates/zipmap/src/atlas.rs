//! Places of the levels of patch images in one plane.
//!
//! Blocks of variable length give further mip levels of each image (*means*): then only the levels that they are made of are packed,
//! and the others lie in the plane's own mip levels, at their share of these places.

use texfold_core::MAX_PLANE_SIDE;

use crate::parts::ImageForm;

/// The origin of each level of the patch images in one plane, and the plane's size.
pub(crate) type Packing = (Vec<Vec<(u32, u32)>>, (u32, u32));

/// The origin of each level of the patch images in a plane of `mips` mip levels, in texels of its mip level
/// `level % mips`, and the plane's size: rows of rectangles of falling height, whose sides are padded to multiples of `granularity`.
/// `None` where it would be too large.
pub(crate) fn pack(images: &[ImageForm], granularity: u32, mips: u32) -> Option<Packing> {
    let whole = |side: u32| side.next_multiple_of(granularity);
    let mut all: Vec<(usize, usize, u32, u32)> = Vec::new();
    for (index, image) in images.iter().enumerate() {
        for level in (0..image.levels).step_by(mips as usize) {
            let size = image.size.at_level(level);
            all.push((index, level as usize, whole(size.width), whole(size.height)));
        }
    }
    all.sort_by_key(|&(index, level, _, height)| (std::cmp::Reverse(height), index, level));
    let area: u64 = all.iter().map(|&(_, _, width, height)| u64::from(width) * u64::from(height)).sum();
    let widest = all.iter().map(|rect| rect.2).max().unwrap_or(granularity);
    let square = whole((area as f64).sqrt().ceil() as u32);
    // The least plane among those of some widths.
    let widths = (0..8).map(|step| whole(square + square * step / 16)).chain([MAX_PLANE_SIDE]);
    let tried = widths.filter(|&width| width >= widest && width <= MAX_PLANE_SIDE).filter_map(|width| {
        let mut origins: Vec<Vec<(u32, u32)>> =
            images.iter().map(|image| vec![(0, 0); image.levels as usize]).collect();
        let (mut x, mut y, mut row, mut used) = (0, 0, 0, granularity);
        for &(index, level, wide, high) in &all {
            if x + wide > width {
                (x, y, row) = (0, y + row, 0);
            }
            let behind = origins[index].iter_mut().skip(level).take(mips as usize);
            (0..).zip(behind).for_each(|(mip, origin)| *origin = (x >> mip, y >> mip));
            (x, row) = (x + wide, high.max(row));
            used = x.max(used);
        }
        let height = (y + row).max(granularity);
        (height <= MAX_PLANE_SIDE).then_some((origins, (used, height)))
    });
    tried.min_by_key(|(_, (width, height))| u64::from(*width) * u64::from(*height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::ImageSize;

    #[test]
    fn levels_lie_apart_and_means_at_the_place_of_the_level_that_they_are_made_of() {
        let image = |(width, height, levels)| ImageForm { size: ImageSize { width, height }, levels };
        let images = [(37, 61, 5), (850, 680, 8), (1, 1, 1), (64, 9, 4)].map(image);
        for mips in 1..=3u32 {
            let (origins, (width, height)) = pack(&images, 8, mips).unwrap();
            let mut is_taken = vec![false; (width * height) as usize];
            for (image, origins) in images.iter().zip(&origins) {
                assert_eq!(origins.len(), image.levels as usize);
                for (level, &(x, y)) in (0..).zip(origins) {
                    let (mip, size) = (level % mips, image.size.at_level(level));
                    let stored = origins[(level - mip) as usize];
                    assert_eq!((x << mip, y << mip), stored);
                    assert!(x + size.width <= width >> mip && y + size.height <= height >> mip);
                    for at in (0..size.texels() as u32).filter(|_| mip == 0) {
                        let at = ((y + at / size.width) * width + x + at % size.width) as usize;
                        assert!(!std::mem::replace(&mut is_taken[at], true));
                    }
                }
            }
        }
    }
}

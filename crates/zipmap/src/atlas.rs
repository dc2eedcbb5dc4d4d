//! Where the levels of patch images lie in one plane.

use texfold_core::MAX_PLANE_SIDE;

use crate::parts::ImageForm;

/// The origin of each level of the patch images in one plane, and the plane's size.
pub(crate) type Packing = (Vec<Vec<(u32, u32)>>, (u32, u32));

/// The origin of each level of the patch images in one plane, and the plane's size: rows of rectangles of falling
/// height, whose sides are padded to multiples of `granularity`. `None` where it would be too large.
pub(crate) fn pack(images: &[ImageForm], granularity: u32) -> Option<Packing> {
    let whole = |side: u32| side.next_multiple_of(granularity);
    let mut all: Vec<(usize, usize, u32, u32)> = Vec::new();
    for (index, image) in images.iter().enumerate() {
        for level in 0..image.levels {
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
            origins[index][level] = (x, y);
            (x, row) = (x + wide, high.max(row));
            used = x.max(used);
        }
        let height = (y + row).max(granularity);
        (height <= MAX_PLANE_SIDE).then_some((origins, (used, height)))
    });
    tried.min_by_key(|(_, (width, height))| u64::from(*width) * u64::from(*height))
}

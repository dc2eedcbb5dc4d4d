//! Where the levels of patch images lie in one plane.

use texfold_bc::ContentPlanes;
use texfold_core::MAX_PLANE_SIDE;

/// The origin of each level of the patch images in one plane, and the plane's size.
pub(crate) type Packing = (Vec<Vec<(u32, u32)>>, (u32, u32));

/// The origin of each level of the patch images in one plane, and the plane's size: rows of rectangles of falling
/// height. `None` where it would be too large.
pub(crate) fn pack(contents: &[Vec<ContentPlanes>]) -> Option<Packing> {
    let whole = |side: u32| side.next_multiple_of(4);
    let mut all: Vec<(usize, usize, u32, u32)> = Vec::new();
    for (index, levels) in contents.iter().enumerate() {
        for (level, planes) in levels.iter().enumerate() {
            let (width, height) = planes.size();
            all.push((index, level, whole(width), whole(height)));
        }
    }
    all.sort_by_key(|&(index, level, _, height)| (std::cmp::Reverse(height), index, level));
    let area: u64 = all.iter().map(|&(_, _, width, height)| u64::from(width) * u64::from(height)).sum();
    let widest = all.iter().map(|rect| rect.2).max().unwrap_or(4);
    let square = whole((area as f64).sqrt().ceil() as u32);
    // The least plane among those of some widths.
    let widths = (0..8).map(|step| whole(square + square * step / 16)).chain([MAX_PLANE_SIDE]);
    let tried = widths.filter(|&width| width >= widest && width <= MAX_PLANE_SIDE).filter_map(|width| {
        let mut origins: Vec<Vec<(u32, u32)>> =
            contents.iter().map(|levels| vec![(0, 0); levels.len()]).collect();
        let (mut x, mut y, mut row, mut used) = (0, 0, 0, 4);
        for &(index, level, wide, high) in &all {
            if x + wide > width {
                (x, y, row) = (0, y + row, 0);
            }
            origins[index][level] = (x, y);
            (x, row) = (x + wide, high.max(row));
            used = x.max(used);
        }
        let height = (y + row).max(4);
        (height <= MAX_PLANE_SIDE).then_some((origins, (used, height)))
    });
    tried.min_by_key(|(_, (width, height))| u64::from(*width) * u64::from(*height))
}

//! How images are cut into tiles.

use texfold_core::{ImageSize, Rect};

/// Texels a side of a tile: the paper's.
pub const TILE_SIDE: u32 = 1024;
/// Least side of the last tile: what remains below is of the one before it. A narrow tile has few blocks to share a
/// model and a border all along, and is seen beside one that is coded otherwise.
pub const LEAST_SIDE: u32 = TILE_SIDE / 4;

/// First column and width of the tiles that cover `length` columns; or row and height.
pub fn cuts(length: u32) -> impl Iterator<Item = (u32, u32)> {
    let count = length.saturating_sub(LEAST_SIDE).div_ceil(TILE_SIDE).max(1);
    (0..count).map(move |index| {
        let start = index * TILE_SIDE;
        (start, if index + 1 < count { TILE_SIDE } else { length - start })
    })
}

/// The tiles of an image of that size, row by row.
#[must_use]
pub fn tile_rects(size: ImageSize) -> Vec<Rect> {
    let row = |(y, height)| {
        cuts(size.width).map(move |(x, width)| Rect { image: 0, level: 0, x, y, width, height })
    };
    cuts(size.height).flat_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_all_and_none_is_narrow() {
        for length in [1, 5, 1024, 1025, 1279, 1280, 1281, 2048, 2250, 2303, 2305, 5400, 32768] {
            let cuts: Vec<_> = cuts(length).collect();
            let mut end = 0;
            for (index, &(start, count)) in (0..).zip(&cuts) {
                assert_eq!((start, start), (end, index * TILE_SIDE), "{length}");
                end += count;
            }
            let (_, last) = cuts[cuts.len() - 1];
            assert!(
                end == length && last <= TILE_SIDE + LEAST_SIDE && (last > LEAST_SIDE || cuts.len() == 1),
                "{length}"
            );
        }
    }
}

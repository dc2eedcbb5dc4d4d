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

/// The columns of a tile that begins at `start` with `apron` more on each side, beyond an image of `whole` columns those of its edge; or
/// the rows.
#[must_use]
pub fn around((start, length): (u32, u32), apron: u32, whole: u32) -> Vec<u32> {
    (start..start + length + 2 * apron).map(|at| at.saturating_sub(apron).min(whole - 1)).collect()
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
    fn what_surrounds_a_tile_ends_at_the_edge_of_the_image() {
        assert_eq!(around((0, 3), 2, 6), [0, 0, 0, 1, 2, 3, 4]);
        assert_eq!(around((3, 3), 2, 6), [1, 2, 3, 4, 5, 5, 5]);
        assert_eq!(around((2, 2), 0, 6), [2, 3]);
    }

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

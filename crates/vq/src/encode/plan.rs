//! The size of a codebook and the places of its samples, and how many bits all else takes.

use texfold_core::{ImageLayout, parameter_bits};

use crate::classes::Groups;
use crate::decode::TexfoldVqParams;
use crate::grid::{Grid, MAX_CODEBOOK_SIDE};

/// Texels of a cell, as of a block.
pub(crate) const CELL_TEXELS: u32 = 16;
/// Most cells: 256 x 256 texels, what two bytes can address.
pub(crate) const MAX_CELLS: u32 = (MAX_CODEBOOK_SIDE / 4) * (MAX_CODEBOOK_SIDE / 4);
/// Share of the codebook that samples may take (paper section 3.1).
pub(crate) const SAMPLE_SHARE: f32 = 0.75;

impl Grid {
    /// The largest rectangle of at most `cells` cells, the squarer one of equals, wider than high.
    pub(crate) fn within(cells: u32) -> Grid {
        let side = MAX_CODEBOOK_SIDE / 4;
        let cells = cells.clamp(1, MAX_CELLS);
        let fit = |columns: u32| Grid { columns, rows: (cells / columns).min(side) };
        (1..=side)
            .map(fit)
            .filter(|grid| grid.rows > 0 && grid.rows <= grid.columns)
            .max_by_key(|grid| (grid.cells(), grid.rows))
            .unwrap_or(Grid { columns: cells.min(side), rows: 1 })
    }

    /// A small rectangle of at least `cells` cells and at least `side` cells a side.
    pub(crate) fn covering(cells: u32, side: u32) -> Grid {
        let most = MAX_CODEBOOK_SIDE / 4;
        let side = side.clamp(1, most);
        (side..=most)
            .map(|columns| Grid { columns, rows: cells.div_ceil(columns).max(side) })
            .filter(|grid| grid.rows <= most && grid.rows <= grid.columns.max(side))
            .min_by_key(|grid| (grid.cells(), grid.columns))
            .unwrap_or(Grid { columns: most, rows: most })
    }

    pub(crate) fn texels(self) -> (u32, u32) {
        (self.columns * 4, self.rows * 4)
    }

    /// Places for at most `count` squares of `side` texels, side by side from the upper left, within the share
    /// that samples may take.
    pub(crate) fn sample_places(self, count: u32, side: u32) -> Vec<(u32, u32)> {
        let (width, height) = self.texels();
        if side == 0 || side > width || side > height {
            return Vec::new();
        }
        let most = (SAMPLE_SHARE * (width * height) as f32 / (side * side) as f32) as u32;
        let across = width / side;
        let place = |index: u32| (index % across * side, index / across * side);
        (0..count.min(most)).map(place).filter(|&(_, y)| y + side <= height).collect()
    }
}

/// Bits of everything but the codebook that goals count: the index planes and the parameters.
pub(crate) fn fixed_bits(layout: &ImageLayout) -> u64 {
    let groups = Groups::of(layout);
    let planes: u64 = groups.planes().map(|plane| 8 * plane.bytes()).sum();
    let parameters = (groups.planes().count() * size_of::<TexfoldVqParams>()) as u64;
    planes + parameter_bits(parameters, groups.places.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CodebookPart;

    #[test]
    fn the_grid_wastes_little() {
        for cells in [1, 2, 3, 7, 64, 100, 1536, 2265, 4096, 9999] {
            let grid = Grid::within(cells);
            let wanted = cells.min(MAX_CELLS);
            assert!(grid.cells() <= wanted && grid.cells() * 100 >= wanted * 95, "{cells}: {grid:?}");
            assert!(grid.columns <= 64 && grid.rows <= 64);
        }
        assert_eq!(Grid::within(1536), Grid { columns: 48, rows: 32 });
    }

    #[test]
    fn samples_take_at_most_three_quarters() {
        let grid = Grid { columns: 32, rows: 32 };
        assert_eq!(grid.sample_places(9, 64), [(0, 0), (64, 0), (0, 64)]);
        assert_eq!(grid.sample_places(1, 132), []);
        let part = CodebookPart { x: 0, y: 0, side: 64, image: 0, source_x: 0, source_y: 0 };
        let free = grid.free_cells(&[part]);
        assert_eq!((free.len(), free[0]), (32 * 32 - 256, (64, 0)));
    }
}

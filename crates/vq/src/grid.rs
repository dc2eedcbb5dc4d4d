//! The cells of a codebook, squares of 4x4 texels, and the samples in it: codewords fill the cells that no sample covers.

/// Longest side of a codebook in texels: the index plane has one byte a coordinate.
pub(crate) const MAX_CODEBOOK_SIDE: u32 = 256;
/// Most image samples of a codebook.
pub(crate) const MAX_SAMPLES: u32 = 64;

/// A rectangle of the codebook that holds one image sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CodebookPart {
    /// Column of its upper left texel in the codebook.
    pub x: u32,
    /// Row of its upper left texel in the codebook.
    pub y: u32,
    /// Columns and rows.
    pub side: u32,
    /// Which image it was cut from.
    pub image: u32,
    /// Column in that image.
    pub source_x: u32,
    /// Row in that image.
    pub source_y: u32,
}

/// Size of a codebook in cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Grid {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
}

impl Grid {
    /// The grid of a codebook of `width` x `height` texels, multiples of 4.
    pub(crate) fn of_texels((width, height): (u32, u32)) -> Grid {
        Grid { columns: width / 4, rows: height / 4 }
    }

    /// Number of cells.
    pub(crate) fn cells(self) -> u32 {
        self.columns * self.rows
    }

    /// Corners in texels of the cells that no sample covers, row by row.
    pub(crate) fn free_cells(self, samples: &[CodebookPart]) -> Vec<(u32, u32)> {
        let taken = |x: u32, y: u32| {
            samples.iter().any(|part| {
                (part.x..part.x + part.side).contains(&x) && (part.y..part.y + part.side).contains(&y)
            })
        };
        (0..self.cells())
            .map(|cell| (cell % self.columns * 4, cell / self.columns * 4))
            .filter(|&(x, y)| !taken(x, y))
            .collect()
    }
}

//! Codebooks made of cells.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::{Effort, Texel};

use crate::codebook::{CELL_SIDE, CODEBOOK_PIXEL, Codebook, MIDDLE, REACH};

impl Codebook {
    /// A codebook of `width` texels a row with cells side by side, each of values -1 to 1 row by row; the cells fill whole rows.
    #[must_use]
    pub fn of_cells(content: Content, width: u32, cells: &[Vec<f32>]) -> Option<Self> {
        let across = width / CELL_SIDE;
        let rows = (cells.len() as u32).div_ceil(across.max(1));
        let (width, height) = (across * CELL_SIDE, rows * CELL_SIDE);
        let mut texels = vec![texel_of(0.0); width as usize * height as usize];
        for (index, cell) in (0..).zip(cells) {
            let (left, top) = (index % across * CELL_SIDE, index / across * CELL_SIDE);
            for (place, &value) in (0..).zip(cell) {
                let (x, y) = (left + place % CELL_SIDE, top + place / CELL_SIDE);
                texels[(y * width + x) as usize] = texel_of(value);
            }
        }
        let planes = ContentPlanes::encode(content, CODEBOOK_PIXEL, (width, height), &texels, Effort::Normal);
        Codebook::from_planes(planes)
    }
}

fn texel_of(value: f32) -> Texel {
    Texel::new((MIDDLE + REACH * value.clamp(-1.0, 1.0)) / 255.0, 0.0, 0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_codebook_grows_by_rows_and_keeps_what_it_had() {
        let cell =
            |seed: usize| (0..1024).map(|i| ((i * 7 + seed * 13) % 200) as f32 / 100.0 - 1.0).collect();
        for content in [Content::Raw, Content::Bc4] {
            let first = Codebook::of_cells(content, 64, &[cell(1), cell(2), cell(3)]).unwrap();
            assert_eq!(first.size(), (64, 64));
            let grown = first.grown(&Codebook::of_cells(content, 64, &[cell(4)]).unwrap()).unwrap();
            assert_eq!(grown.size(), (64, 96));
            assert_eq!(grown.values()[..64 * 64], *first.values());
            assert_eq!(grown.first_rows(64).unwrap(), first);
            assert!(grown.first_rows(128).is_none());
            let other = Codebook::of_cells(content, 32, &[cell(4)]).unwrap();
            assert!(first.grown(&other).is_none());
        }
    }
}

//! Detail transfer: content from a part of the first image only (paper section 7).

use texfold_core::SourceError;
use texfold_core::image::Raster;

use super::pyramid::{SCALES, Space};

/// Cells of all formats that lie wholly inside the mask, where its first channel is above one half.
///
/// # Errors
/// [`SourceError::Guidance`] where the mask has another size than the first image, or no cell is inside.
pub(crate) fn allowed_cells(space: &Space, mask: &Raster) -> Result<Vec<bool>, SourceError> {
    let wrong = |what: &'static str| SourceError::Guidance { map: "content mask", what };
    let size = space.pyramids[0].size;
    if mask.size() != size {
        return Err(wrong("its size is not the first image's"));
    }
    let mut allowed = vec![false; space.cells()];
    for format in 0..space.stored.len() {
        for scale in 0..space.scales() {
            let field = &space.pyramids[0].source[scale];
            let rows = space.rows_of(format, 0, scale);
            let (width, height) = (rows.side << SCALES[scale].across, rows.side << SCALES[scale].down);
            for y in 0..(field.height as u32).div_ceil(rows.side) {
                for x in 0..rows.columns {
                    let mut texels = (y * height..(y + 1) * height)
                        .flat_map(|y| (x * width..(x + 1) * width).map(move |x| (x, y)));
                    let inside =
                        |(x, y): (u32, u32)| x < size.width && y < size.height && mask.value(x, y, 0) > 0.5;
                    allowed[rows.number(x, y) as usize] = texels.all(inside);
                }
            }
        }
    }
    if allowed.iter().any(|&cell| cell) {
        Ok(allowed)
    } else {
        Err(wrong("no cell of content lies inside it"))
    }
}

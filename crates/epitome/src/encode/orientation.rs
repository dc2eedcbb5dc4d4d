//! The eight orientations of a chart: quarter rotations, mirrored or not.

use crate::format::Matrix;

/// An orientation: columns and rows may be exchanged, then each counted from the other end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Orientation {
    exchanged: bool,
    from_right: bool,
    from_below: bool,
}

impl Orientation {
    /// All of them, the one that changes nothing first.
    pub(crate) fn all() -> impl Iterator<Item = Orientation> {
        (0..8u8).map(|bits| Orientation {
            exchanged: bits & 4 != 0,
            from_right: bits & 1 != 0,
            from_below: bits & 2 != 0,
        })
    }

    /// Columns and rows of what had so many.
    pub(crate) fn size(self, (width, height): (u32, u32)) -> (u32, u32) {
        if self.exchanged { (height, width) } else { (width, height) }
    }

    /// Where cell or texel (x, y) of so many columns and rows goes.
    pub(crate) fn cell(self, (x, y): (u32, u32), size: (u32, u32)) -> (u32, u32) {
        let (x, y) = if self.exchanged { (y, x) } else { (x, y) };
        let (width, height) = self.size(size);
        let x = if self.from_right { width - 1 - x } else { x };
        let y = if self.from_below { height - 1 - y } else { y };
        (x, y)
    }

    /// Where a point goes, of a rectangle of that size in the same unit.
    pub(crate) fn point(self, (x, y): (i64, i64), (width, height): (i64, i64)) -> (i64, i64) {
        let (x, y, width, height) =
            if self.exchanged { (y, x, height, width) } else { (x, y, width, height) };
        (if self.from_right { width - x } else { x }, if self.from_below { height - y } else { y })
    }

    /// The 2x2 matrix that reads rotated content as `matrix` reads it unrotated.
    pub(crate) fn matrix(self, matrix: Matrix) -> Matrix {
        let [a, b, c, d] = matrix;
        let [a, b, c, d] = if self.exchanged { [c, d, a, b] } else { [a, b, c, d] };
        let across = if self.from_right { -1 } else { 1 };
        let down = if self.from_below { -1 } else { 1 };
        [across * a, across * b, down * c, down * d]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_points_and_matrices_rotate_alike() {
        let size = (5, 3);
        let mut seen = std::collections::BTreeSet::new();
        for orientation in Orientation::all() {
            let (width, height) = orientation.size(size);
            let cells: Vec<_> = (0..15).map(|i| orientation.cell((i % 5, i / 5), size)).collect();
            assert!(cells.iter().all(|&(x, y)| x < width && y < height), "{orientation:?}");
            assert!(seen.insert(cells.clone()), "{orientation:?} is another one again");
            // The centre of a cell goes to the centre of the cell that it becomes; a step follows the 2x2 matrix.
            let [a, b, c, d] = orientation.matrix([1, 0, 0, 1]).map(i64::from);
            let of =
                |x: u32, y: u32| orientation.point((2 * i64::from(x) + 1, 2 * i64::from(y) + 1), (10, 6));
            for (i, &(x, y)) in (0..15).zip(&cells) {
                let (column, row) = (i % 5, i / 5);
                assert_eq!(of(column, row), (2 * i64::from(x) + 1, 2 * i64::from(y) + 1), "{orientation:?}");
                if column > 0 && row > 0 {
                    let ((right, below), (left, above)) = (of(column, row), of(column - 1, row - 1));
                    assert_eq!((right - left, below - above), (2 * (a + b), 2 * (c + d)), "{orientation:?}");
                }
            }
        }
        assert_eq!(Orientation::all().next(), Some(Orientation::default()));
    }
}

//! The few numbers by which maps are told apart when codebooks are built.

use ndarray::Array2;

/// Numbers by which maps are told apart when codebooks are built: principal components, which hold nearly all of what maps as smooth
/// as these differ by.
const COMPONENTS: usize = 24;
/// Rounds in which these are found.
const POWERS: usize = 2;
/// Square of what is left of a column beside the others, in squares of the column, below which it is their sum but for rounding.
const LEAST_SQUARE: f32 = 1e-10;

/// The largest principal components of vectors, by subspace iteration: O(vectors x numbers x components x rounds), where eigenvectors of
/// the whole covariance would take the cube of the numbers.
pub(super) fn principal(vectors: &Array2<f32>) -> Array2<f32> {
    let dims = vectors.ncols();
    if dims <= COMPONENTS {
        return vectors.clone();
    }
    let start = |(row, column): (usize, usize)| scattered((row * COMPONENTS + column) as u32);
    let mut basis = Array2::from_shape_fn((dims, COMPONENTS), start);
    for _ in 0..POWERS {
        basis = vectors.t().dot(&vectors.dot(&basis));
        orthonormalise(&mut basis);
    }
    vectors.dot(&basis)
}

/// A value from -1 to 1 that follows no order of numbers: a start that is orthogonal to no component. Products with the two odd
/// constants mix all bits of the number into the upper 24 (the second is MurmurHash3's).
fn scattered(number: u32) -> f32 {
    let hash = number.wrapping_mul(0x9e37_79b9).rotate_left(11).wrapping_mul(0x85eb_ca6b);
    (hash >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// Gram and Schmidt's, column by column; a column that the others already span becomes 0.
fn orthonormalise(basis: &mut Array2<f32>) {
    for column in 0..basis.ncols() {
        let mut own = basis.column(column).to_owned();
        let before = own.dot(&own);
        for other in 0..column {
            let share = own.dot(&basis.column(other));
            own.scaled_add(-share, &basis.column(other));
        }
        let square = own.dot(&own);
        let scale = if square > before * LEAST_SQUARE && square > 0.0 { square.sqrt().recip() } else { 0.0 };
        basis.column_mut(column).assign(&(own * scale));
    }
}

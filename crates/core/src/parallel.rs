//! Rows of texels in parallel where the feature `encode` brings rayon, one after the other where it does not.

/// Calls `work(row, texels)` for every row of `width` items of `out`; the last may be shorter. Rows may be worked on in
/// parallel and in any order, so the result must not depend on it.
#[cfg(feature = "encode")]
pub fn for_each_row<T: Send>(out: &mut [T], width: usize, work: impl Fn(usize, &mut [T]) + Send + Sync) {
    use rayon::prelude::*;
    out.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, texels)| work(row, texels));
}

/// Calls `work(row, texels)` for every row of `width` items of `out`; the last may be shorter.
#[cfg(not(feature = "encode"))]
pub fn for_each_row<T: Send>(out: &mut [T], width: usize, work: impl Fn(usize, &mut [T]) + Send + Sync) {
    out.chunks_mut(width.max(1)).enumerate().for_each(|(row, texels)| work(row, texels));
}

/// The results of `work` for 0 to `count`, in that order.
#[cfg(feature = "encode")]
pub fn map<R: Send>(count: usize, work: impl Fn(usize) -> R + Send + Sync) -> Vec<R> {
    use rayon::prelude::*;
    (0..count).into_par_iter().map(work).collect()
}

/// The results of `work` for 0 to `count`, in that order.
#[cfg(not(feature = "encode"))]
pub fn map<R: Send>(count: usize, work: impl Fn(usize) -> R + Send + Sync) -> Vec<R> {
    (0..count).map(work).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_results_are_in_order() {
        let mut out = [0; 10];
        for_each_row(&mut out, 4, |row, items| items.fill(row + 1));
        assert_eq!(out, [1, 1, 1, 1, 2, 2, 2, 2, 3, 3]);
        assert_eq!(map(4, |index| index * index), [0, 1, 4, 9]);
    }
}

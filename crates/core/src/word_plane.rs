//! Arrays of 32-bit words as textures: a word's column and row follow from its index by a shift and a mask.
//!
//! A row has 2^`row_log2` words. It is as short as [`MAX_PLANE_SIDE`] rows allow, so that at most one row is padding.

use std::borrow::Cow;

use crate::{MAX_PLANE_SIDE, Plane, PlaneFormat};

/// Fewest words of a row, as a binary logarithm.
const LEAST_ROW_LOG2: u32 = 6;

/// How an array of words is laid out as a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WordRows {
    /// Words of a row, as a binary logarithm.
    pub row_log2: u32,
    /// Words of the texture: whole rows, or one shorter row.
    pub words: usize,
}

impl WordRows {
    /// The layout of `words` words. Up to [`MAX_PLANE_SIDE`] squared fit a texture.
    #[must_use]
    pub fn of(words: usize) -> Self {
        let mut row_log2 = LEAST_ROW_LOG2;
        while words.div_ceil(1 << row_log2) > MAX_PLANE_SIDE as usize {
            row_log2 += 1;
        }
        let whole = if words > 1 << row_log2 { words.next_multiple_of(1 << row_log2) } else { words };
        WordRows { row_log2, words: whole }
    }

    /// Fills `words` up with 0 to whole rows. The result has no room beyond them; nothing is copied where `words` was
    /// made with room for just these.
    #[must_use]
    pub fn padded(mut words: Vec<u32>) -> (Vec<u32>, Self) {
        let rows = WordRows::of(words.len());
        words.reserve_exact(rows.words - words.len());
        words.resize(rows.words, 0);
        words.shrink_to_fit();
        (words, rows)
    }
}

/// The plane of `words`, as [`WordRows::padded`] gives them; borrowed on little-endian machines.
#[must_use]
pub fn word_plane<'a>(part: &'static str, words: &'a [u32], row_log2: u32) -> Plane<'a> {
    let width = words.len().clamp(1, 1 << row_log2);
    let data = match bytemuck::try_cast_slice::<u32, u8>(words) {
        Ok(bytes) if cfg!(target_endian = "little") => Cow::Borrowed(bytes),
        _ => Cow::Owned(words.iter().flat_map(|word| word.to_le_bytes()).collect()),
    };
    Plane {
        part,
        format: PlaneFormat::R32Uint,
        width: width as u32,
        height: (words.len() / width) as u32,
        levels: 1,
        data,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_whole_and_fit_a_texture() {
        for count in [1, 63, 64, 65, 128, 8192 * 64, 8192 * 64 + 1, 8192 * 8192] {
            let rows = WordRows::of(count);
            assert!(rows.words >= count && rows.words < count + (1 << rows.row_log2), "{count}");
            assert!(
                rows.words <= 1 << rows.row_log2 || rows.words.is_multiple_of(1 << rows.row_log2),
                "{count}"
            );
            assert!(rows.words.div_ceil(1 << rows.row_log2) <= MAX_PLANE_SIDE as usize, "{count}");
            assert!(
                rows.row_log2 == 6 || count > 8192 << (rows.row_log2 - 1),
                "{count} takes the shortest row"
            );
        }
        let (words, rows) = WordRows::padded(vec![7; 65]);
        assert_eq!(words.capacity(), 128, "no room beyond whole rows");
        let mut roomy = vec![7; 65];
        roomy.reserve(1000);
        assert_eq!(WordRows::padded(roomy).0.capacity(), 128);
        let plane = word_plane("map", &words, rows.row_log2);
        assert_eq!((plane.width, plane.height, plane.data.len()), (64, 2, 512));
        assert_eq!(plane.data[..4], [7, 0, 0, 0]);
    }
}

//! Order, place and subband of the 64 coefficients of a block.

/// Columns of a block's padded plane of magnitudes: 8 and two beyond the last, which read as zero.
pub(super) const PADDED_SIDE: usize = 10;
/// Length of such a plane: a power of two, so that masked places need no check of bounds.
pub(super) const PADDED: usize = 128;
/// Subbands that tables differ by.
pub(super) const ZONES: usize = 6;
/// Coefficients of a block.
pub(super) const COEFFICIENTS: usize = 64;

/// A coefficient in coding order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Place in a block's 64 coefficients, column by column.
    pub raster: u8,
    /// Place in a padded plane of magnitudes.
    pub padded: u8,
    /// Subband by the sum of both frequencies: 0, 1, 2, 3 to 4, 5 to 7, above.
    pub zone: u8,
}

/// Coefficients by diagonals from the lowest frequency on; every other diagonal runs the other way.
pub(super) const SCAN: [Place; COEFFICIENTS] = scan();

const fn zone(diagonal: usize) -> u8 {
    match diagonal {
        0..=2 => diagonal as u8,
        3..=4 => 3,
        5..=7 => 4,
        _ => 5,
    }
}

const fn scan() -> [Place; COEFFICIENTS] {
    let mut places = [Place { raster: 0, padded: 0, zone: 0 }; COEFFICIENTS];
    let (mut next, mut diagonal) = (0, 0);
    while diagonal < 15 {
        let mut step = 0;
        while step <= diagonal {
            let (column, row) =
                if diagonal % 2 == 0 { (step, diagonal - step) } else { (diagonal - step, step) };
            if column < 8 && row < 8 {
                let raster = (column * 8 + row) as u8;
                let padded = (row * PADDED_SIDE + column) as u8;
                places[next] = Place { raster, padded, zone: zone(diagonal) };
                next += 1;
            }
            step += 1;
        }
        diagonal += 1;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_coefficient_comes_once_and_after_none_of_its_template() {
        let mut seen = [false; PADDED];
        for place in SCAN.iter().rev() {
            let at = usize::from(place.padded);
            for beyond in [1, 2, PADDED_SIDE, 2 * PADDED_SIDE, PADDED_SIDE + 1] {
                let (column, row) = ((at + beyond) % PADDED_SIDE, (at + beyond) / PADDED_SIDE);
                assert!(column >= 8 || row >= 8 || seen[at + beyond], "{at} needs {beyond} beyond");
            }
            assert!(!std::mem::replace(&mut seen[at], true));
        }
        assert_eq!(seen.iter().filter(|&&seen| seen).count(), COEFFICIENTS);
    }
}

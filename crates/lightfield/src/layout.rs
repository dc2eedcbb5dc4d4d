//! Where patches and view maps lie in their atlases: a function of the patches' sides, so no place is stored.

use crate::params::MAX_TERMS;

/// Longest side of an atlas in texels: what every WebGPU device can sample.
pub(crate) const MAX_SIDE: u32 = 8192;
/// Largest binary logarithm of a patch's side.
pub(crate) const MAX_SIDE_LOG2: u8 = 6;
/// Terms with which atlases are about square. The places do not depend on the number of terms.
const USUAL_TERMS: f64 = 3.0;
/// Rows of an atlas from one term to the next are multiples of a block's side, so that no block belongs to two terms.
const BLOCK: u32 = 4;

/// The places of all maps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    /// For each triangle the word that the shader reads.
    pub(crate) places: Vec<u32>,
    /// Columns of the mean's atlas, and from one corner to the next in that of the surface maps.
    pub(crate) surface_width: u32,
    /// Rows of the mean's atlas, and from one term to the next in that of the surface maps.
    pub(crate) surface_height: u32,
    /// View maps in a row.
    pub(crate) view_columns: u32,
    /// Rows of the view maps' atlas from one term to the next.
    pub(crate) view_height: u32,
}

impl Layout {
    /// For patches of the given sides and view maps of `grid` texels a side, a multiple of 4; `None` where an atlas
    /// would be longer than [`MAX_SIDE`].
    pub(crate) fn new(sides_log2: &[u8], vertices: u32, grid: u32, terms: u32) -> Option<Layout> {
        let terms = terms.clamp(1, MAX_TERMS);
        let (places, surface_width, surface_height) = patches(sides_log2)?;
        let columns = (f64::from(vertices) * USUAL_TERMS).sqrt().ceil() as u32;
        let view_columns = columns.clamp(1, vertices.max(1)).min(MAX_SIDE / grid);
        let view_height = vertices.div_ceil(view_columns).max(1) * grid;
        let tall = |height: u32| u64::from(height) * u64::from(terms) > u64::from(MAX_SIDE);
        if tall(surface_height) || tall(view_height) {
            return None;
        }
        Some(Layout { places, surface_width, surface_height, view_columns, view_height })
    }
}

/// Places of the patches, and columns and rows of their atlas: largest first, row by row, two to a rectangle.
fn patches(sides_log2: &[u8]) -> Option<(Vec<u32>, u32, u32)> {
    let area: u64 = sides_log2.iter().map(|&log2| ((1u64 << log2) + 1) * ((1u64 << log2) + 2) / 2).sum();
    let largest = sides_log2.iter().max().map_or(1, |&log2| (1u32 << log2) + 1);
    // About as wide as tall with three corners across and the usual terms down.
    let ideal = (area as f64 * USUAL_TERMS / 3.0).sqrt().ceil().min(f64::from(MAX_SIDE / 3)) as u32;
    let width = ideal.max(largest).next_multiple_of(BLOCK).min(MAX_SIDE / 3 / BLOCK * BLOCK);
    let mut places = vec![0u32; sides_log2.len()];
    let mut top = 0u64;
    for log2 in (0..=MAX_SIDE_LOG2).rev() {
        let side = 1u32 << log2;
        // No patch is wider than the atlas, so this is 0 only for sides that none has.
        let columns = (width / (side + 1)).max(1);
        let mut count = 0u32;
        for (place, _) in places.iter_mut().zip(sides_log2).filter(|&(_, &found)| found == log2) {
            let (slot, turned) = (count / 2, count % 2);
            let (x, y) = (slot % columns * (side + 1), top + u64::from(slot / columns * (side + 2)));
            if y + u64::from(side) + 2 > u64::from(MAX_SIDE) {
                return None;
            }
            *place = x | (y as u32) << 14 | u32::from(log2) << 28 | turned << 31;
            count += 1;
        }
        top += u64::from(count.div_ceil(2).div_ceil(columns)) * u64::from(side + 2);
    }
    let height = u32::try_from(top).ok()?.max(1).next_multiple_of(BLOCK);
    (height <= MAX_SIDE).then_some((places, width, height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::texfold_lightfield_patch;
    use glam::Vec3;

    #[test]
    fn no_two_patches_share_a_texel_and_none_leaves_the_atlas() {
        for sides in [vec![0], vec![6; 3], (0..200).map(|i| (i * 7 % 5) as u8).collect::<Vec<u8>>()] {
            for terms in [0, 1, 3, 8] {
                let layout = Layout::new(&sides, 90, 16, terms).unwrap();
                let mut owner = std::collections::HashMap::new();
                for (triangle, (&place, &log2)) in layout.places.iter().zip(&sides).enumerate() {
                    let side = 1u32 << log2;
                    for (i, j) in (0..=side).flat_map(|i| (0..=side - i).map(move |j| (i, j))) {
                        let (u, v) = (i as f32 / side as f32, j as f32 / side as f32);
                        let read = texfold_lightfield_patch(place, Vec3::new(1.0 - u - v, u, v));
                        let texels = [read.a, read.b, read.c];
                        let at = texels[read.weights.max_position()];
                        assert!((read.weights.max_element() - 1.0).abs() < 1e-6);
                        assert!(at.x < layout.surface_width && at.y < layout.surface_height);
                        assert_eq!(owner.insert(at, (triangle, i, j)), None);
                    }
                }
            }
        }
    }

    #[test]
    fn what_does_not_fit_a_texture_is_refused() {
        assert_eq!(Layout::new(&vec![6; 200_000], 90, 16, 1), None);
        assert_eq!(Layout::new(&[2; 10], 200_000, 64, 8), None);
        assert!(Layout::new(&vec![3; 100_000], 50_000, 16, 3).is_some());
    }
}

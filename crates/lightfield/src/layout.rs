//! Where maps lie in their atlases: a function of which maps there are, so no place is stored.
//!
//! A layer is the mean or a term. It holds patches of several sides and, of a term, view maps; which triangle or vertex uses which of them is
//! [`Sharing`]. All layers of one atlas have its width and lie one below the other.

use texfold_core::MAX_PLANE_SIDE;

/// Most vertices: with [`MAX_TRIANGLES`], atlases fit a texture of 8192 texels a side, with any number of terms.
pub(crate) const MAX_VERTICES: usize = 1 << 18;
/// Most triangles.
pub(crate) const MAX_TRIANGLES: usize = 1 << 19;
/// Largest binary logarithm of a patch's side.
pub(crate) const MAX_SIDE_LOG2: u8 = 6;
/// Sides that patches may have.
pub(crate) const SIDES: usize = MAX_SIDE_LOG2 as usize + 1;
/// The number of a map that is not there.
pub(crate) const NONE: u32 = u32::MAX;
/// Rows of an atlas from one term to the next are multiples of a block's side, so that no block belongs to two terms.
const BLOCK: u32 = 4;

/// Places of a patch of side `n`, in the order in which its texels are stored.
#[cfg(feature = "encode")]
pub(crate) fn lattice(n: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..=n).flat_map(move |i| (0..=n - i).map(move |j| (i, j)))
}

/// The sides of terms' patches, where those of the mean are downscaled by `reduce_log2`.
pub(crate) fn reduced(sides_log2: &[u8], reduce_log2: u8) -> Vec<u8> {
    sides_log2.iter().map(|log2| log2.saturating_sub(reduce_log2)).collect()
}

/// Which of a layer's maps is used where.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Sharing {
    /// Whether maps are codewords that several may use; otherwise each has its own, in order.
    pub(crate) shared: bool,
    /// Patches by binary logarithm of their side.
    pub(crate) patches: [u32; SIDES],
    /// View maps.
    pub(crate) views: u32,
    /// For each triangle of the mean, for each corner of each triangle of a term, its patch among those of its side; or [`NONE`].
    pub(crate) patch_of: Vec<u32>,
    /// For each vertex its view map, or [`NONE`].
    pub(crate) view_of: Vec<u32>,
}

impl Sharing {
    /// Where each has its own: a patch for each of `sides_log2` and a view map for each of `views` that `uses` them.
    pub(crate) fn own(
        sides_log2: impl Iterator<Item = Option<u8>>,
        views: impl Iterator<Item = bool>,
    ) -> Sharing {
        let mut sharing = Sharing::default();
        let mut next = |log2: u8| {
            let count = &mut sharing.patches[usize::from(log2.min(MAX_SIDE_LOG2))];
            *count += 1;
            *count - 1
        };
        sharing.patch_of = sides_log2.map(|log2| log2.map_or(NONE, &mut next)).collect();
        let mut count = 0;
        let mut next = |uses: bool| {
            count += u32::from(uses);
            if uses { count - 1 } else { NONE }
        };
        sharing.view_of = views.map(&mut next).collect();
        sharing.views = count;
        sharing
    }

    /// Texels of all patches, and of all view maps of `grid` texels a side.
    #[cfg(feature = "encode")]
    pub(crate) fn texels(&self, grid: u32) -> (u64, u64) {
        let of_side = |(log2, &count): (usize, &u32)| {
            let side = 1u64 << log2;
            u64::from(count) * (side + 1) * (side + 2) / 2
        };
        let patches = self.patches.iter().enumerate().map(of_side).sum();
        (patches, u64::from(self.views) * u64::from(grid) * u64::from(grid))
    }
}

/// Columns of the atlases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Widths {
    /// Of the mean's, a multiple of 4.
    pub(crate) mean: u32,
    /// Of the surface maps', a multiple of 4.
    pub(crate) surface: u32,
    /// Of the view maps', a multiple of their side.
    pub(crate) view: u32,
}

impl Widths {
    /// With which atlases of these layers, the mean first, are about square.
    #[cfg(feature = "encode")]
    pub(crate) fn of(layers: &[Sharing], largest_log2: u8, grid: u32) -> Widths {
        let width = |texels: u64, multiple: u32, least: u32| {
            let ideal = (texels as f64).sqrt().ceil().min(f64::from(MAX_PLANE_SIDE)) as u32;
            (ideal.max(least).next_multiple_of(multiple)).min(MAX_PLANE_SIDE / multiple * multiple)
        };
        let (mean, terms) =
            layers.split_first().map_or((0, &[][..]), |(mean, terms)| (mean.texels(grid).0, terms));
        let (patches, views) = terms
            .iter()
            .map(|term| term.texels(grid))
            .fold((0, 0), |sum, term| (sum.0 + term.0, sum.1 + term.1));
        let least = (1u32 << largest_log2) + 1;
        Widths {
            mean: width(mean, BLOCK, least),
            surface: width(patches, BLOCK, least),
            view: width(views, grid, grid),
        }
    }

    /// Whether a reader may take them: within a texture, wide enough for a patch of the side and for a view map.
    pub(crate) fn fit(self, largest_log2: u8, grid: u32) -> bool {
        let wide = |width: u32, multiple: u32, least: u32| {
            (least..=MAX_PLANE_SIDE).contains(&width) && width.is_multiple_of(multiple)
        };
        let least = (1u32 << largest_log2) + 1;
        wide(self.mean, BLOCK, least) && wide(self.surface, BLOCK, least) && wide(self.view, grid, grid)
    }
}

/// The places of all maps.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Layout {
    /// For each layer, triangle and, in terms, corner the word that the shader reads; 0 where there is none.
    pub(crate) patches: Vec<Vec<u32>>,
    /// For each layer and vertex column (14 bits) and row of its view map; 0 where there is none.
    pub(crate) views: Vec<Vec<u32>>,
    /// For each layer the first row after its patches, and the first row after its view maps.
    pub(crate) ends: Vec<Rows>,
}

/// Rows of two atlases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Rows {
    /// Of the surface maps', or of the mean's.
    pub(crate) surface: u32,
    /// Of the view maps'.
    pub(crate) view: u32,
}

impl Layout {
    /// For triangles whose patches have the given sides, in the mean and in terms; `None` where an atlas would be longer than [`MAX_PLANE_SIDE`].
    pub(crate) fn new(
        sides_log2: [&[u8]; 2],
        layers: &[Sharing],
        widths: Widths,
        grid: u32,
    ) -> Option<Layout> {
        let mut layout = Layout { patches: Vec::new(), views: Vec::new(), ends: Vec::new() };
        let (mut top, mut view_top) = (0, 0);
        for (number, layer) in layers.iter().enumerate() {
            // The mean has one patch a triangle and an atlas of its own.
            let (corners, width) = if number == 0 { (1, widths.mean) } else { (3, widths.surface) };
            let shelves = Shelves::new(&layer.patches, width, if number == 1 { 0 } else { top })?;
            let sides_log2 = sides_log2[number.min(1)];
            let place = |(at, &patch): (usize, &u32)| shelves.place(sides_log2[at / corners], patch);
            layout.patches.push(layer.patch_of.iter().enumerate().map(place).collect());
            top = shelves.end;
            let columns = (widths.view / grid).max(1);
            let of_view = |&view: &u32| match view {
                NONE => 0,
                view => (view % columns * grid) | (view_top + view / columns * grid) << 14,
            };
            let rows = u64::from(layer.views.div_ceil(columns)) * u64::from(grid);
            if u64::from(view_top) + rows > u64::from(MAX_PLANE_SIDE) {
                return None;
            }
            layout.views.push(layer.view_of.iter().map(of_view).collect());
            view_top += rows as u32;
            layout.ends.push(Rows { surface: top, view: view_top });
        }
        Some(layout)
    }

    /// Rows of the mean's atlas.
    pub(crate) fn mean_rows(&self) -> u32 {
        self.ends.first().map_or(0, |end| end.surface)
    }

    /// Rows of the surface maps' and of the view maps' atlas of the first `terms` terms.
    pub(crate) fn rows(&self, terms: u32) -> Rows {
        if terms == 0 { Rows::default() } else { self.ends.get(terms as usize).copied().unwrap_or_default() }
    }
}

/// Rows of patches of one layer: largest sides first, two patches to a rectangle.
struct Shelves {
    /// The first row of each side.
    tops: [u32; SIDES],
    width: u32,
    /// The first row after all.
    end: u32,
}

impl Shelves {
    fn new(counts: &[u32; SIDES], width: u32, first: u32) -> Option<Shelves> {
        let mut tops = [0; SIDES];
        let mut top = u64::from(first);
        for log2 in (0..SIDES).rev() {
            tops[log2] = top.min(u64::from(MAX_PLANE_SIDE)) as u32;
            let side = 1u32 << log2;
            // No patch that is there is wider than the atlas.
            let columns = (width / (side + 1)).max(1);
            top += u64::from(counts[log2].div_ceil(2).div_ceil(columns)) * u64::from(side + 2);
        }
        let end = top.next_multiple_of(u64::from(BLOCK));
        (end <= u64::from(MAX_PLANE_SIDE)).then_some(Shelves { tops, width, end: end as u32 })
    }

    /// The word that the shader reads: column (14 bits), row (14 bits), binary logarithm of the side (3 bits) and whether the patch is
    /// turned by half (1 bit).
    fn place(&self, log2: u8, patch: u32) -> u32 {
        if patch == NONE {
            return 0;
        }
        let side = 1u32 << log2;
        let columns = (self.width / (side + 1)).max(1);
        let (slot, turned) = (patch / 2, patch % 2);
        let (x, y) =
            (slot % columns * (side + 1), self.tops[usize::from(log2)] + slot / columns * (side + 2));
        x | y << 14 | u32::from(log2) << 28 | turned << 31
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{texfold_lightfield_patch, texfold_lightfield_texel};
    use glam::Vec3;

    fn layout(sides: &[u8], vertices: u32, terms: usize) -> (Option<Layout>, Widths) {
        let mut layers = vec![Sharing::own(sides.iter().map(|&log2| Some(log2)), std::iter::empty())];
        for term in 0..terms {
            // Every third corner and every second vertex of a term has no map.
            let corners = (0..3 * sides.len()).map(|at| ((at + term) % 3 > 0).then_some(sides[at / 3]));
            layers.push(Sharing::own(corners, (0..vertices).map(|vertex| vertex % 2 == 0)));
        }
        let widths = Widths::of(&layers, sides.iter().copied().max().unwrap_or(0), 16);
        (Layout::new([sides; 2], &layers, widths, 16), widths)
    }

    #[test]
    fn no_two_maps_share_a_texel_and_none_leaves_its_atlas() {
        for sides in [vec![0], vec![6; 3], (0..200).map(|i| (i * 7 % 5) as u8).collect::<Vec<u8>>()] {
            for terms in [0, 1, 3, 8] {
                let (layout, widths) = layout(&sides, 90, terms);
                let layout = layout.unwrap();
                let mut owner = std::collections::HashMap::new();
                let mut tiles = std::collections::HashMap::new();
                for layer in 0..=terms {
                    let width = if layer == 0 { widths.mean } else { widths.surface };
                    for (at, &place) in layout.patches[layer].iter().enumerate() {
                        let corners = if layer == 0 { 1 } else { 3 };
                        if layer > 0 && (at + layer - 1) % 3 == 0 {
                            assert_eq!(place, 0);
                            continue;
                        }
                        let side = 1u32 << sides[at / corners];
                        for (i, j) in (0..=side).flat_map(|i| (0..=side - i).map(move |j| (i, j))) {
                            let (u, v) = (i as f32 / side as f32, j as f32 / side as f32);
                            let read = texfold_lightfield_patch(side, Vec3::new(1.0 - u - v, u, v));
                            let at = [read.a, read.b, read.c][read.weights.max_position()];
                            assert!((read.weights.max_element() - 1.0).abs() < 1e-6);
                            let texel = texfold_lightfield_texel(place, side, at);
                            assert!(texel.x < width && texel.y < layout.ends[layer].surface);
                            assert_eq!(owner.insert((layer == 0, texel), layer), None);
                        }
                    }
                    for (vertex, &place) in layout.views[layer].iter().enumerate().filter(|(v, _)| v % 2 == 0)
                    {
                        let (x, y) = (place & 0x3fff, place >> 14);
                        assert!(x + 16 <= widths.view && y + 16 <= layout.ends[layer].view);
                        assert_eq!(tiles.insert((x / 16, y / 16), vertex), None);
                    }
                }
            }
        }
    }

    #[test]
    fn what_does_not_fit_a_texture_is_refused() {
        assert_eq!(layout(&vec![6; 200_000], 90, 1).0, None);
        assert_eq!(layout(&[2; 10], 2_000_000, 1).0, None);
        assert!(layout(&vec![2; 100_000], 50_000, 3).0.is_some());
    }
}

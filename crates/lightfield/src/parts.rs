//! What a light field is put together of, before or after it is a file.

use texfold_bc::ContentPlanes;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};

use crate::Mesh;
use crate::decode::TEXFOLD_LIGHTFIELD_ROW;
use crate::kinds::{Directions, Factors};
use crate::layout::{Layout, Sharing, Widths, reduced};

/// Pixels of all maps: red, green and blue.
pub(crate) const PIXEL: PixelInfo =
    PixelInfo { channels: 3, depth: Depth::Eight, color: ColorSpace::Srgb, alpha: Alpha::Opaque };

/// The byte of a map that stands for 0, and bytes from there to the one that stands for 1.
pub(crate) fn zero_and_range(factors: Factors) -> (f32, f32) {
    match factors {
        Factors::Signed => (128.0, 127.0),
        Factors::NonNegative => (0.0, 255.0),
    }
}

/// What a light field is put together of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub(crate) mesh: Mesh,
    /// Binary logarithm of the side of each triangle's patch.
    pub(crate) sides_log2: Vec<u8>,
    /// Log2 by which these are downscaled for surface maps.
    pub(crate) surface_reduce_log2: u8,
    pub(crate) directions: Directions,
    pub(crate) factors: Factors,
    pub(crate) grid: u32,
    /// Terms of the whole file.
    pub(crate) total_terms: u32,
    /// Terms that are there.
    pub(crate) terms: u32,
    /// Scales of the terms that are there: term by term, vertex by vertex, red, green and blue.
    pub(crate) scales: Vec<u8>,
    /// Which maps are used where: of the mean, then of the terms that are there.
    pub(crate) layers: Vec<Sharing>,
    pub(crate) widths: Widths,
    pub(crate) mean: ContentPlanes,
    pub(crate) surface: ContentPlanes,
    pub(crate) view: ContentPlanes,
}

impl Parts {
    /// Where all maps lie. Parts are only put together of maps that fit an atlas.
    pub(crate) fn layout(&self) -> Layout {
        let coarse = reduced(&self.sides_log2, self.surface_reduce_log2);
        let sides = [&self.sides_log2[..], &coarse];
        Layout::new(sides, &self.layers, self.widths, self.grid).unwrap_or_default()
    }

    /// Words of the mesh as the shader reads it, in whole rows.
    pub(crate) fn words(&self) -> u64 {
        words(self.mesh.positions.len() as u64, self.mesh.triangles.len() as u64, self.terms)
    }
}

/// Words of a mesh of so many vertices and triangles as the shader reads it, in whole rows.
pub(crate) fn words(vertices: u64, triangles: u64, terms: u32) -> u64 {
    let terms = u64::from(terms);
    let words = (6 + 2 * terms) * vertices + (4 + 3 * terms) * triangles;
    words.next_multiple_of(u64::from(TEXFOLD_LIGHTFIELD_ROW))
}

/// Columns and rows of the mean's atlas.
pub(crate) fn mean_size(layout: &Layout, widths: Widths) -> (u32, u32) {
    (widths.mean, layout.mean_rows().max(4))
}

/// Columns and rows of the surface maps' atlas; at least a block, as a texture has texels.
pub(crate) fn surface_size(layout: &Layout, widths: Widths, terms: u32) -> (u32, u32) {
    (widths.surface, layout.rows(terms).surface.max(4))
}

/// Columns and rows of the view maps' atlas; likewise.
pub(crate) fn view_size(layout: &Layout, widths: Widths, terms: u32) -> (u32, u32) {
    (widths.view, layout.rows(terms).view.max(4))
}

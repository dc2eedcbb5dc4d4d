//! What a light field is put together of, before or after it is a file.

use texfold_bc::ContentPlanes;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::sample::TEXFOLD_RGBA;
use texfold_core::{ImageLayout, ImageSize, Rect, Texel};
use texfold_dct::DctContent;

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

/// Names of the parts in the footprint.
pub(crate) const MEAN_PART: &str = "mean";
/// As above.
pub(crate) const SURFACE_PART: &str = "surface maps";
/// As above.
pub(crate) const VIEW_PART: &str = "view maps";
/// As above, of both in blocks, which a section of the file holds together.
pub(crate) const MAPS_PART: &str = "surface and view maps";

/// Rows of blocks that are decoded at a time: those of the tallest superblock.
const DECODED_ROWS: u32 = 64;

/// The three atlases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Atlas {
    Mean,
    Surface,
    View,
}

/// The texels of the atlases.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Payload {
    /// In planes that shaders read.
    Planes { mean: ContentPlanes, surface: ContentPlanes, view: ContentPlanes },
    /// In blocks of variable length, which are decoded before they are drawn: the mean's atlas, and of each term its rows of
    /// the other two, as [`TermRows::layout`] has them.
    Blocks { mean: DctContent, terms: Vec<Option<DctContent>> },
}

/// The rows of a term in the atlases of surface maps and of view maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TermRows {
    /// First row and number of rows, of surface maps and of view maps.
    pub(crate) bands: [(u32, u32); 2],
    /// Columns of these atlases.
    pub(crate) widths: [u32; 2],
}

impl TermRows {
    pub(crate) fn of(layout: &Layout, widths: Widths, term: u32) -> TermRows {
        let (begin, end) = (layout.rows(term), layout.rows(term + 1));
        let band = |begin: u32, end: u32| (begin, end - begin);
        TermRows {
            bands: [band(begin.surface, end.surface), band(begin.view, end.view)],
            widths: [widths.surface, widths.view],
        }
    }

    /// The bands that have rows: which atlas, first row, and size.
    pub(crate) fn images(&self) -> impl Iterator<Item = (Atlas, u32, ImageSize)> + use<> {
        let bands = [Atlas::Surface, Atlas::View].into_iter().zip(self.bands).zip(self.widths);
        let image = |((atlas, (row, height)), width)| (atlas, row, ImageSize { width, height });
        bands.map(image).filter(|(_, _, size)| size.height > 0)
    }

    /// The layout of the term's images; `None` where no vertex has the term.
    pub(crate) fn layout(&self) -> Option<ImageLayout> {
        let images: Vec<ImageSize> = self.images().map(|(_, _, size)| size).collect();
        (!images.is_empty()).then(|| atlas_layout(images))
    }
}

/// Layout of maps in blocks: no mip levels.
pub(crate) fn atlas_layout(images: Vec<ImageSize>) -> ImageLayout {
    ImageLayout::new(images, 1, PIXEL)
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
    pub(crate) payload: Payload,
}

impl Parts {
    /// Where all maps lie. Parts are only put together of maps that fit an atlas.
    pub(crate) fn layout(&self) -> Layout {
        let coarse = reduced(&self.sides_log2, self.surface_reduce_log2);
        let sides = [&self.sides_log2[..], &coarse];
        Layout::new(sides, &self.layers, self.widths, self.grid).unwrap_or_default()
    }

    /// Columns and rows of an atlas.
    pub(crate) fn size_of(&self, layout: &Layout, atlas: Atlas) -> (u32, u32) {
        match atlas {
            Atlas::Mean => mean_size(layout, self.widths),
            Atlas::Surface => surface_size(layout, self.widths, self.terms),
            Atlas::View => view_size(layout, self.widths, self.terms),
        }
    }

    /// How texels of the mean and of the maps are read.
    pub(crate) fn swizzles(&self) -> [u32; 2] {
        match &self.payload {
            Payload::Planes { mean, surface, .. } => [mean.swizzle().0, surface.swizzle().0],
            // Blocks are decoded to four channels.
            Payload::Blocks { .. } => [TEXFOLD_RGBA; 2],
        }
    }

    /// The bands of an atlas in blocks: first row, content and which of its images; the mean's has one.
    pub(crate) fn bands<'p>(
        &self,
        layout: &Layout,
        (mean, terms): (&'p DctContent, &'p [Option<DctContent>]),
        atlas: Atlas,
    ) -> Vec<(u32, &'p DctContent, u32)> {
        if atlas == Atlas::Mean {
            return vec![(0, mean, 0)];
        }
        let of_term = |(term, content): (u32, &'p Option<DctContent>)| {
            let content = content.as_ref()?;
            let mut images = (0..).zip(TermRows::of(layout, self.widths, term).images());
            let (number, (_, row, _)) = images.find(|(_, (found, _, _))| *found == atlas)?;
            Some((row, content, number))
        };
        (0..).zip(terms).filter_map(of_term).collect()
    }

    /// The texels of an atlas, row by row.
    pub(crate) fn texels(&self, atlas: Atlas) -> Vec<Texel> {
        match (&self.payload, atlas) {
            (Payload::Planes { mean, .. }, Atlas::Mean) => mean.decode(),
            (Payload::Planes { surface, .. }, Atlas::Surface) => surface.decode(),
            (Payload::Planes { view, .. }, Atlas::View) => view.decode(),
            (Payload::Blocks { mean, terms }, _) => {
                let layout = self.layout();
                let (width, height) = self.size_of(&layout, atlas);
                let mut texels = vec![Texel::ZERO; width as usize * height as usize];
                for (row, content, image) in self.bands(&layout, (mean, terms), atlas) {
                    decode_band(content, image, &mut texels[row as usize * width as usize..]);
                }
                texels
            }
        }
    }

    /// Words of the mesh as the shader reads it, in whole rows.
    pub(crate) fn words(&self) -> u64 {
        words(self.mesh.positions.len() as u64, self.mesh.triangles.len() as u64, self.terms)
    }
}

/// Decodes an image to the texels that begin at its first row.
fn decode_band(content: &DctContent, image: u32, out: &mut [Texel]) {
    let Some(&ImageSize { width, height }) = content.layout().images.get(image as usize) else {
        return;
    };
    let texels = out.len().min(width as usize * height as usize);
    let rows = out[..texels].chunks_mut(width as usize * DECODED_ROWS as usize);
    for (y, out) in (0..height).step_by(DECODED_ROWS as usize).zip(rows) {
        let rect = Rect { image, level: 0, x: 0, y, width, height: DECODED_ROWS.min(height - y) };
        // The rows lie inside of the image.
        let _ = content.decode(rect, out);
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

//! What a file holds, before it is laid out for sampling: the map's form, its entries and palettes, the epitomes'
//! planes.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::PixelInfo;
use texfold_core::{ImageLayout, ImageSize, PlaneFormat, Texel};
use texfold_dct::DctContent;
use texfold_residual::ResidualContent;

use crate::decode::TEXFOLD_EPITOME_FINE_LEVELS;
use crate::format::{LayerMap, MapFormat, Palettes};
use crate::layers::{CellLayers, Layering, columns_of, edited, layers_at, numbers};
use crate::map::MapPlane;

/// Mip levels that an epitome has beside its full size, where there are any: one less than the image has that are
/// read from it, as blending four texels halves once more.
pub(crate) const PLANE_MIPS: u32 = 1;
/// Texels along a side of what is transformed at a time in blocks of variable length.
pub(crate) const TRANSFORM_SIDE: u32 = 8;
/// Most entries and most blocks: the map plane, with up to one and a half words an entry, has at most 8192 x 8192
/// words.
pub(crate) const MAX_ENTRIES: u64 = 1 << 25;
/// All that a file holds, before it is laid out for sampling.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub(crate) layout: ImageLayout,
    pub(crate) format: MapFormat,
    pub(crate) palettes: Palettes,
    /// The map that is drawn.
    pub(crate) map: MapPlane,
    /// Epitomes without a residual plane, each with its mip levels; one or two with that of `errors`.
    pub(crate) epitomes: Vec<Vec<ContentPlanes>>,
    /// The last epitome where it has a residual plane: the second, or the only one.
    pub(crate) errors: Option<Box<ResidualContent>>,
    /// For each image the levels that are not read from the epitome.
    pub(crate) coarse: Vec<Vec<ContentPlanes>>,
    /// The only epitome and those levels where they are in blocks of variable length, instead of all that is above.
    pub(crate) blocks: Option<Box<BlockParts>>,
    /// Where the file has several layers: what the map above and the epitomes are made of.
    pub(crate) layering: Option<Box<Layering>>,
}

/// Texels in blocks of variable length.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BlockParts {
    /// The epitome, with its mip level where there are any.
    pub(crate) epitome: DctContent,
    /// The levels of all images that are not read from the epitome, where there are any.
    pub(crate) coarse: Option<DctContent>,
}

impl BlockParts {
    /// Columns and rows of the epitome.
    pub(crate) fn size(&self) -> ImageSize {
        self.epitome.layout().images.first().copied().unwrap_or(ImageSize { width: 0, height: 0 })
    }
}

impl Parts {
    /// Trees and entries of a layer that is there.
    pub(crate) fn map_of(&self, layer: u32) -> LayerMap {
        let finest = self.map.unpacked(&self.format);
        let Some(layering) = &self.layering else { return finest };
        let coarser = layering.coarser.iter().skip(layer as usize).rev();
        coarser.fold(finest, |finer, map| map.unpacked(&self.format, &finer))
    }

    /// The parts with the first `count` layers, at least one; `None` where no more are there.
    pub(crate) fn first_layers(&self, count: u32) -> Option<Parts> {
        let layering = self.layering.as_ref()?;
        let count = count.max(1);
        if count >= layering.loaded() {
            return None;
        }
        let mut parts = self.clone();
        parts.map = MapPlane::new(&self.format, &self.palettes, &self.map_of(count - 1));
        for (levels, cells) in parts.epitomes.iter_mut().zip(&layering.cells) {
            let columns = columns_of(levels);
            let cells = cells.unpacked();
            for (level, planes) in (0u32..).zip(levels.iter_mut()) {
                let layers = layers_at(&cells, columns, level);
                let gone = numbers(&layers, |layer| u32::from(layer) >= count);
                *planes = edited(planes, &gone, |place, _| place.fill(0));
            }
        }
        let cells = |cells: &CellLayers| {
            let cells: Vec<u8> = cells.unpacked().into_iter().map(|layer| layer.min(count as u8)).collect();
            CellLayers::new(&cells, layering.total)
        };
        parts.layering = Some(Box::new(Layering {
            total: layering.total,
            rows: layering.rows.clone(),
            coarser: layering.coarser[..count as usize - 1].to_vec(),
            cells: layering.cells.iter().map(cells).collect(),
        }));
        Some(parts)
    }

    /// Columns and rows of an epitome without a residual plane as it is drawn: with all layers there, rows below
    /// those that the finest reads are not needed.
    pub(crate) fn drawn_size(&self, epitome: usize) -> (u32, u32) {
        let size =
            self.epitomes.get(epitome).and_then(|levels| levels.first()).map_or((4, 4), |base| base.size());
        let layering = self.layering.as_ref().filter(|layering| layering.loaded() == layering.total);
        let rows = layering.and_then(|layering| layering.rows.get(epitome));
        (size.0, rows.map_or(size.1, |&rows| rows.min(size.1)))
    }

    /// The levels of an epitome without a residual plane as they are drawn.
    pub(crate) fn drawn(&self, epitome: usize) -> impl Iterator<Item = DrawnLevel<'_>> {
        let rows = self.drawn_size(epitome).1;
        let levels = self.epitomes.get(epitome).map_or(&[][..], Vec::as_slice);
        (0u32..).zip(levels).map(move |(level, planes)| {
            let (width, height) = planes.size();
            DrawnLevel { planes, size: (width, (rows >> level).min(height)) }
        })
    }
}

/// A mip level of an epitome, of which no more than the first rows may be drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawnLevel<'a> {
    planes: &'a ContentPlanes,
    /// Columns and rows that are drawn.
    pub(crate) size: (u32, u32),
}

impl<'a> DrawnLevel<'a> {
    /// All of a level.
    pub(crate) fn whole(planes: &'a ContentPlanes) -> Self {
        DrawnLevel { planes, size: planes.size() }
    }

    /// Format and bytes of each plane.
    pub(crate) fn planes(self) -> impl Iterator<Item = (PlaneFormat, &'a [u8])> {
        let (width, height) = self.size;
        self.planes.planes().iter().map(move |(format, bytes)| {
            let drawn = bytes.get(..format.bytes(width, height) as usize).unwrap_or(bytes);
            (*format, drawn)
        })
    }

    /// Its texels, row by row.
    pub(crate) fn decode(self) -> Vec<Texel> {
        let mut texels = self.planes.decode();
        texels.truncate(self.size.0 as usize * self.size.1 as usize);
        texels
    }

    /// Whether a GPU holds the same of both.
    pub(crate) fn is_drawn_as(self, other: DrawnLevel<'_>) -> bool {
        self.size == other.size && self.planes().eq(other.planes())
    }
}

/// How levels that are not read from the epitome are stored: one plane, whatever the epitome has. BC1 shows reduced
/// images worse than full ones, so that they may be `finer` than the epitome.
pub(crate) fn coarse_content(content: Content, pixel: PixelInfo, finer: bool) -> Content {
    match (content, pixel.channels) {
        (Content::Bc1, _) if finer => Content::Bc7,
        (Content::Raw, 1) => Content::Bc4,
        (Content::Raw, 2) => Content::Bc5,
        (Content::Raw, _) => Content::Bc7,
        (other, _) => other,
    }
}

/// Columns and rows of an epitome with a residual plane.
pub(crate) fn epitome_size(errors: &ResidualContent) -> [u32; 2] {
    let size = errors.size();
    [size.width, size.height]
}

/// Mip levels that come from the coarse chain, for an image of `levels` levels.
pub(crate) fn coarse_levels(levels: u32) -> std::ops::Range<u32> {
    TEXFOLD_EPITOME_FINE_LEVELS.min(levels)..levels
}

/// The layout of an epitome in blocks of that size.
pub(crate) fn epitome_layout(size: ImageSize, images: &ImageLayout) -> ImageLayout {
    let levels = if images.levels > 1 { 1 + PLANE_MIPS } else { 1 };
    ImageLayout::new(vec![size], levels, images.pixel)
}

/// The layout of what comes from the coarse chain of images of that layout, if anything does.
pub(crate) fn coarse_layout(images: &ImageLayout) -> Option<ImageLayout> {
    let range = coarse_levels(images.levels);
    let sizes = images.images.iter().map(|size| size.at_level(range.start)).collect();
    (!range.is_empty()).then(|| ImageLayout::new(sizes, range.len() as u32, images.pixel))
}

//! Index planes: images of one size lie in one plane, below one another, in several columns where one would be too
//! long.

use std::collections::HashMap;

use texfold_core::address::TEXFOLD_CLAMP;
use texfold_core::{ImageLayout, ImageSize, MAX_PLANE_SIDE, PlaneFormat};

use crate::decode::{TEXFOLD_VQ_LEVELS, TexfoldVqParams};

/// How images of one size lie in their index plane. One texel of the plane is one block of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Arrangement {
    /// Columns of the plane that one image fills.
    width: u32,
    /// Rows of the plane that one image fills: all of its levels.
    rows: u32,
    /// Images side by side.
    columns: u32,
    /// Images below one another.
    lines: u32,
}

/// Images of one size: where each one's blocks lie in the shared index plane.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SizeClass {
    pub(crate) params: TexfoldVqParams,
    /// Column and row of each block's window in the codebook; the plane row by row.
    pub(crate) index: Vec<[u8; 2]>,
    /// Columns of the plane.
    pub(crate) index_width: u32,
    arrangement: Arrangement,
    /// Blocks of all levels of one image.
    blocks: u32,
}

/// Place of an image: its class, and its number among the images of that class.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    pub(crate) class: usize,
    pub(crate) number: u32,
}

/// Images grouped by size, in the order in which sizes first appear; a size that fills a plane begins a further group.
#[derive(Debug)]
pub(crate) struct Groups {
    /// Size and number of images of each group.
    sizes: Vec<(ImageSize, u32)>,
    /// For each image its place.
    pub(crate) places: Vec<Place>,
    levels: u32,
}

/// Blocks of `levels` levels of an image of `size`.
pub(crate) fn blocks_of(size: ImageSize, levels: u32) -> u32 {
    (0..levels).map(|level| size.at_level(level).blocks()).map(|(columns, rows)| columns * rows).sum()
}

/// Rows of the index plane that an image of `size` fills; more than [`MAX_PLANE_SIDE`] cannot be stored.
pub(crate) fn rows_of(size: ImageSize, levels: u32) -> u32 {
    blocks_of(size, levels).div_ceil(size.blocks().0)
}

impl Arrangement {
    /// Of `count` images of `size`.
    fn new(size: ImageSize, levels: u32, count: u32) -> Self {
        let rows = rows_of(size, levels);
        let columns = count.div_ceil((MAX_PLANE_SIDE / rows).max(1)).max(1);
        Arrangement { width: size.blocks().0, rows, columns, lines: count.div_ceil(columns) }
    }

    /// Most images of `size` that one plane holds.
    fn capacity(size: ImageSize, levels: u32) -> u32 {
        (MAX_PLANE_SIDE / rows_of(size, levels)).max(1) * (MAX_PLANE_SIDE / size.blocks().0).max(1)
    }

    /// Columns of the plane.
    fn plane_width(&self) -> u32 {
        self.width * self.columns
    }

    /// Rows of the plane.
    fn plane_height(&self) -> u32 {
        self.rows * self.lines
    }

    /// Bytes of the plane.
    pub(crate) fn bytes(&self) -> u64 {
        PlaneFormat::Rg8Uint.bytes(self.plane_width(), self.plane_height())
    }
}

impl Groups {
    pub(crate) fn of(layout: &ImageLayout) -> Groups {
        let mut sizes: Vec<(ImageSize, u32)> = Vec::new();
        let mut open = HashMap::new();
        let mut places = Vec::new();
        for &size in &layout.images {
            let class = open.entry(size).or_insert(usize::MAX);
            let is_open = sizes
                .get(*class)
                .is_some_and(|&(_, count)| count < Arrangement::capacity(size, layout.levels));
            if !is_open {
                *class = sizes.len();
                sizes.push((size, 0));
            }
            places.push(Place { class: *class, number: sizes[*class].1 });
            sizes[*class].1 += 1;
        }
        Groups { sizes, places, levels: layout.levels }
    }

    /// How the images of each group are laid out.
    pub(crate) fn planes(&self) -> impl Iterator<Item = Arrangement> + '_ {
        self.sizes.iter().map(|&(size, count)| Arrangement::new(size, self.levels, count))
    }

    /// Empty planes; texels of the codebook are read by `swizzle`.
    pub(crate) fn classes(&self, swizzle: u32) -> Vec<SizeClass> {
        let class = |(&(size, _), arrangement)| SizeClass::new(size, self.levels, swizzle, arrangement);
        self.sizes.iter().zip(self.planes()).map(class).collect()
    }
}

impl SizeClass {
    /// An empty plane.
    fn new(size: ImageSize, levels: u32, swizzle: u32, arrangement: Arrangement) -> Self {
        let mut level_start = [0; TEXFOLD_VQ_LEVELS];
        let mut blocks = 0;
        for level in 0..levels {
            level_start[level as usize] = blocks;
            let (columns, rows) = size.at_level(level).blocks();
            blocks += columns * rows;
        }
        let params = TexfoldVqParams {
            size: [size.width, size.height],
            levels,
            address_mode: TEXFOLD_CLAMP,
            swizzle,
            rows: arrangement.rows,
            reserved: [0; 2],
            level_start,
        };
        let index_width = arrangement.plane_width();
        let index = vec![[0; 2]; index_width as usize * arrangement.plane_height() as usize];
        SizeClass { params, index, index_width, arrangement, blocks }
    }

    /// Rows of the index plane.
    pub(crate) fn index_height(&self) -> u32 {
        self.arrangement.plane_height()
    }

    /// Column and row of the plane where image `number` begins.
    fn origin(&self, number: u32) -> (u32, u32) {
        let Arrangement { width, rows, columns, .. } = self.arrangement;
        (number % columns * width, number / columns * rows)
    }

    /// The shader's `image` argument for image `number`.
    pub(crate) fn argument(&self, number: u32) -> u32 {
        let (x, y) = self.origin(number);
        x * MAX_PLANE_SIDE + y
    }

    /// Position in the plane of block `block` (levels one after the other, row by row) of image `number`.
    pub(crate) fn position(&self, number: u32, block: u32) -> usize {
        let ((x, y), width) = (self.origin(number), self.arrangement.width);
        ((y + block / width) * self.index_width + x + block % width) as usize
    }

    /// Blocks of all levels of one image.
    pub(crate) fn blocks(&self) -> u32 {
        self.blocks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::PixelInfo;

    fn layout(sizes: &[(u32, u32, usize)], levels: u32) -> ImageLayout {
        let image = |&(width, height, count): &(u32, u32, usize)| vec![ImageSize { width, height }; count];
        let images = sizes.iter().flat_map(image).collect();
        ImageLayout::new(images, levels, PixelInfo::default())
    }

    #[test]
    fn no_plane_is_longer_than_a_device_can_sample() {
        // Two images of 8192 x 8192 blocks; 70 of a quarter of that; narrow ones by the thousand.
        let many =
            layout(&[(1 << 15, 1 << 15, 2), (1 << 14, 1 << 14, 70), (4, 32768, 9000), (37, 61, 20_000)], 1);
        let groups = Groups::of(&many);
        let mut counts: HashMap<usize, u32> = HashMap::new();
        for place in &groups.places {
            assert_eq!(place.number, *counts.entry(place.class).and_modify(|count| *count += 1).or_insert(0));
        }
        for plane in groups.planes() {
            assert!(
                plane.plane_width() <= MAX_PLANE_SIDE && plane.plane_height() <= MAX_PLANE_SIDE,
                "{plane:?}"
            );
        }
        assert_eq!(groups.sizes.len(), 2 + 18 + 2 + 1, "{:?}", groups.sizes);
    }

    #[test]
    fn every_block_has_a_texel_of_its_own() {
        for levels in [1, 3] {
            let layout = layout(&[(37, 61, 3), (8, 4, 2), (37, 61, 1), (4, 4000, 30)], levels);
            let groups = Groups::of(&layout);
            let classes = groups.classes(0);
            let mut used: Vec<Vec<bool>> =
                classes.iter().map(|class| vec![false; class.index.len()]).collect();
            for place in &groups.places {
                let class = &classes[place.class];
                for block in 0..class.blocks() {
                    let texel = &mut used[place.class][class.position(place.number, block)];
                    assert!(!std::mem::replace(texel, true), "{place:?} block {block}");
                }
            }
        }
    }
}

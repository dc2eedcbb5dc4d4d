//! Sizes of images and of their mip levels.

use super::{MapInfo, PixelInfo};

/// Width and height of one image in texels of level 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ImageSize {
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
}

impl ImageSize {
    /// Number of texels of level 0.
    #[must_use]
    pub fn texels(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Size of mip level `level`: halved and rounded down, at least 1.
    #[must_use]
    pub fn at_level(self, level: u32) -> ImageSize {
        let halve = |side: u32| side.checked_shr(level).unwrap_or(0).max(1);
        ImageSize { width: halve(self.width), height: halve(self.height) }
    }

    /// Number of levels of a full mip chain, down to 1x1.
    #[must_use]
    pub fn full_levels(self) -> u32 {
        32 - self.width.max(self.height).max(1).leading_zeros()
    }

    /// Columns and rows of 4x4 blocks that cover the image.
    #[must_use]
    pub fn blocks(self) -> (u32, u32) {
        (self.width.div_ceil(4), self.height.div_ceil(4))
    }
}

/// Which images, levels and channels an encoded texture holds.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageLayout {
    /// Size of every image, in the order of the source.
    pub images: Vec<ImageSize>,
    /// Mip levels stored for every image; 1 means level 0 alone. An image with a shorter full chain
    /// repeats its last level.
    pub levels: u32,
    /// Channels, depth, colour space and alpha of the source; of maps, those of the first.
    pub pixel: PixelInfo,
    /// The map that each image is, of a material; empty for images of one kind.
    pub maps: Vec<MapInfo>,
}

impl ImageLayout {
    /// Images of one kind.
    #[must_use]
    pub fn new(images: Vec<ImageSize>, levels: u32, pixel: PixelInfo) -> Self {
        ImageLayout { images, levels, pixel, maps: Vec::new() }
    }

    /// Channels, depth, colour space and alpha of an image.
    #[must_use]
    pub fn pixel_of(&self, image: u32) -> PixelInfo {
        self.maps.get(image as usize).map_or(self.pixel, |map| map.pixel)
    }

    /// Number of the map of that name.
    #[must_use]
    pub fn map(&self, name: &str) -> Option<u32> {
        self.maps.iter().position(|map| map.name == name).map(|index| index as u32)
    }

    /// Source texels of level 0 that bits are counted over: those of all images, or of the largest map, as maps lie over one another.
    #[must_use]
    pub fn texels(&self) -> u64 {
        let texels = self.images.iter().map(|size| size.texels());
        if self.maps.is_empty() { texels.sum() } else { texels.max().unwrap_or(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_halve_down_to_one() {
        let size = ImageSize { width: 13, height: 4 };
        assert_eq!(size.full_levels(), 4);
        assert_eq!(size.at_level(2), ImageSize { width: 3, height: 1 });
        assert_eq!(size.at_level(31), ImageSize { width: 1, height: 1 });
        assert_eq!(size.at_level(40), ImageSize { width: 1, height: 1 });
    }
}

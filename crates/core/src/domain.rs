//! What an address is: texels of flat images, or rays that leave a surface.

use glam::Vec3;

use crate::image::ImageLayout;

mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Image2d {}
    impl Sealed for super::SurfaceLight {}
}

/// The space that an encoded texture is sampled in.
pub trait Domain: sealed::Sealed + 'static {
    /// One place that can be sampled.
    type Address: Copy;
    /// A set of places with an order, decoded in one call.
    type Region<'r>: Copy;
    /// The extent of the domain: which addresses exist.
    type Layout;
    /// How many addresses `region` holds.
    fn len(region: Self::Region<'_>) -> usize;
    /// The `index`-th address of `region`, `index < len(region)`.
    fn address(region: Self::Region<'_>, index: usize) -> Self::Address;
}

/// Flat images: one, a set of them, or the frames of a sequence.
#[derive(Debug, Clone, Copy)]
pub enum Image2d {}

/// One texel of one mip level of one image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImageAddress {
    /// Which image of the set, or frame of the sequence.
    pub image: u32,
    /// Mip level; 0 is the full size.
    pub level: u32,
    /// Column in texels of that level.
    pub x: u32,
    /// Row in texels of that level, from the top.
    pub y: u32,
}

/// A rectangle of texels of one level of one image, in row order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// Which image of the set, or frame of the sequence.
    pub image: u32,
    /// Mip level; 0 is the full size.
    pub level: u32,
    /// Leftmost column in texels.
    pub x: u32,
    /// Topmost row in texels.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Domain for Image2d {
    type Address = ImageAddress;
    type Region<'r> = Rect;
    type Layout = ImageLayout;

    fn len(region: Rect) -> usize {
        region.width as usize * region.height as usize
    }

    fn address(region: Rect, index: usize) -> ImageAddress {
        let width = region.width.max(1) as usize;
        ImageAddress {
            image: region.image,
            level: region.level,
            x: region.x + (index % width) as u32,
            y: region.y + (index / width) as u32,
        }
    }
}

impl ImageLayout {
    /// The whole of `level` of image `image`; `None` where there is no such image or level.
    #[must_use]
    pub fn whole(&self, image: u32, level: u32) -> Option<Rect> {
        let size = self.images.get(image as usize)?.at_level(level);
        (level < self.levels).then_some(Rect {
            image,
            level,
            x: 0,
            y: 0,
            width: size.width,
            height: size.height,
        })
    }

    /// `Ok` where every texel of `rect` exists.
    ///
    /// # Errors
    /// [`crate::RegionError`] names what lies outside.
    pub fn check(&self, rect: Rect) -> Result<(), crate::RegionError> {
        let size = self
            .images
            .get(rect.image as usize)
            .ok_or(crate::RegionError::NoSuchImage { image: rect.image, images: self.images.len() })?;
        if rect.level >= self.levels {
            return Err(crate::RegionError::NoSuchLevel { level: rect.level, levels: self.levels });
        }
        let size = size.at_level(rect.level);
        let inside =
            |start: u32, length: u32, end: u32| u64::from(start) + u64::from(length) <= u64::from(end);
        if !inside(rect.x, rect.width, size.width) || !inside(rect.y, rect.height, size.height) {
            return Err(crate::RegionError::Outside { width: size.width, height: size.height });
        }
        Ok(())
    }
}

/// Surface light fields: colour by place on a mesh and by direction.
#[derive(Debug, Clone, Copy)]
pub enum SurfaceLight {}

/// A ray that leaves a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightAddress {
    /// Index of the triangle.
    pub triangle: u32,
    /// Weights of the triangle's three vertices, summing to 1.
    pub barycentric: Vec3,
    /// Unit vector from the surface towards the eye, in the mesh's space.
    pub direction: Vec3,
}

/// The extent of a surface light field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LightLayout {
    /// Triangles of the mesh.
    pub triangles: u32,
    /// Stored terms of the approximation, beside the mean.
    pub terms: u32,
}

impl Domain for SurfaceLight {
    type Address = LightAddress;
    type Region<'r> = &'r [LightAddress];
    type Layout = LightLayout;

    fn len(region: &[LightAddress]) -> usize {
        region.len()
    }

    fn address(region: &[LightAddress], index: usize) -> LightAddress {
        region[index]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rect_addresses_run_row_by_row() {
        let rect = Rect { image: 2, level: 1, x: 5, y: 7, width: 3, height: 2 };
        assert_eq!(Image2d::len(rect), 6);
        assert_eq!(Image2d::address(rect, 4), ImageAddress { image: 2, level: 1, x: 6, y: 8 });
    }
}

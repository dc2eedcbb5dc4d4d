//! Images that are compressed together.

use super::{Alpha, Depth, ImageLayout, ImageSize, MapInfo, MapKind, PixelInfo, Raster};
use crate::{MAX_IMAGE_SIDE, SourceError};

/// Images that are compressed together: one image, a set, or the frames of a sequence in order.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageSet {
    images: Vec<Raster>,
    /// The map that each image is, of a material.
    maps: Vec<MapInfo>,
}

impl ImageSet {
    /// A set of at least one image. Images that differ in channels are all given the channels that hold every
    /// one of them; colour space is that of the first, alpha that of the first which has any, and errors
    /// are measured against the largest [`Raster::peak`]. Values are rounded to 16 bits, the most that a source has: what
    /// arithmetic before left below, such as 1e-7 of a resampled image, would else decide between equal matches and codewords.
    ///
    /// # Errors
    /// [`SourceError::Empty`].
    pub fn new(images: Vec<Raster>) -> Result<Self, SourceError> {
        let first = images.first().ok_or(SourceError::Empty)?.info();
        let rgb = images.iter().any(|image| image.info().channels > 2);
        let extra = images.iter().map(Raster::info).find(|info| info.has_extra());
        let channels = if rgb { 3 } else { 1 } + u8::from(extra.is_some());
        let peak = images.iter().map(Raster::peak).fold(0.0, f32::max);
        let unify = |image: Raster| {
            let image = if image.info().channels == channels { image } else { image.with_channels(channels) };
            image.tagged(first.color, extra.map_or(Alpha::Opaque, |info| info.alpha)).with_peak(peak)
        };
        Ok(ImageSet::of(images.into_iter().map(unify)))
    }

    /// A set of one, its values as [`ImageSet::new`] leaves them.
    #[must_use]
    pub fn single(image: Raster) -> Self {
        ImageSet::of([image])
    }

    fn of(images: impl IntoIterator<Item = Raster>) -> Self {
        ImageSet { images: images.into_iter().map(Raster::settled).collect(), maps: Vec::new() }
    }

    /// The maps of a material, which lie over one another: each keeps its size, channels, depth and colour space. `maps` has the kind of
    /// each and its name, by which it is found and written: up to [`MapInfo::MAX_NAME`] bytes that a file may be named with.
    ///
    /// # Errors
    /// [`SourceError`] without a map or with more than [`MapInfo::MAX_MAPS`], and for a name that is no such name or is there twice.
    pub fn of_maps(maps: Vec<(MapKind, String, Raster)>) -> Result<Self, SourceError> {
        if maps.is_empty() {
            return Err(SourceError::Empty);
        }
        let (infos, images): (Vec<MapInfo>, Vec<Raster>) = maps
            .into_iter()
            .map(|(kind, name, image)| (MapInfo { kind, name, pixel: image.info() }, image))
            .unzip();
        MapInfo::check(&infos)?;
        Ok(ImageSet { maps: infos, ..ImageSet::of(images) })
    }

    /// The map that each image is, of a material; empty for images of one kind.
    #[must_use]
    pub fn maps(&self) -> &[MapInfo] {
        &self.maps
    }

    /// [`ImageSet::check_sides`], and `Ok` only where the images are of one kind, as all codecs but `dct` need them.
    ///
    /// # Errors
    /// [`SourceError::Maps`], and as there.
    pub fn check_images(&self) -> Result<(), SourceError> {
        if self.maps.is_empty() { self.check_sides() } else { Err(SourceError::Maps) }
    }

    /// The images.
    #[must_use]
    pub fn images(&self) -> &[Raster] {
        &self.images
    }

    /// The same images with one colour channel each; see [`Raster::to_gray`].
    #[must_use]
    pub fn to_gray(&self) -> ImageSet {
        ImageSet::of(self.images.iter().map(Raster::to_gray))
    }

    /// `Ok` where no side is longer than [`MAX_IMAGE_SIDE`], the longest that a file can name.
    ///
    /// # Errors
    /// [`SourceError::TooLarge`] names the first image that is too large.
    pub fn check_sides(&self) -> Result<(), SourceError> {
        let mut sizes = self.images.iter().map(Raster::size).enumerate();
        match sizes.find(|(_, size)| size.width.max(size.height) > MAX_IMAGE_SIDE) {
            Some((index, ImageSize { width, height })) => {
                Err(SourceError::TooLarge { index, width, height, max: MAX_IMAGE_SIDE })
            }
            None => Ok(()),
        }
    }

    /// What the channels of every image are; of maps, those of the first.
    #[must_use]
    pub fn info(&self) -> PixelInfo {
        if let Some(first) = self.maps.first() {
            return first.pixel;
        }
        let depth = if self.images.iter().any(|image| image.info().depth == Depth::Sixteen) {
            Depth::Sixteen
        } else {
            Depth::Eight
        };
        PixelInfo { depth, ..self.images[0].info() }
    }

    /// Layout of the set with `levels` mip levels.
    #[must_use]
    pub fn layout(&self, levels: u32) -> ImageLayout {
        let images = self.images.iter().map(Raster::size).collect();
        ImageLayout { maps: self.maps.clone(), ..ImageLayout::new(images, levels, self.info()) }
    }

    /// Texels that bits are counted over: those of all images, or of the largest map, as maps lie over one another.
    #[must_use]
    pub fn texel_count(&self) -> u64 {
        self.layout(1).texels()
    }

    /// Levels of the longest full mip chain.
    #[must_use]
    pub fn full_levels(&self) -> u32 {
        self.images.iter().map(|image| image.size().full_levels()).max().unwrap_or(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::ColorSpace;

    #[test]
    fn sets_round_what_arithmetic_left_and_nothing_else() {
        let info = PixelInfo { channels: 1, ..PixelInfo::default() };
        for (most, stored) in [(255u32, 256), (65_535, 65_536)] {
            let exact: Vec<f32> = (0..stored).map(|value| value as f32 / most as f32).collect();
            for off in [0.0, 1e-7, -1e-7] {
                let moved = exact.iter().map(|value| value + off).collect();
                let set = ImageSet::single(Raster::new(stored, 1, info, moved).unwrap());
                assert!(set.images()[0].values().eq(exact.iter().copied()), "{most} {off}");
            }
        }
    }

    #[test]
    fn a_mixed_set_gets_the_channels_of_all() {
        let gray = Raster::from_u8(1, 1, 1, ColorSpace::Srgb, &[128]).unwrap();
        let rgba = Raster::from_u8(1, 1, 4, ColorSpace::Srgb, &[1, 2, 3, 4]).unwrap();
        let set = ImageSet::new(vec![gray, rgba]).unwrap();
        assert_eq!(set.images()[0].to_bytes(), [128, 128, 128, 255]);
        assert_eq!(set.info().alpha, Alpha::Straight);
        assert_eq!(ImageSet::new(vec![]), Err(SourceError::Empty));
    }

    #[test]
    fn images_that_a_file_cannot_name_are_named() {
        let line = |width| Raster::from_u8(width, 1, 1, ColorSpace::Srgb, &vec![0; width as usize]).unwrap();
        let most = ImageSet::single(line(MAX_IMAGE_SIDE));
        assert_eq!(most.check_sides(), Ok(()));
        let set = ImageSet::new(vec![line(1), line(MAX_IMAGE_SIDE + 1)]).unwrap();
        let error = SourceError::TooLarge { index: 1, width: 32769, height: 1, max: 32768 };
        assert_eq!(set.check_sides(), Err(error));
    }

    #[test]
    fn maps_keep_what_they_are_and_count_once() {
        let gray = Raster::from_u16(2, 3, 1, ColorSpace::Linear, &[9; 6]).unwrap();
        let rgb = Raster::from_u8(4, 6, 3, ColorSpace::Srgb, &[7; 72]).unwrap();
        let maps = |first: &str| {
            ImageSet::of_maps(vec![
                (MapKind::Height, first.to_owned(), gray.clone()),
                (MapKind::BaseColor, "wall_Color".to_owned(), rgb.clone()),
            ])
        };
        let set = maps("wall_Height").unwrap();
        let layout = set.layout(1);
        assert_eq!([0, 1].map(|map| layout.pixel_of(map)), [gray.info(), rgb.info()]);
        assert_eq!((set.texel_count(), layout.map("wall_Color"), layout.map("wall")), (24, Some(1), None));
        assert_eq!(set.check_images(), Err(SourceError::Maps));
        for name in ["wall_Color", "", "a/b", "a\nb", "..", &"long".repeat(20)] {
            assert!(matches!(maps(name), Err(SourceError::MapName { .. })), "{name}");
        }
    }
}

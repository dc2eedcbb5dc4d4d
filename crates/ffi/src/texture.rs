//! Textures: opening, what a file holds, texels.

use std::ffi::{CString, c_char};
use std::ptr;

use texfold::core::ImageSize;
use texfold::core::image::Depth;
use texfold::{Alpha, AnyImage, AnyTexture, ColorSpace, Rect};

use crate::Status;
use crate::status::{Failure, Outcome, guarded, kept, put, there, values, values_mut};

/// A texture of one image, a set, or the maps of a material.
pub struct Texture {
    pub(crate) image: AnyImage,
    codec: CString,
    /// Names and kinds of the maps of a material.
    maps: Vec<(CString, CString)>,
}

/// Limits of what opening a file allocates.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Texels of all images and mip levels.
    pub texels: u64,
    /// Bytes of memory.
    pub bytes: u64,
}

/// Description of a texture. Strings live as long as the texture.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Info {
    /// Name of the codec.
    pub codec: *const c_char,
    /// Images.
    pub images: u32,
    /// Mip levels of each image; 1 where there is level 0 alone.
    pub levels: u32,
    /// Layers that were in the file, of `layers` that a whole file has.
    pub layers_loaded: u32,
    /// Layers of a whole file.
    pub layers: u32,
    /// Bytes of the compressed form on a GPU.
    pub compressed_bytes: u64,
    /// Bytes on a GPU while it is drawn, decoded where the codec is read by block.
    pub resident_bytes: u64,
}

/// Description of an image of a texture. Strings live as long as the texture.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct ImageInfo {
    /// Columns of level 0. Level l has max(1, width >> l).
    pub width: u32,
    /// Rows of level 0.
    pub height: u32,
    /// 1 gray, 2 gray and alpha, 3 RGB, 4 RGB and alpha.
    pub channels: u32,
    /// Bits of a channel of the source, 8 or 16.
    pub bits: u32,
    /// "srgb", "linear" or "normal".
    pub color: *const c_char,
    /// Meaning of the second or fourth channel: "opaque", "straight", "cutout" or "band".
    pub alpha: *const c_char,
    /// Least alpha that is drawn, 0 to 1, where alpha is "cutout".
    pub cutout: f32,
    /// Name of the map; null but in a material.
    pub map: *const c_char,
    /// Kind of the map, such as "color", "normal", "orm"; null but in a material.
    pub map_kind: *const c_char,
}

/// A rectangle of a mip level of an image.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Region {
    /// Number of the image.
    pub image: u32,
    /// Mip level.
    pub level: u32,
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns; 0 for all from x on.
    pub width: u32,
    /// Rows; 0 for all from y on.
    pub height: u32,
}

impl Region {
    /// The rectangle, which must lie in the texture.
    pub(crate) fn rect(self, texture: &AnyImage) -> Outcome<Rect> {
        let layout = texture.as_encoded().layout();
        let whole = layout.whole(self.image, self.level);
        let size = whole.map_or(ImageSize { width: 0, height: 0 }, |Rect { width, height, .. }| ImageSize {
            width,
            height,
        });
        let rect = self.within(size);
        layout.check(rect)?;
        Ok(rect)
    }

    /// The rectangle in a level of that size; it may leave the level.
    pub(crate) fn within(self, size: ImageSize) -> Rect {
        let Region { image, level, x, y, width, height } = self;
        let extent =
            |given: u32, all: u32, first: u32| if given == 0 { all.saturating_sub(first) } else { given };
        Rect {
            image,
            level,
            x,
            y,
            width: extent(width, size.width, x),
            height: extent(height, size.height, y),
        }
    }
}

/// Opens a file of `size` bytes at `data`, which are not needed afterwards. `limits` may be null: 4 gigatexels and 8 GiB.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_open(
    data: *const u8,
    size: usize,
    limits: *const Limits,
    texture: *mut *mut Texture,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let (data, limits) = unsafe { (values(data, size, "data")?, limits.as_ref()) };
        let usual = texfold::Limits::default();
        let limits =
            limits.map_or(usual, |&Limits { texels, bytes }| texfold::Limits { texels, bytes, ..usual });
        let image = texfold::open_with(data, &limits).and_then(AnyTexture::into_image)?;
        let codec = kept(image.codec().name);
        let maps = image.as_encoded().layout().maps.iter();
        let maps = maps.map(|map| (kept(&map.name), kept(map.kind.name()))).collect();
        let opened = Box::into_raw(Box::new(Texture { image, codec, maps }));
        // SAFETY: as the crate says; where there is no room for it, it is freed.
        unsafe { put(texture, opened, "texture").inspect_err(|_| drop(Box::from_raw(opened))) }
    })
}

/// Frees a texture; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_close(texture: *mut Texture) {
    if !texture.is_null() {
        // SAFETY: it comes from `texfold_open` and was not freed.
        drop(unsafe { Box::from_raw(texture) });
    }
}

/// Describes a texture.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_info(texture: *const Texture, info: *mut Info) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let texture = unsafe { there(texture, "texture")? };
        let encoded = texture.image.as_encoded();
        let (layers, memory) = (encoded.layers(), encoded.memory());
        let found = Info {
            codec: texture.codec.as_ptr(),
            images: encoded.layout().images.len() as u32,
            levels: encoded.layout().levels,
            layers_loaded: layers.loaded,
            layers: layers.total,
            compressed_bytes: memory.compressed.div_ceil(8),
            resident_bytes: memory.resident.div_ceil(8),
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// Describes an image of a texture.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_image_info(
    texture: *const Texture,
    image: u32,
    info: *mut ImageInfo,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let texture = unsafe { there(texture, "texture")? };
        let layout = texture.image.as_encoded().layout();
        let size = Region { image, level: 0, x: 0, y: 0, width: 0, height: 0 }.rect(&texture.image)?;
        let pixel = layout.pixel_of(image);
        let (alpha, cutout) = match pixel.alpha {
            Alpha::Opaque => (c"opaque", 0.0),
            Alpha::Straight => (c"straight", 0.0),
            Alpha::Cutout(threshold) => (c"cutout", threshold),
            Alpha::Band => (c"band", 0.0),
        };
        let color = match pixel.color {
            ColorSpace::Srgb => c"srgb",
            ColorSpace::Linear => c"linear",
            ColorSpace::Normal => c"normal",
        };
        let map = texture.maps.get(image as usize);
        let found = ImageInfo {
            width: size.width,
            height: size.height,
            channels: pixel.channels.into(),
            bits: if pixel.depth == Depth::Sixteen { 16 } else { 8 },
            color: color.as_ptr(),
            alpha: alpha.as_ptr(),
            cutout,
            map: map.map_or(ptr::null(), |(name, _)| name.as_ptr()),
            map_kind: map.map_or(ptr::null(), |(_, kind)| kind.as_ptr()),
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// Decodes a region to RGBA of 8 bits a channel, row by row from the top, each `row_bytes` after the one before; 0 for rows without
/// padding. Gray is in red, green and blue; alpha that is not there is 255. `size` is the number of bytes at `pixels`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_decode_rgba8(
    texture: *const Texture,
    region: Region,
    pixels: *mut u8,
    size: usize,
    row_bytes: usize,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let (texture, pixels) = unsafe { (there(texture, "texture")?, values_mut(pixels, size, "pixels")?) };
        let rect = region.rect(&texture.image)?;
        let stride = if row_bytes == 0 { 4 * rect.width as usize } else { row_bytes };
        Ok(texture.image.decode_rgba8(rect, pixels, stride)?)
    })
}

/// As texfold_decode_rgba8 to 16 bits a channel, in the machine's byte order; `row_bytes` is even, `size` still in bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_decode_rgba16(
    texture: *const Texture,
    region: Region,
    pixels: *mut u16,
    size: usize,
    row_bytes: usize,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let (texture, pixels) =
            unsafe { (there(texture, "texture")?, values_mut(pixels, size / 2, "pixels")?) };
        if !row_bytes.is_multiple_of(2) {
            return Err(Failure::argument(format!("rows every {row_bytes} bytes; give an even number")));
        }
        let rect = region.rect(&texture.image)?;
        let stride = if row_bytes == 0 { 4 * rect.width as usize } else { row_bytes / 2 };
        Ok(texture.image.decode_rgba16(rect, pixels, stride)?)
    })
}

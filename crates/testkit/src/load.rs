//! Fixtures read from disk as rasters: making them anew takes seconds, reading them a millisecond.

use std::path::{Path, PathBuf};

use texfold_core::Texel;
use texfold_core::image::{ColorSpace, ImageSet, Raster};

/// The folder `fixtures` of the workspace.
#[must_use]
pub fn fixtures_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures")
}

/// Real photographs beside the checkout, or where `TEXFOLD_DATA` says; `None`, with a line that names what is skipped,
/// where there are none.
#[must_use]
pub fn data_dir(skipped: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let dir = std::env::var_os("TEXFOLD_DATA").map_or_else(beside, PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    println!("skipped: {skipped} needs real photographs; set TEXFOLD_DATA to their folder");
    None
}

/// An 8-bit PNG as a raster in sRGB.
///
/// # Panics
/// Where the file is missing or no such image: tests cannot go on without it.
#[must_use]
#[expect(clippy::panic, reason = "a test without its fixture must fail, and say which")]
pub fn png(path: &Path) -> Raster {
    let image = match image::open(path) {
        Ok(image) => image,
        Err(error) => panic!("{}: {error}", path.display()),
    };
    let (width, height, channels) = (image.width(), image.height(), image.color().channel_count());
    match Raster::from_u8(width, height, channels, ColorSpace::Srgb, image.as_bytes()) {
        Ok(raster) => raster,
        Err(error) => panic!("{}: {error}", path.display()),
    }
}

/// The fixture `images/<name>.png`.
#[must_use]
pub fn image(name: &str) -> Raster {
    png(&fixtures_dir().join(format!("images/{name}.png")))
}

/// The part of an image of `width` x `height` texels whose upper left texel is at (`x`, `y`).
///
/// # Panics
/// Where the part reaches beyond the image.
#[must_use]
#[expect(clippy::panic, reason = "a test without its image must fail, and say why")]
pub fn crop(image: &Raster, (x, y): (u32, u32), (width, height): (u32, u32)) -> Raster {
    let texels: Vec<Texel> = (0..width * height).map(|i| image.texel(x + i % width, y + i / width)).collect();
    match Raster::from_texels(width, height, image.info(), &texels) {
        Ok(part) => part,
        Err(error) => panic!("{width}x{height} texels at ({x}, {y}): {error}"),
    }
}

/// The frames `images/<name>/*.png` in order.
///
/// # Panics
/// Where the folder is missing.
#[must_use]
#[expect(clippy::panic, reason = "a test without its fixture must fail, and say which")]
pub fn frames(name: &str) -> ImageSet {
    let dir = fixtures_dir().join(format!("images/{name}"));
    let Ok(entries) = std::fs::read_dir(&dir) else { panic!("{}: no such folder", dir.display()) };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    match ImageSet::new(paths.iter().map(|path| png(path)).collect()) {
        Ok(set) => set,
        Err(error) => panic!("{}: {error}", dir.display()),
    }
}

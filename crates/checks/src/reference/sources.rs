//! What the cases read that lies in no folder: crops of photographs, and a zoom stack of a surface known at every scale.

use std::fs;
use std::io::{self, Error};
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};

/// Pixels of the images of the zoom stack.
const ZOOM_SIZE: (u32, u32) = (240, 200);

/// The middle of an image, at most `side` pixels a side, as an RGB PNG in `folder`.
pub(super) fn crop(path: &Path, side: u32, folder: &Path) -> io::Result<PathBuf> {
    let image = image::open(path).map_err(|error| Error::other(format!("{}: {error}", path.display())))?;
    let (width, height) = (image.width().min(side), image.height().min(side));
    let (left, top) = ((image.width() - width) / 2, (image.height() - height) / 2);
    fs::create_dir_all(folder)?;
    let cropped = folder.join(path.file_stem().unwrap_or_default()).with_extension("png");
    image.crop_imm(left, top, width, height).to_rgb8().save(&cropped).map_err(Error::other)?;
    Ok(cropped)
}

/// A folder with a photograph and a close-up of zoom 3, with noise and another exposure.
pub(super) fn zoom_stack(folder: &Path) -> io::Result<PathBuf> {
    fs::create_dir_all(folder)?;
    let leaves = Leaves::new(3, 60_000);
    let close = close_up(DVec2::new(0.5, 0.45), 3.0, 0.2, DVec2::ZERO);
    for (name, matrix, exposure) in [("close.png", close, 0.8), ("whole.png", DMat3::IDENTITY, 1.0)] {
        let lens = Lens { exposure, noise: 0.005, seed: 1 };
        let raster = photograph(&leaves.view(&matrix, ZOOM_SIZE, 3), ZOOM_SIZE, lens);
        let (width, height) = ZOOM_SIZE;
        let colour = image::ExtendedColorType::Rgb8;
        image::save_buffer(folder.join(name), &raster.to_bytes(), width, height, colour)
            .map_err(Error::other)?;
    }
    Ok(folder.to_owned())
}

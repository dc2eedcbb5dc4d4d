//! Options shared by `decompress` and `bank extract`: the texels to decode, and the output.

use std::path::{Path, PathBuf};

use texfold_core::{ImageSize, Rect, RegionError};

use super::picture::Format;
use crate::error::CliError;

/// Options that say what is decoded and written.
#[derive(Debug, clap::Args)]
pub(crate) struct Writing {
    /// Folder that the images are written to.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Format of the images.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) to: Format,
    /// Overwrite files that are there.
    #[arg(long)]
    force: bool,
    /// Mip level: 0 is the full size.
    #[arg(long, visible_alias = "level", value_name = "N", default_value_t = 0)]
    pub(crate) lod: u32,
    /// Only the rectangle with this upper left corner and size, in texels of the level. It is part of the file's name.
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
    pub(crate) region: Option<[u32; 4]>,
    /// Load only this many layers of each file.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) layers: Option<u32>,
    /// Decode on the GPU, as a shader does.
    #[arg(long)]
    pub(crate) gpu: bool,
}

fn rectangle(text: &str) -> Result<[u32; 4], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let found = numbers.and_then(|numbers| numbers.try_into().ok());
    found
        .filter(|&[.., width, height]: &[u32; 4]| width > 0 && height > 0)
        .ok_or_else(|| "give left, top, width and height as in 64,0,256,128".to_owned())
}

impl Writing {
    /// The rectangle to decode of an image whose level has that size.
    pub(crate) fn rect(
        &self,
        image: u32,
        ImageSize { width, height }: ImageSize,
    ) -> Result<Rect, RegionError> {
        let [x, y, across, down] = self.region.unwrap_or([0, 0, width, height]);
        if u64::from(x) + u64::from(across) > u64::from(width)
            || u64::from(y) + u64::from(down) > u64::from(height)
        {
            return Err(RegionError::Outside { width, height });
        }
        Ok(Rect { image, level: self.lod, x, y, width: across, height: down })
    }

    /// The ending of file names: the rectangle, if one is given, and the extension.
    pub(crate) fn ending(&self) -> String {
        let region = self.region.map(|[x, y, width, height]| format!("-{x}-{y}-{width}x{height}"));
        format!("{}.{}", region.unwrap_or_default(), self.to.extension())
    }

    /// Refuses to overwrite: fails where one of these files is there, without --force.
    pub(crate) fn check<'p>(&self, outputs: impl Iterator<Item = &'p Path>) -> Result<(), CliError> {
        let mut there = outputs.filter(|output| !self.force && output.symlink_metadata().is_ok());
        let Some(first) = there.next() else { return Ok(()) };
        Err(CliError::Exists { path: first.to_owned(), more: there.count() })
    }
}

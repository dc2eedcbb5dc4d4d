//! OpenEXR files of one channel, such as heights, which the `image` crate does not take.

use std::io::BufReader;
use std::path::Path;

use exr::error::Error;
use exr::image::read::read;
use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers};
use texfold_core::ImageSize;

use crate::files;

/// Columns and rows of a file whose first layer has one channel.
pub(super) fn size(path: &Path) -> Option<ImageSize> {
    let meta = MetaData::read_from_buffered(BufReader::new(files::open(path).ok()?), false).ok()?;
    let header = meta.headers.first().filter(|header| header.channels.list.len() == 1)?;
    let side = |side: usize| u32::try_from(side).ok();
    Some(ImageSize { width: side(header.layer_size.0)?, height: side(header.layer_size.1)? })
}

/// The values of the first layer's channel, row by row; they take four bytes a texel, and its samples as many.
pub(super) fn values(path: &Path) -> Result<Vec<f32>, Error> {
    let file = BufReader::new(files::open(path)?);
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(file)?;
    let channel = image.layer_data.channel_data.list.first().ok_or(Error::Invalid("no channel".into()))?;
    Ok(channel.sample_data.values_as_f32().collect())
}

//! Captures whose photographs are of any format that images are read in.

use std::path::Path;

use texfold_capture as capture;
pub(crate) use texfold_capture::{
    camera_files, image_files, is_capture, mesh_file, read_cameras, test_cameras,
};
use texfold_core::{Capture, Photograph};

use super::pixels;
use crate::error::CliError;
use crate::memory;

/// Reads a capture's folder, its mesh simplified to so many triangles where that is given.
pub(crate) fn read(
    dir: &Path,
    mesh: Option<&Path>,
    triangles: Option<u32>,
    limit_bytes: u64,
) -> Result<Capture, CliError> {
    capture::read(dir, mesh, triangles, |path| pixels::read_stored(path, limit_bytes))
}

/// Reads the photographs that a file of cameras names, at most so many of them, spread over all.
pub(crate) fn read_views(cameras: &Path, most: Option<usize>) -> Result<Vec<Photograph>, CliError> {
    capture::read_views(cameras, most, |path| pixels::read_stored(path, memory::limit(None)))
}

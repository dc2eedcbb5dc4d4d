//! The rival ASTC, by the external program `astcenc` where it is installed.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use texfold_core::image::{PixelInfo, Raster};

use super::measure::Cost;
use crate::error::CliError;
use crate::input::{Remarks, pixels};
use crate::memory;
use crate::png;

/// Bits of an ASTC block of any side.
const BLOCK_BITS: u64 = 128;

/// Names that the program is installed under.
const NAMES: [&str; 4] = ["astcenc", "astcenc-avx2", "astcenc-sse2", "astcenc-neon"];

/// The external encoder.
#[derive(Debug, Clone)]
pub(crate) struct Astcenc(PathBuf);

/// What it made of an image.
#[derive(Debug)]
pub(crate) struct Coded {
    pub(crate) decoded: Raster,
    /// Time of encoding; of ASTC with that of decoding, a small part.
    pub(crate) cost: Cost,
    pub(crate) bits: u64,
}

impl Astcenc {
    /// Looks for the program on PATH.
    pub(crate) fn find() -> Option<Astcenc> {
        on_path(&NAMES).map(Astcenc)
    }

    /// Encodes `image` of the file at `path` with blocks of that side by a preset of the program's own, and decodes it.
    pub(crate) fn code(
        &self,
        image: &Raster,
        side: u32,
        preset: &str,
        path: &Path,
    ) -> Result<Coded, CliError> {
        let failed = |source| CliError::Rival { path: path.to_owned(), program: self.0.clone(), source };
        let dir = tempfile::tempdir().map_err(failed)?;
        let (input, output) = (dir.path().join("in.png"), dir.path().join("out.png"));
        png::write(&input, image)?;
        let clock = Cost::clock();
        let status = Command::new(&self.0)
            .arg("-tl")
            .args([&input, &output])
            .args([&format!("{side}x{side}"), preset, "-silent"])
            .stdout(Stdio::null())
            .status()
            .map_err(failed)?;
        let cost = clock();
        if !status.success() {
            return Err(failed(std::io::Error::other(status.to_string())));
        }
        let decoded = read_back(&output, image.info())?;
        let size = image.size();
        let blocks = u64::from(size.width.div_ceil(side)) * u64::from(size.height.div_ceil(side));
        Ok(Coded { decoded, cost, bits: BLOCK_BITS * blocks })
    }
}

/// The first program on PATH that has one of these names.
pub(super) fn on_path(names: &[&str]) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let places = std::env::split_paths(&path).flat_map(|dir| names.iter().map(move |name| dir.join(name)));
    places.into_iter().find(|place| place.is_file())
}

/// What a program has decoded, as values of that kind.
pub(super) fn read_back(path: &Path, info: PixelInfo) -> Result<Raster, CliError> {
    pixels::read(path, info.color, Some(info.alpha), memory::limit(None), &mut Remarks::default())
}

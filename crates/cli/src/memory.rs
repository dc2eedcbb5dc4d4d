//! How much memory a run may use, and the least that an image needs.

use std::path::Path;

use crate::error::CliError;
use sysinfo::System;
use texfold_core::{LimitError, Limits, LoadError};

/// The memory that a command may use.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(crate) struct MemoryArgs {
    /// Memory limit in GiB for an image; by default three quarters of the machine's.
    #[arg(long, value_name = "GIB", value_parser = gib)]
    memory: Option<f64>,
}

impl MemoryArgs {
    /// The limit in bytes.
    pub(crate) fn bytes(self) -> u64 {
        self.memory.map_or_else(usual_limit, from_gib)
    }

    /// The limits of files that are read.
    pub(crate) fn limits(self) -> Limits {
        Limits { bytes: self.bytes(), ..Limits::default() }
    }
}

fn gib(text: &str) -> Result<f64, String> {
    let found = text.parse().ok().filter(|gib: &f64| gib.is_finite() && *gib > 0.0);
    found.ok_or_else(|| "give a finite number of GiB above 0".to_owned())
}

/// Bytes for each texel below which no codec of this version can work: the file's samples, the raster and what is
/// decoded from it.
pub(crate) const LEAST_BYTES_PER_TEXEL: u64 = 40;

/// Bytes that an input may take whatever is allowed: so the methods that a choice can try on a small image do not depend on the limit.
pub(crate) const ALWAYS_ALLOWED: u64 = 64 << 20;

/// Share of the machine's memory that is used where nothing else is said.
const USUAL_SHARE: f64 = 0.75;

/// Used where the system does not tell its memory.
const UNKNOWN_BYTES: u64 = 4 << 30;

/// Refuses what takes more bytes than that.
///
/// # Errors
/// [`CliError::Memory`].
pub(crate) fn check(path: &Path, needed: u64, allowed: u64) -> Result<(), CliError> {
    if needed <= allowed {
        return Ok(());
    }
    let (needed_mib, allowed_mib) = (needed.div_ceil(1 << 20), allowed >> 20);
    Err(CliError::Memory { path: path.to_owned(), needed_mib, allowed_mib })
}

/// The fault of a file that cannot be loaded within a limit.
pub(crate) fn load_fault(path: &Path, source: LoadError) -> CliError {
    match source {
        LoadError::Limit(LimitError { what: "bytes", needed, allowed }) => {
            let (needed_mib, allowed_mib) = (needed.div_ceil(1 << 20), allowed >> 20);
            CliError::Memory { path: path.to_owned(), needed_mib, allowed_mib }
        }
        source => CliError::Load { path: path.to_owned(), source },
    }
}

/// Bytes of `gib` GiB.
pub(crate) fn from_gib(gib: f64) -> u64 {
    (gib * f64::from(1 << 30)) as u64
}

/// Three quarters of the memory that the machine, or the container that the process runs in, has.
pub(crate) fn usual_limit() -> u64 {
    let mut system = System::new();
    system.refresh_memory();
    let machine = Some(system.total_memory()).filter(|&bytes| bytes > 0);
    let container = system.cgroup_limits().map(|limits| limits.total_memory);
    match machine.into_iter().chain(container).min() {
        Some(bytes) => (bytes as f64 * USUAL_SHARE) as u64,
        None => UNKNOWN_BYTES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_in_bytes() {
        assert_eq!(from_gib(0.5), 1 << 29);
        // No machine that runs this has less, or a thousand times more.
        assert!((1 << 24..1 << 44).contains(&usual_limit()), "{}", usual_limit());
    }
}

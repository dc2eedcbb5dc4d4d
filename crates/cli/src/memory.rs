//! Memory that a run may use.

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
        limit(self.memory)
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

/// Bytes that an input may take whatever is allowed: so the methods that a choice can try on a small image do not depend on the limit.
pub(crate) const ALWAYS_ALLOWED: u64 = 64 << 20;

/// Address space that the C library reserves for the allocations of a thread.
const RESERVED_BY_THREAD: u64 = 64 << 20;

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

/// The limit in bytes: so many GiB, or what is usual, and never more than the system lets the process map.
pub(crate) fn limit(gib: Option<f64>) -> u64 {
    gib.map_or_else(usual_limit, from_gib).min(address_space().unwrap_or(u64::MAX))
}

/// Bytes that the process may still map where its address space is limited (`ulimit -v`), but for what allocators of threads
/// reserve: beyond them an allocation ends the process.
fn address_space() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = limit.split_whitespace().next()?.parse().ok()?;
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mapped = status.lines().find_map(|line| line.strip_prefix("VmSize:"))?;
    let mapped: u64 = mapped.split_whitespace().next()?.parse().ok()?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    Some(limit.saturating_sub(1024 * mapped).saturating_sub(RESERVED_BY_THREAD * (threads + 1)))
}

/// Bytes of `gib` GiB.
fn from_gib(gib: f64) -> u64 {
    (gib * f64::from(1 << 30)) as u64
}

/// Three quarters of the memory that the machine, or the container that the process runs in, has.
fn usual_limit() -> u64 {
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

//! How much memory a run may use, and the least that an image needs.

use sysinfo::System;

/// Bytes for each texel below which no codec of this version can work: the file's samples, the raster and what is
/// decoded from it.
pub(crate) const LEAST_BYTES_PER_TEXEL: u64 = 40;

/// Bytes that an input may take whatever is allowed: so the methods that a choice can try on a small image do not depend on the limit.
pub(crate) const ALWAYS_ALLOWED: u64 = 64 << 20;

/// Share of the machine's memory that is used where nothing else is said.
const USUAL_SHARE: f64 = 0.75;

/// Used where the system does not tell its memory.
const UNKNOWN_BYTES: u64 = 4 << 30;

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

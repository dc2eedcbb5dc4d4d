//! How much memory a run may use, and how much an image needs.

use texfold::CodecChoice;

/// Bytes for each texel of an input while it is encoded and measured: source and decoded raster, the encoder's
/// blocks and the planes of the similarity measure. An estimate from above.
const BYTES_PER_TEXEL: u64 = 120;

/// As above for codec epitome, which holds every image at nine scales in two formats and some candidates for each leaf.
const EPITOME_BYTES_PER_TEXEL: u64 = 450;

/// As above for codec progressive, which holds the coefficients of two bases and a candidate or two for each block.
const PROGRESSIVE_BYTES_PER_TEXEL: u64 = 160;

/// Bytes for each texel of an input that `codec` needs.
pub(crate) fn bytes_per_texel(codec: CodecChoice) -> u64 {
    match codec {
        CodecChoice::Epitome => EPITOME_BYTES_PER_TEXEL,
        CodecChoice::Bc | CodecChoice::Vq => BYTES_PER_TEXEL,
        // Which tries it.
        CodecChoice::Auto | CodecChoice::Progressive => PROGRESSIVE_BYTES_PER_TEXEL,
    }
}

/// Bytes for each texel below which no codec of this version can work: the file's samples, the raster and what is
/// decoded from it.
pub(crate) const LEAST_BYTES_PER_TEXEL: u64 = 40;

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
    let machine = total_of(&read("/proc/meminfo"));
    let container = read("/sys/fs/cgroup/memory.max").trim().parse().ok();
    match machine.into_iter().chain(container).min() {
        Some(bytes) => (bytes as f64 * USUAL_SHARE) as u64,
        None => UNKNOWN_BYTES,
    }
}

fn read(path: &str) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

fn total_of(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_in_bytes() {
        assert_eq!(total_of("MemTotal:       1000 kB\nMemFree: 3 kB\n"), Some(1_024_000));
        assert_eq!(total_of(""), None);
        assert_eq!(from_gib(0.5), 1 << 29);
        assert!(usual_limit() > 0);
    }
}

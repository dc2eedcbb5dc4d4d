//! Any bytes as a file that the command line reads: images, meshes, cameras, lists. The last byte says which. Seeds: files that the tests of the
//! command line write.

#![no_main]

use std::panic;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use texfold_cli::{FOREIGN, read_foreign};

/// Memory limit of an image.
const LIMIT_BYTES: u64 = 64 << 20;

/// A folder in memory where there is one.
static PLACE: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = Path::new("/dev/shm");
    let place = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let place = place.join(format!("texfold-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&place).expect("a folder for files");
    // Panics of decoders become errors; ours are faults.
    let of_libfuzzer = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        if panic.location().is_none_or(|at| !at.file().contains("registry")) {
            of_libfuzzer(panic);
        }
    }));
    place
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let Some((kind, bytes)) = data.split_last() else { return };
    let path = PLACE.join(FOREIGN[usize::from(*kind) % FOREIGN.len()]);
    std::fs::write(&path, bytes).expect("space for a file");
    let _ = read_foreign(&path, LIMIT_BYTES);
});

//! The `.txf` container: a table of named sections, each compressed and checked by itself.
//!
//! FORMAT.md describes the bytes. Sections follow one another in the order of the table, coarse to fine, so
//! that a prefix of a file is a file: the sections that are whole can be read.

mod content;
mod layout;
mod notes;
mod read;
mod wire;
mod write;
mod zstd;

pub use crate::id::CodecId;
pub use content::ContentId;
pub use layout::{LAYOUT_ID, MAPS_ID, read_layout, read_maps, write_layout};
pub use notes::{MAX_GEOREFERENCE, NOTES_ID, Notes, SOURCE_ID, SourceNotes};
pub use read::Sections;
pub use wire::Reader;
pub use write::{SectionWriter, Written};

/// First bytes of every file. The high byte and the line ends show damage by text transfers, as in PNG.
pub const MAGIC: [u8; 8] = *b"\x89TXF\r\n\x1a\n";
/// Format version that is written and read. From release 0.1 on, files of this version open in every later one.
pub const VERSION: u16 = 2;
/// Bytes of the header before the table.
pub const HEADER_BYTES: usize = 32;
/// Bytes of an entry of the table.
pub const ENTRY_BYTES: usize = 40;

const STORED: u32 = 0;
const ZSTD: u32 = 1;

/// First 64 bits of the BLAKE3 hash, little-endian.
pub fn checksum(parts: &[&[u8]]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part);
    }
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(first)
}

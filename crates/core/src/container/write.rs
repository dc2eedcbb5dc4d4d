//! Writing a `.txf` file.

use super::{CodecId, ENTRY_BYTES, HEADER_BYTES, MAGIC, STORED, VERSION, ZSTD, checksum, zstd};

/// Collects the sections of a file, in order.
#[derive(Debug)]
pub struct SectionWriter {
    codec: CodecId,
    sections: Vec<Section>,
}

#[derive(Debug)]
struct Section {
    part: &'static str,
    id: [u8; 4],
    compression: u32,
    raw_len: u64,
    stored: Vec<u8>,
}

/// A whole file, and which part each of its bytes belongs to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// The file.
    pub bytes: Vec<u8>,
    /// Bytes by part; sums to the length of `bytes`.
    pub parts: Vec<(&'static str, u64)>,
}

impl SectionWriter {
    /// An empty file of `codec`.
    #[must_use]
    pub fn new(codec: CodecId) -> Self {
        SectionWriter { codec, sections: Vec::new() }
    }

    /// Adds a section. It is compressed where that makes it smaller. Its bytes count for `part`.
    pub fn section(&mut self, part: &'static str, id: [u8; 4], raw: &[u8]) {
        self.add(part, id, raw, zstd::compress(raw, false));
    }

    /// As [`SectionWriter::section`], of streams of an entropy coder, which seldom become shorter: no long search is made for it where a short one
    /// saves nothing.
    pub fn streams(&mut self, part: &'static str, id: [u8; 4], raw: &[u8]) {
        self.add(part, id, raw, zstd::compress(raw, true));
    }

    fn add(&mut self, part: &'static str, id: [u8; 4], raw: &[u8], shorter: Option<Vec<u8>>) {
        let (compression, stored) = shorter.map_or_else(|| (STORED, raw.to_vec()), |frame| (ZSTD, frame));
        self.sections.push(Section { part, id, compression, raw_len: raw.len() as u64, stored });
    }

    /// The whole file.
    #[must_use]
    pub fn finish(self) -> Written {
        let table_len = self.sections.len() * ENTRY_BYTES;
        let mut offset = (HEADER_BYTES + table_len) as u64;
        let mut table: Vec<u8> = Vec::new();
        for section in &self.sections {
            let stored_len = section.stored.len() as u64;
            table.extend(section.id);
            table.extend(section.compression.to_le_bytes());
            table.extend(offset.to_le_bytes());
            table.extend(stored_len.to_le_bytes());
            table.extend(section.raw_len.to_le_bytes());
            table.extend(checksum(&[&section.stored]).to_le_bytes());
            offset += stored_len;
        }
        let mut bytes: Vec<u8> = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend(self.codec.number.to_le_bytes());
        bytes.extend((self.sections.len() as u32).to_le_bytes());
        bytes.extend(offset.to_le_bytes());
        let table_sum = checksum(&[&bytes, &table]);
        bytes.extend(table_sum.to_le_bytes());
        bytes.extend(&table);
        let mut parts = vec![("container", bytes.len() as u64)];
        for section in &self.sections {
            bytes.extend(&section.stored);
            let stored_len = section.stored.len() as u64;
            match parts.iter_mut().find(|(part, _)| *part == section.part) {
                Some((_, length)) => *length += stored_len,
                None => parts.push((section.part, stored_len)),
            }
        }
        Written { bytes, parts }
    }
}

//! Reading a `.txf` file or a prefix of one. Every length is checked before anything is allocated.

use super::{ENTRY_BYTES, HEADER_BYTES, MAGIC, Reader, STORED, VERSION, ZSTD, checksum, zstd};
use crate::id::String4;
use crate::{Budget, LimitError, LoadError};

const HEAD: String4 = String4(*b"head");

/// The table of sections of a file, and the sections that are whole.
#[derive(Debug, Clone)]
pub struct Sections<'a> {
    codec: u16,
    entries: Vec<Entry>,
    bytes: &'a [u8],
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    id: [u8; 4],
    compression: u32,
    offset: u64,
    stored_len: u64,
    raw_len: u64,
    checksum: u64,
}

impl<'a> Sections<'a> {
    /// Reads header and table of a file or of a prefix of one.
    ///
    /// # Errors
    /// [`LoadError`]: not a `.txf` file, a later version, cut before the end of the table, a table that no writer
    /// writes, or more sections than `budget` allows.
    pub fn parse(bytes: &'a [u8], budget: &mut Budget) -> Result<Self, LoadError> {
        if bytes.len() < MAGIC.len() || bytes[..MAGIC.len()] != MAGIC {
            let cut = bytes.len() < MAGIC.len() && !bytes.is_empty() && MAGIC.starts_with(bytes);
            return Err(if cut { LoadError::Truncated { section: HEAD } } else { LoadError::NotTexfold });
        }
        let mut head = Reader::new(HEAD, bytes);
        head.skip(MAGIC.len())?;
        let version = head.u16()?;
        if version != VERSION {
            return Err(LoadError::Version { found: version, supported: VERSION });
        }
        let codec = head.u16()?;
        let count = head.u32()?;
        let (file_len, table_sum) = (head.u64()?, head.u64()?);
        if count > budget.limits().sections {
            let (needed, allowed) = (u64::from(count), u64::from(budget.limits().sections));
            return Err(LimitError { what: "sections", needed, allowed }.into());
        }
        let table_end = HEADER_BYTES + count as usize * ENTRY_BYTES;
        let table = bytes.get(HEADER_BYTES..table_end).ok_or(LoadError::Truncated { section: HEAD })?;
        if checksum(&[&bytes[..HEADER_BYTES - 8], table]) != table_sum {
            return Err(head.corrupt("the table does not match its checksum"));
        }
        let mut sections = Sections { codec, entries: budget.reserved(count.into())?, bytes };
        let mut offset = table_end as u64;
        for _ in 0..count {
            let entry = read_entry(&mut head, offset)?;
            offset = offset.checked_add(entry.stored_len).ok_or(head.corrupt("a section is too long"))?;
            if sections.entries.iter().any(|other| other.id == entry.id) {
                return Err(head.corrupt("two sections of the same name"));
            }
            sections.entries.push(entry);
        }
        if file_len != offset || bytes.len() as u64 > file_len {
            return Err(head.corrupt("the file's length does not match its table"));
        }
        Ok(sections)
    }

    /// Number of the codec that wrote the file.
    #[must_use]
    pub fn codec(&self) -> u16 {
        self.codec
    }

    /// Ids of all sections of the table, in order, and whether each is whole.
    pub fn ids(&self) -> impl Iterator<Item = ([u8; 4], bool)> + '_ {
        self.entries.iter().map(|entry| (entry.id, self.stored(entry).is_some()))
    }

    /// Where each section of the table ends, in bytes from the start of the file: prefixes of these lengths hold whole sections.
    pub fn ends(&self) -> impl Iterator<Item = u64> + '_ {
        self.entries.iter().map(|entry| entry.offset.saturating_add(entry.stored_len))
    }

    /// Whether the section is there and whole.
    #[must_use]
    pub fn has(&self, id: [u8; 4]) -> bool {
        self.entries.iter().any(|entry| entry.id == id && self.stored(entry).is_some())
    }

    /// The raw bytes of a section; books them in `budget`.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where it is missing or cut, [`LoadError::Corrupt`] where its checksum, length or
    /// compression is wrong, [`LoadError::Limit`] where it is larger than the budget allows.
    pub fn read(&self, id: [u8; 4], budget: &mut Budget) -> Result<Vec<u8>, LoadError> {
        let section = String4(id);
        let entry =
            self.entries.iter().find(|entry| entry.id == id).ok_or(LoadError::Truncated { section })?;
        let stored = self.stored(entry).ok_or(LoadError::Truncated { section })?;
        let corrupt = |what| LoadError::Corrupt { section, offset: 0, what };
        if checksum(&[stored]) != entry.checksum {
            return Err(corrupt("its bytes do not match its checksum"));
        }
        budget.take(entry.raw_len)?;
        if entry.compression == STORED {
            return Ok(stored.to_vec());
        }
        let scratch = zstd::scratch_bytes(entry.raw_len);
        budget.take(scratch)?;
        let raw = usize::try_from(entry.raw_len).map_err(|_| corrupt("it is too long for this machine"))?;
        let raw = zstd::decompress(stored, raw).map_err(|_| corrupt("its zstd frame is damaged"))?;
        budget.release(scratch);
        if raw.len() as u64 != entry.raw_len {
            return Err(corrupt("its length is not the one stated"));
        }
        Ok(raw)
    }

    fn stored(&self, entry: &Entry) -> Option<&'a [u8]> {
        let start = usize::try_from(entry.offset).ok()?;
        let end = usize::try_from(entry.offset.checked_add(entry.stored_len)?).ok()?;
        self.bytes.get(start..end)
    }
}

fn read_entry(head: &mut Reader<'_>, expected_offset: u64) -> Result<Entry, LoadError> {
    let id = head.array()?;
    let compression = head.u32()?;
    let (offset, stored_len, raw_len) = (head.u64()?, head.u64()?, head.u64()?);
    let entry = Entry { id, compression, offset, stored_len, raw_len, checksum: head.u64()? };
    if compression != STORED && compression != ZSTD {
        return Err(head.corrupt("unknown compression"));
    }
    if offset != expected_offset {
        return Err(head.corrupt("sections do not follow one another"));
    }
    if compression == STORED && stored_len != raw_len {
        return Err(head.corrupt("a stored section has two lengths"));
    }
    Ok(entry)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Limits;
    use crate::container::{CodecId, SectionWriter};
    use proptest::prelude::*;

    const TEST: CodecId = CodecId { number: 77, name: "test" };

    fn file() -> Vec<u8> {
        let mut writer = SectionWriter::new(TEST);
        writer.section("a", *b"aaaa", &[7; 500]);
        writer.section("b", *b"bbbb", &[1, 2, 3]);
        let written = writer.finish();
        assert_eq!(written.parts.iter().map(|(_, bytes)| bytes).sum::<u64>(), written.bytes.len() as u64);
        written.bytes
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = file();
        let mut budget = Budget::default();
        let sections = Sections::parse(&bytes, &mut budget).unwrap();
        assert_eq!(sections.codec(), 77);
        assert_eq!(sections.read(*b"aaaa", &mut budget).unwrap(), [7; 500]);
        assert_eq!(sections.read(*b"bbbb", &mut budget).unwrap(), [1, 2, 3]);
        assert_eq!(sections.ids().count(), 2);
    }

    #[test]
    fn every_prefix_reads_its_whole_sections_or_names_the_missing_one() {
        let bytes = file();
        for length in 0..bytes.len() {
            let mut budget = Budget::default();
            match Sections::parse(&bytes[..length], &mut budget) {
                Ok(sections) => {
                    let missing = LoadError::Truncated { section: String4(*b"bbbb") };
                    assert_eq!(sections.read(*b"bbbb", &mut budget), Err(missing));
                    let first = sections.read(*b"aaaa", &mut budget);
                    assert!(first == Ok(vec![7; 500]) || matches!(first, Err(LoadError::Truncated { .. })));
                }
                Err(LoadError::Truncated { section }) => assert_eq!(section, HEAD),
                Err(LoadError::NotTexfold) => assert_eq!(length, 0),
                Err(other) => panic!("{length}: {other}"),
            }
        }
    }

    #[test]
    fn a_section_larger_than_the_budget_is_refused() {
        let bytes = file();
        let mut budget = Budget::new(Limits { bytes: 500, ..Limits::default() });
        let sections = Sections::parse(&bytes, &mut budget).unwrap();
        assert!(matches!(sections.read(*b"aaaa", &mut budget), Err(LoadError::Limit(_))));
        let mut few = Budget::new(Limits { sections: 1, ..Limits::default() });
        assert!(matches!(Sections::parse(&bytes, &mut few), Err(LoadError::Limit(_))));
    }

    #[test]
    fn a_name_stands_for_one_section() {
        let mut writer = SectionWriter::new(TEST);
        writer.section("a", *b"aaaa", &[7; 5]);
        writer.section("a", *b"aaaa", &[8; 5]);
        let found = Sections::parse(&writer.finish().bytes, &mut Budget::default()).err();
        assert!(matches!(found, Some(LoadError::Corrupt { what: "two sections of the same name", .. })));
    }

    #[test]
    fn other_files_are_told_apart() {
        let mut bytes = file();
        assert_eq!(Sections::parse(b"PNG", &mut Budget::default()).err(), Some(LoadError::NotTexfold));
        bytes[8] = 9;
        let found = Sections::parse(&bytes, &mut Budget::default()).err();
        assert_eq!(found, Some(LoadError::Version { found: 9, supported: VERSION }));
    }

    proptest! {
        #[test]
        fn any_flipped_byte_is_noticed(position in 0usize..1 << 16, flip in 1u8..=255) {
            let mut bytes = file();
            let position = position % bytes.len();
            bytes[position] ^= flip;
            let mut budget = Budget::default();
            let outcome = Sections::parse(&bytes, &mut budget)
                .and_then(|sections| Ok((sections.read(*b"aaaa", &mut budget)?, sections.read(*b"bbbb", &mut budget)?)));
            prop_assert!(outcome.is_err());
        }
    }
}

//! What the maker of a file says about it: settings, a verdict, what each part bought.

use super::{Reader, SectionWriter, Sections};
use crate::id::String4;
use crate::{Budget, LoadError};

/// Id of the notes section.
pub const NOTES_ID: [u8; 4] = *b"NOTE";

/// Longest text in bytes, so that a hostile file cannot flood a terminal.
const MAX_TEXT: usize = 4096;

/// Most parts whose worth is noted: more than any codec has.
const MAX_PARTS: usize = 64;

/// How a file was made. Nothing here changes a texel.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Notes {
    /// Settings in the words of the command line.
    pub settings: String,
    /// One sentence: what was modelled, what was left out and why.
    pub verdict: String,
    /// PSNR in dB of the whole with a part left out, by the part's name. What is not finite, as where nothing changes without it, is
    /// not written.
    pub psnr_without: Vec<(String, f32)>,
}

impl Notes {
    /// Writes the notes as a section of the part "container".
    pub fn write(&self, out: &mut SectionWriter) {
        let mut raw = Vec::new();
        let mut text = |text: &str| {
            let mut end = text.len().min(MAX_TEXT);
            while !text.is_char_boundary(end) {
                end -= 1;
            }
            raw.extend((end as u16).to_le_bytes());
            raw.extend(&text.as_bytes()[..end]);
        };
        text(&self.settings);
        text(&self.verdict);
        let known = self.psnr_without.iter().filter(|(_, psnr)| psnr.is_finite());
        for (name, psnr) in known.take(MAX_PARTS) {
            text(name);
            text(&psnr.to_bits().to_string());
        }
        out.section("container", NOTES_ID, &raw);
    }

    /// Reads the notes.
    ///
    /// # Errors
    /// [`LoadError`] where the section is missing, damaged or no text.
    pub fn read(file: &Sections<'_>, budget: &mut Budget) -> Result<Notes, LoadError> {
        let raw = file.read(NOTES_ID, budget)?;
        // The texts, beside the section that they are copied from.
        budget.take(raw.len() as u64)?;
        let mut reader = Reader::new(String4(NOTES_ID), &raw);
        let mut notes =
            Notes { settings: text(&mut reader)?, verdict: text(&mut reader)?, ..Notes::default() };
        while reader.end().is_err() {
            if notes.psnr_without.len() == MAX_PARTS {
                return Err(reader.corrupt("more than 64 parts"));
            }
            // A vector that grows holds up to three times as many values for a moment.
            budget.take(3 * size_of::<(String, f32)>() as u64)?;
            let name = text(&mut reader)?;
            let bits = text(&mut reader)?.parse().map_err(|_| reader.corrupt("no number"))?;
            let psnr = f32::from_bits(bits);
            if !psnr.is_finite() {
                return Err(reader.corrupt("a number that is not finite"));
            }
            notes.psnr_without.push((name, psnr));
        }
        Ok(notes)
    }
}

fn text(reader: &mut Reader<'_>) -> Result<String, LoadError> {
    let length = usize::from(reader.u16()?);
    if length > MAX_TEXT {
        return Err(reader.corrupt("a text above 4096 bytes"));
    }
    let text =
        std::str::from_utf8(reader.bytes(length)?).map_err(|_| reader.corrupt("a text that is not UTF-8"))?;
    if text.chars().any(char::is_control) {
        return Err(reader.corrupt("control characters in a text"));
    }
    Ok(text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::CodecId;

    #[test]
    fn notes_of_a_part_without_which_nothing_changes_can_be_read() {
        let psnr_without =
            vec![("exact".into(), f32::INFINITY), ("maps".into(), 30.0), ("none".into(), f32::NAN)];
        let notes = Notes { psnr_without, ..Notes::default() };
        let mut writer = SectionWriter::new(CodecId { number: 1, name: "test" });
        notes.write(&mut writer);
        let file = writer.finish().bytes;
        let mut budget = Budget::default();
        let read = Notes::read(&Sections::parse(&file, &mut budget).unwrap(), &mut budget).unwrap();
        assert_eq!(read.psnr_without, [("maps".to_owned(), 30.0)]);
    }

    #[test]
    fn notes_survive() {
        let notes = Notes {
            settings: "vq, 2.5 bpp".into(),
            verdict: "ä sentence.".into(),
            psnr_without: vec![("samples".into(), 28.25)],
        };
        let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
        notes.write(&mut writer);
        let bytes = writer.finish().bytes;
        let mut budget = Budget::default();
        let sections = Sections::parse(&bytes, &mut budget).unwrap();
        assert_eq!(Notes::read(&sections, &mut budget), Ok(notes));
    }

    #[test]
    fn a_file_cannot_note_more_parts_than_there_can_be() {
        let open = |parts: usize| {
            let raw = [vec![0; 4], [vec![0, 0, 1, 0, b'0']; 1].concat().repeat(parts)].concat();
            let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
            writer.section("container", NOTES_ID, &raw);
            let bytes = writer.finish().bytes;
            let mut budget = Budget::default();
            Notes::read(&Sections::parse(&bytes, &mut budget).unwrap(), &mut budget)
        };
        assert_eq!(open(64).map(|notes| notes.psnr_without.len()), Ok(64));
        assert!(matches!(open(65), Err(LoadError::Corrupt { what: "more than 64 parts", .. })));
    }
}

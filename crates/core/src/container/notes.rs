//! What the maker of a file says about it: settings, a verdict, what each part bought.

use super::{Reader, SectionWriter, Sections};
use crate::id::String4;
use crate::{Budget, LoadError};

/// Id of the notes section.
pub const NOTES_ID: [u8; 4] = *b"NOTE";

/// Longest text in bytes, so that a hostile file cannot flood a terminal.
const MAX_TEXT: usize = 4096;

/// How a file was made. Nothing here changes a texel.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Notes {
    /// Settings in the words of the command line.
    pub settings: String,
    /// One sentence: what was modelled, what was left out and why.
    pub verdict: String,
    /// PSNR in dB of the whole with a part left out, by the part's name.
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
        for (name, psnr) in &self.psnr_without {
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
        let mut reader = Reader::new(String4(NOTES_ID), &raw);
        let mut notes =
            Notes { settings: text(&mut reader)?, verdict: text(&mut reader)?, ..Notes::default() };
        while reader.end().is_err() {
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
}

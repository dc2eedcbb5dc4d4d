//! Notes of the encoder: settings, a verdict, what each part bought, the source.

use super::{Reader, SectionWriter, Sections};
use crate::id::String4;
use crate::{Budget, LoadError};

/// Id of the notes section.
pub const NOTES_ID: [u8; 4] = *b"NOTE";

/// Id of the optional section on the source.
pub const SOURCE_ID: [u8; 4] = *b"SRCE";

/// Longest text in bytes, so that a hostile file cannot flood a terminal.
const MAX_TEXT: usize = 4096;

/// Most remarks on the source.
const MAX_REMARKS: usize = 16;

/// Most bytes of a georeference.
pub const MAX_GEOREFERENCE: usize = 1 << 16;

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
    /// Remarks on the source and its georeference, if there are any. Boxed, as most textures have none.
    pub source: Option<Box<SourceNotes>>,
}

/// Remarks on how the source was read, and its georeference.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SourceNotes {
    /// Sentences: a colour profile that was converted, a band that was left out. At most 16 are written.
    pub remarks: Vec<String>,
    /// The GeoTIFF tags as a TIFF file of one texel (as GeoJP2 has them), in pixels of the first image's level 0; empty
    /// where there are none. At most [`MAX_GEOREFERENCE`] bytes are written.
    pub georeference: Vec<u8>,
}

impl Notes {
    /// Writes the notes as sections of the part "container": `NOTE`, and `SRCE` where there are notes on the source.
    pub fn write(&self, out: &mut SectionWriter) {
        let mut raw = Vec::new();
        write_text(&mut raw, &self.settings);
        write_text(&mut raw, &self.verdict);
        let known = self.psnr_without.iter().filter(|(_, psnr)| psnr.is_finite());
        for (name, psnr) in known.take(MAX_PARTS) {
            write_text(&mut raw, name);
            write_text(&mut raw, &psnr.to_bits().to_string());
        }
        out.section("container", NOTES_ID, &raw);
        let Some(source) = &self.source else { return };
        let georeference: &[u8] =
            if source.georeference.len() > MAX_GEOREFERENCE { &[] } else { &source.georeference };
        let mut raw = (georeference.len() as u32).to_le_bytes().to_vec();
        raw.extend(georeference);
        source.remarks.iter().take(MAX_REMARKS).for_each(|remark| write_text(&mut raw, remark));
        out.section("container", SOURCE_ID, &raw);
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
        if file.has(SOURCE_ID) {
            notes.source = Some(Box::new(SourceNotes::read(file, budget)?));
        }
        Ok(notes)
    }
}

impl SourceNotes {
    fn read(file: &Sections<'_>, budget: &mut Budget) -> Result<SourceNotes, LoadError> {
        let raw = file.read(SOURCE_ID, budget)?;
        budget.take(raw.len() as u64)?;
        let mut reader = Reader::new(String4(SOURCE_ID), &raw);
        let length = reader.u32()? as usize;
        if length > MAX_GEOREFERENCE {
            return Err(reader.corrupt("a georeference of more than 65536 bytes"));
        }
        let mut source =
            SourceNotes { georeference: reader.bytes(length)?.to_vec(), ..SourceNotes::default() };
        while reader.end().is_err() {
            if source.remarks.len() == MAX_REMARKS {
                return Err(reader.corrupt("more than 16 remarks"));
            }
            budget.take(3 * size_of::<String>() as u64)?;
            source.remarks.push(text(&mut reader)?);
        }
        Ok(source)
    }
}

/// Writes a text as [`text`] reads it: control characters, which names of files may hold, become spaces.
fn write_text(raw: &mut Vec<u8>, text: &str) {
    let text = text.replace(char::is_control, " ");
    let mut end = text.len().min(MAX_TEXT);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    raw.extend((end as u16).to_le_bytes());
    raw.extend(&text.as_bytes()[..end]);
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
            source: None,
        };
        assert_eq!(survivor(&notes), notes);
        let with = |source: SourceNotes| Notes { source: Some(Box::new(source)), ..notes.clone() };
        let remarks = vec!["Display P3 converted to sRGB".to_owned(), "größer".to_owned()];
        let told = with(SourceNotes { remarks, georeference: vec![0, 1, 2, 255] });
        assert_eq!(survivor(&told), told);
        // As of a file of that name.
        let broken =
            with(SourceNotes { remarks: vec!["a\nb.png: turned".to_owned()], ..SourceNotes::default() });
        assert_eq!(survivor(&broken).source.unwrap().remarks, ["a b.png: turned"]);
        let long =
            with(SourceNotes { georeference: vec![0; MAX_GEOREFERENCE + 1], ..SourceNotes::default() });
        assert_eq!(survivor(&long), with(SourceNotes::default()));
        let many = with(SourceNotes { remarks: vec!["one".to_owned(); 20], ..SourceNotes::default() });
        assert_eq!(survivor(&many).source.unwrap().remarks.len(), MAX_REMARKS);
    }

    fn survivor(notes: &Notes) -> Notes {
        let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
        notes.write(&mut writer);
        let bytes = writer.finish().bytes;
        let mut budget = Budget::default();
        Notes::read(&Sections::parse(&bytes, &mut budget).unwrap(), &mut budget).unwrap()
    }

    #[test]
    fn a_source_with_wrong_lengths_is_refused() {
        let open = |raw: &[u8]| {
            let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
            Notes::default().write(&mut writer);
            writer.section("container", SOURCE_ID, raw);
            let bytes = writer.finish().bytes;
            let mut budget = Budget::default();
            Notes::read(&Sections::parse(&bytes, &mut budget).unwrap(), &mut budget)
        };
        let source = |raw: &[u8]| open(raw).unwrap().source.unwrap();
        assert_eq!(source(&[1, 0, 0, 0, 7]).georeference, [7]);
        let remark = [1u8, 0, b'a'];
        let with = |remarks: usize| [vec![0; 4], remark.repeat(remarks)].concat();
        assert_eq!(source(&with(16)).remarks.len(), 16);
        let wrong: [&[u8]; 5] = [&[], &[2, 0, 0, 0, 7], &[1, 0, 1, 0], &with(17), &[0, 0, 0, 0, 1, 0, b'\n']];
        for raw in wrong {
            assert!(open(raw).is_err(), "{raw:?}");
        }
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

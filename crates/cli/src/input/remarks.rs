//! Notes and warnings on files that are read.

use std::path::Path;

/// Names that a line holds at most.
const MOST_NAMES: usize = 5;

/// Notes on how files were read, and warnings of what was left out or may be wrong.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Remarks {
    notes: Vec<Remark>,
    warnings: Vec<Remark>,
}

/// A sentence, and the names of the files that it holds for.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Remark {
    text: String,
    files: Vec<String>,
}

impl Remarks {
    /// Adds a note on how a file was read.
    pub(crate) fn note(&mut self, path: &Path, text: impl Into<String>) {
        add(&mut self.notes, path, text.into());
    }

    /// Adds a warning of something left out or possibly wrong.
    pub(crate) fn warn(&mut self, path: &Path, text: impl Into<String>) {
        add(&mut self.warnings, path, text.into());
    }

    /// The notes on an input of so many files.
    pub(crate) fn notes(&self, files: usize) -> Vec<String> {
        self.notes.iter().map(|remark| remark.line(files)).collect()
    }

    /// The warnings of an input of so many files.
    pub(crate) fn warnings(&self, files: usize) -> Vec<String> {
        self.warnings.iter().map(|remark| remark.line(files)).collect()
    }
}

fn add(remarks: &mut Vec<Remark>, path: &Path, text: String) {
    let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match remarks.iter_mut().find(|remark| remark.text == text) {
        Some(known) if known.files.contains(&file) => {}
        Some(known) => known.files.push(file),
        None => remarks.push(Remark { text, files: vec![file] }),
    }
}

impl Remark {
    fn line(&self, files: usize) -> String {
        if files < 2 { self.text.clone() } else { format!("{}: {}", few(&self.files), self.text) }
    }
}

/// The first of such names, and how many follow.
pub(crate) fn few(names: &[String]) -> String {
    match names.len().saturating_sub(MOST_NAMES) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..MOST_NAMES].join(", ")),
    }
}

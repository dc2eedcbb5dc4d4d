//! What is up to date: an index of the output folder, so that a second run does only what is new.
//!
//! `.texfold-cache.jsonl` holds a line for each output: its name, the hash of what it was made from, the hash of the
//! file, and its row of the report. A line is appended as soon as its output is in place, so an interrupted run goes
//! on where it stopped; a line cut by the interruption does not parse and its output is made again. At the end
//! of a run the index is rewritten whole. It may be deleted at any time.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use serde::{Deserialize, Serialize};

use crate::files;
use crate::output::write_whole;
use crate::report::Row;

/// Name of the index in the output folder.
pub(crate) const INDEX_NAME: &str = ".texfold-cache.jsonl";

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Line {
    output: String,
    key: String,
    hash: String,
    row: Row,
}

/// The index of one output folder.
#[derive(Debug)]
pub(crate) struct Cache {
    path: PathBuf,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    lines: BTreeMap<String, Line>,
    appended: bool,
}

impl Cache {
    /// Reads the index of `dir`; what does not parse is left out.
    pub(crate) fn open(dir: &Path) -> Cache {
        let path = dir.join(INDEX_NAME);
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let lines = text.lines().filter_map(|line| serde_json::from_str::<Line>(line).ok());
        let lines = lines.map(|line| (line.output.clone(), line)).collect();
        Cache { path, state: Mutex::new(State { lines, appended: false }) }
    }

    /// The row of `output` where it was made from the same and has not changed since.
    pub(crate) fn up_to_date(&self, output: &Path, key: &str) -> Option<Row> {
        let name = name_of(output)?;
        let line = self.lock().lines.get(&name).filter(|line| line.key == key).cloned()?;
        let hash = hash_file(output).ok()?;
        (hash == line.hash).then_some(line.row)
    }

    /// Notes that `output` is in place. An index that cannot be written only costs a later run time.
    pub(crate) fn record(&self, output: &Path, key: &str, bytes: &[u8], row: &Row) {
        let Some(name) = name_of(output) else { return };
        let hash = blake3::hash(bytes).to_hex().to_string();
        let line = Line { output: name.clone(), key: key.to_owned(), hash, row: row.clone() };
        let mut state = self.lock();
        if let Ok(mut text) = serde_json::to_string(&line) {
            text.push('\n');
            let file = OpenOptions::new().create(true).append(true).open(&self.path);
            let _ = file.and_then(|mut file| file.write_all(text.as_bytes()));
        }
        state.lines.insert(name, line);
        state.appended = true;
    }

    /// Writes the index whole, one line an output.
    pub(crate) fn close(self) {
        let state = self.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        if !state.appended {
            return;
        }
        let lines: Vec<String> =
            state.lines.values().filter_map(|line| serde_json::to_string(line).ok()).collect();
        let _ = write_whole(&self.path, (lines.join("\n") + "\n").as_bytes());
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The name of a line: that of the file; where it is no Unicode, its bytes in hexadecimal behind a zero, which no name has.
fn name_of(output: &Path) -> Option<String> {
    let name = output.file_name()?;
    let hexadecimal = || name.as_encoded_bytes().iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    Some(name.to_str().map_or_else(|| format!("\0{}", hexadecimal()), str::to_owned))
}

/// Feeds a file into `hasher`, its length first.
pub(crate) fn add_file(hasher: &mut blake3::Hasher, path: &Path) -> std::io::Result<()> {
    let mut file = files::open(path)?;
    hasher.update(&file.metadata()?.len().to_le_bytes());
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(()),
            length => hasher.update(&buffer[..length]),
        };
    }
}

fn hash_file(path: &Path) -> std::io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(files::open(path)?)?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// What made the outputs: another build of the program may encode otherwise.
pub(crate) fn program() -> &'static str {
    static PROGRAM: OnceLock<String> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let build = std::env::current_exe().and_then(|path| hash_file(&path)).unwrap_or_default();
        format!("{} {build}", env!("CARGO_PKG_VERSION"))
    })
}

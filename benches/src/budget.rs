//! Long runs over images: the cost is estimated before the start, `--budget MINUTES` bounds it, and a run that stopped goes on.
//!
//! The figures of each image are noted in `target/benches/NAME/` as soon as they are known. The same program with the same arguments
//! reads them instead of measuring again; a program that was built anew starts from nothing.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::report::{Outcome, cpu_seconds};

/// A run over images whose figures are noted.
#[derive(Debug)]
pub struct Run {
    name: &'static str,
    notes: PathBuf,
    /// Seconds that may pass.
    budget: f64,
    /// CPU seconds that an image takes, where none has been measured.
    usual: f64,
    start: Instant,
}

impl Run {
    /// The run of a bench, which takes `--budget MINUTES` out of its arguments. `usual` is the CPU time of an image in seconds, which
    /// is told where none has been measured yet.
    ///
    /// # Errors
    /// Where the number of minutes is none, or the folder of notes cannot be made.
    pub fn new(name: &'static str, usual: f64, arguments: &mut Vec<String>) -> Outcome<Run> {
        let mut budget = f64::INFINITY;
        if let Some(place) = arguments.iter().position(|argument| argument == "--budget") {
            let minutes = arguments.get(place + 1).ok_or("--budget needs a number of minutes")?;
            budget = 60.0 * minutes.parse::<f64>()?;
            arguments.drain(place..place + 2);
        }
        let mut hasher = DefaultHasher::new();
        arguments.hash(&mut hasher);
        fs::read(std::env::current_exe()?)?.hash(&mut hasher);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/benches").join(name);
        fs::create_dir_all(&folder)?;
        let notes = folder.join(format!("{:016x}.tsv", hasher.finish()));
        Ok(Run { name, notes, budget, usual, start: Instant::now() })
    }

    /// Rows of figures of every image, in order; an error that says how to go on where the budget is used up.
    ///
    /// # Errors
    /// As above, where `measure` fails, and where notes cannot be read or written.
    pub fn rows(
        &self,
        images: &[PathBuf],
        measure: impl Fn(&Path) -> Outcome<Vec<Vec<String>>>,
    ) -> Outcome<Vec<Vec<Vec<String>>>> {
        let known = fs::read_to_string(&self.notes).unwrap_or_default();
        let mut known: Vec<Noted> = known.lines().filter_map(Noted::parsed).collect();
        self.tell_cost(images.len(), &known);
        let mut all = Vec::new();
        for path in images {
            let name = path.display().to_string();
            let place = known.iter().position(|noted| noted.image == name);
            let noted = match place {
                Some(place) => known.swap_remove(place),
                None if self.start.elapsed().as_secs_f64() > self.budget => {
                    let (name, done, count) = (self.name, all.len(), images.len());
                    return Err(format!(
                        "{name}: the budget is used up after {done} of {count} images; run the same command again to go on"
                    )
                    .into());
                }
                None => {
                    eprintln!("{name}");
                    let start = cpu_seconds();
                    let rows = measure(path)?;
                    let noted = Noted { image: name, seconds: cpu_seconds() - start, rows };
                    let mut file = fs::OpenOptions::new().append(true).create(true).open(&self.notes)?;
                    writeln!(file, "{}", noted.line())?;
                    noted
                }
            };
            all.push(noted.rows);
        }
        Ok(all)
    }

    fn tell_cost(&self, images: usize, known: &[Noted]) {
        let spent: f64 = known.iter().map(|noted| noted.seconds).sum();
        let each = if known.is_empty() { self.usual } else { spent / known.len() as f64 };
        let left = images.saturating_sub(known.len());
        let minutes = left as f64 * each / 60.0;
        eprintln!("{}: {images} images, {left} to measure: about {minutes:.0} CPU minutes", self.name);
    }
}

/// What is noted of an image.
#[derive(Debug, PartialEq)]
struct Noted {
    image: String,
    /// CPU time in seconds.
    seconds: f64,
    rows: Vec<Vec<String>>,
}

impl Noted {
    /// One line: image, seconds and rows between tabs, the cells of a row between vertical bars.
    fn line(&self) -> String {
        let rows: Vec<String> = self.rows.iter().map(|row| row.join("|")).collect();
        format!("{}\t{}\t{}", self.image, self.seconds, rows.join("\t"))
    }

    /// `None` for a line that is cut.
    fn parsed(line: &str) -> Option<Noted> {
        let mut parts = line.split('\t');
        let (image, seconds) = (parts.next()?.to_owned(), parts.next()?.parse().ok()?);
        let rows: Vec<Vec<String>> = parts.map(|row| row.split('|').map(str::to_owned).collect()).collect();
        let width = rows.first()?.len();
        rows.iter().all(|row| row.len() == width).then_some(Noted { image, seconds, rows })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_notes_come_back_and_cut_ones_are_left_out() {
        let rows = [["form", "1.5"], ["other", "2"]].map(|row| row.map(str::to_owned).to_vec()).to_vec();
        let noted = Noted { image: "a b.png".to_owned(), seconds: 1.25, rows };
        assert_eq!(Noted::parsed(&noted.line()).as_ref(), Some(&noted));
        assert_eq!(Noted::parsed("a b.png\t1.25\tform|1.5\tother"), None);
        assert_eq!(Noted::parsed("a b.png\t1."), None);
    }
}

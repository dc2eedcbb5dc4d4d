//! Images that are added to a bank: those that do not depend on one another at a time, listed in order.

use std::collections::HashSet;
use std::path::Path;

use texfold::bank::Codebooks;

use super::task::{Finished, Workplace};
use super::{Work, schedule, settle};
use crate::bank::{Add, BankTask, Made, Open, Step, plan};
use crate::error::{CliError, guarded};
use crate::report::Entry;

/// Memory in bytes that images which are encoded at a time may take together: with what else there is the process stays
/// below 1.5 GiB.
const MOST_BYTES: u64 = 1 << 30;

/// An image that is to be encoded, with all that it takes.
struct Ready<'r> {
    task: &'r BankTask,
    add: &'r Add,
    books: Result<Codebooks, CliError>,
}

/// Adds all images to the bank in `out`; entries are in the order of the tasks, each with whether it was up to date.
pub(super) fn add_all(
    tasks: &[&Work],
    out: &Path,
    jobs: usize,
    place: &Workplace<'_>,
) -> Result<Vec<(Entry, bool)>, CliError> {
    let of_bank: Vec<&BankTask> = tasks.iter().filter_map(|task| task.for_bank()).collect();
    if of_bank.is_empty() {
        return Ok(Vec::new());
    }
    let mut open = Open::new(out)?;
    let mut steps = plan(&mut open, &of_bank, place.limit_bytes, place.force).into_iter().peekable();
    let mut entries = Vec::new();
    let mut rest = tasks;
    while steps.peek().is_some() {
        let wave = next_wave(&mut steps, jobs);
        let (now, later) = rest.split_at(wave.len());
        rest = later;
        let made = make(&open, now, &wave, jobs, place);
        for ((task, step), made) in now.iter().zip(wave).zip(made) {
            let finished = match (step, made) {
                (Step::Known(row), _) => Ok(Finished { row: *row, skipped: true }),
                (Step::Failed(error), _) => Err(error),
                (_, Some(made)) => {
                    let listed = made.and_then(|made| open.commit(made));
                    listed.map(|row| Finished { row, skipped: false })
                }
                (_, None) => {
                    let message = "the work was not finished".to_owned();
                    Err(CliError::Internal { path: task.found().path.clone(), message })
                }
            };
            entries.push(settle(task, finished, place.progress));
        }
    }
    Ok(entries)
}

/// The next images of which none depends on another; as many as are encoded at a time, for all of them are listed when
/// they are done.
fn next_wave(steps: &mut std::iter::Peekable<impl Iterator<Item = Step>>, jobs: usize) -> Vec<Step> {
    let mut wave = Vec::new();
    let (mut shared, mut encoded) = (HashSet::new(), 0);
    let fits = |step: &Step, shared: &HashSet<usize>, encoded: usize| match step {
        Step::Add(add) => {
            let apart = !add.depends || add.categories.iter().all(|number| !shared.contains(number));
            encoded == 0 || apart && encoded < jobs
        }
        _ => true,
    };
    while let Some(step) = steps.next_if(|step| fits(step, &shared, encoded)) {
        if let Step::Add(add) = &step {
            shared.extend(add.categories.iter().copied());
            encoded += 1;
        }
        wave.push(step);
    }
    wave
}

/// Encodes the images of a wave; `None` for those that need no encoding.
fn make(
    open: &Open,
    tasks: &[&Work],
    wave: &[Step],
    jobs: usize,
    place: &Workplace<'_>,
) -> Vec<Option<Result<Made, CliError>>> {
    let mut ready = Vec::new();
    for (task, step) in tasks.iter().zip(wave) {
        if let (Some(task), Step::Add(add)) = (task.for_bank(), step) {
            ready.push(Ready { task, add, books: open.books_for(add) });
        }
    }
    let bank = open.bank();
    let work = |ready: &Ready<'_>| {
        let Ready { task, add, books } = ready;
        guarded(&task.path, || {
            let books = books.as_ref().map_err(|error| CliError::BankBook {
                path: task.path.clone(),
                cause: crate::error::explain(error),
            })?;
            let share = place.progress.share(task.name.clone());
            task.make(bank, books, add, place.limit_bytes, &share)
        })
    };
    let limit = place.limit_bytes.min(MOST_BYTES);
    let made = schedule::run(&ready, jobs, limit, |ready| ready.task.cost_bytes(), work);
    let mut made = made.into_iter();
    let of_step = |step: &Step| match step {
        Step::Add(_) => made.next().flatten(),
        _ => None,
    };
    wave.iter().map(of_step).collect()
}

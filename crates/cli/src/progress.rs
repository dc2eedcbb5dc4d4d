//! Progress on stderr, never on stdout: a bar where that is a terminal, else a line now and then.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use texfold_core::Stage;

use crate::console::{complain, is_quiet, mention, say};

/// Steps of the bar for each input.
const STEPS: u64 = 1000;
/// Time between lines where there is no bar.
const PAUSE: Duration = Duration::from_secs(10);
/// Inputs of a run up to which all warnings and notes are printed.
const FEW: usize = 20;
/// Warnings and notes that a run of more inputs prints.
const MOST_REMARKS: [usize; 2] = [5, 2];

/// The progress of a batch.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: ProgressBar,
    /// Time of the last progress line, without a bar.
    told: Option<Mutex<Instant>>,
    inputs: usize,
    /// Warnings and notes so far.
    remarks: [AtomicUsize; 2],
}

/// One input's share of it.
#[derive(Debug)]
pub(crate) struct Share<'p> {
    progress: &'p Progress,
    name: String,
    done: AtomicU32,
}

/// A message on an input beside its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Remark {
    /// Something may be wrong.
    Warning,
    /// A note on how it was read.
    Note,
}

impl Progress {
    pub(crate) fn new(inputs: usize) -> Self {
        Progress::made(inputs, std::io::stderr().is_terminal() && !is_quiet())
    }

    /// As lines alone, for commands whose other messages do not go through this.
    pub(crate) fn lines(inputs: usize) -> Self {
        Progress::made(inputs, false)
    }

    fn made(inputs: usize, has_bar: bool) -> Self {
        let target = if has_bar { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(inputs as u64 * STEPS), target);
        let template = "{bar:30} {percent:>3}% {elapsed_precise}, {eta} left  {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        let told = (!has_bar).then(|| Mutex::new(Instant::now()));
        Progress { bar, told, inputs, remarks: Default::default() }
    }

    /// Starts an input.
    pub(crate) fn share(&self, name: String) -> Share<'_> {
        Share { progress: self, name, done: AtomicU32::new(0) }
    }

    /// A line of results on stdout.
    pub(crate) fn say(&self, line: &str) {
        self.bar.suspend(|| say(line));
    }

    /// An error on stderr.
    pub(crate) fn complain(&self, line: &str) {
        self.bar.suspend(|| complain(line));
    }

    /// A line on stderr that is no error.
    pub(crate) fn mention(&self, line: &str) {
        self.bar.suspend(|| mention(line));
    }

    /// Prints a warning on stderr or a note on stdout. With many inputs only the first of each are printed.
    pub(crate) fn remark(&self, kind: Remark, name: &str, text: &str) {
        let number = self.remarks[kind as usize].fetch_add(1, Ordering::Relaxed);
        if self.inputs > FEW && number >= MOST_REMARKS[kind as usize] {
            return;
        }
        match kind {
            Remark::Warning => self.mention(&format!("warning: {name}: {text}")),
            Remark::Note => self.say(&format!("note: {name}: {text}")),
        }
    }

    /// Removes the bar, and prints the number of messages that were not printed.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
        let untold =
            [0, 1].map(|kind| self.remarks[kind].load(Ordering::Relaxed).saturating_sub(MOST_REMARKS[kind]));
        if self.inputs > FEW && untold != [0; 2] {
            let [warnings, notes] = untold;
            mention(&format!("{warnings} more warnings and {notes} more notes: --report FILE lists them"));
        }
    }

    /// Prints a progress line where there is no bar and the last line is older than [`PAUSE`].
    fn tell(&self, name: &str, stage: &str) {
        let Some(mut told) = self.told.as_ref().and_then(|told| told.try_lock().ok()) else { return };
        if told.elapsed() < PAUSE {
            return;
        }
        *told = Instant::now();
        let percent = 100 * self.bar.position() / self.bar.length().unwrap_or(1).max(1);
        let left = self.bar.eta().as_secs();
        mention(&format!(
            "{percent} %, {} s, about {left} s left: {name}: {stage}",
            self.bar.elapsed().as_secs()
        ));
    }
}

impl Share<'_> {
    pub(crate) fn report(&self, stage: Stage) {
        let Progress { bar, told, .. } = self.progress;
        if told.is_none() {
            bar.set_message(format!("{}: {}", self.name, stage.name));
        }
        self.advance((stage.done.clamp(0.0, 1.0) * STEPS as f32) as u32);
        self.progress.tell(&self.name, stage.name);
    }

    fn advance(&self, to: u32) {
        let before = self.done.fetch_max(to, Ordering::Relaxed);
        if to > before {
            self.progress.bar.inc(u64::from(to - before));
        }
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        self.advance(STEPS as u32);
    }
}

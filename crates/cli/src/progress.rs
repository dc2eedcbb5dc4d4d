//! Progress on stderr, where that is a terminal; never on stdout.

use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU32, Ordering};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use texfold_core::Stage;

use crate::console::say;

/// Steps of the bar for each input.
const STEPS: u64 = 1000;

/// A bar for a batch, or nothing where nobody looks.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: Option<ProgressBar>,
}

/// One input's share of the bar.
#[derive(Debug)]
pub(crate) struct Share<'p> {
    progress: &'p Progress,
    name: String,
    done: AtomicU32,
}

impl Progress {
    pub(crate) fn new(inputs: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(inputs as u64 * STEPS), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3}% {elapsed_precise} {msg}")
            {
                bar.set_style(style);
            }
            bar
        });
        Progress { bar }
    }

    /// Starts an input.
    pub(crate) fn share(&self, name: String) -> Share<'_> {
        Share { progress: self, name, done: AtomicU32::new(0) }
    }

    /// A line of results on stdout.
    pub(crate) fn say(&self, line: &str) {
        self.aside(|| say(line));
    }

    /// A line on stderr.
    pub(crate) fn complain(&self, line: &str) {
        self.aside(|| {
            let _ = writeln!(std::io::stderr().lock(), "{line}");
        });
    }

    /// Does `write` with the bar out of the way.
    pub(crate) fn aside(&self, write: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Share<'_> {
    pub(crate) fn report(&self, stage: Stage) {
        let Some(bar) = &self.progress.bar else { return };
        bar.set_message(format!("{}: {}", self.name, stage.name));
        self.advance((stage.done.clamp(0.0, 1.0) * STEPS as f32) as u32);
    }

    fn advance(&self, to: u32) {
        let before = self.done.fetch_max(to, Ordering::Relaxed);
        if let Some(bar) = self.progress.bar.as_ref().filter(|_| to > before) {
            bar.inc(u64::from(to - before));
        }
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        self.advance(STEPS as u32);
    }
}

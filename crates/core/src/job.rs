//! Progress, cancellation, threads, seed and memory budget as one argument.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::{Budget, EncodeError, Limits};

/// Asks a job to stop; it does so at its next checkpoint.
#[derive(Debug, Default)]
pub struct Cancel(AtomicBool);

impl Cancel {
    /// Asks the job to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// What a job reports: the stage's name and the share of the whole that is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stage {
    /// Name of the running stage.
    pub name: &'static str,
    /// Share of the job that is done, 0 to 1, never falling.
    pub done: f32,
}

/// One run of an encoder.
pub struct Job<'a> {
    progress: Option<&'a mut dyn FnMut(Stage)>,
    cancel: Option<&'a Cancel>,
    pool: Option<&'a rayon::ThreadPool>,
    stage: Stage,
    span: (f32, f32),
    /// Start of all pseudo-random choices.
    pub seed: u64,
    /// What may be allocated.
    pub budget: Budget,
}

impl std::fmt::Debug for Job<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Job").field("stage", &self.stage).field("seed", &self.seed).finish_non_exhaustive()
    }
}

impl Default for Job<'_> {
    fn default() -> Self {
        Job::new(Limits::default())
    }
}

impl<'a> Job<'a> {
    /// A silent job on rayon's global pool.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Job {
            progress: None,
            cancel: None,
            pool: None,
            stage: Stage { name: "", done: 0.0 },
            span: (0.0, 1.0),
            seed: 0x7e8f_01d5,
            budget: Budget::new(limits),
        }
    }

    /// Reports stages to `progress`.
    #[must_use]
    pub fn with_progress(mut self, progress: &'a mut dyn FnMut(Stage)) -> Self {
        self.progress = Some(progress);
        self
    }

    /// Stops at the next checkpoint after `cancel` was set.
    #[must_use]
    pub fn with_cancel(mut self, cancel: &'a Cancel) -> Self {
        self.cancel = Some(cancel);
        self
    }

    /// Runs on `pool` instead of rayon's global one.
    #[must_use]
    pub fn with_pool(mut self, pool: &'a rayon::ThreadPool) -> Self {
        self.pool = Some(pool);
        self
    }

    /// Runs `work` on the job's threads.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Enters a stage that starts when `done` (0 to 1) of the running span is done. Progress never falls.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the caller asked to stop.
    pub fn stage(&mut self, name: &'static str, done: f32) -> Result<(), EncodeError> {
        let (start, end) = self.span;
        let whole = start + (end - start) * done.clamp(0.0, 1.0);
        self.stage = Stage { name, done: self.stage.done.max(whole) };
        if let Some(progress) = &mut self.progress {
            progress(self.stage);
        }
        self.checkpoint()
    }

    /// Runs `work` with its own 0 to 1 mapped to `from..to` of the running span, so that a search loop
    /// over whole encodes still reports one rising figure.
    pub fn within<R>(&mut self, from: f32, to: f32, work: impl FnOnce(&mut Self) -> R) -> R {
        let outer = self.span;
        let at = |share: f32| outer.0 + (outer.1 - outer.0) * share.clamp(0.0, 1.0);
        self.span = (at(from), at(to));
        let result = work(self);
        self.span = outer;
        result
    }

    /// A place where the job may stop.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the caller asked to stop.
    pub fn checkpoint(&self) -> Result<(), EncodeError> {
        match self.cancel {
            Some(cancel) if cancel.is_cancelled() => Err(EncodeError::Cancelled),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_monotone_and_nested() {
        let mut seen = Vec::new();
        let mut sink = |stage: Stage| seen.push(stage);
        let mut job = Job::default().with_progress(&mut sink);
        job.stage("a", 0.5).unwrap();
        job.within(0.5, 0.9, |job| job.stage("b", 0.5)).unwrap();
        job.stage("c", 0.1).unwrap();
        assert_eq!(
            seen,
            [Stage { name: "a", done: 0.5 }, Stage { name: "b", done: 0.7 }, Stage { name: "c", done: 0.7 }]
        );
    }

    #[test]
    fn a_cancelled_job_stops_at_the_next_stage() {
        let cancel = Cancel::default();
        let mut job = Job::default().with_cancel(&cancel);
        assert!(job.stage("a", 0.0).is_ok());
        cancel.cancel();
        assert!(matches!(job.stage("b", 0.1), Err(EncodeError::Cancelled)));
    }
}

//! Progress, cancellation, threads, seed and memory budget as one argument.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::{Budget, EncodeError, Limits};

/// Stops a job: by [`Cancel::cancel`] from another thread, or where a function says so.
#[derive(Default)]
pub struct Cancel {
    asked: AtomicBool,
    when: Option<Box<dyn Fn() -> bool + Send + Sync>>,
}

impl fmt::Debug for Cancel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Cancel").field("asked", &self.asked).finish_non_exhaustive()
    }
}

impl Cancel {
    /// Stops a job when `when` returns `true`: for callers with a signal of their own. It is called at each look, from any of the job's
    /// threads, up to once for each block of a texture.
    pub fn when(when: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Cancel { asked: AtomicBool::new(false), when: Some(Box::new(when)) }
    }

    /// Asks the job to stop.
    pub fn cancel(&self) {
        self.asked.store(true, Ordering::Relaxed);
    }

    /// Whether the job is to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        let is_asked = self.asked.load(Ordering::Relaxed);
        if !is_asked && self.when.as_ref().is_some_and(|when| when()) {
            self.cancel();
            return true;
        }
        is_asked
    }
}

/// A look at whether a job was asked to stop, for loops that run on several threads or have no [`Job`] at hand.
///
/// One look is one relaxed load of an atomic, and the caller's function where there is one: cheap enough for every block of a texture.
#[derive(Debug, Clone, Copy, Default)]
pub struct CancelCheck<'a>(Option<&'a Cancel>);

impl CancelCheck<'_> {
    /// Whether the job was asked to stop.
    #[must_use]
    pub fn is_cancelled(self) -> bool {
        self.0.is_some_and(Cancel::is_cancelled)
    }

    /// A place where the job may stop.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the caller asked to stop.
    pub fn checkpoint(self) -> Result<(), EncodeError> {
        if self.is_cancelled() { Err(EncodeError::Cancelled) } else { Ok(()) }
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

/// One run of an encoder. It can be moved to another thread.
pub struct Job<'a> {
    progress: Option<&'a mut (dyn FnMut(Stage) + Send)>,
    cancel: Option<&'a Cancel>,
    pool: Option<&'a rayon::ThreadPool>,
    stage: Stage,
    span: (f32, f32),
    /// Start of all pseudo-random choices.
    pub seed: u64,
    /// What may be allocated.
    pub budget: Budget,
}

impl fmt::Debug for Job<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
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
    pub fn with_progress(mut self, progress: &'a mut (dyn FnMut(Stage) + Send)) -> Self {
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

    /// Books `bytes` while `work` runs, for what an encoder allocates in that time.
    ///
    /// # Errors
    /// [`EncodeError::Limit`] where the budget has no room; `work` is not run then. Otherwise what `work` returns.
    pub fn holding<R>(
        &mut self,
        bytes: u64,
        work: impl FnOnce(&mut Self) -> Result<R, EncodeError>,
    ) -> Result<R, EncodeError> {
        self.budget.take(bytes)?;
        let result = work(self);
        self.budget.release(bytes);
        result
    }

    /// A look at whether the job was asked to stop, which can be copied into the closures of parallel loops. Such a
    /// loop returns early where [`CancelCheck::is_cancelled`], and [`Job::checkpoint`] behind it gives the error.
    #[must_use]
    pub fn cancel_check(&self) -> CancelCheck<'a> {
        CancelCheck(self.cancel)
    }

    /// A place where the job may stop. Encoders look at least every 0.2 s of work.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the caller asked to stop.
    pub fn checkpoint(&self) -> Result<(), EncodeError> {
        self.cancel_check().checkpoint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_stops_a_job() {
        let looks = std::sync::atomic::AtomicU32::new(0);
        let cancel = Cancel::when(move || looks.fetch_add(1, Ordering::Relaxed) == 2);
        let job = Job::default().with_cancel(&cancel);
        assert_eq!([0; 3].map(|_| job.cancel_check().checkpoint().is_ok()), [true, true, false]);
    }

    #[test]
    fn a_job_moves_to_another_thread() {
        fn is_send<T: Send>(_: &T) {}
        let mut seen = 0;
        let mut sink = |_: Stage| seen += 1;
        let mut job = Job::default().with_progress(&mut sink);
        is_send(&job);
        std::thread::scope(|scope| {
            scope.spawn(move || job.stage("elsewhere", 0.5).unwrap());
        });
        assert_eq!(seen, 1);
    }

    #[test]
    fn memory_is_held_while_work_runs() {
        let mut job = Job::new(Limits { bytes: 100, ..Limits::default() });
        let inner = job.holding(60, |job| job.holding(60, |_| Ok(())));
        assert!(matches!(inner, Err(EncodeError::Limit(_))));
        assert!(job.holding(100, |job| job.checkpoint()).is_ok());
        assert_eq!(job.budget.peak_bytes(), 100);
    }

    #[test]
    fn a_parallel_loop_sees_that_it_was_cancelled() {
        use rayon::prelude::*;
        let cancel = Cancel::default();
        let job = Job::default().with_cancel(&cancel);
        let check = job.cancel_check();
        let rounds = |_| (0..1000).into_par_iter().filter(|_| !check.is_cancelled()).count();
        assert_eq!(rounds(()), 1000);
        cancel.cancel();
        assert_eq!(rounds(()), 0);
        assert!(matches!(check.checkpoint(), Err(EncodeError::Cancelled)));
    }

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

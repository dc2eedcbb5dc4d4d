//! Several tasks at a time, within a memory limit.
//!
//! Tasks start in order; the next waits until its estimate fits beside those that run, or until none runs. Peak memory
//! so depends on the limit and the largest task, not on the number of tasks. Each worker has a thread pool of its share
//! of the cores.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Cores that the process may use.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

struct State {
    next: usize,
    held_bytes: u64,
    running: usize,
}

struct Gate {
    state: Mutex<State>,
    changed: Condvar,
    limit_bytes: u64,
}

impl Gate {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next task and its cost, once there is room for it; `None` when all have started.
    fn enter<T>(&self, tasks: &[T], cost_bytes: &impl Fn(&T) -> u64) -> Option<(usize, u64)> {
        let mut state = self.lock();
        let mut known: Option<(usize, u64)> = None;
        loop {
            let index = state.next;
            let task = tasks.get(index)?;
            let cost = match known {
                Some((same, cost)) if same == index => cost,
                _ => cost_bytes(task),
            };
            known = Some((index, cost));
            if state.running == 0 || state.held_bytes.saturating_add(cost) <= self.limit_bytes {
                state.next += 1;
                state.running += 1;
                state.held_bytes = state.held_bytes.saturating_add(cost);
                return known;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn leave(&self, cost: u64) {
        let mut state = self.lock();
        state.running -= 1;
        state.held_bytes = state.held_bytes.saturating_sub(cost);
        drop(state);
        self.changed.notify_all();
    }
}

/// Runs `work` on every task with `jobs` threads in all, shared out among tasks that run at a time; results are in the
/// order of the tasks, `None` for one whose work did not return.
pub(crate) fn run<T: Sync, R: Send>(
    tasks: &[T],
    jobs: usize,
    limit_bytes: u64,
    cost_bytes: impl Fn(&T) -> u64 + Sync,
    work: impl Fn(&T) -> R + Sync,
) -> Vec<Option<R>> {
    let state = Mutex::new(State { next: 0, held_bytes: 0, running: 0 });
    let gate = Gate { state, changed: Condvar::new(), limit_bytes };
    let results: Mutex<Vec<Option<R>>> = Mutex::new(tasks.iter().map(|_| None).collect());
    let workers = jobs.min(tasks.len());
    let threads = (jobs / workers.max(1)).max(1);
    let worker = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        while let Some((index, cost)) = gate.enter(tasks, &cost_bytes) {
            let result = match &pool {
                Ok(pool) => pool.install(|| work(&tasks[index])),
                Err(_) => work(&tasks[index]),
            };
            results.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(result);
            gate.leave(cost);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(worker);
        }
    });
    results.into_inner().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::Duration;

    #[test]
    fn results_are_in_order_and_memory_stays_within_the_limit() {
        let (held, peak) = (AtomicU64::new(0), AtomicU64::new(0));
        let tasks: Vec<u64> = (0..40).map(|i| i * 7 % 11).collect();
        let work = |&task: &u64| {
            let now = held.fetch_add(task, Ordering::SeqCst) + task;
            peak.fetch_max(now, Ordering::SeqCst);
            std::thread::sleep(Duration::from_millis(2));
            held.fetch_sub(task, Ordering::SeqCst);
            task * 2
        };
        let results = run(&tasks, 8, 15, |&task| task, work);
        assert_eq!(results, tasks.iter().map(|task| Some(task * 2)).collect::<Vec<_>>());
        assert!(peak.load(Ordering::SeqCst) <= 15);
    }

    #[test]
    fn a_task_above_the_limit_runs_alone() {
        let running = AtomicU64::new(0);
        let work = |_: &u64| {
            let others = running.fetch_add(1, Ordering::SeqCst);
            std::thread::sleep(Duration::from_millis(5));
            running.fetch_sub(1, Ordering::SeqCst);
            others
        };
        assert_eq!(run(&[100, 100, 100], 3, 10, |&task| task, work), [Some(0); 3]);
        assert_eq!(run(&[] as &[u64], 3, 10, |&task| task, work), []);
    }
}

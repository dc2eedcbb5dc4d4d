//! Work that may panic or hang, as what is tested here must not.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use texfold::Cancel;

/// What anything here may take: all inputs are small, and the slowest codec takes a twentieth of it.
const LONGEST: Duration = Duration::from_secs(60);

/// Does `work`, tells it to stop after [`LONGEST`], and catches its panics.
///
/// # Errors
/// The words of the panic.
pub(super) fn guarded<R>(work: impl FnOnce(&Cancel) -> R) -> Result<R, String> {
    let cancel = Cancel::default();
    let caught = thread::scope(|scope| {
        let (done, waits) = channel::<()>();
        let cancel = &cancel;
        scope.spawn(move || {
            if waits.recv_timeout(LONGEST) == Err(RecvTimeoutError::Timeout) {
                cancel.cancel();
            }
        });
        let caught = catch_unwind(AssertUnwindSafe(|| work(cancel)));
        drop(done);
        caught
    });
    caught.map_err(|panic| format!("panicked: {}", words(panic.as_ref())))
}

fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("without words")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_are_caught_with_their_words() {
        assert_eq!(guarded(|_| 3), Ok(3));
        assert_eq!(guarded::<()>(|_| panic!("of {}", 1)), Err("panicked: of 1".to_owned()));
    }
}

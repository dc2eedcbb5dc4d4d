//! [`texfold_core::vectorised`]; tests also run what is compiled for any processor.

#[cfg(not(test))]
pub(crate) use texfold_core::vectorised;

/// As [`texfold_core::vectorised`], unless [`NARROW`] is set.
#[cfg(test)]
#[inline(always)]
pub(crate) fn vectorised<R>(mut work: impl FnMut() -> R) -> R {
    if NARROW.load(std::sync::atomic::Ordering::Relaxed) { work() } else { texfold_core::vectorised(work) }
}

/// Whether tests run what is compiled for any processor.
#[cfg(test)]
pub(crate) static NARROW: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

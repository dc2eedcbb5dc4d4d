//! Code that is compiled twice: for any processor, and with the vectors of newer ones, which are chosen while it runs.

/// What `work` gives, compiled for the vectors that this processor has: AVX2 on x86-64, with the further instructions that came with
/// it. Only what is inlined into `work` is compiled so, and a call of this cannot be inlined: `work` is a block, a superblock or a row
/// of texels. Results do not depend on the processor where `work` computes in integers.
#[inline(always)]
pub(crate) fn vectorised<R>(work: impl FnOnce() -> R) -> R {
    #[cfg(test)]
    if NARROW.load(std::sync::atomic::Ordering::Relaxed) {
        return work();
    }
    pulp::Arch::new().dispatch(work)
}

/// Whether tests run what is compiled for any processor.
#[cfg(test)]
pub(crate) static NARROW: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

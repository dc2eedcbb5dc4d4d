//! Code that is compiled twice: for any processor, and with the vectors of newer ones, which are chosen while it runs.

/// The result of `work`, compiled for the vectors that this processor has: AVX2 on x86-64, with the further instructions that came with
/// it. Only what is inlined into `work`, a closure marked `#[inline(always)]`, is compiled so: closures that it passes to iterators and
/// to functions of arrays often are not. A call of this cannot be inlined: `work` is a block, a superblock or a row of texels. Results
/// do not depend on the processor where `work` computes in integers, or in floats without sums that are reordered.
#[inline(always)]
pub fn vectorised<R>(work: impl FnMut() -> R) -> R {
    pulp::Arch::new().dispatch(Work(work))
}

/// Work that is called as `FnMut`: the call of a closure that can be called again as `FnOnce` is a function of its own, which need not be
/// inlined.
struct Work<F>(F);

impl<R, F: FnMut() -> R> pulp::WithSimd for Work<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}

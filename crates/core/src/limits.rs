//! Limits on what foreign bytes and large sources may cost, set before anything is allocated.

/// Most texels a side of an image in a file: 16 mip levels, and a plane of its 4x4 blocks is a texture that every WebGPU
/// device can sample.
pub const MAX_IMAGE_SIDE: u32 = 1 << 15;

/// Most texels a side of a texture that every WebGPU device can sample (its limit `maxTextureDimension2D`).
pub const MAX_PLANE_SIDE: u32 = 8192;

/// What a reader or encoder may use. The defaults are generous for textures and far below what
/// brings a machine down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Texels of all images and levels together.
    pub texels: u64,
    /// Bytes allocated at a time.
    pub bytes: u64,
    /// Sections of a file.
    pub sections: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { texels: 1 << 32, bytes: 8 << 30, sections: 4096 }
    }
}

/// A limit was reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {needed} needed, {allowed} allowed; raise the limit if the source can be trusted")]
pub struct LimitError {
    /// What ran out: "bytes", "texels" or "sections".
    pub what: &'static str,
    /// How much was asked for, with what is held already.
    pub needed: u64,
    /// How much is allowed.
    pub allowed: u64,
}

/// Counts what is allocated against [`Limits`].
#[derive(Debug, Clone)]
pub struct Budget {
    limits: Limits,
    held_bytes: u64,
    peak_bytes: u64,
}

impl Default for Budget {
    fn default() -> Self {
        Budget::new(Limits::default())
    }
}

impl Budget {
    /// An empty account.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Budget { limits, held_bytes: 0, peak_bytes: 0 }
    }

    /// The limits it counts against.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The most bytes held at a time.
    #[must_use]
    pub fn peak_bytes(&self) -> u64 {
        self.peak_bytes
    }

    /// Books `bytes`.
    ///
    /// # Errors
    /// [`LimitError`] where more would be held than allowed; nothing is booked then.
    pub fn take(&mut self, bytes: u64) -> Result<(), LimitError> {
        let needed = self.held_bytes.saturating_add(bytes);
        if needed > self.limits.bytes {
            return Err(LimitError { what: "bytes", needed, allowed: self.limits.bytes });
        }
        self.held_bytes = needed;
        self.peak_bytes = self.peak_bytes.max(needed);
        Ok(())
    }

    /// Gives `bytes` back.
    pub fn release(&mut self, bytes: u64) {
        self.held_bytes = self.held_bytes.saturating_sub(bytes);
    }

    /// Checks a number of texels.
    ///
    /// # Errors
    /// [`LimitError`] where it is above the limit.
    pub fn check_texels(&self, texels: u64) -> Result<(), LimitError> {
        if texels > self.limits.texels {
            return Err(LimitError { what: "texels", needed: texels, allowed: self.limits.texels });
        }
        Ok(())
    }

    /// An empty vector with room for `len` values, booked before it is allocated: filled up to `len` it never grows.
    ///
    /// # Errors
    /// [`LimitError`] where it does not fit.
    pub fn reserved<T>(&mut self, len: u64) -> Result<Vec<T>, LimitError> {
        self.take(len.saturating_mul(size_of::<T>() as u64))?;
        let mut values = Vec::new();
        let reserved = usize::try_from(len).is_ok_and(|len| values.try_reserve_exact(len).is_ok());
        if reserved {
            Ok(values)
        } else {
            Err(LimitError { what: "values in memory", needed: len, allowed: 0 })
        }
    }

    /// A vector of `len` default values, booked before it is allocated.
    ///
    /// # Errors
    /// [`LimitError`] where it does not fit.
    pub fn zeroed<T: Clone + Default>(&mut self, len: u64) -> Result<Vec<T>, LimitError> {
        self.take(len.saturating_mul(size_of::<T>() as u64))?;
        let too_long = LimitError { what: "bytes", needed: len, allowed: usize::MAX as u64 };
        Ok(vec![T::default(); usize::try_from(len).map_err(|_| too_long)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_refuses_before_it_allocates() {
        let mut budget = Budget::new(Limits { bytes: 100, ..Limits::default() });
        assert!(budget.zeroed::<u32>(20).is_ok());
        let refused = budget.zeroed::<u64>(u64::MAX / 4);
        assert_eq!(refused.map(|v| v.len()).map_err(|e| e.what), Err("bytes"));
        budget.release(80);
        assert!(budget.take(100).is_ok());
        assert_eq!(budget.peak_bytes(), 100);
        budget.release(100);
        assert_eq!(budget.reserved::<u32>(25).map(|values| values.capacity()), Ok(25));
        assert!(budget.reserved::<u8>(1).is_err());
        let mut boundless = Budget::new(Limits { bytes: u64::MAX, ..Limits::default() });
        assert!(boundless.reserved::<u64>(u64::MAX).is_err());
    }
}

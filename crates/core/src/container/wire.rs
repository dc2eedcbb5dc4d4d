//! Checked little-endian reading of a section.

use crate::LoadError;
use crate::id::String4;

/// Reads a section's bytes from front to back. Nothing is read past the end.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    section: String4,
    bytes: &'a [u8],
    position: usize,
}

impl<'a> Reader<'a> {
    /// At the start of `bytes`, the content of `section`.
    #[must_use]
    pub fn new(section: String4, bytes: &'a [u8]) -> Self {
        Reader { section, bytes, position: 0 }
    }

    /// [`LoadError::Corrupt`] at the current place.
    #[must_use]
    pub fn corrupt(&self, what: &'static str) -> LoadError {
        LoadError::Corrupt { section: self.section, offset: self.position as u64, what }
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer are left.
    pub fn bytes(&mut self, count: usize) -> Result<&'a [u8], LoadError> {
        let end = self.position.checked_add(count);
        let found = end.and_then(|end| self.bytes.get(self.position..end));
        let found = found.ok_or(LoadError::Truncated { section: self.section })?;
        self.position += count;
        Ok(found)
    }

    /// Passes over `count` bytes.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer are left.
    pub fn skip(&mut self, count: usize) -> Result<(), LoadError> {
        self.bytes(count).map(|_| ())
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer are left.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], LoadError> {
        let mut array = [0; N];
        array.copy_from_slice(self.bytes(N)?);
        Ok(array)
    }

    /// The next byte.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] at the end.
    pub fn u8(&mut self) -> Result<u8, LoadError> {
        self.array().map(u8::from_le_bytes)
    }

    /// The next 16-bit number.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer bytes are left.
    pub fn u16(&mut self) -> Result<u16, LoadError> {
        self.array().map(u16::from_le_bytes)
    }

    /// The next 32-bit number.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer bytes are left.
    pub fn u32(&mut self) -> Result<u32, LoadError> {
        self.array().map(u32::from_le_bytes)
    }

    /// The next 64-bit number.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer bytes are left.
    pub fn u64(&mut self) -> Result<u64, LoadError> {
        self.array().map(u64::from_le_bytes)
    }

    /// The next 32-bit floating-point number, finite.
    ///
    /// # Errors
    /// [`LoadError::Truncated`] where fewer bytes are left, [`LoadError::Corrupt`] for NaN and infinities.
    pub fn f32(&mut self) -> Result<f32, LoadError> {
        let value = f32::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.corrupt("a number that is not finite")) }
    }

    /// Checks that all was read.
    ///
    /// # Errors
    /// [`LoadError::Corrupt`] where bytes are left.
    pub fn end(&self) -> Result<(), LoadError> {
        if self.position == self.bytes.len() { Ok(()) } else { Err(self.corrupt("bytes after the end")) }
    }
}

//! Tables that a decoder makes when it first needs them: a texture that is only uploaded never does.

use std::sync::OnceLock;

/// A value that follows from the structure that it is part of, made when it is first asked for.
///
/// It says nothing that the rest of the structure does not say: any two are equal, whether made or not.
#[derive(Debug, Clone)]
pub struct Cached<T>(OnceLock<T>);

impl<T> Default for Cached<T> {
    fn default() -> Self {
        Cached(OnceLock::new())
    }
}

impl<T> PartialEq for Cached<T> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl<T> From<T> for Cached<T> {
    fn from(value: T) -> Self {
        Cached(OnceLock::from(value))
    }
}

impl<T> Cached<T> {
    /// The value, made by the first caller; others wait for it.
    #[inline]
    pub fn get_or_make(&self, make: impl FnOnce() -> T) -> &T {
        self.0.get_or_init(make)
    }

    /// Whether the value is there already.
    #[must_use]
    pub fn is_made(&self) -> bool {
        self.0.get().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_made_once_and_does_not_tell_structures_apart() {
        let mut made = 0;
        let cached = Cached::default();
        let other = cached.clone();
        for _ in 0..2 {
            assert_eq!(
                *cached.get_or_make(|| {
                    made += 1;
                    7
                }),
                7
            );
        }
        assert!(made == 1 && cached.is_made() && !other.is_made() && cached == other);
    }
}

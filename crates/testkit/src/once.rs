//! Textures that several tests of one program need, each encoded once.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use texfold_core::image::ImageSet;

/// A hash of the images, and the parameters in words.
type Key = (u64, String);

/// Textures by the images and the parameters that they are made of.
#[derive(Debug)]
pub struct Encoded<T>(Mutex<BTreeMap<Key, Arc<OnceLock<T>>>>);

impl<T: Clone> Encoded<T> {
    /// None so far.
    #[must_use]
    #[expect(
        clippy::new_without_default,
        reason = "it stands in statics, which call constant functions alone"
    )]
    pub const fn new() -> Self {
        Encoded(Mutex::new(BTreeMap::new()))
    }

    /// The texture of `images` with `parameters`, made by `make` where no test has needed it yet.
    pub fn get(&self, images: &ImageSet, parameters: &impl Debug, make: impl FnOnce() -> T) -> T {
        let mut hasher = DefaultHasher::new();
        for image in images.images() {
            format!("{:?} {:?}", image.size(), image.info()).hash(&mut hasher);
            image.texels().for_each(|texel| texel.to_array().map(f32::to_bits).hash(&mut hasher));
        }
        let key = (hasher.finish(), format!("{parameters:?}"));
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let one = Arc::clone(known.entry(key).or_default());
        drop(known);
        one.get_or_init(make).clone()
    }
}

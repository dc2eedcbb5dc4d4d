//! How encoded textures are made: in one go, for several goals from one search, or grown image by image.

use std::fmt::Debug;

use crate::{EncodeError, Goal, Job, ParamError, TextureCodec};

/// A codec whose textures can be made.
///
/// Encoding and what was encoded are two things: this trait makes the shipped form, [`crate::Encoded`] is that form.
pub trait Encoder: TextureCodec {
    /// What is compressed: images, a capture, a stack of patches.
    type Source<'s>: Copy;
    /// How it is compressed.
    type Params: Params;

    /// Compresses `source`. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`EncodeError`]: unsuitable parameters or source, a limit reached, or the job cancelled.
    fn encode(
        source: Self::Source<'_>,
        params: &Self::Params,
        job: &mut Job<'_>,
    ) -> Result<Self::Encoded, EncodeError>;
}

/// Parameters of a codec: at most six public fields and an [`crate::Effort`].
pub trait Params: Clone + Default + Debug {
    /// Checks every field against its range.
    ///
    /// # Errors
    /// [`ParamError`] names the first field that is out of range, and the range.
    fn check(&self) -> Result<(), ParamError>;
}

/// A codec whose costly search serves many goals: search once, encode for each.
pub trait SharedSearch: Encoder {
    /// What the search found.
    type Search;
    /// The part of encoding that does not depend on the goal.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    fn search(
        source: Self::Source<'_>,
        params: &Self::Params,
        job: &mut Job<'_>,
    ) -> Result<Self::Search, EncodeError>;
    /// The part that does.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    fn encode_from(
        search: &Self::Search,
        goal: Goal,
        job: &mut Job<'_>,
    ) -> Result<Self::Encoded, EncodeError>;
}

/// A codec whose encoded form accepts further sources without changing a texel that was valid before.
///
/// Banks do not grow by it: their tiles are separate files that are never changed, and what grows is the public codebook beside
/// them, which `Progressive::encode_shared` takes and returns with each new tile.
pub trait Growable: Encoder {
    /// Adds `source`; on an error `encoded` is as it was.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    fn add(
        encoded: &mut Self::Encoded,
        source: Self::Source<'_>,
        job: &mut Job<'_>,
    ) -> Result<(), EncodeError>;
}

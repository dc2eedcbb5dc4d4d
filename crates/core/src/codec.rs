//! The codec family: how an encoded texture is made, and how one is loaded.

use std::fmt::Debug;

use crate::container::{CodecId, Sections};
use crate::{Budget, Domain, EncodeError, Encoded, Goal, Job, LoadError, ParamError};

/// A way to compress textures.
///
/// Encoding and what was encoded are two things: this trait makes or loads the shipped form,
/// [`Encoded`] is that form.
pub trait TextureCodec {
    /// Number and name of the codec in files.
    const ID: CodecId;
    /// What the encoded form is addressed by.
    type Domain: Domain;
    /// What is compressed: images, a capture, a stack of patches.
    type Source<'s>: Copy;
    /// How it is compressed.
    type Params: Params;
    /// The shipped form.
    type Encoded: Encoded<Domain = Self::Domain>;

    /// Compresses `source`. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`EncodeError`]: unsuitable parameters or source, a limit reached, or the job cancelled.
    fn encode(
        source: Self::Source<'_>,
        params: &Self::Params,
        job: &mut Job<'_>,
    ) -> Result<Self::Encoded, EncodeError>;

    /// Reads what [`Encoded::store`] wrote. All checks of foreign bytes happen here: what loads, decodes.
    ///
    /// # Errors
    /// [`LoadError`] names the section and what is wrong with it.
    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Self::Encoded, LoadError>;
}

/// Parameters of a codec: at most six public fields and an [`Effort`].
pub trait Params: Clone + Default + Debug {
    /// Checks every field against its range.
    ///
    /// # Errors
    /// [`ParamError`] names the first field that is out of range, and the range.
    fn check(&self) -> Result<(), ParamError>;
}

/// How long an encoder may look for a better result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, PartialOrd, Ord)]
pub enum Effort {
    /// Previews: the first acceptable result.
    Fast,
    /// The usual trade.
    #[default]
    Normal,
    /// Several times slower for a few tenths of a dB.
    High,
}

/// A codec whose costly search serves many goals: search once, encode for each.
pub trait SharedSearch: TextureCodec {
    /// What the search found.
    type Search;
    /// The part of encoding that does not depend on the goal.
    ///
    /// # Errors
    /// As [`TextureCodec::encode`].
    fn search(
        source: Self::Source<'_>,
        params: &Self::Params,
        job: &mut Job<'_>,
    ) -> Result<Self::Search, EncodeError>;
    /// The part that does.
    ///
    /// # Errors
    /// As [`TextureCodec::encode`].
    fn encode_from(
        search: &Self::Search,
        goal: Goal,
        job: &mut Job<'_>,
    ) -> Result<Self::Encoded, EncodeError>;
}

/// A codec whose encoded form accepts further sources without changing a texel that was valid before.
pub trait Growable: TextureCodec {
    /// Adds `source`; on an error `encoded` is as it was.
    ///
    /// # Errors
    /// As [`TextureCodec::encode`].
    fn add(
        encoded: &mut Self::Encoded,
        source: Self::Source<'_>,
        job: &mut Job<'_>,
    ) -> Result<(), EncodeError>;
}

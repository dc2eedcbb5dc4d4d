//! One search for several goals.

use texfold_core::image::ImageSet;
use texfold_core::{EncodeError, Encoded, Goal, Image2d, Job};

use super::{EncodeSettings, Encoding, Guidance};
use crate::AnyImage;

/// What a search has found, whatever the codec.
pub(super) trait GoalSearch: Send {
    fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<AnyImage, EncodeError>;
}

/// What the search of a codec has found.
pub(super) struct Searched<S, E> {
    pub(super) found: S,
    /// The codec's [`texfold_core::SharedSearch::encode_from`].
    pub(super) encode_from: fn(&S, Goal, &mut Job<'_>) -> Result<E, EncodeError>,
}

impl<S: Send, E: Encoded<Domain = Image2d> + 'static> GoalSearch for Searched<S, E> {
    fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<AnyImage, EncodeError> {
        (self.encode_from)(&self.found, goal, job).map(AnyImage::new)
    }
}

/// Images searched once, to be encoded for several goals.
pub struct ImageSearch<'s>(Kind<'s>);

enum Kind<'s> {
    /// The codec's costly part is done.
    Shared(Box<dyn GoalSearch>),
    /// The codec has no part that serves several goals.
    Repeated {
        encoding: &'static Encoding,
        images: &'s ImageSet,
        guidance: Guidance<'s>,
        settings: EncodeSettings,
    },
}

impl std::fmt::Debug for ImageSearch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.0 {
            Kind::Shared(_) => write!(f, "ImageSearch(shared)"),
            Kind::Repeated { encoding, .. } => write!(f, "ImageSearch({encoding:?})"),
        }
    }
}

/// Does what does not depend on the goal once, with the codec of `encoding`. The goal of `settings` should be of the
/// kind of those to come.
///
/// # Errors
/// As [`texfold_core::SharedSearch::search`].
pub fn search_images<'s>(
    encoding: &'static Encoding,
    images: &'s ImageSet,
    guidance: Guidance<'s>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<ImageSearch<'s>, EncodeError> {
    Ok(ImageSearch(match encoding.search_fn() {
        Some(search) => Kind::Shared(search(images, guidance, settings, job)?),
        None => Kind::Repeated { encoding, images, guidance, settings: settings.clone() },
    }))
}

impl ImageSearch<'_> {
    /// Encodes for a goal.
    ///
    /// # Errors
    /// As [`texfold_core::SharedSearch::encode_from`].
    pub fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<AnyImage, EncodeError> {
        match &self.0 {
            Kind::Shared(search) => search.encode(goal, job),
            Kind::Repeated { encoding, images, guidance, settings } => {
                encoding.encode(images, *guidance, &EncodeSettings { goal, ..settings.clone() }, job)
            }
        }
    }
}

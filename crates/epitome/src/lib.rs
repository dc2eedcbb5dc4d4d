//! Epitome factoring: images as a transform map into a small epitome that holds their content once.
//!
//! An image is covered by square leaves. Each says where in the epitome its content lies, how it is turned, mirrored and
//! scaled, and by which gain and offset it is toned. What repeats, under deformation and lighting, is stored once;
//! what is smooth, or smooth in one direction, is stored at a fraction of its size.
//!
//! Source: Wang, Wexler, Ofek, Hoppe, "Factoring repeated content within and among images", ACM Transactions on Graphics
//! 27 (3), 2008. Beyond the paper: leaves of several sizes chosen by rate and distortion on the stored content, palettes
//! of linear parts and tones, content at reduced width or height and fitted to all who read it, BC1 and BC7 content side by
//! side.

pub mod decode;
mod draw;
mod encode;
mod encoded;
mod layers;
mod params;
mod pictures;
mod wire;

pub use encode::EpitomeSearch;
pub use encoded::{Entry, EpitomeTexture, IDENTITY, Linear, MapFormat, NEUTRAL, Tone};
pub use layers::MAX_LAYERS;
pub use params::{EpitomeParams, EpitomeSource, Transforms};
pub use pictures::{PartPictures, pictures};

use texfold_core::container::Sections;
use texfold_core::{
    Budget, CodecId, EncodeError, Encoder, Goal, Image2d, Job, LoadError, SharedSearch, TextureCodec,
};

/// Epitome factoring.
#[derive(Debug, Clone, Copy)]
pub enum Epitome {}

impl TextureCodec for Epitome {
    const ID: CodecId = CodecId { number: 3, name: "epitome" };
    type Domain = Image2d;
    type Encoded = EpitomeTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<EpitomeTexture, LoadError> {
        wire::load(file, budget)
    }
}

impl Encoder for Epitome {
    type Source<'s> = EpitomeSource<'s>;
    type Params = EpitomeParams;

    fn encode(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        job: &mut Job<'_>,
    ) -> Result<EpitomeTexture, EncodeError> {
        let searched = job.within(0.0, 0.7, |job| encode::search_all(source, params, job))?;
        job.within(0.7, 1.0, |job| encode::encode_from(&searched, params.goal, job))
    }
}

impl SharedSearch for Epitome {
    type Search = EpitomeSearch;

    /// The goal of `params` says how fine the content is that matches are searched in, and whether blocks have one side (for
    /// tolerances) or several; goals of the same kind share a search.
    fn search(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        job: &mut Job<'_>,
    ) -> Result<EpitomeSearch, EncodeError> {
        encode::search_all(source, params, job)
    }

    fn encode_from(
        search: &EpitomeSearch,
        goal: Goal,
        job: &mut Job<'_>,
    ) -> Result<EpitomeTexture, EncodeError> {
        encode::encode_from(search, goal, job)
    }
}

//! Encoding, storing and loading epitomes.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::ImageSet;
use texfold_core::{Budget, Encoded, Encoder, Job, LoadError, TextureCodec};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
use texfold_testkit::{crop, full, image, once};

/// The texture of these images, made once for all tests.
pub(crate) fn encode(images: &ImageSet, params: &EpitomeParams) -> EpitomeTexture {
    static KNOWN: once::Encoded<EpitomeTexture> = once::Encoded::new();
    KNOWN.get(images, params, || {
        Epitome::encode(EpitomeSource::new(images), params, &mut Job::default()).unwrap()
    })
}

pub(crate) fn file(texture: &EpitomeTexture) -> Vec<u8> {
    let mut writer = SectionWriter::new(Epitome::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

pub(crate) fn load(bytes: &[u8]) -> Result<EpitomeTexture, LoadError> {
    let mut budget = Budget::default();
    Epitome::load(&Sections::parse(bytes, &mut budget)?, &mut budget)
}

/// A facade whose windows repeat: a part of it, and in full runs all.
pub(crate) fn facade() -> ImageSet {
    let whole = image("facade");
    ImageSet::single(if full() { whole } else { crop(&whole, (40, 40), (128, 128)) })
}

//! Opening files of any codec.

use texfold_bc::{Bc, BcTexture};
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::{
    AnyEncoded, Budget, EncodeError, Encoded, Growable, Image2d, Job, LoadError, TextureCodec,
};
use texfold_epitome::{Epitome, EpitomeTexture};
use texfold_lightfield::{LightTexture, Lightfield};
use texfold_progressive::{Progressive, ProgressiveTexture};
use texfold_vq::{Vq, VqSource, VqTexture};
use texfold_zipmap::{ZipTexture, Zipmap};

/// An encoded image texture of any codec, for callers that need its own type.
#[derive(Debug)]
pub enum AnyImage {
    /// Plain block compression.
    Bc(BcTexture),
    /// Importance-driven vector quantisation.
    Vq(VqTexture),
    /// Epitome factoring.
    Epitome(EpitomeTexture),
    /// Base and error map.
    Progressive(ProgressiveTexture),
    /// A root and patches of higher resolution.
    Zipmap(ZipTexture),
}

impl AnyImage {
    /// The texture behind its trait.
    #[must_use]
    pub fn as_encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        match self {
            AnyImage::Bc(texture) => texture,
            AnyImage::Vq(texture) => texture,
            AnyImage::Epitome(texture) => texture,
            AnyImage::Progressive(texture) => texture,
            AnyImage::Zipmap(texture) => texture,
        }
    }

    /// The texture behind its trait, boxed.
    #[must_use]
    pub fn into_encoded(self) -> Box<dyn Encoded<Domain = Image2d>> {
        match self {
            AnyImage::Bc(texture) => Box::new(texture),
            AnyImage::Vq(texture) => Box::new(texture),
            AnyImage::Epitome(texture) => Box::new(texture),
            AnyImage::Progressive(texture) => Box::new(texture),
            AnyImage::Zipmap(texture) => Box::new(texture),
        }
    }

    /// The whole `.txf` file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let encoded = self.as_encoded();
        let mut writer = SectionWriter::new(encoded.codec());
        encoded.store(&mut writer);
        writer.finish().bytes
    }
}

/// Loads a `.txf` file of any codec.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file.
pub fn open(bytes: &[u8], budget: &mut Budget) -> Result<AnyEncoded, LoadError> {
    let sections = Sections::parse(bytes, budget)?;
    if sections.codec() == Lightfield::ID.number {
        return Lightfield::load(&sections, budget).map(|light| AnyEncoded::Light(Box::new(light)));
    }
    load_image(&sections, budget).map(|image| AnyEncoded::Image(image.into_encoded()))
}

/// Loads a `.txf` file that holds a surface light field.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file.
pub fn open_light(bytes: &[u8], budget: &mut Budget) -> Result<LightTexture, LoadError> {
    let sections = Sections::parse(bytes, budget)?;
    match sections.codec() {
        number if number == Lightfield::ID.number => Lightfield::load(&sections, budget),
        found => Err(LoadError::NotThisCodec { found }),
    }
}

/// Loads a `.txf` file that holds images.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file.
pub fn open_image(bytes: &[u8], budget: &mut Budget) -> Result<AnyImage, LoadError> {
    load_image(&Sections::parse(bytes, budget)?, budget)
}

fn load_image(sections: &Sections<'_>, budget: &mut Budget) -> Result<AnyImage, LoadError> {
    match sections.codec() {
        number if number == Bc::ID.number => Bc::load(sections, budget).map(AnyImage::Bc),
        number if number == Vq::ID.number => Vq::load(sections, budget).map(AnyImage::Vq),
        number if number == Epitome::ID.number => Epitome::load(sections, budget).map(AnyImage::Epitome),
        number if number == Progressive::ID.number => {
            Progressive::load(sections, budget).map(AnyImage::Progressive)
        }
        number if number == Zipmap::ID.number => Zipmap::load(sections, budget).map(AnyImage::Zipmap),
        found => Err(LoadError::NotThisCodec { found }),
    }
}

/// Adds images to an encoded set or sequence; those already there keep every texel.
///
/// # Errors
/// [`EncodeError`] where the codec cannot grow or the images do not fit; the texture is then as it was.
pub fn add_image(texture: &mut AnyImage, source: VqSource<'_>, job: &mut Job<'_>) -> Result<(), EncodeError> {
    let codec = texture.as_encoded().codec();
    match texture {
        AnyImage::Vq(texture) => Vq::add(texture, source, job),
        _ => Err(EncodeError::CannotGrow { codec, instead: Vq::ID.name }),
    }
}

//! The table of codecs: what [`crate::open`], the command line and the generic tests know of each.

use texfold_bc::Bc;
use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, Image2d, LoadError, Refine, TextureCodec};
use texfold_dct::Dct;
use texfold_epitome::Epitome;
use texfold_lightfield::Lightfield;
use texfold_progressive::Progressive;
use texfold_vq::Vq;
use texfold_zipmap::Zipmap;

use crate::{AnyImage, AnyTexture};

/// Every codec, in the order of the numbers in files.
pub static CODECS: [Registration; 7] = [
    Registration::of_images::<Bc>("Plain block compression", Input::Images),
    Registration::of_images::<Vq>("Importance-driven vector quantisation", Input::Images),
    Registration::of_images::<Epitome>("Epitome factoring", Input::Images).refining::<Epitome>(),
    Registration::of_images::<Progressive>("A small base and a residual plane", Input::Images)
        .refining::<Progressive>(),
    Registration {
        id: Lightfield::ID,
        about: "Surface light-field maps, for captures",
        takes: Input::Capture,
        load: |file, budget| {
            Lightfield::load(file, budget).map(|texture| AnyTexture::Light(Box::new(texture)))
        },
        refine: None,
    },
    Registration::of_images::<Zipmap>(
        "A root and patches of higher resolution, for zoom stacks",
        Input::Stack,
    ),
    Registration::of_images::<Dct>("DCT superblocks", Input::Images).refining::<Dct>(),
];

/// What a codec encodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// One image, a set, or the frames of a sequence.
    Images,
    /// A mesh with photographs of it.
    Capture,
    /// Photographs of one surface at several scales.
    Stack,
}

type Load = fn(&Sections<'_>, &mut Budget) -> Result<AnyTexture, LoadError>;
type RefineImage = fn(&mut AnyImage, &Sections<'_>, &mut Budget) -> Result<Vec<&'static str>, LoadError>;

/// One row of [`CODECS`].
#[derive(Debug, Clone, Copy)]
pub struct Registration {
    /// Number in files, and name.
    pub id: CodecId,
    /// What it is, in a few words.
    pub about: &'static str,
    /// What it encodes.
    pub takes: Input,
    load: Load,
    refine: Option<RefineImage>,
}

impl Registration {
    /// The row of a codec whose textures are images and cannot be refined.
    const fn of_images<C>(about: &'static str, takes: Input) -> Registration
    where
        C: TextureCodec<Domain = Image2d, Encoded: 'static>,
    {
        let load: Load =
            |file, budget| C::load(file, budget).map(|made| AnyTexture::Image(AnyImage::new(made)));
        Registration { id: C::ID, about, takes, load, refine: None }
    }

    /// The same row for a codec whose textures take further layers as they arrive.
    const fn refining<C>(self) -> Registration
    where
        C: TextureCodec<Domain = Image2d, Encoded: Refine + 'static>,
    {
        let refine: RefineImage = |image, file, budget| match image.downcast_mut::<C::Encoded>() {
            Some(texture) => texture.refine(file, budget),
            None => Err(LoadError::NotThisCodec { found: file.codec() }),
        };
        Registration { refine: Some(refine), ..self }
    }

    /// The codec of that number in files.
    #[must_use]
    pub fn by_number(number: u16) -> Option<&'static Registration> {
        CODECS.iter().find(|codec| codec.id.number == number)
    }

    /// The codec of that name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<&'static Registration> {
        CODECS.iter().find(|codec| codec.id.name == name)
    }

    /// Whether a texture that was loaded from a prefix of its file can take further layers as they arrive.
    #[must_use]
    pub fn refines(&self) -> bool {
        self.refine.is_some()
    }

    /// Loads a file of this codec.
    ///
    /// # Errors
    /// [`LoadError`] names what is wrong with the file.
    pub fn load(&self, file: &Sections<'_>, budget: &mut Budget) -> Result<AnyTexture, LoadError> {
        (self.load)(file, budget)
    }

    /// Takes the next layer from a longer prefix of the same file; returns the names of the planes to upload again,
    /// none where the codec has no layers or the next one has not arrived.
    ///
    /// # Errors
    /// [`LoadError`] names what is wrong with the file; the texture stays as it was.
    pub fn refine(
        &self,
        image: &mut AnyImage,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Vec<&'static str>, LoadError> {
        self.refine.map_or(Ok(Vec::new()), |refine| refine(image, file, budget))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_names_are_unique_and_find_their_codec() {
        for codec in &CODECS {
            let same =
                |other: &&Registration| other.id.number == codec.id.number || other.id.name == codec.id.name;
            assert_eq!(CODECS.iter().filter(same).count(), 1, "{:?}", codec.id);
            assert_eq!(Registration::by_number(codec.id.number).map(|found| found.id), Some(codec.id));
            assert_eq!(Registration::by_name(codec.id.name).map(|found| found.id), Some(codec.id));
        }
        assert!(Registration::by_name("auto").is_none() && Registration::by_number(0).is_none());
    }
}

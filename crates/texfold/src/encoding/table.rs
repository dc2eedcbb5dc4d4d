//! The codecs that encode images, and the generic functions behind their rows.

use std::fmt;

use texfold_bc::{Bc, Family};
use texfold_core::image::{ImageSet, PartImages, PixelInfo};
use texfold_core::target::Measured;
use texfold_core::{Access, CodecId, EncodeError, Growable, Job, Notes, ParamError, SharedSearch};
use texfold_dct::Dct;
use texfold_epitome::Epitome;
use texfold_progressive::Progressive;
use texfold_vq::Vq;

use super::adapters::ImageEncoder;
use super::plain::or_plain;
use super::search::{GoalSearch, Searched};
use super::{EncodeSettings, Guidance};
use crate::AnyImage;

/// The codecs that encode images; a choice among all tries the last first.
pub static ENCODINGS: [Encoding; 5] = [
    Encoding::of::<Bc>(),
    Encoding::of::<Vq>().growing::<Vq>(),
    // Not searching: what its search finds for 1.5 bits per texel gives 30.8 dB at 2.5, where a search for 2.5 gives 32.2.
    Encoding::of::<Epitome>(),
    Encoding::of::<Progressive>().searching::<Progressive>(),
    Encoding::of::<Dct>(),
];

type Encode = fn(&ImageSet, Guidance<'_>, &EncodeSettings, &mut Job<'_>) -> Result<AnyImage, EncodeError>;
type Search =
    fn(&ImageSet, Guidance<'_>, &EncodeSettings, &mut Job<'_>) -> Result<Box<dyn GoalSearch>, EncodeError>;
type WhyNot = fn(&ImageSet, &EncodeSettings, &Measured, &Job<'_>) -> Result<Option<String>, EncodeError>;
type Within =
    fn(&ImageSet, Guidance<'_>, &EncodeSettings, f64, &mut Job<'_>) -> Result<AnyImage, EncodeError>;
type Add = fn(&mut AnyImage, &ImageSet, Guidance<'_>, &mut Job<'_>) -> Result<(), EncodeError>;

/// One row of [`ENCODINGS`].
#[derive(Clone, Copy)]
pub struct Encoding {
    /// Number in files, and name.
    pub id: CodecId,
    /// About how many bytes for each texel of the source encoding takes at its peak, the source included.
    pub bytes_per_texel: u64,
    /// Whether a choice among all codecs tries it only where a look at the images gives it a chance and its memory is to be had.
    pub is_seldom_tried: bool,
    /// Whether it follows [`Guidance::painted`] and [`Guidance::mesh`].
    pub follows_importance: bool,
    /// Whether it follows [`Guidance::content_from`].
    pub follows_content_mask: bool,
    /// Bits a texel, compressed that a comparison asks it for.
    pub compared_bpp: &'static [f64],
    /// How its texels are reached, its usual way first.
    pub accesses: &'static [Access],
    /// Whether it follows [`EncodeSettings::metric`].
    pub has_metric: bool,
    check: fn(&EncodeSettings) -> Result<(), ParamError>,
    families: fn(PixelInfo) -> Vec<Family>,
    suits_settings: fn(&EncodeSettings) -> bool,
    suits: fn(&ImageSet, &Guidance<'_>) -> bool,
    encode: Encode,
    or_plain: Encode,
    /// [`ImageEncoder::why_not`].
    pub(super) why_not: WhyNot,
    /// [`ImageEncoder::encode_against`].
    pub(super) within: Within,
    notes: fn(&mut AnyImage) -> Option<&mut Notes>,
    search: Option<Search>,
    add: Option<Add>,
    parts: fn(&AnyImage) -> Vec<PartImages>,
}

impl fmt::Debug for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Encoding({})", self.id.name)
    }
}

impl Encoding {
    /// The row of codec `C`.
    pub(super) const fn of<C: ImageEncoder>() -> Encoding {
        Encoding {
            id: C::ID,
            bytes_per_texel: C::BYTES_PER_TEXEL,
            is_seldom_tried: C::IS_SELDOM_TRIED,
            follows_importance: C::FOLLOWS_IMPORTANCE,
            follows_content_mask: C::FOLLOWS_CONTENT_MASK,
            compared_bpp: C::COMPARED_BPP,
            accesses: C::ACCESS,
            has_metric: C::HAS_METRIC,
            check: C::check,
            families: C::families,
            suits_settings: C::suits_settings,
            suits: C::suits,
            encode: encode::<C>,
            or_plain: or_plain::<C>,
            why_not: C::why_not,
            within: within::<C>,
            notes: notes::<C>,
            search: None,
            add: None,
            parts: parts::<C>,
        }
    }

    const fn searching<C: ImageEncoder + SharedSearch<Search: Send + 'static>>(self) -> Encoding {
        Encoding { search: Some(search::<C>), ..self }
    }

    const fn growing<C: ImageEncoder + Growable>(self) -> Encoding {
        Encoding { add: Some(add::<C>), ..self }
    }

    /// Checks settings for this codec: what it does not follow is refused and not ignored.
    ///
    /// # Errors
    /// [`ParamError`] names the setting, and what it may be.
    pub fn check(&self, settings: &EncodeSettings) -> Result<(), ParamError> {
        settings.goal.check()?;
        if let Some(access) = settings.access.filter(|access| !self.accesses.contains(access)) {
            let may_be = match access {
                Access::Block => "texel; of images, dct and epitome are read by block",
                Access::Texel => "block; of images, bc, vq, epitome and progressive are read by texel",
            };
            return Err(ParamError::new("access", access.name(), may_be));
        }
        if let Some(metric) = settings.metric.filter(|_| !self.has_metric) {
            return Err(ParamError::new(
                "metric",
                metric.name(),
                "none; dct, epitome and progressive have one",
            ));
        }
        (self.check)(settings)
    }

    /// Whether one search serves several goals.
    #[must_use]
    pub fn shares_search(&self) -> bool {
        self.search.is_some()
    }

    /// Whether its textures accept further images.
    #[must_use]
    pub fn grows(&self) -> bool {
        self.add.is_some()
    }

    /// Encodes with this codec, whatever the settings' choice, and with nothing else.
    ///
    /// # Errors
    /// As [`texfold_core::Encoder::encode`].
    pub fn encode(
        &self,
        images: &ImageSet,
        guidance: Guidance<'_>,
        settings: &EncodeSettings,
        job: &mut Job<'_>,
    ) -> Result<AnyImage, EncodeError> {
        (self.encode)(images, guidance, settings, job)
    }

    /// As [`Encoding::encode`], or plain blocks where they answer the goal better.
    pub(crate) fn or_plain(
        &self,
        images: &ImageSet,
        guidance: Guidance<'_>,
        settings: &EncodeSettings,
        job: &mut Job<'_>,
    ) -> Result<AnyImage, EncodeError> {
        (self.or_plain)(images, guidance, settings, job)
    }

    /// Families of formats that a comparison tries for such pixels.
    #[must_use]
    pub fn families(&self, pixel: PixelInfo) -> Vec<Family> {
        (self.families)(pixel)
    }

    /// Whether a choice among all codecs may try this one for such settings.
    pub(crate) fn suits_settings(&self, settings: &EncodeSettings) -> bool {
        self.may_be_chosen(settings) && (self.suits_settings)(settings)
    }

    /// Whether no other codec's own parameters are given.
    fn may_be_chosen(&self, settings: &EncodeSettings) -> bool {
        settings.codec.owner().is_none_or(|owner| owner == self.id)
    }

    /// Whether a choice among all codecs tries this one.
    pub(crate) fn suits(
        &self,
        images: &ImageSet,
        guidance: &Guidance<'_>,
        settings: &EncodeSettings,
    ) -> bool {
        if guidance.content_from.is_some() {
            return self.follows_content_mask && self.may_be_chosen(settings);
        }
        self.suits_settings(settings) && (self.suits)(images, guidance)
    }

    pub(super) fn search_fn(&self) -> Option<Search> {
        self.search
    }

    pub(super) fn add_fn(&self) -> Option<Add> {
        self.add
    }
}

fn encode<C: ImageEncoder>(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    C::check(settings)?;
    C::encode(C::source(images, guidance), &settings.params::<C>(), job).map(AnyImage::new)
}

fn within<C: ImageEncoder>(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    most_bpp: f64,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    C::check(settings)?;
    let (source, params) = (C::source(images, guidance), settings.params::<C>());
    C::encode_against(source, &params, most_bpp, job).map(AnyImage::new)
}

impl AnyImage {
    /// The notes, which are part of the file; `None` where the codec is not one of Texfold's.
    pub fn notes_mut(&mut self) -> Option<&mut Notes> {
        let id = self.codec();
        let encoding = ENCODINGS.iter().find(|encoding| encoding.id == id)?;
        (encoding.notes)(self)
    }
}

fn notes<C: ImageEncoder>(image: &mut AnyImage) -> Option<&mut Notes> {
    image.downcast_mut::<C::Encoded>().map(C::notes_mut)
}

fn search<C: ImageEncoder + SharedSearch<Search: Send + 'static>>(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<Box<dyn GoalSearch>, EncodeError> {
    C::check(settings)?;
    let found = C::search(C::source(images, guidance), &settings.params::<C>(), job)?;
    Ok(Box::new(Searched { found, encode_from: C::encode_from }))
}

fn add<C: ImageEncoder + Growable>(
    image: &mut AnyImage,
    images: &ImageSet,
    guidance: Guidance<'_>,
    job: &mut Job<'_>,
) -> Result<(), EncodeError> {
    match image.downcast_mut::<C::Encoded>() {
        Some(texture) => C::add(texture, C::source(images, guidance), job),
        None => Ok(()),
    }
}

/// Images of the parts of a texture, for a person to look at; none where its codec has no parts.
#[must_use]
pub fn parts_of(image: &AnyImage) -> Vec<PartImages> {
    let id = image.codec();
    ENCODINGS.iter().find(|encoding| encoding.id == id).map_or(Vec::new(), |encoding| (encoding.parts)(image))
}

fn parts<C: ImageEncoder>(image: &AnyImage) -> Vec<PartImages> {
    image.downcast_ref::<C::Encoded>().map_or(Vec::new(), C::parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CODECS, Input};

    #[test]
    fn every_codec_of_images_can_encode() {
        let of_images = CODECS.iter().filter(|codec| codec.takes == Input::Images);
        let ids: Vec<CodecId> = of_images.map(|codec| codec.id).collect();
        assert_eq!(ids, ENCODINGS.each_ref().map(|encoding| encoding.id));
    }
}

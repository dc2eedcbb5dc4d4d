//! What the facade must know of each codec to encode images with it.

use texfold_bc::{Bc, BcParams, BcTexture, Content, Family};
use texfold_core::image::{ColorSpace, ImageSet, PartImages, PixelInfo};
use texfold_core::target::Measured;
use texfold_core::{Access, EncodeError, Encoder, Goal, Image2d, Job, Notes, ParamError, Params};
use texfold_dct::{Dct, DctImages, DctParams};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture, ToleranceKind};
use texfold_progressive::{Progressive, ProgressiveParams, ProgressiveTexture};
use texfold_vq::{Vq, VqParams, VqSource, VqTexture};

use super::{EncodeSettings, Guidance};

/// Share of the bits that content which repeats must save, as a look at some leaves tells, for a choice among all codecs to try it.
const LEAST_REUSE: f32 = 0.05;

/// When plain blocks are encoded, which a method is held against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlainOrder {
    /// Before the method, taking this share of the job: the method may stop where it is larger.
    First(f32),
    /// After the method: only as well as it takes to be no better.
    After,
}

/// How many dB a codebook may be better than a look at some blocks tells: 1.8 on a facade, less on five other fixtures.
const BETTER: f64 = 2.0;

/// A codec that encodes sets of images with the settings of the facade.
pub trait ImageEncoder:
    Encoder<Domain = Image2d, Encoded: 'static, Params: Params + Send + Sync + 'static>
{
    /// About how many bytes for each texel of the source encoding takes at its peak: source and decoded raster, the
    /// encoder's own, and the planes of the similarity measure. An estimate from above.
    const BYTES_PER_TEXEL: u64 = 72;
    /// Whether a choice among all codecs tries it only where a look at the images gives it a chance and its memory is to be had.
    const IS_SELDOM_TRIED: bool = false;
    /// Whether it follows [`Guidance::painted`] and [`Guidance::mesh`].
    const FOLLOWS_IMPORTANCE: bool = false;
    /// Whether it follows [`Guidance::content_from`].
    const FOLLOWS_CONTENT_MASK: bool = false;
    /// Bits a texel, compressed that a comparison asks it for; none where its formats are compared one by one.
    const COMPARED_BPP: &'static [f64] = &[1.0, 1.5, 2.5];
    /// How its texels are reached, its usual way first.
    const ACCESS: &'static [Access] = &[Access::Texel];
    /// Whether it follows [`EncodeSettings::metric`].
    const HAS_METRIC: bool = false;
    /// When plain blocks are encoded to be compared with.
    const PLAIN: PlainOrder = PlainOrder::First(0.2);

    /// The codec's own source.
    fn source<'s>(images: &'s ImageSet, guidance: Guidance<'s>) -> Self::Source<'s>;

    /// Parameters with the goal, content, mips and effort of `settings`.
    fn with_settings(own: Self::Params, settings: &EncodeSettings) -> Self::Params;

    /// Checks what the codec's own parameters cannot say.
    ///
    /// # Errors
    /// [`ParamError`] names the setting.
    fn check(_settings: &EncodeSettings) -> Result<(), ParamError> {
        Ok(())
    }

    /// Whether the result is to be what the parameters say, however large: then it is not held against plain blocks.
    fn is_fixed(_params: &Self::Params) -> bool {
        false
    }

    /// Whether a choice among all codecs may try this one for such settings.
    fn suits_settings(_settings: &EncodeSettings) -> bool {
        false
    }

    /// Whether a choice among all codecs tries this one for such images, its settings being suitable.
    fn suits(_images: &ImageSet, _guidance: &Guidance<'_>) -> bool {
        true
    }

    /// Why this codec will not answer the goal better than `known`, which another has come to, as far as a look at the images tells that
    /// takes a small part of an encode; `None` where it may.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`].
    fn why_not(
        _images: &ImageSet,
        _settings: &EncodeSettings,
        _known: &Measured,
        _job: &Job<'_>,
    ) -> Result<Option<String>, EncodeError> {
        Ok(None)
    }

    /// As [`Encoder::encode`]; may give up where more than `most_bpp` bits a texel, compressed are needed.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    fn encode_within(
        source: Self::Source<'_>,
        params: &Self::Params,
        _most_bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<Self::Encoded, EncodeError> {
        Self::encode(source, params, job)
    }

    /// As [`ImageEncoder::encode_within`], beside another codec's texture: may also end with an error where this codec's own cannot be better.
    ///
    /// # Errors
    /// As there.
    fn encode_against(
        source: Self::Source<'_>,
        params: &Self::Params,
        most_bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<Self::Encoded, EncodeError> {
        Self::encode_within(source, params, most_bpp, job)
    }

    /// The texture's notes.
    fn notes_mut(texture: &mut Self::Encoded) -> &mut Notes;

    /// Families of formats that a comparison tries for such pixels.
    fn families(_pixel: PixelInfo) -> Vec<Family> {
        vec![Family::Bc]
    }

    /// Images of the texture's own parts, for a person to look at.
    fn parts(_texture: &Self::Encoded) -> Vec<PartImages> {
        Vec::new()
    }
}

impl ImageEncoder for Bc {
    const BYTES_PER_TEXEL: u64 = 64;
    const COMPARED_BPP: &'static [f64] = &[];

    fn source<'s>(images: &'s ImageSet, _guidance: Guidance<'s>) -> &'s ImageSet {
        images
    }

    fn notes_mut(texture: &mut BcTexture) -> &mut Notes {
        texture.notes_mut()
    }

    fn with_settings(mut own: BcParams, settings: &EncodeSettings) -> BcParams {
        (own.goal, own.content) = (settings.goal, settings.content);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own
    }

    /// It is what others are held against.
    fn is_fixed(_params: &BcParams) -> bool {
        true
    }
}

impl ImageEncoder for Vq {
    const FOLLOWS_IMPORTANCE: bool = true;
    const COMPARED_BPP: &'static [f64] = &[1.5, 2.5];

    fn source<'s>(images: &'s ImageSet, guidance: Guidance<'s>) -> VqSource<'s> {
        VqSource { painted: guidance.painted, mesh: guidance.mesh, ..VqSource::new(images) }
    }

    fn notes_mut(texture: &mut VqTexture) -> &mut Notes {
        texture.notes_mut()
    }

    fn with_settings(mut own: VqParams, settings: &EncodeSettings) -> VqParams {
        (own.goal, own.content) = (settings.goal, settings.content);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own
    }

    /// A codebook whose size is given is made so.
    fn is_fixed(params: &VqParams) -> bool {
        params.codebook.is_some()
    }

    fn suits_settings(_settings: &EncodeSettings) -> bool {
        true
    }

    /// Its index alone takes a bit a texel, and blocks must be alike for a codebook of what is left to serve them.
    fn why_not(
        images: &ImageSet,
        settings: &EncodeSettings,
        known: &Measured,
        job: &Job<'_>,
    ) -> Result<Option<String>, EncodeError> {
        let params = settings.params::<Vq>();
        let most = match settings.goal {
            Goal::Bpp(bpp) => bpp,
            goal if goal.is_met(known) => known.bpp,
            _ => return Ok(None),
        };
        let least = Vq::least_bpp(images, &params);
        if least >= most {
            return Ok(Some(format!("its index alone takes {least:.2} bits a texel")));
        }
        let psnr = match settings.goal {
            Goal::Psnr(psnr) => psnr,
            _ => known.psnr,
        };
        let error = Vq::least_error(images, &params, most, job)?;
        let reached = 10.0 * (255.0f64.powi(2) / error).log10();
        let why = || format!("a codebook of {most:.2} bits a texel would reach about {reached:.0} dB");
        Ok((reached + BETTER < psnr).then(why))
    }

    fn encode_within(
        source: VqSource<'_>,
        params: &VqParams,
        most_bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<VqTexture, EncodeError> {
        Vq::encode_within(source, params, most_bpp, job)
    }

    fn parts(texture: &VqTexture) -> Vec<PartImages> {
        texfold_vq::part_images(texture).unwrap_or_default()
    }
}

impl ImageEncoder for Epitome {
    // Every image at nine scales in two formats, and some candidates for each leaf.
    const BYTES_PER_TEXEL: u64 = 450;
    const IS_SELDOM_TRIED: bool = true;
    const FOLLOWS_CONTENT_MASK: bool = true;
    const ACCESS: &'static [Access] = &[Access::Block, Access::Texel];
    const HAS_METRIC: bool = true;
    const PLAIN: PlainOrder = PlainOrder::First(0.05);

    fn source<'s>(images: &'s ImageSet, guidance: Guidance<'s>) -> EpitomeSource<'s> {
        let Guidance { content_from, blocks, .. } = guidance;
        EpitomeSource { content_from, blocks, ..EpitomeSource::new(images) }
    }

    fn notes_mut(texture: &mut EpitomeTexture) -> &mut Notes {
        texture.notes_mut()
    }

    fn with_settings(mut own: EpitomeParams, settings: &EncodeSettings) -> EpitomeParams {
        (own.goal, own.content, own.family) = (settings.goal, settings.content, settings.family);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own.access = settings.access.unwrap_or(own.access);
        own.metric = settings.metric.or(own.metric);
        own
    }

    /// A relative tolerance is not what plain blocks are measured by.
    fn is_fixed(params: &EpitomeParams) -> bool {
        params.tolerance_kind == ToleranceKind::Relative
    }

    /// Content planes, layers and bounds of blocks are read by texel; there errors count by a metric in residual planes alone.
    fn check(settings: &EncodeSettings) -> Result<(), ParamError> {
        let planes = settings.content.is_some() || settings.family != Family::default();
        let is_bound = matches!(settings.goal, Goal::Tolerance(_));
        let own = settings.codec.own::<Epitome>().unwrap_or_default();
        if own.tolerance_kind == ToleranceKind::Relative && !is_bound {
            return Err(ParamError::new("tolerance_kind", "relative", "absolute, without a tolerance"));
        }
        let layers = own.layers > 1;
        let by_block = settings.access == Some(Access::Block);
        if by_block && (planes || is_bound || layers) {
            return Err(ParamError::new(
                "access",
                "block",
                "texel, with content planes, layers or a tolerance",
            ));
        }
        let has_residuals = settings.family == Family::ErrorMap && !is_bound;
        if settings.metric.is_some() && settings.access == Some(Access::Texel) && !has_residuals {
            return Err(ParamError::new(
                "metric",
                "set",
                "none by texel, but for error-map content without a tolerance",
            ));
        }
        Ok(())
    }

    /// A choice among all codecs leaves named content to `bc` and `vq`.
    fn suits_settings(settings: &EncodeSettings) -> bool {
        settings.codec.owner().is_some() || settings.content.is_none()
    }

    /// Not where importance is to be followed.
    fn suits(_images: &ImageSet, guidance: &Guidance<'_>) -> bool {
        guidance.painted.is_none() && guidance.mesh.is_none()
    }

    /// Where hardly anything repeats it comes to what [`Progressive`] comes to.
    fn why_not(
        images: &ImageSet,
        _settings: &EncodeSettings,
        known: &Measured,
        job: &Job<'_>,
    ) -> Result<Option<String>, EncodeError> {
        let share = Epitome::estimated_reuse(images, known, job)?;
        let why = || format!("content that repeats would save about {:.0} % of the bits", 100.0 * share);
        Ok((share < LEAST_REUSE).then(why))
    }

    fn encode_against(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        _most_bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<EpitomeTexture, EncodeError> {
        Epitome::encode_shared(source, params, job)
    }

    /// A residual plane holds one or three channels of colours.
    fn families(pixel: PixelInfo) -> Vec<Family> {
        let has_residuals = matches!(pixel.channels, 1 | 3) && pixel.color != ColorSpace::Normal;
        let families = [(Family::Bc, true), (Family::ErrorMap, has_residuals)];
        families.into_iter().filter_map(|(family, fits)| fits.then_some(family)).collect()
    }

    fn parts(texture: &EpitomeTexture) -> Vec<PartImages> {
        texfold_epitome::part_images(texture).unwrap_or_default()
    }
}

impl ImageEncoder for Progressive {
    // The coefficients of two bases, and a candidate or two for each block.
    const BYTES_PER_TEXEL: u64 = 160;
    const IS_SELDOM_TRIED: bool = true;
    const COMPARED_BPP: &'static [f64] = &[1.0, 1.5, 2.5, 4.0];
    const HAS_METRIC: bool = true;
    const PLAIN: PlainOrder = PlainOrder::After;

    fn source<'s>(images: &'s ImageSet, _guidance: Guidance<'s>) -> &'s ImageSet {
        images
    }

    fn notes_mut(texture: &mut ProgressiveTexture) -> &mut Notes {
        texture.notes_mut()
    }

    fn with_settings(mut own: ProgressiveParams, settings: &EncodeSettings) -> ProgressiveParams {
        (own.goal, own.content) = (settings.goal, settings.content);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own.metric = settings.metric.or(own.metric);
        own
    }

    /// Tolerances bound squares.
    fn check(settings: &EncodeSettings) -> Result<(), ParamError> {
        let is_bound = matches!(settings.goal, Goal::Tolerance(_));
        if settings.metric.is_some() && is_bound {
            return Err(ParamError::new("metric", "set", "none with a tolerance"));
        }
        Ok(())
    }

    /// Not where content is chosen.
    fn suits_settings(settings: &EncodeSettings) -> bool {
        settings.content.is_none() && settings.access != Some(Access::Block)
    }

    /// At random access a texel takes about twice the bits that it takes in superblocks; only a bound of every block may be worth them.
    fn why_not(
        _images: &ImageSet,
        settings: &EncodeSettings,
        known: &Measured,
        _job: &Job<'_>,
    ) -> Result<Option<String>, EncodeError> {
        let is_bound = matches!(settings.goal, Goal::Tolerance(_));
        let is_met = settings.goal.is_met(known) && settings.access != Some(Access::Texel);
        let why = || "what is read texel by texel takes about twice the bits".to_owned();
        Ok((is_met && !is_bound).then(why))
    }

    /// Not where importance is to be followed.
    fn suits(_images: &ImageSet, guidance: &Guidance<'_>) -> bool {
        guidance.painted.is_none() && guidance.mesh.is_none()
    }

    fn parts(texture: &ProgressiveTexture) -> Vec<PartImages> {
        texfold_progressive::part_images(texture).unwrap_or_default()
    }
}

impl ImageEncoder for Dct {
    // The coefficients of all axes and stages; the decoded raster and a tile that is compared take more.
    const BYTES_PER_TEXEL: u64 = 56;
    const COMPARED_BPP: &'static [f64] = &[1.0, 1.5, 2.5, 4.0];
    const ACCESS: &'static [Access] = &[Access::Block];
    const HAS_METRIC: bool = true;
    const PLAIN: PlainOrder = PlainOrder::After;

    fn source<'s>(images: &'s ImageSet, _guidance: Guidance<'s>) -> &'s ImageSet {
        images
    }

    fn notes_mut(texture: &mut DctImages) -> &mut Notes {
        texture.notes_mut()
    }

    fn with_settings(mut own: DctParams, settings: &EncodeSettings) -> DctParams {
        (own.goal, own.mips, own.effort) = (settings.goal, settings.mips, settings.effort);
        own.metric = settings.metric.or(own.metric);
        own
    }

    /// It has no content planes.
    fn check(settings: &EncodeSettings) -> Result<(), ParamError> {
        match settings.content.map(Content::name) {
            Some(content) => Err(ParamError::new("content", content, "none; dct has no content planes")),
            None => Ok(()),
        }
    }

    fn suits_settings(settings: &EncodeSettings) -> bool {
        settings.content.is_none() && settings.access != Some(Access::Texel)
    }

    /// Not where importance is to be followed.
    fn suits(_images: &ImageSet, guidance: &Guidance<'_>) -> bool {
        guidance.painted.is_none() && guidance.mesh.is_none()
    }

    fn parts(texture: &DctImages) -> Vec<PartImages> {
        texfold_dct::part_images(texture).unwrap_or_default()
    }
}

//! What the facade must know of each codec to encode images with it.

use texfold_bc::{Bc, BcParams, Content, Family};
use texfold_core::image::{ColorSpace, ImageSet, PixelInfo, Raster};
use texfold_core::{EncodeError, Encoder, Goal, Image2d, Job, ParamError, Params};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
use texfold_progressive::{Progressive, ProgressiveParams, ProgressiveTexture};
use texfold_vq::{Vq, VqParams, VqSource, VqTexture};

use super::{EncodeSettings, Guidance};

/// When plain blocks are encoded, which a method is held against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlainOrder {
    /// Before the method, taking this share of the job: the method may stop where it is larger.
    First(f32),
    /// After the method: only as well as it takes to be no better.
    After,
}

/// Images of a codec's part: one for each image, or one for each plane that all share.
#[derive(Debug, Clone)]
pub struct PartImages {
    /// Name of the part, for file names.
    pub name: &'static str,
    /// The images.
    pub images: Vec<Raster>,
}

/// A codec that encodes sets of images with the settings of the facade.
pub trait ImageEncoder:
    Encoder<Domain = Image2d, Encoded: 'static, Params: Params + Send + Sync + 'static>
{
    /// About how many bytes for each texel of the source encoding takes at its peak: source and decoded raster, the
    /// encoder's own, and the planes of the similarity measure. An estimate from above.
    const BYTES_PER_TEXEL: u64 = 120;
    /// Whether it follows [`Guidance::painted`] and [`Guidance::mesh`].
    const FOLLOWS_IMPORTANCE: bool = false;
    /// Whether it follows [`Guidance::content_from`].
    const FOLLOWS_CONTENT_MASK: bool = false;
    /// Bits of GPU memory a texel that a comparison asks it for; none where its formats are compared one by one.
    const COMPARED_BPP: &'static [f64] = &[1.0, 1.5, 2.5];
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

    /// As [`Encoder::encode`]; may give up where more than `most_bpp` bits of GPU memory a texel are needed.
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

    /// Families of formats that a comparison tries for such pixels.
    fn families(_pixel: PixelInfo) -> Vec<Family> {
        vec![Family::Bc]
    }

    /// Images of the texture's own parts, for a person to look at.
    fn parts(_texture: &Self::Encoded) -> Vec<PartImages> {
        Vec::new()
    }
}

fn part(name: &'static str, images: Vec<Raster>) -> PartImages {
    PartImages { name, images }
}

impl ImageEncoder for Bc {
    const COMPARED_BPP: &'static [f64] = &[];

    fn source<'s>(images: &'s ImageSet, _guidance: Guidance<'s>) -> &'s ImageSet {
        images
    }

    fn with_settings(mut own: BcParams, settings: &EncodeSettings) -> BcParams {
        (own.goal, own.content, own.family) = (settings.goal, settings.content, settings.family);
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

    fn with_settings(mut own: VqParams, settings: &EncodeSettings) -> VqParams {
        (own.goal, own.content) = (settings.goal, settings.content);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own
    }

    /// Codebooks are never ASTC.
    fn check(settings: &EncodeSettings) -> Result<(), ParamError> {
        let content = settings.content.map_or("astc", Content::name);
        let error = ParamError::new("content", content, "raw, bc1 and bc7 for a vq codebook");
        if settings.is_astc() { Err(error) } else { Ok(()) }
    }

    /// A codebook whose size is given is made so.
    fn is_fixed(params: &VqParams) -> bool {
        params.codebook.is_some()
    }

    fn suits_settings(settings: &EncodeSettings) -> bool {
        !settings.is_astc()
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
        texfold_vq::part_images(texture).map_or(Vec::new(), |parts| {
            vec![
                part("codebook", vec![parts.codebook]),
                part("index", parts.index),
                part("usage", parts.usage),
            ]
        })
    }
}

impl ImageEncoder for Epitome {
    // Every image at nine scales in two formats, and some candidates for each leaf.
    const BYTES_PER_TEXEL: u64 = 450;
    const FOLLOWS_CONTENT_MASK: bool = true;
    const PLAIN: PlainOrder = PlainOrder::First(0.05);

    fn source<'s>(images: &'s ImageSet, guidance: Guidance<'s>) -> EpitomeSource<'s> {
        let Guidance { content_from, blocks, .. } = guidance;
        EpitomeSource { content_from, blocks, ..EpitomeSource::new(images) }
    }

    fn with_settings(mut own: EpitomeParams, settings: &EncodeSettings) -> EpitomeParams {
        (own.goal, own.content, own.family) = (settings.goal, settings.content, settings.family);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own.access = settings.access.unwrap_or(own.access);
        own.metric = settings.metric.or(own.metric);
        own
    }

    /// Of the codecs that choose by themselves it alone has ASTC content.
    fn suits_settings(settings: &EncodeSettings) -> bool {
        settings.is_astc() || settings.codec.owner().is_some()
    }

    /// A residual plane holds one or three channels of colours.
    fn families(pixel: PixelInfo) -> Vec<Family> {
        let has_residuals = matches!(pixel.channels, 1 | 3) && pixel.color != ColorSpace::Normal;
        let has_astc = Family::Astc.check_available(None).is_ok();
        let families = [(Family::Bc, true), (Family::Astc, has_astc), (Family::ErrorMap, has_residuals)];
        families.into_iter().filter_map(|(family, fits)| fits.then_some(family)).collect()
    }

    fn parts(texture: &EpitomeTexture) -> Vec<PartImages> {
        texfold_epitome::part_images(texture).map_or(Vec::new(), |parts| {
            vec![
                part("epitome", parts.epitomes),
                part("position", parts.positions),
                part("offset", parts.offsets),
                part("side", parts.sides),
                part("scale", parts.scales),
                part("charts", parts.charts),
                part("usage", parts.usage),
            ]
        })
    }
}

impl ImageEncoder for Progressive {
    // The coefficients of two bases, and a candidate or two for each block.
    const BYTES_PER_TEXEL: u64 = 160;
    const COMPARED_BPP: &'static [f64] = &[1.0, 1.5, 2.5, 4.0];
    const PLAIN: PlainOrder = PlainOrder::After;

    fn source<'s>(images: &'s ImageSet, _guidance: Guidance<'s>) -> &'s ImageSet {
        images
    }

    fn with_settings(mut own: ProgressiveParams, settings: &EncodeSettings) -> ProgressiveParams {
        (own.goal, own.content) = (settings.goal, settings.content);
        (own.mips, own.effort) = (settings.mips, settings.effort);
        own.access = settings.access.unwrap_or(own.access);
        own.metric = settings.metric.or(own.metric);
        own
    }

    /// Not where content is chosen, or blocks must be within a tolerance.
    fn suits_settings(settings: &EncodeSettings) -> bool {
        let free = settings.content.is_none() && !settings.is_astc();
        free && !matches!(settings.goal, Goal::Tolerance(_))
    }

    /// Not where importance is to be followed, alpha counts, or texels are no colours.
    fn suits(images: &ImageSet, guidance: &Guidance<'_>) -> bool {
        let guided = guidance.painted.is_some() || guidance.mesh.is_some();
        let info = images.info();
        !guided && !info.has_alpha() && info.color != ColorSpace::Normal
    }

    fn parts(texture: &ProgressiveTexture) -> Vec<PartImages> {
        texfold_progressive::part_images(texture).map_or(Vec::new(), |parts| {
            vec![
                part("base", parts.bases),
                part("bits", parts.bits),
                part("source", parts.sources),
                part("codebook", parts.codebooks),
                part("usage", parts.usage),
            ]
        })
    }
}

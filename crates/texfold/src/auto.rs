//! Choosing a codec for images, and falling back to plain block compression where a method does not suit.

use texfold_bc::{Bc, Bc1Blocks, BcParams, BcTexture, Content, Family};
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::mesh::UvMesh;
use texfold_core::metric::measure;
use texfold_core::target::Measured;
use texfold_core::{Effort, EncodeError, Encoded, Encoder, Goal, Job, ParamError, SourceError};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};
use texfold_progressive::{Progressive, ProgressiveParams};
use texfold_vq::{GuidanceWeights, Vq, VqParams, VqSource};

use crate::AnyImage;

/// Bits a texel of BC1.
const BC1_BPP: f64 = 4.0;

/// What plain blocks gain in dB by effort, from above: a method that is better by more need not be held against the best of
/// them.
const EFFORT_GAIN: f64 = 1.5;

/// Which codec to use for images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CodecChoice {
    /// The one that answers the goal best.
    #[default]
    Auto,
    /// Plain block compression.
    Bc,
    /// Importance-driven vector quantisation.
    Vq,
    /// Epitome factoring.
    Epitome,
    /// Base and error map.
    Progressive,
}

/// What to encode for, whatever the codec.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EncodeSettings {
    /// Which codec.
    pub codec: CodecChoice,
    /// What to reach.
    pub goal: Goal,
    /// How content planes are stored; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Formats that the goal may decide among where there is no `content`.
    pub family: Family,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
    /// epitome only: layers of the file, 1 where this is not given.
    pub layers: Option<u32>,
    /// vq only: codebook width and height in texels, instead of the goal.
    pub codebook: Option<(u32, u32)>,
    /// vq only: number and side in texels of the image samples.
    pub samples: Option<(u32, u32)>,
    /// vq only: 0 ignores importance, 1 weighs by it.
    pub importance: Option<f32>,
}

/// Optional maps that tell a codec what matters.
#[derive(Debug, Clone, Copy, Default)]
pub struct Guidance<'s> {
    /// A painted importance image, bright where it matters.
    pub painted: Option<&'s Raster>,
    /// A mesh that the texture is drawn on.
    pub mesh: Option<&'s UvMesh>,
    /// Weights of the guidance terms.
    pub weights: GuidanceWeights,
    /// epitome only: where content may come from, bright; everything else is made of it.
    pub content_from: Option<&'s Raster>,
    /// epitome only: the blocks of images that are BC1 already, to be taken over as they are.
    pub blocks: Option<&'s [Bc1Blocks]>,
}

/// Encodes images with the codec that the settings name.
///
/// A codec that cannot reach the goal where plain block compression can, or that is larger at the same quality,
/// gives way to it; the notes' verdict says so. A codebook asked for by its size is made as asked.
///
/// # Errors
/// As [`Encoder::encode`].
pub fn encode_images(
    source: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let bc = |job: &mut Job<'_>| Bc::encode(source, &bc_params(settings), job).map(AnyImage::Bc);
    let images = VqSource {
        images: source,
        painted: guidance.painted,
        mesh: guidance.mesh,
        weights: guidance.weights,
    };
    let Guidance { content_from, blocks, .. } = guidance;
    let factored = EpitomeSource { images: source, content_from, blocks };
    let params = vq_params(settings);
    match settings.codec {
        CodecChoice::Bc => bc(job),
        // Codebooks of vq are never ASTC.
        CodecChoice::Vq if is_astc(settings) => {
            let range = "raw, bc1 and bc7 for a vq codebook";
            let content = settings.content.map_or("astc", Content::name);
            Err(ParamError::new("content", content, range).into())
        }
        CodecChoice::Auto if is_astc(settings) => epitome(factored, settings, job),
        CodecChoice::Epitome => epitome(factored, settings, job),
        CodecChoice::Progressive => progressive(source, settings, job),
        CodecChoice::Vq if settings.codebook.is_some() => Vq::encode(images, &params, job).map(AnyImage::Vq),
        CodecChoice::Auto if any_may_answer(source, &guidance, settings) => {
            let first = job.within(0.0, 0.6, |job| quantised(images, settings, job))?;
            let second = job.within(0.6, 1.0, |job| progressive(source, settings, job))?;
            let of = |image: &AnyImage| measure(source, image.as_encoded());
            Ok(if settings.goal.prefers(&of(&second), &of(&first)) { second } else { first })
        }
        CodecChoice::Vq | CodecChoice::Auto => quantised(images, settings, job),
    }
}

/// Whether a base and an error map may stand for images: not where importance is to be followed, content is chosen, blocks must
/// be within a tolerance, alpha counts, or texels are not colours.
fn any_may_answer(source: &ImageSet, guidance: &Guidance<'_>, settings: &EncodeSettings) -> bool {
    let info = source.info();
    let guided = guidance.painted.is_some() || guidance.mesh.is_some() || settings.importance.is_some();
    let chosen = settings.content.is_some() || settings.codebook.is_some() || settings.samples.is_some();
    let plain = !info.has_alpha() && info.color != ColorSpace::Normal;
    !guided && !chosen && plain && !matches!(settings.goal, Goal::Tolerance(_))
}

/// Quantised images, or the plain form where that answers the goal better.
fn quantised(
    images: VqSource<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let (source, params) = (images.images, vq_params(settings));
    let bc = |job: &mut Job<'_>| Bc::encode(source, &bc_params(settings), job).map(AnyImage::Bc);
    let plain = match job.within(0.0, 0.2, bc) {
        // Content that only vq or only this picture's channels can have is no reason to stop.
        Err(EncodeError::Params(_)) => return Vq::encode(images, &params, job).map(AnyImage::Vq),
        plain => plain?,
    };
    let of_plain = measure(source, plain.as_encoded());
    let method = job.within(0.2, 1.0, |job| match settings.goal {
        Goal::Psnr(_) if settings.goal.is_met(&of_plain) => {
            Vq::encode_within(images, &params, of_plain.bpp, job)
        }
        _ => Vq::encode(images, &params, job),
    });
    choose(source, ("vq", settings.goal), method.map(AnyImage::Vq), (plain, of_plain))
}

/// Factored images, or the plain form where that answers the goal better. Where content is restricted there is no plain form.
fn epitome(
    source: EpitomeSource<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let params = EpitomeParams {
        goal: settings.goal,
        content: settings.content,
        family: settings.family,
        mips: settings.mips,
        layers: settings.layers.unwrap_or(1),
        effort: settings.effort,
        ..EpitomeParams::default()
    };
    if source.content_from.is_some() {
        return Epitome::encode(source, &params, job).map(AnyImage::Epitome);
    }
    let images = source.images;
    let plain = job.within(0.0, 0.05, |job| match source.blocks {
        Some(blocks) if bc1_answers(settings) => {
            BcTexture::from_bc1(blocks.to_vec(), images.info()).map_err(EncodeError::Source)
        }
        _ => Bc::encode(images, &bc_params(settings), job),
    })?;
    let plain = AnyImage::Bc(plain);
    let of_plain = measure(images, plain.as_encoded());
    let method = job.within(0.05, 1.0, |job| Epitome::encode(source, &params, job));
    choose(images, ("epitome", settings.goal), method.map(AnyImage::Epitome), (plain, of_plain))
}

/// A base and an error map, or the plain form where that answers the goal better.
fn progressive(
    source: &ImageSet,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let params = ProgressiveParams {
        goal: settings.goal,
        content: settings.content,
        reduce_log2: None,
        mips: settings.mips,
        effort: settings.effort,
    };
    let method = job.within(0.0, 0.9, |job| Progressive::encode(source, &params, job))?;
    let method = AnyImage::Progressive(method);
    let of_method = measure(source, method.as_encoded());
    // A plain form of more bits is no better answer to a goal that is met, and need not be made.
    let goal = match settings.goal {
        Goal::Psnr(_) if settings.goal.is_met(&of_method) => Goal::Bpp(of_method.bpp),
        goal => goal,
    };
    let plain = BcParams { content: None, goal, ..bc_params(settings) };
    let quick = BcParams { effort: Effort::Fast, ..plain.clone() };
    let quick = job.within(0.9, 0.95, |job| Bc::encode(source, &quick, job))?;
    let far = measure(source, &quick).psnr + EFFORT_GAIN < of_method.psnr;
    if far && settings.goal.is_met(&of_method) && !matches!(settings.goal, Goal::Tolerance(_)) {
        job.stage("done", 1.0)?;
        return Ok(method);
    }
    let plain = job.within(0.95, 1.0, |job| Bc::encode(source, &plain, job)).map(AnyImage::Bc)?;
    let of_plain = measure(source, plain.as_encoded());
    choose(source, ("progressive", settings.goal), Ok(method), (plain, of_plain))
}

/// Whether blocks that are BC1 already can be the plain answer.
fn bc1_answers(settings: &EncodeSettings) -> bool {
    !settings.mips && !is_astc(settings) && !matches!(settings.goal, Goal::Bpp(bpp) if bpp < BC1_BPP)
}

/// Whether content is to be ASTC.
fn is_astc(settings: &EncodeSettings) -> bool {
    matches!((settings.content, settings.family), (Some(Content::Astc(_)), _) | (None, Family::Astc))
}

fn bc_params(settings: &EncodeSettings) -> BcParams {
    BcParams {
        goal: settings.goal,
        content: settings.content,
        family: settings.family,
        reduce_log2: None,
        mips: settings.mips,
        effort: settings.effort,
    }
}

fn vq_params(settings: &EncodeSettings) -> VqParams {
    let usual = VqParams::default();
    VqParams {
        goal: settings.goal,
        codebook: settings.codebook,
        samples: settings.samples,
        importance: settings.importance.unwrap_or(usual.importance),
        content: settings.content,
        mips: settings.mips,
        effort: settings.effort,
    }
}

/// The better answer to the goal; a codebook that cannot hold a tolerance leaves the plain form. Parameters, cancellation
/// and limits are the caller's affair and are passed on.
fn choose(
    source: &ImageSet,
    (name, goal): (&str, Goal),
    method: Result<AnyImage, EncodeError>,
    (plain, of_plain): (AnyImage, Measured),
) -> Result<AnyImage, EncodeError> {
    let method = match method {
        Ok(method) => method,
        Err(EncodeError::Source(SourceError::Full { what })) => {
            return Ok(fall_back(plain, name, &format!("it would need more than {what}")));
        }
        Err(error) => return Err(error),
    };
    let of_method = measure(source, method.as_encoded());
    if goal.prefers(&of_method, &of_plain) {
        return Ok(method);
    }
    let reason = match (goal.is_met(&of_method), goal) {
        (false, Goal::Bpp(_)) => format!("it needs {:.2} bits a texel", of_method.bpp),
        (false, _) => format!("it reaches {:.1} dB in {:.2} bits a texel", of_method.psnr, of_method.bpp),
        (true, Goal::Bpp(_)) => {
            format!("it reaches {:.1} dB where the plain form reaches {:.1}", of_method.psnr, of_plain.psnr)
        }
        (true, _) => format!(
            "it needs {:.2} bits a texel where the plain form needs {:.2}",
            of_method.bpp, of_plain.bpp
        ),
    };
    Ok(fall_back(plain, name, &reason))
}

/// The plain form, whose verdict says why the method of that name was not used.
fn fall_back(plain: AnyImage, method: &str, reason: &str) -> AnyImage {
    match plain {
        AnyImage::Bc(texture) => {
            let mut notes = texture.notes().clone();
            notes.verdict =
                format!("{} {method} does not suit this picture and goal: {reason}.", notes.verdict);
            AnyImage::Bc(texture.with_notes(notes))
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encode(name: &str, settings: EncodeSettings) -> (ImageSet, AnyImage) {
        let set = ImageSet::single(texfold_testkit::picture(name));
        let encoded = encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
        (set, encoded)
    }

    #[test]
    fn noise_falls_back_to_the_plain_form_and_says_so() {
        let settings =
            EncodeSettings { codec: CodecChoice::Vq, goal: Goal::Psnr(30.0), ..EncodeSettings::default() };
        let (set, encoded) = encode("noise", settings);
        assert!(matches!(encoded, AnyImage::Bc(_)));
        assert!(encoded.as_encoded().notes().verdict.contains("vq does not suit"));
        assert!(measure(&set, encoded.as_encoded()).psnr >= 30.0);
    }

    #[test]
    fn a_photograph_is_a_base_and_an_error_map_unless_importance_is_asked_for() {
        let settings = EncodeSettings { goal: Goal::Bpp(2.5), ..EncodeSettings::default() };
        let (set, encoded) = encode("terrain", settings.clone());
        assert!(matches!(encoded, AnyImage::Progressive(_)), "{}", encoded.as_encoded().notes().verdict);
        assert!(measure(&set, encoded.as_encoded()).bpp <= 2.5);
        let weighed = encode("terrain", EncodeSettings { importance: Some(1.0), ..settings }).1;
        assert!(!matches!(weighed, AnyImage::Progressive(_)));
    }

    #[test]
    fn exact_repetition_is_cheaper_than_plain_blocks() {
        let settings = EncodeSettings { goal: Goal::Psnr(34.0), ..EncodeSettings::default() };
        let (set, encoded) = encode("tile_repeat", settings.clone());
        assert!(matches!(encoded, AnyImage::Vq(_)), "{}", encoded.as_encoded().notes().verdict);
        let plain = encode("tile_repeat", EncodeSettings { codec: CodecChoice::Bc, ..settings }).1;
        let (ours, plain) = (measure(&set, encoded.as_encoded()), measure(&set, plain.as_encoded()));
        assert!(ours.psnr >= 34.0 && ours.bpp < 0.6 * plain.bpp, "{ours:?} {plain:?}");
    }

    #[test]
    fn whatever_is_chosen_meets_a_goal_that_plain_blocks_meet() {
        for name in ["one_texel", "odd_3x5", "constant", "black", "ramp", "stripes", "line_513x1"] {
            for goal in [Goal::Psnr(32.0), Goal::Bpp(8.0), Goal::Tolerance(12.0)] {
                let (set, encoded) =
                    encode(name, EncodeSettings { goal, effort: Effort::Fast, ..EncodeSettings::default() });
                let (_, plain) = encode(
                    name,
                    EncodeSettings { goal, codec: CodecChoice::Bc, ..EncodeSettings::default() },
                );
                let (ours, plain) = (measure(&set, encoded.as_encoded()), measure(&set, plain.as_encoded()));
                assert!(goal.is_met(&ours) || !goal.is_met(&plain), "{name} {goal:?}: {ours:?} {plain:?}");
            }
        }
    }
}

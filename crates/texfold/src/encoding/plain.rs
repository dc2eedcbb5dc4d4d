//! A method held against plain block compression, which takes its place where it answers the goal better.

use texfold_bc::{Bc, BcParams, BcTexture};
use texfold_core::image::ImageSet;
use texfold_core::metric::quality;
use texfold_core::target::Measured;
use texfold_core::{Effort, EncodeError, Encoded, Encoder, Goal, Image2d, Job, SourceError};

use super::adapters::{ImageEncoder, PlainOrder};
use super::{EncodeSettings, Guidance};
use crate::AnyImage;

/// Bits a texel of BC1.
const BC1_BPP: f64 = 4.0;

/// What plain blocks gain in dB by effort, from above: a method that is better by more need not be held against the
/// best of them.
const EFFORT_GAIN: f64 = 1.5;

/// Shares of a job after which plain blocks are tried quickly, and as well as they can be, behind a method.
const AFTER: [f32; 2] = [0.9, 0.95];

/// How a texture answers a goal, with no look at whether to stop.
fn measure(images: &ImageSet, texture: &dyn Encoded<Domain = Image2d>, goal: Goal) -> Measured {
    quality(images, texture).judged(goal, images, texture)
}

/// Plain blocks, and how they answer the goal.
struct Plain {
    texture: BcTexture,
    measured: Measured,
}

/// Encodes with codec `C`, or with plain blocks where these answer the goal better and the settings allow it.
pub(super) fn or_plain<C: ImageEncoder>(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    C::check(settings)?;
    let params = settings.params::<C>();
    let named = settings.codec.is::<C>();
    // Blocks cannot keep to a mask.
    if (named && (settings.keeps_codec || C::is_fixed(&params)))
        || guidance.content_from.is_some_and(|_| C::FOLLOWS_CONTENT_MASK)
    {
        return C::encode(C::source(images, guidance), &params, job).map(AnyImage::new);
    }
    match C::PLAIN {
        PlainOrder::First(share) => plain_first::<C>((images, guidance), settings, share, job),
        PlainOrder::After => plain_after::<C>((images, guidance), settings, job),
    }
}

fn plain_first<C: ImageEncoder>(
    (images, guidance): (&ImageSet, Guidance<'_>),
    settings: &EncodeSettings,
    share: f32,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let (source, params) = (C::source(images, guidance), settings.params::<C>());
    let plain = job.within(0.0, share, |job| match guidance.blocks {
        Some(blocks) if bc1_answers(settings) => {
            BcTexture::from_bc1(blocks.to_vec(), images.info()).map_err(EncodeError::Source)
        }
        _ => Bc::encode(images, &settings.params::<Bc>(), job),
    });
    let plain = match plain {
        // Content that only the method or only this image's channels can have is no reason to stop.
        Err(EncodeError::Params(_)) => return C::encode(source, &params, job).map(AnyImage::new),
        plain => Plain::of(images, plain?, settings.goal),
    };
    let method = job.within(share, 1.0, |job| match settings.goal {
        Goal::Psnr(_) if settings.goal.is_met(&plain.measured) => {
            C::encode_within(source, &params, plain.measured.bpp, job)
        }
        _ => C::encode(source, &params, job),
    });
    plain.unless(images, settings.goal, C::ID.name, method.map(AnyImage::new))
}

fn plain_after<C: ImageEncoder>(
    (images, guidance): (&ImageSet, Guidance<'_>),
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let params = settings.params::<C>();
    let [quick_from, plain_from] = AFTER;
    let method = job.within(0.0, quick_from, |job| C::encode(C::source(images, guidance), &params, job))?;
    let method = AnyImage::new(method);
    let of_method = measure(images, method.as_encoded(), settings.goal);
    let met = settings.goal.is_met(&of_method);
    // Blocks of more bits are no better answer to a goal that is met, and need not be made.
    let goal = match settings.goal {
        Goal::Psnr(_) if met => Goal::Bpp(of_method.bpp),
        goal => goal,
    };
    // The content of the settings is that of a part of the method.
    let mut plain: BcParams = settings.params::<Bc>();
    (plain.content, plain.goal) = (None, goal);
    let needed = match settings.goal {
        Goal::Psnr(psnr) if met => psnr,
        _ => of_method.psnr,
    };
    let is_far = |texture: &BcTexture| measure(images, texture, settings.goal).psnr + EFFORT_GAIN < needed;
    let can_be_far = met && !matches!(settings.goal, Goal::Tolerance(_));
    let reduced = match goal {
        Goal::Bpp(bpp) if can_be_far => Bc::reduced(images, &plain, bpp, job)?,
        _ => None,
    };
    let far = reduced.is_some_and(|reduced| is_far(&reduced))
        || can_be_far && {
            let mut quick = plain.clone();
            quick.effort = Effort::Fast;
            is_far(&job.within(quick_from, plain_from, |job| Bc::encode(images, &quick, job))?)
        };
    if far {
        job.stage("done", 1.0)?;
        return Ok(method);
    }
    plain.goal = settings.goal;
    let plain = job.within(plain_from, 1.0, |job| Bc::encode(images, &plain, job))?;
    Plain::of(images, plain, settings.goal).unless(images, settings.goal, C::ID.name, Ok(method))
}

/// Whether blocks that are BC1 already can be the plain answer.
fn bc1_answers(settings: &EncodeSettings) -> bool {
    !settings.mips && !matches!(settings.goal, Goal::Bpp(bpp) if bpp < BC1_BPP)
}

impl Plain {
    fn of(images: &ImageSet, texture: BcTexture, goal: Goal) -> Plain {
        let measured = measure(images, &texture, goal);
        Plain { texture, measured }
    }

    /// The better answer to the goal; a method that has no room for its tables leaves plain blocks. Parameters,
    /// cancellation and limits are the caller's affair and are passed on.
    fn unless(
        self,
        images: &ImageSet,
        goal: Goal,
        name: &str,
        method: Result<AnyImage, EncodeError>,
    ) -> Result<AnyImage, EncodeError> {
        let method = match method {
            Ok(method) => method,
            Err(EncodeError::Source(SourceError::OutOfReach { what })) => {
                return Ok(self.instead_of(name, what));
            }
            Err(EncodeError::Source(SourceError::Full { what })) => {
                return Ok(self.instead_of(name, &format!("it would need more than {what}")));
            }
            Err(error) => return Err(error),
        };
        let (found, plain) = (measure(images, method.as_encoded(), goal), self.measured);
        if goal.prefers(&found, &plain) {
            return Ok(method);
        }
        let reason = match (goal.is_met(&found), goal) {
            (false, Goal::Bpp(_)) => format!("it needs {:.2} bits per texel", found.bpp),
            (false, _) => format!("it reaches {:.1} dB in {:.2} bits per texel", found.psnr, found.bpp),
            (true, Goal::Bpp(_)) => {
                format!("it reaches {:.1} dB, plain blocks {:.1} dB", found.psnr, plain.psnr)
            }
            (true, _) => {
                format!("it needs {:.2} bits per texel, plain blocks {:.2}", found.bpp, plain.bpp)
            }
        };
        Ok(self.instead_of(name, &reason))
    }

    /// Plain blocks, whose verdict says why the method of that name was not used.
    fn instead_of(self, method: &str, reason: &str) -> AnyImage {
        let mut notes = self.texture.notes().clone();
        notes.verdict = format!("{} {method} does not suit this image and goal: {reason}.", notes.verdict);
        AnyImage::new(self.texture.with_notes(notes))
    }
}

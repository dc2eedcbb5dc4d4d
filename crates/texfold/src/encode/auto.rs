//! Choosing a codec for images.

use texfold_bc::Bc;
use texfold_core::image::ImageSet;
use texfold_core::metric::measure;
use texfold_core::target::Measured;
use texfold_core::{EncodeError, Job};

use super::{ENCODINGS, EncodeSettings, Encoding, Guidance};
use crate::AnyImage;

/// Encodes images with the codec that the settings name, or with the one that answers the goal best.
///
/// A codec that cannot reach the goal where plain block compression can, or that is larger at the same quality,
/// gives way to it; the notes' verdict says so. A codebook of a given size is not held against plain blocks.
///
/// # Errors
/// As [`texfold_core::Encoder::encode`].
pub fn encode_images(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    if let Some(encoding) = settings.codec.encoding() {
        return encoding.or_plain(images, guidance, settings, job);
    }
    let suits = |encoding: &&Encoding| encoding.suits(images, &guidance, settings);
    let tried: Vec<&Encoding> = ENCODINGS.iter().filter(suits).collect();
    let share = |index: usize| index as f32 / tried.len() as f32;
    let mut best: Option<(AnyImage, Option<Measured>)> = None;
    for (index, encoding) in tried.iter().enumerate() {
        let made = job.within(share(index), share(index + 1), |job| {
            encoding.or_plain(images, guidance, settings, job)
        })?;
        // What is alone need not be measured.
        let measured = (tried.len() > 1).then(|| measure(images, made.as_encoded()));
        let better = match (&best, measured) {
            (Some((_, Some(known))), Some(found)) => settings.goal.prefers(&found, known),
            _ => true,
        };
        if better {
            best = Some((made, measured));
        }
    }
    match best {
        Some((image, _)) => Ok(image),
        // No method suits such settings: plain blocks name what is wrong with them, or serve.
        None => Encoding::of::<Bc>().encode(images, guidance, settings, job),
    }
}

#[cfg(test)]
mod tests {
    use texfold_bc::BcTexture;
    use texfold_core::{Effort, Goal};
    use texfold_progressive::ProgressiveTexture;
    use texfold_vq::{Vq, VqParams, VqTexture};

    use super::*;
    use crate::Choice;

    fn encode(name: &str, settings: &EncodeSettings) -> (ImageSet, AnyImage) {
        let set = ImageSet::single(texfold_testkit::image(name));
        let encoded = encode_images(&set, Guidance::default(), settings, &mut Job::default()).unwrap();
        (set, encoded)
    }

    fn verdict(image: &AnyImage) -> &str {
        &image.as_encoded().notes().verdict
    }

    #[test]
    fn noise_falls_back_to_plain_blocks_and_says_so() {
        let settings =
            EncodeSettings { codec: Choice::of::<Vq>(), goal: Goal::Psnr(30.0), ..EncodeSettings::default() };
        let (set, encoded) = encode("noise", &settings);
        assert!(encoded.downcast_ref::<BcTexture>().is_some());
        assert!(verdict(&encoded).contains("vq does not suit"));
        assert!(measure(&set, encoded.as_encoded()).psnr >= 30.0);
    }

    #[test]
    fn a_photograph_is_a_base_and_a_residual_unless_importance_is_to_be_followed() {
        let settings = EncodeSettings { goal: Goal::Bpp(2.5), ..EncodeSettings::default() };
        let (set, encoded) = encode("terrain", &settings);
        assert!(encoded.downcast_ref::<ProgressiveTexture>().is_some(), "{}", verdict(&encoded));
        assert!(measure(&set, encoded.as_encoded()).bpp <= 2.5);
        let codec = Choice::auto().with::<Vq>(VqParams::default());
        let weighed = encode("terrain", &EncodeSettings { codec, ..settings }).1;
        assert!(weighed.downcast_ref::<ProgressiveTexture>().is_none());
    }

    #[test]
    fn exact_repetition_is_cheaper_than_plain_blocks() {
        let settings = EncodeSettings { goal: Goal::Psnr(34.0), ..EncodeSettings::default() };
        let (set, encoded) = encode("tile_repeat", &settings);
        assert!(encoded.downcast_ref::<VqTexture>().is_some(), "{}", verdict(&encoded));
        let plain = encode("tile_repeat", &EncodeSettings { codec: Choice::of::<Bc>(), ..settings }).1;
        let (ours, plain) = (measure(&set, encoded.as_encoded()), measure(&set, plain.as_encoded()));
        assert!(ours.psnr >= 34.0 && ours.bpp < 0.6 * plain.bpp, "{ours:?} {plain:?}");
    }

    #[test]
    fn whatever_is_chosen_meets_a_goal_that_plain_blocks_meet() {
        for name in ["one_texel", "odd_3x5", "constant", "black", "ramp", "stripes", "line_513x1"] {
            for goal in [Goal::Psnr(32.0), Goal::Bpp(8.0), Goal::Tolerance(12.0)] {
                let settings = EncodeSettings { goal, effort: Effort::Fast, ..EncodeSettings::default() };
                let (set, encoded) = encode(name, &settings);
                let plain = EncodeSettings { goal, codec: Choice::of::<Bc>(), ..EncodeSettings::default() };
                let (_, plain) = encode(name, &plain);
                let (ours, plain) = (measure(&set, encoded.as_encoded()), measure(&set, plain.as_encoded()));
                assert!(goal.is_met(&ours) || !goal.is_met(&plain), "{name} {goal:?}: {ours:?} {plain:?}");
            }
        }
    }

    #[test]
    fn parameters_of_a_codec_reach_it_and_settings_are_laid_over_them() {
        let own = VqParams::default().with_codebook((64, 32)).with_goal(Goal::Bpp(1.0));
        let codec = Choice::of::<Vq>().with::<Vq>(own);
        let settings = EncodeSettings { codec, goal: Goal::Psnr(20.0), ..EncodeSettings::default() };
        let params = settings.params::<Vq>();
        assert_eq!((params.codebook, params.goal), (Some((64, 32)), Goal::Psnr(20.0)));
        let (_, made) = encode("facade", &settings);
        assert!(made.downcast_ref::<VqTexture>().is_some(), "a codebook of a given size is made so");
    }
}

//! Choosing a codec for images: the one that usually answers best is encoded, and of the others those that a look at the images
//! gives a chance against it.

use texfold_bc::Bc;
use texfold_core::image::ImageSet;
use texfold_core::target::Measured;
use texfold_core::{EncodeError, Encoded, Goal, Image2d, Job, Metric, SourceError};
use texfold_dct::Dct;
use texfold_residual::encode::{Score, score};

use super::{ENCODINGS, EncodeSettings, Encoding, Guidance};
use crate::AnyImage;

/// A texture, and what was made of the codecs that it was chosen from.
#[derive(Debug)]
pub struct Chosen {
    /// The texture.
    pub image: AnyImage,
    /// One for each codec that was encoded or considered; empty where there was nothing to choose from.
    pub attempts: Vec<Attempt>,
}

/// What a choice among all codecs made of one of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Attempt {
    /// Name of the codec.
    pub codec: &'static str,
    /// What it came to, in PSNR of colours, bits a texel as goals count them and the error of its worst block; `None` where
    /// it was not encoded to the end.
    pub measured: Option<Measured>,
    /// What became of it, a part of a sentence whose subject is the codec.
    pub outcome: String,
}

/// Encodes images with the codec that the settings name, or with the one that answers the goal best.
///
/// Maps of a material are encoded by `dct`.
/// Where a codec cannot reach the goal and plain block compression can, or is larger at the same quality,
/// plain blocks are returned; the notes' verdict says so. A codebook of a given size is not held against plain blocks.
/// Where no codec is named, the verdict says what was tried, what was not and why.
///
/// # Errors
/// As [`texfold_core::Encoder::encode`].
pub fn encode_images(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    choose_images(images, guidance, settings, job).map(|chosen| chosen.image)
}

/// As [`encode_images`], and says what each codec came to.
///
/// # Errors
/// As [`texfold_core::Encoder::encode`].
pub fn choose_images(
    images: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<Chosen, EncodeError> {
    let without_choice = |image| Chosen { image, attempts: Vec::new() };
    settings.check()?;
    if !images.maps().is_empty() {
        let dct = Encoding::of::<Dct>();
        let encoding = settings.codec.encoding().unwrap_or(&dct);
        encoding.check(settings)?;
        return encoding.encode(images, guidance, settings, job).map(without_choice);
    }
    if let Some(encoding) = settings.codec.encoding() {
        return encoding.or_plain(images, guidance, settings, job).map(without_choice);
    }
    let suits = |encoding: &&Encoding| encoding.suits(images, &guidance, settings);
    let mut suited = ENCODINGS.iter().rev().filter(suits);
    let Some(first) = suited.next() else {
        // No method suits such settings: plain blocks name what is wrong with them, or serve.
        return Encoding::of::<Bc>().encode(images, guidance, settings, job).map(without_choice);
    };
    let others: Vec<&Encoding> = suited.collect();
    let count = 1 + others.len();
    let share = |index: usize| index as f32 / count as f32;
    let made = job.within(0.0, share(1), |job| first.or_plain(images, guidance, settings, job))?;
    if others.is_empty() {
        return Ok(without_choice(made));
    }
    let mut contest = Contest::new(images, guidance, settings, (first, made), job)?;
    for (index, other) in (1..).zip(others) {
        job.within(share(index), share(index + 1), |job| contest.try_out(other, job))?;
    }
    job.stage("done", 1.0)?;
    Ok(contest.settled())
}

/// Codecs that compete for a goal.
struct Contest<'a> {
    images: &'a ImageSet,
    guidance: Guidance<'a>,
    settings: &'a EncodeSettings,
    best: AnyImage,
    of_best: Score,
    /// Which attempt made the best.
    best_attempt: usize,
    attempts: Vec<Attempt>,
}

impl<'a> Contest<'a> {
    /// Of a first codec's texture, which may be of plain blocks instead.
    fn new(
        images: &'a ImageSet,
        guidance: Guidance<'a>,
        settings: &'a EncodeSettings,
        (first, made): (&Encoding, AnyImage),
        job: &Job<'_>,
    ) -> Result<Contest<'a>, EncodeError> {
        let of_best = scored(images, made.as_encoded(), settings, job)?;
        let mut contest = Contest {
            images,
            guidance,
            settings,
            best: made,
            of_best,
            best_attempt: 0,
            attempts: Vec::new(),
        };
        if contest.best.codec() != first.id {
            contest.note(first.id.name, "was tried; plain blocks are better".to_owned());
        }
        contest.best_attempt = contest.note_encoded(contest.best.codec().name, &of_best);
        Ok(contest)
    }

    /// Tries a codec where it may win.
    fn try_out(&mut self, other: &Encoding, job: &mut Job<'_>) -> Result<(), EncodeError> {
        let name = other.id.name;
        let why = match (other.why_not)(self.images, self.settings, &self.of_best.squares, job) {
            Err(EncodeError::Cancelled) => return Err(EncodeError::Cancelled),
            Err(error) => Some(error.to_string()),
            Ok(why) => why,
        };
        if let Some(why) = why {
            self.note(name, format!("was not tried: {why}"));
            return Ok(());
        }
        let made = (other.within)(self.images, self.guidance, self.settings, self.room(), job);
        let made = match made {
            Ok(made) => made,
            Err(EncodeError::Cancelled) => return Err(EncodeError::Cancelled),
            Err(EncodeError::Source(SourceError::OutOfReach { what } | SourceError::Full { what })) => {
                self.note(name, format!("was tried and does not suit: {what}"));
                return Ok(());
            }
            // The one that is there serves.
            Err(error) => {
                self.note(name, format!("was not tried: {error}"));
                return Ok(());
            }
        };
        let found = scored(self.images, made.as_encoded(), self.settings, job)?;
        let attempt = self.note_encoded(name, &found);
        if self.settings.goal.prefers(&found.by_goal, &self.of_best.by_goal) {
            (self.best, self.of_best, self.best_attempt) = (made, found, attempt);
        }
        Ok(())
    }

    /// Notes a codec that was not encoded to the end.
    fn note(&mut self, codec: &'static str, outcome: String) {
        self.attempts.push(Attempt { codec, measured: None, outcome });
    }

    /// Notes what a codec came to; the attempt's index.
    fn note_encoded(&mut self, codec: &'static str, found: &Score) -> usize {
        let outcome = format!("came to {}", figures(self.settings.goal, &found.by_goal));
        self.attempts.push(Attempt { codec, measured: Some(found.squares), outcome });
        self.attempts.len() - 1
    }

    /// Bits a texel beyond which another answer is no better.
    fn room(&self) -> f64 {
        let goal = self.settings.goal;
        let by_bits = matches!(goal, Goal::Bpp(_));
        if !by_bits && goal.is_met(&self.of_best.by_goal) { self.of_best.by_goal.bpp } else { f64::INFINITY }
    }

    /// The best, whose verdict says of all others what they came to.
    fn settled(mut self) -> Chosen {
        let others = self.attempts.iter().enumerate().filter(|(index, _)| *index != self.best_attempt);
        let others: Vec<String> =
            others.map(|(_, attempt)| format!("{} {}", attempt.codec, attempt.outcome)).collect();
        if let Some(notes) = self.best.notes_mut() {
            notes.verdict = format!("{} Chosen among all methods: {}.", notes.verdict, others.join("; "));
        }
        Chosen { image: self.best, attempts: self.attempts }
    }
}

/// Measurements of a texture for the goal and metric of the settings.
fn scored(
    images: &ImageSet,
    texture: &dyn Encoded<Domain = Image2d>,
    settings: &EncodeSettings,
    job: &Job<'_>,
) -> Result<Score, EncodeError> {
    let metric = settings.metric.unwrap_or(Metric::for_goal(settings.goal, images.info().color));
    let check = job.cancel_check();
    job.install(|| score(images, texture, (settings.goal, metric), check))
}

/// What a codec came to, in the figure that decides.
fn figures(goal: Goal, found: &Measured) -> String {
    match goal {
        Goal::Bpp(_) if goal.is_met(found) => {
            format!("{:.2} dB by the same metric", found.psnr)
        }
        _ if goal.is_met(found) => format!("{:.2} bits a texel", found.bpp),
        Goal::Bpp(_) => format!("{:.2} bits a texel at least", found.bpp),
        Goal::Psnr(_) => format!("{:.1} dB at most", found.psnr),
        Goal::Tolerance(_) => format!("an error of {:.1} in its worst block", found.worst_block_rms),
    }
}

#[cfg(test)]
mod tests {
    use texfold_bc::BcTexture;
    use texfold_core::Effort;
    use texfold_core::metric::measure;
    use texfold_dct::DctImages;
    use texfold_epitome::EpitomeTexture;
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
    fn a_photograph_is_transformed_unless_importance_is_to_be_followed() {
        let settings = EncodeSettings { goal: Goal::Bpp(2.5), ..EncodeSettings::default() };
        let (set, encoded) = encode("terrain", &settings);
        assert!(encoded.downcast_ref::<DctImages>().is_some(), "{}", verdict(&encoded));
        assert!(measure(&set, encoded.as_encoded()).bpp <= 2.5);
        let codec = Choice::auto().with::<Vq>(VqParams::default());
        let weighed = encode("terrain", &EncodeSettings { codec, ..settings }).1;
        assert!(weighed.downcast_ref::<DctImages>().is_none());
    }

    #[test]
    fn exact_repetition_is_cheaper_than_plain_blocks() {
        let settings = EncodeSettings { goal: Goal::Psnr(34.0), ..EncodeSettings::default() };
        let (set, encoded) = encode("tile_repeat", &settings);
        assert!(encoded.downcast_ref::<EpitomeTexture>().is_some(), "{}", verdict(&encoded));
        assert!(verdict(&encoded).contains("dct came to"), "{}", verdict(&encoded));
        let plain = encode("tile_repeat", &EncodeSettings { codec: Choice::of::<Bc>(), ..settings }).1;
        let (ours, plain) = (measure(&set, encoded.as_encoded()), measure(&set, plain.as_encoded()));
        assert!(ours.psnr >= 34.0 && ours.bpp < 0.15 * plain.bpp, "{ours:?} {plain:?}");
    }

    #[test]
    fn what_cannot_win_is_not_tried_and_the_verdict_says_why() {
        let settings = EncodeSettings { goal: Goal::Psnr(34.0), ..EncodeSettings::default() };
        let encoded = encode("salient", &settings).1;
        assert!(verdict(&encoded).contains("epitome was not tried"), "{}", verdict(&encoded));
        assert!(
            verdict(&encoded).contains("vq was not tried: its index alone takes 1.0"),
            "{}",
            verdict(&encoded)
        );
        let encoded = encode("noise", &settings).1;
        assert!(verdict(&encoded).contains("vq was not tried: a codebook of"), "{}", verdict(&encoded));
    }

    #[test]
    fn every_codec_that_was_considered_is_an_attempt_with_what_it_came_to() {
        for (name, goal) in
            [("tile_repeat", Goal::Psnr(34.0)), ("salient", Goal::Bpp(1.0)), ("constant", Goal::Psnr(34.0))]
        {
            let set = ImageSet::single(texfold_testkit::image(name));
            let settings = EncodeSettings { goal, ..EncodeSettings::default() };
            let Chosen { image, attempts } =
                choose_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
            let of = |codec: &str| attempts.iter().find(|attempt| attempt.codec == codec);
            let chosen = of(image.codec().name).unwrap().measured.unwrap();
            assert_eq!(chosen.psnr, measure(&set, image.as_encoded()).psnr, "{name}");
            for codec in ["dct", "progressive", "epitome", "vq"] {
                let attempt = of(codec).unwrap();
                let was_encoded = attempt.outcome.starts_with("came to");
                assert_eq!(attempt.measured.is_some(), was_encoded, "{name}: {attempt:?}");
                let is_told = verdict(&image).contains(&format!("{codec} {}", attempt.outcome));
                assert_eq!(is_told, codec != image.codec().name, "{name}: {}", verdict(&image));
            }
        }
    }

    #[test]
    fn plain_blocks_that_meet_a_quality_in_fewer_bits_are_the_answer() {
        for name in ["constant", "column_1x259", "one_texel"] {
            let settings = EncodeSettings { goal: Goal::Psnr(34.0), ..EncodeSettings::default() };
            let (set, chosen) = encode(name, &settings);
            let plain = encode(name, &EncodeSettings { codec: Choice::of::<Bc>(), ..settings }).1;
            let (ours, plain) = (measure(&set, chosen.as_encoded()), measure(&set, plain.as_encoded()));
            assert!(ours.psnr >= 34.0 && ours.bpp <= plain.bpp, "{name}: {ours:?} {plain:?}");
        }
    }

    #[test]
    fn alpha_and_tolerances_have_the_choice_of_all_methods() {
        for (name, goal) in [("cutout", Goal::Bpp(2.0)), ("terrain", Goal::Tolerance(10.0))] {
            let settings = EncodeSettings { goal, ..EncodeSettings::default() };
            let (set, chosen) = encode(name, &settings);
            let of = |image: &AnyImage| {
                scored(&set, image.as_encoded(), &settings, &Job::default()).unwrap().by_goal
            };
            let ours = of(&chosen);
            assert!(goal.is_met(&ours), "{name}: {ours:?}");
            for encoding in &ENCODINGS {
                let other = encoding.encode(&set, Guidance::default(), &settings, &mut Job::default());
                let Ok(other) = other else { continue };
                let other = of(&other);
                let near = match goal {
                    Goal::Bpp(_) => ours.psnr > other.psnr - 0.3,
                    _ => ours.bpp < 1.05 * other.bpp,
                };
                assert!(near || !goal.is_met(&other), "{name} {encoding:?}: {ours:?} {other:?}");
            }
        }
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

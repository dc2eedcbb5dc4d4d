//! Maps in blocks of variable length: one step for all of them, which a PSNR decides; or in planes where these take fewer bits.

use std::ops::RangeInclusive;

use texfold_bc::Content;
use texfold_core::target::{Measured, search_step};
use texfold_core::{CancelCheck, EncodeError, Encoded, Goal, ImageSize, Job, Metric, Notes, SourceError};
use texfold_dct::encode::{DctEncoder, DctSettings, DctSource, STEPS};
use texfold_dct::{DctContent, Quantiser};

use super::assemble::Maps;
use super::atlases::{Canvas, Drawn};
use super::quality::{self, LightQuality};
use super::scene::Scene;
use super::share::Codebooks;
use crate::LightTexture;
use crate::params::LightParams;
use crate::parts::{Atlas, PIXEL, Parts, Payload, TermRows, atlas_layout};

/// Steps' numbers by which a step of half the size differs: errors of maps that count four times.
const OCTAVE: f64 = STEPS.octave as f64;
/// Steps of maps in units of a byte from which on rounding to bytes adds less than a sixteenth to the quantiser's squared error.
const LEAST_STEP: f64 = 4.0;
/// Least part of the mean's errors that maps are made smaller for: then hardly any are.
const LEAST_PART: f64 = 1.0 / 4096.0;
/// What is kept below a goal that a share of the samples is held to, in dB, as all of them may have less.
const MARGIN: f64 = 0.005;
/// PSNR in dB from which on errors count as none: a share of few samples may be exact.
const EXACT: f64 = 120.0;
/// By how many numbers a step is made finer where searches end just short of a goal; twice as many each time. A 64th of an octave.
const FIRST_STRIDE: u16 = STEPS.octave / 64;
/// Searches for a goal, each by as much above it as the one before was below.
const SEARCHES: usize = 3;
/// Bytes a texel of the atlases while steps are searched: texels twice, samples, coefficients, their numbers, and what the CPU draws from.
const TEXEL_BYTES: u64 = 64;

/// What is to be stored, and for what.
pub(super) struct Store<'s> {
    pub(super) scene: &'s Scene,
    pub(super) params: &'s LightParams,
    pub(super) maps: &'s Maps,
    pub(super) books: Codebooks,
    pub(super) cancel: CancelCheck<'s>,
}

/// A light field and how close it comes to the photographs.
type Measurement = (LightTexture, LightQuality);

impl Store<'_> {
    /// The maps in planes.
    pub(super) fn planes(&self, content: Content) -> Result<LightTexture, EncodeError> {
        let drawn = self.maps.drawn(self.scene, self.params, self.books, self.cancel)?;
        self.in_planes(&drawn, content, self.params.terms)
    }

    fn in_planes(&self, drawn: &Drawn, content: Content, terms: u32) -> Result<LightTexture, EncodeError> {
        let payload = drawn.planes(content, self.cancel)?;
        let parts = drawn.parts(self.scene, self.params, self.params.terms, payload);
        Ok(LightTexture::new(parts, Notes::default()).truncated(terms))
    }

    /// The maps in blocks, with as few bits as keep the PSNR that is asked for, or that of raw maps but for the loss that is allowed; or in
    /// planes where these take fewer. And what is to be said of that.
    pub(super) fn choose(&self, job: &mut Job<'_>) -> Result<(Measurement, String), EncodeError> {
        let plain = job.install(|| self.maps.drawn(self.scene, self.params, self.books, self.cancel))?;
        let raw = job.install(|| self.in_planes(&plain, Content::Raw, self.params.terms))?;
        let quality = job.install(|| quality::measure(self.scene, &raw, self.cancel));
        job.checkpoint()?;
        let reached = self.params.psnr.and_then(|goal| {
            let terms = quality.psnr_of_terms.iter().position(|&psnr| psnr > goal)?;
            Some((terms as u32, goal))
        });
        let most = self.params.terms;
        let within = quality.psnr.min(EXACT) - self.params.storage.loss;
        let (least, goal) = reached.unwrap_or((most, within));
        let texels = [&plain.mean, &plain.surface, &plain.view].map(|canvas| canvas.texels.len() as u64);
        let bytes = Maps::bytes(self.scene, self.params) + TEXEL_BYTES * texels.iter().sum::<u64>();
        let search = Search { store: self, goal, raw: (&raw, &quality) };
        let blocks = job.holding(bytes, |job| search.by_block(least..=most, job))?;
        let bytes = |texture: &LightTexture| texture.gpu().block_bytes().map(|(_, bytes)| bytes).sum::<u64>();
        let held = blocks.as_ref().map_or(u64::MAX, |(texture, _)| bytes(texture));
        for content in [Content::Bc1, Content::Bc7, Content::Raw] {
            if plane_bytes(&plain, content, least) >= held {
                continue;
            }
            let planes = job.install(|| self.in_planes(&plain, content, least))?;
            let measured = job.install(|| quality::measure(self.scene, &planes, self.cancel));
            job.checkpoint()?;
            if measured.psnr >= goal || content == Content::Raw {
                let remark = format!(
                    "Maps are in planes of {}: blocks of variable length take no fewer bits for as much.",
                    content.name()
                );
                return Ok(((planes, measured), remark));
            }
        }
        let blocks = blocks.ok_or(SourceError::Empty)?;
        let share = 100.0 * held as f64 / plane_bytes(&plain, Content::Raw, least).max(1) as f64;
        let remark = format!(
            "Maps are in blocks of variable length, which take {share:.0} % of the bits of raw maps."
        );
        Ok((blocks, remark))
    }
}

/// Bytes of all atlases in planes of the first `terms` terms.
fn plane_bytes(drawn: &Drawn, content: Content, terms: u32) -> u64 {
    let rows = drawn.layout.rows(terms);
    let sizes = [drawn.mean.size, (drawn.widths.surface, rows.surface), (drawn.widths.view, rows.view)];
    let formats = content.formats(PIXEL).0;
    sizes.iter().flat_map(|&(width, rows)| formats.iter().map(move |format| format.bytes(width, rows))).sum()
}

/// What is coded: the mean, and each term's rows of the other atlases.
struct Sources {
    mean: DctSource,
    terms: Vec<TermSources>,
}

/// A term's images, and by how much their steps' numbers differ from the mean's.
struct TermSources {
    rows: TermRows,
    images: Vec<(DctSource, f64)>,
}

impl Sources {
    fn of(drawn: &Drawn, terms: u32) -> Result<Sources, SourceError> {
        let term = |(term, weights): (u32, &[f64; 2])| {
            let rows = TermRows::of(&drawn.layout, drawn.widths, term);
            let image = |(atlas, first, size)| {
                let (canvas, weight) = match atlas {
                    Atlas::Surface => (&drawn.surface, weights[0]),
                    _ => (&drawn.view, weights[1]),
                };
                // A squared error counts by its weight, and goes by the square of the step.
                Ok((source(canvas, first, size)?, -0.5 * OCTAVE * weight.max(f64::MIN_POSITIVE).log2()))
            };
            let images = rows.images().map(image).collect::<Result<Vec<_>, SourceError>>()?;
            Ok(TermSources { rows, images })
        };
        let (width, height) = drawn.mean.size;
        Ok(Sources {
            mean: source(&drawn.mean, 0, ImageSize { width, height })?,
            terms: (0..terms).zip(&drawn.weights).map(term).collect::<Result<Vec<_>, SourceError>>()?,
        })
    }

    fn encoders<'a>(&'a self, cancel: CancelCheck<'a>) -> Result<Encoders<'a>, EncodeError> {
        let params = DctSettings::default().with_metric(Metric::Psnr);
        let encoder = |source: &'a DctSource| DctEncoder::new(source, &params, cancel);
        let term = |term: &'a TermSources| {
            let images = term.images.iter().map(|(source, finer)| Ok((encoder(source)?, *finer)));
            Ok((term.rows, images.collect::<Result<Vec<_>, EncodeError>>()?))
        };
        Ok(Encoders {
            mean: encoder(&self.mean)?,
            terms: self.terms.iter().map(term).collect::<Result<Vec<_>, EncodeError>>()?,
        })
    }
}

/// A term's rows, and the encoders of its images.
type TermEncoders<'a> = (TermRows, Vec<(DctEncoder<'a>, f64)>);

/// Coefficients of all images.
struct Encoders<'a> {
    mean: DctEncoder<'a>,
    terms: Vec<TermEncoders<'a>>,
}

impl Encoders<'_> {
    /// All images with that step of the mean.
    fn at_step(&self, step: u16) -> Result<Payload, EncodeError> {
        let unlike = SourceError::Unlike { index: 0, what: "its size or channels" };
        let mean = self.mean.at_step(step)?;
        let mean = DctContent::new(atlas_layout(vec![mean.form().size]), vec![mean]);
        let term = |(rows, images): &TermEncoders<'_>| {
            let Some(layout) = rows.layout() else { return Ok(None) };
            let at = |(encoder, finer): &(DctEncoder<'_>, f64)| {
                encoder.at_step((f64::from(step) + finer).round().clamp(0.0, f64::from(STEPS.most)) as u16)
            };
            let stages = images.iter().map(at).collect::<Result<Vec<_>, EncodeError>>()?;
            Ok(Some(DctContent::new(layout, stages).ok_or(unlike.clone())?))
        };
        let terms = self.terms.iter().map(term).collect::<Result<Vec<_>, EncodeError>>()?;
        Ok(Payload::Blocks { mean: mean.ok_or(unlike.clone())?, terms })
    }
}

/// Searches steps.
struct Search<'c> {
    store: &'c Store<'c>,
    /// PSNR in dB of the matrices.
    goal: f64,
    /// Raw maps, and how close they come.
    raw: (&'c LightTexture, &'c LightQuality),
}

impl Search<'_> {
    /// The number of terms and the step with the fewest bits that reach the goal; none where no step does.
    fn by_block(
        &self,
        terms: RangeInclusive<u32>,
        job: &mut Job<'_>,
    ) -> Result<Option<Measurement>, EncodeError> {
        let mut best: Option<(u64, Measurement)> = None;
        for terms in terms {
            let found = self.with_terms(terms, job)?;
            if found.1.psnr < self.goal {
                continue;
            }
            let bits = found.0.memory().compressed;
            if best.as_ref().is_some_and(|(least, _)| bits >= *least) {
                break;
            }
            best = Some((bits, found));
        }
        Ok(best.map(|(_, found)| found))
    }

    /// A step of the mean, in units of a byte, that comes near the goal: an error of the mean counts in the matrices by the squares of three
    /// hat functions, a sixth in the mean, and each corner's maps add about a third of it. A step's squared error is a twelfth.
    fn guess(&self, terms: u32) -> f64 {
        let of_raw = self.raw.1.psnr_of_terms.get(terms as usize).copied().unwrap_or(self.raw.1.psnr);
        let error = |psnr: f64| 10f64.powf(-psnr / 10.0);
        let allowed = (error(self.goal) - error(of_raw)).max(error(EXACT));
        255.0 * (2.0 * 12.0 * allowed).sqrt()
    }

    /// The first `terms` terms with the coarsest step that reaches the goal, or the finest where none does.
    fn with_terms(&self, terms: u32, job: &mut Job<'_>) -> Result<Measurement, EncodeError> {
        let Store { scene, params, cancel, .. } = *self.store;
        let guess = self.guess(terms);
        let drawn = job.install(|| self.drawn(guess))?;
        let sources = Sources::of(&drawn, terms)?;
        let encoders = job.install(|| sources.encoders(cancel))?;
        let sampled = |texture: &LightTexture| quality::sampled(scene, texture, cancel).min(EXACT);
        let mut wanted = self.goal + MARGIN;
        if terms == params.terms {
            // A share of the samples may be easier than all.
            wanted += job.install(|| sampled(self.raw.0)) - self.raw.1.psnr.min(EXACT);
        }
        let mut first = Quantiser::nearest_step(guess);
        let mut best = None;
        for _ in 0..SEARCHES {
            let found = search_step(Goal::Psnr(wanted), STEPS, first, |step| {
                job.stage("coding blocks", 0.9)?;
                let payload = job.install(|| encoders.at_step(step))?;
                let texture = LightTexture::new(drawn.parts(scene, params, terms, payload), Notes::default());
                let psnr = job.install(|| sampled(&texture));
                job.checkpoint()?;
                Ok::<_, EncodeError>(((texture, step), Measured { psnr, ..Measured::default() }))
            })?;
            let (texture, step) = found.ok_or(SourceError::Empty)?.value;
            let measured = job.install(|| quality::measure(scene, &texture, cancel));
            job.checkpoint()?;
            let missing = self.goal - measured.psnr;
            best = Some((texture, measured));
            if missing <= 0.0 || step == 0 {
                break;
            }
            (wanted, first) = (wanted + missing + MARGIN, step);
        }
        let best = best.ok_or(SourceError::Empty)?;
        self.finer(
            best,
            first,
            |step| encoders.at_step(step).map(|payload| drawn.parts(scene, params, terms, payload)),
            job,
        )
    }

    /// What was found where it reaches the goal over all samples, else finer and finer steps from `step` on until one does.
    fn finer(
        &self,
        found: Measurement,
        step: u16,
        at_step: impl Fn(u16) -> Result<Parts, EncodeError> + Sync,
        job: &mut Job<'_>,
    ) -> Result<Measurement, EncodeError> {
        let Store { scene, cancel, .. } = *self.store;
        let (mut found, mut step, mut stride) = (found, step, FIRST_STRIDE);
        while found.1.psnr < self.goal && step > 0 {
            step = step.saturating_sub(stride);
            stride *= 2;
            let texture = LightTexture::new(job.install(|| at_step(step))?, Notes::default());
            let measured = job.install(|| quality::measure(scene, &texture, cancel));
            job.checkpoint()?;
            found = (texture, measured);
        }
        Ok(found)
    }

    /// Maps as they are coded with a step of about that size.
    fn drawn(&self, step: f64) -> Result<Drawn, EncodeError> {
        let Store { scene, params, maps, books, cancel } = *self.store;
        let part = (step / LEAST_STEP).powi(2).clamp(LEAST_PART, 1.0) as f32;
        let alike = params.storage.codewords < 1.0;
        maps.levelled(&scene.mesh.triangles, params.model.factors, part, alike)
            .drawn(scene, params, books, cancel)
    }
}

/// Some rows of an atlas; texels that no map reads cost next to nothing.
fn source(canvas: &Canvas, first: u32, size: ImageSize) -> Result<DctSource, SourceError> {
    let texels = size.width as usize * size.height as usize;
    let start = first as usize * size.width as usize;
    let part = start..start + texels;
    let source = DctSource::from_u8(size, &[3], canvas.texels[part.clone()].as_flattened())?;
    Ok(source.with_free_colours_but(usize::from(PIXEL.channels), &canvas.is_read[part]))
}

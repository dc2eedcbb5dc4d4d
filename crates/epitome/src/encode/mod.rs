//! The encoder on one page: content at all scales, leaves from their own place, matches elsewhere, palettes, and leaves chosen
//! by rate and distortion; then a second search among the content that was kept.

mod assemble;
mod candidate;
mod choose;
mod leaf;
mod linear;
mod options;
mod pack;
mod pyramid;
mod report;
mod search;
mod tone;

use texfold_bc::Content;
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::metric::measure;
use texfold_core::target::search as find;
use texfold_core::{EncodeError, Goal, Job, Notes, ParamError, Params, SourceError, SurfaceSize};

use assemble::{Plan, assemble};
use candidate::{Match, ScaleErrors};
use choose::{Choice, Costs, Options, choose, most_errors};
use leaf::Grid;
use options::{Palettes, all_options, direct_options};
use pyramid::{SCALES, Space};
use search::{Allowed, Reach, search};

use crate::{EpitomeParams, EpitomeSource, EpitomeTexture};

/// Longest side of an image in texels that a file can name.
const MAX_SIDE: u32 = 1 << 15;
/// Side of a block whose leaves are chosen by rate and distortion.
const BLOCK: u32 = 32;
/// Bits of an entry that the choice reckons with.
const ENTRY_BITS: f32 = 40.0;
/// Times that matches are searched for.
const PASSES: usize = 2;
/// Most linear parts and tones.
const PALETTES: (usize, usize) = (256, 64);
/// Settings of lambda: 32 an octave.
const KNOBS: std::ops::RangeInclusive<u32> = 1..=544;

/// Error that a bit may cost at setting `knob`, 8-bit squared units.
fn lambda(knob: u32) -> f32 {
    (14.0 - knob as f32 / 32.0).exp2()
}

/// What does not depend on the goal.
#[derive(Debug)]
pub(crate) struct Searched {
    space: Space,
    grid: Grid,
    direct: Options,
    own: Vec<ScaleErrors>,
    matches: Vec<Vec<Match>>,
    cell_bits: Vec<f32>,
}

pub(crate) fn encode(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    job: &mut Job<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    params.check()?;
    check_sizes(source)?;
    let mut searched = job.within(0.0, 0.2, |job| store(source, params, job))?;
    job.within(0.2, 0.7, |job| searched.search(source, params, job))?;
    job.within(0.7, 1.0, |job| finish(source, &searched, params, job))
}

fn check_sizes(source: EpitomeSource<'_>) -> Result<(), SourceError> {
    for (index, image) in source.images.images().iter().enumerate() {
        let SurfaceSize { width, height } = image.size();
        if width > MAX_SIDE || height > MAX_SIDE {
            return Err(SourceError::TooLarge { index, width, height, max: MAX_SIDE });
        }
    }
    Ok(())
}

/// Formats that content is stored in.
fn contents(pixel: PixelInfo, asked: Option<Content>) -> Result<Vec<Content>, ParamError> {
    if let Some(content) = asked {
        let value = f64::from(pixel.channels);
        let error = ParamError { field: "channels", value, range: "what the chosen content format can hold" };
        return if content.fits(pixel) { Ok(vec![content]) } else { Err(error) };
    }
    Ok(match pixel.channels {
        1 => vec![Content::Bc4],
        2 => vec![Content::Bc5],
        3 if pixel.color == ColorSpace::Normal => vec![Content::Bc5],
        _ => vec![Content::Bc1, Content::Bc7],
    })
}

/// Content at all scales, and leaves from their own place.
fn store(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    job: &mut Job<'_>,
) -> Result<Searched, EncodeError> {
    job.stage("storing content", 0.0)?;
    let contents = contents(source.images.info(), params.content)?;
    let sizes: Vec<SurfaceSize> = source.images.images().iter().map(|image| image.size()).collect();
    let (space, grid, direct, own) = job.install(|| {
        let space = Space::new(source.images, BLOCK, &contents, SCALES.len(), params.effort);
        let grid = Grid::new(&sizes, BLOCK, true);
        let (direct, own) = direct_options(&space, &grid);
        (space, grid, direct, own)
    });
    let matches = vec![Vec::new(); grid.nodes()];
    let cell_bits = space.stored.iter().map(|stored| stored.cell_bits as f32).collect();
    Ok(Searched { space, grid, direct, own, matches, cell_bits })
}

impl Searched {
    fn costs(&self, knob: u32) -> Costs<'_> {
        Costs {
            lambda: lambda(knob),
            entry_bits: ENTRY_BITS,
            cell_bits: &self.cell_bits,
            cells: self.space.cells,
        }
    }

    fn choose(&self, options: &Options, knob: u32) -> Choice {
        choose(&self.grid, options, self.costs(knob), self.space.stored.len())
    }

    fn options(&self) -> (Options, Palettes) {
        all_options(&self.space, &self.grid, &self.direct, &self.matches, PALETTES)
    }

    /// Looks for matches in the content that is kept so far, then again in what is kept with them.
    fn search(
        &mut self,
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        job: &mut Job<'_>,
    ) -> Result<(), EncodeError> {
        let texels = source.images.texel_count();
        let reach = Reach::of(params.effort, texels);
        for pass in 0..PASSES {
            let share = |pass: usize| pass as f32 / PASSES as f32;
            job.stage("choosing content", share(pass))?;
            let (choice, errors) = job.install(|| {
                let options = if pass == 0 { None } else { Some(self.options().0) };
                let options = options.as_ref().unwrap_or(&self.direct);
                let knob = nearest_knob(params.goal, texels as f64, |knob| self.choose(options, knob));
                let choice = self.choose(options, knob);
                (choice, most_errors(&self.grid, &self.direct, self.costs(knob)))
            });
            let kept: Vec<bool> = choice.users.iter().map(|&users| users > 0).collect();
            let allowed = Allowed { cells: Some(&kept), errors: &errors, own: &self.own };
            job.within(share(pass), share(pass + 1), |job| {
                search(&self.space, &self.grid, reach, &allowed, &mut self.matches, job)
            })?;
        }
        Ok(())
    }
}

/// The setting that the sums of error and bits say reaches the goal.
fn nearest_knob(goal: Goal, texels: f64, mut choose: impl FnMut(u32) -> Choice) -> u32 {
    let (mut low, mut high) = (*KNOBS.start(), *KNOBS.end());
    while low < high {
        let middle = (low + high) / 2;
        let choice = choose(middle);
        let psnr = 10.0 * (255.0 * 255.0 * 3.0 * texels / choice.error.max(1e-9)).log10();
        let enough = match goal {
            Goal::Psnr(wanted) => psnr >= wanted,
            Goal::Bpp(bpp) => choice.bits / texels >= bpp,
            Goal::Tolerance(tolerance) => psnr >= 20.0 * (255.0 / tolerance).log10() + 6.0,
        };
        if enough {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

/// The setting that reaches the goal on the shipped form.
fn finish(
    source: EpitomeSource<'_>,
    searched: &Searched,
    params: &EpitomeParams,
    job: &mut Job<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    job.stage("fitting palettes", 0.0)?;
    let texels = source.images.texel_count() as f64;
    let (options, palettes, guess) = job.install(|| {
        let (options, palettes) = searched.options();
        let guess = nearest_knob(params.goal, texels, |knob| searched.choose(&options, knob));
        (options, palettes, guess)
    });
    let plan = Plan {
        images: source.images,
        space: &searched.space,
        grid: &searched.grid,
        options: &options,
        palettes: &palettes,
        mips: params.mips,
        effort: params.effort,
    };
    let mut tried = 0u16;
    let found = find(params.goal, KNOBS, guess, 0.0, |knob| {
        job.stage("packing", (0.3 + 0.05 * f32::from(tried)).min(0.95))?;
        tried += 1;
        let made = job.install(|| {
            let choice = searched.choose(&options, knob);
            assemble(&plan, &choice)
        })?;
        Ok::<_, EncodeError>((measure(source.images, &made), made))
    })?;
    let choice = searched.choose(&options, found.knob);
    let verdict = report::verdict(&searched.grid, &options, &choice, found.met);
    let notes = Notes { settings: settings(params), verdict, ..Notes::default() };
    Ok(found.value.with_notes(notes))
}

fn settings(params: &EpitomeParams) -> String {
    let goal = match params.goal {
        Goal::Psnr(value) => format!("psnr {value}"),
        Goal::Bpp(value) => format!("bpp {value}"),
        Goal::Tolerance(value) => format!("tolerance {value}"),
    };
    let content = params.content.map_or(String::new(), |content| format!(", content {}", content.name()));
    format!("epitome, {goal}{content}")
}

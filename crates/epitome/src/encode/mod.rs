//! The encoder on one page: content at all scales, leaves from their own place, matches elsewhere, palettes, and leaves chosen
//! by rate and distortion; then a second search among the content that was kept. Images above 2 megapixels are searched part by part
//! at first (paper section 4.5).

mod assemble;
mod candidate;
mod choose;
mod growth;
mod ladder;
mod leaf;
mod linear;
mod mask;
mod options;
mod pack;
mod pyramid;
mod refit;
mod regroup;
mod report;
mod search;
mod strip;
mod tone;
mod turn;

use std::ops::RangeInclusive;

use texfold_bc::{Bc1Blocks, Content, Family};
use texfold_core::image::{ColorSpace, ImageSet, PixelInfo, Raster};
use texfold_core::metric::measure;
use texfold_core::target::{Measured, search as find};
use texfold_core::{
    AstcBlock, EncodeError, Goal, Job, Notes, ParamError, Params, PlaneFormat, SourceError, SurfaceSize,
};

use assemble::{Plan, assemble};
use candidate::{Match, Rules};
use choose::{Choice, Costs, Options, choose, choose_well, improve, most_errors};
use growth::grow;
use leaf::Grid;
use options::{Fitted, Palettes, Placing, all_options, direct_options, fit, weighed};
use pyramid::{LEAST_SIDE, SCALES, SCALES_ALONE, Space, Storage};
use refit::CellCache;
use search::{Allowed, Reach, search};
use strip::with_widest_strip;

use crate::{EpitomeParams, EpitomeSource, EpitomeTexture};

/// Side of a block whose leaves are chosen by rate and distortion: the first whose smallest leaves are whole cells of all
/// formats, where cells are larger than 4x4 texels; else the last.
const BLOCKS: [u32; 3] = [64, 48, 32];
/// Bits of an entry that the choice reckons with.
const ENTRY_BITS: f32 = 40.0;
/// Times that matches are searched for.
const PASSES: usize = 2;
/// Most linear parts and tones.
const PALETTES: (usize, usize) = (256, 64);
/// Models that are tried for goals of quality and size. Small palettes are upright: fitted ones of 32 linear parts were never
/// smaller on five photographs, and of 8, 16 and 32 tones 16 were best on the whole.
const MODELS: [Form; 3] = [
    Form { linears: Linears::Fitted(PALETTES.0), tones: PALETTES.1, entry_bits: ENTRY_BITS },
    Form { linears: Linears::Upright, tones: 16, entry_bits: 32.0 },
    Form { linears: Linears::Own, tones: 1, entry_bits: 24.0 },
];
/// Nodes for each number of a palette at least.
const NODES_A_NUMBER: usize = 16;
/// The same for tolerances, where content is raw and a number that saves a block saves far more.
const NODES_A_NUMBER_WITHIN: usize = 2;
/// ASTC content that is tried: at 1.7 bits a texel 6x6 is better than 8x8 by 2 dB where much repeats, and worse by as much as
/// 0.8 dB where little does. *Not taken*: 8x8 and 4x4 side by side, which is within 0.2 dB of 8x8 alone up to 1.3 bits, and at
/// 1.7 bits 0.8 dB below 6x6 where that is better.
const ASTC: [AstcBlock; 2] = [AstcBlock::B8, AstcBlock::B6];
/// Steps beyond the setting that reaches a goal at which smaller results are looked for.
const FINER: [u32; 4] = [6, 16, 40, 90];
/// A factor of memory, and dB, that finer settings are taken not to make up for: four crops came out the same.
const FAR: (f64, f64) = (1.03, 0.3);
/// Steps where content has an error map: it is coded anew at each setting.
const FINER_WITH_ERRORS: [u32; 1] = [12];
/// Price of a bit that content with an error map is first made for, in mean squared errors of a texel.
const FIRST_PRICE: f64 = 0.9;
/// Largest step of that price at a time, as a factor.
const MOST_RETUNED: f64 = 4.0;
/// A change of that price that is not worth storing content anew, as a factor.
const LEAST_RETUNED: f32 = 1.05;
/// Settings of lambda: 32 an octave.
const KNOBS: RangeInclusive<u32> = 1..=544;

/// Price that content with an error map is first made for where a size is asked for.
const FIRST_GUESS: f32 = 40.0;

/// Times that a file of several layers is made for a goal of bits, and the share of what it is over that is taken off.
const BPP_TRIES: u32 = 4;
const BPP_STEP: f64 = 1.1;

/// The setting under which only bits count, for tolerances: within them errors are free.
const TOLERANCE_KNOB: u32 = 96;
/// Most linear parts where charts are turned to fit: each may be needed in eight turns.
const TURNED_LINEARS: usize = 32;
/// Side of a block for tolerances where none is given (paper section 4).
const TOLERANCE_BLOCK: u32 = 12;
/// Side of all leaves where there is no quadtree and none is given.
const FIXED_BLOCK: u32 = 16;
/// Times that matches are searched for within a tolerance, by effort: each search is in what the one before has led to.
const TOLERANCE_PASSES: [usize; 3] = [2, 3, 6];
/// Shares of the tolerance that candidates are held to.
const TOLERANCE_SHARES: [f32; 3] = [1.0, 0.75, 0.4];

/// Error that a bit may cost at setting `knob`, 8-bit squared units.
fn lambda(knob: u32) -> f32 {
    (14.0 - knob as f32 / 32.0).exp2()
}

/// The setting nearest to a price.
fn knob_of(lambda: f32) -> u32 {
    let knob = (32.0 * (14.0 - lambda.log2())).round().max(0.0) as u32;
    knob.clamp(*KNOBS.start(), *KNOBS.end())
}

/// What was searched, for encoding with several goals.
#[derive(Debug)]
pub struct EpitomeSearch {
    images: ImageSet,
    params: EpitomeParams,
    space: Space,
    grid: Grid,
    /// Cells that content may come from.
    allowed: Option<Vec<bool>>,
    matches: Vec<Vec<Match>>,
    /// Where content is fitted to its readers. Not within tolerances, which hold for content as it is; nor content that must
    /// come from a part of the images or from their own blocks.
    refit: Option<CellCache>,
    /// Bits of a cell and number of cells, by format.
    cell_bits: Vec<f32>,
    cells: Vec<u32>,
    /// Where cells differ in bits: those of each, in bits of a cell of its format.
    shares: Vec<f32>,
    /// Where content has an error map: the price of a bit that it was coded at.
    price: Option<f32>,
    /// The same images with other content, of which the goal will choose.
    other: Option<Box<EpitomeSearch>>,
}

/// Linear parts that leaves have in a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Linears {
    /// At most so many, fitted to the matches.
    Fitted(usize),
    /// Those of content as it stands, plain and mirrored.
    Upright,
    /// Leaves show their own content alone.
    Own,
}

/// A model that is tried.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Form {
    linears: Linears,
    /// Most tones.
    tones: usize,
    /// Bits of an entry that the choice reckons with, which are fewer with smaller palettes.
    entry_bits: f32,
}

/// What leaves may be with palettes of some size.
struct Model {
    options: Options,
    palettes: Palettes,
    /// Bits of an entry that the choice reckons with.
    entry_bits: f32,
}

/// A setting, what it measures and what it makes.
type Made = (u32, Measured, EpitomeTexture);

/// What a model makes for a goal.
struct Answer {
    model: Form,
    made: Made,
    verdict: String,
}

/// Searches `source` with the goal of `params` in mind.
pub(crate) fn search_all(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    job: &mut Job<'_>,
) -> Result<EpitomeSearch, EncodeError> {
    params.check()?;
    let alone = params.content.is_some() || matches!(params.goal, Goal::Tolerance(_));
    if params.family != Family::Astc || alone {
        return search_one(source, params, job);
    }
    let [first, second] =
        ASTC.map(|block| EpitomeParams { content: Some(Content::Astc(block)), ..params.clone() });
    let mut searched = job.within(0.0, 0.5, |job| search_one(source, &first, job))?;
    let other = job.within(0.5, 1.0, |job| search_one(source, &second, job))?;
    searched.other = Some(Box::new(other));
    Ok(searched)
}

/// As [`search_all`], with the content of `params` or what is usual.
fn search_one(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    job: &mut Job<'_>,
) -> Result<EpitomeSearch, EncodeError> {
    source.images.check_sides()?;
    check_blocks(source)?;
    let mut searched = job.within(0.0, 0.3, |job| store(source, params, job))?;
    job.within(0.3, 1.0, |job| searched.search(job))?;
    Ok(searched)
}

/// The shipped form for a goal.
pub(crate) fn encode_from(
    searched: &EpitomeSearch,
    goal: Goal,
    job: &mut Job<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    goal.check()?;
    EpitomeParams { goal, ..searched.params.clone() }.check()?;
    let Some(other) = &searched.other else { return searched.encode(goal, job) };
    let first = job.within(0.0, 0.5, |job| searched.encode(goal, job))?;
    let second = job.within(0.5, 1.0, |job| other.encode(goal, job))?;
    let (of_first, of_second) = (measure(&searched.images, &first), measure(&searched.images, &second));
    Ok(if goal.prefers(&of_second, &of_first) { second } else { first })
}

/// Whether blocks that are to be taken over are those of the images.
fn check_blocks(source: EpitomeSource<'_>) -> Result<(), SourceError> {
    let Some(blocks) = source.blocks else { return Ok(()) };
    let images = source.images.images();
    let needed = |size: SurfaceSize| PlaneFormat::Bc1.bytes(size.width, size.height) as usize;
    let sum = |sizes: &mut dyn Iterator<Item = SurfaceSize>| sizes.map(needed).sum::<usize>();
    let needed_of = |(blocks, image): (&Bc1Blocks, &Raster)| {
        blocks.size == image.size() && blocks.blocks.len() == needed(blocks.size)
    };
    if blocks.len() == images.len() && blocks.iter().zip(images).all(needed_of) {
        return Ok(());
    }
    let found = blocks.iter().map(|blocks| blocks.blocks.len()).sum();
    Err(SourceError::Length { found, needed: sum(&mut images.iter().map(Raster::size)) })
}

/// How content is stored.
fn storages(pixel: PixelInfo, params: &EpitomeParams) -> Result<Vec<Storage>, ParamError> {
    if params.family != Family::ErrorMap || params.content.is_some() {
        return Ok(contents(pixel, params)?.into_iter().map(Storage::Planes).collect());
    }
    let price = match params.goal {
        Goal::Psnr(psnr) => 3.0 * 255.0 * 255.0 * FIRST_PRICE / 10f64.powf(psnr / 10.0),
        // Tolerances have no error map.
        Goal::Bpp(_) | Goal::Tolerance(_) => f64::from(FIRST_GUESS),
    };
    if !matches!(pixel.channels, 1 | 3) || pixel.color == ColorSpace::Normal {
        return Err(ParamError::new("channels", pixel.channels, "1 or 3 of colours, with an error map"));
    }
    // Hard edges between two colours are better off in plain blocks, all else by an error map. Both in one texture need the same
    // channels.
    let plain = (pixel.channels == 3).then_some(Storage::Planes(Content::Bc1));
    Ok(plain.into_iter().chain([Storage::ErrorMap(price as f32)]).collect())
}

/// Formats that content is stored in.
fn contents(pixel: PixelInfo, params: &EpitomeParams) -> Result<Vec<Content>, ParamError> {
    // Blocks of a compressed format may break a tolerance by themselves.
    let usual = matches!(params.goal, Goal::Tolerance(_)).then_some(Content::Raw);
    if let Some(content) = params.content.or(usual) {
        let error = ParamError::new("channels", pixel.channels, "what the chosen content format can hold");
        return if content.fits(pixel) { Ok(vec![content]) } else { Err(error) };
    }
    Ok(match pixel.channels {
        1 => vec![Content::Bc4],
        2 => vec![Content::Bc5],
        3 if pixel.color == ColorSpace::Normal => vec![Content::Bc5],
        _ => vec![Content::Bc1, Content::Bc7],
    })
}

/// Side of a block for such content.
fn block_of(storages: &[Storage]) -> u32 {
    let side = |storage: &Storage| match storage {
        Storage::Planes(content) => content.cell_side(),
        Storage::ErrorMap(_) => 4,
    };
    let whole = |block: u32| storages.iter().all(|storage| (block / 4).is_multiple_of(side(storage)));
    let large = storages.iter().any(|storage| side(storage) > 4);
    BLOCKS.into_iter().find(|&block| large && whole(block)).unwrap_or(BLOCKS[2])
}

/// Content at all scales.
fn store(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    job: &mut Job<'_>,
) -> Result<EpitomeSearch, EncodeError> {
    job.stage("storing content", 0.0)?;
    let images = source.images.clone();
    let storages = storages(images.info(), params)?;
    let sizes: Vec<SurfaceSize> = images.images().iter().map(|image| image.size()).collect();
    let scales = match params.transforms.scales {
        false => 1,
        true if params.layers > 1 => SCALES.len(),
        true => SCALES_ALONE,
    };
    let (grid, scales) = match params.goal {
        Goal::Tolerance(_) => (Grid::new(&sizes, params.block.unwrap_or(TOLERANCE_BLOCK), false), 1),
        _ if params.transforms.quadtree => (Grid::new(&sizes, block_of(&storages), true), scales),
        _ => (Grid::new(&sizes, params.block.unwrap_or(FIXED_BLOCK), false), scales),
    };
    // Content at a quarter of its size has whole cells too.
    let padding = if scales > 1 && grid.block % (4 * LEAST_SIDE) != 0 { 4 * grid.block } else { grid.block };
    let space = job
        .install(|| Space::new(&images, source.blocks, padding, &storages, scales, params.effort))
        .ok_or(SourceError::Full { what: "a plane of 8192 x 8192 words" })?;
    let allowed = source.content_from.map(|mask| mask::allowed_cells(&space, mask)).transpose()?;
    let matches = vec![Vec::new(); grid.nodes()];
    let price = storages.iter().find_map(|storage| match storage {
        Storage::ErrorMap(price) => Some(*price),
        Storage::Planes(_) => None,
    });
    let cells = space.stored.iter().map(|stored| stored.cells).collect();
    let is_free = source.content_from.is_none() && source.blocks.is_none();
    let refit = (is_free && !matches!(params.goal, Goal::Tolerance(_))).then(CellCache::default);
    Ok(EpitomeSearch {
        images,
        cell_bits: space.cell_bits(),
        shares: space.shares(),
        refit,
        params: params.clone(),
        space,
        grid,
        allowed,
        matches,
        cells,
        price,
        other: None,
    })
}

impl EpitomeSearch {
    fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<EpitomeTexture, EncodeError> {
        job.stage("fitting palettes", 0.0)?;
        match goal {
            Goal::Tolerance(tolerance) => self.within(tolerance, job),
            Goal::Psnr(_) | Goal::Bpp(_) => self.reaching(goal, job),
        }
    }

    fn costs(&self, entry_bits: f32, knob: u32) -> Costs<'_> {
        Costs {
            lambda: lambda(knob),
            entry_bits,
            cell_bits: &self.cell_bits,
            shares: &self.shares,
            cells: &self.cells,
            others: None,
        }
    }

    /// Whether every block is to be covered within a tolerance.
    fn covers_blocks(&self) -> bool {
        matches!(self.params.goal, Goal::Tolerance(_))
    }

    fn choose(&self, options: &Options, knob: u32) -> Choice {
        choose(&self.grid, options, self.costs(ENTRY_BITS, knob))
    }

    fn rules(&self, tolerance: Option<f32>) -> Rules<'_> {
        Rules {
            cells: self.allowed.as_deref(),
            tolerance,
            refits: self.refit.is_some() && self.params.layers <= 1,
        }
    }

    /// Palettes fitted to what has been found so far.
    fn fitted(&self, matches: &[Vec<Match>], linears: Linears, tones: usize) -> Fitted {
        // A palette must earn its bits: an entry for every few leaves.
        let few =
            self.grid.nodes() / if self.covers_blocks() { NODES_A_NUMBER_WITHIN } else { NODES_A_NUMBER };
        let transforms = self.params.transforms;
        let tones = if transforms.tones { tones.min(1 + few) } else { 1 };
        let scales = self.space.scales();
        let mut palette = match linears {
            Linears::Fitted(most) => {
                linear::fitted(&weighed(&self.grid, matches), scales, most.min(scales + 1 + few))
            }
            Linears::Upright => linear::upright(scales, transforms.mirrors),
            Linears::Own => linear::upright(scales, false),
        };
        if self.allowed.is_some() {
            // Leaves that look like nothing that is allowed show one colour.
            palette.truncate(PALETTES.0 - 1);
            palette.push([0; 4]);
        }
        let placing = Placing { fractions: transforms.fractions, turned: linears != Linears::Upright };
        fit(&self.space, &self.grid, matches, (palette, tones), placing)
    }

    /// All that leaves may be.
    fn options(&self, matches: &[Vec<Match>], fitted: &Fitted, rules: &Rules<'_>) -> Options {
        let (direct, _) = direct_options(&self.space, &self.grid, rules);
        all_options(&self.space, &self.grid, &direct, (matches, fitted), rules)
    }

    /// All that leaves may be with everything that was found, and palettes as large as they may be.
    fn whole(&self, rules: &Rules<'_>) -> (Options, Palettes) {
        let fitted = self.fitted(&self.matches, Linears::Fitted(PALETTES.0), PALETTES.1);
        (self.options(&self.matches, &fitted, rules), fitted.palettes)
    }

    /// Looks for matches in the content that is kept so far, then again in what is kept with them. Within a tolerance, and
    /// where content is restricted, any content may be kept.
    fn search(&mut self, job: &mut Job<'_>) -> Result<(), EncodeError> {
        if !self.params.transforms.references {
            return Ok(());
        }
        let texels = self.images.texel_count();
        let reach = Reach::of(&self.params, texels);
        let (direct, own) = job.install(|| direct_options(&self.space, &self.grid, &Rules::default()));
        if self.covers_blocks() || self.allowed.is_some() {
            let errors = self.any_errors();
            let allowed =
                Allowed { cells: self.allowed.as_deref(), shared: None, errors: &errors, own: &own };
            // The part that content is to come from may lie anywhere.
            let reach = Reach { part: reach.part.filter(|_| self.allowed.is_none()), ..reach };
            search(&self.space, &self.grid, reach, &allowed, &mut self.matches, job)?;
            let (Goal::Tolerance(tolerance), None) = (self.params.goal, &self.allowed) else { return Ok(()) };
            for _ in 1..TOLERANCE_PASSES[self.params.effort as usize] {
                let rules = self.rules(Some(tolerance as f32));
                let kept = job.install(|| {
                    let covers = self.covers(&self.whole(&rules).0);
                    covers.into_iter().min_by(|a, b| a.bits.total_cmp(&b.bits))
                });
                let users: Vec<u32> = kept.map(|kept| kept.users).unwrap_or_default();
                let kept: Vec<bool> = users.iter().map(|&users| users > 0).collect();
                let shared: Vec<bool> = users.iter().map(|&users| users > 1).collect();
                let allowed =
                    Allowed { cells: Some(&kept), shared: Some(&shared), errors: &errors, own: &own };
                let reach = Reach { part: None, ..reach };
                search(&self.space, &self.grid, reach, &allowed, &mut self.matches, job)?;
            }
            return Ok(());
        }
        for pass in 0..PASSES {
            let share = |pass: usize| pass as f32 / PASSES as f32;
            job.stage("choosing content", share(pass))?;
            if pass > 0 {
                job.install(|| self.retune());
            }
            let (choice, errors) = job.install(|| {
                let options = (pass > 0).then(|| self.whole(&self.rules(None)).0);
                let options = options.as_ref().unwrap_or(&direct);
                let knob = self.likely_knob(self.params.goal, |knob| self.choose(options, knob));
                (
                    choose_well(&self.grid, options, self.costs(ENTRY_BITS, knob)),
                    most_errors(&self.grid, &direct, self.costs(ENTRY_BITS, knob)),
                )
            });
            let kept: Vec<bool> = choice.users.iter().map(|&users| users > 0).collect();
            let shared: Vec<bool> = choice.users.iter().map(|&users| users > 1).collect();
            let allowed = Allowed { cells: Some(&kept), shared: Some(&shared), errors: &errors, own: &own };
            // What parts of large images keep of their own is then searched as a whole.
            let reach = Reach { part: reach.part.filter(|_| pass == 0), ..reach };
            job.within(share(pass), share(pass + 1), |job| {
                search(&self.space, &self.grid, reach, &allowed, &mut self.matches, job)
            })?;
        }
        job.install(|| self.retune());
        Ok(())
    }

    /// Where content has an error map: codes it anew at the price that the goal seems to ask for.
    fn retune(&mut self) {
        let Some(price) = self.price else { return };
        let texels = self.images.texel_count() as f64;
        let choice = self.choose(&self.whole(&self.rules(None)).0, knob_of(price));
        let factor = match self.params.goal {
            Goal::Psnr(wanted) => 10f64.powf((choice.psnr(texels) - wanted) / 10.0),
            Goal::Bpp(bpp) => (choice.bits / texels / bpp).powi(2),
            Goal::Tolerance(_) => 1.0,
        };
        let factor = factor.clamp(1.0 / MOST_RETUNED, MOST_RETUNED) as f32;
        if factor.max(1.0 / factor) < LEAST_RETUNED {
            return;
        }
        if self.space.store_again(price * factor).is_some() {
            self.cell_bits = self.space.cell_bits();
            self.shares = self.space.shares();
            self.price = Some(price * factor);
        }
    }

    /// The setting that should reach a goal.
    fn likely_knob(&self, goal: Goal, choose: impl FnMut(u32) -> Choice) -> u32 {
        let texels = self.images.texel_count() as f64;
        self.price.map_or_else(|| nearest_knob(goal, texels, choose), knob_of)
    }

    /// For each node the squared error that a match may have: what the tolerance allows, or any.
    fn any_errors(&self) -> Vec<f32> {
        let most = match self.params.goal {
            Goal::Tolerance(tolerance) => 3.0 * (tolerance * tolerance) as f32,
            Goal::Psnr(_) | Goal::Bpp(_) => 3.0 * 255.0 * 255.0,
        };
        (0..self.grid.nodes()).map(|index| most * (self.grid.node(index).side.pow(2)) as f32).collect()
    }

    fn plan<'a>(&'a self, options: &'a Options, palettes: &'a Palettes, entry_bits: f32) -> Plan<'a> {
        Plan {
            images: &self.images,
            space: &self.space,
            grid: &self.grid,
            options,
            palettes,
            entry_bits,
            mips: self.params.mips,
            effort: self.params.effort,
            turns: false,
            refit: self.refit.as_ref(),
        }
    }

    /// The form that answers a goal of quality or size.
    fn reaching(&self, goal: Goal, job: &mut Job<'_>) -> Result<EpitomeTexture, EncodeError> {
        let models: Vec<&Form> = MODELS.iter().filter(|model| self.may_be(model)).collect();
        let mut best: Option<Answer> = None;
        for (index, &&model) in models.iter().enumerate() {
            let share = |index: usize| index as f32 / models.len() as f32;
            let beaten = best.as_ref().map(|best| &best.made);
            let answer =
                job.within(share(index), share(index + 1), |job| self.answer(goal, model, beaten, job))?;
            if best.as_ref().is_none_or(|best| goal.prefers(&answer.made.1, &best.made.1)) {
                best = Some(answer);
            }
        }
        // Without matches there is the model of own content.
        let Some(best) = best else { return Err(EncodeError::Cancelled) };
        if self.params.layers > 1 {
            return self.in_layers(goal, best, job);
        }
        let made = job.install(|| with_widest_strip(&self.images, best.made.2));
        Ok(made.with_notes(self.notes(goal, best.verdict)))
    }

    /// The best that one model makes for a goal.
    fn answer(
        &self,
        goal: Goal,
        model: Form,
        beaten: Option<&Made>,
        job: &mut Job<'_>,
    ) -> Result<Answer, EncodeError> {
        let Model { options, palettes, entry_bits } = job.install(|| self.model(model));
        let made = self.setting(goal, &self.plan(&options, &palettes, entry_bits), beaten, job)?;
        let choice = choose_well(&self.grid, &options, self.costs(entry_bits, made.0));
        let verdict = report::verdict(&self.grid, &options, &choice, goal.is_met(&made.1));
        Ok(Answer { model, made, verdict })
    }

    /// An answer made again in several layers.
    fn in_layers(&self, goal: Goal, best: Answer, job: &mut Job<'_>) -> Result<EpitomeTexture, EncodeError> {
        // What leaves may be is found again: that of two models at once would be most of the memory.
        let Model { options, palettes, entry_bits } = job.install(|| self.model(best.model));
        let plan = self.plan(&options, &palettes, entry_bits);
        let (mut wanted, mut tries, mut found) = (goal, 1, Some(best.made));
        loop {
            let (knob, measured, made) = match found.take() {
                Some(found) => found,
                None => self.setting(wanted, &plan, None, job)?,
            };
            let choice = choose_well(&self.grid, &options, self.costs(entry_bits, knob));
            let met = goal.is_met(&measured);
            let verdict = report::verdict(&self.grid, &options, &choice, met);
            let (made, measured) = self.layered(&plan, &made, (choice, knob), job)?;
            // What coarser layers alone read takes room too.
            if let (Goal::Bpp(bpp), Goal::Bpp(before)) = (goal, wanted)
                && met
                && measured.bpp > bpp
                && tries < BPP_TRIES
            {
                wanted = Goal::Bpp((before - BPP_STEP * (measured.bpp - bpp)).max(0.5 * before));
                tries += 1;
                continue;
            }
            let made = job.install(|| with_widest_strip(&self.images, made));
            let (reached, psnr_without) = self.measure_layers(&made, &measured);
            let notes = self.notes(goal, verdict + &reached);
            return Ok(made.with_notes(Notes { psnr_without, ..notes }));
        }
    }

    /// Whether a model makes sense.
    fn may_be(&self, model: &Form) -> bool {
        let transforms = self.params.transforms;
        // Where content is restricted, most leaves have none of their own.
        let any = self.allowed.is_none();
        match model.linears {
            Linears::Own => any || !transforms.references,
            Linears::Upright => transforms.references && any,
            Linears::Fitted(most) => transforms.references && (any || most == PALETTES.0),
        }
    }

    /// What leaves may be in a model.
    fn model(&self, model: Form) -> Model {
        let none = vec![Vec::new(); self.grid.nodes()];
        let matches = if model.linears == Linears::Own { &none } else { &self.matches };
        let fitted = self.fitted(matches, model.linears, model.tones);
        let options = self.options(matches, &fitted, &self.rules(None));
        Model { options, palettes: fitted.palettes, entry_bits: model.entry_bits }
    }

    /// The setting that reaches a goal with one layer, and what it makes.
    ///
    /// It is looked for around that of another model's answer, `beaten`; where it is far from that one, finer settings are not
    /// tried.
    fn setting(
        &self,
        goal: Goal,
        plan: &Plan<'_>,
        beaten: Option<&Made>,
        job: &mut Job<'_>,
    ) -> Result<Made, EncodeError> {
        let chosen = |knob: u32| choose_well(&self.grid, plan.options, self.costs(plan.entry_bits, knob));
        let nearly = |knob: u32| choose(&self.grid, plan.options, self.costs(plan.entry_bits, knob));
        let guess = beaten.map_or_else(|| job.install(|| self.likely_knob(goal, nearly)), |before| before.0);
        let mut tried = 0u16;
        let make = |knob: u32| assemble(plan, &[chosen(knob)], lambda(knob));
        let found = find(goal, KNOBS, guess, 0.0, |knob| {
            job.stage("packing", (0.5 + 0.05 * f32::from(tried)).min(0.95))?;
            tried += 1;
            let made = job.install(|| make(knob))?;
            Ok::<_, EncodeError>((measure(&self.images, &made), made))
        })?;
        let mut best = (found.knob, found.measured, found.value);
        if beaten.is_some_and(|before| is_far(goal, &best.1, &before.1)) {
            return Ok(best);
        }
        // What repeats is sometimes gathered better at a finer setting, and is smaller there.
        for &step in if self.price.is_some() { &FINER_WITH_ERRORS[..] } else { &FINER } {
            job.checkpoint()?;
            let finer = (found.knob + step).min(*KNOBS.end());
            let made = job.install(|| make(finer))?;
            let of_made = measure(&self.images, &made);
            if goal.prefers(&of_made, &best.1) {
                best = (finer, of_made, made);
            }
        }
        Ok(best)
    }

    /// The smallest form whose every block is within a tolerance. Charts of more candidates may pack worse than charts of
    /// fewer, so several sets of candidates are packed, and each set is covered in two ways; raw charts also turned to fit,
    /// which takes bits for linear parts.
    fn within(&self, tolerance: f64, job: &mut Job<'_>) -> Result<EpitomeTexture, EncodeError> {
        let goal = Goal::Tolerance(tolerance);
        let mut best: Option<(Measured, EpitomeTexture)> = None;
        let mut share = TOLERANCE_SHARES[0];
        // Charts are turned for the candidates that are best as they are: all of them would take twice the time.
        for turns in [false, true] {
            for tried in if turns { vec![share] } else { TOLERANCE_SHARES.to_vec() } {
                job.checkpoint()?;
                for made in job.install(|| self.covered(tolerance, tried, turns))? {
                    let measured = measure(&self.images, &made);
                    if best.as_ref().is_none_or(|(before, _)| goal.prefers(&measured, before)) {
                        (best, share) = (Some((measured, made)), tried);
                    }
                }
            }
        }
        // Every set of candidates covers the images in at least one way.
        best.map(|(_, made)| made).ok_or(EncodeError::Cancelled)
    }

    /// Forms whose every block is within a tolerance, of candidates held to a `share` of it. Charts are turned to fit where
    /// `turns` says so and content is raw.
    fn covered(&self, tolerance: f64, share: f32, turns: bool) -> Result<Vec<EpitomeTexture>, EncodeError> {
        if turns && self.space.stored.iter().any(|stored| stored.content != Content::Raw) {
            return Ok(Vec::new());
        }
        let linears = Linears::Fitted(if turns { TURNED_LINEARS } else { PALETTES.0 });
        let fitted = self.fitted(&self.matches, linears, PALETTES.1);
        let options = self.options(&self.matches, &fitted, &self.rules(Some(tolerance as f32 * share)));
        let plan = Plan { turns, ..self.plan(&options, &fitted.palettes, ENTRY_BITS) };
        let make = |choice: Choice| {
            let verdict = report::verdict(&self.grid, &options, &choice, true);
            let made = assemble(&plan, &[choice], 0.0)?;
            Ok(made.with_notes(self.notes(Goal::Tolerance(tolerance), verdict)))
        };
        self.covers(&options).into_iter().map(make).collect()
    }

    /// Few cells that cover every block: chosen by prices, and, where blocks have one side, grown greedily and improved.
    fn covers(&self, options: &Options) -> Vec<Choice> {
        let mut covers = vec![self.choose(options, TOLERANCE_KNOB)];
        if !self.grid.split {
            let side = self.space.stored[0].cell;
            let grown = grow(&self.grid, options, self.space.cells(), side * side);
            covers.push(improve(&self.grid, options, self.costs(ENTRY_BITS, TOLERANCE_KNOB), &grown));
        }
        covers
    }

    fn notes(&self, goal: Goal, verdict: String) -> Notes {
        let params = EpitomeParams { goal, ..self.params.clone() };
        Notes { settings: settings(&params), verdict, ..Notes::default() }
    }
}

/// Whether `measured` cannot become better than `other` by what finer settings gain.
fn is_far(goal: Goal, measured: &Measured, other: &Measured) -> bool {
    match goal {
        Goal::Bpp(_) => measured.psnr < other.psnr - FAR.1,
        Goal::Psnr(_) | Goal::Tolerance(_) => measured.bpp > other.bpp * FAR.0,
    }
}

/// The setting that the sums of error and bits say reaches the goal.
fn nearest_knob(goal: Goal, texels: f64, mut choose: impl FnMut(u32) -> Choice) -> u32 {
    let (mut low, mut high) = (*KNOBS.start(), *KNOBS.end());
    while low < high {
        let middle = (low + high) / 2;
        let choice = choose(middle);
        let psnr = choice.psnr(texels);
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

fn settings(params: &EpitomeParams) -> String {
    let goal = match params.goal {
        Goal::Psnr(value) => format!("psnr {value}"),
        Goal::Bpp(value) => format!("bpp {value}"),
        Goal::Tolerance(value) => format!("tolerance {value}"),
    };
    let content = match (params.content, params.family) {
        (Some(content), _) => format!(", content {}", content.name()),
        (None, Family::ErrorMap) => ", content error-map".to_owned(),
        (None, Family::Bc | Family::Astc) => String::new(),
    };
    let layers = if params.layers > 1 { format!(", {} layers", params.layers) } else { String::new() };
    let without: String = params.transforms.missing().map(|part| format!(", without {part}")).collect();
    format!("epitome, {goal}{content}{layers}{without}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_charts_show_what_they_hold() {
        let images = ImageSet::single(texfold_testkit::picture("facade"));
        let goal = Goal::Tolerance(20.0);
        let params = EpitomeParams { goal, effort: texfold_core::Effort::Fast, ..EpitomeParams::default() };
        let mut job = Job::default();
        let searched = search_all(EpitomeSource::new(&images), &params, &mut job).unwrap();
        for made in searched.covered(20.0, 1.0, true).unwrap() {
            let measured = measure(&images, &made);
            assert!(goal.is_met(&measured), "{measured:?}");
            // Columns of a leaf lie in rows of the epitome: nothing is turned so far in a search at effort fast.
            let turned = made.parts.linears.iter().filter(|linear| linear[0].abs() < linear[1].abs());
            assert!(turned.count() > 0);
        }
    }
}

//! From matches to candidates: linear parts and tones become numbers of palettes, positions quarters of a texel.

use glam::{Vec2, Vec4};
use rayon::prelude::*;

use super::candidate::{Candidate, FRACTION_BITS, Match, Reading, Rules, ScaleErrors, direct};
use super::choose::Options;
use super::leaf::{Grid, Node};
use super::linear;
use super::pyramid::{CELL, SCALES, Space};
use super::tone::{self, Stats};
use crate::encoded::{Linear, NEUTRAL, Tone};

/// Candidates with content elsewhere that are kept for a leaf, in each format.
const KEPT: usize = 5;
/// The same within a tolerance, where any candidate is as good as another and those that many leaves share are wanted.
const KEPT_WITHIN: usize = 16;
/// Steps of a quarter texel by which a position may move after its linear part became a palette's.
const MOVES: usize = 4;
/// Cells that are tried at most for a leaf of one colour.
const FLAT_TRIES: usize = 256;
/// Leaves that tones are fitted to at most.
const TONE_LEAVES: usize = 20_000;

/// Palettes that entries point into.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Palettes {
    pub(crate) linears: Vec<Linear>,
    pub(crate) tones: Vec<Tone>,
}

/// A match with its numbers, and the sums from which any tone's error follows.
struct Placed {
    x: i32,
    y: i32,
    linear: u16,
    image: u16,
    scale: u8,
    /// For each format.
    stats: Vec<Stats>,
}

/// Candidates of a node, and their cells.
type Found = (Vec<Candidate>, Vec<u32>);

/// Content from each leaf's own place, and its least error at each scale.
pub(crate) fn direct_options(space: &Space, grid: &Grid, rules: &Rules<'_>) -> (Options, Vec<ScaleErrors>) {
    let found: Vec<(Found, ScaleErrors)> = (0..grid.nodes())
        .into_par_iter()
        .map(|index| {
            let node = grid.node(index);
            let mut cells = Vec::new();
            if node.is_outside() {
                return ((Vec::new(), cells), [f32::INFINITY; SCALES.len()]);
            }
            let (candidates, errors) = direct(space, node, rules, &mut cells);
            ((candidates, cells), errors)
        })
        .collect();
    let (found, errors) = found.into_iter().unzip();
    (gather(found), errors)
}

/// One list of cells for all nodes.
fn gather(found: Vec<Found>) -> Options {
    let mut options = Options::default();
    for (mut candidates, cells) in found {
        let start = options.cells.len() as u32;
        for candidate in &mut candidates {
            candidate.cells = (candidate.cells.0 + start, candidate.cells.1 + start);
        }
        options.candidates.push(candidates);
        options.cells.extend(cells);
    }
    options
}

/// Palettes fitted to the matches, and all candidates in their terms.
pub(crate) fn all_options(
    space: &Space,
    grid: &Grid,
    direct: &Options,
    matches: &[Vec<Match>],
    sizes: (usize, usize),
    rules: &Rules<'_>,
) -> (Options, Palettes) {
    let weigh = |(index, matches): (usize, &Vec<Match>)| {
        let side = grid.node(index).side as f32;
        // The better of a leaf's matches are the likelier to be taken.
        let weigh = move |(rank, found): (usize, &Match)| (found.linear, side / (1 + rank) as f32);
        matches.iter().enumerate().map(weigh).collect::<Vec<_>>()
    };
    let linears: Vec<(glam::Mat2, f32)> = matches.iter().enumerate().flat_map(weigh).collect();
    let mut linears = linear::palette(&linears, space.scales(), sizes.0 - usize::from(rules.cells.is_some()));
    if rules.cells.is_some() {
        linears.push([0; 4]);
    }
    let points: Vec<Vec4> = linears.iter().map(|&linear| linear::to_point(linear)).collect();
    let placer = Placer { space, linears: &linears, points: &points };
    let tones = fit_tones(&placer, grid, matches, sizes.1);
    let found: Vec<Found> = (0..grid.nodes())
        .into_par_iter()
        .map(|index| {
            let own = &direct.candidates[index];
            let mut cells = Vec::new();
            let mut candidates: Vec<Candidate> = Vec::new();
            for candidate in own {
                let from = direct.cells_of(candidate);
                let start = cells.len() as u32;
                cells.extend(from);
                candidates.push(Candidate { cells: (start, cells.len() as u32), ..*candidate });
            }
            let most = own.iter().map(|candidate| candidate.error).fold(0.0, f32::max);
            // Within a tolerance, and where a leaf has no content of its own, any error will do.
            let most = if rules.tolerance.is_some() || own.is_empty() { f32::INFINITY } else { most };
            let borrow = Borrow { space, tones: &tones, linears: &linears, rules, most };
            let node = grid.node(index);
            let placed = placer.place_all(node, &matches[index]);
            candidates.extend(borrow.all(node, &placed, &mut cells));
            if candidates.is_empty() && !node.is_outside() {
                candidates.extend(borrow.flat(node, &mut cells));
            }
            (candidates, cells)
        })
        .collect();
    (gather(found), Palettes { linears, tones })
}

/// What turns matches into places.
struct Placer<'a> {
    space: &'a Space,
    linears: &'a [Linear],
    /// The linear parts as points.
    points: &'a [Vec4],
}

impl Placer<'_> {
    /// All matches of a node with linear parts of the palette, their positions moved to where that costs least.
    fn place_all(&self, node: Node, matches: &[Match]) -> Vec<Placed> {
        if node.is_outside() || matches.is_empty() {
            return Vec::new();
        }
        let target = node.texels(self.space);
        matches.iter().filter_map(|found| self.place(node, &target, found)).collect()
    }

    fn place(&self, node: Node, target: &[Vec4], found: &Match) -> Option<Placed> {
        let number = linear::nearest(self.points, found.linear);
        let (image, scale) = (usize::from(found.image), usize::from(found.scale));
        let (x, y) = self.settle(node, target, found, self.linears[number])?;
        let reading = Reading::new(node, x, y, self.linears[number]);
        let field = |stored: &super::pyramid::Stored| reading.stats(&stored.decoded[image][scale], target);
        let stats: Option<Vec<Stats>> = self.space.stored.iter().map(field).collect();
        Some(Placed { x, y, linear: number as u16, image: found.image, scale: found.scale, stats: stats? })
    }

    /// The quarter texel with the least error near a match's position.
    fn settle(&self, node: Node, target: &[Vec4], found: &Match, linear: Linear) -> Option<(i32, i32)> {
        let field = &self.space.stored.last()?.decoded[usize::from(found.image)][usize::from(found.scale)];
        let error = |x: i32, y: i32| {
            let stats = Reading::new(node, x, y, linear).sampled_stats(field, target)?;
            Some(stats.error(&stats.best()))
        };
        let at = (found.position * (1 << FRACTION_BITS) as f32).round();
        // Content beyond the field's edge cannot be read: step inside.
        let at = inside(node, at, linear, field.width, field.height);
        let mut best = (at.x as i32, at.y as i32);
        let mut least = error(best.0, best.1)?;
        for _ in 0..MOVES {
            let around = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(dx, dy)| (best.0 + dx, best.1 + dy));
            let before = best;
            for (x, y) in around {
                if let Some(error) = error(x, y).filter(|&error| error < least) {
                    (best, least) = ((x, y), error);
                }
            }
            if best == before {
                break;
            }
        }
        Some(best)
    }
}

/// A position moved so far that the leaf's content lies within a field of that size.
fn inside(node: Node, at: Vec2, linear: Linear, width: usize, height: usize) -> Vec2 {
    let matrix = super::candidate::matrix(linear);
    let half = node.side as f32 * 0.5;
    let reach = (matrix.x_axis.abs() + matrix.y_axis.abs()) * half;
    let unit = (1 << FRACTION_BITS) as f32;
    let (low, high) = (reach, Vec2::new(width as f32, height as f32) - reach);
    let low = (low * unit).ceil();
    at.max(low).min((high * unit).floor().max(low))
}

/// Tones fitted to an even choice of the leaves' first matches.
fn fit_tones(placer: &Placer<'_>, grid: &Grid, matches: &[Vec<Match>], count: usize) -> Vec<Tone> {
    let matched: Vec<usize> = (0..matches.len()).filter(|&index| !matches[index].is_empty()).collect();
    let step = matched.len().div_ceil(TONE_LEAVES).max(1);
    let some: Vec<Stats> = matched
        .par_iter()
        .step_by(step)
        .filter_map(|&index| {
            let node = grid.node(index);
            let placed = placer.place(node, &node.texels(placer.space), &matches[index][0])?;
            placed.stats.last().copied()
        })
        .collect();
    if some.is_empty() { vec![NEUTRAL] } else { tone::palette(&some, count) }
}

/// What turns placed matches into candidates.
struct Borrow<'a> {
    space: &'a Space,
    tones: &'a [Tone],
    linears: &'a [Linear],
    rules: &'a Rules<'a>,
    /// Error above which a candidate is of no use.
    most: f32,
}

impl Borrow<'_> {
    /// The best candidates with content elsewhere.
    fn all(&self, node: Node, placed: &[Placed], cells: &mut Vec<u32>) -> Vec<Candidate> {
        let target = if self.rules.tolerance.is_some() { node.texels(self.space) } else { Vec::new() };
        let most = if self.rules.tolerance.is_some() { KEPT_WITHIN } else { KEPT };
        let mut kept = Vec::new();
        for format in 0..self.space.stored.len() {
            let toned = placed.iter().map(|placed| self.toned(placed, format));
            let mut found: Vec<Candidate> = toned.filter(|found| found.error < self.most).collect();
            found.sort_by(|a, b| a.error.total_cmp(&b.error));
            let mut count = 0;
            for candidate in found {
                if count < most
                    && let Some(candidate) = self.checked(node, candidate, &target, cells)
                {
                    kept.push(candidate);
                    count += 1;
                }
            }
        }
        kept
    }

    fn toned(&self, placed: &Placed, format: usize) -> Candidate {
        let (number, error) = tone::nearest(self.tones, &placed.stats[format]);
        Candidate {
            error,
            cells: (0, 0),
            x: placed.x,
            y: placed.y,
            image: placed.image,
            linear: placed.linear,
            tone: number as u16,
            scale: placed.scale,
            format: format as u8,
        }
    }

    /// The candidate with its cells, where the rules allow it.
    fn checked(
        &self,
        node: Node,
        candidate: Candidate,
        target: &[Vec4],
        cells: &mut Vec<u32>,
    ) -> Option<Candidate> {
        let (format, image, scale) =
            (usize::from(candidate.format), usize::from(candidate.image), usize::from(candidate.scale));
        let reading =
            Reading::new(node, candidate.x, candidate.y, self.linears[usize::from(candidate.linear)]);
        let field = &self.space.stored[format].decoded[image][scale];
        let start = cells.len();
        reading.cells(field, self.space.rows_of(format, image, scale), cells);
        let tone = self.tones.get(usize::from(candidate.tone)).unwrap_or(&NEUTRAL);
        if !self.rules.allow(&cells[start..]) || !self.rules.accept(&reading, field, target, tone) {
            cells.truncate(start);
            return None;
        }
        Some(Candidate { cells: (start as u32, cells.len() as u32), ..candidate })
    }

    /// The leaf in one colour, that of the middle of a cell which is allowed, toned to fit best: for leaves that must not show
    /// their own content and look like nothing else.
    fn flat(&self, node: Node, cells: &mut Vec<u32>) -> Option<Candidate> {
        let number = self.linears.iter().position(|linear| *linear == [0; 4])?;
        let allowed = self.rules.cells?;
        let target = node.texels(self.space);
        let tried = allowed.iter().enumerate().filter(|(_, allowed)| **allowed).map(|(cell, _)| cell as u32);
        let tried: Vec<u32> = tried.collect();
        let step = tried.len().div_ceil(FLAT_TRIES).max(1);
        let best = tried
            .into_iter()
            .step_by(step)
            .filter_map(|cell| {
                let (format, image, scale, column, row) = self.space.locate(cell);
                let unit = |at: u32| ((at * CELL + CELL / 2) << FRACTION_BITS) as i32;
                let (x, y) = (unit(column), unit(row));
                let reading = Reading::new(node, x, y, self.linears[number]);
                let stats = reading.stats(&self.space.stored[format].decoded[image][scale], &target)?;
                let placed = Placed {
                    x,
                    y,
                    linear: number as u16,
                    image: image as u16,
                    scale: scale as u8,
                    stats: vec![stats; self.space.stored.len()],
                };
                Some(self.toned(&placed, format))
            })
            .min_by(|a, b| a.error.total_cmp(&b.error))?;
        Borrow { rules: &Rules { tolerance: None, ..*self.rules }, ..*self }
            .checked(node, best, &target, cells)
    }
}

//! From matches to candidates: 2x2 matrices and gain-offset pairs become numbers of palettes, positions quarters of a
//! texel.

use glam::{Vec2, Vec4};
use rayon::prelude::*;

use texfold_core::CancelCheck;

use super::candidate::{Candidate, Match, Rules, ScaleErrors, direct, is_upright};
use super::gain_offset::{self, Stats};
use super::leaf::{Grid, Node};
use super::matrix;
use super::pyramid::{CellPlace, SCALES, Space};
use super::reading::{FRACTION_BITS, Reading};
use super::state::Options;
use crate::format::{GainOffset, Matrix, NEUTRAL, Palettes};

/// Candidates with content elsewhere that are kept for a leaf, in each format: upright ones and others. With 5 of all
/// photographs came out 1 to 3 % larger; with 8 of all a page 2.5 %, as rotated ones, which come nearer but meet
/// less, drove out the others.
const KEPT: [usize; 2] = [8, 4];
/// The same within a tolerance, where any candidate is as good as another and those that many leaves share are
/// wanted.
const KEPT_WITHIN: usize = 16;
/// Steps of a quarter texel by which a position may move after its 2x2 matrix became a palette's.
const MOVES: usize = 4;
/// Cells that are tried at most for a leaf of one colour.
const FLAT_TRIES: usize = 256;
/// Leaves that gain-offset pairs are fitted to at most.
const TONE_LEAVES: usize = 20_000;

/// A match with its numbers, and the sums from which any gain-offset pair's error follows.
struct Placed {
    x: i32,
    y: i32,
    matrix: u16,
    image: u16,
    scale: u8,
    /// For each format.
    stats: Vec<Stats>,
}

/// Candidates of a node, and their cells.
type Found = (Vec<Candidate>, Vec<u32>);

/// Content from each leaf's own place, and its least error at each scale. Once `cancel` is cancelled nodes have no
/// content.
pub(crate) fn direct_options(
    space: &Space,
    grid: &Grid,
    rules: &Rules<'_>,
    cancel: CancelCheck<'_>,
) -> (Options, Vec<ScaleErrors>) {
    let found: Vec<(Found, ScaleErrors)> = (0..grid.nodes())
        .into_par_iter()
        .map(|index| {
            let node = grid.node(index);
            let mut cells = Vec::new();
            if node.is_outside() || cancel.is_cancelled() {
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

/// Where a match's content lies once its 2x2 matrix is one of the palette.
#[derive(Debug, Clone, Copy)]
struct Spot {
    x: i32,
    y: i32,
    matrix: u16,
}

/// Palettes fitted to the matches, and the spots of each node's matches.
pub(crate) struct Fitted {
    pub(crate) palettes: Palettes,
    spots: Vec<Vec<Option<Spot>>>,
}

/// The 2x2 matrices of all matches, each with its weight.
pub(crate) fn weighed(grid: &Grid, matches: &[Vec<Match>]) -> Vec<(glam::Mat2, f32)> {
    let weigh = |(index, matches): (usize, &Vec<Match>)| {
        let side = grid.node(index).side as f32;
        // The better of a leaf's matches are the likelier to be taken.
        let weigh = move |(rank, found): (usize, &Match)| (found.matrix, side / (1 + rank) as f32);
        matches.iter().enumerate().map(weigh).collect::<Vec<_>>()
    };
    matches.iter().enumerate().flat_map(weigh).collect()
}

/// Palettes that are wanted.
pub(crate) struct Wanted {
    pub(crate) matrices: Vec<Matrix>,
    /// Most gain-offset pairs.
    pub(crate) gain_offsets: usize,
    pub(crate) placing: Placing,
}

/// Which spots matches may get.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placing {
    /// Whether positions are in quarters of a texel, or else in whole ones.
    pub(crate) fractions: bool,
    /// Whether matches that are not upright get any.
    pub(crate) rotated: bool,
}

/// A palette of such `matrices` and one of at most `gain_offsets` gain-offset pairs. Once `cancel` is cancelled matches have
/// no spots.
pub(crate) fn fit(
    space: &Space,
    grid: &Grid,
    matches: &[Vec<Match>],
    Wanted { matrices, gain_offsets, placing }: Wanted,
    cancel: CancelCheck<'_>,
) -> Fitted {
    let points: Vec<Vec4> = matrices.iter().map(|&matrix| matrix::to_point(matrix)).collect();
    let placer =
        Placer { space, matrices: &matrices, points: &points, placing, gain_offset: gain_offsets > 1 };
    let spots: Vec<Vec<Option<Spot>>> = (0..grid.nodes())
        .into_par_iter()
        .map(|index| {
            let matches = if cancel.is_cancelled() { &[][..] } else { &matches[index] };
            placer.spots(grid.node(index), matches)
        })
        .collect();
    let leaves = leaves_to_adjust(space, grid, matches, &spots, &matrices, cancel);
    let gain_offsets =
        if leaves.is_empty() { vec![NEUTRAL] } else { gain_offset::palette(&leaves, gain_offsets, cancel) };
    Fitted { palettes: Palettes { matrices, gain_offsets }, spots }
}

/// All candidates that the rules allow, those of `direct` among them. Once `cancel` is cancelled nodes have none.
pub(crate) fn all_options(
    space: &Space,
    grid: &Grid,
    direct: &Options,
    matches: &[Vec<Match>],
    fitted: &Fitted,
    rules: &Rules<'_>,
    cancel: CancelCheck<'_>,
) -> Options {
    let Palettes { matrices, gain_offsets } = &fitted.palettes;
    let found: Vec<Found> = (0..grid.nodes())
        .into_par_iter()
        .map(|index| {
            let own = &direct.candidates[index];
            let mut cells = Vec::new();
            let mut candidates: Vec<Candidate> = Vec::new();
            if cancel.is_cancelled() {
                return (candidates, cells);
            }
            for candidate in own {
                let from = direct.cells_of(candidate);
                let start = cells.len() as u32;
                cells.extend(from);
                candidates.push(Candidate { cells: (start, cells.len() as u32), ..*candidate });
            }
            let most = own.iter().map(|candidate| candidate.error).fold(0.0, f32::max);
            // Within a tolerance, and where a leaf has no content of its own, any error will do.
            let most = if rules.tolerance.is_some() || own.is_empty() { f32::INFINITY } else { most };
            let borrow = Borrow { space, gain_offsets, matrices, rules, most };
            let node = grid.node(index);
            let placed = place_all(space, node, &matches[index], &fitted.spots[index], matrices);
            let borrowed = borrow.all(node, &placed, &mut cells);
            let least = |format| {
                let of_format = own.iter().filter(move |own| own.format == format);
                of_format.map(|own| own.error).fold(f32::INFINITY, f32::min)
            };
            candidates.extend(borrowed.into_iter().map(|candidate| Candidate {
                error: rules.hoped(candidate.error, least(candidate.format)),
                ..candidate
            }));
            if candidates.is_empty() && !node.is_outside() {
                candidates.extend(borrow.flat(node, &mut cells));
            }
            (candidates, cells)
        })
        .collect();
    gather(found)
}

/// The matches of a node in their spots.
fn place_all(
    space: &Space,
    node: Node,
    matches: &[Match],
    spots: &[Option<Spot>],
    matrices: &[Matrix],
) -> Vec<Placed> {
    if node.is_outside() || matches.is_empty() {
        return Vec::new();
    }
    let target = node.texels(space);
    let placed =
        |(found, spot): (&Match, &Option<Spot>)| place(space, node, &target, found, (*spot)?, matrices);
    matches.iter().zip(spots).filter_map(placed).collect()
}

fn place(
    space: &Space,
    node: Node,
    target: &[Vec4],
    found: &Match,
    spot: Spot,
    matrices: &[Matrix],
) -> Option<Placed> {
    let (image, scale) = (usize::from(found.image), usize::from(found.scale));
    let reading = Reading::new(node, spot.x, spot.y, matrices[usize::from(spot.matrix)]);
    let field = |stored: &super::pyramid::Stored| reading.stats(&stored.decoded[image][scale], target);
    let stats: Option<Vec<Stats>> = space.stored.iter().map(field).collect();
    let Spot { x, y, matrix } = spot;
    Some(Placed { x, y, matrix, image: found.image, scale: found.scale, stats: stats? })
}

/// What turns matches into spots.
struct Placer<'a> {
    space: &'a Space,
    matrices: &'a [Matrix],
    /// The 2x2 matrices as points.
    points: &'a [Vec4],
    placing: Placing,
    /// Whether a gain-offset pair will follow.
    gain_offset: bool,
}

impl Placer<'_> {
    /// The spots of a node's matches, each with the position that costs least.
    fn spots(&self, node: Node, matches: &[Match]) -> Vec<Option<Spot>> {
        if node.is_outside() || matches.is_empty() {
            return Vec::new();
        }
        let target = node.texels(self.space);
        matches.iter().map(|found| self.spot(node, &target, found)).collect()
    }

    fn spot(&self, node: Node, target: &[Vec4], found: &Match) -> Option<Spot> {
        let may_be = self.placing.rotated || is_upright(found.matrix);
        may_be.then(|| self.settle(node, target, found, matrix::nearest(self.points, found.matrix)))?
    }

    /// The position with the least error near a match's, under a 2x2 matrix of the palette.
    fn settle(&self, node: Node, target: &[Vec4], found: &Match, number: usize) -> Option<Spot> {
        let field = &self.space.stored.last()?.decoded[usize::from(found.image)][usize::from(found.scale)];
        let matrix = self.matrices[number];
        let error = |x: i32, y: i32| {
            let stats = Reading::new(node, x, y, matrix).sampled_stats(field, target)?;
            Some(if self.gain_offset { stats.error(&stats.best()) } else { stats.plain_error() })
        };
        let step_of = if self.placing.fractions { 1 } else { 1 << FRACTION_BITS };
        let step = step_of as f32;
        let at = (found.position * (1 << FRACTION_BITS) as f32 / step).round() * step;
        // Content beyond the field's edge cannot be read: step inside.
        let at = inside(node, at, matrix, (field.width, field.height), step);
        let mut best = (at.x as i32, at.y as i32);
        let mut least = error(best.0, best.1)?;
        for _ in 0..MOVES {
            let steps = [(1, 0), (-1, 0), (0, 1), (0, -1)];
            let around = steps.map(|(dx, dy)| (best.0 + dx * step_of, best.1 + dy * step_of));
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
        Some(Spot { x: best.0, y: best.1, matrix: number as u16 })
    }
}

/// A position moved in steps so far that the leaf's content lies within a field of that size.
fn inside(node: Node, at: Vec2, matrix: Matrix, (width, height): (usize, usize), step: f32) -> Vec2 {
    let matrix = super::candidate::matrix(matrix);
    let half = node.side as f32 * 0.5;
    let reach = (matrix.x_axis.abs() + matrix.y_axis.abs()) * half;
    let unit = (1 << FRACTION_BITS) as f32 / step;
    let (low, high) = (reach, Vec2::new(width as f32, height as f32) - reach);
    let low = (low * unit).ceil() * step;
    at.max(low).min(((high * unit).floor() * step).max(low))
}

/// An even choice of the leaves' first matches, that gain-offset pairs are fitted to.
fn leaves_to_adjust(
    space: &Space,
    grid: &Grid,
    matches: &[Vec<Match>],
    spots: &[Vec<Option<Spot>>],
    matrices: &[Matrix],
    cancel: CancelCheck<'_>,
) -> Vec<Stats> {
    let matched: Vec<usize> = (0..matches.len()).filter(|&index| !matches[index].is_empty()).collect();
    let step = matched.len().div_ceil(TONE_LEAVES).max(1);
    matched
        .par_iter()
        .step_by(step)
        .filter(|_| !cancel.is_cancelled())
        .filter_map(|&index| {
            let node = grid.node(index);
            let spot = spots[index].first().copied()??;
            let placed = place(space, node, &node.texels(space), &matches[index][0], spot, matrices)?;
            placed.stats.last().copied()
        })
        .collect()
}

/// What turns placed matches into candidates.
struct Borrow<'a> {
    space: &'a Space,
    gain_offsets: &'a [GainOffset],
    matrices: &'a [Matrix],
    rules: &'a Rules<'a>,
    /// Error above which a candidate is of no use.
    most: f32,
}

impl Borrow<'_> {
    /// The best candidates with content elsewhere.
    fn all(&self, node: Node, placed: &[Placed], cells: &mut Vec<u32>) -> Vec<Candidate> {
        let target = if self.rules.tolerance.is_some() { node.texels(self.space) } else { Vec::new() };
        let most = if self.rules.tolerance.is_some() { [KEPT_WITHIN; 2] } else { KEPT };
        let mut kept = Vec::new();
        for format in 0..self.space.stored.len() {
            let gain_offset = placed.iter().map(|placed| self.gain_offset(placed, format));
            let mut found: Vec<Candidate> = gain_offset.filter(|found| found.error < self.most).collect();
            found.sort_by(|a, b| a.error.total_cmp(&b.error));
            let mut counts = [0; 2];
            for candidate in found {
                let [_, across, down, _] = self.matrices[usize::from(candidate.matrix)];
                let kind = usize::from((across, down) != (0, 0) && self.rules.tolerance.is_none());
                if counts[kind] < most[kind]
                    && let Some(candidate) = self.checked(node, candidate, &target, cells)
                {
                    kept.push(candidate);
                    counts[kind] += 1;
                }
            }
        }
        kept
    }

    fn gain_offset(&self, placed: &Placed, format: usize) -> Candidate {
        let (number, error) = gain_offset::nearest(self.gain_offsets, &placed.stats[format]);
        Candidate {
            error,
            cells: (0, 0),
            x: placed.x,
            y: placed.y,
            image: placed.image,
            matrix: placed.matrix,
            gain_offset: number as u16,
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
            Reading::new(node, candidate.x, candidate.y, self.matrices[usize::from(candidate.matrix)]);
        let field = &self.space.stored[format].decoded[image][scale];
        let start = cells.len();
        reading.cells(field, self.space.rows_of(format, image, scale), cells);
        let gain_offset = self.gain_offsets.get(usize::from(candidate.gain_offset)).unwrap_or(&NEUTRAL);
        if !self.rules.allow(&cells[start..]) || !self.rules.accept(&reading, field, target, gain_offset) {
            cells.truncate(start);
            return None;
        }
        Some(Candidate { cells: (start as u32, cells.len() as u32), ..candidate })
    }

    /// The leaf in one colour, that of the middle of a cell which is allowed, given gain and offset to fit best: for
    /// leaves that must not read their own content and look like nothing else.
    fn flat(&self, node: Node, cells: &mut Vec<u32>) -> Option<Candidate> {
        let number = self.matrices.iter().position(|matrix| *matrix == [0; 4])?;
        let allowed = self.rules.cells?;
        let target = node.texels(self.space);
        let tried = allowed.iter().enumerate().filter(|(_, allowed)| **allowed).map(|(cell, _)| cell as u32);
        let tried: Vec<u32> = tried.collect();
        let step = tried.len().div_ceil(FLAT_TRIES).max(1);
        let best = tried
            .into_iter()
            .step_by(step)
            .filter_map(|cell| {
                let CellPlace { format, image, scale, column, row } = self.space.locate(cell);
                let side = self.space.stored[format].cell;
                let unit = |at: u32| ((at * side + side / 2) << FRACTION_BITS) as i32;
                let (x, y) = (unit(column), unit(row));
                let reading = Reading::new(node, x, y, self.matrices[number]);
                let stats = reading.stats(&self.space.stored[format].decoded[image][scale], &target)?;
                let placed = Placed {
                    x,
                    y,
                    matrix: number as u16,
                    image: image as u16,
                    scale: scale as u8,
                    stats: vec![stats; self.space.stored.len()],
                };
                Some(self.gain_offset(&placed, format))
            })
            .min_by(|a, b| a.error.total_cmp(&b.error))?;
        Borrow { rules: &Rules { tolerance: None, ..*self.rules }, ..*self }
            .checked(node, best, &target, cells)
    }
}

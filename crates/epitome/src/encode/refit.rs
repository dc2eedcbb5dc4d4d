//! Content fitted to all who read it.
//!
//! What is stored first is the image at one place, or what linear interpolation makes it of where nothing ends. But
//! many leaves read the same content, each laid and given gain and offset in its own way, and none reads beyond its
//! own. The content that reconstructs all of them with the least squared error is found by conjugate gradients, and stored
//! where it is better than what was there. The paper takes content as it is (section 4); at equal quality fitted
//! content is 4 to 7 % smaller.

use glam::{DVec4, Vec4};
use rayon::prelude::*;
use texfold_bc::ContentPlanes;
use texfold_core::EncodeError;

use super::candidate::Candidate;
use super::cell_cache::{CellCache, CellCoder, WantedCell};
use super::gain_offset;
use super::leaf::Node;
use super::pack::Packing;
use super::plan::Plan;
use super::pyramid::CellPlace;
use super::reading::{FRACTION_BITS, Reading};
use super::state::Choice;

/// Steps of conjugate gradients; 20 gain nothing over 3.
const STEPS: usize = 4;
/// Weight of what content was first, against one reader's of one texel.
const FIRST: f32 = 0.02;
/// Weight of a coarser layer's reader.
const COARSER: f32 = 0.1;

/// A leaf, and how it reads the epitome.
struct Reader {
    reading: Reading,
    weight: f32,
    gain: Vec4,
    offset: Vec4,
    node: Node,
}

/// A cell whose texels are fitted.
struct Free {
    number: u32,
    /// Column and row in the epitome, in cells.
    place: (u32, u32),
}

/// One epitome.
struct Sheet<'a> {
    plan: &'a Plan<'a>,
    format: usize,
    /// Columns in texels.
    width: usize,
    /// Texels a side of a cell.
    side: usize,
    free: Vec<Free>,
    readers: Vec<Reader>,
}

/// The epitome of `format` with content fitted to the leaves of all `choices`, of which the last counts most; `base`
/// holds it as it was first.
///
/// # Errors
/// [`EncodeError::Cancelled`] where the job was cancelled.
pub(crate) fn refit(
    plan: &Plan<'_>,
    cache: &CellCache,
    packing: &Packing,
    choices: &[Choice],
    format: usize,
    base: ContentPlanes,
) -> Result<ContentPlanes, EncodeError> {
    let sheet = Sheet::new(
        plan,
        packing,
        choices,
        SheetForm { format, width: base.size().0, readers: Readers::OfFree },
    );
    if sheet.free.is_empty() {
        return Ok(base);
    }
    let mut texels = to_8_bits(&base);
    sheet.start(&mut texels);
    let weights = sheet.solve(&mut texels);
    plan.cancel.checkpoint()?;
    sheet.store(cache, base, Fitted { texels: &texels, weights: &weights })
}

/// Which epitome, of how many columns of texels, and whose readers.
struct SheetForm {
    format: usize,
    width: u32,
    readers: Readers,
}

/// Texels as they should be, and how much an error of each counts.
struct Fitted<'a> {
    texels: &'a [Vec4],
    weights: &'a [Vec4],
}

/// What an epitome whose cells differ in bits should hold.
pub(crate) struct Drawn {
    /// Columns and rows.
    pub(crate) size: (u32, u32),
    /// Its texels in 8-bit units.
    pub(crate) texels: Vec<Vec4>,
    /// How much an error of each counts: by how many leaves draw it how large.
    weights: Vec<Vec4>,
    /// Whether any leaf draws it.
    pub(crate) counts: Vec<bool>,
}

impl Drawn {
    /// Mean weight of each block of that side, row by row.
    pub(crate) fn block_weights(&self, side: usize) -> Vec<f32> {
        let (width, height) = (self.size.0 as usize, self.size.1 as usize);
        let columns = width / side;
        let of_block = |block: usize| {
            let start = block / columns * side * width + block % columns * side;
            let sum: Vec4 = (0..side * side).map(|n| self.weights[start + n / side * width + n % side]).sum();
            sum.truncate().element_sum() / (3 * side * side) as f32
        };
        (0..columns * (height / side)).into_par_iter().map(of_block).collect()
    }

    /// Takes all texels of cells for drawn of which any is.
    pub(crate) fn count_whole_cells(&mut self, side: usize) {
        let width = self.size.0 as usize;
        for row in (0..self.size.1 as usize).step_by(side) {
            for column in (0..width).step_by(side) {
                let cell = (0..side * side).map(move |n| (row + n / side) * width + column + n % side);
                if cell.clone().any(|at| self.counts[at]) {
                    cell.for_each(|at| self.counts[at] = true);
                }
            }
        }
    }
}

/// The epitome of that size and `format`, fitted to the leaves that draw it.
pub(crate) fn fitted(
    plan: &Plan<'_>,
    packing: &Packing,
    choices: &[Choice],
    format: usize,
    (width, height): (u32, u32),
) -> Drawn {
    let sheet = Sheet::new(plan, packing, choices, SheetForm { format, width, readers: Readers::All });
    let mut texels = vec![Vec4::splat(UNUSED); width as usize * height as usize];
    sheet.start(&mut texels);
    let weights = sheet.solve(&mut texels);
    let counts = weights.iter().map(|weight| weight.x > FIRST).collect();
    Drawn { size: (width, height), texels, weights, counts }
}

/// Which leaves are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Readers {
    /// Those of content that several leaves draw, or one otherwise than as it is.
    OfFree,
    /// All of them, and all content is looked at.
    All,
}

/// Texels of an epitome that no leaf draws.
const UNUSED: f32 = 128.0;

/// All texels in 8-bit units.
fn to_8_bits(planes: &ContentPlanes) -> Vec<Vec4> {
    planes.decode().into_iter().map(|texel| texel * 255.0).collect()
}

/// Whether a leaf draws content at full size as it lies in its own place.
fn is_plain(node: &Node, candidate: &Candidate) -> bool {
    let centre = (node.corner * 2 + node.side) << (FRACTION_BITS - 1);
    let is_there = (candidate.x, candidate.y) == (centre.x as i32, centre.y as i32);
    let is_own = candidate.scale == 0 && usize::from(candidate.image) == node.image;
    is_there && is_own && candidate.matrix == 0 && candidate.gain_offset == 0
}

impl<'a> Sheet<'a> {
    fn new(
        plan: &'a Plan<'a>,
        packing: &Packing,
        choices: &[Choice],
        SheetForm { format, width, readers: kind }: SheetForm,
    ) -> Self {
        let chosen: Vec<(Node, &Candidate, f32)> = (0..choices.len())
            .flat_map(|layer| (0..plan.grid.nodes()).map(move |node| (layer, node)))
            .filter_map(|(layer, index)| {
                let leaf = choices[layer].leaves[index]? as usize;
                let candidate = plan.options.candidates[index].get(leaf)?;
                let weight = if layer + 1 == choices.len() { 1.0 } else { COARSER };
                (usize::from(candidate.format) == format).then(|| (plan.grid.node(index), candidate, weight))
            })
            .collect();
        let mut is_free = vec![kind == Readers::All; plan.space.cells()];
        for (_, candidate, _) in chosen.iter().filter(|(node, candidate, _)| !is_plain(node, candidate)) {
            plan.options.cells_of(candidate).iter().for_each(|&cell| is_free[cell as usize] = true);
        }
        let readers = chosen
            .par_iter()
            .filter(|(_, candidate, _)| {
                plan.options.cells_of(candidate).iter().any(|&cell| is_free[cell as usize])
            })
            .filter_map(|&(node, candidate, weight)| Reader::new(plan, packing, node, candidate, weight))
            .collect();
        let free = packing
            .charts
            .iter()
            .filter(|chart| chart.format == format)
            .flat_map(|chart| {
                let rows = plan.space.rows_of(format, chart.image, chart.scale);
                chart
                    .cells
                    .iter()
                    .map(move |&(x, y)| Free { number: rows.number(x, y), place: chart.place_of((x, y)) })
            })
            .filter(|free| is_free[free.number as usize])
            .collect();
        let side = plan.space.stored[format].cell as usize;
        Sheet { plan, format, width: width as usize, side, free, readers }
    }

    /// Numbers of a cell's texels, row by row.
    fn texels_of(&self, free: &Free) -> impl Iterator<Item = usize> + use<> {
        let (side, width) = (self.side, self.width);
        let start = free.place.1 as usize * side * width + free.place.0 as usize * side;
        (0..side * side).map(move |index| start + index / side * width + index % side)
    }

    /// Texels of free cells as they are in the images.
    fn start(&self, texels: &mut [Vec4]) {
        for free in &self.free {
            let CellPlace { image, scale, column, row, .. } = self.plan.space.locate(free.number);
            let field = &self.plan.space.pyramids[image].source[scale];
            let side = self.side as u32;
            for (index, texel) in self.texels_of(free).enumerate() {
                let (x, y) = (column * side + index as u32 % side, row * side + index as u32 / side);
                texels[texel] = field.at(x as i32, y as i32);
            }
        }
    }

    /// Moves the texels of free cells to where the readers' squared error is least; gives the weight that each has in
    /// it.
    fn solve(&self, texels: &mut [Vec4]) -> Vec<Vec4> {
        let mut weights = vec![Vec4::splat(FIRST); texels.len()];
        let mut slope = vec![Vec4::ZERO; texels.len()];
        for reader in self.readers.iter().take_while(|_| !self.plan.cancel.is_cancelled()) {
            let gain = reader.gain * reader.weight;
            let target = reader.node.texels(self.plan.space);
            reader.reading.taps(self.width, |index, at, shares| {
                let decoded = blend(texels, at, shares) * reader.gain + reader.offset;
                let left = (target[index] - decoded) * gain;
                for (at, share) in at.into_iter().zip(shares) {
                    slope[at] += left * share;
                    weights[at] += gain * reader.gain * (share * share);
                }
            });
        }
        let free: Vec<usize> = self.free.iter().flat_map(|free| self.texels_of(free)).collect();
        let dot = |a: &[Vec4], b: &[Vec4]| {
            free.iter().map(|&at| (a[at] * b[at]).as_dvec4()).fold(DVec4::ZERO, |sum, term| sum + term)
        };
        // Texels that are not free stay 0 here, and are so never moved.
        let mut step = vec![Vec4::ZERO; texels.len()];
        free.iter().for_each(|&at| step[at] = slope[at] / weights[at]);
        let mut left = dot(&slope, &step);
        for _ in 0..STEPS {
            let applied = self.apply(&step);
            let length = divide(left, dot(&step, &applied));
            for &at in &free {
                texels[at] += step[at] * length;
                slope[at] -= applied[at] * length;
            }
            let rest = free.iter().map(|&at| (slope[at] * slope[at] / weights[at]).as_dvec4());
            let rest = rest.fold(DVec4::ZERO, |sum, term| sum + term);
            let kept = divide(rest, left);
            free.iter().for_each(|&at| step[at] = slope[at] / weights[at] + step[at] * kept);
            left = rest;
        }
        free.iter().for_each(|&at| texels[at] = texels[at].clamp(Vec4::ZERO, Vec4::splat(255.0)));
        weights
    }

    /// The normal equations' matrix times `step`.
    fn apply(&self, step: &[Vec4]) -> Vec<Vec4> {
        let mut applied: Vec<Vec4> = step.iter().map(|step| *step * FIRST).collect();
        for reader in self.readers.iter().take_while(|_| !self.plan.cancel.is_cancelled()) {
            let gain = reader.gain * reader.gain * reader.weight;
            reader.reading.taps(self.width, |_, at, shares| {
                let change = blend(step, at, shares) * gain;
                at.into_iter().zip(shares).for_each(|(at, share)| applied[at] += change * share);
            });
        }
        applied
    }

    /// The epitome with those cells stored anew that come nearer to the fitted texels.
    fn store(
        &self,
        cache: &CellCache,
        mut base: ContentPlanes,
        Fitted { texels, weights }: Fitted<'_>,
    ) -> Result<ContentPlanes, EncodeError> {
        let want = |free: &Free| {
            let texels = self.texels_of(free).map(|at| texels[at]).collect();
            WantedCell { number: free.number, texels }
        };
        let wanted: Vec<WantedCell> = self.free.iter().map(want).collect();
        let Plan { space, effort, cancel, .. } = *self.plan;
        let coder = CellCoder { stored: &space.stored[self.format], pixel: space.pixel, effort, cancel };
        let strip = cache.encode(coder, &wanted)?;
        let (decoded, stored) = (to_8_bits(&strip), to_8_bits(&base));
        let error = |free: &Free, found: &dyn Fn(usize, usize) -> Vec4| -> f32 {
            let term = |(index, at): (usize, usize)| {
                let step = found(index, at) - texels[at];
                (step * step * weights[at]).element_sum()
            };
            self.texels_of(free).enumerate().map(term).sum()
        };
        let is_better = |&(number, free): &(usize, &Free)| {
            let start = number * self.side * self.side;
            error(free, &|index, _| decoded[start + index]) < error(free, &|_, at| stored[at])
        };
        let better: Vec<((u32, u32), (u32, u32))> = self
            .free
            .iter()
            .enumerate()
            .filter(is_better)
            .map(|(number, free)| ((0, number as u32), free.place))
            .collect();
        base.copy_cells(&strip, better);
        Ok(base)
    }
}

impl Reader {
    fn new(
        plan: &Plan<'_>,
        packing: &Packing,
        node: Node,
        candidate: &Candidate,
        weight: f32,
    ) -> Option<Reader> {
        let ((x, y), _) = packing.moved(plan.space, plan.options, candidate)?;
        let reading = Reading::new(node, x as i32, y as i32, plan.palettes.matrix(candidate.matrix));
        let (gain, offset) = gain_offset::values(&plan.palettes.gain_offset(candidate.gain_offset));
        Some(Reader { reading, weight, gain, offset, node })
    }
}

fn blend(texels: &[Vec4], at: [usize; 4], shares: [f32; 4]) -> Vec4 {
    let [a, b, c, d] = at.map(|at| texels[at]);
    a * shares[0] + b * shares[1] + c * shares[2] + d * shares[3]
}

/// Quotients; 0 where there is nothing to divide by.
fn divide(a: DVec4, b: DVec4) -> Vec4 {
    let quotient = |a: f64, b: f64| if b > 0.0 { (a / b) as f32 } else { 0.0 };
    Vec4::new(quotient(a.x, b.x), quotient(a.y, b.y), quotient(a.z, b.z), quotient(a.w, b.w))
}

//! Charts and where they go.
//!
//! A chart is a set of cells that some leaf reads across: they must stay together. Charts are placed by falling size, each
//! where it fits first from the top: small charts fill what large ones leave. Where quality or size is asked for, charts are
//! mostly small and fill 99.5 % of the sheet. *Not done*: the eight orientations of the
//! paper. Tried for packing alone, within a tolerance of 20: the smallest sheets of three pictures are 86 to 90 % full without
//! them and 88 to 91 % with them, 1.5 to 4 % smaller, less some bits of each entry for the linear parts of turned charts.

use std::collections::BTreeMap;

use super::candidate::{Candidate, FRACTION_BITS};
use super::choose::{Choice, Options};
use super::pyramid::Space;

/// Widths of a sheet that are tried, as shares of a square's side.
const WIDTHS: [f64; 7] = [1.0, 1.1, 1.25, 0.9, 1.4, 0.8, 1.6];
/// Area against cells that is good enough.
const MOST_LOSS: f64 = 1.02;

/// A place or a size in cells.
type Cells = (u32, u32);

/// Cells that stay together.
#[derive(Debug, Clone)]
pub(crate) struct Chart {
    pub(crate) format: usize,
    pub(crate) image: usize,
    pub(crate) scale: usize,
    /// Column and row of each cell in its field, ascending by row, then column.
    pub(crate) cells: Vec<(u32, u32)>,
    /// Column and row of the least column and row.
    pub(crate) corner: (u32, u32),
    /// Where the corner goes, in cells.
    pub(crate) place: (u32, u32),
    /// Whether the finest layer reads none of it. Such charts come last, where a GPU that has all layers need not hold them.
    pub(crate) is_extra: bool,
}

/// Charts in their places.
#[derive(Debug, Default)]
pub(crate) struct Packing {
    pub(crate) charts: Vec<Chart>,
    /// For each cell of all formats its chart; `u32::MAX` for cells that nobody reads.
    pub(crate) chart_of: Vec<u32>,
    /// Columns and rows in cells of each format's epitome.
    pub(crate) sizes: Vec<(u32, u32)>,
    /// How many of the rows the finest layer reads.
    pub(crate) finest_rows: Vec<u32>,
}

impl Chart {
    /// Where a cell lies in the epitome, in cells.
    pub(crate) fn place_of(&self, (x, y): (u32, u32)) -> (u32, u32) {
        (x - self.corner.0 + self.place.0, y - self.corner.1 + self.place.1)
    }
}

impl Packing {
    /// Column and row of a candidate's centre in the epitome, in fractions of a texel; `None` where it has no content.
    pub(crate) fn moved(
        &self,
        space: &Space,
        options: &Options,
        candidate: &Candidate,
    ) -> Option<(u32, u32)> {
        let cell = *options.cells_of(candidate).first()?;
        let chart = self.charts.get(self.chart_of[cell as usize] as usize)?;
        let side = space.stored[usize::from(candidate.format)].cell;
        let moved = |at: i32, place: u32, corner: u32| {
            let texels = (i64::from(place) - i64::from(corner)) * i64::from(side);
            (i64::from(at) + (texels << FRACTION_BITS)).max(0) as u32
        };
        Some((
            moved(candidate.x, chart.place.0, chart.corner.0),
            moved(candidate.y, chart.place.1, chart.corner.1),
        ))
    }
}

/// Sets of cells, joined where a leaf reads across.
struct Union {
    parent: Vec<u32>,
}

impl Union {
    fn root(&mut self, cell: u32) -> u32 {
        let mut root = cell;
        while self.parent[root as usize] != root {
            root = self.parent[root as usize];
        }
        let mut at = cell;
        while self.parent[at as usize] != root {
            let next = self.parent[at as usize];
            self.parent[at as usize] = root;
            at = next;
        }
        root
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        // The smaller number leads, so that the result does not depend on the order.
        let (low, high) = (a.min(b), a.max(b));
        self.parent[high as usize] = low;
    }
}

/// Packs all cells that `layers` read; sides of epitomes are multiples of `step` cells.
pub(crate) fn pack(space: &Space, options: &Options, layers: &[Choice], step: u32) -> Packing {
    let mut packing = Packing { charts: charts(space, options, layers), ..Packing::default() };
    for format in 0..space.stored.len() {
        let mut order: Vec<usize> =
            (0..packing.charts.len()).filter(|&index| packing.charts[index].format == format).collect();
        let key = |index: usize| {
            let chart = &packing.charts[index];
            (chart.is_extra, std::cmp::Reverse(chart.extent()), index)
        };
        order.sort_by_key(|&index| key(index));
        let cells: u64 = order.iter().map(|&index| packing.charts[index].cells.len() as u64).sum();
        let limit = crate::wire::MAX_EPITOME_SIDE / space.stored[format].cell;
        let size = place(&mut packing.charts, &order, cells, (step, limit));
        packing.sizes.push(size);
        let drawn = order.iter().map(|&index| &packing.charts[index]).filter(|chart| !chart.is_extra);
        let rows = drawn.map(|chart| chart.place.1 + chart.size().1).max().unwrap_or(1);
        packing.finest_rows.push(rows.next_multiple_of(step).min(size.1));
    }
    packing.chart_of = vec![u32::MAX; space.cells()];
    for (index, chart) in (0u32..).zip(&packing.charts) {
        let rows = space.rows_of(chart.format, chart.image, chart.scale);
        for &(x, y) in &chart.cells {
            packing.chart_of[rows.number(x, y) as usize] = index;
        }
    }
    packing
}

/// Cells that are read, joined to charts.
fn charts(space: &Space, options: &Options, layers: &[Choice]) -> Vec<Chart> {
    let cells = space.cells() as u32;
    let mut union = Union { parent: (0..cells).collect() };
    for (node, leaf) in layers.iter().flat_map(|choice| choice.leaves.iter().enumerate()) {
        let candidate: Option<&Candidate> = leaf.and_then(|leaf| options.candidates[node].get(leaf as usize));
        let Some(candidate) = candidate else { continue };
        for pair in options.cells_of(candidate).windows(2) {
            union.join(pair[0], pair[1]);
        }
    }
    let mut by_root: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let is_read = |&cell: &u32| layers.iter().any(|choice| choice.users[cell as usize] > 0);
    for cell in (0..cells).filter(is_read) {
        let root = union.root(cell);
        by_root.entry(root).or_default().push(cell);
    }
    let chart = |members: Vec<u32>| {
        let (format, image, scale, ..) = space.locate(members[0]);
        let cells: Vec<(u32, u32)> = members
            .iter()
            .map(|&cell| {
                let (_, _, _, x, y) = space.locate(cell);
                (x, y)
            })
            .collect();
        let left = cells.iter().map(|cell| cell.0).min().unwrap_or(0);
        let top = cells.iter().map(|cell| cell.1).min().unwrap_or(0);
        let finest = layers.last().map(|choice| choice.users.as_slice()).unwrap_or_default();
        let is_extra = members.iter().all(|&cell| finest.get(cell as usize) == Some(&0));
        Chart { format, image, scale, cells, corner: (left, top), place: (0, 0), is_extra }
    };
    by_root.into_values().map(chart).collect()
}

impl Chart {
    /// Columns and rows of the bounding rectangle.
    fn size(&self) -> (u32, u32) {
        let right = self.cells.iter().map(|cell| cell.0).max().unwrap_or(0);
        let bottom = self.cells.iter().map(|cell| cell.1).max().unwrap_or(0);
        (right - self.corner.0 + 1, bottom - self.corner.1 + 1)
    }

    /// What it is sorted by: the longer side, then the number of cells.
    fn extent(&self) -> (u32, usize) {
        let (width, height) = self.size();
        (width.max(height), self.cells.len())
    }

    /// Its rows as bit masks from its leftmost column on.
    fn rows(&self) -> Vec<Vec<u64>> {
        let (width, height) = self.size();
        let mut rows = vec![vec![0u64; (width as usize).div_ceil(64)]; height as usize];
        for &(x, y) in &self.cells {
            let (x, y) = (x - self.corner.0, y - self.corner.1);
            rows[y as usize][x as usize / 64] |= 1 << (x % 64);
        }
        rows
    }
}

/// Places the charts of `order`; gives the columns and rows used, at least one step each and at most `limit`, or more than
/// `limit` where they do not fit. Where a sheet about as wide as high
/// loses much, other widths are tried, and the least area is kept.
fn place(charts: &mut [Chart], order: &[usize], cells: u64, (step, limit): (u32, u32)) -> (u32, u32) {
    let widest = order.iter().map(|&index| charts[index].size().0).max().unwrap_or(1);
    let mut best: Option<(Cells, Vec<Cells>)> = None;
    for share in WIDTHS {
        let width = ((cells as f64).sqrt() * share).ceil() as u32;
        let width = width.max(widest).max(1).next_multiple_of(step).min(limit);
        let (height, places) = place_within(charts, order, width);
        let size = (width, height.next_multiple_of(step));
        let area = |size: (u32, u32)| u64::from(size.0) * u64::from(size.1);
        if size.1 <= limit && best.as_ref().is_none_or(|(least, _)| area(size) < area(*least)) {
            best = Some((size, places));
        }
        if best
            .as_ref()
            .is_some_and(|(size, _)| area(*size) as f64 <= cells as f64 * MOST_LOSS + f64::from(step))
        {
            break;
        }
    }
    // Larger than any sheet: the caller says so.
    let Some((size, places)) = best else { return (limit + 1, limit + 1) };
    for (&index, place) in order.iter().zip(places) {
        charts[index].place = place;
    }
    size
}

/// Rows that a sheet of `width` columns needs, at least one, and the place of each chart.
fn place_within(charts: &[Chart], order: &[usize], width: u32) -> (u32, Vec<(u32, u32)>) {
    let mut sheet = Sheet { width, rows: Vec::new(), full: 0 };
    // Where the last chart of a shape went: no earlier place will do for the next.
    let mut hints: BTreeMap<Vec<Vec<u64>>, (u32, u32)> = BTreeMap::new();
    let mut places = Vec::new();
    for &index in order {
        let rows = charts[index].rows();
        let from = hints.get(&rows).copied().unwrap_or((0, 0));
        let at = sheet.put(&rows, charts[index].size().0, from);
        places.push(at);
        hints.insert(rows, at);
    }
    ((sheet.rows.len() as u32).max(1), places)
}

/// Which cells of an epitome are taken.
struct Sheet {
    width: u32,
    rows: Vec<Vec<u64>>,
    /// Rows from the top that have no free cell.
    full: u32,
}

impl Sheet {
    /// Puts a chart at the first place from `from` on, row by row, where it fits.
    fn put(&mut self, shape: &[Vec<u64>], width: u32, from: (u32, u32)) -> (u32, u32) {
        let words = (self.width as usize).div_ceil(64) + 1;
        let mut y = from.1.max(self.full);
        let mut x = if y == from.1 { from.0 } else { 0 };
        loop {
            while x + width <= self.width {
                if self.fits(shape, x, y) {
                    self.fill(shape, x, y, words);
                    return (x, y);
                }
                x += 1;
            }
            (x, y) = (0, y + 1);
        }
    }

    fn fits(&self, shape: &[Vec<u64>], x: u32, y: u32) -> bool {
        shape.iter().enumerate().all(|(dy, row)| {
            let Some(taken) = self.rows.get(y as usize + dy) else { return true };
            row.iter().enumerate().all(|(word, &bits)| {
                let at = x as usize / 64 + word;
                let shift = x % 64;
                let low = taken.get(at).copied().unwrap_or(0) & (bits << shift);
                let high = if shift > 0 {
                    taken.get(at + 1).copied().unwrap_or(0) & (bits >> (64 - shift))
                } else {
                    0
                };
                low == 0 && high == 0
            })
        })
    }

    fn fill(&mut self, shape: &[Vec<u64>], x: u32, y: u32, words: usize) {
        if self.rows.len() < y as usize + shape.len() {
            self.rows.resize(y as usize + shape.len(), vec![0; words]);
        }
        for (row, taken) in shape.iter().zip(&mut self.rows[y as usize..]) {
            for (word, &bits) in row.iter().enumerate() {
                let (at, shift) = (x as usize / 64 + word, x % 64);
                if let Some(taken) = taken.get_mut(at) {
                    *taken |= bits << shift;
                }
                if shift > 0
                    && let Some(taken) = taken.get_mut(at + 1)
                {
                    *taken |= bits >> (64 - shift);
                }
            }
        }
        let whole = |row: &Vec<u64>| row.iter().map(|word| word.count_ones()).sum::<u32>() >= self.width;
        while self.rows.get(self.full as usize).is_some_and(whole) {
            self.full += 1;
        }
    }
}

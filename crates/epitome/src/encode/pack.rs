//! Charts and where they go.
//!
//! A chart is a set of cells that some leaf reads across: they must stay together. Charts are placed by falling size,
//! each where it fits first from the top: small charts fill what large ones leave. Raw content may be rotated to fit
//! (paper section 4.4), which costs some bits of each entry for the 2x2 matrices that undo it; blocks of compressed
//! formats cannot be rotated without loss, and are mostly in small charts that fill 99.5 % of the sheet as they are.

use std::collections::BTreeMap;

use texfold_core::{CancelCheck, MAX_PLANE_SIDE};

use super::candidate::Candidate;
use super::orientation::Orientation;
use super::pyramid::{CellPlace, Space};
use super::reading::FRACTION_BITS;
use super::state::{Choice, Options};

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
    /// Least and largest column and row of the centres of leaves that read it, in fractions of a texel from the
    /// corner. Those of leaves across an image's edge may lie outside of it.
    centres: [(i64, i64); 2],
    /// Where the upper left corner of the rotated chart goes, in cells.
    pub(crate) place: (u32, u32),
    /// How it is rotated.
    pub(crate) orientation: Orientation,
    /// Whether the finest layer reads none of it. Such charts come last, where a GPU that has all layers need not
    /// hold them.
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
        let (x, y) = self.orientation.cell((x - self.corner.0, y - self.corner.1), self.size());
        (x + self.place.0, y + self.place.1)
    }

    /// Texels of all cells, of `side` texels: where they lie in the field, and where in the epitome.
    pub(crate) fn texels(&self, side: u32) -> impl Iterator<Item = ((u32, u32), (u32, u32))> + Clone + '_ {
        let (width, height) = self.size();
        let size = (width * side, height * side);
        let moved = move |(x, y): (u32, u32)| {
            let (left, top) = (self.corner.0 * side, self.corner.1 * side);
            let (to_x, to_y) = self.orientation.cell((x - left, y - top), size);
            ((x, y), (to_x + self.place.0 * side, to_y + self.place.1 * side))
        };
        let of_cell = move |&(x, y): &(u32, u32)| {
            (0..side * side).map(move |i| (x * side + i % side, y * side + i / side))
        };
        self.cells.iter().flat_map(of_cell).map(moved)
    }
}

impl Packing {
    /// Column and row of a candidate's centre in the epitome, in fractions of a texel, and how its content is rotated
    /// there; `None` where it has none.
    pub(crate) fn moved(
        &self,
        space: &Space,
        options: &Options,
        candidate: &Candidate,
    ) -> Option<((u32, u32), Orientation)> {
        let cell = *options.cells_of(candidate).first()?;
        let chart = self.charts.get(self.chart_of[cell as usize] as usize)?;
        let side = space.stored[usize::from(candidate.format)].cell;
        let pair = |(x, y): (u32, u32)| (units(x, side), units(y, side));
        let (corner, place) = (pair(chart.corner), pair(chart.place));
        let at = (i64::from(candidate.x) - corner.0, i64::from(candidate.y) - corner.1);
        let (x, y) = chart.orientation.point(at, pair(chart.size()));
        Some((((x + place.0).max(0) as u32, (y + place.1).max(0) as u32), chart.orientation))
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

/// What the sides of all epitomes are, and whether charts may be rotated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sides {
    /// Sides are multiples of so many cells.
    pub(crate) step: u32,
    /// Whether charts may be rotated to fit.
    pub(crate) orientations: bool,
}

/// Packs all cells that `layers` read; once `cancel` is cancelled what it gives back is of no use.
pub(crate) fn pack(
    space: &Space,
    options: &Options,
    layers: &[Choice],
    Sides { step, orientations }: Sides,
    cancel: CancelCheck<'_>,
) -> Packing {
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
        let cell = space.stored[format].cell;
        let sheet = Limits { step, side: MAX_PLANE_SIDE / cell, cell, orientations };
        let size = place(&mut packing.charts, &order, cells, sheet, cancel);
        packing.sizes.push(size);
        let drawn = order.iter().map(|&index| &packing.charts[index]).filter(|chart| !chart.is_extra);
        let rows =
            drawn.map(|chart| chart.place.1 + chart.orientation.size(chart.size()).1).max().unwrap_or(1);
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
    let centres = centres(options, layers, &mut union);
    let mut by_root: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let is_read = |&cell: &u32| layers.iter().any(|choice| choice.users[cell as usize] > 0);
    for cell in (0..cells).filter(is_read) {
        let root = union.root(cell);
        by_root.entry(root).or_default().push(cell);
    }
    let chart = |(root, members): (u32, Vec<u32>)| {
        let CellPlace { format, image, scale, .. } = space.locate(members[0]);
        let place = |&cell: &u32| {
            let CellPlace { column, row, .. } = space.locate(cell);
            (column, row)
        };
        let cells: Vec<(u32, u32)> = members.iter().map(place).collect();
        let left = cells.iter().map(|cell| cell.0).min().unwrap_or(0);
        let top = cells.iter().map(|cell| cell.1).min().unwrap_or(0);
        let finest = layers.last().map(|choice| choice.users.as_slice()).unwrap_or_default();
        let is_extra = members.iter().all(|&cell| finest.get(cell as usize) == Some(&0));
        let side = space.stored[format].cell;
        let from_corner = |(x, y): (i64, i64)| (x - units(left, side), y - units(top, side));
        let centres = centres.get(&root).map_or([(0, 0); 2], |centres| centres.map(from_corner));
        let (corner, orientation) = ((left, top), Orientation::default());
        Chart { format, image, scale, cells, corner, centres, place: (0, 0), orientation, is_extra }
    };
    by_root.into_iter().map(chart).collect()
}

/// Cells of `side` texels in fractions of a texel.
fn units(cells: u32, side: u32) -> i64 {
    (i64::from(cells) * i64::from(side)) << FRACTION_BITS
}

/// Least and largest column and row of the centres of the leaves that read each set of cells, by its root.
fn centres(options: &Options, layers: &[Choice], union: &mut Union) -> BTreeMap<u32, [(i64, i64); 2]> {
    let mut centres: BTreeMap<u32, [(i64, i64); 2]> = BTreeMap::new();
    for (node, leaf) in layers.iter().flat_map(|choice| choice.leaves.iter().enumerate()) {
        let candidate = leaf.and_then(|leaf| options.candidates[node].get(leaf as usize));
        let Some((candidate, &cell)) =
            candidate.and_then(|candidate| Some((candidate, options.cells_of(candidate).first()?)))
        else {
            continue;
        };
        let (x, y) = (i64::from(candidate.x), i64::from(candidate.y));
        let [low, high] = centres.entry(union.root(cell)).or_insert([(x, y); 2]);
        *low = (low.0.min(x), low.1.min(y));
        *high = (high.0.max(x), high.1.max(y));
    }
    centres
}

impl Chart {
    /// Columns and rows of the bounding rectangle.
    fn size(&self) -> (u32, u32) {
        let right = self.cells.iter().map(|cell| cell.0).max().unwrap_or(0);
        let bottom = self.cells.iter().map(|cell| cell.1).max().unwrap_or(0);
        (right - self.corner.0 + 1, bottom - self.corner.1 + 1)
    }

    /// Least column and row that it may have in an epitome, rotated so: centres of leaves have no negative ones.
    /// Cells are of `side` texels.
    fn least_place(&self, orientation: Orientation, side: u32) -> Cells {
        let (width, height) = self.size();
        let size = (units(width, side), units(height, side));
        let [a, b] = self.centres.map(|centre| orientation.point(centre, size));
        let cells = |below: i64| below.min(0).unsigned_abs().div_ceil(units(1, side).unsigned_abs()) as u32;
        (cells(a.0.min(b.0)), cells(a.1.min(b.1)))
    }

    /// What it is sorted by: the longer side, then the number of cells.
    fn extent(&self) -> (u32, usize) {
        let (width, height) = self.size();
        (width.max(height), self.cells.len())
    }

    /// Its rows, rotated so, as bit masks from its leftmost column on.
    fn rows(&self, orientation: Orientation) -> Vec<Vec<u64>> {
        let size = self.size();
        let (width, height) = orientation.size(size);
        let mut rows = vec![vec![0u64; (width as usize).div_ceil(64)]; height as usize];
        for &(x, y) in &self.cells {
            let (x, y) = orientation.cell((x - self.corner.0, y - self.corner.1), size);
            rows[y as usize][x as usize / 64] |= 1 << (x % 64);
        }
        rows
    }
}

/// What a sheet may be.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Its sides are multiples of so many cells, and at most so many.
    step: u32,
    side: u32,
    /// Texels a side of a cell.
    cell: u32,
    /// Whether charts may be rotated.
    orientations: bool,
}

/// Places the charts of `order`; gives the columns and rows used, at least one step each and at most `limit`, or more
/// than `limit` where they do not fit. Where a sheet about as wide as high loses much, other widths are tried, and
/// the least area is kept.
fn place(
    charts: &mut [Chart],
    order: &[usize],
    cells: u64,
    limits: Limits,
    cancel: CancelCheck<'_>,
) -> (u32, u32) {
    let Limits { step, side: limit, cell, .. } = limits;
    let widest = |chart: &Chart| chart.size().0 + chart.least_place(Orientation::default(), cell).0;
    let widest = order.iter().map(|&index| widest(&charts[index])).max().unwrap_or(1);
    if widest > limit {
        return (limit + 1, limit + 1);
    }
    let mut best: Option<(Cells, Vec<(Cells, Orientation)>)> = None;
    for share in WIDTHS {
        let width = ((cells as f64).sqrt() * share).ceil() as u32;
        let width = width.max(widest).max(1).next_multiple_of(step).min(limit);
        let (height, places) = place_within(charts, order, width, limits, cancel);
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
    for (&index, (place, orientation)) in order.iter().zip(places) {
        (charts[index].place, charts[index].orientation) = (place, orientation);
    }
    size
}

/// Rows that a sheet of `width` columns needs, at least one, and the place and orientation of each chart.
fn place_within(
    charts: &[Chart],
    order: &[usize],
    width: u32,
    limits: Limits,
    cancel: CancelCheck<'_>,
) -> (u32, Vec<(Cells, Orientation)>) {
    let mut sheet = Sheet { width, rows: Vec::new(), full: 0 };
    // Where the last chart of a shape went: no earlier place will do for the next.
    let mut hints: BTreeMap<(Vec<Vec<u64>>, Cells), Cells> = BTreeMap::new();
    let mut places = Vec::new();
    for &index in order {
        if cancel.is_cancelled() {
            break;
        }
        let chart = &charts[index];
        let mut shapes: Vec<(Vec<Vec<u64>>, Orientation)> = Vec::new();
        for orientation in Orientation::all().take(if limits.orientations { usize::MAX } else { 1 }) {
            let rows = chart.rows(orientation);
            let fits =
                orientation.size(chart.size()).0 + chart.least_place(orientation, limits.cell).0 <= width;
            if fits && !shapes.iter().any(|(known, _)| *known == rows) {
                shapes.push((rows, orientation));
            }
        }
        let found = shapes.into_iter().map(|(rows, orientation)| {
            let shape = (rows, chart.least_place(orientation, limits.cell));
            let from = hints.get(&shape).copied().unwrap_or((0, 0));
            let at = sheet.free(&shape.0, orientation.size(chart.size()).0, from, shape.1);
            (at, orientation, shape)
        });
        // The one that ends first; the first of those that are rotated least.
        let end = |at: Cells, rows: &[Vec<u64>]| (at.1 + rows.len() as u32, at.1, at.0);
        let Some((at, orientation, shape)) = found.min_by_key(|(at, _, shape)| end(*at, &shape.0)) else {
            // Never: a sheet is as wide as the widest chart that is not rotated.
            places.push(((0, 0), Orientation::default()));
            continue;
        };
        sheet.fill(&shape.0, at);
        places.push((at, orientation));
        hints.insert(shape, at);
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
    /// The first place from `from` on, row by row, where a chart fits, no less than `least` in column and row.
    fn free(&self, shape: &[Vec<u64>], width: u32, from: Cells, least: Cells) -> Cells {
        let mut y = from.1.max(self.full).max(least.1);
        let mut x = if y == from.1 { from.0.max(least.0) } else { least.0 };
        loop {
            while x + width <= self.width {
                if self.fits(shape, x, y) {
                    return (x, y);
                }
                x += 1;
            }
            (x, y) = (least.0, y + 1);
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

    fn fill(&mut self, shape: &[Vec<u64>], (x, y): Cells) {
        let words = (self.width as usize).div_ceil(64) + 1;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A chart of those cells of format 0.
    fn chart(cells: &[Cells]) -> Chart {
        let mut cells = cells.to_vec();
        cells.sort_by_key(|&(x, y)| (y, x));
        let corner =
            (cells.iter().map(|cell| cell.0).min().unwrap(), cells.iter().map(|cell| cell.1).min().unwrap());
        let (place, orientation) = ((0, 0), Orientation::default());
        let centres = [(0, 0); 2];
        Chart { format: 0, image: 0, scale: 0, cells, corner, centres, place, orientation, is_extra: false }
    }

    #[test]
    fn rotated_charts_fill_what_upright_ones_leave() {
        // Triangles of 10 cells, all alike: two of them, one rotated by half, are a rectangle of 5 x 4.
        let cells: Vec<Cells> = (0..4).flat_map(|y| (0..=y).map(move |x| (7 + x, 3 + y))).collect();
        let mut charts = vec![chart(&cells); 8];
        let order: Vec<usize> = (0..8).collect();
        let area = |size: Cells| size.0 * size.1;
        let upright = place(
            &mut charts,
            &order,
            80,
            Limits { step: 1, side: 64, cell: 4, orientations: false },
            CancelCheck::default(),
        );
        assert!(charts.iter().all(|chart| chart.orientation == Orientation::default()));
        let rotated = place(
            &mut charts,
            &order,
            80,
            Limits { step: 1, side: 64, cell: 4, orientations: true },
            CancelCheck::default(),
        );
        assert!(area(rotated) < area(upright) && area(rotated) <= 88, "{rotated:?} {upright:?}");
        // No cell lies on another or outside, and texels go where their cells go.
        let mut taken = std::collections::BTreeSet::new();
        for chart in &charts {
            for &cell in &chart.cells {
                let (x, y) = chart.place_of(cell);
                assert!(x < rotated.0 && y < rotated.1 && taken.insert((x, y)), "{x} {y}");
            }
            for ((x, y), (to_x, to_y)) in chart.texels(4) {
                assert_eq!((to_x / 4, to_y / 4), chart.place_of((x / 4, y / 4)));
            }
        }
    }
}

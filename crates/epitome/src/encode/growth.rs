//! Greedy growth of the epitome for tolerances (paper section 4.2), where any candidate will do and only cells count.
//!
//! What a cell would bring is the area of the blocks that become reconstructable with all cells that candidates
//! through it need, less the area of the cells that are new. The cell that brings most goes first. What cells bring
//! falls nearly everywhere as the epitome grows, so a cell is only looked at again when it comes up.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use texfold_core::CancelCheck;

use super::leaf::Grid;
use super::state::Options;

/// A candidate through a cell.
#[derive(Debug, Clone, Copy)]
struct Through {
    node: u32,
    candidate: u32,
}

/// A cell and what it brought when it was last looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Offer {
    benefit: i64,
    cell: u32,
}

impl Ord for Offer {
    fn cmp(&self, other: &Self) -> Ordering {
        // Of equal offers the first cell.
        self.benefit.cmp(&other.benefit).then(other.cell.cmp(&self.cell))
    }
}

impl PartialOrd for Offer {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

struct Growth<'a> {
    grid: &'a Grid,
    options: &'a Options,
    /// Texels of a cell.
    cell_texels: u32,
    /// For each cell the candidates that read it.
    through: Vec<Vec<Through>>,
    kept: Vec<bool>,
    /// For each node how many cells each candidate still lacks.
    missing: Vec<Vec<u32>>,
    done: Vec<bool>,
    /// Marks of cells and nodes seen while an offer is reckoned, by its number.
    seen_cell: Vec<u32>,
    seen_node: Vec<u32>,
    round: u32,
}

/// For each node the candidate with the least error among those whose cells are all kept.
///
/// Once `cancel` is cancelled what it gives back is of no use.
pub(crate) fn grow(
    grid: &Grid,
    options: &Options,
    cells: usize,
    cell_texels: u32,
    cancel: CancelCheck<'_>,
) -> Vec<Option<u32>> {
    let mut growth = Growth::new(grid, options, cells, cell_texels);
    growth.run(cancel);
    let best = |(node, missing): (usize, &Vec<u32>)| {
        let ready = (0u32..).zip(missing).filter(|(_, missing)| **missing == 0).map(|(index, _)| index);
        let error = |index: &u32| options.candidates[node][*index as usize].error;
        ready.min_by(|a, b| error(a).total_cmp(&error(b)))
    };
    growth.missing.iter().enumerate().map(best).collect()
}

impl<'a> Growth<'a> {
    fn new(grid: &'a Grid, options: &'a Options, cells: usize, cell_texels: u32) -> Self {
        let mut through = vec![Vec::new(); cells];
        for (node, candidates) in (0u32..).zip(&options.candidates) {
            for (number, candidate) in (0u32..).zip(candidates) {
                for &cell in options.cells_of(candidate) {
                    through[cell as usize].push(Through { node, candidate: number });
                }
            }
        }
        let count = |candidate: &super::candidate::Candidate| candidate.cells.1 - candidate.cells.0;
        let missing: Vec<Vec<u32>> =
            options.candidates.iter().map(|candidates| candidates.iter().map(count).collect()).collect();
        let done = missing.iter().map(Vec::is_empty).collect();
        Growth {
            grid,
            options,
            cell_texels,
            through,
            kept: vec![false; cells],
            missing,
            done,
            seen_cell: vec![0; cells],
            seen_node: vec![0; grid.nodes()],
            round: 0,
        }
    }

    fn run(&mut self, cancel: CancelCheck<'_>) {
        let mut heap = BinaryHeap::new();
        for cell in (0..self.through.len() as u32).take_while(|_| !cancel.is_cancelled()) {
            if let Some(benefit) = self.benefit(cell) {
                heap.push(Offer { benefit, cell });
            }
        }
        while let Some(Offer { cell, .. }) = heap.pop() {
            if cancel.is_cancelled() {
                return;
            }
            let Some(benefit) = self.benefit(cell) else { continue };
            let offer = Offer { benefit, cell };
            if heap.peek().is_some_and(|next| *next > offer) {
                heap.push(offer);
                continue;
            }
            self.keep_all(cell);
        }
    }

    /// Candidates through `cell` of blocks that are not reconstructed yet: of each block the one that lacks least.
    fn open(&mut self, cell: u32) -> Vec<Through> {
        self.round += 1;
        let mut best: Vec<Through> = Vec::new();
        for &through in &self.through[cell as usize] {
            if self.done[through.node as usize] {
                continue;
            }
            let lacks = |t: Through| self.missing[t.node as usize][t.candidate as usize];
            if self.seen_node[through.node as usize] != self.round {
                self.seen_node[through.node as usize] = self.round;
                best.push(through);
            } else if let Some(known) = best.iter_mut().find(|known| known.node == through.node)
                && lacks(through) < lacks(*known)
            {
                *known = through;
            }
        }
        best
    }

    /// Texels that become reconstructable less texels that are added; `None` where nothing would.
    fn benefit(&mut self, cell: u32) -> Option<i64> {
        let open = self.open(cell);
        if open.is_empty() {
            return None;
        }
        let mut benefit = 0i64;
        for through in open {
            let node = self.grid.node(through.node as usize);
            benefit += i64::from(node.inside.x * node.inside.y);
            let candidate = &self.options.candidates[through.node as usize][through.candidate as usize];
            for &cell in self.options.cells_of(candidate) {
                if !self.kept[cell as usize] && self.seen_cell[cell as usize] != self.round {
                    self.seen_cell[cell as usize] = self.round;
                    benefit -= i64::from(self.cell_texels);
                }
            }
        }
        Some(benefit)
    }

    fn keep_all(&mut self, cell: u32) {
        for through in self.open(cell) {
            let candidate = self.options.candidates[through.node as usize][through.candidate as usize];
            for at in candidate.cells.0..candidate.cells.1 {
                self.keep(self.options.cells[at as usize]);
            }
        }
    }

    fn keep(&mut self, cell: u32) {
        if std::mem::replace(&mut self.kept[cell as usize], true) {
            return;
        }
        for &Through { node, candidate } in &self.through[cell as usize] {
            let missing = &mut self.missing[node as usize][candidate as usize];
            *missing -= 1;
            if *missing == 0 {
                self.done[node as usize] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::candidate::Candidate;
    use super::*;
    use texfold_core::ImageSize;

    #[test]
    fn the_shared_place_is_kept_and_the_others_are_not() {
        // Three blocks of four cells; each has its own cells, and all may read those of the second.
        let grid = Grid::new(&[ImageSize { width: 24, height: 8 }], 8, false);
        let cells: Vec<u32> = (0..12).collect();
        let at = |block: u32, error: f32| Candidate::of_cells(error, (4 * block, 4 * block + 4));
        let candidates = (0..3).map(|block| vec![at(block, 0.0), at(1, 1.0)]).collect();
        let options = Options { candidates, cells };
        assert_eq!(grow(&grid, &options, 12, 16, CancelCheck::default()), [Some(1), Some(0), Some(1)]);
    }
}

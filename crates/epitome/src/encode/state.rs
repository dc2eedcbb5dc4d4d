//! What leaves may be, what that costs, and what each is for now.

use texfold_core::CancelCheck;

use super::candidate::Candidate;
use super::leaf::{Grid, SPLIT_NODES};

/// Cost of a cell to keep away from, in its own.
const SHUNNED: f32 = 3.0;
/// Bits of a block that may be split: a word of the map.
const BLOCK_BITS: f64 = 32.0;

/// Everything that leaves could be.
#[derive(Debug, Default)]
pub(crate) struct Options {
    /// For each node.
    pub(crate) candidates: Vec<Vec<Candidate>>,
    /// Cells of all candidates.
    pub(crate) cells: Vec<u32>,
}

impl Options {
    /// Cells of a candidate.
    #[inline]
    pub(crate) fn cells_of(&self, candidate: &Candidate) -> &[u32] {
        &self.cells[candidate.cells.0 as usize..candidate.cells.1 as usize]
    }
}

/// What bits cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Costs<'a> {
    /// Error that a bit may cost, 8-bit squared units.
    pub(crate) lambda: f32,
    /// Bits of a leaf's entry.
    pub(crate) entry_bits: f32,
    /// Bits of a cell, by format.
    pub(crate) cell_bits: &'a [f32],
    /// Where cells differ in bits: those of each, in bits of a cell of its format.
    pub(crate) shares: &'a [f32],
    /// Number of cells, by format.
    pub(crate) cells: &'a [u32],
    /// The other layers of a layered file, if any.
    pub(crate) others: Option<Others<'a>>,
}

/// Layers between which one is chosen. What they have is stored anyway, only earlier; all else is stored for the
/// layer alone, and costs more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Others<'a> {
    /// For each node that is a leaf of the finest and of the next coarser layer its candidate's number.
    pub(crate) leaves: [&'a [Option<u32>]; 2],
    /// For each cell whether a layer has it.
    pub(crate) cells: &'a [bool],
    /// Weight of a bit that no layer has, in bits.
    pub(crate) dear: f32,
}

impl Costs<'_> {
    /// What the entry of a candidate costs, in entries.
    #[inline]
    pub(super) fn entry_cost(&self, node: usize, candidate: usize) -> f32 {
        match self.others {
            Some(others) if others.leaves.iter().all(|of| of[node] != Some(candidate as u32)) => others.dear,
            _ => 1.0,
        }
    }

    /// What a cell costs, in cells.
    #[inline]
    pub(super) fn cell_cost(&self, cell: u32) -> f32 {
        let share = self.share(cell);
        match self.others {
            Some(others) if !others.cells[cell as usize] => others.dear * share,
            _ => share,
        }
    }

    /// Bits of a cell, in those of a cell of its format.
    #[inline]
    pub(super) fn share(&self, cell: u32) -> f32 {
        self.shares.get(cell as usize).copied().unwrap_or(1.0)
    }
}

/// What was chosen.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Choice {
    /// For each node that is a leaf its candidate's number.
    pub(crate) leaves: Vec<Option<u32>>,
    /// For each cell how many leaves read it.
    pub(crate) users: Vec<u32>,
    /// Squared error of all leaves.
    pub(crate) error: f64,
    /// Bits of cells, entries and block words.
    pub(crate) bits: f64,
}

impl Choice {
    /// What those leaves come to.
    pub(crate) fn of(problem: Problem<'_>, leaves: &[Option<u32>]) -> Self {
        let mut state = State::new(problem);
        for (node, candidate) in leaves.iter().enumerate() {
            if let Some(candidate) = candidate {
                state.take(node, *candidate);
            }
        }
        state.finish()
    }

    /// PSNR in dB over so many texels.
    pub(crate) fn psnr(&self, texels: f64) -> f64 {
        10.0 * (255.0 * 255.0 * 3.0 * texels / self.error.max(1e-9)).log10()
    }
}

/// What is to be chosen: for every block of `grid` leaves, each with one of `options`.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) grid: &'a Grid,
    pub(crate) options: &'a Options,
    pub(crate) costs: Costs<'a>,
    /// Once this is cancelled, whatever is chosen is of no use, and is given back early.
    pub(crate) cancel: CancelCheck<'a>,
}

/// Leaves as they are chosen now.
pub(super) struct State<'a> {
    pub(super) grid: &'a Grid,
    pub(super) options: &'a Options,
    pub(super) costs: Costs<'a>,
    pub(super) cancel: CancelCheck<'a>,
    pub(super) leaves: Vec<Option<u32>>,
    pub(super) users: Vec<u32>,
    /// 0: costs are shared; 1: costs are marginal.
    pub(super) settled: f32,
    /// Cells to keep away from, ascending.
    pub(super) shunned: Vec<u32>,
}

impl<'a> State<'a> {
    pub(super) fn new(Problem { grid, options, costs, cancel }: Problem<'a>) -> Self {
        let users = vec![0; costs.cells.iter().sum::<u32>() as usize];
        State {
            grid,
            options,
            costs,
            cancel,
            leaves: vec![None; grid.nodes()],
            users,
            settled: 1.0,
            shunned: Vec::new(),
        }
    }

    /// All blocks in order, or in the opposite order.
    pub(super) fn sweep(&mut self, backwards: bool) {
        let blocks = self.grid.blocks();
        for index in 0..blocks {
            if self.cancel.is_cancelled() {
                return;
            }
            self.settle(if backwards { blocks - 1 - index } else { index }, true);
        }
    }

    /// Chooses the leaves of one block anew. Unless `shared`, costs take no account of other blocks.
    pub(super) fn settle(&mut self, block: usize, shared: bool) {
        let per_block = self.grid.per_block();
        let first = block * per_block;
        for node in first..first + per_block {
            self.release(node);
        }
        let best: Vec<(f32, u32)> = (first..first + per_block).map(|node| self.best(node, shared)).collect();
        let chosen = self.tree(first, &best);
        for local in chosen {
            let (_, candidate) = best[local];
            self.take(first + local, candidate);
        }
    }

    /// Local numbers of the leaves with the least cost.
    fn tree(&self, first: usize, best: &[(f32, u32)]) -> Vec<usize> {
        if best.len() < SPLIT_NODES {
            return vec![0];
        }
        let outside = |local: usize| self.grid.node(first + local).is_outside();
        let cost = |local: usize| if outside(local) { self.outside_cost() } else { best[local].0 };
        let (mut leaves, mut split_cost) = (Vec::new(), 0.0);
        for quarter in 0..4 {
            let parts: Vec<usize> = (0..4).map(|part| 5 + 4 * quarter + part).collect();
            let of_parts: f32 = parts.iter().map(|&part| cost(part)).sum();
            if of_parts < cost(1 + quarter) {
                split_cost += of_parts;
                leaves.extend(parts);
            } else {
                split_cost += cost(1 + quarter);
                leaves.push(1 + quarter);
            }
        }
        if best[0].0 <= split_cost { vec![0] } else { leaves }
    }

    /// A leaf outside of the image has an entry all the same.
    fn outside_cost(&self) -> f32 {
        self.costs.lambda * self.costs.entry_bits
    }

    /// The candidate of least cost of a node.
    fn best(&self, node: usize, shared: bool) -> (f32, u32) {
        let mut best = (f32::INFINITY, 0);
        let entry = self.outside_cost();
        for (index, candidate) in self.options.candidates[node].iter().enumerate() {
            let mut cost = candidate.error + self.costs.entry_cost(node, index) * entry;
            if cost >= best.0 {
                continue;
            }
            let bits = self.costs.cell_bits[usize::from(candidate.format)] * self.costs.lambda;
            let cells = self.options.cells_of(candidate);
            if shared {
                let mut weight = 0.0;
                for &cell in cells {
                    weight += self.reader_share(cell) * self.costs.cell_cost(cell);
                }
                cost += bits * weight;
            } else {
                cost += bits * cells.iter().map(|&cell| self.costs.cell_cost(cell)).sum::<f32>();
            }
            if cost < best.0 {
                best = (cost, index as u32);
            }
        }
        best
    }

    /// What one more reader pays of a cell's cost.
    #[inline]
    fn reader_share(&self, cell: u32) -> f32 {
        if !self.shunned.is_empty() && self.shunned.binary_search(&cell).is_ok() {
            return SHUNNED;
        }
        match self.users[cell as usize] {
            0 => 1.0,
            others => (1.0 - self.settled) / (others + 1) as f32,
        }
    }

    pub(super) fn release(&mut self, node: usize) {
        if let Some(candidate) = self.leaves[node].take()
            && let Some(candidate) = self.options.candidates[node].get(candidate as usize)
        {
            for &cell in self.options.cells_of(candidate) {
                self.users[cell as usize] -= 1;
            }
        }
    }

    pub(super) fn take(&mut self, node: usize, candidate: u32) {
        self.leaves[node] = Some(candidate);
        if let Some(candidate) = self.options.candidates[node].get(candidate as usize) {
            for &cell in self.options.cells_of(candidate) {
                self.users[cell as usize] += 1;
            }
        }
    }

    pub(super) fn finish(self) -> Choice {
        let (mut error, mut bits) = (0.0f64, 0.0f64);
        for (node, leaf) in self.leaves.iter().enumerate() {
            let Some(leaf) = leaf else { continue };
            bits += f64::from(self.costs.entry_bits);
            if let Some(candidate) = self.options.candidates[node].get(*leaf as usize) {
                error += f64::from(candidate.error);
            }
        }
        let mut users = (0u32..).zip(&self.users);
        for (&cells, &bits_each) in self.costs.cells.iter().zip(self.costs.cell_bits) {
            let used = users.by_ref().take(cells as usize).filter(|(_, users)| **users > 0);
            let used: f64 = used.map(|(cell, _)| f64::from(self.costs.share(cell))).sum();
            bits += used * f64::from(bits_each);
        }
        if self.grid.split {
            bits += BLOCK_BITS * self.grid.blocks() as f64;
        }
        Choice { leaves: self.leaves, users: self.users, error, bits }
    }
}

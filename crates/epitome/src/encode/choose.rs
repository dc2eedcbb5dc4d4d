//! Which leaves, and what each shows: the least error + lambda x bits.
//!
//! A cell is paid for once, however many leaves read it. Its price for one more reader is its bits shared among its readers
//! at first, and what it would really add (nothing where somebody else reads it) at the end; in between the prices go over
//! from one to the other, so that leaves first gather where content is good and then settle.

use super::candidate::Candidate;
use super::leaf::{Grid, SPLIT_NODES};

/// Passes over all blocks.
const SWEEPS: usize = 12;
/// Price of a cell to keep away from, in its own.
const SHUNNED: f32 = 3.0;

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
    /// The other layers of a progressive file, if any.
    pub(crate) others: Option<Others<'a>>,
}

/// Layers between which one is chosen. What they have is stored anyway, only earlier; all else is stored for the layer
/// alone, and costs more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Others<'a> {
    /// For each node that is a leaf of the finest and of the next coarser layer its candidate's number.
    pub(crate) leaves: [&'a [Option<u32>]; 2],
    /// For each cell whether a layer has it.
    pub(crate) cells: &'a [bool],
    /// Price of a bit that no layer has, in bits.
    pub(crate) dear: f32,
}

impl Costs<'_> {
    /// What the entry of a candidate costs, in entries.
    #[inline]
    pub(super) fn entry_price(&self, node: usize, candidate: usize) -> f32 {
        match self.others {
            Some(others) if others.leaves.iter().all(|of| of[node] != Some(candidate as u32)) => others.dear,
            _ => 1.0,
        }
    }

    /// What a cell costs, in cells.
    #[inline]
    pub(super) fn cell_price(&self, cell: u32) -> f32 {
        let share = self.share(cell);
        match self.others {
            Some(others) if !others.cells[cell as usize] => others.dear * share,
            _ => share,
        }
    }

    /// Bits of a cell, in those of a cell of its format.
    #[inline]
    fn share(&self, cell: u32) -> f32 {
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
    pub(crate) fn of(grid: &Grid, options: &Options, costs: Costs<'_>, leaves: &[Option<u32>]) -> Self {
        let mut state = State::new(grid, options, costs);
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

pub(super) struct State<'a> {
    pub(super) grid: &'a Grid,
    pub(super) options: &'a Options,
    pub(super) costs: Costs<'a>,
    pub(super) leaves: Vec<Option<u32>>,
    pub(super) users: Vec<u32>,
    /// 0: prices are shared; 1: prices are marginal.
    settled: f32,
    /// Cells to keep away from, ascending.
    pub(super) shunned: Vec<u32>,
}

/// As [`choose`], and then blocks that share content are chosen together: five photographs came out 0.4 to 3 % smaller, two of
/// one scene 6 %, for three to five times the time of choosing.
pub(crate) fn choose_well(grid: &Grid, options: &Options, costs: Costs<'_>) -> Choice {
    let mut state = chosen(grid, options, costs);
    state.regroup();
    state.finish()
}

/// Chooses leaves for the whole grid, block by block.
pub(crate) fn choose(grid: &Grid, options: &Options, costs: Costs<'_>) -> Choice {
    chosen(grid, options, costs).finish()
}

fn chosen<'a>(grid: &'a Grid, options: &'a Options, costs: Costs<'a>) -> State<'a> {
    let mut state = State::new(grid, options, costs);
    // Every block by itself, as if nobody shared.
    for block in 0..grid.blocks() {
        state.settle(block, false);
    }
    for sweep in 0..SWEEPS {
        // Slowly at first: small sets gather better so, by 3 %.
        state.settled = (sweep as f32 / (SWEEPS - 3) as f32).min(1.0).powi(2);
        state.sweep(sweep % 2 == 1);
    }
    state
}

/// Improves leaves that were chosen otherwise, until nothing changes or enough passes are done: no pass costs more than what
/// it started from.
pub(crate) fn improve(grid: &Grid, options: &Options, costs: Costs<'_>, start: &[Option<u32>]) -> Choice {
    let mut state = State::new(grid, options, costs);
    for (node, candidate) in start.iter().enumerate() {
        state.take(node, candidate.unwrap_or(0));
    }
    for sweep in 0..SWEEPS {
        let before = state.leaves.clone();
        state.sweep(sweep % 2 == 1);
        if state.leaves == before {
            break;
        }
    }
    state.finish()
}

/// For each node the error above which a match elsewhere gains nothing, even with cells that cost nothing: what its own
/// content, whole or split, costs less an entry.
pub(crate) fn most_errors(grid: &Grid, direct: &Options, costs: Costs<'_>) -> Vec<f32> {
    let entry = costs.lambda * costs.entry_bits;
    let own = |node: usize| {
        let cost = |candidate: &Candidate| {
            let cells: f32 = direct.cells_of(candidate).iter().map(|&cell| costs.share(cell)).sum();
            candidate.error + entry + costs.lambda * costs.cell_bits[usize::from(candidate.format)] * cells
        };
        let least = direct.candidates[node].iter().map(cost).fold(f32::INFINITY, f32::min);
        if least.is_finite() { least } else { entry }
    };
    let mut least: Vec<f32> = (0..grid.nodes()).map(own).collect();
    if grid.per_block() == SPLIT_NODES {
        for block in least.chunks_mut(SPLIT_NODES) {
            for quarter in 0..4 {
                let parts: f32 = block[5 + 4 * quarter..9 + 4 * quarter].iter().sum();
                block[1 + quarter] = block[1 + quarter].min(parts);
            }
            block[0] = block[0].min(block[1..5].iter().sum());
        }
    }
    least.into_iter().map(|cost| cost - entry).collect()
}

impl<'a> State<'a> {
    pub(super) fn new(grid: &'a Grid, options: &'a Options, costs: Costs<'a>) -> Self {
        let users = vec![0; costs.cells.iter().sum::<u32>() as usize];
        State {
            grid,
            options,
            costs,
            leaves: vec![None; grid.nodes()],
            users,
            settled: 1.0,
            shunned: Vec::new(),
        }
    }

    /// All blocks in order, or in the opposite order.
    fn sweep(&mut self, backwards: bool) {
        let blocks = self.grid.blocks();
        for index in 0..blocks {
            self.settle(if backwards { blocks - 1 - index } else { index }, true);
        }
    }

    /// Chooses the leaves of one block anew. Unless `shared`, prices take no account of other blocks.
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
            let mut cost = candidate.error + self.costs.entry_price(node, index) * entry;
            if cost >= best.0 {
                continue;
            }
            let bits = self.costs.cell_bits[usize::from(candidate.format)] * self.costs.lambda;
            let cells = self.options.cells_of(candidate);
            if shared {
                let mut price = 0.0;
                for &cell in cells {
                    price += self.reader_share(cell) * self.costs.cell_price(cell);
                }
                cost += bits * price;
            } else {
                cost += bits * cells.iter().map(|&cell| self.costs.cell_price(cell)).sum::<f32>();
            }
            if cost < best.0 {
                best = (cost, index as u32);
            }
        }
        best
    }

    /// What one more reader pays of a cell's price.
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

    fn finish(self) -> Choice {
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
            bits += 32.0 * self.grid.blocks() as f64;
        }
        Choice { leaves: self.leaves, users: self.users, error, bits }
    }
}

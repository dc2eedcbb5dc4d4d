//! Blocks that share content, chosen together. A block alone never leaves cells that another one reads too, since
//! they cost it nothing, nor does the other; here all readers of a leaf's cells leave them at once.

use super::state::State;

/// Passes over all leaves; those after the first look only at what the one before changed.
const ROUNDS: usize = 2;
/// Most blocks that are chosen together.
const MOST_BLOCKS: usize = 8;

/// Which blocks read each cell.
struct Readers {
    /// First reader of each cell, and the end.
    starts: Vec<u32>,
    blocks: Vec<u32>,
}

impl Readers {
    fn of(&self, cell: u32) -> &[u32] {
        let at = |cell: usize| self.starts[cell] as usize;
        &self.blocks[at(cell as usize)..at(cell as usize + 1)]
    }
}

/// For each leaf: all blocks that read its cells choose anew, keeping away from them at first, and stay so where it
/// costs less.
pub(super) fn regroup(state: &mut State<'_>) {
    let per_block = state.grid.per_block();
    let mut changed = vec![true; state.grid.blocks()];
    for _ in 0..ROUNDS {
        let readers = state.readers();
        let mut changes = vec![false; changed.len()];
        for node in 0..state.leaves.len() {
            if state.cancel.is_cancelled() {
                return;
            }
            let cells = state.cells_of(node);
            let mut blocks: Vec<u32> = cells.iter().flat_map(|&cell| readers.of(cell)).copied().collect();
            blocks.sort_unstable();
            blocks.dedup();
            let few = (2..=MOST_BLOCKS).contains(&blocks.len());
            if few
                && (changed[node / per_block] || blocks.iter().any(|&block| changed[block as usize]))
                && state.leave(&blocks, cells)
            {
                blocks.iter().for_each(|&block| changes[block as usize] = true);
            }
        }
        changed = changes;
    }
}

impl State<'_> {
    /// Which blocks read each cell now.
    fn readers(&self) -> Readers {
        let mut starts = vec![0u32; self.users.len() + 1];
        for (cell, &users) in self.users.iter().enumerate() {
            starts[cell + 1] = starts[cell] + users;
        }
        let mut next = starts.clone();
        let mut blocks = vec![0u32; starts.last().map_or(0, |&end| end as usize)];
        for node in 0..self.leaves.len() {
            for cell in self.cells_of(node) {
                let at = &mut next[cell as usize];
                blocks[*at as usize] = (node / self.grid.per_block()) as u32;
                *at += 1;
            }
        }
        Readers { starts, blocks }
    }

    /// Cells of a node that is a leaf.
    fn cells_of(&self, node: usize) -> Vec<u32> {
        let candidate =
            self.leaves[node].and_then(|number| self.options.candidates[node].get(number as usize));
        candidate.map(|candidate| self.options.cells_of(candidate).to_vec()).unwrap_or_default()
    }

    /// Lets `blocks` choose without `cells`, then freely; whether that cost less. Otherwise nothing changes.
    fn leave(&mut self, blocks: &[u32], mut cells: Vec<u32>) -> bool {
        let before = self.lift(blocks);
        cells.sort_unstable();
        for shunned in [cells, Vec::new()] {
            self.shunned = shunned;
            blocks.iter().for_each(|&block| self.settle(block as usize, true));
        }
        let after = self.lift(blocks);
        let better = after.cost < before.cost;
        for (node, candidate) in if better { after.leaves } else { before.leaves } {
            self.take(node, candidate);
        }
        better
    }

    /// Releases the leaves of `blocks`, which cost so much.
    fn lift(&mut self, blocks: &[u32]) -> Lifted {
        let per_block = self.grid.per_block();
        let mut lifted = Lifted { leaves: Vec::new(), cost: 0.0 };
        for node in
            blocks.iter().flat_map(|&block| (0..per_block).map(move |i| block as usize * per_block + i))
        {
            let Some(number) = self.leaves[node] else { continue };
            lifted.leaves.push((node, number));
            let cells = self.cells_of(node);
            self.release(node);
            let options = &self.options.candidates[node];
            let Some(candidate) = options.get(number as usize) else { continue };
            let freed = cells.iter().filter(|&&cell| self.users[cell as usize] == 0);
            let cells: f32 = freed.map(|&cell| self.costs.cell_cost(cell)).sum();
            let bits = self.costs.entry_cost(node, number as usize) * self.costs.entry_bits
                + cells * self.costs.cell_bits[usize::from(candidate.format)];
            lifted.cost += f64::from(candidate.error + self.costs.lambda * bits);
        }
        lifted
    }
}

/// Leaves that were released.
struct Lifted {
    /// Nodes and the numbers of their candidates.
    leaves: Vec<(usize, u32)>,
    /// What they cost, with the cells that nobody else reads.
    cost: f64,
}

#[cfg(test)]
mod tests {
    use super::super::candidate::Candidate;
    use super::super::leaf::Grid;
    use super::super::state::{Costs, Options, Problem};
    use super::*;
    use proptest::prelude::*;
    use texfold_core::{CancelCheck, ImageSize};

    fn problem<'a>(grid: &'a Grid, options: &'a Options, cells: &'a [u32; 1]) -> Problem<'a> {
        Problem { grid, options, costs: costs(cells), cancel: CancelCheck::default() }
    }

    fn costs(cells: &[u32; 1]) -> Costs<'_> {
        Costs { lambda: 1.0, entry_bits: 8.0, cell_bits: &[64.0], shares: &[], cells, others: None }
    }

    /// A leaf of those cells.
    fn candidate(options: &mut Options, error: f32, cells: &[u32]) -> Candidate {
        let start = options.cells.len() as u32;
        options.cells.extend(cells);
        let end = start + cells.len() as u32;
        Candidate::of_cells(error, (start, end))
    }

    #[test]
    fn two_readers_leave_together_for_what_a_third_one_keeps() {
        // Cell 0 is read by the first two blocks, and costs 64; with cell 1, which the third reads, each has an error
        // of 20.
        let grid = Grid::new(&[ImageSize { width: 24, height: 8 }], 8, false);
        let mut options = Options::default();
        for block in 0..3 {
            let own = u32::from(block == 2);
            let candidates = vec![candidate(&mut options, 0.0, &[own]), candidate(&mut options, 20.0, &[1])];
            options.candidates.push(candidates);
        }
        let mut state = State::new(problem(&grid, &options, &[2]));
        (0..3).for_each(|node| state.take(node, 0));
        (0..3).for_each(|block| state.settle(block, true));
        assert_eq!(state.leaves, [Some(0), Some(0), Some(0)]);
        regroup(&mut state);
        assert_eq!(state.leaves[..2], [Some(1), Some(1)]);
        assert_eq!(state.users[0], 0);
    }

    proptest! {
        #[test]
        fn it_never_costs_more(
            blocks in proptest::collection::vec(
                proptest::collection::vec(
                    (0.0f32..200.0, proptest::collection::btree_set(0u32..12, 1..5)), 1..5,
                ),
                1..9,
            ),
            start in proptest::collection::vec(0usize..4, 9),
        ) {
            let size = ImageSize { width: 8 * blocks.len() as u32, height: 8 };
            let grid = Grid::new(&[size], 8, false);
            let mut options = Options::default();
            for block in &blocks {
                let cells = |cells: &std::collections::BTreeSet<u32>| cells.iter().copied().collect::<Vec<_>>();
                let candidates =
                    block.iter().map(|(error, set)| candidate(&mut options, *error, &cells(set))).collect();
                options.candidates.push(candidates);
            }
            let mut state = State::new(problem(&grid, &options, &[12]));
            for (node, block) in blocks.iter().enumerate() {
                state.take(node, (start[node] % block.len()) as u32);
            }
            // What everything costs, from the leaves alone.
            let cost = |state: &State<'_>| {
                let leaves: Vec<u32> = state.leaves.iter().map(|leaf| leaf.unwrap()).collect();
                let taken = leaves.iter().enumerate().map(|(node, &leaf)| &options.candidates[node][leaf as usize]);
                let errors: f32 = taken.clone().map(|candidate| candidate.error + 8.0).sum();
                let mut users = vec![0u32; 12];
                taken.flat_map(|candidate| options.cells_of(candidate)).for_each(|&cell| users[cell as usize] += 1);
                assert_eq!(users, state.users);
                errors + 64.0 * users.iter().filter(|&&users| users > 0).count() as f32
            };
            let before = cost(&state);
            regroup(&mut state);
            prop_assert!(cost(&state) <= before + 1e-2, "{} after {before}", cost(&state));
        }
    }
}

//! Which leaves, and which content each reads: the least error + lambda x bits.
//!
//! A cell is paid for once, however many leaves read it. Its cost for one more reader is its bits shared among its
//! readers at first, and what it would really add (nothing where somebody else reads it) at the end; in between the
//! costs go over from one to the other, so that leaves first gather where content is good and then settle.

use super::candidate::Candidate;
use super::leaf::SPLIT_NODES;
use super::regroup::regroup;
use super::state::{Choice, Problem, State};

/// Passes over all blocks.
const SWEEPS: usize = 12;
/// Passes at the end in which costs are marginal.
const SETTLED_SWEEPS: usize = 3;

/// As [`choose`], and then blocks that share content are chosen together: five photographs came out 0.4 to 3 %
/// smaller, two of one scene 6 %, for three to five times the time of choosing.
pub(crate) fn choose_well(problem: Problem<'_>) -> Choice {
    let mut state = chosen(problem);
    regroup(&mut state);
    state.finish()
}

/// Chooses leaves for the whole grid, block by block.
pub(crate) fn choose(problem: Problem<'_>) -> Choice {
    chosen(problem).finish()
}

fn chosen(problem: Problem<'_>) -> State<'_> {
    let mut state = State::new(problem);
    // Every block by itself, as if nobody shared.
    for block in 0..problem.grid.blocks() {
        if problem.cancel.is_cancelled() {
            break;
        }
        state.settle(block, false);
    }
    for sweep in 0..SWEEPS {
        // Slowly at first: small sets gather better so, by 3 %.
        state.settled = (sweep as f32 / (SWEEPS - SETTLED_SWEEPS) as f32).min(1.0).powi(2);
        state.sweep(sweep % 2 == 1);
    }
    state
}

/// Improves leaves that were chosen otherwise, until nothing changes or enough passes are done: no pass costs more
/// than what it started from.
pub(crate) fn improve(problem: Problem<'_>, start: &[Option<u32>]) -> Choice {
    let mut state = State::new(problem);
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

/// For each node the error above which a match elsewhere gains nothing, even with cells that cost nothing: what its
/// own content, whole or split, costs less an entry.
pub(crate) fn most_errors(problem: Problem<'_>) -> Vec<f32> {
    let Problem { grid, options: direct, costs, .. } = problem;
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

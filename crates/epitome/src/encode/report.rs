//! What was modelled, in a sentence.

use texfold_bc::Family;
use texfold_core::{Access, Goal, Notes};

use super::candidate::Candidate;
use super::leaf::{Grid, Node};
use super::pyramid::SCALES;
use super::reading::FRACTION_BITS;
use super::state::{Choice, Options};
use crate::{EpitomeParams, ToleranceKind};

/// Texels of the images by where their content comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Shares {
    /// From another place.
    pub(crate) borrowed: u64,
    /// From their own place at a smaller scale.
    pub(crate) reduced: u64,
    /// All texels.
    pub(crate) all: u64,
}

/// Counts the texels of a choice.
pub(crate) fn shares(grid: &Grid, options: &Options, choice: &Choice) -> Shares {
    let mut shares = Shares::default();
    for (index, leaf) in choice.leaves.iter().enumerate() {
        let candidate = leaf.and_then(|leaf| options.candidates[index].get(leaf as usize));
        let Some(candidate) = candidate else { continue };
        let node = grid.node(index);
        let texels = u64::from(node.inside.x * node.inside.y);
        shares.all += texels;
        if !is_own(&node, candidate) {
            shares.borrowed += texels;
        } else if candidate.scale > 0 {
            shares.reduced += texels;
        }
    }
    shares
}

/// Whether a candidate is the leaf's own content, upright.
fn is_own(node: &Node, candidate: &Candidate) -> bool {
    let scale = SCALES[usize::from(candidate.scale)];
    let own = |corner: u32, log2: u32| (((2 * corner + node.side) << FRACTION_BITS) >> (1 + log2)) as i32;
    let place = (own(node.corner.x, scale.across), own(node.corner.y, scale.down));
    usize::from(candidate.image) == node.image
        && u16::from(candidate.scale) == candidate.matrix
        && candidate.gain_offset == 0
        && place == (candidate.x, candidate.y)
}

/// The verdict on a choice.
pub(crate) fn verdict(grid: &Grid, options: &Options, choice: &Choice, met: bool) -> String {
    let shares = shares(grid, options, choice);
    let percent = |texels: u64| 100.0 * texels as f64 / shares.all.max(1) as f64;
    let missed = if met { "" } else { " The goal is out of reach; this comes nearest." };
    format!(
        "{:.0}% of the texels are drawn from content elsewhere, {:.0}% from their own content at a smaller scale, the \
         rest from their own at full size.{missed}",
        percent(shares.borrowed),
        percent(shares.reduced)
    )
}

/// The notes of a texture.
pub(super) fn notes(params: &EpitomeParams, goal: Goal, verdict: String) -> Notes {
    Notes { settings: settings(&params.clone().with_goal(goal)), verdict, ..Notes::default() }
}

/// The settings in the words of the command line; behind a semicolon what it has no word for.
fn settings(params: &EpitomeParams) -> String {
    let mut words = vec!["--codec epitome".to_owned()];
    words.push(params.goal.option());
    if params.tolerance_kind == ToleranceKind::Relative {
        words.push("--tolerance-kind relative".to_owned());
    }
    match (params.content, params.family) {
        (Some(content), _) => words.push(format!("--content {}", content.name())),
        (None, Family::ErrorMap) => words.push("--content error-map".to_owned()),
        (None, Family::Bc) => {}
    }
    if params.is_by_block() {
        words.extend(params.metric.map(|metric| format!("--metric {}", metric.name())));
    } else if params.access == Access::Texel {
        words.push("--access texel".to_owned());
    }
    if params.layers > 1 {
        words.push(format!("--layers {}", params.layers));
    }
    if params.mips {
        words.push("--mips".to_owned());
    }
    // With a quadtree, goals of quality and size take no notice of it.
    let has_one_side = !params.transforms.quadtree || matches!(params.goal, Goal::Tolerance(_));
    let block = params.block.filter(|_| has_one_side);
    words.extend(block.map(|block| format!("--block {block}")));
    let missing = params.transforms.missing().filter(|&part| part != "quadtree" || block.is_none());
    let unnamed: Vec<String> = missing.map(|part| format!("without {part}")).collect();
    let unnamed = if unnamed.is_empty() { String::new() } else { format!("; {}", unnamed.join(", ")) };
    words.join(" ") + &unnamed
}

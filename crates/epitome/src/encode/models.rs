//! Models: how large the palettes are that leaves choose from, and what leaves may be then.

use texfold_core::CancelCheck;

use super::candidate::{Match, Rules};
use super::matrix;
use super::options::{Fitted, Placing, Wanted, all_options, direct_options, fit, weighed};
use super::searched::{ENTRY_BITS, EpitomeSearch};
use super::state::Options;
use crate::format::Palettes;

/// Most 2x2 matrices, and most gain-offset pairs.
pub(super) const MOST_LINEARS: usize = 256;
const MOST_TONES: usize = 64;
/// Models that are tried for goals of quality and size. Small palettes are upright: fitted ones of 32 2x2 matrices
/// were never smaller on five photographs, and of 8, 16 and 32 gain-offset pairs 16 were best on the whole.
const WHOLE: Form = Form {
    matrices: Matrices::Fitted(MOST_LINEARS),
    gain_offsets: MOST_TONES,
    scales: true,
    entry_bits: ENTRY_BITS,
};
const UPRIGHT: Form = Form { matrices: Matrices::Upright, gain_offsets: 16, scales: true, entry_bits: 32.0 };
const OWN: Form = Form { matrices: Matrices::Own, gain_offsets: 1, scales: true, entry_bits: 24.0 };
/// In blocks of variable length what is smooth costs little at full size, too, and better so where it stays with what is around it.
const FULL_SIZE: Form = Form { scales: false, ..WHOLE };
const OWN_FULL_SIZE: Form = Form { scales: false, ..OWN };
/// Nodes for each number of a palette at least.
const NODES_A_NUMBER: usize = 16;
/// The same for tolerances, where content is raw and a number that saves a block saves far more.
const NODES_A_NUMBER_WITHIN: usize = 2;
/// 2x2 matrices that leaves have in a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Matrices {
    /// At most so many, fitted to the matches.
    Fitted(usize),
    /// Those of content as it stands, plain and mirrored.
    Upright,
    /// Leaves read their own content alone.
    Own,
}

/// A model that is tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Form {
    matrices: Matrices,
    /// Most gain-offset pairs.
    gain_offsets: usize,
    /// Whether content at a fraction of its size may be used.
    scales: bool,
    /// Bits of an entry as estimated in the rate-distortion cost, which are fewer with smaller palettes.
    pub(super) entry_bits: f32,
}

/// What leaves may be with palettes of some size.
pub(super) struct Model {
    pub(super) options: Options,
    pub(super) palettes: Palettes,
    /// Bits of an entry as estimated in the rate-distortion cost.
    pub(super) entry_bits: f32,
}

impl EpitomeSearch {
    /// The models that make sense, the first and the others.
    pub(super) fn models(&self) -> (Form, &'static [Form]) {
        if !self.params.transforms.references {
            (OWN, if self.params.is_by_block() { &[OWN_FULL_SIZE] } else { &[] })
        } else if self.allowed.is_some() {
            // Most leaves have no content of their own.
            (WHOLE, &[])
        } else if self.params.is_by_block() {
            (WHOLE, &[FULL_SIZE, OWN_FULL_SIZE])
        } else {
            (WHOLE, &[UPRIGHT, OWN])
        }
    }

    /// What leaves may be in a model.
    pub(super) fn model(&self, model: Form, cancel: CancelCheck<'_>) -> Model {
        let none = || vec![Vec::new(); self.grid.nodes()];
        let of_full_size =
            |matches: &Vec<Match>| matches.iter().filter(|found| found.scale == 0).copied().collect();
        let matches = match model {
            Form { matrices: Matrices::Own, .. } => &none(),
            Form { scales: true, .. } => &self.matches,
            Form { scales: false, .. } => &self.matches.iter().map(of_full_size).collect(),
        };
        let fitted = self.fitted(matches, model.matrices, model.gain_offsets, cancel);
        let rules = Rules { full_size: !model.scales, ..self.rules(None) };
        let options = self.options(matches, &fitted, &rules, cancel);
        Model { options, palettes: fitted.palettes, entry_bits: model.entry_bits }
    }

    /// What leaves may be with everything that was found, at most so many 2x2 matrices, and palettes otherwise as
    /// large as they may be.
    pub(super) fn whole(&self, matrices: usize, rules: &Rules<'_>, cancel: CancelCheck<'_>) -> Model {
        let fitted = self.fitted(&self.matches, Matrices::Fitted(matrices), MOST_TONES, cancel);
        let options = self.options(&self.matches, &fitted, rules, cancel);
        Model { options, palettes: fitted.palettes, entry_bits: ENTRY_BITS }
    }

    /// Palettes fitted to what has been found so far.
    fn fitted(
        &self,
        matches: &[Vec<Match>],
        matrices: Matrices,
        gain_offsets: usize,
        cancel: CancelCheck<'_>,
    ) -> Fitted {
        // A palette must earn its bits: an entry for every few leaves.
        let few =
            self.grid.nodes() / if self.covers_blocks() { NODES_A_NUMBER_WITHIN } else { NODES_A_NUMBER };
        let transforms = self.params.transforms;
        let gain_offsets = if transforms.gain_offsets { gain_offsets.min(1 + few) } else { 1 };
        let scales = self.space.scales();
        let mut palette = match matrices {
            Matrices::Fitted(most) => {
                matrix::fitted(&weighed(&self.grid, matches), scales, most.min(scales + 1 + few), cancel)
            }
            Matrices::Upright => matrix::upright(scales, transforms.mirrors),
            Matrices::Own => matrix::upright(scales, false),
        };
        if self.allowed.is_some() {
            // Leaves that look like nothing that is allowed get one colour.
            palette.truncate(MOST_LINEARS - 1);
            palette.push([0; 4]);
        }
        let placing = Placing { fractions: transforms.fractions, rotated: matrices != Matrices::Upright };
        fit(&self.space, &self.grid, matches, Wanted { matrices: palette, gain_offsets, placing }, cancel)
    }

    /// All that leaves may be.
    fn options(
        &self,
        matches: &[Vec<Match>],
        fitted: &Fitted,
        rules: &Rules<'_>,
        cancel: CancelCheck<'_>,
    ) -> Options {
        let (direct, _) = direct_options(&self.space, &self.grid, rules, cancel);
        all_options(&self.space, &self.grid, &direct, matches, fitted, rules, cancel)
    }
}

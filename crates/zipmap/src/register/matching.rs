//! Which features of two photographs show the same: nearest descriptors, kept where the next best is clearly farther
//! (Lowe 2004, section 7.1) and the match holds in both directions.
//!
//! Cost: one product of 128 numbers for each pair of features. *Not done*: a k-d tree, which visits most of
//! 128-dimensional descriptors anyway.

use rayon::prelude::*;
use texfold_core::CancelCheck;

use super::features::Feature;

/// Largest ratio of the distances to the nearest and to the second nearest descriptor.
const RATIO: f32 = 0.8;
/// Features nearer than this in their own scales are the same place with two orientations: not a second match.
const SAME_PLACE: f32 = 1.0;

/// A feature of one photograph and one of another that may show the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Match {
    pub(crate) from: usize,
    pub(crate) to: usize,
}

/// Matches in the order of `from`. Of no use once the job is cancelled.
pub(crate) fn matches(from: &[Feature], to: &[Feature], cancel: CancelCheck<'_>) -> Vec<Match> {
    let found: Vec<Option<Match>> = (0..from.len())
        .into_par_iter()
        .map(|index| {
            if cancel.is_cancelled() {
                return None;
            }
            let best = clear_nearest(&from[index], to)?;
            let back = nearest(&to[best], from)?;
            let same = back == index || same_place(&from[back], &from[index]);
            same.then_some(Match { from: index, to: best })
        })
        .collect();
    found.into_iter().flatten().collect()
}

fn same_place(a: &Feature, b: &Feature) -> bool {
    (a.place - b.place).length() < SAME_PLACE * a.scale.min(b.scale)
}

fn nearest(feature: &Feature, among: &[Feature]) -> Option<usize> {
    let distances = among.iter().map(|other| feature.descriptor.distance(&other.descriptor));
    distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

/// The nearest, where the second nearest at another place is clearly farther.
fn clear_nearest(feature: &Feature, among: &[Feature]) -> Option<usize> {
    let mut best = (f32::INFINITY, 0);
    let mut second = f32::INFINITY;
    for (index, other) in among.iter().enumerate() {
        let distance = feature.descriptor.distance(&other.descriptor);
        if distance < best.0 {
            if best.0.is_finite() && !same_place(&among[best.1], other) {
                second = best.0;
            }
            best = (distance, index);
        } else if distance < second && !same_place(&among[best.1], other) {
            second = distance;
        }
    }
    (best.0 < RATIO * RATIO * second).then_some(best.1)
}

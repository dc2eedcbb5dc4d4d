//! A homography from matches, some of them wrong.
//!
//! Each match has a scale and an orientation on both sides and so proposes a similarity; those that most others agree
//! with are refined by least squares, from similarity to homography, and by homographies through four of their matches
//! at random, each refined on all that agree with it. Source of the last: Chum, Matas, Kittler, "Locally optimized
//! RANSAC", DAGM 2003. The random numbers follow from a seed. Errors are measured in pixels of the coarser photograph.

use glam::{DMat3, DVec2, DVec3};
use texfold_core::CancelCheck;
use texfold_core::rng::Congruential;

use super::features::Feature;
use super::matching::Match;
use crate::geometry::normalised;
use crate::linear::{area_scale, project, solve};

/// Similarities that are refined.
const PROPOSALS: usize = 12;
/// Samples of four matches for each.
const SAMPLES: usize = 40;
/// Error within which a match agrees with a similarity, as a share of the coarser photograph's longer side.
const COARSE_SHARE: f64 = 0.03;
/// Most that a match's own scale and orientation may differ from the similarity's: a factor, and radians.
const SCALE_FACTOR: f64 = 1.6;
/// As above.
const TURN: f64 = 0.5;
/// Errors within which matches agree, of rising accuracy, in pixels of the coarser photograph.
const TOLERANCES: [f64; 4] = [12.0, 6.0, 3.0, 3.0];
/// Least matches that a homography can be refined on: four tell one, two more can contradict it.
const LEAST_MATCHES: usize = 6;
/// Matches that agree with a similarity worth refining, itself among them: as many as tell a homography.
const LEAST_AGREEING: usize = 4;

/// A pair of places that may show the same.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    pub(crate) from: DVec2,
    pub(crate) to: DVec2,
    scale: f64,
    turn: f64,
}

/// A homography and the pairs that agree with it.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) matrix: DMat3,
    pub(crate) inliers: Vec<Pair>,
    score: f64,
}

pub(crate) fn pairs(from: &[Feature], to: &[Feature], matches: &[Match]) -> Vec<Pair> {
    let pair = |found: &Match| {
        let (a, b) = (&from[found.from], &to[found.to]);
        Pair {
            from: a.place.as_dvec2(),
            to: b.place.as_dvec2(),
            scale: f64::from(b.scale / a.scale),
            turn: f64::from(b.angle - a.angle),
        }
    };
    matches.iter().map(pair).collect()
}

/// The homography that most pairs agree with; `None` where none can be fitted, or the job is cancelled. `sides` are the
/// longer sides of both photographs.
pub(crate) fn fit(pairs: &[Pair], sides: (f64, f64), seed: u64, cancel: CancelCheck<'_>) -> Option<Fit> {
    let going = pairs.iter().take_while(|_| !cancel.is_cancelled());
    let proposals = going.map(|pair| propose(pair, pairs, sides));
    let mut proposals: Vec<(usize, DMat3)> =
        proposals.filter(|(agree, _)| *agree >= LEAST_AGREEING).collect();
    // Stable: the first of equals stays first.
    proposals.sort_by_key(|(agree, _)| std::cmp::Reverse(*agree));
    let mut random = Congruential::new(seed);
    let mut best: Option<Fit> = None;
    let mut tried: Vec<DMat3> = Vec::new();
    for (_, proposal) in proposals {
        if tried.len() >= PROPOSALS || cancel.is_cancelled() {
            break;
        }
        if tried.iter().any(|other| alike(other, &proposal, pairs, sides)) {
            continue;
        }
        tried.push(proposal);
        let Some(found) = refine(&proposal, pairs, sides, &mut random, cancel) else { continue };
        if best.as_ref().is_none_or(|best| found.score > best.score) {
            best = Some(found);
        }
    }
    best
}

/// The similarity that a pair proposes, and how many pairs agree with it.
fn propose(pair: &Pair, pairs: &[Pair], sides: (f64, f64)) -> (usize, DMat3) {
    let linear = DVec2::from_angle(pair.turn) * pair.scale;
    let shift = pair.to - linear.rotate(pair.from);
    let matrix = DMat3::from_cols(
        DVec3::new(linear.x, linear.y, 0.0),
        DVec3::new(-linear.y, linear.x, 0.0),
        shift.extend(1.0),
    );
    let tolerance = COARSE_SHARE * if pair.scale > 1.0 { pair.scale * sides.0 } else { sides.1 };
    let agree = |other: &&Pair| {
        let turn = (other.turn - pair.turn + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        let ratio = other.scale / pair.scale;
        (linear.rotate(other.from) + shift - other.to).length() < tolerance
            && turn.abs() < TURN
            && (1.0 / SCALE_FACTOR..SCALE_FACTOR).contains(&ratio)
    };
    (pairs.iter().filter(agree).count(), matrix)
}

/// Whether two similarities move all pairs to nearly the same places.
fn alike(a: &DMat3, b: &DMat3, pairs: &[Pair], sides: (f64, f64)) -> bool {
    let near = |pair: &Pair| {
        (project(a, pair.from) - project(b, pair.from)).length() < 0.5 * COARSE_SHARE * sides.0.max(sides.1)
    };
    pairs.iter().all(near)
}

/// From a rough matrix to the homography that agrees with most pairs around it.
fn refine(
    start: &DMat3,
    pairs: &[Pair],
    sides: (f64, f64),
    random: &mut Congruential,
    cancel: CancelCheck<'_>,
) -> Option<Fit> {
    let mut matrix = *start;
    let rough = COARSE_SHARE * sides.0.max(sides.1);
    for (step, tolerance) in [rough].into_iter().chain(TOLERANCES).enumerate() {
        let inliers = agreeing(&matrix, pairs, tolerance);
        if inliers.len() < LEAST_MATCHES {
            return None;
        }
        // Few and rough pairs do not tell perspective from noise.
        matrix = if step < 2 { affine(&inliers)? } else { homography(&inliers)? };
    }
    let mut best = judged(matrix, pairs)?;
    for _ in (0..SAMPLES).take_while(|_| !cancel.is_cancelled()) {
        let mut four = best.inliers.clone();
        for place in 0..4 {
            let other = place + random.below(four.len() - place);
            four.swap(place, other);
        }
        four.truncate(4);
        let Some(mut sampled) = homography(&four) else { continue };
        for tolerance in &TOLERANCES[1..3] {
            let inliers = agreeing(&sampled, pairs, *tolerance);
            match homography(&inliers).filter(|_| inliers.len() >= LEAST_MATCHES) {
                Some(refined) => sampled = refined,
                None => break,
            }
        }
        if let Some(found) = judged(sampled, pairs).filter(|found| found.score > best.score) {
            best = found;
        }
    }
    Some(best)
}

/// Error of a pair in pixels of the coarser photograph; infinite where the place is mirrored or beyond the horizon.
fn error(matrix: &DMat3, pair: &Pair) -> f64 {
    let scale = area_scale(matrix, pair.from);
    if scale > 0.0 && (*matrix * pair.from.extend(1.0)).z > 0.0 {
        (project(matrix, pair.from) - pair.to).length() / scale.sqrt().max(1.0)
    } else {
        f64::INFINITY
    }
}

fn agreeing(matrix: &DMat3, pairs: &[Pair], tolerance: f64) -> Vec<Pair> {
    pairs.iter().copied().filter(|pair| error(matrix, pair) < tolerance).collect()
}

fn judged(matrix: DMat3, pairs: &[Pair]) -> Option<Fit> {
    let tolerance = TOLERANCES[TOLERANCES.len() - 1];
    let inliers = agreeing(&matrix, pairs, tolerance);
    // Errors within the tolerance count by how small they are (MSAC, Torr and Zisserman 2000).
    let score = inliers.iter().map(|pair| 1.0 - (error(&matrix, pair) / tolerance).powi(2)).sum();
    (inliers.len() >= LEAST_MATCHES).then(|| Fit { matrix: normalised(matrix), inliers, score })
}

/// Moves the middle of places to 0 and their mean distance from it to 1 (Hartley 1997).
fn centred(places: impl Iterator<Item = DVec2> + Clone) -> DMat3 {
    let count = places.clone().count().max(1) as f64;
    let mean = places.clone().sum::<DVec2>() / count;
    let spread = places.map(|place| (place - mean).length()).sum::<f64>() / count;
    let scale = 1.0 / spread.max(1e-9);
    DMat3::from_scale(DVec2::splat(scale)) * DMat3::from_translation(-mean)
}

/// Least squares of the eight free elements with the last at 1.
fn homography(pairs: &[Pair]) -> Option<DMat3> {
    let from = centred(pairs.iter().map(|pair| pair.from));
    let to = centred(pairs.iter().map(|pair| pair.to));
    let mut matrix = [[0.0; 8]; 8];
    let mut right = [0.0; 8];
    for pair in pairs {
        let (a, b) = (project(&from, pair.from), project(&to, pair.to));
        let rows = [
            ([a.x, a.y, 1.0, 0.0, 0.0, 0.0, -a.x * b.x, -a.y * b.x], b.x),
            ([0.0, 0.0, 0.0, a.x, a.y, 1.0, -a.x * b.y, -a.y * b.y], b.y),
        ];
        for (row, value) in rows {
            for i in 0..8 {
                for k in 0..8 {
                    matrix[i][k] += row[i] * row[k];
                }
                right[i] += row[i] * value;
            }
        }
    }
    let h = solve(matrix, right)?;
    let found = DMat3::from_cols(
        DVec3::new(h[0], h[3], h[6]),
        DVec3::new(h[1], h[4], h[7]),
        DVec3::new(h[2], h[5], 1.0),
    );
    let whole = to.inverse() * found * from;
    whole.is_finite().then_some(whole)
}

/// The homography that leads from each first place nearest to the second; `None` where these tell none.
pub(crate) fn through(places: &[(DVec2, DVec2)]) -> Option<DMat3> {
    let pair = |&(from, to): &(DVec2, DVec2)| Pair { from, to, scale: 1.0, turn: 0.0 };
    let pairs: Vec<Pair> = places.iter().map(pair).collect();
    homography(&pairs).map(normalised)
}

/// Least squares of an affine matrix.
fn affine(pairs: &[Pair]) -> Option<DMat3> {
    let middle = centred(pairs.iter().map(|pair| pair.from));
    let mut matrix = [[0.0; 3]; 3];
    let mut right = [[0.0; 3]; 2];
    for pair in pairs {
        let a = project(&middle, pair.from).extend(1.0).to_array();
        for i in 0..3 {
            for k in 0..3 {
                matrix[i][k] += a[i] * a[k];
            }
            right[0][i] += a[i] * pair.to.x;
            right[1][i] += a[i] * pair.to.y;
        }
    }
    let (x, y) = (solve(matrix, right[0])?, solve(matrix, right[1])?);
    let found = DMat3::from_cols(
        DVec3::new(x[0], y[0], 0.0),
        DVec3::new(x[1], y[1], 0.0),
        DVec3::new(x[2], y[2], 1.0),
    );
    Some(found * middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs under a homography, every third of them at random places.
    fn scene(matrix: &DMat3, count: usize) -> Vec<Pair> {
        let mut random = Congruential::new(7);
        let mut place = || DVec2::new(random.below(8000) as f64 / 10.0, random.below(6000) as f64 / 10.0);
        let pair = |index: usize| {
            let from = place();
            let to = if index.is_multiple_of(3) { place() } else { project(matrix, from) };
            let (across, _) = crate::geometry::slope(matrix, from);
            Pair { from, to, scale: across.length() * 1.1, turn: across.to_angle() + 0.1 }
        };
        (0..count).map(pair).collect()
    }

    #[test]
    fn a_homography_is_found_among_wrong_matches() {
        let matrix = DMat3::from_cols_array(&[0.4, 0.15, 1e-5, -0.14, 0.42, -2e-5, 120.0, 30.0, 1.0]);
        let pairs = scene(&matrix, 60);
        let found = fit(&pairs, (800.0, 800.0), 1, CancelCheck::default()).unwrap();
        assert!(found.inliers.len() >= 40);
        for corner in crate::geometry::corners(DVec2::new(800.0, 600.0)) {
            let far = (project(&found.matrix, corner) - project(&matrix, corner)).length();
            assert!(far < 0.01, "{far}");
        }
        let again = fit(&pairs, (800.0, 800.0), 1, CancelCheck::default()).unwrap();
        assert_eq!(found.matrix, again.matrix);
    }

    #[test]
    fn pairs_of_nothing_have_none() {
        let mut pairs = scene(&DMat3::IDENTITY, 3);
        assert!(fit(&pairs, (800.0, 800.0), 1, CancelCheck::default()).is_none());
        // All at one place, and all on a line.
        pairs = vec![pairs[1]; 30];
        assert!(fit(&pairs, (800.0, 800.0), 1, CancelCheck::default()).is_none());
    }
}

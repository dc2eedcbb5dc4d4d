//! Steps of a quantiser: from a guess along the line between one that meets the goal and one that misses it.

use super::{Goal, Measured};
use crate::Effort;

/// By how many octaves of bits or of error what was measured misses the goal; at most 0 where it meets it.
#[must_use]
fn excess(goal: Goal, measured: &Measured) -> f64 {
    match goal {
        Goal::Bpp(bits) => (measured.bpp / bits).log2(),
        Goal::Psnr(db) => (db - measured.psnr) / DECIBELS_PER_OCTAVE,
        Goal::Tolerance(rms) => (measured.worst_block_rms / rms).max(SMALLEST_RATIO).log2(),
    }
}

/// What a search for a step found.
#[derive(Debug, Clone)]
pub struct FoundStep<T> {
    /// What the step made.
    pub value: T,
    /// Its measurements, as `at_step` returned them.
    pub measured: Measured,
    /// Whether it meets the goal; if not, no step does that was tried, and this one comes nearest.
    pub met: bool,
}

/// Searches the step that just meets a goal, from a guess on: along the line between what is known, as bits and errors are
/// nearly even in octaves of the step. `at_step` makes something with a step and measures it, at least in the unit of the goal;
/// of all that meet the goal the nearest to it is found. `None` where nothing is tried.
///
/// # Errors
/// Whatever `at_step` returns, at once.
pub fn search_step<T, E>(
    goal: Goal,
    scale: StepScale,
    first: u16,
    at_step: impl FnMut(u16) -> Result<(T, Measured), E>,
) -> Result<Option<FoundStep<T>>, E> {
    search_from(Search::new(goal, scale), first, None, at_step)
}

/// Search of [`search_step`] where `estimate` measures bits and PSNR of a step at a fraction of the cost of `at_step`. Estimates may
/// be off by a factor: a measurement at one step corrects the estimates of the steps near it, so mostly two steps are made. Goals of
/// single blocks' errors ([`Goal::Tolerance`]) are searched without estimates.
///
/// # Errors
/// Whatever `estimate` or `at_step` returns, at once.
pub fn search_step_estimated<T, E>(
    goal: Goal,
    scale: StepScale,
    first: u16,
    mut estimate: impl FnMut(u16) -> Result<Measured, E>,
    at_step: impl FnMut(u16) -> Result<(T, Measured), E>,
) -> Result<Option<FoundStep<T>>, E> {
    if matches!(goal, Goal::Tolerance(_)) {
        return search_step(goal, scale, first, at_step);
    }
    let mut estimates = Search::new(goal, scale);
    let mut step = first;
    while let Some(at) = estimates.checked(step).filter(|_| !estimates.is_line()) {
        estimates.note(at, excess(goal, &estimate(at)?));
        step = estimates.next();
    }
    let line =
        estimates.met.zip(estimates.missed).map(|(met, missed)| Line { met, missed, most: scale.most });
    let first = line.map_or(step, |line| line.step_at(-AIM * scale.near));
    search_from(Search::new(goal, scale), first, line, at_step)
}

/// Searches along the line of estimates, where there is one, until both sides are known.
fn search_from<T, E>(
    mut search: Search,
    first: u16,
    line: Option<Line>,
    mut at_step: impl FnMut(u16) -> Result<(T, Measured), E>,
) -> Result<Option<FoundStep<T>>, E> {
    let mut best: Option<FoundStep<T>> = None;
    let mut by_best = f64::INFINITY;
    let mut step = first;
    while let Some(at) = search.checked(step) {
        let (value, measured) = at_step(at)?;
        let by = excess(search.goal, &measured);
        let met = search.note(at, by);
        let is_better = best.as_ref().is_none_or(|best| match (best.met, met) {
            (true, true) => by >= by_best,
            (false, false) => by < by_best,
            (_, met) => met,
        });
        if is_better {
            best = Some(FoundStep { value, measured, met });
            by_best = by;
        }
        let is_one_sided = search.met.is_none() || search.missed.is_none();
        step = match line.filter(|_| is_one_sided && search.trials < LINE_TRIALS) {
            Some(line) => line.step_at(line.excess_at(at) - by - AIM * search.scale.near),
            None => search.next(),
        };
    }
    Ok(best)
}

/// Line through the excess of two steps near each other.
#[derive(Debug, Clone, Copy)]
struct Line {
    met: (u16, f64),
    missed: (u16, f64),
    /// The coarsest step.
    most: u16,
}

impl Line {
    fn slope(&self) -> f64 {
        (self.missed.1 - self.met.1) / (f64::from(self.missed.0) - f64::from(self.met.0))
    }

    fn excess_at(&self, step: u16) -> f64 {
        self.met.1 + self.slope() * (f64::from(step) - f64::from(self.met.0))
    }

    fn step_at(&self, excess: f64) -> u16 {
        let step = f64::from(self.met.0) + (excess - self.met.1) / self.slope();
        // The one beside it that is nearer to meeting the goal.
        let step = if self.met.0 > self.missed.0 { step.ceil() } else { step.floor() };
        step.clamp(0.0, f64::from(self.most)) as u16
    }
}

/// The numbers of a quantiser's steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepScale {
    /// Numbers in which a step doubles.
    pub octave: u16,
    /// The coarsest.
    pub most: u16,
    /// Largest distance to the goal, on the side that meets it, at which a search ends, in octaves of bits or of error.
    pub near: f64,
    /// Numbers between a step that meets the goal and one that misses it at which a search ends, too, if bits or errors jump between them.
    pub jump: u16,
}

impl StepScale {
    /// The scale of a search at that effort: at [`Effort::Fast`] it ends within 1 % of the bits or of a block's error, or 0.09 dB, of the goal, or
    /// at a jump between two steps that differ by 4 %, else as `self`.
    #[must_use]
    pub fn at(self, effort: Effort) -> Self {
        match effort {
            Effort::Fast => StepScale { near: 0.0145, jump: self.octave / 16, ..self },
            _ => self,
        }
    }
}

/// PSNR of an octave of error.
const DECIBELS_PER_OCTAVE: f64 = 6.02;
/// Least ratio of errors that a search tells apart.
const SMALLEST_RATIO: f64 = 1e-3;
/// Most textures that a search makes.
const MAX_TRIALS: usize = 16;
/// Aim along the line of estimates, on the side that meets the goal: a share of [`StepScale::near`].
const AIM: f64 = 0.25;
/// Steps between two estimates, in octaves, from which on a line is near enough to the bits and errors between them.
const LINE: f64 = 0.5;
/// Octaves of bits or of error an octave of steps, of which there is mostly one, from which on they jump.
const STEEP: f64 = 4.0;
/// Textures that are made along the line of estimates; if all are on one side, the search goes on without it.
const LINE_TRIALS: usize = 4;

/// A search for the step that just meets a goal.
struct Search {
    goal: Goal,
    scale: StepScale,
    /// Whether coarser steps meet the goal: where it is bits.
    coarser_meets: bool,
    /// The step nearest to the goal among those that meet it, and among those that miss it, with their excess.
    met: Option<(u16, f64)>,
    missed: Option<(u16, f64)>,
    /// Weights of both excesses: a line alone closes in from one side, so that the excess of a side that stays is halved each time (Dowell and
    /// Jarratt 1971, the Illinois method).
    weights: (f64, f64),
    /// Whether the last step met the goal.
    last_met: Option<bool>,
    trials: usize,
    /// How far beyond where the goal should be the next step goes while all are on one side of it.
    reach: f64,
}

impl Search {
    fn new(goal: Goal, scale: StepScale) -> Search {
        let coarser_meets = matches!(goal, Goal::Bpp(_));
        let (weights, last_met) = ((1.0, 1.0), None);
        Search {
            goal,
            scale,
            coarser_meets,
            met: None,
            missed: None,
            weights,
            last_met,
            trials: 0,
            reach: 1.2,
        }
    }

    /// The step, where it is worth trying.
    fn checked(&self, step: u16) -> Option<u16> {
        let known = |side: Option<(u16, f64)>| side.is_some_and(|(at, _)| at == step);
        let near = self.met.is_some_and(|(_, excess)| excess > -self.scale.near);
        (!near && self.trials < MAX_TRIALS && !known(self.met) && !known(self.missed)).then_some(step)
    }

    /// Whether the goal lies between two steps that are so near each other that a line joins what is between them.
    fn is_line(&self) -> bool {
        let apart = self.met.zip(self.missed).map(|((met, _), (missed, _))| met.abs_diff(missed));
        apart.is_some_and(|apart| f64::from(apart) <= LINE * f64::from(self.scale.octave))
    }

    /// Takes a step's excess; whether it is the best that meets the goal.
    fn note(&mut self, step: u16, excess: f64) -> bool {
        self.trials += 1;
        self.reach *= 2.0;
        let meets = excess <= 0.0;
        match self.last_met.replace(meets) {
            Some(true) if meets => self.weights.1 *= 0.5,
            Some(false) if !meets => self.weights.0 *= 0.5,
            _ => self.weights = (1.0, 1.0),
        }
        *(if meets { &mut self.met } else { &mut self.missed }) = Some((step, excess));
        meets
    }

    /// The next step to try: where the line through both sides meets the goal, inside of them.
    fn next(&self) -> u16 {
        let sign = if self.coarser_meets { 1.0 } else { -1.0 };
        match (self.met, self.missed) {
            (Some((met, below)), Some((missed, above))) => {
                let (low, high) = (met.min(missed), met.max(missed));
                let is_jump = (above - below) * f64::from(self.scale.octave) > STEEP * f64::from(high - low);
                if high - low <= 1 || is_jump && high - low <= self.scale.jump {
                    return met;
                }
                let (below, above) = (below * self.weights.0, above * self.weights.1);
                let share = above / (above - below);
                let line = f64::from(missed) + share * (f64::from(met) - f64::from(missed));
                // The one beside it that is nearer to meeting the goal.
                let step = if met > missed { line.ceil() } else { line.floor() };
                (step as u16).clamp(low + 1, high - 1)
            }
            (Some((only, excess)), None) | (None, Some((only, excess))) => {
                // Bits and errors double or halve about once an octave of steps.
                let line = f64::from(only)
                    + sign * self.reach * (f64::from(self.scale.octave) * excess + excess.signum());
                line.clamp(0.0, f64::from(self.scale.most)) as u16
            }
            (None, None) => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    const SCALE: StepScale = StepScale { octave: 256, most: 5119, near: 0.003, jump: 1 };

    /// Bits that halve, and errors that double, every 300 steps; counts what is tried.
    fn along(goal: Goal, first: u16) -> (u16, bool, u32) {
        let mut tried = 0;
        let found = search_step(goal, SCALE, first, |step| {
            tried += 1;
            let octaves = f64::from(step) / 300.0;
            let measured = Measured {
                psnr: 80.0 - 6.02 * octaves,
                bpp: 16.0 * (-octaves).exp2(),
                worst_block_rms: 0.1 * octaves.exp2(),
            };
            Ok::<_, Infallible>((step, measured))
        });
        let found = found.unwrap().unwrap();
        (found.value, found.met, tried)
    }

    #[test]
    fn the_coarsest_step_within_an_error_and_the_finest_within_bits_are_found() {
        for first in [0, 900, 5119] {
            // 4 bits at 600; 60.002 dB at 996.5; an error of 0.8 at 900.
            for (goal, exact) in
                [(Goal::Bpp(4.0), 600.0), (Goal::Psnr(60.002), 996.5), (Goal::Tolerance(0.8), 900.0)]
            {
                let (step, met, tried) = along(goal, first);
                assert!(met && (f64::from(step) - exact).abs() <= 1.5, "{goal:?} from {first}: {step}");
                assert!(tried <= 5, "{goal:?} from {first}: {tried} tried");
            }
        }
    }

    #[test]
    fn a_fast_search_ends_where_bits_jump() {
        let tried = |scale, jump: u16| {
            let mut tried = 0;
            let found = search_step(Goal::Bpp(4.0), scale, 1200, |step| {
                tried += 1;
                let bpp = if step < jump { 12.0 } else { 2.0 } * (-f64::from(step) / 3000.0).exp2();
                Ok::<_, Infallible>((step, Measured { bpp, ..Measured::default() }))
            });
            let found = found.unwrap().unwrap();
            assert!(found.met && (jump..jump + 16).contains(&found.value), "{jump}: {}", found.value);
            tried
        };
        let sum = |scale| (700..1900).step_by(37).map(|jump| tried(scale, jump)).sum::<u32>();
        let (fast, normal) = (sum(SCALE.at(Effort::Fast)), sum(SCALE));
        assert!(f64::from(fast) < 0.8 * f64::from(normal), "{fast} of {normal} tried");
    }

    #[test]
    fn two_steps_are_made_where_estimates_are_off_by_a_factor() {
        for off in [0.7, 0.97, 1.0, 1.02, 1.5] {
            for (goal, exact) in [(Goal::Bpp(1.3), 1086.4), (Goal::Psnr(60.002), 996.5)] {
                let mut made = 0;
                let measured = |step: u16, off: f64| {
                    let octaves = f64::from(step) / 300.0;
                    // Not quite even in octaves.
                    let bent = octaves - 0.02 * octaves * octaves + 0.02 * (exact / 300.0f64).powi(2);
                    Measured {
                        psnr: 80.0 - 6.02 * (bent - off.log2()),
                        bpp: off * 16.0 * (-bent).exp2(),
                        worst_block_rms: 0.0,
                    }
                };
                let estimate = |step| Ok::<_, Infallible>(measured(step, off));
                let found = search_step_estimated(goal, SCALE, 1200, estimate, |step| {
                    made += 1;
                    Ok((step, measured(step, 1.0)))
                });
                let found = found.unwrap().unwrap();
                assert!(
                    found.met && (f64::from(found.value) - exact).abs() <= 2.0,
                    "{goal:?} {off}: {}",
                    found.value
                );
                assert!(
                    made <= if (off - 1.0f64).abs() < 0.05 { 2 } else { 5 },
                    "{goal:?} {off}: {made} made"
                );
            }
        }
    }

    #[test]
    fn bent_curves_take_few_steps() {
        let mut tried = 0;
        for (exact, bend) in (900..1900).step_by(37).zip([-0.15, -0.05, 0.1, 0.2].into_iter().cycle()) {
            let found = search_step(Goal::Psnr(40.0), SCALE, exact + 150, |step| {
                tried += 1;
                let away = (f64::from(step) - f64::from(exact)) / 300.0 - 0.001;
                let psnr = 40.0 - 6.02 * (away + bend * away * away.abs());
                Ok::<_, Infallible>((step, Measured { psnr, bpp: 1.0, worst_block_rms: 0.0 }))
            });
            let found = found.unwrap().unwrap();
            assert!(found.met && found.value == exact, "{exact} {bend}: {}", found.value);
        }
        // 28 searches.
        assert!(tried <= 98, "{tried} tried");
    }

    #[test]
    fn a_goal_out_of_reach_ends_at_the_nearest_step() {
        assert_eq!(along(Goal::Psnr(90.0), 900), (0, false, along(Goal::Psnr(90.0), 900).2));
        assert_eq!(along(Goal::Bpp(1e-9), 900).0, SCALE.most);
    }
}

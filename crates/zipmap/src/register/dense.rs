//! Refining a homography on all pixels that two photographs share, and how well they then agree.
//!
//! The sum of robust squared differences `coarse(p) - gain * fine(H p) - offset` over the coarser photograph's pixels
//! is made smaller by Gauss-Newton steps on the eight numbers of H with gain and offset, from small images to large
//! ones (Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004; weights: Tukey's). The finer photograph is read
//! from the halving that has the coarser one's resolution. What agrees is told by the correlation of both within fields
//! of the shared area: a wrong homography on a smooth image may have a high correlation of the whole.

use glam::{DMat3, DVec2, DVec3, Vec2};
use rayon::prelude::*;
use texfold_core::CancelCheck;

use super::gray::{Gray, Pyramid};
use crate::geometry::{normalised, seen_in, slope};
use crate::linear::{project, solve};

/// Numbers that are solved for.
const UNKNOWNS: usize = 10;
/// Steps at each size.
const STEPS: usize = 12;
/// A step that moves no corner of the shared area by more than this many pixels is the last.
const LAST_STEP: f64 = 0.01;
/// Least pixels that a size is refined on.
const LEAST_PIXELS: usize = 400;
/// Most pixels that a size is refined on: beyond, every n-th.
const MOST_PIXELS: usize = 40_000;
/// Tukey's constant for 95% efficiency, in standard deviations.
const TUKEY: f32 = 4.685;
/// Share of the diagonal that is added to it, so that numbers that nothing tells stay as they are (Levenberg): small
/// beside the 1e-3 from which on steps become shorter, large beside the rounding of sums of 40000 pixels.
const DIAGONAL_SHARE: f64 = 1e-6;
/// Pixels that are summed by one task: 1 ms of work.
const SUMMED: usize = 2048;
/// Levels of the pyramid that are refined on, from quarters of the sides on: a start that is off by 4 pixels is off by
/// one there.
const LEVELS: usize = 3;
/// Absolute deviation that half of a normal distribution is within, in standard deviations.
const MEDIAN_DEVIATION: f32 = 0.6745;
/// Least and largest change of contrast between two photographs: beyond, they show no exposures of one surface.
const GAIN: (f64, f64) = (0.2, 5.0);
/// Least share of the mean number of pixels of a field, and least number, that a field is compared on.
const LEAST_FIELD: (f64, f64) = (0.25, 16.0);
/// Fields a side that correlation is told in.
const FIELDS: usize = 6;
/// Least deviation of a field's pixels, in a range of 1, below which it shows nothing to compare.
const FLAT: f64 = 0.008;

/// How well two photographs agree under a homography.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// Correlation over all shared pixels.
    pub correlation: f64,
    /// Median correlation of the fields that show anything.
    pub fields: f64,
    /// Pixels of the coarser photograph that were compared.
    pub pixels: usize,
}

/// Pixels of an image that a homography leads into another, evenly thinned.
struct Shared<'a> {
    coarse: &'a Gray,
    fine: &'a Gray,
    /// From pixels of `coarse` to pixels of `fine`.
    matrix: DMat3,
    places: Vec<Vec2>,
    /// Middle and half extent of what is shared, in pixels of `coarse`.
    middle: DVec2,
    half: f64,
}

impl<'a> Shared<'a> {
    /// What both show where a pixel is `2^level` pixels of the coarser photograph, `matrix` leading from the coarser to
    /// the finer.
    fn new(coarse: &'a Pyramid, fine: &'a Pyramid, matrix: &DMat3, level: usize) -> Option<Shared<'a>> {
        let (first, last) = (&coarse.levels[0], &fine.levels[0]);
        let image = coarse.levels.get(level)?;
        let pixel = first.extent() / image.extent();
        let inverse = matrix.inverse();
        let polygon = seen_in(&inverse, last.extent(), first.extent());
        let (low, high) = bounds(&polygon)?;
        let middle = (low + high) * 0.5;
        let (across, down) = slope(matrix, middle);
        let zoom = across.perp_dot(down).abs().sqrt() * pixel.x;
        let (detail, size) = fine.level_for(zoom);
        let matrix = DMat3::from_scale(size.recip()) * *matrix * DMat3::from_scale(pixel);
        let (low, high) = (low / pixel, high / pixel);
        let inside = |place: Vec2| {
            let moved = project(&matrix, place.as_dvec2());
            moved.cmpgt(DVec2::ONE).all() && moved.cmplt(detail.extent() - 1.0).all()
        };
        let columns = low.x.max(0.0) as usize..(high.x.ceil() as usize).min(image.width);
        let rows = low.y.max(0.0) as usize..(high.y.ceil() as usize).min(image.height);
        let stride =
            ((columns.len() * rows.len()) as f64 / MOST_PIXELS as f64).sqrt().ceil().max(1.0) as usize;
        let places: Vec<Vec2> = rows
            .step_by(stride)
            .flat_map(|y| columns.clone().step_by(stride).map(move |x| Vec2::new(x as f32, y as f32) + 0.5))
            .filter(|&place| inside(place))
            .collect();
        let (middle, half) = ((low + high) * 0.5, (0.5 * (high - low).max_element()).max(1.0));
        Some(Shared { coarse: image, fine: detail, matrix, places, middle, half })
    }

    /// Pairs of values, coarse and fine.
    fn values(&self) -> Vec<(f32, f32)> {
        let value = |&place: &Vec2| {
            let moved = project(&self.matrix, place.as_dvec2()).as_vec2();
            (self.coarse.at(place), self.fine.at(moved))
        };
        self.places.par_iter().map(value).collect()
    }

    /// One step: the matrix, changed, and how far it moves the corners of what is shared; `None` where it cannot be
    /// told.
    fn step(&self, gain: &mut [f64; 2]) -> Option<(DMat3, f64)> {
        let scale = weight_scale(&self.values(), gain);
        let sums: Vec<([[f64; UNKNOWNS]; UNKNOWNS], [f64; UNKNOWNS])> =
            self.places.par_chunks(SUMMED).map(|places| self.sums(places, *gain, scale)).collect();
        let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut right = [0.0; UNKNOWNS];
        // In the order of the pixels, so that the number of threads does not count.
        for (part, of_right) in sums {
            for i in 0..UNKNOWNS {
                (0..UNKNOWNS).for_each(|k| matrix[i][k] += part[i][k]);
                right[i] += of_right[i];
            }
        }
        for (i, row) in matrix.iter_mut().enumerate() {
            row[i] *= 1.0 + DIAGONAL_SHARE;
        }
        let d = solve(matrix, right)?;
        *gain = [gain[0] + d[8], gain[1] + d[9]];
        // The change is made in coordinates in which what is shared reaches from -1 to 1.
        let change = DMat3::from_cols(
            DVec3::new(1.0 + d[0], d[1], d[2]),
            DVec3::new(d[3], 1.0 + d[4], d[5]),
            DVec3::new(d[6], d[7], 1.0),
        );
        let frame = DMat3::from_translation(self.middle) * DMat3::from_scale(DVec2::splat(self.half));
        let moved = self.matrix * frame * change * frame.inverse();
        let far = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
            let corner = self.middle + DVec2::new(x, y) * self.half;
            (project(&moved, corner) - project(&self.matrix, corner)).length()
        });
        let far = far.into_iter().fold(0.0, f64::max);
        (moved.is_finite() && far.is_finite()).then_some((moved, far))
    }

    /// The normal equations of some pixels.
    fn sums(
        &self,
        places: &[Vec2],
        gain: [f64; 2],
        scale: f32,
    ) -> ([[f64; UNKNOWNS]; UNKNOWNS], [f64; UNKNOWNS]) {
        let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut right = [0.0; UNKNOWNS];
        for &place in places {
            let at = place.as_dvec2();
            let (value, change) = self.fine.at_with_slope(project(&self.matrix, at).as_vec2());
            let (across, down) = slope(&self.matrix, at);
            let change = change.as_dvec2();
            // Change of the value by a step of one unit of the frame.
            let by = DVec2::new(change.dot(across), change.dot(down)) * (self.half * gain[0]);
            let p = (at - self.middle) / self.half;
            let difference = f64::from(self.coarse.at(place)) - gain[0] * f64::from(value) - gain[1];
            let part = (difference as f32 / (TUKEY * scale)).powi(2);
            if part >= 1.0 {
                continue;
            }
            let weight = f64::from((1.0 - part).powi(2));
            let along = by.dot(p);
            let row = [
                by.x * p.x,
                by.y * p.x,
                -along * p.x,
                by.x * p.y,
                by.y * p.y,
                -along * p.y,
                by.x,
                by.y,
                f64::from(value),
                1.0,
            ];
            for i in 0..UNKNOWNS {
                let weighted = weight * row[i];
                (i..UNKNOWNS).for_each(|k| matrix[i][k] += weighted * row[k]);
                right[i] += weighted * difference;
            }
        }
        for i in 0..UNKNOWNS {
            (0..i).for_each(|k| matrix[i][k] = matrix[k][i]);
        }
        (matrix, right)
    }

    fn agreement(&self) -> Agreement {
        let values = self.values();
        let low = self.middle - self.half;
        let mut fields = vec![Moments::default(); FIELDS * FIELDS];
        let mut whole = Moments::default();
        for (place, pair) in self.places.iter().zip(&values) {
            let field = ((place.as_dvec2() - low) / (2.0 * self.half) * FIELDS as f64).as_uvec2();
            let index =
                field.y.min(FIELDS as u32 - 1) as usize * FIELDS + field.x.min(FIELDS as u32 - 1) as usize;
            fields[index].add(*pair);
            whole.add(*pair);
        }
        let least = (LEAST_FIELD.0 * self.places.len() as f64 / (FIELDS * FIELDS) as f64).max(LEAST_FIELD.1);
        let mut told: Vec<f64> = fields
            .iter()
            .filter(|field| field.count >= least && field.deviations().0 > FLAT)
            .map(Moments::correlation)
            .collect();
        told.sort_by(f64::total_cmp);
        let fields = told.get(told.len() / 2).copied().unwrap_or(0.0);
        Agreement { correlation: whole.correlation(), fields, pixels: values.len() }
    }
}

fn bounds(polygon: &[DVec2]) -> Option<(DVec2, DVec2)> {
    let low = polygon.iter().copied().reduce(DVec2::min)?;
    let high = polygon.iter().copied().reduce(DVec2::max)?;
    Some((low, high))
}

/// Gain and offset by least squares where they are not known, and the deviation of most differences.
fn weight_scale(values: &[(f32, f32)], gain: &mut [f64; 2]) -> f32 {
    if gain[0] == 0.0 {
        *gain = Moments::of(values).line();
    }
    let [a, b] = gain.map(|value| value as f32);
    let mut differences: Vec<f32> =
        values.iter().map(|(coarse, fine)| (coarse - a * fine - b).abs()).collect();
    let middle = differences.len() / 2;
    if differences.is_empty() {
        return 1.0;
    }
    let (_, median, _) = differences.select_nth_unstable_by(middle, f32::total_cmp);
    // The median of a normal distribution's absolute values, and no less than a step of 8 bits.
    (*median / MEDIAN_DEVIATION).max(1.0 / 255.0)
}

/// Sums of pairs of values.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    sums: [f64; 2],
    squares: [f64; 3],
}

impl Moments {
    fn of(values: &[(f32, f32)]) -> Moments {
        let mut moments = Moments::default();
        values.iter().for_each(|&pair| moments.add(pair));
        moments
    }

    fn add(&mut self, (a, b): (f32, f32)) {
        let (a, b) = (f64::from(a), f64::from(b));
        self.count += 1.0;
        self.sums = [self.sums[0] + a, self.sums[1] + b];
        self.squares = [self.squares[0] + a * a, self.squares[1] + b * b, self.squares[2] + a * b];
    }

    fn covariance(&self) -> [f64; 3] {
        let [a, b] = self.sums.map(|sum| sum / self.count.max(1.0));
        let [aa, bb, ab] = self.squares.map(|sum| sum / self.count.max(1.0));
        [aa - a * a, bb - b * b, ab - a * b]
    }

    fn deviations(&self) -> (f64, f64) {
        let [aa, bb, _] = self.covariance();
        (aa.max(0.0).sqrt(), bb.max(0.0).sqrt())
    }

    fn correlation(&self) -> f64 {
        let [aa, bb, ab] = self.covariance();
        ab / (aa * bb).max(1e-18).sqrt()
    }

    /// Gain and offset from the second to the first.
    fn line(&self) -> [f64; 2] {
        let [_, bb, ab] = self.covariance();
        let gain = if bb > 1e-12 { (ab / bb).clamp(GAIN.0, GAIN.1) } else { 1.0 };
        [gain, (self.sums[0] - gain * self.sums[1]) / self.count.max(1.0)]
    }
}

/// How well the photographs agree under `matrix`, from the coarser to the finer one.
pub(crate) fn agreement(coarse: &Pyramid, fine: &Pyramid, matrix: &DMat3) -> Agreement {
    Shared::new(coarse, fine, matrix, 0).map_or(Agreement::default(), |shared| shared.agreement())
}

/// `matrix`, from the coarser to the finer photograph, refined; as it was where no step makes the photographs agree
/// better, or the job is cancelled.
pub(crate) fn refine(
    coarse: &Pyramid,
    fine: &Pyramid,
    matrix: &DMat3,
    cancel: CancelCheck<'_>,
) -> (DMat3, Agreement) {
    let mut best = (*matrix, agreement(coarse, fine, matrix));
    let mut current = *matrix;
    for level in (0..LEVELS).rev() {
        let Some(mut shared) = Shared::new(coarse, fine, &current, level) else { continue };
        if shared.places.len() < LEAST_PIXELS {
            continue;
        }
        let mut gain = [0.0; 2];
        let to_fine = |shared: &Shared<'_>| {
            let pixel = coarse.levels[0].extent() / shared.coarse.extent();
            let size = fine.levels[0].extent() / shared.fine.extent();
            normalised(DMat3::from_scale(size) * shared.matrix * DMat3::from_scale(pixel.recip()))
        };
        for _ in (0..STEPS).take_while(|_| !cancel.is_cancelled()) {
            let Some((moved, far)) = shared.step(&mut gain) else { break };
            shared.matrix = moved;
            let extent = shared.fine.extent() - 1.0;
            shared.places.retain(|place| {
                let moved = project(&moved, place.as_dvec2());
                moved.cmpgt(DVec2::ONE).all() && moved.cmplt(extent).all()
            });
            if far < LAST_STEP || shared.places.len() < LEAST_PIXELS {
                break;
            }
        }
        current = to_fine(&shared);
        let found = agreement(coarse, fine, &current);
        // A small size may lead astray; the next starts from the best so far.
        if found.correlation > best.1.correlation && 2 * found.pixels > best.1.pixels {
            best = (current, found);
        }
        current = best.0;
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(width: usize, height: usize, matrix: &DMat3, gain: f32) -> Gray {
        let value = |i: usize| {
            let place = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let p = project(matrix, place).as_vec2();
            let waves = (p.x * 0.11).sin() + (p.y * 0.13 + 1.0).sin() + (0.07 * (p.x + p.y)).cos();
            gain * (0.5 + 0.12 * waves + 0.05 * (0.31 * p.x - 0.23 * p.y).sin()) + 0.02
        };
        Gray { width, height, data: (0..width * height).map(value).collect() }
    }

    #[test]
    fn a_rough_homography_becomes_exact_whatever_the_exposure() {
        let coarse = Pyramid::new(texture(240, 200, &DMat3::IDENTITY, 1.0));
        // The finer image shows a part at twice the size.
        let truth = DMat3::from_cols_array(&[2.0, 0.1, 1e-4, -0.1, 2.05, -1e-4, -110.0, -90.0, 1.0]);
        let fine = Pyramid::new(texture(260, 230, &truth.inverse(), 0.7));
        let mut rough = truth;
        rough.z_axis.x += 2.5;
        rough.z_axis.y -= 2.0;
        rough.x_axis.x *= 1.01;
        let (found, agreed) = refine(&coarse, &fine, &rough, CancelCheck::default());
        assert!(agreed.correlation > 0.995, "{agreed:?}");
        for corner in seen_in(&truth.inverse(), DVec2::new(260.0, 230.0), DVec2::new(240.0, 200.0)) {
            let far = (project(&found, corner) - project(&truth, corner)).length();
            assert!(far < 0.4, "{far} at {corner}");
        }
    }
}

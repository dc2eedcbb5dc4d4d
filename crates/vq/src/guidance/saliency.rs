//! Saliency: where a look at the image goes first.
//!
//! Method: paper section 3.2, which takes the bottom-up model of Itti, Koch and Niebur, "A model of
//! saliency-based visual attention for rapid scene analysis", 1998, as it stands:
//! 1. Gaussian pyramids of intensity, of the two colour opponencies red-green and blue-yellow (of broadly tuned
//!    colours, divided by intensity where that exceeds a tenth of its maximum), and of the local orientation
//!    energy at 0, 45, 90 and 135 degrees (quadrature Gabor filters on every level of the intensity pyramid).
//! 2. Feature maps: differences between a centre level c in {2, 3, 4} and a surround level c + {3, 4}.
//! 3. The operator N promotes maps with few strong peaks over maps with many alike.
//! 4. Conspicuity maps of intensity, colour and orientation are sums of the promoted feature maps; the saliency
//!    map is the mean of the promoted conspicuity maps. Gray images have no colour map.
//!
//! Values are used as stored: they are close to what is perceived, and the paper does the same.
//!
//! Cost: one pass over the image, some 15 million multiplications on at most 512x512 texels, one bilinear
//! upsampling. The finest level that counts is 2, so that an image longer than 512 texels is averaged down first:
//! what is left out is finer than 1/128 of the image, where nobody looks first. Measured on one core: 0.04 s for
//! 512x512 texels, 0.18 s for 4096x4096.
//!
//! Deviations:
//! - The map is stretched so that its lowest value is 0 too: the ground has no saliency.
//! - Levels are mirrored at their borders. The model says nothing; repeated borders make patterns end there, which
//!   outweighed an odd bar among even ones.
//! - Maps are added on the finest centre level, not on level 4: importance is to follow objects, and a cell of
//!   level 4 is 16 texels wide.
//! - An opponency is compared with itself, |RG(c) - RG(s)|. The formula in print adds instead, and would find a
//!   plain red image salient everywhere.
//! - Images of up to 128 texels use finer centres, those of up to 64 the image itself as the finest; up to 32,
//!   pairs whose surround would be coarser than one texel are dropped. Below 5 texels none is left: the map is all
//!   zeros, as it is for a constant image.
//! - Contrasts below [`FLOOR`] are nothing, or else N would blow rounding errors up to full range.
//! - What is transparent takes the mean visible colour, for colours behind it are arbitrary.

use std::f32::consts::{FRAC_PI_4, TAU};
use std::ops::Range;

use glam::{Vec3, Vec4};
use ndarray::{Array2, ArrayView2, Axis, Slice};
use rayon::prelude::*;
use texfold_core::CancelCheck;
use texfold_core::image::Raster;

use super::{Map, fill_rows, halve, normalise, opacity, resample};

/// Longest side of the working copy in texels. The model was tuned on 640x480; 512 has the same nine levels, and
/// with it the finest centre keeps 128 texels a side.
const WORKING_SIDE: u32 = 512;
/// Finest centre level of an image of full size, as in the model.
const FINEST_CENTRE: usize = 2;
/// Number of centre levels, as in the model.
const CENTRES: usize = 3;
/// Distances from centre to surround level, as in the model.
const SURROUNDS: [usize; 2] = [3, 4];
/// Levels from the finest centre to the coarsest surround.
const LEVELS: usize = CENTRES + SURROUNDS[1];
/// Smallest range of a map that counts, where the brightest value is 1: half a step of 8 bits. Lower values let
/// rounding errors pass for contrast.
const FLOOR: f32 = 0.5 / 255.0;
/// Colour is not seen below this share of the brightest intensity (section on early visual features).
const DARK: f32 = 0.1;
/// Local maxima below this share of the highest do not take part in N: they are texture of the ground, and their
/// number would pull the mean to 0 and so call every noisy map unique.
const LEAST_PEAK: f32 = 0.1;
/// Values are cut to this magnitude, so that averages of any finite values are finite.
const LARGEST: Vec3 = Vec3::splat(1e30);
/// Number of orientations, 45 degrees apart.
const ORIENTATIONS: usize = 4;
/// Gabor filters reach this many texels: 1.7 standard deviations, where the envelope is down to 0.23.
const GABOR_RADIUS: usize = 4;
/// Texels of a side of a Gabor filter.
const GABOR_SIDE: usize = 2 * GABOR_RADIUS + 1;
/// Wavelength of the Gabor filters in texels: one octave of orientations a level.
const GABOR_PERIOD: f32 = 7.0;
/// Standard deviation of the Gabor envelope in texels, a third of the wavelength.
const GABOR_SIGMA: f32 = GABOR_PERIOD / 3.0;

/// How much each texel of `image` stands out, 0 to 1; the highest value is 1. All zeros where nothing stands
/// out: in constant images and in those below 5 texels a side.
#[must_use]
pub fn saliency_map(image: &Raster) -> Map {
    saliency(image, CancelCheck::default())
}

/// As [`saliency_map`]; of no use once the job is cancelled.
pub(crate) fn saliency(image: &Raster, cancel: CancelCheck<'_>) -> Map {
    let size = image.size();
    let features = Features::new(image, cancel);
    let working = features.intensity.dim();
    let finest = finest_centre(working);
    let intensity = levels(features.intensity, finest);
    let (colour, (light, oriented)) = rayon::join(
        || features.opponents.map(|planes| colour_conspicuity(planes, finest)),
        || rayon::join(|| contrasts(&intensity), || orientation_conspicuity(&intensity)),
    );
    let mut sum = Map::zeros(intensity[0].dim());
    for mut map in [Some(light), colour, Some(oriented)].into_iter().flatten() {
        promote(&mut map);
        sum += &map;
    }
    let low = sum.iter().copied().fold(f32::MAX, f32::min);
    sum.mapv_inplace(|value| value - low);
    let step = |from: u32, to: usize| to as f64 / f64::from(from) / (1_u32 << finest) as f64;
    let full = (size.height as usize, size.width as usize);
    let mut map = resample(&sum, full, (step(size.height, working.0), step(size.width, working.1)), cancel);
    normalise(&mut map);
    map
}

/// Level of the finest centre for a working copy of `dim`: 2, or less where the coarsest surround would be
/// coarser than one texel.
fn finest_centre(dim: (usize, usize)) -> usize {
    let depth = dim.0.max(dim.1).next_power_of_two().ilog2() as usize;
    (depth + 1).saturating_sub(LEVELS).min(FINEST_CENTRE)
}

/// The levels of a pyramid from `finest` to the coarsest surround, or to a single texel.
fn levels(base: Map, finest: usize) -> Vec<Map> {
    let next = |map: &Map| (map.len() > 1).then(|| halve(map, CancelCheck::default()));
    std::iter::successors(Some(base), next).skip(finest).take(LEVELS).collect()
}

/// What the eye has to go by, on the working copy.
struct Features {
    /// Mean of the channels; the largest absolute value of a channel is 1.
    intensity: Map,
    /// Red against green and blue against yellow; none for gray images.
    opponents: Option<[Map; 2]>,
}

impl Features {
    fn new(image: &Raster, cancel: CancelCheck<'_>) -> Self {
        let mut texels = over_mean(&working_copy(image, cancel));
        let peak = texels.iter().map(|texel| texel.abs().max_element()).fold(0.0, f32::max);
        if peak > 0.0 {
            texels.mapv_inplace(|texel| texel / peak);
        }
        let intensity = texels.mapv(|texel| texel.element_sum() / 3.0);
        let opponents = (image.info().color_channels() > 1).then(|| {
            let dark = DARK * intensity.iter().copied().fold(0.0, f32::max);
            let pairs = texels.mapv(|texel| opponency(texel, dark));
            [pairs.mapv(|pair| pair[0]), pairs.mapv(|pair| pair[1])]
        });
        Features { intensity, opponents }
    }
}

/// Red minus green and blue minus yellow of a colour, all broadly tuned; 0 for intensities up to `dark`.
fn opponency(texel: Vec3, dark: f32) -> [f32; 2] {
    let intensity = texel.element_sum() / 3.0;
    if intensity <= dark {
        return [0.0; 2];
    }
    let [r, g, b] = (texel / intensity).to_array();
    let red = (r - (g + b) / 2.0).max(0.0);
    let green = (g - (r + b) / 2.0).max(0.0);
    let blue = (b - (r + g) / 2.0).max(0.0);
    let yellow = ((r + g) / 2.0 - (r - g).abs() / 2.0 - b).max(0.0);
    [red - green, blue - yellow]
}

/// What one texel of the working copy averages along one axis.
struct Span {
    first: u32,
    weights: Vec<f32>,
}

/// The spans of `count` working texels on a line of `len`; the weights of each add up to 1.
fn spans(len: u32, count: u32) -> Vec<Span> {
    let edge = |i: u32| f64::from(len) * f64::from(i) / f64::from(count);
    let span = |i: u32| {
        let (low, high) = (edge(i), edge(i + 1));
        let (first, end) = (low as u32, high.ceil() as u32);
        let overlap = |k: u32| (high.min(f64::from(k) + 1.0) - low.max(f64::from(k))) / (high - low);
        Span { first, weights: (first..end).map(|k| overlap(k) as f32).collect() }
    };
    (0..count).map(span).collect()
}

/// The image averaged down to [`WORKING_SIDE`], colours multiplied by opacity, opacity beside them.
fn working_copy(image: &Raster, cancel: CancelCheck<'_>) -> Array2<Vec4> {
    let (size, alpha) = (image.size(), image.info().alpha);
    let long = size.width.max(size.height);
    let side = |len: u32| {
        let scaled = f64::from(len) * f64::from(WORKING_SIDE.min(long)) / f64::from(long);
        scaled.round().max(1.0) as u32
    };
    let (rows, columns) = (spans(size.height, side(size.height)), spans(size.width, side(size.width)));
    let mut copy = Array2::from_elem((rows.len(), columns.len()), Vec4::ZERO);
    fill_rows(&mut copy, cancel, |row, line| {
        for (y, down) in (rows[row].first..).zip(&rows[row].weights) {
            for (sum, span) in line.iter_mut().zip(&columns) {
                for (x, across) in (span.first..).zip(&span.weights) {
                    let texel = image.texel(x, y);
                    let seen = opacity(texel.w, alpha);
                    let colour = texel.truncate().clamp(-LARGEST, LARGEST);
                    *sum += (colour * seen).extend(seen) * (down * across);
                }
            }
        }
    });
    copy
}

/// Colours laid over their own mean.
fn over_mean(texels: &Array2<Vec4>) -> Array2<Vec3> {
    let share = 1.0 / texels.len().max(1) as f32;
    let sum = texels.iter().fold(Vec4::ZERO, |sum, texel| sum + *texel * share);
    let mean = if sum.w > 0.0 { sum.truncate() / sum.w } else { Vec3::ZERO };
    texels.mapv(|texel| texel.truncate() + mean * (1.0 - texel.w))
}

/// The feature maps of one pyramid, |centre - surround|, promoted and added up on the finest centre level.
fn contrasts(levels: &[Map]) -> Map {
    let mut sum = Map::zeros(levels[0].dim());
    let pairs = (0..CENTRES).flat_map(|centre| SURROUNDS.map(|distance| (centre, distance)));
    for (centre, distance) in pairs {
        let (Some(near), Some(wide)) = (levels.get(centre), levels.get(centre + distance)) else {
            continue;
        };
        let mut feature = enlarge(wide, near.dim(), distance);
        feature.zip_mut_with(near, |wide, near| *wide = (*near - *wide).abs());
        promote(&mut feature);
        sum += &enlarge(&feature, sum.dim(), centre);
    }
    sum
}

/// `map` on the grid of a level that is `distance` levels finer.
fn enlarge(map: &Map, dim: (usize, usize), distance: usize) -> Map {
    let step = 0.5_f64.powi(distance as i32);
    resample(map, dim, (step, step), CancelCheck::default())
}

/// The operator N: stretches `map` to [0, 1] and multiplies it by (1 - m)^2, m the mean of the local maxima
/// other than the highest. A map of less range than [`FLOOR`] becomes 0.
fn promote(map: &mut Map) {
    let (low, high) = map.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
    if high - low < FLOOR {
        map.fill(0.0);
        return;
    }
    map.mapv_inplace(|value| (value - low) / (high - low));
    let (sum, count) = local_maxima(map);
    // The highest is one of them: a map that reaches 1 has a maximum of 1.
    let mean = if count > 1 { (sum - 1.0) / (count - 1) as f32 } else { 0.0 };
    let uniqueness = (1.0 - mean) * (1.0 - mean);
    map.mapv_inplace(|value| value * uniqueness);
}

fn window(map: &Map, rows: Range<usize>, columns: Range<usize>) -> ArrayView2<'_, f32> {
    map.slice_each_axis(|axis| Slice::from(if axis.axis == Axis(0) { rows.clone() } else { columns.clone() }))
}

/// Sum and number of the local maxima from [`LEAST_PEAK`] up. Of equal neighbours only the first counts.
fn local_maxima(map: &Map) -> (f32, usize) {
    let (rows, columns) = map.dim();
    let beats = |y: usize, x: usize| {
        let value = map[[y, x]];
        let around = (y.saturating_sub(1)..(y + 2).min(rows), x.saturating_sub(1)..(x + 2).min(columns));
        let corner = (y.saturating_sub(1), x.saturating_sub(1));
        window(map, around.0, around.1).indexed_iter().all(|((row, column), &other)| {
            let before = (corner.0 + row, corner.1 + column) < (y, x);
            value > other || (value == other && !before)
        })
    };
    let peaks = map.indexed_iter().filter(|&((y, x), &value)| value >= LEAST_PEAK && beats(y, x));
    peaks.fold((0.0, 0), |(sum, count), (_, value)| (sum + value, count + 1))
}

fn colour_conspicuity(opponents: [Map; 2], finest: usize) -> Map {
    let [red_green, blue_yellow] = opponents.map(|plane| contrasts(&levels(plane, finest)));
    red_green + blue_yellow
}

fn orientation_conspicuity(intensity: &[Map]) -> Map {
    let conspicuity = |index: usize| {
        let gabor = Gabor::new(index as f32 * FRAC_PI_4);
        let energies: Vec<Map> = intensity.iter().map(|level| gabor.energy(level)).collect();
        let mut map = contrasts(&energies);
        promote(&mut map);
        map
    };
    let maps: Vec<Map> = (0..ORIENTATIONS).into_par_iter().map(conspicuity).collect();
    maps.iter().fold(Map::zeros(intensity[0].dim()), |sum, map| sum + map)
}

/// Taps of a filter by row and column.
type Taps = [[f32; GABOR_SIDE]; GABOR_SIDE];

/// A quadrature pair of oriented filters.
struct Gabor {
    even: Taps,
    odd: Taps,
}

impl Gabor {
    /// The filters whose waves travel along `angle` (0 answers to vertical lines). The even one has its mean
    /// taken out under the envelope, so that plain areas give 0; the magnitudes of each add up to 1.
    fn new(angle: f32) -> Self {
        let (sin, cos) = angle.sin_cos();
        let place = |i: usize| i as f32 - GABOR_RADIUS as f32;
        let envelope = |x: f32, y: f32| (-(x * x + y * y) / (2.0 * GABOR_SIGMA * GABOR_SIGMA)).exp();
        let filter = |wave: &dyn Fn(f32) -> f32| -> Taps {
            std::array::from_fn(|row| {
                std::array::from_fn(|column| {
                    let (x, y) = (place(column), place(row));
                    envelope(x, y) * wave(TAU / GABOR_PERIOD * (x * cos + y * sin))
                })
            })
        };
        let total = |filter: &Taps| filter.iter().flatten().sum::<f32>();
        let offset = total(&filter(&f32::cos)) / total(&filter(&|_| 1.0));
        let unit = |mut filter: Taps| {
            let sum: f32 = filter.iter().flatten().map(|tap| tap.abs()).sum();
            filter.iter_mut().flatten().for_each(|tap| *tap /= sum);
            filter
        };
        Gabor { even: unit(filter(&|phase| phase.cos() - offset)), odd: unit(filter(&f32::sin)) }
    }

    /// Magnitude of both answers at every texel. The level is mirrored at its borders, as the pyramid is: where the
    /// border was repeated, patterns would end there and the border would stand out.
    fn energy(&self, level: &Map) -> Map {
        let (rows, columns) = level.dim();
        let dim = (rows + 2 * GABOR_RADIUS, columns + 2 * GABOR_RADIUS);
        let padded = Map::from_shape_fn(dim, |(y, x)| level[[mirrored(y, rows), mirrored(x, columns)]]);
        let answer = |filter: &Taps| {
            let mut sum = Map::zeros(level.dim());
            for (row, taps) in filter.iter().enumerate() {
                for (column, &tap) in taps.iter().enumerate() {
                    sum.scaled_add(tap, &window(&padded, row..row + rows, column..column + columns));
                }
            }
            sum
        };
        let mut energy = answer(&self.even);
        energy.zip_mut_with(&answer(&self.odd), |even, odd| *even = even.hypot(*odd));
        energy
    }
}

/// The texel of a line of `len` that texel `i` of the padded line shows: the line, mirrored at both ends.
fn mirrored(i: usize, len: usize) -> usize {
    // Offset so that the difference stays positive: a multiple of the period of 2 len.
    let place = (i + 2 * len * GABOR_RADIUS - GABOR_RADIUS) % (2 * len);
    place.min(2 * len - 1 - place)
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::{Alpha, PixelInfo};

    fn raster<const C: usize>(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; C]) -> Raster {
        let alpha = if C.is_multiple_of(2) { Alpha::Straight } else { Alpha::Opaque };
        let info = PixelInfo { channels: C as u8, alpha, ..PixelInfo::default() };
        let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y));
        Raster::new(width, height, info, data.collect()).unwrap()
    }

    /// Column and row of the highest value.
    fn peak(map: &Map) -> (usize, usize) {
        let ((y, x), _) = map.indexed_iter().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        (x, y)
    }

    fn max_near(map: &Map, centre: (usize, usize), radius: usize) -> f32 {
        let range = |c: usize, len: usize| c.saturating_sub(radius)..(c + radius + 1).min(len);
        let part = window(map, range(centre.1, map.nrows()), range(centre.0, map.ncols()));
        part.iter().copied().fold(0.0, f32::max)
    }

    /// Places of a 4x4 grid of items 64 texels apart.
    fn item(x: u32, y: u32) -> ((u32, u32), (f32, f32)) {
        ((x / 64, y / 64), ((x % 64) as f32 - 31.5, (y % 64) as f32 - 31.5))
    }

    /// How much the item at (2, 1) beats the best of the others.
    fn advantage(map: &Map) -> f32 {
        let value = |x: usize, y: usize| max_near(map, (x * 64 + 32, y * 64 + 32), 20);
        let others = (0..16).filter(|&i| i != 6).map(|i| value(i % 4, i / 4)).fold(0.0, f32::max);
        value(2, 1) / others
    }

    #[test]
    fn a_bright_spot_on_gray_stands_out() {
        for side in [48, 128, 256, 700] {
            let spot = |x: u32| x.abs_diff(side / 4) < side / 24;
            let map = saliency_map(&raster(side, side, |x, y| [if spot(x) && spot(y) { 1.0 } else { 0.5 }]));
            let (x, y) = peak(&map);
            let near = |at: usize| at.abs_diff(side as usize / 4) <= side as usize / 16;
            assert!(near(x) && near(y), "side {side}: peak at {x}, {y}");
            assert_eq!(map[[y, x]], 1.0);
            assert!(map[[side as usize * 3 / 4, side as usize * 3 / 4]] < 0.1, "side {side}");
        }
    }

    #[test]
    fn a_red_dot_pops_out_of_green_ones() {
        // All of the same intensity, so that only colour can tell.
        let map = saliency_map(&raster(256, 256, |x, y| match item(x, y) {
            (_, (dx, dy)) if dx.hypot(dy) > 10.0 => [0.3, 0.3, 0.3],
            ((2, 1), _) => [0.7, 0.1, 0.1],
            _ => [0.1, 0.7, 0.1],
        }));
        assert!(advantage(&map) > 1.5, "{}", advantage(&map));
    }

    #[test]
    fn a_vertical_bar_pops_out_of_horizontal_ones() {
        let map = saliency_map(&raster(256, 256, |x, y| {
            let (place, (dx, dy)) = item(x, y);
            let (along, across) = if place == (2, 1) { (dy, dx) } else { (dx, dy) };
            [if along.abs() < 14.0 && across.abs() < 4.0 { 0.9 } else { 0.4 }]
        }));
        assert!(advantage(&map) > 1.5, "{}", advantage(&map));
    }

    #[test]
    fn constant_images_give_zeros() {
        for value in [0.0, 0.2, 1.0, -3.0, f32::MIN_POSITIVE, f32::MAX] {
            assert_eq!(saliency_map(&raster(100, 70, |_, _| [value])), Map::zeros((70, 100)), "gray {value}");
            let map = saliency_map(&raster(600, 300, |_, _| [value, value / 3.0, value / 7.0]));
            assert_eq!(map, Map::zeros((300, 600)), "colour {value}");
        }
    }

    #[test]
    fn any_shape_gives_values_from_zero_to_one() {
        for (width, height) in [(1, 1), (3, 5), (4, 4), (4097, 1), (1, 700), (513, 7)] {
            let noise = |x: u32, y: u32| (x * 7919 + y * 104_729) % 251;
            let image = raster(width, height, |x, y| [noise(x, y) as f32 / 250.0, 0.5, (x % 3) as f32]);
            let map = saliency_map(&image);
            assert_eq!(map.dim(), (height as usize, width as usize));
            assert!(map.iter().all(|value| (0.0..=1.0).contains(value)), "{width}x{height}");
            let max = map.iter().copied().fold(0.0, f32::max);
            assert_eq!(max, if width.max(height) < 5 { 0.0 } else { 1.0 }, "{width}x{height}");
        }
    }

    #[test]
    fn colours_behind_transparency_do_not_count() {
        let behind = |hidden: f32| {
            saliency_map(&raster(128, 128, |x, y| match (x / 16, y / 16) {
                (2, 2) => [hidden, 1.0 - hidden, 0.0, 0.0],
                (5, 5) => [0.9, 0.2, 0.2, 1.0],
                _ => [0.4, 0.4, 0.4, 1.0],
            }))
        };
        assert_eq!(behind(0.0), behind(1.0));
        let (x, y) = peak(&behind(1.0));
        assert!((72..104).contains(&x) && (72..104).contains(&y), "peak at {x}, {y}");
    }

    #[test]
    fn threads_do_not_change_the_map() {
        let image = raster(611, 389, |x, y| [(x * y % 97) as f32 / 96.0, (x % 50) as f32 / 49.0, 0.3]);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| saliency_map(&image))
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    fn spans_share_out_every_texel() {
        for (len, count) in [(513, 512), (4097, 512), (7, 7), (1, 1), (1000, 3)] {
            let mut shares = vec![0.0; len as usize];
            for span in spans(len, count) {
                assert!((span.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                for (k, weight) in (span.first..).zip(&span.weights) {
                    shares[k as usize] += weight * len as f32 / count as f32;
                }
            }
            assert!(shares.iter().all(|share| (share - 1.0).abs() < 1e-4), "{len} to {count}");
        }
    }

    #[test]
    fn filters_ignore_plain_areas_and_answer_to_their_own_direction() {
        let stripes = Map::from_shape_fn((32, 32), |(_, x)| (x as f32 * TAU / GABOR_PERIOD).sin());
        let answer = |index: usize, map: &Map| Gabor::new(index as f32 * FRAC_PI_4).energy(map)[[16, 16]];
        assert!((0..ORIENTATIONS).all(|index| answer(index, &Map::ones((32, 32))) < 1e-5));
        assert!(answer(0, &stripes) > 2.5 * answer(1, &stripes));
        assert!(answer(0, &stripes) > 20.0 * answer(2, &stripes));
    }

    #[test]
    fn lines_are_mirrored_at_both_ends() {
        let padded: Vec<usize> = (0..3 + 2 * GABOR_RADIUS).map(|i| mirrored(i, 3)).collect();
        assert_eq!(padded, [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0]);
        assert!((0..1 + 2 * GABOR_RADIUS).all(|i| mirrored(i, 1) == 0));
    }

    #[test]
    fn one_strong_peak_is_promoted_over_many() {
        let mut one = Map::zeros((9, 9));
        one[[4, 4]] = 3.0;
        promote(&mut one);
        assert_eq!(one[[4, 4]], 1.0);
        let mut two = Map::zeros((9, 9));
        two[[1, 1]] = 2.0;
        // A plateau is one maximum.
        two[[6, 6]] = 1.0;
        two[[6, 7]] = 1.0;
        promote(&mut two);
        assert_eq!(two[[1, 1]], 0.25);
        assert_eq!(two[[6, 6]], 0.125);
    }
}

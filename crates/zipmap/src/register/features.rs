//! Features that keep their place under changes of scale and rotation: extrema of differences of Gaussians, each with
//! its scale and the orientations of the gradients around it.
//!
//! Source: Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004, sections 3 to 5. Deviations:
//! of the finest octaves only the strongest features are kept, so that coarse ones, which a wide photograph shows of a
//! close one, are never crowded out; photographs with few features are looked through for fainter ones. Cost: some 80 operations a pixel for each of six blurs an octave.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use texfold_core::CancelCheck;

use super::descriptor::{Descriptor, describe};
use super::gray::Gray;

/// Scales an octave is sampled at.
const SCALES: usize = 3;
/// Blur of the first image of an octave, in its pixels.
const FIRST_SIGMA: f32 = 1.6;
/// Blur that a photograph is taken to have, in pixels.
const CAMERA_SIGMA: f32 = 0.5;
/// Least contrasts of an extremum, of a range of 1: Lowe's, and lower ones for photographs with few features, such as faded ones.
const CONTRASTS: [f32; 4] = [0.03, 0.015, 0.0075, 0.00375];
/// Features from which on a photograph has enough.
const ENOUGH: usize = 500;
/// Largest ratio of curvatures: what lies on a straight edge has no place along it.
const EDGE_RATIO: f32 = 10.0;
/// Most steps to a neighbouring sample while the place of an extremum is found.
const MOVES: usize = 5;
/// Pixels at the border of an octave where no extremum is looked for.
const BORDER: usize = 5;
/// Photographs up to so many pixels are doubled first, which about triples the features.
const DOUBLED_PIXELS: usize = 1 << 20;
/// Larger ones are halved first.
const MOST_PIXELS: usize = 1 << 22;
/// Most features of the first two octaves, and of each further one.
const MOST_FEATURES: [usize; 3] = [2500, 2500, 2000];
/// Bins of a histogram of orientations.
const BINS: usize = 36;
/// Share of the highest bin from which another is an orientation too.
const SECOND_PEAK: f32 = 0.8;

/// A feature of a photograph.
#[derive(Debug, Clone)]
pub(crate) struct Feature {
    /// Its place in pixels.
    pub(crate) place: Vec2,
    /// Its blur in pixels.
    pub(crate) scale: f32,
    /// Direction of the gradients around it, in radians.
    pub(crate) angle: f32,
    pub(crate) descriptor: Descriptor,
}

/// An extremum in the images of an octave.
#[derive(Debug, Clone, Copy)]
struct Extremum {
    /// Pixel in the octave's image; centres are at whole numbers.
    at: Vec2,
    /// Which of the octave's blurs is nearest.
    layer: usize,
    /// Blur in the octave's pixels.
    sigma: f32,
    response: f32,
}

/// All features, coarse ones last, in an order that does not depend on the number of threads. Of no use once the job is
/// cancelled.
pub(crate) fn features(photo: &Gray, cancel: CancelCheck<'_>) -> Vec<Feature> {
    let mut found = Vec::new();
    for contrast in CONTRASTS {
        found = of_contrast(photo, contrast / SCALES as f32, cancel);
        if found.len() >= ENOUGH {
            break;
        }
    }
    found
}

/// All features from that contrast on.
fn of_contrast(photo: &Gray, contrast: f32, cancel: CancelCheck<'_>) -> Vec<Feature> {
    let mut start = photo.clone();
    let mut pixel = 1.0f32;
    let mut sigma = CAMERA_SIGMA;
    if start.data.len() <= DOUBLED_PIXELS {
        start = start.doubled();
        (pixel, sigma) = (0.5, 2.0 * CAMERA_SIGMA);
    }
    while start.data.len() > MOST_PIXELS {
        start = start.halved();
        pixel *= 2.0;
    }
    // A pixel's centre is half a pixel from its corner; thinning keeps the centres of the octave before.
    let centre = 0.5 * pixel;
    let mut base = start.blurred((FIRST_SIGMA * FIRST_SIGMA - sigma * sigma).sqrt(), cancel);
    let mut found = Vec::new();
    for octave in 0.. {
        if base.width.min(base.height) <= 2 * BORDER + 2 || cancel.is_cancelled() {
            break;
        }
        let blurs = blurs(base, cancel);
        let most = MOST_FEATURES[octave.min(MOST_FEATURES.len() - 1)];
        found.extend(of_octave(&blurs, (most, contrast), Scale { pixel, centre }, cancel));
        base = blurs[SCALES].thinned();
        pixel *= 2.0;
    }
    found
}

/// The octave's image at rising blurs, each 2^(1/3) of the one before.
fn blurs(base: Gray, cancel: CancelCheck<'_>) -> Vec<Gray> {
    let step = 2f32.powf(1.0 / SCALES as f32);
    let mut blurs = vec![base];
    for index in 1..SCALES + 3 {
        let before = FIRST_SIGMA * step.powi(index as i32 - 1);
        let next = blurs[index - 1].blurred(before * (step * step - 1.0).sqrt(), cancel);
        blurs.push(next);
    }
    blurs
}

/// How places of an octave's image lead to those of the photograph.
#[derive(Debug, Clone, Copy)]
struct Scale {
    /// Side of an octave's pixel in pixels.
    pixel: f32,
    /// Where the centre of the first one lies.
    centre: f32,
}

fn of_octave(
    blurs: &[Gray],
    (most, contrast): (usize, f32),
    scale: Scale,
    cancel: CancelCheck<'_>,
) -> Vec<Feature> {
    let Scale { pixel, centre } = scale;
    let differences: Vec<Gray> = blurs
        .windows(2)
        .map(|pair| Gray {
            width: pair[0].width,
            height: pair[0].height,
            data: pair[1].data.iter().zip(&pair[0].data).map(|(b, a)| b - a).collect(),
        })
        .collect();
    let (width, height) = (blurs[0].width, blurs[0].height);
    let rows: Vec<Vec<Extremum>> = (BORDER..height - BORDER)
        .into_par_iter()
        .map(|y| {
            if cancel.is_cancelled() {
                return Vec::new();
            }
            let layers = (1..=SCALES).flat_map(|layer| (BORDER..width - BORDER).map(move |x| (layer, x)));
            layers
                .filter(|&(layer, x)| is_extremum(&differences, contrast, layer, x, y))
                .filter_map(|(layer, x)| localise(&differences, contrast, layer, x, y))
                .collect()
        })
        .collect();
    let mut extrema: Vec<Extremum> = rows.into_iter().flatten().collect();
    if extrema.len() > most {
        extrema.sort_by(|a, b| b.response.total_cmp(&a.response));
        extrema.truncate(most);
    }
    let described: Vec<Vec<Feature>> = extrema
        .par_iter()
        .map(|extremum| {
            if cancel.is_cancelled() {
                return Vec::new();
            }
            let blur = &blurs[extremum.layer];
            let feature = |angle| Feature {
                place: extremum.at * pixel + centre,
                scale: extremum.sigma * pixel,
                angle,
                descriptor: describe(blur, extremum.at, extremum.sigma, angle),
            };
            orientations(blur, extremum).into_iter().map(feature).collect()
        })
        .collect();
    described.into_iter().flatten().collect()
}

/// Whether a pixel is above or below all of its 26 neighbours.
fn is_extremum(differences: &[Gray], contrast: f32, layer: usize, x: usize, y: usize) -> bool {
    let width = differences[0].width;
    let at = y * width + x;
    let value = differences[layer].data[at];
    if value.abs() < 0.5 * contrast {
        return false;
    }
    let sign = value.signum();
    let value = value.abs();
    for (index, difference) in differences[layer - 1..=layer + 1].iter().enumerate() {
        for row in [at - width, at, at + width] {
            let three = &difference.data[row - 1..row + 2];
            let own = index == 1 && row == at;
            if (0..3).any(|k| !(own && k == 1) && three[k] * sign >= value) {
                return false;
            }
        }
    }
    true
}

/// The extremum of the parabola through the samples around; `None` where it has none nearby, too little contrast, or
/// lies on an edge.
fn localise(differences: &[Gray], contrast: f32, layer: usize, x: usize, y: usize) -> Option<Extremum> {
    let (mut layer, mut x, mut y) = (layer, x, y);
    for _ in 0..MOVES {
        let value = |dl: isize, dx: isize, dy: isize| {
            differences[layer.wrapping_add_signed(dl)].get(x as isize + dx, y as isize + dy)
        };
        let centre = value(0, 0, 0);
        let slope = 0.5
            * Vec3::new(
                value(0, 1, 0) - value(0, -1, 0),
                value(0, 0, 1) - value(0, 0, -1),
                value(1, 0, 0) - value(-1, 0, 0),
            );
        let xx = value(0, 1, 0) + value(0, -1, 0) - 2.0 * centre;
        let yy = value(0, 0, 1) + value(0, 0, -1) - 2.0 * centre;
        let ss = value(1, 0, 0) + value(-1, 0, 0) - 2.0 * centre;
        let xy = 0.25 * (value(0, 1, 1) - value(0, -1, 1) - value(0, 1, -1) + value(0, -1, -1));
        let xs = 0.25 * (value(1, 1, 0) - value(1, -1, 0) - value(-1, 1, 0) + value(-1, -1, 0));
        let ys = 0.25 * (value(1, 0, 1) - value(1, 0, -1) - value(-1, 0, 1) + value(-1, 0, -1));
        let curvature =
            glam::Mat3::from_cols(Vec3::new(xx, xy, xs), Vec3::new(xy, yy, ys), Vec3::new(xs, ys, ss));
        if curvature.determinant().abs() < 1e-20 {
            return None;
        }
        let offset = -(curvature.inverse() * slope);
        if offset.abs().max_element() <= 0.6 {
            let response = (centre + 0.5 * slope.dot(offset)).abs();
            let (trace, determinant) = (xx + yy, xx * yy - xy * xy);
            let limit = (EDGE_RATIO + 1.0).powi(2) / EDGE_RATIO;
            let fits = response >= contrast && determinant > 0.0 && trace * trace < limit * determinant;
            let sigma = FIRST_SIGMA * 2f32.powf((layer as f32 + offset.z) / SCALES as f32);
            let at = Vec2::new(x as f32 + offset.x, y as f32 + offset.y);
            return fits.then_some(Extremum { at, layer, sigma, response });
        }
        let step = offset.round();
        let moved = |value: usize, by: f32, last: usize| {
            let moved = value as f32 + by;
            (moved >= 1.0 && moved <= last as f32 - 1.0).then_some(moved as usize)
        };
        x = moved(x, step.x, differences[0].width - 1)?;
        y = moved(y, step.y, differences[0].height - 1)?;
        layer = moved(layer, step.z, SCALES + 1)?;
    }
    None
}

/// Directions in which the gradients around an extremum gather.
fn orientations(blur: &Gray, extremum: &Extremum) -> Vec<f32> {
    let sigma = 1.5 * extremum.sigma;
    let radius = (3.0 * sigma).round() as isize;
    let (cx, cy) = (extremum.at.x.round() as isize, extremum.at.y.round() as isize);
    let mut bins = [0f32; BINS];
    for (y, x) in (cy - radius..=cy + radius).flat_map(|y| (cx - radius..=cx + radius).map(move |x| (y, x))) {
        if x < 1 || y < 1 || x >= blur.width as isize - 1 || y >= blur.height as isize - 1 {
            continue;
        }
        let slope =
            Vec2::new(blur.get(x + 1, y) - blur.get(x - 1, y), blur.get(x, y + 1) - blur.get(x, y - 1));
        let distance = Vec2::new(x as f32, y as f32) - extremum.at;
        let weight = (-distance.length_squared() / (2.0 * sigma * sigma)).exp();
        let turn = slope.y.atan2(slope.x) / std::f32::consts::TAU * BINS as f32;
        bins[(turn.round() as isize).rem_euclid(BINS as isize) as usize] += weight * slope.length();
    }
    let at = |bins: &[f32; BINS], k: isize| bins[k.rem_euclid(BINS as isize) as usize];
    for _ in 0..2 {
        let old = bins;
        for k in 0..BINS as isize {
            let (near, far) = (at(&old, k - 1) + at(&old, k + 1), at(&old, k - 2) + at(&old, k + 2));
            bins[k as usize] = (6.0 * at(&old, k) + 4.0 * near + far) / 16.0;
        }
    }
    let highest = bins.iter().copied().fold(0.0, f32::max);
    (0..BINS as isize)
        .filter_map(|k| {
            let (before, own, behind) = (at(&bins, k - 1), at(&bins, k), at(&bins, k + 1));
            let peak = own > before && own > behind && own >= SECOND_PEAK * highest;
            let offset = 0.5 * (before - behind) / (before - 2.0 * own + behind).min(-1e-12);
            peak.then_some((k as f32 + offset) / BINS as f32 * std::f32::consts::TAU)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round spots of several sizes.
    fn spots(width: usize, height: usize, spots: &[(f32, f32, f32)]) -> Gray {
        let value = |x: f32, y: f32| -> f32 {
            let spot = |&(cx, cy, s): &(f32, f32, f32)| {
                0.5 * (-((x - cx).powi(2) + (y - cy).powi(2)) / (2.0 * s * s)).exp()
            };
            0.2 + spots.iter().map(spot).sum::<f32>()
        };
        let data =
            (0..width * height).map(|i| value((i % width) as f32 + 0.5, (i / width) as f32 + 0.5)).collect();
        Gray { width, height, data }
    }

    #[test]
    fn spots_are_found_where_they_are_and_at_their_scale() {
        let placed = [(40.3, 50.7, 3.0), (120.2, 40.6, 6.0), (90.3, 129.7, 12.0)];
        let found = features(&spots(180, 180, &placed), CancelCheck::default());
        for (x, y, size) in placed {
            let near = found.iter().min_by(|a, b| {
                let far = |f: &Feature| (f.place - Vec2::new(x, y)).length();
                far(a).total_cmp(&far(b))
            });
            let near = near.unwrap();
            assert!((near.place - Vec2::new(x, y)).length() < 0.15, "{} at {x} {y}", near.place);
            // A difference of Gaussians answers most at a little below the spot's own blur.
            assert!((0.6..1.3).contains(&(near.scale / size)), "{} of {size}", near.scale);
        }
    }

    #[test]
    fn a_blank_photo_has_none_and_a_tiny_one_does_not_panic() {
        assert!(features(&spots(64, 64, &[]), CancelCheck::default()).is_empty());
        for side in 1..12 {
            assert!(features(&spots(side, 1, &[(0.5, 0.5, 1.0)]), CancelCheck::default()).is_empty());
        }
    }
}

//! How close the shipped form comes to what the photographs show of the samples.

use glam::Vec3;
use rayon::prelude::*;
use texfold_core::{Encoded, LightAddress};

use super::Scene;
use crate::LightTexture;

/// Of how many observations one is looked at for each number of terms below the whole.
const SHARE: usize = 8;

/// What an encoder measured, from the form that ships.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// PSNR in dB over all samples in all photographs that see them, of all terms.
    pub psnr: f64,
    /// The same with the mean alone, with one term and so on, over an eighth of the samples.
    pub psnr_of_terms: Vec<f64>,
    /// The largest RMS error, in 8-bit units, of one photograph on one vertex, edge or triangle.
    pub worst_patch_rms: f64,
    /// Observations: samples times the photographs that see them.
    pub observations: u64,
    /// Samples of the surface that a photograph sees, and all of them.
    pub samples_seen: u64,
    /// As above.
    pub samples: u64,
}

#[derive(Debug, Clone, Default)]
struct Sums {
    squares: f64,
    count: u64,
    of_terms: Vec<f64>,
    count_of_terms: u64,
    seen: u64,
    worst: f64,
}

fn psnr(squares: f64, count: u64) -> f64 {
    10.0 * (3.0 * count.max(1) as f64 / squares.max(f64::MIN_POSITIVE)).log10()
}

/// Compares `texture` with what `scene` knows.
pub(crate) fn measure(scene: &Scene<'_>, texture: &LightTexture) -> Quality {
    let terms = texture.layout().terms;
    let fewer: Vec<LightTexture> = (0..terms).map(|terms| texture.clone().first_terms(terms)).collect();
    let elements = scene.surface.elements.len();
    let of_elements: Vec<Sums> =
        (0..elements).into_par_iter().map(|element| of_element(scene, texture, &fewer, element)).collect();
    let mut all = Sums { of_terms: vec![0.0; fewer.len()], ..Sums::default() };
    for sums in of_elements {
        all.squares += sums.squares;
        all.count += sums.count;
        all.count_of_terms += sums.count_of_terms;
        all.seen += sums.seen;
        all.worst = all.worst.max(sums.worst);
        all.of_terms.iter_mut().zip(&sums.of_terms).for_each(|(all, own)| *all += own);
    }
    let whole = psnr(all.squares, all.count);
    let of_terms = all.of_terms.iter().map(|&squares| psnr(squares, all.count_of_terms));
    Quality {
        psnr: whole,
        psnr_of_terms: of_terms.chain([whole]).collect(),
        worst_patch_rms: 255.0 * all.worst.sqrt(),
        observations: all.count,
        samples_seen: all.seen,
        samples: u64::from(scene.surface.samples),
    }
}

fn of_element(scene: &Scene<'_>, texture: &LightTexture, fewer: &[LightTexture], number: usize) -> Sums {
    let element = &scene.surface.elements[number];
    let mut sums = Sums { of_terms: vec![0.0; fewer.len()], ..Sums::default() };
    let Some(&triangle) = element.triangles.first() else { return sums };
    let corners = scene.mesh.triangles[triangle as usize];
    let mut seen = vec![false; element.weights.len()];
    for (view, colours, weights) in scene.seen[number].iter() {
        let (mut squares, mut count) = (0.0, 0u64);
        for sample in (0..element.weights.len()).filter(|&sample| weights[sample] > 0) {
            let barycentric = Vec3::from(corners.map(|vertex| element.hat(vertex, sample)));
            let direction = scene.eyes[usize::from(view)] - element.position(scene.mesh, sample);
            let address = LightAddress { triangle, barycentric, direction };
            let wanted = Vec3::from(colours[sample].map(f32::from)) / 255.0;
            let error = |texture: &LightTexture| {
                f64::from((texture.sample(address).truncate() - wanted).length_squared())
            };
            squares += error(texture);
            count += 1;
            seen[sample] = true;
            if (sample + usize::from(view)).is_multiple_of(SHARE) {
                sums.of_terms.iter_mut().zip(fewer).for_each(|(sum, texture)| *sum += error(texture));
                sums.count_of_terms += 1;
            }
        }
        sums.squares += squares;
        sums.count += count;
        sums.worst = sums.worst.max(squares / (3 * count.max(1)) as f64);
    }
    sums.seen = seen.iter().filter(|&&seen| seen).count() as u64;
    sums
}

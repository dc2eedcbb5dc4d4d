//! How close the shipped form comes to what the photographs show of the samples.

use glam::Vec3;
use rayon::prelude::*;
use texfold_core::Encoded;

use super::Scene;
use crate::LightTexture;
use crate::decode::texfold_lightfield_parts;

/// Of how many observations one is looked at for each number of terms below the whole.
const SHARE: usize = 8;

/// Directions of the paper's resampled data: 32x32 (section 6.1).
const DIRECTIONS: u64 = 1024;

/// What an encoder measured, from the form that ships.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// PSNR in dB against the matrices that are factored: for each vertex the samples around it in all photographs that see them, times the hat
    /// function, which is what the paper compares (Figure 9); of all terms.
    pub psnr: f64,
    /// PSNR in dB of colours: without the hat function, the three vertices of a triangle together. About 8 dB less.
    pub psnr_of_colours: f64,
    /// The same with the mean alone, with one term and so on, over an eighth of the samples.
    pub psnr_of_terms: Vec<f64>,
    /// As `psnr` in other directions: all texels of the view map between photographs, each blended from the three photographs around it
    /// that see the whole triangle, as in the paper.
    pub psnr_of_blends: f64,
    /// Bytes of these matrices as the paper counts them: samples as fine as the photographs resolve them, in 32x32 directions, of 3 bytes.
    pub resampled_bytes: u64,
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
    /// Of matrices: each observation counts with each vertex whose hat function is above 0 there.
    of_matrices: f64,
    entries: u64,
    of_terms: Vec<f64>,
    count_of_terms: u64,
    seen: u64,
    worst: f64,
}

fn psnr(squares: f64, count: u64) -> f64 {
    10.0 * (3.0 * count.max(1) as f64 / squares.max(f64::MIN_POSITIVE)).log10()
}

/// Compares `texture` with what `scene` knows.
pub(crate) fn measure(scene: &Scene, texture: &LightTexture) -> Quality {
    let terms = texture.layout().terms;
    let fewer: Vec<LightTexture> = (0..terms).map(|terms| texture.clone().first_terms(terms)).collect();
    let elements = scene.surface.elements.len();
    let of_elements: Vec<Sums> =
        (0..elements).into_par_iter().map(|element| of_element(scene, texture, &fewer, element)).collect();
    let mut all = Sums { of_terms: vec![0.0; fewer.len()], ..Sums::default() };
    for sums in of_elements {
        all.squares += sums.squares;
        all.count += sums.count;
        all.of_matrices += sums.of_matrices;
        all.entries += sums.entries;
        all.count_of_terms += sums.count_of_terms;
        all.seen += sums.seen;
        all.worst = all.worst.max(sums.worst);
        all.of_terms.iter_mut().zip(&sums.of_terms).for_each(|(all, own)| *all += own);
    }
    let whole = psnr(all.of_matrices, all.entries);
    let vertices = (0..scene.mesh.positions.len() as u32).into_par_iter();
    let of_vertices: Vec<(f64, u64)> =
        vertices.map(|vertex| super::resample::error(scene, texture, vertex)).collect();
    let of_matrices = of_vertices.iter().fold((0.0, 0), |sum, vertex| (sum.0 + vertex.0, sum.1 + vertex.1));
    let of_terms = all.of_terms.iter().map(|&squares| psnr(squares, all.count_of_terms));
    Quality {
        psnr: whole,
        psnr_of_colours: psnr(all.squares, all.count),
        psnr_of_blends: psnr(of_matrices.0, of_matrices.1 / 3),
        resampled_bytes: u64::from(scene.resolved_samples) * DIRECTIONS * 3,
        psnr_of_terms: of_terms.chain([whole]).collect(),
        worst_patch_rms: 255.0 * all.worst.sqrt(),
        observations: all.count,
        samples_seen: all.seen,
        samples: u64::from(scene.surface.samples),
    }
}

/// What the shipped form shows of one place and direction: the mean, and what each vertex adds.
struct Shown {
    mean: Vec3,
    corners: [Vec3; 3],
}

impl Shown {
    fn new(texture: &LightTexture, triangle: u32, barycentric: Vec3, direction: Vec3) -> Shown {
        let (mean, corners) = texfold_lightfield_parts(&texture.view(), triangle, barycentric, direction);
        Shown { mean, corners }
    }

    fn colour(&self) -> Vec3 {
        (self.mean + self.corners[0] + self.corners[1] + self.corners[2]).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Squared error of the entries in the matrices of the vertices, and their number.
    fn error(&self, wanted: Vec3, hats: Vec3) -> (f64, u64) {
        let entries = hats.to_array().into_iter().zip(self.corners).filter(|&(hat, _)| hat > 0.0);
        let squares =
            entries.map(|(hat, shown)| f64::from(((wanted - self.mean) * hat - shown).length_squared()));
        squares.fold((0.0, 0), |sum, squares| (sum.0 + squares, sum.1 + 1))
    }
}

fn of_element(scene: &Scene, texture: &LightTexture, fewer: &[LightTexture], number: usize) -> Sums {
    let element = &scene.surface.elements[number];
    let mut sums = Sums { of_terms: vec![0.0; fewer.len()], ..Sums::default() };
    let Some(&triangle) = element.triangles.first() else { return sums };
    let corners = scene.mesh.triangles[triangle as usize];
    let mut seen = vec![false; element.weights.len()];
    for (view, colours, weights) in scene.seen[number].iter() {
        let (mut squares, mut count) = (0.0, 0u64);
        for sample in (0..element.weights.len()).filter(|&sample| weights[sample] > 0) {
            let barycentric = Vec3::from(corners.map(|vertex| element.hat(vertex, sample)));
            let direction = scene.eyes[usize::from(view)] - element.position(&scene.mesh, sample);
            let direction = direction.normalize_or_zero();
            let wanted = Vec3::from(colours[sample].map(f32::from)) / 255.0;
            let shown = Shown::new(texture, triangle, barycentric, direction);
            squares += f64::from((shown.colour() - wanted).length_squared());
            let of_matrices = shown.error(wanted, barycentric);
            sums.of_matrices += of_matrices.0;
            sums.entries += of_matrices.1;
            count += 1;
            seen[sample] = true;
            if (number + sample + usize::from(view)).is_multiple_of(SHARE) {
                for (sum, texture) in sums.of_terms.iter_mut().zip(fewer) {
                    *sum +=
                        Shown::new(texture, triangle, barycentric, direction).error(wanted, barycentric).0;
                }
                sums.count_of_terms += of_matrices.1;
            }
        }
        sums.squares += squares;
        sums.count += count;
        sums.worst = sums.worst.max(squares / (3 * count.max(1)) as f64);
    }
    sums.seen = seen.iter().filter(|&&seen| seen).count() as u64;
    sums
}

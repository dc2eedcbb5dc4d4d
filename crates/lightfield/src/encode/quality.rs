//! How close the shipped form comes to what the photographs show of the samples.

use glam::Vec3;
use rayon::prelude::*;
use texfold_core::{CancelCheck, Encoded};

use super::observe::SeenBy;
use super::scene::Scene;
use super::squares::Squares;
use crate::LightTexture;
use crate::decode::{LightfieldView, texfold_lightfield_parts};

/// Of how many observations one is looked at for each number of terms below the whole.
const SHARE: usize = 8;

/// Directions of the paper's resampled data: 32x32 (section 6.1).
const DIRECTIONS: u64 = 1024;

/// What an encoder measured, from the form that ships.
#[derive(Debug, Clone, PartialEq)]
pub struct LightQuality {
    /// PSNR in dB against the matrices that are factored: for each vertex the samples around it in all photographs that see them, times the hat
    /// function, which is what the paper compares (Figure 9); of all terms.
    pub psnr: f64,
    /// PSNR in dB of colours: without the hat function, the three vertices of a triangle together. About 8 dB less.
    pub psnr_of_colours: f64,
    /// The same with the mean alone, with one term and so on, over an eighth of the samples.
    pub psnr_of_terms: Vec<f64>,
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

/// Errors of one element, or of all.
#[derive(Debug, Clone, Default)]
struct Sums {
    /// Of colours.
    colours: Squares,
    /// Of matrices: each observation counts with each vertex whose hat function is above 0 there.
    matrices: Squares,
    /// As `matrices` with fewer terms, by their number, of some observations.
    of_terms: Vec<Squares>,
    samples_seen: u64,
    /// Largest mean square of one photograph on an element.
    worst: f64,
}

impl Sums {
    fn join(&mut self, other: &Sums) {
        self.colours.join(other.colours);
        self.matrices.join(other.matrices);
        self.of_terms.iter_mut().zip(&other.of_terms).for_each(|(all, own)| all.join(*own));
        self.samples_seen += other.samples_seen;
        self.worst = self.worst.max(other.worst);
    }
}

/// Compares `texture` with what `scene` knows; of no use once the job is cancelled.
pub(super) fn measure(scene: &Scene, texture: &LightTexture, cancel: CancelCheck<'_>) -> LightQuality {
    let whole = texture.view();
    let fewer: Vec<LightfieldView<'_>> =
        (0..texture.layout().terms).map(|terms| texture.view_of_terms(terms)).collect();
    let elements = scene.surface.elements.len();
    let compared = Compared { scene, whole, fewer: &fewer, cancel };
    let of_elements: Vec<Sums> =
        (0..elements).into_par_iter().map(|element| compared.element(element)).collect();
    let mut all = Sums { of_terms: vec![Squares::default(); fewer.len()], ..Sums::default() };
    of_elements.iter().for_each(|sums| all.join(sums));
    let psnr = all.matrices.psnr();
    LightQuality {
        psnr,
        psnr_of_colours: all.colours.psnr(),
        resampled_bytes: u64::from(scene.resolved_samples) * DIRECTIONS * 3,
        psnr_of_terms: all.of_terms.iter().map(Squares::psnr).chain([psnr]).collect(),
        worst_patch_rms: 255.0 * all.worst.sqrt(),
        observations: all.colours.count / 3,
        samples_seen: all.samples_seen,
        samples: u64::from(scene.surface.samples),
    }
}

/// PSNR in dB of the matrices, of a share of the observations: those that fewer terms are measured at.
pub(super) fn sampled(scene: &Scene, texture: &LightTexture, cancel: CancelCheck<'_>) -> f64 {
    let compared = Compared { scene, whole: texture.view(), fewer: &[], cancel };
    let elements = (0..scene.surface.elements.len()).into_par_iter();
    let of_elements: Vec<Squares> = elements.map(|element| compared.matrices(element)).collect();
    let mut all = Squares::default();
    of_elements.into_iter().for_each(|squares| all.join(squares));
    all.psnr()
}

/// What the shipped form decodes to at one place and direction: the mean, and what each vertex adds.
struct Decoded {
    mean: Vec3,
    corners: [Vec3; 3],
}

impl Decoded {
    fn new(view: &LightfieldView<'_>, triangle: u32, barycentric: Vec3, direction: Vec3) -> Decoded {
        let (mean, corners) = texfold_lightfield_parts(view, triangle, barycentric, direction);
        Decoded { mean, corners }
    }

    fn colour(&self) -> Vec3 {
        (self.mean + self.corners[0] + self.corners[1] + self.corners[2]).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Squared error of the entries in the matrices of the vertices, three channels each.
    fn error(&self, wanted: Vec3, hats: Vec3) -> Squares {
        let mut squares = Squares::default();
        for (hat, corner) in hats.to_array().into_iter().zip(self.corners).filter(|&(hat, _)| hat > 0.0) {
            squares.add(f64::from(((wanted - self.mean) * hat - corner).length_squared()), 3);
        }
        squares
    }
}

/// What is compared.
struct Compared<'c> {
    scene: &'c Scene,
    whole: LightfieldView<'c>,
    /// With fewer terms, from none.
    fewer: &'c [LightfieldView<'c>],
    cancel: CancelCheck<'c>,
}

impl Compared<'_> {
    /// Errors of the matrices of the element `number` at one of [`SHARE`] observations.
    fn matrices(&self, number: usize) -> Squares {
        let Compared { scene, whole, cancel, .. } = self;
        let element = &scene.surface.elements[number];
        let mut squares = Squares::default();
        let Some(&triangle) = element.triangles.first() else { return squares };
        let corners = scene.mesh.triangles[triangle as usize];
        for SeenBy { view, colours, weights } in
            scene.seen[number].iter().take_while(|_| !cancel.is_cancelled())
        {
            let counts = |sample: &usize| {
                weights[*sample] > 0 && (number + sample + usize::from(view)).is_multiple_of(SHARE)
            };
            for sample in (0..element.weights.len()).filter(counts) {
                let barycentric = Vec3::from(corners.map(|vertex| element.hat(vertex, sample)));
                let direction = scene.eyes[usize::from(view)] - element.position(&scene.mesh, sample);
                let wanted = Vec3::from(colours[sample].map(f32::from)) / 255.0;
                let decoded = Decoded::new(whole, triangle, barycentric, direction.normalize_or_zero());
                squares.join(decoded.error(wanted, barycentric));
            }
        }
        squares
    }

    /// Errors of the element `number`.
    fn element(&self, number: usize) -> Sums {
        let Compared { scene, whole, fewer, cancel } = self;
        let element = &scene.surface.elements[number];
        let mut sums = Sums { of_terms: vec![Squares::default(); fewer.len()], ..Sums::default() };
        let Some(&triangle) = element.triangles.first() else { return sums };
        let corners = scene.mesh.triangles[triangle as usize];
        let mut seen = vec![false; element.weights.len()];
        for SeenBy { view, colours, weights } in
            scene.seen[number].iter().take_while(|_| !cancel.is_cancelled())
        {
            let mut own = Squares::default();
            for sample in (0..element.weights.len()).filter(|&sample| weights[sample] > 0) {
                let barycentric = Vec3::from(corners.map(|vertex| element.hat(vertex, sample)));
                let direction = scene.eyes[usize::from(view)] - element.position(&scene.mesh, sample);
                let direction = direction.normalize_or_zero();
                let wanted = Vec3::from(colours[sample].map(f32::from)) / 255.0;
                let decoded = Decoded::new(whole, triangle, barycentric, direction);
                own.add(f64::from((decoded.colour() - wanted).length_squared()), 3);
                sums.matrices.join(decoded.error(wanted, barycentric));
                seen[sample] = true;
                if (number + sample + usize::from(view)).is_multiple_of(SHARE) {
                    for (squares, fewer) in sums.of_terms.iter_mut().zip(*fewer) {
                        let decoded = Decoded::new(fewer, triangle, barycentric, direction);
                        squares.join(decoded.error(wanted, barycentric));
                    }
                }
            }
            sums.colours.join(own);
            sums.worst = sums.worst.max(own.sum / own.count.max(1) as f64);
        }
        sums.samples_seen = seen.iter().filter(|&&seen| seen).count() as u64;
        sums
    }
}

//! Which photographs see which samples, and in what colour (paper section 5.2, first half).
//!
//! A sample is seen where a triangle around it faces the camera, no other triangle lies between, and all four pixels
//! that its colour is blended from show the object. Occlusion is by rays, exact for the mesh at any resolution.
//! *Deviation*: the paper takes whole triangles only; here each sample counts by itself, so partially seen triangles give what
//! they have. O(samples x views x log triangles).

use glam::{Mat4, Vec2, Vec3};
use rayon::prelude::*;
use texfold_core::{CancelCheck, EncodeError, Job};

use super::surface::{Element, Surface};
use crate::bvh::Bvh;
use crate::{Camera, Mesh, Photograph};

/// Cosine between triangle and view below which a sample is not taken: it is blurred over its neighbours.
const LEAST_COSINE: f32 = 0.1;
/// Least alpha of pixels that show the object: antialiased edges mix it with what lies behind.
const LEAST_ALPHA: u8 = 250;

/// What the photographs show of an element.
#[derive(Debug, Clone, Default)]
pub(crate) struct Seen {
    /// Photographs that see at least one sample.
    pub(crate) views: Vec<u16>,
    /// For each of them the colour of each sample.
    pub(crate) colours: Vec<[u8; 3]>,
    /// For each of them how much each sample counts, 1 to 255 times the cosine; 0 where it is not seen.
    pub(crate) weights: Vec<u8>,
}

/// What one photograph shows of an element.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenBy<'s> {
    /// Which photograph.
    pub(crate) view: u16,
    /// The colour of each sample.
    pub(crate) colours: &'s [[u8; 3]],
    /// How much each sample counts; 0 where it is not seen.
    pub(crate) weights: &'s [u8],
}

/// One sample in one photograph.
#[derive(Debug, Clone, Copy)]
struct SampleSeen {
    colour: [u8; 3],
    weight: u8,
}

impl Seen {
    /// Bytes that it holds.
    pub(super) fn bytes(&self) -> u64 {
        (size_of::<Seen>() + 2 * self.views.len() + 4 * self.weights.len()) as u64
    }

    /// What each photograph shows.
    pub(crate) fn iter(&self) -> impl Iterator<Item = SeenBy<'_>> {
        let samples = (self.colours.len() / self.views.len().max(1)).max(1);
        let colours = self.colours.chunks_exact(samples).zip(self.weights.chunks_exact(samples));
        self.views.iter().zip(colours).map(|(&view, (colours, weights))| SeenBy { view, colours, weights })
    }
}

/// Elements that are looked at before what they take is booked.
const BATCH: usize = 1024;

struct Observer<'a> {
    mesh: &'a Mesh,
    bvh: &'a Bvh,
    normals: Vec<Vec3>,
    views: Vec<(&'a Photograph, Mat4)>,
    cancel: CancelCheck<'a>,
}

/// What the photographs show of each element; booked in the job's budget as it is found.
pub(super) fn observe(
    mesh: &Mesh,
    surface: &Surface,
    bvh: &Bvh,
    views: &[Photograph],
    job: &mut Job<'_>,
) -> Result<Vec<Seen>, EncodeError> {
    let normal = |&triangle: &[u32; 3]| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let normals = mesh.triangles.iter().map(normal).collect();
    let views = views.iter().map(|view| (view, view.camera.to_camera())).collect();
    let observer = Observer { mesh, bvh, normals, views, cancel: job.cancel_check() };
    let mut all = Vec::new();
    for elements in surface.elements.chunks(BATCH) {
        let seen: Vec<Seen> =
            job.install(|| elements.par_iter().map(|element| observer.element(element)).collect());
        job.checkpoint()?;
        job.budget.take(seen.iter().map(Seen::bytes).sum())?;
        all.extend(seen);
    }
    Ok(all)
}

impl Observer<'_> {
    fn element(&self, element: &Element) -> Seen {
        let places: Vec<Vec3> =
            (0..element.weights.len()).map(|sample| element.position(self.mesh, sample)).collect();
        let mut seen = Seen::default();
        let mut found = Vec::new();
        for (number, &(view, to_camera)) in (0u16..).zip(&self.views) {
            if self.cancel.is_cancelled() {
                return seen;
            }
            found.clear();
            found.extend(places.iter().map(|&place| self.sample(element, place, view, to_camera)));
            if found.iter().any(Option::is_some) {
                seen.views.push(number);
                seen.colours
                    .extend(found.iter().map(|found| found.map_or([0; 3], |seen: SampleSeen| seen.colour)));
                seen.weights.extend(found.iter().map(|found| found.map_or(0, |seen| seen.weight)));
            }
        }
        seen
    }

    /// Colour and weight of a sample in a view that sees it.
    fn sample(
        &self,
        element: &Element,
        place: Vec3,
        view: &Photograph,
        to_camera: Mat4,
    ) -> Option<SampleSeen> {
        let to_eye = view.camera.eye() - place;
        let direction = to_eye.normalize_or_zero();
        let facing = |&triangle: &u32| self.normals[triangle as usize].dot(direction);
        let cosine = element.triangles.iter().map(facing).fold(f32::NEG_INFINITY, f32::max);
        if cosine < LEAST_COSINE {
            return None;
        }
        let colour = colour_at(view, view.camera.project(to_camera.transform_point3(place))?)?;
        let own = |other: u32| element.triangles.contains(&other);
        let hidden = self.bvh.blocks(place, to_eye, 0.0..1.0, |other| !own(other));
        (!hidden).then_some(SampleSeen { colour, weight: (cosine * 255.0).clamp(1.0, 255.0) as u8 })
    }
}

/// The colour at a place of the image, blended from four pixels that all show the object.
fn colour_at(view: &Photograph, place: Vec2) -> Option<[u8; 3]> {
    let Camera { width, height, .. } = view.camera;
    let at = place - 0.5;
    let low = at.floor();
    if low.min_element() < 0.0 || low.x + 1.0 >= width as f32 || low.y + 1.0 >= height as f32 {
        return None;
    }
    let first = low.y as usize * width as usize + low.x as usize;
    let pixels = [first, first + 1, first + width as usize, first + width as usize + 1];
    let pixels = pixels.map(|index| view.pixels[index]);
    let part = at - low;
    let weights =
        [(1.0 - part.x) * (1.0 - part.y), part.x * (1.0 - part.y), (1.0 - part.x) * part.y, part.x * part.y];
    if pixels.iter().any(|pixel| pixel[3] < LEAST_ALPHA) {
        return None;
    }
    let blend = |channel: usize| {
        let sum: f32 =
            pixels.iter().zip(weights).map(|(pixel, weight)| f32::from(pixel[channel]) * weight).sum();
        (sum + 0.5) as u8
    };
    Some([blend(0), blend(1), blend(2)])
}

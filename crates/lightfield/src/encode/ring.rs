//! What is known of the light field around one vertex.

use glam::{Vec2, Vec3};
use texfold_core::CancelCheck;

use super::observe::SeenBy;
use super::scene::Scene;
use crate::decode::{
    TEXFOLD_LIGHTFIELD_VIEW, texfold_lightfield_direction, texfold_lightfield_disc, texfold_lightfield_local,
};

/// A sample within the hat function of a vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Its number.
    pub(crate) sample: u32,
    /// The hat function there, above 0.
    pub(crate) hat: f32,
    /// Where it is from the vertex, in its tangent plane, in units of the ring.
    pub(crate) place: Vec2,
}

/// One photograph's colour of a sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observation {
    /// Where it lies in the view maps: 0 to 1 across the unit disc's square.
    pub(crate) at: Vec2,
    /// 0 to 1.
    pub(crate) colour: Vec3,
    /// Which photograph.
    pub(crate) view: u16,
    /// How much it counts, without the hat function.
    pub(crate) weight: f32,
}

/// The rows of a vertex and their observations.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ring {
    pub(crate) rows: Vec<Row>,
    /// Observations of all rows, row by row.
    pub(crate) observations: Vec<Observation>,
    /// For each row where its observations end.
    pub(crate) ends: Vec<usize>,
}

impl Ring {
    /// Gathers what the photographs show around `vertex`; less once the job is cancelled.
    pub(crate) fn new(scene: &Scene, vertex: u32, cancel: CancelCheck<'_>) -> Ring {
        let mut ring = Ring::default();
        let normal = scene.normals[vertex as usize];
        let centre = scene.mesh.positions[vertex as usize];
        for &number in scene.surface.around[vertex as usize].iter().take_while(|_| !cancel.is_cancelled()) {
            let element = &scene.surface.elements[number as usize];
            let seen = &scene.seen[number as usize];
            for sample in 0..element.weights.len() {
                let position = element.position(&scene.mesh, sample);
                let smooth = element.normal(&scene.normals, sample);
                let place =
                    texfold_lightfield_local(TEXFOLD_LIGHTFIELD_VIEW, position - centre, normal).truncate();
                ring.rows.push(Row {
                    sample: element.first + sample as u32,
                    hat: element.hat(vertex, sample),
                    place,
                });
                for SeenBy { view, colours, weights } in seen.iter() {
                    let whole = || weights.iter().all(|&weight| weight > 0);
                    if weights[sample] == 0 || !(scene.partial || whole()) {
                        continue;
                    }
                    let direction = (scene.eyes[usize::from(view)] - position).normalize_or_zero();
                    let towards = texfold_lightfield_direction(scene.directions, direction, smooth);
                    let local = texfold_lightfield_local(scene.directions, towards, normal);
                    ring.observations.push(Observation {
                        at: texfold_lightfield_disc(scene.directions, local) * 0.5 + 0.5,
                        colour: Vec3::from(colours[sample].map(f32::from)) / 255.0,
                        view,
                        weight: f32::from(weights[sample]) / 255.0,
                    });
                }
                ring.ends.push(ring.observations.len());
            }
        }
        let reach = ring.rows.iter().map(|row| row.place.length()).fold(f32::MIN_POSITIVE, f32::max);
        ring.rows.iter_mut().for_each(|row| row.place /= reach);
        ring
    }

    /// The observations of each row.
    pub(crate) fn of_rows(&self) -> impl Iterator<Item = (&Row, std::ops::Range<usize>)> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        self.rows
            .iter()
            .zip(starts.zip(self.ends.iter().copied()))
            .map(|(row, (start, end))| (row, start..end))
    }
}

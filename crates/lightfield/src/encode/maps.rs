//! The maps around one vertex, as all fits give them.

use glam::{Vec3, Vec3A};

use super::ring::Ring;

/// A view map, row by row.
pub(crate) type ViewMap = Vec<Vec3A>;

/// One term while it is fitted: without the hat function.
#[derive(Debug, Clone)]
pub(crate) struct TermFit {
    /// The surface map's value of each row.
    pub(crate) surface: Vec<Vec3A>,
    pub(crate) view: ViewMap,
}

/// One term around a vertex.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    /// For each row the surface map, the hat function included.
    pub(crate) surface: Vec<Vec3>,
    /// The view map, row by row.
    pub(crate) view: Vec<Vec3>,
}

/// All maps of a vertex.
#[derive(Debug, Clone)]
pub(crate) struct VertexMaps {
    /// Samples, ascending.
    pub(crate) rows: Vec<u32>,
    /// Their mean, the hat function included.
    pub(crate) mean: Vec<Vec3>,
    pub(crate) terms: Vec<Term>,
}

impl VertexMaps {
    /// What was fitted to the rows of a ring, times the hat function.
    pub(super) fn new(ring: &Ring, mean: &[Vec3A], terms: &[TermFit]) -> VertexMaps {
        let with_hats = |values: &[Vec3A]| -> Vec<Vec3> {
            ring.rows.iter().zip(values).map(|(row, &value)| (value * row.hat).into()).collect()
        };
        let term = |term: &TermFit| Term {
            surface: with_hats(&term.surface),
            view: term.view.iter().map(|&value| value.into()).collect(),
        };
        VertexMaps {
            rows: ring.rows.iter().map(|row| row.sample).collect(),
            mean: with_hats(mean),
            terms: terms.iter().map(term).collect(),
        }
    }
}

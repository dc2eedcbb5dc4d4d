//! One view map a term for all vertices of a region, over directions in space: where light comes from far away, a highlight is where its
//! reflection points, whichever vertex uses it. Regions are needed where it comes from near by, or from the object itself.
//!
//! The same alternation as that of one vertex, with one system of equations for a view map that all vertices of its region add to. Surface
//! maps stay each vertex's own, and are found again in each round, so no vertex's observations are kept.
//! O(observations x terms x rounds).
//!
//! *Deviation* from the paper, whose codebooks of view maps are built from maps that each vertex has found by itself.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use texfold_core::{CancelCheck, EncodeError, Job};

use super::als::{VertexFit, floor};
use super::maps::{VertexMaps, ViewMap};
use super::pattern::pattern;
use super::ring::Ring;
use super::scene::Scene;
use super::system::System;
use crate::kinds::Factors;
use crate::params::LightParams;

/// Rounds of each term before the next is begun.
const ROUNDS: usize = 3;
/// Rounds over all terms in the end.
const REFINEMENTS: usize = 2;
/// Rounds over all terms of view maps that are known already.
const REFITS: usize = 3;
/// Sweeps over a view map a round.
const SWEEPS: usize = 30;
/// Distance of normals that counts as much as the mesh's size: regions end where the surface turns away.
const NORMALS: f32 = 0.25;

/// Distance of the numbers of neighbouring vertices' patterns: odd, so that rows of two vertices seldom begin alike.
const VERTEX_STEP: usize = 31;

/// What is known so far.
pub(super) struct Shared {
    /// View maps of each term and region.
    views: Vec<Vec<ViewMap>>,
    /// The regions of each term.
    regions: Vec<Regions>,
    /// For each vertex its mean and surface maps.
    vertices: Vec<Known>,
}

/// Which vertices use the same view map.
#[derive(Debug, Clone)]
struct Regions {
    /// The region of each vertex; none where it does not have the term.
    of: Vec<Option<usize>>,
    /// The vertices of each region.
    members: Vec<Vec<usize>>,
}

/// Codewords of a term's view maps.
pub(super) struct Codewords {
    pub(super) views: Vec<ViewMap>,
    /// The codeword of each vertex; none where it does not have the term.
    pub(super) of: Vec<Option<usize>>,
}

impl Regions {
    fn new(of: Vec<Option<usize>>) -> Regions {
        let count = of.iter().flatten().max().map_or(0, |last| last + 1);
        let mut members = vec![Vec::new(); count];
        for (vertex, &region) in of.iter().enumerate() {
            if let Some(region) = region {
                members[region].push(vertex);
            }
        }
        Regions { of, members }
    }
}

#[derive(Debug, Clone, Default)]
struct Known {
    mean: Vec<Vec3A>,
    surface: Vec<Vec<Vec3A>>,
}

/// Fits the terms of all vertices.
pub(super) fn fit(
    scene: &Scene,
    params: &LightParams,
    region_count: u32,
    job: &mut Job<'_>,
) -> Result<Shared, EncodeError> {
    let of: Vec<Option<usize>> =
        regions(scene, region_count as usize, job.cancel_check()).into_iter().map(Some).collect();
    let vertices = vec![Known::default(); of.len()];
    let regions = vec![Regions::new(of); params.terms as usize];
    let mut shared = Shared { views: Vec::new(), regions, vertices };
    let rounds = params.terms as usize * (ROUNDS + REFINEMENTS);
    let mut done = 0;
    let mut turn = |shared: &mut Shared, term: usize| -> Result<(), EncodeError> {
        job.stage("shared maps", 0.1 + 0.1 * done as f32 / rounds.max(1) as f32)?;
        done += 1;
        let cancel = job.cancel_check();
        job.install(|| shared.improve(scene, params, term, cancel));
        job.checkpoint()
    };
    for term in 0..params.terms as usize {
        let nothing = vec![Vec3A::ZERO; (params.maps.grid * params.maps.grid) as usize];
        shared.views.push(vec![nothing; shared.regions[term].members.len()]);
        (0..ROUNDS).try_for_each(|_| turn(&mut shared, term))?;
    }
    for _ in 0..REFINEMENTS {
        (0..params.terms as usize).try_for_each(|term| turn(&mut shared, term))?;
    }
    Ok(shared)
}

/// View maps of codebooks, a term each, fitted to the observations of all vertices that use them, not to means of maps that are alike.
pub(super) fn refit(
    scene: &Scene,
    params: &LightParams,
    terms: Vec<Codewords>,
    job: &mut Job<'_>,
) -> Result<Shared, EncodeError> {
    let (views, regions) = terms.into_iter().map(|term| (term.views, Regions::new(term.of))).unzip();
    let mut shared = Shared { views, regions, vertices: Vec::new() };
    let known = |vertex: usize| {
        let rows = scene.surface.rows(vertex as u32);
        Known { mean: Vec::new(), surface: vec![vec![Vec3A::ZERO; rows]; shared.terms_of(vertex)] }
    };
    shared.vertices = (0..scene.mesh.positions.len()).map(known).collect();
    for round in 0..REFITS {
        job.stage("codebooks", 0.8 + 0.06 * round as f32 / REFITS as f32)?;
        for term in 0..shared.views.len() {
            let cancel = job.cancel_check();
            job.install(|| shared.improve(scene, params, term, cancel));
            job.checkpoint()?;
        }
    }
    Ok(shared)
}

/// Regions of alike places and normals: `count` vertices as far from each other as can be, and those nearest to each.
fn regions(scene: &Scene, count: usize, cancel: CancelCheck<'_>) -> Vec<usize> {
    let places = &scene.mesh.positions;
    let low = places.iter().fold(Vec3::INFINITY, |low, &place| low.min(place));
    let high = places.iter().fold(Vec3::NEG_INFINITY, |high, &place| high.max(place));
    let scale = (high - low).length().max(f32::MIN_POSITIVE).recip();
    let apart = |a: usize, b: usize| {
        ((places[a] - places[b]) * scale).length_squared()
            + ((scene.normals[a] - scene.normals[b]) * NORMALS).length_squared()
    };
    let mut region_of = vec![0; places.len()];
    let mut nearest: Vec<f32> = (0..places.len()).map(|vertex| apart(vertex, 0)).collect();
    for region in (1..count.min(places.len())).take_while(|_| !cancel.is_cancelled()) {
        let farthest = (0..places.len()).max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]).then(b.cmp(&a)));
        let Some(seed) = farthest.filter(|&vertex| nearest[vertex] > 0.0) else { break };
        for vertex in 0..places.len() {
            let distance = apart(vertex, seed);
            if distance < nearest[vertex] {
                (nearest[vertex], region_of[vertex]) = (distance, region);
            }
        }
    }
    region_of
}

/// What a round makes of a region.
struct Improved {
    /// Its vertices and their maps.
    known: Vec<(usize, Known)>,
    /// The view map that they share.
    view: ViewMap,
}

impl Shared {
    /// How many terms a vertex has: of those that are begun, up to the first that it does not have.
    fn terms_of(&self, vertex: usize) -> usize {
        (0..self.views.len()).take_while(|&term| self.regions[term].of[vertex].is_some()).count()
    }

    /// A vertex's fit with all that is known of it; terms that are begun only now have a surface map by their number.
    fn begin<'r>(
        &self,
        ring: &'r Ring,
        params: &LightParams,
        vertex: usize,
        cancel: CancelCheck<'r>,
    ) -> VertexFit<'r> {
        let known = &self.vertices[vertex];
        let mut fit = VertexFit::new(ring, params, cancel, |_| true);
        if !known.mean.is_empty() {
            fit.set_mean(&known.mean);
        }
        for (term, views) in self.views.iter().enumerate() {
            let Some(region) = self.regions[term].of[vertex] else { break };
            let view = &views[region];
            // The first term is the same everywhere; the next ones begin with a pattern that follows nothing.
            let start = |row: usize| {
                let value = pattern(vertex * VERTEX_STEP + row * term) * 2.0 - 1.0;
                match params.model.factors {
                    _ if term == 0 => 1.0,
                    Factors::Signed => value,
                    Factors::NonNegative => 0.5 + 0.5 * value,
                }
            };
            let begun = || (0..ring.rows.len()).map(|row| Vec3A::splat(start(row))).collect();
            let surface = known.surface.get(term).cloned().unwrap_or_else(begun);
            fit.add_term(surface, view);
        }
        fit
    }

    /// One round of a term: each vertex's surface map for the view map, then the view maps for all of them.
    fn improve(&mut self, scene: &Scene, params: &LightParams, term: usize, cancel: CancelCheck<'_>) {
        let floor = Vec3A::splat(floor(params));
        let improve = |(region, vertices): (usize, &Vec<usize>)| {
            let mut system = System::new(params.maps.grid as usize);
            let left = vertices.iter().take_while(|_| !cancel.is_cancelled());
            let known = left.map(|&vertex| {
                let ring = Ring::new(scene, vertex as u32, cancel);
                let mut fit = self.begin(&ring, params, vertex, cancel);
                fit.fit_mean();
                fit.subtract(term, -1.0);
                if self.vertices[vertex].surface.len() > term {
                    fit.terms[term].surface = fit.best_surface(term);
                }
                fit.add_to(&mut system, term);
                let surface = fit.terms.iter().map(|term| term.surface.clone()).collect();
                (vertex, Known { surface, mean: fit.mean })
            });
            let known: Vec<(usize, Known)> = known.collect();
            system.smooth();
            let mut view = self.views[term][region].clone();
            (0..SWEEPS).for_each(|_| system.sweep(&mut view, floor));
            Improved { known, view }
        };
        let found: Vec<Improved> = self.regions[term].members.par_iter().enumerate().map(improve).collect();
        for (region, Improved { known, view }) in found.into_iter().enumerate() {
            known.into_iter().for_each(|(vertex, known)| self.vertices[vertex] = known);
            self.views[term][region] = view;
        }
    }

    /// The maps of a vertex.
    pub(super) fn maps(
        &self,
        scene: &Scene,
        params: &LightParams,
        vertex: u32,
        cancel: CancelCheck<'_>,
    ) -> VertexMaps {
        let ring = Ring::new(scene, vertex, cancel);
        let mut fit = self.begin(&ring, params, vertex as usize, cancel);
        for term in 0..fit.terms.len() {
            fit.subtract(term, -1.0);
            fit.terms[term].surface = fit.best_surface(term);
            fit.subtract(term, 1.0);
        }
        fit.fit_mean();
        fit.finish()
    }
}

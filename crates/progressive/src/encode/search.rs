//! One search for several goals: bases, content of codebooks and the entries of blocks are made once.
//!
//! What goals ask for is made when the first of them does, and kept. A goal of bits may have room for fewer cells of a codebook
//! of its own than another: entries are then looked for anew, among the same pieces. A texture is the same, bit for bit,
//! as one that is encoded without. Memory: some 12 bytes a texel and base.

use std::sync::{Arc, Mutex, PoisonError};

use texfold_core::image::{ImageSet, Raster};
use texfold_core::{EncodeError, Goal, Job, Params};

use super::base::{Base, Ground, Kind, kinds, levels};
use super::{check_sizes, encode_with};
use crate::{ProgressiveParams, ProgressiveTexture, Shared};

/// What has been found in images, for any goal.
#[derive(Debug)]
pub struct ProgressiveSearch {
    source: ImageSet,
    params: ProgressiveParams,
    shared: Shared,
    chains: Vec<Vec<Raster>>,
    held: Mutex<Held>,
}

/// What goals have asked for so far; nothing where no plane can hold it.
#[derive(Debug, Default)]
struct Held {
    grounds: Vec<(Kind, Option<Arc<Ground>>)>,
    /// By kind and cells of an own codebook.
    bases: Vec<(Kind, usize, Option<Arc<Base>>)>,
}

impl ProgressiveSearch {
    /// Makes what the goal of `params` asks for.
    pub(crate) fn new(
        source: &ImageSet,
        params: &ProgressiveParams,
        shared: &Shared,
        job: &mut Job<'_>,
    ) -> Result<Self, EncodeError> {
        params.check()?;
        check_sizes(source)?;
        let chains = job.install(|| levels(source, params.mips));
        let (source, params, shared) = (source.clone(), params.clone(), shared.clone());
        let search = ProgressiveSearch { source, params, shared, chains, held: Mutex::default() };
        let kinds = kinds(search.source.info(), &search.params)?;
        for (index, &kind) in kinds.iter().enumerate() {
            job.stage("trying bases", index as f32 / kinds.len() as f32)?;
            search.base(kind, search.params.goal, job);
        }
        job.stage("done", 1.0)?;
        Ok(search)
    }

    pub(crate) fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<ProgressiveTexture, EncodeError> {
        let params = ProgressiveParams { goal, ..self.params.clone() };
        params.check()?;
        encode_with(&self.source, &params, |kind, job| self.base(kind, goal, job), job)
    }

    fn base(&self, kind: Kind, goal: Goal, job: &Job<'_>) -> Option<Arc<Base>> {
        // What is held is whole even where another thread has failed.
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let known = held.grounds.iter().find(|(known, _)| *known == kind).map(|(_, ground)| ground.clone());
        let ground = match known {
            Some(ground) => ground,
            None => {
                let (effort, chains) = (self.params.effort, &self.chains);
                let made = || Ground::new(&self.source, chains, kind, (effort, &self.shared)).map(Arc::new);
                let made = job.install(made);
                held.grounds.push((kind, made.clone()));
                made
            }
        }?;
        let cells = ground.own_cells(goal);
        let is_it = |(known, of, _): &&(Kind, usize, _)| (*known, *of) == (kind, cells);
        if let Some((_, _, base)) = held.bases.iter().find(is_it) {
            return base.clone();
        }
        let made = job.install(|| ground.base(&self.source, &self.chains, cells).map(Arc::new));
        held.bases.push((kind, cells, made.clone()));
        made
    }
}

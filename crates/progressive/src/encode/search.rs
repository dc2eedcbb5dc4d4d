//! One search for several goals: smaller images, bases, content of codebooks and the entries of blocks are made once.
//!
//! What goals need is made when the first of them does, and kept. A goal of bits may have room for fewer cells of a codebook
//! of its own than another: entries are then looked for anew, among the same pieces. A texture is the same, bit for bit,
//! as one that is encoded without. Memory: some 12 bytes a texel and base.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use texfold_core::image::ImageSet;
use texfold_core::{EncodeError, Goal, Job, Metric, Params};

use super::base::{Base, BaseTexture, Kind};
use super::frame::Frame;
use super::{Encoding, Parts};
use crate::{ProgressiveParams, ProgressiveTexture, Shared};

/// What has been found in images, for any goal.
#[derive(Debug)]
pub struct ProgressiveSearch {
    source: ImageSet,
    params: ProgressiveParams,
    shared: Shared,
    held: Mutex<Held>,
}

/// What goals have needed so far.
#[derive(Debug, Default)]
struct Held {
    frames: Vec<Arc<Frame>>,
    base_textures: Vec<HeldBaseTexture>,
    bases: Vec<HeldBase>,
}

#[derive(Debug)]
struct HeldBaseTexture {
    shrink_log2: u32,
    kind: Kind,
    base_texture: Arc<BaseTexture>,
}

#[derive(Debug)]
struct HeldBase {
    shrink_log2: u32,
    kind: Kind,
    /// Cells of a codebook of its own.
    own_cells: usize,
    metric: Metric,
    /// `None` where no content is worth its bits.
    base: Option<Arc<Base>>,
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
        source.check_images()?;
        let (source, params, shared) = (source.clone(), params.clone(), shared.clone());
        let search = ProgressiveSearch { source, params, shared, held: Mutex::default() };
        search.encode(search.params.goal, job)?;
        Ok(search)
    }

    pub(crate) fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<ProgressiveTexture, EncodeError> {
        let params = &ProgressiveParams { goal, ..self.params.clone() };
        params.check()?;
        Encoding { source: &self.source, params, parts: self }.run(job)
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        // What is held is whole even where another thread has failed.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Parts for ProgressiveSearch {
    fn frame(&self, shrink_log2: u32, job: &Job<'_>) -> Result<Arc<Frame>, EncodeError> {
        let mut held = self.held();
        if let Some(frame) = held.frames.iter().find(|frame| frame.shrink_log2 == shrink_log2) {
            return Ok(frame.clone());
        }
        let (mips, apron, check) = (self.params.mips, self.shared.apron.as_ref(), job.cancel_check());
        let made = Arc::new(job.install(|| Frame::new(&self.source, mips, shrink_log2, apron, check))?);
        held.frames.push(made.clone());
        Ok(made)
    }

    fn base(
        &self,
        frame: &Frame,
        kind: Kind,
        goal: Goal,
        job: &Job<'_>,
    ) -> Result<Option<Arc<Base>>, EncodeError> {
        let mut held = self.held();
        let (shrink_log2, check) = (frame.shrink_log2, job.cancel_check());
        let known =
            held.base_textures.iter().find(|held| held.shrink_log2 == shrink_log2 && held.kind == kind);
        let base_texture = match known {
            Some(known) => known.base_texture.clone(),
            None => {
                let made = job
                    .install(|| BaseTexture::new(frame, kind, self.params.effort, &self.shared, check))
                    .map(Arc::new)?;
                held.base_textures.push(HeldBaseTexture { shrink_log2, kind, base_texture: made.clone() });
                made
            }
        };
        let own_cells = base_texture.own_cells(goal);
        let metric = self.params.metric_for(self.source.info(), goal);
        let is_same = |held: &&HeldBase| {
            (held.shrink_log2, held.kind, held.own_cells, held.metric)
                == (shrink_log2, kind, own_cells, metric)
        };
        if let Some(known) = held.bases.iter().find(is_same) {
            return Ok(known.base.clone());
        }
        let made = job.install(|| base_texture.base(frame, own_cells, metric, check))?.map(Arc::new);
        held.bases.push(HeldBase { shrink_log2, kind, own_cells, metric, base: made.clone() });
        Ok(made)
    }
}

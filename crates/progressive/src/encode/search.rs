//! One search for several goals: smaller images, bases, content of codebooks and the entries of blocks are made once.
//!
//! What goals ask for is made when the first of them does, and kept. A goal of bits may have room for fewer cells of a codebook
//! of its own than another: entries are then looked for anew, among the same pieces. A texture is the same, bit for bit,
//! as one that is encoded without. Memory: some 12 bytes a texel and base.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use texfold_core::image::ImageSet;
use texfold_core::{EncodeError, Goal, Job, Params};

use super::base::{Base, Ground, Kind};
use super::encode_with;
use super::frame::Frame;
use crate::{ProgressiveParams, ProgressiveTexture, Shared};

/// What has been found in images, for any goal.
#[derive(Debug)]
pub struct ProgressiveSearch {
    source: ImageSet,
    params: ProgressiveParams,
    shared: Shared,
    held: Mutex<Held>,
}

/// What goals have asked for so far; nothing where no plane can hold it.
#[derive(Debug, Default)]
struct Held {
    /// By levels that are left out.
    frames: Vec<Arc<Frame>>,
    /// By these and kind.
    grounds: Vec<(u32, Kind, Option<Arc<Ground>>)>,
    /// By these and cells of an own codebook.
    bases: Vec<(u32, Kind, usize, Option<Arc<Base>>)>,
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
        source.check_sides()?;
        let (source, params, shared) = (source.clone(), params.clone(), shared.clone());
        let search = ProgressiveSearch { source, params, shared, held: Mutex::default() };
        search.encode(search.params.goal, job)?;
        Ok(search)
    }

    pub(crate) fn encode(&self, goal: Goal, job: &mut Job<'_>) -> Result<ProgressiveTexture, EncodeError> {
        let params = ProgressiveParams { goal, ..self.params.clone() };
        params.check()?;
        let frame = |shrink_log2: u32, job: &Job<'_>| self.frame(shrink_log2, job);
        let base = |frame: &Frame, kind: Kind, goal: Goal, job: &Job<'_>| self.base(frame, kind, goal, job);
        encode_with(&self.source, &params, (&frame, &base), job)
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        // What is held is whole even where another thread has failed.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn frame(&self, shrink_log2: u32, job: &Job<'_>) -> Arc<Frame> {
        let mut held = self.held();
        if let Some(frame) = held.frames.iter().find(|frame| frame.shrink_log2 == shrink_log2) {
            return frame.clone();
        }
        let around = self.shared.around.as_ref();
        let made = Arc::new(job.install(|| Frame::new(&self.source, self.params.mips, shrink_log2, around)));
        held.frames.push(made.clone());
        made
    }

    fn base(&self, frame: &Frame, kind: Kind, goal: Goal, job: &Job<'_>) -> Option<Arc<Base>> {
        let mut held = self.held();
        let shrink = frame.shrink_log2;
        let known = held.grounds.iter().find(|(of, known, _)| (*of, *known) == (shrink, kind));
        let ground = match known.map(|(_, _, ground)| ground.clone()) {
            Some(ground) => ground,
            None => {
                let made = || Ground::new(frame, kind, (self.params.effort, &self.shared)).map(Arc::new);
                let made = job.install(made);
                held.grounds.push((shrink, kind, made.clone()));
                made
            }
        }?;
        let cells = ground.own_cells(goal);
        let known =
            held.bases.iter().find(|(of, known, own, _)| (*of, *known, *own) == (shrink, kind, cells));
        if let Some((_, _, _, base)) = known {
            return base.clone();
        }
        let made = job.install(|| ground.base(frame, cells).map(Arc::new));
        held.bases.push((shrink, kind, cells, made.clone()));
        made
    }
}

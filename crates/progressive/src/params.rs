//! Parameters of the progressive codec.

use texfold_bc::Content;
use texfold_core::{Effort, Goal, ParamError, Params};

/// Most halvings of the base's width and height.
pub(crate) const MAX_REDUCE_LOG2: u32 = 3;

/// Most levels that are not stored but enlarged from the one behind them.
pub(crate) const MAX_SHRINK_LOG2: u32 = 2;

/// How images are stored as a base and an error map.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ProgressiveParams {
    /// What to reach.
    pub goal: Goal,
    /// How the base is stored; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Halvings of the base's width and height, 1 to 3; `None` lets the goal decide.
    pub reduce_log2: Option<u32>,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
}

impl ProgressiveParams {
    /// Whether codebooks are tried: only then does a texture depend on a public one.
    #[must_use]
    pub fn tries_codebooks(&self) -> bool {
        crate::encode::tries_codebooks(self)
    }
}

impl Params for ProgressiveParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        if let Some(content) = self.content {
            content.check_available()?;
        }
        match self.reduce_log2 {
            Some(value) if !(1..=MAX_REDUCE_LOG2).contains(&value) => {
                Err(ParamError::new("reduce_log2", value, "1..=3"))
            }
            _ => Ok(()),
        }
    }
}

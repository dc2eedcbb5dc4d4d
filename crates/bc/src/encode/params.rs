//! Parameters of the plain codec.

use texfold_core::{Effort, Goal, ParamError, Params};

use crate::Content;

/// How plain block compression is done.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct BcParams {
    /// What to reach. The formats and sizes are few: the smallest that reaches it is taken.
    pub goal: Goal,
    /// Block format; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Log2 downscale of width and height before compression (0 to 3); `None` lets the goal decide.
    pub reduce_log2: Option<u32>,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search within a block.
    pub effort: Effort,
}

impl BcParams {
    /// With this goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        BcParams { goal, ..self }
    }

    /// Stores every image in one block format.
    #[must_use]
    pub fn with_content(self, content: Content) -> Self {
        BcParams { content: Some(content), ..self }
    }

    /// Halves width and height `reduce_log2` times (0 to 3) before compression.
    #[must_use]
    pub fn with_reduce_log2(self, reduce_log2: u32) -> Self {
        BcParams { reduce_log2: Some(reduce_log2), ..self }
    }

    /// Stores a full mip chain.
    #[must_use]
    pub fn with_mips(self, mips: bool) -> Self {
        BcParams { mips, ..self }
    }

    /// Searches longer or shorter within a block.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        BcParams { effort, ..self }
    }
}

impl Params for BcParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        match self.reduce_log2 {
            Some(value) if value > 3 => Err(ParamError::new("reduce_log2", value, "0..=3")),
            _ => Ok(()),
        }
    }
}

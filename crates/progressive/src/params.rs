//! Parameters of the progressive codec.

use texfold_bc::Content;
use texfold_core::image::PixelInfo;
use texfold_core::{Effort, Goal, Metric, ParamError, Params};
use texfold_residual::MAX_REDUCE_LOG2;

/// How images are stored. Colours that alpha hides ([`PixelInfo::hides_colors`]) are not kept.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct ProgressiveParams {
    /// What to reach. Goals of bits lessen the squared errors of colours and alpha together, goals of quality count colours.
    pub goal: Goal,
    /// Which errors count in residual planes, but for tolerances and with alpha, where squares count; `None` is [`Metric::Perceptual`] for colours and goals of bits, else
    /// [`Metric::Psnr`].
    pub metric: Option<Metric>,
    /// How the base is stored; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Log2 downscale of the base's width and height, 1 to 3; `None` lets the goal decide.
    pub reduce_log2: Option<u32>,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
}

impl ProgressiveParams {
    /// With that goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        ProgressiveParams { goal, ..self }
    }

    /// With that metric; `None` lets pixels and goal decide.
    #[must_use]
    pub fn with_metric(self, metric: impl Into<Option<Metric>>) -> Self {
        ProgressiveParams { metric: metric.into(), ..self }
    }

    /// With a base stored like this; `None` lets the goal decide.
    #[must_use]
    pub fn with_content(self, content: impl Into<Option<Content>>) -> Self {
        ProgressiveParams { content: content.into(), ..self }
    }

    /// With a base of that log2 downscale, 1 to 3; `None` lets the goal decide.
    #[must_use]
    pub fn with_reduce_log2(self, reduce_log2: impl Into<Option<u32>>) -> Self {
        ProgressiveParams { reduce_log2: reduce_log2.into(), ..self }
    }

    /// With or without a full mip chain.
    #[must_use]
    pub fn with_mips(self, mips: bool) -> Self {
        ProgressiveParams { mips, ..self }
    }

    /// With that effort.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        ProgressiveParams { effort, ..self }
    }

    /// The metric for such pixels and a goal. A tolerance bounds squared errors, and with alpha squares count, too: colours that it hides
    /// would seem to be where much goes on.
    pub(crate) fn metric_for(&self, pixel: PixelInfo, goal: Goal) -> Metric {
        match goal {
            Goal::Tolerance(_) => Metric::Psnr,
            _ if pixel.has_extra() => Metric::Psnr,
            _ => self.metric.unwrap_or(Metric::for_goal(goal, pixel.color)),
        }
    }

    /// Whether codebooks are tried: only then does a texture depend on a public one.
    #[must_use]
    pub fn tries_codebooks(&self) -> bool {
        crate::encode::tries_codebooks(self)
    }
}

impl Params for ProgressiveParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        match self.reduce_log2 {
            Some(value) if !(1..=MAX_REDUCE_LOG2).contains(&value) => {
                Err(ParamError { field: "reduce_log2", value: value.into(), range: "1..=3" })
            }
            _ => Ok(()),
        }
    }
}

//! Parameters of the codec.

use texfold_core::image::PixelInfo;
use texfold_core::{Effort, Goal, Metric, ParamError, Params};

/// How images are stored.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct DctParams {
    /// What to reach. Goals of bits lessen the squared errors of colours and alpha together, goals of quality hold for the worse of
    /// both.
    pub goal: Goal,
    /// Which errors count; `None` is [`Metric::Perceptual`] for colours and goals of bits, else [`Metric::Psnr`].
    pub metric: Option<Metric>,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
}

impl DctParams {
    /// With that goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        DctParams { goal, ..self }
    }

    /// With that metric; `None` lets pixels and goal decide.
    #[must_use]
    pub fn with_metric(self, metric: impl Into<Option<Metric>>) -> Self {
        DctParams { metric: metric.into(), ..self }
    }

    /// With or without a full mip chain.
    #[must_use]
    pub fn with_mips(self, mips: bool) -> Self {
        DctParams { mips, ..self }
    }

    /// With that effort.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        DctParams { effort, ..self }
    }

    /// The metric for such pixels.
    #[must_use]
    pub fn metric_for(&self, pixel: PixelInfo) -> Metric {
        self.metric.unwrap_or(Metric::for_goal(self.goal, pixel.color))
    }
}

impl Params for DctParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()
    }
}

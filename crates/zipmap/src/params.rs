//! Parameters of the zipmap codec.

use texfold_bc::Content;
use texfold_core::image::PixelInfo;
use texfold_core::{Access, Effort, Goal, Metric, ParamError, Params};

/// How a stack of patches is encoded.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ZipParams {
    /// What to reach. [`Goal::Psnr`]: the PSNR of every image, as compression and images stored below their full size
    /// leave it, against the merged image before; the worst image counts. [`Goal::Tolerance`]: the RMS error of every
    /// 4x4 block of every stored image. [`Goal::Bpp`]: compressed bits per texel of the root and of all images of
    /// the stack.
    pub goal: Goal,
    /// How texels are reached: in blocks of variable length, which are decoded before they are drawn, or in planes that shaders
    /// read. Where blocks miss the goal, or take more bits for a tolerance, the texture is in planes all the same.
    pub access: Access,
    /// What errors count in blocks; `None` for [`Metric::Perceptual`] where colours are sRGB and the goal is bits, else
    /// [`Metric::Psnr`].
    pub metric: Option<Metric>,
    /// How the root is stored in planes; patches are stored alike, with soft alpha. `None` lets the goal decide. With a content,
    /// the texture is in planes.
    pub content: Option<Content>,
    /// Cost of a path to the border, as the sum of gradients of a range of 1, from which on a patch covers all below
    /// it.
    pub tau: f32,
    /// Whether colours are fitted to those of the parents.
    pub merge: bool,
    /// RMS difference in 8-bit units below which a mip level counts as equal to what lies under it, and is left out;
    /// the goal may ask for less.
    pub drop_rms: f32,
    /// How long blocks are searched.
    pub effort: Effort,
}

impl Default for ZipParams {
    fn default() -> Self {
        ZipParams {
            goal: Goal::default(),
            access: Access::default(),
            metric: None,
            content: None,
            tau: 0.5,
            merge: true,
            drop_rms: 2.0,
            effort: Effort::Normal,
        }
    }
}

impl ZipParams {
    /// With this goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        ZipParams { goal, ..self }
    }

    /// With texels that are reached so.
    #[must_use]
    pub fn with_access(self, access: Access) -> Self {
        ZipParams { access, ..self }
    }

    /// With errors that count so, or, for `None`, as goal and colours decide.
    #[must_use]
    pub fn with_metric(self, metric: impl Into<Option<Metric>>) -> Self {
        ZipParams { metric: metric.into(), ..self }
    }

    /// With a root stored so, or, for `None`, as the goal decides.
    #[must_use]
    pub fn with_content(self, content: impl Into<Option<Content>>) -> Self {
        ZipParams { content: content.into(), ..self }
    }

    /// With patches that cover all below them from this cost of a path to their border on.
    #[must_use]
    pub fn with_tau(self, tau: f32) -> Self {
        ZipParams { tau, ..self }
    }

    /// With colours fitted to those of the parents, or as they are.
    #[must_use]
    pub fn with_merge(self, merge: bool) -> Self {
        ZipParams { merge, ..self }
    }

    /// Without mip levels that differ less than this from what lies under them, RMS in 8-bit units.
    #[must_use]
    pub fn with_drop_rms(self, drop_rms: f32) -> Self {
        ZipParams { drop_rms, ..self }
    }

    /// With a search of this length.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        ZipParams { effort, ..self }
    }

    /// What errors count in blocks of such pixels.
    pub(crate) fn metric_for(&self, pixel: PixelInfo) -> Metric {
        self.metric.unwrap_or(Metric::for_goal(self.goal, pixel.color))
    }

    /// RMS difference in 8-bit units from which on a level is kept.
    pub(crate) fn least_difference(&self) -> f64 {
        let of_goal = match self.goal {
            Goal::Psnr(psnr) => 255.0 / 10f64.powf(psnr / 20.0),
            Goal::Tolerance(tolerance) => tolerance,
            Goal::Bpp(_) => f64::INFINITY,
        };
        of_goal.min(f64::from(self.drop_rms))
    }
}

impl Params for ZipParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        let error = |field, value, range| Err(ParamError { field, value, range });
        match self {
            _ if !(1e-3..=100.0).contains(&self.tau) => error("tau", self.tau.into(), "0.001..=100"),
            _ if !(0.0..=64.0).contains(&self.drop_rms) => error("drop_rms", self.drop_rms.into(), "0..=64"),
            _ => Ok(()),
        }
    }
}

//! Parameters of the codec.

use texfold_core::image::{MapKind, PixelInfo};
use texfold_core::{Effort, Goal, Metric, ParamError, Params};

/// Weight of errors of maps that only modulate light. SSIMULACRA2 of a lit surface (bench `materials` with such weights at effort fast), means
/// of 3 and 5 bits: of the material that this was chosen on 73.7, 75.7, 77.4, 77.7, 77.8 at 1, 1/2, 1/4, 1/8, 1/16, of two others 68.3, 70.1,
/// 73.7, 74.1, 72.9.
const MODULATION_WEIGHT: f64 = 0.25;

/// How images are stored. Colours that alpha hides ([`PixelInfo::hides_colors`]) are not kept.
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
    /// Weights of the squared errors of a material's maps by their kind. Where a kind is not named, a quarter for what light is only
    /// multiplied with or spread by (roughness, metalness, occlusion) under [`Metric::Perceptual`], else 1.
    pub weights: Vec<(MapKind, f64)>,
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

    /// With those weights of a material's maps.
    #[must_use]
    pub fn with_weights(self, weights: Vec<(MapKind, f64)>) -> Self {
        DctParams { weights, ..self }
    }

    /// Weight of the squared errors of maps of that kind.
    #[must_use]
    pub fn weight_of(&self, kind: MapKind) -> f64 {
        let named = self.weights.iter().rfind(|(named, _)| *named == kind).map(|&(_, weight)| weight);
        let is_seen = self.metric_for(PixelInfo::default()) == Metric::Perceptual;
        let modulates = matches!(
            kind,
            MapKind::Roughness
                | MapKind::Metalness
                | MapKind::Occlusion
                | MapKind::OcclusionRoughnessMetalness
        );
        named.unwrap_or(if is_seen && modulates { MODULATION_WEIGHT } else { 1.0 })
    }

    /// The metric for such pixels.
    #[must_use]
    pub fn metric_for(&self, pixel: PixelInfo) -> Metric {
        self.metric.unwrap_or(Metric::for_goal(self.goal, pixel.color))
    }
}

impl Params for DctParams {
    fn check(&self) -> Result<(), ParamError> {
        let allowed = |&&(_, weight): &&(MapKind, f64)| !(0.01..=100.0).contains(&weight);
        match self.weights.iter().find(allowed) {
            Some(&(_, weight)) => Err(ParamError::new("weights", weight, "0.01 to 100")),
            None => self.goal.check(),
        }
    }
}

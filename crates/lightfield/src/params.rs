//! Parameters of the light-field codec.

use texfold_bc::Content;
use texfold_core::{ParamError, Params};

/// Most terms beside the mean: a bound of the shader's loop.
pub const MAX_TERMS: u32 = 8;

/// What view maps are laid over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Directions {
    /// The direction to the eye, orthographic, as in the paper.
    View,
    /// That direction reflected about the smooth normal: a highlight keeps its place in the map while it moves
    /// over the surface.
    #[default]
    Reflected,
    /// The reflected direction in space, on an octahedron: what is far away keeps its place in the maps of all vertices.
    World,
}

/// Which signs the factors have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Factors {
    /// Any: a term may add or take away.
    #[default]
    Signed,
    /// None below 0: terms only add to the mean, which is then what they have in common.
    NonNegative,
}

/// How factors are improved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Updates {
    /// One factor at a time by least squares; of factors without signs hierarchical alternating least squares.
    #[default]
    Alternating,
    /// The paper's multiplicative updates, for factors without signs alone: slower.
    Multiplicative,
}

/// How maps are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Fit {
    /// Alternating least squares on what each photograph shows of each sample.
    #[default]
    Scattered,
    /// As scattered, but all vertices show the same view map of a term: small files. Over directions in space alone.
    Shared,
    /// The paper's: photographs that see whole triangles, blended on the grid of the view map, then a principal component analysis.
    /// Its factors have signs, and every vertex has all terms.
    Resampled,
}

/// Parts of the model that can be left out or done otherwise, to see what they buy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Model {
    /// How maps are found.
    pub fit: Fit,
    /// What view maps are laid over.
    pub directions: Directions,
    /// Which signs the factors have.
    pub factors: Factors,
    /// How they are improved.
    pub updates: Updates,
    /// Whether photographs that show part of an edge or triangle count with what they show.
    pub partial: bool,
    /// Whether a vertex has only the terms that photographs left out of a first fit speak for.
    pub chosen: bool,
}

impl Default for Model {
    fn default() -> Self {
        Model {
            fit: Fit::default(),
            directions: Directions::default(),
            factors: Factors::default(),
            updates: Updates::default(),
            partial: true,
            chosen: true,
        }
    }
}

/// How a light field is encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct LightParams {
    /// Terms beside the mean, 0 to [`MAX_TERMS`].
    pub terms: u32,
    /// As few of these terms as reach this PSNR in dB against what the photographs show; all where this is not given.
    pub psnr: Option<f64>,
    /// Texels a side of a view map, a multiple of 4 up to 64.
    pub grid: u32,
    /// Samples along a triangle's side for each that the photographs resolve, 0.125 to 1.
    pub sampling: f32,
    /// How often the sides of surface maps are halved, 0 to 3, beside those of the mean: terms differ less from place to place.
    pub halvings: u8,
    /// Share of what the maps take that is stored, above 0 to 1: below 1 maps are codewords that several triangles or vertices show. View maps
    /// that regions share count once.
    pub codewords: f32,
    /// Regions of the mesh whose vertices show the same view maps, where they share them; 1 to 4096.
    pub regions: u32,
    /// Parts of the model.
    pub model: Model,
    /// How the maps are stored: raw, BC1 or BC7.
    pub content: Content,
}

impl Default for LightParams {
    fn default() -> Self {
        LightParams {
            terms: 1,
            psnr: None,
            grid: 16,
            sampling: 1.0,
            halvings: 1,
            regions: 24,
            codewords: 1.0,
            model: Model::default(),
            content: Content::Raw,
        }
    }
}

impl Params for LightParams {
    fn check(&self) -> Result<(), ParamError> {
        let error = |field, value, range| Err(ParamError { field, value, range });
        match self {
            _ if self.psnr.is_some_and(|psnr| !psnr.is_finite() || psnr <= 0.0) => {
                error("psnr", self.psnr.unwrap_or(0.0).into(), "finite numbers above 0")
            }
            _ if self.terms > MAX_TERMS => error("terms", self.terms.into(), "0..=8"),
            _ if !(4..=64).contains(&self.grid) || !self.grid.is_multiple_of(4) => {
                error("grid", self.grid.into(), "multiples of 4 in 4..=64")
            }
            _ if !(0.125..=1.0).contains(&self.sampling) => {
                error("sampling", self.sampling.into(), "0.125..=1")
            }
            _ if !(1..=4096).contains(&self.regions) => error("regions", self.regions.into(), "1..=4096"),
            _ if self.halvings > 3 => error("halvings", self.halvings.into(), "0..=3"),
            _ if !(self.codewords > 0.0 && self.codewords <= 1.0) => {
                error("codewords", self.codewords.into(), "above 0 to 1")
            }
            _ if self.model.fit == Fit::Resampled && self.model.factors == Factors::NonNegative => {
                error("factors", "non-negative".into(), "any sign where the matrix is resampled")
            }
            _ if self.model.fit == Fit::Shared && self.model.directions != Directions::World => {
                error("directions", "around vertices".into(), "those in space where vertices share view maps")
            }
            _ if self.model.fit == Fit::Resampled && self.model.directions == Directions::World => {
                error("directions", "in space".into(), "those around vertices where the matrix is resampled")
            }
            _ if self.model.fit == Fit::Shared && self.model.updates == Updates::Multiplicative => {
                error("updates", "multiplicative".into(), "alternating where vertices share view maps")
            }
            _ if self.model.updates == Updates::Multiplicative && self.model.factors == Factors::Signed => {
                error("updates", "multiplicative".into(), "alternating where factors have signs")
            }
            _ if !matches!(self.content, Content::Raw | Content::Bc1 | Content::Bc7) => {
                error("content", self.content.name().into(), "raw, bc1 and bc7 for light-field maps")
            }
            _ => Ok(()),
        }
    }
}

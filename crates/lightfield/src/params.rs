//! Parameters of the light-field codec.

use texfold_bc::Content;
use texfold_core::{Access, ParamError, ParamValue, Params};

use crate::kinds::{Directions, Factors, MAX_TERMS};

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
pub enum FitMethod {
    /// Alternating least squares on what each photograph shows of each sample.
    #[default]
    Scattered,
    /// As scattered, but all vertices of a region decode the same view map of a term: small files. Over directions in space alone.
    Shared {
        /// Regions of the mesh, 1 to 4096.
        regions: u32,
    },
    /// The paper's: photographs that see whole triangles, blended on the grid of the view map, then a principal component analysis.
    /// Its factors have signs, and every vertex has all terms.
    Resampled,
}

/// Parts of the model that can be left out or done otherwise, to see what they buy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct LightModel {
    /// How maps are found.
    pub fit: FitMethod,
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

impl Default for LightModel {
    fn default() -> Self {
        LightModel {
            fit: FitMethod::default(),
            directions: Directions::default(),
            factors: Factors::default(),
            updates: Updates::default(),
            partial: true,
            chosen: true,
        }
    }
}

impl LightModel {
    /// With maps found in this way.
    #[must_use]
    pub fn with_fit(self, fit: FitMethod) -> Self {
        LightModel { fit, ..self }
    }

    /// With view maps over these directions.
    #[must_use]
    pub fn with_directions(self, directions: Directions) -> Self {
        LightModel { directions, ..self }
    }

    /// With factors of these signs.
    #[must_use]
    pub fn with_factors(self, factors: Factors) -> Self {
        LightModel { factors, ..self }
    }

    /// With factors improved in this way.
    #[must_use]
    pub fn with_updates(self, updates: Updates) -> Self {
        LightModel { updates, ..self }
    }

    /// With or without photographs that show part of an edge or triangle.
    #[must_use]
    pub fn with_partial(self, partial: bool) -> Self {
        LightModel { partial, ..self }
    }

    /// With the terms that photographs left out speak for, or with all of them everywhere.
    #[must_use]
    pub fn with_chosen(self, chosen: bool) -> Self {
        LightModel { chosen, ..self }
    }
}

/// How fine the maps are.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct MapSizes {
    /// Texels a side of a view map, a multiple of 4 up to 64.
    pub grid: u32,
    /// Samples along a triangle's side for each that the photographs resolve, 0.125 to 1.
    pub sampling: f32,
    /// Log2 by which the sides of surface maps are downscaled beside those of the mean, 0 to 3: terms differ less from place to place.
    pub surface_reduce_log2: u8,
}

impl Default for MapSizes {
    fn default() -> Self {
        MapSizes { grid: 16, sampling: 1.0, surface_reduce_log2: 1 }
    }
}

/// Loss of maps in blocks against raw ones, in dB of the matrices.
const LOSS: f64 = 0.5;

/// How maps are stored once they are found.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct MapStorage {
    /// How texels are reached: in blocks of variable length, which are decoded before they are drawn, or in planes that shaders read.
    /// Where planes of a content reach the same PSNR with fewer bits, maps are in planes all the same.
    pub access: Access,
    /// How texels are stored in planes: raw, BC1 or BC7; `None` for raw ones. With a content, maps are in planes.
    pub content: Option<Content>,
    /// By how many dB maps in blocks may be below raw maps, against the photographs, where no PSNR is asked for: above 0 to 10.
    pub loss: f64,
    /// Fraction of the maps' bits to keep, above 0 to 1: below 1 maps are codewords that several triangles or vertices share. View
    /// maps that regions share count once.
    pub codewords: f32,
}

impl Default for MapStorage {
    fn default() -> Self {
        MapStorage { access: Access::default(), content: None, loss: LOSS, codewords: 1.0 }
    }
}

impl MapStorage {
    /// With texels that are reached so.
    #[must_use]
    pub fn with_access(self, access: Access) -> Self {
        MapStorage { access, ..self }
    }

    /// With texels stored in this way, in planes; `None` for blocks or raw planes, as `access` says.
    #[must_use]
    pub fn with_content(self, content: impl Into<Option<Content>>) -> Self {
        MapStorage { content: content.into(), ..self }
    }

    /// With blocks that are by at most so many dB below raw maps.
    #[must_use]
    pub fn with_loss(self, loss: f64) -> Self {
        MapStorage { loss, ..self }
    }

    /// With this fraction of the maps' bits.
    #[must_use]
    pub fn with_codewords(self, codewords: f32) -> Self {
        MapStorage { codewords, ..self }
    }

    /// Checks all fields.
    pub(crate) fn check(&self) -> Result<(), ParamError> {
        if !(self.codewords > 0.0 && self.codewords <= 1.0) {
            return error("codewords", self.codewords, "above 0 to 1");
        }
        if !(self.loss > 0.0 && self.loss <= 10.0) {
            return error("loss", self.loss, "above 0 to 10");
        }
        let holds = |content| matches!(content, Content::Raw | Content::Bc1 | Content::Bc7);
        if let Some(content) = self.content.filter(|&content| !holds(content)) {
            return error("content", content.name(), "raw, bc1 and bc7 for light-field maps");
        }
        Ok(())
    }
}

/// How a light field is encoded.
///
/// ```
/// use texfold_lightfield::LightParams;
/// let params = LightParams::default().with_terms(3).with_codewords(0.5);
/// assert_eq!((params.terms, params.storage.codewords), (3, 0.5));
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LightParams {
    /// Terms beside the mean, 0 to [`MAX_TERMS`].
    pub terms: u32,
    /// As few of these terms as reach this PSNR in dB against the photographs; all where this is not given.
    pub psnr: Option<f64>,
    /// How fine the maps are.
    pub maps: MapSizes,
    /// Parts of the model.
    pub model: LightModel,
    /// How the maps are stored.
    pub storage: MapStorage,
}

impl Default for LightParams {
    fn default() -> Self {
        LightParams {
            terms: 1,
            psnr: None,
            maps: MapSizes::default(),
            model: LightModel::default(),
            storage: MapStorage::default(),
        }
    }
}

impl LightParams {
    /// With so many terms beside the mean.
    #[must_use]
    pub fn with_terms(self, terms: u32) -> Self {
        LightParams { terms, ..self }
    }

    /// With as few terms as reach this PSNR in dB; `None` for all.
    #[must_use]
    pub fn with_psnr(self, psnr: impl Into<Option<f64>>) -> Self {
        LightParams { psnr: psnr.into(), ..self }
    }

    /// With these parts of the model.
    #[must_use]
    pub fn with_model(self, model: LightModel) -> Self {
        LightParams { model, ..self }
    }

    /// With view maps of so many texels a side.
    #[must_use]
    pub fn with_grid(mut self, grid: u32) -> Self {
        self.maps.grid = grid;
        self
    }

    /// With so many samples for each that the photographs resolve.
    #[must_use]
    pub fn with_sampling(mut self, sampling: f32) -> Self {
        self.maps.sampling = sampling;
        self
    }

    /// With the sides of surface maps downscaled by this log2.
    #[must_use]
    pub fn with_surface_reduce_log2(mut self, log2: u8) -> Self {
        self.maps.surface_reduce_log2 = log2;
        self
    }

    /// With maps stored in this way.
    #[must_use]
    pub fn with_storage(self, storage: MapStorage) -> Self {
        LightParams { storage, ..self }
    }

    /// With texels that are reached so.
    #[must_use]
    pub fn with_access(mut self, access: Access) -> Self {
        self.storage.access = access;
        self
    }

    /// With texels stored in this way, in planes; `None` for blocks or raw planes, as the access says.
    #[must_use]
    pub fn with_content(mut self, content: impl Into<Option<Content>>) -> Self {
        self.storage.content = content.into();
        self
    }

    /// With this fraction of the maps' bits.
    #[must_use]
    pub fn with_codewords(mut self, codewords: f32) -> Self {
        self.storage.codewords = codewords;
        self
    }
}

fn error(field: &'static str, value: impl Into<ParamValue>, range: &'static str) -> Result<(), ParamError> {
    Err(ParamError::new(field, value, range))
}

impl MapSizes {
    fn check(&self) -> Result<(), ParamError> {
        if !(4..=64).contains(&self.grid) || !self.grid.is_multiple_of(4) {
            return error("grid", self.grid, "multiples of 4 in 4..=64");
        }
        if !(0.125..=1.0).contains(&self.sampling) {
            return error("sampling", self.sampling, "0.125..=1");
        }
        if self.surface_reduce_log2 > 3 {
            return error("surface_reduce_log2", self.surface_reduce_log2, "0..=3");
        }
        Ok(())
    }
}

impl LightModel {
    /// Which parts go together.
    fn check(&self) -> Result<(), ParamError> {
        if let FitMethod::Shared { regions } = self.fit {
            if !(1..=4096).contains(&regions) {
                return error("regions", regions, "1..=4096");
            }
            if self.directions != Directions::World {
                return error(
                    "directions",
                    "around vertices",
                    "those in space where vertices share view maps",
                );
            }
            if self.updates == Updates::Multiplicative {
                return error("updates", "multiplicative", "alternating where vertices share view maps");
            }
        }
        if self.fit == FitMethod::Resampled {
            if self.factors == Factors::NonNegative {
                return error("factors", "non-negative", "any sign where the matrix is resampled");
            }
            if self.directions == Directions::World {
                return error(
                    "directions",
                    "in space",
                    "those around vertices where the matrix is resampled",
                );
            }
        }
        if self.updates == Updates::Multiplicative && self.factors == Factors::Signed {
            return error("updates", "multiplicative", "alternating where factors have signs");
        }
        Ok(())
    }
}

impl Params for LightParams {
    fn check(&self) -> Result<(), ParamError> {
        if self.psnr.is_some_and(|psnr| !psnr.is_finite() || psnr <= 0.0) {
            return error("psnr", self.psnr.unwrap_or(0.0), "finite numbers above 0");
        }
        if self.terms > MAX_TERMS {
            return error("terms", self.terms, "0..=8");
        }
        self.maps.check()?;
        self.model.check()?;
        self.storage.check()
    }
}

//! Colours of a patch fitted to those of what it lies on: exposure first, then a harmonic correction from the border.
//!
//! The paper takes the parent's warped border as Dirichlet data for a Poisson equation with the patch's gradients as
//! guidance. Deviations: gain and offset of each channel are fitted before, as gradients of another exposure stay too
//! strong or too weak; and on the border the parent is compared with the patch at the parent's own resolution, so that
//! detail that the parent lacks counts as no difference and does not run inwards. The half of a level by which the
//! parent may be sharper is filtered away on both sides.

use glam::{DMat3, DVec2, Vec2, Vec4};
use rayon::prelude::*;
use texfold_core::image::{MipFilter, Raster, mip_chain};
use texfold_core::{CancelCheck, Texel};

use super::canvas::{Canvas, Footprint, Laid, colour};
use super::multigrid::{harmonic, with_border};

/// Places a side at which exposures are compared.
const SAMPLES: u32 = 48;
/// Largest change of contrast; more is no exposure.
const GAIN: (f32, f32) = (0.4, 2.5);
/// Rounds of fitting; after the first, places that differ by more than this many deviations are left out.
const ROUNDS: usize = 3;
/// As above.
const OUTLIER: f32 = 2.0;
/// Least places that an exposure is fitted to: gain and offset of three channels, and as much again against chance.
const LEAST_PLACES: usize = 16;
/// Variance, in a range of 1, that is added on both sides of a gain: a patch of less contrast than 2.5 steps of 8 bits
/// keeps its own.
const FLAT_VARIANCE: f32 = 1e-4;

/// A patch before it is laid: its texels, row by row, and where they lie.
pub(crate) struct PatchTexels {
    pub(crate) texels: Vec<Texel>,
    pub(crate) size: (u32, u32),
    /// Its upper left texel in its image.
    pub(crate) corner: (u32, u32),
    pub(crate) matrix: DMat3,
    /// Texels to a texel of what it lies on.
    pub(crate) step: f64,
}

impl PatchTexels {
    /// The patch as it lies on the canvas.
    pub(crate) fn laid(&self, source: usize, zoom: f64, content: usize) -> Laid {
        Laid { source, matrix: self.matrix, size: self.size, corner: self.corner, zoom, content }
    }
}

/// The patch at several sizes.
struct Chain(Vec<Raster>);

impl Chain {
    /// The first level whose texels are as large as `step` of the first level's.
    fn level(&self, step: f64) -> usize {
        (step.max(1.0).log2().ceil() as usize).min(self.0.len() - 1)
    }

    /// Blended texels of a level.
    fn at(&self, place: Vec2, level: usize) -> Vec4 {
        let raster = &self.0[level];
        let size = raster.size();
        let tap = texfold_core::address::texfold_tap(
            place,
            glam::UVec2::new(size.width, size.height),
            texfold_core::address::TEXFOLD_CLAMP,
        );
        let four = [
            raster.texel(tap.low.x, tap.low.y),
            raster.texel(tap.high.x, tap.low.y),
            raster.texel(tap.low.x, tap.high.y),
            raster.texel(tap.high.x, tap.high.y),
        ];
        texfold_core::sample::texfold_bilinear(four, tap.weight)
    }
}

/// Fits the patch to what lies under it on the canvas. Of no use once the job is cancelled.
pub(crate) fn merge(patch: &mut PatchTexels, canvas: &Canvas, image: &Raster, cancel: CancelCheck<'_>) {
    let (width, height) = patch.size;
    let info = texfold_core::image::PixelInfo {
        channels: 3,
        alpha: texfold_core::image::Alpha::Opaque,
        ..image.info()
    };
    let Ok(raster) = Raster::from_texels(width, height, info, &patch.texels) else { return };
    let levels = raster.size().full_levels();
    let chain = Chain(mip_chain(&raster, levels, MipFilter::Box));
    let names = canvas.touching(&patch.matrix);
    let table = canvas.table(&names);
    let view = canvas.view(&table);
    let inverse = patch.matrix.inverse();
    let texel = DVec2::new(1.0 / f64::from(width), 1.0 / f64::from(height));
    // What both show: texels as large as the parent's.
    let level = chain.level(patch.step);
    let shared = texel * f64::from(1u32 << level);
    let below = |at: DVec2| {
        let found = Footprint::of(&inverse, at, shared);
        (colour(&view, &found), found.uv.cmpge(Vec2::ZERO).all() && found.uv.cmple(Vec2::ONE).all())
    };
    if cancel.is_cancelled() {
        return;
    }
    let (gain, offset) = exposure(&chain, level, below);
    let fitted = |colour: Vec4| (colour * gain + offset).truncate().extend(1.0);
    let place = |x: usize, y: usize| (DVec2::new(x as f64, y as f64) + 0.5) * texel;
    let mut difference = with_border(width as usize, height as usize, |x, y| {
        let at = place(x, y);
        below(at).0 - fitted(chain.at(at.as_vec2(), level))
    });
    harmonic(&mut difference, cancel);
    patch.texels.par_iter_mut().zip(&difference.values).for_each(|(texel, change)| {
        *texel = (fitted(*texel) + *change).clamp(Vec4::ZERO, Vec4::ONE).truncate().extend(1.0);
    });
}

/// Gain and offset of each channel from the patch to what lies under it.
fn exposure(chain: &Chain, level: usize, below: impl Fn(DVec2) -> (Vec4, bool) + Sync) -> (Vec4, Vec4) {
    let pairs: Vec<(Vec4, Vec4)> = (0..SAMPLES * SAMPLES)
        .into_par_iter()
        .filter_map(|k| {
            let at = (DVec2::new(f64::from(k % SAMPLES), f64::from(k / SAMPLES)) + 0.5) / f64::from(SAMPLES);
            let (under, inside) = below(at);
            inside.then(|| (chain.at(at.as_vec2(), level), under))
        })
        .collect();
    let (mut gain, mut offset) = (Vec4::ONE, Vec4::ZERO);
    let mut limit = f32::INFINITY;
    for _ in 0..ROUNDS {
        let error = |(own, under): &(Vec4, Vec4)| (*own * gain + offset - *under).truncate().length();
        let kept: Vec<&(Vec4, Vec4)> = pairs.iter().filter(|pair| error(pair) <= limit).collect();
        if kept.len() < LEAST_PLACES {
            break;
        }
        let count = kept.len() as f32;
        let mean =
            |value: &dyn Fn(&(Vec4, Vec4)) -> Vec4| kept.iter().map(|pair| value(pair)).sum::<Vec4>() / count;
        let (own, under) = (mean(&|pair| pair.0), mean(&|pair| pair.1));
        let variance = mean(&|pair| (pair.0 - own) * (pair.0 - own));
        let covariance = mean(&|pair| (pair.0 - own) * (pair.1 - under));
        let slope = (covariance + FLAT_VARIANCE) / (variance + FLAT_VARIANCE);
        gain = slope.clamp(Vec4::splat(GAIN.0), Vec4::splat(GAIN.1));
        offset = under - own * gain;
        let errors: f32 =
            kept.iter().map(|pair| (pair.0 * gain + offset - pair.1).truncate().length_squared()).sum();
        limit = OUTLIER * (errors / count).sqrt().max(1.0 / 255.0);
    }
    (gain.truncate().extend(1.0), offset.truncate().extend(0.0))
}

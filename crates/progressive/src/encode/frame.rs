//! What of images is coded: all levels, or only those from a half or a quarter of the width and height on, enlarged for the others.
//!
//! Below a bit per texel most bits of a residual plane say which blocks have none. An image of half the size at four times the bits
//! has the same memory, and what enlarging loses is then less than what the bits buy. The smaller image is the one whose
//! enlargement is nearest to the image (see [`Enlargement`]), not its mean texel by texel, but where it is a mip level too. Cost: a dozen passes over the image.

use glam::{UVec2, Vec2};
use texfold_core::address::TexfoldTap;
use texfold_core::image::{ImageSet, MipFilter, Raster, mip_chain_cancellable};
use texfold_core::{CancelCheck, Effort, EncodeError, Goal, ImageLayout, ImageSize, Metric};

use texfold_residual::encode::{Enlargement, PaddedRaster, least_share};
use texfold_residual::{APRON, MAX_SHRINK_LOG2, stored_layout};

use crate::ProgressiveParams;

/// Least side of an image that is stored smaller.
const LEAST_SIDE: u32 = 16;
/// Passes of the fit: of 12 the last changes the PSNR of the terrain by 0.006 dB, and 24 leave it 0.02 dB better.
const PASSES: usize = 12;
/// Share of the squared error of the smaller image that is left in the enlarged one: two thirds in each direction where errors are
/// independent, more where they are smooth.
const KEPT: f64 = 0.55;
/// Squared error of a value of 8 bits at 0 dB.
const FULL: f64 = 255.0 * 255.0;

/// Texels around what is stored of a tile that its base may go on over.
pub(crate) const STORED_AROUND: u32 = APRON >> MAX_SHRINK_LOG2;

/// Images as they are coded.
#[derive(Debug)]
pub(crate) struct Frame {
    /// The images.
    pub(crate) full: ImageLayout,
    /// Levels that are not stored.
    pub(crate) shrink_log2: u32,
    /// For each image the levels that are.
    pub(crate) chains: Vec<Vec<Raster>>,
    /// The largest that is, with what surrounds it: of one tile, where that is known.
    pub(crate) around: Option<PaddedRaster>,
    /// Mean squared error of what is stored, upsampled, in 8-bit units.
    pub(crate) floor: f64,
}

/// The levels of each image that are stored.
fn levels(source: &ImageSet, mips: bool, check: CancelCheck<'_>) -> Result<Vec<Vec<Raster>>, EncodeError> {
    let count = if mips { source.full_levels().min(16) } else { 1 };
    let chain = |image| mip_chain_cancellable(image, count, MipFilter::Box, check);
    source.images().iter().map(chain).collect()
}

/// The sizes that may be tried, as the goal and the pixels need: the first is the whole. Of goals of bits, [`Frame::may_beat`]
/// leaves out those that cannot be the best.
pub(crate) fn shrinks(source: &ImageSet, params: &ProgressiveParams) -> Vec<u32> {
    let least = source.images().iter().map(|image| image.size().width.min(image.size().height)).min();
    let possible = |log2: u32| params.reduce_log2.is_none() && least >= Some(LEAST_SIDE << log2);
    let wanted = match params.goal {
        Goal::Bpp(_) => true,
        // Such goals are those of colours: nothing would say how far alpha may be off.
        Goal::Psnr(_) => params.effort != Effort::Fast && !source.info().has_extra(),
        Goal::Tolerance(_) => false,
    };
    std::iter::once(0).chain((1..=2).filter(|&log2| wanted && possible(log2))).collect()
}

impl Frame {
    /// `apron` is what surrounds the single image, as [`crate::Shared`] has it.
    pub(crate) fn new(
        source: &ImageSet,
        mips: bool,
        shrink_log2: u32,
        apron: Option<&Raster>,
        check: CancelCheck<'_>,
    ) -> Result<Frame, EncodeError> {
        let mut chains = levels(source, mips, check)?;
        let full = source.layout(chains.first().map_or(1, |levels| levels.len() as u32));
        let mut around = match (apron, source.images()) {
            (Some(apron), [image]) => PaddedRaster::new(apron, image.size(), STORED_AROUND << shrink_log2),
            _ => None,
        };
        if shrink_log2 == 0 {
            return Ok(Frame { full, shrink_log2, chains, around, floor: 0.0 });
        }
        let (mut sum, mut values) = (0.0, 0.0);
        // Fitted, it would be too sharp for the mip level that it also is, and hidden colours would be mixed in.
        let passes = if mips || source.info().has_extra() { 0 } else { PASSES };
        for (image, chain) in source.images().iter().zip(&mut chains) {
            let known = around.clone().unwrap_or_else(|| PaddedRaster::alone(image.clone()));
            let (small, squared) = fitted(&known, shrink_log2, passes, check)?;
            sum += squared;
            values += (image.size().texels() * u64::from(image.info().color_channels())) as f64;
            let further = chain.drain(..).skip(shrink_log2 as usize + 1);
            *chain = std::iter::once(small.within(0).raster).chain(further).collect();
            around = around.map(|_| small);
        }
        Ok(Frame { full, shrink_log2, chains, around, floor: FULL * sum / values })
    }

    /// The levels that are stored.
    pub(crate) fn stored(&self) -> ImageLayout {
        stored_layout(&self.full, self.shrink_log2)
    }

    /// Whether a texture of the frame may have less error, as the metric counts it, than one of a PSNR of `psnr` dB: what enlarging loses, no
    /// bits buy.
    pub(crate) fn may_beat(&self, psnr: f64, metric: Metric) -> bool {
        least_share(metric) * self.floor < FULL / 10f64.powf(psnr / 10.0)
    }

    /// The goal for what is stored that serves a goal for the images; `None` where it is out of reach.
    pub(crate) fn inner_goal(&self, goal: Goal) -> Option<Goal> {
        if self.shrink_log2 == 0 {
            return Some(goal);
        }
        match goal {
            Goal::Bpp(bpp) => {
                Some(Goal::Bpp(bpp * self.full.texels() as f64 / self.stored().texels() as f64))
            }
            Goal::Psnr(psnr) => {
                let left = (FULL / 10f64.powf(psnr / 10.0) - self.floor) / KEPT;
                (left > 0.0).then(|| Goal::Psnr(10.0 * (FULL / left).log10()))
            }
            Goal::Tolerance(_) => None,
        }
    }
}

/// The places that texels of the enlarged image are read at: columns or rows of an image of `count` and of a smaller one of `small` texels,
/// with `more` and `beyond` on each side.
fn taps((count, more): (u32, u32), (small, beyond): (u32, u32)) -> Vec<TexfoldTap> {
    let last = (small + 2 * beyond - 1) as f32;
    let tap = |at: u32| {
        let place = (at as f32 - more as f32 + 0.5) / count as f32 * small as f32 + (beyond as f32 - 0.5);
        let low = place.clamp(0.0, last).floor();
        let (low, high) = (UVec2::splat(low as u32), UVec2::splat((low + 1.0).min(last) as u32));
        TexfoldTap { low, high, weight: Vec2::splat(place.clamp(0.0, last)) - low.as_vec2() }
    };
    (0..count + 2 * more).map(tap).collect()
}

/// Enlargement of a smaller image of `width` x `height` texels and `beyond` more on each side to one of `inner` texels and `padding` more.
fn enlargement((inner, padding): (ImageSize, u32), (width, height): (u32, u32), beyond: u32) -> Enlargement {
    let counted = |count: u32| padding as usize..(padding + count) as usize;
    Enlargement {
        small: ImageSize { width: width + 2 * beyond, height: height + 2 * beyond },
        columns: taps((inner.width, padding), (width, beyond)),
        rows: taps((inner.height, padding), (height, beyond)),
        counted: [counted(inner.width), counted(inner.height)],
        gain: 1.0,
    }
}

/// The smaller image whose enlargement is nearest to `image`, as far as so many passes come, and that enlargement's squared error of colours in
/// units of the range: of the image, not of what surrounds it.
fn fitted(
    image: &PaddedRaster,
    shrink_log2: u32,
    passes: usize,
    check: CancelCheck<'_>,
) -> Result<(PaddedRaster, f64), EncodeError> {
    let (inner, beyond) = (image.inner(), image.padding >> shrink_log2);
    let ImageSize { width, height } = inner.at_level(shrink_log2);
    let enlargement = enlargement((inner, image.padding), (width, height), beyond);
    let size = enlargement.small;
    let mut small = image.reduced(&image.raster, size, f64::from(beyond));
    let mut squared = 0.0;
    for channel in 0..usize::from(image.raster.info().color_channels()) {
        let wanted: Vec<f32> = image.raster.texels().map(|texel| texel[channel]).collect();
        let mut values: Vec<f32> = small.iter().map(|texel| texel[channel]).collect();
        enlargement.fit(&mut values, &wanted, passes, check)?;
        squared += enlargement.squared(&values, &wanted);
        small.iter_mut().zip(values).for_each(|(texel, value)| texel[channel] = value);
    }
    // As many texels as the size says.
    let raster = Raster::from_texels(size.width, size.height, image.raster.info(), &small);
    let raster = raster.unwrap_or_else(|_| image.raster.clone());
    Ok((PaddedRaster { raster, padding: beyond }, squared))
}

#[cfg(test)]
mod tests {
    use texfold_core::Texel;
    use texfold_core::address::{TEXFOLD_CLAMP, texfold_tap};
    use texfold_core::image::{Alpha, ColorSpace, MipFilter, mip_chain};

    use super::*;

    #[test]
    fn the_fit_is_nearer_than_means_and_nearly_the_nearest() {
        let image = texfold_testkit::image("terrain");
        let means = mip_chain(&image.clone().tagged(ColorSpace::Linear, Alpha::Opaque), 2, MipFilter::Box);
        let enlargement = enlargement((image.size(), 0), (128, 128), 0);
        let red = |image: &Raster| -> Vec<f32> { image.texels().map(|texel| texel.x).collect() };
        let wanted = red(&image);
        let of_means = enlargement.squared(&red(&means[1]), &wanted);
        let (small, _) = fitted(&PaddedRaster::alone(image), 1, PASSES, CancelCheck::default()).unwrap();
        let found = red(&small.raster);
        let left = enlargement.squared(&found, &wanted);
        assert!(small.raster.size().width == 128 && left < 0.9 * of_means, "{left} {of_means}");
        // What is left has nothing in common with what a smaller image could hold.
        let common = enlargement.gathered(&enlargement.residuals(&found, &wanted));
        let common: f64 = common.iter().map(|&sum| f64::from(sum).powi(2)).sum();
        assert!(common < left, "{common} {left}");
    }

    #[test]
    fn the_fit_of_a_tile_is_that_of_the_whole_in_its_place() {
        let image = texfold_testkit::image("terrain");
        for shrink_log2 in [1, 2] {
            let (whole, _) =
                fitted(&PaddedRaster::alone(image.clone()), shrink_log2, PASSES, CancelCheck::default())
                    .unwrap();
            let padding = 32 << shrink_log2 >> 1;
            let known = PaddedRaster { raster: image.clone(), padding };
            let (tile, _) = fitted(&known, shrink_log2, PASSES, CancelCheck::default()).unwrap();
            assert_eq!((tile.padding, tile.raster.size()), (16, whole.raster.size()));
            let near = |(a, b): (Texel, Texel)| (a - b).abs().max_element() < 1e-4;
            assert!(tile.raster.texels().zip(whole.raster.texels()).all(near));
        }
    }

    #[test]
    fn places_of_texels_are_those_that_decoders_read() {
        for (count, small) in [(256, 128), (281, 140), (17, 4)] {
            let taps = taps((count, 0), (small, 0));
            for (at, tap) in (0..count).zip(taps) {
                let uv = Vec2::splat((at as f32 + 0.5) / count as f32);
                let wanted = texfold_tap(uv, UVec2::splat(small), TEXFOLD_CLAMP);
                let place =
                    |tap: TexfoldTap| tap.low.x as f32 + (tap.high.x - tap.low.x) as f32 * tap.weight.x;
                assert!((place(tap) - place(wanted)).abs() < 1e-3, "{at} of {count}");
            }
        }
    }
}

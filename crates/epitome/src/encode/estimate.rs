//! What showing content in several places may save, from a look at some leaves: for callers that choose among methods.

use glam::Vec2;
use rayon::prelude::*;
use texfold_core::image::{ColorSpace, ImageSet, PixelInfo, Raster};
use texfold_core::target::Measured;
use texfold_core::{CancelCheck, EncodeError, Job};
use texfold_match::{
    Descriptor, Field, Freedom, LumaSums, Mirror, PatchIndex, Place, Refiner, Transform, describe,
};

use crate::Epitome;

/// Texels a side of the leaves that are looked at.
const SIDE: usize = 16;
/// Leaves that are looked at in a part.
const LEAVES: usize = 256;
/// Texels a side of the parts that large images are looked at in, as they are searched in parts.
const PART: u32 = 1024;
/// Parts that are looked at.
const PARTS: usize = 4;
/// Steps between places, in texels.
const STEP: usize = 2;
/// Patches that are looked at for a leaf under each mirroring.
const NEIGHBOURS: usize = 3;
/// Contrast in 8-bit steps below which a leaf has hardly any bits to save.
const LEAST_CONTRAST: f32 = 1.0;
/// Squared distance of descriptors beyond which nothing is alike.
const WITHIN: f32 = 0.4;
/// Luma differs less than colour does: by what to multiply its squared error to compare it with that of all channels.
const CHANNELS: f32 = 3.0;
/// What a bit is worth, in squared errors of a texel at the quality that is reached: about what the slope of squared error
/// against bits is.
const LAMBDA: f32 = 0.9;
/// Bits of a leaf in the map.
const MAP_BITS: f32 = 40.0;

impl Epitome {
    /// Share of a texture's bits, 0 to 1, that showing content in several places may save, where `known` is what its images
    /// come to without. An estimate from some leaves of 16x16 texels at full size, upright or mirrored, in at most four
    /// parts of 1024x1024 texels: the time does not grow beyond.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`].
    pub fn estimated_reuse(images: &ImageSet, known: &Measured, job: &Job<'_>) -> Result<f32, EncodeError> {
        let check = job.cancel_check();
        let mse = (255.0f64.powi(2) / 10f64.powf(known.psnr / 10.0)) as f32;
        let parts = parts(images);
        let texels: usize = parts.iter().map(|part| part.0.texels.len()).sum();
        let rate = Rate { mse: mse.max(1.0 / 12.0), bpp: known.bpp as f32 };
        let found = job.install(|| Look::new(parts, images.info(), check).leaves(texels, rate));
        job.checkpoint()?;
        Ok(found)
    }
}

/// What a texture comes to without reuse.
#[derive(Debug, Clone, Copy)]
struct Rate {
    /// Mean squared error of a channel, 8-bit units.
    mse: f32,
    /// Bits a texel.
    bpp: f32,
}

/// Parts of large images, evenly chosen among all; small images as they are.
fn parts(images: &ImageSet) -> Vec<(Field, Vec<f32>)> {
    let cut = |(image, x, y): &(&Raster, u32, u32)| {
        let size = image.size();
        let (width, height) = ((size.width - x).min(PART), (size.height - y).min(PART));
        let texels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
        let texels = texels.map(|(u, v)| image.texel(x + u, y + v) * 255.0).collect();
        let field = Field { width: width as usize, height: height as usize, texels };
        let luma = field.luma();
        (field, luma)
    };
    let corners = |image: &'_ Raster| {
        let size = image.size();
        let rows = (0..size.height).step_by(PART as usize);
        rows.flat_map(move |y| (0..size.width).step_by(PART as usize).map(move |x| (x, y)))
            .collect::<Vec<_>>()
    };
    let all: Vec<_> = images
        .images()
        .iter()
        .flat_map(|image| corners(image).into_iter().map(move |(x, y)| (image, x, y)))
        .collect();
    // Small images repeat one another: as many as make up the parts.
    let texels = |(image, x, y): &(&Raster, u32, u32)| {
        let size = image.size();
        u64::from((size.width - x).min(PART)) * u64::from((size.height - y).min(PART))
    };
    let mean = all.iter().map(texels).sum::<u64>() / all.len().max(1) as u64;
    let most = ((PARTS as u64 * u64::from(PART * PART)) / mean.max(1)).max(1) as usize;
    let step = all.len().div_ceil(most).max(1);
    all.iter().step_by(step).map(cut).collect()
}

/// A look at some parts.
struct Look<'a> {
    parts: Vec<(Field, Vec<f32>)>,
    sums: Vec<LumaSums>,
    index: Option<PatchIndex>,
    mirrors: &'static [Mirror],
    cancel: CancelCheck<'a>,
}

impl<'a> Look<'a> {
    fn new(parts: Vec<(Field, Vec<f32>)>, pixel: PixelInfo, cancel: CancelCheck<'a>) -> Self {
        let sums: Vec<LumaSums> = parts.par_iter().map(|(field, _)| LumaSums::new(field)).collect();
        let places: Vec<Place> =
            (0..).zip(&parts).flat_map(|(number, (field, _))| places(number, field)).collect();
        let mirrors = if pixel.color == ColorSpace::Normal { &Mirror::ALL[..1] } else { &Mirror::ALL[..] };
        let index = (!places.is_empty()).then(|| {
            let sums: Vec<&LumaSums> = sums.iter().collect();
            PatchIndex::new(&sums, (SIDE, SIDE), &places, LEAST_CONTRAST, cancel)
        });
        Look { parts, sums, index, mirrors, cancel }
    }

    /// Share of the bits of all leaves, of `texels` texels, that need not be stored where what came first is shown again.
    fn leaves(&self, texels: usize, rate: Rate) -> f32 {
        let all: Vec<(usize, usize, usize)> = self.corners();
        let step = all.len().div_ceil(LEAVES * self.parts.len().clamp(1, PARTS)).max(1);
        let chosen: Vec<_> = all.iter().step_by(step).copied().collect();
        let weights: Vec<f32> = chosen.par_iter().map(|&leaf| self.weight(leaf, rate.mse)).collect();
        let sum: f32 = weights.iter().sum();
        if sum <= 0.0 {
            return 0.0;
        }
        let bits_of_chosen = rate.bpp * texels as f32 * chosen.len() as f32 / all.len() as f32;
        let saved = |(&leaf, weight): (&(usize, usize, usize), &f32)| {
            self.saved(leaf, bits_of_chosen * weight / sum, rate.mse)
        };
        let saved: Vec<f32> = chosen.par_iter().zip(&weights).map(saved).collect();
        saved.iter().sum::<f32>() / bits_of_chosen.max(1.0)
    }

    /// Part, column and row of the corner of every leaf.
    fn corners(&self) -> Vec<(usize, usize, usize)> {
        let of_part = |(number, (field, _)): (usize, &(Field, Vec<f32>))| {
            let (across, down) = (field.width / SIDE, field.height / SIDE);
            let row = move |y: usize| (0..across).map(move |x| (number, SIDE * x, SIDE * y));
            (0..down).flat_map(row).collect::<Vec<_>>()
        };
        self.parts.iter().enumerate().flat_map(of_part).collect()
    }

    /// A number that grows with a leaf's bits: those of differences of neighbours at such an error.
    fn weight(&self, (part, x, y): (usize, usize, usize), mse: f32) -> f32 {
        let (field, luma) = &self.parts[part];
        let at = |u: usize, v: usize| luma[(y + v) * field.width + x + u];
        let steps =
            |u: usize, v: usize| (at(u, v) - at(u - 1, v)).powi(2) + (at(u, v) - at(u, v - 1)).powi(2);
        let sum: f32 = (1..SIDE).flat_map(|v| (1..SIDE).map(move |u| (u, v))).map(|(u, v)| steps(u, v)).sum();
        (1.0 + sum / (2 * (SIDE - 1) * (SIDE - 1)) as f32 / mse).log2()
    }

    /// Bits of a leaf of `bits` that something which came first saves.
    fn saved(&self, leaf: (usize, usize, usize), bits: f32, mse: f32) -> f32 {
        let Some(index) = self.index.as_ref().filter(|_| bits > MAP_BITS && !self.cancel.is_cancelled())
        else {
            return 0.0;
        };
        let (part, x, y) = leaf;
        let (descriptor, contrast) = describe(&self.sums[part], x, y, SIDE, SIDE);
        if contrast < LEAST_CONTRAST {
            return 0.0;
        }
        // Squared error of luma that costs as much as the bits.
        let of_error = |error: f32| error * CHANNELS / (LAMBDA * CHANNELS * mse);
        let most = (bits - MAP_BITS) * LAMBDA * mse;
        let within = WITHIN.min(most / (contrast * contrast * (SIDE * SIDE) as f32));
        let near = self.mirrors.iter().flat_map(|mirror| self.near(index, *mirror, &descriptor, within));
        let target = self.luma_of(leaf);
        let refiner = Refiner::new(&target, (SIDE, SIDE));
        let first = near
            .filter(|(place, _)| (place.field as usize, place.y as usize, place.x as usize) < (part, y, x));
        let apart = first.filter(|(place, _)| {
            let near = |a: u32, b: usize| (a as usize).abs_diff(b) < SIDE / 2;
            place.field as usize != part || !near(place.x, x) || !near(place.y, y)
        });
        let error =
            apart.map(|(place, seed)| self.refined(&refiner, place, seed)).fold(f32::INFINITY, f32::min);
        (bits - MAP_BITS - of_error(error)).max(0.0)
    }

    fn near<'i>(
        &'i self,
        index: &'i PatchIndex,
        mirror: Mirror,
        descriptor: &Descriptor,
        within: f32,
    ) -> impl Iterator<Item = (Place, Transform)> + 'i {
        let found = index.nearest(&mirror.of(descriptor), within, NEIGHBOURS);
        found.into_iter().map(move |near| {
            let half = SIDE as f32 / 2.0;
            let position = Vec2::new(near.place.x as f32 + half, near.place.y as f32 + half);
            let sign = |flip: bool| if flip { -1.0 } else { 1.0 };
            let matrix = glam::Mat2::from_diagonal(Vec2::new(sign(mirror.across), sign(mirror.down)));
            (near.place, Transform { position, matrix })
        })
    }

    /// Squared error of luma at a place once its position is refined.
    fn refined(&self, refiner: &Refiner<'_>, place: Place, seed: Transform) -> f32 {
        let (field, luma) = &self.parts[place.field as usize];
        refiner.refine(luma, (field.width, field.height), seed, Freedom::Position).error
    }

    fn luma_of(&self, (part, x, y): (usize, usize, usize)) -> Vec<f32> {
        let (field, luma) = &self.parts[part];
        let row = |v: usize| &luma[v * field.width + x..v * field.width + x + SIDE];
        (y..y + SIDE).flat_map(row).copied().collect()
    }
}

/// Places of patches in a field.
fn places(number: u32, field: &Field) -> Vec<Place> {
    if field.width < SIDE || field.height < SIDE {
        return Vec::new();
    }
    let rows = (0..=field.height - SIDE).step_by(STEP);
    rows.flat_map(|y| (0..=field.width - SIDE).step_by(STEP).map(move |x| (x, y)))
        .map(|(x, y)| Place { field: number, x: x as u32, y: y as u32 })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reuse_of(images: Vec<Raster>, psnr: f64, bpp: f64) -> f32 {
        let set = ImageSet::new(images).unwrap();
        Epitome::estimated_reuse(&set, &Measured { psnr, bpp, worst_block_rms: 0.0 }, &Job::default())
            .unwrap()
    }

    fn mirrored(image: &Raster) -> Raster {
        let size = image.size();
        let texel = |i: u32| image.texel(size.width - 1 - i % size.width, i / size.width);
        let texels: Vec<_> = (0..size.width * size.height).map(texel).collect();
        Raster::from_texels(size.width, size.height, image.info(), &texels).unwrap()
    }

    #[test]
    fn what_repeats_saves_bits_and_what_does_not_saves_none() {
        let of = |name: &str, bpp: f64| reuse_of(vec![texfold_testkit::image(name)], 34.0, bpp);
        assert!(of("tile_repeat", 3.6) > 0.3 && of("text_page", 1.3) > 0.3);
        assert!(of("terrain", 2.2) < 0.02 && of("noise", 12.8) < 0.02 && of("salient", 0.5) < 0.05);
        assert_eq!(of("one_texel", 4.0), 0.0);
        assert_eq!(of("constant", 0.1), 0.0);
    }

    #[test]
    fn a_mirrored_image_beside_it_saves_half() {
        let image = texfold_testkit::image("terrain");
        let alone = reuse_of(vec![image.clone()], 34.0, 2.2);
        let both = reuse_of(vec![image.clone(), mirrored(&image)], 34.0, 2.2);
        assert!(alone < 0.02 && (0.25..0.5).contains(&both), "{alone} {both}");
    }
}

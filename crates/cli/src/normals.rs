//! Normal maps: the angle that compression turns normals by, and the search for a goal in degrees.

use std::f64::consts::FRAC_PI_2;

use texfold::encoding::Chosen;
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::metric::decode_image;
use texfold_core::{Encoded, Goal, Image2d, Texel};

/// Mean angle in degrees that normal maps are encoded to where no goal is given.
pub(crate) const USUAL_DEGREES: f64 = 1.0;
/// Most encodes of a search.
pub(crate) const ROUNDS: usize = 4;
/// A search ends where the angle is below the goal by less than this, in dB.
const CLOSE: f64 = 0.25;
/// The largest step of a search and the margin that is added to each step, in dB.
const MOST_STEP: f64 = 12.0;
const MARGIN: f64 = 0.05;
/// PSNR in dB below which nothing is left of an image.
const LEAST_PSNR: f64 = 1.0;

/// The PSNR in dB at which errors of normal distribution turn normals by that many degrees in the mean: a stored component is half of a
/// normal's, and two of three components turn it.
pub(crate) fn psnr_of(degrees: f64) -> f64 {
    20.0 * (2.0 * FRAC_PI_2.sqrt() / degrees.to_radians()).log10()
}

/// Mean angle in degrees between the normals of `images` and of `texture`; `None` where no image has normals of three channels.
pub(crate) fn mean_degrees(images: &ImageSet, texture: &dyn Encoded<Domain = Image2d>) -> Option<f64> {
    let (mut sum, mut texels) = (0.0, 0.0);
    for (index, source) in (0..).zip(images.images()).filter(|(_, source)| has_normals(source)) {
        let of_image = source.size().texels() as f64;
        sum += of_image * degrees_of(source, &decode_image(texture, index, 0)?)?;
        texels += of_image;
    }
    (texels > 0.0).then(|| sum / texels)
}

/// Mean angle in degrees between the normals of an image and of what it is decoded to; `None` where it has none of three channels.
#[must_use]
pub(crate) fn degrees_of(source: &Raster, decoded: &Raster) -> Option<f64> {
    let angle = |(a, b): (Texel, Texel)| f64::from(normal(a).angle_between(normal(b)));
    let mean =
        || source.texels().zip(decoded.texels()).map(angle).sum::<f64>() / source.size().texels() as f64;
    has_normals(source).then(|| mean().to_degrees())
}

fn has_normals(image: &Raster) -> bool {
    image.info().color == ColorSpace::Normal && image.info().channels > 2
}

fn normal(texel: Texel) -> glam::Vec3 {
    (texel.truncate() * 2.0 - 1.0).normalize_or(glam::Vec3::Z)
}

/// The smallest of some encodes of a set of normal maps whose mean angle is at most `degrees`, or the one of the least angle where none is.
pub(crate) fn search<E>(
    images: &ImageSet,
    degrees: f64,
    mut encode: impl FnMut(Goal) -> Result<Chosen, E>,
) -> Result<Chosen, E> {
    let mut psnr = psnr_of(degrees);
    let mut best: Option<(f64, Chosen)> = None;
    for _ in 0..ROUNDS {
        let chosen = encode(Goal::Psnr(psnr))?;
        let found = mean_degrees(images, chosen.image.as_encoded()).unwrap_or(0.0);
        let above = (20.0 * (found / degrees).log10()).clamp(-MOST_STEP, MOST_STEP);
        let bits = |chosen: &Chosen| chosen.image.as_encoded().memory().goal;
        let is_better =
            best.as_ref().is_none_or(|(known, held)| match (found <= degrees, *known <= degrees) {
                (true, true) => bits(&chosen) < bits(held),
                (false, false) => found < *known,
                (is_met, _) => is_met,
            });
        if is_better {
            best = Some((found, chosen));
        }
        if (-CLOSE..=0.0).contains(&above) {
            break;
        }
        psnr = (psnr + above + MARGIN).max(LEAST_PSNR);
    }
    match best {
        Some((_, chosen)) => Ok(chosen),
        None => encode(Goal::Psnr(psnr)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::rng::Rng;

    #[test]
    fn errors_of_a_psnr_turn_normals_by_its_angle() {
        let mut rng = Rng::new(5);
        let mut even = || f64::from(rng.below(1 << 16)) / f64::from(1 << 16) - 0.5;
        // Sums of twelve even numbers have about normal distribution of deviation 1.
        let mut gauss = || (0..12).map(|_| even()).sum::<f64>();
        let psnr = psnr_of(2.0);
        let deviation = 10f64.powf(-psnr / 20.0);
        let angles = (0..20_000).map(|_| {
            let noise = [0; 3].map(|_| (deviation * gauss()) as f32);
            let texel = Texel::new(0.5 + noise[0], 0.5 + noise[1], 1.0 + noise[2], 1.0);
            f64::from(normal(texel).angle_between(glam::Vec3::Z))
        });
        let mean = angles.sum::<f64>().to_degrees() / 20_000.0;
        assert!((mean - 2.0).abs() < 0.05, "{mean}");
    }
}

//! How a texture was made and how good it is, in words and numbers, from its shipped form.

use glam::{DMat3, Vec2, Vec4};
use rayon::prelude::*;
use texfold_bc::ContentPlanes;
use texfold_core::image::Raster;
use texfold_core::metric::SquaredError;
use texfold_core::{Access, CancelCheck, Encoded, Notes};
use texfold_dct::DctContent;

use super::Dropped;
use super::canvas::colour;
use super::compare::{footprint, places, step};
use super::fit::Fitted;
use crate::decode::ZipmapView;
use crate::parts::{ImageForm, PATCH_PART, Payload, patch_pixel};
use crate::{PatchStack, ZipParams, ZipTexture};

/// Variance, in a range of 1, that is added on both sides of a gain, so that flat images divide by no zero: a quarter
/// of a step of 8 bits.
const FLAT_VARIANCE: f32 = 1e-6;

/// How well a texture reconstructs one image of its stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fidelity {
    /// Which patch of the stack; the root where there is none.
    pub patch: Option<usize>,
    /// Error against the image after its exposure was fitted by a gain and an offset a channel.
    pub error: SquaredError,
    /// The same of the root alone.
    pub root_alone: SquaredError,
}

/// How well a texture reconstructs the images that it was made of.
#[must_use]
pub fn fidelity(stack: &PatchStack, texture: &ZipTexture) -> Vec<Fidelity> {
    fidelity_of(stack, texture, CancelCheck::default())
}

/// As [`fidelity`]; of no use once the job is cancelled.
fn fidelity_of(stack: &PatchStack, texture: &ZipTexture, cancel: CancelCheck<'_>) -> Vec<Fidelity> {
    let alone = texture.first_patches(0);
    let views = [texture.view(), alone.view()];
    let identity = (None, &stack.root, DMat3::IDENTITY);
    let patches = stack.patches.iter().enumerate();
    let patches = patches.map(|(index, patch)| (Some(index), &stack.images[patch.image], patch.matrix));
    std::iter::once(identity)
        .chain(patches)
        .map(|(patch, image, matrix)| {
            let [error, root_alone] = views.map(|view| against(&view, image, &matrix.inverse(), cancel));
            Fidelity { patch, error, root_alone }
        })
        .collect()
}

/// Error of the texture at the texels of an image whose exposure is fitted.
fn against(view: &ZipmapView<'_>, image: &Raster, inverse: &DMat3, cancel: CancelCheck<'_>) -> SquaredError {
    let size = (image.size().width, image.size().height);
    let pairs: Vec<(Vec4, Vec4)> = places(size)
        .into_par_iter()
        .filter_map(|place| {
            let at = footprint(inverse, place, size);
            let inside = at.uv.cmpge(Vec2::ZERO).all() && at.uv.cmple(Vec2::ONE).all();
            (inside && !cancel.is_cancelled()).then(|| (image.texel(place.0, place.1), colour(view, &at)))
        })
        .collect();
    let count = pairs.len().max(1) as f32;
    let sum = |value: &dyn Fn(&(Vec4, Vec4)) -> Vec4| {
        pairs.iter().map(|pair| value(pair).as_dvec4()).sum::<glam::DVec4>().as_vec4() / count
    };
    let (own, decoded) = (sum(&|pair| pair.0), sum(&|pair| pair.1));
    let variance = sum(&|pair| (pair.0 - own) * (pair.0 - own));
    let covariance = sum(&|pair| (pair.0 - own) * (pair.1 - decoded));
    let gain = (covariance + FLAT_VARIANCE) / (variance + FLAT_VARIANCE);
    let fitted = |colour: Vec4| (colour - own) * gain + decoded;
    let total = pairs.iter().map(|pair| step(fitted(pair.0), pair.1)).sum();
    SquaredError { sum: total, count: 3 * pairs.len() as u64 }
}

pub(crate) fn notes(
    stack: &PatchStack,
    params: &ZipParams,
    fitted: &Fitted,
    dropped: &Dropped,
    cancel: CancelCheck<'_>,
) -> Notes {
    let texture = &fitted.texture;
    let found = fidelity_of(stack, texture, cancel);
    let sum = |error: fn(&Fidelity) -> SquaredError| {
        found.iter().map(error).fold(SquaredError::default(), |a, b| a + b)
    };
    let goal = params.goal.option();
    // On the command line these stand in the list of patches.
    let tau = if params.tau == ZipParams::default().tau {
        String::new()
    } else {
        format!(", tau = {}", params.tau)
    };
    let merge = if params.merge { "" } else { ", merge = false" };
    let access = match texture.access() {
        Access::Block => {
            format!(" --access block --metric {}", params.metric_for(texture.layout().pixel).name())
        }
        Access::Texel => " --access texel".to_owned(),
    };
    let content = params.content.map_or(String::new(), |content| format!(" --content {}", content.name()));
    let alone = sum(|fidelity| fidelity.root_alone).psnr() as f32;
    let psnr_without = if texture.patches() > 0 { vec![(PATCH_PART.to_owned(), alone)] } else { Vec::new() };
    Notes {
        settings: format!("--codec zipmap {goal}{access}{content}{tau}{merge}"),
        verdict: verdict(fitted, dropped, sum(|fidelity| fidelity.error).psnr()),
        psnr_without,
        ..Notes::default()
    }
}

/// Bits a texel of the root and of patch images.
fn bits_per_texel(texture: &ZipTexture) -> [f64; 2] {
    let pixel = texture.layout().pixel;
    match &texture.parts.payload {
        Payload::Planes { root, images } => {
            let root = root[0].content().bits_per_texel(pixel);
            let of_image =
                |levels: &Vec<ContentPlanes>| levels[0].content().bits_per_texel(patch_pixel(pixel));
            [root, images.first().map_or(root, of_image)]
        }
        Payload::Blocks { root, atlas } => {
            let bits =
                |content: &DctContent, texels: u64| 8.0 * content.held_bytes() as f64 / texels.max(1) as f64;
            let texels = texture.parts.images.iter().map(ImageForm::texels).sum();
            let root = bits(root, root.layout().texels());
            [root, atlas.as_ref().map_or(root, |atlas| bits(atlas, texels))]
        }
    }
}

fn verdict(fitted: &Fitted, dropped: &Dropped, psnr: f64) -> String {
    let texture = &fitted.texture;
    let root = texture.root_size();
    let zoom = fitted.zooms.iter().copied().fold(1.0, f64::max);
    let losses = || fitted.losses.iter();
    let loss = losses().fold(SquaredError::default(), |sum, &loss| sum + loss).psnr();
    let worst = losses().map(|loss| loss.psnr()).fold(f64::INFINITY, f64::min);
    let plain = root.texels() as f64 * zoom * zoom * 4.0 / 3.0;
    let bits = texture.memory().compressed as f64;
    let [bits_per_texel, of_patches] = bits_per_texel(texture);
    let mut text = format!(
        "{}{} patches on a root of {}x{}, zoom up to {zoom:.2}; {psnr:.2} dB against the photographs after fitting \
         their exposure; {loss:.2} dB against the merged images, {worst:.2} dB for the worst of them; {:.0}% of the \
         memory of a plain texture as fine throughout",
        match texture.access() {
            Access::Block => "By block: ",
            Access::Texel => "",
        },
        texture.patches(),
        root.width,
        root.height,
        100.0 * bits / (plain * bits_per_texel),
    );
    if texture.contents() < texture.patches() {
        text += &format!(
            "; they use {} images; an image of several patches is stored once, and its colours are not fitted",
            texture.contents()
        );
    }
    if dropped.coarser > 0 {
        text += &format!(
            "; {} images are stored without their finest levels, which the goal does not need",
            dropped.coarser
        );
    }
    if !dropped.spared.is_empty() {
        text += &format!("; nor does it need patches {:?}", dropped.spared);
    }
    if dropped.levels > 0 {
        let share = dropped.level_texels;
        text += &format!(
            "; {} mip levels ({share} texels) equal what lies under them and are left out",
            dropped.levels
        );
    }
    if dropped.cropped_texels > 0 {
        text += &format!("; {} texels outside of the root or their mask are cut off", dropped.cropped_texels);
    }
    if !dropped.nothing_new.is_empty() {
        text += &format!("; patches {:?} add nothing new", dropped.nothing_new);
    }
    if !dropped.hidden.is_empty() {
        text += &format!("; patches {:?} are hidden by others", dropped.hidden);
    }
    let left_out = dropped.level_texels + dropped.patch_texels + dropped.cropped_texels + dropped.fine_texels;
    if left_out > 0 {
        let saved = left_out as f64 * of_patches;
        text += &format!("; all that is left out would take {:.0}% more memory", 100.0 * saved / bits);
    }
    text + "."
}

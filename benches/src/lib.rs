//! Images and settings that the benches share.

pub mod report;

use rayon::prelude::*;
use texfold::core::image::{ColorSpace, ImageSet, Raster, to_u8};
use texfold::{
    Access, AnyImage, Content, Effort, Goal, Job,
    bc::{Bc, BcParams},
    core::Encoder,
    dct::{Dct, DctParams},
    epitome::{Epitome, EpitomeParams, EpitomeSource},
    progressive::{Progressive, ProgressiveParams},
    vq::{Vq, VqParams, VqSource},
};

/// Photographs that are factored in the regime of the paper of epitomes.
pub const FACTORED_PHOTOGRAPHS: [&str; 9] = [
    "skimage_brick.png",
    "urban100_021.png",
    "urban100_100.png",
    "urban100_014.png",
    "urban100_018.png",
    "aloeL.jpg",
    "page_boston_cooking_a.jpg",
    "wool_albedo.png",
    "zebras_bsds_253027.jpg",
];

/// Photographs by their path below the data folder, or fixtures by name.
#[must_use]
pub fn images(photographs: &[&str], fixtures: &[&str]) -> Vec<(String, Raster)> {
    let fixture = |name: &&str| texfold_testkit::fixtures_dir().join(format!("images/{name}.png"));
    let paths: Vec<std::path::PathBuf> = match texfold_testkit::data_dir("the tables on photographs") {
        Some(data) => photographs.iter().map(|name| data.join(name)).collect(),
        None => fixtures.iter().map(fixture).collect(),
    };
    let named = |path: &std::path::PathBuf| {
        (path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), texfold_testkit::png(path))
    };
    paths.iter().map(named).collect()
}

/// A 512x512 image: the facade four times, each turned another way so that blocks do not repeat exactly.
#[must_use]
pub fn image_512() -> ImageSet {
    let source = texfold_testkit::image("facade");
    image_of(&source, 512)
}

/// A large image of `side` texels made of the terrain, turned and dimmed from tile to tile.
#[must_use]
pub fn image_of(source: &Raster, side: u32) -> ImageSet {
    let size = source.size();
    let texel = |x: u32, y: u32| -> [u8; 3] {
        let (column, row) = (x / size.width, y / size.height);
        let (mut u, mut v) = (x % size.width, y % size.height);
        if column % 2 == 1 {
            u = size.width - 1 - u;
        }
        if row % 2 == 1 {
            v = size.height - 1 - v;
        }
        let dim = 1.0 - 0.03 * ((column * 7 + row * 13) % 11) as f32;
        (source.texel(u, v).truncate() * dim).to_array().map(to_u8)
    };
    let bytes: Vec<u8> = (0..side).flat_map(|y| (0..side).flat_map(move |x| texel(x, y))).collect();
    match Raster::from_u8(side, side, 3, ColorSpace::Srgb, &bytes) {
        Ok(raster) => ImageSet::single(raster),
        Err(_) => ImageSet::single(source.clone()),
    }
}

/// The settings of the paper's examples: a codebook of 1/16 of a 512x512 image with one sample of 64x64.
#[must_use]
pub fn paper_params() -> VqParams {
    VqParams::default().with_codebook((128, 128)).with_samples((1, 64)).with_content(Content::Raw)
}

/// `set` by vq; `None` where it cannot be encoded.
#[must_use]
pub fn vq(set: &ImageSet, params: &VqParams) -> Option<AnyImage> {
    Vq::encode(VqSource::new(set), params, &mut Job::default()).ok().map(AnyImage::new)
}

/// Quality that the benches ask of epitome, in dB.
const EPITOME_PSNR: f64 = 32.0;

/// Settings of epitome at effort `fast`: `content`, or BC1 and BC7 side by side.
#[must_use]
pub fn epitome_params(content: Option<Content>) -> EpitomeParams {
    let params = EpitomeParams::new(Goal::Psnr(EPITOME_PSNR)).with_access(Access::Texel);
    params.with_content(content).with_effort(Effort::Fast)
}

/// `set` by epitome; `None` where it cannot be encoded.
#[must_use]
pub fn epitome(set: &ImageSet, params: &EpitomeParams) -> Option<AnyImage> {
    Epitome::encode(EpitomeSource::new(set), params, &mut Job::default()).ok().map(AnyImage::new)
}

/// `set` by progressive within `bpp` bits a texel; `None` where it cannot be encoded.
#[must_use]
pub fn progressive(set: &ImageSet, bpp: f64, effort: Effort) -> Option<AnyImage> {
    let params = ProgressiveParams::default().with_goal(Goal::Bpp(bpp)).with_effort(effort);
    Progressive::encode(set, &params, &mut Job::default()).ok().map(AnyImage::new)
}

/// `set` by dct within `bpp` bits a texel; `None` where it cannot be encoded.
#[must_use]
pub fn dct(set: &ImageSet, bpp: f64, effort: Effort) -> Option<AnyImage> {
    let params = DctParams::default().with_goal(Goal::Bpp(bpp)).with_effort(effort);
    Dct::encode(set, &params, &mut Job::default()).ok().map(AnyImage::new)
}

/// `set` as plain blocks at full size; `None` where it cannot be encoded.
#[must_use]
pub fn bc(set: &ImageSet, content: Content) -> Option<AnyImage> {
    let params = BcParams::default().with_content(content).with_reduce_log2(0).with_effort(Effort::Fast);
    Bc::encode(set, &params, &mut Job::default()).ok().map(AnyImage::new)
}

/// `work` for every number below `count`, on all cores; results are in order.
pub fn over<R: Send>(count: usize, work: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
    (0..count).into_par_iter().map(work).collect()
}

/// PSNR in dB of a whole image and of its most salient quarter.
#[must_use]
pub fn salient_psnr(source: &Raster, decoded: &Raster) -> (f64, f64) {
    let saliency: Vec<f32> = texfold_vq::saliency_map(source).iter().copied().collect();
    let mut sorted = saliency.clone();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let threshold = sorted[sorted.len() / 4];
    let (mut whole, mut salient) = ((0f64, 0f64), (0f64, 0f64));
    for ((a, b), saliency) in source.texels().zip(decoded.texels()).zip(&saliency) {
        let step = |channel: usize| f64::from(to_u8(a[channel])) - f64::from(to_u8(b[channel]));
        let error: f64 = (0..3).map(|channel| step(channel).powi(2)).sum();
        whole = (whole.0 + error, whole.1 + 3.0);
        if *saliency >= threshold {
            salient = (salient.0 + error, salient.1 + 3.0);
        }
    }
    let psnr = |(sum, count): (f64, f64)| 10.0 * (65025.0 * count / sum.max(1e-9)).log10();
    (psnr(whole), psnr(salient))
}

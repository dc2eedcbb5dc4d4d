//! Colours that alpha hides, by block: kept, but where goals of bits may change them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use texfold_core::image::{Alpha, ColorSpace, ImageSet, Raster, to_u8};
use texfold_core::metric::{SquaredError, alpha_error, decode_surface};
use texfold_core::rng::Rng;
use texfold_core::{Effort, Encoded, Encoder, Goal, Job, Metric, Texel};
use texfold_progressive::{Progressive, ProgressiveParams, ProgressiveTexture};

fn encode(set: &ImageSet, params: &ProgressiveParams) -> ProgressiveTexture {
    Progressive::encode(set, params, &mut Job::default()).unwrap()
}

fn with_alpha(image: Raster) -> ImageSet {
    ImageSet::single(image.tagged(ColorSpace::Srgb, Alpha::Straight))
}

/// A disc of terrain; noise is hidden around it.
fn disc() -> ImageSet {
    let terrain = texfold_testkit::image("terrain").with_channels(4);
    let mut rng = Rng::new(3);
    let texel = |(i, texel): (usize, Texel)| {
        let (x, y) = ((i % 256) as f32 - 127.5, (i / 256) as f32 - 127.5);
        if x.hypot(y) < 80.0 {
            return texel.truncate().extend(1.0);
        }
        let [red, green, blue] = [(); 3].map(|()| rng.unit() as f32);
        Texel::new(red, green, blue, 0.0)
    };
    let texels: Vec<Texel> = terrain.texels().enumerate().map(texel).collect();
    let terrain = terrain.tagged(ColorSpace::Srgb, Alpha::Straight);
    ImageSet::single(Raster::from_texels(256, 256, terrain.info(), &texels).unwrap())
}

/// Error of the colours of texels that count.
fn error_where(
    source: &ImageSet,
    texture: &ProgressiveTexture,
    counts: impl Fn(u32, u32) -> bool,
) -> SquaredError {
    let (source, decoded) = (&source.images()[0], decode_surface(texture, 0, 0).unwrap());
    let mut error = SquaredError::default();
    let size = source.size();
    for (x, y) in (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))) {
        if counts(x, y) {
            let (a, b) = (source.texel(x, y), decoded.texel(x, y));
            let square = |channel| f64::from(to_u8(a[channel]).abs_diff(to_u8(b[channel]))).powi(2);
            error = error + SquaredError { sum: (0..3).map(square).sum(), count: 3 };
        }
    }
    error
}

fn visible_psnr(source: &ImageSet, texture: &ProgressiveTexture) -> f64 {
    let image = &source.images()[0];
    error_where(source, texture, |x, y| image.texel(x, y).w > 0.0).psnr()
}

#[test]
fn hidden_colours_that_may_change_leave_their_bits_to_visible_ones() {
    let set = disc();
    let image = &set.images()[0];
    let params = ProgressiveParams::default().with_goal(Goal::Bpp(1.0)).with_metric(Metric::Psnr);
    for mips in [false, true] {
        let params = params.clone().with_mips(mips);
        let (kept, freed) = (encode(&set, &params), encode(&set, &params.clone().with_free_hidden(true)));
        let (before, after) = (visible_psnr(&set, &kept), visible_psnr(&set, &freed));
        assert!(after > before + 3.0, "mips {mips}: {after} after {before}");
        assert!(freed.notes().verdict.contains("hides"));
        // Filters read the texels around the disc: those are kept as what is visible is.
        let visible = |x: u32, y: u32| image.texel(x, y).w > 0.0;
        let around = |x: u32, y: u32| {
            let near = |dx: u32, dy: u32| visible((x + dx).clamp(1, 256) - 1, (y + dy).clamp(1, 256) - 1);
            !visible(x, y) && (0..9).any(|at| near(at % 3, at / 3))
        };
        let ring = error_where(&set, &freed, around);
        let others = error_where(&set, &freed, |x, y| !visible(x, y) && !around(x, y));
        // Noise is 10.8 dB away from its mean.
        assert!(ring.count > 3 * 400 && ring.psnr() > 18.0, "mips {mips}: {}", ring.psnr());
        assert!(mips || others.psnr() < 12.0, "{}", others.psnr());
        let alpha = |texture| alpha_error(image, &decode_surface(texture, 0, 0).unwrap()).unwrap().psnr();
        assert!(alpha(&freed) > alpha(&kept), "mips {mips}");
    }
}

#[test]
fn goals_of_quality_keep_hidden_colours() {
    let set = disc();
    let params = ProgressiveParams::default().with_goal(Goal::Psnr(28.0)).with_effort(Effort::Fast);
    assert!(encode(&set, &params) == encode(&set, &params.clone().with_free_hidden(true)));
    // A tolerance may be answered by texel, which takes long.
    let info = set.info();
    let frees = |goal| ProgressiveParams::default().with_goal(goal).with_free_hidden(true).frees_hidden(info);
    assert!(frees(Goal::Bpp(1.0)) && !frees(Goal::Tolerance(8.0)) && !frees(Goal::Psnr(28.0)));
}

/// Bits of a file with hidden colours that may change, of the quality of what is visible that `bpp` bits give where they are kept.
fn bits_freed(set: &ImageSet, bpp: f64, metric: Metric) -> f64 {
    let params = |bpp| ProgressiveParams::default().with_goal(Goal::Bpp(bpp)).with_metric(metric);
    let wanted = visible_psnr(set, &encode(set, &params(bpp)));
    let (mut low, mut high) = (bpp / 16.0, bpp * 1.05);
    while high / low > 1.005 {
        let middle = (low * high).sqrt();
        let found = visible_psnr(set, &encode(set, &params(middle).with_free_hidden(true)));
        *(if found >= wanted { &mut high } else { &mut low }) = middle;
    }
    high
}

/// `cargo test --release -p texfold-progressive --test hidden -- --ignored --nocapture`
#[test]
#[ignore = "measures"]
fn bits_of_hidden_colours() {
    let mut images = vec![
        ("cutout".to_owned(), with_alpha(texfold_testkit::image("cutout"))),
        ("disc".to_owned(), disc()),
    ];
    if let Some(data) = texfold_testkit::data_dir("bits of hidden colours") {
        let names = [
            "slf/nerf_lego/r_0",
            "slf/nerf_lego/r_36",
            "slf/spot_gloss/images/023",
            "vq/anim_openarena_flame/flame1",
        ];
        for name in names {
            images
                .push((name.to_owned(), with_alpha(texfold_testkit::png(&data.join(format!("{name}.png"))))));
        }
    }
    for (name, set) in images {
        for bpp in [0.5, 1.0] {
            let freed = bits_freed(&set, bpp, Metric::Perceptual);
            println!("{name:32} {bpp:.2} {freed:.3} {:+.1} %", 100.0 * (freed / bpp - 1.0));
        }
    }
}

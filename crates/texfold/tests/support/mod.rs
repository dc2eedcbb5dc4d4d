//! Small textures of every codec.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "each test file uses its own part; a test without its texture must fail"
)]

pub mod forged;
pub mod target;

use std::sync::OnceLock;

use texfold::core::image::{ImageSet, Raster};
use texfold::{
    Access, AnyImage, Content, Effort, Family, Goal, Job,
    bc::{Bc, BcParams},
    core::Encoder,
    dct::{Dct, DctParams},
    encoding::{ENCODINGS, Encoding},
    epitome::{Epitome, EpitomeParams, EpitomeSource},
    progressive::{Progressive, ProgressiveParams, Shared},
    vq::{Vq, VqParams, VqSource},
    zipmap::{PatchSource, PatchStack, ZipParams, Zipmap},
};

pub fn fixture(name: &str) -> ImageSet {
    ImageSet::single(texfold_testkit::image(name))
}

pub fn vq(set: &ImageSet, params: &VqParams) -> AnyImage {
    AnyImage::new(Vq::encode(VqSource::new(set), params, &mut Job::default()).unwrap())
}

pub fn bc(set: &ImageSet, params: &BcParams) -> AnyImage {
    AnyImage::new(Bc::encode(set, params, &mut Job::default()).unwrap())
}

pub fn epitome(set: &ImageSet, params: &EpitomeParams) -> AnyImage {
    AnyImage::new(Epitome::encode(EpitomeSource::new(set), params, &mut Job::default()).unwrap())
}

pub fn dct(set: &ImageSet, params: &DctParams) -> AnyImage {
    AnyImage::new(Dct::encode(set, params, &mut Job::default()).unwrap())
}

pub fn progressive(set: &ImageSet, params: &ProgressiveParams) -> AnyImage {
    AnyImage::new(Progressive::encode(set, params, &mut Job::default()).unwrap())
}

/// A small root with three patches that overlap.
pub fn zipmap(set: &ImageSet, content: Content) -> AnyImage {
    zipmap_with(set, &ZipParams::default().with_content(content))
}

/// The same in blocks.
pub fn zipmap_blocks(set: &ImageSet) -> AnyImage {
    zipmap_with(set, &ZipParams::default().with_goal(Goal::Psnr(30.0)))
}

fn zipmap_with(set: &ImageSet, params: &ZipParams) -> AnyImage {
    let params = params.clone().with_tau(0.05).with_effort(Effort::Fast);
    let stack = stack(&set.images()[0], texfold_testkit::image("cutout"));
    AnyImage::new(Zipmap::encode(&stack, &params, &mut Job::default()).unwrap())
}

/// A root with three patches of one image, which overlap.
pub fn stack(root: &Raster, image: Raster) -> PatchStack {
    let patch = |(x, y, zoom, turn): (f64, f64, f64, f64)| PatchSource {
        image: 0,
        matrix: texfold_testkit::leaves::close_up((x, y).into(), zoom, turn, (0.1, 0.0).into()),
        mask: None,
        parent: None,
    };
    let patches = [(0.5, 0.5, 1.5, 0.3), (0.6, 0.4, 3.0, -0.5), (0.1, 0.9, 2.0, 0.0)].map(patch).to_vec();
    PatchStack { root: root.clone(), images: vec![image], patches }
}

/// One texture of each kind, small enough to be damaged ten thousand times, each made once.
pub fn small_textures() -> &'static [(String, ImageSet, AnyImage)] {
    static TEXTURES: OnceLock<Vec<(String, ImageSet, AnyImage)>> = OnceLock::new();
    TEXTURES.get_or_init(make_small_textures)
}

/// The small texture of that name.
pub fn small_texture(name: &str) -> &'static AnyImage {
    &small_textures().iter().find(|texture| texture.0 == name).expect("a small texture").2
}

fn make_small_textures() -> Vec<(String, ImageSet, AnyImage)> {
    let odd = fixture("odd_37x61");
    let ripple = texfold_testkit::frames("ripple");
    let mut textures = Vec::new();
    for content in [Content::Raw, Content::Bc1, Content::Bc7] {
        let params = VqParams::default()
            .with_codebook((32, 16))
            .with_samples((1, 12))
            .with_content(content)
            .with_mips(content == Content::Bc1)
            .with_effort(Effort::Fast);
        textures.push((format!("vq {}", content.name()), odd.clone(), vq(&odd, &params)));
        let params = BcParams::default().with_goal(Goal::Psnr(20.0)).with_content(content).with_mips(true);
        textures.push((format!("bc {}", content.name()), odd.clone(), bc(&odd, &params)));
    }
    let params = VqParams::default().with_codebook((64, 32)).with_effort(Effort::Fast);
    textures.push(("vq sequence".to_owned(), ripple.clone(), vq(&ripple, &params)));
    // BC1 and BC7 side by side, with mip levels; the same in layers; plain bytes; with a residual plane; two images that share content.
    let fast = EpitomeParams::new(Goal::Psnr(26.0)).with_effort(Effort::Fast);
    textures.push(("epitome, blocks".to_owned(), odd.clone(), epitome(&odd, &fast.clone().with_mips(true))));
    let fast = fast.with_access(Access::Texel);
    let params = fast.clone().with_mips(true);
    textures.push(("epitome mixed".to_owned(), odd.clone(), epitome(&odd, &params)));
    let params = params.with_layers(3);
    textures.push(("epitome layers".to_owned(), odd.clone(), epitome(&odd, &params)));
    let params = fast.clone().with_content(Content::Raw);
    textures.push(("epitome raw".to_owned(), odd.clone(), epitome(&odd, &params)));
    let params = fast.clone().with_family(Family::ErrorMap).with_mips(true);
    textures.push(("epitome errors".to_owned(), odd.clone(), epitome(&odd, &params)));
    let params = fast.with_content(Content::Bc1);
    textures.push(("epitome sequence".to_owned(), ripple.clone(), epitome(&ripple, &params)));
    // A base and a residual plane with mip levels; a set; a base alone.
    let fast = DctParams::default().with_goal(Goal::Psnr(32.0)).with_effort(Effort::Fast);
    for (name, set, mips) in [("mips", &odd, true), ("sequence", &ripple, false)] {
        let made = dct(set, &fast.clone().with_mips(mips));
        textures.push((format!("dct layers, {name}"), set.clone(), made));
    }
    let fast = ProgressiveParams::default().with_goal(Goal::Psnr(32.0)).with_effort(Effort::Fast);
    let params = fast.clone().with_mips(true);
    textures.push(("progressive layers".to_owned(), odd.clone(), progressive(&odd, &params)));
    let params = fast.clone().with_content(Content::Raw);
    textures.push(("progressive layers, sequence".to_owned(), ripple.clone(), progressive(&ripple, &params)));
    let params = fast.clone().with_goal(Goal::Bpp(0.8)).with_mips(true);
    textures.push(("progressive layers, enlarged".to_owned(), odd.clone(), progressive(&odd, &params)));
    // A tile of a larger image, which is the same all around.
    let tile = &odd.images()[0];
    let (size, more) = (tile.size(), texfold_progressive::APRON);
    let (width, height) = (size.width + 2 * more, size.height + 2 * more);
    let texels: Vec<_> =
        (0..width * height).map(|i| tile.texel(i % width % size.width, i / width % size.height)).collect();
    let around = Some(Raster::from_texels(width, height, tile.info(), &texels).unwrap());
    let shared = Shared { apron: around, ..Shared::default() };
    for (name, goal) in [("tile", fast.goal), ("enlarged tile", Goal::Bpp(0.8))] {
        let params = fast.clone().with_goal(goal).with_mips(true);
        let made = Progressive::encode_shared(&odd, &params, &shared, &mut Job::default()).unwrap();
        assert_eq!(made.shrink_log2() > 0, name != "tile");
        textures.push((format!("progressive layers, {name}"), odd.clone(), AnyImage::new(made)));
    }
    let params = fast.with_goal(Goal::Psnr(10.0));
    textures.push(("progressive base".to_owned(), odd.clone(), progressive(&odd, &params)));
    for content in [Content::Raw, Content::Bc7] {
        textures.push((format!("zipmap {}", content.name()), odd.clone(), zipmap(&odd, content)));
    }
    textures.push(("zipmap, blocks".to_owned(), odd.clone(), zipmap_blocks(&odd)));
    textures
}

/// Every codec of images with each of its ways to reach texels; those that have one only are named once.
pub fn ways() -> impl Iterator<Item = (&'static Encoding, Access)> {
    ENCODINGS.iter().flat_map(|encoding| encoding.accesses.iter().map(move |&access| (encoding, access)))
}

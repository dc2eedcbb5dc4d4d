//! What the tests of this crate share: an adapter, textures of all codecs, and the CPU's answer to a view.

#![allow(dead_code, unused_imports, reason = "each test file uses its own part")]
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

mod cases;
mod epitome;
mod host;
mod progressive;
mod residual;
mod twin;
mod zipmap;

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{IVec2, Vec2, Vec4};
use texfold_bc::{Bc, BcParams, Content};
use texfold_core::address::TEXFOLD_REPEAT;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, PixelInfo, Raster, srgb_to_linear};
use texfold_core::rng::Rng;
use texfold_core::{
    Budget, Effort, Encoder, GpuForm, ImageLayout, ImageSize, Job, Limits, Notes, TextureCodec,
};
use texfold_gpu::{AddressMode, Gpu, GpuError, GpuTexture, Lookup, Policy, View};
use texfold_vq::Vq;

pub(crate) use cases::{
    BLENDED, Case, PLACED, STORED, cases, epitome_case, error_mapped, layered_case, plane_bound, rounded,
    wide_cases,
};
pub(crate) use epitome::{Forge, epitome};
pub(crate) use host::{Function, Switches, answers, run};
pub(crate) use progressive::{Base, progressive};
pub(crate) use residual::{Edge, Residual};
pub(crate) use twin::{Call, Twin};
pub(crate) use zipmap::{zipmap, zipmap_blocks};

/// The adapter, or `None` with a printed line where there is none and none is required.
///
/// Tests take turns on two devices: software Vulkan compiles the shaders of one device on one core.
pub(crate) fn gpu() -> Option<&'static Gpu> {
    static GPUS: [OnceLock<Result<Gpu, GpuError>>; 2] = [const { OnceLock::new() }; 2];
    static NEXT: AtomicUsize = AtomicUsize::new(0);
    thread_local! { static TURN: usize = NEXT.fetch_add(1, Ordering::Relaxed) % GPUS.len(); }
    let policy = Policy::from_env();
    match GPUS[TURN.with(|turn| *turn)].get_or_init(|| Gpu::new(policy)) {
        Ok(gpu) => Some(gpu),
        Err(error) if policy == Policy::Require => panic!("TEXFOLD_GPU=require, but: {error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    }
}

/// Does `work` for each of `cases`, on two devices at a time.
pub(crate) fn on_two_devices(cases: &[Case], work: impl Fn(&Gpu, &Case) + Sync) {
    std::thread::scope(|scope| {
        for first in 0..2 {
            let work = &work;
            scope.spawn(move || {
                let Some(gpu) = gpu() else { return };
                cases.iter().skip(first).step_by(2).for_each(|case| work(gpu, case));
            });
        }
    });
}

/// An encoded texture with the CPU functions that its shader must equal.
pub(crate) struct Subject(Box<dyn Twin>);

impl Subject {
    pub(crate) fn new(twin: impl Twin + 'static) -> Self {
        Subject(Box::new(twin))
    }

    pub(crate) fn form(&self) -> GpuForm<'_> {
        self.0.encoded().gpu()
    }

    pub(crate) fn layout(&self) -> &ImageLayout {
        self.0.encoded().layout()
    }

    pub(crate) fn upload(&self, gpu: &Gpu) -> GpuTexture {
        gpu.upload(&self.form()).unwrap()
    }

    /// What a function gives on the CPU.
    pub(crate) fn call(&self, image: u32, mode: AddressMode, call: Call) -> Vec4 {
        self.0.call(image, number(mode), call)
    }

    /// Every pixel of a view, by the CPU.
    pub(crate) fn view(&self, view: &View, mode: AddressMode) -> Vec<Vec4> {
        let linear = matches!(view.lookup, Lookup::NearestLinear { .. });
        let pixel = |call| {
            let texel = self.call(view.image, mode, call);
            if linear { linear_light(texel) } else { texel }
        };
        calls_of(view).into_iter().map(pixel).collect()
    }
}

/// What each pixel of a view calls, row by row.
pub(crate) fn calls_of(view: &View) -> Vec<Call> {
    let (width, height) = view.size;
    let size = Vec2::new(width as f32, height as f32);
    let (dx, dy) = (view.uv.matrix2.x_axis / size.x, view.uv.matrix2.y_axis / size.y);
    let call = |x: u32, y: u32| {
        let at = (Vec2::new(x as f32, y as f32) + 0.5) / size;
        let uv = view.uv.translation + view.uv.matrix2.x_axis * at.x + view.uv.matrix2.y_axis * at.y;
        match view.lookup {
            Lookup::Fetch { level } => Call::Fetch { at: IVec2::new(x as i32, y as i32), level },
            Lookup::Nearest { level } | Lookup::NearestLinear { level } => Call::Nearest { uv, level },
            Lookup::Bilinear { level } => Call::Bilinear { uv, level },
            Lookup::Level { lod } => Call::Level { uv, lod },
            Lookup::Derivative => Call::Grad { uv, dx, dy },
        }
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| call(x, y)).collect()
}

fn number(mode: AddressMode) -> u32 {
    match mode {
        AddressMode::Repeat => TEXFOLD_REPEAT,
        AddressMode::Clamp => texfold_core::address::TEXFOLD_CLAMP,
    }
}

fn linear_light(texel: Vec4) -> Vec4 {
    Vec4::new(srgb_to_linear(texel.x), srgb_to_linear(texel.y), srgb_to_linear(texel.z), texel.w)
}

/// The fixture of that name.
pub(crate) fn image(name: &str) -> Raster {
    let color = if name == "normal_map" { ColorSpace::Normal } else { ColorSpace::Srgb };
    texfold_testkit::image(name).tagged(color, Alpha::Straight)
}

/// Images through the plain codec with all mip levels.
pub(crate) fn bc(images: Vec<Raster>, content: Content, reduce_log2: u32) -> Subject {
    let params = BcParams::default()
        .with_content(content)
        .with_reduce_log2(reduce_log2)
        .with_mips(true)
        .with_effort(Effort::Fast);
    let source = ImageSet::new(images).unwrap();
    Subject::new(Bc::encode(&source, &params, &mut Job::new(Limits::default())).unwrap())
}

/// A vq texture with random indices into a random codebook of 64 x 128 texels, by way of its file format.
pub(crate) fn vq(sizes: &[(u32, u32)], levels: u32, channels: u8, content: Content) -> Subject {
    let (width, height) = (64, 128);
    let mut rng = Rng::new(u64::from(channels) + 10 * u64::from(levels));
    let alpha = if matches!(channels, 2 | 4) { Alpha::Straight } else { Alpha::Opaque };
    // Three channels in BC5 are normals.
    let color = if (channels, content) == (3, Content::Bc5) { ColorSpace::Normal } else { ColorSpace::Srgb };
    let pixel = PixelInfo { channels, depth: Depth::Eight, color, alpha };
    let images: Vec<_> = sizes.iter().map(|&(width, height)| ImageSize { width, height }).collect();
    let mut out = SectionWriter::new(Vq::ID);
    Notes::default().write(&mut out);
    let number = Content::ALL.iter().position(|&kind| kind == content).unwrap() as u8;
    // No free cells, no samples, a growth threshold of 0.0.
    let form: Vec<u8> = [width, height, 0, 0, 0u32].into_iter().flat_map(u32::to_le_bytes).collect();
    let planes = content.formats(pixel).0;
    let codebook: Vec<u8> =
        planes.iter().flat_map(|format| rng.bytes(format.bytes(width, height) as usize)).collect();
    let mut index = Vec::new();
    for size in &images {
        let blocks: u32 = (0..levels).map(|level| size.at_level(level).blocks()).map(|(x, y)| x * y).sum();
        for side in [width, height] {
            let values: Vec<u8> = (0..blocks).map(|_| rng.below(side - 3) as u8).collect();
            let before = std::iter::once(0).chain(values.iter().copied());
            index.extend(values.iter().zip(before).map(|(value, before)| value.wrapping_sub(before)));
        }
    }
    write_layout(&ImageLayout::new(images, levels, pixel), &mut out);
    out.section("container", *b"VQFM", &[vec![number], form].concat());
    out.section("codebook", *b"CODE", &codebook);
    out.section("index", *b"INDX", &index);
    let bytes = out.finish().bytes;
    let mut budget = Budget::default();
    let sections = Sections::parse(&bytes, &mut budget).unwrap();
    Subject::new(Vq::load(&sections, &mut budget).unwrap())
}

/// Fails where a channel of a texel differs by more than its bound; returns the largest difference.
pub(crate) fn assert_close(
    name: &str,
    found: &[[f32; 4]],
    wanted: &[Vec4],
    bound: impl Fn(usize) -> Vec4,
) -> f32 {
    assert_eq!(found.len(), wanted.len(), "{name}");
    let mut largest = 0f32;
    for (index, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let difference = (Vec4::from(*found) - *wanted).abs();
        let bound = bound(index);
        let is_close = difference.cmple(bound).all();
        assert!(is_close, "{name}, pixel {index}: GPU {found:?}, CPU {wanted}, which may differ by {bound}");
        largest = largest.max(difference.max_element());
    }
    largest
}

//! What the tests of this crate share: an adapter, textures of all codecs, and the CPU's answer to a view.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

mod epitome;
mod progressive;
mod zipmap;

use std::sync::OnceLock;

use glam::{IVec2, Vec2, Vec4};
use texfold_bc::{Bc, BcParams, BcTexture, Content};
use texfold_core::address::TEXFOLD_REPEAT;
use texfold_core::container::{SectionWriter, write_layout};
use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, PixelInfo, Raster, srgb_to_linear};
use texfold_core::rng::Rng;
use texfold_core::{
    Budget, Effort, Encoded, Encoder, GpuForm, ImageLayout, Job, Limits, Notes, SurfaceSize, TextureCodec,
};
use texfold_epitome::EpitomeTexture;
use texfold_gpu::{AddressMode, Gpu, GpuError, GpuTexture, Lookup, Policy, View};
use texfold_progressive::ProgressiveTexture;
use texfold_testkit::fixtures::{Picture, pictures};
use texfold_vq::{Vq, VqTexture};
use texfold_zipmap::ZipTexture;

pub(crate) use epitome::{Forge, epitome};
pub(crate) use progressive::{Base, progressive};
pub(crate) use zipmap::zipmap;

/// The adapter, or `None` with a printed line where there is none and none is required.
pub(crate) fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Result<Gpu, GpuError>> = OnceLock::new();
    let policy = Policy::from_env();
    match GPU.get_or_init(|| Gpu::new(policy)) {
        Ok(gpu) => Some(gpu),
        Err(error) if policy == Policy::Require => panic!("TEXFOLD_GPU=require, but: {error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    }
}

/// An encoded texture with the CPU functions that its shader must equal.
pub(crate) enum Subject {
    Bc(BcTexture),
    Vq(VqTexture),
    Epitome(EpitomeTexture),
    Progressive(ProgressiveTexture),
    Zipmap(ZipTexture),
}

impl Subject {
    pub(crate) fn form(&self) -> GpuForm<'_> {
        match self {
            Subject::Bc(texture) => texture.gpu(),
            Subject::Vq(texture) => texture.gpu(),
            Subject::Epitome(texture) => texture.gpu(),
            Subject::Progressive(texture) => texture.gpu(),
            Subject::Zipmap(texture) => texture.gpu(),
        }
    }

    pub(crate) fn layout(&self) -> &ImageLayout {
        match self {
            Subject::Bc(texture) => texture.layout(),
            Subject::Vq(texture) => texture.layout(),
            Subject::Epitome(texture) => texture.layout(),
            Subject::Progressive(texture) => texture.layout(),
            Subject::Zipmap(texture) => texture.layout(),
        }
    }

    pub(crate) fn upload(&self, gpu: &Gpu) -> GpuTexture {
        gpu.upload(&self.form()).unwrap()
    }

    /// Every pixel of a view, by the CPU.
    pub(crate) fn view(&self, view: &View, mode: AddressMode) -> Vec<Vec4> {
        let (width, height) = view.size;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        pixels.map(|(x, y)| self.pixel(view, mode, x, y)).collect()
    }

    fn pixel(&self, view: &View, mode: AddressMode, x: u32, y: u32) -> Vec4 {
        let size = Vec2::new(view.size.0 as f32, view.size.1 as f32);
        let at = (Vec2::new(x as f32, y as f32) + 0.5) / size;
        let uv = view.uv.translation + view.uv.matrix2.x_axis * at.x + view.uv.matrix2.y_axis * at.y;
        match view.lookup {
            Lookup::Fetch { level } => self.fetch(view.surface, IVec2::new(x as i32, y as i32), level),
            Lookup::Nearest { level } => self.nearest(view.surface, mode, uv, level),
            Lookup::NearestLinear { level } => linear(self.nearest(view.surface, mode, uv, level)),
            Lookup::Bilinear { level } => self.bilinear(view.surface, mode, uv, level),
            Lookup::Level { lod } => self.trilinear(view.surface, mode, uv, lod),
            Lookup::Derivative => {
                let (dx, dy) = (view.uv.matrix2.x_axis / size.x, view.uv.matrix2.y_axis / size.y);
                if let Subject::Zipmap(texture) = self {
                    // Patches are turned: what fits one of them does not follow from a level of the whole.
                    let view = zipmap_view(texture, mode);
                    return texfold_zipmap::decode::texfold_zipmap_sample_grad(&view, uv, dx, dy);
                }
                self.trilinear(view.surface, mode, uv, self.level(view.surface, dx, dy))
            }
        }
    }

    fn fetch(&self, surface: u32, at: IVec2, level: u32) -> Vec4 {
        match self {
            Subject::Bc(texture) => texfold_bc::decode::texfold_bc_fetch(&texture.view(surface), at, level),
            Subject::Vq(texture) => {
                let (view, place) = texture.view(surface);
                texfold_vq::decode::texfold_vq_fetch(&view, place, at, level)
            }
            Subject::Epitome(texture) => {
                texfold_epitome::decode::texfold_epitome_fetch(&texture.view(surface), at, level)
            }
            Subject::Progressive(texture) => {
                texfold_progressive::decode::texfold_progressive_fetch(&texture.view(surface), at, level)
            }
            Subject::Zipmap(texture) => {
                texfold_zipmap::decode::texfold_zipmap_fetch(&texture.view(), at, level)
            }
        }
    }

    fn nearest(&self, surface: u32, mode: AddressMode, uv: Vec2, level: u32) -> Vec4 {
        match self {
            Subject::Bc(texture) => {
                texfold_bc::decode::texfold_bc_nearest(&bc_view(texture, surface, mode), uv, level)
            }
            Subject::Vq(texture) => {
                let (view, place) = vq_view(texture, surface, mode);
                texfold_vq::decode::texfold_vq_nearest(&view, place, uv, level)
            }
            Subject::Epitome(texture) => {
                let view = epitome_view(texture, surface, mode);
                texfold_epitome::decode::texfold_epitome_nearest(&view, uv, level)
            }
            Subject::Progressive(texture) => {
                let view = progressive_view(texture, surface, mode);
                texfold_progressive::decode::texfold_progressive_nearest(&view, uv, level)
            }
            Subject::Zipmap(texture) => {
                texfold_zipmap::decode::texfold_zipmap_nearest(&zipmap_view(texture, mode), uv, level)
            }
        }
    }

    fn bilinear(&self, surface: u32, mode: AddressMode, uv: Vec2, level: u32) -> Vec4 {
        match self {
            Subject::Bc(texture) => {
                texfold_bc::decode::texfold_bc_bilinear(&bc_view(texture, surface, mode), uv, level)
            }
            Subject::Vq(texture) => {
                let (view, place) = vq_view(texture, surface, mode);
                texfold_vq::decode::texfold_vq_bilinear(&view, place, uv, level)
            }
            Subject::Epitome(texture) => {
                let view = epitome_view(texture, surface, mode);
                texfold_epitome::decode::texfold_epitome_bilinear(&view, uv, level)
            }
            Subject::Progressive(texture) => {
                let view = progressive_view(texture, surface, mode);
                texfold_progressive::decode::texfold_progressive_bilinear(&view, uv, level)
            }
            Subject::Zipmap(texture) => {
                texfold_zipmap::decode::texfold_zipmap_bilinear(&zipmap_view(texture, mode), uv, level)
            }
        }
    }

    fn trilinear(&self, surface: u32, mode: AddressMode, uv: Vec2, lod: f32) -> Vec4 {
        match self {
            Subject::Bc(texture) => {
                texfold_bc::decode::texfold_bc_sample_level(&bc_view(texture, surface, mode), uv, lod)
            }
            Subject::Vq(texture) => {
                let (view, place) = vq_view(texture, surface, mode);
                texfold_vq::decode::texfold_vq_sample_level(&view, place, uv, lod)
            }
            Subject::Epitome(texture) => {
                let view = epitome_view(texture, surface, mode);
                texfold_epitome::decode::texfold_epitome_sample_level(&view, uv, lod)
            }
            Subject::Progressive(texture) => {
                let view = progressive_view(texture, surface, mode);
                texfold_progressive::decode::texfold_progressive_sample_level(&view, uv, lod)
            }
            Subject::Zipmap(texture) => {
                texfold_zipmap::decode::texfold_zipmap_sample_level(&zipmap_view(texture, mode), uv, lod)
            }
        }
    }

    /// The mip level that suits such steps between pixels.
    pub(crate) fn level(&self, surface: u32, dx: Vec2, dy: Vec2) -> f32 {
        let size = match self {
            Subject::Bc(texture) => texture.view(surface).params.plane_size,
            Subject::Vq(texture) => texture.view(surface).0.params.size,
            Subject::Epitome(texture) => texture.view(surface).params.size,
            Subject::Progressive(texture) => texture.view(surface).params.size,
            Subject::Zipmap(texture) => texture.view().params.size,
        };
        texfold_core::address::texfold_level(dx, dy, size.into())
    }
}

fn number(mode: AddressMode) -> u32 {
    match mode {
        AddressMode::Repeat => TEXFOLD_REPEAT,
        AddressMode::Clamp => texfold_core::address::TEXFOLD_CLAMP,
    }
}

fn bc_view(texture: &BcTexture, surface: u32, mode: AddressMode) -> texfold_bc::decode::BcView<'_> {
    let mut view = texture.view(surface);
    view.params.address_mode = number(mode);
    view
}

fn vq_view(texture: &VqTexture, surface: u32, mode: AddressMode) -> (texfold_vq::decode::VqView<'_>, u32) {
    let (mut view, place) = texture.view(surface);
    view.params.address_mode = number(mode);
    (view, place)
}

fn epitome_view(
    texture: &EpitomeTexture,
    surface: u32,
    mode: AddressMode,
) -> texfold_epitome::decode::EpitomeView<'_> {
    let mut view = texture.view(surface);
    view.params.address_mode = number(mode);
    view
}

fn progressive_view(
    texture: &ProgressiveTexture,
    surface: u32,
    mode: AddressMode,
) -> texfold_progressive::decode::ProgressiveView<'_> {
    let mut view = texture.view(surface);
    view.params.address_mode = number(mode);
    view
}

fn zipmap_view(texture: &ZipTexture, mode: AddressMode) -> texfold_zipmap::decode::ZipmapView<'_> {
    let mut view = texture.view();
    view.params.address_mode = number(mode);
    view
}

fn linear(texel: Vec4) -> Vec4 {
    Vec4::new(srgb_to_linear(texel.x), srgb_to_linear(texel.y), srgb_to_linear(texel.z), texel.w)
}

/// The fixture of that name.
pub(crate) fn picture(name: &str) -> Raster {
    static PICTURES: OnceLock<Vec<Picture>> = OnceLock::new();
    let picture = PICTURES.get_or_init(pictures).iter().find(|picture| picture.name == name).unwrap();
    let color = if name == "normal_map" { ColorSpace::Normal } else { ColorSpace::Srgb };
    Raster::from_u8(picture.width, picture.height, picture.channels, color, &picture.data).unwrap()
}

/// Images through the plain codec with all mip levels.
pub(crate) fn bc(images: Vec<Raster>, content: Content, reduce_log2: u32) -> Subject {
    let params = BcParams {
        content: Some(content),
        reduce_log2: Some(reduce_log2),
        mips: true,
        effort: Effort::Fast,
        ..BcParams::default()
    };
    let source = ImageSet::new(images).unwrap();
    Subject::Bc(Bc::encode(&source, &params, &mut Job::new(Limits::default())).unwrap())
}

/// A vq texture with random inrngs into a random codebook of 64 x 128 texels, by way of its file format.
pub(crate) fn vq(sizes: &[(u32, u32)], levels: u32, channels: u8, content: Content) -> Subject {
    let (width, height) = (64, 128);
    let mut rng = Rng::new(u64::from(channels) + 10 * u64::from(levels));
    let alpha = if matches!(channels, 2 | 4) { Alpha::Straight } else { Alpha::Opaque };
    // Three channels in BC5 are normals.
    let color = if (channels, content) == (3, Content::Bc5) { ColorSpace::Normal } else { ColorSpace::Srgb };
    let pixel = PixelInfo { channels, depth: Depth::Eight, color, alpha };
    let surfaces: Vec<_> = sizes.iter().map(|&(width, height)| SurfaceSize { width, height }).collect();
    let mut out = SectionWriter::new(Vq::ID);
    Notes::default().write(&mut out);
    let number = Content::ALL.iter().position(|&kind| kind == content).unwrap() as u8;
    // No free cells, no samples, a growth threshold of 0.0.
    let form: Vec<u8> = [width, height, 0, 0, 0u32].into_iter().flat_map(u32::to_le_bytes).collect();
    let planes = content.formats(pixel).0;
    let codebook: Vec<u8> =
        planes.iter().flat_map(|format| rng.bytes(format.bytes(width, height) as usize)).collect();
    let mut index = Vec::new();
    for size in &surfaces {
        let blocks: u32 = (0..levels).map(|level| size.at_level(level).blocks()).map(|(x, y)| x * y).sum();
        for side in [width, height] {
            let values: Vec<u8> = (0..blocks).map(|_| rng.below(side - 3) as u8).collect();
            let before = std::iter::once(0).chain(values.iter().copied());
            index.extend(values.iter().zip(before).map(|(value, before)| value.wrapping_sub(before)));
        }
    }
    write_layout(&ImageLayout { surfaces, levels, pixel }, &mut out);
    out.section("container", *b"VQFM", &[vec![number], form].concat());
    out.section("codebook", *b"CODE", &codebook);
    out.section("index", *b"INDX", &index);
    let image = texfold::open_image(&out.finish().bytes, &mut Budget::default()).unwrap();
    Subject::Vq(image.downcast().unwrap())
}

/// Fails where a channel of a texel differs by more than its bound; returns the largest difference.
pub(crate) fn assert_close(name: &str, found: &[[f32; 4]], wanted: &[Vec4], bound: Vec4) -> f32 {
    assert_eq!(found.len(), wanted.len(), "{name}");
    let mut largest = 0f32;
    for (index, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let difference = (Vec4::from(*found) - *wanted).abs();
        assert!(difference.cmple(bound).all(), "{name}, pixel {index}: GPU {found:?}, CPU {wanted}");
        largest = largest.max(difference.max_element());
    }
    largest
}

//! A file that arrives in pieces: what is uploaded again is what changed, and the GPU draws what the CPU decodes after each piece.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{Case, Subject, Twin, assert_close, calls_of, gpu, image, layered_case};
use glam::{Mat2, Vec2, Vec4};
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::ImageSet;
use texfold_core::{Budget, Effort, Encoded, Encoder, Goal, Image2d, Job, LoadError, Refine, TextureCodec};
use texfold_dct::{Dct, DctParams};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};
use texfold_gpu::{AddressMode, Gpu, GpuError, GpuTexture, Lookup, Updated, View};
use texfold_progressive::{Progressive, ProgressiveParams};

fn file(texture: &dyn Encoded<Domain = Image2d>) -> Vec<u8> {
    let mut out = SectionWriter::new(texture.codec());
    texture.store(&mut out);
    out.finish().bytes
}

fn load<C: TextureCodec>(bytes: &[u8]) -> Result<C::Encoded, LoadError> {
    let mut budget = Budget::default();
    C::load(&Sections::parse(bytes, &mut budget)?, &mut budget)
}

/// The least length of a prefix that holds that many layers.
fn prefix<C: TextureCodec>(bytes: &[u8], layers: u32) -> usize
where
    C::Encoded: Encoded<Domain = Image2d>,
{
    let holds =
        |length: usize| load::<C>(&bytes[..length]).is_ok_and(|texture| texture.layers().loaded >= layers);
    let (mut low, mut high) = (0, bytes.len());
    while low < high {
        let middle = (low + high) / 2;
        if holds(middle) { high = middle } else { low = middle + 1 }
    }
    low
}

/// Compares every lookup of every image; the texture repeats.
fn compare(gpu: &Gpu, case: &Case, texture: &GpuTexture) {
    let askew = glam::Affine2 {
        matrix2: Mat2::from_cols(Vec2::new(2.125, 0.875), Vec2::new(-0.6875, 1.5625)),
        translation: Vec2::new(-0.6171875, -0.8671875),
    };
    let layout = case.subject.layout();
    let mode = AddressMode::Repeat;
    for (image, size) in (0..).zip(&layout.images) {
        let mut views = vec![View { image, size: (64, 64), uv: askew, lookup: Lookup::Level { lod: 0.75 } }];
        for level in 0..layout.levels {
            let size = size.at_level(level);
            views.push(View::whole(image, (size.width, size.height), Lookup::Fetch { level }));
        }
        for view in views {
            let calls = calls_of(&view);
            let wanted: Vec<Vec4> = calls.iter().map(|&call| case.subject.call(image, mode, call)).collect();
            let name = format!("{}, {:?}", case.name, view.lookup);
            let found = gpu.read_view(texture, &view).unwrap();
            assert_close(&name, &found, &wanted, |index| {
                case.bound(image, mode, calls[index], wanted[index])
            });
        }
    }
}

/// What each further layer of `bytes` needed; checks what is drawn after each.
fn arrive<C: TextureCodec>(gpu: &Gpu, bytes: &[u8], layers: u32) -> Vec<Updated>
where
    C::Encoded: Refine<Domain = Image2d> + Twin + Clone + 'static,
{
    let mut loaded = load::<C>(&bytes[..prefix::<C>(bytes, 1)]).unwrap();
    let mut texture = gpu.upload(&loaded.gpu()).unwrap().with_address_mode(AddressMode::Repeat);
    compare(gpu, &layered_case("first layer", Subject::new(loaded.clone())), &texture);
    let mut steps = Vec::new();
    for layer in 2..=layers {
        let length = prefix::<C>(bytes, layer);
        let mut budget = Budget::default();
        let sections = Sections::parse(&bytes[..length], &mut budget).unwrap();
        let changed = loaded.refine(&sections, &mut budget).unwrap();
        let updated = gpu.update(&mut texture, &loaded.gpu(), &changed).unwrap();
        compare(gpu, &layered_case(&format!("{layer} layers"), Subject::new(loaded.clone())), &texture);
        assert_eq!(8 * texture.bytes(), loaded.memory().compressed);
        assert!(updated.bytes <= texture.bytes(), "{updated:?}");
        steps.push(updated);
    }
    // Nothing new: only parameters are written.
    let uniforms = loaded.gpu().uniforms.len() as u64;
    let same = gpu.update(&mut texture, &loaded.gpu(), &[]).unwrap();
    assert_eq!(same, Updated { bytes: uniforms, rebound: false });
    steps
}

#[test]
fn a_layered_epitome_is_drawn_after_each_layer() {
    let Some(gpu) = gpu() else { return };
    let params =
        EpitomeParams::new(Goal::Psnr(28.0)).with_effort(Effort::Fast).with_mips(true).with_layers(3);
    let set = ImageSet::single(image("facade"));
    let whole = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    let steps = arrive::<Epitome>(gpu, &file(&whole), 3);
    // The map grows with each layer, and the coarse mip levels are never uploaded again.
    let form = whole.gpu();
    let mips: usize =
        form.planes.iter().filter(|plane| plane.part == "mips").map(|plane| plane.data.len()).sum();
    assert!(mips > 0);
    for step in &steps {
        assert!(step.rebound && 8 * (step.bytes + mips as u64) <= form.memory().compressed, "{step:?}");
    }
}

#[test]
fn a_progressive_file_is_drawn_before_and_after_its_residual() {
    let Some(gpu) = gpu() else { return };
    let params =
        ProgressiveParams::default().with_goal(Goal::Psnr(36.0)).with_effort(Effort::Fast).with_mips(true);
    let set = ImageSet::single(image("facade"));
    let whole = Progressive::encode(&set, &params, &mut Job::default()).unwrap();
    let steps = arrive::<Progressive>(gpu, &file(&whole), 2);
    // The base stays where it is.
    let base: usize =
        whole.gpu().planes.iter().filter(|plane| plane.part == "base").map(|plane| plane.data.len()).sum();
    assert!(base > 0);
    assert!(8 * (steps[0].bytes + base as u64) <= whole.memory().compressed, "{steps:?}");
}

#[test]
fn a_file_in_blocks_is_drawn_before_and_after_its_second_layer() {
    let Some(gpu) = gpu() else { return };
    let params = DctParams::default().with_goal(Goal::Bpp(1.0)).with_mips(true);
    let set = ImageSet::single(image("facade"));
    let whole = Dct::encode(&set, &params, &mut Job::default()).unwrap();
    let bytes = file(&whole);
    let mut loaded = load::<Dct>(&bytes[..prefix::<Dct>(&bytes, 1)]).unwrap();
    assert_eq!(loaded.layers().loaded, 1);
    let mut texture = gpu.upload(&loaded.gpu()).unwrap().with_address_mode(AddressMode::Repeat);
    compare_levels(gpu, &loaded, &texture);
    let mut budget = Budget::default();
    let changed = loaded.refine(&Sections::parse(&bytes, &mut budget).unwrap(), &mut budget).unwrap();
    assert_eq!(loaded, whole);
    assert!(gpu.update(&mut texture, &loaded.gpu(), &changed).unwrap().rebound);
    compare_levels(gpu, &whole, &texture);
}

/// Compares all texels of all levels, and texels beyond the edges of a texture that repeats.
fn compare_levels(gpu: &Gpu, texture: &dyn Encoded<Domain = Image2d>, uploaded: &GpuTexture) {
    let layout = texture.layout();
    for level in 0..layout.levels {
        let rect = layout.whole(0, level).unwrap();
        let mut wanted = vec![Vec4::ZERO; (rect.width * rect.height) as usize];
        texture.decode(rect, &mut wanted).unwrap();
        let view = View::whole(0, (rect.width, rect.height), Lookup::Fetch { level });
        let found = gpu.read_view(uploaded, &view).unwrap();
        assert_close(&format!("level {level}"), &found, &wanted, |_| Vec4::splat(1e-6));
    }
    let rect = layout.whole(0, 0).unwrap();
    let beyond = glam::Affine2::from_translation(Vec2::ONE);
    let view = View::whole(0, (rect.width, rect.height), Lookup::Nearest { level: 0 });
    let inside = gpu.read_view(uploaded, &view).unwrap();
    assert_eq!(gpu.read_view(uploaded, &View { uv: beyond, ..view }).unwrap(), inside);
}

#[test]
fn planes_of_the_same_size_are_written_in_place() {
    let Some(gpu) = gpu() else { return };
    let first = crate::support::vq(&[(37, 61)], 2, 3, texfold_bc::Content::Raw);
    let form = first.form();
    let mut texture = gpu.upload(&form).unwrap();
    let size = (37, 61);
    let draw =
        |texture: &GpuTexture| gpu.decode_rgba8(texture, 0, 0, size, texfold_gpu::Filter::Nearest).unwrap();
    let before = draw(&texture);
    let mut other = form.clone();
    for plane in &mut other.planes {
        if plane.part == "codebook" {
            plane.data.to_mut().iter_mut().for_each(|byte| *byte = 255 - *byte);
        }
    }
    // What is not named is not read again.
    let updated = gpu.update(&mut texture, &other, &["index"]).unwrap();
    assert!(!updated.rebound && draw(&texture) == before);
    let updated = gpu.update(&mut texture, &other, &["codebook"]).unwrap();
    assert!(!updated.rebound);
    assert!(draw(&texture).iter().zip(&before).all(|(new, old)| new[0] == 255 - old[0]));
    // What does not fit is refused, and the texture stays.
    let after = draw(&texture);
    let mut damaged = form.clone();
    damaged.planes[0].data.to_mut().pop();
    assert!(matches!(gpu.update(&mut texture, &damaged, &["index"]), Err(GpuError::Form { .. })));
    let mut strange = form.clone();
    strange.module = "bc";
    assert!(matches!(gpu.update(&mut texture, &strange, &[]), Err(GpuError::Form { .. })));
    assert!(draw(&texture) == after);
}

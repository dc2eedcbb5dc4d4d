//! CPU decoding on one core: whole images and single texels at random places.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec2;
use texfold::{AnyImage, Content, Effort, ImageAddress, Texel, epitome::EpitomeTexture};
use texfold_benches::{bc, dct, epitome, epitome_params, image_of, paper_params, progressive, vq};
use texfold_epitome::decode::texfold_epitome_bilinear;

const SIDE: u32 = 1024;
/// Random places a measurement.
const PLACES: u32 = 1 << 16;

fn textures() -> Vec<(String, AnyImage)> {
    let set = image_of(&texfold_testkit::image("terrain"), SIDE);
    let mut textures: Vec<(String, AnyImage)> = Vec::new();
    textures.extend(vq(&set, &paper_params()).map(|texture| ("vq".to_owned(), texture)));
    for (name, content) in [("epitome bc1", Some(Content::Bc1)), ("epitome bc1 and bc7", None)] {
        let texture = epitome(&set, &epitome_params(content));
        textures.extend(texture.map(|texture| (name.to_owned(), texture)));
    }
    for bpp in [0.89, 1.28, 2.0] {
        let of =
            [("progressive", progressive(&set, bpp, Effort::Fast)), ("dct", dct(&set, bpp, Effort::Fast))];
        for (name, texture) in of {
            textures.extend(texture.map(|texture| (format!("{name} {bpp} bpp"), texture)));
        }
    }
    for content in [Content::Bc1, Content::Bc7] {
        textures.extend(bc(&set, content).map(|texture| (format!("plain {}", content.name()), texture)));
    }
    textures
}

fn decode(c: &mut Criterion) {
    let textures = textures();
    let mut out = vec![0; 4 * (SIDE * SIDE) as usize];
    let Ok(one) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
    let mut group = c.benchmark_group("decode 1024x1024");
    group.sample_size(10).throughput(Throughput::Elements(u64::from(SIDE * SIDE)));
    for (name, texture) in &textures {
        let Some(rect) = texture.as_encoded().layout().whole(0, 0) else { continue };
        group.bench_function(name, |b| {
            b.iter(|| {
                one.install(|| texture.decode_rgba8(rect, black_box(&mut out), 4 * rect.width as usize))
            });
        });
    }
    group.finish();
    let mut group = c.benchmark_group("continuous 1024x1024");
    group.sample_size(10).throughput(Throughput::Elements(u64::from(SIDE * SIDE)));
    for (name, texture) in &textures {
        let Some(texture) = texture.downcast_ref::<EpitomeTexture>() else { continue };
        // A third of the sides, three pixels a texel; and one pixel a texel.
        for (extent, pixels) in [(1.0 / 3.0, "three pixels a texel"), (1.0, "one")] {
            let draw = || texture.draw(0, Vec2::splat(0.1), Vec2::splat(extent), (SIDE, SIDE));
            group.bench_function(format!("{name}, {pixels}"), |b| {
                b.iter(|| one.install(|| black_box(draw())));
            });
        }
        let view = texture.view(0);
        let place = |i: u32| Vec2::new((i % SIDE) as f32, (i / SIDE) as f32) / (3 * SIDE) as f32 + 0.1;
        let slowly = || (0..SIDE * SIDE).map(|i| texfold_epitome_bilinear(&view, place(i), 0)).sum::<Texel>();
        group.bench_function(format!("{name}, place by place"), |b| b.iter(|| black_box(slowly())));
    }
    group.finish();
    let mut group = c.benchmark_group("random texels");
    group.sample_size(10).throughput(Throughput::Elements(u64::from(PLACES)));
    for (name, texture) in &textures {
        let texture = texture.as_encoded();
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut state = 1u32;
                let mut sum = Texel::ZERO;
                for _ in 0..PLACES {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let (x, y) = (state >> 22, (state >> 12) & (SIDE - 1));
                    sum += texture.texel(ImageAddress { image: 0, level: 0, x, y });
                }
                black_box(sum)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, decode);
criterion_main!(benches);

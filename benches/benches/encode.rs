//! Encoding: time of a whole encode of a 512x512 image.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use texfold::{Content, Effort, Goal, vq::VqParams};
use texfold_benches::{bc, dct, epitome, epitome_params, image_512, paper_params, progressive, vq};

fn encode(c: &mut Criterion) {
    let set = image_512();
    let mut group = c.benchmark_group("encode 512x512");
    group.sample_size(10).throughput(Throughput::Elements(set.texel_count()));
    group.bench_function("vq, codebook 1/16, one sample", |b| b.iter(|| vq(&set, &paper_params())));
    let fast = paper_params().with_effort(Effort::Fast);
    group.bench_function("vq, the same, fast", |b| b.iter(|| vq(&set, &fast)));
    let goal = VqParams::default().with_goal(Goal::Bpp(2.5));
    group.bench_function("vq, 2.5 bits a texel", |b| b.iter(|| vq(&set, &goal)));
    for effort in [Effort::Fast, Effort::Normal] {
        group.bench_function(format!("progressive, 2.7 bpp, {effort:?}"), |b| {
            b.iter(|| progressive(&set, 2.7, effort));
        });
        group.bench_function(format!("dct, 2.7 bpp, {effort:?}"), |b| b.iter(|| dct(&set, 2.7, effort)));
    }
    let fast = epitome_params(None);
    group.bench_function("epitome, 32 dB, fast", |b| b.iter(|| epitome(&set, &fast)));
    let normal = epitome_params(None).with_effort(Effort::Normal);
    group.bench_function("epitome, 32 dB", |b| b.iter(|| epitome(&set, &normal)));
    group.bench_function("saliency", |b| b.iter(|| texfold_vq::saliency_map(&set.images()[0])));
    for content in [Content::Bc1, Content::Bc7] {
        group.bench_function(format!("plain {}, fast", content.name()), |b| b.iter(|| bc(&set, content)));
    }
    group.finish();
}

criterion_group!(benches, encode);
criterion_main!(benches);

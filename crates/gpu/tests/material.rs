//! Textures of several codecs in one pipeline show what each shows alone.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]
#![expect(
    clippy::duplicate_mod,
    reason = "the example and the other tests' support each draw without a window"
)]

#[path = "../examples/material.rs"]
#[expect(dead_code, reason = "the example draws to a file, the test compares")]
mod example;

use crate::support::{bc, gpu, image, vq};
use texfold_bc::Content;
use texfold_gpu::{GpuError, Layer};

#[test]
fn six_textures_of_four_codecs_share_one_pipeline() {
    let Some(gpu) = gpu() else { return };
    let (largest, images) = example::differences(gpu).unwrap();
    // The same arithmetic, perhaps in another order of instructions: a value between two bytes may be rounded the other way.
    assert!(largest <= 1, "{largest} of 255");
    assert_eq!(images.len(), 7);
    for (number, image) in images.iter().enumerate() {
        for other in &images[..number] {
            let apart =
                image.as_flattened().iter().zip(other.as_flattened()).filter(|(a, b)| a.abs_diff(**b) > 8);
            assert!(apart.count() > 1000, "image {number} shows another texture");
        }
    }
}

#[test]
fn what_cannot_be_bound_together_is_refused_by_name() {
    let Some(gpu) = gpu() else { return };
    let first = vq(&[(8, 8)], 1, 3, Content::Raw).upload(gpu);
    let second = bc(vec![image("odd_3x5")], Content::Raw, 0).upload(gpu);
    let layer = |prefix, texture, image| Layer { prefix, texture, image };
    let refused = gpu.material(0, &[layer("a", &first, 0), layer("a", &second, 0)]);
    assert!(matches!(refused, Err(GpuError::Paste(_))));
    let refused = gpu.material(0, &[layer("A", &first, 0)]);
    assert!(matches!(refused, Err(GpuError::Paste(_))));
    let refused = gpu.material(0, &[layer("a", &first, 0), layer("b", &second, 1)]);
    assert!(matches!(refused, Err(GpuError::NoSuchImage { image: 1, images: 1 })));
    let bound = gpu.material(0, &[layer("a", &first, 0), layer("b", &second, 0)]).unwrap();
    assert!(bound.wgsl().contains("fn b_sample(uv: vec2<f32>)"));
    assert_eq!(bound.places(), [0, 0]);
    assert_eq!(bound.constants(), [("B_REDUCED", 0.0)]);
}

//! Light fields on a GPU show what the CPU reference shows.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

#[expect(dead_code, unused_imports, reason = "the tests of images use the rest")]
mod support;

use glam::{Mat4, Vec3};
use support::gpu;
use texfold_bc::Content;
use texfold_core::{Encoded, Encoder, Job};
use texfold_gpu::GpuError;
use texfold_lightfield::{
    Camera, Directions, Factors, FitMethod, LightModel, LightParams, LightTexture, Lightfield, Renderer,
};
use texfold_testkit::capture::{Look, camera, eyes, sphere};

fn encoded(content: Content, directions: Directions, factors: Factors, codewords: f32) -> LightTexture {
    let fit = if directions == Directions::World {
        FitMethod::Shared { regions: 24 }
    } else {
        FitMethod::Scattered
    };
    let model = LightModel::default().with_fit(fit).with_directions(directions).with_factors(factors);
    let params = LightParams::default()
        .with_terms(2)
        .with_content(content)
        .with_model(model)
        .with_codewords(codewords);
    Lightfield::encode(&sphere(Look::Glossy, 24, 48), &params, &mut Job::default()).unwrap()
}

fn projection(texture: &LightTexture, camera: &Camera) -> Mat4 {
    let (near, far) = texture.mesh().depths(camera);
    camera.view_projection(near, far)
}

#[test]
fn drawn_pixels_are_those_of_the_reference() {
    let Some(gpu) = gpu() else { return };
    for (content, directions, factors, codewords) in [
        (Content::Raw, Directions::Reflected, Factors::Signed, 1.0),
        (Content::Raw, Directions::View, Factors::NonNegative, 0.3),
        (Content::Bc1, Directions::Reflected, Factors::Signed, 0.3),
        (Content::Bc7, Directions::Reflected, Factors::NonNegative, 1.0),
        (Content::Raw, Directions::World, Factors::Signed, 1.0),
    ] {
        let whole = encoded(content, directions, factors, codewords);
        for terms in [0, 1, 2] {
            let texture = whole.clone().first_terms(terms);
            let light = gpu.upload_light(&whole.gpu()).unwrap().with_terms(terms);
            assert_eq!(8 * light.bytes(), whole.footprint().bits_memory());
            let renderer = Renderer::new(&texture);
            for eye in eyes(4, 3.0, 0.7) {
                let camera = camera(eye, 90);
                let found = gpu.draw_light(&light, projection(&texture, &camera), eye, (90, 90)).unwrap();
                let wanted = renderer.render(&camera);
                let (mut sum, mut shared, mut apart) = (0u32, 0u32, 0u32);
                for (found, wanted) in found.iter().zip(&wanted) {
                    if found[3] != wanted[3] {
                        apart += 1;
                    } else if found[3] > 0 {
                        shared += 3;
                        sum += (0..3).map(|c| u32::from(found[c].abs_diff(wanted[c]))).sum::<u32>();
                    }
                }
                let mean = f64::from(sum) / f64::from(shared);
                assert!(shared > 3 * 3000 && apart < 8, "{content:?}: {shared} values, {apart} apart");
                // Hardware may round BC1 by up to 2 of 255.
                let bound = if content == Content::Bc1 { 1.0 } else { 0.2 };
                assert!(mean < bound, "{content:?} {directions:?} {terms} terms: {mean} of 255");
            }
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_by_name() {
    let Some(gpu) = gpu() else { return };
    let texture = encoded(Content::Raw, Directions::Reflected, Factors::Signed, 1.0);
    let light = gpu.upload_light(&texture.gpu()).unwrap();
    let draw = |size| gpu.draw_light(&light, Mat4::IDENTITY, Vec3::ZERO, size);
    assert!(matches!(draw((0, 8)), Err(GpuError::PictureSize { width: 0, .. })));
    let mut form = texture.gpu();
    assert!(matches!(gpu.upload(&form), Err(GpuError::Form { .. })));
    form.surfaces[0].planes.pop();
    assert!(matches!(gpu.upload_light(&form), Err(GpuError::Form { .. })));
    form.module = "bc";
    assert!(matches!(gpu.upload_light(&form), Err(GpuError::UnknownModule { module: "bc" })));
}

//! Light fields on a GPU show what the CPU reference shows.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

#[path = "../examples/light.rs"]
#[allow(dead_code, reason = "the example's main")]
#[expect(clippy::duplicate_mod, reason = "examples and tests each draw without a window")]
mod example;

use crate::support::{BLENDED, Function, assert_close, gpu, rounded, run};
use glam::{Mat4, Vec3, Vec4};
use texfold_bc::Content;
use texfold_core::{Access, Encoded, Encoder, Job};
use texfold_gpu::GpuError;
use texfold_lightfield::decode::{
    LightfieldView, texfold_lightfield_sample, texfold_lightfield_scales, texfold_lightfield_triangle,
    texfold_lightfield_vertex, texfold_lightfield_word,
};
use texfold_lightfield::{
    Camera, Directions, Factors, FitMethod, LightModel, LightParams, LightTexture, Lightfield, Renderer,
};
use texfold_testkit::capture::{Look, camera, eyes, sphere};

/// What a pixel may differ by, in steps of 8 bits: one for rounding on either side, and one for where the pixel lies: rasters
/// place corners to 1/256 of a pixel, some 0.01 texels of a map here.
const PIXEL: u8 = 2;
/// As above, where hardware may round each texel by 2.
const PIXEL_BC1: u8 = 8;

fn encoded(
    content: Option<Content>,
    directions: Directions,
    factors: Factors,
    codewords: f32,
) -> LightTexture {
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

/// Textures of every kind of direction, content and sharing; without a content in blocks.
fn textures() -> Vec<(Option<Content>, LightTexture)> {
    [
        (Some(Content::Raw), Directions::Reflected, Factors::Signed, 1.0),
        (Some(Content::Raw), Directions::View, Factors::NonNegative, 0.3),
        (Some(Content::Bc1), Directions::Reflected, Factors::Signed, 0.3),
        (Some(Content::Bc7), Directions::Reflected, Factors::NonNegative, 1.0),
        (Some(Content::Raw), Directions::World, Factors::Signed, 1.0),
        (None, Directions::Reflected, Factors::Signed, 1.0),
        (None, Directions::World, Factors::NonNegative, 0.5),
    ]
    .into_iter()
    .map(|(content, directions, factors, codewords)| {
        (content, encoded(content, directions, factors, codewords))
    })
    .collect()
}

/// What all maps of a triangle add by at most where each of their texels is off by `steps` of 8 bits: a product of a surface and a view
/// map, both within -1 and 1, changes by what either does, times its scale.
fn products(view: &LightfieldView<'_>, triangle: u32, steps: f32) -> f32 {
    let first = texfold_lightfield_triangle(view, triangle);
    let scale = |corner: u32| {
        let own = texfold_lightfield_vertex(view, texfold_lightfield_word(view, first + corner)) + 6;
        let of = |term: u32| {
            texfold_lightfield_scales(texfold_lightfield_word(view, own + 2 * term)).max_element()
        };
        (0..view.params.terms).map(of).sum::<f32>()
    };
    2.0 * steps / view.params.map_range * (0..3).map(scale).sum::<f32>()
}

/// Places on all triangles and directions to look from, none of them computed: both sides start from the same bits.
fn arguments(triangles: u32) -> Vec<(u32, Vec3, Vec3)> {
    let directions = [
        Vec3::new(0.6, 0.0, 0.8),
        Vec3::new(-0.48, 0.6, 0.64),
        Vec3::new(0.0, -1.0, 0.0),
        Vec3::new(-0.36, -0.48, -0.8),
    ];
    let place = |k: u32| {
        let x = k % 16;
        let y = k / 16 % (17 - x);
        Vec3::new((16 - x - y) as f32, x as f32, y as f32) / 16.0
    };
    let of = |triangle: u32| {
        (0..48).map(move |k| (triangle, place(k * 5 + triangle), directions[(k % 4) as usize]))
    };
    (0..triangles).flat_map(of).collect()
}

#[test]
fn the_shader_gives_what_the_cpu_gives_for_the_same_arguments() {
    let Some(gpu) = gpu() else { return };
    for (content, whole) in textures() {
        let light = gpu.upload_light(&whole.gpu()).unwrap();
        let view = whole.view();
        let calls = arguments(view.params.triangles);
        let function = Function {
            module: texfold_shaders::module(whole.gpu().module).unwrap(),
            body: "return texfold_lightfield_sample(u32(a.x), a.yzw, b.xyz);".to_owned(),
            off: Vec::new(),
        };
        let inputs: Vec<_> = calls
            .iter()
            .map(|(triangle, at, towards)| {
                [[*triangle as f32, at.x, at.y, at.z], [towards.x, towards.y, towards.z, 0.0]]
            })
            .collect();
        let found = run(gpu, &function, light.bind_group(), &inputs);
        let wanted: Vec<Vec4> = calls
            .iter()
            .map(|&(triangle, at, towards)| texfold_lightfield_sample(&view, triangle, at, towards))
            .collect();
        let steps = if content == Some(Content::Bc1) { 255.0 * rounded() } else { 0.0 };
        let bound = |index: usize| {
            // Where in a view map of up to 32 texels a direction lies follows from some ten roundings of 2^-23 and two roots: 4e-5
            // texels; a map changes by 2 from texel to texel at most.
            let placed = products(&view, calls[index].0, 4e-5 * view.params.map_range);
            Vec4::splat(steps / 255.0 + products(&view, calls[index].0, steps) + placed + BLENDED)
        };
        let largest = assert_close(&format!("{content:?}, {:?}", view.params), &found, &wanted, bound);
        println!("{content:?}: {largest:e}");
    }
}

#[test]
fn drawn_pixels_are_those_of_the_reference() {
    let Some(gpu) = gpu() else { return };
    for (content, whole) in textures() {
        for terms in [0, 1, 2] {
            let texture = whole.clone().first_terms(terms);
            let light = gpu.upload_light(&whole.gpu()).unwrap().with_terms(terms);
            assert_eq!(whole.access(), if content.is_some() { Access::Texel } else { Access::Block });
            assert_eq!(8 * light.bytes(), whole.footprint().bits_resident);
            let renderer = Renderer::new(&texture);
            for eye in eyes(4, 3.0, 0.7) {
                let camera = camera(eye, 90);
                let found = gpu.draw_light(&light, projection(&texture, &camera), eye, (90, 90)).unwrap();
                let wanted = renderer.render(&camera);
                let bound = if content == Some(Content::Bc1) { PIXEL_BC1 } else { PIXEL };
                let (mut largest, mut shared, mut apart) = (0, 0, 0);
                for (found, wanted) in found.iter().zip(&wanted) {
                    let difference = (0..3).map(|c| found[c].abs_diff(wanted[c])).fold(0, u8::max);
                    if found[3] != wanted[3] || difference > bound {
                        apart += 1;
                    } else if found[3] > 0 {
                        shared += 1;
                        largest = difference.max(largest);
                    }
                }
                let name = format!("{content:?} {terms} terms");
                println!("{name}: {largest} of 255");
                // Where two triangles meet, at the silhouette above all, the raster may draw one and the ray hit the other.
                assert!(
                    shared > 3000 && apart < 8,
                    "{name}: {shared} pixels, {apart} differ by more than {bound}"
                );
            }
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_by_name() {
    let Some(gpu) = gpu() else { return };
    let texture = encoded(Some(Content::Raw), Directions::Reflected, Factors::Signed, 1.0);
    let light = gpu.upload_light(&texture.gpu()).unwrap();
    let draw = |size| gpu.draw_light(&light, Mat4::IDENTITY, Vec3::ZERO, size);
    assert!(matches!(draw((0, 8)), Err(GpuError::ImageSize { width: 0, .. })));
    let mut form = texture.gpu();
    assert!(matches!(gpu.upload(&form), Err(GpuError::Form { .. })));
    form.images[0].planes.pop();
    assert!(matches!(gpu.upload_light(&form), Err(GpuError::Form { .. })));
    form.module = "bc";
    assert!(matches!(gpu.upload_light(&form), Err(GpuError::Form { .. })));
    form.module = "none";
    assert!(matches!(gpu.upload_light(&form), Err(GpuError::UnknownModule { module: "none" })));
}

#[test]
fn light_fields_share_a_scene_with_plain_textures() {
    let Some(gpu) = gpu() else { return };
    let (largest, compared) = example::check(gpu).unwrap();
    assert!(largest <= PIXEL && compared > 10_000, "{largest} of {compared} pixels");
}

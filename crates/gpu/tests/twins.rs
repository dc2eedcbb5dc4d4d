//! GPU equals CPU: every shader function against its twin, through this crate's own pipelines and as a renderer pastes it.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::HashSet;
use std::sync::Mutex;

use crate::support::{
    BLENDED, Call, Case, Forge, STORED, Switches, answers, assert_close, bc, calls_of, cases, epitome_case,
    gpu, on_two_devices, vq, wide_cases,
};
use glam::{Affine2, IVec2, Mat2, Vec2, Vec4};
use texfold_bc::Content;
use texfold_core::ImageSize;
use texfold_core::image::{ColorSpace, Raster};
use texfold_gpu::{AddressMode, Filter, Gpu, GpuTexture, Lookup, View};
use texfold_shaders::{Slot, image_modules};

const MODES: [AddressMode; 2] = [AddressMode::Repeat, AddressMode::Clamp];

/// Columns and rows of the views: powers of two, so that divisions by them are exact.
const SIZE: (u32, u32) = (32, 16);

/// Turned, squeezed and beyond all four edges: in sixteenths, so that every pixel's coordinates are exact.
fn askew() -> Affine2 {
    Affine2 {
        matrix2: Mat2::from_cols(Vec2::new(2.125, 0.875), Vec2::new(-0.6875, 1.5625)),
        translation: Vec2::new(-0.6171875, -0.8671875),
    }
}

/// Fails where a pixel that the GPU found differs from the CPU's by more than the case allows; returns the largest difference.
fn check(case: &Case, name: &str, image: u32, mode: AddressMode, calls: &[Call], found: &[[f32; 4]]) -> f32 {
    let wanted: Vec<Vec4> = calls.iter().map(|&call| case.subject.call(image, mode, call)).collect();
    let name = format!("{}, image {image}, {mode:?}, {name}", case.name);
    assert_close(&name, found, &wanted, |index| {
        let bound = case.bound(image, mode, calls[index], wanted[index]);
        bound + case.cut_off(found[index][3], wanted[index].w)
    })
}

/// Draws a view through this crate's pipelines and compares it.
fn draw(gpu: &Gpu, case: &Case, texture: &GpuTexture, mode: AddressMode, view: &View) -> f32 {
    let found = gpu.read_view(texture, view).unwrap();
    let name = format!("{:?} {:?}", view.uv, view.lookup);
    check(case, &name, view.image, mode, &calls_of(view), &found)
}

/// Calls functions as a renderer pastes them, and compares the results.
fn call(
    (gpu, switches): (&Gpu, Switches),
    case: &Case,
    texture: &GpuTexture,
    image: u32,
    mode: AddressMode,
    calls: &[Call],
) {
    let found = answers(gpu, texture, image, switches, calls);
    check(case, &format!("pasted, switches {switches:?}"), image, mode, calls, &found);
}

/// The cases that this crate's own pipelines draw: all in full runs, otherwise the first of each module and set of switches, which
/// is the first of each pipeline. The functions that these pipelines call are compared for every case as a renderer pastes them, and
/// for these cases with every switch on.
fn drawn_cases(gpu: &Gpu) -> Vec<&'static Case> {
    let mut known = HashSet::new();
    let mut is_new = |case: &&Case| {
        let texture = case.subject.upload(gpu);
        let constants = texture.constants(&Slot::new(texture.module(), 0, 0));
        known.insert(format!("{} {constants:?}", texture.module().name)) || texfold_testkit::full()
    };
    cases().iter().filter(|case| is_new(case)).collect()
}

/// Draws every lookup of every image with both address modes.
fn draw_all(case: &Case, lookups: &[Lookup]) {
    let Some(gpu) = gpu() else { return };
    let mut largest = 0f32;
    for mode in MODES {
        let texture = case.subject.upload(gpu).with_address_mode(mode);
        for image in 0..texture.images() as u32 {
            for &lookup in lookups {
                let view = View { image, size: SIZE, uv: askew(), lookup };
                largest = largest.max(draw(gpu, case, &texture, mode, &view));
            }
        }
    }
    println!("{}: {largest:e}", case.name);
}

#[test]
fn every_module_of_images_has_a_case() {
    for module in image_modules() {
        let found = cases().iter().any(|case| case.subject.form().module == module.name);
        assert!(found, "no case draws module {}", module.name);
        for switch in module.switches {
            // Modules that share functions share their constants: it is on in a case of one of them.
            let needed = |case: &Case| {
                let form = case.subject.form();
                let own = texfold_shaders::module(form.module).into_iter().flat_map(|module| module.switches);
                let own = own.filter(|own| own.constant == switch.constant);
                let is_on = |own: &texfold_shaders::Switch| {
                    form.images.iter().any(|image| own.is_needed(&form.uniforms[image.uniforms.clone()]))
                };
                own.into_iter().any(is_on)
            };
            assert!(cases().iter().any(needed), "{} is never on", switch.constant);
        }
    }
}

#[test]
fn own_pipelines_fetch_the_texels_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for case in drawn_cases(gpu) {
        let texture = case.subject.upload(gpu);
        let layout = case.subject.layout();
        for (image, size) in (0..).zip(&layout.images) {
            for level in 0..layout.levels {
                let size = size.at_level(level);
                // Wider and higher than the level: what lies outside is the nearest texel inside.
                let fetch = View::whole(image, (size.width + 3, size.height + 2), Lookup::Fetch { level });
                draw(gpu, case, &texture, AddressMode::Clamp, &fetch);
            }
            let size = (size.width, size.height);
            let found = gpu.decode(&texture, image, 0, size, Filter::Nearest).unwrap();
            let fetch = View::whole(image, size, Lookup::Fetch { level: 0 });
            check(case, "decoded", image, AddressMode::Clamp, &calls_of(&fetch), &found);
        }
    }
}

#[test]
fn own_pipelines_wrap_clamp_and_blend_as_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for case in drawn_cases(gpu) {
        let levels = case.subject.layout().levels;
        // Single texels are fetched by another test, and each lookup is a pipeline.
        if texfold_testkit::full() {
            draw_all(case, &(0..levels).map(|level| Lookup::Nearest { level }).collect::<Vec<_>>());
        }
        draw_all(case, &(0..levels).map(|level| Lookup::Bilinear { level }).collect::<Vec<_>>());
    }
}

#[test]
fn own_pipelines_blend_levels_as_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let lods = [-1.5, 0.0, 0.3, 1.0, 2.75, 4.999, 40.0, 1e30, -1e30, f32::MAX, -0.0];
    for case in drawn_cases(gpu) {
        draw_all(case, &lods.map(|lod| Lookup::Level { lod }));
    }
}

#[test]
fn derivatives_choose_the_level_that_the_cpu_computes() {
    let Some(gpu) = gpu() else { return };
    let mut drawn = HashSet::new();
    for case in cases() {
        let form = case.subject.form();
        // A case with mip levels of each module, and one that is stored smaller than it is.
        let reduced = texfold_shaders::module(form.module).is_some_and(|module| {
            let params = &form.uniforms[form.images[0].uniforms.clone()];
            module.may_be_reduced && module.switches[0].is_needed(params)
        });
        if case.subject.layout().levels < 2 || !drawn.insert((form.module, reduced)) {
            continue;
        }
        for mode in MODES {
            let texture = case.subject.upload(gpu).with_address_mode(mode);
            let image = texture.images() as u32 - 1;
            // The last of them longer than wide, so that a pixel of a zipmap is the mean of several.
            for zoom in [0.125, 1.0, 8.0].map(Vec2::splat).into_iter().chain([Vec2::new(0.125, 1.0)]) {
                let scaled = Affine2::from_scale(zoom) * askew();
                let uv =
                    Affine2 { translation: Vec2::splat(0.5) - scaled.matrix2 * Vec2::splat(0.5), ..scaled };
                let view = View { image, size: SIZE, uv, lookup: Lookup::Derivative };
                draw(gpu, case, &texture, mode, &view);
            }
        }
    }
    let modules = image_modules().map(|module| module.name);
    for wanted in modules.map(|name| (name, false)).chain([("bc", true), ("progressive", true)]) {
        assert!(drawn.contains(&wanted), "{wanted:?} is not drawn by derivatives");
    }
}

/// Calls of the functions that take coordinates and read one level, at some places. Those that blend two levels call these twice, and
/// this crate's pipelines draw them: with every switch on a software renderer compiles them for a minute.
fn calls_at(places: &[Vec2], levels: u32) -> Vec<Call> {
    let of = |&uv: &Vec2| {
        (0..levels.min(3)).flat_map(move |level| [Call::Nearest { uv, level }, Call::Bilinear { uv, level }])
    };
    places.iter().flat_map(of).collect()
}

/// Every texel of every level, and some around it: what lies outside is the nearest texel inside.
fn fetches(case: &Case, image: u32) -> Vec<Call> {
    let layout = case.subject.layout();
    let of = |level: u32| {
        let size = layout.images[image as usize].at_level(level);
        calls_of(&View::whole(image, (size.width + 3, size.height + 2), Lookup::Fetch { level }))
    };
    (0..layout.levels).flat_map(of).collect()
}

/// Quarters of texels from one texel before the image to one behind it, along both diagonals; none where sides are no powers of two:
/// edges and centres of texels are then no exact coordinates.
fn edges(size: ImageSize) -> Vec<Vec2> {
    if !(size.width.is_power_of_two() && size.height.is_power_of_two() && size.width * size.height > 64) {
        return Vec::new();
    }
    let side = Vec2::new(size.width as f32, size.height as f32);
    let place = |k: i32| {
        let at = |side: u32| (k % (4 * side as i32 + 8)) as f32 * 0.25;
        let at = Vec2::new(at(size.width), at(size.height));
        [at / side, Vec2::new(at.x, size.height as f32 - at.y) / side]
    };
    (-4..=(4 * size.width.max(size.height) as i32 + 4)).flat_map(place).collect()
}

/// Coordinates of any size.
fn any_numbers() -> Vec<Vec2> {
    let numbers = [1e9, -1e9, 1e30, -1e30, 3e9, 0.3, -1e-30, f32::MAX, 0.0, 1.0];
    numbers.iter().flat_map(|&x| numbers.iter().map(move |&y| Vec2::new(x, y))).collect()
}

#[test]
fn pasted_shaders_give_the_texels_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let view = View { image: 0, size: SIZE, uv: askew(), lookup: Lookup::Bilinear { level: 0 } };
    let place = |call: &Call| if let Call::Bilinear { uv, .. } = call { *uv } else { Vec2::ZERO };
    let inside: Vec<Vec2> = calls_of(&view).iter().map(place).chain(any_numbers()).collect();
    let with_all: Vec<&Case> = drawn_cases(gpu);
    let with_edges = Mutex::new(HashSet::new());
    on_two_devices(cases(), |gpu, case| {
        let is_one = with_all.iter().any(|one| std::ptr::eq(*one, case));
        let switches = if is_one { Switches::On } else { Switches::Needed };
        let layout = case.subject.layout();
        for mode in MODES {
            let texture = case.subject.upload(gpu).with_address_mode(mode);
            for (image, &size) in (0..).zip(&layout.images) {
                let edges = edges(size);
                if !edges.is_empty() {
                    with_edges.lock().unwrap().insert(case.subject.form().module);
                }
                let mut calls = calls_at(&[inside.as_slice(), &edges].concat(), layout.levels);
                if mode == AddressMode::Clamp {
                    calls.extend(fetches(case, image));
                }
                call((gpu, switches), case, &texture, image, mode, &calls);
            }
        }
    });
    for module in ["bc", "vq", "epitome", "progressive"] {
        let found = with_edges.lock().unwrap().contains(module);
        assert!(found, "no texture of {module} has sides that are powers of two");
    }
}

#[test]
fn the_cpu_gives_a_colour_for_any_coordinate_and_level() {
    // Shaders may do as they like with these; the CPU gives some colour of the image.
    let odd = [f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
    for case in cases() {
        for (x, lod) in odd.into_iter().flat_map(|x| odd.map(|lod| (x, lod))) {
            let uv = Vec2::new(x, -x);
            for call in
                [Call::Nearest { uv, level: 0 }, Call::Bilinear { uv, level: 0 }, Call::Level { uv, lod }]
            {
                let found = case.subject.call(0, AddressMode::Repeat, call);
                assert!(found.is_finite(), "{}, {call:?}", case.name);
            }
        }
    }
}

#[test]
fn textures_of_8192_texels_a_side_are_drawn_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for case in wide_cases() {
        let size = case.subject.layout().images[0];
        assert_eq!((size.width, size.height), (8192, 8));
        // Eighths of texels around both ends, the middle, and the borders of blocks.
        let near = [0, 8192, 4096, 8160, 4095]
            .map(|column| (0..64).map(move |k| column as f32 + (k - 32) as f32 * 0.125));
        let place = |x: f32| [0.375, 3.5, 7.875].map(|y| Vec2::new(x / 8192.0, y / 8.0));
        let places: Vec<Vec2> = near.into_iter().flatten().flat_map(place).collect();
        for mode in MODES {
            let texture = case.subject.upload(gpu).with_address_mode(mode);
            let columns = [0, 1, 4095, 4096, 8184, 8191, 9000];
            let fetch = columns
                .iter()
                .flat_map(|&x| (0..8).map(move |y| Call::Fetch { at: IVec2::new(x, y), level: 0 }));
            let calls: Vec<Call> =
                calls_at(&places, case.subject.layout().levels).into_iter().chain(fetch).collect();
            call((gpu, Switches::On), &case, &texture, 0, mode, &calls);
        }
    }
}

#[test]
fn srgb_becomes_linear_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let ramp: Vec<u8> = (0..=255).collect();
    let image = Raster::from_u8(256, 1, 1, ColorSpace::Srgb, &ramp).unwrap();
    let subject = bc(vec![image], Content::Raw, 0);
    let texture = subject.upload(gpu);
    let view = View::whole(0, (256, 1), Lookup::NearestLinear { level: 0 });
    let wanted = subject.view(&view, AddressMode::Clamp);
    let found = gpu.read_view(&texture, &view).unwrap();
    // A power is a logarithm good to 2^-21, times 2.4, and what raising 2 to it adds.
    assert_close("ramp", &found, &wanted, |_| Vec4::splat(BLENDED));
}

#[test]
fn a_long_sequence_fills_several_columns_of_the_index_plane() {
    let Some(gpu) = gpu() else { return };
    let subject = vq(&[(40, 40); 1000], 1, 3, Content::Raw);
    assert!(subject.form().planes.iter().any(|plane| plane.part == "index" && plane.width > 10));
    let texture = subject.upload(gpu);
    for image in [0, 1, 2, 818, 819, 999] {
        let view = View::whole(image, (40, 40), Lookup::Nearest { level: 0 });
        let wanted = subject.view(&view, AddressMode::Clamp);
        let found = gpu.read_view(&texture, &view).unwrap();
        assert_close(&format!("frame {image}"), &found, &wanted, |_| Vec4::splat(STORED));
    }
}

#[test]
fn a_long_map_has_longer_rows() {
    let Some(gpu) = gpu() else { return };
    let forge = Forge { sizes: &[(9, 9), (2999, 3001)], bits: [9, 9, 2, 8, 6], block: 4, ..Forge::default() };
    let case = epitome_case("long", Forge { split: false, ..forge });
    assert!(case.subject.form().planes[0].width > 64);
    let texture = case.subject.upload(gpu);
    for image in [0, 1] {
        let view = View { image, size: (64, 64), uv: askew(), lookup: Lookup::Nearest { level: 0 } };
        draw(gpu, &case, &texture, AddressMode::Clamp, &view);
    }
}

#[test]
fn the_footprint_counts_the_bytes_that_are_uploaded() {
    let Some(gpu) = gpu() else { return };
    for case in cases() {
        let form = case.subject.form();
        assert_eq!(8 * gpu.upload(&form).unwrap().bytes(), form.memory().resident, "{}", case.name);
    }
}

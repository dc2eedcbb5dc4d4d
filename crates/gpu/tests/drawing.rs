//! Images of any size, meshes, and what is refused.

use crate::support::{Base, Forge, Subject, assert_close, bc, epitome, gpu, image, progressive, vq, zipmap};
use glam::{Affine2, Mat4, Vec2, Vec3};
use texfold_bc::Content;
use texfold_core::mesh::UvMesh;
use texfold_gpu::{AddressMode, Filter, Gpu, GpuError, Lod, Lookup, Policy, Probe, View};

/// Two triangles that cover the whole image at the given depth and show the rectangle of the given corners.
fn sheet(depth: f32, low: Vec2, high: Vec2) -> UvMesh {
    let corner = |x: f32, y: f32| Vec3::new(x, y, depth);
    UvMesh {
        positions: vec![corner(-1.0, 1.0), corner(1.0, 1.0), corner(-1.0, -1.0), corner(1.0, -1.0)],
        uvs: vec![low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high],
        triangles: vec![[0, 1, 2], [2, 1, 3]],
    }
}

fn join(first: UvMesh, second: UvMesh) -> UvMesh {
    let offset = first.positions.len() as u32;
    UvMesh {
        positions: [first.positions, second.positions].concat(),
        uvs: [first.uvs, second.uvs].concat(),
        triangles: first
            .triangles
            .into_iter()
            .chain(second.triangles.iter().map(|t| t.map(|i| i + offset)))
            .collect(),
    }
}

fn largest_difference(a: &[[u8; 4]], b: &[[u8; 4]]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

#[test]
fn an_image_larger_than_a_tile_has_no_seams() {
    let Some(gpu) = gpu() else { return };
    let subject = vq(&[(37, 61)], 1, 3, Content::Raw);
    let texture = subject.upload(gpu).with_address_mode(AddressMode::Repeat);
    // The last pixels' coordinates, up to 20, are sums and quotients rounded by 2^-19 at most, four times on each axis; a step of one of
    // 37 or 61 texels changes a value by 1 at most.
    let place = glam::Vec4::splat(4.0 * (37.0 + 61.0) / (1 << 19) as f32);
    for size in [(2051, 3), (3, 4099)] {
        let uv = Affine2::from_scale(Vec2::new(20.0, 20.0));
        let view = View { image: 0, size, uv, lookup: Lookup::Bilinear { level: 0 } };
        let found = gpu.read_view(&texture, &view).unwrap();
        let wanted = subject.view(&view, AddressMode::Repeat);
        assert_close(&format!("{size:?}"), &found, &wanted, |_| place);
    }
}

#[test]
fn bytes_are_the_floats_rounded() {
    let Some(gpu) = gpu() else { return };
    let image = image("odd_37x61");
    let texture = bc(vec![image.clone()], Content::Raw, 0).upload(gpu);
    let bytes = gpu.decode_rgba8(&texture, 0, 0, (37, 61), Filter::Nearest).unwrap();
    let wanted: Vec<[u8; 4]> =
        image.texels().map(|texel| texel.to_array().map(texfold_core::image::to_u8)).collect();
    assert_eq!(bytes, wanted);
    let floats = gpu.decode(&texture, 0, 1, (50, 50), Filter::Bilinear).unwrap();
    let bytes = gpu.decode_rgba8(&texture, 0, 1, (50, 50), Filter::Bilinear).unwrap();
    let rounded: Vec<[u8; 4]> = floats.iter().map(|texel| texel.map(texfold_core::image::to_u8)).collect();
    // A value halfway between two bytes may go either way.
    assert!(largest_difference(&bytes, &rounded) <= 1);
}

#[test]
fn a_mesh_that_covers_the_image_shows_what_a_quad_shows() {
    let Some(gpu) = gpu() else { return };
    let texture =
        bc(vec![image("facade")], Content::Bc1, 0).upload(gpu).with_address_mode(AddressMode::Repeat);
    for scale in [0.4, 1.0, 5.0] {
        let mesh = sheet(0.5, Vec2::ZERO, Vec2::splat(scale));
        let drawn = gpu.draw_mesh(&texture, 0, &mesh, Mat4::IDENTITY, (96, 64)).unwrap();
        let uv = Affine2::from_scale(Vec2::splat(scale));
        let quad = gpu.draw_quad(&texture, 0, (96, 64), uv, Lod::Derivative).unwrap();
        // Interpolated coordinates differ in the last bits, and contrast turns them into a few steps.
        assert!(
            largest_difference(&drawn, &quad) <= 3,
            "scale {scale}: {}",
            largest_difference(&drawn, &quad)
        );
        let other = gpu.draw_quad(
            &texture,
            0,
            (96, 64),
            Affine2::from_translation(Vec2::splat(0.3)) * uv,
            Lod::Derivative,
        );
        assert!(largest_difference(&drawn, &other.unwrap()) > 30, "the comparison sees nothing");
    }
}

#[test]
fn the_nearer_triangle_hides_the_farther_in_either_order() {
    let Some(gpu) = gpu() else { return };
    let texture = bc(vec![image("facade")], Content::Raw, 0).upload(gpu);
    let near = || sheet(0.2, Vec2::ZERO, Vec2::ONE);
    let far = || sheet(0.8, Vec2::splat(0.5), Vec2::splat(0.6));
    let draw = |mesh: &UvMesh| gpu.draw_mesh(&texture, 0, mesh, Mat4::IDENTITY, (64, 64)).unwrap();
    let wanted = draw(&near());
    assert!(largest_difference(&wanted, &draw(&far())) > 30);
    assert_eq!(draw(&join(near(), far())), wanted);
    assert_eq!(draw(&join(far(), near())), wanted);
}

#[test]
fn what_does_not_exist_is_refused_by_name() {
    let Some(gpu) = gpu() else { return };
    let texture = bc(vec![image("odd_3x5")], Content::Raw, 0).upload(gpu);
    let decode = |image, level, size| gpu.decode(&texture, image, level, size, Filter::Nearest);
    assert!(matches!(decode(1, 0, (1, 1)), Err(GpuError::NoSuchImage { image: 1, images: 1 })));
    assert!(matches!(decode(0, 3, (1, 1)), Err(GpuError::NoSuchLevel { level: 3, levels: 3 })));
    assert!(matches!(decode(0, 0, (0, 1)), Err(GpuError::ImageSize { width: 0, height: 1, .. })));
    let mut mesh = sheet(0.5, Vec2::ZERO, Vec2::ONE);
    mesh.triangles[0][2] = 9;
    assert!(matches!(gpu.draw_mesh(&texture, 0, &mesh, Mat4::IDENTITY, (8, 8)), Err(GpuError::Mesh)));
    let whole = sheet(0.5, Vec2::ZERO, Vec2::ONE);
    let huge = gpu.draw_mesh(&texture, 0, &whole, Mat4::IDENTITY, (1 << 20, 8));
    assert!(matches!(huge, Err(GpuError::ImageSize { width: 0x10_0000, .. })));
}

#[test]
fn a_damaged_form_is_refused_by_name() {
    let Some(gpu) = gpu() else { return };
    let subject = bc(vec![image("odd_37x61")], Content::Bc1, 0);
    let mut form = subject.form();
    form.module = "none";
    assert!(matches!(gpu.upload(&form), Err(GpuError::UnknownModule { module: "none" })));
    let mut form = subject.form();
    form.images[0].planes.pop();
    assert!(matches!(gpu.upload(&form), Err(GpuError::Form { .. })));
    let mut form = subject.form();
    form.images[0].uniforms.end -= 4;
    assert!(matches!(gpu.upload(&form), Err(GpuError::Form { .. })));
    let mut form = subject.form();
    form.planes[0].data.to_mut().pop();
    assert!(matches!(gpu.upload(&form), Err(GpuError::Form { .. })));
    let mut form = subject.form();
    form.planes[0].width = 1 << 20;
    assert!(matches!(gpu.upload(&form), Err(GpuError::PlaneTooLarge { .. })));
}

#[test]
fn a_switched_off_gpu_says_so() {
    assert!(matches!(Gpu::new(Policy::Off), Err(GpuError::Off)));
}

#[test]
fn times_are_measured_for_all_three_shaders() {
    let Some(gpu) = gpu() else { return };
    let base = Base {
        sizes: &[(64, 64)],
        levels: 1,
        channels: 3,
        content: Content::Bc1,
        reduce_log2: 2,
        shrink_log2: 0,
        beyond: false,
        alpha_gain_log2: 0,
        class_bits: 16,
        books: None,
    };
    let zip = zipmap("odd_37x61", 3, Content::Raw, 3);
    let made =
        [Subject::new(epitome(&Forge::default())), Subject::new(progressive(&base)), Subject::new(zip)];
    for subject in made.into_iter().chain([vq(&[(64, 64)], 1, 3, Content::Raw)]) {
        let texture = subject.upload(gpu);
        for lookup in [Lookup::Nearest { level: 0 }, Lookup::Bilinear { level: 0 }] {
            let view = View::whole(0, (64, 64), lookup);
            for probe in [Probe::Lookup, Probe::LoadsOnly, Probe::Plain] {
                let seconds = gpu.time(&texture, &view, probe, 4).unwrap();
                assert!(seconds > 0.0 && seconds < 10.0, "{probe:?}: {seconds} s");
            }
        }
    }
}

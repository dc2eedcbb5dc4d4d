//! Textures on meshes, as cameras see them.

use std::fs;

use crate::support::{Place, fixture};

/// A box without top and bottom on a floor.
const ROOM: &str = "
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1.6 -1.2 1.6
v 1.6 -1.2 1.6
v 1.6 -1.2 -1.6
v -1.6 -1.2 -1.6
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vt 8 0
vt 8 8
vt 0 8
f 1/1 2/2 3/3 4/4
f 2/1 6/2 7/3 3/4
f 6/1 5/2 8/3 7/4
f 5/1 1/2 4/3 8/4
f 9/1 10/5 11/6 12/7
";

/// Of the pixels that either image draws the mesh in, the share whose values are within `steps` of 255.
fn alike(one: &image::RgbaImage, other: &image::RgbaImage, steps: u8) -> f64 {
    assert_eq!(one.dimensions(), other.dimensions());
    let pairs = one.pixels().zip(other.pixels()).filter(|(one, other)| one.0[3] > 0 || other.0[3] > 0);
    let near =
        |one: [u8; 4], other: [u8; 4]| one.iter().zip(other).all(|(one, other)| one.abs_diff(other) <= steps);
    let found: Vec<bool> = pairs.map(|(one, other)| near(one.0, other.0)).collect();
    assert!(6 * found.len() > one.pixels().len(), "the mesh is in {} pixels", found.len());
    found.iter().filter(|&&near| near).count() as f64 / found.len() as f64
}

#[test]
fn a_mesh_is_drawn_alike_by_gpu_and_cpu_with_every_codec_of_images() {
    let place = Place::new();
    fs::write(place.at("room.obj"), ROOM).unwrap();
    fs::copy(fixture("facade.png"), place.at("facade.png")).unwrap();
    for codec in ["dct", "bc", "vq"] {
        let (run, _) = place
            .compress(&format!("facade.png --codec {codec} --bpp 6 --mips --effort fast --out out --force"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        for (out, option) in [("gpu", ""), ("cpu", "--cpu")] {
            let run = place.run(&format!(
                "render out/facade.txf --mesh room.obj --turntable 3 --size 96x72 --out {out} {option}"
            ));
            assert_eq!(run.code, Some(0), "{}", run.stderr);
        }
        for number in 0..3 {
            let read =
                |out: &str| image::open(place.at(&format!("{out}/{number:03}.png"))).unwrap().to_rgba8();
            let (gpu, cpu) = (read("gpu"), read("cpu"));
            // Edges of triangles, and derivatives, which a GPU takes of two pixels at a time, differ.
            assert!(alike(&gpu, &cpu, 12) > 0.97, "{codec} {number}: {}", alike(&gpu, &cpu, 12));
            assert!(gpu.pixels().any(|pixel| pixel.0[3] == 0) && gpu.pixels().any(|pixel| pixel.0[3] == 255));
            // Another camera sees something else.
            let next = image::open(place.at(&format!("gpu/{:03}.png", (number + 1) % 3))).unwrap().to_rgba8();
            assert!(alike(&gpu, &next, 12) < 0.9);
        }
    }
}

#[test]
fn what_cannot_be_drawn_on_a_mesh_is_named() {
    let place = Place::new();
    fs::copy(fixture("odd_3x5.png"), place.at("odd_3x5.png")).unwrap();
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    fs::write(place.at("points.ply"), points).unwrap();
    let torn = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt nan 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    fs::write(place.at("torn.obj"), torn).unwrap();
    fs::write(place.at("room.obj"), ROOM).unwrap();
    let (run, _) = place.compress("odd_3x5.png --codec bc --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for (options, wanted) in [
        ("--mesh points.ply", "has no triangles"),
        ("--mesh torn.obj", "out of range"),
        ("--mesh none.obj", "none.obj"),
        ("--mesh room.obj --image 1", "image 1"),
        ("--turntable 3", "--mesh"),
        ("--mesh room.obj --terms 2", "--terms"),
    ] {
        let run = place.run(&format!("render out/odd_3x5.txf {options} --out drawn --cpu"));
        assert_ne!(run.code, Some(0), "{options}");
        assert!(run.stderr.contains(wanted), "{options}: {}", run.stderr);
    }
}

/// A ball shows each part of the image once, its left half in the half of longitudes that it belongs to, without a tear at the seam.
#[test]
fn a_mesh_without_texture_coordinates_is_given_some() {
    let place = Place::new();
    let [left, right] = [[250u8, 20, 20], [20, 20, 250]];
    let image = image::RgbImage::from_fn(64, 32, |x, _| image::Rgb(if x < 32 { left } else { right }));
    image.save(place.at("halves.png")).unwrap();
    let ball = fixture("../captures/ball/mesh.obj");
    let (run, _) = place.compress("halves.png --codec bc --content raw --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let run = place.run(&format!(
        "render out/halves.txf --mesh {} --turntable 8 --size 64x64 --out drawn --cpu",
        ball.display()
    ));
    assert!(run.code == Some(0) && run.stderr.contains("no texture coordinates are read"), "{}", run.stderr);
    let mut counts = [0usize; 2];
    for number in 0..8 {
        let drawn = image::open(place.at(&format!("drawn/{number:03}.png"))).unwrap().to_rgba8();
        for pixel in drawn.pixels().filter(|pixel| pixel.0[3] == 255) {
            // A colour between the two lies at a border alone.
            counts[0] += usize::from(pixel.0[0] > 200);
            counts[1] += usize::from(pixel.0[2] > 200);
        }
    }
    let [reds, blues] = counts;
    assert!(reds > 3000 && blues > 3000 && reds.abs_diff(blues) < reds / 10, "{counts:?}");
}

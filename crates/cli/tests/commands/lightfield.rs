//! Captures: from a folder to a file, and from the file to views.

use std::fs;

use serde_json::json;
use texfold_capture::{read_image, read_views};
use texfold_testkit::capture::{Look, camera, eyes, photograph, sphere};

use crate::support::{Place, names, psnr};

const SIZE: u32 = 40;

/// Writes photographs, their cameras and the mesh of a sphere.
fn write_capture(place: &Place, folder: &str) {
    let capture = sphere(Look::Glossy, 20, SIZE);
    fs::create_dir_all(place.at(folder).join("images")).unwrap();
    let mut frames = Vec::new();
    for (index, view) in capture.views.iter().enumerate() {
        let name = format!("images/{index:02}.png");
        let path = place.at(folder).join(&name);
        image::save_buffer(path, view.pixels.as_flattened(), SIZE, SIZE, image::ExtendedColorType::Rgba8)
            .unwrap();
        frames.push(json!({ "file_path": name, "transform_matrix": rows(view.camera.to_world) }));
    }
    let focal = capture.views[0].camera.focal.x;
    let cameras = json!({ "fl_x": focal, "fl_y": focal, "w": SIZE, "h": SIZE, "frames": frames });
    fs::write(place.at(folder).join("transforms.json"), cameras.to_string()).unwrap();
    let mut mesh = String::new();
    for p in &capture.mesh.positions {
        mesh += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    for [a, b, c] in &capture.mesh.triangles {
        mesh += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    fs::write(place.at(folder).join("mesh.obj"), mesh).unwrap();
}

fn rows(matrix: glam::Mat4) -> [[f32; 4]; 4] {
    matrix.transpose().to_cols_array_2d()
}

/// A file of two cameras that took no photograph, and what they would show.
fn write_cameras(place: &Place, name: &str) -> Vec<Vec<[u8; 4]>> {
    let mesh = sphere(Look::Glossy, 0, 1).mesh;
    let views: Vec<_> =
        eyes(2, 4.0, 2.0).into_iter().map(|eye| photograph(&mesh, Look::Glossy, camera(eye, SIZE))).collect();
    let frame = |view: &texfold::core::Photograph| json!({ "file_path": "none.png", "transform_matrix": rows(view.camera.to_world) });
    let frames: Vec<_> = views.iter().map(frame).collect();
    let focal = views[0].camera.focal.x;
    let cameras = json!({ "fl_x": focal, "w": SIZE, "h": SIZE, "frames": frames });
    fs::write(place.at(name), cameras.to_string()).unwrap();
    views.into_iter().map(|view| view.pixels).collect()
}

#[test]
fn a_capture_becomes_a_file_and_the_file_new_views() {
    let place = Place::new();
    write_capture(&place, "ball");
    let wanted = write_cameras(&place, "new.json");
    let (run, report) = place.compress("ball --codec lightfield --terms 1 --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let row = &report[0];
    assert_eq!((row["codec"].as_str(), row["images"].as_u64()), (Some("lightfield"), Some(20)));
    assert_eq!(row["bits_disk"].as_u64(), Some(8 * fs::metadata(place.at("out/ball.txf")).unwrap().len()));
    assert!(row["psnr"].as_f64().unwrap() > 38.0 && row["ssim"].as_f64().unwrap() > 0.9, "{row}");
    let parts: u64 =
        row["parts"].as_array().unwrap().iter().map(|part| part["bits_memory"].as_u64().unwrap()).sum();
    assert_eq!(Some(parts), row["bits_memory"].as_u64());
    let (again, _) = place.compress("ball --codec lightfield --terms 1 --out out");
    assert!(again.stdout.contains("1 up to date"), "{}", again.stdout);
    assert!(
        again.stdout.contains("dB for 4 of its views, ") && !again.stdout.contains("bpp"),
        "{}",
        again.stdout
    );

    // Photographs that are kept for tests are drawn instead of those that it was made from.
    let mut cameras: serde_json::Value =
        serde_json::from_slice(&fs::read(place.at("new.json")).unwrap()).unwrap();
    for (index, pixels) in wanted.iter().enumerate() {
        let name = format!("test-{index}.png");
        let path = place.at("ball").join(&name);
        image::save_buffer(path, pixels.as_flattened(), SIZE, SIZE, image::ExtendedColorType::Rgba8).unwrap();
        cameras["frames"][index]["file_path"] = name.into();
    }
    fs::write(place.at("ball/transforms_test.json"), cameras.to_string()).unwrap();
    let (run, report) = place.compress("ball --codec lightfield --terms 1 --out out");
    assert!(run.stdout.contains("dB for 2 new views, "), "{}", run.stdout);
    let views = &report[0]["views"];
    assert!(views["are_new"] == true && views["psnr"].as_f64().unwrap() > 30.0, "{views}");
    fs::write(place.at("ball/transforms_test.json"), "{").unwrap();
    let (run, report) = place.compress("ball --codec lightfield --terms 1 --out out");
    assert_eq!((run.code, &report[0]["views"]["are_new"]), (Some(0), &false.into()));
    assert!(run.stderr.contains("its views for tests are not compared: "), "{}", run.stderr);

    for (arguments, least) in [("--cpu", 30.0), ("--cpu --terms 0", 20.0), ("--cpu --size 40x40", 30.0)] {
        let run = place.run(&format!("render out/ball.txf --camera new.json --out views {arguments}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert_eq!(names(&place.at("views")), ["000.png", "001.png"]);
        for (index, wanted) in wanted.iter().enumerate() {
            let (width, height, samples) = place.samples(&format!("views/{index:03}.png"));
            assert_eq!((width, height, samples.len()), (SIZE, SIZE, 6400));
            let inner = |pixels: &[u8]| -> Vec<u8> {
                let shown = pixels.chunks_exact(4).zip(wanted).filter(|(_, wanted)| wanted[3] == 255);
                shown.flat_map(|(pixel, _)| pixel[..3].to_vec()).collect()
            };
            let found = psnr(&inner(&samples), &inner(wanted.as_flattened()));
            assert!(found > least, "{arguments}: {found}");
        }
    }
    let info = place.run("info out/ball.txf --json");
    let summary: serde_json::Value = serde_json::from_str(&info.stdout).unwrap();
    assert_eq!((summary["triangles"].as_u64(), summary["terms"].as_u64()), (Some(80), Some(1)));
    let pictures = place.run("info out/ball.txf --pictures parts");
    assert_eq!(pictures.code, Some(0), "{}", pictures.stderr);
    assert_eq!(
        names(&place.at("parts")),
        ["ball-mean.png", "ball-surface-maps.png", "ball-terms.png", "ball-view-maps.png"]
    );
    let seen = place.run("info out/ball.txf --camera ball/transforms.json --pictures parts");
    assert!(seen.code == Some(0) && seen.stdout.contains("view 19"), "{}{}", seen.stdout, seen.stderr);
    assert_eq!(names(&place.at("parts")).len(), 24);
    let (width, height, samples) = place.samples("parts/ball-view-003.png");
    assert_eq!((width, height, samples.len()), (3 * SIZE, SIZE, 9 * (SIZE * SIZE) as usize));
    let flat = place.run("decompress out/ball.txf --out png");
    assert!(flat.code == Some(1) && flat.stderr.contains("render"), "{}", flat.stderr);
}

#[test]
fn meshes_are_simplified_and_maps_shared_where_that_is_asked_for() {
    let place = Place::new();
    write_capture(&place, "ball");
    let size = |arguments: &str, triangles: usize| {
        let (run, report) = place
            .compress(&format!("ball --codec lightfield --terms 1 --access texel {arguments} --out out"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let summary = place.run("info out/ball.txf --json").stdout;
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        assert_eq!(summary["triangles"].as_u64(), Some(triangles as u64));
        (report[0]["bits_disk"].as_u64().unwrap(), report[0]["psnr"].as_f64().unwrap())
    };
    let whole = size("", 80);
    let (fewer, shared) = (size("--triangles 40", 40), size("--codewords 0.5", 80));
    assert!(
        fewer.0 < whole.0 && shared.0 < whole.0 * 7 / 10 && shared.1 > 25.0,
        "{whole:?} {fewer:?} {shared:?}"
    );
    let regions = size("--regions 1", 80);
    assert!(regions.0 < whole.0 && regions.1 > 38.0, "{whole:?} {regions:?}");
    let (only_adding, finer) = (size("--factors nonnegative", 80), size("--grid 32", 80));
    assert!(only_adding.1 != whole.1 && only_adding.1 > 30.0, "{whole:?} {only_adding:?}");
    assert!(finer.0 > whole.0, "{whole:?} {finer:?}");
    let wrong = place.run("compress ball --codec lightfield --grid 6 --out out");
    assert!(
        wrong.code == Some(1) && wrong.stderr.contains("grid is 6; allowed: multiples of 4"),
        "{}",
        wrong.stderr
    );
    let wrong = place.run("compress ball --codec lightfield --codewords 1.5 --out out");
    assert!(wrong.code == Some(1) && wrong.stderr.contains("codewords"), "{}", wrong.stderr);
    let misplaced = place.run("compress ball --as set --codec vq --codewords 0.5 --out out");
    assert!(misplaced.code == Some(2) && misplaced.stderr.contains("codewords"), "{}", misplaced.stderr);
}

#[test]
fn a_goal_is_reached_or_the_report_says_so() {
    let place = Place::new();
    write_capture(&place, "ball");
    let (_, low) = place.compress("ball --codec lightfield --psnr 20 --out out");
    assert!(low[0]["settings"].as_str().unwrap().contains("--terms 0 ") && low[0]["warnings"] == json!([]));
    let (run, high) = place.compress("ball --codec lightfield --psnr 90 --out out");
    assert!(run.code == Some(0) && high[0]["warnings"][0].as_str().unwrap().contains("90"), "{}", high[0]);
    for goal in ["bpp", "tolerance"] {
        let other = place.run(&format!("compress ball --{goal} 2 --out other"));
        assert!(other.code == Some(1) && other.stderr.contains(&format!("no --{goal}")), "{}", other.stderr);
    }
    assert!(!place.at("other/ball.txf").exists());
}

#[test]
fn models_of_colmap_and_tables_of_middlebury_are_captures() {
    let place = Place::new();
    write_capture(&place, "ball");
    let file = place.at("ball/transforms.json");
    let wanted = read_views(&file, None, read_image).unwrap();
    fs::remove_file(&file).unwrap();
    let focal = wanted[0].camera.focal.x;
    let lens = format!("1 SIMPLE_PINHOLE {SIZE} {SIZE} {focal} {0} {0}\n", SIZE / 2);
    fs::write(place.at("ball/cameras.txt"), lens).unwrap();
    let (mut images, mut table) = (String::new(), format!("{}\n", wanted.len()));
    for (index, view) in wanted.iter().enumerate() {
        let flipped = view.camera.to_world * glam::Mat4::from_scale(glam::vec3(1.0, -1.0, -1.0));
        let (_, turn, shift) = flipped.inverse().to_scale_rotation_translation();
        let [x, y, z, w] = turn.to_array();
        images +=
            &format!("{index} {w} {x} {y} {z} {} {} {} 1 {index:02}.png\n\n", shift.x, shift.y, shift.z);
        let centre = 0.5 * SIZE as f32 - 0.5;
        table += &format!("images/{index:02}.png {focal} 0 {centre} 0 {focal} {centre} 0 0 1");
        let by_rows = glam::Mat3::from_quat(turn).transpose().to_cols_array();
        let numbers = by_rows.into_iter().chain(shift.to_array()).map(|number| format!(" {number}"));
        table += &(numbers.collect::<String>() + "\n");
    }
    fs::write(place.at("ball/images.txt"), images).unwrap();
    for file in ["images.txt", "ball_par.txt"] {
        if file == "ball_par.txt" {
            fs::remove_file(place.at("ball/images.txt")).unwrap();
            fs::write(place.at("ball").join(file), &table).unwrap();
        }
        let found = read_views(&place.at("ball").join(file), None, read_image).unwrap();
        assert_eq!(found.len(), wanted.len());
        for (found, wanted) in found.iter().zip(&wanted) {
            assert!(found.camera.to_world.abs_diff_eq(wanted.camera.to_world, 1e-4), "{file}");
            assert!(found.camera.centre.abs_diff_eq(wanted.camera.centre, 1e-4), "{file}");
            assert!(found.pixels == wanted.pixels, "{file}");
        }
        let (run, report) = place.compress(&format!("ball --force --out out-{file}"));
        assert!(run.code == Some(0) && report[0]["codec"] == "lightfield", "{}", run.stderr);
    }
}

/// A pincushion lens draws farther out than a pinhole: its photograph undistorted shows the ball smaller.
#[test]
fn photographs_of_a_distorting_lens_are_undistorted() {
    let place = Place::new();
    write_capture(&place, "ball");
    let file = place.at("ball/transforms.json");
    let seen = || {
        let views = read_views(&file, None, read_image).unwrap();
        views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] > 0).count()
    };
    let before = seen();
    let mut cameras: serde_json::Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    cameras["k1"] = json!(2.0);
    fs::write(&file, cameras.to_string()).unwrap();
    assert!(0 < seen() && 5 * seen() < 4 * before, "{} of {before}", seen());
}

#[test]
fn faults_of_captures_are_named() {
    let place = Place::new();
    write_capture(&place, "ball");
    place.image("a.png", 16, 16, 3);
    let file = place.at("ball/transforms.json");
    let cameras = fs::read_to_string(&file).unwrap();
    let fault = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut changed: serde_json::Value = serde_json::from_str(&cameras).unwrap();
        change(&mut changed);
        fs::write(&file, changed.to_string()).unwrap();
        let (run, report) = place.compress("ball --out out");
        fs::write(&file, &cameras).unwrap();
        assert_eq!(run.code, Some(1));
        report[0]["error"].as_str().unwrap().to_owned()
    };
    for (error, wanted) in [
        (fault(&|c| c["frames"] = json!([])), "names no frame"),
        (fault(&|c| c["frames"] = json!(3)), "transforms.json"),
        (fault(&|c| c["camera_model"] = json!("EQUIRECTANGULAR")), "undistort the images first"),
        (fault(&|c| c["fl_x"] = json!(null)), "add fl_x"),
        (fault(&|c| c["w"] = json!(41)), "40x40 pixels where its camera has 41x40"),
        (fault(&|c| c["frames"][2]["file_path"] = json!("images/none.png")), "none.png"),
        (fault(&|c| c["frames"][2]["transform_matrix"][0] = json!([0, 0, 0, 0])), "frame 2"),
    ] {
        assert!(error.contains(wanted), "{error}");
    }
    for (arguments, wanted) in [
        ("ball --codec lightfield --mesh a.png", "none of OBJ, PLY"),
        ("ball --codec vq", "--as set"),
        ("a.png --codec lightfield", "is not a capture"),
        ("a.png --as lightfield", "is not a capture"),
    ] {
        let (run, report) = place.compress(&format!("{arguments} --out out"));
        let error = report[0]["error"].as_str().unwrap();
        assert!(run.code == Some(1) && error.contains(wanted), "{arguments}: {error}");
    }
    place.compress("a.png --out out");
    let image = place.run("render out/a.txf --camera ball/transforms.json --out views --cpu");
    assert!(image.code == Some(1) && image.stderr.contains("not a light field"), "{}", image.stderr);
}

#[test]
fn a_capture_is_compared_with_photographs_and_harmonics_on_views_that_none_has_seen() {
    let place = Place::new();
    let ball = texfold_testkit::fixtures_dir().join("captures/ball");
    let run = place.run(&format!("compare {} --out out", ball.display()));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let rows: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("out/results.json")).unwrap()).unwrap();
    let figures = |series: &str, name: &str| -> Vec<f64> {
        let of = rows.iter().filter(|row| row["series"] == series);
        of.map(|row| row[name].as_f64().unwrap()).collect()
    };
    let blended = figures("blend of three photographs", "psnr");
    let nearest = figures("nearest photograph", "psnr");
    assert_eq!((blended.len(), nearest.len()), (4, 4));
    // Of all photographs a blend is above the nearest one, and what codes them better is better.
    assert!(blended[3] > nearest[3] + 0.5 && blended[3] > blended[2], "{blended:?} {nearest:?}");
    let ours = figures("light field", "psnr");
    assert!(ours.is_sorted() && figures("light field", "bpp_disk").is_sorted(), "{ours:?}");
    assert!(ours[3] > figures("one colour a place, dct", "psnr")[0] + 1.0, "{ours:?}");
    // The ball shines: harmonics follow it no more than a little.
    let harmonics = figures("harmonics a vertex", "psnr");
    assert!(harmonics.len() == 3 && harmonics[2] > harmonics[0], "{harmonics:?}");
    let page = fs::read_to_string(place.at("out/report.html")).unwrap();
    assert!(page.contains("<h2>Captures</h2>") && page.contains("blend of three photographs = 100 %"));
}

//! Zoom stacks from folder to frames.

use std::fs;

use glam::{DMat3, DVec2};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};

use crate::support::Place;

const SIZE: (u32, u32) = (240, 200);

/// A root and a close-up of zoom 3, as PNG.
fn shots(place: &Place) -> DMat3 {
    let leaves = Leaves::new(3, 60_000);
    let close = close_up(DVec2::new(0.5, 0.45), 3.0, 0.2, DVec2::ZERO);
    fs::create_dir_all(place.at("wall")).unwrap();
    for (name, matrix, exposure) in [("a.png", close, 0.8), ("b.png", DMat3::IDENTITY, 1.0)] {
        let lens = Lens { exposure, noise: 0.005, seed: 1 };
        let raster = photograph(&leaves.view(&matrix, SIZE, 3), SIZE, lens);
        image::save_buffer(
            place.at("wall").join(name),
            &raster.to_bytes(),
            SIZE.0,
            SIZE.1,
            image::ExtendedColorType::Rgb8,
        )
        .unwrap();
    }
    close
}

#[test]
fn a_folder_becomes_a_texture_that_is_zoomed_into() {
    let place = Place::new();
    shots(&place);
    let (run, report) = place.compress("wall --as zoom --codec zipmap --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!((report[0]["codec"].as_str(), report[0]["images"].as_u64()), (Some("zipmap"), Some(2)));
    let parts = report[0]["parts"].as_array().unwrap();
    let sum = |key: &str| parts.iter().map(|part| part[key].as_u64().unwrap()).sum::<u64>();
    assert_eq!(Some(sum("bits_memory")), report[0]["bits_memory"].as_u64());
    assert_eq!(Some(sum("bits_disk")), report[0]["bits_disk"].as_u64());
    let psnr = report[0]["psnr"].as_f64().unwrap();
    let without = parts.iter().find_map(|part| part["psnr_without"].as_f64()).unwrap();
    assert!(psnr > without + 3.0, "{psnr} {without}");
    // The goal is about images that are merged.
    let merged = report[0]["psnr_merged"].as_f64().unwrap();
    assert!(merged >= 34.0 && report[0]["goal_met"] == true, "{}", report[0]);
    assert!(
        run.stdout.contains(&format!("{merged:7.2} dB for merged images, {psnr:.2} dB against")),
        "{}",
        run.stdout
    );
    let (run, report) = place.compress("wall --as zoom --bpp 0.001 --out least --force");
    assert_eq!(report[0]["goal_met"], false, "{}", run.stdout);
    assert!(run.stderr.contains("the goal of 0.001 bits per texel was missed"), "{}", run.stderr);
    let run = place.run("render out/wall.txf --zoom-to 0.5,0.45 --steps 3 --size 64x48 --out frames --cpu");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let sizes = ["000.png", "001.png", "002.png", "strip.png"]
        .map(|name| image::image_dimensions(place.at("frames").join(name)).unwrap());
    assert_eq!(sizes, [(64, 48), (64, 48), (64, 48), (96, 24)]);
    let info = place.run("info out/wall.txf");
    assert!(info.stdout.contains("1 patches on a root of 240x200"), "{}", info.stdout);
    let again = place.run("compress wall --as zoom --out out");
    assert!(again.stdout.contains("1 up to date"), "{}", again.stdout);
    // What else does not go with it.
    for arguments in ["out/wall.txf --out x", "out/wall.txf --zoom-to 0.5,0.5 --terms 1 --out x"] {
        let run = place.run(&format!("render {arguments}"));
        assert_eq!(run.code, Some(1), "{arguments}");
        assert!(run.stderr.contains("give --camera for a light field"), "{}", run.stderr);
    }
    let wrong = place.run("compress wall --as zoom --codec vq --out out");
    assert!(wrong.stderr.contains("is a zoom stack"), "{}", wrong.stderr);
}

#[test]
fn a_list_says_where_patches_lie() {
    let place = Place::new();
    let close = shots(&place);
    let rows = close.transpose().to_cols_array().map(|value| format!("{value:?}")).join(", ");
    let list = format!("root = 'b.png'\n[[patch]]\nimage = 'a.png'\nmatrix = [{rows}]\nparent = 'b.png'\n");
    fs::write(place.at("wall/zipmap.toml"), &list).unwrap();
    let (run, report) = place.compress("wall --content bc7 --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(
        report[0]["verdict"].as_str().unwrap().starts_with("1 patches on a root of 240x200, zoom up to 3.00")
    );
    let tuned = format!("tau = 2.5\nmerge = false\n{list}");
    fs::write(place.at("wall/zipmap.toml"), &tuned).unwrap();
    let (run, report) = place.compress("wall --content bc7 --out tuned");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(report[0]["settings"].as_str().unwrap().ends_with(", tau = 2.5, merge = false"), "{report:?}");
    assert!(fs::read(place.at("out/wall.txf")).unwrap() != fs::read(place.at("tuned/wall.txf")).unwrap());
    for (change, what) in [
        (tuned.replace("2.5", "-1.0"), "tau is -1; allowed: 0.001..=100"),
        (list.replace("matrix = [", "matrix = [1.0, "), "has 10 numbers"),
        (list.replace("parent = 'b.png'", "parent = 'c.png'"), "has parent c.png"),
        (list.replace("a.png", "none.png"), "none.png"),
        (list.replace("parent = 'b.png'", "parent = 'a.png'"), "lead in a circle"),
        (list.replace("root", "wurzel"), "the list of patches cannot be read"),
    ] {
        fs::write(place.at("wall/zipmap.toml"), change).unwrap();
        let (run, report) = place.compress("wall --out out");
        assert_eq!(run.code, Some(1), "{what}");
        let error = report[0]["error"].as_str().unwrap();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn maps_ride_along_with_a_stack_and_a_registration_can_be_written_by_hand() {
    let place = Place::new();
    shots(&place);
    assert_eq!(place.run("compress wall --as zoom --out out").code, Some(0));
    let list = fs::read_to_string(place.at("out/wall.zipmap.toml")).unwrap();
    assert!(list.contains("root = \"b.png\"") && list.contains("image = \"a.png\""), "{list}");
    // The same by hand: the same texture.
    fs::write(place.at("wall/zipmap.toml"), &list).unwrap();
    assert_eq!(place.run("compress wall --out again").code, Some(0));
    assert!(fs::read(place.at("out/wall.txf")).unwrap() == fs::read(place.at("again/wall.txf")).unwrap());
    // Heights at the places of the colours.
    fs::create_dir(place.at("heights")).unwrap();
    for name in ["a.png", "b.png"] {
        fs::copy(place.at("wall").join(name), place.at("heights").join(name)).unwrap();
    }
    let ride = "root = 'b.png'\nwith = '../wall'\n[[patch]]\nimage = 'a.png'\n";
    fs::write(place.at("heights/zipmap.toml"), ride).unwrap();
    let (run, report) = place.compress("heights --color linear --psnr 40 --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let verdict = report[0]["verdict"].as_str().unwrap();
    assert!(verdict.starts_with("By block: 1 patches on a root of 240x200, zoom up to 3.0"), "{verdict}");
    let up_to_date = place.run("compress heights --color linear --psnr 40 --out out");
    assert!(up_to_date.stdout.contains("1 up to date"), "{}", up_to_date.stdout);
    for (change, what) in [
        (format!("{ride}matrix = [1.0]\n"), "leave its matrix, mask and parent out"),
        (ride.replace("[[patch]]\nimage = 'a.png'\n", ""), "0 maps and masks for 1 patches"),
        (ride.replace("../wall", "../heights"), "goes with a third stack"),
        (format!("tau = 1.0\n{ride}"), "tau and merge are those of the stack that it goes with"),
        (format!("merge = true\n{ride}"), "tau and merge are those of the stack that it goes with"),
        (ride.replace("../wall", "../none"), "none"),
    ] {
        fs::write(place.at("heights/zipmap.toml"), change).unwrap();
        let (run, report) = place.compress("heights --out out");
        assert_eq!(run.code, Some(1), "{what}");
        let error = report[0]["error"].as_str().unwrap();
        assert!(error.contains(what), "{error}");
    }
    // What colours have changed makes their maps out of date.
    fs::write(place.at("heights/zipmap.toml"), ride).unwrap();
    fs::write(place.at("wall/zipmap.toml"), format!("# moved\n{list}")).unwrap();
    let changed = place.run("compress heights --color linear --psnr 40 --out out");
    assert!(changed.stdout.contains("1 written"), "{}", changed.stdout);
}

#[test]
fn files_outside_of_a_folder_are_read_only_when_asked_for() {
    let place = Place::new();
    shots(&place);
    fs::create_dir_all(place.at("wall/in")).unwrap();
    fs::copy(place.at("wall/b.png"), place.at("secret.png")).unwrap();
    let absolute = place.at("secret.png").display().to_string();
    for (name, is_inside) in [
        ("in/../b.png", true),
        ("./b.png", true),
        ("../secret.png", false),
        ("in/../../secret.png", false),
        (&absolute, false),
    ] {
        fs::write(place.at("wall/zipmap.toml"), format!("root = '{name}'\n")).unwrap();
        let run = place.run("compress wall --out out --force");
        assert_eq!(run.code, Some(i32::from(!is_inside)), "{name}: {}", run.stderr);
        if !is_inside {
            assert!(run.stderr.contains("lies outside of the folder; give --outside if"), "{}", run.stderr);
            let run = place.run("compress wall --out out --force --outside");
            assert_eq!(run.code, Some(0), "{name}: {}", run.stderr);
        }
    }
    // A folder beside it, as of heights that go with colours, is no way out of both.
    fs::create_dir_all(place.at("heights")).unwrap();
    fs::write(place.at("wall/zipmap.toml"), "root = '../secret.png'\n").unwrap();
    fs::copy(place.at("wall/b.png"), place.at("heights/b.png")).unwrap();
    fs::write(place.at("heights/zipmap.toml"), "root = 'b.png'\nwith = '../wall'\n").unwrap();
    let run = place.run("compress heights --out out --force");
    assert!(run.stderr.contains("lies outside of the folder"), "{}", run.stderr);
    // Nor is the folder above.
    fs::write(place.at("zipmap.toml"), "root = 'secret.png'\n").unwrap();
    fs::write(place.at("heights/zipmap.toml"), "root = '../secret.png'\nwith = '..'\n").unwrap();
    let run = place.run("compress heights --out out --force");
    assert!(run.stderr.contains("lies outside of the folder"), "{}", run.stderr);
}

#[test]
fn a_stack_is_compared_with_the_plain_texture_that_it_stands_for() {
    let place = Place::new();
    shots(&place);
    fs::write(place.at("few.toml"), "title = \"few\"\ncodecs = [\"dct\"]\nbpp = [0.25, 1.0]").unwrap();
    let run = place.run("compare wall --as zoom --suite few.toml --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let rows: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("out/results.json")).unwrap()).unwrap();
    // The root has 240x200 pixels, and the patch shows three times as many of them a side.
    assert!(rows.iter().all(|row| row["size"] == serde_json::json!([960, 800])), "{:?}", rows[0]["size"]);
    let figures = |series: &str, name: &str| -> Vec<f64> {
        let of = rows.iter().filter(|row| row["series"] == series);
        of.map(|row| row[name].as_f64().unwrap()).collect()
    };
    let [plain, stack] = ["dct", "zoom stack"].map(|series| figures(series, "psnr"));
    assert!(plain.len() == 2 && stack.len() == 4 && stack.is_sorted(), "{plain:?} {stack:?}");
    assert!(figures("zoom stack", "bpp_disk").is_sorted());
    // What a stack draws is near what its photographs show: no shift, no other exposure.
    assert!(stack[3] > 36.0, "{stack:?}");
}

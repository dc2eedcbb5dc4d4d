//! Maps of materials as one texture.

use std::fs;

use image::{ExtendedColorType, ImageBuffer, Luma, Rgb};
use serde_json::Value;

use crate::support::Place;

/// Two materials and a file that is none in a folder: gray stored as RGB, 16-bit height at half the size, normals in two conventions.
fn folder(place: &Place) {
    place.image("in/Wall_2K_Color.png", 64, 48, 3);
    place.image("in/Wall_2K_NormalGL.png", 64, 48, 3);
    place.image("in/Wall_2K_NormalDX.png", 64, 48, 3);
    place.image("in/preview.png", 8, 8, 3);
    let gray = ImageBuffer::from_fn(64, 48, |x, y| Rgb([((x * 3 + y) % 256) as u8; 3]));
    gray.save(place.at("in/Wall_2K_Roughness.png")).unwrap();
    let height = ImageBuffer::from_fn(32, 24, |x, y| Luma([(x * 1999 + y * 77) as u16]));
    height.save(place.at("in/Wall_2K_Displacement.png")).unwrap();
    place.image("in/floor_diff_1k.png", 32, 32, 4);
}

fn map<'r>(row: &'r Value, kind: &str) -> &'r Value {
    row["maps"].as_array().unwrap().iter().find(|map| map["kind"] == kind).unwrap()
}

#[test]
fn a_folder_of_maps_becomes_a_file_for_each_material_and_maps_again() {
    let place = Place::new();
    folder(&place);
    let (run, rows) = place.compress("in --as material --mips --weights normal=2 --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let of =
        |name: &str| rows.iter().find(|row| row["output"].as_str().is_some_and(|path| path.contains(name)));
    let (wall, floor) = (of("Wall_2K.txf").unwrap(), of("floor.txf").unwrap());
    assert_eq!((wall["images"].as_u64(), floor["images"].as_u64()), (Some(4), Some(1)));
    assert_eq!(wall["source_texels"].as_u64(), Some(64 * 48), "maps lie over one another");
    assert!(wall["psnr"].as_f64() >= Some(40.0) && wall["goal_met"] == true, "{wall}");
    let kinds: Vec<&str> =
        wall["maps"].as_array().unwrap().iter().map(|map| map["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["color", "normal", "roughness", "height"]);
    assert_eq!((&map(wall, "roughness")["channels"], &map(wall, "height")["width"]), (&1.into(), &32.into()));
    assert_eq!(
        (&map(wall, "color")["color"], &map(wall, "normal")["color"]),
        (&"srgb".into(), &"normal".into())
    );
    assert!(map(wall, "normal")["degrees"].as_f64() < Some(3.0));
    let left: Vec<&str> = rows
        .iter()
        .filter_map(|row| row["not_read"].as_array())
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    assert!(
        left.len() == 2 && left[0].ends_with("preview.png") && left[1].ends_with("Wall_2K_NormalDX.png"),
        "{left:?}"
    );

    let run = place.run("decompress out --out png");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let color = |name: &str| {
        let decoded = image::open(place.at(&format!("png/{name}.png"))).unwrap();
        (decoded.width(), ExtendedColorType::from(decoded.color()))
    };
    assert_eq!(color("Wall_2K_Color"), (64, ExtendedColorType::Rgb8));
    assert_eq!(color("Wall_2K_Roughness"), (64, ExtendedColorType::L8));
    assert_eq!(color("Wall_2K_Displacement"), (32, ExtendedColorType::L16));
    assert_eq!(color("floor_diff_1k"), (32, ExtendedColorType::Rgba8));
    let info: Value = serde_json::from_str(&place.run("info out/Wall_2K.txf --json").stdout).unwrap();
    assert_eq!((info["maps"][3]["kind"].as_str(), info["levels"].as_u64()), (Some("height"), Some(7)));
    assert!(info["settings"].as_str().unwrap().contains("--weights normal=2"), "{info}");
}

#[test]
fn maps_are_decoded_on_a_gpu_as_on_the_cpu() {
    let place = Place::new();
    folder(&place);
    place.compress("in --as material --bpp 8 --mips --out out");
    let run = place.run("decompress out/Wall_2K.txf --out gpu --gpu --lod 1");
    if run.code != Some(0) && std::env::var("TEXFOLD_GPU").as_deref() != Ok("require") {
        assert!(run.stderr.contains("GPU"), "{}", run.stderr);
        return;
    }
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    place.run("decompress out/Wall_2K.txf --out cpu --lod 1");
    let names = ["Wall_2K_Color", "Wall_2K_NormalGL", "Wall_2K_Roughness", "Wall_2K_Displacement"];
    for name in names {
        let [cpu, gpu] = ["cpu", "gpu"].map(|dir| place.samples(&format!("{dir}/{name}.png")));
        assert_eq!((cpu.0, cpu.1), (gpu.0, gpu.1));
        assert!(cpu.2 == gpu.2, "{name}");
    }
}

#[test]
fn a_comparison_tells_how_far_normals_turn_and_how_close_the_lit_surface_comes() {
    let place = Place::new();
    folder(&place);
    let suite = "title = \"few\"\ncodecs = [\"dct\"]\nbpp = [2.0, 12.0]\nmetrics = [\"psnr\"]\n";
    fs::write(place.at("few.toml"), suite).unwrap();
    let run = place.run("compare in --as material --suite few.toml --out out --effort fast");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let rows: Vec<Value> = serde_json::from_slice(&fs::read(place.at("out/results.json")).unwrap()).unwrap();
    let of = |name: &str, figure: &str| -> Vec<Option<f64>> {
        let rows = rows.iter().filter(|row| row["input"].as_str().unwrap().contains(name));
        rows.map(|row| row[figure].as_f64()).collect()
    };
    let (degrees, lit) = (of("Wall_2K", "degrees"), of("Wall_2K", "lit_ssimulacra2"));
    assert!(degrees.len() == 2 && degrees[1] > Some(0.0) && degrees[1] < degrees[0], "{degrees:?}");
    assert!(lit[0] < lit[1] && lit[1] > Some(50.0), "{lit:?}");
    assert_eq!((of("floor", "degrees"), of("floor", "lit_ssimulacra2")), (vec![None; 2], vec![None; 2]));
    let page = fs::read_to_string(place.at("out/report.html")).unwrap();
    assert!(page.contains("normals, degrees<th>lit, SSIMULACRA2"));
}

#[test]
fn what_is_no_material_is_refused_by_name() {
    let place = Place::new();
    folder(&place);
    for (command, wanted) in [
        ("in/preview.png --as material", "no name of a map"),
        ("in --as material --codec vq", "only the codec dct"),
        ("in --as material --color srgb", "--color"),
        ("in --as material --weights colour=2", "kinds of maps"),
        ("in --as material --access texel", "access"),
        ("in/Wall_2K_Color.png --weights normal=2 --codec bc", "weights"),
        ("in/Wall_2K_Color.png --weights normal=2", "--as material"),
        ("in --as material --weights saliency=2", "weights of importance"),
        ("in --as material --codebook 64x64", "--codebook"),
    ] {
        let run = place.run(&format!("compress {command} --out out"));
        assert!(
            run.code != Some(0) && run.stderr.contains(wanted),
            "{command}: {:?} {}",
            run.code,
            run.stderr
        );
    }
    assert!(
        fs::read_dir(place.at("out")).map_or(0, |dir| dir
            .filter(|entry| entry
                .as_ref()
                .is_ok_and(|entry| entry.path().extension().is_some_and(|end| end == "txf")))
            .count())
            == 0
    );
}

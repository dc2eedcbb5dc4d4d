//! What comes out: decoded images, reports, information, comparisons.

use std::fs;
use std::io::{BufRead, Read, Write};

use base64::prelude::{BASE64_STANDARD, Engine};

use crate::support::{Place, fixture, names, psnr};

#[test]
fn a_round_trip_reaches_its_goal_and_reports_what_is_there() {
    let place = Place::new();
    fs::copy(fixture("facade.png"), place.at("facade.png")).unwrap();
    let (run, report) = place.compress("facade.png --out out --codec bc --psnr 38");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    assert_eq!(place.run("decompress out/facade.txf --out png").code, Some(0));
    let (source, decoded) = (place.samples("facade.png"), place.samples("png/facade.png"));
    assert_eq!((source.0, source.1), (decoded.0, decoded.1));
    let row = &report[0];
    let found = psnr(&source.2, &decoded.2);
    assert!(found >= 38.0, "{found}");
    assert!((found - row["psnr"].as_f64().unwrap()).abs() < 1e-6, "{found} {row}");
    let length = fs::metadata(place.at("out/facade.txf")).unwrap().len();
    assert_eq!(row["bits_disk"].as_u64().unwrap(), 8 * length);
    let texels = f64::from(source.0) * f64::from(source.1);
    assert_eq!(row["source_texels"].as_f64().unwrap(), texels);
    assert!((row["bpp_disk"].as_f64().unwrap() - 8.0 * length as f64 / texels).abs() < 1e-9);
    assert!(
        (row["bpp_memory"].as_f64().unwrap() - row["bits_memory"].as_f64().unwrap() / texels).abs() < 1e-9
    );
}

#[test]
fn a_row_has_every_field_and_its_parts_sum_to_the_totals() {
    let place = Place::new();
    place.image("in/0.png", 33, 17, 4);
    place.image("in/1.png", 17, 33, 4);
    let (_, report) = place.compress("in --out out --codec bc --bpp 8");
    let row = report[0].as_object().unwrap();
    for field in [
        "input",
        "output",
        "codec",
        "settings",
        "width",
        "height",
        "images",
        "source_texels",
        "bits_memory",
        "bits_resident",
        "bits_disk",
        "bpp_memory",
        "bpp_resident",
        "bpp_disk",
        "psnr",
        "psnr_alpha",
        "rms",
        "worst_block_rms",
        "ssim",
        "ssimulacra2",
        "access",
        "goal_met",
        "encode_seconds",
        "encode_texels_per_second",
        "peak_bytes",
        "parts",
        "verdict",
        "tried",
        "warnings",
    ] {
        assert!(row.contains_key(field), "{field}");
    }
    assert_eq!((row["images"].as_u64(), row["source_texels"].as_u64()), (Some(2), Some(2 * 33 * 17)));
    for total in ["bits_memory", "bits_disk"] {
        let parts = row["parts"].as_array().unwrap();
        let sum: u64 = parts.iter().map(|part| part[total].as_u64().unwrap()).sum();
        assert_eq!(Some(sum), row[total].as_u64(), "{total}");
    }
    assert_eq!(row["input"], "in");
    assert!(place.at(row["output"].as_str().unwrap()).is_file());
}

#[test]
fn a_missed_goal_is_a_warning() {
    let place = Place::new();
    place.image("a.png", 64, 64, 3);
    let (run, report) = place.compress("a.png --out out --codec bc --content bc1 --psnr 90");
    assert_eq!(run.code, Some(0));
    assert_eq!((&report[0]["goal_met"], &report[0]["access"]), (&false.into(), &"texel".into()));
    assert!(report[0]["warnings"][0].as_str().unwrap().contains("90 dB"), "{report:?}");
    assert!(run.stderr.contains("warning: ") && run.stderr.contains("90 dB"), "{}", run.stderr);
    assert!(run.stdout.contains(", 1 warning in "), "{}", run.stdout);
    let strict = place.run("compress a.png --out out --codec bc --content bc1 --psnr 90 --strict");
    assert!(strict.code == Some(1) && strict.stdout.contains("1 up to date"), "{}", strict.stdout);
}

#[test]
fn a_named_codec_stays_unless_plain_blocks_are_allowed() {
    let place = Place::new();
    // More blocks than there are codewords.
    place.image("a.png", 512, 256, 3);
    let (run, report) = place.compress("a.png --out out --codec vq --psnr 60");
    assert_eq!((run.code, &report[0]["codec"]), (Some(0), &"vq".into()));
    assert!(run.stderr.contains("the goal of 60 dB was missed"), "{}", run.stderr);
    let (_, report) = place.compress("a.png --out out --codec vq --psnr 60 --or-plain");
    assert_eq!((&report[0]["codec"], &report[0]["goal_met"]), (&"bc".into(), &true.into()));
}

#[test]
fn quiet_runs_tell_errors_and_answers_alone() {
    let place = Place::new();
    place.image("a.png", 64, 64, 3);
    fs::write(place.at("b.png"), b"no image").unwrap();
    let run = place.run("compress a.png b.png --out out --codec bc --content bc1 --psnr 90 --quiet");
    assert_eq!((run.code, run.stdout.as_str()), (Some(1), ""));
    let lines: Vec<&str> = run.stderr.lines().filter(|line| !line.contains("XDG")).collect();
    assert!(matches!(lines[..], [line] if line.starts_with("error: b.png")), "{lines:?}");
    let info = place.run("--quiet info out/a.txf");
    assert!(info.stdout.contains("codec bc"), "{}", info.stdout);
}

#[test]
fn normal_maps_have_a_goal_in_degrees() {
    let place = Place::new();
    place.image("a_Normal.png", 64, 64, 3);
    let (_, usual) = place.compress("a_Normal.png --out out --effort fast");
    let (_, coarse) = place.compress("a_Normal.png --out out --effort fast --degrees 5");
    let of = |report: &[serde_json::Value], figure: &str| report[0][figure].as_f64().unwrap();
    for (report, degrees) in [(&usual, 1.0), (&coarse, 5.0)] {
        let found = of(report, "degrees");
        assert!(found <= degrees && found > 0.6 * degrees, "{found} {degrees}");
        assert_eq!(report[0]["goal_met"], true, "{report:?}");
    }
    assert!(of(&coarse, "bpp_memory") < 0.8 * of(&usual, "bpp_memory"));
    place.image("b.png", 8, 8, 3);
    let run = place.run("compress b.png --out out --degrees 1");
    assert!(run.code == Some(1) && run.stderr.contains("--color normal"), "{}", run.stderr);
}

#[test]
fn many_inputs_take_a_line_each_and_few_more() {
    let place = Place::new();
    fs::create_dir(place.at("in")).unwrap();
    for number in 0..40 {
        place.image(&format!("in/{number:02}_normal.png"), 8, 8, 3);
    }
    let (run, report) = place.compress("in --as image --out out --codec bc --content bc1 --psnr 90");
    let lines = run.stdout.lines().chain(run.stderr.lines()).filter(|line| !line.contains("XDG")).count();
    assert!(lines <= 40 + 10, "{lines}: {} {}", run.stdout, run.stderr);
    assert!(run.stderr.contains("35 more warnings and 38 more notes"), "{}", run.stderr);
    assert!(run.stdout.contains("40 warnings"), "{}", run.stdout);
    assert_eq!(report.iter().filter(|row| row["warnings"][0].is_string()).count(), 40);
}

#[test]
fn a_choice_reports_what_became_of_each_codec() {
    let place = Place::new();
    place.image("a.png", 64, 64, 3);
    let (run, report) = place.compress("a.png --out out --psnr 30");
    assert_eq!(run.code, Some(0));
    let row = &report[0];
    let tried = row["tried"].as_array().unwrap();
    let of = |codec: &str| tried.iter().find(|tried| tried["codec"] == codec).unwrap();
    assert_eq!(of(row["codec"].as_str().unwrap())["psnr"], row["psnr"], "{row:?}");
    for codec in ["dct", "progressive", "epitome", "vq"] {
        let was_encoded = of(codec)["outcome"].as_str().unwrap().starts_with("came to");
        assert_eq!(of(codec)["bpp"].is_number(), was_encoded, "{row:?}");
    }
    let (_, report) = place.compress("a.png --out named --codec bc --psnr 30");
    assert_eq!(report[0]["tried"].as_array().map(Vec::len), Some(0));
}

#[test]
fn a_folder_is_a_set_in_sorted_order() {
    let place = Place::new();
    for (index, width) in [20u32, 24, 28].into_iter().enumerate() {
        place.image(&format!("tiles/{index}.png"), width, 16, 3);
    }
    let (run, report) = place.compress("tiles --out out --codec bc --psnr 60");
    assert_eq!((run.code, report[0]["images"].as_u64()), (Some(0), Some(3)));
    place.run("decompress out/tiles.txf --out png");
    assert_eq!(names(&place.at("png")), ["tiles-000.png", "tiles-001.png", "tiles-002.png"]);
    let widths: Vec<u32> = (0..3).map(|i| place.samples(&format!("png/tiles-00{i}.png")).0).collect();
    assert_eq!(widths, [20, 24, 28]);
    let (run, report) = place.compress("tiles --as image --out each --codec bc");
    assert_eq!((run.code, report.len()), (Some(0), 3));
    assert_eq!(report[1]["input"], "tiles/1.png");
    let (run, report) = place.compress("tiles --as sequence --out frames --codec bc");
    assert_eq!(run.code, Some(1), "frames of unlike sizes");
    assert!(report[0]["error"].as_str().unwrap().contains("tiles/1.png"), "{report:?}");
}

#[test]
fn mip_levels_are_decoded_by_number() {
    let place = Place::new();
    place.image("a.png", 40, 24, 3);
    place.compress("a.png --out out --codec bc --mips --content bc7");
    assert_eq!(place.run("decompress out/a.txf --out png --lod 2").code, Some(0));
    assert_eq!((place.samples("png/a.png").0, place.samples("png/a.png").1), (10, 6));
    let run = place.run("decompress out/a.txf --out png --lod 9");
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.contains("level 9 of 6"), "{}", run.stderr);
    let run = place.run("decompress out/a.txf --out png --layers 1");
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.contains("leave out --layers"), "{}", run.stderr);
}

#[test]
fn a_progressive_file_is_decoded_layer_by_layer() {
    let place = Place::new();
    place.image("a.png", 96, 80, 3);
    let arguments = "a.png --out out --codec epitome --content bc1 --psnr 26 --effort fast --layers 3";
    let (run, report) = place.compress(arguments);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(report[0]["codec"], "epitome", "{}", report[0]["verdict"]);
    assert!(report[0]["settings"].as_str().unwrap().ends_with("--layers 3"), "{report:?}");
    let run = place.run("info out/a.txf");
    assert!(run.stdout.contains("layers    3 of 3"), "{}", run.stdout);
    assert!(run.stdout.contains("map, layer 1") && run.stdout.contains("epitome, layer 3"), "{}", run.stdout);
    let decode = |file: &str, out: &str, layers: &str| {
        let run = place.run(&format!("decompress out/{file}.txf --out {out} {layers}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        (fs::read(place.at(&format!("{out}/{file}.png"))).unwrap(), run.stderr)
    };
    let whole = decode("a", "whole", "");
    let (first, warned) = decode("a", "first", "--layers 1");
    assert!(first != whole.0 && warned.is_empty() && whole.1.is_empty(), "{warned}");
    assert_eq!(decode("a", "third", "--layers 3"), whole);
    let (more, warned) = decode("a", "more", "--layers 4");
    assert!(more == whole.0 && warned.contains("has 3 layers, not 4"), "{warned}");
    // A file cut in the last layer shows the second, and says so; one cut in the first layer is an error.
    let bytes = fs::read(place.at("out/a.txf")).unwrap();
    fs::write(place.at("out/cut.txf"), &bytes[..bytes.len() - 1]).unwrap();
    let (cut, warned) = decode("cut", "cut", "");
    assert!(warned.contains("ends after 2 of 3 layers"), "{warned}");
    assert!(cut == decode("a", "second", "--layers 2").0);
    assert!(place.run("info out/cut.txf").stdout.contains("layers    2 of 3"));
    fs::write(place.at("out/short.txf"), &bytes[..bytes.len() / 8]).unwrap();
    let run = place.run("decompress out/short.txf --out short");
    assert!(run.code == Some(1) && run.stderr.contains("fetch the rest"), "{}", run.stderr);
}

#[test]
fn damaged_files_are_named_and_the_others_decoded() {
    let place = Place::new();
    place.image("a.png", 40, 24, 3);
    place.compress("a.png --out out --codec bc");
    let bytes = fs::read(place.at("out/a.txf")).unwrap();
    let mut flipped = bytes.clone();
    flipped[bytes.len() - 3] ^= 1;
    fs::write(place.at("out/flipped.txf"), flipped).unwrap();
    fs::write(place.at("out/cut.txf"), &bytes[..bytes.len() / 2]).unwrap();
    fs::write(place.at("out/text.txf"), b"no texture").unwrap();
    let run = place.run("decompress out/cut.txf out/flipped.txf out/text.txf none.txf out/a.txf --out png");
    assert_eq!((run.code, names(&place.at("png"))), (Some(1), vec!["a.png".to_owned()]));
    for name in ["out/cut.txf", "out/flipped.txf", "out/text.txf", "none.txf"] {
        assert!(run.stderr.lines().any(|line| line.contains(name)), "{name}: {}", run.stderr);
    }
    assert_eq!(place.run("info out/cut.txf").code, Some(1));
}

#[test]
fn info_tells_the_ledger_and_draws_the_parts() {
    let place = Place::new();
    fs::copy(fixture("salient.png"), place.at("salient.png")).unwrap();
    let (run, report) = place.compress("salient.png --out out --codec vq --codebook 64x64 --content raw");
    assert_eq!((run.code, &report[0]["codec"]), (Some(0), &"vq".into()), "{}", run.stderr);
    let run = place.run("info out/salient.txf --json");
    let info: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&info["codec"], &info["bits_disk"]), (&report[0]["codec"], &report[0]["bits_disk"]));
    assert_eq!((&info["parts"], &info["verdict"]), (&report[0]["parts"], &report[0]["verdict"]));
    // The left half of the texture is drawn four times as wide as the right one.
    let corners =
        ["-4 0 0", "0 0 0", "1 0 0", "-4 1 0", "0 1 0", "1 1 0"].map(|corner| format!("v {corner}\n"));
    let places = ["0 0", "0.5 0", "1 0", "0 1", "0.5 1", "1 1"].map(|place| format!("vt {place}\n"));
    let faces = "f 1/1 2/2 5/5 4/4\nf 2/2 3/3 6/6 5/5\n";
    fs::write(place.at("wall.obj"), [&corners.concat(), &places.concat(), faces].concat()).unwrap();
    let run = place.run("info out/salient.txf --pictures parts --original salient.png --mesh wall.obj");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.contains(report[0]["verdict"].as_str().unwrap()), "{}", run.stdout);
    let parts = names(&place.at("parts"));
    for part in ["decoded", "error", "codebook", "index", "usage"] {
        assert!(parts.contains(&format!("salient-{part}.png")), "{parts:?}");
    }
    let (width, _, stretch) = place.samples("parts/salient-distortion.png");
    let row = &stretch[..width as usize];
    assert!(row[0] == 255 && (60..70).contains(&row[width as usize - 1]), "{row:?}");
    let (width, _, salient) = place.samples("parts/salient-saliency.png");
    // The ball's centre lies right of and below the middle; the upper left corner is ground.
    assert!(salient[(145 * width + 155) as usize] > 3 * salient[(10 * width + 10) as usize].max(10));
    let run = place.run("info out/salient.txf --mesh wall.obj --pictures parts");
    assert!(run.code == Some(2) && run.stderr.contains("--original"), "{}", run.stderr);
}

#[test]
fn weights_decide_which_term_of_importance_places_samples() {
    let place = Place::new();
    fs::copy(fixture("facade.png"), place.at("facade.png")).unwrap();
    let mut painted = image::GrayImage::new(256, 256);
    for (x, y) in (0..64).flat_map(|x| (192..256).map(move |y| (x, y))) {
        painted.put_pixel(x, y, image::Luma([255]));
    }
    painted.save(place.at("painted.png")).unwrap();
    let seen = |weights: &str| {
        let options = "--codec vq --codebook 64x64 --samples 1x32 --effort fast --importance-map painted.png";
        let (run, report) = place.compress(&format!("facade.png --out out --force {options} {weights}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let decoded = place.run("decompress out/facade.txf --force --out png");
        assert_eq!(decoded.code, Some(0), "{}", decoded.stderr);
        let image = image::open(place.at("png/facade.png")).unwrap().to_rgb8();
        let source = image::open(fixture("facade.png")).unwrap().to_rgb8();
        let error = |x: u32, y: u32| {
            let pairs = image.get_pixel(x, y).0.into_iter().zip(source.get_pixel(x, y).0);
            pairs.map(|(a, b)| u64::from(a.abs_diff(b)).pow(2)).sum::<u64>()
        };
        let corner: u64 =
            (0..64).flat_map(|x| (192..256).map(move |y| (x, y))).map(|(x, y)| error(x, y)).sum();
        (corner, report[0]["settings"].as_str().unwrap().to_owned())
    };
    let (corner, settings) = seen("--weights painted=100,usability=0,saliency=0");
    let (without, _) = seen("--weights painted=0");
    assert!(4 * corner < 3 * without, "{corner} {without}");
    assert!(settings.contains("--weights usability=0,saliency=0,distortion=1,painted=100"), "{settings}");
    for wrong in ["saliency", "saliency=-1", "beauty=1", "saliency=1001", ""] {
        let run = place.run(&format!("compress facade.png --out out --codec vq --weights={wrong}"));
        assert!(run.code == Some(2) && run.stderr.contains("TERM=WEIGHT"), "{wrong}: {}", run.stderr);
    }
}

#[test]
fn bases_and_bytes_of_superblocks_are_drawn() {
    let place = Place::new();
    fs::copy(fixture("terrain.png"), place.at("terrain.png")).unwrap();
    let (run, report) = place.compress("terrain.png --out out --codec dct --bpp 2 --effort fast");
    assert_eq!((run.code, &report[0]["codec"]), (Some(0), &"dct".into()), "{}", run.stderr);
    let run = place.run("info out/terrain.txf --pictures parts");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(names(&place.at("parts")), ["terrain-base.png", "terrain-bits.png", "terrain-decoded.png"]);
    let (width, height, bits) = place.samples("parts/terrain-bits.png");
    assert!((width, height) == (256, 256) && bits.iter().max() > bits.iter().min());
}

#[test]
fn an_epitome_is_compressed_told_drawn_and_decoded() {
    let place = Place::new();
    fs::copy(fixture("facade.png"), place.at("facade.png")).unwrap();
    let (run, report) = place.compress("facade.png --out out --codec epitome --psnr 28 --effort fast --mips");
    assert_eq!((run.code, &report[0]["codec"]), (Some(0), &"epitome".into()), "{}", run.stderr);
    assert!(report[0]["psnr"].as_f64().unwrap() >= 28.0, "{report:?}");
    let run = place.run("info out/facade.txf --json");
    let info: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&info["codec"], &info["parts"]), (&report[0]["codec"], &report[0]["parts"]));
    let named = |part: &str| info["parts"].as_array().unwrap().iter().any(|found| found["name"] == part);
    assert!(["map", "epitome", "mips"].into_iter().all(named), "{info}");
    let run = place.run("info out/facade.txf --pictures parts --original facade.png");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let parts = names(&place.at("parts"));
    for part in ["decoded", "error", "position", "offset", "side", "scale"] {
        assert!(parts.contains(&format!("facade-{part}.png")), "{parts:?}");
    }
    for part in ["epitome", "usage"] {
        // One, or a numbered one of each content format.
        assert!(parts.iter().any(|name| name.starts_with(&format!("facade-{part}"))), "{parts:?}");
    }
    for level in ["0", "1", "4"] {
        let decompress = format!("decompress out/facade.txf --force --lod {level} --out");
        assert_eq!(place.run(&format!("{decompress} cpu")).code, Some(0));
        let run = place.run(&format!("{decompress} gpu --gpu"));
        if run.code != Some(0) && std::env::var("TEXFOLD_GPU").as_deref() != Ok("require") {
            assert!(run.stderr.contains("GPU"), "{}", run.stderr);
            return;
        }
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let (cpu, gpu) = (place.samples("cpu/facade.png"), place.samples("gpu/facade.png"));
        assert_eq!((cpu.0, cpu.1), (gpu.0, gpu.1));
        // Hardware may round BC1 by two steps, a gain may double them, and writing bytes rounds once more.
        let most = cpu.2.iter().zip(&gpu.2).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(most <= Some(5), "level {level}: {most:?}");
    }
}

#[test]
fn a_comparison_has_a_row_for_each_setting_and_a_page_of_its_own() {
    let place = Place::new();
    place.image("a.png", 64, 48, 3);
    let run = place.run("compare a.png missing.png --out out --effort fast");
    assert_eq!(run.code, Some(1), "one input is missing");
    let rows: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("out/results.json")).unwrap()).unwrap();
    let csv = fs::read_to_string(place.at("out/results.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    let header = "input,codec,settings,bpp_memory,bpp_disk,psnr,ssim,encode_seconds,\
                  decode_cpu_texels_per_second,decode_gpu_texels_per_second,random_access,ssimulacra2,bpp_resident,butteraugli,series,encode_cpu_seconds,effort,degrees,lit_ssimulacra2";
    assert_eq!(csv.lines().next(), Some(header));
    for name in header.split(',') {
        assert!(rows.iter().all(|row| row.get(name).is_some()), "{name}");
    }
    for row in &rows {
        let [held, drawn] = ["bpp_memory", "bpp_resident"].map(|name| row[name].as_f64().unwrap());
        match row["codec"].as_str() {
            Some("dct") => assert!(drawn > 32.0 && held < 8.0, "{row}"),
            Some("bc" | "vq" | "progressive" | "astc") => assert!(drawn == held, "{row}"),
            _ => assert!(drawn >= held, "{row}"),
        }
    }
    let bc1 = rows.iter().find(|row| row["settings"] == "bc1").unwrap();
    let bc7 = rows.iter().find(|row| row["settings"] == "bc7").unwrap();
    assert!(bc7["psnr"].as_f64() > bc1["psnr"].as_f64());
    assert!(bc7["ssimulacra2"].as_f64() > bc1["ssimulacra2"].as_f64() && bc1["ssimulacra2"].is_number());
    assert!(bc7["butteraugli"].as_f64() < bc1["butteraugli"].as_f64() && bc7["butteraugli"].is_number());
    assert!(bc1["decode_cpu_texels_per_second"].as_f64().unwrap() > 0.0);
    for codec in ["vq", "epitome", "progressive", "dct"] {
        assert!(rows.iter().any(|row| row["codec"] == codec), "{codec}");
    }
    let page = fs::read_to_string(place.at("out/report.html")).unwrap();
    assert!(page.matches("<svg").count() >= 3);
    assert!(!page.contains("src=\"http") && page.contains("data:image/png;base64,"));
    // Series are switched by their names, and so read is the form of codec-compare.
    assert_eq!(
        page.matches("<button type=\"button\"").count(),
        page.split("class=\"curves\"").nth(1).unwrap().matches("<g data-series").count()
    );
    let json =
        |path: &str| serde_json::from_slice::<serde_json::Value>(&fs::read(place.at(path)).unwrap()).unwrap();
    let list = json("out/codec-compare.json");
    let batches: Vec<_> = list
        .as_array()
        .unwrap()
        .iter()
        .map(|batch| json(&format!("out/{}", batch[0].as_str().unwrap())))
        .collect();
    assert_eq!(
        batches.iter().map(|batch| batch["field_values"].as_array().unwrap().len()).sum::<usize>(),
        rows.len()
    );
    for batch in &batches {
        for (names, values) in [
            ("constant_descriptions", &batch["constant_values"]),
            ("field_descriptions", &batch["field_values"][0]),
        ] {
            assert_eq!(batch[names].as_array().unwrap().len(), values.as_array().unwrap().len());
        }
    }
    let images = fs::read_to_string(place.at("out/images.html")).unwrap();
    let links = page.matches("images.html#").count();
    assert!(links > 3 && images.matches("\"group\":\"a.png\"").count() == links);
    assert_eq!(images.matches("\"originals\":[\"").count(), 1, "encodings of an input share its original");
}

#[test]
fn a_comparison_goes_on_where_it_has_stopped() {
    let place = Place::new();
    place.image("a.png", 64, 48, 3);
    fs::write(
        place.at("few.toml"),
        "title = \"few\"\ncodecs = [\"dct\"]\nbpp = [1.0, 2.0]\nplain = true\njpeg = [50]",
    )
    .unwrap();
    let rows = |place: &Place| fs::read_to_string(place.at("out/results.csv")).unwrap();
    let run = place.run("compare a.png --suite few.toml --out out --budget 0");
    assert!(run.code == Some(0) && run.stderr.contains("9 settings are not measured"), "{}", run.stderr);
    assert_eq!(rows(&place).lines().count(), 1);
    assert_eq!(place.run("compare a.png --suite few.toml --out out").code, Some(0));
    let first = rows(&place);
    assert_eq!(first.lines().count(), 10);
    let page = fs::read(place.at("out/report.html")).unwrap();
    // Nothing is measured again, or times would differ; images are as before.
    assert_eq!(place.run("compare a.png --suite few.toml --out out --budget 0").code, Some(0));
    assert_eq!(rows(&place), first);
    assert!(fs::read(place.at("out/report.html")).unwrap() == page);
    // Of another image nothing was kept, and what is of no use any more is removed.
    place.image("a.png", 48, 64, 3);
    assert_eq!(place.run("compare a.png --suite few.toml --out out").code, Some(0));
    assert_ne!(rows(&place), first);
    let kept = fs::read_dir(place.at("out/measured")).unwrap().flatten();
    assert_eq!(
        kept.filter(|entry| entry.path().extension().is_some_and(|ending| ending == "json")).count(),
        9
    );
    let run = place.run("compare a.png --suite none --out out");
    assert!(run.code == Some(2) && run.stderr.contains("rates"), "{}", run.stderr);
}

#[test]
fn efforts_are_points_of_a_series_in_charts_of_time() {
    let place = Place::new();
    place.image("a.png", 64, 48, 3);
    place.image("gray.png", 64, 48, 1);
    let suite = "title = \"efforts\"\ncodecs = [\"dct\", \"auto\"]\nefforts = [\"fast\", \"normal\"]\nbpp = [2.0, 4.0]\nequal-bpp = 4.0";
    fs::write(place.at("efforts.toml"), suite).unwrap();
    assert_eq!(place.run("compare a.png gray.png --suite efforts.toml --out out").code, Some(0));
    let rows: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("out/results.json")).unwrap()).unwrap();
    let found: Vec<_> = rows
        .iter()
        .map(|row| ["series", "settings", "effort"].map(|name| row[name].as_str().unwrap().to_owned()))
        .collect();
    let wanted = |effort: &str| {
        let of =
            |series: &str, bpp: u32| [series.to_owned(), format!("{bpp} bpp, {effort}"), effort.to_owned()];
        [of("dct", 2), of("dct", 4), of("auto", 2), of("auto", 4)]
    };
    let once = [wanted("fast"), wanted("normal")].concat();
    assert_eq!(found, [once.clone(), once].concat());
    // Charts of bits have the slower effort, those of time both.
    let chart = |name: &str| fs::read_to_string(place.at(&format!("out/charts/{name}.svg"))).unwrap();
    assert_eq!(chart("compressed-size-psnr").matches("<circle").count(), 4);
    let time = chart("encoding-psnr");
    assert!(time.contains("at 4 bits a texel"), "{time}");
    // An image this small may take no CPU time that is counted.
    let is_timed = |row: &&serde_json::Value| row["encode_cpu_seconds"].as_f64() > Some(0.0);
    let timed = rows[..8].iter().zip(&rows[8..]).filter(|(a, b)| is_timed(a) || is_timed(b));
    let timed = timed.filter(|(row, _)| row["settings"].as_str().unwrap().starts_with('4'));
    assert_eq!(time.matches("<circle").count(), timed.count());
    // The original of the first kind of pixels and four settings, of two pixels a texel.
    let (width, height, _) = place.samples("out/sheet.png");
    assert_eq!((width, height), (2 * 160, 2 * (5 * 163 - 3)));
    // Of another comparison no chart stays.
    fs::write(place.at("out/charts/other.svg"), "").unwrap();
    assert_eq!(place.run("compare a.png --suite efforts.toml --out out").code, Some(0));
    assert!(
        !place.at("out/charts/other.svg").exists()
            && place.at("out/charts/compressed-size-psnr.svg").exists()
    );
}

#[test]
fn the_suite_of_limits_has_superblocks_by_both_metrics_at_equal_bits() {
    let place = Place::new();
    place.image("a.png", 64, 48, 3);
    let run = place.run("compare a.png --suite limits --out out --effort fast");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let rows: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("out/results.json")).unwrap()).unwrap();
    let ours: Vec<_> = rows.iter().filter(|row| row["codec"] == "dct").collect();
    assert_eq!(ours.len(), 10);
    assert!(!rows.iter().any(|row| row["codec"] == "bc" || row["codec"] == "vq"));
    for (by_psnr, by_eye) in ours[..5].iter().zip(&ours[5..]) {
        let figure = |row: &serde_json::Value, name: &str| row[name].as_f64().unwrap();
        assert!(by_psnr["settings"].as_str().unwrap().ends_with(" psnr"));
        assert!(by_eye["settings"].as_str().unwrap().ends_with(" perceptual"));
        assert!(figure(by_psnr, "psnr") > figure(by_eye, "psnr"), "{by_psnr} {by_eye}");
    }
}

#[test]
fn the_gpu_decodes_as_the_cpu_does() {
    let place = Place::new();
    place.image("set/0.png", 37, 21, 3);
    place.image("set/1.png", 21, 37, 3);
    place.compress("set --out out --codec bc --content bc7 --mips");
    let run = place.run("decompress out/set.txf --out gpu --gpu --lod 1");
    if run.code != Some(0) && std::env::var("TEXFOLD_GPU").as_deref() != Ok("require") {
        assert!(run.stderr.contains("GPU"), "{}", run.stderr);
        return;
    }
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    place.run("decompress out/set.txf --out smooth --gpu --continuous --lod 1");
    place.run("decompress out/set.txf --out cpu --lod 1");
    for name in ["set-000.png", "set-001.png"] {
        let reference = place.samples(&format!("cpu/{name}")).2;
        for other in ["gpu", "smooth"] {
            let found = place.samples(&format!("{other}/{name}")).2;
            assert!(reference.iter().zip(&found).all(|(a, b)| a.abs_diff(*b) <= 1), "{other}/{name}");
        }
    }
    // An epitome whose leaves are blended in wide strips is another image then, on both.
    fs::copy(fixture("facade.png"), place.at("wall.png")).unwrap();
    place.compress("wall.png --out out --codec epitome --effort fast --psnr 21");
    for (out, options) in [("plain", ""), ("cpu", "--continuous"), ("gpu", "--continuous --gpu")] {
        place.run(&format!("decompress out/wall.txf --out {out} {options}"));
    }
    let [plain, cpu, gpu] = ["plain", "cpu", "gpu"].map(|out| place.samples(&format!("{out}/wall.png")).2);
    // Places are rounded otherwise, which shows where content is steepest.
    let far = cpu.iter().zip(&gpu).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert!(far * 1000 < cpu.len() && cpu.iter().zip(&gpu).all(|(a, b)| a.abs_diff(*b) <= 2), "{far}");
    assert!(plain.iter().zip(&cpu).any(|(a, b)| a.abs_diff(*b) > 1));
    // A rectangle is that part of it, but for how places are rounded.
    for (out, options) in [("cpu", ""), ("gpu", "--gpu")] {
        let run = place
            .run(&format!("decompress out/wall.txf --out {out} --continuous --region 11,20,75,60 {options}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let whole = image::open(place.at(&format!("{out}/wall.png"))).unwrap();
        let part = place.samples(&format!("{out}/wall-11-20-75x60.png")).2;
        let wanted = whole.crop_imm(11, 20, 75, 60);
        let far = wanted.as_bytes().iter().zip(&part).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert!(far * 1000 < part.len(), "{out}: {far}");
    }
}

#[test]
fn a_base_with_errors_is_compressed_told_and_decoded() {
    let place = Place::new();
    fs::copy(fixture("terrain.png"), place.at("a.png")).unwrap();
    let arguments = "a.png --out out --codec progressive --psnr 30 --effort fast --mips --content bc7";
    let (run, report) = place.compress(arguments);
    assert_eq!((run.code, &report[0]["codec"]), (Some(0), &"progressive".into()), "{}", run.stderr);
    assert!(report[0]["psnr"].as_f64().unwrap() >= 30.0, "{report:?}");
    assert!(report[0]["verdict"].as_str().unwrap().contains("in BC7"), "{}", report[0]["verdict"]);
    let run = place.run("info out/a.txf --json");
    let info: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    let part = |name: &str| info["parts"].as_array().unwrap().iter().find(|part| part["name"] == name);
    assert!(part("base").is_some() && part("residual plane").unwrap()["psnr_without"].as_f64() < Some(30.0));
    for (options, folder) in [("", "whole"), ("--layers 1", "base"), ("--lod 3", "small")] {
        let run = place.run(&format!("decompress out/a.txf --out {folder} {options}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
    let (whole, base) = (place.samples("whole/a.png"), place.samples("base/a.png"));
    assert_eq!((whole.0, whole.1), (base.0, base.1));
    assert!(whole.2 != base.2);
    assert_eq!(place.samples("small/a.png").0, whole.0 / 8);
}

#[test]
fn a_page_holds_files_their_originals_and_stills() {
    let place = Place::new();
    place.image("in/a \"quote\" <b>.png", 40, 30, 4);
    place.image("in/b.png", 600, 20, 1);
    place.compress("in --as image --out out --codec dct --bpp 2 --effort fast");
    let run = place.run("view out/*.txf --out view.html --original in");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let page = fs::read_to_string(place.at("view.html")).unwrap();
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap();
    let (data, rest) = rest.split_once("</script>").unwrap();
    assert!(rest.contains("requestAdapter"), "the page draws by itself");
    let items: serde_json::Value = serde_json::from_str(data).unwrap();
    assert_eq!(items["isServed"], false);
    let items = items["items"].as_array().unwrap();
    assert_eq!(items[0]["name"], "a \"quote\" <b>.txf");
    let files: Vec<_> = names(&place.at("out")).into_iter().filter(|name| name.ends_with(".txf")).collect();
    assert_eq!(items.len(), files.len());
    for (item, name) in items.iter().zip(files) {
        let bytes = |text: &serde_json::Value| BASE64_STANDARD.decode(text.as_str().unwrap()).unwrap();
        assert!(bytes(&item["data"]) == fs::read(place.at("out").join(name)).unwrap());
        let still = image::load_from_memory(&bytes(&item["still"])).unwrap();
        assert!(still.width() <= 512 && still.height() <= 512);
    }
    let first = BASE64_STANDARD.decode(items[0]["originals"][0].as_str().unwrap()).unwrap();
    assert_eq!(image::load_from_memory(&first).unwrap().to_rgba8().dimensions(), (40, 30));
    assert_eq!(items[1]["originals"].as_array().map(Vec::len), Some(0));
    let run = place.run("view out/b.txf --out more.html --original in --original in");
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.contains("more originals than files; give one for each file"), "{}", run.stderr);
    fs::write(place.at("cut.txf"), &fs::read(place.at("out/b.txf")).unwrap()[..100]).unwrap();
    let run = place.run("view cut.txf --out cut.html");
    assert_eq!((run.code, place.at("cut.html").exists()), (Some(1), false), "{}", run.stderr);
}

/// A program that is killed when a test ends.
struct Served(std::process::Child);

impl Drop for Served {
    fn drop(&mut self) {
        // One that has ended already needs no end.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Served {
    /// Serves a page, with those arguments behind, and gives its address.
    fn new(arguments: &[&str], folder: &std::path::Path) -> (Served, String) {
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_texfold"));
        let program = program.args(["view", "--serve", "0"]).args(arguments).current_dir(folder);
        let mut served = Served(program.stdout(std::process::Stdio::piped()).spawn().unwrap());
        let mut told = String::new();
        std::io::BufReader::new(served.0.stdout.take().unwrap()).read_line(&mut told).unwrap();
        let address = told.trim().strip_prefix("http://").unwrap().trim_end_matches('/').to_owned();
        (served, address)
    }
}

/// Status line and body of the answer to a request.
fn asked(address: &str, head: &str, body: &[u8]) -> (String, Vec<u8>) {
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    write!(stream, "{head}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n", body.len()).unwrap();
    stream.write_all(body).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap();
    let head = str::from_utf8(&answer[..end]).unwrap();
    (head.lines().next().unwrap().to_owned(), answer[end + 4..].to_vec())
}

#[test]
fn a_served_page_has_images_encoded() {
    let place = Place::new();
    place.image("in.png", 48, 32, 3);
    let (_served, address) = Served::new(&[], &place.at(""));
    let image = fs::read(place.at("in.png")).unwrap();
    let ask = |line: &str, host: &str, more: &str, body: &[u8]| {
        let (status, answer) = asked(&address, &format!("{line} HTTP/1.1\r\nHost: {host}{more}"), body);
        (status, String::from_utf8(answer).unwrap())
    };
    let own = "\r\nX-Texfold: 1";
    let (status, page) = ask("GET /", &address, "", b"");
    assert!(status.contains("200") && page.contains("\"isServed\":true"), "{status}");
    let line = "POST /encode?name=a%20b.png&bpp=2&codec=dct&effort=fast";
    let (status, answer) = ask(line, &address, own, &image);
    assert!(status.contains("200"), "{status} {answer}");
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!(answer["item"]["name"], "a b.txf");
    let file = BASE64_STANDARD.decode(answer["item"]["data"].as_str().unwrap()).unwrap();
    assert_eq!(8 * file.len() as u64, answer["report"]["bits_disk"].as_u64().unwrap());
    assert!(answer["report"]["psnr"].as_f64().unwrap() > 20.0);
    assert_eq!(answer["item"]["originals"].as_array().map(Vec::len), Some(1));
    // Other pages and other names of this machine get nothing.
    assert!(ask(line, &address, "", &image).0.contains("404"));
    assert!(ask(line, "example.org", own, &image).0.contains("403"));
    let (status, answer) = ask(line, &address, own, b"no image");
    assert!(
        status.contains("422") && answer.starts_with("a b.png: the image cannot be decoded"),
        "{status} {answer}"
    );
    let (status, answer) = ask("POST /encode?name=../../x.png&bpp=-1", &address, own, &image);
    assert!(status.contains("422") && answer.contains("bpp"), "{status} {answer}");
}

#[test]
fn a_served_page_gets_the_tiles_of_banks_and_nothing_else() {
    let place = Place::new();
    place.image("in/wide.png", 1500, 40, 3);
    let run = place.run("bank add in --codec dct --psnr 28 --effort fast --mips --out bank");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let (_served, address) = Served::new(&["bank"], &place.at(""));
    let get = |path: &str| asked(&address, &format!("GET {path} HTTP/1.1\r\nHost: {address}"), b"");
    let (_, page) = get("/");
    let (_, data) = str::from_utf8(&page).unwrap().split_once("id=\"data\">").unwrap();
    let data: serde_json::Value =
        serde_json::from_str(data.split("</script").next().unwrap().trim()).unwrap();
    let image = &data["items"][0]["bank"]["images"][0];
    assert_eq!((&image["name"], image["width"].as_u64()), (&"wide".into(), Some(1500)));
    let tiles = image["tiles"].as_array().unwrap();
    assert_eq!(tiles.len(), 2);
    for tile in tiles {
        let file = tile["file"].as_str().unwrap();
        let (status, bytes) = get(&format!("/bank/0/{file}"));
        assert!(
            status.contains("200") && bytes == fs::read(place.at("bank").join(file)).unwrap(),
            "{status}"
        );
    }
    for path in
        ["/bank/0/bank.json", "/bank/0/../in/wide.png", "/bank/1/x", "/bank/", "/bank/0/%2e%2e%2fbank.json"]
    {
        assert!(get(path).0.contains("404"), "{path}");
    }
    let run = place.run("view bank --out page.html");
    assert!(
        run.code == Some(1) && run.stderr.contains("see it with `texfold view --serve`"),
        "{}",
        run.stderr
    );
}

#[test]
fn frames_are_added_to_a_file_and_those_there_keep_every_texel() {
    let place = Place::new();
    place.image("walk/0.png", 64, 48, 3);
    place.image("walk/1.png", 64, 48, 3);
    place.image("more/2.png", 64, 48, 3);
    place.image("other/3.png", 32, 48, 3);
    place.compress("walk --as sequence --out out --codec vq --bpp 6 --codebook 128x128");
    place.compress("walk --out plain --codec bc");
    assert_eq!(place.run("decompress out/walk.txf --out before").code, Some(0));
    let run = place.run("compress more --add-to out/walk.txf --out grown");
    assert!(
        run.code == Some(0) && run.stdout.contains("1 images added to 2, at "),
        "{} {}",
        run.stdout,
        run.stderr
    );
    assert_eq!(place.run("decompress grown/walk.txf --out after").code, Some(0));
    let frames = names(&place.at("after"));
    assert_eq!(frames.len(), 3);
    for (frame, before) in frames.iter().zip(names(&place.at("before"))) {
        let read = |folder: &str, name: &str| place.samples(&format!("{folder}/{name}"));
        assert!(read("after", frame) == read("before", &before), "{frame}");
    }
    let (_, _, added) = place.samples(&format!("after/{}", frames[2]));
    assert!(psnr(&added, &place.samples("more/2.png").2) > 25.0);
    for (arguments, code, message) in [
        ("more --add-to plain/walk.txf --out no", 1, "codec bc cannot take further images; use vq"),
        ("other --as sequence --add-to out/walk.txf --out no", 1, "3.png"),
        ("more --color linear --add-to out/walk.txf --out no", 2, "--color cannot be combined with --add-to"),
        (
            "more --report r.json --add-to out/walk.txf --out no",
            2,
            "--report cannot be combined with --add-to",
        ),
        ("more --effort fast --add-to out/walk.txf --out no", 2, "--effort cannot be combined with --add-to"),
        ("more missing --add-to out/walk.txf --out no", 1, "missing"),
        (
            "more --add-to out/walk.txf --out no --bpp 2",
            2,
            "--tolerance and --degrees cannot be combined with --add-to",
        ),
    ] {
        let run = place.run(&format!("compress {arguments}"));
        assert!(
            run.code == Some(code) && run.stderr.contains(message),
            "{arguments}: {:?} {}",
            run.code,
            run.stderr
        );
        assert!(!place.at("no").exists());
    }
}

#[test]
fn epitomes_have_blocks_of_the_side_that_is_asked_for() {
    let place = Place::new();
    fs::copy(fixture("facade.png"), place.at("facade.png")).unwrap();
    let mut bits = Vec::new();
    for block in [8, 64] {
        let (run, report) = place.compress(&format!(
            "facade.png --codec epitome --block {block} --tolerance 30 --effort fast --out {block}"
        ));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!(report[0]["worst_block_rms"].as_f64().unwrap() <= 30.0);
        assert_eq!(report[0]["settings"], format!("--codec epitome --tolerance 30 --block {block}"));
        bits.push(report[0]["bpp_memory"].as_f64().unwrap());
    }
    // Small blocks repeat within the tolerance, large ones do not.
    assert!(bits[0] < 0.6 * bits[1], "{bits:?}");
    let relative = "--tolerance 0.01 --tolerance-kind relative";
    let (run, report) =
        place.compress(&format!("facade.png --codec epitome {relative} --effort fast --out relative"));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(report[0]["worst_relative_error"].as_f64().unwrap() <= 0.01);
    assert!(report[0]["goal_met"] == true && report[0]["settings"] == format!("--codec epitome {relative}"));
    for (arguments, what) in [
        (
            "--codec epitome --psnr 34 --tolerance-kind relative",
            "relative; allowed: absolute, without a tolerance",
        ),
        (
            "--codec bc --tolerance 4 --tolerance-kind relative",
            "--tolerance-kind is for codec epitome, not bc",
        ),
        ("--codec epitome --block 10", "--block 10 is outside multiples of 4 in 8..=64"),
        ("--codec dct --block 16", "--block is for codec epitome, not dct"),
    ] {
        let run = place.run(&format!("compress facade.png {arguments} --out out"));
        assert!(run.code == Some(2) && run.stderr.contains(what), "{}", run.stderr);
    }
}

//! Banks: many images that share codebooks, added over time, whatever happens in between.

use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use image::{DynamicImage, ExtendedColorType};
use serde_json::Value;
use texfold::bank::{Bank, BankError, BankWriter, NewImage, WriteError};
use texfold::core::{Rect, RegionError, Stage, Texel};
use texfold::dct::Dct;
use texfold::progressive::Progressive;
use texfold::{Effort, EncodeSettings, Goal, Job};
use texfold_testkit::strokes;

use crate::support::{Place, Run, names, psnr};

const ADD: &str = "in --codec dct --psnr 28 --effort fast --out bank";

/// Runs `bank add` and reads its report.
fn add(place: &Place, arguments: &str) -> (Run, Vec<Value>) {
    let run = place.run(&format!("bank add {arguments} --report report.json"));
    let report = fs::read(place.at("report.json")).unwrap_or_else(|_| panic!("{}", run.stderr));
    (run, serde_json::from_slice(&report).unwrap())
}

fn info(place: &Place) -> Value {
    let run = place.run("bank list bank --json");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    serde_json::from_str(&run.stdout).unwrap()
}

fn image_names(place: &Place) -> Vec<String> {
    let images = info(place)["images"].as_array().unwrap().clone();
    images.iter().map(|image| image["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn every_kind_of_image_is_added_and_bad_ones_are_named() {
    let place = Place::new();
    place.image("in/photo.png", 200, 120, 3);
    place.image("in/gray.png", 64, 40, 1);
    place.image("in/collar.png", 64, 64, 4);
    place.image("in/tiny.png", 3, 2, 3);
    place.image16("in/deep.tif", 50, 30);
    place.image("whole.tif", 64, 64, 3);
    let whole = fs::read(place.at("whole.tif")).unwrap();
    fs::write(place.at("in/cut.tif"), &whole[..whole.len() / 2]).unwrap();
    let (run, report) = add(&place, ADD);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(run.stderr.contains("cut.tif"), "{}", run.stderr);
    assert_eq!(image_names(&place), ["collar", "deep", "gray", "photo", "tiny"]);
    assert_eq!(report.iter().filter(|row| row["error"].is_string()).count(), 1);
    // Parts add up; the figures are those of what is decoded.
    for row in report.iter().filter(|row| row["error"].is_null()) {
        let parts = row["parts"].as_array().unwrap();
        let sum: u64 = parts.iter().map(|part| part["bits_memory"].as_u64().unwrap()).sum();
        assert_eq!(Some(sum), row["bits_memory"].as_u64());
    }
    assert_eq!(place.run("bank extract bank --out png").code, Some(0));
    assert_eq!(names(&place.at("png")), ["collar.png", "deep.png", "gray.png", "photo.png", "tiny.png"]);
    let (width, height, shown) = place.samples("png/photo.png");
    assert_eq!((width, height), (200, 120));
    let photo = report.iter().find(|row| row["input"].as_str().unwrap().contains("photo")).unwrap();
    let found = psnr(&shown, &place.samples("in/photo.png").2);
    assert!(found >= 28.0 && (found - photo["psnr"].as_f64().unwrap()).abs() < 0.01, "{found}");
}

#[test]
fn tiles_levels_and_single_images_are_decoded_alone() {
    let place = Place::new();
    place.image("in/wide.png", 1300, 40, 3);
    place.image("in/other.png", 32, 32, 3);
    assert_eq!(place.run(&format!("bank add {ADD} --mips")).code, Some(0));
    assert_eq!(info(&place)["images"][1]["tiles"], 2);
    let run = place.run("bank extract bank --out png --image wide --tile 1,0");
    assert_eq!((run.code, names(&place.at("png"))), (Some(0), vec!["wide-1-0.png".to_owned()]));
    assert_eq!(place.run("bank extract bank --out whole").code, Some(0));
    let (width, height, tile) = place.samples("png/wide-1-0.png");
    assert_eq!((width, height), (276, 40));
    let whole = place.samples("whole/wide.png").2;
    let row = |y: usize| &whole[(y * 1300 + 1024) * 3..(y * 1300 + 1300) * 3];
    assert!((0..40).all(|y| tile[y * 276 * 3..(y + 1) * 276 * 3] == *row(y)));
    assert_eq!(place.run("bank extract bank --out half --image wide --lod 1").code, Some(0));
    let (width, height, _) = place.samples("half/wide.png");
    assert_eq!((width, height), (650, 20));
    let half = place.samples("half/wide.png").2;
    // The library reads the same, across tiles and from a part of a level.
    let bank: Bank = Bank::open(&place.at("bank")).unwrap();
    assert_eq!((bank.images()[1].name.as_str(), bank.images()[1].levels > 1), ("wide", true));
    for (level, width, samples) in [(0, 1300, &whole), (1, 650, &half)] {
        let (x, y) = (1000 >> level, 3);
        let rect = Rect { image: 0, level, x, y, width: 100, height: 12 };
        let mut texels = vec![Texel::ZERO; 1200];
        bank.decode(1, rect, &mut texels).unwrap();
        for (number, texel) in texels.iter().enumerate() {
            let place = (y as usize + number / 100) * width + x as usize + number % 100;
            let bytes = texel.to_array().map(|value| (value * 255.0).round() as u8);
            assert_eq!(bytes[..3], samples[3 * place..3 * place + 3]);
        }
    }
    // The first bytes of a tile's file have its coarse levels.
    let tile = &bank.images()[1].tiles[0];
    let [coarse, tile] = [bank.coarse_tile(tile), bank.tile(tile)].map(|tile| {
        let mut texels = [Texel::ZERO; 32];
        let rect = Rect { image: 0, level: 5, x: 0, y: 0, width: 32, height: 1 };
        tile.unwrap().as_encoded().decode(rect, &mut texels).unwrap();
        texels
    });
    assert_eq!(coarse, tile);
    let rect = Rect { image: 0, level: 0, x: 1290, y: 0, width: 11, height: 1 };
    let outside = bank.decode(1, rect, &mut [Texel::ZERO; 11]);
    assert!(matches!(outside, Err(BankError::Region(RegionError::Outside { width: 1300, height: 40 }))));
    assert!(matches!(bank.decode(2, rect, &mut []), Err(BankError::Region(RegionError::NoSuchImage { .. }))));
    let run = place.run("bank extract bank --out none --image nobody");
    assert!(run.code == Some(1) && run.stderr.contains("nobody"), "{}", run.stderr);
    let run = place.run("bank extract bank --out none --image wide --tile 7,7");
    assert_eq!(run.code, Some(1), "{}", run.stderr);
}

#[test]
fn a_damaged_or_missing_file_is_named_and_the_rest_is_decoded() {
    let place = Place::new();
    for name in ["a", "b", "c"] {
        place.image(&format!("in/{name}.png"), 40, 40, 3);
    }
    assert_eq!(place.run(&format!("bank add {ADD}")).code, Some(0));
    let manifest: Value = serde_json::from_slice(&fs::read(place.at("bank/bank.json")).unwrap()).unwrap();
    let file = |index: usize| manifest["images"][index]["tiles"][0]["file"].as_str().unwrap().to_owned();
    fs::remove_file(place.at("bank").join(file(0))).unwrap();
    let path = place.at("bank").join(file(1));
    let mut bytes = fs::read(&path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 0x55;
    fs::write(&path, bytes).unwrap();
    let run = place.run("bank extract bank --out png");
    assert_eq!((run.code, names(&place.at("png"))), (Some(1), vec!["c.png".to_owned()]));
    assert!(run.stderr.contains(&file(0)) && run.stderr.contains(&file(1)), "{}", run.stderr);
    fs::write(place.at("bank/bank.json"), b"{\"version\": 1").unwrap();
    let run = place.run("bank list bank");
    assert!(run.code == Some(1) && run.stderr.contains("bank.json"), "{}", run.stderr);
}

#[test]
fn a_killed_run_leaves_a_bank_that_opens_and_goes_on() {
    let place = Place::new();
    for number in 0..6 {
        place.image(&format!("in/{number}.png"), 200 + number, 180, 3);
    }
    let mut child = Command::new(env!("CARGO_BIN_EXE_texfold"))
        .args(format!("bank add {ADD}").split_whitespace())
        .current_dir(place.at("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // Killed once the first image is in: somewhere within the second or a later one.
    let start = Instant::now();
    while !place.at("bank/bank.json").exists() && start.elapsed() < Duration::from_secs(300) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = image_names(&place);
    assert!(!before.is_empty());
    assert_eq!(place.run("bank extract bank --out before").code, Some(0));
    assert_eq!(place.run(&format!("bank add {ADD}")).code, Some(0));
    assert_eq!(image_names(&place), ["0", "1", "2", "3", "4", "5"]);
    assert_eq!(place.run("bank extract bank --out after").code, Some(0));
    for name in before {
        let read = |dir: &str| fs::read(place.at(dir).join(format!("{name}.png"))).unwrap();
        assert!(read("before") == read("after"), "{name}");
    }
    // Nothing that does not count is left.
    let listed = fs::read_to_string(place.at("bank/bank.json")).unwrap();
    let stray = |name: &String| name.ends_with(".txf") && !listed.contains(name.as_str());
    assert!(!names(&place.at("bank")).iter().any(stray));
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_bank_as_it_was() {
    let place = Place::new();
    place.image("in/a.png", 60, 60, 3);
    assert_eq!(place.run(&format!("bank add {ADD}")).code, Some(0));
    let before = fs::read(place.at("bank/bank.json")).unwrap();
    let noise: Vec<u8> = (0..200 * 200 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    image::save_buffer(place.at("in/b.png"), &noise, 200, 200, ExtendedColorType::Rgb8).unwrap();
    // Files of at most 8 blocks of 512 bytes, as if there were no more space.
    let script =
        format!("trap '' XFSZ; ulimit -f 8; exec '{}' bank add {ADD}", env!("CARGO_BIN_EXE_texfold"));
    let output = Command::new("sh").args(["-c", &script]).current_dir(place.at(".")).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && stderr.contains("cannot be written"), "{stderr}");
    assert_eq!(fs::read(place.at("bank/bank.json")).unwrap(), before);
    assert_eq!(place.run(&format!("bank add {ADD}")).code, Some(0));
    assert_eq!(image_names(&place), ["a", "b"]);
}

#[test]
fn another_file_of_a_known_name_is_refused_or_replaces_it() {
    let place = Place::new();
    place.image("in/a.png", 40, 40, 3);
    assert_eq!(place.run(&format!("bank add {ADD}")).code, Some(0));
    let run = place.run(&format!("bank add {ADD}"));
    assert!(run.stdout.contains("1 up to date"), "{}", run.stdout);
    place.image("in/a.png", 44, 40, 3);
    let run = place.run(&format!("bank add {ADD}"));
    assert!(run.code == Some(1) && run.stderr.contains("rename"), "{}", run.stderr);
    for codec in ["dct", "progressive"] {
        let arguments = format!("--codec {codec} --psnr 28 --effort fast --out {codec}");
        let place = Place::new();
        place.image("in/a.png", 40, 40, 3);
        place.image("in/b.png", 40, 40, 3);
        assert_eq!(place.run(&format!("bank add in {arguments}")).code, Some(0));
        let before = bank_files(&place, codec);
        // Encoded again, in its place; the files of b stay.
        place.image("in/a.png", 44, 40, 3);
        let run = place.run(&format!("bank add in/a.png {arguments} --force"));
        assert!(run.code == Some(0) && run.stdout.contains("1 written"), "{}", run.stderr);
        let after = bank_files(&place, codec);
        let listed = manifest(&place, codec);
        assert_eq!((&listed["images"][0]["width"], &listed["images"][1]["name"]), (&44.into(), &"b".into()));
        let tiles = |number: usize| listed["images"][number]["tiles"][0]["file"].as_str().unwrap().to_owned();
        assert!(before.iter().all(|(name, _)| *name != tiles(0)), "{codec}");
        assert!(before.contains(after.iter().find(|(name, _)| *name == tiles(1)).unwrap()), "{codec}");
        let named = |name: &&(String, Vec<u8>)| name.0.starts_with("image-");
        assert_eq!(after.iter().filter(named).count(), 2, "{codec}");
        let counted: u64 =
            listed["categories"].as_array().unwrap().iter().filter_map(|c| c["tiles"].as_u64()).sum();
        assert_eq!(counted, 2, "{codec}");
        let run = place.run(&format!("bank extract {codec} --out png"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
}

/// What is read band by band is what is read at once.
#[test]
fn palettes_and_interlacing_are_read() {
    let place = Place::new();
    place.image("plain.png", 90, 70, 3);
    let original = image::open(place.at("plain.png")).unwrap();
    fs::create_dir_all(place.at("in")).unwrap();
    let palette: Vec<u8> = (0..64u32).flat_map(|i| [(i * 4) as u8, (255 - i * 3) as u8, 77]).collect();
    let indices: Vec<u8> = (0..90 * 70u32).map(|i| (i % 90 / 3 + i / 90 / 5) as u8 % 64).collect();
    let file = fs::File::create(place.at("in/palette.png")).unwrap();
    let mut encoder = png::Encoder::new(file, 90, 70);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_palette(palette);
    encoder.write_header().unwrap().write_image_data(&indices).unwrap();
    DynamicImage::from(original.to_luma8()).save(place.at("in/gray.tif")).unwrap();
    original.save(place.at("in/photo.tif")).unwrap();
    let arguments = "in --codec dct --psnr 40 --effort fast --out bank";
    let (run, report) = add(&place, arguments);
    assert_eq!((run.code, report.len()), (Some(0), 3), "{}", run.stderr);
    assert_eq!(place.run("bank extract bank --out png").code, Some(0));
    let wanted = image::open(place.at("in/palette.png")).unwrap().to_rgb8();
    let found = psnr(&place.samples("png/palette.png").2, &wanted);
    let told = report.iter().find(|row| row["input"] == "in/palette.png").unwrap()["psnr"].as_f64().unwrap();
    assert!((found - told).abs() < 0.01, "{found} {told}");
}

/// Files of a bank by name, with what depends on the clock left out.
fn bank_files(place: &Place, bank: &str) -> Vec<(String, Vec<u8>)> {
    let read = |name: String| {
        let bytes = fs::read(place.at(bank).join(&name)).unwrap();
        if name != "bank.json" {
            return (name, bytes);
        }
        let mut listed: Value = serde_json::from_slice(&bytes).unwrap();
        for image in listed["images"].as_array_mut().unwrap() {
            for figure in ["encode_seconds", "encode_texels_per_second", "peak_bytes", "output"] {
                image["row"][figure] = Value::Null;
            }
        }
        (name, serde_json::to_vec(&listed).unwrap())
    };
    names(&place.at(bank)).into_iter().map(read).collect()
}

#[test]
fn a_bank_is_the_same_however_many_images_are_encoded_at_a_time() {
    let place = Place::new();
    for (number, name) in ["a", "b", "c", "d"].into_iter().enumerate() {
        place.image(&format!("in/{name}.png"), 90 + 8 * number as u32, 80, 3);
    }
    fs::write(place.at("in/bad.png"), b"\x89PNG\r\n\x1a\nnothing").unwrap();
    // Few enough bits that codebooks are tried by texel, so that images of a category wait for one another.
    fs::write(
        place.at("banks.toml"),
        "[[rule]]\nglob = \"**/[ac].png\"\ncategory = \"first\"\n[[rule]]\nglob = \"**/b*.png\"\ncategory = \"second\"\n",
    )
    .unwrap();
    for codec in ["progressive", "dct"] {
        for jobs in ["1", "2", "4"] {
            let arguments = "bank add in --bpp 0.6 --config banks.toml --codec";
            let run = place.run(&format!("{arguments} {codec} --jobs {jobs} --out {codec}{jobs}"));
            assert!(run.code == Some(1) && run.stderr.contains("bad.png"), "{}", run.stderr);
        }
        let files = |jobs: u32| bank_files(&place, &format!("{codec}{jobs}"));
        let alone = files(1);
        assert_eq!(alone.len(), 6, "four images, a list and a lock");
        assert!(alone == files(2) && alone == files(4), "{codec}");
    }
}

/// `bank.json` as it is.
fn manifest(place: &Place, bank: &str) -> Value {
    serde_json::from_slice(&fs::read(place.at(bank).join("bank.json")).unwrap()).unwrap()
}

/// How each image of the bank is read, in the order that they were added.
fn forms(place: &Place) -> Vec<String> {
    let images = info(place)["images"].as_array().unwrap().clone();
    images.iter().map(|image| image["access"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn images_of_a_bank_have_the_codec_that_each_was_added_with() {
    let place = Place::new();
    let texel = ADD.replace("--codec dct", "--codec progressive");
    place.image("in/a.png", 80, 60, 3);
    let (_, report) = add(&place, &texel);
    assert_eq!((&report[0]["access"], &report[0]["goal_met"]), (&"texel".into(), &Value::Null));
    assert_eq!(report[0]["codec"], "progressive");
    assert_eq!(manifest(&place, "bank")["version"], 1);
    assert_eq!(place.run("bank extract bank --out before").code, Some(0));
    place.image("in/b.png", 70, 50, 3);
    let run = place.run(&format!("bank add in/b.png {}", ADD.trim_start_matches("in ")));
    assert_eq!((run.code, forms(&place)), (Some(0), vec!["texel".to_owned(), "block".to_owned()]));
    assert_eq!(manifest(&place, "bank")["version"], 2);
    assert_eq!(place.run("bank extract bank --out after").code, Some(0));
    assert_eq!(names(&place.at("after")), ["a.png", "b.png"]);
    let read = |dir: &str| fs::read(place.at(dir).join("a.png")).unwrap();
    assert!(read("before") == read("after"));
    let (run, report) = add(&place, &ADD.replace("--out bank", "--out new"));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let is_dct = |row: &Value| row["codec"] == "dct" && row["access"] == "block" && row["goal_met"] == true;
    assert!(report.iter().all(is_dct), "{report:?}");
}

/// Steps of the first image of a bank, tile by tile.
fn steps(place: &Place, bank: &str) -> Vec<u16> {
    let tiles = manifest(place, bank)["images"][0]["tiles"].as_array().unwrap().clone();
    let step = |tile: &Value| {
        let bytes = fs::read(place.at(bank).join(tile["file"].as_str().unwrap())).unwrap();
        let image = texfold::open(&bytes).unwrap().into_image().unwrap();
        let texture = image.downcast_ref::<texfold::dct::DctImages>().unwrap();
        texture.content().stages()[0].form().quantiser.step
    };
    tiles.iter().map(step).collect()
}

#[test]
fn tiles_of_an_image_share_a_step_and_the_image_meets_the_goal() {
    let place = Place::new();
    let (width, height) = (1400u32, 48u32);
    // Smooth in the first tile, rough in the second.
    let texel = |i: u32| {
        let (x, y) = (i % width, i / width);
        let rough = i.wrapping_mul(2_654_435_761) >> if x < 1024 { 30 } else { 25 };
        [x / 8 + rough, y + rough, 60 + rough].map(|value| value.min(255) as u8)
    };
    let data: Vec<u8> = (0..width * height).flat_map(texel).collect();
    fs::create_dir_all(place.at("in")).unwrap();
    image::save_buffer(place.at("in/a.png"), &data, width, height, ExtendedColorType::Rgb8).unwrap();
    for (goal, name) in [("--psnr 34", "psnr"), ("--bpp 1", "bpp"), ("--tolerance 16", "tolerance")] {
        let (run, report) = add(&place, &format!("in --codec dct {goal} --effort fast --out {name}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let steps = steps(&place, name);
        assert!(steps.len() == 2 && steps[0] == steps[1], "{goal}: {steps:?}");
        let (row, figure) = (&report[0], |field: &str| report[0][field].as_f64().unwrap());
        assert_eq!((&row["access"], &row["goal_met"]), (&"block".into(), &true.into()));
        match name {
            "psnr" => assert!((34.0..34.1).contains(&figure("psnr")), "{row}"),
            "bpp" => assert!((0.97..1.01).contains(&figure("bpp_memory")), "{row}"),
            _ => assert!((14.0..=16.0).contains(&figure("worst_block_rms")), "{row}"),
        }
    }
    // What no step reaches is said to be missed.
    let (run, report) = add(&place, "in --codec dct --bpp 0.001 --effort fast --out less");
    assert_eq!((run.code, &report[0]["goal_met"]), (Some(0), &false.into()), "{}", run.stderr);
    assert!(report[0]["warnings"][0].as_str().unwrap().contains("missed"), "{report:?}");
}

#[test]
fn the_library_writes_what_the_program_writes_and_each_reads_the_other() {
    let place = Place::new();
    place.image("in/a.png", 1400, 60, 4);
    let (run, _) = add(&place, "in --codec dct --psnr 34 --effort fast --mips --out program");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let encode = |dir: &str, name: &str, key: &str| {
        let settings = EncodeSettings {
            goal: Goal::Psnr(34.0),
            effort: Effort::Fast,
            mips: true,
            ..EncodeSettings::default()
        };
        let image = texfold_testkit::png(&place.at("in/a.png"));
        let mut bank: BankWriter = BankWriter::open(&place.at(dir)).unwrap();
        bank.add_blocks(&NewImage { name, key, ..NewImage::default() }, &image, &settings.params::<Dct>())
    };
    assert!(encode("library", "a", "1").unwrap());
    let tiles = |bank: &str| {
        let files = bank_files(&place, bank).into_iter().filter(|(name, _)| name.ends_with("txf"));
        files.collect::<Vec<_>>()
    };
    assert!(tiles("program").len() == 2 && tiles("program") == tiles("library"));
    for field in ["next", "version", "categories"] {
        assert_eq!(manifest(&place, "program")[field], manifest(&place, "library")[field]);
    }
    let row = |bank: &str, image: usize| manifest(&place, bank)["images"][image]["row"].clone();
    for field in
        ["psnr", "rms", "worst_block_rms", "bits_memory", "bits_disk", "bpp_resident", "goal_met", "codec"]
    {
        assert_eq!(row("program", 0)[field], row("library", 0)[field], "{field}");
    }

    // The same again is there already; another one of its name is refused.
    assert!(!encode("library", "a", "1").unwrap());
    assert!(matches!(encode("library", "a", "2"), Err(WriteError::Known { .. })));
    assert!(matches!(encode("library", "../a", "1"), Err(WriteError::Name { .. })));
    // The library keeps what the program wrote of its image.
    assert!(encode("program", "b", "1").unwrap());
    assert!(row("program", 0)["verdict"].as_str().unwrap().contains("2 tiles"), "{}", row("program", 0));
    let run = place.run("bank list program");
    assert!(run.code == Some(0) && run.stdout.contains('b'), "{}", run.stderr);
    let (run, _) = add(&place, "in --codec dct --psnr 30 --effort fast --force --out library");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(manifest(&place, "library")["images"].as_array().unwrap().len(), 1);
}

#[test]
fn public_codebooks_grow_by_the_library_as_by_the_program() {
    let place = Place::new();
    for (name, seed) in [("a", 0), ("b", 1)] {
        let image = strokes((1320, 192), seed, 12);
        let bytes = image.to_bytes();
        image::save_buffer(place.at(&format!("{name}.png")), &bytes, 1320, 192, ExtendedColorType::Rgb8)
            .unwrap();
        let (run, _) =
            add(&place, &format!("{name}.png --codec progressive --category s --bpp 0.3 --out program"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let mut bank: BankWriter = BankWriter::open(&place.at("library")).unwrap();
        let settings = EncodeSettings { goal: Goal::Bpp(0.3), ..EncodeSettings::default() };
        let new = NewImage { name, key: name, category: Some("s"), ..NewImage::default() };
        let mut stages = Vec::new();
        let mut progress = |stage: Stage| stages.push(stage.done);
        let mut job = Job::default().with_progress(&mut progress);
        let params = settings.params::<Progressive>();
        assert!(bank.add_texels(&new, &image, &params, &mut job).unwrap());
        assert!(!bank.add_texels(&new, &image, &params, &mut job).unwrap());
        assert!(stages.is_sorted() && stages.iter().any(|&done| done > 0.6), "two tiles: {stages:?}");
    }
    let files = |bank: &str| {
        let files = bank_files(&place, bank).into_iter().filter(|(name, _)| name.ends_with("txf"));
        files.collect::<Vec<_>>()
    };
    assert!(files("program") == files("library"));
    let rows = |pointer: &str| manifest(&place, "library").pointer(pointer).unwrap().as_u64().unwrap();
    assert_eq!(rows("/version"), 1);
    let (first, second) = (rows("/images/0/tiles/0/grown_rows"), rows("/images/1/tiles/0/blocks/0"));
    assert!(
        first > 0 && second > 0,
        "{first} rows from the first image, {second} blocks of the second use it"
    );
    assert_eq!(rows("/categories/0/tiles"), 4);
    assert!(files("library").iter().filter(|(name, _)| name.starts_with("category")).count() >= 1);
    let row = |bank: &str, image: usize| manifest(&place, bank)["images"][image]["row"].clone();
    for (field, image) in [
        "psnr",
        "rms",
        "worst_block_rms",
        "bits_memory",
        "bits_disk",
        "bpp_resident",
        "goal_met",
        "codec",
        "access",
    ]
    .into_iter()
    .flat_map(|field| [(field, 0), (field, 1)])
    {
        assert_eq!(row("program", image)[field], row("library", image)[field], "{field} {image}");
    }
    let bank: Bank = Bank::open(&place.at("library")).unwrap();
    let mut texels = vec![Texel::ZERO; 40 * 40];
    let rect = Rect { image: 0, level: 0, x: 1004, y: 100, width: 40, height: 40 };
    bank.decode(1, rect, &mut texels).unwrap();
    let original = strokes((1320, 192), 1, 12).crop(rect);
    let error: f32 = texels.iter().zip(original.texels()).map(|(a, b)| (*a - b).x.powi(2)).sum();
    assert!(error / 1600.0 < 0.01, "{error}");
}

#[test]
fn users_name_categories_and_others_join_the_nearest() {
    let place = Place::new();
    let plain = |name: &str, colour: [u8; 3]| {
        let data: Vec<u8> = (0..48 * 48).flat_map(|i| colour.map(|value| value + (i % 3) as u8)).collect();
        fs::create_dir_all(place.at("in")).unwrap();
        image::save_buffer(place.at(name), &data, 48, 48, ExtendedColorType::Rgb8).unwrap();
    };
    plain("in/sea.png", [20, 40, 150]);
    plain("in/wood.png", [30, 80, 20]);
    let more = "bank add in --codec dct --psnr 30 --effort fast --out bank";
    let run =
        place.run("bank add in/sea.png --codec dct --category water --psnr 30 --effort fast --out bank");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(place.run(more).code, Some(0));
    plain("in/bay.png", [25, 45, 140]);
    assert_eq!(place.run(more).code, Some(0));
    let found = info(&place);
    assert_eq!(found["categories"][0]["name"], "water");
    let of = |image: usize| found["images"][image]["categories"][0].as_u64().unwrap();
    // In the order that they were added: sea, wood, bay.
    assert_eq!((of(0), of(1), of(2)), (0, 1, 0));
    assert_eq!(found["categories"][0]["tiles"], 2);
    let run = place.run("compress in/sea.png --codec vq --category water --out out");
    assert!(run.code == Some(2) && run.stderr.contains("bank add"), "{}", run.stderr);
    fs::write(place.at("rules.toml"), "category = \"water\"\n").unwrap();
    let run = place.run("compress in/sea.png --config rules.toml --out out");
    assert!(run.code == Some(2) && run.stderr.contains("bank add"), "{}", run.stderr);
    let run = place.run("bank add in/sea.png --codec vq --out bank");
    assert!(run.code == Some(2) && run.stderr.contains("dct and progressive"), "{}", run.stderr);
    for command in ["info bank", "decompress bank --out png"] {
        let run = place.run(command);
        assert!(run.code == Some(1) && run.stderr.contains("texfold bank"), "{}", run.stderr);
    }
}

/// As for single images, whatever tile has the largest values; a black one has none.
#[test]
fn sources_of_fewer_bits_in_16_are_measured_against_their_own() {
    let place = Place::new();
    let (width, height) = (1300, 40);
    let value = |x: u32, y: u32| if x < 1024 { 0 } else { 300 + (x * 37 + y * y * 11) as u16 % 1700 };
    let image = image::ImageBuffer::from_fn(width, height, |x, y| image::Luma([value(x, y)]));
    fs::create_dir_all(place.at("in")).unwrap();
    DynamicImage::ImageLuma16(image).save(place.at("in/deep.png")).unwrap();
    let (_, report) = add(&place, &format!("{ADD} --color linear"));
    let (psnr, note) = (report[0]["psnr"].as_f64().unwrap(), report[0]["notes"].to_string());
    assert!(note.contains("use 11 of 16 bits"), "{note}");
    assert!((28.0..33.0).contains(&psnr), "{psnr}");
    // The same of all bits is 30 dB more.
    assert_eq!(place.run("bank extract bank --out png").code, Some(0));
    let found = image::open(place.at("png/deep.png")).unwrap().into_luma16();
    let squares = found
        .enumerate_pixels()
        .map(|(x, y, found)| (f64::from(found.0[0]) - f64::from(value(x, y))).powi(2));
    let mean = squares.sum::<f64>() / f64::from(width * height);
    assert!((10.0 * (2047.0f64.powi(2) / mean).log10() - psnr).abs() < 0.1, "{mean}");
}

/// A manifest is foreign: none makes the bank lose a file, read one from elsewhere, or show what it does not hold.
#[test]
fn forged_manifests_are_refused_and_nothing_is_written() {
    let place = Place::new();
    place.image("a.png", 48, 40, 3);
    place.image("b.png", 48, 40, 3);
    let run =
        place.run("bank add a.png --out bank --bpp 4 --codec progressive --effort fast --category field");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let file = place.at("bank/bank.json");
    let honest = fs::read(&file).unwrap();
    let files = || {
        let read = |name: String| (fs::read(place.at("bank").join(&name)).unwrap(), name);
        names(&place.at("bank")).into_iter().filter(|name| name != "bank.json").map(read).collect::<Vec<_>>()
    };
    let before = files();
    let forgeries: [(&str, Value); 15] = [
        // Far more texels than the tiles have.
        ("/images/0/width", 32768.into()),
        ("/images/0/name", "con".into()),
        ("/images/0/tiles/0/file", "Lpt1.txf".into()),
        ("/next", 0.into()),
        ("/next", u32::MAX.into()),
        ("/categories/0/file", "/etc/hostname".into()),
        ("/categories/0/file", "../a.png".into()),
        ("/categories/0/file", "\u{1b}[2Jx".into()),
        ("/categories/0/name", "\u{7}".into()),
        ("/categories/0/colours", Value::Array(Vec::new())),
        ("/categories/0/rows", u32::MAX.into()),
        ("/categories/0/tiles", u32::MAX.into()),
        ("/images/0/name", "a\nb".into()),
        ("/images/0/tiles/0/grown_rows", u32::MAX.into()),
        ("/images/0/tiles/0/blocks", serde_json::json!([u64::MAX, 1, 1])),
    ];
    for (place_of, value) in forgeries {
        let mut manifest = manifest(&place, "bank");
        *manifest.pointer_mut(place_of).unwrap() = value.clone();
        fs::write(&file, manifest.to_string()).unwrap();
        for command in [
            "bank list bank",
            "bank add b.png --out bank --bpp 4 --codec progressive",
            "bank extract bank --out png",
        ] {
            let run = place.run(command);
            let named = run.stderr.contains("bank.json") && !run.stderr.contains('\u{1b}');
            assert!(
                run.code == Some(1) && named,
                "{place_of} {value}: {command}: {:?} {}",
                run.code,
                run.stderr
            );
        }
        assert!(files() == before, "{place_of} {value}");
        fs::write(&file, &honest).unwrap();
    }
    place.image("aux.png", 48, 40, 3);
    let run = place.run("bank add aux.png --out bank --bpp 4 --codec progressive");
    assert!(run.code == Some(1) && run.stderr.contains("a device on Windows"), "{}", run.stderr);
    // Two tiles in one file, and a colour image that claims to be gray.
    let mut twice = manifest(&place, "bank");
    let mut second = twice["images"][0].clone();
    second["name"] = "c".into();
    twice["images"].as_array_mut().unwrap().push(second);
    fs::write(&file, twice.to_string()).unwrap();
    assert!(place.run("bank list bank").stderr.contains("a tile that cannot be"));
    let mut gray = serde_json::from_slice::<Value>(&honest).unwrap();
    gray["images"][0]["channels"] = 1.into();
    fs::write(&file, gray.to_string()).unwrap();
    let run = place.run("bank extract bank --out png");
    assert!(run.code == Some(1) && run.stderr.contains("is not the tile that is listed"), "{}", run.stderr);
}

/// What `bank add` accepts, every later run reads.
#[test]
fn names_that_look_like_files_of_a_bank_are_listed_and_control_characters_refused() {
    let place = Place::new();
    place.image("photo-2024.txf.png", 48, 40, 3);
    let add = "bank add photo-2024.txf.png --out bank --bpp 4 --effort fast";
    assert_eq!(place.run(add).code, Some(0));
    assert_eq!(place.run("bank list bank").code, Some(0));
    place.image("in/a\u{7}b.png", 48, 40, 3);
    let run = place.run("bank add in --out bank --bpp 4 --effort fast");
    assert!(run.code == Some(1) && run.stderr.contains("a\\u{7}b has control characters"), "{}", run.stderr);
    place.image("c.png", 48, 40, 3);
    let run = place.run("bank add c.png --category x\u{7} --out bank --bpp 4 --effort fast");
    assert!(run.code == Some(1) && run.stderr.contains("control characters"), "{}", run.stderr);
    assert_eq!(place.run("bank list bank").code, Some(0));
}

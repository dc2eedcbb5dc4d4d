//! Many inputs at a time: what fails, what is skipped, what is made again.

use std::fs;
use std::time::SystemTime;

use crate::support::{Place, names};

#[test]
fn a_bad_input_does_not_stop_the_others() {
    let place = Place::new();
    place.image("in/a.png", 40, 24, 3);
    place.image("in/c.png", 16, 16, 1);
    fs::write(place.at("in/b.png"), b"this is no image").unwrap();
    fs::write(place.at("in/empty.png"), b"").unwrap();
    let (run, report) = place.compress("in/*.png missing.png none*.png --out out --codec bc");
    assert_eq!(run.code, Some(1));
    assert_eq!(names(&place.at("out")), ["a.txf", "c.txf"]);
    for (name, hint) in [
        ("in/b.png", "export it again"),
        ("in/empty.png", "write it again"),
        ("missing.png", "check the path"),
        ("none*.png", "check the pattern"),
    ] {
        let line = run.stderr.lines().find(|line| line.contains(name)).unwrap_or_else(|| panic!("{name}"));
        assert!(line.contains(hint), "{line}");
        let row = report.iter().find(|row| row["input"] == name).unwrap();
        assert!(row["error"].as_str().unwrap().contains(hint), "{row}");
        assert_eq!(row.as_object().unwrap().len(), 2);
    }
    assert_eq!(report.len(), 6);
    assert!(run.stdout.contains("2 written, 0 up to date, 4 failed"), "{}", run.stdout);
}

#[test]
fn folders_of_textures_are_decompressed_and_viewed() {
    let place = Place::new();
    place.image("in/a.png", 40, 24, 3);
    place.image("in/c.png", 16, 16, 1);
    assert_eq!(place.run("compress in --as image --out out --codec bc").code, Some(0));
    fs::write(place.at("out/notes.txt"), b"not a texture").unwrap();
    let run = place.run("decompress out --to png --out png");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(names(&place.at("png")), ["a.png", "c.png"]);
    let run = place.run("view out --out page.html");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let page = fs::read_to_string(place.at("page.html")).unwrap();
    assert!(page.contains("\"a.txf\"") && page.contains("\"c.txf\""));
    let run = place.run("decompress in --out other");
    assert!(
        run.code == Some(1) && run.stderr.contains("in: the folder holds no .txf file"),
        "{}",
        run.stderr
    );
}

#[cfg(unix)]
#[test]
fn names_that_are_no_unicode_are_up_to_date_too() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt};
    let place = Place::new();
    place.image("in/a.png", 40, 24, 3);
    for name in [&b"\xff.png"[..], b"\xfe.png"] {
        fs::copy(place.at("in/a.png"), place.at("in").join(OsStr::from_bytes(name))).unwrap();
    }
    for counts in ["3 written, 0 up to date", "0 written, 3 up to date"] {
        let run = place.run("compress in --as image --out out --codec bc");
        assert!(run.code == Some(0) && run.stdout.contains(counts), "{} {}", run.stdout, run.stderr);
    }
}

#[test]
fn what_is_up_to_date_is_skipped_unless_forced() {
    let place = Place::new();
    place.image("a.png", 40, 24, 3);
    place.image("b.png", 24, 40, 3);
    let modified = |name: &str| -> SystemTime { fs::metadata(place.at(name)).unwrap().modified().unwrap() };
    let (_, first) = place.compress("a.png b.png --out out --codec bc");
    let before = modified("out/a.txf");
    let (run, second) = place.compress("a.png b.png --out out --codec bc");
    assert!(run.stdout.contains("0 written, 2 up to date, 0 failed"), "{}", run.stdout);
    assert_eq!((modified("out/a.txf"), &second), (before, &first));
    let (run, _) = place.compress("a.png b.png --out out --codec bc --psnr 30");
    assert!(run.stdout.contains("2 written"), "other settings: {}", run.stdout);
    place.image("b.png", 24, 44, 3);
    let (run, _) = place.compress("a.png b.png --out out --codec bc --psnr 30");
    assert!(run.stdout.contains("1 written, 1 up to date"), "another source: {}", run.stdout);
    let (run, _) = place.compress("a.png b.png --out out --codec bc --psnr 30 --force");
    assert!(run.stdout.contains("2 written, 0 up to date"), "{}", run.stdout);
}

#[test]
fn an_interrupted_run_goes_on_where_it_stopped() {
    let place = Place::new();
    for name in ["a.png", "b.png", "c.png", "d.png"] {
        place.image(name, 40, 24, 3);
    }
    let all = "a.png b.png c.png d.png --out out --codec bc";
    place.compress(all);
    let whole: Vec<Vec<u8>> =
        names(&place.at("out")).iter().map(|name| fs::read(place.at("out").join(name)).unwrap()).collect();
    // As after an interruption: an output missing, one damaged, the index cut within its last line, a temporary file.
    fs::remove_file(place.at("out/a.txf")).unwrap();
    fs::write(place.at("out/b.txf"), b"half").unwrap();
    let index = place.at("out/.texfold-cache.jsonl");
    let text = fs::read_to_string(&index).unwrap();
    fs::write(&index, &text[..text.len() - 40]).unwrap();
    let leftover = place.at("out/.texfold-tmp-4194999-x");
    fs::write(&leftover, b"half").unwrap();
    let (run, report) = place.compress(all);
    assert_eq!(run.code, Some(0));
    assert!(run.stdout.contains("3 written, 1 up to date"), "{}", run.stdout);
    let again: Vec<Vec<u8>> =
        names(&place.at("out")).iter().map(|name| fs::read(place.at("out").join(name)).unwrap()).collect();
    assert_eq!((again, report.len()), (whole, 4));
    assert_eq!(leftover.exists(), !std::path::Path::new("/proc/self").exists());
}

#[test]
fn inputs_that_would_write_the_same_file_collide() {
    let place = Place::new();
    place.image("one/wall.png", 16, 16, 3);
    place.image("two/wall.png", 20, 16, 3);
    let (run, report) = place.compress("one/wall.png two/wall.png one/wall.png --out out --codec bc");
    assert_eq!((run.code, report.len()), (Some(1), 2));
    assert_eq!(report[0]["width"], 16);
    let error = report[1]["error"].as_str().unwrap();
    assert!(error.contains("two/wall.png") && error.contains("one/wall.png"), "{error}");
    assert_eq!(names(&place.at("out")), ["wall.txf"]);
}

#[test]
fn an_output_folder_that_cannot_be_is_named() {
    let place = Place::new();
    place.image("a.png", 16, 16, 3);
    fs::write(place.at("taken"), b"a file").unwrap();
    let run = place.run("compress a.png --out taken");
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.contains("taken: the folder cannot be made"), "{}", run.stderr);
    fs::create_dir_all(place.at("out/a.txf")).unwrap();
    let (run, report) = place.compress("a.png --out out --codec bc");
    assert_eq!(run.code, Some(1));
    assert!(report[0]["error"].as_str().unwrap().contains("out/a.txf: is a folder"), "{report:?}");
    assert_eq!(fs::read_dir(place.at("out")).unwrap().count(), 1, "no temporary file is left");
}

#[test]
fn bytes_do_not_depend_on_jobs_or_memory() {
    let place = Place::new();
    for (index, channels) in [3u8, 1, 4, 3, 2].into_iter().enumerate() {
        place.image(&format!("in/{index}.png"), 70 + index as u32, 50, channels);
    }
    for (out, limits) in [("one", "--jobs 1"), ("two", "--jobs 2"), ("tight", "--jobs 4 --memory 0.0003")] {
        let (run, _) = place.compress(&format!("in --as image --out {out} --bpp 6 {limits}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
    for name in names(&place.at("one")) {
        let read = |out: &str| fs::read(place.at(out).join(&name)).unwrap();
        assert_eq!(read("one"), read("two"), "{name}");
        assert_eq!(read("one"), read("tight"), "{name}");
    }
}

#[test]
fn mistakes_on_the_command_line_end_with_2() {
    let place = Place::new();
    place.image("a.png", 16, 16, 3);
    for (arguments, hint) in [
        ("compress a.png", "--out"),
        ("compress a.png --out out --codec tga", "tga"),
        ("compress a.png --out out --psnr 30 --bpp 2", "--bpp"),
        ("compress a.png --out out --psnr -3", "--psnr -3 is outside finite numbers"),
        ("compress a.png --out out --bpp -1", "--bpp -1 is outside finite numbers above 0"),
        ("compress a.png --out out --bpp nan", "finite"),
        ("compress a.png --out out --terms 4", "lightfield"),
        ("compress a.png --out out --codec bc --codebook 128x128", "vq"),
        ("compress a.png --out out --codebook 300x128", "256"),
        ("compress a.png --out out --layers 3", "epitome"),
        ("compress a.png --out out --codec epitome --layers 9", "1..=8"),
        ("compress a.png --out out --codec epitome --layers 2 --tolerance 5", "for a tolerance"),
        ("decompress a.txf --out out --layers 0", "--layers"),
        ("compress a.png --out out --jobs 0", "jobs"),
        ("compress a.png --out out --memory -1", "-1"),
        ("compress a.png --out out --config none.toml", "none.toml"),
        ("decompress --out out", "FILE.txf"),
        ("info", "FILE.txf"),
        ("draw", "draw"),
        ("stability --out out", "cargo xtask stability"),
    ] {
        let run = place.run(arguments);
        assert_eq!(run.code, Some(2), "{arguments}: {}", run.stderr);
        assert!(run.stderr.contains(hint), "{arguments}: {}", run.stderr);
    }
    assert!(!place.at("out").exists(), "nothing is done");
}

#[test]
fn rules_of_a_configuration_hold_by_glob() {
    let place = Place::new();
    place.image("in/wall_normal.png", 32, 32, 3);
    place.image("in/wall.png", 32, 32, 3);
    let rules = "codec = 'bc'\ncontent = 'bc7'\njobs = 1\nreport = 'from_config.json'\n\
                 [[rule]]\nglob = '*_normal.png'\ncolor = 'normal'\ncontent = 'bc5'\n";
    fs::write(place.at("batch.toml"), rules).unwrap();
    let run = place.run("compress in/wall.png in/wall_normal.png --out out --config batch.toml");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let report: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("from_config.json")).unwrap()).unwrap();
    let settings: Vec<&str> = report.iter().map(|row| row["settings"].as_str().unwrap()).collect();
    assert!(settings[0].contains("bc7") && settings[1].contains("bc5"), "{settings:?}");
    let run = place.run("compress in/wall_normal.png --out out --config batch.toml --content raw");
    assert_eq!(run.code, Some(0), "the command line goes first: {}", run.stderr);
    let raw: Vec<serde_json::Value> =
        serde_json::from_slice(&fs::read(place.at("from_config.json")).unwrap()).unwrap();
    assert!(raw[0]["settings"].as_str().unwrap().contains("raw"), "{raw:?}");
    fs::write(place.at("wrong.toml"), "codex = 'bc'\n").unwrap();
    let run = place.run("compress in/wall.png --out other --config wrong.toml");
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("wrong.toml") && run.stderr.contains("codex"), "{}", run.stderr);
}

#[test]
fn a_corrupt_image_of_a_set_is_named_and_other_inputs_are_done() {
    let place = Place::new();
    for name in ["set/a.png", "set/b.png", "set/c.png", "other/a.png", "other/b.png"] {
        place.image(name, 48, 32, 3);
    }
    // The header is whole, the pixels are not.
    let half = fs::read(place.at("set/b.png")).unwrap();
    fs::write(place.at("set/b.png"), &half[..half.len() / 2]).unwrap();
    let (run, report) = place.compress("set other --out out --codec epitome --psnr 30 --effort fast");
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    // A set is one file, whole or not at all: what lacks an image would number the others anew.
    assert_eq!(names(&place.at("out")), ["other.txf"]);
    let error = report.iter().find_map(|row| row["error"].as_str()).unwrap();
    assert!(error.contains("set/b.png") && run.stderr.contains("set/b.png"), "{error}");
    let done = report.iter().find(|row| row["input"] == "other").unwrap();
    assert_eq!(done["images"].as_u64(), Some(2), "{done}");
    let (run, _) = place.compress("set --as image --out each --codec epitome --psnr 30 --effort fast");
    assert_eq!((run.code, names(&place.at("each"))), (Some(1), vec!["a.txf".into(), "c.txf".into()]));
}

/// What may never end is not read, and what is no file is not replaced.
#[cfg(unix)]
#[test]
fn fifos_are_neither_read_nor_replaced() {
    let place = Place::new();
    place.image("a.png", 16, 16, 3);
    for name in ["fifo.png", "fifo.txf", "bank.txf", "config.toml"] {
        assert!(std::process::Command::new("mkfifo").arg(place.at(name)).status().unwrap().success());
    }
    for command in [
        "compress fifo.png --out out",
        "compress a.png --codec vq --importance-map fifo.png --out out",
        "compress a.png --config config.toml --out out",
        "compress a.png --add-to fifo.txf --out out",
        "bank add fifo.png --out bank",
        "info fifo.txf",
        "decompress fifo.txf --out out",
        "view fifo.txf --out view.html",
        "render fifo.txf --camera fifo.png --out out",
    ] {
        let run = place.run(command);
        assert!(run.code.is_some_and(|code| code != 0), "{command}: {:?}", run.code);
        let text = format!("{}{}", run.stderr, run.stdout);
        assert!(text.contains("a FIFO, not a regular file"), "{command}: {text}");
    }
    let run = place.run("compress a.png --out . --force");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    fs::rename(place.at("fifo.txf"), place.at("a.txf")).unwrap();
    let run = place.run("compress a.png --out . --force");
    assert!(run.code == Some(1) && run.stderr.contains("a.txf: is a FIFO"), "{}", run.stderr);
}

#[cfg(target_os = "linux")]
#[test]
fn what_stdout_does_not_take_fails_the_run() {
    let place = Place::new();
    place.image("a.png", 16, 16, 3);
    assert_eq!(place.compress("a.png --out out").0.code, Some(0));
    for command in ["--help", "compress --help", "info out/a.txf", "compress a.png --out out --force"] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let program = std::process::Command::new(env!("CARGO_BIN_EXE_texfold"))
            .args(command.split(' '))
            .current_dir(place.at(""))
            .stdout(full)
            .output()
            .unwrap();
        let stderr = String::from_utf8(program.stderr).unwrap();
        assert!(program.status.code() == Some(1) && stderr.contains("stdout"), "{command}: {stderr}");
    }
}

#[test]
fn half_a_jpeg_is_an_error() {
    let place = Place::new();
    place.image("a.png", 64, 64, 3);
    image::open(place.at("a.png")).unwrap().to_rgb8().save(place.at("whole.jpg")).unwrap();
    let bytes = fs::read(place.at("whole.jpg")).unwrap();
    fs::write(place.at("half.jpg"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let (run, report) = place.compress("whole.jpg half.jpg --out out");
    assert_eq!(run.code, Some(1));
    assert_eq!(report[0]["error"], serde_json::Value::Null, "{report:?}");
    assert!(report[1]["error"].as_str().unwrap().contains("ends early"), "{report:?}");
}

//! The checks as a user runs them, and the program's commands from file to file, on the CPU and on the GPU.

#![allow(clippy::panic, clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use texfold_gpu::{Gpu, Policy};
use texfold_testkit::{fixtures_dir, full};

/// Largest difference of decoders in 8-bit steps: hardware may round BC1 to BC5 differently (Direct3D 11.3 specification, 19.5).
const ROUNDING: u8 = 2;

/// Runs the program; fails where it does not succeed.
fn run(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_texfold-checks")).args(arguments).output().unwrap();
    let (told, faults) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{arguments:?}: {:?}\n{told}\n{faults}", output.status);
}

/// Whether a GPU or software Vulkan is there; fails where there is none and one is required.
fn has_gpu() -> bool {
    let policy = Policy::from_env();
    match Gpu::new(policy) {
        Ok(_) => true,
        Err(error) if policy == Policy::Require => panic!("TEXFOLD_GPU=require, but: {error}"),
        Err(error) => {
            println!("without a GPU: {error}");
            false
        }
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn fixtures_are_those_that_the_code_gives() {
    run(&["fixtures", "--check"]);
}

#[test]
fn the_browser_package_has_what_the_code_gives() {
    run(&["web", "--check"]);
}

#[test]
fn codecs_keep_their_references() {
    let all = ["reference", "--only", "fixtures"];
    if full() { run(&all) } else { run(&[&all[..], &["--quick"]].concat()) }
}

#[test]
fn codecs_keep_their_bounds_on_inputs_that_methods_do_not_suit() {
    let out = tempfile::tempdir().unwrap();
    let extent = if full() { "--full" } else { "--bounds" };
    run(&["stability", extent, "--out", text(out.path())]);
    assert!(out.path().join("report.html").is_file() && out.path().join("results.json").is_file());
}

#[test]
fn files_of_every_codec_are_decoded_alike_on_both_sides() {
    let out = tempfile::tempdir().unwrap();
    let images = fixtures_dir().join("images");
    let (facade, ripple) = (images.join("facade.png"), images.join("ripple"));
    let few = ["auto", "bc", "vq", "epitome", "progressive", "dct"].map(|codec| (codec, facade.clone()));
    let set = ("auto", ripple);
    let all = fs::read_dir(&images).unwrap().map(|entry| entry.unwrap().path());
    let all = all.filter(|path| full() && path.is_file()).map(|path| ("auto", path));
    let inputs: Vec<(&str, PathBuf)> = few.into_iter().chain([set]).chain(all).collect();
    let gpu = has_gpu();
    for (number, (codec, input)) in inputs.iter().enumerate() {
        let folder = out.path().join(number.to_string());
        run(&["compress", text(input), "--codec", codec, "--effort", "fast", "--out", text(&folder)]);
        let file = folder.join(input.file_stem().unwrap()).with_extension("txf");
        let (on_cpu, on_gpu) = (folder.join("cpu"), folder.join("gpu"));
        run(&["decompress", text(&file), "--out", text(&on_cpu)]);
        if gpu {
            run(&["decompress", text(&file), "--out", text(&on_gpu), "--gpu"]);
            assert_alike(&on_cpu, &on_gpu);
        }
    }
}

/// Fails where an image of one folder is not in the other, or a value differs by more than decoders may round.
fn assert_alike(reference: &Path, other: &Path) {
    let open = |path: &Path| image::open(path).unwrap().to_rgba8();
    for entry in fs::read_dir(reference).unwrap() {
        let path = entry.unwrap().path();
        let (a, b) = (open(&path), open(&other.join(path.file_name().unwrap())));
        assert_eq!(a.dimensions(), b.dimensions(), "{}", path.display());
        let largest = a.iter().zip(b.iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(largest <= Some(ROUNDING), "{} differs by {largest:?}", path.display());
    }
}

#[test]
fn a_capture_is_compressed_and_rendered_on_both_sides() {
    let out = tempfile::tempdir().unwrap();
    let capture = fixtures_dir().join("captures/ball");
    let (file, cameras) = (out.path().join("ball.txf"), capture.join("transforms.json"));
    run(&["compress", text(&capture), "--out", text(out.path())]);
    run(&["info", text(&file)]);
    let render = |side: &str, more: &[&str]| {
        let folder = out.path().join(side);
        let arguments = ["render", text(&file), "--camera", text(&cameras), "--out", text(&folder)];
        run(&[&arguments[..], more].concat());
        assert!(folder.join("019.png").is_file(), "{side}");
    };
    render("cpu", &["--cpu"]);
    if has_gpu() {
        render("gpu", &[]);
    }
}

//! C programs, built by the C compiler that Rust links with, beside what Rust gives.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use texfold::{AnyImage, AnyTexture, Texel};

fn crate_dir() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The folder of the library that was built with this test.
fn library_dir() -> PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_owned()
}

/// Builds a program; every warning fails.
fn build(source: &str, dir: &TempDir) -> PathBuf {
    build_by("cc", &["-std=c99", "-pedantic"], source, &[], dir)
}

fn build_by(compiler: &str, options: &[&str], source: &str, libraries: &[&str], dir: &TempDir) -> PathBuf {
    let program = dir.path().join("program");
    let mut compiler = Command::new(compiler);
    compiler.args(options).args(["-Wall", "-Wextra", "-Werror", "-g", "-O1", "-o"]).arg(&program);
    compiler.arg(crate_dir().join(source)).arg("-I").arg(crate_dir().join("include"));
    compiler.arg("-L").arg(library_dir()).arg("-ltexfold_c").args(libraries);
    let built = compiler.output().unwrap();
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    program
}

/// Runs a program with the library.
fn run(command: &mut Command) -> Output {
    command.env("LD_LIBRARY_PATH", library_dir()).env("DYLD_LIBRARY_PATH", library_dir()).output().unwrap()
}

/// Whether tools that programs are built and run with must be there, as in continuous integration.
fn is_required() -> bool {
    std::env::var("TEXFOLD_TOOLS").is_ok_and(|value| value == "require")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Golden files and their textures, those of images.
fn golden() -> Vec<(PathBuf, AnyImage)> {
    let dir = texfold_testkit::fixtures_dir().join("golden");
    let mut files: Vec<_> = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|end| end == "txf"));
    files.sort();
    let image = |file: PathBuf| match texfold::open(&fs::read(&file).unwrap()).unwrap() {
        AnyTexture::Image(image) => Some((file, image)),
        AnyTexture::Light(_) => None,
    };
    files.into_iter().filter_map(image).collect()
}

#[test]
fn the_example_decodes_as_rust_does() {
    let dir = TempDir::new().unwrap();
    let program = build("examples/c/decode.c", &dir);
    let (file, image) = golden().swap_remove(0);
    let out = dir.path().join("out.pam");
    let done = run(Command::new(&program).arg(&file).arg(&out));
    assert!(done.status.success(), "{}", text(&done.stderr));
    let whole = image.as_encoded().layout().whole(0, 0).unwrap();
    let mut rgba = vec![0; 4 * whole.width as usize * whole.height as usize];
    image.decode_rgba8(whole, &mut rgba, 4 * whole.width as usize).unwrap();
    assert!(fs::read(&out).unwrap().ends_with(&rgba));

    let light = texfold_testkit::fixtures_dir().join("golden/lightfield.txf");
    let refused = run(Command::new(&program).arg(light).arg(dir.path().join("light.pam")));
    assert!(!refused.status.success() && text(&refused.stderr).contains("codec number"));
    assert!(!dir.path().join("light.pam").exists());
}

/// FNV-1a, as the program has it.
fn hash_of(bytes: impl IntoIterator<Item = u8>) -> u64 {
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(1_099_511_628_211);
    bytes.into_iter().fold(14_695_981_039_346_656_037, step)
}

/// What the program prints of a texture.
fn lines(file: &Path, image: &AnyImage) -> Vec<String> {
    let layout = image.as_encoded().layout();
    let mut lines = Vec::new();
    for number in 0..layout.images.len() as u32 {
        for level in 0..layout.levels {
            let whole = layout.whole(number, level).unwrap();
            let (width, height) = (whole.width as usize, whole.height as usize);
            let mut eight = vec![0; 4 * width * height];
            image.decode_rgba8(whole, &mut eight, 4 * width).unwrap();
            let mut sixteen = vec![Texel::ZERO; width * height];
            image.as_encoded().decode(whole, &mut sixteen).unwrap();
            let round = |value: f32| (value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16;
            let sixteen = sixteen.iter().flat_map(|texel| texel.to_array()).map(round);
            lines.push(format!(
                "{} {} {number} {level} {width}x{height} {:016x} {:016x}",
                file.display(),
                image.codec().name,
                hash_of(eight),
                hash_of(sixteen.flat_map(u16::to_ne_bytes)),
            ));
        }
    }
    lines
}

#[test]
fn all_golden_files_decode_as_in_rust_and_misuse_is_refused() {
    let dir = TempDir::new().unwrap();
    let program = build("tests/check.c", &dir);
    let golden = golden();
    let wanted: Vec<String> = golden.iter().flat_map(|(file, image)| lines(file, image)).collect();
    let valgrind = Command::new("valgrind").arg("--version").output().is_ok();
    assert!(valgrind || !is_required(), "valgrind is required and not installed");
    let mut command = if valgrind {
        let mut command = Command::new("valgrind");
        command.args(["--quiet", "--error-exitcode=99", "--leak-check=full"]);
        command.args(["--show-leak-kinds=definite", "--errors-for-leak-kinds=definite"]);
        command.arg(format!("--suppressions={}", crate_dir().join("tests/valgrind.supp").display()));
        command.arg(&program);
        command
    } else {
        Command::new(&program)
    };
    let done = run(command.args(golden.iter().map(|(file, _)| file)));
    assert!(done.status.success(), "{}: {}", done.status, text(&done.stderr));
    let printed = text(&done.stdout);
    let found: Vec<&str> =
        printed.lines().filter(|line| line.starts_with(std::path::MAIN_SEPARATOR)).collect();
    assert_eq!(found, wanted);
    for expected in
        ["limit: texels: ", "file: not a .txf file", "effort: effort 'quick'; give one of fast, normal, high"]
    {
        assert!(printed.lines().any(|line| line.starts_with(expected)), "no line {expected}: {printed}");
    }
}

#[test]
fn the_vulkan_example_decodes_as_the_cpu_does() {
    let dir = TempDir::new().unwrap();
    let has_headers = Path::new("/usr/include/vulkan/vulkan.h").exists();
    let has_compiler = Command::new("c++").arg("--version").output().is_ok();
    if !has_headers || !has_compiler {
        assert!(!is_required(), "a C++ compiler and libvulkan-dev are required and not installed");
        println!("no C++ compiler, or no headers of Vulkan: the example is not built");
        return;
    }
    let program = build_by("c++", &["-std=c++17"], "examples/cpp/decode_vulkan.cpp", &["-lvulkan"], &dir);
    let shaders = dir.path().join("shaders");
    // Where the workspace was built, it is there.
    let built = library_dir().join("../texfold");
    let mut texfold = if built.exists() { Command::new(built) } else { Command::new(env!("CARGO")) };
    if texfold.get_program() == env!("CARGO") {
        texfold.args(["run", "--quiet", "--package", "texfold-cli", "--"]);
    }
    texfold.args(["shaders", "dct", "--lang", "spirv", "--out"]).arg(&shaders).current_dir(crate_dir());
    let written = texfold.output().unwrap();
    assert!(written.status.success(), "{}", text(&written.stderr));
    for (file, image) in golden().iter().filter(|(_, image)| image.codec().name == "dct") {
        let done = run(Command::new(&program).arg(file).arg(&shaders));
        let printed = text(&done.stdout);
        assert!(done.status.success(), "{}: {printed}{}", file.display(), text(&done.stderr));
        let levels = image.as_encoded().gpu().decoded_images().next().unwrap().levels as usize;
        let equal = printed.lines().filter(|line| line.starts_with("level ") && line.ends_with(" equal"));
        assert_eq!(equal.count(), levels, "{}: {printed}", file.display());
    }
}

//! `tidy`: the invariants of ARCHITECTURE.md that can be seen in manifests and source text.
//!
//! * each package depends on what [`ALLOWED`] lists for it and on nothing else: so the core knows no codec, codecs know neither
//!   each other (but content planes of bc) nor wgpu nor image formats, and only texfold-gpu links wgpu;
//! * each of the packages that the project stands on is used ([`NAMED`]);
//! * the facade exports the names that `crates/texfold/api.txt` lists ([`crate::api`]);
//! * no function is longer than 80 lines, no file longer than 600 without documentation and tests, in Rust and in WGSL.
//!
//! Lines of functions are counted from signature to closing brace, found by braces outside of strings and comments;
//! *not done*: strings of several lines that hold single braces, which rustfmt'd code here has none of. Dependencies
//! that only tests use are free.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Most lines of a function, signature and closing brace counted.
const FUNCTION_LINES: usize = 80;
/// Most lines of a file without documentation, blank lines and tests.
const FILE_LINES: usize = 600;

/// A package by its folder, and all that it may depend on.
struct Allowed {
    package: &'static str,
    /// Whether [`NUMERIC`] is allowed, too.
    numeric: bool,
    may: &'static [&'static str],
}

/// Packages that the project stands on: each is used by one of its own.
const NAMED: [&str; 8] = ["criterion", "glam", "image", "kiddo", "ndarray", "rayon", "texpresso", "wgpu"];

/// What any package with numbers in it may use.
const NUMERIC: [&str; 4] = ["bytemuck", "glam", "rayon", "thiserror"];

/// Everything that packages may depend on. A codec knows core, bc and the crates of methods, never another codec.
const ALLOWED: [Allowed; 26] = [
    Allowed { package: "core", numeric: true, may: &["blake3", "pulp", "ruzstd", "zstd"] },
    Allowed { package: "bc", numeric: true, may: &["dds", "texfold-core", "texpresso"] },
    Allowed { package: "dct", numeric: true, may: &["texfold-bc", "texfold-core"] },
    Allowed { package: "residual", numeric: true, may: &["texfold-bc", "texfold-core"] },
    Allowed { package: "codebook", numeric: true, may: &["ndarray", "texfold-core"] },
    Allowed { package: "match", numeric: true, may: &["kiddo", "texfold-core"] },
    Allowed {
        package: "vq",
        numeric: true,
        may: &["ndarray", "texfold-bc", "texfold-codebook", "texfold-core"],
    },
    Allowed {
        package: "epitome",
        numeric: true,
        may: &["texfold-bc", "texfold-core", "texfold-dct", "texfold-match", "texfold-residual"],
    },
    Allowed {
        package: "progressive",
        numeric: true,
        may: &["texfold-bc", "texfold-core", "texfold-match", "texfold-residual"],
    },
    Allowed {
        package: "lightfield",
        numeric: true,
        may: &["delaunator", "ndarray", "texfold-bc", "texfold-codebook", "texfold-core", "texfold-dct"],
    },
    Allowed { package: "zipmap", numeric: true, may: &["texfold-bc", "texfold-core", "texfold-dct"] },
    Allowed {
        package: "texfold",
        numeric: false,
        may: &[
            // Categories and files of banks.
            "ndarray",
            // Lists of banks.
            "serde",
            "serde_json",
            "tempfile",
            "texfold-bc",
            "texfold-codebook",
            "texfold-core",
            "texfold-dct",
            "texfold-epitome",
            "texfold-lightfield",
            "texfold-progressive",
            "texfold-residual",
            "texfold-vq",
            "texfold-zipmap",
            "thiserror",
        ],
    },
    Allowed {
        package: "capture",
        numeric: true,
        may: &[
            "base64",
            "gltf",
            "image",
            "roxmltree",
            "serde",
            "serde-ply",
            "serde_json",
            "texfold",
            "thiserror",
            "tobj",
        ],
    },
    Allowed { package: "chart", numeric: false, may: &[] },
    Allowed { package: "shaders", numeric: true, may: &["texfold-core"] },
    Allowed {
        package: "gpu",
        numeric: true,
        may: &["pollster", "range-alloc", "texfold-core", "texfold-shaders", "wgpu", "wgpu29"],
    },
    Allowed {
        package: "cli",
        numeric: true,
        may: &[
            "base64",
            "blake3",
            "clap",
            "ctt-astcenc",
            "dds",
            "exr",
            "butteraugli",
            "fast-ssim2",
            "flate2",
            "glob",
            "gltf",
            "image",
            "indicatif",
            // A texture of JPEG, beside which ours are compared.
            "jpeg-encoder",
            "jxl-oxide",
            "ktx2",
            "moxcms",
            "naga",
            "ndarray",
            "percent-encoding",
            "png",
            "serde",
            "serde_json",
            "sysinfo",
            "tempfile",
            "texfold",
            "texfold-bc",
            "texfold-capture",
            "texfold-chart",
            "texfold-codebook",
            "texfold-core",
            "texfold-dct",
            "texfold-gpu",
            // The bank is built of the parts of this codec and of dct.
            "texfold-progressive",
            "texfold-shaders",
            "tiff",
            "roxmltree",
            "tiny_http",
            "toml",
            // Levels of KTX2.
            "zstd",
        ],
    },
    Allowed { package: "testkit", numeric: true, may: &["image", "texfold-core", "texfold-shaders"] },
    Allowed {
        package: "benches",
        numeric: true,
        may: &[
            "image",
            "jpeg-encoder",
            "texfold",
            "texfold-capture",
            "texfold-chart",
            "texfold-cli",
            "texfold-core",
            "texfold-epitome",
            "texfold-gpu",
            "texfold-match",
            "texfold-progressive",
            "texfold-testkit",
            "texfold-vq",
            "tempfile",
            "tiff",
        ],
    },
    Allowed {
        package: "checks",
        numeric: true,
        may: &[
            "base64",
            "blake3",
            "clap",
            "image",
            "serde_json",
            "texfold",
            "texfold-chart",
            "texfold-cli",
            "texfold-gpu",
            "texfold-shaders",
            "texfold-testkit",
        ],
    },
    // Built before anything else, and again after each edit: it knows no codec.
    Allowed { package: "xtask", numeric: false, may: &["clap"] },
    Allowed { package: "ffi", numeric: false, may: &["rayon", "texfold", "texfold-shaders"] },
    Allowed {
        package: "python",
        numeric: false,
        may: &["glam", "numpy", "pyo3", "rayon", "texfold", "texfold-capture", "texfold-shaders"],
    },
    // As "window", of a workspace of its own.
    Allowed {
        package: "bevy",
        numeric: false,
        may: &[
            "bevy_app",
            "bevy_asset",
            "bevy_color",
            "bevy_ecs",
            "bevy_image",
            "bevy_material",
            "bevy_pbr",
            "bevy_reflect",
            "bevy_render",
            "bevy_shader",
            "serde",
            "texfold",
            "texfold-gpu",
            "thiserror",
            "tracing",
            "wgpu-types",
        ],
    },
    Allowed {
        package: "window",
        numeric: true,
        may: &["clap", "pollster", "texfold", "texfold-gpu", "texfold-shaders", "tobj", "winit"],
    },
    Allowed {
        package: "fuzz",
        numeric: false,
        may: &["libfuzzer-sys", "texfold", "texfold-cli", "texfold-core"],
    },
];

/// Runs the command.
pub(crate) fn run() -> ExitCode {
    match check(&crate::root()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: the workspace cannot be read; check its permissions: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Whether the workspace is tidy; what is not is named on stderr.
pub(crate) fn check(root: &Path) -> io::Result<bool> {
    let mut faults = Vec::new();
    check_manifests(root, &mut faults)?;
    crate::api::check(root, &mut faults)?;
    for path in sources(root)? {
        let text = fs::read_to_string(&path)?;
        let name = path.strip_prefix(root).unwrap_or(&path).display().to_string();
        check_source(&name, &text, &mut faults);
    }
    for fault in &faults {
        eprintln!("error: {fault}");
    }
    Ok(faults.is_empty())
}

fn check_manifests(root: &Path, faults: &mut Vec<String>) -> io::Result<()> {
    let mut folders: Vec<PathBuf> =
        fs::read_dir(root.join("crates"))?.flatten().map(|entry| entry.path()).collect();
    folders.extend(["shaders", "benches", "xtask"].map(|name| root.join(name)));
    folders.sort();
    let mut used = Vec::new();
    for folder in folders {
        let manifest = folder.join("Cargo.toml");
        if !manifest.is_file() {
            continue;
        }
        let package = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let manifest = fs::read_to_string(&manifest)?;
        // Benches alone use some of them.
        used.extend(
            manifest.lines().filter_map(|line| line.split(['.', '=', ' ']).next()).map(str::to_owned),
        );
        check_dependencies(&package, &dependencies(&manifest), faults);
    }
    for name in NAMED.iter().filter(|name| !used.iter().any(|used| used == *name)) {
        faults.push(format!("no package uses {name}, which the project stands on; use it where it fits"));
    }
    Ok(())
}

fn check_dependencies(package: &str, dependencies: &[String], faults: &mut Vec<String>) {
    let Some(row) = ALLOWED.iter().find(|row| row.package == package) else {
        faults.push(format!(
            "package {package} is not in the list of allowed dependencies; add it in xtask/src/tidy.rs"
        ));
        return;
    };
    let allowed = |name: &str| row.may.contains(&name) || (row.numeric && NUMERIC.contains(&name));
    for dependency in dependencies.iter().filter(|name| !allowed(name)) {
        faults.push(format!(
            "package {package} may not depend on {dependency}; move what needs it up a layer, or allow it in \
             xtask/src/tidy.rs with a reason in the commit"
        ));
    }
}

/// Names under `[dependencies]` and `[build-dependencies]`; what only tests use is free.
fn dependencies(manifest: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut inside = false;
    for line in manifest.lines().map(str::trim) {
        if let Some(section) = line.strip_prefix('[') {
            inside = section.ends_with("dependencies]") && !section.starts_with("dev-");
        } else if inside && !line.starts_with('#') {
            let name = line.split(['.', '=', ' ']).next().unwrap_or_default();
            if !name.is_empty() {
                names.push(name.to_owned());
            }
        }
    }
    names
}

/// Rust and WGSL files of the workspace.
fn sources(root: &Path) -> io::Result<Vec<PathBuf>> {
    let mut open: Vec<PathBuf> =
        ["crates", "shaders", "benches", "xtask", "fuzz"].map(|name| root.join(name)).into();
    let mut found = Vec::new();
    while let Some(folder) = open.pop() {
        if !folder.is_dir() {
            continue;
        }
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() && !path.ends_with("target") {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs" || extension == "wgsl") {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Lines of a file that are neither blank, nor documentation, nor tests; 0 for files that are tests as a whole.
fn code_lines(name: &str, text: &str) -> usize {
    if name.contains("/tests/") || name.contains("/benches/benches/") {
        return 0;
    }
    // Modules of tests stand last.
    let code = text.split("\n#[cfg(test)]\nmod ").next().unwrap_or(text);
    let counts = |line: &&str| !line.is_empty() && !line.starts_with("//");
    code.lines().map(str::trim).filter(counts).count()
}

fn check_source(name: &str, text: &str, faults: &mut Vec<String>) {
    let lines = code_lines(name, text);
    if lines > FILE_LINES {
        faults.push(format!("{name} has {lines} lines of code; split it (at most {FILE_LINES})"));
    }
    for (line, function, length) in functions(text) {
        if length > FUNCTION_LINES {
            let most = FUNCTION_LINES;
            faults.push(format!(
                "{name}:{line}: function {function} has {length} lines; split it (at most {most})"
            ));
        }
    }
}

/// A function whose closing brace is still to come.
struct Open {
    /// Its first line, from 1.
    line: usize,
    name: String,
    /// How many braces are open within its body; `None` before the body.
    depth: Option<usize>,
}

/// First line, name and number of lines of each function with a body.
fn functions(text: &str) -> Vec<(usize, String, usize)> {
    let mut found = Vec::new();
    let mut open: Vec<Open> = Vec::new();
    let mut depth = 0usize;
    for (index, line) in text.lines().enumerate() {
        let code = code_of(line);
        if let Some(name) = function_name(&code) {
            open.push(Open { line: index + 1, name, depth: None });
        }
        for letter in code.chars() {
            if letter == '{' {
                depth += 1;
                if let Some(function) = open.last_mut().filter(|function| function.depth.is_none()) {
                    function.depth = Some(depth);
                }
            } else if letter == '}' {
                if let Some(function) = open.pop_if(|function| function.depth == Some(depth)) {
                    found.push((function.line, function.name, index + 2 - function.line));
                }
                depth = depth.saturating_sub(1);
            }
        }
        if code.trim_end().ends_with(';') {
            // A declaration without a body.
            open.pop_if(|function| function.depth.is_none());
        }
    }
    found
}

/// The name of the function that a line declares.
fn function_name(code: &str) -> Option<String> {
    let words: Vec<&str> = code.split_whitespace().collect();
    let place = words.iter().position(|&word| word == "fn")?;
    let before = ["pub", "pub(crate)", "pub(super)", "const", "async", "unsafe", "extern", "default"];
    let is_declaration = words[..place].iter().all(|word| before.contains(word) || word.starts_with('@'));
    let name = words.get(place + 1)?.split(['(', '<']).next()?;
    (is_declaration && !name.is_empty()).then(|| name.to_owned())
}

/// A line without comments, and without what stands in quotation marks.
fn code_of(line: &str) -> String {
    let mut code = String::new();
    let mut letters = line.chars().peekable();
    let mut quoted = false;
    while let Some(letter) = letters.next() {
        match letter {
            '\\' if quoted => _ = letters.next(),
            '"' => quoted = !quoted,
            _ if quoted => {}
            '/' if letters.peek() == Some(&'/') => break,
            '\'' => skip_char_literal(&mut letters),
            _ => code.push(letter),
        }
    }
    code
}

/// Skips `{'`, `"'` and `\n'` after an opening apostrophe; a lifetime stays.
fn skip_char_literal(letters: &mut std::iter::Peekable<std::str::Chars<'_>>) {
    let mut ahead = letters.clone();
    let length = match (ahead.next(), ahead.next(), ahead.next()) {
        (Some('\\'), _, Some('\'')) => 3,
        (Some(_), Some('\''), _) => 2,
        _ => 0,
    };
    for _ in 0..length {
        letters.next();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_measured_from_signature_to_brace() {
        let text = "impl X {\n    pub(crate) fn a(\n        x: [u8; 4],\n    ) -> u8 {\n        // }\n        let c = '{';\n\
                    \n        format!(\"}}\");\n    }\n}\ntrait T {\n    fn b(&self);\n    fn c() {}\n}\n";
        let found = functions(text);
        assert_eq!(found, [(2, "a".to_owned(), 8), (13, "c".to_owned(), 1)]);
    }

    #[test]
    fn long_functions_and_files_are_named() {
        let mut faults = Vec::new();
        let body = "    x();\n".repeat(79);
        check_source("a.rs", &format!("fn long() {{\n{body}}}\nfn short() {{\n}}\n"), &mut faults);
        assert_eq!(faults, ["a.rs:1: function long has 81 lines; split it (at most 80)"]);
        let code = "x();\n".repeat(600);
        let around = format!("//! Doc.\n\n{code}\n#[cfg(test)]\nmod tests {{\n{code}}}\n");
        check_source("b.rs", &around, &mut faults);
        assert_eq!(faults.len(), 1, "documentation and tests do not count: {faults:?}");
        check_source("b.rs", &format!("x();\n{around}"), &mut faults);
        assert_eq!(faults[1], "b.rs has 601 lines of code; split it (at most 600)");
        check_source("crates/b/tests/b.rs", &format!("x();\n{around}"), &mut faults);
        assert_eq!(faults.len(), 2);
    }

    #[test]
    fn what_is_not_allowed_is_named() {
        let manifest = "[package]\nname = \"x\"\n[dependencies]\nglam.workspace = true\nwgpu = \"1\"\n\
                        texfold-vq = { workspace = true, optional = true }\n\
                        [dev-dependencies]\nimage.workspace = true\n";
        let names = dependencies(manifest);
        assert_eq!(names, ["glam", "wgpu", "texfold-vq"]);
        let mut faults = Vec::new();
        check_dependencies("epitome", &names, &mut faults);
        check_dependencies("gpu", &names, &mut faults);
        check_dependencies("unheard-of", &names, &mut faults);
        let named = |fault: &String| fault.split(';').next().unwrap_or_default().to_owned();
        assert_eq!(
            faults.iter().map(named).collect::<Vec<_>>(),
            [
                "package epitome may not depend on wgpu",
                "package epitome may not depend on texfold-vq",
                "package gpu may not depend on texfold-vq",
                "package unheard-of is not in the list of allowed dependencies",
            ]
        );
    }

    #[test]
    fn no_codec_may_know_another_but_bc_and_none_may_know_the_gpu() {
        let codecs = ["bc", "vq", "epitome", "progressive", "lightfield", "zipmap"];
        for row in ALLOWED.iter().filter(|row| codecs.contains(&row.package)) {
            let other = |name: &&&str| codecs.iter().any(|codec| **name == format!("texfold-{codec}"));
            let known: Vec<_> = row.may.iter().filter(other).collect();
            assert!(known.iter().all(|name| **name == "texfold-bc"), "{}: {known:?}", row.package);
            assert!(!row.may.contains(&"wgpu") && !row.may.contains(&"image"), "{}", row.package);
        }
        let with_wgpu: Vec<&str> =
            ALLOWED.iter().filter(|row| row.may.contains(&"wgpu")).map(|row| row.package).collect();
        assert_eq!(with_wgpu, ["gpu"]);
    }
}

//! `tidy`: the invariants of ARCHITECTURE.md that can be seen in manifests and source text.
//!
//! * the core knows no codec, no GPU library and no image format;
//! * codecs know neither wgpu nor image formats nor each other (vq builds on the blocks of bc);
//! * only texfold-gpu links wgpu;
//! * no function is longer than 80 lines, no file longer than 900, in Rust and in WGSL.
//!
//! Lines of functions are counted from signature to closing brace, found by braces outside of strings and comments;
//! *not done*: strings of several lines that hold single braces, which rustfmt'd code here has none of.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Most lines of a function, signature and closing brace counted.
const FUNCTION_LINES: usize = 80;
/// Most lines of a file.
const FILE_LINES: usize = 900;

/// What a package may not depend on.
struct Rule {
    package: &'static str,
    never: &'static [&'static str],
}

const CODECS_AND_ABOVE: &[&str] = &[
    "texfold",
    "texfold-bc",
    "texfold-vq",
    "texfold-epitome",
    "texfold-lightfield",
    "texfold-progressive",
    "texfold-zipmap",
    "texfold-match",
    "texfold-codebook",
    "texfold-gpu",
    "texfold-cli",
    "texfold-shaders",
    "wgpu",
    "naga",
    "image",
    "dds",
    "ktx2",
    "texpresso",
];

const RULES: [Rule; 9] = [
    Rule { package: "core", never: CODECS_AND_ABOVE },
    Rule {
        package: "bc",
        never: &["texfold-vq", "texfold-codebook", "texfold", "texfold-gpu", "wgpu", "image"],
    },
    Rule {
        package: "vq",
        never: &[
            "texfold-epitome",
            "texfold-match",
            "texfold",
            "texfold-gpu",
            "texfold-cli",
            "wgpu",
            "image",
        ],
    },
    Rule {
        package: "epitome",
        never: &["texfold-vq", "texfold", "texfold-gpu", "texfold-cli", "wgpu", "image"],
    },
    Rule {
        package: "lightfield",
        never: &[
            "texfold-vq",
            "texfold-epitome",
            "texfold-match",
            "texfold",
            "texfold-gpu",
            "texfold-cli",
            "wgpu",
            "image",
        ],
    },
    Rule {
        package: "progressive",
        never: &["texfold-vq", "texfold-epitome", "texfold", "texfold-gpu", "texfold-cli", "wgpu", "image"],
    },
    Rule {
        package: "zipmap",
        never: &["texfold-vq", "texfold-epitome", "texfold", "texfold-gpu", "texfold-cli", "wgpu", "image"],
    },
    Rule {
        package: "match",
        never: &["texfold-bc", "texfold-vq", "texfold-epitome", "texfold", "texfold-gpu", "wgpu", "image"],
    },
    Rule {
        package: "codebook",
        never: &["texfold-bc", "texfold-vq", "texfold", "texfold-gpu", "wgpu", "image"],
    },
];

/// The only package that links the GPU library.
const GPU_PACKAGE: &str = "gpu";

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
    for folder in folders {
        let manifest = folder.join("Cargo.toml");
        if !manifest.is_file() {
            continue;
        }
        let package = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let dependencies = dependencies(&fs::read_to_string(&manifest)?);
        check_dependencies(&package, &dependencies, faults);
    }
    Ok(())
}

fn check_dependencies(package: &str, dependencies: &[String], faults: &mut Vec<String>) {
    let never = RULES.iter().find(|rule| rule.package == package).map_or(&[][..], |rule| rule.never);
    for dependency in dependencies {
        if never.contains(&dependency.as_str()) {
            faults.push(format!("package {package} depends on {dependency}; move what needs it up a layer"));
        }
        if dependency == "wgpu" && package != GPU_PACKAGE {
            faults.push(format!("package {package} depends on wgpu; go through texfold-gpu"));
        }
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

fn check_source(name: &str, text: &str, faults: &mut Vec<String>) {
    let lines = text.lines().count();
    if lines > FILE_LINES {
        faults.push(format!("{name} has {lines} lines; split it (at most {FILE_LINES})"));
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
        check_source("b.rs", &"//\n".repeat(901), &mut faults);
        assert_eq!(faults[1], "b.rs has 901 lines; split it (at most 900)");
    }

    #[test]
    fn forbidden_dependencies_are_named() {
        let manifest = "[package]\nname = \"x\"\n[dependencies]\nglam.workspace = true\nwgpu = \"1\"\n\
                        [dev-dependencies]\nimage.workspace = true\n";
        let names = dependencies(manifest);
        assert_eq!(names, ["glam", "wgpu"]);
        let mut faults = Vec::new();
        check_dependencies("core", &names, &mut faults);
        check_dependencies("gpu", &names, &mut faults);
        assert_eq!(faults.len(), 2, "{faults:?}");
    }
}

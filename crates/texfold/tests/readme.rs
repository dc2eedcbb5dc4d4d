//! Code in the README is that of examples, which compile and run.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::fs;
use std::path::{Path, PathBuf};

/// Most lines of the README.
const LINES: usize = 200;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn its_code_stands_in_examples() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let embed = fs::read_to_string(root().join("crates/texfold/examples/embed.rs")).unwrap();
    let snippet = |name: &str| {
        let example = fs::read_to_string(root().join("crates/gpu/examples").join(name)).unwrap();
        let rest = example.split("// README: from here\n").nth(1).unwrap();
        rest.split("// README: to here").next().unwrap().to_owned()
    };
    let code: Vec<&str> =
        readme.split("```rust\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    assert_eq!(code.len(), 4);
    assert!(embed.ends_with(code[0]), "differs from crates/texfold/examples/embed.rs");
    for (code, name) in code[1..].iter().zip(["hardware.rs", "room.rs", "material.rs"]) {
        assert_eq!(*code, snippet(name), "differs from crates/gpu/examples/{name}");
    }
}

#[test]
fn it_is_short() {
    let lines = fs::read_to_string(root().join("README.md")).unwrap().lines().count();
    assert!(lines <= LINES, "{lines} lines");
}

//! The names that the facade exports, held against a list that is committed: it grows on purpose.

use std::fs;
use std::io;
use std::path::Path;

/// File of the exports, and the list that they are held to.
const FACADE: &str = "crates/texfold/src/lib.rs";
const LIST: &str = "crates/texfold/api.txt";

/// Names the faults of the list: what is exported and not listed, and what is listed and not exported.
pub(crate) fn check(root: &Path, faults: &mut Vec<String>) -> io::Result<()> {
    let exported = exports(&fs::read_to_string(root.join(FACADE))?);
    let listed: Vec<String> = fs::read_to_string(root.join(LIST))?
        .lines()
        .filter(|line| !line.is_empty())
        .map(str::to_owned)
        .collect();
    for name in exported.iter().filter(|name| !listed.contains(name)) {
        faults.push(format!("{FACADE} exports {name}; add it to {LIST} if users shall keep to it"));
    }
    for name in listed.iter().filter(|name| !exported.contains(name)) {
        faults.push(format!("{LIST} has {name}, which {FACADE} does not export; remove it, or export it"));
    }
    Ok(())
}

/// Names of `pub use` and `pub mod`, sorted; `*` for a glob.
fn exports(text: &str) -> Vec<String> {
    let mut names = Vec::new();
    let code: String =
        text.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    for statement in code.split(';').map(str::trim) {
        let statement = statement
            .lines()
            .filter(|line| !line.trim_start().starts_with('#'))
            .collect::<Vec<_>>()
            .join(" ");
        if let Some(module) = statement.trim().strip_prefix("pub mod ") {
            names.push(module.trim().to_owned());
        } else if let Some(tree) = statement.trim().strip_prefix("pub use ") {
            let (path, leaves) = tree.split_once('{').unwrap_or(("", tree));
            let last = path.trim_end_matches("::").rsplit("::").next().unwrap_or_default();
            let leaf = |leaf: &str| {
                let leaf = leaf.trim();
                let name =
                    leaf.rsplit(" as ").next().unwrap_or(leaf).rsplit("::").next().unwrap_or(leaf).trim();
                if name == "self" { last.to_owned() } else { name.to_owned() }
            };
            let leaves = leaves.trim_end_matches('}').split(',').map(leaf);
            names.extend(leaves.filter(|name| !name.is_empty()));
        }
    }
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_users_write() {
        let text = "//! pub use no::this;\nmod any;\npub use any::{AnyImage, file_of};\n#[cfg(feature = \"x\")]\npub mod guide;\n\
                    pub use texfold_bc::{self as bc, Content};\npub use texfold_dct as dct;\npub use a::b::{self, c::D};\npub use e::*;\n";
        let names = ["*", "AnyImage", "Content", "D", "b", "bc", "dct", "file_of", "guide"];
        assert_eq!(exports(text), names);
    }
}

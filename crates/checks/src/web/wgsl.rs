//! WGSL in few bytes: without comments and blanks, names of the project's own that no caller needs to know shortened.

use std::collections::{HashMap, HashSet};

/// Endings of functions that renderers call, and the struct that one of them returns.
const PUBLIC: [&str; 11] = [
    "_fetch",
    "_nearest",
    "_bilinear",
    "_sample_level",
    "_sample_grad",
    "_sample",
    "_sample_image",
    "_sample_material",
    "_sample_material_level",
    "_sample_material_grad",
    "TexfoldTileMaterial",
];

/// Members of that struct: they stay, too.
const MEMBERS: [&str; 7] = ["color", "normal", "height", "emissive", "occlusion", "roughness", "metalness"];

/// Names of WGSL that texts also declare, and the constant that pipelines set: they stay.
const KEPT: [&str; 36] = [
    "LOOKUP",
    "abs",
    "all",
    "any",
    "clamp",
    "cross",
    "distance",
    "dot",
    "exp2",
    "floor",
    "flat",
    "fract",
    "function",
    "length",
    "log2",
    "max",
    "min",
    "mix",
    "normalize",
    "position",
    "pow",
    "private",
    "read",
    "reflect",
    "round",
    "select",
    "sign",
    "sqrt",
    "step",
    "storage",
    "texture",
    "trunc",
    "uniform",
    "vertex",
    "workgroup",
    "write",
];

/// A short name for each name of the texts' own, those that save most first. A name means the same in all texts, so that texts can be put
/// together.
pub(crate) fn short_names<'t>(texts: impl Iterator<Item = &'t str> + Clone) -> HashMap<&'t str, String> {
    let declared: HashSet<&str> = texts.clone().flat_map(declared).collect();
    let mut counts: HashMap<&str, usize> = HashMap::new();
    let used = texts.flat_map(lines_of_code).flat_map(words);
    for word in used.filter(|word| is_own(word) || declared.contains(word)) {
        *counts.entry(word).or_default() += 1;
    }
    let mut names: Vec<(&str, usize)> = counts.into_iter().collect();
    names.sort_by_key(|&(name, count)| (std::cmp::Reverse(count * name.len()), name));
    let short = |number: usize| format!("T{}", base36(number));
    names.into_iter().enumerate().map(|(number, (name, _))| (name, short(number))).collect()
}

/// Names of variables, constants, members and parameters that a text declares, of more than two letters: shorter ones may be components of
/// vectors.
fn declared(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    for code in lines_of_code(text) {
        let words: Vec<&str> = words(code).filter(|word| !word.trim().is_empty()).collect();
        for (number, word) in words.iter().enumerate() {
            let before = number.checked_sub(1).map(|before| words[before]);
            let is_value = ["let", "var", "const", ">"].iter().any(|kind| before == Some(kind))
                && words.get(number + 1) == Some(&"=");
            let is_typed = words.get(number + 1) == Some(&":");
            if (is_value || is_typed) && word.starts_with(is_name) {
                found.push(*word);
            }
        }
    }
    let stays = |name: &str| {
        name.len() < 3
            || KEPT.contains(&name)
            || MEMBERS.contains(&name)
            || name.starts_with("TEXFOLD_")
            || is_public(name)
    };
    found.retain(|name| !stays(name) && *name != "default");
    found
}

fn is_public(name: &str) -> bool {
    PUBLIC.iter().any(|ending| name.ends_with(ending))
}

/// Whether a name is the project's own and none that callers use or that is replaced by a number.
fn is_own(word: &str) -> bool {
    let begins = ["texfold_", "TEXFOLD_", "Texfold"].iter().any(|beginning| word.starts_with(beginning));
    let is_place = ["TEXFOLD_GROUP", "TEXFOLD_ANISOTROPY", "TEXFOLD_STRIDE", "TEXFOLD_TILE_COLOURS"]
        .contains(&word)
        || word.starts_with("TEXFOLD_BINDING_");
    begins && !is_place && !is_public(word)
}

fn base36(number: usize) -> String {
    let digit = char::from_digit((number % 36) as u32, 36).unwrap_or('0');
    if number < 36 { digit.to_string() } else { base36(number / 36) + &digit.to_string() }
}

/// The text without comments and blanks that separate nothing, with the names of `names`.
pub(crate) fn short(text: &str, names: &HashMap<&str, String>) -> String {
    let mut out = String::new();
    let mut is_apart = false;
    for code in lines_of_code(text) {
        for word in words(code) {
            if word.trim().is_empty() {
                is_apart = true;
                continue;
            }
            let between_names = out.ends_with(is_name) && word.starts_with(is_name);
            // Two signs may be another one without a blank.
            let between_signs = out.ends_with(['-', '+', '&', '|', '<', '>', '='])
                && word.starts_with(['-', '+', '&', '|', '<', '>', '=', '*']);
            if is_apart && (between_names || between_signs) {
                out.push(' ');
            }
            is_apart = false;
            let is_attribute = ["@", "@builtin(", "@interpolate("].iter().any(|start| out.ends_with(start));
            let short = names.get(word).filter(|_| !is_attribute);
            out += short.map_or(word, String::as_str);
        }
        is_apart = true;
    }
    out.push('\n');
    out.replace(",)", ")").replace(",}", "}")
}

/// The lines of a text without comments.
fn lines_of_code(text: &str) -> impl Iterator<Item = &str> {
    text.lines().map(|line| line.split("//").next().unwrap_or_default())
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// A text in pieces: names and numbers, blanks, single signs.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text;
    std::iter::from_fn(move || {
        let first = rest.chars().next()?;
        let kind = |c: char| (is_name(c), c.is_whitespace());
        let alike = |c: char| kind(c) == kind(first) && (is_name(c) || c.is_whitespace());
        let end = rest.find(|c: char| !alike(c)).unwrap_or(rest.len()).max(first.len_utf8());
        let (word, behind) = rest.split_at(end);
        rest = behind;
        Some(word)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meaning_stays_and_public_names_stay() {
        let text = "// A comment.\nfn texfold_bc_sample(uv: vec2<f32>) -> u32 {\n    // Another.\n    let length_of = 2u;\n    return texfold_x(a - -b, length_of,\n    );\n}\n";
        let names = short_names([text].into_iter());
        assert_eq!(names.len(), 2);
        let expected = "fn texfold_bc_sample(uv:vec2<f32>)->u32{let T0=2u;return T1(a- -b,T0);}\n";
        assert_eq!(short(text, &names), expected);
        let commented = format!("// texfold_x, texfold_x, texfold_y\n{text}");
        assert_eq!(short_names([commented.as_str()].into_iter()), names);
    }
}

//! Pasting: any number of textures, of one codec or of several, in one shader.
//!
//! Composition is text. Names of a module's WGSL begin with `texfold_vq`, `TexfoldVq` or `TEXFOLD_VQ`; a slot with a prefix
//! replaces these beginnings, word by word, so that two textures of one module do not declare the same names. *Not done*: a
//! shader preprocessor, since nothing but names and binding numbers differs between two textures.

use std::fmt;
use std::ops::Range;

use crate::{ModuleInfo, shared};

/// A texture in a renderer's shader: its module, where it is bound, and what its names begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot<'a> {
    module: &'static ModuleInfo,
    group: u32,
    first_binding: u32,
    prefix: Option<&'a str>,
}

/// Why slots cannot stand in one shader.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PasteError {
    /// A prefix is no name, or one that belongs to this crate.
    Prefix {
        /// The prefix.
        prefix: String,
    },
    /// Two slots declare one name: they have the same prefix, or none and the same module.
    Name {
        /// A name that both declare.
        name: String,
    },
    /// Two slots take one binding.
    Binding {
        /// Its group.
        group: u32,
        /// Its number.
        binding: u32,
    },
}

impl std::error::Error for PasteError {}

impl fmt::Display for PasteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PasteError::Prefix { prefix } => write!(
                f,
                "{prefix:?} cannot begin WGSL names; use lower-case letters, digits and single underscores, a letter first, \
                 and not \"texfold\""
            ),
            PasteError::Name { name } => {
                write!(f, "two textures of the shader declare {name}; give each its own prefix")
            }
            PasteError::Binding { group, binding } => write!(
                f,
                "two textures of the shader take binding {binding} of group {group}; begin behind the range that the other uses"
            ),
        }
    }
}

impl<'a> Slot<'a> {
    /// A texture of `module` with its bindings in `group` from `first_binding` on, in the order of [`ModuleInfo::bindings`]. Its
    /// names are those in `wgsl/`: `texfold_vq_sample` and so on.
    #[must_use]
    pub fn new(module: &'static ModuleInfo, group: u32, first_binding: u32) -> Self {
        Slot { module, group, first_binding, prefix: None }
    }

    /// The same with names that begin with `prefix`, in snake case, in place of `texfold_vq`: `albedo_sample`, `AlbedoParams`,
    /// `ALBEDO_SPLIT`.
    #[must_use]
    pub fn named(self, prefix: &'a str) -> Self {
        Slot { prefix: Some(prefix), ..self }
    }

    /// The module.
    #[must_use]
    pub fn module(&self) -> &'static ModuleInfo {
        self.module
    }

    /// The binding numbers that it takes in its group.
    #[must_use]
    pub fn bindings(&self) -> Range<u32> {
        self.first_binding..self.first_binding + self.module.bindings.len() as u32
    }

    /// The function that gives the colour at a texture coordinate: `texfold_vq_sample` or `albedo_sample`; of a light field, at a
    /// place on a triangle towards a direction.
    #[must_use]
    pub fn sample_function(&self) -> String {
        let space = self.module.namespaces.first().copied().unwrap_or_default();
        self.name(&format!("texfold_{space}_sample"))
    }

    /// What a name of the module's WGSL, such as that of a [`crate::Switch`], is in the pasted shader.
    #[must_use]
    pub fn name(&self, name: &str) -> String {
        renamed(&self.beginnings(), name).unwrap_or_else(|| name.to_owned())
    }

    /// The texture's own functions, structs, bindings and switches, without what [`shared`] holds.
    #[must_use]
    pub fn source(&self) -> String {
        let beginnings = self.beginnings();
        let mut source = String::new();
        for fragment in self.module.fragments {
            let first_binding = self.first_binding + fragment.first_binding;
            for word in words(fragment.text) {
                let number =
                    word.strip_prefix("TEXFOLD_BINDING_").and_then(|number| number.parse::<u32>().ok());
                match (number, renamed(&beginnings, word)) {
                    (Some(number), _) => source += &(first_binding + number).to_string(),
                    (None, _) if word == "TEXFOLD_GROUP" => source += &self.group.to_string(),
                    (None, Some(other)) => source += &other,
                    (None, None) => source += word,
                }
            }
            source.push('\n');
        }
        source
    }

    /// What names of the module begin with, and what they begin with in the shader; none where that is the same.
    fn beginnings(&self) -> Vec<(String, String)> {
        let Some(prefix) = self.prefix else { return Vec::new() };
        let of_space = |(number, space): (usize, &&str)| {
            let from = format!("texfold_{space}");
            // Names of fragments that modules share keep what they begin with behind the prefix.
            let to = if number == 0 { prefix.to_owned() } else { format!("{prefix}_{space}") };
            [
                (camel_case(&from), camel_case(&to)),
                (format!("{}_", from.to_uppercase()), format!("{}_", to.to_uppercase())),
                (from + "_", to + "_"),
            ]
        };
        self.module.namespaces.iter().enumerate().flat_map(of_space).collect()
    }

    fn check_prefix(&self) -> Result<(), PasteError> {
        let Some(prefix) = self.prefix else { return Ok(()) };
        let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        let is_name = prefix.starts_with(|c: char| c.is_ascii_lowercase())
            && prefix.chars().all(letters)
            && !prefix.contains("__")
            && !prefix.ends_with('_');
        // Names of shared functions begin with it.
        let is_ours = prefix.split('_').next() == Some("texfold");
        if is_name && !is_ours { Ok(()) } else { Err(PasteError::Prefix { prefix: prefix.to_owned() }) }
    }
}

/// Everything that a renderer's own shader needs to sample the textures of `slots`: shared functions once, then each slot's own.
///
/// # Errors
/// [`PasteError`] where slots take the same names or bindings.
pub fn paste(slots: &[Slot<'_>]) -> Result<String, PasteError> {
    for (number, slot) in slots.iter().enumerate() {
        slot.check_prefix()?;
        for other in slots[..number].iter().filter(|other| other.group == slot.group) {
            let binding = slot.bindings().start.max(other.bindings().start);
            if binding < slot.bindings().end.min(other.bindings().end) {
                return Err(PasteError::Binding { group: slot.group, binding });
            }
        }
    }
    let parts: Vec<String> = std::iter::once(shared()).chain(slots.iter().map(Slot::source)).collect();
    let source = parts.join("\n");
    let mut known = std::collections::HashSet::new();
    match source.lines().filter_map(declared).find(|name| !known.insert(*name)) {
        Some(name) => Err(PasteError::Name { name: name.to_owned() }),
        None => Ok(source),
    }
}

/// The name that a line of WGSL declares for the whole shader, if any.
fn declared(line: &str) -> Option<&str> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let rest = match line.strip_prefix("@group(") {
        Some(binding) => binding.split_once(" var")?.1.trim_start_matches("<uniform>").trim_start(),
        None => ["fn ", "struct ", "const ", "override "].iter().find_map(|word| line.strip_prefix(word))?,
    };
    rest.split(|c: char| !is_name(c)).next().filter(|name| !name.is_empty())
}

/// `name` with another beginning; `None` where it has none of `beginnings`.
fn renamed(beginnings: &[(String, String)], name: &str) -> Option<String> {
    beginnings.iter().find_map(|(from, to)| Some(to.clone() + name.strip_prefix(from.as_str())?))
}

/// A text in pieces: names and numbers whole, what stands between them as it is.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut rest = text;
    std::iter::from_fn(move || {
        let first = rest.chars().next()?;
        let end = rest.find(|c: char| is_name(c) != is_name(first)).unwrap_or(rest.len());
        let (word, behind) = rest.split_at(end);
        rest = behind;
        Some(word)
    })
}

/// `wall_normal` as `WallNormal`.
fn camel_case(name: &str) -> String {
    let capital = |part: &str| {
        let (first, rest) = part.split_at(part.len().min(1));
        first.to_uppercase() + rest
    };
    name.split('_').map(capital).collect()
}

//! Texfold's WGSL: decode functions to paste into a renderer, and the entry points that use them.
//!
//! [`paste`] gives the functions of a module with the bindings that the renderer chooses; the renderer's own shader
//! then calls, say, `texfold_vq_sample(uv)`. Nothing is fetched but with `textureLoad`, so every adapter gives the
//! same texels, no sampler is bound and the functions may be called from any control flow (those that take
//! derivatives say so).
//!
//! Composition is text: fragments with prefixed names, one after the other. *Not done*: a shader preprocessor; two
//! textures of one module in one shader would need a second prefix, and no renderer has asked for that yet.

mod module;

pub use module::{Binding, Module, Switch};

/// A shader that this project draws with, around a module's functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Entry {
    /// Lookups within a given level, over a rectangle of texture coordinates.
    Decode,
    /// Trilinear lookups over a rectangle of texture coordinates.
    Draw,
    /// A textured mesh.
    Mesh,
    /// The loads of a lookup without its arithmetic, to compare times with.
    Bare,
}

impl Entry {
    /// All of them.
    pub const ALL: [Entry; 4] = [Entry::Decode, Entry::Draw, Entry::Mesh, Entry::Bare];
}

const ADDRESS: &str = include_str!("../wgsl/shared/address.wgsl");
const SAMPLE: &str = include_str!("../wgsl/shared/sample.wgsl");
const VIEW: &str = include_str!("../wgsl/entry/view.wgsl");

/// The functions that all modules share. [`paste`] includes them; a renderer that wants several modules in one
/// shader takes them once and each module from [`functions`].
#[must_use]
pub fn shared() -> String {
    [ADDRESS, SAMPLE].join("\n")
}

/// The functions of `module` alone, with its bindings in `group` from `first_binding` on, in the order of
/// [`Module::bindings`].
#[must_use]
pub fn functions(module: Module, group: u32, first_binding: u32) -> String {
    let source = module.source().replace("TEXFOLD_GROUP", &group.to_string());
    // Falling, as the first number is how others begin.
    (0..module.bindings().len() as u32).rev().fold(source, |source, index| {
        source.replace(&format!("TEXFOLD_BINDING_{index}"), &(first_binding + index).to_string())
    })
}

/// Everything that a renderer's own shader needs to sample textures of `module`.
#[must_use]
pub fn paste(module: Module, group: u32, first_binding: u32) -> String {
    [shared(), functions(module, group, first_binding)].join("\n")
}

/// A whole shader: `module`, one of [`Module::IMAGES`], in group 0, the entry's parameters in group 1; its functions are `vertex_main` and
/// `fragment_main`.
#[must_use]
pub fn entry(module: Module, entry: Entry) -> String {
    let head = [paste(module, 0, 0), module.entry_source().to_owned()].join("\n");
    let body = match entry {
        Entry::Decode => [VIEW, include_str!("../wgsl/entry/decode.wgsl")].join("\n"),
        Entry::Draw => [VIEW, include_str!("../wgsl/entry/draw.wgsl")].join("\n"),
        Entry::Mesh => include_str!("../wgsl/entry/mesh.wgsl").to_owned(),
        Entry::Bare => [VIEW, include_str!("../wgsl/entry/bare.wgsl")].join("\n"),
    };
    [head, body].join("\n")
}

/// A whole shader that draws a light field on its mesh: the module in group 0, the camera in group 1; its functions are
/// `vertex_main` and `fragment_main`.
#[must_use]
pub fn light() -> String {
    [paste(Module::Lightfield, 0, 0), Module::Lightfield.entry_source().to_owned()].join("\n")
}

/// A whole shader that draws a plain texture (group 0: texture, sampler) with the parameters of [`Entry::Draw`].
#[must_use]
pub fn plain() -> String {
    [VIEW, include_str!("../wgsl/entry/plain.wgsl")].join("\n")
}

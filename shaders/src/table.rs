//! The table of modules. A new codec adds a row here and its files under `wgsl/`.

use crate::module::{Binding, Fragment, ImageOffsets, LightOffsets, ModuleInfo, Offsets, Switch};

/// All modules.
pub static MODULES: [ModuleInfo; 7] = [
    ModuleInfo {
        name: "bc",
        bindings: &[params(32), Binding::Float, Binding::Float],
        offsets: image(16, 20),
        switches: &[switch("TEXFOLD_BC_REDUCED", "reduced", 28)],
        may_be_reduced: true,
        has_image: false,
        namespaces: &["bc"],
        fragments: &[fragment(include_str!("../wgsl/bc.wgsl"))],
        entry_source: include_str!("../wgsl/entry/bc.wgsl"),
    },
    ModuleInfo {
        name: "vq",
        bindings: &[params(96), Binding::Uint, Binding::Float, Binding::Float],
        offsets: image(8, 12),
        switches: &[],
        may_be_reduced: false,
        has_image: true,
        namespaces: &["vq"],
        fragments: &[fragment(include_str!("../wgsl/vq.wgsl"))],
        entry_source: include_str!("../wgsl/entry/vq.wgsl"),
    },
    ModuleInfo {
        name: "epitome",
        bindings: &EPITOME_BINDINGS,
        offsets: image(8, 12),
        switches: &[],
        may_be_reduced: false,
        has_image: false,
        namespaces: &["epitome"],
        fragments: &[EPITOME, fragment(include_str!("../wgsl/epitome/planes.wgsl"))],
        entry_source: include_str!("../wgsl/entry/epitome.wgsl"),
    },
    // An epitome whose last plane is residual content: what "epitome" binds, then what residual content does.
    ModuleInfo {
        name: "epitome-errors",
        bindings: &[
            EPITOME_BINDINGS[0],
            EPITOME_BINDINGS[1],
            EPITOME_BINDINGS[2],
            EPITOME_BINDINGS[3],
            EPITOME_BINDINGS[4],
            RESIDUAL_BINDINGS[0],
            RESIDUAL_BINDINGS[1],
            RESIDUAL_BINDINGS[2],
            RESIDUAL_BINDINGS[3],
        ],
        offsets: image(8, 12),
        switches: &residual_switches(EPITOME_PARAMS as usize),
        may_be_reduced: false,
        has_image: false,
        namespaces: &["epitome", "residual"],
        fragments: &[
            EPITOME,
            fragment(include_str!("../wgsl/epitome/errors.wgsl")),
            residual(EPITOME_BINDINGS.len() as u32),
        ],
        entry_source: include_str!("../wgsl/entry/epitome.wgsl"),
    },
    ModuleInfo {
        name: "lightfield",
        bindings: &[
            params(48),
            Binding::Uint,
            Binding::Float,
            Binding::Float,
            Binding::Float,
            Binding::Float,
            Binding::Float,
            Binding::Float,
        ],
        offsets: Offsets::Light(LightOffsets { triangles: 4, terms: 8, stored_terms: 12 }),
        switches: &[],
        may_be_reduced: false,
        has_image: false,
        namespaces: &["lightfield"],
        fragments: &[fragment(include_str!("../wgsl/lightfield.wgsl"))],
        entry_source: include_str!("../wgsl/entry/lightfield.wgsl"),
    },
    ModuleInfo {
        name: "progressive",
        bindings: &[
            params(PROGRESSIVE_PARAMS),
            Binding::Uint,
            Binding::Float,
            Binding::Float,
            RESIDUAL_BINDINGS[0],
            RESIDUAL_BINDINGS[1],
            RESIDUAL_BINDINGS[2],
            RESIDUAL_BINDINGS[3],
        ],
        offsets: image(8, 12),
        switches: &[
            switch("TEXFOLD_PROGRESSIVE_SHRUNK", "shrink_log2", 16),
            switch("TEXFOLD_PROGRESSIVE_DETAIL", "map_form", 20),
            switch("TEXFOLD_PROGRESSIVE_PADDED", "base_padding", PROGRESSIVE_PARAMS as usize + 40),
            residual_switches(PROGRESSIVE_PARAMS as usize)[0],
            residual_switches(PROGRESSIVE_PARAMS as usize)[1],
        ],
        may_be_reduced: true,
        has_image: false,
        namespaces: &["progressive", "residual"],
        fragments: &[fragment(include_str!("../wgsl/progressive.wgsl")), residual(4)],
        entry_source: include_str!("../wgsl/entry/progressive.wgsl"),
    },
    ModuleInfo {
        name: "zipmap",
        bindings: &[params(64), Binding::Uint, Binding::Float, Binding::Float, Binding::Float],
        offsets: image(8, 12),
        switches: &[Switch { only: Some(SPLIT), ..switch("TEXFOLD_ZIPMAP_SPLIT", "root_swizzle", 28) }],
        may_be_reduced: false,
        has_image: false,
        namespaces: &["zipmap"],
        fragments: &[fragment(include_str!("../wgsl/zipmap.wgsl"))],
        entry_source: include_str!("../wgsl/entry/zipmap.wgsl"),
    },
];

/// The module of that name.
#[must_use]
pub fn module(name: &str) -> Option<&'static ModuleInfo> {
    MODULES.iter().find(|module| module.name == name)
}

/// The modules that are sampled by texture coordinate.
pub fn image_modules() -> impl Iterator<Item = &'static ModuleInfo> {
    MODULES.iter().filter(|module| module.image().is_some())
}

/// `TEXFOLD_SPLIT` of `sample.wgsl`: a base or root in two planes.
const SPLIT: u32 = 4;

const EPITOME: Fragment = fragment(include_str!("../wgsl/epitome.wgsl"));
const EPITOME_PARAMS: u64 = 112;
const EPITOME_BINDINGS: [Binding; 5] =
    [params(EPITOME_PARAMS), Binding::Uint, Binding::Float, Binding::Float, Binding::Float];

const PROGRESSIVE_PARAMS: u64 = 48;
const RESIDUAL_BINDINGS: [Binding; 4] = [params(208), Binding::Uint, Binding::Float, Binding::Float];

/// The functions of residual content, with its bindings from the module's `first_binding` on.
const fn residual(first_binding: u32) -> Fragment {
    Fragment { text: include_str!("../wgsl/residual.wgsl"), first_binding }
}

/// Those of residual content whose parameters begin at byte `start` of those of a surface.
const fn residual_switches(start: usize) -> [Switch; 2] {
    [
        Switch { only: Some(SPLIT), ..switch("TEXFOLD_RESIDUAL_SPLIT", "swizzle", start + 16) },
        switch("TEXFOLD_RESIDUAL_ISOLATED", "base_block", start + 36),
    ]
}

const fn image(levels: usize, address_mode: usize) -> Offsets {
    Offsets::Image(ImageOffsets { levels, address_mode })
}

const fn params(bytes: u64) -> Binding {
    Binding::Params { bytes }
}

const fn switch(constant: &'static str, member: &'static str, offset: usize) -> Switch {
    Switch { constant, member, offset, only: None }
}

const fn fragment(text: &'static str) -> Fragment {
    Fragment { text, first_binding: 0 }
}

//! The modules: one for each codec that a GPU can sample, and one for each of its forms that binds other planes.

use std::borrow::Cow;

/// The WGSL of one codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Module {
    /// Plain block compression.
    Bc,
    /// Vector quantisation.
    Vq,
    /// Epitome factoring.
    Epitome,
    /// The same where the last epitome is residual content: what [`Module::Epitome`] binds, then what residual content does.
    /// It takes the place of [`Module::Epitome`] in a shader.
    EpitomeErrors,
    /// Surface light-field maps.
    Lightfield,
    /// Details from codebooks, then what residual content binds: base and residual plane.
    Progressive,
    /// A root and patches of higher resolution.
    Zipmap,
}

/// One binding of a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Binding {
    /// A uniform buffer of that many bytes.
    Params {
        /// Size of the buffer.
        bytes: u64,
    },
    /// A two-dimensional texture of unsigned integers.
    Uint,
    /// A two-dimensional texture of floats, loaded without a sampler.
    Float,
}

/// A constant of a module that is true unless a pipeline sets it to 0: for images that do without what it stands for. Software
/// renderers make the loads of every branch, so that pictures are drawn faster without those that are never taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Switch {
    /// Its name.
    pub constant: &'static str,
    /// Where the number that tells lies in the parameters of an image, in bytes.
    offset: usize,
    /// The number that needs it; any but 0 where this is `None`.
    only: Option<u32>,
}

impl Switch {
    /// Whether an image with these parameters needs it.
    #[must_use]
    pub fn is_needed(&self, params: &[u8]) -> bool {
        let bytes = params.get(self.offset..self.offset + 4).and_then(|bytes| bytes.try_into().ok());
        let number = bytes.map(u32::from_le_bytes);
        match self.only {
            Some(only) => number == Some(only),
            None => number != Some(0),
        }
    }
}

/// Swizzle of a base in two planes, as in `sample.wgsl`.
const SPLIT: u32 = 4;
/// Bytes of the parameters that stand before those of residual content.
const EPITOME_PARAMS: usize = 112;
const PROGRESSIVE_PARAMS: usize = 48;
/// Bytes of the parameters of residual content.
const RESIDUAL_PARAMS: u64 = 208;

const PROGRESSIVE_SWITCHES: [Switch; 5] = [
    Switch { constant: "TEXFOLD_PROGRESSIVE_SHRUNK", offset: 16, only: None },
    Switch { constant: "TEXFOLD_PROGRESSIVE_DETAIL", offset: 20, only: None },
    Switch { constant: "TEXFOLD_PROGRESSIVE_PADDED", offset: PROGRESSIVE_PARAMS + 40, only: None },
    residual_switches(PROGRESSIVE_PARAMS)[0],
    residual_switches(PROGRESSIVE_PARAMS)[1],
];
const ERROR_SWITCHES: [Switch; 2] = residual_switches(EPITOME_PARAMS);

const ZIPMAP_SWITCHES: [Switch; 1] =
    [Switch { constant: "TEXFOLD_ZIPMAP_SPLIT", offset: 28, only: Some(SPLIT) }];

/// Those of residual content whose parameters begin at byte `start`.
const fn residual_switches(start: usize) -> [Switch; 2] {
    [
        Switch { constant: "TEXFOLD_RESIDUAL_SPLIT", offset: start + 16, only: Some(SPLIT) },
        Switch { constant: "TEXFOLD_RESIDUAL_ISOLATED", offset: start + 36, only: None },
    ]
}

impl Module {
    /// All of them.
    pub const ALL: [Module; 7] = [
        Module::Bc,
        Module::Vq,
        Module::Epitome,
        Module::EpitomeErrors,
        Module::Lightfield,
        Module::Progressive,
        Module::Zipmap,
    ];
    /// Those that are sampled by texture coordinate.
    pub const IMAGES: [Module; 6] =
        [Module::Bc, Module::Vq, Module::Epitome, Module::EpitomeErrors, Module::Progressive, Module::Zipmap];

    /// The name that an encoded texture gives: "bc", "vq", "epitome", "epitome-errors", "lightfield", "progressive",
    /// "zipmap".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Module::Bc => "bc",
            Module::Vq => "vq",
            Module::Epitome => "epitome",
            Module::EpitomeErrors => "epitome-errors",
            Module::Lightfield => "lightfield",
            Module::Progressive => "progressive",
            Module::Zipmap => "zipmap",
        }
    }

    /// The module of that name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Module> {
        Module::ALL.into_iter().find(|module| module.name() == name)
    }

    /// What to bind, in order: parameters, then planes of a surface in their order. Where there are parameters twice, those of a
    /// surface are both, one behind the other.
    #[must_use]
    pub fn bindings(self) -> &'static [Binding] {
        match self {
            Module::Bc => &[Binding::Params { bytes: 32 }, Binding::Float, Binding::Float],
            Module::Vq => &[Binding::Params { bytes: 96 }, Binding::Uint, Binding::Float, Binding::Float],
            Module::Epitome => &[
                Binding::Params { bytes: 112 },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
                Binding::Float,
            ],
            Module::EpitomeErrors => &[
                Binding::Params { bytes: 112 },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
                Binding::Float,
                Binding::Params { bytes: RESIDUAL_PARAMS },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
            ],
            Module::Lightfield => &[
                Binding::Params { bytes: 48 },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
                Binding::Float,
                Binding::Float,
                Binding::Float,
                Binding::Float,
            ],
            Module::Progressive => &[
                Binding::Params { bytes: PROGRESSIVE_PARAMS as u64 },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
                Binding::Params { bytes: RESIDUAL_PARAMS },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
            ],
            Module::Zipmap => &[
                Binding::Params { bytes: 64 },
                Binding::Uint,
                Binding::Float,
                Binding::Float,
                Binding::Float,
            ],
        }
    }

    /// Where the address mode, a 32-bit number, lies in the parameters of an image, in bytes.
    #[must_use]
    pub fn address_mode_offset(self) -> Option<usize> {
        match self {
            Module::Bc => Some(20),
            Module::Vq | Module::Epitome | Module::EpitomeErrors | Module::Progressive | Module::Zipmap => {
                Some(12)
            }
            Module::Lightfield => None,
        }
    }

    /// Where the number of mip levels, a 32-bit number, lies in the parameters of an image, in bytes. Columns and rows of
    /// level 0 are the first two numbers of every image.
    #[must_use]
    pub fn levels_offset(self) -> Option<usize> {
        match self {
            Module::Bc => Some(16),
            Module::Vq | Module::Epitome | Module::EpitomeErrors | Module::Progressive | Module::Zipmap => {
                Some(8)
            }
            Module::Lightfield => None,
        }
    }

    /// What a pipeline may leave out where no image that it draws needs it.
    #[must_use]
    pub fn switches(self) -> &'static [Switch] {
        match self {
            Module::Bc => &[Switch { constant: "TEXFOLD_BC_REDUCED", offset: 28, only: None }],
            Module::Progressive => &PROGRESSIVE_SWITCHES,
            Module::EpitomeErrors => &ERROR_SWITCHES,
            Module::Zipmap => &ZIPMAP_SWITCHES,
            Module::Vq | Module::Epitome | Module::Lightfield => &[],
        }
    }

    /// Whether the first switch stands for planes that are smaller than their sources.
    #[must_use]
    pub fn may_be_reduced(self) -> bool {
        matches!(self, Module::Bc | Module::Progressive)
    }

    /// The name of the function that gives the colour at a texture coordinate: `texfold_vq_sample` and so on; of a light
    /// field, at a place on a triangle towards a direction.
    #[must_use]
    pub fn sample_function(self) -> &'static str {
        match self {
            Module::Bc => "texfold_bc_sample",
            Module::Vq => "texfold_vq_sample",
            Module::Epitome | Module::EpitomeErrors => "texfold_epitome_sample",
            Module::Lightfield => "texfold_lightfield_sample",
            Module::Progressive => "texfold_progressive_sample",
            Module::Zipmap => "texfold_zipmap_sample",
        }
    }

    /// The functions, with placeholders for group and bindings.
    pub(crate) fn source(self) -> Cow<'static, str> {
        Cow::Borrowed(match self {
            Module::Bc => include_str!("../wgsl/bc.wgsl"),
            Module::Vq => include_str!("../wgsl/vq.wgsl"),
            Module::Epitome => EPITOME,
            Module::EpitomeErrors => return Cow::Owned(epitome_errors()),
            Module::Lightfield => include_str!("../wgsl/lightfield.wgsl"),
            Module::Progressive => return Cow::Owned([PROGRESSIVE, &residual(4)].join("\n")),
            Module::Zipmap => include_str!("../wgsl/zipmap.wgsl"),
        })
    }

    /// What the entry points call.
    pub(crate) fn entry_source(self) -> &'static str {
        match self {
            Module::Bc => include_str!("../wgsl/entry/bc.wgsl"),
            Module::Vq => include_str!("../wgsl/entry/vq.wgsl"),
            Module::Epitome | Module::EpitomeErrors => include_str!("../wgsl/entry/epitome.wgsl"),
            Module::Lightfield => include_str!("../wgsl/entry/lightfield.wgsl"),
            Module::Progressive => include_str!("../wgsl/entry/progressive.wgsl"),
            Module::Zipmap => include_str!("../wgsl/entry/zipmap.wgsl"),
        }
    }
}

const EPITOME: &str = include_str!("../wgsl/epitome.wgsl");
const PROGRESSIVE: &str = include_str!("../wgsl/progressive.wgsl");
const RESIDUAL: &str = include_str!("../wgsl/residual.wgsl");
/// Begins the lines around what reads epitomes without an error map.
const PLANES_MARK: &str = "// TEXFOLD_EPITOME_PLANES";

/// The functions of epitomes, where the last is read by those of residual content.
fn epitome_errors() -> String {
    let mut parts = EPITOME.split(PLANES_MARK);
    let (before, _, behind) = (parts.next(), parts.next(), parts.next());
    let read = include_str!("../wgsl/epitome/errors.wgsl");
    let residual = residual(Module::Epitome.bindings().len());
    [before.unwrap_or_default(), read, behind.unwrap_or_default(), &residual].join("\n")
}

/// The functions of residual content with its bindings behind the first `count` of a module.
fn residual(count: usize) -> String {
    // By another name first, so that no number is changed twice.
    let renamed = (0..4).fold(RESIDUAL.to_owned(), |source, index| {
        source.replace(&format!("TEXFOLD_BINDING_{index}"), &format!("TEXFOLD_BEHIND_{}", count + index))
    });
    renamed.replace("TEXFOLD_BEHIND_", "TEXFOLD_BINDING_")
}

//! What a module is: the WGSL of one codec and what a renderer needs to know to bind and call it.

use std::hash::{Hash, Hasher};

/// One row of [`crate::MODULES`]: the WGSL that samples textures of one codec, or of one form of a codec that binds other planes.
///
/// Two rows are equal where their names are: names are unique.
#[derive(Debug)]
#[non_exhaustive]
pub struct ModuleInfo {
    /// The name that an encoded texture gives in `GpuForm::module`: "bc", "vq", ...
    pub name: &'static str,
    /// What to bind, in order: parameters, then planes in the order of the texture's `ImageBinding::planes`. A module with two
    /// blocks of parameters takes both from the bytes of one surface, one behind the other.
    pub bindings: &'static [Binding],
    /// What it samples, and where the numbers that every such texture has lie in its parameters.
    pub offsets: Offsets,
    /// Constants that a pipeline may set to 0 where no texture that it draws needs them.
    pub switches: &'static [Switch],
    /// Whether the first switch stands for planes that are smaller than their sources.
    pub may_be_reduced: bool,
    /// Whether its functions take, as their first argument, which of several images of one size is read:
    /// `ImageBinding::image`. `_sample` without one reads the first.
    pub has_image: bool,
    /// What names of its WGSL begin with, without `texfold_`: first the module's own, then those of fragments that it shares with
    /// other modules.
    pub(crate) namespaces: &'static [&'static str],
    /// Its functions.
    pub(crate) fragments: &'static [Fragment],
    /// What this project's own entry points call.
    pub(crate) entry_source: &'static str,
}

/// Where numbers lie in the parameters of a texture, by what its module samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Offsets {
    /// Images, by texture coordinate.
    Image(ImageOffsets),
    /// Light fields, by a place on a triangle and a direction.
    Light(LightOffsets),
}

/// Where the numbers that all light fields have lie in their parameters, in bytes; 32 bits each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LightOffsets {
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Terms that are drawn.
    pub terms: usize,
    /// Terms that are stored.
    pub stored_terms: usize,
}

/// Where the numbers that all images have lie in their parameters, in bytes. Columns and rows of level 0 are the first two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageOffsets {
    /// Number of mip levels, 32 bits.
    pub levels: usize,
    /// Address mode, 32 bits: `TEXFOLD_REPEAT` or `TEXFOLD_CLAMP`.
    pub address_mode: usize,
}

/// A file of WGSL.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fragment {
    /// Its text, in which `TEXFOLD_GROUP` and `TEXFOLD_BINDING_0` and so on stand for numbers.
    pub(crate) text: &'static str,
    /// The module's binding that is the fragment's `TEXFOLD_BINDING_0`.
    pub(crate) first_binding: u32,
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
/// renderers make the loads of every branch, so that images are drawn faster without those that are never taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Switch {
    /// Its name in the module's WGSL; [`crate::Slot::name`] gives the name in a pasted shader.
    pub constant: &'static str,
    /// The member of the parameters that tells whether an image needs it.
    pub member: &'static str,
    /// Where that member, a 32-bit number, lies in the parameters of an image, in bytes.
    pub offset: usize,
    /// The value of the member that needs the constant; any but 0 where this is `None`.
    pub only: Option<u32>,
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

impl ModuleInfo {
    /// The offsets of a module that samples images; `None` for light fields.
    #[must_use]
    pub fn image(&self) -> Option<ImageOffsets> {
        match self.offsets {
            Offsets::Image(offsets) => Some(offsets),
            Offsets::Light(_) => None,
        }
    }

    /// The offsets of a module that samples light fields; `None` for images.
    #[must_use]
    pub fn light(&self) -> Option<LightOffsets> {
        match self.offsets {
            Offsets::Light(offsets) => Some(offsets),
            Offsets::Image(_) => None,
        }
    }

    /// Number of textures that it binds: WebGPU guarantees 16 for all modules of a shader together.
    #[must_use]
    pub fn textures(&self) -> usize {
        self.bindings.iter().filter(|binding| !matches!(binding, Binding::Params { .. })).count()
    }
}

impl PartialEq for ModuleInfo {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for ModuleInfo {}

impl Hash for ModuleInfo {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.name.hash(state);
    }
}

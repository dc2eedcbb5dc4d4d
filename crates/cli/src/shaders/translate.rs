//! Shaders in other languages, by naga. Its overrides have their defaults: every switch is on.

use std::collections::BTreeMap;
use std::fmt::Display;

use naga::back::pipeline_constants::process_overrides;
use naga::back::{PipelineConstants, glsl, hlsl, msl, spv};
use naga::proc::BoundsCheckPolicies;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, GlobalVariable, Module, ResourceBinding, ShaderStage, StorageAccess, TypeInner};

use super::Lang;
use crate::error::CliError;

/// A shader that is valid.
pub(super) struct Program {
    pub(super) name: String,
    source: String,
    pub(super) module: Module,
    info: ModuleInfo,
}

/// Contents of a file.
pub(super) enum Text {
    Lines(String),
    Words(Vec<u32>),
}

/// Kinds of bindings: languages number each from 0 on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Bound {
    Uniform,
    Storage,
    Texture,
    Image,
    Sampler,
}

impl Bound {
    pub(super) fn name(self) -> &'static str {
        match self {
            Bound::Uniform => "uniform",
            Bound::Storage => "storage",
            Bound::Texture => "texture",
            Bound::Image => "image",
            Bound::Sampler => "sampler",
        }
    }

    pub(super) fn of(module: &Module, variable: &GlobalVariable) -> Bound {
        match (variable.space, &module.types[variable.ty].inner) {
            (AddressSpace::Uniform, _) => Bound::Uniform,
            (AddressSpace::Storage { .. }, _) => Bound::Storage,
            (_, TypeInner::Sampler { .. }) => Bound::Sampler,
            (_, TypeInner::Image { class: naga::ImageClass::Storage { .. }, .. }) => Bound::Image,
            _ => Bound::Texture,
        }
    }
}

/// Name of a stage.
pub(super) fn stage_name(stage: ShaderStage) -> &'static str {
    match stage {
        ShaderStage::Vertex => "vertex",
        ShaderStage::Fragment => "fragment",
        _ => "compute",
    }
}

impl Program {
    /// Reads and checks a shader.
    pub(super) fn new(name: &str, source: &str) -> Result<Program, CliError> {
        let failed = |what: String| fault(name, &what);
        let module =
            naga::front::wgsl::parse_str(source).map_err(|error| failed(error.emit_to_string(source)))?;
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        let info = validator.validate(&module).map_err(|error| failed(error.emit_to_string(source)))?;
        let constants = PipelineConstants::default();
        let settled =
            process_overrides(&module, &info, None, &constants).map_err(|error| failed(error.to_string()))?;
        let (module, info) = (settled.0.into_owned(), settled.1.into_owned());
        Ok(Program { name: name.to_owned(), source: source.to_owned(), module, info })
    }

    /// Bound variables, in the order of groups and bindings.
    pub(super) fn bound(&self) -> Vec<(ResourceBinding, &GlobalVariable)> {
        let variables = self.module.global_variables.iter();
        let mut bound: Vec<_> =
            variables.filter_map(|(_, variable)| Some((variable.binding?, variable))).collect();
        bound.sort_by_key(|(binding, _)| (binding.group, binding.binding));
        bound
    }

    /// Number of each binding among those of its kind; in Metal storage follows uniforms, and images follow textures.
    pub(super) fn numbers(&self, lang: Lang) -> BTreeMap<ResourceBinding, u8> {
        let mut next = BTreeMap::new();
        if lang == Lang::Msl {
            next.insert(Bound::Storage, self.count(Bound::Uniform));
            next.insert(Bound::Image, self.count(Bound::Texture));
        }
        let number = |(binding, variable): (ResourceBinding, &GlobalVariable)| {
            let next = next.entry(Bound::of(&self.module, variable)).or_insert(0u8);
            *next += 1;
            (binding, *next - 1)
        };
        self.bound().into_iter().map(number).collect()
    }

    /// Place of a binding in the terms of a language; `None` where these are groups and bindings.
    pub(super) fn place(
        &self,
        lang: Lang,
        (binding, variable): (ResourceBinding, &GlobalVariable),
    ) -> Option<String> {
        let kind = Bound::of(&self.module, variable);
        let number = self.numbers(lang).get(&binding).copied()?;
        match lang {
            Lang::Wgsl | Lang::Spirv => None,
            Lang::Glsl | Lang::Essl => Some(format!("{} {number}", kind.name())),
            Lang::Msl => Some(match kind {
                Bound::Uniform | Bound::Storage => format!("buffer {number}"),
                Bound::Texture | Bound::Image => format!("texture {number}"),
                Bound::Sampler => format!("sampler {number}"),
            }),
            Lang::Hlsl => {
                let letter = match (kind, variable.space) {
                    (Bound::Uniform, _) => 'b',
                    (Bound::Storage, AddressSpace::Storage { access })
                        if access.contains(StorageAccess::STORE) =>
                    {
                        'u'
                    }
                    (Bound::Image, _) => 'u',
                    // By way of an index in a buffer of the group.
                    (Bound::Sampler, _) => return Some("nagaSamplerHeap".to_owned()),
                    _ => 't',
                };
                Some(format!("{letter}{}, space{}", binding.binding, binding.group))
            }
        }
    }

    /// Names of files, and what they hold.
    pub(super) fn in_language(&self, lang: Lang) -> Result<Vec<(String, Text)>, CliError> {
        let name = &self.name;
        let one = |ending: &str, text: Text| vec![(format!("{name}.{ending}"), text)];
        Ok(match lang {
            Lang::Wgsl => one("wgsl", Text::Lines(self.source.clone())),
            Lang::Spirv => one("spv", Text::Words(self.spirv()?)),
            Lang::Hlsl => one("hlsl", Text::Lines(self.header(lang) + &self.hlsl()?)),
            Lang::Msl => one("metal", Text::Lines(self.header(lang) + &self.msl()?)),
            Lang::Glsl => self.glsl(lang, glsl::Version::Desktop(450))?,
            Lang::Essl => self.glsl(lang, glsl::Version::Embedded { version: 310, is_webgl: false })?,
        })
    }

    /// Comments that name the bindings.
    fn header(&self, lang: Lang) -> String {
        let mut header = format!("// Texfold {}: {}\n", env!("CARGO_PKG_VERSION"), self.name);
        for (binding, variable) in self.bound() {
            let name = variable.name.as_deref().unwrap_or_default();
            let place = self.place(lang, (binding, variable)).unwrap_or_default();
            header += &format!("// group {}, binding {}: {name}, {place}\n", binding.group, binding.binding);
        }
        header
    }

    fn spirv(&self) -> Result<Vec<u32>, CliError> {
        let options = spv::Options {
            lang_version: (1, 3),
            flags: spv::WriterFlags::LABEL_VARYINGS | spv::WriterFlags::CLAMP_FRAG_DEPTH,
            ..spv::Options::default()
        };
        spv::write_vec(&self.module, &self.info, &options, None).map_err(|error| fault(&self.name, &error))
    }

    fn hlsl(&self) -> Result<String, CliError> {
        let target = |(binding, _): (ResourceBinding, _)| {
            let space = u8::try_from(binding.group).unwrap_or(u8::MAX);
            (binding, hlsl::BindTarget { space, register: binding.binding, ..hlsl::BindTarget::default() })
        };
        let options = hlsl::Options {
            shader_model: hlsl::ShaderModel::V6_0,
            binding_map: self.bound().into_iter().map(target).collect(),
            ..hlsl::Options::default()
        };
        let (mut text, pipeline) = (String::new(), hlsl::PipelineOptions::default());
        let mut writer = hlsl::Writer::new(&mut text, &options, &pipeline);
        writer.write(&self.module, &self.info, None).map_err(|error| fault(&self.name, &error))?;
        Ok(text)
    }

    fn msl(&self) -> Result<String, CliError> {
        let numbers = self.numbers(Lang::Msl);
        let resource = |(binding, variable): (ResourceBinding, &GlobalVariable)| {
            let number = numbers.get(&binding).copied().unwrap_or_default();
            let kind = Bound::of(&self.module, variable);
            let mut target = msl::BindTarget::default();
            match kind {
                Bound::Uniform | Bound::Storage => target.buffer = Some(number),
                Bound::Texture | Bound::Image => target.texture = Some(number),
                Bound::Sampler => target.sampler = Some(msl::BindSamplerTarget::Resource(number)),
            }
            target.mutable = matches!(kind, Bound::Image | Bound::Storage);
            (binding, target)
        };
        let resources = msl::EntryPointResources {
            resources: self.bound().into_iter().map(resource).collect(),
            sizes_buffer: Some(self.count(Bound::Uniform) + self.count(Bound::Storage)),
            ..msl::EntryPointResources::default()
        };
        let entries = self.module.entry_points.iter().map(|entry| (entry.name.clone(), resources.clone()));
        let options = msl::Options {
            lang_version: (2, 1),
            per_entry_point_map: entries.collect(),
            fake_missing_bindings: false,
            ..msl::Options::default()
        };
        let written = msl::write_string(&self.module, &self.info, &options, &msl::PipelineOptions::default());
        written.map(|(text, _)| text).map_err(|error| fault(&self.name, &error))
    }

    /// Bindings of a kind.
    fn count(&self, kind: Bound) -> u8 {
        let bound = self.bound().into_iter();
        bound.filter(|(_, variable)| Bound::of(&self.module, variable) == kind).count() as u8
    }

    /// A file for each entry point.
    fn glsl(&self, lang: Lang, version: glsl::Version) -> Result<Vec<(String, Text)>, CliError> {
        let options = glsl::Options {
            version,
            writer_flags: glsl::WriterFlags::empty(),
            binding_map: self.numbers(lang),
            zero_initialize_workgroup_memory: true,
        };
        let of_entry = |entry: &naga::EntryPoint| {
            let pipeline = glsl::PipelineOptions {
                shader_stage: entry.stage,
                entry_point: entry.name.clone(),
                multiview: None,
            };
            let mut text = String::new();
            let policies = BoundsCheckPolicies::default();
            glsl::Writer::new(&mut text, &self.module, &self.info, &options, &pipeline, policies)
                .and_then(|mut writer| writer.write())
                .map_err(|error| fault(&format!("{}, {}", self.name, entry.name), &error))?;
            let ending = match entry.stage {
                ShaderStage::Vertex => "vert",
                ShaderStage::Fragment => "frag",
                _ => "comp",
            };
            // Nothing but blanks may stand before the version.
            let (version, rest) = text.split_once('\n').unwrap_or((&text, ""));
            let text = format!("{version}\n{}{rest}", self.header(lang));
            Ok((format!("{}.{}.{ending}", self.name, entry.name), Text::Lines(text)))
        };
        self.module.entry_points.iter().map(of_entry).collect()
    }
}

fn fault(name: &str, what: &dyn Display) -> CliError {
    CliError::Shader { name: name.to_owned(), what: what.to_string() }
}

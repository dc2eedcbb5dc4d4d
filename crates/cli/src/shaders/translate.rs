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
        if lang == Lang::Essl && self.is_drawing() {
            return Some(format!("{} {}", kind.name(), self.names(binding).join(", ")));
        }
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
            Lang::Glsl | Lang::Essl => self.glsl(lang)?,
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

    /// Whether it has neither compute passes nor storage buffers: GLSL ES 3.00 suffices, which WebGL 2 takes.
    fn is_drawing(&self) -> bool {
        let is_stored = |(_, variable): (_, &GlobalVariable)| {
            matches!(Bound::of(&self.module, variable), Bound::Storage | Bound::Image)
        };
        self.module.entry_points.iter().all(|entry| entry.stage != ShaderStage::Compute)
            && !self.bound().into_iter().any(is_stored)
    }

    /// Names of a binding in the shaders of all entry points in GLSL ES 3.00, which has no numbers of bindings.
    fn names(&self, binding: ResourceBinding) -> Vec<String> {
        let is_it = |variable: naga::Handle<GlobalVariable>| {
            self.module.global_variables[variable].binding == Some(binding)
        };
        let of_entry = |entry: &naga::EntryPoint| {
            let (_, info) = self.write_glsl(entry, Lang::Essl).ok()?;
            let mut textures = info.texture_mapping.iter();
            let texture = textures.find(|(_, mapping)| is_it(mapping.texture)).map(|(name, _)| name);
            let mut uniforms = info.uniforms.iter();
            let uniform = uniforms.find(|(variable, _)| is_it(**variable)).map(|(_, name)| name);
            texture.or(uniform).cloned()
        };
        self.module.entry_points.iter().filter_map(of_entry).collect()
    }

    /// A file for each entry point.
    fn glsl(&self, lang: Lang) -> Result<Vec<(String, Text)>, CliError> {
        let of_entry = |entry: &naga::EntryPoint| {
            let (text, _) = self.write_glsl(entry, lang)?;
            let ending = match entry.stage {
                ShaderStage::Vertex => "vert",
                ShaderStage::Fragment => "frag",
                _ => "comp",
            };
            // Nothing but blanks may stand before the version.
            let (version, rest) = text.split_once('\n').unwrap_or((&text, ""));
            let mut text = format!("{version}\n{}{rest}", self.header(lang));
            if lang == Lang::Essl && self.is_drawing() {
                text = text.replacen(PRECISION, &format!("{PRECISION}{INTEGERS}"), 1);
            }
            Ok((format!("{}.{}.{ending}", self.name, entry.name), Text::Lines(text)))
        };
        self.module.entry_points.iter().map(of_entry).collect()
    }

    /// An entry point in GLSL, and the names that bindings have there.
    fn write_glsl(
        &self,
        entry: &naga::EntryPoint,
        lang: Lang,
    ) -> Result<(String, glsl::ReflectionInfo), CliError> {
        let version = match (lang, self.is_drawing()) {
            (Lang::Essl, true) => glsl::Version::Embedded { version: 300, is_webgl: false },
            (Lang::Essl, false) => glsl::Version::Embedded { version: 310, is_webgl: false },
            _ => glsl::Version::Desktop(450),
        };
        let options = glsl::Options {
            version,
            writer_flags: glsl::WriterFlags::empty(),
            binding_map: self.numbers(lang),
            zero_initialize_workgroup_memory: true,
        };
        let pipeline = glsl::PipelineOptions {
            shader_stage: entry.stage,
            entry_point: entry.name.clone(),
            multiview: None,
        };
        let (mut text, policies) = (String::new(), BoundsCheckPolicies::default());
        let info = glsl::Writer::new(&mut text, &self.module, &self.info, &options, &pipeline, policies)
            .and_then(|mut writer| writer.write())
            .map_err(|error| fault(&format!("{}, {}", self.name, entry.name), &error))?;
        Ok((text, info))
    }
}

/// Line that naga writes above declarations.
const PRECISION: &str = "precision highp int;\n";
/// Functions of integers that GLSL ES has from 3.10 on, and those of floats of the same name.
const INTEGERS: &str = "
float es_mix(float a, float b, float t) { return mix(a, b, t); }
vec2 es_mix(vec2 a, vec2 b, vec2 t) { return mix(a, b, t); }
vec3 es_mix(vec3 a, vec3 b, vec3 t) { return mix(a, b, t); }
vec4 es_mix(vec4 a, vec4 b, vec4 t) { return mix(a, b, t); }
vec2 es_mix(vec2 a, vec2 b, float t) { return mix(a, b, t); }
vec3 es_mix(vec3 a, vec3 b, float t) { return mix(a, b, t); }
vec4 es_mix(vec4 a, vec4 b, float t) { return mix(a, b, t); }
vec2 es_mix(vec2 a, vec2 b, bvec2 t) { return mix(a, b, t); }
vec3 es_mix(vec3 a, vec3 b, bvec3 t) { return mix(a, b, t); }
vec4 es_mix(vec4 a, vec4 b, bvec4 t) { return mix(a, b, t); }
ivec2 es_mix(ivec2 a, ivec2 b, bvec2 t) { return ivec2(t.x ? b.x : a.x, t.y ? b.y : a.y); }
ivec3 es_mix(ivec3 a, ivec3 b, bvec3 t) { return ivec3(es_mix(a.xy, b.xy, t.xy), t.z ? b.z : a.z); }
ivec4 es_mix(ivec4 a, ivec4 b, bvec4 t) { return ivec4(es_mix(a.xyz, b.xyz, t.xyz), t.w ? b.w : a.w); }
uvec2 es_mix(uvec2 a, uvec2 b, bvec2 t) { return uvec2(t.x ? b.x : a.x, t.y ? b.y : a.y); }
uvec3 es_mix(uvec3 a, uvec3 b, bvec3 t) { return uvec3(es_mix(a.xy, b.xy, t.xy), t.z ? b.z : a.z); }
uvec4 es_mix(uvec4 a, uvec4 b, bvec4 t) { return uvec4(es_mix(a.xyz, b.xyz, t.xyz), t.w ? b.w : a.w); }
int es_msb(uint value) {
    int found = -1;
    while (value != 0u) {
        value >>= 1u;
        found++;
    }
    return found;
}
int es_count(uint bits) {
    bits -= (bits >> 1u) & 0x55555555u;
    bits = (bits & 0x33333333u) + ((bits >> 2u) & 0x33333333u);
    return int((((bits + (bits >> 4u)) & 0x0F0F0F0Fu) * 0x01010101u) >> 24u);
}
#define mix es_mix
#define findMSB es_msb
#define bitCount es_count
";

fn fault(name: &str, what: &dyn Display) -> CliError {
    CliError::Shader { name: name.to_owned(), what: what.to_string() }
}

//! Every composed shader is valid for every WebGPU device, without any optional capability.

#![allow(clippy::panic, reason = "a test fails by panicking")]

use naga::valid::{Capabilities, ValidationFlags, Validator};
use texfold_shaders::{Binding, Entry, Module, entry, functions, light, paste, plain, shared};

fn validate(name: &str, source: &str) -> naga::Module {
    let module = match naga::front::wgsl::parse_str(source) {
        Ok(module) => module,
        Err(error) => panic!("{name}: {}", error.emit_to_string(source)),
    };
    if let Err(error) = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module) {
        panic!("{name}: {}", error.emit_to_string(source));
    }
    module
}

#[test]
fn every_entry_point_of_every_module_is_valid() {
    for module in Module::IMAGES {
        for kind in Entry::ALL {
            let composed = validate(&format!("{module:?} {kind:?}"), &entry(module, kind));
            let names: Vec<&str> = composed.entry_points.iter().map(|entry| entry.name.as_str()).collect();
            assert_eq!(names, ["vertex_main", "fragment_main"]);
        }
    }
    validate("plain", &plain());
    validate("light", &light());
}

#[test]
fn a_renderer_chooses_group_and_bindings() {
    for module in Module::ALL {
        let arguments = if module == Module::Lightfield { "3u, uv.xyx, uv.yxy" } else { "uv" };
        for (group, first) in [(0, 0), (1, 0), (2, 7), (3, 1)] {
            let host = format!(
                "{}\n@fragment fn host(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {{ return {}({arguments}); }}",
                paste(module, group, first),
                module.sample_function(),
            );
            let composed = validate(&format!("{module:?} in group {group} from {first}"), &host);
            let mut bindings: Vec<_> =
                composed.global_variables.iter().filter_map(|(_, variable)| variable.binding).collect();
            bindings.sort_by_key(|binding| binding.binding);
            let wanted: Vec<_> = (0..module.bindings().len() as u32)
                .map(|index| naga::ResourceBinding { group, binding: first + index })
                .collect();
            assert_eq!(bindings, wanted);
        }
    }
}

#[test]
fn all_modules_share_one_shader() {
    let mut parts = vec![shared()];
    let mut first_binding = 0;
    // Residual content comes with both codecs that embed it.
    for module in Module::ALL.into_iter().filter(|&module| module != Module::EpitomeErrors) {
        parts.push(functions(module, 0, first_binding));
        first_binding += module.bindings().len() as u32;
    }
    validate("all", &parts.join("\n"));
}

#[test]
fn bindings_are_as_declared() {
    for module in Module::ALL {
        let composed = validate(module.name(), &paste(module, 0, 0));
        let mut variables: Vec<_> = composed.global_variables.iter().map(|(_, variable)| variable).collect();
        variables.sort_by_key(|variable| variable.binding.as_ref().map(|binding| binding.binding));
        let found: Vec<Binding> = variables
            .into_iter()
            .map(|variable| match composed.types[variable.ty].inner {
                naga::TypeInner::Struct { span, .. } => Binding::Params { bytes: u64::from(span) },
                naga::TypeInner::Image {
                    class: naga::ImageClass::Sampled { kind: naga::ScalarKind::Uint, .. },
                    ..
                } => Binding::Uint,
                _ => Binding::Float,
            })
            .collect();
        assert_eq!(found, module.bindings());
    }
}

#[test]
fn offsets_are_those_of_the_named_members() {
    for module in Module::IMAGES {
        let composed = validate(module.name(), &paste(module, 0, 0));
        let params = composed.global_variables.iter().next().map(|(_, variable)| variable.ty).unwrap();
        let naga::TypeInner::Struct { members, .. } = &composed.types[params].inner else {
            panic!("{module:?}: the first binding is no struct")
        };
        let offset = |name: &str| {
            members
                .iter()
                .find(|member| member.name.as_deref() == Some(name))
                .map(|member| member.offset as usize)
        };
        assert_eq!(offset("size"), Some(0));
        assert_eq!(offset("levels"), module.levels_offset());
        assert_eq!(offset("address_mode"), module.address_mode_offset());
    }
}

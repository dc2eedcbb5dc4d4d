//! Every composed shader is valid for every WebGPU device, without any optional capability.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use naga::valid::{Capabilities, ValidationFlags, Validator};
use texfold_shaders::{
    Binding, DctEntry, DctTarget, Entry, MODULES, ModuleInfo, Offsets, PasteError, Slot, block, entry,
    image_modules, light, paste, plain, tile_drawing, tile_passes, tile_plan, tiles,
};

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

/// A fragment shader that adds the colours of all slots.
fn host(slots: &[Slot<'_>]) -> String {
    let colour = |slot: &Slot<'_>| {
        let arguments = if slot.module().light().is_some() { "3u, uv.xyx, uv.yxy" } else { "uv" };
        format!("{}({arguments})", slot.sample_function())
    };
    let colours: Vec<String> = slots.iter().map(colour).collect();
    format!(
        "{}\n@fragment fn host(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {{ return {}; }}",
        paste(slots).unwrap(),
        colours.join(" + "),
    )
}

/// The bindings of a shader, in order.
fn bindings(module: &naga::Module) -> Vec<naga::ResourceBinding> {
    let mut bindings: Vec<_> =
        module.global_variables.iter().filter_map(|(_, variable)| variable.binding).collect();
    bindings.sort_by_key(|binding| (binding.group, binding.binding));
    bindings
}

#[test]
fn every_entry_point_of_every_module_is_valid() {
    for module in &MODULES {
        let shaders: Vec<(String, String)> = match module.offsets {
            Offsets::Image(_) => {
                Entry::ALL.iter().map(|&kind| (format!("{kind:?}"), entry(module, kind))).collect()
            }
            Offsets::Light(_) => vec![("light".to_owned(), light(module))],
        };
        for (kind, source) in shaders {
            let composed = validate(&format!("{} {kind}", module.name), &source);
            let names: Vec<&str> = composed.entry_points.iter().map(|entry| entry.name.as_str()).collect();
            assert_eq!(names, ["vertex_main", "fragment_main"]);
        }
    }
    validate("plain", &plain());
}

#[test]
fn the_shaders_of_the_cache_of_tiles_are_valid() {
    let drawn = "@fragment fn host(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {
        return texfold_tile_sample(3u, uv) + texfold_tile_sample_level(4u, uv, 1.5);
    }";
    for (name, source) in
        [("plan", tile_plan()), ("passes", tile_passes()), ("draw", [&tiles(2, 7, 8), drawn].concat())]
    {
        validate(name, &source);
    }
    image_modules().for_each(|module| drop(validate(module.name, &tile_drawing(module))));
}

#[test]
fn block_decoders_are_valid_and_bind_little() {
    for target in DctTarget::ALL {
        let composed = validate(&format!("block {target:?}"), &block(target));
        let names: Vec<&str> = composed.entry_points.iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(names, DctEntry::ALL.map(DctEntry::name));
        assert!(
            composed.entry_points.iter().all(|entry| entry.workgroup_size.iter().product::<u32>() <= 256)
        );
        let in_storage =
            |variable: &naga::GlobalVariable| matches!(variable.space, naga::AddressSpace::Storage { .. });
        let storage = composed.global_variables.iter().filter(|(_, variable)| in_storage(variable)).count();
        assert!(
            storage <= 4,
            "{storage} storage buffers: devices without more than downlevel defaults have 4"
        );
    }
}

#[test]
fn a_renderer_chooses_group_and_bindings() {
    for module in &MODULES {
        for (group, first) in [(0, 0), (1, 0), (2, 7), (3, 1)] {
            let slot = Slot::new(module, group, first);
            let composed =
                validate(&format!("{} in group {group} from {first}", module.name), &host(&[slot]));
            let wanted: Vec<_> =
                slot.bindings().map(|binding| naga::ResourceBinding { group, binding }).collect();
            assert_eq!(bindings(&composed), wanted);
        }
    }
}

#[test]
fn every_module_twice_shares_one_shader() {
    let names: Vec<[String; 2]> =
        (0..MODULES.len()).map(|number| [format!("texture_{number}"), format!("other_{number}")]).collect();
    let mut slots = Vec::new();
    let mut first = 0;
    for (module, name) in
        MODULES.iter().zip(&names).flat_map(|(module, names)| names.each_ref().map(|n| (module, n)))
    {
        slots.push(Slot::new(module, 1, first).named(name));
        first = slots[slots.len() - 1].bindings().end;
    }
    let composed = validate("all, twice", &host(&slots));
    let wanted: Vec<_> = (0..first).map(|binding| naga::ResourceBinding { group: 1, binding }).collect();
    assert_eq!(bindings(&composed), wanted);
    // Each has its own switches, and nothing is left under the name of the files.
    let switches = MODULES.iter().map(|module| module.switches.len()).sum::<usize>();
    assert_eq!(composed.overrides.len(), 2 * switches);
    for (_, variable) in composed.global_variables.iter() {
        let name = variable.name.as_deref().unwrap();
        assert!(names.as_flattened().iter().any(|prefix| name.starts_with(prefix.as_str())), "{name}");
    }
}

#[test]
fn switches_are_named_as_they_are_pasted() {
    for slot in
        MODULES.iter().flat_map(|module| [Slot::new(module, 0, 0), Slot::new(module, 0, 0).named("wall_1")])
    {
        let composed = validate(slot.module().name, &host(&[slot]));
        let mut found: Vec<String> =
            composed.overrides.iter().filter_map(|(_, constant)| constant.name.clone()).collect();
        let mut named: Vec<String> =
            slot.module().switches.iter().map(|switch| slot.name(switch.constant)).collect();
        found.sort();
        named.sort();
        assert_eq!(found, named);
    }
}

#[test]
fn slots_that_cannot_share_a_shader_are_refused() {
    let [bc, vq, ..] = &MODULES;
    for prefix in ["", "Albedo", "1st", "a__b", "a_", "_a", "texfold_wall", "texfold", "a-b", "ä"] {
        let refused = paste(&[Slot::new(bc, 0, 0).named(prefix)]);
        assert_eq!(refused, Err(PasteError::Prefix { prefix: prefix.to_owned() }));
    }
    let twice = paste(&[Slot::new(vq, 0, 0).named("wall"), Slot::new(vq, 0, 4).named("wall")]);
    assert!(matches!(twice, Err(PasteError::Name { name }) if name == "WallParams"));
    let twice = paste(&[Slot::new(vq, 0, 0), Slot::new(vq, 0, 4)]);
    assert!(matches!(twice, Err(PasteError::Name { name }) if name == "TexfoldVqParams"));
    // Different in snake case, the same in camel case.
    let alike = paste(&[Slot::new(vq, 0, 0).named("wall_1"), Slot::new(vq, 0, 4).named("wall1")]);
    assert!(matches!(alike, Err(PasteError::Name { name }) if name == "Wall1Params"));
    let overlapping = [Slot::new(bc, 2, 1).named("a"), Slot::new(vq, 2, 3).named("b")];
    assert_eq!(paste(&overlapping), Err(PasteError::Binding { group: 2, binding: 3 }));
    assert!(paste(&[Slot::new(bc, 2, 1).named("a"), Slot::new(vq, 1, 3).named("b")]).is_ok());
}

#[test]
fn bindings_are_as_declared() {
    for module in &MODULES {
        let composed = validate(module.name, &paste(&[Slot::new(module, 0, 0)]).unwrap());
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
        assert_eq!(found, module.bindings);
    }
}

/// Members of all blocks of parameters of a module, with their offsets: blocks lie one behind the other.
fn members(module: &'static ModuleInfo) -> Vec<(String, usize)> {
    let composed = validate(module.name, &paste(&[Slot::new(module, 0, 0)]).unwrap());
    let mut variables: Vec<_> = composed.global_variables.iter().map(|(_, variable)| variable).collect();
    variables.sort_by_key(|variable| variable.binding.as_ref().map(|binding| binding.binding));
    let mut start = 0;
    let mut found = Vec::new();
    for variable in variables {
        let naga::TypeInner::Struct { members, span } = &composed.types[variable.ty].inner else { continue };
        let member = |member: &naga::StructMember| {
            (member.name.clone().unwrap_or_default(), start + member.offset as usize)
        };
        found.extend(members.iter().map(member));
        start += *span as usize;
    }
    found
}

#[test]
fn offsets_are_those_of_the_named_members() {
    for module in &MODULES {
        let members = members(module);
        let first = |name: &str| members.iter().find(|member| member.0 == name).map(|member| member.1);
        match module.offsets {
            Offsets::Image(offsets) => {
                assert_eq!(first("size"), Some(0));
                assert_eq!(first("levels"), Some(offsets.levels), "{}", module.name);
                assert_eq!(first("address_mode"), Some(offsets.address_mode), "{}", module.name);
            }
            Offsets::Light(offsets) => {
                assert_eq!(first("triangles"), Some(offsets.triangles));
                assert_eq!(first("terms"), Some(offsets.terms));
                assert_eq!(first("stored_terms"), Some(offsets.stored_terms));
            }
        }
        for switch in module.switches {
            let found = members.contains(&(switch.member.to_owned(), switch.offset));
            assert!(found, "{}: no {} at {}: {members:?}", module.name, switch.member, switch.offset);
        }
    }
}

#[test]
fn names_and_lookups_are_unique() {
    let mut names: Vec<_> = MODULES.iter().map(|module| module.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), MODULES.len());
    for module in &MODULES {
        assert_eq!(texfold_shaders::module(module.name), Some(module));
    }
    assert_eq!(texfold_shaders::module("none"), None);
    assert_eq!(image_modules().count(), MODULES.len() - 1);
}

//! Bindings and parameters of a shader as JSON, for who binds them by hand.

use naga::proc::Layouter;
use naga::{Handle, ImageClass, Module, ScalarKind, StorageFormat, Type, TypeInner, VectorSize};
use serde_json::{Value, json};

use super::Lang;
use super::translate::{Bound, Program, stage_name};

/// The description of a shader.
pub(super) fn json(program: &Program, lang: Lang) -> String {
    let module = &program.module;
    let entries = module.entry_points.iter().map(|entry| {
        let mut value = json!({"name": entry.name, "stage": stage_name(entry.stage)});
        if entry.stage == naga::ShaderStage::Compute {
            value["workgroup"] = json!(entry.workgroup_size);
        }
        value
    });
    let mut layouter = Layouter::default();
    // Modules that were valid have layouts.
    let _ = layouter.update(module.to_ctx());
    let bindings = program.bound().into_iter().map(|(binding, variable)| {
        let kind = Bound::of(module, variable);
        let mut value = json!({
            "group": binding.group,
            "binding": binding.binding,
            "name": variable.name,
            "kind": kind.name(),
            "type": type_name(module, variable.ty),
        });
        if let Some(place) = program.place(lang, (binding, variable)) {
            value["place"] = json!(place);
        }
        if matches!(kind, Bound::Uniform | Bound::Storage) {
            value["bytes"] = json!(layouter[variable.ty].size);
            value["members"] = json!(members(module, &layouter, variable.ty));
        }
        value
    });
    let value = json!({
        "name": program.name,
        "entries": entries.collect::<Vec<_>>(),
        "bindings": bindings.collect::<Vec<_>>(),
    });
    format!("{value:#}\n")
}

/// Name, type, first byte and bytes of each member of a struct.
fn members(module: &Module, layouter: &Layouter, ty: Handle<Type>) -> Vec<Value> {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => members
            .iter()
            .map(|member| {
                json!({
                    "name": member.name,
                    "type": type_name(module, member.ty),
                    "offset": member.offset,
                    "bytes": layouter[member.ty].size,
                })
            })
            .collect(),
        _ => Vec::new(),
    }
}

/// A type in the words of WGSL.
fn type_name(module: &Module, ty: Handle<Type>) -> String {
    let ty = &module.types[ty];
    let scalar = |kind: ScalarKind, width: u8| match kind {
        ScalarKind::Sint => format!("i{}", 8 * width),
        ScalarKind::Uint => format!("u{}", 8 * width),
        ScalarKind::Float => format!("f{}", 8 * width),
        _ => "bool".to_owned(),
    };
    let number = |size: VectorSize| size as u8;
    match &ty.inner {
        TypeInner::Scalar(one) | TypeInner::Atomic(one) => scalar(one.kind, one.width),
        TypeInner::Vector { size, scalar: one } => {
            format!("vec{}<{}>", number(*size), scalar(one.kind, one.width))
        }
        TypeInner::Matrix { columns, rows, scalar: one } => {
            format!("mat{}x{}<{}>", number(*columns), number(*rows), scalar(one.kind, one.width))
        }
        TypeInner::Array { base, size: naga::ArraySize::Constant(size), .. } => {
            format!("array<{}, {size}>", type_name(module, *base))
        }
        TypeInner::Array { base, .. } => format!("array<{}>", type_name(module, *base)),
        TypeInner::Image { class, arrayed, .. } => {
            let array = if *arrayed { "_array" } else { "" };
            match class {
                ImageClass::Sampled { kind, .. } => format!("texture_2d{array}<{}>", scalar(*kind, 4)),
                ImageClass::Storage { format, .. } => {
                    format!("texture_storage_2d{array}<{}>", format_name(*format))
                }
                _ => ty.name.clone().unwrap_or_default(),
            }
        }
        TypeInner::Sampler { .. } => "sampler".to_owned(),
        _ => ty.name.clone().unwrap_or_default(),
    }
}

fn format_name(format: StorageFormat) -> String {
    format!("{format:?}").to_lowercase()
}

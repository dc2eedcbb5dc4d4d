//! The table of modules names bytes of the parameters that codecs write: they are those of the CPU's structs.
//!
//! `shaders/tests/validate.rs` holds the same table to the structs of the WGSL.

#![allow(clippy::panic, reason = "a test fails by panicking")]

use std::mem::{offset_of, size_of};

use texfold_bc::decode::TexfoldBcParams;
use texfold_epitome::decode::TexfoldEpitomeParams;
use texfold_lightfield::decode::TexfoldLightfieldParams;
use texfold_progressive::decode::TexfoldProgressiveParams;
use texfold_residual::decode::TexfoldResidualParams;
use texfold_shaders::{Binding, MODULES, Offsets};
use texfold_vq::decode::TexfoldVqParams;
use texfold_zipmap::decode::TexfoldZipmapParams;

/// A struct of parameters: its bytes, and where some of its members lie.
struct Layout {
    bytes: usize,
    members: Vec<(&'static str, usize)>,
}

macro_rules! layout {
    ($params:ty: $($member:ident),+) => {
        Layout {
            bytes: size_of::<$params>(),
            members: vec![$((stringify!($member), offset_of!($params, $member))),+],
        }
    };
}

/// The blocks of parameters of a module, in order.
fn layouts(module: &str) -> Vec<Layout> {
    let epitome = || layout!(TexfoldEpitomeParams: size, levels, address_mode);
    let progressive = || layout!(TexfoldProgressiveParams: size, levels, address_mode, shrink_log2, map_form);
    let residual = || layout!(TexfoldResidualParams: swizzle, base_block, base_padding);
    match module {
        "bc" => vec![layout!(TexfoldBcParams: size, levels, address_mode, reduced)],
        "vq" => vec![layout!(TexfoldVqParams: size, levels, address_mode)],
        "epitome" => vec![epitome()],
        "epitome-errors" => vec![epitome(), residual()],
        "lightfield" => vec![layout!(TexfoldLightfieldParams: triangles, terms, stored_terms)],
        "progressive" => vec![progressive(), residual()],
        "zipmap" => vec![layout!(TexfoldZipmapParams: size, levels, address_mode, root_swizzle)],
        other => panic!("name the parameters of module {other} here"),
    }
}

#[test]
fn offsets_are_those_of_the_structs_that_codecs_write() {
    for module in &MODULES {
        let layouts = layouts(module.name);
        let bytes = |binding: &Binding| match binding {
            Binding::Params { bytes } => Some(*bytes as usize),
            Binding::Uint | Binding::Float => None,
        };
        let sizes: Vec<usize> = module.bindings.iter().filter_map(bytes).collect();
        assert_eq!(sizes, layouts.iter().map(|layout| layout.bytes).collect::<Vec<_>>(), "{}", module.name);
        let first =
            |name: &str| layouts[0].members.iter().find(|member| member.0 == name).map(|member| member.1);
        match module.offsets {
            Offsets::Image(offsets) => {
                assert_eq!(first("size"), Some(0), "{}", module.name);
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
            let mut start = 0;
            let found = layouts.iter().any(|layout| {
                let place = layout
                    .members
                    .iter()
                    .any(|&(name, at)| (name, start + at) == (switch.member, switch.offset));
                start += layout.bytes;
                place
            });
            assert!(found, "{}: no {} at byte {}", module.name, switch.member, switch.offset);
        }
    }
}

//! Each WGSL function has a CPU twin of the same name, in the same order, and keeps to a few rules of its own.

/// WGSL of a namespace and its CPU twin. Where two files give one function in two ways, only one of them is here.
struct Twin {
    name: &'static str,
    wgsl: &'static [&'static str],
    rust: &'static str,
}

/// The shared functions, then those of each namespace of [`texfold_shaders::MODULES`].
const TWINS: [Twin; 10] = [
    Twin {
        name: "address",
        wgsl: &[include_str!("../wgsl/shared/address.wgsl")],
        rust: include_str!("../../crates/core/src/address.rs"),
    },
    Twin {
        name: "sample",
        wgsl: &[include_str!("../wgsl/shared/sample.wgsl")],
        rust: include_str!("../../crates/core/src/sample.rs"),
    },
    Twin {
        name: "bc",
        wgsl: &[include_str!("../wgsl/bc.wgsl")],
        rust: include_str!("../../crates/bc/src/decode.rs"),
    },
    Twin {
        name: "vq",
        wgsl: &[include_str!("../wgsl/vq.wgsl")],
        rust: include_str!("../../crates/vq/src/decode.rs"),
    },
    Twin {
        name: "epitome",
        wgsl: &[include_str!("../wgsl/epitome.wgsl"), include_str!("../wgsl/epitome/planes.wgsl")],
        rust: include_str!("../../crates/epitome/src/decode.rs"),
    },
    Twin {
        name: "lightfield",
        wgsl: &[include_str!("../wgsl/lightfield.wgsl")],
        rust: include_str!("../../crates/lightfield/src/decode.rs"),
    },
    Twin {
        name: "residual",
        wgsl: &[include_str!("../wgsl/residual.wgsl")],
        rust: include_str!("../../crates/residual/src/decode/mod.rs"),
    },
    Twin {
        name: "block",
        wgsl: &[
            include_str!("../wgsl/block_pass.wgsl"),
            include_str!("../wgsl/block.wgsl"),
            include_str!("../wgsl/block_intra.wgsl"),
        ],
        rust: concat!(
            include_str!("../../crates/testkit/src/dct/mod.rs"),
            include_str!("../../crates/testkit/src/dct/intra.rs"),
            include_str!("../../crates/testkit/src/dct/samples.rs")
        ),
    },
    Twin {
        name: "progressive",
        wgsl: &[include_str!("../wgsl/progressive.wgsl")],
        rust: include_str!("../../crates/progressive/src/decode.rs"),
    },
    Twin {
        name: "zipmap",
        wgsl: &[include_str!("../wgsl/zipmap.wgsl")],
        rust: include_str!("../../crates/zipmap/src/decode.rs"),
    },
];

/// WGSL functions without a twin of that name, and why.
const ALONE: [(&str, &str); 14] = [
    ("texfold_blend", "texfold_bilinear of four loads: planes of codecs are not alike on a CPU"),
    ("texfold_srgb_to_linear", "its twin is texfold_core::image::srgb_to_linear"),
    ("texfold_linear", "texfold_srgb_to_linear on three channels"),
    ("texfold_bc_sample_grad", "texfold_level, then texfold_bc_sample_level"),
    ("texfold_bc_sample", "takes derivatives, which a CPU does not have"),
    ("texfold_vq_sample_grad", "texfold_level, then texfold_vq_sample_level"),
    ("texfold_vq_sample_image", "takes derivatives, which a CPU does not have"),
    ("texfold_vq_sample", "takes derivatives, which a CPU does not have"),
    ("texfold_epitome_sample_grad", "texfold_level, then texfold_epitome_sample_level"),
    ("texfold_epitome_sample", "takes derivatives, which a CPU does not have"),
    ("texfold_progressive_sample_grad", "texfold_level, then texfold_progressive_sample_level"),
    ("texfold_progressive_sample", "takes derivatives, which a CPU does not have"),
    ("texfold_zipmap_tap", "a CPU clears the border of levels of means when it decodes them"),
    ("texfold_zipmap_sample", "takes derivatives, which a CPU does not have"),
];

const ENTRIES: [(&str, &str); 19] = [
    ("entry/loads_only", include_str!("../wgsl/entry/loads_only.wgsl")),
    ("entry/bc", include_str!("../wgsl/entry/bc.wgsl")),
    ("entry/block", include_str!("../wgsl/entry/block.wgsl")),
    ("entry/block_share", include_str!("../wgsl/entry/block_share.wgsl")),
    ("entry/block_texel", include_str!("../wgsl/entry/block_texel.wgsl")),
    ("entry/block_unorm", include_str!("../wgsl/entry/block_unorm.wgsl")),
    ("entry/block_uint", include_str!("../wgsl/entry/block_uint.wgsl")),
    ("entry/block_float", include_str!("../wgsl/entry/block_float.wgsl")),
    ("entry/decode", include_str!("../wgsl/entry/decode.wgsl")),
    ("entry/draw", include_str!("../wgsl/entry/draw.wgsl")),
    ("epitome/errors", include_str!("../wgsl/epitome/errors.wgsl")),
    ("entry/epitome", include_str!("../wgsl/entry/epitome.wgsl")),
    ("entry/lightfield", include_str!("../wgsl/entry/lightfield.wgsl")),
    ("entry/mesh", include_str!("../wgsl/entry/mesh.wgsl")),
    ("entry/progressive", include_str!("../wgsl/entry/progressive.wgsl")),
    ("entry/plain", include_str!("../wgsl/entry/plain.wgsl")),
    ("entry/view", include_str!("../wgsl/entry/view.wgsl")),
    ("entry/zipmap", include_str!("../wgsl/entry/zipmap.wgsl")),
    ("entry/vq", include_str!("../wgsl/entry/vq.wgsl")),
];

/// The words that follow `keyword` at the start of a line and begin with `prefix`.
fn declared<'a>(source: &'a str, keyword: &str, prefix: &str) -> Vec<&'a str> {
    source
        .lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix(keyword))
        .map(|rest| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default())
        .filter(|name| name.starts_with(prefix))
        .collect()
}

/// Names and values of constants, without the types and without WGSL's suffix of unsigned numbers.
fn constants(source: &str) -> Vec<(&str, &str)> {
    source
        .lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("const TEXFOLD_"))
        .filter_map(|line| {
            let (name, rest) = line.split_once(": ")?;
            let (_, value) = rest.split_once(" = ")?;
            Some((name, value.trim_end_matches(';').trim_end_matches('u')))
        })
        .collect()
}

fn without_comments(source: &str) -> String {
    source.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

impl Twin {
    /// Names of the functions, in the order of the files.
    fn functions(&self) -> Vec<&'static str> {
        self.wgsl.iter().flat_map(|wgsl| declared(wgsl, "fn ", "")).collect()
    }
}

fn all_sources() -> impl Iterator<Item = (&'static str, String)> {
    let twins = TWINS.into_iter().flat_map(|twin| twin.wgsl.iter().map(move |wgsl| (twin.name, *wgsl)));
    twins.chain(ENTRIES).map(|(name, source)| (name, without_comments(source)))
}

#[test]
fn functions_have_twins_in_the_same_order() {
    for Twin { name, wgsl, rust } in TWINS {
        let twins = declared(rust, "fn ", "texfold_");
        let mut found = Vec::new();
        for source in wgsl {
            let alone = |function: &&str| !ALONE.iter().any(|(exception, _)| exception == function);
            let functions: Vec<&str> =
                declared(source, "fn ", "texfold_").into_iter().filter(alone).collect();
            // The twins of one file, without those of the module's others.
            let wanted: Vec<&str> = twins.iter().copied().filter(|twin| functions.contains(twin)).collect();
            assert_eq!(functions, wanted, "{name}");
            found.extend(functions);
        }
        let missing: Vec<_> = twins.iter().filter(|twin| !found.contains(twin)).collect();
        assert!(missing.is_empty(), "{name}: no WGSL for {missing:?}");
    }
}

#[test]
fn every_exception_exists() {
    for (function, reason) in ALONE {
        let found = TWINS.iter().any(|twin| twin.functions().contains(&function));
        assert!(found, "{function} ({reason}) is listed but not written");
    }
}

#[test]
fn every_function_of_a_module_carries_its_prefix() {
    for twin in TWINS {
        let name = twin.name;
        let prefix =
            if ["address", "sample"].contains(&name) { "texfold_" } else { &format!("texfold_{name}_") };
        let odd: Vec<_> = twin.functions().into_iter().filter(|found| !found.starts_with(prefix)).collect();
        assert!(odd.is_empty(), "{name}: {odd:?}");
    }
}

#[test]
fn shared_constants_have_the_same_values() {
    for Twin { name, wgsl, rust } in &TWINS[..2] {
        let found = constants(wgsl[0]);
        assert!(!found.is_empty(), "{name}");
        assert_eq!(found, constants(rust), "{name}");
    }
}

#[test]
fn constants_of_modules_have_the_values_of_their_twins() {
    for Twin { name, wgsl, rust } in &TWINS[2..] {
        let known = constants(rust);
        let found = wgsl.iter().flat_map(|source| constants(source));
        let strange: Vec<_> = found.filter(|found| !known.contains(found)).collect();
        assert!(strange.is_empty(), "{name}: {strange:?}");
    }
}

#[test]
fn workgroups_read_as_many_streams_everywhere() {
    let streams = texfold_shaders::BLOCK_STREAMS;
    for (name, source, line) in [
        (
            "share",
            include_str!("../wgsl/entry/block_share.wgsl"),
            format!("const ENTRY_STREAMS: u32 = {streams}u;"),
        ),
        (
            "plan",
            include_str!("../wgsl/entry/tiles_plan.wgsl"),
            format!("const ENTRY_STREAMS: u32 = {streams}u;"),
        ),
        ("web", include_str!("../../web/src/decoder.ts"), format!("const STREAMS = {streams};")),
    ] {
        assert!(source.contains(&line), "{name}: {line}");
    }
}

#[test]
fn nothing_is_sampled_with_implicit_levels() {
    for (name, source) in all_sources() {
        for (at, found) in source.match_indices("textureSample") {
            let rest = &source[at + found.len()..];
            assert!(rest.starts_with("Level("), "{name}: browsers reject textureSample in branches");
        }
    }
}

#[test]
fn loops_have_a_constant_bound() {
    for (name, source) in all_sources() {
        let words: Vec<&str> = source.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        for keyword in ["loop", "while"] {
            assert!(!words.contains(&keyword), "{name}: {keyword}");
        }
        for line in source.lines().filter(|line| line.trim_start().starts_with("for ")) {
            let condition = line.split(';').nth(1).unwrap_or_default();
            let bounded = condition.contains(" < min(") && condition.contains(", TEXFOLD_");
            assert!(bounded, "{name}: no constant bound in {line}");
        }
    }
}

#[test]
fn every_function_is_documented() {
    for twin in TWINS {
        for wgsl in twin.wgsl {
            let lines: Vec<&str> = wgsl.lines().collect();
            for (index, line) in lines.iter().enumerate().filter(|(_, line)| line.starts_with("fn ")) {
                assert!(lines[index - 1].starts_with("// "), "{}: no comment above {line}", twin.name);
            }
        }
    }
}

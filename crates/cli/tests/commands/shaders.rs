//! `shaders`: what it writes is what the validators of each language take, and its JSON says what is bound.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use texfold_shaders::{DctEntry, MODULES, Offsets};

use crate::support::{Place, names};

/// Runs a validator on each of these files; where it is not installed, nothing is known of them.
fn validated(program: &str, options: &[&str], dir: &Path, endings: &[&str]) {
    for name in names(dir).iter().filter(|name| endings.iter().any(|ending| name.ends_with(ending))) {
        match Command::new(program).args(options).arg(dir.join(name)).output() {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                println!("no {program}: {} is not validated", dir.display());
                return;
            }
            Err(error) => panic!("{program}: {error}"),
            Ok(run) => {
                assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stdout));
            }
        }
    }
}

fn json(dir: &Path, name: &str) -> Value {
    serde_json::from_slice(&fs::read(dir.join(name)).unwrap()).unwrap()
}

#[test]
fn every_language_has_every_shader() {
    let place = Place::new();
    let mut shaders = BTreeMap::new();
    for lang in ["wgsl", "glsl", "essl", "hlsl", "msl", "spirv"] {
        let run = place.run(&format!("shaders --lang {lang} --out {lang}"));
        assert_eq!(run.code, Some(0), "{lang}: {}", run.stderr);
        let described = names(&place.at(lang)).into_iter().filter(|name| name.ends_with(".json"));
        shaders.insert(lang, described.collect::<Vec<_>>());
        for name in &shaders[lang] {
            let described = json(&place.at(lang), name);
            // A file a stage, or one of all.
            let stages = match lang {
                "glsl" | "essl" => described["entries"].as_array().unwrap().len(),
                _ => 1,
            };
            let stem = name.strip_suffix("json").unwrap();
            let files = names(&place.at(lang));
            let of_it = files.iter().filter(|file| file.starts_with(stem) && file != &name);
            assert_eq!(of_it.count(), stages, "{lang} {name}");
        }
    }
    assert!(
        shaders.values().all(|found| found == &shaders["wgsl"]) && shaders["wgsl"].len() == MODULES.len() + 6
    );
    validated("spirv-val", &["--target-env", "vulkan1.1"], &place.at("spirv"), &["spv"]);
    for lang in ["glsl", "essl"] {
        validated("glslangValidator", &[], &place.at(lang), &["vert", "frag", "comp"]);
    }
}

#[test]
fn the_json_has_the_offsets_that_parameters_are_written_at() {
    let place = Place::new();
    assert_eq!(place.run("shaders --lang msl --out out").code, Some(0));
    for module in &MODULES {
        let described = json(&place.at("out"), &format!("{}.json", module.name));
        let params = &described["bindings"][0];
        let texfold_shaders::Binding::Params { bytes } = module.bindings[0] else { panic!("no parameters") };
        assert_eq!((params["kind"].as_str(), params["bytes"].as_u64()), (Some("uniform"), Some(bytes)));
        let offset = |name: &str| {
            let members = params["members"].as_array().unwrap();
            members.iter().find(|member| member["name"] == name).and_then(|member| member["offset"].as_u64())
        };
        match module.offsets {
            Offsets::Image(at) => {
                assert_eq!(offset("levels"), Some(at.levels as u64), "{}", module.name);
                assert_eq!(offset("address_mode"), Some(at.address_mode as u64), "{}", module.name);
            }
            Offsets::Light(at) => assert_eq!(offset("terms"), Some(at.terms as u64)),
        }
        // A plane that no function reads is not among them.
        let bound = described["bindings"].as_array().unwrap().iter().filter(|binding| binding["group"] == 0);
        let numbers: Vec<u64> = bound.filter_map(|binding| binding["binding"].as_u64()).collect();
        assert!(numbers.iter().all(|&number| number < module.bindings.len() as u64), "{}", module.name);
    }
    let blocks = json(&place.at("out"), "dct-unorm8.json");
    let entries: Vec<&str> =
        blocks["entries"].as_array().unwrap().iter().filter_map(|entry| entry["name"].as_str()).collect();
    assert_eq!(entries, DctEntry::ALL.map(DctEntry::name));
    assert_eq!(blocks["entries"][0]["workgroup"], serde_json::json!([8, 1, 1]));
}

#[test]
fn bindings_lie_where_the_json_has_them() {
    let place = Place::new();
    for lang in ["glsl", "essl", "hlsl", "msl"] {
        assert_eq!(place.run(&format!("shaders dct vq --lang {lang} --out {lang}")).code, Some(0));
        let dir = place.at(lang);
        for shader in ["dct-unorm8", "vq"] {
            let files = names(&dir).into_iter().filter(|name| name.starts_with(&format!("{shader}.")));
            let texts =
                files.filter(|name| !name.ends_with("json")).map(|name| fs::read_to_string(dir.join(name)));
            let text: String = texts.map(Result::unwrap).collect();
            for binding in json(&dir, &format!("{shader}.json"))["bindings"].as_array().unwrap() {
                let at = binding["place"].as_str().unwrap();
                let (kind, number) = at.split_once(' ').unwrap();
                // GLSL ES 3.00 has names instead of numbers, those of the stages that use them.
                let wanted = match lang {
                    "essl" if shader == "vq" && kind == "uniform" => format!("uniform {number} {{"),
                    "essl" if shader == "vq" => format!("sampler2D {number};"),
                    // Space 0 goes without saying.
                    "hlsl" => format!("register({})", at.replace(", space0", "")),
                    "msl" => format!("[[{kind}({number})]]"),
                    _ => format!("binding = {number}"),
                };
                assert!(text.contains(&wanted), "{lang} {shader}: no {wanted}");
            }
        }
    }
}

#[test]
fn codecs_are_chosen_by_name_and_what_a_target_lacks_is_replaced() {
    let place = Place::new();
    assert_eq!(place.run("shaders bc epitome --lang essl --out out").code, Some(0));
    assert_eq!(names(&place.at("out")).len(), 6);
    let shader = fs::read_to_string(place.at("out").join("epitome.fragment_main.frag")).unwrap();
    assert!(shader.starts_with("#version 300 es\n// Texfold") && !shader.contains("textureQueryLevels"));
    let glsl = place.run("shaders bc --lang glsl --out glsl");
    assert_eq!(glsl.code, Some(0));
    let shader = fs::read_to_string(place.at("glsl").join("bc.fragment_main.frag")).unwrap();
    assert!(shader.contains("textureQueryLevels") && shader.contains("layout(binding = 1)"));
    for wrong in ["shaders gif --lang glsl --out out", "shaders --lang cg --out out", "shaders --out out"] {
        assert_eq!(place.run(wrong).code, Some(2), "{wrong}");
    }
}

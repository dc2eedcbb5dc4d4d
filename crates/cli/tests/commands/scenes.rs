//! Scenes of glTF with textures beside them.

use std::fs;

use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Value, json};

use crate::support::Place;

/// A `.glb` file of that JSON and binary chunk.
fn glb(json: &Value, mut bin: Vec<u8>) -> Vec<u8> {
    let mut text = serde_json::to_vec(json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let chunk =
        |kind: &[u8; 4], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], &kind[..], data].concat();
    let chunks = [chunk(b"JSON", &text), chunk(b"BIN\0", &bin)].concat();
    [&b"glTF"[..], &2u32.to_le_bytes(), &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

/// JSON and binary chunk of a `.glb` file.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let length = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], length(8)), (&b"glTF"[..], bytes.len()));
    let json = serde_json::from_slice(&bytes[20..20 + length(12)]).unwrap();
    let bin = 20 + length(12);
    (json, bytes.get(bin + 8..).unwrap_or_default().to_vec())
}

/// The bytes of a buffer view.
fn view<'b>(json: &Value, bin: &'b [u8], index: u64) -> &'b [u8] {
    let view = &json["bufferViews"][index as usize];
    let number = |name: &str| view[name].as_u64().unwrap() as usize;
    assert_eq!(number("buffer"), 0);
    &bin[number("byteOffset")..][..number("byteLength")]
}

/// The image that a texture shows without its extension.
fn shown(json: &Value, bin: &[u8], texture: usize) -> image::DynamicImage {
    let source = json["textures"][texture]["source"].as_u64().unwrap();
    let part = json["images"][source as usize]["bufferView"].as_u64().unwrap();
    image::load_from_memory(view(json, bin, part)).unwrap()
}

const POSITIONS: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.5];

/// Two materials that share colours, of a triangle: opaque, with occlusion in the channels of roughness and metalness; emitting, in an image
/// beside the scene.
fn scene(place: &Place) -> Vec<u8> {
    for (name, channels) in [("color", 4), ("normal", 3), ("orm", 3), ("glow", 3)] {
        place.image(&format!("{name}.png"), 320, 64, channels);
    }
    let mut bin: Vec<u8> = POSITIONS.iter().flat_map(|value| value.to_le_bytes()).collect();
    let mut views = vec![json!({ "buffer": 0, "byteLength": 36 })];
    for name in ["color", "normal", "orm"] {
        let bytes = fs::read(place.at(&format!("{name}.png"))).unwrap();
        bin.resize(bin.len().next_multiple_of(4), 0);
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        bin.extend(bytes);
    }
    let json = json!({
        "asset": { "version": "2.0" },
        "extras": { "bufferView": 7 },
        "buffers": [{ "byteLength": bin.len() }],
        "bufferViews": views,
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0.5] }],
        "images": [
            { "bufferView": 1, "mimeType": "image/png" },
            { "bufferView": 2, "mimeType": "image/png" },
            { "bufferView": 3, "mimeType": "image/png" },
            { "uri": "my%20glow.png" },
        ],
        "textures": [{ "source": 0 }, { "source": 1 }, { "source": 2 }, { "source": 3 }, { "source": 0 }],
        "materials": [
            {
                "name": "lea/ther",
                "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 2 } },
                "normalTexture": { "index": 1 },
                "occlusionTexture": { "index": 2 },
            },
            { "pbrMetallicRoughness": { "baseColorTexture": { "index": 4 } }, "emissiveTexture": { "index": 3 } },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "nodes": [{ "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
        "scene": 0,
    });
    fs::rename(place.at("glow.png"), place.at("my glow.png")).unwrap();
    glb(&json, bin)
}

#[test]
fn a_scene_is_packed_and_unpacked_and_keeps_all_else() {
    let place = Place::new();
    fs::write(place.at("chair.glb"), scene(&place)).unwrap();
    let run = place.run("pack chair.glb --out packed --effort fast --psnr 40 --weights normal=2");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.contains("orm") && run.stdout.contains("compressed"), "{}", run.stdout);
    let (json, bin) = parts(&fs::read(place.at("packed/chair.glb")).unwrap());
    let of_texture = |texture: usize| &json["textures"][texture]["extensions"]["TEXFOLD_texture"];
    assert_eq!(of_texture(0), &json!({ "uri": "chair-lea_ther.txf", "map": "color" }));
    assert_eq!(of_texture(4), of_texture(0), "both materials name the same image");
    assert_eq!(of_texture(3), &json!({ "uri": "chair-material-1.txf", "map": "emissive" }));
    assert_eq!(json["extensionsUsed"], json!(["TEXFOLD_texture"]));
    assert!(json.get("extensionsRequired").is_none());
    let positions: Vec<u8> = POSITIONS.iter().flat_map(|value| value.to_le_bytes()).collect();
    let triangle = json["accessors"][0]["bufferView"].as_u64().unwrap();
    assert!(view(&json, &bin, triangle) == positions);
    assert_eq!(json["extras"]["bufferView"], 7, "what applications keep stays");
    let small = shown(&json, &bin, 0);
    assert_eq!((small.width(), small.height(), small.color().channel_count()), (160, 32, 3));
    let info: Value =
        serde_json::from_str(&place.run("info packed/chair-lea_ther.txf --json").stdout).unwrap();
    let maps: Vec<(&str, u64)> = info["maps"]
        .as_array()
        .unwrap()
        .iter()
        .map(|map| (map["name"].as_str().unwrap(), map["channels"].as_u64().unwrap()))
        .collect();
    assert_eq!(maps, [("color", 3), ("orm", 3), ("normal", 3)], "an opaque material needs no alpha");

    let run = place.run("unpack packed/chair.glb --out plain");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let (json, bin) = parts(&fs::read(place.at("plain/chair.glb")).unwrap());
    assert!(!json.to_string().contains("TEXFOLD"), "{json}");
    assert_eq!(json["images"].as_array().map(Vec::len), Some(4));
    for (texture, name) in [(0, "color.png"), (1, "normal.png"), (2, "orm.png"), (3, "my glow.png")] {
        let (found, wanted) =
            (shown(&json, &bin, texture).to_rgb8(), image::open(place.at(name)).unwrap().to_rgb8());
        assert_eq!(found.dimensions(), wanted.dimensions());
        let error: f64 =
            found.iter().zip(wanted.iter()).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2)).sum();
        assert!(error / (found.len() as f64) < 30.0, "{name}: {}", error / found.len() as f64);
    }
    let triangle = json["accessors"][0]["bufferView"].as_u64().unwrap();
    assert!(view(&json, &bin, triangle) == positions);
}

#[test]
fn channels_that_extensions_read_stay_and_formats_that_go_are_not_required() {
    let place = Place::new();
    let (mut json, bin) = parts(&scene(&place));
    json["textures"][1]["extensions"] = json!({ "EXT_texture_webp": { "source": 1 } });
    json["extensionsUsed"] = json!(["EXT_texture_webp", "KHR_materials_sheen"]);
    json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    let pbr = json["materials"][0]["pbrMetallicRoughness"].as_object_mut().unwrap();
    let color = pbr.remove("baseColorTexture").unwrap();
    json["materials"][1]["pbrMetallicRoughness"] = json!({});
    json["materials"][0]["extensions"] = json!({ "KHR_materials_sheen": { "sheenColorTexture": color } });
    fs::write(place.at("chair.glb"), glb(&json, bin)).unwrap();
    let run = place.run("pack chair.glb --out packed --effort fast");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let (json, _) = parts(&fs::read(place.at("packed/chair.glb")).unwrap());
    assert_eq!(json["extensionsUsed"], json!(["KHR_materials_sheen", "TEXFOLD_texture"]));
    assert!(json.get("extensionsRequired").is_none(), "{json}");
    let info: Value =
        serde_json::from_str(&place.run("info packed/chair-lea_ther.txf --json").stdout).unwrap();
    let sheen = info["maps"].as_array().unwrap().iter().find(|map| map["name"] == "sheenColor").unwrap();
    assert_eq!(sheen["channels"], 4, "roughness of the sheen lies beside its colour");
}

#[test]
fn others_are_shown_the_images_or_nothing() {
    let place = Place::new();
    let bytes = scene(&place);
    fs::write(place.at("chair.glb"), &bytes).unwrap();
    let run = place.run("pack chair.glb --out none --effort fast --fallback none");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let (json, bin) = parts(&fs::read(place.at("none/chair.glb")).unwrap());
    assert!(json.get("images").is_none() && json["textures"][0].get("source").is_none());
    assert_eq!((json["bufferViews"].as_array().map(Vec::len), bin.len()), (Some(1), 36));
    assert_eq!(json["extensionsRequired"], json!(["TEXFOLD_texture"]));
    let run = place.run("pack chair.glb --out all --effort fast --fallback original");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let (json, bin) = parts(&fs::read(place.at("all/chair.glb")).unwrap());
    assert!(shown(&json, &bin, 1) == image::open(place.at("normal.png")).unwrap());
    assert!(
        shown(&json, &bin, 3) == image::open(place.at("my glow.png")).unwrap(),
        "what lay beside the scene"
    );
    assert_eq!((&json["images"][3]["mimeType"], json["images"][3].get("uri")), (&json!("image/png"), None));
    // Bound for its own place, a scene is not replaced.
    let run = place.run("pack chair.glb --out .");
    assert!(run.code == Some(1) && run.stderr.contains("over itself"), "{}", run.stderr);
    assert!(fs::read(place.at("chair.glb")).unwrap() == bytes);
}

#[test]
fn parts_that_meshopt_compressed_stay_as_they_are() {
    const NAME: &str = "EXT_meshopt_compression";
    let place = Place::new();
    let (json, mut bin) = parts(&scene(&place));
    let positions = bin[..36].to_vec();
    let compressed = [0xa0, 7, 1, 2, 3];
    let start = bin.len();
    bin.extend(compressed);
    let encoded = BASE64_STANDARD.encode(&positions);
    // Without the bytes that were compressed, and with them.
    for uri in [None, Some(format!("data:application/octet-stream;base64,{encoded}"))] {
        let mut json = json.clone();
        let part = json!({ "buffer": 0, "byteOffset": start, "byteLength": 5, "byteStride": 12, "count": 3, "mode": "ATTRIBUTES" });
        json["bufferViews"][0] =
            json!({ "buffer": 1, "byteLength": 36, "byteStride": 12, "extensions": { NAME: part } });
        let mut fallback = json!({ "byteLength": 36, "extensions": { NAME: { "fallback": true } } });
        if let Some(uri) = &uri {
            fallback["uri"] = uri.as_str().into();
        }
        json["buffers"] = json!([{ "byteLength": bin.len() }, fallback]);
        (json["extensionsUsed"], json["extensionsRequired"]) = (json!([NAME]), json!([NAME]));
        fs::write(place.at("chair.glb"), glb(&json, bin.clone())).unwrap();
        for (command, out) in [
            ("pack chair.glb --out packed --effort fast", "packed/chair.glb"),
            ("unpack packed/chair.glb --out plain", "plain/chair.glb"),
        ] {
            let run = place.run(command);
            assert_eq!(run.code, Some(0), "{}", run.stderr);
            let (json, bin) = parts(&fs::read(place.at(out)).unwrap());
            let of_mesh = json["accessors"][0]["bufferView"].as_u64().unwrap();
            let found = &json["bufferViews"][of_mesh as usize];
            let part = &found["extensions"][NAME];
            let at = part["byteOffset"].as_u64().unwrap() as usize;
            assert_eq!(
                (&part["buffer"], &part["count"], &bin[at..at + 5]),
                (&json!(0), &json!(3), &compressed[..])
            );
            assert!(json["extensionsRequired"].as_array().unwrap().contains(&json!(NAME)));
            if uri.is_some() {
                assert!(
                    view(&json, &bin, of_mesh) == positions && json["buffers"].as_array().unwrap().len() == 1
                );
            } else {
                assert_eq!((&found["buffer"], &found["byteLength"]), (&json!(1), &json!(36)));
                assert_eq!(json["buffers"][1]["extensions"][NAME]["fallback"], true);
                assert_eq!(json["buffers"][1]["byteLength"], 36);
            }
        }
    }
}

#[test]
fn scenes_that_cannot_be_packed_say_why() {
    let place = Place::new();
    let bytes = scene(&place);
    let (json, bin) = parts(&bytes);
    let with = |change: &dyn Fn(&mut Value)| {
        let mut json = json.clone();
        change(&mut json);
        glb(&json, bin.clone())
    };
    for (scene, wanted) in [
        (bytes[..bytes.len() / 2].to_vec(), "cannot be read"),
        (b"{}".to_vec(), "not of glTF 2"),
        (b"[1]".to_vec(), "not of glTF 2"),
        (with(&|json| json["images"][3]["uri"] = "../my glow.png".into()), "outside"),
        (with(&|json| json["images"][3]["uri"] = "https://example.org/a.png".into()), "outside"),
        (with(&|json| json["images"][3]["uri"] = "missing.png".into()), "missing.png"),
        (with(&|json| json["images"][3]["uri"] = "data:image/png;base64,!".into()), "base64"),
        (with(&|json| json["bufferViews"][2]["byteLength"] = u64::MAX.into()), "memory"),
        (with(&|json| json["bufferViews"][2]["byteLength"] = 1_000_000.into()), "not there"),
        (with(&|json| json["images"] = json!([])), "no materials"),
        (with(&|json| json["materials"] = json!([])), "no materials"),
        (with(&|json| json["images"] = json!([1, 2, 3, 4])), "without bytes"),
    ] {
        fs::write(place.at("chair.glb"), scene).unwrap();
        let run = place.run("pack chair.glb --out packed --effort fast");
        assert!(
            run.code == Some(1) && run.stderr.contains(wanted),
            "{wanted}: {:?} {}",
            run.code,
            run.stderr
        );
        assert!(!place.at("packed/chair.glb").exists());
    }
    fs::write(place.at("chair.glb"), &bytes).unwrap();
    let run = place.run("unpack chair.glb --out plain");
    assert!(run.stderr.contains("no textures that pack has made"), "{}", run.stderr);
    let place_of =
        |place: Value| with(&|json| json["textures"][0]["extensions"] = json!({ "TEXFOLD_texture": place }));
    for (named, wanted) in [
        (json!({ "uri": "../a.txf", "map": "color" }), "no name of a file"),
        (json!({ "uri": "a.txf" }), "map has none"),
        (json!({ "uri": "none.txf", "map": "color" }), "none.txf"),
    ] {
        fs::write(place.at("chair.glb"), place_of(named)).unwrap();
        let run = place.run("unpack chair.glb --out plain");
        assert!(run.code == Some(1) && run.stderr.contains(wanted), "{wanted}: {}", run.stderr);
    }
}

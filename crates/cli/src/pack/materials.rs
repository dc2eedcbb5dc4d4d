//! Which images of a scene are maps of which material.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use texfold_core::image::{Alpha, ColorSpace, MapInfo, MapKind};

use super::scene::Scene;

/// Extensions of textures that name an image in a format that is read.
const OTHER_SOURCES: [&str; 1] = ["EXT_texture_webp"];

/// An image that becomes a map.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Slot {
    pub(super) image: usize,
    pub(super) kind: MapKind,
    pub(super) color: ColorSpace,
    pub(super) name: String,
    /// Meaning of the channel beside colours.
    pub(super) alpha: Alpha,
}

/// Images that become one texture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Material {
    /// What names its file.
    pub(super) name: String,
    pub(super) slots: Vec<Slot>,
}

/// The images that all materials name, each with the first material that names it.
pub(super) fn materials(scene: &Scene) -> Vec<Material> {
    let alphas = alphas(scene);
    let mut taken = BTreeSet::new();
    let mut names = BTreeSet::new();
    let mut found = Vec::new();
    for (number, material) in scene.list("materials").iter().enumerate() {
        let mut slots: Vec<Slot> = Vec::new();
        for (key, texture, kind, color) in textures_of(material) {
            let Some(image) = image_of(scene, texture).filter(|&image| taken.insert(image)) else { continue };
            let alpha = match color {
                ColorSpace::Srgb => alphas.get(&image).copied().unwrap_or_default(),
                _ => Alpha::Band,
            };
            let usual = if kind == MapKind::Other { key.trim_end_matches("Texture") } else { kind.name() };
            let usual = if MapInfo::is_name(usual) { usual } else { kind.name() };
            let is_free = |name: &String| slots.iter().all(|slot| slot.name != *name);
            let name = numbered(usual, is_free);
            slots.push(Slot { image, kind, color, name, alpha });
        }
        if slots.is_empty() {
            continue;
        }
        let name = numbered(&file_name(material["name"].as_str(), number), |name| !names.contains(name));
        names.insert(name.clone());
        found.push(Material { name, slots });
    }
    found
}

/// A name that is free, with a number behind it where it is not itself.
fn numbered(usual: &str, is_free: impl Fn(&String) -> bool) -> String {
    let mut names =
        std::iter::once(usual.to_owned()).chain((2u32..).map(|number| format!("{usual}-{number}")));
    names.find(is_free).unwrap_or_default()
}

/// A part of a file's name, of a material's.
fn file_name(name: Option<&str>, number: usize) -> String {
    let plain = |char: char| if char.is_ascii_alphanumeric() || "-_".contains(char) { char } else { '_' };
    let name: String = name.unwrap_or_default().chars().take(40).map(plain).collect();
    if name.is_empty() { format!("material-{number}") } else { name }
}

/// The textures of a material: the member that names each, and what it holds.
fn textures_of(material: &Value) -> Vec<(String, usize, MapKind, ColorSpace)> {
    let pbr = &material["pbrMetallicRoughness"];
    let known = [
        ("baseColorTexture", &pbr["baseColorTexture"], MapKind::BaseColor, ColorSpace::Srgb),
        (
            "metallicRoughnessTexture",
            &pbr["metallicRoughnessTexture"],
            MapKind::OcclusionRoughnessMetalness,
            ColorSpace::Linear,
        ),
        ("normalTexture", &material["normalTexture"], MapKind::Normal, ColorSpace::Normal),
        ("occlusionTexture", &material["occlusionTexture"], MapKind::Occlusion, ColorSpace::Linear),
        ("emissiveTexture", &material["emissiveTexture"], MapKind::Emissive, ColorSpace::Srgb),
    ];
    let known = known.into_iter().filter_map(|(key, info, kind, color)| {
        Some((key.to_owned(), info["index"].as_u64()? as usize, kind, color))
    });
    let mut found: Vec<_> = known.collect();
    further(&material["extensions"], &mut found);
    found
}

/// The textures that extensions name: members whose names end so.
fn further(value: &Value, found: &mut Vec<(String, usize, MapKind, ColorSpace)>) {
    let Some(members) = value.as_object() else { return };
    for (key, member) in members {
        match member["index"].as_u64().filter(|_| key.ends_with("Texture")) {
            Some(index) => {
                let has = |words: &[&str]| words.iter().any(|word| key.contains(word));
                let (kind, color) = if has(&["Normal", "normal"]) {
                    (MapKind::Normal, ColorSpace::Normal)
                } else if has(&["Color", "diffuse", "specularGlossiness"]) {
                    (MapKind::Other, ColorSpace::Srgb)
                } else {
                    (MapKind::Other, ColorSpace::Linear)
                };
                found.push((key.clone(), index as usize, kind, color));
            }
            None => further(member, found),
        }
    }
}

/// The image of a texture, in a format that is read.
pub(super) fn image_of(scene: &Scene, texture: usize) -> Option<usize> {
    let texture = scene.list("textures").get(texture)?;
    let others = OTHER_SOURCES.iter().map(|name| &texture["extensions"][name]["source"]);
    let image = others.chain([&texture["source"]]).find_map(Value::as_u64)? as usize;
    (image < scene.list("images").len()).then_some(image)
}

/// Meaning of the fourth channel of each image: alpha of base colours where a material is not opaque, data where an extension may read it; of
/// materials that share an image, what keeps most.
fn alphas(scene: &Scene) -> BTreeMap<usize, Alpha> {
    let mut found = BTreeMap::new();
    for material in scene.list("materials") {
        for (_, texture, kind, _) in textures_of(material) {
            let Some(image) = image_of(scene, texture) else { continue };
            let alpha = match (kind, material["alphaMode"].as_str()) {
                (MapKind::BaseColor, Some("BLEND")) => Alpha::Straight,
                (MapKind::BaseColor, Some("MASK")) => {
                    Alpha::Cutout(material["alphaCutoff"].as_f64().unwrap_or(0.5) as f32)
                }
                (MapKind::Other, _) => Alpha::Band,
                _ => Alpha::Opaque,
            };
            let kept = found.entry(image).or_insert(alpha);
            *kept = match (*kept, alpha) {
                (Alpha::Opaque, other) | (other, Alpha::Opaque) => other,
                (one, other) if one == other => one,
                (Alpha::Band, _) | (_, Alpha::Band) => Alpha::Band,
                _ => Alpha::Straight,
            };
        }
    }
    found
}

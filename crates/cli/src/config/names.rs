//! Kinds of maps and colour handling by file name.

use std::path::{Path, PathBuf};

use texfold_core::image::{ColorSpace, MapKind};

use super::values::ColorName::{self, Linear, Normal};
use crate::settings::Settings;

/// Ends of names of maps, lower case, behind a separator; longer ones first.
const ENDS: [(&str, MapKind); 53] = [
    ("normal_opengl", MapKind::Normal),
    ("normal_directx", MapKind::Normal),
    ("normal_gl", MapKind::Normal),
    ("normal_dx", MapKind::Normal),
    ("normal_map", MapKind::Normal),
    ("normalgl", MapKind::Normal),
    ("normaldx", MapKind::Normal),
    ("normalmap", MapKind::Normal),
    ("normals", MapKind::Normal),
    ("normal", MapKind::Normal),
    ("nor_gl", MapKind::Normal),
    ("nor_dx", MapKind::Normal),
    ("norm", MapKind::Normal),
    ("nor", MapKind::Normal),
    ("nrm", MapKind::Normal),
    ("occlusionroughnessmetallic", MapKind::OcclusionRoughnessMetalness),
    ("occlusionroughmetal", MapKind::OcclusionRoughnessMetalness),
    ("metallicroughness", MapKind::OcclusionRoughnessMetalness),
    ("ambient_occlusion", MapKind::Occlusion),
    ("ambientocclusion", MapKind::Occlusion),
    ("displacement", MapKind::Height),
    ("transparency", MapKind::Opacity),
    ("base_color", MapKind::BaseColor),
    ("basecolor", MapKind::BaseColor),
    ("basecolour", MapKind::BaseColor),
    ("roughness", MapKind::Roughness),
    ("metalness", MapKind::Metalness),
    ("occlusion", MapKind::Occlusion),
    ("metallic", MapKind::Metalness),
    ("emissive", MapKind::Emissive),
    ("emission", MapKind::Emissive),
    ("opacity", MapKind::Opacity),
    ("diffuse", MapKind::BaseColor),
    ("albedo", MapKind::BaseColor),
    ("height", MapKind::Height),
    ("colour", MapKind::BaseColor),
    ("color", MapKind::BaseColor),
    ("alpha", MapKind::Opacity),
    ("rough", MapKind::Roughness),
    ("metal", MapKind::Metalness),
    ("diff", MapKind::BaseColor),
    ("disp", MapKind::Height),
    ("emit", MapKind::Emissive),
    ("mask", MapKind::Other),
    ("bump", MapKind::Height),
    ("spec", MapKind::Other),
    ("base", MapKind::BaseColor),
    ("col", MapKind::BaseColor),
    ("orm", MapKind::OcclusionRoughnessMetalness),
    ("arm", MapKind::OcclusionRoughnessMetalness),
    ("rma", MapKind::Other),
    ("mra", MapKind::Other),
    ("ao", MapKind::Occlusion),
];

/// Ends that may be words of a name as well: they tell a map only among others of its material.
const WORDS: [&str; 4] = ["metal", "alpha", "spec", "base"];

/// A map, by its file's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct MapName {
    /// The name before the end, which all maps of a material have; empty where the end is all of the name.
    pub(crate) material: String,
    /// The end.
    pub(crate) end: &'static str,
    pub(crate) kind: MapKind,
}

impl MapName {
    /// The map that a file is by its name. A size such as `_4k` may follow the end.
    pub(crate) fn of(path: &Path) -> Option<MapName> {
        let stem = path.file_stem()?.to_string_lossy().into_owned();
        // One byte for one, so that places are alike.
        let plain = stem.to_ascii_lowercase().replace(['-', ' ', '.'], "_");
        let is_size = |last: &str| {
            last.strip_suffix('k')
                .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
        };
        let plain =
            plain.rsplit_once('_').filter(|(_, last)| is_size(last)).map_or(plain.as_str(), |(name, _)| name);
        let of_end = |&(end, kind): &(&'static str, MapKind)| {
            let before = plain.strip_suffix(end)?;
            let length = if before.is_empty() { 0 } else { before.strip_suffix('_')?.len() };
            Some(MapName { material: stem.get(..length)?.to_owned(), end, kind })
        };
        ENDS.iter().find_map(of_end)
    }

    /// Whether the second axis of normals points down.
    pub(crate) fn is_directx(&self) -> bool {
        self.kind == MapKind::Normal && (self.end.ends_with("dx") || self.end.ends_with("directx"))
    }

    /// How values of such a map are handled.
    pub(crate) fn color(&self) -> ColorSpace {
        self.kind.color_space()
    }
}

/// The end of a lone file's name and the colour handling that it stands for, where that is not the usual one.
fn of_name(path: &Path) -> Option<(&'static str, ColorName)> {
    let found = MapName::of(path).filter(|name| !name.material.is_empty() && !WORDS.contains(&name.end))?;
    match found.color() {
        ColorSpace::Srgb => None,
        ColorSpace::Linear => Some((found.end, Linear)),
        ColorSpace::Normal => Some((found.end, Normal)),
    }
}

/// Takes the colour handling that all files have by their names.
pub(super) fn settle(files: &[PathBuf], settings: &mut Settings) {
    let named: Vec<Option<(&str, ColorName)>> = files.iter().map(|file| of_name(file)).collect();
    let color_of = |named: &Option<(&str, ColorName)>| named.map(|(_, color)| color);
    let first = named.first().and_then(color_of);
    let alike = named.iter().all(|named| color_of(named) == first);
    for (file, (end, color)) in files.iter().zip(&named).filter_map(|(file, named)| Some((file, (*named)?))) {
        if alike {
            settings.color = color.color();
            let handling = if color == Normal { "normal" } else { "linear" };
            settings.remarks.note(file, format!("handled as {handling} because the name ends in {end}"));
        } else {
            settings.remarks.warn(
                file,
                "by its name another kind of map than the rest of its folder, and handled as srgb; \
                 give `--as material` to keep maps as what they are in one file, `--as image`, or `--color` for all",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_names_tell_maps() {
        let kind = |name: &str| of_name(Path::new(name)).map(|(_, color)| color);
        for name in [
            "wall_Normal.png",
            "wall_normal.png",
            "wall_nrm.tga",
            "Bricks_2K-PNG_NormalGL.png",
            "brick_nor_gl_4k.png",
            "a/b-Normal_DX.tif",
            "wall.normal.png",
        ] {
            assert_eq!(kind(name), Some(Normal), "{name}");
        }
        for name in [
            "w_Roughness.png",
            "w_Rough.png",
            "w_Metallic.png",
            "w_Metalness.png",
            "w_AO.png",
            "w_Occlusion.png",
            "w_ORM.png",
            "w_OcclusionRoughMetal.png",
            "w_Height.png",
            "w_Displacement.png",
            "w_Mask.png",
            "w_arm_1k.jpg",
        ] {
            assert_eq!(kind(name), Some(Linear), "{name}");
        }
        for name in [
            "normal.png",
            "abnormal.png",
            "wall_Color.png",
            "swarm.png",
            "scratched_metal.png",
            "wall_4k.png",
        ] {
            assert_eq!(kind(name), None, "{name}");
        }
    }

    #[test]
    fn no_end_hides_behind_a_shorter_one() {
        for (end, kind) in ENDS {
            let found = MapName::of(&PathBuf::from(format!("w_{end}.png")));
            assert_eq!(found, Some(MapName { material: "w".to_owned(), end, kind }));
        }
    }

    #[test]
    fn maps_of_a_material_share_its_name() {
        for (name, material, kind) in [
            ("Bricks_2K-PNG_NormalGL.png", "Bricks_2K-PNG", MapKind::Normal),
            ("rusty metal_diff_4k.jpg", "rusty metal", MapKind::BaseColor),
            ("a/Roughness.png", "", MapKind::Roughness),
            ("Helmet.Base_Color.tga", "Helmet", MapKind::BaseColor),
            ("Helmet_OcclusionRoughMetal.png", "Helmet", MapKind::OcclusionRoughnessMetalness),
        ] {
            let found = MapName::of(Path::new(name)).unwrap();
            assert_eq!((found.material.as_str(), found.kind), (material, kind), "{name}");
        }
        assert!(MapName::of(Path::new("w_nor_dx_2k.png")).unwrap().is_directx());
        assert!(!MapName::of(Path::new("w_nor_gl_2k.png")).unwrap().is_directx());
        assert_eq!(MapName::of(Path::new("preview.png")), None);
    }
}

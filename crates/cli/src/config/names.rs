//! Colour handling by file name.

use std::path::{Path, PathBuf};

use super::values::ColorName::{self, Linear, Normal};
use crate::settings::Settings;

/// Ends of names of maps, lower case, behind a separator; longer ones first.
const ENDS: [(&str, ColorName); 33] = [
    ("normal_opengl", Normal),
    ("normal_directx", Normal),
    ("normal_gl", Normal),
    ("normal_dx", Normal),
    ("normal_map", Normal),
    ("normalgl", Normal),
    ("normaldx", Normal),
    ("normalmap", Normal),
    ("normals", Normal),
    ("normal", Normal),
    ("nor_gl", Normal),
    ("nor_dx", Normal),
    ("norm", Normal),
    ("nor", Normal),
    ("nrm", Normal),
    ("occlusionroughnessmetallic", Linear),
    ("occlusionroughmetal", Linear),
    ("metallicroughness", Linear),
    ("ambient_occlusion", Linear),
    ("ambientocclusion", Linear),
    ("displacement", Linear),
    ("roughness", Linear),
    ("metalness", Linear),
    ("occlusion", Linear),
    ("metallic", Linear),
    ("height", Linear),
    ("rough", Linear),
    ("disp", Linear),
    ("mask", Linear),
    ("bump", Linear),
    ("orm", Linear),
    ("arm", Linear),
    ("ao", Linear),
];

/// The end of a file's name and the colour handling that it stands for. A size such as `_4k` may follow the end.
fn of_name(path: &Path) -> Option<(&'static str, ColorName)> {
    let stem = path.file_stem()?.to_string_lossy().to_ascii_lowercase().replace(['-', ' ', '.'], "_");
    let is_size = |last: &str| {
        last.strip_suffix('k')
            .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let stem =
        stem.rsplit_once('_').filter(|(_, last)| is_size(last)).map_or(stem.as_str(), |(name, _)| name);
    let ends = |end: &str| stem.strip_suffix(end).is_some_and(|before| before.ends_with('_'));
    ENDS.into_iter().find(|(end, _)| ends(end))
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
                 give `--as image`, or `--color` for all",
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
        for (index, (end, _)) in ENDS.iter().enumerate() {
            let path = PathBuf::from(format!("w_{end}.png"));
            assert_eq!(of_name(&path).map(|(found, _)| found), Some(*end), "{index}");
        }
    }
}

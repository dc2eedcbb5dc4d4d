//! The maps of a material: images that lie over one another, each with a meaning of its own.

use super::{ColorSpace, PixelInfo};
use crate::SourceError;

/// Meaning of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MapKind {
    /// Base colour, also named albedo or diffuse; alpha is opacity.
    BaseColor,
    /// Unit normals in tangent space.
    Normal,
    /// Roughness.
    Roughness,
    /// Metalness.
    Metalness,
    /// Ambient occlusion.
    Occlusion,
    /// Occlusion in red, roughness in green and metalness in blue, as glTF has them; occlusion may be missing.
    OcclusionRoughnessMetalness,
    /// Height or displacement.
    Height,
    /// Emitted light.
    Emissive,
    /// Opacity.
    Opacity,
    /// Anything else.
    Other,
}

impl MapKind {
    /// All kinds, in the order of their numbers in files.
    pub const ALL: [MapKind; 10] = [
        MapKind::BaseColor,
        MapKind::Normal,
        MapKind::Roughness,
        MapKind::Metalness,
        MapKind::Occlusion,
        MapKind::OcclusionRoughnessMetalness,
        MapKind::Height,
        MapKind::Emissive,
        MapKind::Opacity,
        MapKind::Other,
    ];

    /// Colour space of its values where nothing else is known.
    #[must_use]
    pub fn color_space(self) -> ColorSpace {
        match self {
            MapKind::BaseColor | MapKind::Emissive => ColorSpace::Srgb,
            MapKind::Normal => ColorSpace::Normal,
            _ => ColorSpace::Linear,
        }
    }

    /// Its name, as options and reports have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            MapKind::BaseColor => "color",
            MapKind::Normal => "normal",
            MapKind::Roughness => "roughness",
            MapKind::Metalness => "metalness",
            MapKind::Occlusion => "occlusion",
            MapKind::OcclusionRoughnessMetalness => "orm",
            MapKind::Height => "height",
            MapKind::Emissive => "emissive",
            MapKind::Opacity => "opacity",
            MapKind::Other => "other",
        }
    }

    /// The kind of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<MapKind> {
        MapKind::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// A map of a material.
#[derive(Debug, Clone, PartialEq)]
pub struct MapInfo {
    /// Its meaning.
    pub kind: MapKind,
    /// Its name, which no other map of its material has.
    pub name: String,
    /// Channels, depth, colour space and alpha of its source.
    pub pixel: PixelInfo,
}

impl MapInfo {
    /// Longest name in bytes.
    pub const MAX_NAME: usize = 64;
    /// Most maps of a material.
    pub const MAX_MAPS: usize = 64;

    /// Whether a map may have that name.
    #[must_use]
    pub fn is_name(name: &str) -> bool {
        (1..=MapInfo::MAX_NAME).contains(&name.len())
            && !name.starts_with('.')
            && !name.chars().any(|char| char.is_control() || ['/', '\\', ':'].contains(&char))
    }

    /// Checks the number of maps and their names: what can name a file, each once.
    pub(crate) fn check(maps: &[MapInfo]) -> Result<(), SourceError> {
        if maps.len() > MapInfo::MAX_MAPS {
            return Err(SourceError::TooManyMaps { maps: maps.len() });
        }
        let is_new = |index: usize| maps[..index].iter().all(|other| other.name != maps[index].name);
        match maps.iter().enumerate().find(|&(index, map)| !MapInfo::is_name(&map.name) || !is_new(index)) {
            Some((_, map)) => Err(SourceError::MapName { name: map.name.clone() }),
            None => Ok(()),
        }
    }
}

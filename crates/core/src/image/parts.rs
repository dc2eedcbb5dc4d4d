//! Images of what an encoded texture consists of.

use super::Raster;

/// Images of one part of a texture, for a person to look at: one for each image of the texture, or one for each plane that all share.
#[derive(Debug, Clone)]
pub struct PartImages {
    /// Name of the part, for file names.
    pub name: &'static str,
    /// The images.
    pub images: Vec<Raster>,
}

impl PartImages {
    /// The images of the part of that name; none where there is no such part.
    #[must_use]
    pub fn of<'p>(parts: &'p [PartImages], name: &str) -> &'p [Raster] {
        parts.iter().find(|part| part.name == name).map_or(&[], |part| &part.images)
    }
}

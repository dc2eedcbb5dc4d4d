//! What is encoded: a root and images that show parts of it in more detail.

use glam::DMat3;
use texfold_core::image::Raster;

use crate::linear::{area_scale, project};
use crate::{Registration, ZipError};

/// One image at one place of the root.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSource {
    /// Which image of the stack; several patches may show the same.
    pub image: usize,
    /// From the root's texture coordinates to the image's, 0 to 1 each.
    pub matrix: DMat3,
    /// Opacity of each texel, white where opaque; by the image's gradients alone where there is none.
    pub mask: Option<Raster>,
    /// The patch that it lies on; the root where there is none.
    pub parent: Option<usize>,
}

/// A root and patches.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchStack {
    /// What everything lies on.
    pub root: Raster,
    /// Images of the patches.
    pub images: Vec<Raster>,
    /// The patches; later ones lie over earlier ones.
    pub patches: Vec<PatchSource>,
}

impl PatchStack {
    /// A folder of photographs, as registration has put them in order.
    #[must_use]
    pub fn registered(photos: &[Raster], found: &Registration) -> Option<PatchStack> {
        let root = photos.get(found.root)?.clone();
        let mut stack = PatchStack { root, images: Vec::new(), patches: Vec::new() };
        for placed in &found.placed {
            let parent = found.placed.iter().position(|other| other.photo == placed.parent);
            stack.images.push(photos.get(placed.photo)?.clone());
            stack.patches.push(PatchSource {
                image: stack.images.len() - 1,
                matrix: placed.matrix,
                mask: None,
                parent,
            });
        }
        Some(stack)
    }

    /// Maps of another kind, such as normals or heights, at the places of these patches: a root, a map for each patch,
    /// and the opacity of each, from [`crate::masks`] of the colours. Encode them with [`crate::ZipParams::merge`]
    /// off, as they have no exposure.
    ///
    /// # Errors
    /// [`ZipError::Maps`] where there are not as many maps and masks as patches. Masks of another size than the maps
    /// are an error of encoding.
    pub fn riding(
        &self,
        root: Raster,
        maps: Vec<Raster>,
        masks: Vec<Raster>,
    ) -> Result<PatchStack, ZipError> {
        if maps.len() != self.patches.len() || masks.len() != self.patches.len() {
            return Err(ZipError::Maps { found: maps.len().min(masks.len()), patches: self.patches.len() });
        }
        let patch = |(image, (patch, mask)): (usize, (&PatchSource, Raster))| PatchSource {
            image,
            mask: Some(mask),
            ..patch.clone()
        };
        let patches = self.patches.iter().zip(masks).enumerate().map(patch).collect();
        Ok(PatchStack { root, images: maps, patches })
    }

    /// The order in which patches are laid: parents before those that lie on them, else as they are named.
    pub(crate) fn order(&self) -> Result<Vec<usize>, ZipError> {
        let mut laid = Vec::new();
        for (patch, source) in self.patches.iter().enumerate() {
            if let Some(parent) = source.parent.filter(|&parent| parent >= self.patches.len()) {
                return Err(ZipError::NoParent { patch, parent });
            }
            let mut chain = vec![patch];
            let mut at = patch;
            while let Some(parent) = self.patches[at].parent {
                if chain.contains(&parent) {
                    return Err(ZipError::Cycle { patch });
                }
                chain.push(parent);
                at = parent;
            }
            laid.extend(chain.into_iter().rev().filter(|index| !laid.contains(index)).collect::<Vec<_>>());
        }
        Ok(laid)
    }

    /// Texels of a patch to a texel of the root, at its middle.
    pub(crate) fn zoom(&self, patch: &PatchSource) -> f64 {
        let extent = |image: &Raster| glam::DVec2::new(image.size().width.into(), image.size().height.into());
        let (own, root) = (extent(&self.images[patch.image]), extent(&self.root));
        let middle = project(&patch.matrix.inverse(), glam::DVec2::splat(0.5));
        let pixels = DMat3::from_scale(own) * patch.matrix * DMat3::from_scale(root.recip());
        area_scale(&pixels, middle * root).abs().sqrt()
    }
}

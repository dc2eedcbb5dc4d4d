//! What is encoded: a mesh and photographs of it.

use crate::mesh::{MAX_TRIANGLES, MAX_VERTICES};
use crate::{Camera, CaptureError, Mesh};

/// Most photographs: an index has 16 bits.
const MAX_VIEWS: usize = 1 << 15;

/// One photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// What took it.
    pub camera: Camera,
    /// Red, green, blue and whether the object is seen (255) or not (0), row by row from the top.
    pub pixels: Vec<[u8; 4]>,
}

/// A mesh and photographs of it, in one space.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Capture {
    /// The object's shape.
    pub mesh: Mesh,
    /// The photographs.
    pub views: Vec<Photograph>,
}

impl Capture {
    /// Checks sizes and numbers.
    ///
    /// # Errors
    /// [`CaptureError`] names the first fault.
    pub fn check(&self) -> Result<(), CaptureError> {
        if self.views.is_empty() {
            return Err(CaptureError::NoViews);
        }
        if self.views.len() > MAX_VIEWS {
            return Err(CaptureError::TooManyViews { views: self.views.len(), max: MAX_VIEWS });
        }
        self.check_mesh()?;
        for (index, view) in self.views.iter().enumerate() {
            if !view.camera.is_valid() {
                return Err(CaptureError::Camera { index });
            }
            let needed = u64::from(view.camera.width) * u64::from(view.camera.height);
            if view.pixels.len() as u64 != needed {
                return Err(CaptureError::ViewSize { index, found: view.pixels.len(), needed });
            }
        }
        Ok(())
    }

    fn check_mesh(&self) -> Result<(), CaptureError> {
        let (vertices, triangles) = (self.mesh.positions.len(), self.mesh.triangles.len());
        if triangles == 0 {
            return Err(CaptureError::NoTriangles);
        }
        for (what, found, max) in
            [("vertices", vertices, MAX_VERTICES), ("triangles", triangles, MAX_TRIANGLES)]
        {
            if found > max {
                return Err(CaptureError::MeshTooLarge { what, found, max });
            }
        }
        if self.mesh.is_valid() { Ok(()) } else { Err(CaptureError::Mesh) }
    }
}

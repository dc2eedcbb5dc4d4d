//! What can be encoded of a capture: sizes that the format counts, and numbers that are finite.

use texfold_core::{Capture, Mesh};

use crate::CaptureError;
use crate::layout::{MAX_TRIANGLES, MAX_VERTICES};

/// Most photographs: an index has 16 bits.
const MAX_VIEWS: usize = 1 << 15;

/// Checks sizes and numbers.
///
/// # Errors
/// [`CaptureError`] names the first fault.
pub(crate) fn check(capture: &Capture) -> Result<(), CaptureError> {
    if capture.views.is_empty() {
        return Err(CaptureError::NoViews);
    }
    if capture.views.len() > MAX_VIEWS {
        return Err(CaptureError::TooManyViews { views: capture.views.len(), max: MAX_VIEWS });
    }
    check_mesh(&capture.mesh)?;
    for (index, view) in capture.views.iter().enumerate() {
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

fn check_mesh(mesh: &Mesh) -> Result<(), CaptureError> {
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    if triangles == 0 {
        return Err(CaptureError::NoTriangles);
    }
    for (what, found, max) in [("vertices", vertices, MAX_VERTICES), ("triangles", triangles, MAX_TRIANGLES)]
    {
        if found > max {
            return Err(CaptureError::MeshTooLarge { what, found, max });
        }
    }
    if mesh.is_valid() { Ok(()) } else { Err(CaptureError::Mesh) }
}

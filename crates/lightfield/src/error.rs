//! What is wrong with a capture.

/// Why a capture cannot be encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// No photograph.
    #[error("the capture holds no photograph; give at least one")]
    NoViews,
    /// More photographs than the format counts.
    #[error("the capture holds {views} photographs, more than {max}; leave some out")]
    TooManyViews {
        /// Photographs found.
        views: usize,
        /// Most that can be used.
        max: usize,
    },
    /// No triangle that has an area.
    #[error("the mesh has no triangle with an area; export it again")]
    NoTriangles,
    /// More vertices or triangles than the format counts.
    #[error("the mesh has {found} {what}, more than {max}; simplify it")]
    MeshTooLarge {
        /// "vertices" or "triangles".
        what: &'static str,
        /// How many there are.
        found: usize,
        /// Most that can be used.
        max: usize,
    },
    /// An index without a vertex, or a number that is not finite.
    #[error("the mesh has an index without a vertex or a number that is not finite; export it again")]
    Mesh,
    /// A photograph without pixels or of another length than its size.
    #[error(
        "photograph {index} has {found} pixels where its camera has {needed}; give photographs of the camera's size"
    )]
    ViewSize {
        /// Which photograph.
        index: usize,
        /// Pixels found.
        found: usize,
        /// Pixels of the camera.
        needed: u64,
    },
    /// A camera whose matrix has no inverse or whose focal length is not above 0.
    #[error("camera {index} has a singular matrix or no focal length; calibrate it again")]
    Camera {
        /// Which camera.
        index: usize,
    },
    /// No camera sees the mesh.
    #[error(
        "no photograph shows the mesh; check that mesh and cameras are in one space and that masks are not empty"
    )]
    NoOverlap,
    /// Maps that do not fit a texture.
    #[error(
        "the maps need textures longer than 8192 texels; simplify the mesh or take fewer terms, smaller view maps or less sampling"
    )]
    Atlas,
}

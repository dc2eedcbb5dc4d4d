//! Causes for which a capture cannot be read. Each message names the file and says what to do.

use std::error::Error;
use std::io;
use std::path::PathBuf;

/// Causes for which a capture, or a mesh, cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// A file cannot be read.
    #[error("{}: cannot be read; check the path and its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file that is no mesh of its format.
    #[error("{}: the mesh cannot be read; export it as OBJ, glTF or GLB again", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The fault.
        source: Box<dyn Error + Send + Sync>,
    },
    /// A mesh without what textures on it take.
    #[error("{}: the mesh {what}; export it as triangles with texture coordinates", path.display())]
    UvMeshContent {
        /// The file.
        path: PathBuf,
        /// The fault.
        what: &'static str,
    },
    /// A mesh without what a light field takes.
    #[error("{}: the mesh {what}; export it as triangles in OBJ or PLY", path.display())]
    MeshContent {
        /// The file.
        path: PathBuf,
        /// The fault.
        what: &'static str,
    },
    /// A file that is no list of cameras of its format.
    #[error("{}: the cameras cannot be read; write them as the cause says", path.display())]
    Cameras {
        /// The file.
        path: PathBuf,
        /// The fault.
        source: Box<dyn Error + Send + Sync>,
    },
    /// Cameras that cannot be.
    #[error("{}: the file of cameras {what}", path.display())]
    CameraContent {
        /// The file.
        path: PathBuf,
        /// The fault.
        what: &'static str,
    },
    /// A camera without a view.
    #[error("{}: the camera of frame {frame} has a singular matrix or no focal length; calibrate it again", path.display())]
    SingularCamera {
        /// The file of cameras.
        path: PathBuf,
        /// Number of the camera in the file.
        frame: usize,
    },
    /// A folder without a mesh.
    #[error("{}: there is no {name}; put the mesh there or name one (--mesh): one in the cameras' space, such as COLMAP's poisson_mesher, OpenMVS or Metashape make", path.display())]
    NoMesh {
        /// The folder.
        path: PathBuf,
        /// Names of meshes.
        name: String,
    },
    /// An image that the caller cannot read.
    #[error("{}: the image cannot be read; save it again as PNG or JPEG", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// The fault.
        source: Box<dyn Error + Send + Sync>,
    },
    /// An image of another size than its camera.
    #[error("{}: {width}x{height} pixels where its camera has {}x{}; scale the image or correct the cameras", path.display(), wanted.0, wanted.1)]
    ImageSize {
        /// The image.
        path: PathBuf,
        /// Its columns.
        width: u32,
        /// Its rows.
        height: u32,
        /// Columns and rows of the camera.
        wanted: (u32, u32),
    },
}

impl CaptureError {
    /// True for a mesh without texture coordinates, or of a format that has none: [`crate::read_mesh`] may read it.
    #[must_use]
    pub fn lacks_coordinates(&self) -> bool {
        use crate::uv_mesh::{NO_COORDINATES, OTHER_FORMAT};
        matches!(self, CaptureError::UvMeshContent { what: NO_COORDINATES | OTHER_FORMAT, .. })
    }
}

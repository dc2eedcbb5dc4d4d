//! A mesh and photographs of it: what light fields are encoded from and drawn on.

mod camera;
mod mesh;

pub use camera::Camera;
pub use mesh::Mesh;

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

//! stub
use texfold_core::image::Raster;
/// Saliency of each texel, 0 to 1 (one channel).
pub fn saliency_map(_image:&Raster)->Option<Raster>{None}
/// Distortion
pub fn distortion_map(_mesh:&texfold_core::mesh::UvMesh,_w:u32,_h:u32)->Option<Raster>{None}

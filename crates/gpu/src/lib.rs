//! Upload, draw and read back Texfold textures on any wgpu adapter

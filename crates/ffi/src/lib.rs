//! Texfold for C: what `include/texfold.h` declares.
//!
//! Safety, for all functions: a pointer is null, or points to as many values as the function's description says, which nobody writes to
//! meanwhile; an object comes from the function that makes its kind and was not freed. Null pointers, wrong lengths, names and numbers are
//! refused. No panic reaches the caller.

mod encode;
mod gpu;
mod status;
mod texture;

pub use encode::{
    Bytes, Cancelling, EncodeOptions, Progress, Source, texfold_bytes_free, texfold_cancel,
    texfold_cancel_free, texfold_cancel_new, texfold_encode, texfold_encode_options,
};
pub use gpu::{
    BindingInfo, BlocksInfo, DecodedInfo, Dispatch, Gpu, GpuInfo, PlaneInfo, Program, ProgramInfo,
    texfold_gpu_binding, texfold_gpu_blocks, texfold_gpu_decoded, texfold_gpu_free, texfold_gpu_info,
    texfold_gpu_new, texfold_gpu_plane, texfold_program_free, texfold_program_info, texfold_program_new,
};
pub use status::{Status, texfold_error};
pub use texture::{
    ImageInfo, Info, Limits, Region, Texture, texfold_close, texfold_decode_rgba8, texfold_decode_rgba16,
    texfold_image_info, texfold_info, texfold_open,
};

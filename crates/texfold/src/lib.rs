//! Texture codecs whose memory grows with what is unique in a scene.
//!
//! The facade for embedding: [`open`] a `.txf` file, [`encode_images`] with a codec by name or the one that
//! suits, and everything of the shared vocabulary.

mod auto;
mod open;

pub use auto::{CodecChoice, EncodeSettings, Guidance, encode_images};
pub use open::{AnyImage, add_image, open, open_image, open_light};
pub use texfold_bc::{Bc, Bc1Blocks, BcParams, Content, Family};
pub use texfold_core::*;
pub use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture, MAX_LAYERS, Transforms};
pub use texfold_lightfield::{
    Camera, Capture, CaptureError, Directions, Factors, FitMethod, FittedMaps, LightModel, LightParams,
    LightQuality, LightTexture, Lightfield, MAX_TERMS, MapSizes, MapStorage, Mesh, Photograph, Renderer,
    Updates,
};
pub use texfold_progressive::{Progressive, ProgressiveParams, ProgressiveTexture, Shared};
pub use texfold_vq::{GuidanceWeights, Vq, VqParams, VqSource};
pub use texfold_zipmap::{
    Fidelity, LeftOut, PatchSource, PatchStack, Registration, ZipError, ZipParams, ZipTexture, Zipmap,
    fidelity, masks as zip_masks, register,
};

//! Encoding images: with a codec by name, or the one that answers the goal best.

mod adapters;
mod add;
mod auto;
mod judge;
mod plain;
mod search;
mod settings;
mod table;

pub use adapters::{ImageEncoder, PartImages, PlainOrder};
pub use add::add_images;
pub use auto::{Attempt, Chosen, choose_images, encode_images};
pub use search::{ImageSearch, search_images};
pub use settings::{Choice, EncodeSettings, Guidance, OwnParams};
pub use table::{ENCODINGS, Encoding, parts_of};
pub use texfold_bc::{Bc1Blocks, BcParams};
pub use texfold_dct::DctParams;
pub use texfold_epitome::{EpitomeParams, EpitomeSource, Transforms};
pub use texfold_lightfield::{
    Capture, CaptureError, FitMethod, FittedMaps, LightModel, LightParams, LightQuality, MapSizes,
    MapStorage, Photograph, Updates, simplify_mesh,
};
pub use texfold_progressive::{ProgressiveParams, Shared};
pub use texfold_vq::{GuidanceWeights, VqParams, VqSource};
pub use texfold_zipmap::{
    Fault, Fidelity, LeftOut, PatchSource, PatchStack, Registration as StackRegistration, ZipError,
    ZipParams, fidelity, masks as zip_masks, register,
};

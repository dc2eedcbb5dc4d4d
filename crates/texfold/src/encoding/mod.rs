//! The codecs of images as a table, and the choice among them: for command lines, benches and generic tools.

mod adapters;
mod add;
mod auto;
mod builder;
mod plain;
mod search;
mod settings;
mod table;

pub use adapters::{ImageEncoder, PlainOrder};
pub use add::add_images;
pub use auto::{Attempt, Chosen, choose_images, encode_images};
pub use builder::Encode;
pub use search::{ImageSearch, search_images};
pub use settings::{Choice, EncodeSettings, Guidance, OwnParams};
pub use table::{ENCODINGS, Encoding, parts_of};

//! Texfold's command line as a library: files, batches, reports.
//!
//! The binary `texfold` and `cargo xtask` run the same commands: compress, decompress, info, view, render, compare and bank.
//! Each has a folder of its own; what they share lies beside: finding and reading inputs, writing files whole or not
//! at all, reports, and exit codes.
//!
//! Exit codes: 0 all done, 1 some inputs failed and the others are written, 2 usage.

mod bank;
mod bank_command;
mod compare;
mod compress;
mod config;
mod console;
mod decompress;
mod error;
mod files;
mod info;
mod input;
mod material_figures;
mod memory;
mod normals;
mod output;
mod pack;
mod perceptual;
mod png;
mod progress;
mod render;
mod report;
mod run;
mod settings;
mod shaders;
mod thumbnail;
mod view;

pub use bank_command::{BankCommand, ExtractArgs, ListArgs};
pub use compare::{CompareArgs, cpu_seconds, draw_photographs};
pub use compress::CompressArgs;
pub use config::{
    AlphaChoice, CodecName, ColorName, ContentName, EffortName, Options, RunOptions, Samples, Sides,
};
pub use decompress::DecompressArgs;
pub use info::InfoArgs;
#[doc(hidden)]
pub use input::foreign::{FOREIGN, read_foreign};
pub use pack::{PackArgs, UnpackArgs};
pub use perceptual::{butteraugli, ssimulacra2};
pub use render::RenderArgs;
pub use run::{Command, main, run};
pub use settings::Kind;
pub use shaders::{Lang, ShadersArgs};
pub use view::ViewArgs;

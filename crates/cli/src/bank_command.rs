//! `bank`: folders of large images in tiles, which grow by further images.

use std::path::PathBuf;

use crate::bank::{self, Choice, is_bank};
use crate::compress::{self, CompressArgs};
use crate::decompress::{Device, decode, tile};
use crate::error::CliError;
use crate::output::{make_folder, remove_stale};

/// Commands of `texfold bank`.
#[derive(Debug, clap::Subcommand)]
pub enum BankCommand {
    /// Add images to the bank in the folder --out, which is made where there is none: those that are there stay as they are.
    Add(Box<CompressArgs>),
    /// Show what a bank holds.
    List(ListArgs),
    /// Decode images of a bank into PNG files.
    Extract(ExtractArgs),
}

/// Arguments of `bank list`.
#[derive(Debug, clap::Args)]
pub struct ListArgs {
    /// The folder of a bank.
    #[arg(value_name = "DIR")]
    bank: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of `bank extract`.
#[derive(Debug, clap::Args)]
pub struct ExtractArgs {
    /// The folder of a bank.
    #[arg(value_name = "DIR")]
    bank: PathBuf,
    /// Folder that the PNG files are written to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only the image of that name.
    #[arg(long, value_name = "NAME")]
    image: Option<String>,
    /// Only the tile of 1024x1024 texels in that column and row.
    #[arg(long, value_name = "X,Y", value_parser = tile)]
    tile: Option<(u32, u32)>,
    /// Mip level: 0 is the full size.
    #[arg(long, value_name = "N", default_value_t = 0)]
    lod: u32,
    /// Load only this many layers of each tile.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    layers: Option<u32>,
    /// Decode on the GPU, as a shader does.
    #[arg(long)]
    gpu: bool,
}

/// Runs the command; gives the number of images that failed.
pub(crate) fn run(command: BankCommand) -> Result<usize, CliError> {
    match command {
        BankCommand::Add(args) => compress::add(*args),
        BankCommand::List(ListArgs { bank, json }) => bank::describe(&bank, json).map(|()| 0),
        BankCommand::Extract(args) => extract(&args),
    }
}

fn extract(args: &ExtractArgs) -> Result<usize, CliError> {
    if !is_bank(&args.bank) {
        return Err(CliError::NoBank { path: args.bank.clone() });
    }
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let device = match args.gpu.then(Device::open).transpose() {
        Ok(device) => device,
        Err(source) => return Err(CliError::NoGpu { source: Box::new(source) }),
    };
    let choice = Choice { image: args.image.clone(), tile: args.tile, level: args.lod, layers: args.layers };
    bank::decompress(&args.bank, &args.out, &choice, &|path, texture, level| {
        let texture = texture.as_encoded();
        match &device {
            Some(device) => device.upload(path, texture)?.decode(path, texture, 0, level, false),
            None => decode(path, texture, 0, level),
        }
    })
}

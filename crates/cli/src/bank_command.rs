//! `bank`: folders of large images in tiles, which grow by further images.

use std::path::PathBuf;

use crate::bank::{self, Choice, is_bank};
use crate::compress::{self, CompressArgs};
use crate::decompress::{Device, Writing, decode_part, tile};
use crate::error::{CliError, UsageError};
use crate::output::{make_folder, remove_stale};

/// Commands of `texfold bank`.
#[derive(Debug, clap::Subcommand)]
pub enum BankCommand {
    /// Add images to the bank in the folder --out, which is made where there is none: those that are there stay as they are.
    Add(Box<CompressArgs>),
    /// Show what a bank holds.
    List(ListArgs),
    /// Decode images of a bank.
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
    #[command(flatten)]
    writing: Writing,
    /// Only the image of that name.
    #[arg(long, value_name = "NAME")]
    image: Option<String>,
    /// Only the tile in that column and row. Tiles have 1024x1024 texels; the last of a row or column has up to 1280 a side.
    #[arg(long, value_name = "X,Y", value_parser = tile, conflicts_with = "region")]
    tile: Option<(u32, u32)>,
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
    let writing = &args.writing;
    writing.check_options()?;
    if writing.texture().is_some() {
        return Err(UsageError::BankTexture.into());
    }
    make_folder(&writing.out)?;
    remove_stale(&writing.out);
    let device = Device::where_wanted(writing.gpu)?;
    let choice = Choice { image: args.image.as_deref(), tile: args.tile, writing };
    bank::decompress(&args.bank, choice, &|path, texture, rect| {
        let texture = texture.as_encoded();
        match &device {
            Some(device) => device.upload(path, texture)?.decode(path, texture, rect, false),
            None => decode_part(path, texture, rect),
        }
    })
}

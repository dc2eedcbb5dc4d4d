//! The commands by name, and what the process says when it ends.

use std::process::ExitCode;

use clap::Parser;

use crate::console::{be_quiet, complain, is_cut, note_cut};
use crate::error::{CliError, explain};
use crate::{
    BankCommand, CompareArgs, CompressArgs, DecompressArgs, InfoArgs, PackArgs, RenderArgs, ShadersArgs,
    UnpackArgs, ViewArgs, bank_command, compare, compress, decompress, info, pack, render, shaders, view,
};

/// Exit code: some inputs failed, the others are written.
const SOME_FAILED: u8 = 1;
/// Exit code: the command line or the configuration is wrong; nothing was done.
const USAGE: u8 = 2;
/// Commands of `cargo xtask` alone, as they work on the source tree.
const OF_THE_SOURCE_TREE: [&str; 3] = ["fixtures", "reference", "stability"];

/// What can be done.
#[derive(Debug, clap::Subcommand)]
#[command(rename_all = "kebab-case")]
pub enum Command {
    /// Encode images into .txf files.
    Compress(Box<CompressArgs>),
    /// Decode .txf files into images.
    Decompress(DecompressArgs),
    /// Show what a .txf file holds.
    Info(InfoArgs),
    /// Write a page that shows .txf files in a browser.
    View(ViewArgs),
    /// Draw a light field as cameras see it, or a zoom into an image.
    Render(RenderArgs),
    /// Keep large images in tiles that share codebooks, and add to them over time.
    #[command(subcommand)]
    Bank(BankCommand),
    /// Put the images of a glTF scene into textures beside it.
    Pack(PackArgs),
    /// Put the images of a packed scene back into it.
    Unpack(UnpackArgs),
    /// Write the decode shaders in the language of another engine.
    Shaders(ShadersArgs),
    /// Compare codecs with one another and with peers: images, materials, captures, zoom stacks.
    Compare(CompareArgs),
}

/// Texture codecs whose memory grows with what is unique in a scene.
#[derive(Debug, Parser)]
#[command(name = "texfold", version)]
struct Program {
    /// Print errors alone, and what `info` and `bank list` are asked for.
    #[arg(long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

/// The whole program: reads the command line, runs it, gives the exit code.
#[must_use]
pub fn main() -> ExitCode {
    match Program::try_parse() {
        Ok(Program { quiet, command }) => run(command, quiet),
        Err(answer) => {
            let first = std::env::args().nth(1);
            if let Some(name) = first.filter(|name| OF_THE_SOURCE_TREE.contains(&name.as_str())) {
                complain(&format!("{name} needs Texfold's source tree; run `cargo xtask {name}` there"));
                return ended(USAGE);
            }
            // Help and the version are answers, all else is a usage error.
            let printed = answer.print();
            if !answer.use_stderr() {
                note_cut(printed);
            }
            ended(u8::try_from(answer.exit_code()).unwrap_or(USAGE))
        }
    }
}

/// Runs one command and gives the exit code; `quiet` prints errors alone, and what `info` and `bank list` are asked for.
#[must_use]
pub fn run(command: Command, quiet: bool) -> ExitCode {
    if quiet {
        be_quiet();
    }
    let outcome = match command {
        Command::Compress(args) => compress::run(*args),
        Command::Decompress(args) => decompress::run(&args),
        Command::Info(args) => info::run(&args),
        Command::View(args) => view::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Bank(command) => bank_command::run(command),
        Command::Pack(args) => pack::pack(&args),
        Command::Unpack(args) => pack::unpack(&args),
        Command::Shaders(args) => shaders::run(&args),
        Command::Compare(args) => compare::run(&args),
    };
    ended(match outcome {
        Ok(0) => 0,
        Ok(_) => SOME_FAILED,
        Err(error) => {
            complain(&explain(&error));
            if matches!(error, CliError::Usage(_)) { USAGE } else { SOME_FAILED }
        }
    })
}

/// The exit code; a run whose stdout is incomplete has failed.
fn ended(code: u8) -> ExitCode {
    if is_cut() {
        complain("stdout cannot be written; is its device full?");
        return ExitCode::from(code.max(SOME_FAILED));
    }
    ExitCode::from(code)
}

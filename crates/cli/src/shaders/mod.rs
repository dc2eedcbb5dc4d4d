//! `shaders`: the decode shaders in the languages of other engines, with their bindings.

mod layout;
mod translate;

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use texfold_shaders::{
    DctTarget, Entry, MODULES, ModuleInfo, Offsets, block, entry, light, tile_passes, tile_plan, tiles,
};

use crate::console::{complain, say};
use crate::error::{CliError, explain};
use crate::output::{make_folder, remove_stale, write_whole};
use translate::{Program, Text};

/// Shaders of the decoder of superblocks, and of the cache of tiles.
const OTHERS: [&str; 2] = ["dct", "tiles"];
/// The fragment shader of the cache of tiles: its functions are `texfold_tile_sample` and two more.
const TILE_ENTRY: &str = "
@fragment
fn fragment_main(@location(0) uv: vec2<f32>, @location(1) @interpolate(flat) texture: u32) -> @location(0) vec4<f32> {
    return texfold_tile_sample(texture, uv);
}
";
/// Anisotropy of the cache of tiles, and pixels between two that mark tiles.
const TILE_OPTIONS: (u16, u32) = (4, 4);

/// A language of shaders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Lang {
    /// As it is written.
    Wgsl,
    /// GLSL 4.50: a file a stage, bindings of each kind from 0 on.
    Glsl,
    /// GLSL ES: a file a stage; 3.00 with bindings by name for drawing by texel, as WebGL 2 takes it, 3.10 for the others.
    Essl,
    /// HLSL for shader model 6.0: registers are bindings, spaces are groups.
    Hlsl,
    /// Metal 2.1: indices of each kind from 0 on.
    Msl,
    /// SPIR-V 1.3 for Vulkan 1.1: descriptor sets are groups.
    Spirv,
}

/// Arguments of `shaders`.
#[derive(Debug, clap::Args)]
pub struct ShadersArgs {
    /// Shaders to write; all by default. dct: compute shaders that decode superblocks into a plain texture; tiles: the cache of decoded tiles;
    /// others: drawing by texel from the compressed form.
    #[arg(value_name = "CODEC", value_parser = PossibleValuesParser::new(names()))]
    codecs: Vec<String>,
    /// Language.
    #[arg(long, value_enum)]
    lang: Lang,
    /// Folder to write to; it is made where there is none.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

fn names() -> Vec<&'static str> {
    OTHERS.into_iter().chain(MODULES.iter().map(|module| module.name)).collect()
}

/// Names and sources of the shaders of a codec.
fn sources(name: &str) -> Vec<(String, String)> {
    let module = |module: &'static ModuleInfo| match module.offsets {
        Offsets::Image(_) => (module.name.to_owned(), entry(module, Entry::Draw)),
        Offsets::Light(_) => (module.name.to_owned(), light(module)),
    };
    match name {
        "dct" => {
            let targets = [DctTarget::Unorm8, DctTarget::Uint16, DctTarget::Float32];
            let names = ["dct-unorm8", "dct-uint16", "dct-float32"];
            names.into_iter().zip(targets).map(|(name, target)| (name.to_owned(), block(target))).collect()
        }
        "tiles" => {
            let (anisotropy, stride) = TILE_OPTIONS;
            let draw = [&tiles(0, anisotropy, stride), TILE_ENTRY].concat();
            [("tiles-plan", tile_plan()), ("tiles-decode", tile_passes()), ("tiles-draw", draw)]
                .map(|(name, source)| (name.to_owned(), source))
                .into()
        }
        _ => MODULES.iter().filter(|row| row.name == name).map(module).collect(),
    }
}

/// Numbers of mip levels, which GLSL ES cannot ask of a texture, and what they are of planes that [`texfold_core::Encoded::gpu`]
/// lists: an image of a set has fewer levels than others where it ends sooner.
const NUMBERS_OF_LEVELS: [(&str, &str); 2] = [
    (
        "textureNumLevels(texfold_bc_plane_a)",
        "min(texfold_bc_params.levels, firstLeadingBit(max(texfold_bc_params.plane_size.x, texfold_bc_params.plane_size.y)) + 1u)",
    ),
    (
        "textureNumLevels(texfold_epitome_coarse_plane)",
        "(min(texfold_epitome_params.levels, firstLeadingBit(max(texfold_epitome_params.size.x, texfold_epitome_params.size.y)) + 1u) \
         - TEXFOLD_EPITOME_FINE_LEVELS)",
    ),
];

/// The same shader without what a language lacks.
fn adapted(source: String, lang: Lang) -> String {
    if lang != Lang::Essl {
        return source;
    }
    NUMBERS_OF_LEVELS.iter().fold(source, |source, (asked, known)| source.replace(asked, known))
}

/// Runs the command; gives the number of shaders that cannot be written in the language.
pub(crate) fn run(args: &ShadersArgs) -> Result<usize, CliError> {
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let all = names().into_iter().map(str::to_owned).collect();
    let chosen = if args.codecs.is_empty() { &all } else { &args.codecs };
    let mut failed = 0;
    for (name, source) in chosen.iter().flat_map(|codec| sources(codec)) {
        let program = Program::new(&name, &adapted(source, args.lang))?;
        let written = match program.in_language(args.lang) {
            Ok(written) => written,
            Err(error) => {
                failed += 1;
                complain(&explain(&error));
                continue;
            }
        };
        for (file, text) in written {
            let bytes = match text {
                Text::Lines(text) => text.into_bytes(),
                Text::Words(words) => words.iter().flat_map(|word| word.to_le_bytes()).collect(),
            };
            write_whole(&args.out.join(&file), &bytes)?;
            say(&format!("{}", args.out.join(file).display()));
        }
        let path = args.out.join(format!("{name}.json"));
        write_whole(&path, layout::json(&program, args.lang).as_bytes())?;
    }
    Ok(failed)
}

//! `web`: what the browser package takes from Rust. WGSL without comments, bindings of its modules, numbers that the format fixes,
//! and for the package's tests what files under fixtures/golden load to.

mod golden;
mod wgsl;

use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use texfold_gpu::ModuleInfo;
use texfold_shaders::{Binding, LightOffsets, MODULES, Offsets, PARTS};

use crate::root;

/// Arguments of `web`.
#[derive(Debug, clap::Args)]
pub(crate) struct WebArgs {
    /// Change nothing; fail where a file differs from what the code gives.
    #[arg(long)]
    check: bool,
}

/// Runs the command.
pub(crate) fn run(args: &WebArgs) -> ExitCode {
    match write(&root(), args.check) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: web/ cannot be read or written; check its permissions: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Writes all files, or compares them; whether they are as the code gives them.
fn write(root: &Path, check: bool) -> io::Result<bool> {
    let mut is_current = true;
    for (name, text) in files(root)? {
        let path = root.join("web").join(&name);
        if !check {
            fs::write(path, text)?;
            continue;
        }
        if fs::read_to_string(path).ok().as_ref() != Some(&text) {
            eprintln!("error: web/{} is not what the code gives; run cargo xtask web", name.display());
            is_current = false;
        }
    }
    Ok(is_current)
}

/// All files, by their names under web/.
fn files(root: &Path) -> io::Result<Vec<(PathBuf, String)>> {
    let mut files = shaders();
    files.push(("src/generated/dct.ts".into(), dct()));
    files.push(("test/golden.json".into(), golden::golden(&root.join("fixtures/golden"))?));
    Ok(files)
}

const HEAD: &str = "// Written by `cargo xtask web`; changes are lost.\n\n";

/// What a row of the table of modules has.
const MODULE: &str = "\
/** A file of WGSL, and of the first one of a module the functions that entry points call. */
interface File {
  text: string;
  entry?: string;
}

/** What to bind for a codec, and its WGSL. */
export interface Module {
  /** Bytes of a uniform buffer, or the samples of a texture. */
  bindings: readonly (number | \"uint\" | \"float\")[];
  /** Bytes of the parameters at which mip levels and address mode lie; none of light fields. */
  levels?: number;
  addressMode?: number;
  /** Bytes of the parameters of a light field. */
  light?: { triangles: number; terms: number; storedTerms: number };
  /** Constants that a pipeline may set to 0: name, byte of a member, the value of it that needs the constant (else any but 0). */
  switches: readonly (readonly [string, number, number?])[];
  /** Files, with the first binding of each. */
  files: readonly (readonly [() => Promise<File>, number])[];
}
";

/// Parts of shaders, files of modules, bindings.
fn shaders() -> Vec<(PathBuf, String)> {
    let mut sources: Vec<(&'static str, &'static str)> = Vec::new();
    for module in &MODULES {
        for (number, (text, _)) in module.sources().enumerate() {
            if !sources.iter().any(|(other, _)| *other == text) {
                let entry = if number == 0 { drawing_entry(module.entry_source()) } else { "" };
                sources.push((text, entry));
            }
        }
    }
    let of_sources = sources.iter().flat_map(|&(text, entry)| [text, entry]);
    let names = wgsl::short_names(PARTS.iter().map(|(_, text)| *text).chain(of_sources));
    let text = |text: &str| format!("{:?}", wgsl::short(text, &names));
    let [mut parts, mut tiles] = [HEAD.to_owned(), HEAD.to_owned() + &tile_numbers()];
    for (name, part) in PARTS {
        // Who does not use a cache of tiles does not load its shaders.
        let file = if name.starts_with("tile") { &mut tiles } else { &mut parts };
        let _ = writeln!(file, "export const {name} = {};", text(part));
    }
    let file = |number: usize| PathBuf::from(format!("src/generated/source{number}.ts"));
    let mut files = vec![("src/generated/parts.ts".into(), parts), ("src/generated/tiles.ts".into(), tiles)];
    for (number, (source, entry)) in sources.iter().enumerate() {
        let mut out = format!("{HEAD}export const text = {};\n", text(source));
        if !entry.is_empty() {
            let _ = writeln!(out, "export const entry = {};", text(entry));
        }
        files.push((file(number), out));
    }
    let mut table = format!("{HEAD}{MODULE}\nexport const modules: Record<string, Module> = {{\n");
    for module in &MODULES {
        let sources = module.sources().map(|(text, first)| {
            let number = sources.iter().position(|(source, _)| *source == text).unwrap_or_default();
            format!("[() => import(\"./source{number}.js\"), {first}]")
        });
        table += &row(module, sources.collect(), &names);
    }
    files.push(("src/generated/modules.ts".into(), table + "};\n"));
    files
}

/// Sizes and flags of a cache of tiles.
fn tile_numbers() -> String {
    let (numbers, tail_places) = texfold_gpu::tile_numbers();
    let mut out = format!("/** Places of a tail's levels. */\nexport const TAIL_PLACES = {tail_places:?};\n");
    for (name, value) in numbers {
        let _ = writeln!(out, "export const {name} = {value};");
    }
    out
}

/// What drawing and decoding call of the functions that entry points call: those before the ones that times are compared with.
fn drawing_entry(source: &str) -> &str {
    source.split_once("fn entry_size").map_or(source, |(before, _)| before)
}

/// A row of the table of modules.
fn row(module: &ModuleInfo, files: Vec<String>, names: &HashMap<&str, String>) -> String {
    let mut out = format!("  {:?}: {{\n", module.name);
    let bindings: Vec<String> = module.bindings.iter().map(binding).collect();
    let _ = writeln!(out, "    bindings: [{}],", bindings.join(", "));
    let _ = match module.offsets {
        Offsets::Image(offsets) => {
            writeln!(out, "    levels: {}, addressMode: {},", offsets.levels, offsets.address_mode)
        }
        Offsets::Light(LightOffsets { triangles, terms, stored_terms }) => {
            writeln!(
                out,
                "    light: {{ triangles: {triangles}, terms: {terms}, storedTerms: {stored_terms} }},"
            )
        }
    };
    let switches = module.switches.iter().map(|switch| {
        let only = switch.only.map(|only| format!(", {only}")).unwrap_or_default();
        format!("[{:?}, {}{only}]", wgsl::short(switch.constant, names).trim_end(), switch.offset)
    });
    let _ = writeln!(out, "    switches: [{}],", switches.collect::<Vec<_>>().join(", "));
    let _ = writeln!(out, "    files: [{}],\n  }},", files.join(", "));
    out
}

fn binding(binding: &Binding) -> String {
    match binding {
        Binding::Params { bytes } => bytes.to_string(),
        Binding::Uint => "\"uint\"".to_owned(),
        Binding::Float => "\"float\"".to_owned(),
    }
}

/// Numbers that the format of blocks fixes.
fn dct() -> String {
    let constants = texfold::dct::FormatConstants::new();
    let mut out = HEAD.to_owned();
    let _ = writeln!(
        out,
        "/** Stopping probabilities in 1/65536. */\nexport const STOP = {:?};",
        constants.stops
    );
    let _ = writeln!(
        out,
        "/** Stopping probabilities that tables may begin from, a letter each: 0 for 0, then as in ASCII; of dependent quantisers the second ones. */\nexport const PRESETS = {:?};",
        constants.presets
    );
    let _ = writeln!(
        out,
        "/** Stopping probabilities of intra modes other than none. */\nexport const MODE_STOPS = {:?};",
        constants.mode_stops
    );
    let _ = writeln!(
        out,
        "/** Scale of each frequency in 1/4096. */\nexport const SCALES = {:?};",
        constants.scales
    );
    let _ = writeln!(
        out,
        "/** Distance of each coefficient from the mean in 1/64. */\nexport const RADII = {:?};",
        constants.radii
    );
    let _ = writeln!(
        out,
        "/** Scan, classes and symbols: what stands before the tables of a decoder. */\nexport const WORDS = {:?};",
        constants.words
    );
    out
}

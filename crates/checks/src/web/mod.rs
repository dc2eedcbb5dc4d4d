//! `web`: what the browser package takes from Rust. WGSL without comments, bindings of its modules, numbers that the format fixes,
//! and for the package's tests what files under fixtures/golden load to.

mod golden;
mod wgsl;

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
fn files(root: &Path) -> io::Result<[(PathBuf, String); 3]> {
    Ok([
        ("src/generated/wgsl.ts".into(), shaders()),
        ("src/generated/dct.ts".into(), dct()),
        ("test/golden.json".into(), golden::golden(&root.join("fixtures/golden"))?),
    ])
}

const HEAD: &str = "// Written by `cargo xtask web`; changes are lost.\n\n";

/// Parts of shaders, files of modules, bindings.
fn shaders() -> String {
    let mut sources: Vec<&'static str> = Vec::new();
    for (text, _) in MODULES.iter().flat_map(ModuleInfo::sources) {
        if !sources.contains(&text) {
            sources.push(text);
        }
    }
    let entries = MODULES.iter().map(ModuleInfo::entry_source);
    let all = PARTS.iter().map(|(_, text)| *text).chain(sources.iter().copied()).chain(entries);
    let names = wgsl::short_names(all);
    let text = |text: &str| format!("{:?}", wgsl::short(text, &names));
    let mut out = HEAD.to_owned();
    for (name, part) in PARTS {
        let _ = writeln!(out, "export const {name} = {};", text(part));
    }
    for (number, source) in sources.iter().enumerate() {
        let _ = writeln!(out, "const source{number} = {};", text(source));
    }
    out += "\n/** WGSL of a codec: its files with the first binding of each, and what to bind. */\n";
    out += "export interface Module {\n  /** Bytes of a uniform buffer, or the samples of a texture. */\n";
    out += "  bindings: readonly (number | \"uint\" | \"float\")[];\n";
    out +=
        "  /** Bytes of the parameters at which mip levels and address mode lie; none of light fields. */\n";
    out += "  levels?: number;\n  addressMode?: number;\n";
    out += "  /** Bytes of the parameters of a light field. */\n";
    out += "  light?: { triangles: number; terms: number; storedTerms: number };\n";
    out += "  /** Constants that a pipeline may set to 0: name, byte of a member, the value of it that needs the constant (else any but 0). */\n";
    out += "  switches: readonly (readonly [string, number, number?])[];\n";
    out += "  sources: readonly (readonly [string, number])[];\n";
    out += "  /** The functions that entry points call. */\n  entry: string;\n}\n\n";
    out += "export const modules: Record<string, Module> = {\n";
    for module in &MODULES {
        let _ = writeln!(out, "  {:?}: {{", module.name);
        let bindings: Vec<String> = module.bindings.iter().map(binding).collect();
        let _ = writeln!(out, "    bindings: [{}],", bindings.join(", "));
        let _ = match module.offsets {
            Offsets::Image(offsets) => {
                writeln!(out, "    levels: {}, addressMode: {},", offsets.levels, offsets.address_mode)
            }
            Offsets::Light(offsets) => {
                let LightOffsets { triangles, terms, stored_terms } = offsets;
                writeln!(
                    out,
                    "    light: {{ triangles: {triangles}, terms: {terms}, storedTerms: {stored_terms} }},"
                )
            }
        };
        let switches = module.switches.iter().map(|switch| {
            let only = switch.only.map(|only| format!(", {only}")).unwrap_or_default();
            format!("[{:?}, {}{only}]", wgsl::short(switch.constant, &names).trim_end(), switch.offset)
        });
        let _ = writeln!(out, "    switches: [{}],", switches.collect::<Vec<_>>().join(", "));
        let sources = module.sources().map(|(text, first)| {
            let number = sources.iter().position(|source| *source == text).unwrap_or_default();
            format!("[source{number}, {first}]")
        });
        let _ = writeln!(out, "    sources: [{}],", sources.collect::<Vec<_>>().join(", "));
        let _ = writeln!(out, "    entry: {},\n  }},", text(module.entry_source()));
    }
    out + "};\n"
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

//! Formats for storage, by external programs where they are installed: files of few bits, of which no part can be read alone.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use texfold_core::image::Raster;

use super::measure::Cost;
use super::rival::{Coded, on_path, read_back};
use crate::error::CliError;
use crate::png;

/// Goals in bits a texel: those of ASTC in blocks of 12x12, 10x10, 8x8 and 6x6, and half a bit.
pub(super) const GOALS: [f64; 5] = [0.5, 0.89, 1.28, 2.0, 3.56];

/// Settings of an encoder from the fewest bits to the most.
const SETTINGS: u32 = 100;

/// A format for storage and its programs.
struct Format {
    name: &'static str,
    extension: &'static str,
    encoder: &'static str,
    decoder: &'static str,
    /// Speed of the encoder where the comparison has none of its own; none where it has no choice.
    speed: Option<u8>,
    /// Options of the encoder for a setting of 0 to [`SETTINGS`] and a speed.
    options: fn(u32, u8) -> Vec<String>,
    /// What stands before the input and the output of both programs.
    flags: [&'static str; 2],
}

/// Its name alone: rows are kept by what is written here, and places of functions change from run to run.
impl std::fmt::Debug for Format {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(self.name)
    }
}

/// All of them, at full resolution of colours and an effort between speed and quality.
static FORMATS: [Format; 4] = [
    Format {
        name: "avif",
        extension: "avif",
        encoder: "avifenc",
        decoder: "avifdec",
        speed: Some(6),
        options: |setting, speed| {
            let level = 63 - setting * 63 / SETTINGS;
            words(&format!("-s {speed} -y 444 --min 0 --max 63 -a end-usage=q -a cq-level={level}"))
        },
        flags: ["", ""],
    },
    Format {
        name: "jpeg xl",
        extension: "jxl",
        encoder: "cjxl",
        decoder: "djxl",
        // Below 7 is beyond its largest distance, 100 is lossless.
        speed: None,
        options: |setting, _| words(&format!("-e 7 -q {}", setting.clamp(7, 99))),
        flags: ["", ""],
    },
    Format {
        name: "jpeg 2000",
        extension: "jp2",
        encoder: "opj_compress",
        decoder: "opj_decompress",
        speed: None,
        options: |setting, _| {
            // From 0.05 to 12.8 bits of 24.
            let ratio = 480.0 / (f64::from(setting) * 8.0 / f64::from(SETTINGS)).exp2();
            words(&format!("-I -r {ratio:.3}"))
        },
        flags: ["-i", "-o"],
    },
    Format {
        name: "webp",
        extension: "webp",
        encoder: "cwebp",
        decoder: "dwebp",
        speed: None,
        options: |setting, _| words(&format!("-q {setting} -m 6 -sharp_yuv")),
        flags: ["", "-o"],
    },
];

/// Names of the formats.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().map(|format| format.name)
}

fn words(words: &str) -> Vec<String> {
    words.split_whitespace().map(str::to_owned).collect()
}

/// A format whose programs are installed.
#[derive(Debug, Clone)]
pub(crate) struct Storage {
    format: &'static Format,
    encoder: PathBuf,
    decoder: PathBuf,
    speed: Option<u8>,
}

impl Storage {
    /// Those that are on PATH.
    pub(crate) fn find() -> Vec<Storage> {
        let found = |format: &'static Format| {
            let (encoder, decoder) = (on_path(&[format.encoder])?, on_path(&[format.decoder])?);
            Some(Storage { format, encoder, decoder, speed: format.speed })
        };
        FORMATS.iter().filter_map(found).collect()
    }

    pub(crate) fn name(&self) -> &'static str {
        self.format.name
    }

    /// The format at each of these speeds, where its encoder has a choice.
    pub(super) fn speeds(&self, all: &[u8]) -> Vec<Storage> {
        match self.speed {
            Some(_) => all.iter().map(|&speed| Storage { speed: Some(speed), ..self.clone() }).collect(),
            None => vec![self.clone()],
        }
    }

    /// The speed in words; empty where the encoder has no choice.
    pub(super) fn effort(&self) -> String {
        self.speed.map_or(String::new(), |speed| format!("speed {speed}"))
    }

    /// Encodes an image of the file at `path` at the best setting within `goal` bits a texel, and decodes it; `None` where none is. `known`
    /// holds the files of settings that were tried before.
    pub(super) fn within(
        &self,
        image: &Raster,
        goal: f64,
        known: &mut BTreeMap<u32, File>,
        path: &Path,
    ) -> Result<Option<Coded>, CliError> {
        let most = goal * image.size().texels() as f64;
        // Settings below `fits` are within the goal.
        let (mut fits, mut beyond) = (0, SETTINGS + 1);
        while fits < beyond {
            let setting = u32::midpoint(fits, beyond).min(SETTINGS);
            let file = match known.entry(setting) {
                Entry::Occupied(file) => file.into_mut(),
                Entry::Vacant(place) => place.insert(self.encode(image, setting, path)?),
            };
            if (8 * file.bytes.len()) as f64 <= most {
                fits = setting + 1;
            } else {
                beyond = setting;
            }
        }
        let best = fits.checked_sub(1).and_then(|setting| known.get(&setting));
        best.map(|file| self.decode(image, file, path)).transpose()
    }

    fn encode(&self, image: &Raster, setting: u32, path: &Path) -> Result<File, CliError> {
        let failed =
            |source| CliError::Rival { path: path.to_owned(), program: self.encoder.clone(), source };
        let dir = tempfile::tempdir().map_err(failed)?;
        let (input, output) =
            (dir.path().join("in.png"), dir.path().join("out").with_extension(self.format.extension));
        png::write(&input, image)?;
        let clock = Cost::clock();
        self.run(&self.encoder, &(self.format.options)(setting, self.speed.unwrap_or(0)), [&input, &output])
            .map_err(failed)?;
        let cost = clock();
        let bytes = std::fs::read(&output).map_err(failed)?;
        Ok(File { bytes, cost })
    }

    fn decode(&self, image: &Raster, file: &File, path: &Path) -> Result<Coded, CliError> {
        let failed =
            |source| CliError::Rival { path: path.to_owned(), program: self.decoder.clone(), source };
        let dir = tempfile::tempdir().map_err(failed)?;
        let (input, output) =
            (dir.path().join("in").with_extension(self.format.extension), dir.path().join("out.png"));
        std::fs::write(&input, &file.bytes).map_err(failed)?;
        self.run(&self.decoder, &[], [&input, &output]).map_err(failed)?;
        let decoded = read_back(&output, image.info())?;
        Ok(Coded { decoded, cost: file.cost, bits: 8 * file.bytes.len() as u64 })
    }

    /// Runs a program from one file to the other.
    fn run(&self, program: &Path, options: &[String], files: [&Path; 2]) -> std::io::Result<()> {
        let mut command = Command::new(program);
        command.args(options).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        for (flag, file) in self.format.flags.into_iter().zip(files) {
            command.args((!flag.is_empty()).then_some(flag)).arg(file);
        }
        let status = command.status()?;
        if status.success() { Ok(()) } else { Err(std::io::Error::other(status.to_string())) }
    }
}

/// A file of an encoder, and the time that it took.
#[derive(Debug)]
pub(super) struct File {
    bytes: Vec<u8>,
    cost: Cost,
}

#[cfg(all(test, unix))]
mod tests {
    use texfold_core::image::ColorSpace;

    use super::*;

    /// A format whose files are PNG with ten bytes more for each setting.
    static PADDED: Format = Format {
        name: "padded",
        extension: "padded",
        encoder: "sh",
        decoder: "cp",
        speed: None,
        options: |setting, _| {
            let script = format!("cp \"$1\" \"$2\" && head -c {setting}0 /dev/zero >> \"$2\"");
            ["-c", &script, "sh"].map(str::to_owned).to_vec()
        },
        flags: ["", ""],
    };

    #[test]
    fn the_best_setting_within_the_bits_is_found() {
        let image = Raster::from_u8(9, 7, 1, ColorSpace::Srgb, &[40; 63]).unwrap();
        let at = |name| on_path(&[name]).unwrap();
        let padded = Storage { format: &PADDED, encoder: at("sh"), decoder: at("cp"), speed: None };
        let mut known = BTreeMap::new();
        let mut within =
            |bits: f64| padded.within(&image, bits / 63.0, &mut known, Path::new("a.png")).unwrap();
        let least = within(1e9).unwrap().bits - 8 * 1000;
        for setting in [0, 1, 37, 99, 100] {
            let coded = within((least + 80 * setting + 79) as f64).unwrap();
            assert_eq!(coded.bits, least + 80 * setting);
            assert_eq!(coded.decoded, image);
        }
        assert!(within(least as f64 - 1.0).is_none());
        // Rows are kept by it from run to run.
        assert!(format!("{padded:?}").starts_with("Storage { format: padded"), "{padded:?}");
        assert!(known.len() < 30, "settings are tried once: {}", known.len());
    }
}

//! Running the program in a folder of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use image::{ExtendedColorType, ImageBuffer, Rgb};
use serde_json::Value;

/// A folder that goes when the test ends.
pub(crate) struct Place {
    dir: tempfile::TempDir,
}

/// What a run gave.
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Place {
    pub(crate) fn new() -> Place {
        Place { dir: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Runs the program in this folder; arguments are split at spaces. Lines of progress, which a slow machine prints, are left out.
    pub(crate) fn run(&self, arguments: &str) -> Run {
        let output: Output = Command::new(env!("CARGO_BIN_EXE_texfold"))
            .args(arguments.split_whitespace())
            .current_dir(self.dir.path())
            .output()
            .unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        Run {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: stderr.split_inclusive('\n').filter(|line| !line.contains(" s left: ")).collect(),
        }
    }

    /// Runs `compress` and reads its report.
    pub(crate) fn compress(&self, arguments: &str) -> (Run, Vec<Value>) {
        let run = self.run(&format!("compress {arguments} --report report.json"));
        let report = fs::read(self.at("report.json")).unwrap_or_else(|_| panic!("{}", run.stderr));
        (run, serde_json::from_slice(&report).unwrap())
    }

    /// Writes an image of the given channels, smooth with some texture.
    pub(crate) fn image(&self, name: &str, width: u32, height: u32, channels: u8) {
        let color = match channels {
            1 => ExtendedColorType::L8,
            2 => ExtendedColorType::La8,
            3 => ExtendedColorType::Rgb8,
            _ => ExtendedColorType::Rgba8,
        };
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::save_buffer(path, &samples(width, height, channels), width, height, color).unwrap();
    }

    /// Writes a 16-bit RGB image.
    pub(crate) fn image16(&self, name: &str, width: u32, height: u32) {
        let samples = samples(width, height, 3).into_iter().map(|byte| u16::from(byte) * 257).collect();
        let image: ImageBuffer<Rgb<u16>, Vec<u16>> = ImageBuffer::from_raw(width, height, samples).unwrap();
        image.save(self.at(name)).unwrap();
    }

    /// Samples of an 8-bit image, channels interleaved.
    pub(crate) fn samples(&self, name: &str) -> (u32, u32, Vec<u8>) {
        let image = image::open(self.at(name)).unwrap();
        (image.width(), image.height(), image.as_bytes().to_vec())
    }
}

/// Samples of an image that any codec can do something with.
pub(crate) fn samples(width: u32, height: u32, channels: u8) -> Vec<u8> {
    let value = |x: u32, y: u32, channel: u32| {
        let wave = (x * (5 + channel) + y * 3) % 64;
        (40 + wave + 20 * channel + (x * y) % 7) as u8
    };
    let texel = |x, y| (0..u32::from(channels)).map(move |channel| value(x, y, channel));
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y)).collect()
}

/// A fixture of the repository.
pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/images").join(name)
}

/// Names in a folder, sorted, without hidden ones.
pub(crate) fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.starts_with('.'))
        .collect();
    names.sort();
    names
}

/// PSNR in dB of 8-bit samples.
pub(crate) fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 / (sum / a.len() as f64).max(1e-9)).log10()
}

//! Which images are compressed in which ways: few enough that the fixtures take less than a minute on two cores.

use std::io;
use std::path::{Path, PathBuf};

use super::sources;
use crate::root;

/// Fixtures that show detail, edges, repetition, noise, alpha and normals, and those whose sides are odd.
const IMAGES: [&str; 12] = [
    "cloth",
    "column_1x259",
    "cutout",
    "facade",
    "gray",
    "noise",
    "normal_map",
    "odd_37x61",
    "text_page",
    "tile_repeat",
    "transparent",
    "zebra",
];
/// Of these those that take encoders that search long.
const FEW_IMAGES: [&str; 5] = ["cutout", "facade", "odd_37x61", "text_page", "tile_repeat"];
/// Of these those without alpha, which content with a residual plane cannot hold.
const OPAQUE_IMAGES: [&str; 4] = ["facade", "odd_37x61", "text_page", "tile_repeat"];
/// Photographs below the folder of data: Kodak's, aerial ones, and surfaces that repeat.
const PHOTOGRAPHS: [&str; 7] = [
    "vq/kodak/kodim05.png",
    "vq/kodak/kodim13.png",
    "vq/kodak/kodim23.png",
    "remote/brighton_DJI_0022.jpg",
    "remote/naip_m_4709963_20090818.tif",
    "epitome/skimage_brick.png",
    "epitome/urban100_014.png",
];
/// Pixels a side of what is cut from them.
const CROP: u32 = 256;

/// What is measured: images that are always there, or photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Suite {
    /// Images, frames and the capture under fixtures/.
    Fixtures,
    /// Photographs, a capture and a zoom stack of the data folder.
    Data,
}

/// One `compress` command, or `bank add`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Case {
    pub(super) codec: &'static str,
    /// Whether the images are added to a bank.
    pub(super) is_bank: bool,
    /// What tells it from others of the codec.
    setting: String,
    pub(super) arguments: Vec<String>,
    pub(super) inputs: Vec<PathBuf>,
}

/// A codec, its settings, and the images that it can encode quickly enough. Figures of goals of bits are PSNR: such cases ask
/// for that metric, where the default counts errors for the eye.
const SETTINGS: [(&str, &str, &[&str]); 15] = [
    ("bc", "--content bc1", &IMAGES),
    ("bc", "--content bc7 --mips", &IMAGES),
    ("bc", "--psnr 36", &IMAGES),
    ("vq", "--bpp 2 --effort fast", &IMAGES),
    ("vq", "--psnr 30 --effort fast", &FEW_IMAGES),
    ("vq", "--codebook 64x64 --samples 1x32 --content raw --mips", &IMAGES),
    ("epitome", "--psnr 32 --effort fast", &FEW_IMAGES),
    ("epitome", "--psnr 32 --effort fast --access texel", &FEW_IMAGES),
    ("epitome", "--bpp 2 --effort fast --content error-map --metric psnr", &OPAQUE_IMAGES),
    ("epitome", "--tolerance 12 --effort fast", &FEW_IMAGES),
    ("dct", "--bpp 1 --effort fast --metric psnr", &FEW_IMAGES),
    ("dct", "--psnr 34 --effort fast", &FEW_IMAGES),
    ("progressive", "--bpp 1 --effort fast --metric psnr", &FEW_IMAGES),
    ("progressive", "--psnr 34 --effort fast", &FEW_IMAGES),
    ("auto", "--psnr 32 --effort fast", &FEW_IMAGES),
];

impl Case {
    fn new(codec: &'static str, setting: &str, inputs: Vec<PathBuf>) -> Case {
        let arguments = ["--codec", codec].into_iter().chain(setting.split_whitespace());
        let arguments = arguments.map(str::to_owned).collect();
        Case { codec, is_bank: false, setting: setting.to_owned(), arguments, inputs }
    }

    /// As users would write it.
    pub(super) fn name(&self) -> String {
        let bank = if self.is_bank { " in a bank" } else { "" };
        format!("{}{bank} {}", self.codec, self.setting).trim_end().to_owned()
    }

    /// Whether `image` is the file name of an input, or of a file in one.
    pub(super) fn reads(&self, image: &str) -> bool {
        let is_named = |input: &PathBuf| input.file_name().is_some_and(|name| name == image);
        self.inputs.iter().any(|input| is_named(input) || input.join(image).is_file())
    }

    /// A folder's name.
    pub(super) fn folder(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        self.name().chars().map(plain).collect()
    }
}

impl Suite {
    /// The name of its reference.
    pub(super) fn name(self) -> &'static str {
        match self {
            Suite::Fixtures => "fixtures",
            Suite::Data => "data",
        }
    }

    /// Its cases, in quick runs of few images; inputs that have to be made first are made in `work`. None where there is no data.
    pub(super) fn cases(self, work: &Path, quick: bool) -> io::Result<Vec<Case>> {
        match self {
            Suite::Fixtures => fixtures(work, quick),
            Suite::Data => texfold_testkit::data_dir("the reference of photographs")
                .map_or(Ok(Vec::new()), |data| photographs(&data, work)),
        }
    }
}

fn fixtures(work: &Path, quick: bool) -> io::Result<Vec<Case>> {
    let is_wanted = |name: &&&str| !quick || FEW_IMAGES.contains(name);
    let paths = |names: &[&str]| -> Vec<PathBuf> {
        names
            .iter()
            .filter(is_wanted)
            .map(|name| root().join(format!("fixtures/images/{name}.png")))
            .collect()
    };
    let case = |&(codec, setting, images)| Case::new(codec, setting, paths(images));
    let mut cases: Vec<Case> = SETTINGS.iter().map(case).collect();
    let frames = vec![root().join("fixtures/images/ripple")];
    for (codec, setting) in [("vq", "--as sequence --bpp 2"), ("epitome", "--as set --psnr 32 --effort fast")]
    {
        cases.push(Case::new(codec, setting, frames.clone()));
    }
    cases.push(Case { is_bank: true, ..Case::new("dct", "--bpp 1 --effort fast", frames) });
    let ball = vec![root().join("fixtures/captures/ball")];
    for setting in
        ["--terms 2 --access texel", "--terms 1 --content bc1 --codewords 0.5", "--regions 4 --content bc7"]
    {
        cases.push(Case::new("lightfield", setting, ball.clone()));
    }
    let stack = vec![sources::zoom_stack(&work.join("stack"))?];
    for setting in [
        "--as zoom --bpp 4 --effort fast",
        "--as zoom --psnr 34 --effort fast",
        "--as zoom --access texel --bpp 4 --effort fast",
        "--as zoom --access texel --psnr 34 --effort fast",
    ] {
        cases.push(Case::new("zipmap", setting, stack.clone()));
    }
    Ok(cases)
}

fn photographs(data: &Path, work: &Path) -> io::Result<Vec<Case>> {
    let crop = |name: &&str| sources::crop(&data.join(name), CROP, &work.join("crops"));
    let crops: Vec<PathBuf> = PHOTOGRAPHS.iter().map(crop).collect::<io::Result<_>>()?;
    let case =
        |&(codec, setting, _): &(&'static str, &str, &[&str])| Case::new(codec, setting, crops.clone());
    let mut cases: Vec<Case> = SETTINGS.iter().map(case).collect();
    let spot = data.join("slf/spot_gloss");
    let mesh = format!("--mesh {} --triangles 600", spot.join("mesh_600.obj").display());
    for setting in ["--terms 2 --access texel", "--content bc1 --codewords 0.5"] {
        // The path of the mesh is no part of the name: references are the same wherever the data lies.
        let mut case = Case::new("lightfield", setting, vec![spot.clone()]);
        case.arguments.extend(mesh.split_whitespace().map(str::to_owned));
        cases.push(case);
    }
    for setting in ["--as zoom --psnr 34 --effort fast", "--as zoom --access texel --psnr 34 --effort fast"] {
        cases.push(Case::new("zipmap", setting, vec![data.join("zipmap/vlfeat_river")]));
    }
    Ok(cases)
}

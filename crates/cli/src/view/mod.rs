//! `view`: a page that shows `.txf` files in a browser, by the package under web/.

mod serve;

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use base64::prelude::{BASE64_STANDARD, Engine};
use glam::Vec3;
use serde::Serialize;
use serde_json::json;
use texfold::AnyTexture;
use texfold_core::image::Raster;
use texfold_core::{Encoded, Image2d, Mesh, Rect, Texel};

use crate::bank::{BankMap, is_bank};
use crate::console::{complain, say};
use crate::error::{CliError, explain, guarded};
use crate::files;
use crate::info::read_original;
use crate::input::find::expand_all;
use crate::memory::{MemoryArgs, load_fault};
use crate::output::write_whole;
use crate::png;

/// The page; `npm run build` in web/ writes it.
const PAGE: &str = include_str!("page.html");
/// What stands in the page for the files.
const DATA: &str = "@DATA@";
/// Largest side of a picture for browsers that cannot draw the texture.
const STILL_SIDE: u32 = 512;

/// Arguments of `view`.
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// .txf files, and folders of them; with --serve also folders of banks, shown as maps.
    #[arg(value_name = "FILE.txf", required_unless_present = "serve")]
    files: Vec<PathBuf>,
    /// The page to write: it holds the files and needs nothing else.
    #[arg(long, value_name = "PAGE.html", required_unless_present = "serve")]
    out: Option<PathBuf>,
    /// Serve the page on this machine alone, at http://127.0.0.1:PORT/ (0, the default: any free port). Images that are dropped on it are
    /// encoded and shown beside what the browser's own encoders make of them at equal bytes.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "0", conflicts_with = "out")]
    serve: Option<u16>,
    /// The image or folder that a file was made from, once for each file in their order: also show originals and errors.
    #[arg(long, value_name = "INPUT")]
    original: Vec<PathBuf>,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// A file as the page takes it.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Item {
    name: String,
    /// All in base 64: the file, PNGs of the images that it was made from, a PNG of a part of it.
    data: String,
    originals: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    still: Option<String>,
    /// Name of the group whose originals it has: of other encodings of the same input.
    #[serde(skip_serializing_if = "Option::is_none")]
    group: Option<String>,
    /// Of a light field's mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    sphere: Option<Sphere>,
    /// In the place of a file: a bank, whose tiles the page asks for one by one.
    #[serde(skip_serializing_if = "Option::is_none")]
    bank: Option<BankMap>,
}

/// Images that the encodings of one input have in common.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Group {
    /// PNGs in base 64.
    pub(crate) originals: Vec<String>,
    /// By other encoders, decoded.
    pub(crate) rivals: Vec<Picture>,
}

/// An image: its name, a PNG in base 64.
#[derive(Debug, Serialize)]
pub(crate) struct Picture {
    pub(crate) name: String,
    pub(crate) data: String,
}

/// A sphere around a mesh.
#[derive(Debug, Serialize)]
struct Sphere {
    centre: [f32; 3],
    radius: f32,
}

/// Runs the command; the number of files that are not in the page.
pub(crate) fn run(args: &ViewArgs) -> Result<usize, CliError> {
    let mut originals: VecDeque<&PathBuf> = args.original.iter().collect();
    let (mut items, mut failed) = (Vec::new(), 0);
    for path in expand_all(&args.files) {
        let original = originals.pop_front();
        let read = path.and_then(|path| {
            guarded(&path, || {
                if args.serve.is_some() && is_bank(&path) {
                    return Ok(Item { bank: Some(BankMap::read(&path)?), ..Item::new(&path, &[]) });
                }
                item(&path, original.map(PathBuf::as_path), args.memory)
            })
        });
        match read {
            Ok(item) => items.push(item),
            Err(error) => {
                complain(&explain(&error));
                failed += 1;
            }
        }
    }
    if let Some(path) = originals.front() {
        return Err(CliError::OriginalWithoutFile { path: (*path).clone() });
    }
    if let Some(port) = args.serve {
        return serve::serve(port, &items);
    }
    if let Some(out) = args.out.as_ref().filter(|_| !items.is_empty()) {
        write_whole(out, page(&items, &BTreeMap::new(), false).as_bytes())?;
        say(&format!("wrote {}", out.display()));
    }
    Ok(failed)
}

/// The page with these files, and groups by their names; served pages can have images encoded.
pub(crate) fn page(items: &[Item], groups: &BTreeMap<String, Group>, is_served: bool) -> String {
    let data = json!({ "items": items, "groups": groups, "isServed": is_served }).to_string();
    // Nothing in a name ends the element that holds the data.
    PAGE.replace(DATA, &data.replace('<', "\\u003c"))
}

impl Item {
    /// A file and nothing else of it.
    fn new(path: &Path, file: &[u8]) -> Item {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Item { name, data: BASE64_STANDARD.encode(file), ..Item::default() }
    }

    /// An encoding of an input, whose originals the group of that name has.
    pub(crate) fn of_group(name: String, file: &[u8], group: &str) -> Item {
        Item { group: Some(group.to_owned()), ..Item::new(Path::new(&name), file) }
    }
}

/// Reads a file and all that the page shows of it.
fn item(path: &Path, original: Option<&Path>, memory: MemoryArgs) -> Result<Item, CliError> {
    if is_bank(path) {
        return Err(CliError::IsBank { path: path.to_owned() });
    }
    let bytes = files::read(path)?;
    let texture = texfold::open_with(&bytes, &memory.limits()).map_err(|source| load_fault(path, source))?;
    let encode = |raster: &Raster| {
        let fault = |source| CliError::Draw { path: path.to_owned(), source: Box::new(source) };
        png::encode(raster).map(|png| BASE64_STANDARD.encode(png)).map_err(fault)
    };
    let (mut originals, mut picture, mut around) = (Vec::new(), None, None);
    match &texture {
        AnyTexture::Image(image) => {
            let encoded = image.as_encoded();
            picture = still(encoded).as_ref().map(encode).transpose()?;
            if let Some(original) = original {
                let images = read_original(original, encoded.layout().images.len(), memory.bytes())?;
                originals = images.iter().map(encode).collect::<Result<_, _>>()?;
            }
        }
        AnyTexture::Light(light) => around = Some(sphere(light.mesh())),
    }
    Ok(Item { originals, still: picture, sphere: around, ..Item::new(path, &bytes) })
}

/// The middle of the first image, of the mip level that fits best.
fn still(encoded: &dyn Encoded<Domain = Image2d>) -> Option<Raster> {
    let layout = encoded.layout();
    let size = layout.images.first()?;
    let fitting = (size.width.max(size.height) / STILL_SIDE).checked_ilog2().unwrap_or(0);
    let level = fitting.min(layout.levels - 1);
    let size = size.at_level(level);
    let (width, height) = (size.width.min(STILL_SIDE), size.height.min(STILL_SIDE));
    let (x, y) = ((size.width - width) / 2, (size.height - height) / 2);
    let mut texels = vec![Texel::ZERO; width as usize * height as usize];
    encoded.decode(Rect { image: 0, level, x, y, width, height }, &mut texels).ok()?;
    Raster::from_texels(width, height, layout.pixel, &texels).ok()
}

/// A sphere around the vertices of a mesh: around the middle of the box that holds them.
fn sphere(mesh: &Mesh) -> Sphere {
    let low = mesh.positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = mesh.positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let centre = (low + high) / 2.0;
    let radius = mesh.positions.iter().map(|place| place.distance(centre)).fold(0.0, f32::max);
    Sphere { centre: centre.to_array(), radius: radius.max(f32::MIN_POSITIVE) }
}

//! Images are added in three steps. First the categories of their tiles are found, for all images in order. Then each
//! is encoded tile by tile: by block, or by texel against the public codebooks of these categories. Images that share none
//! do not depend on one another and are encoded at a time. Last, each is listed in `bank.json`, in order. What a bank comes
//! to does not depend on how many are encoded at a time.

use std::time::Instant;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold::bank::{Categories, Codebooks, Grown, Seen, is_device, is_printable};
use texfold_core::image::Depth;
use texfold_core::{Access, ImageSize};
use texfold_progressive::{Progressive, ProgressiveParams};

use super::encode::{Encode, Encoded};
use super::manifest::{self, Bank, Image};
use super::sums::Sums;
use super::task::BankTask;
use super::{Open, fault, tiles};
use crate::error::{CliError, guarded};
use crate::input::{self, Remarks, georeference};
use crate::progress::Share;
use crate::report::Row;

/// Bytes that a texel of a band takes at most: as it is read, and as it is cut.
const BAND_BYTES: u64 = 12;
/// Bytes that encoding a tile takes: 160 MB for one of 1279 x 1279 texels, as measured, 210 MB with codebooks, and what
/// allocators keep.
const TILE_BYTES: u64 = 280 << 20;

/// Encoded tiles of two steps, which the search for the step of an image by block keeps; here of 8 bits a texel at most.
const MOST_KEPT_BYTES: u64 = 192 << 20;

/// What is to be done with an image.
#[derive(Debug)]
pub(crate) enum Step {
    /// It is there already.
    Known(Box<Row>),
    /// It cannot be added.
    Failed(CliError),
    /// It is to be added.
    Add(Box<Add>),
}

/// An image that is to be added.
#[derive(Debug)]
pub(crate) struct Add {
    /// Hash of all that its stored form depends on, but the codebooks.
    key: String,
    /// Number of its first file.
    first: u32,
    /// Categories of its tiles, row by row.
    pub(crate) categories: Vec<usize>,
    /// How its texels are to be reached.
    access: Access,
    depth: Depth,
    peak: f32,
    georeference: Vec<u8>,
    remarks: Remarks,
    /// Whether it uses what other images have brought.
    pub(crate) depends: bool,
}

impl Add {
    /// Whether it may use public codebooks.
    pub(super) fn uses_codebooks(&self) -> bool {
        self.access == Access::Texel
    }
}

/// An image that has been encoded, all but listed.
#[derive(Debug)]
pub(crate) struct Made {
    image: Image,
    grown: Vec<Grown>,
    /// Number of the first file that is not its own.
    end: u32,
}

/// What is seen of an image before it is added.
#[derive(Debug, Default)]
struct Found {
    tiles: Seen,
    georeference: Vec<u8>,
    remarks: Remarks,
}

/// The key of an image that is to be added, and what is seen of it; else what is to be done with it.
type New = Result<(String, Found), Step>;

/// Finds out what is to be done with each image, and the categories of the tiles.
///
/// With `force` images that are there are encoded again, and replace those of their names.
pub(crate) fn plan(open: &mut Open, tasks: &[&BankTask], limit_bytes: u64, force: bool) -> Vec<Step> {
    let keys: Vec<Result<String, Step>> = tasks.iter().map(|task| task.key_of_new(open, force)).collect();
    let found = |(task, key): (&&BankTask, Result<String, Step>)| {
        let seen = guarded(&task.path, || task.seen(limit_bytes));
        key.and_then(|key| Ok((key, seen.map_err(Step::Failed)?)))
    };
    let found: Vec<New> = tasks.iter().zip(keys).map(found).collect();
    let manifest = open.bank().manifest();
    let (mut first, mut categories) = (manifest.next, Categories::of(manifest.categories.clone()));
    let known =
        || tasks.iter().zip(&found).filter_map(|(task, found)| Some((*task, &found.as_ref().ok()?.1.tiles)));
    let mut named = Vec::new();
    for (task, _) in known() {
        if let Some(name) = task.category.as_deref().filter(|name| !named.contains(name)) {
            let of_name = known().filter(|(task, _)| task.category.as_deref() == Some(name));
            let tiles: Vec<Vec<f32>> = of_name.flat_map(|(_, seen)| &seen.colours).cloned().collect();
            categories.name(name, &tiles);
            named.push(name);
        }
    }
    let tiles: Vec<Vec<f32>> = known().flat_map(|(_, seen)| &seen.colours).cloned().collect();
    categories.begin(&tiles);
    let step = |(task, found): (&&BankTask, New)| match found {
        Ok((key, seen)) => task.step(&mut categories, key, &mut first, seen),
        Err(step) => step,
    };
    let steps = tasks.iter().zip(found).map(step).collect();
    open.writer.set_categories(categories.into_inner());
    steps
}

impl BankTask {
    /// Where tiles join categories, and which files are the image's: one for each tile, and one for each codebook that
    /// it grows.
    fn step(&self, categories: &mut Categories, key: String, next: &mut u32, found: Found) -> Step {
        let (first, Found { tiles: Seen { colours, depth, peak, .. }, georeference, remarks }) =
            (*next, found);
        *next += 2 * colours.len() as u32;
        let categories = match categories.join(self.category.as_deref(), &colours) {
            Ok(joined) => joined,
            Err(error) => return Step::Failed(fault(&self.path, error)),
        };
        let access = self.access();
        let depends = access == Access::Texel && self.params().tries_codebooks();
        Step::Add(Box::new(Add {
            key,
            first,
            categories,
            access,
            depth,
            peak,
            georeference,
            remarks,
            depends,
        }))
    }

    /// Access to texels: that of the codec, which is dct or progressive.
    fn access(&self) -> Access {
        let encoding = self.settings.encode.codec.encoding();
        encoding.and_then(|encoding| encoding.accesses.first().copied()).unwrap_or_default()
    }

    fn seen(&self, limit_bytes: u64) -> Result<Found, CliError> {
        let mut seen = Seen::default();
        let mut remarks = self.settings.remarks.clone();
        tiles::each(&self.path, &self.settings, limit_bytes, &mut remarks, |cut| {
            seen.add(&cut.tile);
            Ok(())
        })?;
        // Those of all images together would take too much memory.
        seen.samples = Vec::new();
        input::note_of_peak(&self.path, seen.peak, &mut remarks);
        let georeference = georeference::of_input(&[&self.path], 1, &mut remarks);
        Ok(Found { tiles: seen, remarks, georeference })
    }

    /// The key of an image that is not there yet, or replaces the one of its name.
    fn key_of_new(&self, open: &Open, force: bool) -> Result<String, Step> {
        let shown = [Some(self.name.as_str()), self.category.as_deref()].into_iter().flatten();
        if let Some(name) = shown.into_iter().find(|name| !is_printable(name)) {
            let (path, name) = (self.path.clone(), name.escape_debug().to_string());
            return Err(Step::Failed(CliError::ControlCharacters { path, name }));
        }
        if is_device(&self.name) {
            return Err(Step::Failed(CliError::DeviceName { path: self.path.clone() }));
        }
        let key = self.key().map_err(Step::Failed)?;
        match open.bank().images().iter().find(|image| image.name == self.name) {
            None => Ok(key),
            Some(_) if force => Ok(key),
            Some(known)
                if known.key == key && known.tiles.iter().all(|tile| open.bank().path_of(tile).exists()) =>
            {
                Err(Step::Known(Box::new(known.row.clone())))
            }
            Some(_) => Err(Step::Failed(CliError::BankName { path: self.path.clone() })),
        }
    }

    pub(super) fn params(&self) -> ProgressiveParams {
        self.settings.encode.params::<Progressive>()
    }

    /// About how many bytes it takes to add it: a band of the image, and a tile with all that is made of it.
    pub(crate) fn cost_bytes(&self) -> u64 {
        let (width, texels) =
            input::size_of(&self.path).map_or((0, 0), |size| (u64::from(size.width), size.texels()));
        (2 * texels).min(MOST_KEPT_BYTES) + width * u64::from(tiles::MOST_ROWS) * BAND_BYTES + TILE_BYTES
    }

    /// Encodes the image, and writes its files.
    pub(crate) fn make(
        &self,
        bank: &Bank,
        books: &Codebooks,
        add: &Add,
        limit_bytes: u64,
        share: &Share<'_>,
    ) -> Result<Made, CliError> {
        let start = Instant::now();
        let Add { first, depth, peak, ref categories, .. } = *add;
        let dir = bank.dir();
        let encode = Encode { task: self, dir, first, categories, depth, peak, limit_bytes, share };
        let Encoded { sums, size, making, grown } = match add.access {
            Access::Block => encode.blocks()?,
            Access::Texel => encode.texels(books)?,
        };
        let mut row = sums.row(self, bank.dir(), size, (&making, start.elapsed().as_secs_f64()));
        row.notes = add.remarks.notes(1);
        row.warnings.extend(add.remarks.warnings(1));
        let image = self.image(add, sums, size, row);
        Ok(Made { image, grown, end: add.first + 2 * add.categories.len() as u32 })
    }

    fn image(&self, add: &Add, sums: Sums, size: ImageSize, row: Row) -> Image {
        Image {
            name: self.name.clone(),
            key: add.key.clone(),
            width: size.width,
            height: size.height,
            channels: sums.channels,
            levels: sums.levels,
            georeference: BASE64_STANDARD.encode(&add.georeference),
            tiles: sums.tiles,
            row,
        }
    }
}

impl Open {
    /// Lists an image that has been made, in the place of one of its name: from then on it counts. The files of the one before
    /// are removed after that; the rows that it added to codebooks stay, as others may use them.
    pub(crate) fn commit(&mut self, made: Made) -> Result<Row, CliError> {
        let Made { image, grown, end } = made;
        let row = image.row.clone();
        let path = self.bank().dir().join(&image.name);
        let has_blocks = |image: &Image| manifest::access_of(image) == Access::Block;
        self.writer.list(image, end, has_blocks, &grown).map_err(|error| fault(&path, error))?;
        Ok(row)
    }
}

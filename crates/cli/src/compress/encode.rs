//! From the content of files to an encoded texture: blocks that exist are taken over, everything else is encoded.

use std::path::{Path, PathBuf};

use texfold::{
    AnyImage, Content, EncodeSettings, Family, Guidance, encoding::Chosen, epitome::Epitome, vq::Vq,
};
use texfold_bc::{Bc1Blocks, BcTexture};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::mesh::UvMesh;
use texfold_core::{EncodeError, Goal, Job, Limits, SourceError, Stage};

use crate::error::CliError;
use crate::input::{self, Remarks, container, georeference, pixels};
use crate::memory;
use crate::settings::Settings;

/// Bits a texel of BC1: what blocks that are taken over cost.
const BC1_BPP: f64 = 4.0;

/// The images of an input.
#[derive(Debug)]
pub(crate) struct Loaded {
    /// Their texels: what the result is measured against.
    pub(crate) images: ImageSet,
    /// Their blocks, where they are BC1 and are to stay so.
    pub(crate) blocks: Option<Vec<Bc1Blocks>>,
    /// Importance painted by hand.
    pub(crate) painted: Option<Raster>,
    /// Where content may come from.
    pub(crate) content_from: Option<Raster>,
    /// The georeference, for the notes; empty where there is none.
    pub(crate) georeference: Vec<u8>,
    /// Notes and warnings on the files.
    pub(crate) remarks: Remarks,
    /// Why blocks that exist are not taken over.
    pub(crate) warning: Option<&'static str>,
}

/// Why encoding failed; the path is added by the caller.
#[derive(Debug)]
pub(crate) enum Fault {
    Source(SourceError),
    Encode(EncodeError),
}

impl Fault {
    pub(crate) fn of(self, path: &Path) -> CliError {
        let path = path.to_owned();
        match self {
            Fault::Source(source) => CliError::Source { path, source },
            Fault::Encode(source) => CliError::Encode { path, source },
        }
    }
}

/// Reads all files of an input.
pub(crate) fn load(
    files: &[PathBuf],
    all_frames: bool,
    settings: &Settings,
    limit_bytes: u64,
) -> Result<Loaded, CliError> {
    let first = files.first().cloned().unwrap_or_default();
    let mut remarks = settings.remarks.clone();
    if settings.is_material {
        let images = input::material::read_maps(files, settings, limit_bytes, &mut remarks)?;
        return Ok(Loaded {
            images,
            blocks: None,
            painted: None,
            content_from: None,
            georeference: Vec::new(),
            remarks,
            warning: None,
        });
    }
    let mut rasters = Vec::new();
    let mut blocks = Vec::new();
    for content in input::read_files(files, all_frames, settings, limit_bytes, &mut remarks)? {
        match content {
            input::Content::Pixels(raster) => rasters.push(raster),
            input::Content::Blocks { image, alpha } => {
                rasters.push(container::decode(&first, image.clone(), alpha, settings)?);
                blocks.push(image);
            }
        }
    }
    if settings.encode.codec.is::<Vq>() {
        // It works on texels; that blocks are decoded is no surprise.
        blocks.clear();
    }
    let mixed = blocks.len() < rasters.len();
    let obstacle =
        if mixed { Some("not all images of the input are BC1") } else { obstacle(&settings.encode) };
    let images = ImageSet::new(rasters).map_err(|source| CliError::Source { path: first.clone(), source })?;
    input::note_of_peak(&first, images.images()[0].peak(), &mut remarks);
    let read = |map: &PathBuf| pixels::read(map, settings.color, None, limit_bytes, &mut Remarks::default());
    let painted = settings.importance_map.as_ref().map(read).transpose()?;
    let content_from = settings.content_from.as_ref().map(read).transpose()?;
    let warning = obstacle.filter(|_| !blocks.is_empty());
    let blocks = (!blocks.is_empty() && obstacle.is_none()).then_some(blocks);
    let georeference = georeference::of_input(files, images.images().len(), &mut remarks);
    Ok(Loaded { images, blocks, painted, content_from, georeference, remarks, warning })
}

/// Why BC1 blocks cannot be the answer to such settings.
fn obstacle(settings: &EncodeSettings) -> Option<&'static str> {
    if settings.content.is_some_and(|content| content != Content::Bc1) || settings.family != Family::Bc {
        Some("another format was requested: the BC1 blocks are decoded and encoded again")
    } else if settings.codec.is::<Epitome>() {
        // What it shows from elsewhere, and at other scales, is another matter.
        None
    } else if settings.mips {
        Some("a mip chain was requested: the BC1 blocks are decoded and encoded again")
    } else if matches!(settings.goal, Goal::Bpp(bpp) if bpp < BC1_BPP) {
        Some("fewer bits than BC1 were requested: the BC1 blocks are decoded and encoded again")
    } else {
        None
    }
}

/// Encodes on the threads that call this.
pub(crate) fn encode(
    loaded: &Loaded,
    settings: &Settings,
    mesh: Option<&UvMesh>,
    limit_bytes: u64,
    progress: &mut (dyn FnMut(Stage) + Send),
) -> Result<Chosen, Fault> {
    if let Some(blocks) = &loaded.blocks
        && !settings.encode.codec.is::<Epitome>()
    {
        let texture = BcTexture::from_bc1(blocks.clone(), loaded.images.info());
        let texture = texture.map_err(Fault::Source)?;
        return Ok(Chosen { image: AnyImage::new(texture), attempts: Vec::new() });
    }
    let guidance = Guidance {
        painted: loaded.painted.as_ref(),
        mesh,
        content_from: loaded.content_from.as_ref(),
        blocks: loaded.blocks.as_deref(),
    };
    let limits = Limits { bytes: limit_bytes.max(memory::ALWAYS_ALLOWED), ..Limits::default() };
    let mut job = Job::new(limits).with_progress(progress);
    texfold::encoding::choose_images(&loaded.images, guidance, &settings.encode, &mut job)
        .map_err(Fault::Encode)
}

//! `render`: light fields and textured meshes as cameras see them, one PNG a camera, and zooms into flat textures.

mod mesh;
mod zoom;

use std::path::{Path, PathBuf};

use texfold::{
    core::Camera,
    lightfield::{LightTexture, Renderer},
};
use texfold_core::image::{Alpha, ColorSpace, Raster};
use texfold_core::{Encoded, Limits};
use texfold_gpu::{Gpu, GpuError, Policy};

use crate::config::Sides;
use crate::console::warn;
use crate::error::{CliError, guarded};
use crate::files;
use crate::input::capture;
use crate::memory::{MemoryArgs, load_fault};
use crate::output::{make_folder, remove_stale};
use crate::png;

/// Digits of an image's number; more where there are more than a thousand.
const NUMBER_DIGITS: usize = 3;

/// Arguments of `render`.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// A .txf file.
    #[arg(value_name = "FILE.txf")]
    file: PathBuf,
    /// Light fields and meshes: the cameras, in a file like a capture's transforms.json.
    #[arg(long, value_name = "CAMERAS.json", conflicts_with = "zoom_to")]
    camera: Option<PathBuf>,
    /// Images: draw a zoom towards this point, and a strip of its frames. 0,0 is the upper left corner, 1,1 the lower
    /// right.
    #[arg(long, value_name = "U,V", value_parser = zoom::target)]
    zoom_to: Option<glam::Vec2>,
    /// Images: draw this mesh (.obj, .ply, .glb or .gltf) with an image on it, its texture coordinates repeated; longitude and latitude
    /// where it has none (.ply: always).
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["zoom_to", "terms"])]
    mesh: Option<PathBuf>,
    /// With --mesh: this many cameras on a circle around the mesh, y up, instead of --camera; 1 by default.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000), requires = "mesh", conflicts_with = "camera")]
    turntable: Option<u32>,
    /// With --mesh: which image of the file is drawn.
    #[arg(long, value_name = "K", default_value_t = 0, requires = "mesh")]
    image: u32,
    /// Frames of a zoom.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000), requires = "zoom_to")]
    steps: Option<u32>,
    /// Folder for the images: 000.png and so on, in the order of the cameras.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Draw on the CPU: the reference.
    #[arg(long)]
    cpu: bool,
    /// Use only this many terms beside the mean.
    #[arg(long, value_name = "K")]
    terms: Option<u32>,
    /// Width and height in pixels; by default those of the cameras, of a turntable 640x480.
    #[arg(long, value_name = "WxH")]
    size: Option<Sides>,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Runs the command.
pub(crate) fn run(args: &RenderArgs) -> Result<usize, CliError> {
    guarded(&args.file, || match (args.zoom_to, &args.camera) {
        _ if args.mesh.is_some() => args.mesh.as_deref().map_or(Ok(0), |path| mesh::run(args, path)),
        (Some(_), _) if args.terms.is_some() => Err(usage(args, "an image has no terms")),
        (Some(target), _) => zoom::run(args, target),
        (None, Some(camera)) => render_light(args, camera),
        (None, None) => Err(usage(args, "neither cameras, nor a mesh, nor a zoom target are given")),
    })
}

fn usage(args: &RenderArgs, given: &'static str) -> CliError {
    CliError::RenderWhat { path: args.file.clone(), given }
}

/// Images of a light field.
fn render_light(args: &RenderArgs, camera: &Path) -> Result<usize, CliError> {
    let texture = load(&args.file, &args.memory.limits())?;
    let layers = texture.layers();
    if layers.loaded < layers.total {
        let (has, of) = (layers.loaded - 1, layers.total - 1);
        warn(&format!("{}: ends after {has} of {of} terms", args.file.display()));
    }
    let texture = match args.terms {
        Some(terms) => texture.first_terms(terms),
        None => texture,
    };
    let cameras = cameras(camera, args.size)?;
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let digits = NUMBER_DIGITS.max((cameras.len() - 1).to_string().len());
    let mut draw = artist(args, &texture)?;
    for (number, camera) in cameras.iter().enumerate() {
        let pixels = draw(camera)?;
        let path = args.out.join(format!("{number:0digits$}.png"));
        png::write(&path, &raster(&args.file, camera, &pixels)?)?;
    }
    Ok(0)
}

type Artist<'t> = Box<dyn FnMut(&Camera) -> Result<Vec<[u8; 4]>, CliError> + 't>;

/// What draws: the reference, or a GPU.
fn artist<'t>(args: &'t RenderArgs, texture: &'t LightTexture) -> Result<Artist<'t>, CliError> {
    if args.cpu {
        let renderer = Renderer::new(texture);
        return Ok(Box::new(move |camera| Ok(renderer.render(camera))));
    }
    let device =
        Gpu::new(Policy::from_env()).map_err(|source| CliError::NoDrawing { source: Box::new(source) })?;
    let failed =
        |source: GpuError| CliError::GpuDrawing { path: args.file.clone(), source: Box::new(source) };
    let light = device.upload_light(&texture.gpu()).map_err(failed)?.with_terms(texture.layout().terms);
    let mesh = texture.mesh();
    Ok(Box::new(move |camera| {
        let (near, far) = mesh.depths(camera);
        let size = (camera.width, camera.height);
        device.draw_light(&light, camera.view_projection(near, far), camera.eye(), size).map_err(failed)
    }))
}

/// Loads a `.txf` file that holds a light field, within limits.
pub(crate) fn load(path: &Path, limits: &Limits) -> Result<LightTexture, CliError> {
    let bytes = files::read(path)?;
    let texture = texfold::open_with(&bytes, limits).map_err(|source| load_fault(path, source))?;
    let codec = texture.codec().name;
    texture.into_light().map_err(|_| CliError::NotLight { path: path.to_owned(), codec })
}

/// The cameras of a file, for images of `size` pixels where that is given.
fn cameras(path: &Path, size: Option<Sides>) -> Result<Vec<Camera>, CliError> {
    let size = size.map(|Sides(width, height)| (width.max(1), height.max(1)));
    let shots = capture::read_cameras(path)?;
    let camera = |shot: &texfold_capture::Shot| -> Result<Camera, CliError> {
        let camera = shot.camera(path, size)?;
        Ok(size.map_or(camera, |(width, height)| camera.resized(width, height)))
    };
    shots.iter().map(camera).collect()
}

fn raster(path: &Path, camera: &Camera, pixels: &[[u8; 4]]) -> Result<Raster, CliError> {
    let raster = Raster::from_u8(camera.width, camera.height, 4, ColorSpace::Srgb, pixels.as_flattened());
    raster
        .map(|raster| raster.tagged(ColorSpace::Srgb, Alpha::Straight))
        .map_err(|source| CliError::Source { path: path.to_owned(), source })
}

//! What goes wrong with files and command lines. Each message names the file and says what to do.

use std::error::Error;
use std::io;
use std::path::PathBuf;

use crate::input::formats::FORMATS;
use texfold::bank::BankError;
use texfold_capture::CaptureError;
use texfold_core::{EncodeError, LoadError, RegionError, SourceError};

/// A command line or configuration that cannot be carried out: exit code 2, nothing is done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum UsageError {
    #[error("--{option} is for codec {wanted}, not {codec}; leave it out or give --codec {wanted}")]
    NotForCodec { option: &'static str, wanted: &'static str, codec: &'static str },
    #[error("--{option} cannot be combined with {other}; leave one of them out")]
    Excluded { option: &'static str, other: &'static str },
    #[error("--weights of kinds of maps are for --as material; give that, or leave them out")]
    MapWeights,
    #[error("--weights of a scene name kinds of maps; give them as in normal=2,height=0.5")]
    SceneWeights,
    #[error("--container is for textures; give --to bc1, bc3, bc4, bc5, bc7 or rgba8, or leave it out")]
    Container,
    #[error("windows of a bank are written as pictures; give --to png, tiff, cog, webp or exr")]
    BankTexture,
    #[error("a bank has images of the codecs dct and progressive, not {codec}; give one of these")]
    BankCodec { codec: &'static str },
    #[error("--category is for images of a bank; leave it out, or use `texfold bank add`")]
    Category,
    #[error("--{} is {}; allowed: {}", source.field, source.value, source.range)]
    Setting { source: texfold_core::ParamError },
    #[error("--{option} {value} is outside {range}; give a value in that range")]
    Range { option: &'static str, value: String, range: &'static str },
    #[error("--suite {name}: {reason}")]
    Suite { name: String, reason: String },
    #[error("{} names more than one goal; give one of psnr, bpp, tolerance and degrees", path.display())]
    TwoGoals { path: PathBuf },
    #[error("{}: the configuration cannot be read; check the path", path.display())]
    ConfigRead { path: PathBuf, source: io::Error },
    #[error("{}: the configuration is wrong; correct it as the cause says", path.display())]
    ConfigSyntax { path: PathBuf, source: toml::de::Error },
    #[error("{}: rule {index} has no glob; add glob = \"*.png\" or the like", path.display())]
    RuleWithoutGlob { path: PathBuf, index: usize },
    #[error("{}: '{glob}' is not a valid glob; correct the pattern", path.display())]
    RuleGlob { path: PathBuf, glob: String, source: glob::PatternError },
}

/// Why an input, or a whole command, failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    #[error(transparent)]
    Usage(#[from] UsageError),
    #[error("shader {name} cannot be written in that language ({what}); choose another one with --lang")]
    Shader { name: String, what: String },
    #[error("{}: no such file or folder; check the path", path.display())]
    NotFound { path: PathBuf },
    #[error("{pattern}: no file matches; check the pattern")]
    NoMatch { pattern: String },
    #[error("{}: the folder holds no .txf file; name one that `compress` wrote to", path.display())]
    NoTextures { path: PathBuf },
    #[error("{}: cannot be read; check the path and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{}: the folder holds no image; put {formats} files into it", path.display(), formats = FORMATS)]
    EmptyFolder { path: PathBuf },
    #[error("{}: the file is empty; write it again", path.display())]
    EmptyFile { path: PathBuf },
    #[error("{}: unknown image format; give {formats}", path.display(), formats = FORMATS)]
    UnknownFormat { path: PathBuf },
    #[error("{}: {name} is not read; give {formats}", path.display(), formats = FORMATS)]
    NotRead { path: PathBuf, name: &'static str },
    #[error("{}: {name} is not read by this build; build with --features {feature}, or give {formats}", path.display(), formats = FORMATS)]
    NeedsFeature { path: PathBuf, name: &'static str, feature: &'static str },
    #[error("{}: --degrees is a goal for normal maps in files of their own; give --color normal where it is one", path.display())]
    NoNormals { path: PathBuf },
    #[error("{}: light fields have no --{option}; give --psnr, or --terms, --codewords and --grid", path.display())]
    LightGoal { path: PathBuf, option: &'static str },
    #[error("{}: the float samples exceed 0 to 1; tone-map the image to 8 or 16 bits first", path.display())]
    HighRange { path: PathBuf },
    #[error("{}: the image cannot be decoded; export it again", path.display())]
    Decode { path: PathBuf, source: Box<image::ImageError> },
    #[error("{}: the image ends early or is damaged; export it again", path.display())]
    Rows { path: PathBuf, source: Box<dyn Error + Send + Sync> },
    #[error("{}: another process adds to this bank; wait until it has ended", path.display())]
    BankLocked { path: PathBuf },
    #[error(transparent)]
    Bank(#[from] BankError),
    #[error("{}: this is a bank; list it with `texfold bank list`, decode its images with `texfold bank extract`, see it with `texfold view --serve`", path.display())]
    IsBank { path: PathBuf },
    #[error("{}: no image is stored by block, so that no page can show tiles; add images with --codec dct", path.display())]
    BankByTexel { path: PathBuf },
    #[error("{}: there are more originals than files; give one for each file, in their order", path.display())]
    OriginalWithoutFile { path: PathBuf },
    #[error("port {port} cannot be served; give another one, or --serve for any that is free")]
    Serve { port: u16, source: Box<dyn Error + Send + Sync> },
    #[error("{}: this is no bank; give the folder that `texfold bank add` has written", path.display())]
    NoBank { path: PathBuf },
    #[error("{}: this cannot be in a bank; give images, or folders of images", path.display())]
    NotForBank { path: PathBuf },
    #[error("{}: the bank has an image of that name from another file or with other settings; rename one of them, or replace that one (--force)", path.display())]
    BankName { path: PathBuf },
    #[error("{}: a codebook of the bank cannot be used: {cause}", path.display())]
    BankBook { path: PathBuf, cause: String },
    #[error("{}: the bank has {most} categories already; give one of those that `texfold bank list` shows", path.display())]
    BankCategories { path: PathBuf, most: usize },
    #[error("{}: the bank holds no image {name}; give the name of one that `texfold bank list` shows", path.display())]
    NoSuchImage { path: PathBuf, name: String },
    #[error("{}: the image needs more than the limits allow; scale it down, split it, or raise --memory", path.display())]
    ImageLimits { path: PathBuf, source: Box<image::ImageError> },
    #[error("{}: {what} are not read; convert to 8 or 16 bits and 1 to 4 channels", path.display())]
    PixelFormat { path: PathBuf, what: String },
    #[error("{}: has {bands} bands, and only compress takes more than four, of one image at a time; give the file alone, or four of its bands", path.display())]
    ManyBands { path: PathBuf, bands: u16 },
    #[error("{}: about {needed_mib} MiB are needed and {allowed_mib} MiB allowed; split the input or raise --memory", path.display())]
    Memory { path: PathBuf, needed_mib: u64, allowed_mib: u64 },
    #[error("{}: the {container} header is wrong; export the file again", path.display())]
    Container { path: PathBuf, container: &'static str, source: Box<dyn Error + Send + Sync> },
    #[error("{}: holds {found}, and only a flat image of 8 or 16 bits, plain or in BC1 to BC5, BC7 or ASTC, is read; convert it to PNG", path.display())]
    NotFlat { path: PathBuf, found: &'static str },
    #[error("{}: the file ends before its blocks do ({found} of {needed} bytes); export it again", path.display())]
    CutBlocks { path: PathBuf, found: usize, needed: u64 },
    #[error("{}: the scene {what}; export it as glTF 2 with its images in PNG, JPEG or WebP", path.display())]
    Scene { path: PathBuf, what: &'static str },
    #[error("{}: would be written over itself; give another --out", path.display())]
    Itself { path: PathBuf },
    #[error("{}: the scene cannot be read; export it as .glb or .gltf again", path.display())]
    SceneSyntax { path: PathBuf, source: Box<dyn Error + Send + Sync> },
    #[error("{}: no name of a map; end file names in _Color, _Normal, _Roughness, _Metalness, _AO, _ORM, _Height, _Emissive or _Opacity, or give --as image (a scene of glTF is for the command pack)", path.display())]
    NoMaps { path: PathBuf },
    #[error("{}: is not a folder of photographs; give codec zipmap a folder with zipmap.toml in it, or --as zoom", path.display())]
    NotStack { path: PathBuf },
    #[error("{}: is a zoom stack, but codec {codec} takes images; give --codec zipmap, or --as set to encode its images", path.display())]
    StackOnly { path: PathBuf, codec: &'static str },
    #[error("{}: the list of patches cannot be read; write it as the cause says", path.display())]
    StackFile { path: PathBuf, source: Box<toml::de::Error> },
    #[error("{}: the matrix of patch {patch} has {found} numbers; give nine, row by row", path.display())]
    StackMatrix { path: PathBuf, patch: usize, found: usize },
    #[error("{}: patch {patch} has parent {parent}, which is the image of no patch; name the image of another patch", path.display())]
    StackParent { path: PathBuf, patch: usize, parent: String },
    #[error("{}: patch {patch} lies where the stack that it goes with says; leave its matrix, mask and parent out", path.display())]
    StackRide { path: PathBuf, patch: usize },
    #[error("{}: tau and merge are those of the stack that it goes with; leave them out here", path.display())]
    StackRideKeys { path: PathBuf },
    #[error("{}: goes with {}, which goes with a third stack; name that one", path.display(), host.display())]
    StackHost { path: PathBuf, host: PathBuf },
    #[error("{}: {given}; give --camera for a light field, --mesh or --zoom-to for images", path.display())]
    RenderWhat { path: PathBuf, given: &'static str },
    #[error("{}: frame {index} is not of the first frame's size; crop the frames alike or give --as set", path.display())]
    FrameSize { path: PathBuf, index: usize },
    #[error("{}: the name {name} has control characters, which a bank does not list; choose another", path.display())]
    ControlCharacters { path: PathBuf, name: String },
    #[error("{}: a device on Windows has this name, where a bank could not be read; rename the file", path.display())]
    DeviceName { path: PathBuf },
    #[error("{}: is {found}, not a regular file; name a file", path.display())]
    NotAFile { path: PathBuf, found: &'static str },
    #[error("{}: is a symbolic link to nothing; remove it or make its target", path.display())]
    DanglingLink { path: PathBuf },
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error("{}: names {}, which lies outside of the folder; give --outside if that is meant", path.display(), file.display())]
    Outside { path: PathBuf, file: PathBuf },
    #[error("{}: is not a capture; give codec lightfield a folder with transforms.json (or a model of COLMAP, images.txt and cameras.txt or .bin, OpenMVS's .mvs, Metashape's .xml, or Middlebury's _par.txt), images and mesh.obj, .ply, .glb or .gltf", path.display())]
    NotCapture { path: PathBuf },
    #[error("{}: has no photographs to hold back; give a capture of {needed} and more, or transforms_test.json", path.display())]
    FewViews { path: PathBuf, needed: usize },
    #[error("{}: is a capture, but codec {codec} takes images; give --codec lightfield, or --as set to encode its images", path.display())]
    OnlyImages { path: PathBuf, codec: &'static str },
    #[error("{}: holds a light field, not images; draw it with the command render", path.display())]
    NotImages { path: PathBuf },
    #[error("{}: holds images of codec {codec}, not a light field; give a file that was made from a capture", path.display())]
    NotLight { path: PathBuf, codec: &'static str },
    #[error("{}: cannot be encoded", path.display())]
    Encode { path: PathBuf, source: EncodeError },
    #[error("{}: unsuitable source", path.display())]
    Source { path: PathBuf, source: SourceError },
    #[error("{}: cannot be loaded", path.display())]
    Load { path: PathBuf, source: LoadError },
    #[error("{}: cannot be decoded", path.display())]
    Region { path: PathBuf, source: RegionError },
    #[error("{}: codec {codec} has no {option}; leave out --{option}", path.display())]
    NoSuchPart { path: PathBuf, codec: &'static str, option: &'static str },
    #[error("{}: would write {}, which {} writes already; rename one or use another --out", path.display(), output.display(), first.display())]
    Collision { path: PathBuf, output: PathBuf, first: PathBuf },
    #[error("{}: {found} channels, and that format holds {held}; give --to bc7 or rgba8", path.display())]
    Channels { path: PathBuf, found: u8, held: u8 },
    #[error("{}: cannot be written as a texture ({what}); give another --container", path.display())]
    Texture { path: PathBuf, what: String },
    #[error("{}: exists already{}; give --force to overwrite, or another --out", path.display(), and_more(*more))]
    Exists { path: PathBuf, more: usize },
    #[error("{}: WebP holds at most {most} texels a side; give --to png or tiff, or a --region", path.display())]
    WebpSide { path: PathBuf, most: u32 },
    #[error("{}: there is no tile {},{}; tiles are 0,0 to {},{}", path.display(), tile.0, tile.1, last.0, last.1)]
    NoSuchTile { path: PathBuf, tile: (u32, u32), last: (u32, u32) },
    #[error("{}: cannot be written; check space and permissions, or give another path", path.display())]
    Write { path: PathBuf, source: io::Error },
    #[error("{}: the folder cannot be made; check the path and its permissions", path.display())]
    MakeFolder { path: PathBuf, source: io::Error },
    #[error("{}: an image cannot be drawn; report this as a fault of Texfold", path.display())]
    Draw { path: PathBuf, source: Box<dyn Error + Send + Sync> },
    #[error("no GPU could be used; leave out --gpu, or install a Vulkan driver such as mesa-vulkan-drivers")]
    NoGpu { source: Box<dyn Error + Send + Sync> },
    #[error("{}: cannot be decoded on the GPU; leave out --gpu to decode on the CPU", path.display())]
    Gpu { path: PathBuf, source: Box<dyn Error + Send + Sync> },
    #[error("no GPU could be used; give --cpu, or install a Vulkan driver such as mesa-vulkan-drivers")]
    NoDrawing { source: Box<dyn Error + Send + Sync> },
    #[error("{}: cannot be drawn on the GPU; give --cpu to draw on the CPU", path.display())]
    GpuDrawing { path: PathBuf, source: Box<dyn Error + Send + Sync> },
    #[error("{}: {} failed; take it off PATH to leave its format out", path.display(), program.display())]
    Rival { path: PathBuf, program: PathBuf, source: io::Error },
    #[error("{}: no setting of that format is within {bpp} bits a texel", path.display())]
    NoSetting { path: PathBuf, bpp: f64 },
    #[error("{}: an internal error ({message}); report this as a fault of Texfold, with the file", path.display())]
    Internal { path: PathBuf, message: String },
}

fn and_more(more: usize) -> String {
    if more == 0 { String::new() } else { format!(", and {more} more of the files") }
}

/// The message with all its causes.
pub(crate) fn explain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let message = error.to_string();
        if !text.contains(&message) {
            text.push_str(": ");
            text.push_str(message.trim_end());
        }
        cause = error.source();
    }
    text
}

/// Runs `work`; a panic within becomes an error that names `path`.
pub(crate) fn guarded<R>(
    path: &std::path::Path,
    work: impl FnOnce() -> Result<R, CliError>,
) -> Result<R, CliError> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let message = panic
            .downcast_ref::<&str>()
            .map(|text| (*text).to_owned())
            .or_else(|| panic.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "a panic without a message".to_owned());
        Err(CliError::Internal { path: path.to_owned(), message })
    })
}

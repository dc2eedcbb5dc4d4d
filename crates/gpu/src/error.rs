//! What can go wrong between an encoded texture and its pixels.

use texfold_core::PlaneFormat;
use texfold_shaders::DctProgramError;

/// Why there is no GPU, or why it could not do what was requested.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The environment forbids it.
    #[error("GPU use is switched off; unset TEXFOLD_GPU or set it to \"require\"")]
    Off,
    /// No driver answers.
    #[error(
        "no GPU adapter; install a Vulkan driver, such as mesa-vulkan-drivers for rendering in software, or build \
         with the feature of another backend (metal, dx12, gles)"
    )]
    NoAdapter,
    /// The adapter gives no device.
    #[error("the adapter gave no device; update its driver or choose another adapter")]
    Device(#[from] wgpu::RequestDeviceError),
    /// The adapter cannot sample BC formats.
    #[error(
        "the adapter cannot sample {format:?} blocks; encode with content that it has, or raw (--content raw)"
    )]
    NoBlockCompression {
        /// The format that is missing.
        format: PlaneFormat,
    },
    /// There is no WGSL for such a texture.
    #[error("no shader module is named {module:?}; use versions of the texfold crates that belong together")]
    UnknownModule {
        /// The name that the texture gave.
        module: &'static str,
    },
    /// Planes, parameters and bindings of the texture contradict each other.
    #[error(
        "the GPU form of the texture is inconsistent: {what}; use versions of the texfold crates that belong together"
    )]
    Form {
        /// What does not fit.
        what: &'static str,
    },
    /// A plane does not fit the device.
    #[error("a plane of {width} x {height} texels exceeds the device's {limit} a side; split the image set")]
    PlaneTooLarge {
        /// Columns of the plane.
        width: u32,
        /// Rows of the plane.
        height: u32,
        /// Most texels a side.
        limit: u32,
    },
    /// The textures of a material are more than a shader of the device can read.
    #[error(
        "the textures of the material have {textures} planes, and a shader of the device reads {limit}; ask for a device with a \
         higher max_sampled_textures_per_shader_stage, or draw the material in two passes"
    )]
    TooManyTextures {
        /// Planes of all textures.
        textures: usize,
        /// Most that one shader reads.
        limit: u32,
    },
    /// A material whose maps cannot share tiles.
    #[error(
        "the maps of this material cannot share tiles: {what}; add them as textures, each looked up by itself"
    )]
    Material {
        /// The reason.
        what: &'static str,
    },
    /// The textures of a material cannot stand in one shader.
    #[error("the textures of the material cannot stand in one shader")]
    Paste(#[from] texfold_shaders::PasteError),
    /// The requested image is empty or does not fit the device.
    #[error("an image of {width} x {height} pixels cannot be drawn; request 1 to {limit} a side")]
    ImageSize {
        /// Requested columns.
        width: u32,
        /// Requested rows.
        height: u32,
        /// Most pixels a side.
        limit: u32,
    },
    /// There are no plain texels of an image.
    #[error(
        "image {image} has no plain texels of that kind: sample it with the WGSL of the module {module:?}, encode it for access by \
         block, or, for more than 8 bits a sample, ask for a view without sRGB"
    )]
    NotDecoded {
        /// The requested image.
        image: u32,
        /// The module that samples it.
        module: &'static str,
    },
    /// There is no such image.
    #[error("there is no image {image}; the texture holds {images}, counted from 0")]
    NoSuchImage {
        /// The requested image.
        image: u32,
        /// Images in the texture.
        images: usize,
    },
    /// There is no such mip level.
    #[error("there is no mip level {level}; the image holds {levels}, counted from 0")]
    NoSuchLevel {
        /// The requested level.
        level: u32,
        /// Levels of the image.
        levels: u32,
    },
    /// There is no such channel.
    #[error("there is no channel {channel}; the texture holds {channels}, counted from 0")]
    NoSuchChannel {
        /// The requested channel.
        channel: u8,
        /// Channels of the texture.
        channels: usize,
    },
    /// The rectangle does not lie in the image, or not in its target.
    #[error("the rectangle of the texture in blocks cannot be decoded")]
    Region(#[from] texfold_core::RegionError),
    /// Blocks cannot be decoded into such a texture.
    #[error(
        "blocks of this texture are decoded into {format:?} with the usage STORAGE_BINDING; make such a texture"
    )]
    DctTarget {
        /// The format that is needed.
        format: wgpu::TextureFormat,
    },
    /// A buffer does not fit the device.
    #[error(
        "a buffer of {bytes} bytes exceeds the {limit} that a shader of the device can read; ask for a device with a higher          max_storage_buffer_binding_size, or split the image"
    )]
    StorageTooLarge {
        /// Bytes that are needed.
        bytes: u64,
        /// Most bytes of a buffer that a shader reads.
        limit: u64,
    },
    /// A cache of tiles has no room for a further texture.
    #[error(
        "the cache of tiles has no room: {what}; remove textures, or make the cache with a larger {option}"
    )]
    TilesFull {
        /// The resource that is used up.
        what: &'static str,
        /// The member of `TileOptions` that bounds it.
        option: &'static str,
    },
    /// The device cannot hold a cache of tiles.
    #[error(
        "a cache of tiles needs {limit} of {needed}, and the device was made with {given}; ask for a device with more"
    )]
    TileLimit {
        /// The device limit.
        limit: &'static str,
        /// The needed value.
        needed: u64,
        /// The device's.
        given: u64,
    },
    /// The mesh has an index without a corner, a number that is not finite, or no triangle.
    #[error(
        "the mesh has no triangle, an index without a corner or a number that is not finite; repair the mesh"
    )]
    Mesh,
    /// The device ran out of memory.
    #[error("the device is out of memory; draw smaller images or drop textures that are not in use")]
    OutOfMemory(#[source] wgpu::Error),
    /// The device refused a command.
    #[error("the device refused a command; report it with the adapter's name and its driver's version")]
    Refused(#[source] wgpu::Error),
    /// The device is lost, as after a reset of its driver, or gives nothing back.
    #[error("the device is lost; make a new one and upload again")]
    Lost,
}

impl From<DctProgramError> for GpuError {
    fn from(error: DctProgramError) -> Self {
        match error {
            DctProgramError::Region(error) => GpuError::Region(error),
            DctProgramError::NoSuchChannel { channel, channels } => {
                GpuError::NoSuchChannel { channel, channels }
            }
        }
    }
}

//! Planes, parameters and decoding programs of a texture, for any interface to a GPU.

use std::ffi::{CString, c_char};

use texfold::core::GpuDct;
use texfold_shaders::{DctChannel, DctEntry, DctProgram};

use crate::status::{Failure, Outcome, guarded, kept, put, there};
use crate::{Region, Status, Texture};

/// Planes, parameters and textures in blocks of a texture: copies, which outlive it.
pub struct Gpu {
    module: CString,
    planes: Vec<PlaneKept>,
    uniforms: Vec<u8>,
    bindings: Vec<BindingKept>,
    blocks: Vec<Blocks>,
    decoded: Vec<DecodedInfo>,
}

struct PlaneKept {
    width: u32,
    height: u32,
    levels: u32,
    format: CString,
    data: Vec<u8>,
}

struct BindingKept {
    textures: Vec<u32>,
    offset: u64,
    size: u64,
    image: u32,
}

struct Blocks {
    of: GpuDct<'static>,
    words: Vec<u32>,
    streams: Vec<u8>,
}

/// Calls of the block decoder's functions, with all their parameters.
pub struct Program {
    of: DctProgram,
    dispatches: Vec<Dispatch>,
}

/// Numbers of planes, images and blocks of a texture, and its parameters. Pointers live as long as the object.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct GpuInfo {
    /// Name of the shader that reads its texels: `texfold shaders <module>` writes it.
    pub module: *const c_char,
    /// Textures to upload.
    pub planes: u32,
    /// Images, each with a binding.
    pub images: u32,
    /// Textures in blocks to upload and decode; 0 where texels are read from the planes.
    pub blocks: u32,
    /// Textures that the blocks are decoded to. Of codec "dct" they are the images; of others their texels are made of them by the shader.
    pub decoded: u32,
    /// Parameters of all images.
    pub uniforms: *const u8,
    /// Bytes of the parameters.
    pub uniforms_size: usize,
}

/// A texture to upload. Pointers live as long as the object.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct PlaneInfo {
    /// Columns of level 0.
    pub width: u32,
    /// Rows of level 0.
    pub height: u32,
    /// Mip levels in `data`.
    pub levels: u32,
    /// Format by its name in WebGPU, such as "rgba8unorm", "r32uint" or "bc7-rgba-unorm".
    pub format: *const c_char,
    /// The levels one after the other, largest first, rows without padding.
    pub data: *const u8,
    /// Bytes of `data`.
    pub size: usize,
}

/// A texture that blocks are decoded to.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct DecodedInfo {
    /// Columns of level 0.
    pub width: u32,
    /// Rows of level 0.
    pub height: u32,
    /// Mip levels.
    pub levels: u32,
    /// Bits of a channel: 8 in format rgba8unorm, 16 in rgba16uint. Both have the values of texfold_decode_rgba8 and texfold_decode_rgba16 where
    /// the codec is "dct".
    pub bits: u32,
}

/// Bindings of an image. Pointers live as long as the object.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct BindingInfo {
    /// Numbers of textures in the order of the shader's bindings: planes, and from the number of planes on those that blocks are decoded to.
    pub textures: *const u32,
    /// How many there are.
    pub count: usize,
    /// First byte of the image's parameters in `uniforms`.
    pub uniform_offset: u64,
    /// Bytes of the image's parameters.
    pub uniform_size: u64,
    /// Argument `image` of the shader's functions.
    pub image: u32,
}

/// A texture in blocks of variable length. Pointers live as long as the object.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct BlocksInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Number of the decoded texture that it belongs to.
    pub decoded: u32,
    /// First mip level of the decoded texture that it gives.
    pub level: u32,
    /// Mip levels that it gives.
    pub levels: u32,
    /// Name of the shader that decodes it, as `texfold shaders dct` writes it: "dct-unorm8" or "dct-uint16".
    pub shader: *const c_char,
    /// Storage buffer of group 0, binding 1.
    pub words: *const u32,
    /// Number of words.
    pub words_count: usize,
    /// Storage buffer of group 0, binding 2.
    pub streams: *const u8,
    /// Bytes of the streams, a multiple of 4.
    pub streams_size: usize,
}

/// A dispatch of a program.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Dispatch {
    /// Name of the function. A static string.
    pub entry: *const c_char,
    /// Bind group 0, binding 0 to TexfoldProgramInfo.pass_size from this byte of `passes` on.
    pub pass_offset: u32,
    /// Bind group 1, binding 0 to TexfoldProgramInfo.output_size from this byte of `outputs` on; of write_texels alone.
    pub output_offset: u32,
    /// Mip level to bind in group 1, binding 1, counted from the first that is written; of write_texels alone.
    pub level: u32,
    /// Workgroups.
    pub groups: [u32; 3],
    /// True where scratch memory is filled with zeros before it.
    pub clears: bool,
    /// True of write_texels.
    pub writes: bool,
}

/// A program. Each dispatch reads what those before it wrote to scratch memory; those of write_texels do not depend on one another. Pointers live as long as the object.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct ProgramInfo {
    /// Uniform buffer with the parameters of passes; offsets are multiples of 256.
    pub passes: *const u8,
    /// Its bytes.
    pub passes_size: usize,
    /// Bytes of it that each dispatch binds.
    pub pass_size: usize,
    /// Uniform buffer with the parameters of write_texels; offsets are multiples of 256.
    pub outputs: *const u8,
    /// Its bytes.
    pub outputs_size: usize,
    /// Bytes of it that a dispatch binds.
    pub output_size: usize,
    /// Bytes of scratch memory: storage buffer of group 0, binding 3. More than was allowed only where one superblock needs more alone.
    pub scratch_size: u64,
    /// Dispatches in their order.
    pub dispatches: *const Dispatch,
    /// How many there are.
    pub dispatch_count: usize,
}

/// Copies the planes, parameters and blocks of a texture.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_new(texture: *const Texture, gpu: *mut *mut Gpu) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let texture = unsafe { there(texture, "texture")? };
        let form = texture.image.as_encoded().gpu();
        let plane = |plane: texfold::core::Plane<'_>| PlaneKept {
            width: plane.width,
            height: plane.height,
            levels: plane.levels,
            format: kept(plane.format.name()),
            data: plane.data.into_owned(),
        };
        let binding = |binding: texfold::core::ImageBinding| BindingKept {
            textures: binding.planes.iter().map(|&plane| plane as u32).collect(),
            offset: binding.uniforms.start as u64,
            size: binding.uniforms.len() as u64,
            image: binding.image,
        };
        let blocks = |blocks: GpuDct<'_>| Blocks {
            streams: texfold_shaders::streams(&blocks),
            words: blocks.words,
            of: GpuDct { words: Vec::new(), streams: &[], ..blocks },
        };
        let decoded = form.decoded_images().map(|image| DecodedInfo {
            width: image.size.width,
            height: image.size.height,
            levels: image.levels,
            bits: if image.depth > 8 { 16 } else { 8 },
        });
        let made = Gpu {
            decoded: decoded.collect(),
            module: kept(form.module),
            uniforms: form.uniforms,
            bindings: form.images.into_iter().map(binding).collect(),
            planes: form.planes.into_iter().map(plane).collect(),
            blocks: form.blocks.into_iter().map(blocks).collect(),
        };
        let made = Box::into_raw(Box::new(made));
        // SAFETY: as the crate says; where there is no room for it, it is freed.
        unsafe { put(gpu, made, "gpu").inspect_err(|_| drop(Box::from_raw(made))) }
    })
}

/// Frees what texfold_gpu_new made; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_free(gpu: *mut Gpu) {
    if !gpu.is_null() {
        // SAFETY: it comes from `texfold_gpu_new` and was not freed.
        drop(unsafe { Box::from_raw(gpu) });
    }
}

/// Describes all of it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_info(gpu: *const Gpu, info: *mut GpuInfo) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let gpu = unsafe { there(gpu, "gpu")? };
        let found = GpuInfo {
            module: gpu.module.as_ptr(),
            planes: gpu.planes.len() as u32,
            images: gpu.bindings.len() as u32,
            blocks: gpu.blocks.len() as u32,
            decoded: gpu.decoded.len() as u32,
            uniforms: gpu.uniforms.as_ptr(),
            uniforms_size: gpu.uniforms.len(),
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// The member of that number.
fn numbered<'a, T>(all: &'a [T], number: u32, name: &str) -> Outcome<&'a T> {
    all.get(number as usize).ok_or_else(|| {
        Failure::argument(format!("{name} {number} of {}; give a number below that", all.len()))
    })
}

/// Describes a texture to upload.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_plane(gpu: *const Gpu, plane: u32, info: *mut PlaneInfo) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let plane = numbered(unsafe { &there(gpu, "gpu")?.planes }, plane, "plane")?;
        let found = PlaneInfo {
            width: plane.width,
            height: plane.height,
            levels: plane.levels,
            format: plane.format.as_ptr(),
            data: plane.data.as_ptr(),
            size: plane.data.len(),
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// Describes the bindings of an image.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_binding(gpu: *const Gpu, image: u32, info: *mut BindingInfo) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let binding = numbered(unsafe { &there(gpu, "gpu")?.bindings }, image, "image")?;
        let found = BindingInfo {
            textures: binding.textures.as_ptr(),
            count: binding.textures.len(),
            uniform_offset: binding.offset,
            uniform_size: binding.size,
            image: binding.image,
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// Describes a texture in blocks.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_blocks(gpu: *const Gpu, blocks: u32, info: *mut BlocksInfo) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let blocks = numbered(unsafe { &there(gpu, "gpu")?.blocks }, blocks, "blocks")?;
        let Blocks { of, words, streams } = blocks;
        let found = BlocksInfo {
            width: of.layout.size.width,
            height: of.layout.size.height,
            decoded: of.image as u32,
            level: of.level,
            levels: of.levels,
            shader: if of.layout.depth > 8 { c"dct-uint16" } else { c"dct-unorm8" }.as_ptr(),
            words: words.as_ptr(),
            words_count: words.len(),
            streams: streams.as_ptr(),
            streams_size: streams.len(),
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// Describes a texture that blocks are decoded to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_gpu_decoded(
    gpu: *const Gpu,
    decoded: u32,
    info: *mut DecodedInfo,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let found = *numbered(unsafe { &there(gpu, "gpu")?.decoded }, decoded, "decoded texture")?;
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

/// Dispatches that decode a texture in blocks within `max_scratch` bytes of scratch memory (0: 128 MiB, what every WebGPU device binds;
/// large textures are faster within more): all of its levels, `x` and `y` being 0; or where `region` is not null that rectangle (levels
/// counted from that of the blocks, `image` 0), whose first texel goes to column `x` and row `y` of the target. The functions are in the
/// shader that TexfoldBlocksInfo names.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_program_new(
    gpu: *const Gpu,
    blocks: u32,
    region: *const Region,
    x: u32,
    y: u32,
    max_scratch: u64,
    program: *mut *mut Program,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let (gpu, region) = unsafe { (there(gpu, "gpu")?, region.as_ref()) };
        let Blocks { of, .. } = numbered(&gpu.blocks, blocks, "blocks")?;
        let channels = DctChannel::colours(&of.layout);
        let max_scratch = if max_scratch == 0 { texfold_shaders::MAX_SCRATCH } else { max_scratch };
        let made = match region {
            None if (x, y) != (0, 0) => return Err(Failure::argument("x and y are of a region; give 0")),
            None => DctProgram::levels(&of.layout, channels, of.levels, max_scratch)?,
            Some(region) => {
                let rect = region.within(of.layout.size.at_level(region.level.min(31)));
                DctProgram::new(&of.layout, rect, channels, [x, y], max_scratch)?
            }
        };
        let dispatch = |dispatch: &texfold_shaders::DctDispatch| Dispatch {
            entry: match dispatch.entry {
                DctEntry::Read => c"read_superblocks",
                DctEntry::Transform => c"transform_blocks",
                DctEntry::Predict => c"predict_blocks",
                DctEntry::DeblockColumns => c"deblock_columns",
                DctEntry::DeblockRows => c"deblock_rows",
                DctEntry::Write => c"write_texels",
            }
            .as_ptr(),
            pass_offset: dispatch.pass,
            output_offset: dispatch.output,
            level: dispatch.level,
            groups: dispatch.groups,
            clears: dispatch.clears,
            writes: dispatch.entry == DctEntry::Write,
        };
        let dispatches = made.dispatches.iter().map(dispatch).collect();
        let made = Box::into_raw(Box::new(Program { of: made, dispatches }));
        // SAFETY: as the crate says; where there is no room for it, it is freed.
        unsafe { put(program, made, "program").inspect_err(|_| drop(Box::from_raw(made))) }
    })
}

/// Frees a program; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_program_free(program: *mut Program) {
    if !program.is_null() {
        // SAFETY: it comes from `texfold_program_new` and was not freed.
        drop(unsafe { Box::from_raw(program) });
    }
}

/// Describes a program.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_program_info(program: *const Program, info: *mut ProgramInfo) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let Program { of, dispatches } = unsafe { there(program, "program")? };
        let found = ProgramInfo {
            passes: of.passes.as_ptr(),
            passes_size: of.passes.len(),
            pass_size: texfold_shaders::PASS_BYTES,
            outputs: of.outputs.as_ptr(),
            outputs_size: of.outputs.len(),
            output_size: texfold_shaders::OUTPUT_BYTES,
            scratch_size: of.scratch,
            dispatches: dispatches.as_ptr(),
            dispatch_count: dispatches.len(),
        };
        // SAFETY: as the crate says.
        unsafe { put(info, found, "info") }
    })
}

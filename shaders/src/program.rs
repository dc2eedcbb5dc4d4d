//! The calls of `block.wgsl`'s functions that decode a rectangle, with all their parameters, for any interface to a GPU.

use std::fmt;

use texfold_core::{DCT_LEVELS, DctLayout, GpuChannel, GpuDct, ImageSize, Rect, RegionError};

use crate::{BLOCK_STREAMS, DctPlan};

/// Usual limit of a program's scratch memory in bytes: what every WebGPU device binds. Larger rectangles are decoded in parts, one after another,
/// each of which takes the time of its longest stream: of 12 megatexels at half a bit a texel an H200 decodes 1.15, 1.6
/// and 2 gigatexels/s within 64, 128 and 192 MiB (benches/gpu.md).
pub const MAX_SCRATCH: u64 = 128 << 20;
/// Distance in bytes of parameters in their buffers: what every device allows.
pub const PARAMETER_STRIDE: usize = 256;
/// Bytes of [`DctProgram::passes`] that are bound from a dispatch's offset on: a pass for each plane, of which images of 262144 texels
/// a side have as many.
pub const PASS_BYTES: usize = PASSES * PARAMETER_STRIDE;
/// Bytes of [`DctProgram::outputs`] that are bound from a dispatch's offset on.
pub const OUTPUT_BYTES: usize = size_of::<Output>();

const PASSES: usize = 6;
/// Blocks and axes that a workgroup transforms.
const BLOCKS: u32 = 64;
/// Texels along the side of what a workgroup writes.
const TEXELS: u32 = 8;

/// Content of a channel of a decoded texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DctChannel {
    /// The channel of that number.
    Channel(u8),
    /// Nothing.
    Zero,
    /// The largest sample.
    One,
}

impl DctChannel {
    /// The channels of a texture as an image shows them: gray or colours, and alpha where there are two or four.
    #[must_use]
    pub fn colours(layout: &DctLayout) -> [DctChannel; 4] {
        use DctChannel::{Channel, One};
        match layout.channels.len() {
            1 => [Channel(0), Channel(0), Channel(0), One],
            2 => [Channel(0), Channel(0), Channel(0), Channel(1)],
            3 => [Channel(0), Channel(1), Channel(2), One],
            _ => [Channel(0), Channel(1), Channel(2), Channel(3)],
        }
    }

    /// The shader's parameters of those channels.
    ///
    /// # Errors
    /// [`DctProgramError::NoSuchChannel`].
    pub fn parameters(
        layout: &DctLayout,
        channels: [DctChannel; 4],
    ) -> Result<[GpuChannel; 4], DctProgramError> {
        let constant =
            |value: i32| GpuChannel { mean: value << layout.shift, first_axis: 0, weights: [0; 4] };
        let mut found = [constant(0); 4];
        for (found, channel) in found.iter_mut().zip(channels) {
            *found = match channel {
                DctChannel::Zero => constant(0),
                DctChannel::One => constant((1 << layout.depth) - 1),
                DctChannel::Channel(channel) => {
                    let channels = layout.channels.len();
                    let known = layout.channels.get(usize::from(channel)).copied();
                    known.ok_or(DctProgramError::NoSuchChannel { channel, channels })?
                }
            };
        }
        Ok(found)
    }
}

/// Why a rectangle cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DctProgramError {
    /// There is no such level, or the rectangle is empty or leaves it.
    Region(RegionError),
    /// The texture has fewer channels.
    NoSuchChannel {
        /// The channel.
        channel: u8,
        /// Channels of the texture.
        channels: usize,
    },
}

impl std::error::Error for DctProgramError {}

impl fmt::Display for DctProgramError {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DctProgramError::Region(error) => error.fmt(to),
            DctProgramError::NoSuchChannel { channel, channels } => {
                write!(to, "the texture has {channels} channels, and none of number {channel}")
            }
        }
    }
}

impl From<RegionError> for DctProgramError {
    fn from(error: RegionError) -> Self {
        DctProgramError::Region(error)
    }
}

/// A function of [`crate::block`]'s shader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DctEntry {
    /// Reads the streams of superblocks of all planes.
    Read,
    /// Transforms the blocks of a plane.
    Transform,
    /// Adds intra predictions to the blocks of the image.
    Predict,
    /// Filters borders between columns of blocks.
    DeblockColumns,
    /// Filters borders between rows of blocks.
    DeblockRows,
    /// Writes texels to the target.
    Write,
}

impl DctEntry {
    /// All of them, in the order in which they are first called.
    pub const ALL: [DctEntry; 6] = [
        DctEntry::Read,
        DctEntry::Transform,
        DctEntry::Predict,
        DctEntry::DeblockColumns,
        DctEntry::DeblockRows,
        DctEntry::Write,
    ];

    /// Its name in the shader.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            DctEntry::Read => "read_superblocks",
            DctEntry::Transform => "transform_blocks",
            DctEntry::Predict => "predict_blocks",
            DctEntry::DeblockColumns => "deblock_columns",
            DctEntry::DeblockRows => "deblock_rows",
            DctEntry::Write => "write_texels",
        }
    }
}

/// A dispatch. It reads what those before it wrote to scratch memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DctDispatch {
    /// The function.
    pub entry: DctEntry,
    /// Whether scratch memory is filled with zeros before it.
    pub clears: bool,
    /// Byte of [`DctProgram::passes`] from which [`PASS_BYTES`] are bound in group 0, binding 0.
    pub pass: u32,
    /// Byte of [`DctProgram::outputs`] from which [`OUTPUT_BYTES`] are bound in group 1, binding 0; 0 but for [`DctEntry::Write`].
    pub output: u32,
    /// Mip level that is bound in group 1, binding 1, counted from the first one that is written; 0 but for [`DctEntry::Write`].
    pub level: u32,
    /// Workgroups.
    pub groups: [u32; 3],
}

/// Dispatches, in their order, that decode a rectangle of a texture in blocks, or an image and the mip levels that are made of it.
///
/// Group 0 has [`DctProgram::passes`] (uniform), [`GpuDct::words`], [`streams()`] and scratch memory (storage buffers), group 1
/// [`DctProgram::outputs`] (uniform) and a level of the target (storage texture).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DctProgram {
    /// Parameters of all passes, [`PARAMETER_STRIDE`] bytes each.
    pub passes: Vec<u8>,
    /// Parameters of `write_texels`, [`PARAMETER_STRIDE`] bytes each.
    pub outputs: Vec<u8>,
    /// Bytes of scratch memory.
    pub scratch: u64,
    /// Dispatches.
    pub dispatches: Vec<DctDispatch>,
}

/// Bytes of the streams as the shader reads them: as parts of two words.
#[must_use]
pub fn streams(blocks: &GpuDct<'_>) -> Vec<u8> {
    let mut bytes = blocks.streams.to_vec();
    bytes.resize(bytes.len().next_multiple_of(4) + 8, 0);
    bytes
}

impl DctProgram {
    /// A rectangle, whose first texel goes to `place` in the target. `rect.image` is 0. Scratch memory is at most `max_scratch` bytes
    /// ([`MAX_SCRATCH`]), but for a superblock that needs more alone.
    ///
    /// # Errors
    /// [`DctProgramError`] where there is no such level or channel, or the rectangle is empty or leaves the level.
    pub fn new(
        layout: &DctLayout,
        rect: Rect,
        channels: [DctChannel; 4],
        place: [u32; 2],
        max_scratch: u64,
    ) -> Result<DctProgram, DctProgramError> {
        let channels = DctChannel::parameters(layout, channels)?;
        let mut program = DctProgram::empty();
        for (part, plan) in parts(layout, rect, max_scratch)? {
            let place = [place[0] + part.x - rect.x, place[1] + part.y - rect.y];
            program.decode(&plan, &[(0, Output::new(layout, part, &channels, place))]);
        }
        Ok(program.finished())
    }

    /// The whole image and the levels that are made of it, `levels` in all; the streams are read once.
    ///
    /// # Errors
    /// As [`DctProgram::new`].
    pub fn levels(
        layout: &DctLayout,
        channels: [DctChannel; 4],
        levels: u32,
        max_scratch: u64,
    ) -> Result<DctProgram, DctProgramError> {
        let channels = DctChannel::parameters(layout, channels)?;
        let size = layout.size;
        let stored = size.full_levels().min(DCT_LEVELS);
        if levels > stored {
            return Err(RegionError::NoSuchLevel { level: levels - 1, levels: stored }.into());
        }
        let rect = Rect { image: 0, level: 0, x: 0, y: 0, width: size.width, height: size.height };
        let mut program = DctProgram::empty();
        for (part, plan) in parts(layout, rect, max_scratch)? {
            let outputs = (0..levels).map(|level| {
                let part = reduced(part, size, level);
                (level, Output::new(layout, part, &channels, [part.x, part.y]))
            });
            let outputs: Vec<_> = outputs.filter(|(_, output)| !output.size.contains(&0)).collect();
            program.decode(&plan, &outputs);
        }
        Ok(program.finished())
    }

    fn empty() -> DctProgram {
        DctProgram { passes: Vec::new(), outputs: Vec::new(), scratch: 0, dispatches: Vec::new() }
    }

    /// Behind the last pass what is bound with it.
    fn finished(mut self) -> DctProgram {
        self.passes.resize(self.passes.len() + PASS_BYTES - PARAMETER_STRIDE, 0);
        self
    }

    /// Does the passes of a plan and writes outputs of what they decode.
    fn decode(&mut self, plan: &DctPlan, outputs: &[(u32, Output)]) {
        self.scratch = self.scratch.max(4 * plan.words);
        let first = self.passes.len() as u32;
        let streams = plan.passes.iter().map(|pass| pass.count[0] * pass.count[1]).max().unwrap_or(0);
        let dispatch = |entry, pass, groups| DctDispatch {
            entry,
            clears: entry == DctEntry::Read,
            pass,
            output: 0,
            level: 0,
            groups,
        };
        let groups = [streams.div_ceil(BLOCK_STREAMS), plan.passes.len() as u32, 1];
        self.dispatches.push(dispatch(DctEntry::Read, first, groups));
        let mut offset = first;
        for pass in &plan.passes {
            offset = self.passes.len() as u32;
            push(&mut self.passes, pass);
            let blocks = pass.held[0] * pass.held[1] * pass.axes;
            let groups = [blocks.div_ceil(BLOCKS), 1, 1];
            self.dispatches.push(dispatch(DctEntry::Transform, offset, groups));
            if pass.has_modes() {
                let superblocks = pass.count[0] * pass.count[1];
                let groups = [superblocks.div_ceil(BLOCK_STREAMS), pass.axes, 1];
                self.dispatches.push(dispatch(DctEntry::Predict, offset, groups));
            }
            if pass.deblocking > 0 {
                self.dispatches.push(dispatch(DctEntry::DeblockColumns, offset, groups));
                self.dispatches.push(dispatch(DctEntry::DeblockRows, offset, groups));
            }
        }
        for (level, output) in outputs {
            let [width, height] = output.size.map(|side| side.div_ceil(TEXELS));
            self.dispatches.push(DctDispatch {
                output: self.outputs.len() as u32,
                level: *level,
                ..dispatch(DctEntry::Write, offset, [width, height, 1])
            });
            push(&mut self.outputs, output);
        }
    }
}

/// Parameters behind others.
fn push(to: &mut Vec<u8>, parameters: &impl bytemuck::NoUninit) {
    to.extend_from_slice(bytemuck::bytes_of(parameters));
    to.resize(to.len().next_multiple_of(PARAMETER_STRIDE), 0);
}

/// The shader's parameters of `write_texels`: 36 words.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Output {
    size: [u32; 2],
    origin: [u32; 2],
    place: [u32; 2],
    shift: u32,
    largest: i32,
    means: [i32; 4],
    first_axes: [u32; 4],
    weights: [[i32; 4]; 4],
    last: [u32; 2],
    reduce_log2: u32,
    average: u32,
}

impl Output {
    fn new(layout: &DctLayout, rect: Rect, channels: &[GpuChannel; 4], place: [u32; 2]) -> Output {
        Output {
            size: [rect.width, rect.height],
            origin: [rect.x, rect.y],
            place,
            shift: layout.shift,
            largest: (1 << layout.depth) - 1,
            means: channels.map(|channel| channel.mean),
            first_axes: channels.map(|channel| channel.first_axis),
            weights: channels.map(|channel| channel.weights),
            last: [layout.size.width - 1, layout.size.height - 1],
            reduce_log2: rect.level,
            average: layout.average.bits(),
        }
    }
}

/// Place of a part of an image of that size in a level whose texels are means of squares of its samples. Parts are cut where
/// superblocks are: at multiples of such squares.
fn reduced(part: Rect, size: ImageSize, level: u32) -> Rect {
    let few = size.at_level(level);
    let cut = |first: u32, count: u32, all: u32, few: u32| {
        let start = first >> level;
        let end = if first + count >= all { few } else { (first + count) >> level };
        (start, end.saturating_sub(start))
    };
    let (x, width) = cut(part.x, part.width, size.width, few.width);
    let (y, height) = cut(part.y, part.height, size.height, few.height);
    Rect { level, x, y, width, height, ..part }
}

/// Parts of a rectangle that need at most so many bytes each, cut where superblocks are.
fn parts(layout: &DctLayout, rect: Rect, max_scratch: u64) -> Result<Vec<(Rect, DctPlan)>, RegionError> {
    let texels = layout.superblock_texels(DctPlan::new(layout, rect)?.reduce_log2);
    let mut open = vec![rect];
    let mut done = Vec::new();
    while let Some(rect) = open.pop() {
        let plan = DctPlan::new(layout, rect)?;
        let [columns, rows] = plan.passes.last().map_or([1, 1], |pass| pass.count);
        if 4 * plan.words <= max_scratch || columns * rows <= 1 {
            done.push((rect, plan));
        } else if rows > 1 {
            let middle = (rect.y / texels + rows / 2) * texels - rect.y;
            open.push(Rect { y: rect.y + middle, height: rect.height - middle, ..rect });
            open.push(Rect { height: middle, ..rect });
        } else {
            let middle = (rect.x / texels + columns / 2) * texels - rect.x;
            open.push(Rect { x: rect.x + middle, width: rect.width - middle, ..rect });
            open.push(Rect { width: middle, ..rect });
        }
    }
    Ok(done)
}

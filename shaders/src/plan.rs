//! Which superblocks a rectangle of a texture needs, and where `block.wgsl` holds what it decodes of them.

use std::ops::Range;

use texfold_core::{DCT_LEVELS, DctLayout, ImageSize, Rect, RegionError, dct_planes};

/// Texels along a block's side.
const SIDE: u32 = 8;
/// Samples of a block, and words that the decoder holds for it.
pub const BLOCK_WORDS: u32 = 64;
/// Words that the decoder keeps of a block's axis beside its coefficients: the symbol of their number and the block's intra mode behind 8 bits, then in two words each
/// which of them are not zero and what signs those have.
pub const BLOCK_NOTES: u32 = 5;
/// Streams that a workgroup of `read_superblocks` reads, one an invocation. Lanes of a GPU wait for the longest of their streams and
/// for one another's memory: few lanes are faster.
pub const BLOCK_STREAMS: u32 = 8;
/// First word of the tables of probabilities of a texture whose words begin at 0: behind what all textures share.
pub const DCT_TABLES: u32 = 144;
/// Most axes of a texture: their places in their groups take two bits each of a word.
const MAX_AXES: usize = 16;

/// What the decoder does of one plane, as the shader's uniform block holds it: 34 words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct DctPass {
    /// Columns and rows of blocks of the whole plane.
    pub plane_blocks: [u32; 2],
    /// Column and row of the first superblock to decode.
    pub first: [u32; 2],
    /// Columns and rows of superblocks to decode.
    pub count: [u32; 2],
    /// Columns and rows of blocks to decode.
    pub held: [u32; 2],
    /// Column and row of the first sample that is held of the base.
    pub base_first: [u32; 2],
    /// Columns and rows of blocks that are held of the base.
    pub base_held: [u32; 2],
    /// Columns and rows of blocks of all superblocks of the plane.
    pub wrap: [u32; 2],
    /// Columns and rows of samples of all superblocks of the base.
    pub base_wrap: [u32; 2],
    /// Superblocks in a row of the plane.
    pub superblock_columns: u32,
    /// Number of the plane's first superblock in the index.
    pub superblock_start: u32,
    /// Blocks along a superblock's side.
    pub side: u32,
    /// Axes.
    pub axes: u32,
    /// Place of each axis in its group, two bits each.
    pub ranks: u32,
    /// 1 where finer planes build on this one, else 0.
    pub is_base: u32,
    /// 1 where means come from a base, else 0.
    pub has_base: u32,
    /// Where samples are held: first word of the first block.
    pub samples: u32,
    /// Where the notes of blocks and axes are held, [`BLOCK_NOTES`] words each.
    pub notes: u32,
    /// Where the base's samples are held.
    pub base_samples: u32,
    /// First word of the steps.
    pub steps: u32,
    /// Both reconstruction offsets, 8 bits each; bit 16 where quantisers are dependent, bit 17 where blocks of the image have intra modes.
    pub offsets: u32,
    /// First word of the index.
    pub index: u32,
    /// Bits of a length in the index.
    pub index_bits: u32,
    /// Bytes of all superblocks.
    pub stream_bytes: u32,
    /// Largest jump across a border of blocks that is taken away from first axes; 0 where nothing is filtered.
    pub deblocking: i32,
    /// First word of the tables of probabilities.
    pub tables: u32,
    /// First byte of the streams.
    pub streams: u32,
}

impl DctPass {
    /// Whether blocks of the plane may have intra modes.
    #[must_use]
    pub fn has_modes(&self) -> bool {
        self.is_base == 0 && self.offsets >> 17 & 1 == 1
    }
}

/// What a rectangle needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DctPlan {
    /// What is decoded, in this order: the coarsest plane first, the rectangle's own last.
    pub passes: Vec<DctPass>,
    /// Words of memory that the decoder needs, all 0 before the first pass.
    pub words: u64,
    /// Binary logarithm of the samples along a texel's side, 0 to 2: a texel is their mean.
    pub reduce_log2: u32,
}

/// Columns and rows of superblocks.
type Superblocks = [Range<u32>; 2];

impl DctPlan {
    /// What a rectangle of one of the [`DCT_LEVELS`] levels needs; `rect.image` is 0.
    ///
    /// # Errors
    /// [`RegionError`] where there is no such level, or the rectangle is empty or leaves it.
    pub fn new(layout: &DctLayout, rect: Rect) -> Result<DctPlan, RegionError> {
        check(layout, rect)?;
        let reduce_log2 = rect.level;
        let planes = dct_planes(layout.size);
        let texels = layout.superblock_texels(reduce_log2);
        let cover = |first: u32, count: u32| first / texels..(first + count).div_ceil(texels);
        let mut superblocks = [cover(rect.x, rect.width), cover(rect.y, rect.height)];
        let mut needed = Vec::new();
        for plane in 0..planes.len() {
            let base = planes.get(plane + 1).copied();
            let wider = base.map(|base| base_of(layout, plane, &superblocks, base));
            needed.push((plane, superblocks.clone()));
            superblocks = wider.unwrap_or(superblocks);
        }
        let (passes, words) = passes(layout, &planes, &needed);
        Ok(DctPlan { passes, words, reduce_log2 })
    }
}

fn check(layout: &DctLayout, rect: Rect) -> Result<(), RegionError> {
    if rect.image != 0 {
        return Err(RegionError::NoSuchImage { image: rect.image, images: 1 });
    }
    let levels = layout.size.full_levels().min(DCT_LEVELS);
    if rect.level >= levels {
        return Err(RegionError::NoSuchLevel { level: rect.level, levels });
    }
    let inside = |first: u32, count: u32, all: u32| {
        count > 0 && first.checked_add(count).is_some_and(|end| end <= all)
    };
    let ImageSize { width, height } = layout.size.at_level(rect.level);
    if !inside(rect.x, rect.width, width) || !inside(rect.y, rect.height, height) {
        return Err(RegionError::Outside { width, height });
    }
    Ok(())
}

/// The superblocks of a plane's base that hold the means of blocks of its superblocks, and those a mean around them.
fn base_of(layout: &DctLayout, plane: usize, superblocks: &Superblocks, base: ImageSize) -> Superblocks {
    let side = (1u32 << layout.plane_log2(plane)) / SIDE;
    let texels = 1u32 << layout.plane_log2(plane + 1);
    let cover = |range: &Range<u32>, all: u32| {
        let first = (range.start * side).saturating_sub(1);
        let last = (range.end * side + 1).min(all);
        first / texels..last.div_ceil(texels)
    };
    [cover(&superblocks[0], base.width), cover(&superblocks[1], base.height)]
}

/// The passes from the coarsest plane on, and the words that they need.
fn passes(layout: &DctLayout, planes: &[ImageSize], needed: &[(usize, Superblocks)]) -> (Vec<DctPass>, u64) {
    let count = |(plane, &size)| superblock_count(layout, plane, size).iter().product();
    let counts: Vec<u32> = planes.iter().enumerate().map(count).collect();
    // The first block's words stay 0: what lies beyond a border is read there.
    let mut next = u64::from(BLOCK_WORDS);
    let mut passes: Vec<DctPass> = Vec::new();
    for (plane, superblocks) in needed.iter().rev() {
        let mut pass = pass(layout, *plane, planes[*plane], superblocks);
        // The coarsest plane's superblocks come first.
        pass.superblock_start = counts[*plane + 1..].iter().sum();
        pass.is_base = u32::from(*plane > 0);
        pass.deblocking = if *plane > 0 { 0 } else { layout.deblocking };
        pass.steps = layout.steps + BLOCK_WORDS * *plane as u32;
        pass.samples = next as u32;
        if let Some(base) = passes.last() {
            pass.has_base = 1;
            pass.base_first = base.first.map(|first| first * base.side * SIDE);
            (pass.base_held, pass.base_samples) = (base.held, base.samples);
            pass.base_wrap = base.wrap.map(|blocks| blocks * SIDE);
        }
        let blocks = u64::from(pass.held[0]) * u64::from(pass.held[1]) * u64::from(pass.axes);
        next += u64::from(BLOCK_WORDS) * blocks;
        pass.notes = next as u32;
        next += u64::from(BLOCK_NOTES) * blocks;
        passes.push(pass);
    }
    (passes, next)
}

/// A pass but for what depends on other planes.
fn pass(layout: &DctLayout, plane: usize, size: ImageSize, superblocks: &Superblocks) -> DctPass {
    let side = (1u32 << layout.plane_log2(plane)) / SIDE;
    let all = superblock_count(layout, plane, size);
    let plane_blocks = [size.width.div_ceil(SIDE), size.height.div_ceil(SIDE)];
    let held = |axis: usize| {
        let range = &superblocks[axis];
        (range.end * side).min(plane_blocks[axis]) - range.start * side
    };
    DctPass {
        plane_blocks,
        first: [superblocks[0].start, superblocks[1].start],
        count: [superblocks[0].len() as u32, superblocks[1].len() as u32],
        held: [held(0), held(1)],
        wrap: all.map(|count| count * side),
        superblock_columns: all[0],
        side,
        axes: layout.ranks.len().min(MAX_AXES) as u32,
        ranks: layout.packed_ranks(),
        offsets: layout.packed_offsets(),
        index: layout.index,
        index_bits: layout.index_bits,
        stream_bytes: layout.stream_bytes,
        tables: DCT_TABLES,
        ..DctPass::default()
    }
}

/// Columns and rows of superblocks of a plane.
fn superblock_count(layout: &DctLayout, plane: usize, size: ImageSize) -> [u32; 2] {
    let texels = 1u32 << layout.plane_log2(plane);
    [size.width.div_ceil(texels), size.height.div_ceil(texels)]
}

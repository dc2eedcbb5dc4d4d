//! Epitome textures with pseudo-random maps and content, by way of their file format.

use super::residual::Residual;
use texfold_bc::Content;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::rng::Rng;
use texfold_core::{Budget, ImageLayout, ImageSize, Notes, TextureCodec};
use texfold_epitome::decode::TEXFOLD_EPITOME_FINE_LEVELS;
use texfold_epitome::{Epitome, EpitomeTexture, GainOffset, IDENTITY, Matrix, NEUTRAL};

/// Odd ones, several of one size, and one that is smaller than a leaf.
const SIZES: [(u32, u32); 6] = [(37, 61), (64, 40), (5, 3), (37, 61), (1, 1), (101, 33)];
/// Columns and rows of the first and the second epitome, multiples of 8 texels or more.
const EPITOMES: [(u32, u32); 2] = [(128, 64), (48, 80)];
/// Mip levels of an epitome that has any, its full size among them.
const PLANE_LEVELS: u32 = 2;

/// Mirrors, rotations by quarter turns and by 45 and 30 degrees, scales, squeezes and a shear.
const MATRICES: [Matrix; 16] = [
    IDENTITY,
    [-8192, 0, 0, 8192],
    [4096, 0, 0, 8192],
    [16384, 0, 0, 16384],
    [8192, 0, 0, -8192],
    [0, 8192, -8192, 0],
    [4096, 0, 0, 4096],
    [2048, 0, 0, 2048],
    [0, -8192, 8192, 0],
    [-8192, 0, 0, -8192],
    [0, 8192, 8192, 0],
    [8192, 0, 0, 2048],
    [5793, -5793, 5793, 5793],
    [7094, 4096, -4096, 7094],
    [0, -4096, 2048, 0],
    [8192, 3000, -1234, 9876],
];

/// What to forge.
#[derive(Clone, Copy)]
pub(crate) struct Forge {
    /// Columns and rows of the images.
    pub(crate) sizes: &'static [(u32, u32)],
    pub(crate) levels: u32,
    pub(crate) channels: u8,
    pub(crate) normal: bool,
    /// One epitome of each.
    pub(crate) contents: &'static [Content],
    /// A further epitome with a residual plane: base and rate model.
    pub(crate) residual: Option<Residual>,
    /// Coarse mip levels in BC7 beside BC1.
    pub(crate) finer: bool,
    pub(crate) block: u32,
    pub(crate) split: bool,
    /// Of column, row, their fraction, gain and offset and 2x2 matrix.
    pub(crate) bits: [u32; 5],
    /// Half the width of the seams in which leaves are blended, in eighths of a texel; 4 is the least.
    pub(crate) seam_width: u32,
}

impl Default for Forge {
    fn default() -> Self {
        Forge {
            sizes: &SIZES,
            levels: 1,
            channels: 3,
            normal: false,
            contents: &[Content::Raw],
            residual: None,
            finer: false,
            block: 32,
            split: true,
            bits: [9, 8, 2, 4, 4],
            seam_width: 4,
        }
    }
}

impl Forge {
    /// All mip levels of the largest image.
    pub(crate) fn with_mips(self) -> Self {
        Forge { levels: 7, ..self }
    }

    /// Blocks of 12 texels.
    pub(crate) fn unsplit(self) -> Self {
        Forge { block: 12, split: false, ..self }
    }

    /// How levels that are not read from the epitome are stored.
    pub(crate) fn coarse(&self) -> Content {
        match (self.stored().next().unwrap(), self.channels) {
            (Content::Raw, 1) => Content::Bc4,
            (Content::Raw, 2) => Content::Bc5,
            (Content::Raw, _) => Content::Bc7,
            (Content::Bc1, _) if self.finer => Content::Bc7,
            (other, _) => other,
        }
    }

    /// What the epitomes are stored as, that with a residual plane by its base.
    fn stored(&self) -> impl Iterator<Item = Content> {
        let base = self.residual.map(|residual| residual.content);
        self.contents.iter().copied().chain(base)
    }

    fn pixel(&self) -> PixelInfo {
        let alpha = if matches!(self.channels, 2 | 4) { Alpha::Straight } else { Alpha::Opaque };
        let color = if self.normal { ColorSpace::Normal } else { ColorSpace::Srgb };
        PixelInfo { channels: self.channels, depth: Depth::Eight, color, alpha }
    }

    fn form(&self, matrices: usize, gain_offsets: usize) -> Vec<u8> {
        let mips = self.levels > 1;
        let head = [self.block, u32::from(self.split)].into_iter().chain(self.bits);
        let flags =
            u32::from(mips) | if self.seam_width > 4 { 4 } else { 0 } | if self.finer { 8 } else { 0 };
        let flags = flags | if self.residual.is_some() { 2 } else { 0 };
        let head = head.chain([flags, self.stored().count() as u32]);
        let mut form: Vec<u8> = head.map(|value| value as u8).collect();
        for (content, (width, height)) in self.stored().zip(EPITOMES) {
            form.push(content.number());
            form.extend([width, height].into_iter().flat_map(u32::to_le_bytes));
        }
        form.extend([matrices as u32, gain_offsets as u32].into_iter().flat_map(u32::to_le_bytes));
        form.extend((self.seam_width > 4).then_some(self.seam_width as u8));
        form
    }

    /// How each block is split, and the number of leaves.
    fn trees(&self, images: &[ImageSize], rng: &mut Rng) -> (Vec<u8>, u32) {
        let across = |side: u32| side.div_ceil(self.block);
        let blocks = images.iter().map(|size| across(size.width) * across(size.height)).sum();
        if !self.split {
            return (Vec::new(), blocks);
        }
        let trees: Vec<u8> =
            (0..blocks).map(|_| if rng.below(4) == 0 { 0 } else { 1 | (rng.below(16) as u8) << 1 }).collect();
        let leaves = |tree: &u8| if *tree == 0 { 1 } else { 4 + 3 * (tree >> 1).count_ones() };
        let count = trees.iter().map(leaves).sum();
        (trees, count)
    }

    /// Entries with any place in their epitome, byte plane by byte plane, places as what differs from the one before.
    fn entries(&self, leaves: u32, palettes: [usize; 2], rng: &mut Rng) -> Vec<u8> {
        let [x_bits, y_bits, fraction, ..] = self.bits;
        let mut planes: [Vec<u8>; 7] = Default::default();
        let mut before = [0u32; 2];
        for _ in 0..leaves {
            let plane = rng.below(self.stored().count() as u32);
            let (width, height) = EPITOMES[plane as usize];
            let place = [
                rng.below((width << fraction).min(1 << x_bits)),
                rng.below((height << fraction).min(1 << y_bits)),
            ];
            let step = [0, 1].map(|axis| (place[axis].wrapping_sub(before[axis]) as u16).to_le_bytes());
            before = place;
            let numbers = palettes.map(|count| rng.below(count as u32) as u8);
            let bytes = [step[0][0], step[0][1], step[1][0], step[1][1], numbers[1], numbers[0], plane as u8];
            planes.iter_mut().zip(bytes).for_each(|(plane, byte)| plane.push(byte));
        }
        planes.concat()
    }

    /// The planes of all levels of an image or an epitome; a level of 1 x 1 texels is repeated.
    fn content(&self, content: Content, sizes: impl Iterator<Item = (u32, u32)>, rng: &mut Rng) -> Vec<u8> {
        let formats = content.formats(self.pixel()).0;
        let (mut bytes, mut last) = (Vec::new(), None);
        for (width, height) in sizes {
            if last != Some((1, 1)) {
                bytes.push(
                    rng.bytes(formats.iter().map(|format| format.bytes(width, height)).sum::<u64>() as usize),
                );
            } else if let Some(level) = bytes.last().cloned() {
                bytes.push(level);
            }
            last = Some((width, height));
        }
        bytes.concat()
    }
}

/// Pairs of every gain and offset, the neutral one first.
fn gain_offsets(count: u32, rng: &mut Rng) -> Vec<GainOffset> {
    let random = |_| [(); 6].map(|()| rng.below(256) as u8);
    std::iter::once(NEUTRAL).chain((1..count).map(random)).collect()
}

/// A texture with a pseudo-random map into pseudo-random epitomes.
pub(crate) fn epitome(forge: &Forge) -> EpitomeTexture {
    let [.., gain_offset_bits, matrix_bits] = forge.bits;
    let mut rng = Rng::new(
        u64::from(gain_offset_bits) + 10 * u64::from(forge.block) + 1000 * u64::from(forge.channels),
    );
    let images: Vec<_> = forge.sizes.iter().map(|&(width, height)| ImageSize { width, height }).collect();
    let matrices = &MATRICES[..MATRICES.len().min(1 << matrix_bits)];
    let gain_offsets = gain_offsets(1 << gain_offset_bits, &mut rng);
    let (trees, leaves) = forge.trees(&images, &mut rng);
    let entries = forge.entries(leaves, [matrices.len(), gain_offsets.len()], &mut rng);
    let plane_levels = if forge.levels > 1 { PLANE_LEVELS } else { 1 };
    let mut planes = Vec::new();
    for (&content, (width, height)) in forge.contents.iter().zip(EPITOMES) {
        let sizes = (0..plane_levels).map(|level| (width >> level, height >> level));
        planes.extend(forge.content(content, sizes, &mut rng));
    }
    let mut coarse = Vec::new();
    for size in &images {
        let sizes = (TEXFOLD_EPITOME_FINE_LEVELS..forge.levels).map(|level| size.at_level(level));
        let sizes = sizes.map(|size| (size.width, size.height));
        coarse.extend(forge.content(forge.coarse(), sizes, &mut rng));
    }
    let mut out = SectionWriter::new(Epitome::ID);
    Notes::default().write(&mut out);
    write_layout(&ImageLayout::new(images, forge.levels, forge.pixel()), &mut out);
    out.section("container", *b"EPFM", &forge.form(matrices.len(), gain_offsets.len()));
    let palettes = matrices.as_flattened().iter().flat_map(|value| value.to_le_bytes());
    out.section("map", *b"EPPL", &palettes.chain(gain_offsets.concat()).collect::<Vec<u8>>());
    out.section("map", *b"EPTR", &trees);
    out.section("map", *b"EPEN", &entries);
    if !planes.is_empty() {
        out.section("epitome", *b"EPAT", &planes);
    }
    if let Some(residual) = forge.residual {
        let (width, height) = EPITOMES[forge.contents.len()];
        let size = ImageSize { width, height };
        residual.store(&[size], plane_levels, forge.pixel(), &mut rng, &mut out);
    }
    if !coarse.is_empty() {
        out.section("mips", *b"EPMC", &coarse);
    }
    let bytes = out.finish().bytes;
    let mut budget = Budget::default();
    let sections = Sections::parse(&bytes, &mut budget).unwrap();
    Epitome::load(&sections, &mut budget).unwrap()
}

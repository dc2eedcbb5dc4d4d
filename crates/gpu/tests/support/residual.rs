//! Residual content with pseudo-random bases, rate models and bits, as sections of any codec's file.

use texfold_bc::Content;
use texfold_core::ImageSize;
use texfold_core::container::SectionWriter;
use texfold_core::image::PixelInfo;
use texfold_core::rng::Rng;

/// What a base says of the texels beyond its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Edge {
    /// Its outermost texels are repeated.
    Repeated,
    /// It is four texels larger on each side.
    Padded,
    /// Every block ends at its own border.
    Isolated,
}

/// What residual content is like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residual {
    /// Texel data of the base.
    pub(crate) content: Content,
    /// Log2 downscale of the base.
    pub(crate) reduce_log2: u32,
    /// Levels that are not stored.
    pub(crate) shrink_log2: u32,
    pub(crate) edge: Edge,
    /// Log2 factor of alpha's contrast.
    pub(crate) alpha_gain_log2: u32,
    /// Bits of a block of class 1; 0 for no residual plane, 32 also for luma and chroma that are turned.
    pub(crate) class_bits: u32,
}

/// Bits of coefficients by class, for a class of 16 bits more than the one before: each kind has some.
const CLASSES: [u32; 16] = [
    0, 0x11, 0x2_0011, 0x111, 0x1111, 0x2_1111, 0x4_1111, 0x13_1111, 0x2222, 0x100_0111, 0x11_2222,
    0x102_0122, 0x104_1111, 0x3344, 0x202_0011, 0x200_0111,
];
/// The same for classes of 32 bits more each: three bits for a kind that has at most two above.
const WIDE_CLASSES: [u32; 11] = [
    0, 0x2_0011, 0x1111, 0x4_1111, 0x2222, 0x11_2222, 0x104_1111, 0x202_0011, 0x200_1111, 0x300_0000,
    0x300_0022,
];

/// How luma and chroma are turned: 300, -200 and -511 times 1/511.
const AXES: u32 = 300 | (1024 - 200) << 10 | (1024 - 511) << 20;

impl Residual {
    fn form(&self, classes: &[u32]) -> Vec<u8> {
        let flags = match self.edge {
            Edge::Repeated => 0,
            Edge::Isolated => 16,
            Edge::Padded => 32,
        };
        let mut form = vec![
            self.content.number(),
            (self.reduce_log2 | self.shrink_log2 << 2 | self.alpha_gain_log2 << 6) as u8 | flags,
            (self.class_bits / 16) as u8 | if self.is_turned() { 16 } else { 0 },
        ];
        form.extend([300u16, 250, 180, 120, 200, 90, 70].into_iter().flat_map(u16::to_le_bytes));
        let classes = (0..16).map(|number| classes.get(number).copied().unwrap_or(0));
        form.extend(classes.flat_map(u32::to_le_bytes));
        if self.is_turned() {
            form.extend(AXES.to_le_bytes());
        }
        form
    }

    fn is_turned(&self) -> bool {
        self.class_bits == 32
    }

    /// Writes the sections of `levels` levels of images of those sizes, base and residual plane.
    pub(crate) fn store(
        &self,
        images: &[ImageSize],
        levels: u32,
        pixel: PixelInfo,
        rng: &mut Rng,
        out: &mut SectionWriter,
    ) {
        let classes: &[u32] = match self.class_bits {
            16 => &CLASSES,
            32 => &WIDE_CLASSES,
            _ => &[0],
        };
        let (mut planes, mut maps) = (Vec::new(), Vec::new());
        for size in images {
            planes.extend(self.base(*size, levels, pixel, rng));
            let sides =
                |level| (size.at_level(level).width.div_ceil(8), size.at_level(level).height.div_ceil(8));
            let blocks: u32 = (0..levels).map(sides).map(|(columns, rows)| columns * rows).sum();
            let chosen: Vec<u8> = (0..blocks).map(|_| rng.below(classes.len() as u32) as u8).collect();
            let halves: u32 =
                chosen.iter().map(|&class| u32::from(class)).sum::<u32>() * self.class_bits / 16;
            let scales: Vec<u8> = (0..blocks).map(|_| rng.below(13) as u8).collect();
            for numbers in [&chosen, &scales] {
                maps.extend(numbers.chunks(2).map(|pair| pair[0] | pair.get(1).copied().unwrap_or(0) << 4));
            }
            maps.extend(rng.bytes(2 * halves as usize));
        }
        out.section("container", *b"RSF0", &self.form(classes));
        out.section("base", *b"RSB0", &planes);
        if self.class_bits > 0 {
            out.section("residual plane", *b"RSP0", &maps);
        }
    }

    /// Planes of the base of one image.
    fn base(&self, size: ImageSize, levels: u32, pixel: PixelInfo, rng: &mut Rng) -> Vec<u8> {
        // Four texels of the base on each side.
        let more = if self.edge == Edge::Padded { 8 << self.reduce_log2 } else { 0 };
        let whole = ImageSize { width: size.width + more, height: size.height + more };
        let held = levels.min(size.at_level(self.reduce_log2).full_levels());
        let level = |level| whole.at_level(self.reduce_log2 + level);
        let formats = self.content.formats(pixel).0;
        let mut planes = Vec::new();
        for level in (0..held).map(level) {
            for format in &formats {
                planes.extend(rng.bytes(format.bytes(level.width, level.height) as usize));
            }
        }
        planes
    }
}

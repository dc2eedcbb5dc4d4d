//! Progressive textures with pseudo-random bases, models and bits, by way of their file format.

use texfold_bc::Content;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::rng::Rng;
use texfold_core::{Budget, ImageLayout, ImageSize, Notes, TextureCodec};

use super::residual::{Edge, Residual};
use texfold_progressive::{Codebook, Progressive, ProgressiveTexture};

/// What a texture is like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Base {
    pub(crate) sizes: &'static [(u32, u32)],
    pub(crate) levels: u32,
    pub(crate) channels: u8,
    pub(crate) content: Content,
    /// Log2 downscale of the base's width and height.
    pub(crate) reduce_log2: u32,
    /// Levels that are not stored.
    pub(crate) shrink_log2: u32,
    /// Whether the base goes on beyond the borders.
    pub(crate) beyond: bool,
    /// Log2 factor of alpha's contrast.
    pub(crate) alpha_gain_log2: u32,
    /// Bits of a block of class 1; 0 for no residual plane.
    pub(crate) class_bits: u32,
    /// Codebooks and a map, where there are any: binary logarithm of a block's side, bits of a rotation, and content of a public
    /// codebook of 64x64 texels and a private one of 32x64 behind it.
    pub(crate) books: Option<(u32, u32, Content)>,
}

/// Rows of both codebooks.
const ROWS: u32 = 128;

/// A codebook of pseudo-random cells.
fn codebook(content: Content, width: u32, cells: usize, rng: &mut Rng) -> Codebook {
    let mut cell = || rng.bytes(1024).into_iter().map(|byte| f32::from(byte) / 127.5 - 1.0).collect();
    let cells: Vec<Vec<f32>> = (0..cells).map(|_| cell()).collect();
    Codebook::of_cells(content, width, &cells).unwrap()
}

/// Sections of codebooks and map; the public codebook is returned.
fn store_books(
    (side_log2, rotation_bits, content): (u32, u32, Content),
    images: &[ImageSize],
    levels: u32,
    rng: &mut Rng,
    out: &mut SectionWriter,
) -> Codebook {
    let public = codebook(content, 64, 4, rng);
    let private = codebook(content, 32, 2, rng);
    let mut raw = vec![content.number()];
    raw.extend(&private.planes().planes()[0].1);
    out.section("codebook", *b"PRCB", &raw);
    let sizes = [64u32, 64, 32, 64];
    let mut raw: Vec<u8> = sizes.into_iter().flat_map(u32::to_le_bytes).collect();
    raw.extend(public.checksum().to_le_bytes());
    let form = side_log2 | 6 << 4 | 7 << 8 | rotation_bits << 12;
    raw.extend(form.to_le_bytes());
    raw.extend(70u16.to_le_bytes());
    for size in images {
        let side = 1 << side_log2;
        let blocks_of =
            |level| size.at_level(level).width.div_ceil(side) * size.at_level(level).height.div_ceil(side);
        let mut bits: Vec<bool> = Vec::new();
        for _ in 0..(0..levels).map(blocks_of).sum() {
            let entry = rng.below(64) | rng.below(ROWS) << 6 | rng.below(1 << (rotation_bits + 5)) << 13;
            bits.extend((0..18 + rotation_bits).map(|bit| entry >> bit & 1 == 1));
        }
        bits.resize(bits.len().next_multiple_of(32), false);
        let byte = |bits: &[bool]| (0..).zip(bits).map(|(n, &bit)| u8::from(bit) << n).sum::<u8>();
        raw.extend(bits.chunks(8).map(byte));
    }
    out.section("map", *b"PRMP", &raw);
    public
}

/// The texture of that kind.
pub(crate) fn progressive(base: &Base) -> ProgressiveTexture {
    let Base { sizes, levels, channels, content, reduce_log2, shrink_log2, class_bits, .. } = *base;
    let mut rng = Rng::new(u64::from(channels) + 10 * u64::from(class_bits + reduce_log2));
    let alpha = if matches!(channels, 2 | 4) { Alpha::Straight } else { Alpha::Opaque };
    let pixel = PixelInfo { channels, depth: Depth::Eight, color: ColorSpace::Srgb, alpha };
    let full: Vec<_> = sizes.iter().map(|&(width, height)| ImageSize { width, height }).collect();
    let mut out = SectionWriter::new(Progressive::ID);
    Notes::default().write(&mut out);
    write_layout(&ImageLayout::new(full.clone(), levels, pixel), &mut out);
    // What is stored of them.
    let levels = levels.saturating_sub(shrink_log2).max(1);
    let images: Vec<_> = full.iter().map(|size| size.at_level(shrink_log2)).collect();
    let residual = Residual {
        content,
        reduce_log2,
        shrink_log2,
        edge: if base.beyond { Edge::Padded } else { Edge::Repeated },
        alpha_gain_log2: base.alpha_gain_log2,
        class_bits,
    };
    residual.store(&images, levels, pixel, &mut rng, &mut out);
    let public = base.books.map(|books| store_books(books, &images, levels, &mut rng, &mut out));
    let bytes = out.finish().bytes;
    let mut budget = Budget::default();
    let file = Sections::parse(&bytes, &mut budget).unwrap();
    Progressive::load_shared(&file, public.as_ref(), &mut budget).unwrap()
}

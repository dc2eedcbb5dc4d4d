//! Textures of every module that reach every branch of its shader, and how far a GPU may differ from the CPU on each.
//!
//! Bounds follow from arithmetic. Views of the tests have coordinates that are sums of few powers of two, so that texture coordinates,
//! their products with sizes and the weights of bilinear blends are exact in single precision on both sides, whatever is fused or
//! reordered. What remains is what a format's decoders may do and what a codec's own arithmetic rounds.

use std::sync::OnceLock;

use glam::Vec4;
use texfold_bc::{Content, Family};
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::{Effort, Encoder, Goal, Job, PlaneFormat};
use texfold_epitome::decode::{TEXFOLD_EPITOME_FINE_LEVELS, TEXFOLD_EPITOME_GAIN_ONE};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
use texfold_gpu::AddressMode;
use texfold_zipmap::decode::TEXFOLD_ZIPMAP_LEAST;

use super::{
    Base, Call, Edge, Forge, Residual, Subject, bc, epitome, image, progressive, vq, zipmap, zipmap_blocks,
};

/// Plain bytes and BC7 decode to the same bytes everywhere; what remains is the division by 255.
pub(crate) const STORED: f32 = 1e-6;
/// What exact weights leave of a blend: a trilinear one is seven `a + (b - a) * w` of values up to 1, each rounded three times by
/// 2^-24 at most (1.3e-6), and a few more roundings of a level's fraction.
pub(crate) const BLENDED: f32 = 1e-5;
/// Places in an epitome, below 256 texels, are rounded three times on each axis by 2^-16 at most, and a step of one texel changes a value
/// by 1 at most, or 2 where the gain is largest.
pub(crate) const PLACED: f32 = 6.0 * 2.0 / 65536.0;
/// Where in the base a texel lies is computed by a division, good to 2.5 units in the last place on a GPU: in a base below 256
/// texels a side, a step of one texel changes a value by 1 at most, on each axis.
const TAPPED: f32 = 2.0 * 2.0 / 65536.0;
/// A residual is a sum of some twenty products.
const SUMMED: f32 = 4e-6;
/// Where a patch's texel lies is computed by two divisions, and its level by a logarithm.
const PATCHED: f32 = 1e-4;

/// Decoders of BC1 to BC5 may round differently (Direct3D 11.3 specification, 19.5): software by up to 2 of 255. An H200 was seen to
/// differ by 0.010 in BC1 and 0.025 in BC5; the bound for GPUs, 0.034, holds there.
pub(crate) fn rounded() -> f32 {
    let is_software = super::gpu().is_none_or(|gpu| gpu.info().device_type == wgpu::DeviceType::Cpu);
    if is_software { 2.0 / 255.0 + 1e-6 } else { 0.03 + 1.0 / 255.0 }
}

/// Largest difference of single texels and of blended ones.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) nearest: f32,
    pub(crate) blended: f32,
}

/// How z of a normal follows from x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Normals {
    /// Texels are colours.
    No,
    /// After x and y of one level are blended.
    Rebuilt,
    /// As above, times a gain of that much at most.
    Scaled(f32),
}

/// A texture, and what a GPU may differ by.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) subject: Subject,
    bounds: Bounds,
    /// Those of the levels that an epitome texture does not read from its epitome.
    coarse: Bounds,
    normals: Normals,
}

impl Case {
    /// The bound of each channel where the CPU gives `wanted`.
    pub(crate) fn bound(&self, image: u32, mode: AddressMode, call: Call, wanted: Vec4) -> Vec4 {
        let at = |level| if level < TEXFOLD_EPITOME_FINE_LEVELS { self.bounds } else { self.coarse };
        let most = match call {
            Call::Fetch { level, .. } | Call::Nearest { level, .. } => at(level).nearest,
            Call::Bilinear { level, .. } => at(level).blended,
            Call::Level { .. } | Call::Grad { .. } => self.bounds.blended.max(self.coarse.blended),
        };
        let bound = Vec4::splat(most);
        match (self.normals, call) {
            (Normals::No, _) => bound,
            (Normals::Scaled(gain), _) => bound.with_z(gain * worst_z(most)),
            (Normals::Rebuilt, Call::Level { uv, lod }) => {
                let levels = self.subject.layout().levels;
                let low = lod.clamp(0.0, (levels - 1) as f32) as u32;
                let of = |level| self.subject.call(image, mode, Call::Bilinear { uv, level });
                let z = [low, (low + 1).min(levels - 1)].map(|level| z_bound(of(level), most));
                bound.with_z(z[0].max(z[1]))
            }
            (Normals::Rebuilt, Call::Grad { .. }) => bound.with_z(worst_z(most)),
            (Normals::Rebuilt, _) => bound.with_z(z_bound(wanted, most)),
        }
    }
}

impl Case {
    /// What a zoom stack's texel may differ by beyond that where one side ends compositing: at a transmittance that rounding may
    /// put on either side of the least, of which alpha then lacks as much. What follows has that weight.
    pub(crate) fn cut_off(&self, found: f32, wanted: f32) -> f32 {
        let ends = |alpha: f32| (alpha - (1.0 - TEXFOLD_ZIPMAP_LEAST)).abs() <= STORED;
        // Few texels get as far as the form, which copies tables.
        let is_cut_off = (ends(found) || ends(wanted)) && self.subject.form().module == "zipmap";
        if is_cut_off { TEXFOLD_ZIPMAP_LEAST } else { 0.0 }
    }
}

/// What 1 - x^2 - y^2 of a normal changes by at most where both, stored as v * 0.5 + 0.5, change by `most`.
fn squares(x: f32, y: f32, most: f32) -> f32 {
    4.0 * most * (x.abs() + y.abs()) + 8.0 * most * most
}

/// What z of a normal changes by at most where x and y of `texel` change by `most`.
fn z_bound(texel: Vec4, most: f32) -> f32 {
    let (x, y) = (2.0 * texel.x - 1.0, 2.0 * texel.y - 1.0);
    let (square, change) = (1.0 - x * x - y * y, squares(x, y, most));
    let root = |square: f32| square.max(0.0).sqrt();
    let change = (root(square + change) - root(square)).max(root(square) - root(square - change));
    0.5 * change + most
}

/// As above for any normal: at the horizon z changes by half the root of what its square does.
fn worst_z(most: f32) -> f32 {
    let along = std::f32::consts::FRAC_1_SQRT_2;
    0.5 * squares(along, along, most).sqrt() + most
}

/// What a format's decoders may differ by.
fn decoded(content: Content) -> f32 {
    match content {
        Content::Raw | Content::Bc7 => STORED,
        _ => rounded(),
    }
}

/// As above, by the format of a plane.
pub(crate) fn plane_bound(format: PlaneFormat) -> f32 {
    match format {
        PlaneFormat::Bc1 | PlaneFormat::Bc3 | PlaneFormat::Bc4 | PlaneFormat::Bc5 => rounded(),
        _ => STORED,
    }
}

/// Texels that are stored as they are: `blends` where even a single one is blended from those of a smaller plane.
fn plain_case(name: String, subject: Subject, content: Content, blends: bool) -> Case {
    let normal = subject.layout().pixel.color == ColorSpace::Normal;
    let stored = decoded(content);
    let blended = stored + BLENDED;
    let bounds = Bounds { nearest: if blends { blended } else { stored }, blended };
    let normals = if normal { Normals::Rebuilt } else { Normals::No };
    Case { name, subject, bounds, coarse: bounds, normals }
}

pub(crate) fn bc_case(name: &str, image: Raster, content: Content, reduce_log2: u32) -> Case {
    let name = format!("bc {name} {content:?} /{reduce_log2}");
    plain_case(name, bc(vec![image], content, reduce_log2), content, reduce_log2 > 0)
}

fn bc_cases() -> Vec<Case> {
    use Content::{Bc1, Bc3, Bc4, Bc5, Bc7, Raw};
    let gray_alpha = image("cutout").with_channels(2);
    let images: [(&str, Raster, &[Content]); 8] = [
        ("odd_37x61", image("odd_37x61"), &[Raw, Bc1, Bc7]),
        ("cutout", image("cutout"), &[Raw, Bc1, Bc3, Bc7]),
        ("gray", image("gray"), &[Raw, Bc4]),
        ("gray_alpha", gray_alpha, &[Raw, Bc5]),
        ("normal_map", image("normal_map"), &[Bc5]),
        ("one_texel", image("one_texel"), &[Raw, Bc1, Bc7]),
        ("odd_3x5", image("odd_3x5"), &[Raw, Bc7]),
        ("line_513x1", image("line_513x1"), &[Raw, Bc7]),
    ];
    let mut cases = Vec::new();
    for (name, image, contents) in images {
        for &content in contents {
            // Plain bytes are never reduced.
            for reduce_log2 in if content == Raw { 0..=0 } else { 0..=1 } {
                cases.push(bc_case(name, image.clone(), content, reduce_log2));
            }
        }
    }
    // Images of unlike sizes share a number of levels: the smaller ones repeat their last.
    for content in [Raw, Bc1] {
        let images = ["odd_3x5", "odd_37x61", "one_texel"].map(image).to_vec();
        let subject = bc(images, content, 0);
        cases.push(plain_case(format!("bc set {content:?}"), subject, content, false));
    }
    cases
}

fn vq_cases() -> Vec<Case> {
    let sizes = [(37, 61), (16, 8), (37, 61), (1, 1), (5, 3), (64, 64), (37, 61)];
    let plain = (1..=4).map(|channels| (channels, Content::Raw));
    let contents = plain.chain([
        (3, Content::Bc1),
        (4, Content::Bc7),
        (2, Content::Bc5),
        (3, Content::Bc5),
        (1, Content::Bc4),
    ]);
    let texture = |(channels, content)| {
        let name = format!("vq {channels} channels {content:?}");
        plain_case(name, vq(&sizes, 6, channels, content), content, false)
    };
    contents.map(texture).collect()
}

/// The largest gain of a texture's map entries.
fn gain_of(texture: &EpitomeTexture) -> f32 {
    let gains = texture.gain_offsets().iter().flat_map(|tone| tone[..3].to_vec());
    f32::from(gains.max().unwrap_or(0)).max(TEXFOLD_EPITOME_GAIN_ONE) / TEXFOLD_EPITOME_GAIN_ONE
}

pub(crate) fn epitome_case(name: &str, forge: Forge) -> Case {
    let texture = epitome(&forge);
    let gain = gain_of(&texture);
    // Blending keeps to what each texel differs by, and a gain multiplies it.
    let plain = forge.contents.iter().map(|&content| decoded(content));
    let summed = forge.residual.map(|residual| decoded(residual.content) + SUMMED + TAPPED);
    let stored = gain * plain.chain(summed).fold(STORED, f32::max);
    let bounds = Bounds { nearest: stored + PLACED, blended: stored + PLACED + BLENDED };
    let stored = decoded(forge.coarse());
    let coarse = Bounds { nearest: stored, blended: stored + BLENDED };
    let normals = if forge.normal { Normals::Scaled(gain) } else { Normals::No };
    Case { name: format!("epitome {name}"), subject: Subject::new(texture), bounds, coarse, normals }
}

fn epitome_cases() -> Vec<Case> {
    use Content::{Bc1, Bc5, Bc7, Raw};
    let bits = |x, y, gain_offset, matrix| [x, y, 2, gain_offset, matrix];
    let forge = Forge::default;
    let coded = Residual {
        content: Bc1,
        reduce_log2: 2,
        shrink_log2: 0,
        edge: Edge::Isolated,
        alpha_gain_log2: 0,
        class_bits: 16,
    };
    let wide = Residual { content: Bc7, reduce_log2: 1, edge: Edge::Repeated, class_bits: 32, ..coded };
    let cases = [
        ("1 channel, 2 bytes", Forge { channels: 1, block: 32, bits: bits(7, 6, 2, 1), ..forge() }),
        ("2 channels, 3 bytes, mips", Forge { channels: 2, bits: bits(9, 8, 4, 3), ..forge() }.with_mips()),
        (
            "3 channels, 5 bytes, mips",
            Forge { bits: bits(12, 12, 8, 8), seam_width: 11, ..forge() }.with_mips(),
        ),
        ("3 channels, 6 bytes, large", Forge { block: 64, bits: bits(16, 16, 8, 8), ..forge() }),
        (
            "4 channels, unsplit, mips",
            Forge { channels: 4, bits: bits(9, 9, 8, 6), seam_width: 48, ..forge() }.unsplit().with_mips(),
        ),
        ("bc1, no palettes", Forge { contents: &[Bc1], bits: bits(9, 8, 0, 0), ..forge() }),
        (
            "bc1, small, mips",
            Forge { contents: &[Bc1], block: 16, bits: bits(9, 8, 4, 3), ..forge() }.with_mips(),
        ),
        (
            "bc1 and bc7, mips",
            Forge { contents: &[Bc1, Bc7], finer: true, bits: bits(16, 16, 8, 7), seam_width: 32, ..forge() }
                .with_mips(),
        ),
        ("error-coded alone", Forge { contents: &[], residual: Some(coded), ..forge() }),
        (
            "error-coded alone, mips",
            Forge { contents: &[], residual: Some(wide), bits: bits(9, 8, 3, 3), ..forge() }.with_mips(),
        ),
        (
            "bc1 and error-coded, mips",
            Forge { contents: &[Bc1], residual: Some(coded), bits: bits(9, 8, 2, 3), ..forge() }.with_mips(),
        ),
        (
            "bc1 and bc7, unsplit",
            Forge { contents: &[Bc1, Bc7], bits: bits(9, 9, 4, 4), ..forge() }.unsplit(),
        ),
        (
            "raw and bc7, alpha",
            Forge { channels: 4, contents: &[Raw, Bc7], bits: bits(9, 9, 7, 6), ..forge() },
        ),
        (
            "normals, mips",
            Forge { normal: true, contents: &[Bc5], bits: bits(9, 8, 5, 5), ..forge() }.with_mips(),
        ),
        (
            "1 channel, unsplit, mips",
            Forge { channels: 1, bits: bits(9, 8, 5, 5), ..forge() }.unsplit().with_mips(),
        ),
        // For coordinates on texel edges, which are exact where sizes are powers of two.
        ("64x32, mips", Forge { sizes: &[(64, 32)], levels: 6, seam_width: 16, ..forge() }),
    ];
    cases.into_iter().map(|(name, forge)| epitome_case(name, forge)).collect()
}

/// Epitomes whose last plane is error-coded, encoded for a PSNR in dB: beside a plain plane, or alone.
pub(crate) fn error_mapped(source: &str, mips: bool, psnr: f64) -> (Case, bool) {
    let params = EpitomeParams::new(Goal::Psnr(psnr));
    let params = params.with_family(Family::ErrorMap).with_mips(mips).with_effort(Effort::Fast);
    let set = ImageSet::single(image(source));
    let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    assert!(texture.errors().is_some_and(|errors| !errors.classes(0).is_empty()), "{source}");
    let mixed = texture.view(0).params.mixed == 1;
    let stored = gain_of(&texture) * (rounded() + TAPPED);
    let bounds = Bounds { nearest: stored + PLACED, blended: stored + PLACED + BLENDED };
    let coarse = Bounds { nearest: rounded(), blended: rounded() + BLENDED };
    let name = format!("error-mapped epitome of {source}, mixed {mixed}");
    (Case { name, subject: Subject::new(texture), bounds, coarse, normals: Normals::No }, mixed)
}

/// Epitomes in blocks, which the GPU decodes before it draws them: exact texels, blended as the map says.
fn epitome_block_case((source, mips): (&str, bool)) -> Case {
    let params = EpitomeParams::new(Goal::Psnr(30.0)).with_mips(mips).with_effort(Effort::Fast);
    let set = ImageSet::single(image(source));
    let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    assert!(texture.blocks().is_some(), "{source}");
    let stored = gain_of(&texture) * STORED;
    let bounds = Bounds { nearest: stored + PLACED, blended: stored + PLACED + BLENDED };
    let coarse = Bounds { nearest: STORED, blended: STORED + BLENDED };
    let name = format!("epitome of {source} in blocks, mips {mips}");
    Case { name, subject: Subject::new(texture), bounds, coarse, normals: Normals::No }
}

fn progressive_case(base: Base) -> Case {
    let Base { sizes, channels, content, reduce_log2, shrink_log2, beyond, class_bits, books, .. } = base;
    let gain = (1u32 << base.alpha_gain_log2) as f32;
    let name = format!(
        "progressive {sizes:?} {channels} channels {content:?} /{reduce_log2} of /{shrink_log2}, beyond {beyond}, \
         {class_bits} bits, alpha by {gain}, {books:?}"
    );
    // Contrast raises errors with it.
    let rounded = gain * (decoded(content) + SUMMED + TAPPED);
    let bounds =
        Bounds { nearest: rounded + if shrink_log2 > 0 { BLENDED } else { 0.0 }, blended: rounded + BLENDED };
    Case { name, subject: Subject::new(progressive(&base)), bounds, coarse: bounds, normals: Normals::No }
}

/// Bases and models that reach every branch: with and without residuals, sets, levels beyond those of the base.
fn progressive_cases() -> Vec<Case> {
    use Content::{Bc1, Bc4, Bc5, Bc7, Raw};
    let base = |channels, content, reduce_log2, class_bits| Base {
        sizes: &[(37, 61), (1, 1)],
        levels: 2,
        channels,
        content,
        reduce_log2,
        shrink_log2: 0,
        beyond: false,
        alpha_gain_log2: 0,
        class_bits,
        books: None,
    };
    let bases = [
        Base { sizes: &[(37, 61), (1, 1), (5, 3), (129, 8)], levels: 6, ..base(3, Bc1, 2, 16) },
        base(3, Raw, 2, 16),
        base(3, Bc7, 1, 32),
        base(3, Bc7, 3, 0),
        base(1, Bc4, 2, 16),
        base(2, Bc5, 1, 16),
        base(4, Bc7, 1, 16),
        Base { alpha_gain_log2: 3, ..base(4, Bc7, 1, 16) },
        Base { alpha_gain_log2: 1, shrink_log2: 1, ..base(2, Bc5, 2, 0) },
        Base { books: Some((3, 5, Raw)), ..base(3, Bc7, 3, 0) },
        Base { books: Some((4, 4, Raw)), levels: 5, ..base(3, Bc7, 2, 16) },
        Base { books: Some((4, 3, Bc4)), ..base(1, Bc4, 2, 0) },
        Base { sizes: &[(513, 390)], books: Some((3, 5, Raw)), ..base(4, Bc7, 1, 16) },
        // Images of a half and a quarter of the size, enlarged.
        Base { sizes: &[(37, 61), (1, 1), (130, 9)], levels: 6, shrink_log2: 1, ..base(3, Bc1, 2, 16) },
        Base { sizes: &[(150, 61), (2, 3)], levels: 1, shrink_log2: 2, ..base(3, Bc7, 2, 32) },
        Base { sizes: &[(64, 32)], levels: 5, shrink_log2: 1, ..base(3, Bc7, 2, 16) },
        // Padded bases.
        Base { sizes: &[(37, 61), (64, 32)], levels: 6, beyond: true, ..base(3, Bc1, 2, 16) },
        Base { books: Some((3, 5, Raw)), beyond: true, ..base(3, Bc7, 3, 0) },
        Base {
            sizes: &[(150, 61), (64, 128)],
            levels: 6,
            shrink_log2: 1,
            beyond: true,
            ..base(3, Bc1, 2, 16)
        },
        Base { sizes: &[(37, 61)], levels: 1, shrink_log2: 2, beyond: true, ..base(3, Bc7, 3, 32) },
        // Several rows of words.
        Base { sizes: &[(513, 390)], levels: 2, ..base(3, Bc7, 3, 16) },
    ];
    bases.into_iter().map(progressive_case).collect()
}

/// Patches in blocks, which the GPU decodes before it draws them.
fn zipmap_block_case((channels, patches): (u8, usize)) -> Case {
    let bounds = Bounds { nearest: STORED + PATCHED, blended: STORED + PATCHED };
    let name = format!("zipmap {channels} channels in blocks, {patches} patches");
    let subject = Subject::new(zipmap_blocks("odd_37x61", channels, patches));
    Case { name, subject, bounds, coarse: bounds, normals: Normals::No }
}

fn zipmap_case(channels: u8, content: Content, patches: usize, subject: Subject) -> Case {
    // The CPU keeps blocks of BC1 to BC5 in 8 bits.
    let exact = matches!((content, channels), (Content::Raw, _) | (Content::Bc7, 3 | 4));
    let placed = if exact { STORED } else { rounded() } + PATCHED;
    let bounds = Bounds { nearest: placed, blended: placed };
    let name = format!("zipmap {channels} channels {content:?}, {patches} patches");
    Case { name, subject, bounds, coarse: bounds, normals: Normals::No }
}

/// Roots of one and two planes, patches of every content, none, and more than a list of tiles holds in one texel.
fn zipmap_cases() -> Vec<Case> {
    use Content::{Bc1, Bc3, Bc7, Raw};
    let kinds = [
        (3, Raw, 5),
        (3, Bc1, 3),
        (3, Bc3, 5),
        (4, Bc7, 4),
        (1, Raw, 5),
        (1, Bc7, 4),
        (3, Bc7, 0),
        (3, Raw, 23),
    ];
    let case = |(channels, content, patches)| {
        zipmap_case(channels, content, patches, Subject::new(zipmap("odd_37x61", channels, content, patches)))
    };
    let blocks = [(3, 5), (4, 4), (1, 3), (3, 0)].into_iter().map(zipmap_block_case);
    kinds.into_iter().map(case).chain(blocks).collect()
}

/// All cases, each made once.
pub(crate) fn cases() -> &'static [Case] {
    static CASES: OnceLock<Vec<Case>> = OnceLock::new();
    CASES.get_or_init(|| {
        let blocks = [("odd_37x61", true), ("tile_repeat", false), ("gray", true)].map(epitome_block_case);
        let mixed = [error_mapped("odd_37x61", true, 30.0).0, error_mapped("odd_37x61", false, 30.0).0];
        let first = bc_cases().into_iter().chain(vq_cases()).chain(epitome_cases()).chain(mixed);
        first.chain(blocks).chain(progressive_cases()).chain(zipmap_cases()).collect()
    })
}

/// Textures as wide as WebGPU allows, 8192 texels, of every codec that can be made so without an encoder's time.
pub(crate) fn wide_cases() -> Vec<Case> {
    let (width, height) = (8192, 8);
    let bytes: Vec<u8> =
        (0..width * height * 3u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let image = Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes).unwrap();
    let sizes = &[(8192, 8)];
    let base = Base {
        sizes,
        levels: 2,
        channels: 3,
        content: Content::Bc7,
        reduce_log2: 1,
        shrink_log2: 0,
        beyond: false,
        alpha_gain_log2: 0,
        class_bits: 16,
        books: Some((3, 5, Content::Raw)),
    };
    vec![
        bc_case("8192x8", image.clone(), Content::Raw, 0),
        bc_case("8192x8", image, Content::Bc7, 1),
        plain_case("vq 8192x8".to_owned(), vq(sizes, 2, 3, Content::Raw), Content::Raw, false),
        epitome_case("8192x8", Forge { sizes, levels: 4, block: 16, ..Forge::default() }),
        progressive_case(base),
        progressive_case(Base { shrink_log2: 1, books: None, ..base }),
    ]
}

/// An encoded texture of any content: gains up to 2, places in planes below 256 texels a side, residuals.
pub(crate) fn layered_case(name: &str, subject: Subject) -> Case {
    let stored = 2.0 * rounded() + SUMMED + TAPPED + PLACED;
    let bounds = Bounds { nearest: stored, blended: stored + BLENDED };
    Case { name: name.to_owned(), subject, bounds, coarse: bounds, normals: Normals::No }
}

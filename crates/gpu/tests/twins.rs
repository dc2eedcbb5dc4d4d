//! GPU equals CPU: every shader function against its twin, on every texel.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::sync::OnceLock;

use glam::{Affine2, Vec2, Vec4};
use support::{Base, Forge, Subject, assert_close, bc, epitome, gpu, picture, progressive, vq, zipmap};
use texfold_bc::{Content, Family};
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::{AstcBlock, Effort, Encoder, Goal, Job};
use texfold_epitome::decode::{TEXFOLD_EPITOME_FINE_LEVELS, TEXFOLD_EPITOME_GAIN_ONE};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};
use texfold_gpu::{AddressMode, Filter, GpuError, Lookup, View};

/// Plain bytes and BC7 decode to the same bytes everywhere; what remains is the division by 255.
const EXACT: Vec4 = Vec4::splat(1e-6);
/// What filtered values may differ by, for the order of floating-point operations.
const FILTERED: Vec4 = Vec4::splat(1.0 / 255.0);
/// Decoders of BC1 to BC5 may round differently by this much (Direct3D 11.3 specification, 19.5).
const ROUNDED: Vec4 = Vec4::splat(2.0 / 255.0 + 1e-6);
/// As above, where z of a normal follows from x and y: near the horizon, z changes faster than they do.
const ROUNDED_NORMAL: Vec4 = Vec4::new(2.0 / 255.0 + 1e-6, 2.0 / 255.0 + 1e-6, 10.0 / 255.0, 1e-6);

/// As above for random texels, many of them at the horizon: z is half the root of what x and y leave of 1.
const ROUNDED_ANY_NORMAL: Vec4 = Vec4::new(2.0 / 255.0 + 1e-6, 2.0 / 255.0 + 1e-6, 0.11, 1e-6);

/// ASTC is decoded in half precision, rounded to 8 bits on the CPU; GPUs may cut to 8 bits instead.
const CUT: Vec4 = Vec4::splat(1.0 / 255.0 + 1e-6);

/// What single texels of an epitome's leaves may differ by: their places, below 256 texels, are rounded three times
/// on each axis, and a step of one texel changes a value by 1 at most, or 2 where the gain is largest.
const PLACED: Vec4 = Vec4::splat(6.0 * 2.0 / 65536.0);

/// Largest difference of single texels and of blended ones.
#[derive(Clone, Copy)]
struct Bounds {
    nearest: Vec4,
    blended: Vec4,
}

struct Case {
    name: String,
    subject: Subject,
    bounds: Bounds,
    /// Those of the levels that an epitome texture does not read from its epitome.
    coarse: Bounds,
}

impl Case {
    /// The bounds that count at mip level `level`.
    fn bounds(&self, level: u32) -> Bounds {
        if level < TEXFOLD_EPITOME_FINE_LEVELS { self.bounds } else { self.coarse }
    }

    /// What every blended lookup keeps to.
    fn blended(&self) -> Vec4 {
        self.bounds.blended.max(self.coarse.blended)
    }
}

fn case(name: impl Into<String>, subject: Subject, content: Content) -> Case {
    let normal = subject.layout().pixel.color == ColorSpace::Normal;
    let (nearest, blended) = match content {
        Content::Raw | Content::Bc7 => (EXACT, FILTERED),
        Content::Bc5 if normal && matches!(subject, Subject::Vq(_)) => {
            (ROUNDED_ANY_NORMAL, ROUNDED_ANY_NORMAL)
        }
        Content::Bc5 if normal => (ROUNDED_NORMAL, ROUNDED_NORMAL),
        Content::Astc(_) => (CUT, CUT),
        _ => (ROUNDED, ROUNDED),
    };
    let bounds = Bounds { nearest, blended };
    Case { name: name.into(), subject, bounds, coarse: bounds }
}

fn bc_cases() -> Vec<Case> {
    use Content::{Bc1, Bc3, Bc4, Bc5, Bc7, Raw};
    let gray_alpha = picture("cutout").with_channels(2);
    let images: [(&str, Raster, &[Content]); 8] = [
        ("odd_37x61", picture("odd_37x61"), &[Raw, Bc1, Bc7]),
        ("cutout", picture("cutout"), &[Raw, Bc1, Bc3, Bc7]),
        ("gray", picture("gray"), &[Raw, Bc4]),
        ("gray_alpha", gray_alpha, &[Raw, Bc5]),
        ("normal_map", picture("normal_map"), &[Bc5]),
        ("one_texel", picture("one_texel"), &[Raw, Bc1, Bc7]),
        ("odd_3x5", picture("odd_3x5"), &[Raw, Bc7]),
        ("line_513x1", picture("line_513x1"), &[Raw, Bc7]),
    ];
    let mut cases = Vec::new();
    for (name, image, contents) in images {
        for &content in contents {
            // Plain bytes are never reduced.
            for reduce_log2 in if content == Raw { 0..=0 } else { 0..=1 } {
                let subject = bc(vec![image.clone()], content, reduce_log2);
                cases.push(case(format!("bc {name} {content:?} {reduce_log2}"), subject, content));
            }
        }
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
        case(format!("vq {channels} channels {content:?}"), vq(&sizes, 6, channels, content), content)
    };
    contents.map(texture).collect()
}

fn epitome_case(name: &str, forge: Forge) -> Case {
    let subject = epitome(&forge);
    let Subject::Epitome(texture) = &subject else { panic!("{name} is no epitome") };
    let gains = texture.tones().iter().flat_map(|tone| tone[..3].to_vec());
    let gain = f32::from(gains.max().unwrap_or(0)).max(TEXFOLD_EPITOME_GAIN_ONE) / TEXFOLD_EPITOME_GAIN_ONE;
    let rounding = |content| match content {
        Content::Raw | Content::Bc7 => EXACT,
        Content::Bc5 if forge.normal => ROUNDED_ANY_NORMAL,
        _ => ROUNDED,
    };
    // Blending keeps to what each texel differs by, and a tone multiplies it.
    let stored = gain * forge.contents.iter().map(|&content| rounding(content)).fold(EXACT, Vec4::max);
    let bounds = Bounds { nearest: stored + PLACED, blended: stored + FILTERED };
    let stored = rounding(forge.coarse());
    let coarse = Bounds { nearest: stored, blended: stored + FILTERED };
    Case { name: format!("epitome {name}"), subject, bounds, coarse }
}

fn epitome_cases() -> Vec<Case> {
    use Content::{Bc1, Bc5, Bc7, Raw};
    let bits = |x, y, tone, linear| [x, y, 2, tone, linear];
    let forge = Forge::default;
    let cases = [
        ("1 channel, 2 bytes", Forge { channels: 1, block: 32, bits: bits(7, 6, 2, 1), ..forge() }),
        ("2 channels, 3 bytes, mips", Forge { channels: 2, bits: bits(9, 8, 4, 3), ..forge() }.with_mips()),
        ("3 channels, 5 bytes, mips", Forge { bits: bits(12, 12, 8, 8), strip: 11, ..forge() }.with_mips()),
        ("3 channels, 6 bytes, large", Forge { block: 64, bits: bits(16, 16, 8, 8), ..forge() }),
        (
            "4 channels, unsplit, mips",
            Forge { channels: 4, bits: bits(9, 9, 8, 6), strip: 48, ..forge() }.unsplit().with_mips(),
        ),
        ("bc1, no palettes", Forge { contents: &[Bc1], bits: bits(9, 8, 0, 0), ..forge() }),
        (
            "bc1, small, mips",
            Forge { contents: &[Bc1], block: 16, bits: bits(9, 8, 4, 3), ..forge() }.with_mips(),
        ),
        (
            "bc1 and bc7, mips",
            Forge { contents: &[Bc1, Bc7], finer: true, bits: bits(16, 16, 8, 7), strip: 32, ..forge() }
                .with_mips(),
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
    ];
    let forged = cases.into_iter().map(|(name, forge)| epitome_case(name, forge));
    forged.chain([errors_epitome("odd_37x61", true), errors_epitome("odd_37x61", false)]).collect()
}

/// Epitomes with an error map, encoded: beside plain content, and alone.
fn errors_epitome(image: &str, mips: bool) -> Case {
    let (goal, family) = (Goal::Psnr(30.0), Family::ErrorMap);
    let params = EpitomeParams { goal, family, mips, effort: Effort::Fast, ..EpitomeParams::default() };
    let set = ImageSet::single(picture(image));
    let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    assert!(texture.errors().is_some_and(|errors| !errors.classes(0).is_empty()), "{image}");
    let gains = texture.tones().iter().flat_map(|tone| tone[..3].to_vec());
    let gain = f32::from(gains.max().unwrap_or(0)).max(TEXFOLD_EPITOME_GAIN_ONE) / TEXFOLD_EPITOME_GAIN_ONE;
    let stored = gain * (ROUNDED + TAPPED);
    let bounds = Bounds { nearest: stored + PLACED, blended: stored + FILTERED };
    let coarse = Bounds { nearest: ROUNDED, blended: ROUNDED + FILTERED };
    Case {
        name: format!("epitome of {image} with an error map"),
        subject: Subject::Epitome(texture),
        bounds,
        coarse,
    }
}

/// Bases and models that reach every branch: with and without an error map, sets, levels beyond those of the base.
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
        Base { books: Some((3, 5, Raw)), ..base(3, Bc7, 3, 0) },
        Base { books: Some((4, 4, Raw)), levels: 5, ..base(3, Bc7, 2, 16) },
        Base { books: Some((4, 3, Bc4)), ..base(1, Bc4, 2, 0) },
        Base { sizes: &[(513, 390)], books: Some((3, 5, Raw)), ..base(4, Bc7, 1, 16) },
        // Images of a half and a quarter of the size, enlarged.
        Base { sizes: &[(37, 61), (1, 1), (130, 9)], levels: 6, shrink_log2: 1, ..base(3, Bc1, 2, 16) },
        Base { sizes: &[(150, 61), (2, 3)], levels: 1, shrink_log2: 2, ..base(3, Bc7, 2, 32) },
        // Bases that go on beyond the borders.
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
    let case = |base: Base| {
        let Base { channels, content, reduce_log2, shrink_log2, beyond, class_bits, books, .. } = base;
        let name = format!(
            "progressive {channels} channels {content:?} /{reduce_log2} of /{shrink_log2}, beyond {beyond}, {class_bits} bits, {books:?}"
        );
        // A texel is a sum of some twenty products, and blended: single ones are equal within their rounding.
        let rounded = if matches!(content, Raw | Bc7) { Vec4::splat(4e-6) } else { ROUNDED };
        let bounds = Bounds { nearest: rounded + TAPPED, blended: rounded + FILTERED };
        Case { name, subject: progressive(&base), bounds, coarse: bounds }
    };
    bases.into_iter().map(case).collect()
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
        let name = format!("zipmap {channels} channels {content:?}, {patches} patches");
        // Where a patch's texel lies is computed by two divisions, and its level by a logarithm; the CPU keeps blocks of BC1 to
        // BC5 in 8 bits.
        let exact = matches!((content, channels), (Raw, _) | (Bc7, 3 | 4));
        let placed = if exact { EXACT } else { ROUNDED } + Vec4::splat(1e-4);
        let bounds = Bounds { nearest: placed, blended: placed };
        Case { name, subject: zipmap(channels, content, patches), bounds, coarse: bounds }
    };
    kinds.into_iter().map(case).collect()
}

#[test]
fn zipmaps_are_drawn_by_derivatives_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for case in zipmap_cases() {
        let texture = case.subject.upload(gpu).with_address_mode(AddressMode::Clamp);
        // The last of them longer than wide, so that a pixel is the mean of several.
        for zoom in [0.05, 0.2, 1.0, 3.0].map(Vec2::splat).into_iter().chain([Vec2::new(0.1, 0.9)]) {
            let uv = Affine2::from_scale(zoom) * askew();
            let uv = Affine2 { translation: Vec2::splat(0.5) - uv.matrix2 * Vec2::splat(0.5), ..uv };
            let view = View { surface: 0, size: (41, 29), uv, lookup: Lookup::Derivative };
            let found = gpu.sample(&texture, &view).unwrap();
            let wanted = case.subject.view(&view, AddressMode::Clamp);
            assert_close(&format!("{}, zoom {zoom}", case.name), &found, &wanted, case.blended());
        }
    }
}

/// Where in the base a texel lies is computed by a division, good to 2.5 units in the last place on a GPU: in a base below 256
/// texels a side, a step of one texel changes a value by 1 at most, on each axis.
const TAPPED: Vec4 = Vec4::splat(2.0 * 2.0 / 65536.0);

fn cases() -> &'static [Case] {
    static CASES: OnceLock<Vec<Case>> = OnceLock::new();
    CASES.get_or_init(|| {
        let first = bc_cases().into_iter().chain(vq_cases()).chain(epitome_cases());
        first.chain(progressive_cases()).chain(zipmap_cases()).collect()
    })
}

/// Turned, squeezed and beyond all four edges, so that no pixel falls on a texel's centre or edge.
fn askew() -> Affine2 {
    Affine2::from_scale_angle_translation(Vec2::new(2.3, 1.7), 0.4, Vec2::new(-0.613, -0.871))
}

/// Draws every view on both sides with both address modes; returns the largest difference.
fn compare(case: &Case, lookups: &[Lookup], bound: impl Fn(Lookup) -> Vec4) -> Option<f32> {
    let gpu = gpu()?;
    let mut largest = 0f32;
    for mode in [AddressMode::Repeat, AddressMode::Clamp] {
        let texture = case.subject.upload(gpu).with_address_mode(mode);
        for surface in 0..texture.surfaces() as u32 {
            for &lookup in lookups {
                let view = View { surface, size: (23, 17), uv: askew(), lookup };
                let name = format!("{}, surface {surface}, {mode:?}, {lookup:?}", case.name);
                let found = gpu.sample(&texture, &view).unwrap();
                let wanted = case.subject.view(&view, mode);
                largest = largest.max(assert_close(&name, &found, &wanted, bound(lookup)));
            }
        }
    }
    Some(largest)
}

#[test]
fn every_texel_of_every_level_is_fetched_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for case in cases() {
        let mut largest = 0f32;
        let texture = case.subject.upload(gpu);
        let layout = case.subject.layout();
        for (surface, size) in (0..).zip(&layout.surfaces) {
            for level in 0..layout.levels {
                let size = size.at_level(level);
                // Wider and higher than the level: what lies outside is the nearest texel inside.
                let fetch = View::whole(surface, (size.width + 3, size.height + 2), Lookup::Fetch { level });
                let name = format!("{}, surface {surface}, level {level}", case.name);
                let wanted = case.subject.view(&fetch, AddressMode::Clamp);
                let bound = case.bounds(level).nearest;
                let found = gpu.sample(&texture, &fetch).unwrap();
                largest = largest.max(assert_close(&name, &found, &wanted, bound));
                let size = (size.width, size.height);
                let whole = View::whole(surface, size, Lookup::Fetch { level });
                let wanted = case.subject.view(&whole, AddressMode::Clamp);
                let found = gpu.decode(&texture, surface, level, size, Filter::Nearest).unwrap();
                assert_close(&name, &found, &wanted, bound);
            }
        }
        println!("{}: {largest:e}", case.name);
    }
}

#[test]
fn nearest_texels_wrap_and_clamp_as_on_the_cpu() {
    for case in cases() {
        let levels = case.subject.layout().levels;
        let lookups: Vec<_> = (0..levels).map(|level| Lookup::Nearest { level }).collect();
        // Reduced planes blend even here.
        let reduced = case.name.ends_with(" 1");
        let bound = |lookup| match lookup {
            Lookup::Nearest { level } if !reduced => case.bounds(level).nearest,
            _ => case.blended(),
        };
        let Some(largest) = compare(case, &lookups, bound) else { return };
        println!("{}: {largest:e}", case.name);
    }
}

#[test]
fn bilinear_blends_are_those_of_the_cpu() {
    for case in cases() {
        let levels = case.subject.layout().levels;
        let lookups: Vec<_> = (0..levels).map(|level| Lookup::Bilinear { level }).collect();
        let bound = |lookup| match lookup {
            Lookup::Bilinear { level } => case.bounds(level).blended,
            _ => case.blended(),
        };
        let Some(largest) = compare(case, &lookups, bound) else { return };
        println!("{}: {largest:e}", case.name);
    }
}

#[test]
fn trilinear_blends_are_those_of_the_cpu() {
    let lookups = [-1.5, 0.0, 0.3, 1.0, 2.75, 4.999, 40.0].map(|lod| Lookup::Level { lod });
    for case in cases() {
        let Some(largest) = compare(case, &lookups, |_| case.blended()) else { return };
        println!("{}: {largest:e}", case.name);
    }
}

#[test]
fn derivatives_choose_the_level_that_the_cpu_computes() {
    let Some(gpu) = gpu() else { return };
    for case in [
        case("bc", bc(vec![picture("facade")], Content::Bc1, 0), Content::Bc1),
        case("bc reduced", bc(vec![picture("facade")], Content::Bc1, 1), Content::Bc1),
        case("vq", vq(&[(64, 64), (37, 61)], 6, 3, Content::Raw), Content::Raw),
        epitome_case("with mips", Forge::default().with_mips()),
    ] {
        let texture = case.subject.upload(gpu).with_address_mode(AddressMode::Repeat);
        let surface = texture.surfaces() as u32 - 1;
        for zoom in [0.2, 1.0, 3.0, 9.0] {
            let uv = Affine2::from_scale(Vec2::splat(zoom)) * askew();
            let view = View { surface, size: (41, 29), uv, lookup: Lookup::Derivative };
            let (dx, dy) = (uv.matrix2.x_axis / 41.0, uv.matrix2.y_axis / 29.0);
            let lod = case.subject.level(surface, dx, dy);
            let found = gpu.sample(&texture, &view).unwrap();
            let name = format!("{}, zoom {zoom}, level {lod}", case.name);
            let wanted = case.subject.view(&view, AddressMode::Repeat);
            assert_close(&name, &found, &wanted, case.blended());
            let explicit = gpu.sample(&texture, &View { lookup: Lookup::Level { lod }, ..view }).unwrap();
            let explicit: Vec<Vec4> = explicit.into_iter().map(Vec4::from).collect();
            assert_close(&name, &found, &explicit, FILTERED);
        }
    }
}

#[test]
fn srgb_becomes_linear_as_on_the_cpu() {
    let ramp: Vec<u8> = (0..=255).collect();
    let image = Raster::from_u8(256, 1, 1, ColorSpace::Srgb, &ramp).unwrap();
    let case = case("ramp", bc(vec![image], Content::Raw, 0), Content::Raw);
    let _ = compare(&case, &[Lookup::NearestLinear { level: 0 }], |_| FILTERED);
}

/// Epitomes with ASTC content, encoded: random blocks are mostly illegal, or HDR, which each decoder shows in its own way.
fn astc_epitome(content: Option<Content>) -> Case {
    let goal = Goal::Psnr(26.0);
    let (family, effort) = (Family::Astc, Effort::Fast);
    let params = EpitomeParams { goal, content, family, mips: true, effort, ..EpitomeParams::default() };
    let set = ImageSet::single(picture("facade"));
    let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    let gains = texture.tones().iter().flat_map(|tone| tone[..3].to_vec());
    let gain = f32::from(gains.max().unwrap_or(0)).max(TEXFOLD_EPITOME_GAIN_ONE) / TEXFOLD_EPITOME_GAIN_ONE;
    // Epitomes of this picture are below 256 texels a side.
    let bounds = Bounds { nearest: gain * CUT + PLACED, blended: gain * CUT + FILTERED };
    let coarse = Bounds { nearest: CUT, blended: CUT + FILTERED };
    Case { name: format!("epitome {content:?}"), subject: Subject::Epitome(texture), bounds, coarse }
}

#[test]
fn astc_is_sampled_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    if !Content::Astc(AstcBlock::B8).is_available() {
        println!("skipped: ASTC on the GPU needs the feature texfold-bc/astc");
        return;
    }
    let plain = |(image, block)| {
        let content = Content::Astc(block);
        case(format!("bc {image} {content:?}"), bc(vec![picture(image)], content, 0), content)
    };
    let images = ["odd_37x61", "cutout", "one_texel"];
    let plains = images.iter().flat_map(|&image| AstcBlock::ALL.map(|block| (image, block))).map(plain);
    let epitomes = [None, Some(Content::Astc(AstcBlock::B5)), Some(Content::Astc(AstcBlock::B8))];
    for case in plains.chain(epitomes.into_iter().map(astc_epitome)) {
        if !gpu.has_astc() {
            let refused = gpu.upload(&case.subject.form());
            assert!(matches!(refused, Err(GpuError::NoBlockCompression { .. })), "{}", case.name);
            println!("skipped: {} has no ASTC", gpu.info().name);
            return;
        }
        let levels = case.subject.layout().levels;
        let nearest: Vec<_> = (0..levels).map(|level| Lookup::Nearest { level }).collect();
        let blended: Vec<_> = (0..levels).map(|level| Lookup::Bilinear { level }).collect();
        let level = |lookup| match lookup {
            Lookup::Nearest { level } | Lookup::Bilinear { level } => level,
            _ => 0,
        };
        let nearest = compare(&case, &nearest, |lookup| case.bounds(level(lookup)).nearest);
        let blended = compare(&case, &blended, |lookup| case.bounds(level(lookup)).blended);
        println!("{}: {:e}, blended {:e}", case.name, nearest.unwrap(), blended.unwrap());
    }
}

#[test]
fn images_of_different_sizes_share_a_set_of_mips() {
    // The smaller image repeats its last level, which its texture holds once.
    let images = || vec![picture("odd_3x5"), picture("odd_37x61"), picture("one_texel")];
    for content in [Content::Raw, Content::Bc1] {
        let case = case(format!("set {content:?}"), bc(images(), content, 0), content);
        let lookups: Vec<_> = (0..6).map(|level| Lookup::Bilinear { level }).collect();
        if compare(&case, &lookups, |_| case.blended()).is_none() {
            return;
        }
        let lookups = [Lookup::Level { lod: 2.5 }, Lookup::Level { lod: 9.0 }];
        let _ = compare(&case, &lookups, |_| case.blended());
    }
}

#[test]
fn any_number_may_be_a_coordinate_or_a_level() {
    let far = |x: f32, y: f32| Affine2::from_translation(Vec2::new(x, y));
    let cases = [
        case("bc", bc(vec![picture("odd_37x61")], Content::Bc1, 0), Content::Bc1),
        case("bc reduced", bc(vec![picture("odd_37x61")], Content::Bc1, 1), Content::Bc1),
        case("vq", vq(&[(37, 61)], 6, 3, Content::Raw), Content::Raw),
        epitome_case("with mips", Forge::default().with_mips()),
    ];
    let lookups = [
        Lookup::Nearest { level: 1 },
        Lookup::Bilinear { level: 1 },
        Lookup::Level { lod: 1e30 },
        Lookup::Level { lod: -1e30 },
    ];
    for case in &cases {
        for mode in [AddressMode::Repeat, AddressMode::Clamp] {
            let texture = gpu().map(|gpu| (gpu, case.subject.upload(gpu).with_address_mode(mode)));
            for (lookup, uv) in lookups
                .into_iter()
                .flat_map(|lookup| [far(1e9, -1e9), far(-1e30, 1e30), far(3e9, 0.3)].map(|uv| (lookup, uv)))
            {
                let view = View { surface: 0, size: (5, 3), uv, lookup };
                let wanted = case.subject.view(&view, mode);
                if let Some((gpu, texture)) = &texture {
                    let name = format!("{}, {uv:?}, {mode:?}, {lookup:?}", case.name);
                    assert_close(&name, &gpu.sample(texture, &view).unwrap(), &wanted, case.blended());
                }
            }
            // Shaders may do as they like with these; the CPU gives some colour of the image.
            let odd = [f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
            for (x, lod) in odd.into_iter().flat_map(|x| odd.map(|lod| (x, lod))) {
                for lookup in [lookups[0], lookups[1], Lookup::Level { lod }] {
                    let view = View { surface: 0, size: (5, 3), uv: far(x, -x), lookup };
                    let found = case.subject.view(&view, mode);
                    assert!(found.iter().all(|texel| texel.is_finite()), "{}, {x}, {lookup:?}", case.name);
                }
            }
        }
    }
}

#[test]
fn a_long_sequence_fills_several_columns_of_the_index_plane() {
    let Some(gpu) = gpu() else { return };
    let subject = vq(&[(40, 40); 1000], 1, 3, Content::Raw);
    assert!(subject.form().planes.iter().any(|plane| plane.part == "index" && plane.width > 10));
    let texture = subject.upload(gpu);
    for surface in [0, 1, 2, 818, 819, 999] {
        let view = View::whole(surface, (40, 40), Lookup::Nearest { level: 0 });
        let wanted = subject.view(&view, AddressMode::Clamp);
        assert_close(&format!("frame {surface}"), &gpu.sample(&texture, &view).unwrap(), &wanted, EXACT);
    }
}

#[test]
fn layers_that_arrive_are_drawn_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let set = ImageSet::single(picture("facade"));
    let params = EpitomeParams {
        goal: Goal::Psnr(28.0),
        effort: Effort::Fast,
        mips: true,
        layers: 3,
        ..EpitomeParams::default()
    };
    let whole = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    let mut before = 0;
    for layers in 1..=3 {
        let subject = Subject::Epitome(whole.first_layers(layers));
        let texture = subject.upload(gpu);
        for level in 0..5 {
            let side = 256 >> level;
            let view = View::whole(0, (side, side), Lookup::Fetch { level });
            let wanted = subject.view(&view, AddressMode::Clamp);
            let name = format!("{layers} layers, level {level}");
            assert_close(&name, &gpu.sample(&texture, &view).unwrap(), &wanted, 2.0 * ROUNDED + PLACED);
        }
        let view = View { surface: 0, size: (61, 67), uv: askew(), lookup: Lookup::Level { lod: 1.4 } };
        let wanted = subject.view(&view, AddressMode::Clamp);
        let found = gpu.sample(&texture, &view).unwrap();
        assert_close("blended", &found, &wanted, 2.0 * ROUNDED + FILTERED);
        assert_eq!(8 * texture.bytes(), subject.form().bits_memory());
        // The map grows with each layer.
        let map = subject.form().planes[0].data.len();
        assert!(map > before, "{layers} layers: {map} bytes after {before}");
        before = map;
    }
}

#[test]
fn a_long_map_has_longer_rows() {
    let Some(gpu) = gpu() else { return };
    let forge = Forge { sizes: &[(9, 9), (2999, 3001)], bits: [9, 9, 2, 8, 6], block: 4, ..Forge::default() };
    let case = epitome_case("long", Forge { split: false, ..forge });
    assert!(case.subject.form().planes[0].width > 64);
    let texture = case.subject.upload(gpu);
    for surface in [0, 1] {
        let view = View { surface, size: (61, 67), uv: askew(), lookup: Lookup::Nearest { level: 0 } };
        let wanted = case.subject.view(&view, AddressMode::Clamp);
        assert_close(&case.name, &gpu.sample(&texture, &view).unwrap(), &wanted, case.bounds.nearest);
    }
}

#[test]
fn the_footprint_counts_the_bytes_that_are_uploaded() {
    let Some(gpu) = gpu() else { return };
    for case in cases() {
        let form = case.subject.form();
        assert_eq!(8 * gpu.upload(&form).unwrap().bytes(), form.bits_memory(), "{}", case.name);
    }
}

//! What is done with files that anybody may have written: by the tests here, and by the fuzz targets in `fuzz/`.

use std::sync::LazyLock;

use glam::Vec3;
use texfold::{
    AnyImage, AnyTexture, Encoded, ImageAddress, Limits, Rect, Texel,
    core::{Budget, Domain, Image2d, ImageSize, LightAddress},
    dct::DctImages,
    lightfield::LightTexture,
    open,
};
use texfold::{
    core::container::{CodecId, SectionWriter, Sections},
    open_with,
};
use texfold_testkit::dct;

/// More than any of the seeds needs, far less than a hostile size would take.
const LIMITS: Limits = Limits { texels: 1 << 18, bytes: 16 << 20, sections: 64 };
/// Longest side of a region that is decoded.
const REGION_SIDE: u32 = 40;
/// The same, for compute passes on the CPU.
const PASSES_SIDE: u32 = 16;
/// Most images that are looked at, and levels of each: the first level of the second stage is among them.
const MOST_IMAGES: u32 = 2;
const MOST_LEVELS: u32 = 4;

/// A golden file.
macro_rules! golden {
    ($name:literal) => {
        include_bytes!(concat!("../../../../fixtures/golden/", $name, ".txf"))
    };
}

/// Files of every codec. Those with content in blocks come first: images with mip levels, images with alpha, a zoom stack, an
/// epitome, a light field.
const SEEDS: [&[u8]; 15] = [
    golden!("dct"),
    golden!("dct_alpha"),
    golden!("zipmap_block"),
    golden!("epitome_block"),
    golden!("lightfield_block"),
    golden!("bc_bc7"),
    golden!("epitome"),
    golden!("epitome_errors"),
    golden!("epitome_layers"),
    golden!("lightfield"),
    golden!("progressive"),
    golden!("progressive_turned"),
    golden!("vq_bc1_mips"),
    golden!("vq_raw_sequence"),
    golden!("zipmap"),
];
/// Files with content in blocks.
const WITH_BLOCKS: usize = 5;

/// Files and sections that are forged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Forged {
    /// Block content, and what says how large images are and where they lie.
    Blocks,
    /// All sections of files of every codec.
    Sections,
}

/// Loads a file of any codec, within small limits; whatever loads is decoded, drawn from, handed to a GPU and stored, and what is
/// stored loads again. Whether it loads.
pub fn open_any(bytes: &[u8]) -> bool {
    let Ok(texture) = open_with(bytes, &LIMITS) else { return false };
    match &texture {
        AnyTexture::Image(image) => {
            exercise_image(image.as_encoded());
            exercise_passes(image);
        }
        AnyTexture::Light(light) => exercise_light(light),
    }
    let stored = texture.to_bytes();
    // Within the usual limits: the file itself is held, too.
    let again = open(&stored).expect("what is stored loads");
    assert_eq!(again.to_bytes(), stored, "what is stored is stored alike");
    true
}

fn exercise_image(image: &dyn Encoded<Domain = Image2d>) {
    let layout = image.layout();
    for index in 0..(layout.images.len() as u32).min(MOST_IMAGES) {
        for level in (0..layout.levels).take(MOST_LEVELS as usize) {
            let Some(whole) = layout.whole(index, level) else { continue };
            let (right, bottom) = (whole.width - 1, whole.height - 1);
            for (x, y) in [(0, 0), (right, bottom), (right / 2, bottom / 3), (u32::MAX, u32::MAX)] {
                assert!(image.texel(ImageAddress { image: index, level, x, y }).is_finite());
            }
            let region = corner(whole, REGION_SIDE);
            let mut texels = vec![Texel::ZERO; Image2d::len(region)];
            image.decode(region, &mut texels).expect("the region lies inside");
            assert!(texels.iter().all(|texel| texel.is_finite()));
        }
    }
    let _ = (image.memory().compressed, image.footprint());
}

/// What the compute passes of blocks give, on the CPU, is what decoding gives, whatever the streams hold.
fn exercise_passes(image: &AnyImage) {
    let form = image.as_encoded().gpu();
    let images = image.downcast_ref::<DctImages>();
    for (number, blocks) in form.blocks.iter().enumerate().take(MOST_LEVELS as usize) {
        let region = corner(whole_of(blocks.layout.size), PASSES_SIDE);
        let drawn = dct::decode(blocks, region).expect("the region lies inside");
        if let Some(stage) = images.and_then(|images| images.content().stages().get(number)) {
            let mut texels = vec![0; drawn.len()];
            stage.decode(region, &mut texels).expect("the region lies inside");
            assert!(drawn == texels, "passes and decoding differ");
        }
    }
}

fn whole_of(size: ImageSize) -> Rect {
    Rect { image: 0, level: 0, x: 0, y: 0, width: size.width, height: size.height }
}

/// The last texels of a level, whose blocks may be cut.
fn corner(whole: Rect, side: u32) -> Rect {
    let (width, height) = (whole.width.min(side), whole.height.min(side));
    Rect { x: whole.width - width, y: whole.height - height, width, height, ..whole }
}

fn exercise_light(light: &LightTexture) {
    let triangles = light.layout().triangles;
    for triangle in [0, triangles / 2, triangles.saturating_sub(1), u32::MAX] {
        let barycentric = Vec3::new(0.2, 0.3, 0.5);
        let at = LightAddress { triangle, barycentric, direction: Vec3::Z };
        assert!(light.texel(at).is_finite());
    }
    for blocks in light.gpu().blocks.iter().take(MOST_LEVELS as usize) {
        dct::decode(blocks, corner(whole_of(blocks.layout.size), PASSES_SIDE))
            .expect("the region lies inside");
    }
    let _ = (light.memory().compressed, light.footprint());
}

/// A file as its sections.
type Parts = (u16, Vec<([u8; 4], Vec<u8>)>);

/// Reads `data` as an instruction to forge a file of a correct container, and opens that: sections are changed as they are before
/// compression, and checksums are right. The first bytes name a seed, a section, what is done with it (`data[2]`) and where; the
/// rest is what is put there. True where it loads; `None` where `data` is too short.
pub fn open_forged(data: &[u8], forged: Forged) -> Option<bool> {
    let (&[seed, section, what, low, high], rest) = data.split_first_chunk()?;
    static PARTS: LazyLock<Vec<Parts>> = LazyLock::new(|| SEEDS.iter().map(|seed| parts_of(seed)).collect());
    let seeds = if forged == Forged::Blocks { &PARTS[..WITH_BLOCKS] } else { &PARTS[..] };
    let (codec, mut sections) = seeds[usize::from(seed) % seeds.len()].clone();
    let can_be = |at: &usize| forged == Forged::Sections || is_block_content(sections[*at].0);
    let forgeable: Vec<usize> = (0..sections.len()).filter(can_be).collect();
    let target = forgeable[usize::from(section) % forgeable.len()];
    let other = &seeds[usize::from(seed / 16) % seeds.len()].1;
    let other = &other[usize::from(section / 16) % other.len()].1;
    let raw = &mut sections[target].1;
    let at = usize::from(u16::from_le_bytes([low, high])) % (raw.len() + 1);
    change(raw, (what, at), rest, other);
    let mut writer = SectionWriter::new(CodecId { number: codec, name: "" });
    sections.iter().for_each(|(id, raw)| writer.section("", *id, raw));
    Some(open_any(&writer.finish().bytes))
}

/// Sections of block content, and what says how large images are and where they lie.
fn is_block_content(id: [u8; 4]) -> bool {
    matches!(&id, [b'R', b'B', b'B' | b'D', _] | b"ZMFM" | b"LAYO")
}

fn parts_of(file: &[u8]) -> Parts {
    let mut budget = Budget::default();
    let sections = Sections::parse(file, &mut budget).expect("seeds are files");
    let ids: Vec<[u8; 4]> = sections.ids().map(|(id, _)| id).collect();
    let raw = |id: [u8; 4]| (id, sections.read(id, &mut Budget::default()).expect("seeds are whole"));
    (sections.codec(), ids.into_iter().map(raw).collect())
}

/// Changes a section from `at` on.
fn change(raw: &mut Vec<u8>, (what, at): (u8, usize), rest: &[u8], other: &[u8]) {
    match what % 8 {
        // Other bytes, one here and one there: pairs of how far on and what.
        0..=2 => {
            let mut place = at;
            for pair in rest.chunks_exact(2) {
                if let Some(byte) = raw.get_mut(place) {
                    *byte = pair[1];
                }
                place += 1 + usize::from(pair[0] % 32);
            }
        }
        3 => {
            let end = (at + rest.len()).min(raw.len());
            raw[at..end].copy_from_slice(&rest[..end - at]);
        }
        4 => {
            raw.truncate(at);
            raw.extend(rest);
        }
        5 => drop(raw.splice(at..at, rest.iter().copied())),
        6 => drop(raw.drain(at..(at + rest.len()).min(raw.len()))),
        // The end of another section.
        _ => {
            raw.truncate(at);
            raw.extend(&other[at.min(other.len())..]);
        }
    }
}

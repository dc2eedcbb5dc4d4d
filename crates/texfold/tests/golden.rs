//! Files of format version 2, which decode to the same images; from release 0.1 on for ever.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::path::PathBuf;

use texfold::core::metric::decode_image;
use texfold::{
    Access, Encoded,
    core::{Budget, Layers},
    lightfield::Renderer,
};
use texfold::{core::container::Sections, open};
use texfold_testkit::capture::{Look, sphere};

fn golden(name: &str) -> PathBuf {
    texfold_testkit::fixtures_dir().join("golden").join(name)
}

/// Level 0 of the file's images equals the golden images, to the last 8-bit step.
fn assert_decodes(name: &str, images: &[String]) {
    assert_level_decodes(name, 0, images);
}

/// As [`assert_decodes`], for level `level`.
fn assert_level_decodes(name: &str, level: u32, images: &[String]) {
    let bytes = std::fs::read(golden(&format!("{name}.txf"))).unwrap();
    let texture = open(&bytes).unwrap().into_image().unwrap();
    assert_eq!(texture.as_encoded().layout().images.len(), images.len(), "{name}");
    for (index, image) in images.iter().enumerate() {
        let wanted = texfold_testkit::png(&golden(image));
        let decoded = decode_image(texture.as_encoded(), index as u32, level).unwrap();
        assert_eq!(decoded.size(), wanted.size(), "{name}");
        assert!(decoded.to_bytes() == wanted.to_bytes(), "{name}: {image} decodes otherwise than before");
    }
}

#[test]
fn plain_bc7_decodes_as_ever() {
    assert_decodes("bc_bc7", &["bc_bc7.png".to_owned()]);
}

#[test]
fn vq_with_a_bc1_codebook_and_mips_decodes_as_ever() {
    assert_decodes("vq_bc1_mips", &["vq_bc1_mips.png".to_owned()]);
}

#[test]
fn a_vq_sequence_decodes_as_ever() {
    let frames: Vec<String> = (0..5).map(|frame| format!("vq_raw_sequence-{frame:03}.png")).collect();
    assert_decodes("vq_raw_sequence", &frames);
}

/// Two epitomes, leaves of two sizes, 2x2 matrices, tones and mip levels. While the form of the file is not released,
/// it is written anew by
/// `texfold compress fixtures/images/tile_repeat.png --codec epitome --access texel --effort fast --psnr 30 --mips --out .`
/// and its images by `texfold decompress tile_repeat.txf --out .` without and with `--lod 2`.
#[test]
fn an_epitome_of_two_formats_decodes_as_ever() {
    assert_decodes("epitome", &["epitome.png".to_owned()]);
    assert_level_decodes("epitome", 2, &["epitome-level2.png".to_owned()]);
}

/// Stages whose tables begin from the preset, written by `texfold compress fixtures/images/zebra.png --codec dct --effort fast --bpp 2 --mips
/// --out .` and its images by `texfold decompress zebra.txf --out .` without and with `--lod 2`.
#[test]
fn blocks_with_preset_tables_decode_as_ever() {
    assert_decodes("dct_preset", &["dct_preset.png".to_owned()]);
    assert_level_decodes("dct_preset", 2, &["dct_preset-level2.png".to_owned()]);
}

/// Dependent quantisers, alpha and mip levels, written by `texfold compress fixtures/images/cutout.png --codec dct --effort fast --bpp 2 --mips
/// --out .` and its images by `texfold decompress cutout.txf --out .` without and with `--lod 2`.
#[test]
fn blocks_with_dependent_quantisers_decode_as_ever() {
    assert_decodes("dct_dependent", &["dct_dependent.png".to_owned()]);
    assert_level_decodes("dct_dependent", 2, &["dct_dependent-level2.png".to_owned()]);
}

/// Superblocks of the image's means that are smaller than its own, written by `texfold compress fixtures/images/facade.png --codec dct
/// --effort fast --bpp 0.5 --mips --out .` and its images by `texfold decompress facade.txf --out .` with `--lod 1` and `--lod 3`.
#[test]
fn blocks_with_small_bases_decode_as_ever() {
    for level in [1, 3] {
        assert_level_decodes("dct_small_bases", level, &[format!("dct_small_bases-level{level}.png")]);
    }
}

/// Blocks with intra modes, written by `texfold compress fixtures/images/terrain.png --codec dct --effort fast --bpp 1 --mips --out .` and its
/// images by `texfold decompress terrain.txf --out .` without and with `--lod 1`.
#[test]
fn blocks_with_intra_modes_decode_as_ever() {
    assert_decodes("dct_intra", &["dct_intra.png".to_owned()]);
    assert_level_decodes("dct_intra", 1, &["dct_intra-level1.png".to_owned()]);
}

/// Maps of a material, of unlike sizes and pixels: the fixtures cutout, normal_map and gray under the names `m_BaseColor.png`, `m_Normal.png` and
/// `m_Height.png` in a folder, written by `texfold compress FOLDER --as material --bpp 3 --mips --effort fast --out .` and its images by
/// `texfold decompress m.txf --out .`.
#[test]
fn maps_of_a_material_decode_as_ever() {
    assert_decodes("dct_material", &[0, 1, 2].map(|map| format!("dct_material-00{map}.png")));
    let bytes = std::fs::read(golden("dct_material.txf")).unwrap();
    let texture = open(&bytes).unwrap().into_image().unwrap();
    let maps = &texture.as_encoded().layout().maps;
    let found: Vec<(&str, &str)> = maps.iter().map(|map| (map.kind.name(), map.name.as_str())).collect();
    assert_eq!(found, [("color", "m_BaseColor"), ("normal", "m_Normal"), ("height", "m_Height")]);
}

/// Maps of a material, of one size: the fixtures cutout, normal_map, ramp and zebra as `m_BaseColor.png`, `m_Normal.png`, `m_Roughness.png` and
/// `m_Height.png`, written as those above.
#[test]
fn maps_of_one_size_decode_as_ever() {
    assert_decodes("dct_maps", &[0, 1, 2, 3].map(|map| format!("dct_maps-00{map}.png")));
}

/// An epitome and coarse mip levels in blocks of variable length, written by
/// `texfold compress fixtures/images/tile_repeat.png --codec epitome --effort fast --psnr 30 --mips --out .`
/// and its images by `texfold decompress tile_repeat.txf --out .` without and with `--lod LEVEL`.
#[test]
fn an_epitome_in_blocks_decodes_as_ever() {
    assert_decodes("epitome_block", &["epitome_block.png".to_owned()]);
    assert_level_decodes("epitome_block", 2, &["epitome_block-level2.png".to_owned()]);
    assert_level_decodes("epitome_block", 4, &["epitome_block-level4.png".to_owned()]);
}

/// Content with a residual plane, and mip levels. While the form of the file is not released, it is written anew by
/// `texfold compress fixtures/images/salient.png --codec epitome --content error-map --effort fast --psnr 28 --mips --out .`
/// and its images by `texfold decompress salient.txf --out .` without and with `--lod 2`.
#[test]
fn an_epitome_with_an_error_map_decodes_as_ever() {
    assert_decodes("epitome_errors", &["epitome_errors.png".to_owned()]);
    assert_level_decodes("epitome_errors", 2, &["epitome_errors-level2.png".to_owned()]);
}

/// Three layers with mip levels, and what a prefix with one of them shows. While the form of the file is not released, it is
/// written anew by
/// `texfold compress fixtures/images/odd_37x61.png --codec epitome --effort fast --psnr 28 --mips --layers 3 --out .`
/// and its images by `texfold decompress odd_37x61.txf --out .` without and with `--layers 1`.
#[test]
fn a_progressive_epitome_decodes_as_ever() {
    assert_decodes("epitome_layers", &["epitome_layers.png".to_owned()]);
    let bytes = std::fs::read(golden("epitome_layers.txf")).unwrap();
    let sections = Sections::parse(&bytes, &mut Budget::default()).unwrap();
    assert!(sections.has(*b"EPA2") && !sections.has(*b"EPA3"));
    let ends_first = |length: &usize| {
        Sections::parse(&bytes[..*length], &mut Budget::default()).is_ok_and(|part| part.has(*b"EPA0"))
    };
    let end = (0..bytes.len()).find(ends_first).unwrap();
    let prefix = open(&bytes[..end]).unwrap().into_image().unwrap();
    assert_eq!(prefix.as_encoded().layers(), Layers { loaded: 1, total: 3 });
    let wanted = texfold_testkit::png(&golden("epitome_layers-layer1.png"));
    assert!(decode_image(prefix.as_encoded(), 0, 0).unwrap().to_bytes() == wanted.to_bytes());
}

/// The same capture in blocks: written by `texfold compress fixtures/captures/ball --codec lightfield --out .`, and its image as that of
/// [`a_light_field_is_drawn_as_ever`].
#[test]
fn a_light_field_in_blocks_is_drawn_as_ever() {
    let bytes = std::fs::read(golden("lightfield_block.txf")).unwrap();
    let texture = open(&bytes).unwrap().into_light().unwrap();
    assert_eq!((texture.layers(), texture.access()), (Layers { loaded: 2, total: 2 }, Access::Block));
    let camera = sphere(Look::Glossy, 20, 40).views[7].camera;
    let drawn = Renderer::new(&texture).render(&camera);
    let wanted = texfold_testkit::png(&golden("lightfield_block.png")).to_bytes();
    assert!(drawn.as_flattened() == wanted, "the light field is drawn otherwise than before");
}

/// A light field of the capture fixture in planes, as its eighth camera sees it. While the form of the file is not released, it is written
/// anew by `texfold compress fixtures/captures/ball --codec lightfield --access texel --out .` and its image by
/// `texfold render ball.txf --camera fixtures/captures/ball/transforms.json --out . --cpu`, which is `007.png`.
#[test]
fn a_light_field_is_drawn_as_ever() {
    let bytes = std::fs::read(golden("lightfield.txf")).unwrap();
    let texture = open(&bytes).unwrap().into_light().unwrap();
    assert_eq!(texture.layers(), Layers { loaded: 2, total: 2 });
    let camera = sphere(Look::Glossy, 20, 40).views[7].camera;
    let drawn = Renderer::new(&texture).render(&camera);
    let wanted = texfold_testkit::png(&golden("lightfield.png")).to_bytes();
    assert!(drawn.as_flattened() == wanted, "the light field is drawn otherwise than before");
}

/// A base and a residual plane with mip levels, and what a prefix without the residual plane decodes to. While the form of the file is not
/// released, it is written anew by
/// `texfold compress fixtures/images/odd_37x61.png --codec progressive --effort fast --psnr 32 --mips --out .`
/// and its images by `texfold decompress odd_37x61.txf --out .` without any, with `--lod 2` and with `--layers 1`.
#[test]
fn a_base_and_an_error_map_decode_as_ever() {
    assert_decodes("progressive", &["progressive.png".to_owned()]);
    assert_level_decodes("progressive", 2, &["progressive-level2.png".to_owned()]);
    let bytes = std::fs::read(golden("progressive.txf")).unwrap();
    // The residual plane is the last section.
    let prefix = open(&bytes[..bytes.len() - 1]).unwrap().into_image().unwrap();
    assert_eq!(prefix.as_encoded().layers(), Layers { loaded: 1, total: 2 });
    let wanted = texfold_testkit::png(&golden("progressive-base.png"));
    assert!(decode_image(prefix.as_encoded(), 0, 0).unwrap().to_bytes() == wanted.to_bytes());
}

/// A residual plane along axes of its own. It was written by
/// `texfold compress fixtures/images/stripes.png --codec progressive --metric psnr --bpp 2 --mips --out .`, its images by
/// `texfold decompress stripes.txf --out .` without and with `--lod 2`.
#[test]
fn a_residual_along_axes_of_its_own_decodes_as_ever() {
    assert_decodes("progressive_turned", &["progressive_turned.png".to_owned()]);
    assert_level_decodes("progressive_turned", 2, &["progressive_turned-level2.png".to_owned()]);
    let bytes = std::fs::read(golden("progressive_turned.txf")).unwrap();
    let file = Sections::parse(&bytes, &mut Budget::default()).unwrap();
    let form = file.read(*b"RSF0", &mut Budget::default()).unwrap();
    assert_eq!((form[2] >> 4, form.len()), (1, 3 + 14 + 64 + 4));
}

/// A base whose alpha has its contrast raised. It was written by
/// `texfold compress fixtures/images/cutout.png --codec progressive --effort fast --bpp 1.5 --mips --out .`, its images by
/// `texfold decompress cutout.txf --out .` without and with `--lod 2`.
#[test]
fn alpha_of_raised_contrast_decodes_as_ever() {
    assert_decodes("progressive_cutout", &["progressive_cutout.png".to_owned()]);
    assert_level_decodes("progressive_cutout", 2, &["progressive_cutout-level2.png".to_owned()]);
    let bytes = std::fs::read(golden("progressive_cutout.txf")).unwrap();
    let file = Sections::parse(&bytes, &mut Budget::default()).unwrap();
    assert_eq!(file.read(*b"RSF0", &mut Budget::default()).unwrap()[1] >> 6, 3);
}

/// DCT superblocks with mip levels of two stages, and what a prefix without the images' own superblocks shows; and
/// blocks with alpha. They were written by `texfold compress fixtures/images/NAME.png --codec dct --bpp 2 --mips --out .` of
/// `odd_37x61` and `cutout`, and their images by `texfold decompress NAME.txf --out .` without any, with `--lod LEVEL` and with
/// `--layers 1`.
#[test]
fn blocks_of_variable_length_decode_as_ever() {
    assert_decodes("dct", &["dct.png".to_owned()]);
    assert_level_decodes("dct", 2, &["dct-level2.png".to_owned()]);
    assert_level_decodes("dct", 4, &["dct-level4.png".to_owned()]);
    let bytes = std::fs::read(golden("dct.txf")).unwrap();
    let prefix = open(&bytes[..bytes.len() - 1]).unwrap().into_image().unwrap();
    assert_eq!(prefix.as_encoded().layers(), Layers { loaded: 1, total: 2 });
    let wanted = texfold_testkit::png(&golden("dct-base.png"));
    assert!(decode_image(prefix.as_encoded(), 0, 0).unwrap().to_bytes() == wanted.to_bytes());
    assert_decodes("dct_alpha", &["dct_alpha.png".to_owned()]);
    assert_level_decodes("dct_alpha", 1, &["dct_alpha-level1.png".to_owned()]);
}

/// A root in two planes with two patches in one, by hand. While the form of the file is not released, it is written anew by
/// `texfold compress STACK --content raw --out .` of a folder with the fixtures `odd_37x61.png` and `cutout.png` and this
/// `zipmap.toml`, and its images by `texfold decompress zipmap.txf --out .` with `--lod 2` and `--lod 5`:
///
/// ```toml
/// root = "odd_37x61.png"
/// [[patch]]
/// image = "cutout.png"
/// matrix = [1.8, 0.3, -0.55, -0.3, 1.8, -0.25, 0.1, 0.0, 1.0]
/// [[patch]]
/// image = "odd_37x61.png"
/// matrix = [3.0, 0.0, -1.0, 0.0, 3.0, -1.0, 0.0, 0.0, 1.0]
/// parent = "cutout.png"
/// ```
#[test]
fn a_zipmap_decodes_as_ever() {
    assert_level_decodes("zipmap", 2, &["zipmap-level2.png".to_owned()]);
    assert_level_decodes("zipmap", 5, &["zipmap-level5.png".to_owned()]);
}

/// The same stack in blocks with each level of its patches, as they were written before blocks gave means of these.
#[test]
fn a_zipmap_in_blocks_decodes_as_ever() {
    assert_level_decodes("zipmap_block", 2, &["zipmap_block-level2.png".to_owned()]);
    assert_level_decodes("zipmap_block", 5, &["zipmap_block-level5.png".to_owned()]);
}

/// The same stack in blocks with levels of means, written by `texfold compress STACK --as zoom --bpp 3 --out .`, and its images by
/// `texfold decompress zipmap_means.txf --out .` with `--lod 2` and `--lod 3`.
#[test]
fn a_zipmap_in_blocks_with_means_decodes_as_ever() {
    assert_level_decodes("zipmap_means", 2, &["zipmap_means-level2.png".to_owned()]);
    assert_level_decodes("zipmap_means", 3, &["zipmap_means-level3.png".to_owned()]);
}

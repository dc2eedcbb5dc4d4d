//! What the codec promises: goals, mip levels, layers, sets, every kind of pixel, forged files.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{
    Alpha, ColorSpace, Depth, ImageSet, MapKind, MipFilter, PixelInfo, Raster, mip_chain,
};
use texfold_core::metric::{alpha_error, color_error, decode_image, measure, quality};
use texfold_core::rng::Rng;
use texfold_core::{
    Budget, Domain, Effort, Encoded, Encoder, Goal, Image2d, Job, Layers, Rect, Refine, Texel, TextureCodec,
};
use texfold_dct::{Dct, DctImages, DctParams};

fn image(name: &str) -> ImageSet {
    ImageSet::single(texfold_testkit::image(name))
}

fn encode(set: &ImageSet, params: &DctParams) -> DctImages {
    Dct::encode(set, params, &mut Job::default()).unwrap()
}

fn to(goal: Goal) -> DctParams {
    DctParams::default().with_goal(goal)
}

fn bytes(texture: &DctImages) -> Vec<u8> {
    let mut writer = SectionWriter::new(Dct::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

fn load(bytes: &[u8]) -> DctImages {
    let mut budget = Budget::default();
    Dct::load(&Sections::parse(bytes, &mut budget).unwrap(), &mut budget).unwrap()
}

#[test]
fn goals_are_met_and_little_more() {
    let set = image("terrain");
    for psnr in [28.0, 34.0, 40.0] {
        let texture = encode(&set, &to(Goal::Psnr(psnr)));
        let found = measure(&set, &texture);
        assert!((0.0..0.1).contains(&(found.psnr - psnr)), "{psnr}: {found:?}");
    }
    for bpp in [0.5, 1.0, 2.0, 4.0, 6.0] {
        let texture = encode(&set, &to(Goal::Bpp(bpp)));
        let found = measure(&set, &texture);
        assert!(found.bpp <= bpp && found.bpp > 0.97 * bpp, "{bpp}: {found:?}");
        // What is counted is what is held, and what the file has beside its notes and sections.
        assert_eq!(texture.memory(), texture.gpu().memory());
        let file = 8.0 * bytes(&texture).len() as f64 / set.texel_count() as f64;
        assert!(file > found.bpp && file < found.bpp + 0.1, "{file} {found:?}");
    }
    for tolerance in [24.0, 8.0] {
        let found = measure(&set, &encode(&set, &to(Goal::Tolerance(tolerance))));
        assert!(found.worst_block_rms <= tolerance, "{tolerance}: {found:?}");
    }
}

#[test]
fn the_nearest_is_given_where_no_step_meets_the_goal() {
    let tiny = ImageSet::single(texfold_testkit::image("odd_37x61"));
    let texture = encode(&tiny, &to(Goal::Psnr(200.0)));
    assert!(texture.notes().verdict.contains("out of reach"), "{}", texture.notes().verdict);
}

#[test]
fn every_level_is_as_good_as_the_goal_asks_and_all_cost_little() {
    for name in ["terrain", "facade", "salient"] {
        let set = image(name);
        let texture = encode(&set, &to(Goal::Psnr(36.0)).with_mips(true));
        let levels = set.full_levels();
        assert_eq!(texture.layout().levels, levels);
        let chain = mip_chain(&set.images()[0], levels, MipFilter::Box);
        for (level, wanted) in chain.iter().enumerate() {
            let decoded = decode_image(&texture, 0, level as u32).unwrap();
            let psnr = color_error(wanted, &decoded).psnr();
            assert!(psnr > 33.0, "{name}, level {level}: {psnr}");
        }
        let alone = encode(&set, &to(Goal::Psnr(36.0)));
        let ratio = measure(&set, &texture).bpp / measure(&set, &alone).bpp;
        assert!(ratio < 1.1, "{name}: {ratio}");
    }
}

#[test]
fn a_prefix_is_a_soft_image_and_takes_the_rest_as_it_arrives() {
    let set = image("terrain");
    let texture = encode(&set, &to(Goal::Psnr(36.0)).with_mips(true));
    let file = bytes(&texture);
    let has_base = |length: &usize| {
        Sections::parse(&file[..*length], &mut Budget::default()).is_ok_and(|part| part.has(*b"RBB0"))
    };
    let end = (0..file.len()).find(has_base).unwrap();
    assert!(end < file.len() / 6, "{end} of {}", file.len());
    let mut loaded = load(&file[..end]);
    assert_eq!(loaded.layers(), Layers { loaded: 1, total: 2 });
    assert!(loaded == texture.first_layers(1));
    let psnr = measure(&set, &loaded).psnr;
    assert!(psnr > 18.0 && psnr < 30.0, "{psnr}");
    let noted = f64::from(texture.notes().psnr_without[0].1);
    assert!((noted - psnr).abs() < 1e-3, "{noted} {psnr}");
    let mut budget = Budget::default();
    let whole = Sections::parse(&file, &mut budget).unwrap();
    assert_eq!(loaded.refine(&whole, &mut budget).unwrap(), ["base", "residual plane"]);
    assert!(loaded == texture && loaded.refine(&whole, &mut budget).unwrap().is_empty());
}

#[test]
fn every_kind_of_pixel_is_stored() {
    let size = (45u32, 30u32);
    for channels in 1..=4u8 {
        for depth in [Depth::Eight, Depth::Sixteen] {
            let count = size.0 * size.1 * u32::from(channels);
            let value =
                |i: u32| (0.5 + 0.4 * (i as f32 / 37.0).sin() * (i as f32 / 911.0).cos()).clamp(0.0, 1.0);
            let alpha = if channels % 2 == 0 { Alpha::Straight } else { Alpha::Opaque };
            let info = PixelInfo { channels, depth, color: ColorSpace::Srgb, alpha };
            let raster = Raster::new(size.0, size.1, info, (0..count).map(value).collect()).unwrap();
            let set = ImageSet::single(raster);
            let texture = encode(&set, &to(Goal::Psnr(38.0)));
            assert!(measure(&set, &texture).psnr >= 38.0, "{channels} {depth:?}");
            let loaded = load(&bytes(&texture));
            assert!(loaded == texture && loaded.layout().pixel == info);
            let rect = Rect { image: 0, level: 0, x: 5, y: 3, width: 21, height: 18 };
            let mut part = vec![Texel::ZERO; 21 * 18];
            loaded.decode(rect, &mut part).unwrap();
            for (index, texel) in part.into_iter().enumerate() {
                assert_eq!(texel, loaded.texel(<Image2d as Domain>::address(rect, index)));
            }
        }
    }
}

#[test]
fn gradients_of_16_bits_have_more_steps_than_8_bits_have() {
    let info = PixelInfo { channels: 1, depth: Depth::Sixteen, ..PixelInfo::default() };
    let data: Vec<f32> = (0..128 * 128).map(|i| 0.5 + (i % 128) as f32 / 128.0 / 64.0).collect();
    let set = ImageSet::single(Raster::new(128, 128, info, data).unwrap());
    let texture = encode(&set, &to(Goal::Bpp(4.0)));
    let decoded = decode_image(&texture, 0, 0).unwrap();
    let steps: std::collections::BTreeSet<u32> = decoded.values().map(f32::to_bits).collect();
    assert!(steps.len() > 60, "{} steps of 4 that 8 bits have", steps.len());
}

#[test]
fn images_of_a_set_share_a_step() {
    let names = ["terrain", "facade", "odd_37x61"];
    let set = ImageSet::new(names.map(texfold_testkit::image).to_vec()).unwrap();
    let texture = encode(&set, &to(Goal::Bpp(1.5)).with_mips(true));
    let found = measure(&set, &texture);
    assert!(found.bpp <= 1.5 && found.bpp > 1.47, "{found:?}");
    let images = texture.content().stages();
    let steps: Vec<u16> = images.iter().map(|image| image.form().quantiser.step).collect();
    // Stages of two images of 256x256 texels, and of one of 37x61: each is finer than the one before.
    let (first, second, third) = (steps[0], steps[1], steps[2]);
    assert_eq!(steps, [first, second, third, first, second, third, first, second]);
    assert!(third < second && second < first);
}

#[test]
fn alpha_is_coded_like_a_channel() {
    let opaque = texfold_testkit::image("terrain").with_channels(4);
    let texel = |(i, texel): (usize, Texel)| texel.truncate().extend((i % 256) as f32 / 255.0);
    let info = PixelInfo { channels: 4, alpha: Alpha::Straight, ..opaque.info() };
    let texels: Vec<Texel> = opaque.texels().enumerate().map(texel).collect();
    let set = ImageSet::single(Raster::from_texels(256, 256, info, &texels).unwrap());
    let texture = encode(&set, &to(Goal::Bpp(1.0)));
    let quality = quality(&set, &texture);
    assert!(quality.alpha.unwrap().psnr() > 40.0, "{quality:?}");
    let decoded = decode_image(&texture, 0, 0).unwrap();
    assert!(alpha_error(&set.images()[0], &decoded).is_some());
}

#[test]
fn more_bits_are_never_worse() {
    for name in ["terrain", "salient", "noise"] {
        let set = image(name);
        let mut before = 0.0;
        for step in 0..12 {
            let bpp = 0.2 * 1.3f64.powi(step);
            let found = measure(&set, &encode(&set, &to(Goal::Bpp(bpp)).with_effort(Effort::Fast)));
            assert!(found.psnr > before, "{name} at {bpp}: {found:?} after {before}");
            before = found.psnr;
        }
    }
}

#[test]
fn forged_files_decode_or_are_refused() {
    let set = image("odd_37x61");
    let texture = encode(&set, &to(Goal::Bpp(2.0)).with_mips(true));
    let mut rng = Rng::new(11);
    let (mut opened, mut refused) = (0, 0);
    for _ in 0..300 {
        // Past the checksums: sections are written again with damaged bytes.
        let mut out = SectionWriter::new(Dct::ID);
        texture.notes().write(&mut out);
        texfold_core::container::write_layout(texture.layout(), &mut out);
        let mut parts: Vec<Vec<u8>> = vec![Vec::new(), Vec::new()];
        for image in texture.content().stages() {
            parts[0].extend(image.base_bytes());
            parts[1].extend(image.detail_bytes());
        }
        for _ in 0..1 + rng.below(6) {
            let part = &mut parts[rng.below(2) as usize];
            let at = rng.below(part.len() as u32) as usize;
            part[at] = rng.below(256) as u8;
        }
        out.section("base", *b"RBB0", &parts[0]);
        out.section("residual plane", *b"RBD0", &parts[1]);
        let bytes = out.finish().bytes;
        let mut budget = Budget::default();
        let file = Sections::parse(&bytes, &mut budget).unwrap();
        match Dct::load(&file, &mut budget) {
            Ok(forged) => {
                opened += 1;
                for level in 0..forged.layout().levels {
                    let _ = decode_image(&forged, 0, level).unwrap();
                }
                let _ = (forged.gpu(), forged.footprint());
            }
            Err(_) => refused += 1,
        }
    }
    assert!(opened > 30 && refused > 30, "{opened} {refused}");
}

/// A material: colours with opacity, normals, gray of 16 bits at half the size, a constant map.
fn material() -> ImageSet {
    let color = texfold_testkit::image("terrain").with_channels(3);
    let (width, height) = (color.size().width, color.size().height);
    let height_at = |x: u32, y: u32| {
        let texel = color.texel(x.min(width - 1), y.min(height - 1));
        texel.x + texel.y + texel.z
    };
    let normals = (0..width * height).flat_map(|at| {
        let (x, y) = (at % width, at / width);
        let slope = glam::Vec3::new(
            height_at(x, y) - height_at(x + 1, y),
            height_at(x, y) - height_at(x, y + 1),
            4.0,
        );
        (0.5 * slope.normalize() + 0.5).to_array()
    });
    let normals: Vec<f32> = normals.collect();
    let info = |channels, color| PixelInfo { channels, color, ..PixelInfo::default() };
    let normals = Raster::new(width, height, info(3, ColorSpace::Normal), normals).unwrap();
    let half = (0..width / 2 * (height / 2)).map(|at| {
        let (x, y) = (at % (width / 2), at / (width / 2));
        (height_at(2 * x, 2 * y) * 21_845.0) as u16
    });
    let half: Vec<u16> = half.collect();
    let half = Raster::from_u16(width / 2, height / 2, 1, ColorSpace::Linear, &half).unwrap();
    let constant = vec![77; (width * height) as usize];
    let constant = Raster::from_u8(width, height, 1, ColorSpace::Linear, &constant).unwrap();
    let maps = vec![
        (MapKind::BaseColor, "m_Color".to_owned(), color),
        (MapKind::Normal, "m_Normal".to_owned(), normals),
        (MapKind::Height, "m_Height".to_owned(), half),
        (MapKind::Metalness, "m_Metalness".to_owned(), constant),
    ];
    ImageSet::of_maps(maps).unwrap()
}

#[test]
fn maps_of_a_material_keep_their_size_pixels_and_names_and_meet_a_goal_together() {
    let set = material();
    let bpp = 6.0;
    let texture = load(&bytes(&encode(&set, &to(Goal::Bpp(bpp)).with_mips(true))));
    let layout = texture.layout();
    assert_eq!(layout, &set.layout(set.full_levels()));
    let found = texture.memory().goal as f64 / set.texel_count() as f64;
    assert!(found <= bpp && found > 0.96 * bpp, "{found}");
    for (number, image) in (0..).zip(set.images()) {
        let decoded = decode_image(&texture, number, 0).unwrap();
        assert_eq!((decoded.size(), decoded.info()), (image.size(), image.info()));
        let psnr = color_error(image, &decoded).psnr();
        assert!(psnr > 33.0, "{}: {psnr}", layout.maps[number as usize].name);
        let small = decode_image(&texture, number, 2).unwrap();
        assert_eq!((small.size(), small.info()), (image.size().at_level(2), image.info()));
    }
    // A constant map costs nothing but its header, tables and index.
    assert!(texture.content().held_bytes_of(3) < 700, "{}", texture.content().held_bytes_of(3));
    // Decoded on a GPU, 16 bits take floats.
    let deep = texture.gpu().blocks.iter().filter(|stage| stage.layout.depth == 16).count();
    assert_eq!(deep, texture.content().stages_of(2).len());
}

#[test]
fn a_weight_of_a_kind_of_map_moves_bits_to_it() {
    let set = material();
    let errors = |weights: Vec<(MapKind, f64)>| {
        let texture = encode(&set, &to(Goal::Bpp(4.0)).with_weights(weights));
        [0, 1, 2].map(|map| {
            color_error(&set.images()[map as usize], &decode_image(&texture, map, 0).unwrap()).mse()
        })
    };
    let (even, moved) = (errors(Vec::new()), errors(vec![(MapKind::Normal, 4.0)]));
    assert!(moved[1] < 0.7 * even[1] && moved[0] > even[0] && moved[2] > even[2], "{even:?} {moved:?}");
    // Maps of 8 and of 16 bits have errors alike in parts of their range.
    assert!(even[2] < 4.0 * even[1] && even[1] < 4.0 * even[2], "{even:?}");
    let wrong = to(Goal::Bpp(2.0)).with_weights(vec![(MapKind::Normal, 0.0)]);
    assert!(Dct::encode(&set, &wrong, &mut Job::default()).is_err());
}

#[test]
fn images_of_8_and_16_bits_make_one_set() {
    let eight = texfold_testkit::image("odd_37x61").with_channels(1);
    let sixteen: Vec<u16> = eight.values().map(|value| (value * 65_535.0) as u16).collect();
    let size = eight.size();
    let sixteen = Raster::from_u16(size.width, size.height, 1, ColorSpace::Srgb, &sixteen).unwrap();
    let set = ImageSet::new(vec![eight, sixteen]).unwrap();
    let texture = encode(&set, &to(Goal::Psnr(36.0)));
    assert!(measure(&set, &texture).psnr >= 36.0);
}

#[test]
fn colours_that_alpha_hides_cost_nothing() {
    let cutout = texfold_testkit::image("cutout");
    let mut rng = Rng::new(12);
    let texel = |texel: Texel| {
        let noise = [0; 3].map(|_: u8| rng.below(256) as f32 / 255.0);
        if texel.w == 0.0 { Texel::new(noise[0], noise[1], noise[2], 0.0) } else { texel }
    };
    let texels: Vec<Texel> = cutout.texels().map(texel).collect();
    let noisy =
        Raster::from_texels(cutout.size().width, cutout.size().height, cutout.info(), &texels).unwrap();
    for goal in [Goal::Bpp(2.0), Goal::Psnr(34.0)] {
        let [plain, noisy] = [&cutout, &noisy].map(|image| ImageSet::single(image.clone()));
        let [of_plain, of_noisy] = [&plain, &noisy].map(|set| encode(set, &to(goal)));
        assert_eq!(bytes(&of_plain), bytes(&of_noisy), "{goal:?}");
        assert_eq!(quality(&plain, &of_plain).color, quality(&noisy, &of_noisy).color);
        // A band, and alpha of data, hide nothing.
        for (color, alpha) in [(ColorSpace::Srgb, Alpha::Band), (ColorSpace::Linear, Alpha::Straight)] {
            let other = ImageSet::single(noisy.images()[0].clone().tagged(color, alpha));
            let of_other = bytes(&encode(&other, &to(goal))).len();
            assert!(goal != Goal::Psnr(34.0) || of_other > 2 * bytes(&of_noisy).len(), "{color:?} {alpha:?}");
        }
    }
}

//! What the encoder promises of the form that is read texel by texel: goals, fewer bits than plain blocks, mip levels, layers, every kind of pixel.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use texfold_bc::{Bc, BcParams, Content};
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{Alpha, ColorSpace, ImageSet, MipFilter, PixelInfo, Raster, mip_chain};
use texfold_core::metric::{alpha_error, color_error, decode_image, measure, quality};
use texfold_core::target::Measured;
use texfold_core::{
    Budget, Domain, Effort, EncodeError, Encoded, Encoder, Goal, Image2d, ImageAddress, ImageSize, Job,
    Layers, LoadError, Metric, Rect, Refine, SharedSearch, Texel, TextureCodec,
};
use texfold_progressive::{APRON, Progressive, ProgressiveParams, ProgressiveTexture, Shared};
use texfold_residual::encode::counted_error;
use texfold_testkit::{once, strokes};

fn image(name: &str) -> ImageSet {
    ImageSet::single(texfold_testkit::image(name))
}

/// The texture of these images, made once for all tests.
fn encode(set: &ImageSet, params: &ProgressiveParams) -> ProgressiveTexture {
    static KNOWN: once::Encoded<ProgressiveTexture> = once::Encoded::new();
    KNOWN.get(set, params, || {
        Progressive::encode_shared(set, params, &Shared::default(), &mut Job::default()).unwrap()
    })
}

fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<ProgressiveTexture, LoadError> {
    Progressive::load(file, budget)
}

fn fast(goal: Goal) -> ProgressiveParams {
    ProgressiveParams::default().with_goal(goal).with_effort(Effort::Fast)
}

fn bytes(texture: &ProgressiveTexture) -> Vec<u8> {
    let mut writer = SectionWriter::new(Progressive::ID);
    texture.store(&mut writer);
    writer.finish().bytes
}

fn bc1(set: &ImageSet) -> Measured {
    let params = BcParams::default().with_goal(Goal::Bpp(5.0)).with_content(Content::Bc1).with_reduce_log2(0);
    measure(set, &Bc::encode(set, &params, &mut Job::default()).unwrap())
}

#[test]
fn as_many_bits_as_bc1_are_better_than_bc1() {
    for name in ["terrain", "salient"] {
        let set = image(name);
        let (plain, ours) = (bc1(&set), measure(&set, &encode(&set, &fast(Goal::Bpp(4.0)))));
        assert!(ours.bpp <= 4.0 && ours.psnr > plain.psnr + 0.5, "{name}: {ours:?} {plain:?}");
    }
}

#[test]
fn half_the_bits_of_bc1_are_better_than_bc1_in_a_photograph() {
    let Some(data) = texfold_testkit::data_dir("a photograph beside BC1") else { return };
    let set = ImageSet::single(texfold_testkit::png(&data.join("vq/kodak/kodim19.png")));
    let params = fast(Goal::Bpp(2.0)).with_metric(Metric::Psnr);
    let (plain, ours) = (bc1(&set), measure(&set, &encode(&set, &params)));
    assert!(ours.bpp <= 2.0 && ours.psnr > plain.psnr + 0.5, "{ours:?} {plain:?}");
}

#[test]
fn each_metric_is_best_by_its_own_count() {
    for name in ["terrain", "cloth", "salient"] {
        let set = image(name);
        for bpp in [0.5, 1.0, 2.0] {
            let made = [Metric::Psnr, Metric::Perceptual].map(|metric| {
                let texture = encode(&set, &fast(Goal::Bpp(bpp)).with_metric(metric));
                let decoded: Vec<Texel> = decode_image(&texture, 0, 0).unwrap().texels().collect();
                [Metric::Psnr, Metric::Perceptual].map(|by| counted_error(&set.images()[0], &decoded, by))
            });
            let [squares, eye] = made;
            // Up to a bit, estimates of squares are so far off that either form may have fewer.
            assert!(squares[0] < eye[0] || bpp < 2.0, "{name} at {bpp} bits: {made:?}");
            assert!(eye[1] < squares[1], "{name} at {bpp} bits: {made:?}");
        }
    }
}

#[test]
fn goals_are_met_and_little_more() {
    let set = image("terrain");
    for psnr in [28.0, 34.0, 40.0] {
        let found = measure(&set, &encode(&set, &fast(Goal::Psnr(psnr))));
        assert!((0.0..0.15).contains(&(found.psnr - psnr)), "{psnr}: {found:?}");
    }
    for bpp in [0.5, 1.0, 2.0, 4.0, 6.0] {
        let found = measure(&set, &encode(&set, &fast(Goal::Bpp(bpp))));
        assert!(found.bpp <= bpp && found.bpp > 0.97 * bpp, "{bpp}: {found:?}");
    }
    // In few blocks a cell has all of the error.
    for tolerance in [24.0, 16.0, 12.0, 8.0] {
        let found = measure(&set, &encode(&set, &fast(Goal::Tolerance(tolerance))));
        assert!(found.worst_block_rms <= tolerance, "{tolerance}: {found:?}");
    }
}

#[test]
fn more_effort_is_no_worse() {
    let set = image("terrain");
    let psnr = |effort| {
        let params = ProgressiveParams::default().with_goal(Goal::Bpp(2.0)).with_effort(effort);
        measure(&set, &encode(&set, &params)).psnr
    };
    let (fast, normal) = (psnr(Effort::Fast), psnr(Effort::Normal));
    assert!(normal > fast - 0.02, "{normal} {fast}");
}

#[test]
fn every_level_is_as_good_as_the_goal_asks() {
    let set = image("terrain");
    let params = fast(Goal::Psnr(36.0)).with_mips(true);
    let texture = encode(&set, &params);
    let levels = set.full_levels();
    assert_eq!(texture.layout().levels, levels);
    let chain = mip_chain(&set.images()[0], levels, MipFilter::Box);
    for (level, wanted) in chain.iter().enumerate() {
        let decoded = decode_image(&texture, 0, level as u32).unwrap();
        let psnr = color_error(wanted, &decoded).psnr();
        // The same price of a bit everywhere: a level of few texels may be a little worse than the first, one of less than a block more.
        let least = if wanted.size().width < 8 { 32.0 } else { 33.0 };
        assert!(psnr > least, "level {level}: {psnr}");
    }
    // A third of the texels more, and as many bits for each.
    let alone = encode(&set, &fast(Goal::Psnr(36.0)));
    let ratio = measure(&set, &texture).bpp / measure(&set, &alone).bpp;
    assert!((1.2..1.6).contains(&ratio), "{ratio}");
}

#[test]
fn a_prefix_is_the_enlarged_base_and_takes_the_errors_as_they_arrive() {
    let set = image("terrain");
    let texture = encode(&set, &fast(Goal::Psnr(36.0)).with_mips(true));
    let file = bytes(&texture);
    let has_base = |length: &usize| {
        Sections::parse(&file[..*length], &mut Budget::default()).is_ok_and(|part| part.has(*b"RSB0"))
    };
    let end = (0..file.len()).find(has_base).unwrap();
    let mut budget = Budget::default();
    let part = Sections::parse(&file[..end], &mut budget).unwrap();
    let mut loaded = load(&part, &mut budget).unwrap();
    assert_eq!(loaded.layers(), Layers { loaded: 1, total: 2 });
    assert_eq!(decode_image(&loaded, 0, 0), decode_image(&texture.first_layers(1), 0, 0));
    let psnr = measure(&set, &loaded).psnr;
    assert!(psnr > 18.0 && psnr < 36.0, "{psnr}");
    // What the notes say of the whole without its residual plane is what the prefix decodes to.
    let noted = f64::from(texture.notes().psnr_without[0].1);
    assert!((noted - psnr).abs() < 1e-3, "{noted} {psnr}");
    assert!(loaded.refine(&part, &mut budget).unwrap().is_empty());
    let whole = Sections::parse(&file, &mut budget).unwrap();
    assert_eq!(loaded.refine(&whole, &mut budget).unwrap(), ["residual plane", "uniforms"]);
    assert_eq!(loaded, texture);
    assert!(loaded.refine(&whole, &mut budget).unwrap().is_empty());
}

#[test]
fn every_kind_of_pixel_is_stored() {
    let size = (45u32, 30u32);
    for channels in 1..=4u8 {
        let value = |i: u32| ((i * 37 / 5) % 256) as u8 / 2 + ((i / 90) % 120) as u8;
        let data: Vec<u8> = (0..size.0 * size.1 * u32::from(channels)).map(value).collect();
        let raster = Raster::from_u8(size.0, size.1, channels, ColorSpace::Srgb, &data).unwrap();
        let set = ImageSet::single(raster);
        let texture = encode(&set, &fast(Goal::Psnr(30.0)));
        let found = measure(&set, &texture);
        assert!(found.psnr >= 30.0, "{channels} channels: {found:?}");
        assert!(texture.base_content().fits(set.info()));
    }
    let normals = image("normal_map");
    let raster = normals.images()[0].clone().tagged(ColorSpace::Normal, normals.info().alpha);
    let set = ImageSet::single(raster);
    assert!(measure(&set, &encode(&set, &fast(Goal::Psnr(28.0)))).psnr >= 28.0);
    // Normals of two channels would be rebuilt before errors are added.
    let params = fast(Goal::Psnr(34.0)).with_content(Content::Bc5);
    let refused = Progressive::encode(&set, &params, &mut Job::default());
    assert!(matches!(refused, Err(EncodeError::Params(_))), "{refused:?}");
}

#[test]
fn the_base_is_stored_as_asked() {
    let set = image("terrain");
    for content in [Content::Raw, Content::Bc1, Content::Bc7] {
        for reduce_log2 in 1..=3 {
            let params = fast(Goal::Psnr(34.0)).with_content(content).with_reduce_log2(reduce_log2);
            let texture = encode(&set, &params);
            assert_eq!((texture.base_content(), texture.reduce_log2()), (content, reduce_log2));
            assert!(measure(&set, &texture).psnr >= 34.0, "{content:?} {reduce_log2}");
        }
    }
}

#[test]
fn an_image_that_its_base_holds_has_no_residual_plane() {
    let set = image("constant");
    let texture = encode(&set, &fast(Goal::Psnr(40.0)));
    assert_eq!(texture.layers(), Layers { loaded: 1, total: 1 });
    assert!(texture.notes().verdict.contains("alone"), "{}", texture.notes().verdict);
    let at = |x, y| texture.texel(ImageAddress { image: 0, level: 0, x, y });
    assert_eq!(at(0, 0), at(17, 5));
}

/// Whatever stands in the sections of map and codebook: what loads can be drawn.
fn damaged_maps_load_or_are_named(file: &Sections<'_>, budget: &mut Budget) {
    let mut refused = 0;
    for trial in 0..64usize {
        let mut writer = SectionWriter::new(Progressive::ID);
        for (id, _) in file.ids().collect::<Vec<_>>() {
            let mut raw = file.read(id, budget).unwrap();
            if id == *b"PRMP" || id == *b"PRCB" && trial % 4 == 0 {
                // The head byte by byte, then places further behind; and cut.
                let at = if trial < 32 { trial } else { trial * 131 % raw.len() };
                let at = at.min(raw.len() - 1);
                raw[at] ^= [0xff, 0x01, 0x80][trial % 3];
                if trial % 8 == 7 {
                    raw.truncate(at);
                }
            }
            writer.section("container", id, &raw);
        }
        let bytes = writer.finish().bytes;
        let mut budget = Budget::default();
        let sections = Sections::parse(&bytes, &mut budget).unwrap();
        match load(&sections, &mut budget) {
            Ok(texture) => {
                for (x, y) in [(0, 0), (511, 511), (300, 77)] {
                    let texel = texture.texel(ImageAddress { image: 0, level: 0, x, y });
                    assert!(texel.is_finite());
                }
            }
            Err(_) => refused += 1,
        }
    }
    assert!((16..64).contains(&refused), "{refused}");
}

#[test]
fn what_recurs_is_shown_from_a_codebook() {
    let set = ImageSet::single(strokes((512, 512), 0, 1));
    let goal = Goal::Bpp(0.6);
    let plain = encode(&set, &fast(goal));
    let texture = encode(&set, &ProgressiveParams::default().with_goal(goal));
    assert!(plain.details().is_none() && texture.details().is_some());
    let (without, with) = (measure(&set, &plain), measure(&set, &texture));
    assert!(with.bpp <= 0.6 && with.psnr > without.psnr + 1.0, "{with:?} {without:?}");
    // As it is stored, so it loads; and a texel is what its image shows there.
    let stored = bytes(&texture);
    let mut budget = Budget::default();
    let file = Sections::parse(&stored, &mut budget).unwrap();
    let loaded = load(&file, &mut budget).unwrap();
    assert_eq!(loaded, texture);
    damaged_maps_load_or_are_named(&file, &mut budget);
    let whole = decode_image(&loaded, 0, 0).unwrap();
    for (x, y) in [(0, 0), (511, 511), (77, 300)] {
        let texel = loaded.texel(ImageAddress { image: 0, level: 0, x, y });
        assert!((texel - whole.texel(x, y)).abs().max_element() < 1.0 / 255.0, "{x} {y}");
    }
}

#[test]
fn a_public_codebook_grows_and_earlier_images_stay_as_they_are() {
    let params = ProgressiveParams::default().with_goal(Goal::Bpp(0.5));
    let mut shared = Shared { public: None, most_rows: 128, apron: None };
    let (mut made, mut rows) = (Vec::new(), Vec::new());
    for seed in [0, 0, 1] {
        let set = ImageSet::single(strokes((512, 512), seed, 12));
        let texture = Progressive::encode_shared(&set, &params, &shared, &mut Job::default()).unwrap();
        if let Some(public) = texture.details().and_then(|details| details.public.clone()) {
            shared.public = Some(public);
        }
        rows.push(shared.public.as_ref().map_or(0, |public| public.size().1));
        made.push((bytes(&texture), decode_image(&texture, 0, 0).unwrap()));
    }
    let public = shared.public.unwrap();
    assert!(public.size().1 <= 128);
    for (stored, shown) in &made {
        let mut budget = Budget::default();
        let file = Sections::parse(stored, &mut budget).unwrap();
        let texture = Progressive::load_shared(&file, Some(&public), &mut budget).unwrap();
        assert!(decode_image(&texture, 0, 0).unwrap() == *shown);
        if texture.details().is_some_and(|details| details.public.is_some()) {
            let alone = load(&file, &mut budget).unwrap_err().to_string();
            assert!(alone.contains("bank"), "{alone}");
        }
    }
    // The same once more finds what it brought.
    assert!(rows[0] > 0 && rows[1] == rows[0], "{rows:?}");
}

/// Columns `left` to `right` of the middle rows of an image, of those beyond its edge the outermost.
fn columns(image: &Raster, (left, right): (i32, i32), rows: (i32, i32)) -> Raster {
    let size = image.size();
    let inside = |at: i32, count: u32| at.clamp(0, count as i32 - 1) as u32;
    let (width, height) = ((right - left) as u32, (rows.1 - rows.0) as u32);
    let texel = |i: u32| {
        let (x, y) = (left + (i % width) as i32, rows.0 + (i / width) as i32);
        image.texel(inside(x, size.width), inside(y, size.height))
    };
    let texels: Vec<Texel> = (0..width * height).map(texel).collect();
    Raster::from_texels(width, height, image.info(), &texels).unwrap()
}

#[test]
fn no_step_is_seen_between_tiles_whose_bases_go_on_beyond_their_borders() {
    let image = texfold_testkit::image("terrain");
    let (width, height) = (image.size().width as i32, image.size().height as i32);
    let (half, more) = (width / 2, APRON as i32);
    // At a tenth of a bit a smaller image is enlarged.
    for (mips, goal) in [(false, Goal::Psnr(24.0)), (true, Goal::Psnr(24.0)), (false, Goal::Bpp(0.1))] {
        let params = fast(goal).with_mips(mips);
        let enlarged = matches!(goal, Goal::Bpp(_));
        // Mean steps at the border of two tiles, and within them at borders of blocks, for levels 0 and 1.
        let steps = |goes_on: bool| {
            let tiles = [(0, half), (half, width)].map(|(left, right)| {
                let set = ImageSet::single(columns(&image, (left, right), (0, height)));
                let around = columns(&image, (left - more, right + more), (-more, height + more));
                let shared = Shared { apron: goes_on.then_some(around), ..Shared::default() };
                let made = Progressive::encode_shared(&set, &params, &shared, &mut Job::default()).unwrap();
                let (file, mut budget) = (bytes(&made), Budget::default());
                let loaded = load(&Sections::parse(&file, &mut budget).unwrap(), &mut budget);
                assert_eq!(loaded.unwrap(), made);
                assert_eq!(made.shrink_log2() > 0, enlarged);
                made
            });
            for tile in &tiles {
                let shown = decode_image(tile, 0, 0).unwrap();
                let (right, bottom) = (shown.size().width - 1, shown.size().height - 1);
                for (x, y) in [(0, 0), (0, bottom), (right, 0), (right, bottom), (right, 77), (50, bottom)] {
                    let texel = tile.texel(ImageAddress { image: 0, level: 0, x, y });
                    assert!((texel - shown.texel(x, y)).abs().max_element() < 1e-5, "{x} {y}");
                }
            }
            let step = |level: u32| {
                let shown = [0, 1].map(|tile: usize| decode_image(&tiles[tile], 0, level).unwrap());
                let (last, rows) = (shown[0].size().width - 1, shown[0].size().height);
                let away = |a: Texel, b: Texel| f64::from((a - b).truncate().abs().element_sum());
                let across: f64 =
                    (0..rows).map(|y| away(shown[0].texel(last, y), shown[1].texel(0, y))).sum();
                let within: f64 = [16, 32, 48]
                    .map(|x: u32| {
                        let inner = |y: u32| away(shown[1].texel(x - 1, y), shown[1].texel(x, y));
                        (0..rows).map(inner).sum::<f64>()
                    })
                    .into_iter()
                    .sum();
                3.0 * across / within
            };
            let bits = tiles.iter().map(|tile| tile.memory().compressed).sum::<u64>() as f64;
            ([step(0), if mips { step(1) } else { 0.0 }], bits)
        };
        let ((plain, plain_bits), (goes_on, bits)) = (steps(false), steps(true));
        // A base that is read at wrong places leaves more to the residual plane.
        assert!(bits < 1.2 * plain_bits, "{bits} bits, ending there {plain_bits}");
        assert!(goes_on[0] < 1.5 && goes_on[0] < 0.7 * plain[0], "{goes_on:?}, ending there {plain:?}");
    }
}

#[test]
fn one_search_serves_goals_of_every_kind() {
    let set = ImageSet::single(texfold_testkit::image("terrain"));
    let params = ProgressiveParams::default().with_goal(Goal::Bpp(0.6));
    let search = Progressive::search(&set, &params, &mut Job::default()).unwrap();
    // With room for codebooks of several sizes, and without; the last goal asks again for the bases of the first.
    for goal in [Goal::Bpp(0.45), Goal::Psnr(36.0), Goal::Tolerance(9.0), Goal::Bpp(0.6)] {
        let found = Progressive::encode_from(&search, goal, &mut Job::default()).unwrap();
        let alone = encode(&set, &params.clone().with_goal(goal));
        assert!(bytes(&found) == bytes(&alone), "{goal:?}");
    }
}

#[test]
fn few_bits_of_an_image_with_alpha_show_its_colours_hidden_ones_too() {
    let opaque = texfold_testkit::image("terrain").with_channels(4);
    let ImageSize { width, height } = opaque.size();
    // A collar of a fifth.
    let seen = |i: u32| if i % width < width / 5 { 0.0 } else { 1.0 };
    let texels: Vec<Texel> =
        (0..).zip(opaque.texels()).map(|(i, texel)| texel.truncate().extend(seen(i))).collect();
    let collar = Raster::from_texels(width, height, opaque.info(), &texels).unwrap();
    let set = ImageSet::single(collar.tagged(opaque.info().color, Alpha::Straight));
    let mut last = Measured { bpp: 0.0, psnr: 0.0, worst_block_rms: 0.0 };
    for bpp in [0.1, 0.2, 0.6] {
        let texture = encode(&set, &fast(Goal::Bpp(bpp)));
        let measured = measure(&set, &texture);
        assert!(measured.bpp <= bpp && measured.psnr > last.psnr, "{measured:?} after {last:?}");
        let alpha = alpha_error(&set.images()[0], &decode_image(&texture, 0, 0).unwrap()).unwrap();
        assert!(alpha.psnr() > 20.0, "alpha {}", alpha.psnr());
        last = measured;
    }
    assert!(last.psnr > 25.0, "{last:?}");
}

#[test]
fn few_bits_are_spent_on_a_smaller_image_that_is_enlarged() {
    let set = image("terrain");
    let params = fast(Goal::Bpp(0.2)).with_mips(true);
    let texture = encode(&set, &params);
    assert!(texture.shrink_log2() > 0, "{}", texture.notes().verdict);
    let loaded = {
        let (file, mut budget) = (bytes(&texture), Budget::default());
        load(&Sections::parse(&file, &mut budget).unwrap(), &mut budget).unwrap()
    };
    assert_eq!(loaded, texture);
    assert_eq!(loaded.layout(), &set.layout(set.full_levels()));
    // A part of any level is what its texels are one by one.
    for level in [0, 1, 3] {
        let rect = Rect { image: 0, level, x: 7, y: 3, width: 21, height: 18 };
        let mut part = vec![Texel::ZERO; 21 * 18];
        loaded.decode(rect, &mut part).unwrap();
        for (index, texel) in part.into_iter().enumerate() {
            let address = <Image2d as Domain>::address(rect, index);
            assert_eq!(texel, loaded.texel(address), "level {level}: {address:?}");
        }
    }
    // A level that is stored is as good as it is for itself, and one that is not no worse than the enlarged one.
    let levels = mip_chain(&set.images()[0], set.full_levels(), MipFilter::Box);
    let psnr =
        |level: u32| color_error(&levels[level as usize], &decode_image(&texture, 0, level).unwrap()).psnr();
    assert!(psnr(2) > psnr(0) + 3.0, "{} {}", psnr(2), psnr(0));
}

#[test]
fn a_quarter_of_a_bit_is_better_than_bc1_of_a_quarter_of_the_size() {
    for name in ["terrain", "salient", "facade"] {
        let set = image(name);
        let params =
            BcParams::default().with_goal(Goal::Bpp(5.0)).with_content(Content::Bc1).with_reduce_log2(2);
        let plain = measure(&set, &Bc::encode(&set, &params, &mut Job::default()).unwrap());
        let ours = measure(&set, &encode(&set, &fast(Goal::Bpp(plain.bpp))));
        assert!(ours.bpp <= plain.bpp && ours.psnr > plain.psnr + 0.3, "{name}: {ours:?} {plain:?}");
    }
}

#[test]
fn a_coarse_quality_is_met_by_an_enlarged_image_where_that_takes_fewer_bits() {
    let set = image("terrain");
    let goal = |goal| ProgressiveParams::default().with_goal(goal);
    let texture = encode(&set, &goal(Goal::Psnr(24.0)));
    let found = measure(&set, &texture);
    assert!(texture.shrink_log2() > 0 && (24.0..24.3).contains(&found.psnr), "{found:?}");
    let whole = encode(&set, &goal(Goal::Psnr(24.0)).with_reduce_log2(3));
    assert!(found.bpp < measure(&set, &whole).bpp, "{found:?}");
}

#[test]
fn a_collar_costs_few_bits_and_alpha_is_as_good_as_colours() {
    let image = texfold_testkit::image("terrain").with_channels(4);
    // A slanted collar without data.
    let inside = |i: usize| i % 256 > 40 + i / 256 / 4;
    let texel = |(i, texel): (usize, Texel)| if inside(i) { texel } else { Texel::ZERO };
    let info = PixelInfo { channels: 4, alpha: Alpha::Straight, ..image.info() };
    let texels: Vec<Texel> = image.texels().enumerate().map(texel).collect();
    let set = ImageSet::single(Raster::from_texels(256, 256, info, &texels).unwrap());
    let alpha = |texture: &ProgressiveTexture| quality(&set, texture).alpha.unwrap().psnr();
    let few = encode(&set, &fast(Goal::Bpp(1.0)));
    assert!(measure(&set, &few).bpp <= 1.0 && alpha(&few) > 24.0, "{}", alpha(&few));
    let good = encode(&set, &fast(Goal::Psnr(27.0)));
    let found = measure(&set, &good);
    assert!(found.psnr >= 27.0 && alpha(&good) >= 27.0, "{found:?} {}", alpha(&good));
    // All alike, alpha is no reason for a large base.
    let plain = ImageSet::single(texfold_testkit::image("terrain").with_channels(4));
    assert!(encode(&plain, &fast(Goal::Psnr(27.0))).reduce_log2() > 1);
}

/// A disc of alpha 1, its border as wide as said, on an image of one colour.
fn disc(border: f32) -> ImageSet {
    let texel = |i: u32| {
        let (x, y) = ((i % 128) as f32 - 63.5, (i / 128) as f32 - 63.5);
        Texel::new(0.4, 0.5, 0.6, ((40.0 - x.hypot(y)) / border + 0.5).clamp(0.0, 1.0))
    };
    let info = texfold_testkit::image("terrain").with_channels(4).info();
    let texels: Vec<Texel> = (0..128 * 128).map(texel).collect();
    let raster = Raster::from_texels(128, 128, info, &texels).unwrap();
    ImageSet::single(raster.tagged(info.color, Alpha::Straight))
}

#[test]
fn contrast_of_alpha_is_raised_where_outlines_are_sharp() {
    let params = fast(Goal::Bpp(3.0)).with_reduce_log2(2);
    for (border, raised, least) in [(0.1, true, 29.0), (1.0, true, 32.0), (40.0, false, 44.0)] {
        let set = disc(border);
        let texture = encode(&set, &params);
        assert_eq!(texture.content().form().alpha_gain_log2 > 0, raised, "border of {border}");
        let found = alpha_error(&set.images()[0], &decode_image(&texture, 0, 0).unwrap()).unwrap().psnr();
        assert!(found > least, "border of {border}: alpha has {found} dB");
    }
}

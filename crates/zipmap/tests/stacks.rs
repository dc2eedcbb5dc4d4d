//! Zoom stacks with known matrices: registration, what is drawn, and hard cases.

#![allow(clippy::panic, clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use glam::{DMat3, DVec2, Vec2};
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{ColorSpace, Raster};
use texfold_core::{Access, Budget, Effort, EncodeError, Encoded, Encoder, Goal, Job, Texel, TextureCodec};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};
use texfold_zipmap::decode::{texfold_zipmap_pixel, texfold_zipmap_sample_grad};
use texfold_zipmap::{
    LeftOut, PatchSource, PatchStack, Registration, ZipError, ZipParams, ZipTexture, Zipmap, fidelity, masks,
    register,
};

const SIZE: (u32, u32) = (320, 280);
const PLAIN: Lens = Lens { exposure: 1.0, noise: 0.0, seed: 1 };

fn leaves() -> Leaves {
    Leaves::new(3, 60_000)
}

fn shot(leaves: &Leaves, matrix: &DMat3, lens: Lens) -> Raster {
    photograph(&leaves.view(matrix, SIZE, 3), SIZE, lens)
}

fn project(matrix: &DMat3, place: DVec2) -> DVec2 {
    let moved = *matrix * place.extend(1.0);
    moved.truncate() / moved.z
}

/// Mean distance in pixels of the patch, at the corners of the patch, between two matrices from the root.
fn far(found: &DMat3, truth: &DMat3) -> f64 {
    let size = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
    let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
    let of =
        |corner: &DVec2| ((project(found, project(&truth.inverse(), *corner)) - *corner) * size).length();
    corners.iter().map(of).sum::<f64>() / 4.0
}

fn registered(photos: &[Raster]) -> Registration {
    register(photos, &mut Job::default()).unwrap()
}

fn encode(stack: &PatchStack, params: &ZipParams) -> Result<ZipTexture, ZipError> {
    Zipmap::encode(stack, params, &mut Job::default()).map_err(|error| match error {
        EncodeError::Codec { source, .. } => *source.downcast::<ZipError>().unwrap(),
        error => panic!("{error}"),
    })
}

fn bytes(texture: &ZipTexture) -> Vec<u8> {
    let mut writer = SectionWriter::new(texture.codec());
    texture.store(&mut writer);
    writer.finish().bytes
}

/// A root and close-ups of zoom 2.5 and 6 about one place, and their matrices.
fn stack_of_three(exposure: f64) -> (Vec<Raster>, Vec<DMat3>) {
    let leaves = leaves();
    let middle = DVec2::new(0.45, 0.55);
    let matrices = vec![
        DMat3::IDENTITY,
        close_up(middle, 2.5, 0.3, DVec2::new(0.05, -0.04)),
        close_up(middle, 6.0, -0.2, DVec2::ZERO),
    ];
    let lens = |index: usize| Lens {
        exposure: [1.0, exposure, 1.0 / exposure][index],
        noise: 0.01,
        seed: index as u64,
    };
    (
        matrices.iter().enumerate().map(|(index, matrix)| shot(&leaves, matrix, lens(index))).collect(),
        matrices,
    )
}

#[test]
fn close_ups_are_found_within_a_pixel_whatever_their_exposure_and_order() {
    let (photos, matrices) = stack_of_three(0.75);
    for order in [[0, 1, 2], [2, 0, 1]] {
        let shuffled: Vec<Raster> = order.iter().map(|&index: &usize| photos[index].clone()).collect();
        let found = registered(&shuffled);
        assert_eq!((order[found.root], found.placed.len()), (0, 2), "{:?}", found.left_out);
        for placed in &found.placed {
            let off = far(&placed.matrix, &matrices[order[placed.photo]]);
            println!("{:?} zoom {:.2}: {off:.3} pixels off", order, placed.zoom);
            assert!(off < 1.0, "{off}");
        }
    }
}

#[test]
fn a_close_up_adds_detail_and_its_exposure_is_that_of_the_root() {
    let (photos, _) = stack_of_three(0.75);
    let stack = PatchStack::registered(&photos, &registered(&photos)).unwrap();
    let texture = encode(&stack, &ZipParams::default()).unwrap();
    assert_eq!((texture.patches(), texture.deep_levels()), (2, 3));
    for shown in fidelity(&stack, &texture).iter().skip(1) {
        let gain = shown.error.psnr() - shown.root_alone.psnr();
        println!("patch {:?}: {:.2} dB, {gain:.2} dB above the root", shown.patch, shown.error.psnr());
        assert!(gain > 3.0, "{gain}");
    }
    // The mean around the zoomed place is that of the root alone, though the close-ups are a quarter darker and
    // brighter.
    let alone = texture.first_patches(0);
    let (corner, extent) = (Vec2::new(0.4, 0.5), Vec2::splat(0.1));
    let mean = |texture: &ZipTexture| {
        texture.draw(corner, extent, (64, 64)).iter().map(|texel| texel.truncate()).sum::<glam::Vec3>()
            / 4096.0
    };
    let difference = (mean(&texture) - mean(&alone)).abs().max_element();
    assert!(difference < 0.02, "{difference}");
}

/// Mean step between neighbouring pixels across the line of a patch's left border, and left and right of it.
fn steps_around_border(texture: &ZipTexture, matrix: &DMat3, pixel: f64) -> (f64, f64) {
    let inverse = matrix.inverse();
    let colour = |u: f64, v: f64| {
        let at = project(&inverse, DVec2::new(u, v)).as_vec2();
        let step = Vec2::splat(pixel as f32);
        texture.draw(at - step * 0.5, step, (1, 1))[0]
    };
    let across = pixel
        * (project(matrix, DVec2::splat(0.5) + DVec2::X * 1e-3) - project(matrix, DVec2::splat(0.5)))
            .length()
        / 1e-3;
    let beside = [-8.0, -7.0, -6.0, -5.0, -4.0, 4.0, 5.0, 6.0, 7.0, 8.0];
    let mut sums = [0.0; 11];
    for row in 0..400 {
        let v = 0.05 + 0.9 * f64::from(row) / 400.0;
        for (sum, place) in sums.iter_mut().zip([0.0].into_iter().chain(beside)) {
            let u = place * across;
            let difference = colour(u + 0.5 * across, v) - colour(u - 0.5 * across, v);
            *sum += f64::from(difference.truncate().abs().element_sum());
        }
    }
    (sums[0], sums[1..].iter().sum::<f64>() / 10.0)
}

#[test]
fn no_seam_shows_at_the_border_of_a_patch_at_any_level() {
    let (photos, matrices) = stack_of_three(1.3);
    let patches = [1].map(|image| PatchSource { image, matrix: matrices[image], mask: None, parent: None });
    let stack = PatchStack { root: photos[0].clone(), images: photos.clone(), patches: patches.to_vec() };
    let texture = encode(&stack, &ZipParams::default()).unwrap();
    for level in 0..4 {
        let pixel = f64::from(1 << level) / 2.5 / f64::from(SIZE.0);
        let (border, around) = steps_around_border(&texture, &matrices[1], pixel);
        println!("level {level}: {border:.2} at the border, {around:.2} beside it");
        assert!(border < 1.1 * around, "level {level}: {border} {around}");
    }
}

#[test]
fn a_pixel_that_is_longer_than_wide_keeps_detail_across() {
    let (photos, matrices) = stack_of_three(1.0);
    let patches = [1].map(|image| PatchSource { image, matrix: matrices[image], mask: None, parent: None });
    let stack = PatchStack { root: photos[0].clone(), images: photos.clone(), patches: patches.to_vec() };
    let params = ZipParams::default().with_content(texfold_bc::Content::Raw);
    let texture = encode(&stack, &params).unwrap();
    let view = texture.view();
    let texel = Vec2::new(1.0 / SIZE.0 as f32, 1.0 / SIZE.1 as f32) / 2.5;
    // A pixel of six texels by one, turned: against the mean of many small ones, and against one as wide as long.
    let (dx, dy) = (Vec2::new(5.0, 3.3) * texel, Vec2::new(-0.55, 0.83) * texel);
    let (mut longer, mut square) = (0.0, 0.0);
    for k in 0..400u32 {
        let at = Vec2::new(0.35 + 0.01 * (k % 20) as f32, 0.45 + 0.01 * (k / 20) as f32);
        let exact = (0..48).map(|part| {
            let place = at + dx * ((part as f32 + 0.5) / 48.0 - 0.5);
            texfold_zipmap_pixel(&view, place, dy, Vec2::new(dy.y, -dy.x))
        });
        let exact = exact.sum::<Texel>() / 48.0;
        longer += (texfold_zipmap_sample_grad(&view, at, dx, dy) - exact).truncate().length_squared();
        square += (texfold_zipmap_pixel(&view, at, dx, dy) - exact).truncate().length_squared();
    }
    println!("mean of parts: {longer:.3}, one lookup: {square:.3}");
    assert!(8.0 * longer < square, "{longer} {square}");
    // A pixel of no area, of no size, and numbers that are none, are drawn too.
    for (dx, dy) in
        [(dx, dx), (Vec2::ZERO, Vec2::ZERO), (Vec2::splat(f32::NAN), dy), (Vec2::splat(f32::INFINITY), dy)]
    {
        assert!(texfold_zipmap_sample_grad(&view, Vec2::splat(0.5), dx, dy).w >= 0.0 || !dx.is_finite());
    }
}

#[test]
fn bytes_depend_neither_on_threads_nor_on_the_way_through_a_file() {
    let (photos, matrices) = stack_of_three(0.9);
    let patches =
        [1, 2].map(|image| PatchSource { image, matrix: matrices[image], mask: None, parent: None });
    let stack = PatchStack { root: photos[0].clone(), images: photos.clone(), patches: patches.to_vec() };
    let with = |threads: usize| {
        let pool = rayon_pool(threads);
        let mut job = Job::default().with_pool(&pool);
        let found = register(&photos, &mut job).unwrap();
        (
            format!("{:?}", found.placed),
            bytes(&Zipmap::encode(&stack, &ZipParams::default(), &mut job).unwrap()),
        )
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one.0, three.0);
    assert!(one.1 == three.1);
    let mut budget = Budget::default();
    let sections = Sections::parse(&one.1, &mut budget).unwrap();
    let loaded = Zipmap::load(&sections, &mut budget).unwrap();
    assert!(bytes(&loaded) == one.1);
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

#[test]
fn photos_that_do_not_belong_are_left_out_with_a_reason() {
    let (mut photos, _) = stack_of_three(1.0);
    let elsewhere = Leaves::new(77, 60_000);
    photos.push(shot(&elsewhere, &DMat3::IDENTITY, PLAIN));
    photos.push(photograph(&vec![Texel::splat(0.4); (SIZE.0 * SIZE.1) as usize], SIZE, PLAIN));
    // A second copy of the first close-up, and its mirror image.
    photos.push(photos[1].clone());
    let mirrored: Vec<Texel> =
        (0..SIZE.0 * SIZE.1).map(|i| photos[1].texel(SIZE.0 - 1 - i % SIZE.0, i / SIZE.0)).collect();
    photos.push(photograph(&mirrored, SIZE, PLAIN));
    let found = registered(&photos);
    assert_eq!((found.root, found.placed.len()), (0, 2), "{:?}", found.left_out);
    let reason =
        |photo: usize| found.left_out.iter().find(|(index, _)| *index == photo).map(|(_, reason)| *reason);
    assert!(matches!(reason(3), Some(LeftOut::Alone { .. })), "{:?}", reason(3));
    assert!(matches!(reason(4), Some(LeftOut::Blank { features: 0 })), "{:?}", reason(4));
    let copy = [1, 5].into_iter().filter_map(reason).collect::<Vec<_>>();
    assert!(matches!(copy[..], [LeftOut::NoFiner { .. }]), "{copy:?}");
    assert!(matches!(reason(6), Some(LeftOut::Alone { .. })), "{:?}", reason(6));
}

#[test]
fn repeating_patterns_are_not_taken_for_a_match() {
    // The same tile again and again: every shift by a tile fits as well as any other.
    let tile = Leaves::new(5, 4000);
    let view = |shift: f64, zoom: f64| {
        let colour = |i: u32| {
            let at = DVec2::new(f64::from(i % SIZE.0), f64::from(i / SIZE.0)) / (40.0 * zoom) + shift;
            tile.colour(at - at.floor())
        };
        photograph(&(0..SIZE.0 * SIZE.1).map(colour).collect::<Vec<_>>(), SIZE, PLAIN)
    };
    let found = registered(&[view(0.0, 1.0), view(0.37, 2.0)]);
    assert!(found.placed.is_empty(), "{:?}", found.placed);
}

#[test]
fn stacks_of_none_and_of_five_hundred_patches_are_drawn() {
    let leaves = leaves();
    let root = shot(&leaves, &DMat3::IDENTITY, PLAIN);
    let mut stack = PatchStack { root, images: Vec::new(), patches: Vec::new() };
    let none = encode(&stack, &ZipParams::default()).unwrap();
    assert_eq!(
        (none.patches(), none.deep_levels(), none.draw(Vec2::ZERO, Vec2::ONE, (3, 2)).len()),
        (0, 0, 6)
    );
    assert!(matches!(register(&[], &mut Job::default()), Err(EncodeError::Source(_))));
    assert!(registered(&[stack.root.clone()]).placed.is_empty());
    let small = (24, 24);
    for index in 0..500 {
        let middle =
            DVec2::new(f64::from(index % 25) + 0.5, f64::from(index / 25) + 0.5) / DVec2::new(25.0, 20.0);
        let matrix = close_up(middle, 22.0, 0.1 * f64::from(index), DVec2::ZERO);
        stack.images.push(photograph(&leaves.view(&matrix, small, 2), small, PLAIN));
        stack.patches.push(PatchSource { image: index as usize, matrix, mask: None, parent: None });
    }
    let params = ZipParams::default().with_tau(0.05).with_effort(Effort::Fast);
    let many = encode(&stack, &params).unwrap();
    assert!(many.patches() > 400, "{}", many.patches());
    let file = bytes(&many);
    let mut budget = Budget::default();
    let loaded = Zipmap::load(&Sections::parse(&file, &mut budget).unwrap(), &mut budget).unwrap();
    assert_eq!(loaded.draw(Vec2::ZERO, Vec2::ONE, (9, 9)), many.draw(Vec2::ZERO, Vec2::ONE, (9, 9)));
}

#[test]
fn faults_of_hand_made_stacks_are_named() {
    let leaves = leaves();
    let root = shot(&leaves, &DMat3::IDENTITY, PLAIN);
    let close = close_up(DVec2::splat(0.5), 3.0, 0.0, DVec2::ZERO);
    let image = shot(&leaves, &close, PLAIN);
    let patch = |matrix, parent| PatchSource { image: 0, matrix, mask: None, parent };
    let with = |patches: Vec<PatchSource>| {
        let stack = PatchStack { root: root.clone(), images: vec![image.clone()], patches };
        encode(&stack, &ZipParams::default()).map(|texture| texture.patches())
    };
    let flat = DMat3::from_cols_array(&[1.0, 2.0, 0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0]);
    for singular in [flat, DMat3::ZERO, close * f64::NAN, close * f64::INFINITY] {
        assert_eq!(with(vec![patch(singular, None)]), Err(ZipError::Singular { patch: 0 }));
    }
    let away = DMat3::from_translation(DVec2::splat(50.0)) * close;
    assert_eq!(with(vec![patch(close, None), patch(away, None)]), Err(ZipError::Outside { patch: 1 }));
    let circle = vec![patch(close, Some(1)), patch(close, Some(0))];
    assert_eq!(with(circle), Err(ZipError::Cycle { patch: 0 }));
    assert_eq!(with(vec![patch(close, Some(4))]), Err(ZipError::NoParent { patch: 0, parent: 4 }));
    assert_eq!(
        with(vec![PatchSource { image: 1, ..patch(close, None) }]),
        Err(ZipError::NoImage { patch: 0, image: 1 })
    );
    let mask = Raster::from_u8(2, 2, 1, ColorSpace::Linear, &[255; 4]).unwrap();
    let masked = PatchSource { mask: Some(mask), ..patch(close, None) };
    assert_eq!(with(vec![masked]), Err(ZipError::MaskSize { patch: 0, found: (2, 2), wanted: SIZE }));
    // A mirrored patch by hand is drawn mirrored; the same image may lie at several places.
    let mirrored = DMat3::from_translation(DVec2::X) * DMat3::from_scale(DVec2::new(-1.0, 1.0)) * close;
    let other = close_up(DVec2::splat(0.2), 3.0, 1.0, DVec2::ZERO);
    assert_eq!(with(vec![patch(mirrored, None), patch(other, Some(0))]), Ok(2));
}

#[test]
fn an_image_at_several_places_is_stored_once_and_is_the_same_at_each() {
    let leaves = leaves();
    let root = shot(&leaves, &DMat3::IDENTITY, PLAIN);
    let image = shot(&Leaves::new(8, 60_000), &DMat3::IDENTITY, PLAIN);
    let places = [(0.25, 0.3, 0.2), (0.7, 0.35, -0.9), (0.5, 0.75, 2.0)];
    let matrices = places.map(|(x, y, turn)| close_up(DVec2::new(x, y), 4.0, turn, DVec2::ZERO));
    let patches = matrices.map(|matrix| PatchSource { image: 0, matrix, mask: None, parent: None });
    let mut stack = PatchStack { root, images: vec![image], patches: patches.to_vec() };
    let params = ZipParams::default().with_content(texfold_bc::Content::Raw);
    let three = encode(&stack, &params).unwrap();
    assert_eq!((three.patches(), three.contents()), (3, 1), "{}", three.notes().verdict);
    let middle = |texture: &ZipTexture, matrix: &DMat3, at: DVec2| {
        let place = project(&matrix.inverse(), at).as_vec2();
        texture.draw(place - Vec2::splat(5e-5), Vec2::splat(1e-4), (1, 1))[0]
    };
    for at in [DVec2::splat(0.5), DVec2::new(0.4, 0.55)] {
        let [a, b, c] = matrices.map(|matrix| middle(&three, &matrix, at));
        assert!((a - b).abs().max_element() < 2e-3 && (a - c).abs().max_element() < 2e-3, "{a} {b} {c}");
    }
    let file = bytes(&three);
    let mut budget = Budget::default();
    assert!(Zipmap::load(&Sections::parse(&file, &mut budget).unwrap(), &mut budget).unwrap() == three);
    // Copies of the image are fitted and stored one by one.
    stack.images = vec![stack.images[0].clone(); 3];
    (0..3).for_each(|index| stack.patches[index].image = index);
    let copies = encode(&stack, &params).unwrap();
    assert_eq!((copies.patches(), copies.contents()), (3, 3));
    let [once, thrice] = [&three, &copies].map(|texture| texture.gpu().planes[3].data.len());
    assert!(2 * once < thrice, "{once} {thrice}");
}

#[test]
fn a_patch_that_shows_nothing_new_or_that_others_hide_is_left_out() {
    let leaves = leaves();
    let root = shot(&leaves, &DMat3::IDENTITY, PLAIN);
    let close = close_up(DVec2::splat(0.5), 3.0, 0.0, DVec2::ZERO);
    let closer = close_up(DVec2::splat(0.5), 4.0, 0.2, DVec2::ZERO);
    let wide = close_up(DVec2::splat(0.5), 2.0, 0.0, DVec2::ZERO);
    // The root itself again, enlarged.
    let same: Vec<Texel> = (0..SIZE.0 * SIZE.1)
        .map(|i| {
            let at = DVec2::new(f64::from(i % SIZE.0) + 0.5, f64::from(i / SIZE.0) + 0.5);
            let at = project(&close.inverse(), at / DVec2::new(SIZE.0.into(), SIZE.1.into()));
            let tap = texfold_core::address::texfold_tap(at.as_vec2(), glam::UVec2::from(SIZE), 1);
            let four = [
                (tap.low.x, tap.low.y),
                (tap.high.x, tap.low.y),
                (tap.low.x, tap.high.y),
                (tap.high.x, tap.high.y),
            ];
            texfold_core::sample::texfold_bilinear(four.map(|(x, y)| root.texel(x, y)), tap.weight)
        })
        .collect();
    let white =
        Raster::from_u8(SIZE.0, SIZE.1, 1, ColorSpace::Linear, &vec![255; (SIZE.0 * SIZE.1) as usize])
            .unwrap();
    let images =
        vec![photograph(&same, SIZE, PLAIN), shot(&leaves, &closer, PLAIN), shot(&leaves, &wide, PLAIN)];
    let patch = |image, matrix, mask| PatchSource { image, matrix, mask, parent: None };
    let stack = PatchStack {
        root,
        images,
        patches: vec![
            patch(0, close, None),
            patch(1, closer, Some(white.clone())),
            patch(2, wide, Some(white)),
        ],
    };
    // Levels of the enlarged root differ from the root's own by their filters, where edges are as hard as here by more
    // than the usual 2 of 255.
    let texture = encode(&stack, &ZipParams::default().with_drop_rms(4.0)).unwrap();
    let verdict = &texture.notes().verdict;
    assert_eq!(texture.patches(), 1, "{verdict}");
    assert!(
        verdict.contains("patches [0] add nothing new") && verdict.contains("patches [1] are hidden"),
        "{verdict}"
    );
}

#[test]
fn texels_that_others_hide_take_no_bits_and_show_at_no_distance() {
    let leaves = leaves();
    let [wide, close] = [2.0, 2.6].map(|zoom| close_up(DVec2::splat(0.5), zoom, 0.1, DVec2::ZERO));
    let below = shot(&leaves, &wide, PLAIN);
    // Noise where the closer one lies over it, but for what filters read beside its border.
    let noisy: Vec<Texel> = (0..SIZE.0 * SIZE.1)
        .map(|i| {
            let at = DVec2::new(f64::from(i % SIZE.0) + 0.5, f64::from(i / SIZE.0) + 0.5);
            let at = project(&(close * wide.inverse()), at / DVec2::new(SIZE.0.into(), SIZE.1.into()));
            let is_hidden = at.cmpgt(DVec2::splat(0.2)).all() && at.cmplt(DVec2::splat(0.8)).all();
            let hash = (i ^ (i >> 7)).wrapping_mul(0x9e37_79b1);
            let noise = f32::from(((hash ^ (hash >> 15)).wrapping_mul(0x85eb_ca6b) >> 24) as u8) / 255.0;
            if is_hidden { Texel::splat(noise) } else { below.texel(i % SIZE.0, i / SIZE.0) }
        })
        .collect();
    let white = vec![255; (SIZE.0 * SIZE.1) as usize];
    let white = Raster::from_u8(SIZE.0, SIZE.1, 1, ColorSpace::Linear, &white).unwrap();
    let params = ZipParams::default().with_goal(Goal::Psnr(36.0)).with_merge(false);
    let [plain, noisy] = [below, photograph(&noisy, SIZE, PLAIN)].map(|below| {
        let patch = |image, matrix| PatchSource { image, matrix, mask: Some(white.clone()), parent: None };
        let stack = PatchStack {
            root: shot(&leaves, &DMat3::IDENTITY, PLAIN),
            images: vec![below, shot(&leaves, &close, PLAIN)],
            patches: vec![patch(0, wide), patch(1, close)],
        };
        encode(&stack, &params).unwrap()
    });
    let bits = [&plain, &noisy].map(|texture| texture.memory().compressed as f64);
    println!("{bits:?} bits");
    assert_eq!(noisy.patches(), 2);
    assert!(bits[1] < 1.01 * bits[0], "{bits:?}");
    for side in [16, 40, 100, 300, 900] {
        let [a, b] = [&plain, &noisy].map(|texture| texture.draw(Vec2::ZERO, Vec2::ONE, (side, side)));
        let squares = a.iter().zip(&b).map(|(a, b)| f64::from((a - b).truncate().length_squared()) / 3.0);
        let rms = 255.0 * (squares.sum::<f64>() / a.len() as f64).sqrt();
        println!("{side} pixels: {rms:.3}");
        assert!(rms < 2.5, "{side}: {rms}");
    }
}

/// What a texture takes, its worst PSNR against the images, and texels of its patches' finest levels.
fn figures(stack: &PatchStack, access: Access, goal: Goal) -> (f64, f64, u64) {
    let params = ZipParams::default().with_goal(goal).with_access(access).with_merge(false);
    let texture = encode(stack, &params).unwrap();
    assert_eq!(texture.access(), access);
    let texels: u64 = stack.images.iter().chain([&stack.root]).map(|image| image.size().texels()).sum();
    let worst =
        fidelity(stack, &texture).iter().map(|found| found.error.psnr()).fold(f64::INFINITY, f64::min);
    let patches = (0..texture.patches()).filter_map(|index| texture.patch(index));
    let bits = texture.memory().compressed as f64 / texels as f64;
    (bits, worst, patches.map(|patch| patch.size.texels()).sum())
}

/// A root and two close-ups of it that hide what lies under them.
fn hiding_stack() -> PatchStack {
    let leaves = leaves();
    let root = shot(&leaves, &DMat3::IDENTITY, PLAIN);
    let close =
        [(0.3, 3.0), (0.6, 4.0)].map(|(middle, zoom)| close_up(DVec2::splat(middle), zoom, 0.2, DVec2::ZERO));
    let white = vec![255; (SIZE.0 * SIZE.1) as usize];
    let white = Raster::from_u8(SIZE.0, SIZE.1, 1, ColorSpace::Linear, &white).unwrap();
    let patch = |image| PatchSource { image, matrix: close[image], mask: Some(white.clone()), parent: None };
    let images = close.iter().map(|matrix| shot(&leaves, matrix, PLAIN)).collect();
    PatchStack { root, images, patches: vec![patch(0), patch(1)] }
}

#[test]
fn blocks_take_fewer_bits_than_planes_and_more_bits_are_never_worse() {
    let stack = hiding_stack();
    let mut before = (0.0, 0.0);
    for psnr in [26.0, 30.0, 34.0] {
        let [blocks, planes] =
            [Access::Block, Access::Texel].map(|access| figures(&stack, access, Goal::Psnr(psnr)));
        println!("{psnr} dB: {blocks:?} by block, {planes:?} by texel");
        assert!(blocks.0 < 0.5 * planes.0 && blocks.0 > before.0, "{blocks:?} {planes:?}");
        before = (blocks.0, blocks.1);
    }
    let mut before = 0.0;
    for bpp in [0.5, 1.0, 2.0, 4.0] {
        let (bits, worst, _) = figures(&stack, Access::Block, Goal::Bpp(bpp));
        println!("{bpp} bits: {bits} {worst}");
        // The table and the parameters of a small stack are counted in `bits`, too.
        assert!(bits <= bpp + 0.01 && bits > 0.97 * bpp && worst > before, "{bits} {worst} for {bpp}");
        before = worst;
    }
}

#[test]
fn patches_are_stored_as_finely_as_the_goal_asks() {
    let stack = hiding_stack();
    let mut before = (0.0, 0.0, 0);
    for psnr in [12.0, 20.0, 26.0, 34.0] {
        let found = figures(&stack, Access::Texel, Goal::Psnr(psnr));
        println!("{psnr} dB: {found:?}");
        // The border's texels, alpha 0, and what lies under them are not compression's.
        assert!(found.1 > psnr.min(25.0), "{found:?} for {psnr} dB");
        assert!(found.0 >= before.0 && found.2 >= before.2, "{found:?} for {psnr} dB after {before:?}");
        before = found;
    }
    assert_eq!(before.2, 2 * u64::from(SIZE.0 * SIZE.1));
    assert_eq!(figures(&stack, Access::Texel, Goal::Psnr(12.0)).2, 0);
    let mut quality = 0.0;
    for bpp in [2.0, 4.0, 7.0, 12.0] {
        let found = figures(&stack, Access::Texel, Goal::Bpp(bpp));
        println!("{bpp} bits: {found:?}");
        assert!(found.0 <= bpp && found.1 >= quality, "{found:?} for {bpp} bits after {quality} dB");
        quality = found.1;
    }
    let (fine, coarse) = (
        figures(&stack, Access::Texel, Goal::Tolerance(6.0)),
        figures(&stack, Access::Texel, Goal::Tolerance(60.0)),
    );
    assert!(coarse.0 < fine.0 && coarse.1 < fine.1, "{fine:?} {coarse:?}");
}

#[test]
fn maps_of_another_kind_lie_where_the_colours_do() {
    let leaves = leaves();
    let root = shot(&leaves, &DMat3::IDENTITY, PLAIN);
    let [inside, across] = [0.5, 0.05].map(|at| close_up(DVec2::splat(at), 3.0, 0.2, DVec2::ZERO));
    let patch = |image, matrix| PatchSource { image, matrix, mask: None, parent: None };
    let colours = PatchStack {
        images: vec![shot(&leaves, &inside, PLAIN), shot(&leaves, &across, PLAIN), root.clone()],
        // The last image shows nothing new.
        patches: vec![patch(2, DMat3::IDENTITY), patch(0, inside), patch(1, across)],
        root,
    };
    let params = ZipParams::default().with_drop_rms(4.0);
    let masks = masks(&colours, &params, &mut Job::default()).unwrap();
    let shown = |mask: &Raster| mask.values().filter(|&share| share > 0.0).count();
    let texels = (SIZE.0 * SIZE.1) as usize;
    let [nothing, whole, part] = [0, 1, 2].map(|index| shown(&masks[index]));
    assert!(
        whole > texels * 4 / 5 && nothing == 0 && part < whole && part > texels / 5,
        "{whole} {nothing} {part}"
    );
    // A stripe along the first column is no part of any patch.
    assert!((0..SIZE.1).all(|y| masks[1].texel(0, y).x == 0.0));
    let flat =
        |value: u8| Raster::from_u8(SIZE.0, SIZE.1, 1, ColorSpace::Linear, &vec![value; texels]).unwrap();
    let heights = vec![flat(200), flat(200), flat(200)];
    let riding = colours.riding(flat(50), heights.clone(), masks.clone()).unwrap();
    // As fine as they come: maps that are stored coarser have coarser masks.
    let finest = params.clone().with_goal(Goal::Psnr(60.0)).with_merge(false);
    let riding = encode(&riding, &finest).unwrap();
    let texture = encode(&colours, &params).unwrap();
    assert_eq!((riding.patches(), texture.patches()), (2, 2));
    // Where the mask is full the height is that of the patch, and where it is clear that of the root.
    let view = riding.view();
    for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))).step_by(97) {
        let at =
            DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / DVec2::new(SIZE.0.into(), SIZE.1.into());
        let uv = project(&inside.inverse(), at).as_vec2();
        let step = 1.0 / (3.0 * SIZE.0 as f32);
        let height = texfold_zipmap_pixel(&view, uv, Vec2::new(step, 0.0), Vec2::new(0.0, step)).x;
        let wanted = (50.0 + 150.0 * masks[1].texel(x, y).x) / 255.0;
        // Alpha is blended between texels, and stored in blocks.
        let around = (0..9).map(|k| (x + k % 3, y + k / 3)).filter(|&(x, y)| x > 0 && y > 0);
        let around = around.map(|(x, y)| masks[1].texel((x - 1).min(SIZE.0 - 1), (y - 1).min(SIZE.1 - 1)).x);
        let (low, high) = around.fold((1f32, 0f32), |(low, high), share| (low.min(share), high.max(share)));
        assert!((height - wanted).abs() < 0.6 * (high - low) + 0.05, "{x}, {y}: {height} for {wanted}");
    }
    let few = colours.riding(flat(50), heights[..1].to_vec(), masks);
    assert_eq!(few.err(), Some(ZipError::Maps { found: 1, patches: 3 }));
}

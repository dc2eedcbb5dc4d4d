//! Hard cases of registration and of drawing: zooms of twelve, jumps of exposure, people who walk through, and patches
//! smaller than a pixel.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use glam::{DMat3, DVec2, Vec2};
use texfold_core::image::{ColorSpace, Raster};
use texfold_core::rng::Rng;
use texfold_core::{Encoder, Goal, Job, Texel};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};
use texfold_zipmap::{PatchSource, PatchStack, Registration, ZipParams, Zipmap, register};

const SIZE: (u32, u32) = (320, 280);

fn lens(exposure: f64, seed: u64) -> Lens {
    Lens { exposure, noise: 0.01, seed }
}

fn shot(leaves: &Leaves, matrix: &DMat3, lens: Lens) -> Raster {
    photograph(&leaves.view(matrix, SIZE, 3), SIZE, lens)
}

fn registered(photos: &[Raster]) -> Registration {
    register(photos, &mut Job::default()).unwrap()
}

/// Mean distance in pixels of the close-up, at its corners, between two matrices from the root.
fn far(found: &DMat3, truth: &DMat3) -> f64 {
    let size = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
    let off = |corner: DVec2| {
        let moved = *found * truth.inverse() * corner.extend(1.0);
        ((moved.truncate() / moved.z - corner) * size).length()
    };
    [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(off).iter().sum::<f64>() / 4.0
}

#[test]
fn a_zoom_of_twelve_in_one_step_is_left_out_or_right_and_in_two_steps_it_is_found() {
    let leaves = Leaves::new(3, 60_000);
    let middle = DVec2::new(0.47, 0.52);
    let matrices =
        [DMat3::IDENTITY, close_up(middle, 12.0, 0.15, DVec2::ZERO), close_up(middle, 4.0, 0.1, DVec2::ZERO)];
    let photos: Vec<Raster> =
        matrices.iter().zip(1..).map(|(matrix, seed)| shot(&leaves, matrix, lens(1.0, seed))).collect();
    let alone = registered(&photos[..2]);
    // A pixel of the root is twelve of the close-up.
    assert!(alone.placed.iter().all(|placed| far(&placed.matrix, &matrices[1]) < 12.0), "{:?}", alone.placed);
    assert_eq!(alone.placed.len() + alone.left_out.len(), 1, "{:?}", alone.left_out);
    let chained = registered(&photos);
    assert_eq!(chained.placed.len(), 2, "{:?}", chained.left_out);
    for placed in &chained.placed {
        let off = far(&placed.matrix, &matrices[placed.photo]);
        println!("zoom {:.1}: {off:.2} pixels off", placed.zoom);
        assert!(off < 3.0, "{off}");
    }
}

#[test]
fn a_jump_of_exposure_by_four_is_no_hindrance() {
    let leaves = Leaves::new(5, 60_000);
    let truth = close_up(DVec2::splat(0.5), 2.5, 0.2, DVec2::ZERO);
    for (wide, close) in [(0.4, 1.6), (1.6, 0.4)] {
        let photos = [shot(&leaves, &DMat3::IDENTITY, lens(wide, 1)), shot(&leaves, &truth, lens(close, 2))];
        let found = registered(&photos);
        assert_eq!((found.root, found.placed.len()), (0, 1), "{:?}", found.left_out);
        let off = far(&found.placed[0].matrix, &truth);
        println!("exposure {wide} and {close}: {off:.2} pixels off");
        assert!(off < 1.0, "{off}");
    }
}

/// Lays discs over an image: about a seventh of it.
fn with_people(leaves: &Leaves, matrix: &DMat3, seed: u64) -> Raster {
    let mut texels = leaves.view(matrix, SIZE, 3);
    let mut rng = Rng::new(seed);
    for _ in 0..12 {
        let middle = DVec2::new(rng.between(0.0, SIZE.0.into()), rng.between(0.0, SIZE.1.into()));
        let colour = Texel::new(rng.unit() as f32, rng.unit() as f32, rng.unit() as f32, 1.0);
        for (at, texel) in texels.iter_mut().enumerate() {
            let place = DVec2::new((at % SIZE.0 as usize) as f64, (at / SIZE.0 as usize) as f64);
            if (place - middle).length() < 18.0 {
                *texel = colour;
            }
        }
    }
    photograph(&texels, SIZE, lens(1.0, seed))
}

#[test]
fn people_who_walk_through_do_not_move_a_photograph() {
    let leaves = Leaves::new(7, 60_000);
    let truth = close_up(DVec2::splat(0.45), 2.0, -0.1, DVec2::new(0.05, 0.0));
    let photos = [with_people(&leaves, &DMat3::IDENTITY, 21), with_people(&leaves, &truth, 22)];
    let found = registered(&photos);
    assert_eq!((found.root, found.placed.len()), (0, 1), "{:?}", found.left_out);
    let off = far(&found.placed[0].matrix, &truth);
    println!("{off:.2} pixels off");
    assert!(off < 1.0, "{off}");
}

#[test]
fn a_patch_vanishes_smoothly_when_it_becomes_smaller_than_a_pixel() {
    let (width, height) = (256u32, 256u32);
    let gray =
        photograph(&vec![Texel::splat(0.25); (width * height) as usize], (width, height), lens(1.0, 1));
    let white = photograph(&vec![Texel::splat(1.0); 64 * 64], (64, 64), lens(1.0, 2));
    let mask = Raster::from_u8(64, 64, 1, ColorSpace::Linear, &[255; 64 * 64]).unwrap();
    // 16 texels of the root.
    let matrix = close_up(DVec2::splat(0.5), 16.0, 0.0, DVec2::ZERO);
    let patch = PatchSource { image: 0, matrix, mask: Some(mask), parent: None };
    let stack = PatchStack { root: gray, images: vec![white], patches: vec![patch] };
    // The patch has a seventeenth of all texels: if the whole error lay there, its colour would be within 0.5 %.
    let params = ZipParams::default().with_merge(false).with_goal(Goal::Psnr(60.0));
    let texture = Zipmap::encode(&stack, &params, &mut Job::default()).unwrap();
    let alone = texture.first_patches(0);
    // Pixels of a sixteenth of the patch to sixteen times it, a fifth larger each.
    let mut before = f32::INFINITY;
    let mut shown = Vec::new();
    for k in 0..46 {
        let pixel = 1.2f32.powi(k) / 256.0;
        let corner = Vec2::splat(0.5 - 0.5 * pixel);
        let at = |texture: &texfold_zipmap::ZipTexture| texture.draw(corner, Vec2::splat(pixel), (1, 1))[0];
        let found = (at(&texture) - at(&alone)).x;
        assert!((-2e-3..=before + 2e-2).contains(&found), "step {k}: {found} behind {before}: {shown:?}");
        // No level is left all at once: from all to nothing in no fewer than four steps.
        assert!(before.is_infinite() || before - found < 0.3, "step {k}: {found} behind {before}: {shown:?}");
        (before, _) = (found, shown.push(found));
    }
    println!("{shown:?}");
    assert!(shown[0] > 0.74 && shown[45].abs() < 2e-3, "{shown:?}");
}

//! Registration of real photographs, where they are there (`TEXFOLD_DATA`).

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2};
use texfold_core::image::Raster;
use texfold_core::{Encoder, Job};
use texfold_testkit::png;
use texfold_zipmap::{PatchStack, Registration, ZipParams, Zipmap, fidelity, register};

fn data() -> Option<PathBuf> {
    texfold_testkit::data_dir("registration of zoom stacks")
}

/// A matrix of nine numbers, row by row, that leads from pixel centres at whole numbers to such.
fn ground_truth(path: &Path) -> DMat3 {
    let text = std::fs::read_to_string(path).unwrap();
    let numbers: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let rows: [f64; 9] = numbers.try_into().unwrap();
    let half = DMat3::from_translation(DVec2::splat(0.5));
    half * DMat3::from_cols_array(&rows).transpose() * half.inverse()
}

fn project(matrix: &DMat3, place: DVec2) -> DVec2 {
    let moved = *matrix * place.extend(1.0);
    moved.truncate() / moved.z
}

fn extent(image: &Raster) -> DVec2 {
    DVec2::new(f64::from(image.size().width), f64::from(image.size().height))
}

/// Correlation of `image`, warped by `matrix` from pixels of `first`, with `first`.
fn correlation(first: &Raster, image: &Raster, matrix: &DMat3) -> f64 {
    let value = |x: i64, y: i64| f64::from(image.texel(x.max(0) as u32, y.max(0) as u32).x);
    let mut sums = [0.0; 6];
    for (y, x) in (0..first.size().height).flat_map(|y| (0..first.size().width).map(move |x| (y, x))) {
        let at = project(matrix, DVec2::new(f64::from(x), f64::from(y)) + 0.5) - 0.5;
        if at.cmplt(DVec2::ZERO).any() || at.cmpgt(extent(image) - 1.0).any() {
            continue;
        }
        let (corner, part) = (at.floor().as_i64vec2(), at - at.floor());
        let upper = value(corner.x, corner.y) * (1.0 - part.x) + value(corner.x + 1, corner.y) * part.x;
        let lower =
            value(corner.x, corner.y + 1) * (1.0 - part.x) + value(corner.x + 1, corner.y + 1) * part.x;
        let (a, b) = (f64::from(first.texel(x, y).x), upper * (1.0 - part.y) + lower * part.y);
        for (sum, term) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
            *sum += term;
        }
    }
    let [n, a, b, aa, bb, ab] = sums;
    (ab * n - a * b) / ((aa * n - a * a) * (bb * n - b * b)).sqrt()
}

/// From pixels of photograph `from` to pixels of photograph `to`.
fn between(found: &Registration, photos: &[Raster], from: usize, to: usize) -> DMat3 {
    let of_root = |photo: usize| {
        let matrix = found.placed.iter().find(|placed| placed.photo == photo).map(|placed| placed.matrix);
        DMat3::from_scale(extent(&photos[photo])) * matrix.unwrap_or(DMat3::IDENTITY)
    };
    of_root(to) * of_root(from).inverse()
}

#[test]
fn every_photo_of_the_boat_is_registered_as_well_as_its_ground_truth() {
    let Some(dir) = data().map(|dir| dir.join("zipmap/boat")) else { return };
    let photos: Vec<Raster> = (1..=6).map(|n| png(&dir.join(format!("img{n}.pgm")))).collect();
    let found = register(&photos, &mut Job::default()).unwrap();
    assert_eq!((found.root, found.placed.len(), found.left_out.len()), (5, 5, 0));
    let order: Vec<usize> = found.placed.iter().map(|placed| placed.photo).collect();
    assert_eq!(order, [4, 3, 2, 1, 0]);
    let size = extent(&photos[0]);
    let corners = [DVec2::ZERO, DVec2::new(size.x, 0.0), size, DVec2::new(0.0, size.y)];
    for n in 1..6 {
        let truth = ground_truth(&dir.join(format!("H1to{}p", n + 1)));
        let far = |matrix: &DMat3| {
            let back = matrix.inverse() * truth;
            corners.iter().map(|&corner| (project(&back, corner) - corner).length()).sum::<f64>() / 4.0
        };
        let link = found.links.iter().find(|link| (link.coarse, link.fine) == (n, 0)).unwrap();
        let (direct, placed) = (link.matrix.inverse(), between(&found, &photos, 0, n));
        let of = |matrix: &DMat3| correlation(&photos[0], &photos[n], matrix);
        println!(
            "img{}: pair {:.2} px, all {:.2} px from the ground truth; correlation {:.4}, {:.4}, its own {:.4}",
            n + 1,
            far(&direct),
            far(&placed),
            of(&direct),
            of(&placed),
            of(&truth)
        );
        // The ground truth is good to about 4 pixels; that of the sixth is off by up to 24.
        assert!(n == 5 || (far(&direct) < 4.0 && far(&placed) < 4.0), "img{}", n + 1);
        assert!(of(&direct) >= of(&truth), "img{}", n + 1);
    }
}

#[test]
fn a_pair_of_two_lenses_is_registered_to_its_own_grid() {
    let Some(dir) = data().map(|dir| dir.join("zipmap/city100_nikon")) else { return };
    let photos = ["001H.png", "001L.png"].map(|name| png(&dir.join(name)));
    // Both lie on one grid: the sharp one is taken as it is, the soft one at a third of its size.
    let (width, height) = (photos[1].size().width / 3, photos[1].size().height / 3);
    let mean = |i: u32| {
        let (x, y) = (i % width * 3, i / width * 3);
        let nine = (0..9).map(|k| photos[1].texel(x + k % 3, y + k / 3));
        nine.fold(texfold_core::Texel::ZERO, |sum, texel| sum + texel) / 9.0
    };
    let texels: Vec<texfold_core::Texel> = (0..width * height).map(mean).collect();
    let small = Raster::from_texels(width, height, photos[1].info(), &texels).unwrap();
    let photos = vec![photos[0].clone(), small];
    let found = register(&photos, &mut Job::default()).unwrap();
    assert_eq!((found.root, found.placed.len()), (1, 1), "{:?}", found.left_out);
    let own = between(&found, &photos, 1, 0);
    let size = extent(&photos[1]);
    let far = [DVec2::ZERO, DVec2::new(size.x, 0.0), size, DVec2::new(0.0, size.y)]
        .map(|corner| (project(&own, corner) - corner * 3.0).length());
    let far = far.into_iter().sum::<f64>() / 4.0;
    println!("city100: {far:.2} pixels from identity, {:?}", found.placed[0].link.agreement);
    assert!(far < 2.0, "{far}");
    let stack = PatchStack::registered(&photos, &found).unwrap();
    let texture = Zipmap::encode(&stack, &ZipParams::default(), &mut Job::default()).unwrap();
    let shown = fidelity(&stack, &texture)[1];
    let (psnr, alone) = (shown.error.psnr(), shown.root_alone.psnr());
    println!("city100: the sharp photograph is shown at {psnr:.2} dB, by the root alone at {alone:.2} dB");
    assert!(psnr > alone + 3.0, "{psnr} {alone}");
}

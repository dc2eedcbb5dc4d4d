//! Captures that leave the fit too little or too much to go by.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

use glam::{Vec2, Vec3};
use texfold_core::{Access, Encoded, Job, LightAddress};
use texfold_lightfield::{
    Capture, Factors, FitMethod, LightModel, LightParams, LightQuality, LightTexture, Lightfield, Mesh,
    Photograph,
};
use texfold_testkit::capture::{Look, camera, eyes, sphere};

fn params(terms: u32) -> LightParams {
    LightParams::default().with_terms(terms).with_access(Access::Texel)
}

fn encode(capture: &Capture, params: &LightParams) -> (LightTexture, LightQuality) {
    Lightfield::encode_measured(capture, params, &mut Job::default()).unwrap()
}

fn colours(texture: &LightTexture) -> impl Iterator<Item = Vec3> {
    let places = (0..texture.layout().triangles).flat_map(|triangle| {
        [Vec3::X, Vec3::new(0.5, 0.25, 0.25), Vec3::new(0.1, 0.0, 0.9)].map(|place| (triangle, place))
    });
    places.flat_map(move |(triangle, barycentric)| {
        let directions = eyes(5, 1.0, 0.3).into_iter();
        directions
            .map(move |direction| LightAddress { triangle, barycentric, direction })
            .map(|at| texture.texel(at).truncate())
    })
}

/// A square whose colour, seen from the left or the right, has one pattern more or less, and from below or above another as strong: two
/// terms of one singular value, and no third.
fn two_patterns() -> Capture {
    let corners = [Vec2::NEG_ONE, Vec2::new(1.0, -1.0), Vec2::ONE, Vec2::new(-1.0, 1.0)];
    let positions = corners.map(|corner| corner.extend(0.0)).to_vec();
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] };
    let view = |(x, y): (f32, f32)| {
        let camera = camera(Vec3::new(x, y, 3.5), 40);
        let pixel = |index: u32| {
            let ray = camera.ray(Vec2::new((index % 40) as f32, (index / 40) as f32) + 0.5);
            let at = camera.eye() - ray * (camera.eye().z / ray.z);
            if at.x.abs() > 1.0 || at.y.abs() > 1.0 {
                return [0; 4];
            }
            let value = 0.5 + 0.2 * x.signum() * at.x.signum() + 0.2 * y.signum() * at.y.signum();
            [(255.0 * value) as u8, (255.0 * value) as u8, (255.0 * value) as u8, 255]
        };
        Photograph { pixels: (0..1600).map(pixel).collect(), camera }
    };
    let places = [-1.4f32, -0.8, 0.8, 1.4];
    let views = places.iter().flat_map(|&x| places.map(|y| view((x, y)))).collect();
    Capture { mesh, views }
}

#[test]
fn terms_of_one_singular_value_are_found_and_more_than_the_rank_do_no_harm() {
    let capture = two_patterns();
    for factors in [Factors::Signed, Factors::NonNegative] {
        let model = LightModel::default().with_factors(factors).with_chosen(false);
        let of = |terms| {
            let (texture, quality) = encode(&capture, &params(terms).with_model(model));
            assert!(colours(&texture).all(Vec3::is_finite));
            quality.psnr
        };
        let steps = [0, 1, 2, 8].map(of);
        // Factors without signs need a term for each way from the darkest.
        let least = if factors == Factors::Signed { steps[1] + 2.0 } else { steps[1] };
        let found = format!("{factors:?}: {steps:?}");
        assert!(steps[1] > steps[0] + 1.0 && steps[2] > least && steps[3] > steps[2] - 0.3, "{found}");
    }
}

#[test]
fn terms_beyond_the_rank_cost_nothing_where_there_is_nothing_to_show() {
    for look in [Look::Black, Look::Diffuse] {
        let (texture, _) = encode(&sphere(look, 24, 32), &params(8));
        assert!(texture.terms_of_vertices().iter().all(|&terms| terms == 0), "{look:?}");
        let (all, _) =
            encode(&sphere(look, 24, 32), &params(8).with_model(LightModel::default().with_chosen(false)));
        let apart = colours(&texture).zip(colours(&all)).map(|(a, b)| (a - b).abs().max_element());
        let most = apart.fold(0.0, f32::max);
        assert!(most < 0.15, "{look:?}: {most}");
        if look == Look::Black {
            assert!(colours(&texture).all(|colour| colour == Vec3::ZERO));
        }
    }
}

#[test]
fn places_that_no_photograph_shows_take_after_their_neighbours() {
    let whole = sphere(Look::Diffuse, 12, 32);
    let capture = Capture { views: whole.views[..1].to_vec(), ..whole };
    for fit in [FitMethod::Scattered, FitMethod::Resampled] {
        let model = LightModel::default().with_fit(fit);
        let (texture, quality) = encode(&capture, &params(2).with_model(model));
        let shares = (quality.samples_seen, quality.samples);
        assert!(shares.0 + 30 < shares.1 && shares.0 > 0, "{shares:?}");
        let seen = capture.views[0].pixels.iter().filter(|pixel| pixel[3] == 255);
        let (low, high) = seen.fold((255, 0), |(low, high), pixel| {
            (pixel[..3].iter().fold(low, |a, &b| a.min(b)), pixel[..3].iter().fold(high, |a, &b| a.max(b)))
        });
        let span = f32::from(low) / 255.0 - 0.05..f32::from(high) / 255.0 + 0.05;
        // What is far from all that is seen has no neighbours to take after, and is black.
        let outside =
            colours(&texture).filter(|colour| colour.to_array().iter().any(|value| !span.contains(value)));
        let strange = outside.filter(|&colour| colour.min_element() < 0.0 || colour.max_element() > span.end);
        assert_eq!(strange.count(), 0, "{fit:?}");
    }
}

#[test]
fn odd_triangles_go_or_stay_and_the_rest_is_as_before() {
    let plain = sphere(Look::Glossy, 12, 32);
    let (_, before) = encode(&plain, &params(1));
    let mut odd = plain.clone();
    let [a, b, c] = odd.mesh.triangles[0];
    let first = odd.mesh.positions.len() as u32;
    let corners = odd.mesh.corners([a, b, c]);
    // On one line; far thinner than a pixel; and two more triangles at an edge that has two.
    odd.mesh.positions.extend([corners[0].midpoint(corners[1]), corners[0] + Vec3::splat(1e-6)]);
    odd.mesh.positions.extend([Vec3::ZERO, Vec3::splat(0.01)]);
    odd.mesh.triangles.extend([[a, first, b], [a, first + 1, b], [a, b, first + 2], [b, a, first + 3]]);
    let (texture, after) = encode(&odd, &params(1));
    let count = texture.mesh().triangles.len();
    assert!((82..=84).contains(&count), "{count} triangles");
    assert!(colours(&texture).all(Vec3::is_finite));
    assert!(after.psnr > before.psnr - 1.0, "{} against {}", after.psnr, before.psnr);
}

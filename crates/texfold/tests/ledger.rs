//! A part of a model that is kept pays for its bits: without it D + lambda R is larger, where lambda is what a bit is worth at that
//! setting, by the slope of the method's own curve of error over bits.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold::core::image::ImageSet;
use texfold::core::metric::measure;
use texfold::{
    Access, AnyImage, Choice, Effort, EncodeSettings, Encoded, Goal, Guidance, Job, Metric,
    core::Footprint,
    encode_images,
    lightfield::{LightParams, Lightfield},
};
use texfold_testkit::capture::{Look, sphere};
use texfold_testkit::{full, image};

use crate::support::ways;

/// Images that some method suits: alpha, one channel, repetition, text. Quick runs take the first two.
const IMAGES: [&str; 4] = ["cutout", "gray", "facade", "text_page"];
/// A goal, and one nearby of less quality: the slope between them is what a bit is worth.
const GOALS: [[Goal; 2]; 4] = [
    [Goal::Psnr(32.0), Goal::Psnr(31.0)],
    [Goal::Bpp(2.5), Goal::Bpp(2.0)],
    [Goal::Bpp(1.5), Goal::Bpp(1.2)],
    [Goal::Bpp(0.6), Goal::Bpp(0.5)],
];

/// Squared error and bits of a texel, and its parts.
struct Point {
    error: f64,
    bits: f64,
    parts: Vec<(String, f64, f64)>,
}

/// The error of a PSNR, of a range of 1.
fn error_of(psnr: f64) -> f64 {
    10f64.powf(-psnr / 10.0)
}

/// Parts with bits in memory whose PSNR without them is known.
fn parts(footprint: &Footprint, texels: f64) -> Vec<(String, f64, f64)> {
    let known = footprint.parts.iter().filter(|part| part.bits_memory > 0);
    known
        .filter_map(|part| {
            let without = error_of(part.psnr_without?);
            Some((part.name.to_owned(), part.bits_memory as f64 / texels, without))
        })
        .collect()
}

/// Holds every part of `at` to what its bits are worth, by the slope to `below`; the number of parts.
fn held(name: &str, at: &Point, below: &Point) -> usize {
    let slope = (below.error - at.error) / (at.bits - below.bits);
    // A flat curve says that bits are worth nothing there.
    let lambda = if slope.is_finite() { slope.max(0.0) } else { 0.0 };
    for (part, bits, without) in &at.parts {
        let gain = without - at.error;
        assert!(
            gain > lambda * bits,
            "{name}: {part} takes {bits:.3} bits a texel, worth {:.2e}, and removes an error of {gain:.2e}",
            lambda * bits
        );
    }
    at.parts.len()
}

fn point(set: &ImageSet, made: &AnyImage) -> Point {
    let (found, texels) = (measure(set, made.as_encoded()), set.texel_count() as f64);
    let parts = parts(&made.as_encoded().footprint(), texels);
    Point { error: error_of(found.psnr), bits: found.bpp, parts }
}

#[test]
fn every_part_of_an_image_that_is_kept_pays_for_its_bits() {
    let mut held_parts = std::collections::BTreeMap::<String, usize>::new();
    let images = if full() { &IMAGES[..] } else { &IMAGES[..2] };
    for name in images {
        let set = ImageSet::single(image(name));
        for (encoding, access) in ways() {
            for goals in GOALS {
                let [at, below] = goals.map(|goal| {
                    let mut settings = EncodeSettings {
                        codec: Choice::named(encoding.id.name).unwrap(),
                        goal,
                        access: Some(access),
                        effort: Effort::Fast,
                        metric: Some(Metric::Psnr),
                        ..EncodeSettings::default()
                    };
                    if settings.check().is_err() {
                        settings.metric = None;
                    }
                    encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap()
                });
                let what = format!("{name}, {} {access:?}, {:?}", encoding.id.name, goals[0]);
                let count = held(&what, &point(&set, &at), &point(&set, &below));
                *held_parts.entry(at.as_encoded().codec().name.to_owned()).or_default() += count;
            }
        }
    }
    println!("{held_parts:?}");
    let least = 2 * images.len();
    let [of_dct, of_progressive] = ["dct", "progressive"].map(|codec| held_parts[codec]);
    assert!(held_parts["vq"] > 0 && of_dct >= least && of_progressive >= least, "{held_parts:?}");
}

#[test]
fn the_terms_of_a_light_field_pay_for_their_bits() {
    let capture = sphere(Look::Glossy, 24, 40);
    for access in [Access::Block, Access::Texel] {
        let [at, below] = [0.5, 1.0].map(|loss| {
            let mut params = LightParams::default().with_terms(2).with_access(access);
            params.storage = params.storage.with_loss(loss);
            let (texture, quality) =
                Lightfield::encode_measured(&capture, &params, &mut Job::default()).unwrap();
            let bits = texture.memory().compressed as f64;
            Point { error: error_of(quality.psnr), bits, parts: parts(&texture.footprint(), 1.0) }
        });
        assert!(held(&format!("{access:?}"), &at, &below) > 0);
    }
}

//! Regimes of captures, and how light fields depend on photographs, cameras and meshes.

use std::time::Instant;

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;
use texfold::{AnyTexture, core::metric::SquaredError, open};
use texfold::{
    Cancel, EncodeError, Encoded, Job,
    core::{Capture, Mesh, Photograph},
    file_of,
    lightfield::{LightParams, LightTexture, Lightfield, Renderer},
};
use texfold_testkit::capture::{Look, camera, eyes, icosphere, photograph, sphere};
use texfold_testkit::rng::Rng;

use super::atlas::{Failure, Picture, falls, sentence};
use super::guard::guarded;
use super::record::{self, Check, Curve, Point, Row};
use super::{Extent, Outcome, Tools, page};

/// Pixels a side of a photograph.
const SIZE: u32 = 40;
/// Terms that are asked for.
const TERMS: u32 = 3;
/// Distance of the cameras from the middle of a sphere of radius 1.
const DISTANCE: f32 = 4.0;
/// What captures are encoded for where a quality is asked for.
const GOAL_DB: f64 = 34.0;
/// By how much terms may lose against the mean alone, in dB: the figures are of samples, rounded.
const SLACK_DB: f64 = 0.1;
/// By what fraction of the radius vertices are moved, and by how much PSNR may change for it.
const NUDGE: f32 = 1e-7;
const NUDGE_DB: f64 = 0.01;
/// PSNR above which results are alike.
const EXACT_DB: f64 = 60.0;
/// Bytes that a file may have beside photographs and mesh: header, table of sections, notes.
const HEADER_BYTES: f64 = 1024.0;
/// Bytes of a vertex and of a triangle as they are given.
const VERTEX_BYTES: usize = 12;
const TRIANGLE_BYTES: usize = 12;
/// Mean difference of pixels that shader and reference may have where both show the object, in 8-bit units: one rounds to bytes, and
/// rays and triangles disagree on pixels at the edges.
const TWIN_UNITS: f64 = 0.5;

struct Regime {
    name: &'static str,
    about: &'static str,
    capture: fn() -> Capture,
}

const REGIMES: [Regime; 11] = [
    Regime { name: "one camera", about: "most of the surface is never seen", capture: one_camera },
    Regime { name: "cameras on one side", about: "vertices that no photograph shows", capture: one_side },
    Regime {
        name: "black object",
        about: "rank 0: rows of zeros in every factor",
        capture: || sphere(Look::Black, 12, SIZE),
    },
    Regime {
        name: "matt object",
        about: "rank below the number of terms",
        capture: || sphere(Look::Diffuse, 12, SIZE),
    },
    Regime { name: "one photograph twelve times", about: "repeated singular values", capture: repeated },
    Regime {
        name: "triangles without area",
        about: "no normal, no place for samples",
        capture: without_area,
    },
    Regime { name: "edges of three triangles", about: "no inside and outside", capture: three_at_an_edge },
    Regime {
        name: "vertices without triangles",
        about: "nothing to be seen of them",
        capture: lone_vertices,
    },
    Regime { name: "cameras that look away", about: "no photograph shows the object", capture: looking_away },
    Regime { name: "camera inside", about: "the object lies around the eye", capture: inside },
    Regime { name: "no triangles", about: "nothing to draw", capture: no_triangles },
];

fn one_camera() -> Capture {
    let whole = sphere(Look::Glossy, 12, SIZE);
    Capture { views: whole.views[..1].to_vec(), ..whole }
}

fn one_side() -> Capture {
    let mesh = icosphere(1);
    let above = eyes(24, DISTANCE, 0.0).into_iter().filter(|eye| eye.z > 0.0);
    let views = above.map(|eye| photograph(&mesh, Look::Glossy, camera(eye, SIZE))).collect();
    Capture { mesh, views }
}

fn repeated() -> Capture {
    let one = one_camera();
    Capture { views: vec![one.views[0].clone(); 12], ..one }
}

fn with_triangles(more: &[[u32; 3]]) -> Capture {
    let mut capture = sphere(Look::Glossy, 12, SIZE);
    capture.mesh.triangles.extend(more);
    capture
}

fn without_area() -> Capture {
    with_triangles(&[[0, 0, 1], [2, 2, 2], [3, 4, 3]])
}

fn three_at_an_edge() -> Capture {
    let first = icosphere(1).triangles[0];
    with_triangles(&[[first[0], first[1], 30], [first[0], first[1], 31]])
}

fn lone_vertices() -> Capture {
    let mut capture = sphere(Look::Glossy, 12, SIZE);
    capture.mesh.positions.extend([Vec3::splat(0.1), Vec3::splat(3.0)]);
    capture
}

fn looking_away() -> Capture {
    let mut capture = sphere(Look::Glossy, 6, SIZE);
    for view in &mut capture.views {
        view.camera = camera(-view.camera.eye(), SIZE);
        view.camera.to_world.w_axis = (-view.camera.eye()).extend(1.0);
    }
    capture
}

fn inside() -> Capture {
    let mesh = icosphere(1);
    let views =
        eyes(6, 0.2, 0.0).into_iter().map(|eye| photograph(&mesh, Look::Glossy, camera(eye, SIZE))).collect();
    Capture { mesh, views }
}

fn no_triangles() -> Capture {
    let whole = sphere(Look::Glossy, 2, SIZE);
    Capture { mesh: Mesh::default(), ..whole }
}

/// What each regime is about.
pub(super) fn about() -> Vec<(&'static str, &'static str)> {
    REGIMES.iter().map(|regime| (regime.name, regime.about)).collect()
}

/// Every regime of captures.
///
/// # Errors
/// Where a picture cannot be written.
pub(super) fn rows(tools: &Tools, say: &mut dyn FnMut(Row)) -> Outcome<()> {
    let goals = [("lightfield", None), ("lightfield at 34 dB", Some(GOAL_DB))];
    for (regime, (codec, goal)) in REGIMES.iter().flat_map(|regime| goals.map(|goal| (regime, goal))) {
        let start = Instant::now();
        let capture = (regime.capture)();
        let mut pictures = Vec::new();
        let outcome = match guarded(|cancel| encode(&capture, goal, &tools.single, cancel)) {
            Err(fault) => record::Outcome::Broken(fault),
            Ok(Err(EncodeError::Cancelled)) => record::Outcome::Broken("does not end in time".to_owned()),
            Ok(Err(error)) => record::Outcome::Refused(record::words(&error)),
            Ok(Ok(made)) => match guarded(|cancel| held(&capture, goal, &made, tools, cancel)) {
                Err(fault) => record::Outcome::Broken(fault),
                Ok(outcome) => {
                    pictures = views(&capture, &made.texture)?;
                    outcome
                }
            },
        };
        let seconds = start.elapsed().as_secs_f64();
        say(Row { regime: regime.name, codec: codec.to_owned(), outcome, seconds, pictures });
    }
    Ok(())
}

/// A texture, its PSNR against the photographs, and that of its mean alone.
struct Made {
    texture: LightTexture,
    psnr: f64,
    of_mean: f64,
    /// As `of_mean`, over the same samples, with all terms.
    of_all: f64,
}

fn encode(
    capture: &Capture,
    goal: Option<f64>,
    pool: &ThreadPool,
    cancel: &Cancel,
) -> Result<Made, EncodeError> {
    let mut job = Job::default().with_pool(pool).with_cancel(cancel);
    let params = LightParams::default().with_terms(TERMS).with_psnr(goal);
    let (texture, quality) = Lightfield::encode_measured(capture, &params, &mut job)?;
    let of_mean = quality.psnr_of_terms.first().copied().unwrap_or(quality.psnr);
    let of_all = quality.psnr_of_terms.last().copied().unwrap_or(quality.psnr);
    Ok(Made { texture, psnr: quality.psnr, of_mean, of_all })
}

fn held(
    capture: &Capture,
    goal: Option<f64>,
    made: &Made,
    tools: &Tools,
    cancel: &Cancel,
) -> record::Outcome {
    let bytes = file_of(&made.texture);
    let texels = seen(capture).max(1) as f64;
    let mut checks = vec![
        decoded(&bytes),
        Check::least(
            "PSNR beside that of the mean alone, dB",
            made.of_all.min(EXACT_DB),
            made.of_mean.min(EXACT_DB) - SLACK_DB,
        ),
        Check::least("PSNR beside that of one colour, dB", made.psnr, of_one_colour(capture)),
    ];
    if goal.is_some() {
        // Without one, maps are as fine as the photographs allow, and of small photographs larger than these.
        checks.push(Check::most(
            "bytes of the file",
            bytes.len() as f64,
            given_bytes(capture) + HEADER_BYTES,
        ));
    }
    let by_two = |pool: &ThreadPool| encode(capture, goal, pool, cancel);
    checks.extend(tools.is_independent_of_threads(&bytes, by_two, |other| file_of(&other.texture)));
    let change = encode(&nudged(capture), goal, &tools.single, cancel)
        .map_or(f64::INFINITY, |other| (other.psnr.min(EXACT_DB) - made.psnr.min(EXACT_DB)).abs());
    checks.push(Check::most("change of PSNR by 1e-7 of the vertices, dB", change, NUDGE_DB));
    checks.extend(twin(tools, capture, &made.texture));
    record::Outcome::Made {
        verdict: made.texture.notes().verdict.clone(),
        psnr: made.psnr,
        bpp: made.texture.memory().compressed as f64 / texels,
        checks,
    }
}

/// Pixels that show the object, in all photographs.
fn seen(capture: &Capture) -> usize {
    capture.views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] > 127).count()
}

/// The photographs, three bytes a pixel that shows the object, and the mesh as it was given.
fn given_bytes(capture: &Capture) -> f64 {
    let mesh = VERTEX_BYTES * capture.mesh.positions.len() + TRIANGLE_BYTES * capture.mesh.triangles.len();
    (3 * seen(capture) + mesh) as f64
}

/// The file opens and every pixel drawn of it from around is a number; bytes always are, so what is counted is what cannot be drawn.
fn decoded(bytes: &[u8]) -> Check {
    let strange = open(bytes).and_then(AnyTexture::into_light).map_or(f64::INFINITY, |texture| {
        let directions = eyes(5, 1.0, 0.3);
        let places = [Vec3::X, Vec3::new(0.5, 0.25, 0.25), Vec3::new(0.1, 0.0, 0.9)];
        let samples =
            (0..texture.layout().triangles).flat_map(|triangle| places.map(|place| (triangle, place)));
        let colours = samples.flat_map(|(triangle, barycentric)| {
            directions.iter().map(move |&direction| texfold::core::LightAddress {
                triangle,
                barycentric,
                direction,
            })
        });
        colours.filter(|&at| !texture.texel(at).is_finite()).count() as f64
    });
    Check::most("samples of the stored file that are no numbers", strange, 0.0)
}

/// PSNR of the mean colour of all photographs, in dB.
fn of_one_colour(capture: &Capture) -> f64 {
    let pixels = || capture.views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] == 255);
    let colour =
        |pixel: &[u8; 4]| Vec3::new(pixel[0].into(), pixel[1].into(), pixel[2].into()).as_dvec3() / 255.0;
    let count = pixels().count().max(1) as f64;
    let mean = pixels().map(colour).sum::<glam::DVec3>() / count;
    let squares: f64 = pixels().map(|pixel| (colour(pixel) - mean).length_squared()).sum();
    (-10.0 * (squares / (3.0 * count)).log10()).min(EXACT_DB)
}

/// All vertices moved by what rounding leaves.
fn nudged(capture: &Capture) -> Capture {
    let mut nudged = capture.clone();
    let mut rng = Rng::new(3);
    for place in &mut nudged.mesh.positions {
        *place += Vec3::from([0.0; 3].map(|_: f32| rng.between(-1.0, 1.0) as f32)) * NUDGE;
    }
    nudged
}

/// The first photograph's view by the shader and by the reference.
fn twin(tools: &Tools, capture: &Capture, texture: &LightTexture) -> Option<Check> {
    let gpu = tools.gpu.as_ref()?;
    let camera = capture.views.first()?.camera;
    let light = gpu.upload_light(&texture.gpu()).ok()?.with_terms(texture.layout().terms);
    let (near, far) = texture.mesh().depths(&camera);
    let size = (camera.width, camera.height);
    let drawn = gpu.draw_light(&light, camera.view_projection(near, far), camera.eye(), size).ok()?;
    let wanted = Renderer::new(texture).render(&camera);
    let both = drawn.iter().zip(&wanted).filter(|(a, b)| a[3] == 255 && b[3] == 255);
    let apart: Vec<u32> =
        both.flat_map(|(a, b)| [0, 1, 2].map(|channel| u32::from(a[channel].abs_diff(b[channel])))).collect();
    let mean = f64::from(apart.iter().sum::<u32>()) / apart.len().max(1) as f64;
    Some(Check::most("mean difference of the shader's pixels, 8-bit units", mean, TWIN_UNITS))
}

/// The first photograph, and the same view drawn.
fn views(capture: &Capture, texture: &LightTexture) -> Outcome<Vec<Vec<u8>>> {
    let Some(view) = capture.views.first() else { return Ok(Vec::new()) };
    let drawn = Renderer::new(texture).render(&view.camera);
    let size = (view.camera.width, view.camera.height);
    Ok(vec![page::png_of_pixels(&view.pixels, size)?, page::png_of_pixels(&drawn, size)?])
}

/// What is varied of a capture, and how far; quick values first.
struct Sweep {
    title: &'static str,
    across: &'static str,
    values: [f64; 6],
    capture: fn(f64) -> Capture,
}

/// Titles of charts begin so, and these are their lines.
const TITLE: &str = "Light field: ";
const MEAN_LINE: &str = "the mean alone";
const TERMS_LINE: &str = "mean and terms";
/// Values of [`Sweep::values`] that a quick run takes.
const QUICK: usize = 3;
/// Photographs where their number is not what is varied.
const VIEWS: u32 = 24;

const SWEEPS: [Sweep; 4] = [
    Sweep {
        title: "Number of photographs",
        across: "photographs",
        values: [4.0, 16.0, 48.0, 8.0, 24.0, 96.0],
        capture: |count| sphere(Look::Glossy, count as u32, SIZE),
    },
    Sweep {
        title: "Error of camera places",
        across: "deviation in per cent of the object's radius",
        values: [0.0, 2.0, 10.0, 0.5, 1.0, 5.0],
        capture: |percent| disturbed(percent / 100.0, 0.0, 0.0),
    },
    Sweep {
        title: "Error of the mesh",
        across: "deviation of vertices in per cent of the object's radius",
        values: [0.0, 2.0, 10.0, 0.5, 1.0, 5.0],
        capture: |percent| disturbed(0.0, percent / 100.0, 0.0),
    },
    Sweep {
        title: "Noise of the photographs",
        across: "deviation in 8-bit units",
        values: [0.0, 5.0, 20.0, 1.0, 2.0, 10.0],
        capture: |units| disturbed(0.0, 0.0, units),
    },
];

/// A capture whose cameras, vertices and pixels are not what they were.
fn disturbed(cameras: f64, vertices: f64, pixels: f64) -> Capture {
    let mut capture = sphere(Look::Glossy, VIEWS, SIZE);
    let mut rng = Rng::new(17);
    // A sum of three has nearly a normal distribution, of deviation 1 / 2 each 1.
    let mut normal = move || (0..3).map(|_| rng.between(-1.0, 1.0)).sum::<f64>();
    for view in &mut capture.views {
        let off = Vec3::from([0.0; 3].map(|_: f32| (normal() * cameras) as f32));
        view.camera.to_world.w_axis += off.extend(0.0);
        for pixel in view.pixels.iter_mut().filter(|_| pixels > 0.0) {
            for value in &mut pixel[..3] {
                *value = (f64::from(*value) + normal() * pixels).round().clamp(0.0, 255.0) as u8;
            }
        }
    }
    for place in capture.mesh.positions.iter_mut().filter(|_| vertices > 0.0) {
        *place *= 1.0 + (normal() * vertices) as f32;
    }
    capture
}

/// All charts of captures.
///
/// # Errors
/// None: what cannot be encoded has no point.
pub(super) fn curves(extent: Extent) -> Outcome<Vec<Curve>> {
    let unseen = unseen();
    let curve = |sweep: &Sweep| {
        let count = if extent == Extent::Full { sweep.values.len() } else { QUICK };
        let mut values = sweep.values[..count].to_vec();
        values.sort_by(f64::total_cmp);
        let found: Vec<Option<[f64; 2]>> =
            values.par_iter().map(|&value| new_views(&(sweep.capture)(value), &unseen)).collect();
        let line = |name: &str, index: usize| {
            let point = |(&x, found): (&f64, &Option<[f64; 2]>)| {
                found.map(|found| Point { x, y: found[index], gave_way: false })
            };
            (name.to_owned(), values.iter().zip(&found).filter_map(point).collect())
        };
        Curve {
            title: format!("{TITLE}{}", sweep.title),
            across: sweep.across,
            up: "PSNR of views that no photograph shows, dB",
            lines: vec![line(MEAN_LINE, 0), line(TERMS_LINE, 1)],
        }
    };
    Ok(SWEEPS.iter().map(curve).collect())
}

/// What light fields withstand least, by the charts of [`curves`]; pictures are of a view that no photograph shows.
///
/// # Errors
/// Where a picture cannot be made.
pub(super) fn failure(curves: &[Curve]) -> Outcome<Failure> {
    let falls = falls(curves.iter().filter(|curve| curve.title.starts_with(TITLE)), TERMS_LINE, None);
    let mean = |x: f64| {
        let (_, points) = falls.first()?.curve.lines.iter().find(|(name, _)| name == MEAN_LINE)?;
        points.iter().find(|point| point.x == x).map(|point| point.y)
    };
    let is_no_better = |point: &Point| mean(point.x).is_some_and(|mean| point.y <= mean + SLACK_DB);
    let fallback = match falls.first().and_then(|fall| fall.values_where(is_no_better)) {
        Some(values) => format!("and terms are worth nothing beside the mean at {values}"),
        None => "and terms are above the mean alone at each value".to_owned(),
    };
    let name = |title: &str| title.trim_start_matches(TITLE).to_owned();
    let sentence = sentence("lightfield", &falls, name, "dB of new views", &fallback);
    let unseen = unseen();
    let view = &unseen[0];
    let mut pictures = vec![Picture {
        png: page::png_of_pixels(&view.pixels, (SIZE, SIZE))?,
        caption: "a new view".to_owned(),
    }];
    if let Some(fall) = falls.first() {
        let sweep = &SWEEPS[fall.index];
        for value in [fall.best.x, fall.worst.x] {
            let params = LightParams::default().with_terms(TERMS);
            let (texture, _) =
                Lightfield::encode_measured(&(sweep.capture)(value), &params, &mut Job::default())?;
            let drawn = Renderer::new(&texture).render(&view.camera);
            pictures.push(Picture {
                png: page::png_of_pixels(&drawn, (SIZE, SIZE))?,
                caption: format!("{value}: drawn"),
            });
        }
    }
    Ok(Failure { method: "lightfield".to_owned(), sentence, pictures })
}

/// Views between those of all captures.
fn unseen() -> Vec<Photograph> {
    let mesh = icosphere(1);
    eyes(7, DISTANCE, 1.0).into_iter().map(|eye| photograph(&mesh, Look::Glossy, camera(eye, SIZE))).collect()
}

/// PSNR in dB of new views by the mean alone and by all terms.
fn new_views(capture: &Capture, unseen: &[Photograph]) -> Option<[f64; 2]> {
    let params = LightParams::default().with_terms(TERMS);
    let (texture, _) = Lightfield::encode_measured(capture, &params, &mut Job::default()).ok()?;
    let psnr = |texture: &LightTexture| {
        let renderer = Renderer::new(texture);
        let error = unseen.iter().fold(SquaredError::default(), |sum, view| {
            sum + squares(&renderer.render(&view.camera), &view.pixels)
        });
        error.psnr()
    };
    let all = psnr(&texture);
    Some([psnr(&texture.first_terms(0)), all])
}

/// Where the photograph shows the object and nothing else.
fn squares(drawn: &[[u8; 4]], wanted: &[[u8; 4]]) -> SquaredError {
    let both = drawn.iter().zip(wanted).filter(|(_, wanted)| wanted[3] == 255);
    let apart =
        both.flat_map(|(a, b)| [0, 1, 2].map(|channel| f64::from(a[channel]) - f64::from(b[channel])));
    apart.fold(SquaredError::default(), |sum, apart| sum + SquaredError { sum: apart * apart, count: 1 })
}

//! Light fields against views of a capture that were never used for fitting: meshes, terms, parts of the model and content, beside the
//! mean alone and the nearest photograph projected again.
//!
//! `cargo run --release -p texfold-benches --bin lightfield -- [OUT_DIR] [CAPTURE] [FORM]`: a capture's folder with `transforms_test.json` and
//! decimated meshes; `slf/spot_gloss` of the shared data where none is named; of its forms those whose names hold the last argument. Writes lightfield.csv and lightfield.md. PSNR counts pixels of the
//! object alone; those that a mesh does not cover count as black.

use std::path::{Path, PathBuf};

use texfold::{
    Camera, Capture, Content, Directions, Encoded, Factors, Fit, Job, LightParams, LightTexture, Lightfield,
    Model, Renderer, View,
};
use texfold_benches::report::{Outcome, Table, cpu_seconds};

/// Meshes beside the capture's own, by their triangles.
const MESHES: [u32; 3] = [600, 1500, 3000];
/// Share of the object's pixels that are called brightest.
const BRIGHTEST: f64 = 0.1;
/// Distances of two hits on one ray that are one place, as a share.
const SAME_PLACE: f32 = 2e-3;

/// What is encoded: a name, and how.
fn variants() -> Vec<(&'static str, LightParams)> {
    let usual = LightParams { terms: 3, sampling: 0.6, ..LightParams::default() };
    let model = |model| LightParams { model, ..usual.clone() };
    let all = Model::default();
    let small = LightParams { terms: 1, grid: 12, sampling: 0.35, content: Content::Bc1, ..usual.clone() };
    vec![
        ("0 terms", LightParams { terms: 0, ..usual.clone() }),
        ("1 term", LightParams { terms: 1, ..usual.clone() }),
        ("2 terms", LightParams { terms: 2, ..usual.clone() }),
        ("3 terms", usual.clone()),
        ("6 terms", LightParams { terms: 6, ..usual.clone() }),
        ("3 terms at every vertex", model(Model { chosen: false, ..all })),
        ("no partly seen triangles", model(Model { partial: false, ..all })),
        ("factors without signs", model(Model { factors: Factors::NonNegative, ..all })),
        ("over the view direction", model(Model { directions: Directions::View, ..all })),
        ("resampled, reflected", model(Model { fit: Fit::Resampled, ..all })),
        ("resampled (the paper)", model(Model { fit: Fit::Resampled, directions: Directions::View, ..all })),
        ("all samples, maps of 24x24", LightParams { grid: 24, sampling: 1.0, ..usual.clone() }),
        ("3 terms, BC7", LightParams { content: Content::Bc7, ..usual.clone() }),
        ("3 terms, BC1", LightParams { content: Content::Bc1, ..usual.clone() }),
        ("small: 1 term, BC1, maps of 12x12", small),
    ]
}

/// How close views come.
struct Closeness {
    psnr: f64,
    worst: f64,
    brightest: f64,
}

fn db(squares: f64, count: f64) -> f64 {
    10.0 * (65025.0 * 3.0 * count.max(1.0) / squares.max(1e-9)).log10()
}

/// Compares what `draw` gives for the camera of each view with the view.
fn closeness(tests: &[View], draw: impl Fn(&Camera) -> Vec<[u8; 4]>) -> Closeness {
    let mut errors: Vec<(u32, f64)> = Vec::new();
    let mut worst = f64::INFINITY;
    for view in tests {
        let drawn = draw(&view.camera);
        let first = errors.len();
        for (wanted, found) in view.pixels.iter().zip(&drawn).filter(|(wanted, _)| wanted[3] > 127) {
            let squares: f64 = (0..3).map(|c| f64::from(wanted[c].abs_diff(found[c])).powi(2)).sum();
            errors.push((wanted[..3].iter().map(|&value| u32::from(value)).sum(), squares));
        }
        let own = &errors[first..];
        worst = worst.min(db(own.iter().map(|(_, squares)| squares).sum(), own.len() as f64));
    }
    let sum =
        |errors: &[(u32, f64)]| db(errors.iter().map(|(_, squares)| squares).sum(), errors.len() as f64);
    let psnr = sum(&errors);
    errors.sort_by_key(|&(brightness, _)| std::cmp::Reverse(brightness));
    errors.truncate((errors.len() as f64 * BRIGHTEST).ceil() as usize);
    Closeness { psnr, worst, brightest: sum(&errors) }
}

/// The photograph whose direction is nearest of those that see a place, at each pixel of a camera.
fn nearest_photograph(capture: &Capture, renderer: &Renderer<'_>, camera: &Camera) -> Vec<[u8; 4]> {
    let eye = camera.eye();
    let pixel = |index: u32| {
        let at = glam::Vec2::new((index % camera.width) as f32, (index / camera.width) as f32) + 0.5;
        let ray = camera.ray(at);
        let Some((distance, _)) = renderer.meet(eye, ray) else { return [0; 4] };
        let place = eye + distance * ray;
        let mut order: Vec<(f32, usize)> = (0..capture.views.len())
            .map(|view| (-(capture.views[view].camera.eye() - place).normalize().dot(-ray), view))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.iter().find_map(|&(_, view)| colour_of(&capture.views[view], renderer, place)).unwrap_or([0; 4])
    };
    (0..camera.width * camera.height).map(pixel).collect()
}

/// The pixel of a photograph that shows a place, where it does.
fn colour_of(view: &View, renderer: &Renderer<'_>, place: glam::Vec3) -> Option<[u8; 4]> {
    let camera = &view.camera;
    let at = camera.project(camera.to_camera().transform_point3(place))?;
    if at.min_element() < 0.0 || at.x >= camera.width as f32 || at.y >= camera.height as f32 {
        return None;
    }
    let pixel = view.pixels[at.y as usize * camera.width as usize + at.x as usize];
    let (distance, _) = renderer.meet(camera.eye(), place - camera.eye())?;
    (pixel[3] > 250 && (distance - 1.0).abs() < SAME_PLACE).then_some(pixel)
}

fn encode(capture: &Capture, params: &LightParams) -> Outcome<(LightTexture, f64)> {
    let (texture, quality) = Lightfield::encode_measured(capture, params, &mut Job::default())?;
    Ok((texture, quality.psnr))
}

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "target/lightfield".to_owned()));
    let named = arguments.next().map(PathBuf::from);
    let shared = || Some(texfold_testkit::data_dir("the light-field table")?.join("slf/spot_gloss"));
    let Some(dir) = named.or_else(shared) else { return Ok(()) };
    std::fs::create_dir_all(&out)?;
    let tests =
        texfold_cli::read_views(&dir.join("transforms_test.json")).map_err(|error| error.to_string())?;
    let mut table = Table::new(&[
        "form",
        "triangles",
        "kB file",
        "kB memory",
        "photographs : file",
        "dB of the photographs",
        "dB of new views",
        "worst view",
        "brightest 10 %",
        "CPU s",
    ]);
    let only = arguments.next().unwrap_or_default();
    let variants: Vec<_> = variants().into_iter().filter(|(name, _)| name.contains(&only)).collect();
    for (name, params) in &variants {
        row(&mut table, name, &dir, None, params, &tests)?;
    }
    for triangles in MESHES.into_iter().filter(|n| dir.join(format!("mesh_{n}.obj")).is_file()) {
        for (name, params) in variants.iter().filter(|(name, _)| ["0 terms", "3 terms"].contains(name)) {
            row(&mut table, name, &dir, Some(triangles), params, &tests)?;
        }
    }
    baseline(&mut table, &dir, &tests)?;
    table.write(&out, "lightfield", "Light fields against views that were never used for fitting.")
}

fn row(
    table: &mut Table,
    name: &str,
    dir: &Path,
    triangles: Option<u32>,
    params: &LightParams,
    tests: &[View],
) -> Outcome<()> {
    let capture = texfold_cli::read_capture(dir, triangles).map_err(|error| error.to_string())?;
    let before = cpu_seconds();
    let (texture, of_photographs) = encode(&capture, params)?;
    let seconds = cpu_seconds() - before;
    let renderer = Renderer::new(&texture);
    let found = closeness(tests, |camera| renderer.render(camera));
    let footprint = texture.footprint();
    let shown = capture.views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] > 127).count();
    let bytes = [footprint.bits_disk(), footprint.bits_memory()].map(|bits| bits as f64 / 8.0);
    table.row(vec![
        name.to_owned(),
        texture.mesh().triangles.len().to_string(),
        format!("{:.0}", bytes[0] / 1e3),
        format!("{:.0}", bytes[1] / 1e3),
        format!("{:.0} : 1", 3.0 * shown as f64 / bytes[0]),
        format!("{of_photographs:.2}"),
        format!("{:.2}", found.psnr),
        format!("{:.2}", found.worst),
        format!("{:.2}", found.brightest),
        format!("{seconds:.0}"),
    ]);
    Ok(())
}

/// The nearest photograph, on the capture's own mesh.
fn baseline(table: &mut Table, dir: &Path, tests: &[View]) -> Outcome<()> {
    let capture = texfold_cli::read_capture(dir, None).map_err(|error| error.to_string())?;
    let (texture, _) =
        encode(&capture, &LightParams { terms: 0, sampling: 0.125, ..LightParams::default() })?;
    let renderer = Renderer::new(&texture);
    let found = closeness(tests, |camera| nearest_photograph(&capture, &renderer, camera));
    let mut cells = vec!["nearest photograph".to_owned(), texture.mesh().triangles.len().to_string()];
    cells.extend(["", "", "1 : 1", ""].map(str::to_owned));
    cells.extend([found.psnr, found.worst, found.brightest].map(|value| format!("{value:.2}")));
    cells.push(String::new());
    table.row(cells);
    Ok(())
}

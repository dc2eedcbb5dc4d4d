//! Light fields against views of a capture that were never used for fitting, beside the mean alone and the nearest photograph
//! projected again.
//!
//! `cargo run --release -p texfold-benches --bin lightfield -- [OUT] [CAPTURE] [TABLE]`: a capture's folder with `transforms_test.json`;
//! `slf/spot_gloss` of the shared data where none is named. Tables are `meshes` (quality against size by triangles and terms, with a
//! chart), `stored` (raw maps, block compression and codebooks), `blocks` (blocks of variable length beside planes; a test view of each is
//! drawn into OUT), `model` (parts of the model left out or done otherwise), `speed` (of encodes) and
//! `frames` (of drawing); all where none is named. PSNR counts pixels of the object alone; those that a mesh does not cover count as black.

#[path = "lightfield/edges.rs"]
mod edges;
#[path = "lightfield/views.rs"]
mod views;

use std::path::PathBuf;
use std::time::Instant;

use texfold::{
    Access, Content, Encoded, Job,
    core::{Capture, Photograph},
    lightfield::{
        Directions, Factors, FitMethod, LightModel, LightParams, LightQuality, LightTexture, Lightfield,
        MapStorage, Renderer,
    },
};
use texfold_benches::report::{Outcome, Table, cpu_seconds};
use texfold_capture::read_image;
use texfold_chart::{Axis, Chart, Kind, LARGE, Names, Point, Scale, Series};
use texfold_gpu::{Gpu, Policy};
use views::{Closeness, closeness};

/// Meshes by their triangles, simplified from the capture's own, which is the last.
const MESHES: [Option<u32>; 4] = [Some(600), Some(1500), Some(3000), None];
/// The mesh of the tables of one mesh.
const USUAL_MESH: Option<u32> = Some(3000);
/// Most terms of the chart.
const MOST_TERMS: u32 = 6;
/// Pixels a side of images that are timed, and how often each is drawn.
const FRAME: u32 = 512;
const DRAWS: usize = 15;
/// Terms that are drawn beside the mean.
const FRAME_TERMS: [u32; 4] = [0, 1, 2, 3];
/// Log2 downscale of surface maps in small files.
const SMALL_REDUCE_LOG2: u8 = 2;
/// Regions and shares of codewords of small files.
const SMALL: [(u32, f32); 5] = [(24, 0.4), (50, 0.5), (110, 0.6), (250, 0.7), (500, 0.8)];

/// The size from which the marks of the chart's axis double, in kB.
const LEAST_KILOBYTES: f64 = 62.5;

struct Bench {
    dir: PathBuf,
    out: PathBuf,
    tests: Vec<Photograph>,
}

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "target/lightfield".to_owned()));
    let named = arguments.next().filter(|dir| !dir.is_empty()).map(PathBuf::from);
    let shared = || Some(texfold_testkit::data_dir("the light-field tables")?.join("slf/spot_gloss"));
    let Some(dir) = named.or_else(shared) else { return Ok(()) };
    std::fs::create_dir_all(&out)?;
    let tests = texfold_capture::read_views(&dir.join("transforms_test.json"), None, read_image)
        .map_err(|error| error.to_string())?;
    let bench = Bench { dir, out, tests };
    let only = arguments.next();
    for (name, table) in [
        ("meshes", Bench::meshes as fn(&Bench) -> Outcome<()>),
        ("stored", Bench::stored),
        ("blocks", Bench::blocks),
        ("model", Bench::model),
        ("speed", Bench::speed),
        ("frames", Bench::frames),
    ] {
        if only.as_deref().is_none_or(|only| only == name) {
            table(&bench)?;
        }
    }
    Ok(())
}

fn usual() -> LightParams {
    LightParams::default().with_terms(3).with_access(Access::Texel)
}

/// One term whose view maps are shared: small files.
fn of_regions(regions: u32) -> LightParams {
    let model =
        LightModel::default().with_fit(FitMethod::Shared { regions }).with_directions(Directions::World);
    usual().with_terms(1).with_surface_reduce_log2(SMALL_REDUCE_LOG2).with_grid(32).with_model(model)
}

fn columns() -> Table {
    Table::new(&[
        "form",
        "triangles",
        "terms",
        "kB file",
        "kB memory",
        "resampled : file",
        "resampled : maps in memory",
        "photographs : file",
        "dB of matrices",
        "dB of colours",
        "dB of new views",
        "worst view",
        "brightest 10 %",
        "steps at edges, mean",
        "most",
        "CPU s",
    ])
}

/// One row's measurements.
struct Measured {
    bytes: f64,
    found: Closeness,
}

impl Bench {
    fn capture(&self, triangles: Option<u32>) -> Outcome<Capture> {
        Ok(texfold_capture::read(&self.dir, None, triangles, read_image)
            .map_err(|error| error.to_string())?)
    }

    fn row(
        &self,
        table: &mut Table,
        name: &str,
        capture: &Capture,
        (texture, quality): (&LightTexture, &LightQuality),
        seconds: f64,
    ) -> Measured {
        let renderer = Renderer::new(texture);
        let found = closeness(&self.tests, |camera| renderer.render(camera));
        let footprint = texture.footprint();
        let shown = capture.views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] > 127).count();
        let [file, memory] = [footprint.bits_disk(), footprint.bits_memory()].map(|bits| bits as f64 / 8.0);
        let of_maps = footprint.parts.iter().filter(|part| part.name != "mesh" && part.name != "container");
        let maps = of_maps.map(|part| part.bits_memory).sum::<u64>() as f64 / 8.0;
        let ratio = |whole: f64, part: f64| format!("{:.0}", whole / part);
        let resampled = quality.resampled_bytes as f64;
        let terms = texture.layout().terms as usize;
        let steps = edges::steps(texture);
        table.row(vec![
            name.to_owned(),
            texture.mesh().triangles.len().to_string(),
            terms.to_string(),
            format!("{:.0}", file / 1e3),
            format!("{:.0}", memory / 1e3),
            ratio(resampled, file),
            ratio(resampled, maps),
            ratio(3.0 * shown as f64, file),
            format!("{:.2}", quality.psnr_of_terms.get(terms).copied().unwrap_or(quality.psnr)),
            format!("{:.2}", quality.psnr_of_colours),
            format!("{:.2}", found.psnr),
            format!("{:.2}", found.worst),
            format!("{:.2}", found.brightest),
            format!("{:.2}", steps.mean),
            format!("{:.1}", steps.most),
            format!("{seconds:.0}"),
        ]);
        Measured { bytes: file, found }
    }

    /// The mean alone and the nearest photograph, on the capture's own mesh; dB of the latter.
    fn baselines(&self, table: &mut Table) -> Outcome<f64> {
        let capture = self.capture(None)?;
        let before = cpu_seconds();
        let none = usual().with_terms(0);
        let (texture, quality) = Lightfield::encode_measured(&capture, &none, &mut Job::default())?;
        self.row(table, "mean alone", &capture, (&texture, &quality), cpu_seconds() - before);
        let renderer = Renderer::new(&texture);
        let found = closeness(&self.tests, |camera| {
            texfold_cli::draw_photographs(&capture.views, &renderer, camera, false)
        });
        let mut cells = vec!["nearest photograph".to_owned(), texture.mesh().triangles.len().to_string()];
        cells.extend(["", "", "", "", "", "1", "", ""].map(str::to_owned));
        cells.extend([found.psnr, found.worst, found.brightest].map(|value| format!("{value:.2}")));
        cells.extend(["", "", ""].map(str::to_owned));
        table.row(cells);
        Ok(found.psnr)
    }

    /// Small files on the capture's own mesh: kilobytes and dB.
    fn small(&self, table: &mut Table) -> Outcome<Vec<(f64, f64)>> {
        let capture = self.capture(None)?;
        let mut points = Vec::new();
        for (regions, codewords) in SMALL {
            let params = of_regions(regions).with_codewords(codewords).with_content(Content::Bc1);
            let before = cpu_seconds();
            let (texture, quality) = Lightfield::encode_measured(&capture, &params, &mut Job::default())?;
            let name = format!("{regions} regions, bc1, codewords {codewords}");
            let row = self.row(table, &name, &capture, (&texture, &quality), cpu_seconds() - before);
            points.push((row.bytes / 1e3, row.found.psnr));
        }
        Ok(points)
    }

    /// Quality against size, as in Figure 8 of the paper: prefixes of one file of six terms.
    fn meshes(&self) -> Outcome<()> {
        let mut table = columns();
        let mut series = Vec::new();
        for (factors, kind) in [(Factors::Signed, "PCA"), (Factors::NonNegative, "NMF")] {
            for (colour, triangles) in MESHES.into_iter().enumerate() {
                let capture = self.capture(triangles)?;
                let model = LightModel::default().with_factors(factors);
                let params = usual().with_terms(MOST_TERMS).with_model(model);
                let before = cpu_seconds();
                let (whole, quality) = Lightfield::encode_measured(&capture, &params, &mut Job::default())?;
                let seconds = cpu_seconds() - before;
                let mut points = Vec::new();
                for terms in 0..=MOST_TERMS {
                    let texture = whole.clone().truncated(terms);
                    let row = self.row(&mut table, kind, &capture, (&texture, &quality), seconds);
                    points.push((row.bytes / 1e3, row.found.psnr));
                }
                let count = whole.mesh().triangles.len();
                let name = format!("{kind}, {count} triangles");
                series.push(line(name, colour, factors == Factors::NonNegative, points));
            }
        }
        let name = format!(
            "1 term, regions, BC1, codewords, {} triangles",
            self.capture(None)?.mesh.triangles.len()
        );
        series.push(line(name, MESHES.len(), false, self.small(&mut table)?));
        let nearest = self.baselines(&mut table)?;
        let sizes = series.iter().flat_map(|series: &Series| series.points.iter().map(|point| point.x));
        let (least, most) =
            sizes.fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), x| (least.min(x), most.max(x)));
        series.push(Series {
            name: "nearest photograph".to_owned(),
            colour: None,
            kind: Kind::Line,
            points: vec![(least, nearest).into(), (most, nearest).into()],
        });
        let chart = Chart {
            title: "New views by size of the file",
            across: Axis { label: "kB", scale: Scale::Doublings(LEAST_KILOBYTES) },
            up: Axis { label: "dB", scale: Scale::Linear },
            size: LARGE,
            names: Names::Above,
            series,
        };
        std::fs::write(self.out.join("lightfield.svg"), chart.svg())?;
        table.write(
            &self.out,
            "lightfield",
            "Light fields by triangles and terms; rows of one mesh and kind are prefixes of one file.",
        )
    }

    /// Ways to store the same maps.
    fn stored(&self) -> Outcome<()> {
        let mut table = columns();
        for (name, triangles, params, forms) in fits() {
            let capture = self.capture(triangles)?;
            let before = cpu_seconds();
            let fitted = Lightfield::fit(&capture, &params, &mut Job::default())?;
            let fitting = cpu_seconds() - before;
            for &(content, share) in forms {
                let storage = MapStorage::default().with_content(content).with_codewords(share);
                let before = cpu_seconds();
                let (texture, quality) = fitted.store(storage, &mut Job::default())?;
                let seconds = fitting + cpu_seconds() - before;
                let books = if share < 1.0 { format!(", codewords {share}") } else { String::new() };
                let name = format!("{name}, {}{books}", content.name());
                self.row(&mut table, &name, &capture, (&texture, &quality), seconds);
            }
        }
        self.baselines(&mut table)?;
        table.write(&self.out, "stored", "Fits, each stored in several ways.")
    }

    /// Blocks of variable length at several losses beside planes, of fits of the two meshes that nothing was chosen by and of the one
    /// that [`LOSSES`] were.
    fn blocks(&self) -> Outcome<()> {
        let mut table = columns();
        for (name, triangles, params) in blocks_fits() {
            let capture = self.capture(triangles)?;
            let before = cpu_seconds();
            let fitted = Lightfield::fit(&capture, &params, &mut Job::default())?;
            let fitting = cpu_seconds() - before;
            let plane =
                |content: Content| (content.name().to_owned(), MapStorage::default().with_content(content));
            let block = |loss| (format!("blocks, loss {loss}"), MapStorage::default().with_loss(loss));
            let planes = [Content::Raw, Content::Bc7, Content::Bc1].map(plane);
            for (form, storage) in planes.into_iter().chain(LOSSES.map(block)) {
                let before = cpu_seconds();
                let (texture, quality) = fitted.store(storage, &mut Job::default())?;
                let seconds = fitting + cpu_seconds() - before;
                let name = format!("{name}, {form}");
                self.row(&mut table, &name, &capture, (&texture, &quality), seconds);
                let camera = self.tests[0].camera;
                let pixels = Renderer::new(&texture).render(&camera).into_flattened();
                let image = image::RgbaImage::from_raw(camera.width, camera.height, pixels);
                image.ok_or("a view of another size")?.save(self.out.join(format!("{name}.png")))?;
            }
        }
        table.write(&self.out, "blocks", "Blocks of variable length beside planes.")
    }

    /// Time by vertices and by views, stage by stage.
    fn speed(&self) -> Outcome<()> {
        let mut table = Table::new(&["triangles", "vertices", "views", "stages, CPU s", "all, CPU s"]);
        let whole = self.capture(None)?;
        let few = |part: usize| whole.views.iter().step_by(part).cloned().collect::<Vec<Photograph>>();
        let of_views = [4, 2].map(|part| Capture { views: few(part), mesh: whole.mesh.clone() });
        let of_meshes = [750, 1500, 3000].map(|count| self.capture(Some(count)));
        for capture in of_meshes.into_iter().chain(of_views.into_iter().chain([whole]).map(Ok)) {
            let capture = capture?;
            let stages = stages(&capture, &usual())?;
            let split = stages.iter().map(|(name, seconds)| format!("{name} {seconds:.1}"));
            table.row(vec![
                capture.mesh.triangles.len().to_string(),
                capture.mesh.positions.len().to_string(),
                capture.views.len().to_string(),
                split.collect::<Vec<_>>().join(", "),
                format!("{:.1}", stages.iter().map(|stage| stage.1).sum::<f64>()),
            ]);
        }
        table.write(&self.out, "speed", "CPU seconds of an encode of three terms.")
    }

    /// Frames a second of PCA and NMF, drawn in turns, and seconds of the CPU reference: medians.
    fn frames(&self) -> Outcome<()> {
        let mut table = Table::new(&[
            "factors",
            "terms beside the mean",
            "frames a second",
            "of PCA of as many",
            "of PCA of one more",
            "reference, s a frame",
        ]);
        let gpu = match Gpu::new(Policy::from_env()) {
            Ok(gpu) => gpu,
            Err(error) => {
                println!("skipped: {error}");
                return Ok(());
            }
        };
        let capture = self.capture(USUAL_MESH)?;
        let camera = self.tests[0].camera.resized(FRAME, FRAME);
        let encode = |factors| -> Outcome<LightTexture> {
            // All terms at all vertices, so that both draw as many.
            let model = LightModel::default().with_factors(factors).with_chosen(false);
            let params = usual().with_model(model);
            Ok(Lightfield::encode_measured(&capture, &params, &mut Job::default())?.0)
        };
        let wholes = [encode(Factors::Signed)?, encode(Factors::NonNegative)?];
        let (near, far) = wholes[0].mesh().depths(&camera);
        let projection = camera.view_projection(near, far);
        let mut kinds = Vec::new();
        for (name, whole) in ["PCA", "NMF"].into_iter().zip(&wholes) {
            for terms in FRAME_TERMS {
                let texture = whole.clone().first_terms(terms);
                let light = gpu.upload_light(&texture.gpu())?.with_terms(terms);
                kinds.push((name, terms, texture, light, Vec::new(), Vec::new()));
            }
        }
        for _ in 0..DRAWS {
            for (_, _, texture, light, drawn, cast) in &mut kinds {
                let start = Instant::now();
                gpu.draw_light(light, projection, camera.eye(), (FRAME, FRAME))?;
                drawn.push(start.elapsed().as_secs_f64());
                let renderer = Renderer::new(texture);
                let start = Instant::now();
                std::hint::black_box(renderer.render(&camera));
                cast.push(start.elapsed().as_secs_f64());
            }
        }
        let timed: Vec<_> =
            kinds.into_iter().map(|kind| (kind.0, kind.1, median(kind.4), median(kind.5))).collect();
        for &(name, terms, drawn, cast) in &timed {
            let of_pca = |terms: u32| {
                let pca = timed.iter().find(|other| other.0 == "PCA" && other.1 == terms);
                pca.map_or(String::new(), |pca| format!("{:.2}", pca.2 / drawn))
            };
            table.row(vec![
                name.to_owned(),
                terms.to_string(),
                format!("{:.1}", 1.0 / drawn),
                of_pca(terms),
                of_pca(terms + 1),
                format!("{cast:.2}"),
            ]);
        }
        table.write(&self.out, "frames", "Images of 512x512, drawn in turns.")
    }

    /// Parts of the model.
    fn model(&self) -> Outcome<()> {
        let mut table = columns();
        let capture = self.capture(USUAL_MESH)?;
        for (name, params) in variants() {
            let before = cpu_seconds();
            let (texture, quality) = Lightfield::encode_measured(&capture, &params, &mut Job::default())?;
            self.row(&mut table, name, &capture, (&texture, &quality), cpu_seconds() - before);
        }
        self.baselines(&mut table)?;
        table.write(&self.out, "model", "Parts of the model left out or done otherwise.")
    }
}

/// CPU seconds of each stage of an encode.
fn stages(capture: &Capture, params: &LightParams) -> Outcome<Vec<(&'static str, f64)>> {
    let mut begun: Vec<(&'static str, f64)> = Vec::new();
    let mut progress = |stage: texfold::core::Stage| {
        if begun.last().is_none_or(|last| last.0 != stage.name) {
            begun.push((stage.name, cpu_seconds()));
        }
    };
    Lightfield::encode_measured(capture, params, &mut Job::default().with_progress(&mut progress))?;
    begun.push(("end", cpu_seconds()));
    Ok(begun.windows(2).map(|pair| (pair[0].0, pair[1].1 - pair[0].1)).collect())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// A fit's name, triangles and parameters, and how it is stored: content and the share that codebooks keep.
type Stored = (&'static str, Option<u32>, LightParams, &'static [(Content, f32)]);

/// Losses against raw maps at which blocks are measured, in dB of the matrices.
const LOSSES: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// Fits that are stored in blocks and in planes.
fn blocks_fits() -> Vec<(&'static str, Option<u32>, LightParams)> {
    let one = usual().with_terms(1);
    vec![
        ("3 terms", Some(1500), usual()),
        ("3 terms", USUAL_MESH, usual()),
        ("1 term", None, one.clone()),
        ("1 term, coarser maps", None, one.with_surface_reduce_log2(SMALL_REDUCE_LOG2)),
        ("110 regions, coarser maps", None, of_regions(110)),
    ]
}

/// Fits that are stored in several ways.
fn fits() -> Vec<Stored> {
    use Content::{Bc1, Bc7, Raw};
    let one = usual().with_terms(1).with_surface_reduce_log2(SMALL_REDUCE_LOG2);
    vec![
        (
            "own view maps",
            USUAL_MESH,
            usual(),
            &[(Raw, 1.0), (Raw, 0.5), (Bc7, 1.0), (Bc1, 1.0), (Bc1, 0.5), (Bc1, 0.25), (Bc1, 0.12)],
        ),
        ("own, coarser maps", None, one, &[(Raw, 1.0), (Bc1, 1.0), (Bc1, 0.5), (Bc1, 0.25)]),
        ("500 regions, coarser maps", None, of_regions(500), &[(Raw, 1.0), (Bc1, 0.8)]),
        ("250 regions, coarser maps", None, of_regions(250), &[(Raw, 1.0), (Bc1, 0.7)]),
        (
            "110 regions, coarser maps",
            None,
            of_regions(110),
            &[(Raw, 1.0), (Raw, 0.6), (Bc1, 1.0), (Bc1, 0.6)],
        ),
        ("24 regions, coarser maps", None, of_regions(24), &[(Raw, 1.0), (Bc1, 0.4)]),
    ]
}

/// What is left out, and how.
fn variants() -> Vec<(&'static str, LightParams)> {
    let model = |model| usual().with_model(model);
    let all = LightModel::default();
    let plain = all.with_factors(Factors::NonNegative);
    vec![
        ("usual", usual()),
        ("3 terms at every vertex", model(all.with_chosen(false))),
        ("partly seen triangles thrown away", model(all.with_partial(false))),
        ("factors without signs", model(plain)),
        ("1 term", usual().with_terms(1)),
        ("1 term without signs", model(plain).with_terms(1)),
        ("over the view direction", model(all.with_directions(Directions::View))),
        ("resampled, reflected", model(all.with_fit(FitMethod::Resampled))),
        (
            "resampled (the paper)",
            model(all.with_fit(FitMethod::Resampled).with_directions(Directions::View)),
        ),
        ("maps of 24x24", usual().with_grid(24)),
        ("maps of 12x12", usual().with_grid(12)),
        ("half the samples a side", usual().with_sampling(0.5)),
    ]
}

fn line(name: String, colour: usize, hollow: bool, points: Vec<(f64, f64)>) -> Series {
    let points = points.into_iter().map(|point| Point { hollow, ..point.into() }).collect();
    Series { name, colour: Some(colour), kind: Kind::Both, points }
}

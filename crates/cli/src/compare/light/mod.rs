//! Light fields beside other ways to show a surface from anywhere, against photographs that none of them has seen.

mod harmonics;
mod photographs;

use std::path::Path;

use glam::Vec3;
use texfold::core::{Capture, Photograph};
use texfold::lightfield::{
    Directions, FitMethod, LightModel, LightParams, LightTexture, Lightfield, Renderer,
};
use texfold::{Access, Content, file_of};
use texfold_core::image::{ColorSpace, Raster, to_u8};
use texfold_core::{Camera, Encoded, Job, parallel};

use super::jpeg;
use super::measure::{Cost, Measured};
use super::table::Row;
use crate::compress::light::{Similarity, masked, similarity};
use crate::error::CliError;
use crate::input::{Found, capture};
use crate::material_figures::MaterialFigures;
use harmonics::{Harmonics, MOST_DEGREE};
pub use photographs::draw_photographs;

/// Codecs' names in rows.
const OURS: &str = "lightfield";
const PHOTOGRAPHS: &str = "photographs";
const HARMONICS: &str = "harmonics";

/// Most photographs that are drawn again.
const TESTS: usize = 8;
/// Without photographs for tests, one of so many is held back.
const HELD_BACK: usize = 8;
/// Goals in dB of the photographs' matrices.
const GOALS: [f64; 4] = [30.0, 34.0, 38.0, 42.0];
/// Most terms beside the mean.
const TERMS: u32 = 6;
/// Regions that share view maps, and shares of codewords, of small files.
const SMALL: [(u32, f32); 3] = [(24, 0.4), (110, 0.6), (500, 0.8)];
/// Qualities of photographs as JPEG textures, and of how many one is kept.
const KEPT: [(u8, usize); 4] = [(25, 8), (60, 4), (60, 1), (90, 1)];
/// Steps of the lattice along a side of a triangle, for harmonics at texels.
const TEXELS: u32 = 4;
/// Effort of Zstandard.
const ZSTD_LEVEL: i32 = 19;

/// Whether a row is of a capture.
pub(super) fn is_light(row: &Row) -> bool {
    [OURS, PHOTOGRAPHS, HARMONICS].contains(&row.codec.as_str())
}

/// A way to show a surface.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    codec: &'static str,
    series: &'static str,
    pub(super) settings: String,
    pub(super) has_thumbnail: bool,
    way: Way,
}

#[derive(Debug, Clone)]
enum Way {
    /// By our codec; on a simplified mesh, or the capture's own.
    Ours(Box<LightParams>, bool),
    /// One of so many photographs, as JPEG of a quality.
    Photographs { quality: u8, step: usize, is_blended: bool },
    /// Harmonics of a degree at points of a lattice of so many steps along each side of a triangle.
    Harmonics(u32, u32),
}

/// All ways.
pub(super) fn candidates() -> Vec<Candidate> {
    let ours = |series, settings: String, has_thumbnail, params: LightParams, simplified| Candidate {
        codec: OURS,
        series,
        settings,
        has_thumbnail,
        way: Way::Ours(Box::new(params), simplified),
    };
    let goal = |db: f64| {
        let params = LightParams::default().with_terms(TERMS).with_psnr(db);
        ours("light field", format!("{db} dB"), db == GOALS[1] || db == GOALS[3], params, true)
    };
    let small = |(regions, share): (u32, f32)| {
        let model =
            LightModel::default().with_fit(FitMethod::Shared { regions }).with_directions(Directions::World);
        let params =
            LightParams::default().with_access(Access::Texel).with_surface_reduce_log2(2).with_grid(32);
        let params = params.with_model(model).with_codewords(share).with_content(Content::Bc1);
        ours(
            "light field, shared view maps",
            format!("{regions} regions"),
            regions == SMALL[1].0,
            params,
            false,
        )
    };
    let mean = LightParams::default().with_terms(0);
    let plain = mean.clone().with_access(Access::Texel).with_content(Content::Bc7);
    let mut all: Vec<Candidate> = GOALS.map(goal).into_iter().chain(SMALL.map(small)).collect();
    all.push(ours("one colour a place, dct", "mean".to_owned(), true, mean, false));
    all.push(ours("one colour a place, BC7", "mean".to_owned(), false, plain, false));
    for (series, is_blended) in [("nearest photograph", false), ("blend of three photographs", true)] {
        all.extend(KEPT.map(|(quality, step)| Candidate {
            codec: PHOTOGRAPHS,
            series,
            settings: format!("q{quality}, one of {step}"),
            has_thumbnail: (quality, step) == KEPT[2],
            way: Way::Photographs { quality, step, is_blended },
        }));
    }
    for (series, steps) in [("harmonics a vertex", 1), ("harmonics a texel", TEXELS)] {
        all.extend((1..=MOST_DEGREE).map(|degree| Candidate {
            codec: HARMONICS,
            series,
            settings: format!("degree {degree}"),
            has_thumbnail: degree == MOST_DEGREE,
            way: Way::Harmonics(degree, steps),
        }));
    }
    all
}

/// A capture, and photographs of it that are held back.
pub(super) struct Scene {
    source: Capture,
    tests: Vec<Photograph>,
    /// Pixels of the object in all photographs, which bits are counted over.
    pixels: u64,
    /// One colour a place: the mesh as it is stored, with its bits in memory and in a file.
    geometry: (LightTexture, [u64; 2]),
    pub(super) hash: blake3::Hash,
}

impl Scene {
    pub(super) fn read(found: &Found, limit_bytes: u64) -> Result<Scene, CliError> {
        let mut source = capture::read(&found.path, None, None, limit_bytes)?;
        let tests = match capture::test_cameras(&found.path) {
            Some(cameras) => capture::read_views(&cameras, Some(TESTS))?,
            None => {
                let (mut tests, mut kept) = (Vec::new(), Vec::new());
                for (number, view) in source.views.drain(..).enumerate() {
                    if number % HELD_BACK == HELD_BACK - 1 { tests.push(view) } else { kept.push(view) }
                }
                source.views = kept;
                tests
            }
        };
        if tests.is_empty() {
            return Err(CliError::FewViews { path: found.path.clone(), needed: HELD_BACK });
        }
        let shown = |view: &Photograph| view.pixels.iter().filter(|pixel| pixel[3] > 127).count() as u64;
        let pixels = source.views.iter().map(shown).sum::<u64>().max(1);
        let none = LightParams::default().with_terms(0).with_access(Access::Texel);
        let fault = |source| CliError::Encode { path: found.path.clone(), source };
        let (texture, _) = Lightfield::encode_measured(&source, &none, &mut Job::default()).map_err(fault)?;
        let mesh = texture.footprint().parts.into_iter().find(|part| part.name == "mesh");
        let bits = mesh.map_or([0; 2], |part| [part.bits_memory, part.bits_disk]);
        let hash = hash(&source, &tests);
        Ok(Scene { source, tests, pixels, geometry: (texture, bits), hash })
    }

    /// The first photograph that is drawn again, and nothing of what lies around the object.
    pub(super) fn wanted(&self) -> Result<Raster, CliError> {
        raster(&self.tests[0].pixels, &self.tests[0])
    }

    pub(super) fn measure(&self, candidate: &Candidate, path: &Path) -> Result<Measured, CliError> {
        let clock = Cost::clock();
        let fault = |source| CliError::Encode { path: path.to_owned(), source };
        let (mesh, [mesh_memory, mesh_disk]) = (self.geometry.0.mesh(), self.geometry.1);
        let renderer = Renderer::new(&self.geometry.0);
        match &candidate.way {
            Way::Ours(params, simplified) => {
                let encode =
                    if *simplified { Lightfield::encode_simplified } else { Lightfield::encode_measured };
                let (texture, _) = encode(&self.source, params, &mut Job::default()).map_err(fault)?;
                let bytes = file_of(&texture);
                let cost = clock();
                let loaded = texfold::open(&bytes).and_then(texfold::AnyTexture::into_light);
                let texture = loaded.map_err(|source| CliError::Load { path: path.to_owned(), source })?;
                let bits = [texture.memory().compressed, 8 * bytes.len() as u64];
                let renderer = Renderer::new(&texture);
                self.judged(candidate, bits, cost, |camera| renderer.render(camera))
            }
            Way::Photographs { quality, step, is_blended } => {
                let (mut views, mut bits, mut cost) = (Vec::new(), 0, Cost::NONE);
                for view in self.source.views.iter().step_by(*step) {
                    let coded = jpeg::code(&raster(&view.pixels, view)?, *quality, path)?;
                    (bits, cost) = (bits + coded.bits, cost.and(coded.cost));
                    let decoded = coded.decoded.to_bytes();
                    let pixels = decoded.chunks_exact(3).zip(&view.pixels);
                    let pixels = pixels.map(|(rgb, own)| [rgb[0], rgb[1], rgb[2], own[3]]).collect();
                    views.push(Photograph { camera: view.camera, pixels });
                }
                let bits = [mesh_memory + bits, mesh_disk + bits];
                self.judged(candidate, bits, cost, |camera| {
                    draw_photographs(&views, &renderer, camera, *is_blended)
                })
            }
            Way::Harmonics(degree, steps) => {
                let fitted = Harmonics::fit(mesh, &self.source.views, &renderer, (*degree, *steps));
                let packed = zstd::bulk::compress(&fitted.bytes, ZSTD_LEVEL);
                let packed = packed
                    .map_err(|source| CliError::Draw { path: path.to_owned(), source: source.into() })?;
                let cost = clock();
                let bits = [mesh_memory + 8 * fitted.bytes.len() as u64, mesh_disk + 8 * packed.len() as u64];
                self.judged(candidate, bits, cost, |camera| draw(camera, &renderer, &fitted))
            }
        }
    }

    /// The row of a way of that many bits in memory and on disk.
    fn judged(
        &self,
        candidate: &Candidate,
        bits: [u64; 2],
        cost: Cost,
        draw: impl Fn(&Camera) -> Vec<[u8; 4]>,
    ) -> Result<Measured, CliError> {
        let Similarity { ssim, ssimulacra2, views } = similarity(&self.tests, TESTS, &draw);
        let decoded = raster(&draw(&self.tests[0].camera), &self.tests[0])?;
        let [bpp_memory, bpp_disk] = bits.map(|bits| bits as f64 / self.pixels as f64);
        let camera = &self.tests[0].camera;
        let row = Row {
            input: String::new(),
            codec: candidate.codec.to_owned(),
            settings: candidate.settings.clone(),
            bpp_memory,
            bpp_disk,
            psnr: views.psnr,
            ssim,
            ssimulacra2,
            butteraugli: None,
            encode_seconds: cost.seconds,
            texels: self.pixels as f64,
            decode_cpu_texels_per_second: None,
            decode_gpu_texels_per_second: None,
            random_access: 1,
            bpp_resident: bpp_memory,
            series: candidate.series.to_owned(),
            encode_cpu_seconds: cost.known_cpu_seconds(),
            size: (camera.width, camera.height),
            effort: String::new(),
            material: MaterialFigures::default(),
            inputs: 1,
        };
        Ok(Measured { row, decoded: Some(decoded), file: None })
    }
}

/// What a camera sees of a mesh with harmonics.
fn draw(camera: &Camera, renderer: &Renderer<'_>, harmonics: &Harmonics) -> Vec<[u8; 4]> {
    let mut pixels = vec![[0; 4]; (camera.width * camera.height) as usize];
    parallel::for_each_row(&mut pixels, camera.width as usize, |row, line| {
        for (column, pixel) in line.iter_mut().enumerate() {
            let ray = camera.ray(glam::Vec2::new(column as f32, row as f32) + 0.5);
            let Some((_, address)) = renderer.meet(camera.eye(), ray) else { continue };
            let [red, green, blue] =
                harmonics.colour(&address).clamp(Vec3::ZERO, Vec3::ONE).to_array().map(to_u8);
            *pixel = [red, green, blue, u8::MAX];
        }
    });
    pixels
}

/// Pixels where a photograph shows the object, black around it.
fn raster(pixels: &[[u8; 4]], view: &Photograph) -> Result<Raster, CliError> {
    let (width, height) = (view.camera.width, view.camera.height);
    let made = Raster::from_u8(width, height, 3, ColorSpace::Srgb, &masked(pixels, view));
    made.map_err(|source| CliError::Draw { path: "a view".into(), source: source.into() })
}

/// A hash of all that ways are made of and judged by.
fn hash(source: &Capture, tests: &[Photograph]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{:?} {:?}", source.mesh.triangles, source.mesh.positions).as_bytes());
    for view in source.views.iter().chain(tests) {
        hasher.update(format!("{:?}", view.camera).as_bytes());
        hasher.update(view.pixels.as_flattened());
    }
    hasher.finalize()
}

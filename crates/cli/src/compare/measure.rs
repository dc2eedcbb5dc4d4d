//! Measuring one setting on one input.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use texfold::{
    AnyImage, EncodeSettings, Family, Guidance,
    encoding::{Encoding, ImageSearch, search_images},
};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::{SquaredError, color_error, ssim};
use texfold_core::{CodecId, Domain, EncodeError, Encoded, Image2d, Job, Metric, Rect, Texel};
use texfold_gpu::{Gpu, Lookup, Policy, Probe, View};

use super::candidate::{Candidate, Way};
use super::rival::{Astcenc, Coded};
use super::storage::{File, Storage};
use super::table::Row;
use crate::config::EffortName;
use crate::error::CliError;
use crate::perceptual::{butteraugli, mean, ssimulacra2};
use crate::report::Figures;

/// Whole decodes on the CPU that the median is taken of.
const CPU_DECODES: usize = 5;
/// Seconds of drawing on the GPU that the mean is taken over; rendering in software needs that long for one.
const GPU_SECONDS: f64 = 0.1;
/// Most drawings on the GPU.
const GPU_DRAWINGS: f64 = 200.0;

/// The preset of `astcenc` between speed and quality.
const ASTC_PRESET: &str = "-medium";

/// What measuring needs.
#[derive(Debug)]
pub(crate) struct Bench {
    effort: EffortName,
    gpu: Option<Gpu>,
    astcenc: Option<Astcenc>,
    storage: Option<Vec<Storage>>,
    /// One thread, for the speed of decoding.
    single: Option<rayon::ThreadPool>,
}

/// A setting measured on an input.
#[derive(Debug)]
pub(crate) struct Measured {
    pub(crate) row: Row,
    /// The first image, decoded.
    pub(crate) decoded: Raster,
    /// The `.txf` file; none of the rival.
    pub(crate) file: Option<Vec<u8>>,
}

/// The images of an input, and the search that the last candidate shared with those of its kind.
#[derive(Debug)]
pub(crate) struct Searches<'s> {
    images: &'s ImageSet,
    held: Option<Held<'s>>,
    /// Files of a format for storage: its name, and for each image those of settings that were tried.
    stored: (&'static str, Vec<BTreeMap<u32, File>>),
}

#[derive(Debug)]
struct Held<'s> {
    of: (CodecId, Family, Option<Metric>),
    search: ImageSearch<'s>,
    seconds: f64,
}

impl<'s> Searches<'s> {
    pub(crate) fn new(images: &'s ImageSet) -> Searches<'s> {
        Searches { images, held: None, stored: ("", Vec::new()) }
    }

    /// Encodes for a goal; and the seconds that a search took which was there already.
    fn encode(
        &mut self,
        encoding: &'static Encoding,
        settings: &EncodeSettings,
    ) -> Result<(AnyImage, f64), EncodeError> {
        let of = (encoding.id, settings.family, settings.metric);
        let mut job = Job::default();
        let (held, seconds) = match self.held.take_if(|held| held.of == of) {
            Some(held) => {
                let seconds = held.seconds;
                (self.held.insert(held), seconds)
            }
            None => {
                // One search at a time is held: it is large.
                self.held = None;
                let start = Instant::now();
                let search = search_images(encoding, self.images, Guidance::default(), settings, &mut job)?;
                let seconds = start.elapsed().as_secs_f64();
                (self.held.insert(Held { of, search, seconds }), 0.0)
            }
        };
        held.search.encode(settings.goal, &mut job).map(|image| (image, seconds))
    }
}

impl Bench {
    /// Looks for a GPU, for the rival, and for formats for storage where they are wanted.
    pub(crate) fn open(effort: EffortName, with_storage: bool) -> Bench {
        Bench {
            effort,
            gpu: Gpu::new(Policy::from_env()).ok(),
            astcenc: Astcenc::find(),
            storage: with_storage.then(Storage::find),
            single: rayon::ThreadPoolBuilder::new().num_threads(1).build().ok(),
        }
    }

    /// The rival, where it is installed.
    pub(crate) fn rival(&self) -> Option<&Astcenc> {
        self.astcenc.as_ref()
    }

    /// Formats for storage whose programs are installed; none where they are not wanted.
    pub(crate) fn storage(&self) -> &[Storage] {
        self.storage.as_deref().unwrap_or_default()
    }

    /// Whether formats for storage are wanted.
    pub(crate) fn wants_storage(&self) -> bool {
        self.storage.is_some()
    }

    /// How long each codec searches.
    pub(crate) fn effort(&self) -> EffortName {
        self.effort
    }

    /// Name of the adapter, where there is one.
    pub(crate) fn adapter(&self) -> Option<String> {
        self.gpu.as_ref().map(|gpu| gpu.info().name)
    }

    /// Encodes, loads what ships, and measures it.
    pub(crate) fn measure(
        &self,
        searches: &mut Searches<'_>,
        candidate: &Candidate,
        path: &Path,
    ) -> Result<Measured, CliError> {
        let images = searches.images;
        let fault = |source| CliError::Encode { path: path.to_owned(), source };
        let start = Instant::now();
        let (image, search_seconds) = match &candidate.way {
            Way::Fixed(encoding, settings) => {
                let made = encoding.encode(images, Guidance::default(), settings, &mut Job::default());
                (made.map_err(fault)?, 0.0)
            }
            Way::Goal(encoding, settings) => searches.encode(encoding, settings).map_err(fault)?,
            Way::Rival(astcenc, side) => {
                let coded = images.images().iter().map(|image| astcenc.code(image, *side, ASTC_PRESET, path));
                return Ok(external(images, candidate, coded.collect::<Result<_, _>>()?));
            }
            Way::Storage(format, goal) => {
                if searches.stored.0 != format.name() {
                    searches.stored =
                        (format.name(), images.images().iter().map(|_| BTreeMap::new()).collect());
                }
                let pairs = images.images().iter().zip(&mut searches.stored.1);
                let coded = pairs.map(|(image, known)| format.within(image, *goal, known, path));
                let coded = coded.collect::<Result<Option<Vec<Coded>>, _>>()?;
                let bits = || CliError::NoSetting { path: path.to_owned(), bpp: *goal };
                return Ok(external(images, candidate, coded.ok_or_else(bits)?));
            }
        };
        let bytes = image.to_bytes();
        let encode_seconds = search_seconds + start.elapsed().as_secs_f64();
        let (figures, shipped) =
            Figures::of(images, &bytes).map_err(|source| CliError::Load { path: path.to_owned(), source })?;
        let encoded = shipped.as_encoded();
        let decoded = crate::decompress::decode(path, encoded, 0, 0)?;
        let mut differences = vec![(butteraugli(&images.images()[0], &decoded), 1.0)];
        for (number, image) in images.images().iter().enumerate().skip(1) {
            let decoded = crate::decompress::decode(path, encoded, number as u32, 0)?;
            differences.push((butteraugli(image, &decoded), 1.0));
        }
        let row = Row {
            input: String::new(),
            codec: candidate.codec,
            settings: candidate.settings.clone(),
            bpp_memory: figures.sizes.bpp_memory,
            bpp_resident: figures.sizes.bpp_resident,
            bpp_disk: figures.sizes.bpp_disk,
            psnr: figures.psnr,
            ssim: figures.ssim,
            ssimulacra2: figures.ssimulacra2,
            butteraugli: mean(differences.into_iter()),
            encode_seconds,
            texels: images.texel_count() as f64,
            decode_cpu_texels_per_second: Some(self.cpu_speed(encoded)),
            decode_gpu_texels_per_second: self.gpu_speed(encoded),
            random_access: 1,
        };
        Ok(Measured { row, decoded, file: Some(bytes) })
    }

    /// Texels a second of whole decodes on one thread: the median of several.
    fn cpu_speed(&self, encoded: &dyn Encoded<Domain = Image2d>) -> f64 {
        let layout = encoded.layout();
        let wholes: Vec<Rect> =
            (0..layout.images.len()).filter_map(|image| layout.whole(image as u32, 0)).collect();
        let mut texels =
            vec![Texel::ZERO; wholes.iter().map(|&whole| Image2d::len(whole)).max().unwrap_or(0)];
        let mut once = || {
            let start = Instant::now();
            for &whole in &wholes {
                // Whole images of the layout and room for them: this cannot fail.
                let _ = encoded.decode(whole, &mut texels[..Image2d::len(whole)]);
                std::hint::black_box(&texels);
            }
            start.elapsed().as_secs_f64().max(1e-9)
        };
        let mut all = || (0..CPU_DECODES).map(|_| once()).collect::<Vec<f64>>();
        let mut seconds = match &self.single {
            Some(single) => single.install(all),
            None => all(),
        };
        seconds.sort_by(f64::total_cmp);
        wholes.iter().map(|&whole| Image2d::len(whole)).sum::<usize>() as f64 / seconds[CPU_DECODES / 2]
    }

    /// Texels a second of drawing the first image at its own size; `None` without an adapter that can hold it.
    fn gpu_speed(&self, encoded: &dyn Encoded<Domain = Image2d>) -> Option<f64> {
        let gpu = self.gpu.as_ref()?;
        let texture = gpu.upload(&encoded.gpu()).ok()?;
        let size = *encoded.layout().images.first()?;
        let view = View::whole(0, (size.width, size.height), Lookup::Fetch { level: 0 });
        let first = gpu.time(&texture, &view, Probe::Lookup, 1).ok()?;
        let drawings = (GPU_SECONDS / first.max(1e-9)).clamp(1.0, GPU_DRAWINGS) as u32;
        let seconds = gpu.time(&texture, &view, Probe::Lookup, drawings).ok()?;
        (seconds > 0.0).then(|| size.texels() as f64 / seconds)
    }
}

/// What external programs have made of each image: our figures judge.
fn external(images: &ImageSet, candidate: &Candidate, coded: Vec<Coded>) -> Measured {
    let (mut error, mut similarity) = (SquaredError::default(), 0.0);
    let (mut perceived, mut differences) = (Vec::new(), Vec::new());
    for (image, coded) in images.images().iter().zip(&coded) {
        error = error + color_error(image, &coded.decoded);
        similarity += ssim(image, &coded.decoded);
        perceived.push((ssimulacra2(image, &coded.decoded), 1.0));
        differences.push((butteraugli(image, &coded.decoded), 1.0));
    }
    let texels = images.texel_count() as f64;
    let bpp = coded.iter().map(|coded| coded.bits).sum::<u64>() as f64 / texels;
    // A file that is read whole is drawn as plain texels.
    let is_stored = matches!(candidate.way, Way::Storage(..));
    let row = Row {
        input: String::new(),
        codec: candidate.codec,
        settings: candidate.settings.clone(),
        bpp_memory: bpp,
        bpp_resident: if is_stored { 32.0 } else { bpp },
        bpp_disk: bpp,
        psnr: error.psnr(),
        ssim: similarity / images.images().len() as f64,
        ssimulacra2: mean(perceived.into_iter()),
        butteraugli: mean(differences.into_iter()),
        encode_seconds: coded.iter().map(|coded| coded.seconds).sum(),
        texels,
        decode_cpu_texels_per_second: None,
        decode_gpu_texels_per_second: None,
        random_access: u8::from(!is_stored),
    };
    let first = coded.into_iter().next().map(|coded| coded.decoded);
    Measured { row, decoded: first.unwrap_or_else(|| images.images()[0].clone()), file: None }
}

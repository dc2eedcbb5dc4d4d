//! Measuring one setting on one input.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use texfold::{
    AnyImage, EncodeSettings, Family, Guidance, encode_images,
    encoding::{Encoding, ImageSearch, search_images},
};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::{SquaredError, color_error, ssim};
use texfold_core::{CodecId, Domain, Effort, EncodeError, Encoded, Image2d, Job, Metric, Rect, Texel};
use texfold_gpu::{Gpu, Lookup, Policy, Probe, View};

use super::candidate::{Candidate, Way};
use super::jpeg;
use super::rival::{Astcenc, Coded};
use super::storage::{self, File, Storage};
use super::suite::Suite;
use super::table::Row;
use crate::error::CliError;
use crate::material_figures::MaterialFigures;
use crate::perceptual::{butteraugli, mean, ssimulacra2};
use crate::report::Figures;

/// Whole decodes on the CPU that the median is taken of.
const CPU_DECODES: usize = 5;
/// Seconds of drawing on the GPU that the mean is taken over; rendering in software needs that long for one.
const GPU_SECONDS: f64 = 0.1;
/// Most drawings on the GPU.
const GPU_DRAWINGS: f64 = 200.0;

/// What measuring needs.
#[derive(Debug)]
pub(crate) struct Bench {
    gpu: Option<Gpu>,
    astcenc: Option<Astcenc>,
    /// Whether ASTC is compared.
    wants_rival: bool,
    storage: Option<Vec<Storage>>,
    /// One thread, for the speed of decoding.
    single: Option<rayon::ThreadPool>,
}

/// A setting measured on an input.
#[derive(Debug)]
pub(crate) struct Measured {
    pub(crate) row: Row,
    /// The first image, decoded; not of rows that were kept without it.
    pub(crate) decoded: Option<Raster>,
    /// The `.txf` file; none of the rival.
    pub(crate) file: Option<Vec<u8>>,
}

/// The images of an input, and the search that the last candidate shared with those of its kind.
#[derive(Debug)]
pub(crate) struct Searches<'s> {
    images: &'s ImageSet,
    held: Option<Held<'s>>,
    /// Files of a format for storage: its name and speed, and for each image those of settings that were tried.
    stored: ((&'static str, String), Vec<BTreeMap<u32, File>>),
}

#[derive(Debug)]
struct Held<'s> {
    of: (CodecId, Family, Option<Metric>, Effort),
    search: ImageSearch<'s>,
    cost: Cost,
}

/// Time that something took.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cost {
    pub(super) seconds: f64,
    cpu_seconds: f64,
}

impl Cost {
    pub(super) const NONE: Cost = Cost { seconds: 0.0, cpu_seconds: 0.0 };

    /// Of work on one thread of this process, which is shorter than what CPU time is counted in.
    pub(super) fn of_one_thread(seconds: f64) -> Cost {
        Cost { seconds, cpu_seconds: seconds }
    }

    /// Starts a clock; the call of what it returns gives the cost since.
    pub(super) fn clock() -> impl Fn() -> Cost {
        let (start, cpu) = (Instant::now(), cpu_seconds());
        move || Cost { seconds: start.elapsed().as_secs_f64(), cpu_seconds: cpu_seconds() - cpu }
    }

    pub(super) fn and(self, other: Cost) -> Cost {
        let (seconds, cpu_seconds) = (self.seconds + other.seconds, self.cpu_seconds + other.cpu_seconds);
        Cost { seconds, cpu_seconds }
    }

    /// CPU seconds where the system tells them.
    pub(super) fn known_cpu_seconds(self) -> Option<f64> {
        (cpu_seconds() > 0.0).then_some(self.cpu_seconds)
    }
}

/// CPU seconds that this process has used, all threads together, and programs that it has started and waited for, to a hundredth of a
/// second; 0 where the system has no `/proc`.
#[must_use]
pub fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields 14 to 17, counted after the name, which may hold anything but ends with the last bracket.
    let after = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 =
        after.split_whitespace().skip(11).take(4).filter_map(|field| field.parse::<f64>().ok()).sum();
    ticks / 100.0
}

impl<'s> Searches<'s> {
    pub(crate) fn new(images: &'s ImageSet) -> Searches<'s> {
        Searches { images, held: None, stored: Default::default() }
    }

    /// Encodes for a goal; and what a search took which was there already.
    fn encode(
        &mut self,
        encoding: &'static Encoding,
        settings: &EncodeSettings,
    ) -> Result<(AnyImage, Cost), EncodeError> {
        let of = (encoding.id, settings.family, settings.metric, settings.effort);
        let mut job = Job::default();
        let (held, cost) = match self.held.take_if(|held| held.of == of) {
            Some(held) => {
                let cost = held.cost;
                (self.held.insert(held), cost)
            }
            None => {
                // One search at a time is held: it is large.
                self.held = None;
                let clock = Cost::clock();
                let search = search_images(encoding, self.images, Guidance::default(), settings, &mut job)?;
                let cost = clock();
                (self.held.insert(Held { of, search, cost }), Cost::NONE)
            }
        };
        held.search.encode(settings.goal, &mut job).map(|image| (image, cost))
    }
}

impl Bench {
    /// Looks for a GPU, for the rival, and for formats for storage where they are wanted.
    pub(crate) fn open(suite: &Suite, with_storage: bool) -> Bench {
        Bench {
            gpu: Gpu::new(Policy::from_env()).ok(),
            astcenc: Astcenc::find().filter(|_| !suite.astc.is_empty()),
            wants_rival: !suite.astc.is_empty(),
            storage: with_storage.then(Storage::find),
            single: rayon::ThreadPoolBuilder::new().num_threads(1).build().ok(),
        }
    }

    /// The rival, where it is installed.
    pub(crate) fn rival(&self) -> Option<&Astcenc> {
        self.astcenc.as_ref()
    }

    /// Whether the rival is compared where it is installed.
    pub(crate) fn wants_rival(&self) -> bool {
        self.wants_rival
    }

    /// Formats for storage whose programs are installed; none where they are not wanted.
    pub(crate) fn storage(&self) -> &[Storage] {
        self.storage.as_deref().unwrap_or_default()
    }

    /// Whether formats for storage are wanted.
    pub(crate) fn wants_storage(&self) -> bool {
        self.storage.is_some()
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
        let clock = Cost::clock();
        let (image, search) = match &candidate.way {
            Way::Fixed(encoding, settings) => {
                let made = encoding.encode(images, Guidance::default(), settings, &mut Job::default());
                (made.map_err(fault)?, Cost::NONE)
            }
            Way::Goal(encoding, settings) => searches.encode(encoding, settings).map_err(fault)?,
            Way::Auto(settings) => {
                let made = encode_images(images, Guidance::default(), settings, &mut Job::default());
                (made.map_err(fault)?, Cost::NONE)
            }
            Way::Rival(astcenc, side, preset) => {
                let preset = format!("-{}", preset.name());
                let coded = images.images().iter().map(|image| astcenc.code(image, *side, &preset, path));
                return Ok(external(images, candidate.words(), coded.collect::<Result<_, _>>()?));
            }
            Way::Jpeg(quality) => {
                let coded = images.images().iter().map(|image| jpeg::code(image, *quality, path));
                return Ok(external(images, candidate.words(), coded.collect::<Result<_, _>>()?));
            }
            Way::Storage(format, goal) => {
                let of = (format.name(), format.effort());
                if searches.stored.0 != of {
                    searches.stored = (of, images.images().iter().map(|_| BTreeMap::new()).collect());
                }
                let pairs = images.images().iter().zip(&mut searches.stored.1);
                let coded = pairs.map(|(image, known)| format.within(image, *goal, known, path));
                let coded = coded.collect::<Result<Option<Vec<Coded>>, _>>()?;
                let bits = || CliError::NoSetting { path: path.to_owned(), bpp: *goal };
                return Ok(external(images, candidate.words(), coded.ok_or_else(bits)?));
            }
        };
        let bytes = image.to_bytes();
        let cost = clock().and(search);
        let (figures, shipped) =
            Figures::of(images, &bytes).map_err(|source| CliError::Load { path: path.to_owned(), source })?;
        let encoded = shipped.as_encoded();
        let numbers = 0..images.images().len() as u32;
        let decoded = numbers.map(|number| crate::decompress::decode(path, encoded, number, 0));
        let decoded = decoded.collect::<Result<Vec<Raster>, _>>()?;
        let pairs = images.images().iter().zip(&decoded);
        let differences = pairs.map(|(image, decoded)| (butteraugli(image, decoded), 1.0));
        let row = Row {
            input: String::new(),
            // Of a choice among codecs, the one that was chosen.
            codec: shipped.codec().name.to_owned(),
            settings: candidate.settings.clone(),
            bpp_memory: figures.sizes.bpp_memory,
            bpp_resident: figures.sizes.bpp_resident,
            bpp_disk: figures.sizes.bpp_disk,
            psnr: figures.psnr,
            ssim: figures.ssim,
            ssimulacra2: figures.ssimulacra2,
            butteraugli: mean(differences),
            encode_seconds: cost.seconds,
            texels: images.texel_count() as f64,
            decode_cpu_texels_per_second: Some(self.cpu_speed(encoded)),
            decode_gpu_texels_per_second: self.gpu_speed(encoded),
            random_access: 1,
            series: candidate.series.clone(),
            encode_cpu_seconds: cost.known_cpu_seconds(),
            size: size_of_first(images),
            effort: candidate.effort.clone(),
            material: MaterialFigures::of(images, &decoded.iter().collect::<Vec<_>>()),
            inputs: 1,
        };
        Ok(Measured { row, decoded: decoded.into_iter().next(), file: Some(bytes) })
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

fn size_of_first(images: &ImageSet) -> (u32, u32) {
    let size = images.images()[0].size();
    (size.width, size.height)
}

/// What others have made of each image: our figures judge.
pub(super) fn external(
    images: &ImageSet,
    [codec, series, settings, effort]: [&str; 4],
    coded: Vec<Coded>,
) -> Measured {
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
    let cost = coded.iter().fold(Cost::NONE, |sum, coded| sum.and(coded.cost));
    // A file that is read whole is drawn as plain texels.
    let is_stored = storage::names().any(|name| name == codec);
    let row = Row {
        input: String::new(),
        codec: codec.to_owned(),
        settings: settings.to_owned(),
        bpp_memory: bpp,
        bpp_resident: if is_stored { 32.0 } else { bpp },
        bpp_disk: bpp,
        psnr: error.psnr(),
        ssim: similarity / images.images().len() as f64,
        ssimulacra2: mean(perceived.into_iter()),
        butteraugli: mean(differences.into_iter()),
        encode_seconds: cost.seconds,
        texels,
        decode_cpu_texels_per_second: None,
        decode_gpu_texels_per_second: None,
        random_access: u8::from(!is_stored),
        series: series.to_owned(),
        encode_cpu_seconds: cost.known_cpu_seconds(),
        size: size_of_first(images),
        effort: effort.to_owned(),
        material: MaterialFigures::of(images, &coded.iter().map(|coded| &coded.decoded).collect::<Vec<_>>()),
        inputs: 1,
    };
    Measured { row, decoded: coded.into_iter().next().map(|coded| coded.decoded), file: None }
}

//! Regimes of images, each for every codec that encodes images and for the choice among them, by block and by texel.
//!
//! The bounds are those of invariant 6 and 8 of ARCHITECTURE.md, held against plain blocks made for the same goal.

mod regimes;
mod sweeps;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Instant;

use rayon::ThreadPool;
use texfold::core::metric::{decode_image, quality};
use texfold::{
    Access, AnyImage, Cancel, Choice, Effort, EncodeError, EncodeSettings, Goal, Guidance, Job, Texel,
    bc::Bc,
    core::{GpuForm, PlaneFormat, TextureCodec},
    encode_images,
    encoding::ENCODINGS,
};
use texfold::{
    AnyTexture,
    core::image::{ColorSpace, ImageSet, Raster},
    open,
};
use texfold_gpu::{Filter, Gpu};
use texfold_testkit::multiply;

use super::guard::guarded;
use super::page::png;
use super::record::{self, Check, Row};
use super::{Extent, Outcome, Tools};
use regimes::{REGIMES, Regime};
pub(super) use sweeps::{curves, failures};

/// What images are encoded for.
const GOAL_DB: f64 = 30.0;
/// By how much a result may be below plain blocks, in dB: decoded figures are rounded.
const SLACK_DB: f64 = 0.1;
/// Room for what a file says beside its content: header, table of sections, parameters, notes.
const HEADER_BYTES: usize = 1024;
/// Megatexels that smaller images count as: what does not grow with them takes time, too.
const LEAST_MEGATEXELS: f64 = 1.0 / 16.0;
/// CPU time that encoding any image may take at effort fast, in [`unit`]s a megatexel: two to three times that of the slowest regime.
const MOST_TIME: [(&str, f64); 6] = [
    ("bc", 75.0),
    ("vq", 1500.0),
    ("epitome", 2000.0),
    ("progressive", 600.0),
    ("dct", 300.0),
    ("auto", 1000.0),
];
/// What is added to values, and by how much PSNR may change for it.
const NUDGE: f32 = 1e-7;
const NUDGE_DB: f64 = 0.01;
/// PSNR above which results are alike: errors of single 8-bit steps in a few texels.
const EXACT_DB: f64 = 80.0;
/// What processors of BC1 to BC5 may round differently (Direct3D 11.3 specification, 19.5), and the largest gain of an epitome.
const ROUNDED: f32 = 2.0 / 255.0;
const LARGEST_GAIN: f32 = 2.0;
/// What places that are computed in single precision, and blends, leave.
const COMPUTED: f32 = 4e-4;

/// A codec, or the choice among all, with a way to reach texels.
struct Way {
    name: String,
    choice: Choice,
    access: Access,
    /// The longest that encoding may take for any image.
    most_time: f64,
}

/// All codecs by each of their ways to reach texels, and last the choice among them, for bounds alone by block, as it is by default.
fn ways(extent: Extent) -> Vec<Way> {
    let named = ENCODINGS.iter().filter_map(|encoding| {
        let name = encoding.id.name;
        Some((name, Choice::named(name)?, encoding.accesses))
    });
    let of_auto: &[Access] =
        if extent == Extent::Bounds { &[Access::Block] } else { &[Access::Block, Access::Texel] };
    let all = named.chain([("auto", Choice::auto(), of_auto)]);
    let way = |name: &str, choice: &Choice, access: Access| Way {
        name: format!("{name} by {}", access.name()),
        choice: choice.clone(),
        access,
        most_time: MOST_TIME.iter().find(|(codec, _)| *codec == name).map_or(0.0, |&(_, most)| most),
    };
    all.flat_map(|(name, choice, accesses)| {
        accesses.iter().map(|&access| way(name, &choice, access)).collect::<Vec<Way>>()
    })
    .collect()
}

/// Every regime for every way: of bounds alone two regimes at a time.
///
/// # Errors
/// Where an image of a regime cannot be made.
pub(super) fn rows(tools: &Tools, extent: Extent, say: &mut dyn FnMut(Row)) -> Outcome<()> {
    if extent != Extent::Bounds {
        return REGIMES.iter().try_for_each(|regime| rows_of(regime, tools, extent, say));
    }
    let next = AtomicUsize::new(0);
    let some = || -> Result<Vec<(usize, Row)>, String> {
        let tools = Tools::open(extent).map_err(|error| error.to_string())?;
        let mut rows = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(regime) = REGIMES.get(number) else { return Ok(rows) };
            rows_of(regime, &tools, extent, &mut |row| rows.push((number, row)))
                .map_err(|error| error.to_string())?;
        }
    };
    let (first, second) = thread::scope(|scope| {
        let other = scope.spawn(some);
        (some(), other.join())
    });
    let mut rows = first?;
    rows.extend(second.map_err(|_| "a thread of stability panicked")??);
    rows.sort_by_key(|(number, _)| *number);
    rows.into_iter().for_each(|(_, row)| say(row));
    Ok(())
}

fn rows_of(regime: &Regime, tools: &Tools, extent: Extent, say: &mut dyn FnMut(Row)) -> Outcome<()> {
    let images = (regime.images)()?;
    let plain = plain(&images, tools);
    for way in ways(extent) {
        let start = Instant::now();
        let (made, time) = tools.single.install(|| {
            let before = thread_seconds();
            let made = guarded(|cancel| encode(&images, &way, &tools.single, cancel));
            (made, thread_seconds() - before)
        });
        let bytes = made.as_ref().ok().and_then(|made| made.as_ref().ok()).map(AnyImage::to_bytes);
        let mut outcome = match made {
            Err(fault) => record::Outcome::Broken(fault),
            Ok(Err(EncodeError::Cancelled)) => record::Outcome::Broken("does not end in time".to_owned()),
            Ok(Err(error)) => record::Outcome::Refused(record::words(&error)),
            Ok(Ok(made)) => held(&images, &made, &way, plain.as_ref(), tools),
        };
        // The unit is 0 where CPU time is not known.
        if let record::Outcome::Made { checks, .. } = &mut outcome
            && tools.unit > 0.0
        {
            let megatexels = whole_cells(&images).max(LEAST_MEGATEXELS);
            checks.push(Check::most(
                "CPU time of encoding, units a megatexel",
                time / tools.unit / megatexels,
                way.most_time,
            ));
        }
        let pictures = pictures(&images, bytes.as_deref())?;
        let seconds = start.elapsed().as_secs_f64();
        say(Row { regime: regime.name, codec: way.name, outcome, seconds, pictures });
    }
    Ok(())
}

/// Megatexels of images whose sides are whole cells of 16 texels: a row of texels takes as long as the blocks that it is in.
fn whole_cells(images: &ImageSet) -> f64 {
    let of = |side: u32| f64::from(side.next_multiple_of(16));
    images.images().iter().map(|image| of(image.size().width) * of(image.size().height) / 1e6).sum()
}

/// CPU seconds of this thread; 0 where the system has no `/proc`.
fn thread_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    stat.split_whitespace().next().and_then(|nanoseconds| nanoseconds.parse::<f64>().ok()).unwrap_or(0.0)
        / 1e9
}

/// CPU seconds of 2^24 dependent multiplications, the shortest of three: what times are compared with on machines of any speed.
pub(super) fn unit() -> f64 {
    let once = || {
        let start = thread_seconds();
        multiply(1 << 24);
        thread_seconds() - start
    };
    (0..3).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// What each regime is about.
pub(super) fn about() -> Vec<(&'static str, &'static str)> {
    REGIMES.iter().map(|Regime { name, about, .. }| (*name, *about)).collect()
}

fn settings(choice: &Choice, access: Access, goal: Goal) -> EncodeSettings {
    EncodeSettings {
        codec: choice.clone(),
        goal,
        effort: Effort::Fast,
        access: Some(access),
        ..EncodeSettings::default()
    }
}

fn encode(images: &ImageSet, way: &Way, pool: &ThreadPool, cancel: &Cancel) -> Result<AnyImage, EncodeError> {
    let mut job = Job::default().with_pool(pool).with_cancel(cancel);
    let settings = settings(&way.choice, way.access, Goal::Psnr(GOAL_DB));
    encode_images(images, Guidance::default(), &settings, &mut job)
}

/// Plain blocks for the same goal.
fn plain(images: &ImageSet, tools: &Tools) -> Option<AnyImage> {
    let way = Way {
        name: Bc::ID.name.to_owned(),
        choice: Choice::of::<Bc>(),
        access: Access::Texel,
        most_time: 0.0,
    };
    guarded(|cancel| encode(images, &way, &tools.single, cancel)).ok()?.ok()
}

/// A texture held to all bounds; what breaks on the way is a fault.
fn held(
    images: &ImageSet,
    made: &AnyImage,
    way: &Way,
    plain: Option<&AnyImage>,
    tools: &Tools,
) -> record::Outcome {
    let checked = guarded(|cancel| {
        let mut checks = vec![decoded(images, made)];
        checks.extend(plain.map(|plain| beside_plain(images, made, plain)).unwrap_or_default());
        checks.extend(again(images, made, way, tools, cancel));
        checks.extend(tools.gpu.as_ref().and_then(|gpu| twin(gpu, made)));
        checks
    });
    match checked {
        Err(fault) => record::Outcome::Broken(fault),
        Ok(checks) => record::Outcome::Made {
            verdict: made.as_encoded().notes().verdict.clone(),
            psnr: quality(images, made.as_encoded()).color.psnr(),
            bpp: made.as_encoded().memory().compressed as f64 / images.texel_count() as f64,
            checks,
        },
    }
}

/// The file opens again and every texel of it is a number.
fn decoded(images: &ImageSet, made: &AnyImage) -> Check {
    let loaded = open(&made.to_bytes()).and_then(AnyTexture::into_image);
    let wrong = loaded.map_or(f64::INFINITY, |loaded| {
        let decoded = |(index, image): (u32, &Raster)| {
            let found = decode_image(loaded.as_encoded(), index, 0);
            let found = found.filter(|found| found.size() == image.size());
            found.map_or(image.size().texels(), |found| {
                found.texels().filter(|texel| !texel.is_finite()).count() as u64
            })
        };
        (0u32..).zip(images.images()).map(decoded).sum::<u64>() as f64
    });
    Check::most("texels of the stored file that are no numbers", wrong, 0.0)
}

/// Quality, memory and length beside plain blocks.
fn beside_plain(images: &ImageSet, made: &AnyImage, plain: &AnyImage) -> Vec<Check> {
    let (found, least) = (quality(images, made.as_encoded()), quality(images, plain.as_encoded()));
    let wanted = |psnr: f64| psnr.min(GOAL_DB) - SLACK_DB;
    let mut checks =
        vec![Check::least("PSNR of colours, dB", found.color.psnr(), wanted(least.color.psnr()))];
    if let (Some(alpha), Some(least)) = (found.alpha, least.alpha) {
        checks.push(Check::least("PSNR of alpha, dB", alpha.psnr(), wanted(least.psnr())));
    }
    let bits = |image: &AnyImage| image.as_encoded().memory().compressed;
    if least.color.psnr() >= GOAL_DB {
        checks.push(Check::most("bits of memory", bits(made) as f64, bits(plain) as f64));
    }
    // Coded blocks are as small as they get, where plain blocks of a pattern shrink in a file.
    let of_plain = plain.to_bytes().len().max(bits(plain).div_ceil(8) as usize);
    let limit = (of_plain + HEADER_BYTES) as f64;
    checks.push(Check::most("bytes of the file", made.to_bytes().len() as f64, limit));
    checks
}

/// Encoded again by two threads, and with values that differ by what rounding leaves.
fn again(images: &ImageSet, made: &AnyImage, way: &Way, tools: &Tools, cancel: &Cancel) -> Vec<Check> {
    let by_two = |pool: &ThreadPool| encode(images, way, pool, cancel);
    let threads = tools.is_independent_of_threads(&made.to_bytes(), by_two, AnyImage::to_bytes);
    let mut checks: Vec<Check> = threads.into_iter().collect();
    let nudged = nudged(images).and_then(|nudged| Ok(encode(&nudged, way, &tools.single, cancel)?));
    let psnr = |image: &AnyImage| quality(images, image.as_encoded()).color.psnr().min(EXACT_DB);
    let change = nudged.map_or(f64::INFINITY, |nudged| (psnr(&nudged) - psnr(made)).abs());
    checks.push(Check::most("change of PSNR by 1e-7 of the values, dB", change, NUDGE_DB));
    checks
}

/// Each value a little larger or smaller.
fn nudged(images: &ImageSet) -> Outcome<ImageSet> {
    let nudged = |image: &Raster| {
        let value = |(index, value): (usize, f32)| {
            let up = (index as u32).wrapping_mul(0x9e37_79b9) >> 31 == 0;
            (value + if up { NUDGE } else { -NUDGE }).clamp(0.0, 1.0)
        };
        let data = image.values().enumerate().map(value).collect();
        Ok(Raster::new(image.size().width, image.size().height, image.info(), data)?)
    };
    Ok(ImageSet::new(images.images().iter().map(nudged).collect::<Outcome<_>>()?)?)
}

/// The same texels by the shader; `None` where the adapter cannot hold the texture.
fn twin(gpu: &Gpu, made: &AnyImage) -> Option<Check> {
    let encoded = made.as_encoded();
    let form = encoded.gpu();
    let texture = gpu.upload(&form).ok()?;
    let layout = encoded.layout();
    // The third channel of normals follows from the others, steeply near the horizon.
    let channels = if layout.pixel.color == ColorSpace::Normal { 2 } else { 4 };
    let mut most = 0f32;
    for (image, size) in (0u32..).zip(&layout.images) {
        let drawn = gpu.decode(&texture, image, 0, (size.width, size.height), Filter::Nearest).ok()?;
        let wanted = decode_image(encoded, image, 0)?;
        let apart = |(a, b): ([f32; 4], Texel)| {
            let differences = a.into_iter().zip(b.to_array()).take(channels).map(|(a, b)| (a - b).abs());
            // Not a number, it would be overlooked by a maximum.
            differences.fold(0f32, |most, apart| if apart <= most { most } else { apart })
        };
        let of_image = drawn.into_iter().zip(wanted.texels()).map(apart);
        most = of_image.fold(most, |most, apart| if apart <= most { most } else { apart });
    }
    Some(Check::most(
        "difference of the shader, of a range of 1",
        f64::from(most),
        f64::from(twin_limit(&form)),
    ))
}

/// What a GPU may differ by on a form.
fn twin_limit(form: &GpuForm<'_>) -> f32 {
    let rounds = |format: PlaneFormat| {
        matches!(format, PlaneFormat::Bc1 | PlaneFormat::Bc3 | PlaneFormat::Bc4 | PlaneFormat::Bc5)
    };
    let rounded = form.planes.iter().any(|plane| rounds(plane.format));
    COMPUTED + if rounded { LARGEST_GAIN * ROUNDED } else { 0.0 }
}

/// The middle of the first image, and of what was made of it.
fn pictures(images: &ImageSet, bytes: Option<&[u8]>) -> Outcome<Vec<Vec<u8>>> {
    let first = &images.images()[0];
    let loaded = bytes.and_then(|bytes| open(bytes).and_then(AnyTexture::into_image).ok());
    let decoded = loaded.and_then(|loaded| decode_image(loaded.as_encoded(), 0, 0));
    [Some(first), decoded.as_ref()].into_iter().flatten().map(png).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_regimes_are_unique() {
        let mut names: Vec<&str> = REGIMES.iter().map(|regime| regime.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), REGIMES.len());
    }

    #[test]
    fn a_result_worse_than_plain_blocks_is_found_out() {
        let images = (REGIMES[1].images)().unwrap();
        let tools = Tools::open(Extent::Bounds).unwrap();
        let bright = (REGIMES[18].images)().unwrap();
        let way = &ways(Extent::Bounds)[0];
        let wrong = guarded(|cancel| encode(&bright, way, &tools.single, cancel)).unwrap().unwrap();
        let plain = plain(&images, &tools).unwrap();
        let checks = beside_plain(&images, &wrong, &plain);
        assert!(checks.iter().any(|check| !check.holds()), "{checks:?}");
    }
}

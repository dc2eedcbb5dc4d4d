//! Encoding.

use std::ffi::{CString, c_char, c_void};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::ThreadPoolBuilder;
use texfold::core::image::MapKind;
use texfold::core::{EncodeError, Stage};
use texfold::{Cancel, Choice, ColorSpace, Encode, Goal, ImageSet, Job, Raster};

use crate::Status;
use crate::status::{Failure, Outcome, guarded, put, text, there, values};

/// An image to encode.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Source {
    /// Values row by row from the top, the channels of a texel side by side: bytes, or 16-bit values in the machine's byte order.
    pub pixels: *const c_void,
    /// Bytes at `pixels`.
    pub size: usize,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from the start of a row to that of the next; 0 for rows without padding.
    pub row_bytes: usize,
    /// 1 gray, 2 gray and alpha, 3 RGB, 4 RGB and alpha.
    pub channels: u32,
    /// Bits of a value, 8 or 16.
    pub bits: u32,
    /// "srgb", "linear" or "normal"; null: "srgb", or that of the map's kind.
    pub color: *const c_char,
    /// "straight", or "band" where the second or fourth channel counts as colours do, as near infrared; null: "straight".
    pub alpha: *const c_char,
    /// Name of a map of a material, such as "color", "normal", "roughness", "orm"; null for images of one kind.
    pub map: *const c_char,
}

/// A callback with the name of an encoder's stage and the share of the work that is done, 0 to 1; called from one thread at a time. False cancels.
pub type Progress = Option<unsafe extern "C" fn(stage: *const c_char, done: f32, user: *mut c_void) -> bool>;

/// Options of texfold_encode; texfold_encode_options() has the usual values.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EncodeOptions {
    /// "dct", "vq", "epitome", "progressive", "bc"; null or "auto": the codec that answers the goal best.
    pub codec: *const c_char,
    /// "psnr" in dB, "bpp" in bits a texel, or "tolerance", the largest RMS error of a block in 8-bit units.
    pub goal: *const c_char,
    /// Value of the goal.
    pub value: f64,
    /// "fast", "normal" or "high"; null: "normal".
    pub effort: *const c_char,
    /// "psnr" or "perceptual"; null: what suits the goal.
    pub metric: *const c_char,
    /// "block" or "texel"; null: whichever needs fewer bits.
    pub access: *const c_char,
    /// True to store mip levels.
    pub mips: bool,
    /// Threads; 0 for as many as there are cores.
    pub threads: u32,
    /// Called while it is encoded; null for nothing.
    pub progress: Progress,
    /// Passed to `progress`.
    pub user: *mut c_void,
    /// Cancels from another thread; null for nothing.
    pub cancel: *const Cancelling,
}

/// A file, to be freed by texfold_bytes_free.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Bytes {
    /// Its bytes.
    pub data: *mut u8,
    /// How many there are.
    pub size: usize,
}

/// Cancels an encoder from another thread.
pub struct Cancelling(Arc<Cancel>);

/// An object that cancels encoders.
#[unsafe(no_mangle)]
pub extern "C" fn texfold_cancel_new() -> *mut Cancelling {
    Box::into_raw(Box::new(Cancelling(Arc::default())))
}

/// Cancels the encoders that have the object among their options, now and later. Null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_cancel(cancel: *const Cancelling) {
    // SAFETY: as the crate says.
    if let Some(Cancelling(cancel)) = unsafe { cancel.as_ref() } {
        cancel.cancel();
    }
}

/// Frees an object that no encoder has any more; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_cancel_free(cancel: *mut Cancelling) {
    if !cancel.is_null() {
        // SAFETY: it comes from `texfold_cancel_new` and was not freed.
        drop(unsafe { Box::from_raw(cancel) });
    }
}

/// The usual options: the best codec at 1 bit a texel, without mip levels.
#[unsafe(no_mangle)]
pub extern "C" fn texfold_encode_options() -> EncodeOptions {
    EncodeOptions {
        codec: ptr::null(),
        goal: c"bpp".as_ptr(),
        value: 1.0,
        effort: ptr::null(),
        metric: ptr::null(),
        access: ptr::null(),
        mips: false,
        threads: 0,
        progress: None,
        user: ptr::null_mut(),
        cancel: ptr::null(),
    }
}

/// Encodes an image, a set of images, or the maps of a material, of which each has a name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_encode(
    sources: *const Source,
    count: usize,
    options: *const EncodeOptions,
    file: *mut Bytes,
) -> Status {
    guarded(|| {
        // SAFETY: as the crate says.
        let (sources, options) = unsafe { (values(sources, count, "sources")?, there(options, "options")?) };
        if file.is_null() {
            return Err(Failure::null("file"));
        }
        // SAFETY: as the crate says.
        let bytes = unsafe { run(&set_of(sources)?, options)? };
        let size = bytes.len();
        let data = Box::into_raw(bytes.into_boxed_slice()).cast();
        // SAFETY: as the crate says, and it is not null.
        unsafe { put(file, Bytes { data, size }, "file") }
    })
}

/// Frees the bytes of a file; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn texfold_bytes_free(file: Bytes) {
    if !file.data.is_null() {
        // SAFETY: it comes from `texfold_encode` and was not freed.
        drop(unsafe { Box::from_raw(ptr::slice_from_raw_parts_mut(file.data, file.size)) });
    }
}

/// Images as they are encoded.
///
/// # Safety
/// As the crate says.
unsafe fn set_of(sources: &[Source]) -> Outcome<ImageSet> {
    let mut images = Vec::new();
    let mut maps = Vec::new();
    for source in sources {
        // SAFETY: as the crate says.
        let (name, color, alpha) =
            unsafe { (text(source.map, "map")?, text(source.color, "color")?, text(source.alpha, "alpha")?) };
        let kind = name.map(|name| MapKind::named(name).unwrap_or(MapKind::Other));
        let usual = kind.map_or(ColorSpace::Srgb, MapKind::color_space);
        let color = color.map(str::parse).transpose()?.unwrap_or(usual);
        // SAFETY: as the crate says.
        let mut image = unsafe { raster(source, color)? };
        match alpha {
            None | Some("straight") => {}
            Some("band") => image = image.with_band(source.channels as u8),
            Some(other) => {
                return Err(Failure::argument(format!("alpha '{other}'; give one of straight, band")));
            }
        }
        match kind {
            Some(kind) => maps.push((kind, name.unwrap_or_default().to_owned(), image)),
            None => images.push(image),
        }
    }
    if !maps.is_empty() && !images.is_empty() {
        return Err(Failure::argument(
            "some images have a map's name and some have none; give all or none one",
        ));
    }
    let set = if maps.is_empty() { ImageSet::new(images) } else { ImageSet::of_maps(maps) };
    Ok(set.map_err(EncodeError::from)?)
}

/// The image at a pointer.
///
/// # Safety
/// As the crate says.
unsafe fn raster(source: &Source, color: ColorSpace) -> Outcome<Raster> {
    let &Source { pixels, size, width, height, row_bytes, channels, bits, .. } = source;
    let value_bytes = match bits {
        8 => 1,
        16 => 2,
        _ => return Err(Failure::argument(format!("{bits} bits a value; give 8 or 16"))),
    };
    let channels = u8::try_from(channels).ok().filter(|channels| (1..=4).contains(channels));
    let channels = channels.ok_or_else(|| Failure::argument("give 1 to 4 channels"))?;
    let packed = (width as usize).checked_mul(usize::from(channels) * value_bytes);
    let stride = if row_bytes == 0 { packed } else { Some(row_bytes) };
    let needed = stride.zip(packed).and_then(|(stride, packed)| {
        stride
            .checked_mul((height as usize).saturating_sub(1))?
            .checked_add(packed)
            .filter(|_| stride >= packed)
    });
    let (Some(stride), Some(packed), Some(needed)) = (stride, packed, needed) else {
        return Err(Failure::argument(
            "rows overlap or are longer than memory; give row_bytes of a row or more, or 0",
        ));
    };
    if size < needed {
        return Err(Failure::argument(format!("{size} bytes of pixels where {needed} are needed")));
    }
    // SAFETY: as the crate says.
    let bytes = unsafe { values(pixels.cast::<u8>(), size, "pixels")? };
    let rows = (0..height as usize).flat_map(|row| &bytes[row * stride..][..packed]).copied();
    let image = if value_bytes == 1 {
        Raster::from_u8(width, height, channels, color, &rows.collect::<Vec<_>>())
    } else {
        let bytes: Vec<u8> = rows.collect();
        let (pairs, _) = bytes.as_chunks::<2>();
        let values: Vec<u16> = pairs.iter().map(|&pair| u16::from_ne_bytes(pair)).collect();
        Raster::from_u16(width, height, channels, color, &values)
    };
    Ok(image.map_err(EncodeError::from)?)
}

/// What the caller passes on to its own callback.
struct User(*mut c_void);

// SAFETY: the caller's callback is called from one thread at a time and gets it as it is.
unsafe impl Send for User {}

impl User {
    /// The pointer. A method, so that closures take the struct and not the pointer alone.
    fn pointer(&self) -> *mut c_void {
        self.0
    }
}

/// The file of a set.
///
/// # Safety
/// As the crate says.
unsafe fn run(set: &ImageSet, options: &EncodeOptions) -> Outcome<Vec<u8>> {
    let name = |pointer, what| {
        // SAFETY: as the crate says.
        unsafe { text(pointer, what) }
    };
    let goal = name(options.goal, "goal")?.ok_or_else(|| Failure::null("goal"))?;
    let choice = match name(options.codec, "codec")? {
        None => Choice::auto(),
        Some(codec) => codec.parse()?,
    };
    let mut encoder =
        Encode::new(set).goal(Goal::named(goal, options.value)?).codec(choice).mips(options.mips);
    if let Some(effort) = name(options.effort, "effort")? {
        encoder = encoder.effort(effort.parse()?);
    }
    if let Some(metric) = name(options.metric, "metric")? {
        encoder = encoder.metric(metric.parse()?);
    }
    if let Some(access) = name(options.access, "access")? {
        encoder = encoder.access(access.parse()?);
    }
    // SAFETY: as the crate says.
    let given = unsafe { options.cancel.as_ref() }.map(|Cancelling(cancel)| Arc::clone(cancel));
    let stopped = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stopped);
    let cancel = Cancel::when(move || {
        seen.load(Ordering::Relaxed) || given.as_ref().is_some_and(|given| given.is_cancelled())
    });
    let user = User(options.user);
    let callback = options.progress;
    let mut report = move |stage: Stage| {
        let Some(progress) = callback.filter(|_| !stopped.load(Ordering::Relaxed)) else { return };
        let name = CString::new(stage.name).unwrap_or_default();
        // SAFETY: the caller's function, with its own pointer.
        if !unsafe { progress(name.as_ptr(), stage.done, user.pointer()) } {
            stopped.store(true, Ordering::Relaxed);
        }
    };
    let pool = match options.threads {
        0 => None,
        threads => {
            let pool = ThreadPoolBuilder::new().num_threads(threads as usize).build();
            Some(pool.map_err(|error| Failure::argument(format!("{threads} threads: {error}")))?)
        }
    };
    let mut job = Job::new(texfold::Limits::default()).with_progress(&mut report).with_cancel(&cancel);
    if let Some(pool) = &pool {
        job = job.with_pool(pool);
    }
    Ok(encoder.run_in(&mut job)?.image.to_bytes())
}

//! `compress --add-to`: further images for a file that is there.

use std::path::Path;
use std::time::Instant;

use texfold::{AnyTexture, Guidance, add_images};
use texfold_core::image::Raster;
use texfold_core::metric::{SquaredError, color_error, decode_image};
use texfold_core::{Job, Limits, Stage};

use super::{CompressArgs, encode};
use crate::config::Config;
use crate::console::{say, warn};
use crate::decompress;
use crate::error::{CliError, UsageError};
use crate::input::find;
use crate::memory;
use crate::output::{make_folder, write_whole};
use crate::progress::Progress;
use crate::settings::Kind;

/// Adds the images of all inputs, in their order, behind those of a file; the result has the file's name in the output folder. Nothing is
/// written where an input cannot be read or the file cannot take it.
pub(super) fn grow(args: &CompressArgs, file: &Path) -> Result<(), CliError> {
    let start = Instant::now();
    args.options.check()?;
    args.options.check_of_pixels()?;
    let config = args.config.as_deref().map(Config::read).transpose()?.unwrap_or_default();
    let run = args.run.clone().or(config.run.clone());
    if run.report.is_some() {
        return Err(UsageError::Excluded { option: "report", other: "--add-to" }.into());
    }
    let limit_bytes = memory::limit(run.memory);
    let (mut files, mut all_frames) = (Vec::new(), true);
    let inputs = find(&args.inputs, |path| args.options.or(&config.options(path)).kind());
    inputs.say_not_read();
    for found in inputs.found {
        let found = found.map_err(|unusable| *unusable.error)?;
        all_frames &= found.takes_all_frames();
        files.extend(found.files);
    }
    let limits = Limits { bytes: limit_bytes.max(memory::ALWAYS_ALLOWED), ..Limits::default() };
    let mut texture = decompress::load(file, &limits)?;
    let layout = texture.as_encoded().layout().clone();
    let first = layout.images.len();
    let options = args.options.or(&config.options(file));
    let mut settings = options.resolve(file)?;
    settings.color = layout.pixel.color;
    let loaded = encode::load(&files, all_frames, &settings, limit_bytes)?;
    loaded.remarks.warnings(files.len()).iter().for_each(|warning| warn(warning));
    if !loaded.georeference.is_empty() {
        warn("the georeference of an added image is not kept");
    }
    let is_frame = |image: &Raster| layout.images.first() == Some(&image.size());
    let other = loaded.images.images().iter().position(|image| !is_frame(image));
    if let Some(index) = other.filter(|_| options.kind() == Some(Kind::Sequence)) {
        return Err(CliError::FrameSize {
            path: files.get(index).or(files.first()).cloned().unwrap_or_default(),
            index: first + index,
        });
    }

    let progress = Progress::new(1);
    let share = progress.share(file.file_stem().unwrap_or_default().to_string_lossy().into_owned());
    let mut report = |stage: Stage| share.report(stage);
    let mut job = Job::new(limits).with_progress(&mut report);
    let guidance = Guidance { painted: loaded.painted.as_ref(), ..Guidance::default() };
    let added = add_images(&mut texture, &loaded.images, guidance, &mut job);
    added.map_err(|source| CliError::Encode { path: file.to_owned(), source })?;
    drop(share);
    progress.finish();

    // Measured from what ships.
    let bytes = texture.to_bytes();
    let load = |source| CliError::Load { path: file.to_owned(), source };
    let texture = texfold::open(&bytes).and_then(AnyTexture::into_image).map_err(load)?;
    let encoded = texture.as_encoded();
    let mut error = SquaredError::default();
    for (number, image) in (first as u32..).zip(loaded.images.images()) {
        if let Some(decoded) = decode_image(encoded, number, 0) {
            error = error + color_error(image, &decoded);
        }
    }
    make_folder(&args.out)?;
    let output = args.out.join(file.file_name().unwrap_or_default());
    write_whole(&output, &bytes)?;
    let (images, texels) = (encoded.layout().images.len(), encoded.layout().texels() as f64);
    say(&format!(
        "{}: {} images added to {first}, at {:.2} dB; {images} images at {:.3} bpp memory, {:.3} bpp disk; {:.1} s",
        output.display(),
        images - first,
        error.psnr(),
        encoded.memory().compressed as f64 / texels,
        8.0 * bytes.len() as f64 / texels,
        start.elapsed().as_secs_f64()
    ));
    Ok(())
}

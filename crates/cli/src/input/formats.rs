//! Names of formats: of those that are read, and of those that are not.

use std::path::Path;

use crate::error::CliError;

/// Formats that are read, as sentences name them.
pub(crate) const FORMATS: &str =
    "PNG, JPEG, TIFF, WebP, GIF, BMP, TGA, QOI, PNM, OpenEXR, Radiance HDR, DDS or KTX2";

/// Extensions of images, lower case: which files of a folder are taken.
const EXTENSIONS: [&str; 19] = [
    "png", "apng", "jpg", "jpeg", "tif", "tiff", "webp", "gif", "bmp", "tga", "qoi", "pbm", "pgm", "ppm",
    "pnm", "exr", "hdr", "dds", "ktx2",
];

/// Formats that are not read, by their extension.
const OTHERS: [(&str, &str); 11] = [
    ("svg", "SVG"),
    ("svgz", "SVG"),
    ("jp2", "JPEG 2000"),
    ("j2k", "JPEG 2000"),
    ("avif", "AVIF"),
    ("heic", "HEIC"),
    ("heif", "HEIC"),
    ("ico", "ICO"),
    ("psd", "PSD"),
    ("ktx", "KTX 1"),
    ("jxl", JPEG_XL),
];

/// The name of JPEG XL, which a feature of the build reads.
const JPEG_XL: &str = "JPEG XL";

/// True for files of a folder that are taken, by extension.
pub(super) fn is_image(path: &Path) -> bool {
    let extension = extension(path);
    EXTENSIONS.contains(&extension.as_str()) || cfg!(feature = "jxl") && extension == "jxl"
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// True for the first bytes of a JPEG XL file.
pub(super) fn is_jpeg_xl(head: &[u8]) -> bool {
    head.starts_with(b"\xff\x0a") || head.starts_with(b"\0\0\0\x0cJXL \r\n\x87\n")
}

/// The format that is not read, by the first bytes of a file.
fn by_content(head: &[u8]) -> Option<&'static str> {
    let starts = |magic: &[u8]| head.starts_with(magic);
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let markup = text.starts_with("<?xml") || text.starts_with("<!");
    match head.get(4..12) {
        Some(b"ftypavif" | b"ftypavis") => return Some("AVIF"),
        Some(b"ftypheic" | b"ftypheix" | b"ftyphevc" | b"ftypmif1" | b"ftypmsf1") => return Some("HEIC"),
        _ => {}
    }
    if text.starts_with("<svg") || markup && text.contains("<svg") {
        Some("SVG")
    } else if starts(b"\0\0\0\x0cjP  ") || starts(b"\xff\x4f\xff\x51") {
        Some("JPEG 2000")
    } else if starts(b"\0\0\x01\0") {
        Some("ICO")
    } else if starts(b"8BPS") {
        Some("PSD")
    } else if starts(b"\xabKTX 11\xbb") {
        Some("KTX 1")
    } else {
        (is_jpeg_xl(head) && !cfg!(feature = "jxl")).then_some(JPEG_XL)
    }
}

/// Refuses a file by the name of its format, where its first bytes tell one that is not read.
pub(super) fn check(path: &Path, head: &[u8]) -> Result<(), CliError> {
    by_content(head).map_or(Ok(()), |name| Err(not_read(path, name)))
}

/// The refusal of a file whose content is of no format that is read.
pub(super) fn unknown(path: &Path) -> CliError {
    let extension = extension(path);
    match OTHERS.iter().find(|(other, _)| *other == extension) {
        Some((_, name)) => not_read(path, name),
        None => CliError::UnknownFormat { path: path.to_owned() },
    }
}

fn not_read(path: &Path, name: &'static str) -> CliError {
    let path = path.to_owned();
    if name == JPEG_XL && !cfg!(feature = "jxl") {
        CliError::NeedsFeature { path, name, feature: "jxl" }
    } else {
        CliError::NotRead { path, name }
    }
}

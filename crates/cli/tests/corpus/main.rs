//! A corpus of small files of every form: what is taken as it is, what with a note or warning, and what is refused.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

mod files;

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output};

use files::*;
use image::{DynamicImage, ImageFormat};
use serde_json::Value;
use texfold_core::ImageAddress;
use texfold_core::image::{Alpha, ColorSpace, Depth, linear_to_srgb, srgb_to_linear};
use texfold_core::metric::decode_image;
use tiff::encoder::colortype;

/// The expected outcome of a file.
#[derive(Debug)]
enum Want {
    Taken(Taken),
    Refused(&'static str),
}

#[derive(Debug, Clone, Copy)]
struct Taken {
    size: (u64, u64),
    channels: u8,
    depth: Depth,
    color: ColorSpace,
    /// Values of a place in 8 bits, and how far they may be off.
    texel: ((u32, u32), [f32; 3], f32),
    note: &'static str,
    warning: &'static str,
}

fn taken(channels: u8, depth: Depth) -> Taken {
    let size = (u64::from(WIDTH), u64::from(HEIGHT));
    let texel = ((5, 2), texel(5, 2).map(f32::from), 0.6);
    Taken { size, channels, depth, color: ColorSpace::Srgb, texel, note: "", warning: "" }
}

fn rgb8() -> Taken {
    taken(3, Depth::Eight)
}

/// An image of one colour.
fn flat(channels: u8, texel: [f32; 3]) -> Taken {
    Taken { texel: ((3, 3), texel, 1.1), ..taken(channels, Depth::Eight) }
}

impl Taken {
    fn off(self, by: f32) -> Taken {
        Taken { texel: (self.texel.0, self.texel.1, by), ..self }
    }

    fn noted(self, note: &'static str) -> Taken {
        Taken { note, ..self }
    }

    fn warned(self, warning: &'static str) -> Taken {
        Taken { warning, ..self }
    }

    fn linear(self) -> Taken {
        Taken { color: ColorSpace::Linear, ..self }.noted("float samples are taken as 16 bits, linear")
    }
}

type Case = (&'static str, Vec<u8>, Want);

fn plain_formats() -> Vec<Case> {
    let (rgb, rgba) = (rgb(), rgba());
    let eight = |name, format| (name, of(&rgb, format), Want::Taken(rgb8()));
    let alpha = |name, format| (name, of(&rgba, format), Want::Taken(taken(4, Depth::Eight)));
    let deep = |name, format| {
        let image = DynamicImage::ImageRgb16(rgb.to_rgb16());
        (name, of(&image, format), Want::Taken(taken(3, Depth::Sixteen)))
    };
    let gray = DynamicImage::ImageLuma8(rgb.to_luma8());
    let luma = f32::from(rgb.to_luma8().get_pixel(5, 2).0[0]);
    let gray_want = Taken { texel: ((5, 2), [luma; 3], 0.6), ..taken(1, Depth::Eight) };
    vec![
        eight("png-rgb.png", ImageFormat::Png),
        alpha("png-rgba.png", ImageFormat::Png),
        deep("png-deep.png", ImageFormat::Png),
        ("png-gray.png", of(&gray, ImageFormat::Png), Want::Taken(gray_want)),
        ("jpeg.jpg", jpeg(None), Want::Taken(rgb8().off(6.0))),
        eight("tiff.tif", ImageFormat::Tiff),
        deep("tiff-deep.tiff", ImageFormat::Tiff),
        eight("bmp.bmp", ImageFormat::Bmp),
        eight("tga.tga", ImageFormat::Tga),
        alpha("tga-rgba.tga", ImageFormat::Tga),
        eight("pnm.ppm", ImageFormat::Pnm),
        eight("webp.webp", ImageFormat::WebP),
        alpha("webp-rgba.webp", ImageFormat::WebP),
        eight("qoi.qoi", ImageFormat::Qoi),
        alpha("qoi-rgba.qoi", ImageFormat::Qoi),
        ("gif.gif", gif(1), Want::Taken(rgb8().off(1.0))),
        eight("wrong-extension.jpeg", ImageFormat::Png),
    ]
}

fn floats() -> Vec<Case> {
    let deep = || taken(3, Depth::Sixteen).linear();
    let above = "tone-map the image to 8 or 16 bits first";
    let alpha = taken(4, Depth::Sixteen).linear();
    let gray: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| i as f32 / 48.0).collect();
    let gray_want = Taken { texel: ((5, 2), [21.0 / 48.0 * 255.0; 3], 0.6), ..taken(1, Depth::Sixteen) };
    let steep: Vec<f32> = gray.iter().map(|value| value * 90.0).collect();
    vec![
        ("exr.exr", float(ImageFormat::OpenExr, 1.0), Want::Taken(deep())),
        ("exr-alpha.exr", exr_with_alpha(), Want::Taken(alpha)),
        ("exr-gray.exr", exr_gray(1.0), Want::Taken(gray_want.linear())),
        ("exr-heights.exr", exr_gray(90.0), Want::Refused(above)),
        ("exr-bright.exr", float(ImageFormat::OpenExr, 4.0), Want::Refused(above)),
        ("hdr.hdr", float(ImageFormat::Hdr, 1.0), Want::Taken(deep().off(2.0))),
        ("hdr-bright.hdr", float(ImageFormat::Hdr, 4.0), Want::Refused(above)),
        ("float.tif", float(ImageFormat::Tiff, 1.0), Want::Taken(deep())),
        ("float-negative.tif", float(ImageFormat::Tiff, -1.0), Want::Refused(above)),
        ("float-gray.tif", tiff_of::<colortype::Gray32Float>(&gray), Want::Taken(gray_want.linear())),
        ("float-heights.tif", tiff_of::<colortype::Gray32Float>(&steep), Want::Refused(above)),
    ]
}

fn tiffs() -> Vec<Case> {
    let words = vec![7u32; (WIDTH * HEIGHT) as usize];
    let doubles = vec![0.5f64; (WIDTH * HEIGHT) as usize];
    let long = vec![7u64; (WIDTH * HEIGHT) as usize];
    let pages = "the first of 3 pages is taken; `--as set`";
    vec![
        ("tiff-jpeg.tif", tiff_in_jpeg(), Want::Taken(rgb8().off(6.0))),
        ("tiff-palette.tif", tiff_with_palette(8), Want::Taken(flat(3, [7.0, 70.0, 200.0]))),
        (
            "tiff-palette-4.tif",
            tiff_with_palette(4),
            Want::Refused("palettes of colours of 4 bits are not read; convert to"),
        ),
        (
            "tiff-32.tif",
            tiff_of::<colortype::Gray32>(&words),
            Want::Refused("samples of 32 bits are not read"),
        ),
        (
            "tiff-64.tif",
            tiff_of::<colortype::Gray64>(&long),
            Want::Refused("samples of 64 bits are not read"),
        ),
        (
            "tiff-f64.tif",
            tiff_of::<colortype::Gray64Float>(&doubles),
            Want::Taken(Taken { depth: Depth::Sixteen, ..flat(1, [127.5; 3]) }.linear()),
        ),
        ("tiff-pages.tif", tiff_pages(&[0, 0, 0], false), Want::Taken(rgb8().warned(pages))),
        ("tiff-big-pages.tif", tiff_pages(&[0, 0, 0], true), Want::Taken(rgb8().warned(pages))),
        ("tiff-overviews.tif", tiff_pages(&[0, 1, 1], false), Want::Taken(rgb8())),
    ]
}

fn animations() -> Vec<Case> {
    let want = || Want::Taken(rgb8().off(1.0).warned("the first of 4 frames is taken; `--as sequence`"));
    vec![
        ("moving-gif.gif", gif(4), want()),
        ("moving-webp.webp", animated_webp(4), want()),
        ("moving-png.png", apng(4), want()),
    ]
}

/// Display P3 in sRGB, by the matrix of the two sets of primaries.
fn from_p3(texel: [u8; 3]) -> [f32; 3] {
    let linear = texel.map(|value| srgb_to_linear(f32::from(value) / 255.0));
    let rows = [[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]];
    rows.map(|row: [f32; 3]| {
        let sum: f32 = row.iter().zip(linear).map(|(factor, value)| factor * value).sum();
        linear_to_srgb(sum.clamp(0.0, 1.0)) * 255.0
    })
}

fn profiles() -> Vec<Case> {
    let converted = |off| {
        let texel = ((5, 2), from_p3(texel(5, 2)), off);
        Taken { texel, ..rgb8() }.noted("Display P3 converted to sRGB")
    };
    let at = |name, image: &DynamicImage, format, want| {
        (name, with_profile(image, format, display_p3()), Want::Taken(want))
    };
    let (rgb, rgba) = (rgb(), rgba());
    let deep = DynamicImage::ImageRgb16(rgb.to_rgb16());
    let gray = DynamicImage::ImageLuma8(rgb.to_luma8());
    let luma = f32::from(rgb.to_luma8().get_pixel(5, 2).0[0]) / 255.0;
    let lighter = Taken { texel: ((5, 2), [linear_to_srgb(luma) * 255.0; 3], 1.6), ..taken(1, Depth::Eight) };
    let broken = "the colour profile cannot be used";
    let normal = Taken { color: ColorSpace::Normal, ..rgb8() };
    vec![
        at("p3.png", &rgb, ImageFormat::Png, converted(1.6)),
        at("p3-deep.png", &deep, ImageFormat::Png, Taken { depth: Depth::Sixteen, ..converted(1.6) }),
        at("p3-alpha.png", &rgba, ImageFormat::Png, Taken { channels: 4, ..converted(1.6) }),
        at("p3.webp.webp", &rgb, ImageFormat::WebP, converted(1.6)),
        at("p3.tif.tif", &rgb, ImageFormat::Tiff, converted(1.6)),
        ("p3.jpg.jpg", jpeg(Some(display_p3())), Want::Taken(converted(8.0))),
        at("p3_Normal.png", &rgb, ImageFormat::Png, normal.noted("handled as normal")),
        ("srgb.png", with_profile(&rgb, ImageFormat::Png, srgb()), Want::Taken(rgb8())),
        (
            "gray-profile.png",
            with_profile(&gray, ImageFormat::Png, linear_gray()),
            Want::Taken(lighter.noted("converted to sRGB")),
        ),
        (
            "broken.png",
            with_profile(&rgb, ImageFormat::Png, vec![3; 200]),
            Want::Taken(rgb8().warned(broken)),
        ),
        (
            "cmyk.jpg",
            cmyk_jpeg(),
            Want::Taken(flat(3, [127.0; 3]).off(3.0).noted("CMYK colours are converted to RGB")),
        ),
        ("turned.jpg", turned_jpeg(6), {
            let texel = ((HEIGHT - 1 - 2, 5), texel(5, 2).map(f32::from), 6.0);
            let size = (u64::from(HEIGHT), u64::from(WIDTH));
            Want::Taken(Taken { size, texel, ..rgb8() }.noted("turned as its EXIF orientation asks"))
        }),
    ]
}

fn names() -> Vec<Case> {
    let png = of(&rgb(), ImageFormat::Png);
    let linear = Taken { color: ColorSpace::Linear, ..rgb8() };
    vec![
        ("w_AO.png", png.clone(), Want::Taken(linear.noted("handled as linear because the name ends in ao"))),
        ("w_rough_1k.png", png.clone(), Want::Taken(linear.noted("handled as linear"))),
        ("w_albedo.png", png, Want::Taken(rgb8())),
    ]
}

fn containers() -> Vec<Case> {
    use dds::Format as F;
    let blocks = |block: Vec<u8>| block.repeat(4);
    let red = || [bc4_blocks(128), red_block()].concat();
    let two = || [bc4_blocks(128), bc4_blocks(200)].concat();
    let bc7 = || blocks(bc7_block([64, 32, 16], 255));
    let plain = rgba().into_bytes();
    let zstd = zstd::bulk::compress(&bc7(), 3).unwrap();
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    zlib.write_all(&bc7()).unwrap();
    let zlib = zlib.finish().unwrap();
    let half = 128.0;
    let bc5 = || flat(3, [half, 200.0, 0.0]).noted("BC5 has no blue");
    let brown = || flat(3, [129.0, 64.0, 32.0]);
    vec![
        (
            "bc1.dds",
            dds_of(F::BC1_UNORM, &blocks(red_block())),
            Want::Taken(flat(3, [255.0, 0.0, 0.0]).warned("another format was requested")),
        ),
        (
            "bc2.dds",
            dds_of(F::BC2_UNORM, &blocks([vec![0x88; 8], red_block()].concat())),
            Want::Taken(flat(4, [255.0, 0.0, 0.0])),
        ),
        ("bc3.dds", dds_of(F::BC3_UNORM, &blocks(red())), Want::Taken(flat(4, [255.0, 0.0, 0.0]))),
        ("bc4.dds", dds_of(F::BC4_UNORM, &blocks(bc4_blocks(90))), Want::Taken(flat(1, [90.0; 3]))),
        ("bc5.dds", dds_of(F::BC5_UNORM, &blocks(two())), Want::Taken(bc5())),
        (
            "bc5_nrm.dds",
            dds_of(F::BC5_UNORM, &blocks([bc4_blocks(128), bc4_blocks(128)].concat())),
            Want::Taken(
                Taken { color: ColorSpace::Normal, ..flat(3, [half, half, 255.0]) }.noted("handled as"),
            ),
        ),
        ("bc7.dds", dds_of(F::BC7_UNORM, &bc7()), Want::Taken(brown())),
        ("rgba.dds", dds_of(F::R8G8B8A8_UNORM, &plain), Want::Taken(taken(4, Depth::Eight))),
        ("bc6.dds", dds_of(F::BC6H_UF16, &[0; 64]), Want::Refused("holds BC6H, whose values are above 1")),
        ("half.dds", dds_of(F::R16G16B16A16_FLOAT, &[0; 384]), Want::Refused("holds float samples")),
        ("bc3.ktx2.ktx2", ktx2_of(137, 0, 1, &blocks(red())), Want::Taken(flat(4, [255.0, 0.0, 0.0]))),
        ("bc7.ktx2.ktx2", ktx2_of(145, 0, 1, &bc7()), Want::Taken(brown())),
        ("bc7-srgb.ktx2", ktx2_of(146, 0, 1, &bc7()), Want::Taken(brown())),
        ("rgba.ktx2.ktx2", ktx2_of(37, 0, 1, &plain), Want::Taken(taken(4, Depth::Eight))),
        ("zstd.ktx2", ktx2_of(145, 2, 1, &zstd), Want::Taken(brown())),
        (
            "zstd-cut.ktx2",
            ktx2_of(145, 2, 1, &zstd[..zstd.len() - 3]),
            Want::Refused("the KTX2 header is wrong"),
        ),
        ("zlib.ktx2", ktx2_of(145, 3, 1, &zlib), Want::Taken(brown())),
        (
            "zlib-cut.ktx2",
            ktx2_of(145, 3, 1, &zlib[..zlib.len() - 6]),
            Want::Refused("the KTX2 header is wrong"),
        ),
        ("basis.ktx2", ktx2_of(0, 1, 1, &[0; 64]), Want::Refused("holds Basis Universal, and only a flat")),
        ("uastc.ktx2", ktx2_of(0, 0, 1, &[0; 64]), Want::Refused("holds Basis Universal")),
        ("cube.ktx2", ktx2_of(145, 0, 6, &bc7()), Want::Refused("holds a cube map")),
        ("bc6.ktx2.ktx2", ktx2_of(143, 0, 1, &[0; 64]), Want::Refused("holds BC6H")),
        (
            "astc.ktx2",
            ktx2_of(157, 0, 1, &blocks(astc_block([200, 100, 50, 255]))),
            Want::Taken(flat(3, [200.0, 100.0, 50.0])),
        ),
        ("astc-cut.ktx2", ktx2_of(158, 0, 1, &[0; 24]), Want::Refused("ends before its blocks do")),
        ("etc2.ktx2", ktx2_of(147, 0, 1, &[0; 64]), Want::Refused("holds another format")),
        ("bc7-cut.dds", dds_of(F::BC7_UNORM, &bc7()[..20]), Want::Refused("ends before its blocks do")),
    ]
}

fn others() -> Vec<Case> {
    let cut = |name, bytes: Vec<u8>, want| (name, bytes[..bytes.len() / 2].to_vec(), Want::Refused(want));
    let ftyp = |brand: &[u8; 4]| [&[0, 0, 0, 24][..], b"ftyp", brand, &[0; 40]].concat();
    let rgb = rgb();
    let large_qoi = [&b"qoif"[..], &16_384u32.to_be_bytes(), &16_384u32.to_be_bytes(), &[4, 0]].concat();
    let wide_qoi = [&b"qoif"[..], &40_000u32.to_be_bytes(), &4u32.to_be_bytes(), &[4, 0]].concat();
    vec![
        (
            "a.svg",
            b"<?xml version='1.0'?><svg xmlns='http://www.w3.org/2000/svg'/>".to_vec(),
            Want::Refused("SVG is not read; give PNG, JPEG, TIFF, WebP"),
        ),
        ("b.png", b"<svg/>".to_vec(), Want::Refused("SVG is not read")),
        ("c.jp2", b"\0\0\0\x0cjP  \r\n\x87\n".to_vec(), Want::Refused("JPEG 2000 is not read")),
        ("d.avif", ftyp(b"avif"), Want::Refused("AVIF is not read")),
        ("e.heic", ftyp(b"heic"), Want::Refused("HEIC is not read")),
        ("f.ico", vec![0, 0, 1, 0, 1, 0, 8, 8], Want::Refused("ICO is not read")),
        ("g.psd", b"8BPS\0\x01".to_vec(), Want::Refused("PSD is not read")),
        #[cfg(not(feature = "jxl"))]
        (
            "h.jxl",
            jxl(),
            Want::Refused("JPEG XL is not read by this build; build with --features jxl, or give"),
        ),
        #[cfg(feature = "jxl")]
        (
            "h.jxl",
            jxl(),
            Want::Taken(Taken { size: (8, 8), texel: ((5, 2), [150.0, 60.0, 100.0], 0.6), ..rgb8() }),
        ),
        ("i.dat", b"nothing known".to_vec(), Want::Refused("unknown image format; give PNG, JPEG")),
        cut("cut-webp.webp", of(&rgb, ImageFormat::WebP), "the image cannot be decoded"),
        cut("cut-qoi.qoi", of(&rgb, ImageFormat::Qoi), "the image cannot be decoded"),
        cut("cut-exr.exr", float(ImageFormat::OpenExr, 1.0), "the image cannot be decoded"),
        cut("cut-hdr.hdr", float(ImageFormat::Hdr, 1.0), "the image cannot be decoded"),
        cut("cut-gif.gif", gif(1), "the image cannot be decoded"),
        ("large.qoi", large_qoi, Want::Refused("--memory")),
        ("wide.qoi", wide_qoi, Want::Refused("40000x4, longer than 32768 texels a side")),
    ]
}

fn texfold(dir: &Path, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_texfold");
    Command::new(program).args(arguments.split_whitespace()).current_dir(dir).output().unwrap()
}

/// The report of a run.
fn compress(dir: &Path, arguments: &str) -> Vec<Value> {
    let run = texfold(dir, &format!("compress {arguments} --out out --report report.json"));
    let report = fs::read(dir.join("report.json"));
    let report = report.unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&run.stderr)));
    serde_json::from_slice(&report).unwrap()
}

fn joined(row: &Value, field: &str) -> String {
    let lines = row[field].as_array().map(Vec::as_slice).unwrap_or_default();
    lines.iter().map(|line| line.as_str().unwrap()).collect::<Vec<_>>().join("; ")
}

/// The difference between a file's outcome and what is expected.
fn fault(dir: &Path, row: &Value, want: &Want) -> Option<String> {
    let error = row["error"].as_str();
    let want = match (want, error) {
        (Want::Refused(sentence), Some(error)) => {
            let is_plain = !error.contains("Unknown(") && !error.contains("internal error");
            return (!error.contains(sentence) || !is_plain).then(|| error.to_owned());
        }
        (Want::Taken(want), None) => want,
        (_, error) => return Some(format!("{error:?}")),
    };
    let file = fs::read(dir.join(row["output"].as_str().unwrap())).unwrap();
    let texture = texfold::open(&file).unwrap().into_image().unwrap();
    let encoded = texture.as_encoded();
    let ((x, y), values, off) = want.texel;
    let found = encoded.texel(ImageAddress { image: 0, level: 0, x, y }) * 255.0;
    let pixel = encoded.layout().pixel;
    let size = (row["width"].as_u64().unwrap(), row["height"].as_u64().unwrap());
    let told = |found: String, wanted: &str| {
        if wanted.is_empty() { found.is_empty() } else { found.contains(wanted) }
    };
    let count = if pixel.channels < 3 { 1 } else { 3 };
    let is_right = size == want.size
        && (pixel.channels, pixel.depth, pixel.color) == (want.channels, want.depth, want.color)
        && (0..count).all(|channel| (found[channel] - values[channel]).abs() <= off)
        && told(joined(row, "notes"), want.note)
        && told(joined(row, "warnings"), want.warning);
    let all = || format!("{size:?} {pixel:?} {found} {} {}", joined(row, "notes"), joined(row, "warnings"));
    (!is_right).then(all)
}

#[test]
fn every_form_has_its_outcome() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir_all(dir.path().join("in")).unwrap();
    let forms =
        [plain_formats(), floats(), tiffs(), animations(), profiles(), names(), containers(), others()];
    let mut cases: Vec<Case> = forms.into_iter().flatten().collect();
    cases.sort_by_key(|(name, ..)| *name);
    for (name, bytes, _) in &cases {
        fs::write(dir.path().join("in").join(name), bytes).unwrap();
    }
    // For the fuzz target of inputs, whose last byte is the number of the kind: TGA is told by its name alone.
    if let Some(seeds) = std::env::var_os("TEXFOLD_SEEDS") {
        for (name, bytes, _) in &cases {
            let kind = u8::from(name.ends_with(".tga"));
            fs::write(Path::new(&seeds).join(name), [bytes.as_slice(), &[kind]].concat()).unwrap();
        }
    }
    let report = compress(dir.path(), "in/* --codec bc --content raw --memory 1");
    assert_eq!(report.len(), cases.len());
    let mut faults = Vec::new();
    for ((name, _, want), row) in cases.iter().zip(&report) {
        assert_eq!(row["input"].as_str(), Some(format!("in/{name}").as_str()));
        faults.extend(fault(dir.path(), row, want).map(|fault| format!("{name}: {fault}\n    {want:?}")));
    }
    assert!(faults.is_empty(), "{} of {} files:\n{}", faults.len(), cases.len(), faults.join("\n"));
}

#[test]
fn all_frames_and_pages_are_taken_where_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let files = [
        ("a.gif", gif(3), "sequence"),
        ("b.webp", animated_webp(3), "sequence"),
        ("c.png", apng(3), "sequence"),
        ("d.tif", tiff_pages(&[0, 1, 0, 0], false), "set"),
        ("e.tif", tiff_pages(&[0, 0, 0], true), "sequence"),
    ];
    for (name, bytes, kind) in files {
        fs::write(dir.path().join(name), bytes).unwrap();
        let report = compress(dir.path(), &format!("{name} --as {kind} --codec bc --content raw"));
        assert_eq!(report[0]["images"], 3, "{name}: {report:?}");
        assert_eq!(joined(&report[0], "warnings"), "", "{name}");
        let file = fs::read(dir.path().join(report[0]["output"].as_str().unwrap())).unwrap();
        let texture = texfold::open(&file).unwrap().into_image().unwrap();
        let red = |image| texture.as_encoded().texel(ImageAddress { image, level: 0, x: 0, y: 0 }).x * 255.0;
        let wanted = if kind == "sequence" && name != "e.tif" { [0.0, 50.0, 100.0] } else { [0.0; 3] };
        assert!((0..3).all(|image| (red(image) - wanted[image as usize]).abs() < 1.5), "{name}");
    }
}

/// Values of all bands at all places, by images of up to four channels.
fn band_values(dir: &Path, row: &Value) -> (Alpha, Vec<Vec<u8>>) {
    let file = fs::read(dir.join(row["output"].as_str().unwrap())).unwrap();
    let texture = texfold::open(&file).unwrap().into_image().unwrap();
    let layout = texture.as_encoded().layout();
    let image = |image| decode_image(texture.as_encoded(), image, 0).unwrap().to_bytes();
    (layout.pixel.alpha, (0..layout.images.len() as u32).map(image).collect())
}

#[test]
fn bands_are_channels_and_come_back() {
    let dir = tempfile::tempdir().unwrap();
    // Samples, photometric interpretation, kinds of extra samples.
    let cases: [(u16, u16, &[u16]); 6] =
        [(2, 1, &[0]), (3, 1, &[0, 0]), (4, 2, &[0]), (4, 1, &[0, 0, 0]), (5, 2, &[0, 2]), (9, 1, &[0; 8])];
    for planes in [Planes::Together, Planes::Strips, Planes::Tiles] {
        for (bands, photometric, kinds) in cases {
            let name = format!("{bands}-{photometric}-{planes:?}");
            let bytes = tiff_of_bands(bands, photometric, planes, kinds);
            fs::write(dir.path().join(format!("{name}.tif")), bytes).unwrap();
            let report = compress(dir.path(), &format!("{name}.tif --codec bc --content raw"));
            let (alpha, found) = band_values(dir.path(), &report[0]);
            let note = joined(&report[0], "notes");
            assert!(note.starts_with(&format!("{bands} bands are the channels")), "{name}: {report:?}");
            assert_eq!(found.len(), usize::from(bands.div_ceil(4)), "{name}");
            assert_eq!(alpha == Alpha::Band, bands != 3, "{name}: {alpha:?}");
            let channels = bands.min(4);
            for (image, values) in (0..).zip(&found) {
                let places = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
                let wanted = places.flat_map(|(x, y)| {
                    (0..channels).map(move |channel| match image * channels + channel {
                        band @ 0..=2 => texel(x, y)[usize::from(band)],
                        number if number < bands => band(x, y, number),
                        _ => 0,
                    })
                });
                assert!(wanted.eq(values.iter().copied()), "{name}: image {image}");
            }
            let run = texfold(dir.path(), &format!("decompress out/{name}.txf --to tiff --out back"));
            assert_eq!(String::from_utf8(run.stderr).unwrap(), "", "{name}");
            // One file again, of which the bands are those of the first.
            let report =
                compress(dir.path(), &format!("back/{name}.tiff --codec bc --content raw --out again"));
            assert_eq!(joined(&report[0], "notes"), note, "{name}");
            assert_eq!(band_values(dir.path(), &report[0]), (alpha, found), "{name}");
        }
    }
    let run = texfold(dir.path(), "decompress out/5-2-Tiles.txf --out png");
    let warned = String::from_utf8(run.stderr).unwrap();
    assert_eq!(
        warned.matches("the band beside the colours is left out; give --to tiff").count(),
        2,
        "{warned}"
    );
    fs::create_dir(dir.path().join("both")).unwrap();
    for name in ["5-2-Tiles.tif", "4-2-Tiles.tif"] {
        fs::copy(dir.path().join(name), dir.path().join("both").join(name)).unwrap();
    }
    let run = texfold(dir.path(), "compress both --as set --out set");
    assert!(String::from_utf8(run.stderr).unwrap().contains("has 5 bands, and only compress"));
    fs::write(dir.path().join("profile.tif"), tiff_with_band_and_profile()).unwrap();
    let report = compress(dir.path(), "profile.tif --codec bc --content raw");
    assert!(joined(&report[0], "warnings").contains("colour profile is not followed"), "{report:?}");
    // What takes no bands says so.
    fs::create_dir(dir.path().join("stack")).unwrap();
    for name in ["a.tif", "b.tif"] {
        fs::copy(dir.path().join("4-2-Tiles.tif"), dir.path().join("stack").join(name)).unwrap();
    }
    let run = texfold(dir.path(), "compress stack --as zoom --out zoom");
    let warned = String::from_utf8(run.stderr).unwrap();
    assert!(warned.contains("the band beside them is left out"), "{warned}");
    // Alpha by the file's tags or by the user's word.
    fs::write(dir.path().join("alpha.tif"), tiff_of_bands(4, 2, Planes::Together, &[2])).unwrap();
    for (arguments, wanted) in [
        ("alpha.tif", Alpha::Straight),
        ("alpha.tif --alpha band --force", Alpha::Band),
        ("4-2-Together.tif --alpha straight --force", Alpha::Straight),
    ] {
        let report = compress(dir.path(), &format!("{arguments} --codec bc --content raw"));
        assert_eq!(band_values(dir.path(), &report[0]).0, wanted, "{arguments}");
    }
}

#[test]
fn files_of_a_folder_that_are_not_read_are_listed() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir_all(dir.path().join("in")).unwrap();
    fs::write(dir.path().join("in/a.png"), of(&rgb(), ImageFormat::Png)).unwrap();
    for name in ["notes.txt", "scan.psd", "1.dat", "2.dat", "3.dat", "4.dat", "5.dat", ".hidden"] {
        fs::write(dir.path().join("in").join(name), b"x").unwrap();
    }
    let run = texfold(dir.path(), "compress in --codec bc --out out --report report.json");
    assert_eq!(run.status.code(), Some(0));
    let stdout = String::from_utf8(run.stdout).unwrap();
    assert!(
        stdout.lines().any(|line| line == "not read: 1.dat, 2.dat, 3.dat, 4.dat, 5.dat and 2 more"),
        "{stdout}"
    );
    assert_eq!(String::from_utf8(run.stderr).unwrap(), "");
    let report: Vec<Value> =
        serde_json::from_slice(&fs::read(dir.path().join("report.json")).unwrap()).unwrap();
    assert_eq!((report.len(), report[1]["not_read"].as_array().unwrap().len()), (2, 7));
    assert_eq!(report[1]["not_read"][6], "in/scan.psd");
}

#[test]
fn unlike_maps_of_a_folder_are_warned_of() {
    let dir = tempfile::tempdir().unwrap();
    for (folder, names) in
        [("unlike", ["w_Color.png", "w_Normal.png"]), ("alike", ["v_Normal.png", "w_Normal.png"])]
    {
        fs::create_dir_all(dir.path().join(folder)).unwrap();
        for name in names {
            fs::write(dir.path().join(folder).join(name), of(&rgb(), ImageFormat::Png)).unwrap();
        }
    }
    let report = compress(dir.path(), "unlike alike --codec bc --content raw");
    assert!(
        joined(&report[0], "warnings").starts_with("w_Normal.png: by its name another kind"),
        "{report:?}"
    );
    assert!(
        joined(&report[1], "notes").starts_with("v_Normal.png, w_Normal.png: handled as normal"),
        "{report:?}"
    );
    let report = compress(dir.path(), "unlike --color linear --codec bc --content raw");
    assert_eq!(joined(&report[0], "warnings"), "");
    let run = texfold(dir.path(), "compress unlike --codec bc --out out --strict --force");
    assert_eq!(run.status.code(), Some(1));
}

#[test]
fn images_of_banks_are_read_alike() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir_all(dir.path().join("in")).unwrap();
    for (name, bytes) in [
        ("a.webp", of(&rgb(), ImageFormat::WebP)),
        ("b.png", with_profile(&rgb(), ImageFormat::Png, display_p3())),
        ("c.exr", float(ImageFormat::OpenExr, 1.0)),
        ("d.tif", tiff_pages(&[0, 0], false)),
        ("e.dds", dds_of(dds::Format::R8G8B8A8_UNORM, &rgba().into_bytes())),
    ] {
        fs::write(dir.path().join("in").join(name), bytes).unwrap();
    }
    let run = texfold(
        dir.path(),
        "bank add in --codec dct --psnr 30 --effort fast --out bank --report report.json",
    );
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let report: Vec<Value> =
        serde_json::from_slice(&fs::read(dir.path().join("report.json")).unwrap()).unwrap();
    assert_eq!(report.len(), 5);
    assert_eq!(joined(&report[1], "notes"), "Display P3 converted to sRGB");
    assert!(joined(&report[2], "notes").contains("linear"), "{report:?}");
    assert!(joined(&report[3], "warnings").contains("the first of 2 pages"), "{report:?}");
}

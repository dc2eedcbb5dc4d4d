//! The report as one HTML file that needs nothing else.

use std::error::Error;
use std::fmt::Write;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold_chart::escaped;
use texfold_core::image::Raster;

use super::candidate::Candidate;
use super::chart::{self, CHARTS};
use super::measure::Bench;
use super::storage::Storage;
use super::table::{Row, difference, means, score};
use crate::{png, thumbnail};

/// Side in texels of the images: the middle of each input.
const THUMBNAIL_SIDE: u32 = 160;

/// Images of one input.
#[derive(Debug)]
pub(crate) struct Subject {
    input: String,
    original: Option<Raster>,
    shown: Vec<Shown>,
}

#[derive(Debug)]
struct Shown {
    title: String,
    decoded: Raster,
    error: Raster,
    /// Its number in the page of images.
    place: Option<usize>,
}

impl Subject {
    /// An input, with its image where images are wanted.
    pub(crate) fn new(input: &str, image: Option<&Raster>) -> Subject {
        let original = image.map(|image| thumbnail::crop(image, THUMBNAIL_SIDE));
        Subject { input: input.to_owned(), original, shown: Vec::new() }
    }

    /// Adds what a setting made of it.
    pub(crate) fn add(&mut self, candidate: &Candidate, row: &Row, decoded: &Raster, place: Option<usize>) {
        let Some(original) = self.original.as_ref().filter(|_| candidate.has_thumbnail) else { return };
        let decoded = thumbnail::crop(decoded, THUMBNAIL_SIDE);
        let error = thumbnail::error(original, &decoded);
        self.shown.push(Shown { title: row.title(), error, decoded, place });
    }
}

const STYLE: &str = ":root{color-scheme:light dark}body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}\
table{border-collapse:collapse;font-size:14px}td,th{padding:.2rem .6rem;border-bottom:1px solid #8884;text-align:right}\
td:nth-child(-n+3),th:nth-child(-n+3){text-align:left}figure{display:inline-block;margin:.3rem}\
figcaption{font-size:13px;max-width:22rem}img{image-rendering:pixelated;margin-right:3px;vertical-align:top}\
svg{width:100%;height:auto}.wide{overflow-x:auto}.wide>svg{min-width:44rem}";

type Fault = Box<dyn Error + Send + Sync>;

/// The whole page.
pub(crate) fn html(rows: &[Row], subjects: &[Subject], bench: &Bench) -> Result<String, Fault> {
    let means = means(rows);
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Texfold: comparison</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style>\
         <h1>Texfold: comparison of {} inputs</h1>",
        subjects.len()
    );
    page.push_str(&circumstances(bench));
    for (axis, quality) in CHARTS {
        if let Some(svg) = chart::svg(&means, axis, quality) {
            write!(page, "<div class=\"wide\">{svg}</div>")?;
        }
    }
    write!(page, "<h2>Means over the inputs</h2>{}", table(&means))?;
    write!(
        page,
        "<h2>Images</h2><p>The middle {THUMBNAIL_SIDE} texels of each input: the original, then for some settings \
         the decoded image and its error, scaled by {} around middle gray. <a href=\"images.html\">All of them to zoom into</a>, \
         beside the original.</p>",
        thumbnail::ERROR_GAIN
    )?;
    for subject in subjects {
        page.push_str(&images(subject)?);
    }
    writeln!(page, "<h2>All rows</h2>{}</html>", table(rows))?;
    Ok(page)
}

/// What was measured how, and what was not there.
fn circumstances(bench: &Bench) -> String {
    let gpu = match bench.adapter() {
        Some(name) => format!("GPU speeds are of {}: the first image drawn at its own size.", escaped(&name)),
        None => "No GPU adapter was found: GPU speeds are left out.".to_owned(),
    };
    let rival = if bench.rival().is_some() {
        "ASTC is by the external program astcenc at its medium preset, its time with decoding."
    } else {
        "The external program astcenc was not found: ASTC is left out."
    };
    let storage = match bench.storage() {
        [] if bench.wants_storage() => "No program of a format for storage was found.".to_owned(),
        [] => String::new(),
        found => {
            let names: Vec<&str> = found.iter().map(Storage::name).collect();
            format!(
                "Dashed: {} at the best setting within the bits of each image; no part of such files can be read alone, and they are drawn \
                 as plain texels.",
                names.join(", ")
            )
        }
    };
    format!(
        "<p>Quality is taken from the bytes of the file that ships; butteraugli alone is better where it is smaller. Compressed bits count all planes, blocks and parameters; \
         a cache of tiles holds them and a pool for all textures together. Bits decoded whole are those of GPU memory where textures in \
         blocks are decoded to plain texels. Encoding uses all \
         cores at effort {}; CPU decoding one thread, the median of several whole decodes. {gpu} {rival} {storage}</p>",
        bench.effort().name()
    )
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "<div class=\"wide\"><table><tr><th>input<th>codec<th>settings<th>bits compressed<th>bits decoded whole<th>bits disk<th>PSNR dB<th>SSIM<th>SSIMULACRA2<th>butteraugli\
         <th>encode s<th>CPU Mtexel/s<th>GPU Mtexel/s",
    );
    let speed = |speed: Option<f64>| speed.map_or("-".to_owned(), |speed| format!("{:.1}", speed / 1e6));
    for row in rows {
        let _ = write!(
            text,
            "<tr><td>{}<td>{}<td>{}<td>{:.3}<td>{:.3}<td>{:.3}<td>{:.2}<td>{:.4}<td>{}<td>{}<td>{:.2}<td>{}<td>{}",
            escaped(&row.input),
            row.codec,
            escaped(&row.settings),
            row.bpp_memory,
            row.bpp_resident,
            row.bpp_disk,
            row.psnr,
            row.ssim,
            score(row.ssimulacra2),
            difference(row.butteraugli),
            row.encode_seconds,
            speed(row.decode_cpu_texels_per_second),
            speed(row.decode_gpu_texels_per_second)
        );
    }
    text.push_str("</table></div>");
    text
}

fn images(subject: &Subject) -> Result<String, Fault> {
    let Some(original) = &subject.original else { return Ok(String::new()) };
    let mut text = format!(
        "<h3>{}</h3><figure>{}<figcaption>original</figcaption></figure>",
        escaped(&subject.input),
        data_image(original, "original")?
    );
    for Shown { title, decoded, error, place } in &subject.shown {
        let title = escaped(title);
        let caption = match place {
            Some(place) => format!("<a href=\"images.html#{place}\">{title}</a>"),
            None => title,
        };
        write!(
            text,
            "<figure>{}{}<figcaption>{caption}</figcaption></figure>",
            data_image(decoded, "decoded")?,
            data_image(error, "error")?
        )?;
    }
    Ok(text)
}

fn data_image(raster: &Raster, alt: &str) -> Result<String, Fault> {
    let size = raster.size();
    let data = BASE64_STANDARD.encode(png::encode(raster)?);
    Ok(format!(
        "<img alt=\"{alt}\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{data}\">",
        size.width, size.height
    ))
}

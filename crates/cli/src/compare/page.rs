//! The report as one HTML file that needs nothing else.

use std::error::Error;
use std::fmt::Write;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold_chart::escaped;
use texfold_core::Texel;
use texfold_core::image::Raster;

use super::candidate::RIVAL;
use super::measure::Bench;
use super::storage::Storage;
use super::suite::{AUTO, Suite};
use super::table::{Row, difference, means, score};
use super::{chart, choices, equal, light};
use crate::material_figures::MaterialFigures;
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
    pub(crate) fn add(&mut self, row: &Row, decoded: &Raster, place: Option<usize>) {
        let Some(original) = &self.original else { return };
        let decoded = thumbnail::crop(decoded, THUMBNAIL_SIDE);
        let error = thumbnail::error(original, &decoded);
        self.shown.push(Shown { title: row.title(), error, decoded, place });
    }
}

/// Pixels of a texel of the sheet, and texels between its parts.
const SHEET: (u32, u32) = (2, 3);
/// Most columns and rows of the sheet.
const SHEET_PARTS: (usize, usize) = (6, 8);

/// A column for each of the first inputs whose pixels are of one kind: the original, and below it what is shown of the first settings; `None`
/// where no input has images.
pub(crate) fn sheet(subjects: &[Subject]) -> Option<Raster> {
    let info = subjects.iter().find_map(|subject| subject.original.as_ref())?.info();
    let column = |subject: &Subject| {
        let original = subject.original.clone().filter(|original| original.info() == info)?;
        let shown = subject.shown.iter().map(|shown| shown.decoded.clone());
        Some(std::iter::once(original).chain(shown).take(SHEET_PARTS.1).collect::<Vec<Raster>>())
    };
    let columns: Vec<Vec<Raster>> = subjects.iter().filter_map(column).take(SHEET_PARTS.0).collect();
    let rows = columns.iter().map(Vec::len).max()? as u32;
    let ((zoom, gap), step) = (SHEET, THUMBNAIL_SIDE + SHEET.1);
    let side = |count: u32| zoom * (count * step - gap);
    let (width, height) = (side(columns.len() as u32), side(rows));
    let texel = |x: u32, y: u32| {
        let image = columns.get((x / step) as usize)?.get((y / step) as usize)?;
        let (size, (x, y)) = (image.size(), (x % step, y % step));
        (x < size.width && y < size.height).then(|| image.texel(x, y))
    };
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x / zoom, y / zoom)));
    let texels: Vec<Texel> = all.map(|(x, y)| texel(x, y).unwrap_or(Texel::ONE)).collect();
    Raster::from_texels(width, height, info, &texels).ok()
}

const STYLE: &str = ":root{color-scheme:light dark}body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}\
table{border-collapse:collapse;font-size:14px}td,th{padding:.2rem .6rem;border-bottom:1px solid #8884;text-align:right}\
td:first-child,th:first-child,td.text,th.text{text-align:left;white-space:nowrap}figure{display:inline-block;margin:.3rem}\
figcaption{font-size:13px;max-width:22rem}img{image-rendering:pixelated;margin-right:3px;vertical-align:top}\
svg{width:100%;height:auto}.wide{overflow-x:auto}.worse{color:#b3182b}@media(prefers-color-scheme:dark){.worse{color:#ff8f9b}}\
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,27rem),1fr));gap:1rem}\
.curves{display:block;margin:0;touch-action:pan-y}.curves output{display:block;min-height:1.5em;font-size:13px}\
.legend{position:sticky;top:0;background:Canvas;padding:.4rem 0}.legend button{font:inherit;color:inherit;background:none;border:1px solid #8884;border-radius:1rem;\
margin:.15rem;padding:.1rem .7rem;cursor:pointer}.legend button[aria-pressed=false]{opacity:.4;text-decoration:line-through}";

type Fault = Box<dyn Error + Send + Sync>;

/// The whole page. `left_out` counts settings that the time did not suffice for.
pub(crate) fn html(
    suite: &Suite,
    rows: &[Row],
    subjects: &[Subject],
    bench: &Bench,
    left_out: usize,
) -> Result<String, Fault> {
    let means = means(rows);
    let title = escaped(&suite.title);
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Texfold: {title}</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style>\
         <h1>Texfold: {title}</h1><p>Mean qualities over {} input{}, and all their bits over all their texels. Click a name to switch its series; point at a mark to read it.</p>",
        subjects.len(),
        if subjects.len() == 1 { "" } else { "s" }
    );
    if left_out > 0 {
        write!(
            page,
            "<p><strong>{left_out} settings are not measured yet</strong>: the time did not suffice. The same command goes on.</p>"
        )?;
    }
    let (of_light, of_images): (Vec<Row>, Vec<Row>) = rows.iter().cloned().partition(light::is_light);
    if !of_images.is_empty() {
        section(&mut page, &of_images, suite)?;
    }
    if !of_light.is_empty() {
        write!(
            page,
            "<h2>Captures</h2><p>PSNR and SSIMULACRA2 are of photographs that none of the ways has seen, of the object's pixels; bits a texel \
             count the object's pixels in all photographs. Photographs are kept as JPEG textures with the mesh.</p>"
        )?;
        section(&mut page, &of_light, suite)?;
    }
    page.push_str(&circumstances(bench, rows));
    write!(page, "<h2>Means over the inputs</h2>{}", table(&means))?;
    write!(
        page,
        "<p><a href=\"results.csv\">All {} rows</a>, as <a href=\"results.json\">JSON</a>, and for codec-compare: \
         <a href=\"codec-compare.json\">codec-compare.json</a>.</p>",
        rows.len()
    )?;
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
    writeln!(page, "<script>{}</script></html>", texfold_chart::SCRIPT)?;
    Ok(page)
}

/// Charts and bits at equal quality.
fn section(page: &mut String, rows: &[Row], suite: &Suite) -> Result<(), Fault> {
    let means = means(rows);
    let comparable = chart::comparable(&means);
    if comparable.len() < means.len() {
        write!(
            page,
            "<p>Charts hold the {} settings that most inputs have; {} more, of fewer inputs, are in the table below.</p>",
            comparable.len(),
            means.len() - comparable.len()
        )?;
    }
    let (legend, charts) = chart::svgs(&comparable, suite.equal_bpp());
    write!(page, "{legend}<div class=\"charts\">")?;
    for svg in charts {
        write!(page, "<figure class=\"curves\">{svg}<output></output></figure>")?;
    }
    page.push_str("</div>");
    page.push_str(&equal::tables(rows));
    page.push_str(&choices::tables(suite, rows));
    Ok(())
}

/// What was measured how, and what was not there.
fn circumstances(bench: &Bench, rows: &[Row]) -> String {
    let gpu = match bench.adapter() {
        Some(name) => format!("GPU speeds are of {}: the first image drawn at its own size.", escaped(&name)),
        None => "No GPU adapter was found: GPU speeds are left out.".to_owned(),
    };
    let efforts = |is_wanted: fn(&Row) -> bool| {
        let mut all: Vec<&str> = Vec::new();
        for row in rows.iter().filter(|row| is_wanted(row) && !row.effort.is_empty()) {
            if !all.contains(&row.effort.as_str()) {
                all.push(&row.effort);
            }
        }
        all.join(", ")
    };
    let rival = match bench.rival() {
        Some(_) => format!(
            "ASTC is by the external program astcenc (preset {}), its time with decoding.",
            efforts(|row| row.codec == RIVAL)
        ),
        None if !bench.wants_rival() => String::new(),
        None => "The external program astcenc was not found: ASTC is left out.".to_owned(),
    };
    let ours =
        efforts(|row| row.codec == AUTO || texfold::CODECS.iter().any(|codec| codec.id.name == row.codec));
    let several = if ours.contains(", ") { "; charts and tables of bits have the last of them" } else { "" };
    let jpeg =
        "JPEG textures are baseline 4:2:0 with 0.17 bits a texel for the index that decoding by block takes.";
    let storage = match bench.storage() {
        [] if bench.wants_storage() => "No program of a format for storage was found.".to_owned(),
        [] => String::new(),
        found => {
            let names: Vec<&str> = found.iter().map(Storage::name).collect();
            format!(
                "Dashed: {} at the best setting within the bits of each image, also of a set, whose bits codecs share out among its images; no part of \
                 such files can be read alone, and they are drawn as plain texels.",
                names.join(", ")
            )
        }
    };
    format!(
        "<p>Quality is taken from the bytes of the file that ships; butteraugli alone is better where it is smaller. Compressed bits count all planes, blocks and parameters; \
         a cache of tiles holds them and a pool for all textures together. Bits decoded whole are those of GPU memory where textures in \
         blocks are decoded to plain texels. Encoding uses all \
         cores at effort {ours}{several}; CPU decoding one thread, the median of several whole decodes. {gpu} {rival} {jpeg} {storage}</p>"
    )
}

fn table(means: &[Row]) -> String {
    let of_materials = means.iter().any(|row| row.material != MaterialFigures::default());
    let mut text = String::from(
        "<div class=\"wide\"><table><tr><th>series<th class=\"text\">settings<th>inputs<th>bits compressed<th>bits decoded whole<th>bits disk<th>PSNR dB<th>SSIM<th>SSIMULACRA2<th>butteraugli\
         <th>encode s<th>CPU s/Mtexel<th>CPU Mtexel/s<th>GPU Mtexel/s",
    );
    if of_materials {
        text.push_str("<th>normals, degrees<th>lit, SSIMULACRA2");
    }
    let speed = |speed: Option<f64>| speed.map_or("-".to_owned(), |speed| format!("{:.1}", speed / 1e6));
    for row in means {
        let _ = write!(
            text,
            "<tr><td>{}<td class=\"text\">{}<td>{}<td>{:.3}<td>{:.3}<td>{:.3}<td>{:.2}<td>{:.4}<td>{}<td>{}<td>{:.2}<td>{}<td>{}<td>{}",
            escaped(&row.series),
            escaped(&row.settings),
            row.inputs,
            row.bpp_memory,
            row.bpp_resident,
            row.bpp_disk,
            row.psnr,
            row.ssim,
            score(row.ssimulacra2),
            difference(row.butteraugli),
            row.encode_seconds,
            difference(row.cpu_seconds_a_megatexel()),
            speed(row.decode_cpu_texels_per_second),
            speed(row.decode_gpu_texels_per_second)
        );
        if of_materials {
            let MaterialFigures { degrees, lit } = row.material;
            let _ = write!(text, "<td>{}<td>{}", difference(degrees), score(lit));
        }
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

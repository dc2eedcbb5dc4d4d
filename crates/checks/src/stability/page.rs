//! The report: one HTML file that needs nothing else.

use std::fmt::Write;
use std::io::Cursor;

use base64::prelude::{BASE64_STANDARD, Engine};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use texfold::core::image::Raster;
use texfold_chart::{Axis, Chart, Kind, NARROW, Names, Point, Scale, Series, escaped, short};

use super::atlas::{Failure, Picture};
use super::record::{Bound, Check, Curve, Outcome as Result, Row};
use super::{Outcome, Tools};

/// Texels a side of a picture at most: the middle of an image.
const PICTURE: u32 = 64;

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#222;--paper:#fff;--rule:#ddd;--bad:#b00020;--good:#1b6e3c}\
@media(prefers-color-scheme:dark){:root{--ink:#ddd;--paper:#161616;--rule:#3a3a3a;--bad:#ff8a93;--good:#7fd6a0}}\
body{font:16px/1.5 system-ui,sans-serif;max-width:76rem;margin:2rem auto;padding:0 1rem;color:var(--ink);background:var(--paper)}\
table{border-collapse:collapse;font-size:14px}td,th{padding:.2rem .6rem;border-bottom:1px solid var(--rule);text-align:left;vertical-align:top}\
.wide{overflow-x:auto}.bad{color:var(--bad);font-weight:600}.good{color:var(--good)}\
img{image-rendering:pixelated;width:96px;margin-right:4px}figure{display:inline-block;margin:0 .6rem .6rem 0}figure img{width:160px}figcaption{font-size:13px}summary{cursor:pointer}\
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,24rem),1fr));gap:1rem}svg{width:100%;height:auto}";

/// The whole page.
pub(super) fn html(
    tools: &Tools,
    rows: &[Row],
    (curves, failures): (&[Curve], &[Failure]),
    about: &[(&str, &str)],
) -> String {
    let broken = rows.iter().filter(|row| !row.holds()).count();
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Texfold: stability</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style><h1>Texfold: stability</h1>"
    );
    let gpu = match (&tools.gpu, &tools.no_gpu) {
        (Some(gpu), _) => format!("Shaders ran on {}.", escaped(&gpu.info().name)),
        (None, why) => format!("No shader ran: {}.", escaped(why.as_deref().unwrap_or("no adapter"))),
    };
    let _ = write!(
        page,
        "<p>{} results over {} regimes; <b class=\"{}\">{broken} break a bound</b>. {gpu} A regime is an input that some method does not \
         suit. A result is correct within its bounds, or a refusal that says what to do.</p>{}",
        rows.len(),
        about.len(),
        if broken == 0 { "good" } else { "bad" },
        overview(rows, about)
    );
    if !failures.is_empty() {
        page.push_str("<h2>Where each method stops working</h2>");
        for failure in failures {
            page.push_str(&card(failure, rows));
        }
    }
    if !curves.is_empty() {
        page.push_str("<h2>Charts</h2><p>Hollow points: the method fell back to a plainer form.</p><div class=\"charts\">");
        for curve in curves {
            page.push_str(&svg(curve));
        }
        page.push_str("</div>");
    }
    page.push_str("<h2>Regimes</h2>");
    for &(regime, what) in about {
        let of_regime: Vec<&Row> = rows.iter().filter(|row| row.regime == regime).collect();
        page.push_str(&details(regime, what, &of_regime));
    }
    page.push_str("</html>\n");
    page
}

/// A method's failure with its pictures, and what its results keep.
fn card(failure: &Failure, rows: &[Row]) -> String {
    let of_method = || rows.iter().filter(|row| row.codec.split([' ', ',']).next() == Some(&failure.method));
    let made = of_method().filter(|row| matches!(row.outcome, Result::Made { .. })).count();
    let broken = of_method().filter(|row| !row.holds()).count();
    let refused = of_method().filter(|row| matches!(row.outcome, Result::Refused(_))).count();
    let mut text = format!(
        "<h3>{}</h3><p>{} Over all regimes {made} results, {broken} beyond a bound, and {refused} refusals with a reason.</p>",
        escaped(&failure.method),
        escaped(&failure.sentence)
    );
    for Picture { png, caption } in &failure.pictures {
        let _ = write!(
            text,
            "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption></figure>",
            escaped(caption),
            BASE64_STANDARD.encode(png)
        );
    }
    text
}

fn svg(curve: &Curve) -> String {
    let axis = |label| Axis { label, scale: Scale::Linear };
    let lines = curve.lines.iter().enumerate();
    let series = lines.map(|(index, (name, points))| {
        let point =
            |point: &super::record::Point| Point { hollow: point.gave_way, ..(point.x, point.y).into() };
        Series {
            name: name.clone(),
            colour: Some(index),
            kind: Kind::Both,
            points: points.iter().map(point).collect(),
        }
    });
    let series = series.collect();
    let (across, up) = (axis(curve.across), axis(curve.up));
    Chart { title: &curve.title, across, up, size: NARROW, names: Names::Above, series }.svg()
}

/// Regimes by codecs: one word each.
fn overview(rows: &[Row], about: &[(&str, &str)]) -> String {
    let mut text = String::from(
        "<div class=\"wide\"><table><tr><th>regime<th>what is hard<th>results<th>closest to a bound",
    );
    for &(regime, what) in about {
        let of_regime = || rows.iter().filter(move |row| row.regime == regime);
        let broken: Vec<&str> =
            of_regime().filter(|row| !row.holds()).map(|row| row.codec.as_str()).collect();
        let refused = of_regime().filter(|row| matches!(row.outcome, Result::Refused(_))).count();
        let made = of_regime().count() - refused - broken.len();
        let state = if broken.is_empty() {
            format!(
                "<span class=\"good\">{made} within bounds</span>{}",
                if refused > 0 { format!(", {refused} refused") } else { String::new() }
            )
        } else {
            format!("<span class=\"bad\">broken: {}</span>", escaped(&broken.join(", ")))
        };
        let _ = write!(
            text,
            "<tr><td>{}<td>{}<td>{state}<td>{}",
            escaped(regime),
            escaped(what),
            closest(&of_regime().collect::<Vec<_>>())
        );
    }
    text + "</table></div>"
}

/// The check of a regime that is nearest to its bound, of those whose bound is above zero.
fn closest(rows: &[&Row]) -> String {
    let checks = rows.iter().filter_map(|row| match &row.outcome {
        Result::Made { checks, .. } => Some(checks.iter().map(move |check| (row, check))),
        _ => None,
    });
    let share = |check: &Check| match check.bound {
        Bound::Most(limit) if limit > 0.0 => check.measured / limit,
        Bound::Least(limit) if limit > 0.0 => limit / check.measured,
        _ => 0.0,
    };
    let nearest = checks.flatten().max_by(|a, b| share(a.1).total_cmp(&share(b.1)));
    nearest.map_or(String::new(), |(row, check)| format!("{}: {}", escaped(&row.codec), sentence(check)))
}

fn sentence(check: &Check) -> String {
    let (side, limit) = match check.bound {
        Bound::Most(limit) => ("at most", limit),
        Bound::Least(limit) => ("at least", limit),
    };
    format!("{} {}, {side} {}", check.what, exact(check.measured), exact(limit))
}

/// A figure, small and large ones without a unit.
fn exact(value: f64) -> String {
    match value.abs() {
        size if size > 0.0 && size < 0.01 => format!("{value:.1e}"),
        size if size >= 100.0 => format!("{value:.0}"),
        _ => short(value),
    }
}

fn details(regime: &str, what: &str, rows: &[&Row]) -> String {
    let mut text = format!(
        "<details><summary><b>{}</b>: {}</summary><div class=\"wide\"><table><tr><th>codec<th>bits a texel<th>PSNR dB<th>s<th>result<th>in, out",
        escaped(regime),
        escaped(what)
    );
    for row in rows {
        let (bits, psnr, result) = match &row.outcome {
            Result::Made { verdict, psnr, bpp, checks } => {
                let line = |check: &Check| {
                    let class = if check.holds() { "good" } else { "bad" };
                    format!("<span class=\"{class}\">{}</span><br>", escaped(&sentence(check)))
                };
                (short(*bpp), short(*psnr), checks.iter().map(line).collect::<String>() + &escaped(verdict))
            }
            Result::Refused(error) => (String::new(), String::new(), format!("refused: {}", escaped(error))),
            Result::Broken(fault) => {
                (String::new(), String::new(), format!("<span class=\"bad\">{}</span>", escaped(fault)))
            }
        };
        let picture = |png: &Vec<u8>| {
            format!("<img alt=\"\" src=\"data:image/png;base64,{}\">", BASE64_STANDARD.encode(png))
        };
        let pictures: String = row.pictures.iter().map(picture).collect();
        let _ = write!(
            text,
            "<tr><td>{}<td>{bits}<td>{psnr}<td>{:.2}<td>{result}<td>{pictures}",
            escaped(&row.codec),
            row.seconds
        );
    }
    text + "</table></div></details>"
}

/// The middle of an image as a PNG file in RGBA.
///
/// # Errors
/// Where it cannot be written.
pub(super) fn png(image: &Raster) -> Outcome<Vec<u8>> {
    let size = image.size();
    let (width, height) = (size.width.min(PICTURE), size.height.min(PICTURE));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texel = |i: u32| {
        let texel = image.texel(left + i % width, top + i / width);
        texel.to_array().map(texfold::core::image::to_u8)
    };
    png_of_pixels(&(0..width * height).map(texel).collect::<Vec<_>>(), (width, height))
}

/// Pixels as a PNG file.
///
/// # Errors
/// Where it cannot be written.
pub(super) fn png_of_pixels(pixels: &[[u8; 4]], (width, height): (u32, u32)) -> Outcome<Vec<u8>> {
    let mut file = Cursor::new(Vec::new());
    PngEncoder::new(&mut file).write_image(pixels.as_flattened(), width, height, ExtendedColorType::Rgba8)?;
    Ok(file.into_inner())
}

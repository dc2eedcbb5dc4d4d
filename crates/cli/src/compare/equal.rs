//! Bits at equal quality, of all series beside a peer, and of inputs, the worst first.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use texfold_chart::escaped;

use super::chart::{Line, PERCEIVED, PSNR, Quality, lines};
use super::table::Row;

/// Series that others are compared with, where they are there.
const PEERS: [&str; 3] = ["ASTC", "BC7", "blend of three photographs"];

/// The rows of an input.
struct Input<'r> {
    name: &'r str,
    lines: Vec<Line<'r>>,
}

impl Input<'_> {
    /// Bits of a series beside those of a peer.
    fn beside(&self, series: &str, peer: &str, quality: Quality) -> Option<f64> {
        let curve =
            |name: &str| self.lines.iter().find(|line| line.name == name).map(|line| line.curve(quality));
        curve(series)?.bits_beside(&curve(peer)?)
    }

    /// The folder that the input lies in.
    fn class(&self) -> String {
        let folder = Path::new(self.name).parent().and_then(Path::file_name);
        folder.unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// Both tables; nothing where no peer was measured.
pub(super) fn tables(rows: &[Row]) -> String {
    let groups = rows.chunk_by(|a, b| a.input == b.input);
    let inputs: Vec<Input<'_>> =
        groups.map(|group| Input { name: &group[0].input, lines: lines(group) }).collect();
    let peers: Vec<&str> =
        PEERS.into_iter().filter(|peer| rows.iter().any(|row| row.series == *peer)).collect();
    let Some(&peer) = peers.first() else { return String::new() };
    let mut text = format!(
        "<h2>Bits at equal quality</h2><p>Bits of a series in percent of those of {}, over the qualities that both reach (Bjontegaard rates; geometric \
         means over the inputs where there is such a range, whose number stands behind).</p>",
        peers.join(" and of ")
    );
    text.push_str(&of_series(rows, &inputs, &peers));
    text.push_str(&of_inputs(&inputs, peer));
    text
}

/// Geometric mean of what is known, and its number.
fn mean(factors: impl Iterator<Item = Option<f64>>) -> Option<(f64, usize)> {
    let known: Vec<f64> = factors.flatten().map(f64::ln).collect();
    (!known.is_empty()).then(|| ((known.iter().sum::<f64>() / known.len() as f64).exp(), known.len()))
}

/// A factor in percent, in colour where it is a loss.
fn percent(factor: f64) -> String {
    let class = if factor > 1.0 { " class=\"worse\"" } else { "" };
    format!("<span{class}>{:.0} %</span>", 100.0 * factor)
}

fn of_series(rows: &[Row], inputs: &[Input<'_>], peers: &[&str]) -> String {
    let mut text = String::from("<div class=\"wide\"><table><tr><th>series");
    let columns = || peers.iter().flat_map(|&peer| [PSNR, PERCEIVED].map(|quality| (peer, quality)));
    for (peer, quality) in columns() {
        let _ = write!(text, "<th>{}, {peer} = 100 %", quality.name);
    }
    for line in lines(rows) {
        let cells: Vec<Option<(f64, usize)>> = columns()
            .map(|(peer, quality)| mean(inputs.iter().map(|input| input.beside(line.name, peer, quality))))
            .collect();
        if cells.iter().all(Option::is_none) {
            continue;
        }
        let _ = write!(text, "<tr><td>{}", escaped(line.name));
        for cell in cells {
            match cell {
                Some((factor, count)) => {
                    let _ = write!(text, "<td>{} ({count})", percent(factor));
                }
                None => text.push_str("<td>-"),
            }
        }
    }
    text + "</table></div>"
}

/// The best of our series on an input: bits beside a peer's, by both figures where they are known.
#[derive(Debug)]
struct Best<'i> {
    input: &'i str,
    class: String,
    series: String,
    psnr: Option<f64>,
    perceived: Option<f64>,
}

impl<'i> Best<'i> {
    fn of(input: &Input<'i>, peer: &str) -> Option<Best<'i>> {
        let best = |quality: Quality| {
            let ours = input.lines.iter().filter(|line| line.rows.iter().all(|row| is_ours(row)));
            let found = ours.filter_map(|line| Some((input.beside(line.name, peer, quality)?, line.name)));
            found.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let (psnr, perceived) = (best(PSNR), best(PERCEIVED));
        let series = perceived.or(psnr)?.1.to_owned();
        let [psnr, perceived] = [psnr, perceived].map(|best| best.map(|best| best.0));
        Some(Best { input: input.name, class: input.class(), series, psnr, perceived })
    }

    /// What inputs are in order of.
    fn factor(&self) -> f64 {
        self.perceived.or(self.psnr).unwrap_or(f64::INFINITY)
    }
}

/// Inputs and their folders with the best of our series, the worst first.
fn of_inputs(inputs: &[Input<'_>], peer: &str) -> String {
    let mut found: Vec<Best<'_>> = inputs.iter().filter_map(|input| Best::of(input, peer)).collect();
    if found.is_empty() {
        return String::new();
    }
    found.sort_by(|a, b| b.factor().total_cmp(&a.factor()));
    let mut classes: BTreeMap<&str, Vec<Option<f64>>> = BTreeMap::new();
    for best in &found {
        classes.entry(&best.class).or_default().push(Some(best.factor()));
    }
    let mut text = format!(
        "<h2>Inputs, the worst first</h2><p>The best of our series, in percent of the bits of {peer}.</p>"
    );
    if classes.len() > 1 {
        text.push_str("<div class=\"wide\"><table><tr><th>folder<th>inputs<th>percent");
        let means =
            classes.into_iter().filter_map(|(class, factors)| Some((mean(factors.into_iter())?, class)));
        let mut means: Vec<((f64, usize), &str)> = means.collect();
        means.sort_by(|a, b| b.0.0.total_cmp(&a.0.0));
        for ((factor, count), class) in means {
            let _ = write!(text, "<tr><td>{}<td>{count}<td>{}", escaped(class), percent(factor));
        }
        text.push_str("</table></div>");
    }
    text.push_str("<div class=\"wide\"><table><tr><th>input<th class=\"text\">series<th>SSIMULACRA2<th>PSNR");
    let cell = |factor: Option<f64>| factor.map_or("-".to_owned(), percent);
    for Best { input, series, psnr, perceived, .. } in &found {
        let _ = write!(
            text,
            "<tr><td>{}<td class=\"text\">{}<td>{}<td>{}",
            escaped(input),
            escaped(series),
            cell(*perceived),
            cell(*psnr)
        );
    }
    text + "</table></div>"
}

/// Whether a row is of a codec of ours, plain blocks aside.
fn is_ours(row: &Row) -> bool {
    let names = texfold::CODECS.iter().map(|codec| codec.id.name);
    names.filter(|name| *name != "bc").any(|name| name == row.codec)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::table::tests::row;

    /// Settings of a series that takes `factor` times the bits of the peer.
    fn rows(input: &str, codec: &str, series: &str, factor: f64) -> Vec<Row> {
        (0..3)
            .map(|step| Row {
                codec: codec.to_owned(),
                series: series.to_owned(),
                bpp_memory: factor * f64::from(1 << step),
                ssimulacra2: Some(50.0 + 10.0 * f64::from(step)),
                ..row(input, &step.to_string(), 30.0 + 5.0 * f64::from(step), None)
            })
            .collect()
    }

    #[test]
    fn inputs_are_in_order_of_what_the_best_series_takes() {
        let mut all = Vec::new();
        for (input, factor) in [("a/1.png", 0.5), ("a/2.png", 1.5), ("b/3.png", 0.25)] {
            all.extend(rows(input, "astc", "ASTC", 1.0));
            all.extend(rows(input, "dct", "dct", factor));
            // What is plain is nothing of ours.
            all.extend(rows(input, "bc", "BC7", 0.1));
        }
        let text = tables(&all);
        let order = ["a/2.png", "a/1.png", "b/3.png"].map(|name| text.find(name).unwrap());
        assert!(order.is_sorted(), "{text}");
        assert!(text.contains("<span class=\"worse\">150 %</span>") && text.contains("25 %"));
        // Geometric means: of folder a, and of dct on all inputs.
        assert!(
            text.contains("<td>a<td>2<td><span>87 %")
                && text.contains("<tr><td>dct<td><span>57 %</span> (3)")
        );
        assert_eq!(tables(&rows("a", "dct", "dct", 1.0)), "");
        // Captures and stacks have their best series, too.
        let blend = rows("ball", "photographs", PEERS[2], 1.0);
        let text = tables(&[blend, rows("ball", "lightfield", "light field", 0.5)].concat());
        assert!(text.contains("<tr><td>ball<td class=\"text\">light field<td><span>50 %"), "{text}");
    }
}

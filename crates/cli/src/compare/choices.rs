//! What a choice among all codecs returns, beside each codec alone at the same quality.

use std::fmt::Write;

use texfold_chart::escaped;
use texfold_core::Goal;

use super::candidate::words;
use super::suite::{AUTO, Suite};
use super::table::Row;

/// Excess over the bits of the best codec that counts as none.
const NEAR: f64 = 0.05;
/// CPU seconds of a choice beside those of the codec that it returns: a factor, and what may be added for each megatexel.
const TIME: (f64, f64) = (1.3, 1.0);
/// PSNR in dB that a codec may lack of what was asked for, as figures are rounded.
const LACKING: f64 = 0.005;

/// A choice on one input.
struct Choice<'r> {
    chosen: &'r Row,
    /// The codec with the fewest bits of those that reach the PSNR.
    best: &'r Row,
    /// The codec that was chosen, alone.
    alone: Option<&'r Row>,
}

impl Choice<'_> {
    /// Bits beyond those of the best, as a share of these; negative where the choice found fewer.
    fn excess(&self) -> f64 {
        self.chosen.bpp_memory / self.best.bpp_memory - 1.0
    }

    /// CPU seconds of the choice, and of the codec that it returned.
    fn seconds(&self) -> Option<(f64, f64)> {
        self.chosen.encode_cpu_seconds.zip(self.alone?.encode_cpu_seconds)
    }

    fn is_long(&self) -> bool {
        let (factor, more) = TIME;
        self.seconds().is_some_and(|(all, alone)| all > factor * alone + more * self.chosen.texels / 1e6)
    }
}

/// A table for each PSNR that was asked for: nothing where a choice or all codecs beside it are missing.
pub(super) fn tables(suite: &Suite, rows: &[Row]) -> String {
    let mut text = String::new();
    for goal in suite.goals(&[]) {
        let Goal::Psnr(psnr) = goal else { continue };
        let mut choices = choices(rows, &words(goal), psnr);
        if choices.is_empty() {
            continue;
        }
        choices.sort_by(|a, b| b.excess().total_cmp(&a.excess()));
        text.push_str(&table(&choices, psnr));
    }
    text
}

fn choices<'r>(rows: &'r [Row], settings: &str, psnr: f64) -> Vec<Choice<'r>> {
    let is_asked = |row: &&Row| row.settings.starts_with(settings) && row.psnr >= psnr - LACKING;
    let chosen = rows.iter().filter(|row| row.series == AUTO).filter(is_asked);
    let choice = |chosen: &'r Row| {
        let beside =
            |row: &&Row| row.input == chosen.input && row.series != AUTO && row.settings == chosen.settings;
        let others = || rows.iter().filter(beside).filter(is_asked);
        let best = others().min_by(|a, b| a.bpp_memory.total_cmp(&b.bpp_memory))?;
        Some(Choice { chosen, best, alone: others().find(|row| row.codec == chosen.codec) })
    };
    chosen.filter_map(choice).collect()
}

fn table(choices: &[Choice<'_>], psnr: f64) -> String {
    let near = choices.iter().filter(|choice| choice.excess() <= NEAR).count();
    let seconds = choices
        .iter()
        .filter_map(Choice::seconds)
        .fold((0.0, 0.0), |sum, (all, alone)| (sum.0 + all, sum.1 + alone));
    let long = choices.iter().filter(|choice| choice.is_long()).count();
    let mut text = format!(
        "<h2>Choices at {psnr} dB</h2><p>{near} of {} within {:.0} % of the fewest bits compressed of all codecs. CPU seconds of all choices {:.1}, of the \
         codecs that they return, alone, {:.1}; {long} take longer than {} times that and {} s a megatexel.</p><div class=\"wide\"><table>\
         <tr><th>input<th class=\"text\">chosen<th>bits<th class=\"text\">best<th>bits<th>more<th>CPU s<th>alone",
        choices.len(),
        100.0 * NEAR,
        seconds.0,
        seconds.1,
        TIME.0,
        TIME.1
    );
    for choice in choices {
        let Choice { chosen, best, .. } = choice;
        let class = if choice.excess() > NEAR { " class=\"worse\"" } else { "" };
        let alone = choice.seconds().map_or("-".to_owned(), |(_, alone)| format!("{alone:.2}"));
        let _ = write!(
            text,
            "<tr><td>{}<td class=\"text\">{}<td>{:.3}<td class=\"text\">{}<td>{:.3}<td><span{class}>{:.1} %</span><td>{:.2}<td>{alone}",
            escaped(&chosen.input),
            escaped(&chosen.codec),
            chosen.bpp_memory,
            escaped(&best.codec),
            best.bpp_memory,
            100.0 * choice.excess(),
            chosen.encode_cpu_seconds.unwrap_or(chosen.encode_seconds),
        );
    }
    text + "</table></div>"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::suite::find;
    use crate::compare::table::tests::row;

    #[test]
    fn choices_are_compared_with_the_codec_of_the_fewest_bits() {
        let made = |input: &str, series: &str, codec: &str, bpp: f64, psnr: f64| Row {
            series: series.to_owned(),
            codec: codec.to_owned(),
            bpp_memory: bpp,
            encode_cpu_seconds: Some(if series == AUTO { 3.0 } else { 1.0 }),
            ..row(input, "34 dB", psnr, None)
        };
        let rows = [
            made("a", AUTO, "dct", 1.0, 34.01),
            made("a", "dct", "dct", 1.0, 34.01),
            // Fewer bits, but of less quality than was asked for.
            made("a", "vq", "vq", 0.5, 33.0),
            made("b", AUTO, "dct", 1.2, 34.01),
            made("b", "dct", "dct", 1.2, 34.01),
            made("b", "epitome", "epitome", 1.0, 34.01),
        ];
        let suite = find("choices").unwrap();
        let text = tables(&suite, &rows);
        assert!(text.contains("<p>1 of 2 within 5 %") && text.contains("choices 6.0, of the"), "{text}");
        assert!(text.contains("alone, 2.0; 2 take longer"), "{text}");
        let (worst, best) = (text.find("<td>b<"), text.find("<td>a<"));
        assert!(worst < best && text.contains("<span class=\"worse\">20.0 %</span>"), "{text}");
        assert_eq!(tables(&suite, &rows[1..3]), "");
    }
}

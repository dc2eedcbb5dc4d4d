//! The rows of a comparison, as JSON, CSV and means over inputs.

use serde::Serialize;

/// One setting on one input.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Row {
    pub(crate) input: String,
    pub(crate) codec: &'static str,
    pub(crate) settings: String,
    pub(crate) bpp_memory: f64,
    pub(crate) bpp_disk: f64,
    pub(crate) psnr: f64,
    pub(crate) ssim: f64,
    /// Where it is defined ([`crate::ssimulacra2`]).
    pub(crate) ssimulacra2: Option<f64>,
    /// Where it is defined ([`crate::butteraugli`]).
    pub(crate) butteraugli: Option<f64>,
    pub(crate) encode_seconds: f64,
    /// Texels of all images, for speeds.
    #[serde(skip)]
    pub(crate) texels: f64,
    /// One thread, whole images; nothing where the decoder is not ours.
    pub(crate) decode_cpu_texels_per_second: Option<f64>,
    /// Nothing without an adapter.
    pub(crate) decode_gpu_texels_per_second: Option<f64>,
    pub(crate) random_access: u8,
    /// GPU memory where blocks are decoded whole.
    pub(crate) bpp_resident: f64,
}

const HEADER: &str = "input,codec,settings,bpp_memory,bpp_disk,psnr,ssim,encode_seconds,\
                      decode_cpu_texels_per_second,decode_gpu_texels_per_second,random_access,ssimulacra2,bpp_resident,butteraugli";

impl Row {
    /// The row for a terminal.
    pub(crate) fn line(&self) -> String {
        format!(
            "{:32} {:7} {:12} {:7.3} bpp memory {:7.3} bpp disk {:7.2} dB {:7.4} ssim {:>6} ssimulacra2 {:7.2} s",
            self.input,
            self.codec,
            self.settings,
            self.bpp_memory,
            self.bpp_disk,
            self.psnr,
            self.ssim,
            score(self.ssimulacra2),
            self.encode_seconds
        )
    }

    /// The setting and what it reaches, for captions.
    pub(crate) fn title(&self) -> String {
        format!("{} {}: {:.2} dB at {:.2} bits", self.codec, self.settings, self.psnr, self.bpp_memory)
    }

    pub(crate) fn encode_texels_per_second(&self) -> f64 {
        self.texels / self.encode_seconds.max(1e-9)
    }
}

/// SSIMULACRA2 for readers.
pub(crate) fn score(figure: Option<f64>) -> String {
    figure.map_or("-".to_owned(), |figure| format!("{figure:.1}"))
}

/// Butteraugli for readers.
pub(crate) fn difference(figure: Option<f64>) -> String {
    figure.map_or("-".to_owned(), |figure| format!("{figure:.2}"))
}

/// All rows as CSV (RFC 4180).
pub(crate) fn csv(rows: &[Row]) -> String {
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.0}"));
    let mut text = format!("{HEADER}\n");
    for row in rows {
        let fields = [
            quoted(&row.input),
            quoted(row.codec),
            quoted(&row.settings),
            format!("{:.6}", row.bpp_memory),
            format!("{:.6}", row.bpp_disk),
            format!("{:.4}", row.psnr),
            format!("{:.6}", row.ssim),
            format!("{:.6}", row.encode_seconds),
            optional(row.decode_cpu_texels_per_second),
            optional(row.decode_gpu_texels_per_second),
            row.random_access.to_string(),
            row.ssimulacra2.map_or(String::new(), |figure| format!("{figure:.4}")),
            format!("{:.6}", row.bpp_resident),
            row.butteraugli.map_or(String::new(), |figure| format!("{figure:.4}")),
        ];
        text.push_str(&fields.join(","));
        text.push('\n');
    }
    text
}

fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", field.replace('"', "\"\""));
    }
    field.to_owned()
}

/// One row for each setting: the mean over the inputs that have it, in the order of first appearance.
pub(crate) fn means(rows: &[Row]) -> Vec<Row> {
    let mut groups: Vec<(&'static str, &str, Vec<&Row>)> = Vec::new();
    for row in rows {
        match groups.iter_mut().find(|(codec, settings, _)| *codec == row.codec && *settings == row.settings)
        {
            Some((_, _, group)) => group.push(row),
            None => groups.push((row.codec, &row.settings, vec![row])),
        }
    }
    groups.into_iter().map(|(_, _, group)| mean(&group)).collect()
}

fn mean(group: &[&Row]) -> Row {
    let mean_of = |figure: &dyn Fn(&Row) -> Option<f64>| {
        let known: Vec<f64> = group.iter().filter_map(|row| figure(row)).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    };
    let figure = |figure: fn(&Row) -> f64| mean_of(&|row| Some(figure(row))).unwrap_or(0.0);
    Row {
        input: format!("mean of {}", group.len()),
        codec: group[0].codec,
        settings: group[0].settings.clone(),
        bpp_memory: figure(|row| row.bpp_memory),
        bpp_disk: figure(|row| row.bpp_disk),
        psnr: figure(|row| row.psnr),
        ssim: figure(|row| row.ssim),
        ssimulacra2: mean_of(&|row| row.ssimulacra2),
        butteraugli: mean_of(&|row| row.butteraugli),
        encode_seconds: figure(|row| row.encode_seconds),
        texels: figure(|row| row.texels),
        decode_cpu_texels_per_second: mean_of(&|row| row.decode_cpu_texels_per_second),
        decode_gpu_texels_per_second: mean_of(&|row| row.decode_gpu_texels_per_second),
        random_access: group[0].random_access,
        bpp_resident: figure(|row| row.bpp_resident),
    }
}

/// Indices of the points that no other beats: a larger `y` at an `x` that is as good or better. From the best `x` on.
pub(crate) fn front(points: &[(f64, f64)], smaller_is_better: bool) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    let sign = if smaller_is_better { 1.0 } else { -1.0 };
    order.sort_by(|&a, &b| {
        (sign * points[a].0).total_cmp(&(sign * points[b].0)).then(points[b].1.total_cmp(&points[a].1))
    });
    let mut best = f64::NEG_INFINITY;
    order.retain(|&index| {
        let better = points[index].1 > best;
        best = best.max(points[index].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(input: &str, settings: &str, psnr: f64, gpu: Option<f64>) -> Row {
        Row {
            input: input.to_owned(),
            codec: "bc",
            settings: settings.to_owned(),
            bpp_memory: 4.0,
            bpp_resident: 4.0,
            bpp_disk: 3.0,
            psnr,
            ssim: 0.9,
            ssimulacra2: Some(70.0),
            butteraugli: Some(1.5),
            encode_seconds: 0.5,
            texels: 100.0,
            decode_cpu_texels_per_second: Some(1e6),
            decode_gpu_texels_per_second: gpu,
            random_access: 1,
        }
    }

    #[test]
    fn means_are_over_the_inputs_that_have_a_setting() {
        let rows = [row("a", "x", 30.0, None), row("a", "y", 31.0, None), row("b", "x", 34.0, Some(2.0))];
        let means = means(&rows);
        let found: Vec<(&str, f64, Option<f64>)> = means
            .iter()
            .map(|row| (row.settings.as_str(), row.psnr, row.decode_gpu_texels_per_second))
            .collect();
        assert_eq!(found, [("x", 32.0, Some(2.0)), ("y", 31.0, None)]);
        assert_eq!(means[0].encode_texels_per_second(), 200.0);
    }

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points = [(4.0, 35.0), (2.0, 33.0), (3.0, 32.0), (8.0, 42.0), (2.0, 31.0)];
        assert_eq!(front(&points, true), [1, 0, 3]);
        assert_eq!(front(&points, false), [3]);
    }

    #[test]
    fn names_with_commas_are_quoted() {
        let text = csv(&[row("a,\"b\".png", "x", 30.0, None)]);
        assert_eq!(
            text.lines().nth(1),
            Some(
                "\"a,\"\"b\"\".png\",bc,x,4.000000,3.000000,30.0000,0.900000,0.500000,1000000,,1,70.0000,4.000000,1.5000"
            )
        );
        assert_eq!(text.lines().next().map(|header| header.split(',').count()), Some(14));
    }
}

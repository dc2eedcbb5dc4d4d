//! The rows of a comparison, as JSON, CSV and means over inputs.

use serde::{Deserialize, Serialize};

use crate::material_figures::MaterialFigures;

/// One setting on one input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) input: String,
    pub(crate) codec: String,
    pub(crate) settings: String,
    pub(crate) bpp_memory: f64,
    pub(crate) bpp_disk: f64,
    #[serde(deserialize_with = "infinite_without")]
    pub(crate) psnr: f64,
    pub(crate) ssim: f64,
    /// Where it is defined ([`crate::ssimulacra2`]).
    pub(crate) ssimulacra2: Option<f64>,
    /// Where it is defined ([`crate::butteraugli`]).
    pub(crate) butteraugli: Option<f64>,
    pub(crate) encode_seconds: f64,
    /// Texels of all images.
    pub(crate) texels: f64,
    /// One thread, whole images; nothing where the decoder is not ours.
    pub(crate) decode_cpu_texels_per_second: Option<f64>,
    /// Nothing without an adapter.
    pub(crate) decode_gpu_texels_per_second: Option<f64>,
    pub(crate) random_access: u8,
    /// GPU memory where blocks are decoded whole.
    pub(crate) bpp_resident: f64,
    /// The curve that it is a point of.
    pub(crate) series: String,
    /// All threads and programs together; nothing where the system does not tell.
    pub(crate) encode_cpu_seconds: Option<f64>,
    /// Columns and rows of the first image.
    pub(crate) size: (u32, u32),
    /// Effort of the encoder, in its own words; empty where it has no choice.
    pub(crate) effort: String,
    /// Of normals and of what is lit; columns of their own.
    #[serde(flatten)]
    pub(crate) material: MaterialFigures,
    /// How many inputs this is the mean of.
    #[serde(skip, default = "one")]
    pub(crate) inputs: usize,
}

fn one() -> usize {
    1
}

/// JSON has no infinite numbers: they are written as null.
fn infinite_without<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(reader)?.unwrap_or(f64::INFINITY))
}

const HEADER: &str = "input,codec,settings,bpp_memory,bpp_disk,psnr,ssim,encode_seconds,\
                      decode_cpu_texels_per_second,decode_gpu_texels_per_second,random_access,ssimulacra2,bpp_resident,butteraugli,series,encode_cpu_seconds,effort,degrees,lit_ssimulacra2";

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
        format!("{}, {}: {:.2} dB at {:.2} bits", self.series, self.settings, self.psnr, self.bpp_memory)
    }

    /// CPU seconds of encoding a megatexel.
    pub(crate) fn cpu_seconds_a_megatexel(&self) -> Option<f64> {
        self.encode_cpu_seconds.map(|seconds| seconds / self.texels * 1e6)
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
            quoted(&row.codec),
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
            quoted(&row.series),
            row.encode_cpu_seconds.map_or(String::new(), |seconds| format!("{seconds:.2}")),
            quoted(&row.effort),
            row.material.degrees.map_or(String::new(), |figure| format!("{figure:.4}")),
            row.material.lit.map_or(String::new(), |figure| format!("{figure:.4}")),
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

/// One row for each setting: mean qualities of the inputs that have it, and all their bits over all their texels, in the order of first appearance.
pub(crate) fn means(rows: &[Row]) -> Vec<Row> {
    let mut groups: Vec<(&str, &str, Vec<&Row>)> = Vec::new();
    for row in rows {
        let of = (row.series.as_str(), row.settings.as_str());
        match groups.iter_mut().find(|(series, settings, _)| (*series, *settings) == of) {
            Some((_, _, group)) => group.push(row),
            None => groups.push((of.0, of.1, vec![row])),
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
    // Sums over sums: an image of a few texels, which is all header, weighs what it is.
    let weighed = |figure: &dyn Fn(&Row) -> Option<f64>| {
        let known = group.iter().filter_map(|row| Some((figure(row)? * row.texels, row.texels)));
        let sums = known.fold((0.0, 0.0), |sums, (figure, texels)| (sums.0 + figure, sums.1 + texels));
        (sums.1 > 0.0).then(|| sums.0 / sums.1)
    };
    let bits = |figure: fn(&Row) -> f64| weighed(&|row| Some(figure(row))).unwrap_or(0.0);
    let speed = |figure: fn(&Row) -> Option<f64>| weighed(&|row| figure(row).map(f64::recip)).map(f64::recip);
    Row {
        input: String::new(),
        codec: group[0].codec.clone(),
        settings: group[0].settings.clone(),
        bpp_memory: bits(|row| row.bpp_memory),
        bpp_disk: bits(|row| row.bpp_disk),
        psnr: figure(|row| row.psnr),
        ssim: figure(|row| row.ssim),
        ssimulacra2: mean_of(&|row| row.ssimulacra2),
        butteraugli: mean_of(&|row| row.butteraugli),
        encode_seconds: figure(|row| row.encode_seconds),
        texels: figure(|row| row.texels),
        decode_cpu_texels_per_second: speed(|row| row.decode_cpu_texels_per_second),
        decode_gpu_texels_per_second: speed(|row| row.decode_gpu_texels_per_second),
        random_access: group[0].random_access,
        bpp_resident: bits(|row| row.bpp_resident),
        series: group[0].series.clone(),
        encode_cpu_seconds: mean_of(&|row| row.encode_cpu_seconds),
        size: group[0].size,
        effort: group[0].effort.clone(),
        material: MaterialFigures {
            degrees: mean_of(&|row| row.material.degrees),
            lit: mean_of(&|row| row.material.lit),
        },
        inputs: group.len(),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::compare) fn row(input: &str, settings: &str, psnr: f64, gpu: Option<f64>) -> Row {
        Row {
            input: input.to_owned(),
            codec: "bc".to_owned(),
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
            series: "BC1, x".to_owned(),
            encode_cpu_seconds: Some(0.75),
            size: (10, 10),
            effort: "fast".to_owned(),
            material: MaterialFigures { degrees: Some(1.5), lit: None },
            inputs: 1,
        }
    }

    #[test]
    fn means_are_over_the_inputs_that_have_a_setting() {
        let rows = [row("a", "x", 30.0, None), row("a", "y", 31.0, None), row("b", "x", 34.0, Some(2.0))];
        // Bits are over all texels: a large image weighs more.
        let large = Row { texels: 300.0, bpp_memory: 8.0, ..row("c", "x", 32.0, None) };
        let of_all = means(&[rows.to_vec(), vec![large]].concat());
        assert_eq!((of_all[0].bpp_memory, of_all[0].psnr, of_all[0].texels), (6.4, 32.0, 500.0 / 3.0));
        // A setting of that name of another series is another one.
        let other = Row { series: "other".to_owned(), ..row("a", "x", 99.0, None) };
        assert_eq!(means(&[rows.to_vec(), vec![other]].concat()).len(), 3);
        let means = means(&rows);
        let found: Vec<(&str, f64, Option<f64>)> = means
            .iter()
            .map(|row| (row.settings.as_str(), row.psnr, row.decode_gpu_texels_per_second))
            .collect();
        assert_eq!(found, [("x", 32.0, Some(2.0)), ("y", 31.0, None)]);
        assert_eq!((means[0].inputs, means[1].inputs), (2, 1));
        assert_eq!(means[0].cpu_seconds_a_megatexel(), Some(7500.0));
    }

    #[test]
    fn names_with_commas_are_quoted() {
        let text = csv(&[row("a,\"b\".png", "x", 30.0, None)]);
        assert_eq!(
            text.lines().nth(1),
            Some(
                "\"a,\"\"b\"\".png\",bc,x,4.000000,3.000000,30.0000,0.900000,0.500000,1000000,,1,70.0000,4.000000,1.5000,\"BC1, x\",0.75,fast,1.5000,"
            )
        );
        assert_eq!(text.lines().next().map(|header| header.split(',').count()), Some(19));
    }
}

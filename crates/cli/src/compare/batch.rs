//! Rows as codec-compare reads them (github.com/webmproject/codec-compare): a file for each series, and a list of these.

use serde_json::{Value, json};

use super::chart::{CEILING_DB, Line};
use super::table::Row;

/// The batch of a series on all inputs.
pub(super) fn batch(line: &Line<'_>) -> Value {
    let fields: Vec<Field> =
        FIELDS.into_iter().filter(|field| line.rows.iter().all(|row| (field.2)(row).is_some())).collect();
    let described =
        |name: &str, what: &str| Value::Object([(name.to_owned(), json!(what))].into_iter().collect());
    let seconds = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let constants = [
        ("name", "Name of the series", line.name.to_owned()),
        ("codec", "Name of the codec", line.rows[0].codec.clone()),
        ("version", "Version of Texfold", env!("CARGO_PKG_VERSION").to_owned()),
        ("time", "Seconds since 1970", seconds.map_or(0, |time| time.as_secs()).to_string()),
    ];
    json!({
        "constant_descriptions": constants.iter().map(|(name, what, _)| described(name, what)).collect::<Vec<_>>(),
        "constant_values": constants.iter().map(|(_, _, value)| value).collect::<Vec<_>>(),
        "field_descriptions": fields.iter().map(|(name, what, _)| described(name, what)).collect::<Vec<_>>(),
        "field_values": line.rows.iter().map(|row| {
            fields.iter().map(|(_, _, value)| value(row)).collect::<Vec<_>>()
        }).collect::<Vec<_>>(),
    })
}

/// Name, description and value; a field that a row lacks is left out.
type Field = (&'static str, &'static str, fn(&Row) -> Option<Value>);

const FIELDS: [Field; 16] = [
    ("original_name", "Input", |row| Some(json!(row.input))),
    ("settings", "Settings of the codec", |row| Some(json!(row.settings))),
    ("effort", "Effort of the encoder", |row| Some(json!(row.effort))),
    ("width", "Pixel columns of the first image", |row| Some(json!(row.size.0))),
    ("height", "Pixel rows of the first image", |row| Some(json!(row.size.1))),
    ("encoded_size", "Bytes of the file", |row| Some(json!((row.bpp_disk * row.texels / 8.0).round()))),
    ("memory_size", "Bytes that a GPU holds, compressed", |row| {
        Some(json!((row.bpp_memory * row.texels / 8.0).round()))
    }),
    ("psnr", "Peak signal-to-noise ratio in dB, up to 60", |row| Some(json!(row.psnr.min(CEILING_DB)))),
    ("ssim", "Structural similarity", |row| Some(json!(row.ssim))),
    ("ssimulacra2", "SSIMULACRA 2", |row| row.ssimulacra2.map(|figure| json!(figure))),
    ("butteraugli", "Butteraugli, 3-norm", |row| row.butteraugli.map(|figure| json!(figure))),
    ("degrees", "Mean angle between normals", |row| row.material.degrees.map(|figure| json!(figure))),
    ("lit_ssimulacra2", "SSIMULACRA 2 of the lit surface", |row| {
        row.material.lit.map(|figure| json!(figure))
    }),
    ("encoding_time", "Seconds of encoding", |row| Some(json!(row.encode_seconds))),
    ("encoding_cpu_time", "CPU seconds of encoding", |row| {
        row.encode_cpu_seconds.map(|figure| json!(figure))
    }),
    ("decoding_time", "Seconds of decoding on one thread", |row| {
        row.decode_cpu_texels_per_second.map(|speed| json!(row.texels / speed))
    }),
];

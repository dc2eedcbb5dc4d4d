//! What golden files load to: planes, parameters and blocks by their hashes, whole and cut.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use texfold::core::container::Sections;
use texfold::core::{Budget, GpuDct, GpuForm, Plane};
use texfold::{AnyTexture, Encoded as _};
use texfold_testkit::capture::{Look, sphere};

/// All golden files: for each what it loads to, and what its prefixes load to that end with a section or a byte before.
pub(crate) fn golden(folder: &Path) -> io::Result<String> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "txf") {
            paths.push(path);
        }
    }
    paths.sort();
    let mut lines = Vec::new();
    for path in paths {
        let bytes = fs::read(&path)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut found = loaded(&bytes);
        let mut budget = Budget::default();
        let ends: Vec<u64> =
            Sections::parse(&bytes, &mut budget).map(|file| file.ends().collect()).unwrap_or_default();
        let cuts = ends.iter().flat_map(|&end| [end as usize - 1, end as usize]);
        let prefixes = cuts.filter(|&cut| cut < bytes.len()).map(|cut| {
            let mut found = loaded(&bytes[..cut]);
            found["bytes"] = cut.into();
            found
        });
        found["prefixes"] = prefixes.collect();
        if let Some(camera) = camera(&bytes) {
            found["camera"] = camera;
        }
        lines.push(format!("{}: {found}", Value::from(name)));
    }
    Ok(format!("{{\n{}\n}}\n", lines.join(",\n")))
}

/// The camera that the golden picture of a light field was drawn with: the eighth of its capture.
fn camera(bytes: &[u8]) -> Option<Value> {
    let light = texfold::open(bytes).ok()?.into_light().ok()?;
    let camera = sphere(Look::Glossy, 20, 40).views.get(7)?.camera;
    let (near, far) = light.mesh().depths(&camera);
    let matrix = camera.view_projection(near, far).to_cols_array();
    Some(
        json!({ "viewProjection": matrix, "eye": camera.eye().to_array(), "size": [camera.width, camera.height] }),
    )
}

/// What bytes load to: the form, or the error.
fn loaded(bytes: &[u8]) -> Value {
    match texfold::open(bytes) {
        Ok(texture) => json!({ "form": described(&texture) }),
        Err(error) => json!({ "error": error.to_string() }),
    }
}

fn described(texture: &AnyTexture) -> Value {
    let (form, layers) = match texture {
        AnyTexture::Image(image) => (image.as_encoded().gpu(), image.as_encoded().layers()),
        AnyTexture::Light(light) => (light.gpu(), light.layers()),
    };
    json!({ "layers": [layers.loaded, layers.total], "compressed": form.memory().compressed, "form": form_of(&form) })
}

fn form_of(form: &GpuForm<'_>) -> Value {
    let images = form.images.iter().map(|image| {
        json!({ "planes": image.planes, "uniforms": [image.uniforms.start, image.uniforms.end], "image": image.image })
    });
    json!({
        "module": form.module,
        "uniforms": hash(&form.uniforms),
        "planes": form.planes.iter().map(plane).collect::<Value>(),
        "images": images.collect::<Value>(),
        "blocks": form.blocks.iter().map(blocks).collect::<Value>(),
    })
}

fn plane(plane: &Plane<'_>) -> Value {
    json!({
        "part": plane.part,
        "format": plane.format.name(),
        "width": plane.width,
        "height": plane.height,
        "levels": plane.levels,
        "data": hash(&plane.data),
    })
}

fn blocks(blocks: &GpuDct<'_>) -> Value {
    let layout = &blocks.layout;
    let words: Vec<u8> = blocks.words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let channels = layout.channels.iter().map(|channel| {
        json!({ "mean": channel.mean, "firstAxis": channel.first_axis, "weights": channel.weights })
    });
    let held: u64 = blocks.held_bytes.iter().map(|(_, bytes)| bytes).sum();
    json!({
        "layout": {
            "size": { "width": layout.size.width, "height": layout.size.height },
            "depth": layout.depth,
            "superblockLog2": layout.superblock_log2,
            "baseLog2": layout.base_log2,
            "ranks": layout.ranks,
            "channels": channels.collect::<Value>(),
            "shift": layout.shift,
            "offsets": layout.offsets,
            "isDependent": layout.is_dependent,
            "hasModes": layout.has_modes,
            "steps": layout.steps,
            "index": layout.index,
            "indexBits": layout.index_bits,
            "streamBytes": layout.stream_bytes,
            "isLight": layout.average.is_light,
            "isWeighted": layout.average.is_weighted,
            "deblocking": layout.deblocking,
        },
        "words": hash(&words),
        "streams": hash(blocks.streams),
        "headBytes": held - blocks.streams.len() as u64,
        "image": blocks.image,
        "level": blocks.level,
        "levels": blocks.levels,
        "row": blocks.row,
    })
}

/// The first 8 bytes of the BLAKE3, as the package computes it: a number in hexadecimal digits, the first byte lowest.
fn hash(bytes: &[u8]) -> String {
    let hash = blake3::hash(bytes);
    hash.as_bytes()[..8].iter().rev().map(|byte| format!("{byte:02x}")).collect()
}

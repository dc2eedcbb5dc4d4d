//! glTF scenes as they are written: JSON that is kept with all that is not known here, and the bytes that it names.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use base64::engine::Engine;
use gltf::binary::{Glb, Header};
use percent_encoding::percent_decode_str;
use serde_json::{Value, json};
use texfold_capture::BASE64;

use crate::error::CliError;
use crate::{files, memory};

/// A scene.
#[derive(Debug)]
pub(super) struct Scene {
    path: PathBuf,
    pub(super) json: Value,
    views: Vec<View>,
}

/// The bytes of a buffer view.
#[derive(Debug)]
struct View {
    /// `None` where they are there in compressed form alone.
    plain: Option<Vec<u8>>,
    /// The bytes that meshopt's extension names, as they are, and the extension's name.
    compressed: Option<(String, Vec<u8>)>,
}

impl Scene {
    /// Reads a `.glb` or `.gltf` file, with the buffers that lie beside it.
    pub(super) fn read(path: &Path, limit_bytes: u64) -> Result<Scene, CliError> {
        let bytes = files::read(path)?;
        let wrong = |source: Box<dyn std::error::Error + Send + Sync>| CliError::SceneSyntax {
            path: path.to_owned(),
            source,
        };
        let (text, blob) = if bytes.starts_with(b"glTF") {
            let glb = Glb::from_slice(&bytes).map_err(|source| wrong(source.into()))?;
            (glb.json, glb.bin)
        } else {
            (Cow::Borrowed(&bytes[..]), None)
        };
        let json: Value = serde_json::from_slice(&text).map_err(|source| wrong(source.into()))?;
        let scene = Scene { path: path.to_owned(), json, views: Vec::new() };
        if !scene.json["asset"]["version"].as_str().is_some_and(|version| version.starts_with("2.")) {
            return Err(scene.fault("is not of glTF 2"));
        }
        let buffers = scene.list("buffers").iter().enumerate();
        let buffers = buffers.map(|(index, buffer)| scene.buffer(index, buffer, blob.as_deref()));
        let buffers = buffers.collect::<Result<Vec<_>, CliError>>()?;
        // Part of a buffer; `None` of one that has no bytes.
        let part = |place: &Value| -> Result<Option<Vec<u8>>, CliError> {
            let number = |name: &str| place[name].as_u64().and_then(|number| usize::try_from(number).ok());
            let start = number("byteOffset").unwrap_or(0);
            let end = number("byteLength").and_then(|length| start.checked_add(length));
            let buffer = number("buffer").and_then(|buffer| buffers.get(buffer));
            let Some(Some(buffer)) = buffer else {
                return buffer.map(|_| None).ok_or_else(|| scene.fault("names a buffer that it lacks"));
            };
            let bytes = end.and_then(|end| buffer.get(start..end)).map(<[u8]>::to_vec);
            bytes.map(Some).ok_or_else(|| scene.fault("has a part of a buffer that is not there"))
        };
        let view = |view: &Value| -> Result<View, CliError> {
            let extension = meshopt(view).map(|(name, extension)| {
                part(extension)?.map(|bytes| (name.to_owned(), bytes)).ok_or_else(|| scene.fault(LACKS))
            });
            let (plain, compressed) = (part(view)?, extension.transpose()?);
            if plain.is_none() && compressed.is_none() {
                return Err(scene.fault(LACKS));
            }
            Ok(View { plain, compressed })
        };
        // Parts may overlap: many of a large buffer would fill memory.
        let views = scene.list("bufferViews");
        let lengths = views.iter().chain(views.iter().filter_map(|view| meshopt(view).map(|(_, part)| part)));
        let needed = lengths.filter_map(|part| part["byteLength"].as_u64()).fold(0, u64::saturating_add);
        memory::check(path, needed.saturating_mul(2), limit_bytes.max(memory::ALWAYS_ALLOWED))?;
        let views = views.iter().map(view).collect::<Result<Vec<_>, CliError>>()?;
        Ok(Scene { views, ..scene })
    }

    /// An error about the scene.
    pub(super) fn fault(&self, what: &'static str) -> CliError {
        CliError::Scene { path: self.path.clone(), what }
    }

    /// The members of a list of the scene; none where it has none.
    pub(super) fn list(&self, name: &str) -> &[Value] {
        self.json[name].as_array().map_or(&[], Vec::as_slice)
    }

    /// The bytes of a buffer; `None` of one whose views are there in compressed form alone.
    fn buffer<'b>(
        &self,
        index: usize,
        buffer: &Value,
        blob: Option<&'b [u8]>,
    ) -> Result<Option<Cow<'b, [u8]>>, CliError> {
        match (buffer["uri"].as_str(), blob) {
            (Some(uri), _) => self.named(uri).map(Cow::Owned).map(Some),
            (None, _) if meshopt(buffer).is_some_and(|(_, extension)| extension["fallback"] == true) => {
                Ok(None)
            }
            (None, Some(blob)) if index == 0 => Ok(Some(Cow::Borrowed(blob))),
            _ => Err(self.fault(LACKS)),
        }
    }

    /// What a URI names: bytes within it, or a file in the folder of the scene.
    fn named(&self, uri: &str) -> Result<Vec<u8>, CliError> {
        if let Some(data) = uri.strip_prefix("data:") {
            let text = data.split_once(";base64,").map(|(_, text)| text);
            return text
                .and_then(|text| BASE64.decode(text).ok())
                .ok_or_else(|| self.fault("has data that is no base64"));
        }
        let name = PathBuf::from(percent_decode_str(uri).decode_utf8_lossy().as_ref());
        let is_inside = name.components().all(|part| matches!(part, std::path::Component::Normal(_)));
        if uri.contains("://") || !is_inside {
            return Err(CliError::Outside { path: self.path.clone(), file: name });
        }
        files::read(&self.path.parent().unwrap_or(Path::new("")).join(name))
    }

    /// The bytes of an image's file.
    pub(super) fn image(&self, index: usize) -> Result<Vec<u8>, CliError> {
        let image =
            self.list("images").get(index).ok_or_else(|| self.fault("names an image that it lacks"))?;
        if let Some(uri) = image["uri"].as_str() {
            return self.named(uri);
        }
        let view = image["bufferView"].as_u64().and_then(|view| self.views.get(view as usize));
        view.and_then(|view| view.plain.clone()).ok_or_else(|| self.fault("has an image without bytes"))
    }

    /// Puts the bytes of a file in the place of an image's, or adds an image where there is none of that number; gives its number.
    pub(super) fn put_image(&mut self, index: Option<usize>, mime_type: &str, bytes: Vec<u8>) -> usize {
        self.views.push(View { plain: Some(bytes), compressed: None });
        let view = self.views.len() - 1;
        let views = array_of(&mut self.json, "bufferViews");
        views.push(json!({ "buffer": 0 }));
        let images = array_of(&mut self.json, "images");
        let number = index.filter(|&index| index < images.len()).unwrap_or_else(|| {
            images.push(json!({}));
            images.len() - 1
        });
        if let Some(image) = images[number].as_object_mut() {
            image.remove("uri");
            image.insert("bufferView".to_owned(), view.into());
            image.insert("mimeType".to_owned(), mime_type.into());
        }
        number
    }

    /// Embeds images that lie beside the scene and that textures name: from another folder their names lead nowhere.
    pub(super) fn take_images(&mut self) -> Result<(), CliError> {
        let mut textures = Value::Array(self.list("textures").to_vec());
        let named = renumber(&mut textures, "source", self.list("images").len());
        for index in (0..named.len()).filter(|&index| named[index]) {
            let image = &self.list("images")[index];
            let is_beside = |uri: &&str| !uri.starts_with("data:") && !uri.contains("://");
            if image["uri"].as_str().filter(is_beside).is_none() {
                continue;
            }
            let bytes = self.image(index)?;
            let mime_type = if bytes.starts_with(b"\xABKTX 20") {
                "image/ktx2"
            } else {
                let format = image::guess_format(&bytes);
                format.map_err(|_| self.fault("names an image whose format is not known"))?.to_mime_type()
            };
            self.put_image(Some(index), mime_type, bytes);
        }
        Ok(())
    }

    /// Names an extension in a list of them, once.
    pub(super) fn name_extension(&mut self, list: &str, name: &str) {
        let names = array_of(&mut self.json, list);
        if !names.iter().any(|known| known == name) {
            names.push(name.into());
        }
    }

    /// Removes extensions of textures that no texture has any longer from the lists of extensions: none that is not used may be required.
    pub(super) fn forget_unused(&mut self) {
        for list in ["extensionsUsed", "extensionsRequired"] {
            let textures = self.list("textures").to_vec();
            let is_used = |name: &Value| {
                let has = |texture: &Value| {
                    name.as_str().is_some_and(|name| !texture["extensions"][name].is_null())
                };
                !name.as_str().is_some_and(is_of_textures) || textures.iter().any(has)
            };
            array_of(&mut self.json, list).retain(is_used);
            self.drop_empty(list);
        }
    }

    fn drop_empty(&mut self, list: &str) {
        if self.list(list).is_empty()
            && let Some(root) = self.json.as_object_mut()
        {
            root.remove(list);
        }
    }

    /// The scene as the bytes of a `.glb` file, without images and parts of buffers that nothing names.
    pub(super) fn into_glb(mut self) -> Result<Vec<u8>, CliError> {
        // Images are named by textures alone, parts of buffers from anywhere.
        let count = self.list("images").len();
        let kept = match self.json.get_mut("textures") {
            Some(textures) => renumber(textures, "source", count),
            None => vec![false; count],
        };
        keep(array_of(&mut self.json, "images"), &kept);
        self.drop_empty("images");
        let kept = renumber(&mut self.json, "bufferView", self.views.len());
        keep(&mut self.views, &kept);
        keep(array_of(&mut self.json, "bufferViews"), &kept);
        let mut blob: Vec<u8> = Vec::new();
        let mut place = |bytes: &[u8]| {
            blob.resize(blob.len().next_multiple_of(4), 0);
            blob.extend(bytes);
            (blob.len() - bytes.len(), bytes.len())
        };
        // A buffer without bytes, which views that are there in compressed form alone lie in.
        let mut absent: Option<(String, u64)> = None;
        for (view, bytes) in array_of(&mut self.json, "bufferViews").iter_mut().zip(&self.views) {
            if let Some((name, bytes)) = &bytes.compressed {
                let (start, length) = place(bytes);
                let extension = &mut view["extensions"][name.as_str()];
                (extension["buffer"], extension["byteOffset"], extension["byteLength"]) =
                    (0.into(), start.into(), length.into());
            }
            match (&bytes.plain, &bytes.compressed) {
                (None, Some((name, _))) => {
                    let start = absent.map_or(0, |(_, end)| end.div_ceil(4).saturating_mul(4));
                    (view["buffer"], view["byteOffset"]) = (1.into(), start.into());
                    let length = view["byteLength"].as_u64().unwrap_or(0);
                    absent = Some((name.clone(), start.saturating_add(length)));
                }
                (plain, _) => {
                    let (start, length) = place(plain.as_deref().unwrap_or_default());
                    (view["buffer"], view["byteOffset"], view["byteLength"]) =
                        (0.into(), start.into(), length.into());
                }
            }
        }
        self.drop_empty("bufferViews");
        self.json["buffers"] = json!([{ "byteLength": blob.len() }]);
        if let Some((name, length)) = absent {
            let without = json!({ "byteLength": length, "extensions": { name: { "fallback": true } } });
            array_of(&mut self.json, "buffers").push(without);
        }
        if blob.is_empty() {
            array_of(&mut self.json, "buffers").clear();
            self.drop_empty("buffers");
        }
        let fault = |source: Box<dyn std::error::Error + Send + Sync>| CliError::SceneSyntax {
            path: self.path.clone(),
            source,
        };
        let text = serde_json::to_vec(&self.json).map_err(|source| fault(source.into()))?;
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        let bin = (!blob.is_empty()).then_some(Cow::Owned(blob));
        Glb { header, json: Cow::Owned(text), bin }.to_vec().map_err(|source| fault(source.into()))
    }
}

/// The fault of a scene without the bytes of a buffer.
const LACKS: &str = "lacks a buffer";

/// The extension by which meshopt compresses a buffer view, or marks a buffer without bytes: `EXT_` or `KHR_meshopt_compression`.
fn meshopt(json: &Value) -> Option<(&str, &Value)> {
    let extensions = json["extensions"].as_object()?;
    let found = extensions.iter().find(|(name, _)| name.ends_with("_meshopt_compression"));
    found.map(|(name, extension)| (name.as_str(), extension))
}

/// Whether an extension of that name gives a texture another image.
pub(super) fn is_of_textures(name: &str) -> bool {
    name.contains("_texture_") && !name.ends_with("_transform") || name.ends_with("_texture")
}

/// The list of that name, which is made where there is none.
fn array_of<'j>(json: &'j mut Value, name: &str) -> &'j mut Vec<Value> {
    if !json[name].is_array() {
        json[name] = Value::Array(Vec::new());
    }
    match &mut json[name] {
        Value::Array(list) => list,
        _ => unreachable!("it was made a list"),
    }
}

/// Gives the members of a list of `count` that are named by `key` anywhere in `json` numbers without gaps; returns whether each is named.
fn renumber(json: &mut Value, key: &str, count: usize) -> Vec<bool> {
    let mut named = vec![false; count];
    each_number(json, key, &mut |number| {
        if let Some(named) = named.get_mut(*number as usize) {
            *named = true;
        }
    });
    let mut next = 0;
    let numbers: BTreeMap<u64, u64> = (0u64..)
        .zip(&named)
        .filter(|(_, named)| **named)
        .map(|(number, _)| {
            next += 1;
            (number, next - 1)
        })
        .collect();
    each_number(json, key, &mut |number| {
        if let Some(&new) = numbers.get(number) {
            *number = new;
        }
    });
    named
}

/// Calls `see` with each number that is a member of that name, anywhere in `json` but in what applications keep for themselves.
fn each_number(json: &mut Value, key: &str, see: &mut dyn FnMut(&mut u64)) {
    match json {
        Value::Array(list) => list.iter_mut().for_each(|member| each_number(member, key, see)),
        Value::Object(members) => {
            for (name, member) in members.iter_mut().filter(|(name, _)| *name != "extras") {
                match member.as_u64().filter(|_| name == key) {
                    Some(mut number) => {
                        see(&mut number);
                        *member = number.into();
                    }
                    None => each_number(member, key, see),
                }
            }
        }
        _ => {}
    }
}

fn keep<T>(list: &mut Vec<T>, kept: &[bool]) {
    let mut kept = kept.iter();
    list.retain(|_| kept.next().is_none_or(|&kept| kept));
}

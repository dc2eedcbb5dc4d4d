//! Content of a window.

#[path = "../../gpu/examples/support/archive.rs"]
mod archive;

use std::error::Error;
use std::path::Path;

use glam::{Mat4, Vec2, Vec3};
use texfold::bank::{Bank, MANIFEST};
use texfold::zipmap::ZipTexture;
use texfold::{AnyImage, AnyTexture, Encoded, core::ImageSize};
use texfold_gpu::{
    AddressMode, Gpu, GpuLight, GpuTexture, TileCache, TileLook, TileOptions, TileWatch, wgpu,
};
use texfold_shaders::Entry;

use crate::draw::{Corner, Drawing, Mesh, Params, TILED};
use crate::orbit::Orbit;
use archive::Archive;

/// Compressed streams of a bank that are held.
const STREAM_BYTES: u64 = 64 << 20;

/// Something to draw.
pub(crate) struct Content {
    name: String,
    drawing: Drawing,
    kind: Kind,
}

enum Kind {
    /// Images of any codec from a cache of tiles.
    Images {
        cache: Box<TileCache>,
        mesh: Mesh,
        image: u32,
        images: u32,
    },
    /// Photographs to zoom into, by the codec's own shader: a cache ends at the texels of the root.
    Stack {
        texture: GpuTexture,
        mesh: Mesh,
    },
    Light {
        light: Box<GpuLight>,
    },
    Bank {
        bank: Bank,
        archive: Box<Archive>,
        mesh: Mesh,
        watch: Option<TileWatch>,
    },
}

/// Opens the file and forgets it: its faults are told before there is a window.
pub(crate) fn check(path: &Path) -> Result<(), Box<dyn Error>> {
    if path.join(MANIFEST).is_file() {
        Bank::open(path).map(|_: Bank| ())?
    } else {
        open(path).map(|_| ())?
    }
    Ok(())
}

fn open(path: &Path) -> Result<AnyTexture, Box<dyn Error>> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    texfold::open(&bytes).map_err(|error| format!("{}: {error}", path.display()).into())
}

impl Content {
    /// A file or bank, and a camera that sees it.
    pub(crate) fn open(
        gpu: &Gpu,
        path: &Path,
        mesh: Option<&Path>,
        format: wgpu::TextureFormat,
    ) -> Result<(Content, Orbit), Box<dyn Error>> {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let (kind, drawing, orbit) = if path.join(MANIFEST).is_file() {
            of_bank(gpu, Bank::open(path)?, format)?
        } else {
            match open(path)? {
                AnyTexture::Light(light) => of_light(gpu, &light, format)?,
                AnyTexture::Image(image) if image.downcast_ref::<ZipTexture>().is_some() => {
                    of_stack(gpu, &image, format)?
                }
                AnyTexture::Image(image) => of_images(gpu, &image, mesh, format)?,
            }
        };
        Ok((Content { name, drawing, kind }, orbit))
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Bytes on the GPU, meshes left out.
    pub(crate) fn bytes(&self) -> u64 {
        match &self.kind {
            Kind::Images { cache, .. } => cache.bytes(),
            Kind::Stack { texture, .. } => texture.bytes(),
            Kind::Light { light } => light.bytes(),
            Kind::Bank { archive, .. } => archive.cache.bytes(),
        }
    }

    /// Draws it in a pass.
    pub(crate) fn draw(&self, gpu: &Gpu, pass: &mut wgpu::RenderPass<'_>, projection: Mat4, eye: Vec3) {
        let params = match &self.kind {
            Kind::Light { .. } => Params::of_eye(projection, eye),
            Kind::Images { image, .. } => Params::of_image(projection, *image),
            Kind::Stack { texture, .. } => {
                Params::of_image(projection, texture.bind_group(0).map_or(0, |(_, place)| place))
            }
            Kind::Bank { .. } => Params::of_image(projection, 0),
        };
        self.drawing.begin(gpu, pass, &params);
        match &self.kind {
            Kind::Images { cache, mesh, .. } => {
                pass.set_bind_group(0, cache.bind_group(), &[]);
                mesh.draw(pass);
            }
            Kind::Stack { texture, mesh } => {
                let Ok((group, _)) = texture.bind_group(0) else { return };
                pass.set_bind_group(0, group, &[]);
                mesh.draw(pass);
            }
            Kind::Light { light } => {
                pass.set_bind_group(0, light.bind_group(), &[]);
                pass.draw(0..3 * light.triangles(), 0..1);
            }
            Kind::Bank { archive, mesh, .. } => {
                pass.set_bind_group(0, archive.cache.bind_group(), &[]);
                mesh.draw(pass);
            }
        }
    }

    /// Records what follows the pass.
    pub(crate) fn update(&self, encoder: &mut wgpu::CommandEncoder) {
        match &self.kind {
            Kind::Images { cache, .. } => cache.update(encoder),
            Kind::Bank { archive, .. } => archive.cache.update(encoder),
            Kind::Stack { .. } | Kind::Light { .. } => {}
        }
    }

    /// Reads files of a bank that were looked at.
    pub(crate) fn read(&mut self, gpu: &Gpu, frame: u32) -> Result<(), Box<dyn Error>> {
        let Kind::Bank { bank, archive, watch, .. } = &mut self.kind else { return Ok(()) };
        let Some(begun) = watch else {
            *watch = Some(archive.cache.watch(gpu)?);
            return Ok(());
        };
        if let Some(uses) = begun.poll(gpu)? {
            archive.read(gpu, bank, &uses, frame)?;
            *watch = None;
        }
        Ok(())
    }

    /// Shows another image of a file.
    pub(crate) fn turn_over(&mut self, by: i32) {
        if let Kind::Images { image, images, .. } = &mut self.kind {
            *image = image.wrapping_add_signed(by).min(u32::MAX - 1) % *images;
        }
    }

    /// Draws a light field with so many terms beside the mean.
    pub(crate) fn set_terms(&self, terms: u32) {
        if let Kind::Light { light } = &self.kind {
            light.set_terms(terms);
        }
    }
}

type Made = (Kind, Drawing, Orbit);

/// Corners and triangles.
type Shape = (Vec<Corner>, Vec<[u32; 3]>);

fn of_images(
    gpu: &Gpu,
    image: &AnyImage,
    mesh: Option<&Path>,
    format: wgpu::TextureFormat,
) -> Result<Made, Box<dyn Error>> {
    let texture = image.as_encoded();
    let sizes = &texture.layout().images;
    let held: u64 = texfold_gpu::TileBytes::of(texture).held;
    let texels: u64 = sizes.iter().map(|size| u64::from(size.width) * u64::from(size.height)).sum();
    let options = TileOptions {
        stream_bytes: held + (1 << 20),
        textures: sizes.len() as u32,
        pages: (texels / 4096 + 64 * sizes.len() as u64).min(1 << 22) as u32,
        scratch_bytes: 64 << 20,
        pool_bytes: (64 << 20) + ((sizes.len() as u64) << 16),
        anisotropy: if gpu.info().device_type == wgpu::DeviceType::Cpu { 1 } else { 4 },
        ..TileOptions::default()
    };
    let mut cache = Box::new(TileCache::new(gpu, &options)?);
    let address = if mesh.is_some() { AddressMode::Repeat } else { AddressMode::Clamp };
    cache.add(gpu, texture, TileLook { address, srgb: false })?;
    let source = [&cache.wgsl(0), TILED].concat();
    let drawing = Drawing::new(gpu, source, cache.bind_group_layout(), true, format);
    let (corners, triangles) = match mesh {
        Some(path) => model(path)?,
        None => wall(sizes[0]),
    };
    let orbit = around(&corners);
    let mesh = Mesh::new(gpu, &corners, &triangles);
    Ok((Kind::Images { cache, mesh, image: 0, images: sizes.len() as u32 }, drawing, orbit))
}

fn of_stack(gpu: &Gpu, image: &AnyImage, format: wgpu::TextureFormat) -> Result<Made, Box<dyn Error>> {
    let texture = gpu.upload(&image.as_encoded().gpu())?;
    let source = texfold_shaders::entry(texture.module(), Entry::Mesh);
    let drawing = Drawing::new(gpu, source, gpu.bind_group_layout(texture.module()), true, format);
    let (corners, triangles) = wall(image.as_encoded().layout().images[0]);
    let orbit = around(&corners);
    let mesh = Mesh::new(gpu, &corners, &triangles);
    Ok((Kind::Stack { texture, mesh }, drawing, orbit))
}

fn of_light(
    gpu: &Gpu,
    light: &texfold::lightfield::LightTexture,
    format: wgpu::TextureFormat,
) -> Result<Made, Box<dyn Error>> {
    let corners: Vec<Vec3> = light.mesh().positions.clone();
    let light = Box::new(gpu.upload_light(&light.gpu())?);
    let source = texfold_shaders::light(light.module());
    let drawing = Drawing::new(gpu, source, gpu.bind_group_layout(light.module()), false, format);
    let orbit = sphere(&corners, 0.3);
    Ok((Kind::Light { light }, drawing, orbit))
}

fn of_bank(gpu: &Gpu, bank: Bank, format: wgpu::TextureFormat) -> Result<Made, Box<dyn Error>> {
    let archive = Box::new(Archive::new(gpu, &bank, STREAM_BYTES, false)?);
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for placed in archive.placed() {
        let first = corners.len() as u32;
        triangles.extend([[0, 1, 2], [2, 1, 3]].map(|corner| corner.map(|number| first + number)));
        for uv in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE] {
            let across = uv * placed.size;
            let position = placed.corner + Vec3::new(across.x, 0.0, across.y);
            corners.push(Corner { position, uv, texture: placed.texture });
        }
    }
    let source = [&archive.cache.wgsl(0), TILED].concat();
    let drawing = Drawing::new(gpu, source, archive.cache.bind_group_layout(), true, format);
    let positions: Vec<Vec3> = corners.iter().map(|corner| corner.position).collect();
    let mesh = Mesh::new(gpu, &corners, &triangles);
    Ok((Kind::Bank { bank, archive, mesh, watch: None }, drawing, sphere(&positions, 1.2)))
}

/// An upright rectangle of the shape of an image.
fn wall(size: ImageSize) -> Shape {
    let shape = Vec2::new(size.width as f32, size.height as f32);
    let half = shape / shape.max_element();
    let corner = |uv: Vec2| {
        let at = (uv * 2.0 - 1.0) * half;
        Corner { position: Vec3::new(at.x, -at.y, 0.0), uv, texture: 0 }
    };
    ([Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(corner).to_vec(), vec![[0, 1, 2], [2, 1, 3]])
}

/// The triangles of an OBJ model.
fn model(path: &Path) -> Result<Shape, Box<dyn Error>> {
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ..Default::default() };
    let (models, _) =
        tobj::load_obj(path, &options).map_err(|error| format!("{}: {error}", path.display()))?;
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for tobj::Model { mesh, .. } in models {
        let first = corners.len() as u32;
        let count = mesh.positions.len() / 3;
        if mesh.texcoords.len() != 2 * count {
            return Err(format!("{}: has no texture coordinates; unwrap the model", path.display()).into());
        }
        for (place, uv) in mesh.positions.chunks_exact(3).zip(mesh.texcoords.chunks_exact(2)) {
            corners.push(Corner {
                position: Vec3::from_slice(place),
                // Those of OBJ begin at the bottom.
                uv: Vec2::new(uv[0], 1.0 - uv[1]),
                texture: 0,
            });
        }
        triangles.extend(
            mesh.indices.chunks_exact(3).map(|corner| [corner[0], corner[1], corner[2]].map(|c| first + c)),
        );
    }
    if triangles.is_empty() {
        return Err(format!("{}: has no triangle", path.display()).into());
    }
    Ok((corners, triangles))
}

fn around(corners: &[Corner]) -> Orbit {
    sphere(&corners.iter().map(|corner| corner.position).collect::<Vec<_>>(), 0.15)
}

fn sphere(positions: &[Vec3], height: f32) -> Orbit {
    let bound = |pick: fn(Vec3, Vec3) -> Vec3| positions.iter().copied().reduce(pick).unwrap_or_default();
    let [low, high] = [bound(Vec3::min), bound(Vec3::max)];
    Orbit::around((low + high) / 2.0, (0.5 * (high - low).length()).max(1e-6), height)
}

//! Several light fields and plain textures in one scene: objects with highlights that move with the eye, on a floor from a cache of tiles.
//!
//! `cargo run --release -p texfold-gpu --example light -- [FOLDER [FILE.txf ...]]` draws the light fields of the files, two spheres where none is named, as a camera goes
//! around them, and writes frames to the folder, `target/light` where none is named. [`check`] is the test: the objects look as each does alone.

#[path = "support/offscreen.rs"]
mod offscreen;
#[path = "support/scene.rs"]
mod scene;

use std::error::Error;
use std::path::PathBuf;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};
use scene::pipeline::{self, Corners, Entries};
use scene::{Quad, Scene, camera};
use texfold::core::{Encoded, Encoder};
use texfold::lightfield::{LightParams, LightTexture, Lightfield};
use texfold::{Choice, Content, Effort, EncodeSettings, Guidance, ImageSet, Job};
use texfold_gpu::{Gpu, GpuLight, ModuleInfo, Policy, TileCache, TileLook, TileOptions, wgpu};
use texfold_shaders::Slot;
use texfold_testkit::capture::{Look, sphere};

const SIZE: (u32, u32) = (640, 360);
const FRAMES: u32 = 8;

/// The renderer's own shader: places of an object's triangles, and its colour towards the eye. Behind it stand the functions of the module, in group 0.
const SHADER: &str = "
struct Object {
    // From the object's space to clip space.
    projection: mat4x4<f32>,
    // Where the eye is, in the object's space.
    eye: vec3<f32>,
    reserved: u32,
}

@group(1) @binding(0) var<uniform> object: Object;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) barycentric: vec3<f32>,
    @location(2) @interpolate(flat) triangle: u32,
}

@vertex
fn vs(@builtin(vertex_index) index: u32) -> Corner {
    let corner = index % 3u;
    let vertex = texfold_lightfield_word(texfold_lightfield_triangle(index / 3u) + corner);
    let place = texfold_lightfield_position(vertex);
    let barycentric = vec3<f32>(vec3<u32>(corner) == vec3<u32>(0u, 1u, 2u));
    return Corner(object.projection * vec4<f32>(place, 1.0), place, barycentric, index / 3u);
}

@fragment
fn fs(corner: Corner) -> @location(0) vec4<f32> {
    let direction = normalize(object.eye - corner.place);
    return texfold_linear(texfold_lightfield_sample(corner.triangle, corner.barycentric, direction));
}
";

/// The uniform of that shader.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Uniform {
    projection: Mat4,
    eye: Vec3,
    reserved: u32,
}

/// A light field at its place. All of them share a pipeline, and each has a bind group.
struct Object {
    light: GpuLight,
    /// From its space to the scene's: about a unit wide, on the floor.
    placed: Mat4,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Object {
    fn new(gpu: &Gpu, light: &LightTexture, at: Vec3) -> Result<Object, Box<dyn Error>> {
        let positions = &light.mesh().positions;
        let bound = |pick: fn(Vec3, Vec3) -> Vec3| positions.iter().copied().reduce(pick).unwrap_or_default();
        let [low, high] = [bound(Vec3::min), bound(Vec3::max)];
        let scale = 1.0 / (high - low).max_element();
        let foot = Vec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z));
        let placed =
            Mat4::from_translation(at) * Mat4::from_scale(Vec3::splat(scale)) * Mat4::from_translation(-foot);
        let (uniform, group) = pipeline::uniform(gpu.device(), size_of::<Uniform>());
        Ok(Object { light: gpu.upload_light(&light.gpu())?, placed, uniform, group })
    }

    /// Parameters of the object's shader, from the scene's camera.
    fn seen(&self, projection: Mat4, eye: Vec3) -> Uniform {
        let eye = self.placed.inverse().transform_point3(eye);
        Uniform { projection: projection * self.placed, eye, reserved: 0 }
    }
}

/// Light fields on a floor.
struct Stage {
    floor: Scene,
    cache: TileCache,
    pipeline: wgpu::RenderPipeline,
    objects: Vec<Object>,
}

impl Stage {
    fn new(gpu: &Gpu, lights: &[LightTexture]) -> Result<Stage, Box<dyn Error>> {
        let mut objects = Vec::new();
        for (number, light) in (0u8..).zip(lights) {
            let left = f32::from(number) - 0.5 * (lights.len() as f32 - 1.0);
            objects.push(Object::new(gpu, light, Vec3::new(1.3 * left, 0.0, 0.0))?);
        }
        let first = objects.first().ok_or("no light field")?;
        let pipeline = pipeline_of(gpu, first.light.module())?;
        let options = TileOptions {
            pool_bytes: 8 << 20,
            stream_bytes: 1 << 20,
            scratch_bytes: 8 << 20,
            textures: 1,
            anisotropy: scene::anisotropy(gpu),
            ..TileOptions::default()
        };
        let mut cache = TileCache::new(gpu, &options)?;
        let settings = EncodeSettings {
            codec: Choice::named("dct").ok_or("no such codec")?,
            effort: Effort::Fast,
            mips: true,
            ..EncodeSettings::default()
        };
        let set = ImageSet::single(texfold_testkit::image("tile_repeat"));
        let tiles = texfold::encode_images(&set, Guidance::default(), &settings, &mut Job::default())?;
        let added = cache.add(gpu, tiles.as_encoded(), TileLook::default())?;
        let quad = Quad {
            corner: Vec3::new(-4.0, 0.0, -4.0),
            across: Vec3::new(8.0, 0.0, 0.0),
            down: Vec3::new(0.0, 0.0, 8.0),
            repeats: [8.0, 8.0],
            texture: added.first().ok_or("no image")?.index(),
        };
        let floor = Scene::tiled(gpu, &cache, &[quad], SIZE);
        Ok(Stage { floor, cache, pipeline, objects })
    }

    /// Draws the scene in one pass.
    fn frame(&self, gpu: &Gpu, eye: Vec3) -> Result<Vec<u8>, Box<dyn Error>> {
        let projection = projection(eye);
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = self.floor.pass(&mut encoder);
        self.floor.draw_in(gpu, &mut pass, projection, &[self.cache.bind_group().clone()]);
        pass.set_pipeline(&self.pipeline);
        for object in &self.objects {
            gpu.queue().write_buffer(&object.uniform, 0, bytemuck::bytes_of(&object.seen(projection, eye)));
            pass.set_bind_group(0, object.light.bind_group(), &[]);
            pass.set_bind_group(1, &object.group, &[]);
            pass.draw(0..3 * object.light.triangles(), 0..1);
        }
        drop(pass);
        self.cache.update(&mut encoder);
        offscreen::read_back(gpu, encoder, self.floor.target())
    }
}

fn projection(eye: Vec3) -> Mat4 {
    camera(eye, Vec3::new(0.0, 0.45, 0.0), SIZE)
}

/// The `number`th of so many eyes around the scene.
fn eye(number: u32, all: u32) -> Vec3 {
    let angle = number as f32 / all as f32 * std::f32::consts::TAU;
    Vec3::new(3.0 * angle.sin(), 1.1, 3.0 * angle.cos())
}

/// The pipeline of all light fields.
fn pipeline_of(gpu: &Gpu, module: &'static ModuleInfo) -> Result<wgpu::RenderPipeline, Box<dyn Error>> {
    let source = [&texfold_shaders::paste(&[Slot::new(module, 0, 0)])?, SHADER].concat();
    let entries = Entries { vertex: "vs", fragment: "fs" };
    let uniform = pipeline::uniform_layout(gpu.device());
    let groups = [Some(gpu.bind_group_layout(module)), Some(&uniform)];
    let shader = (source, entries);
    Ok(pipeline::pipeline(gpu.device(), shader, &groups, &[], Corners::NUMBERED, scene::FORMAT))
}

/// Two spheres: one by block, one with texels in BC7.
fn spheres() -> Result<Vec<LightTexture>, Box<dyn Error>> {
    let params = LightParams::default().with_terms(2);
    let made = [(Look::Glossy, None), (Look::Diffuse, Some(Content::Bc7))].map(|(look, content)| {
        Lightfield::encode(&sphere(look, 24, 64), &params.clone().with_content(content), &mut Job::default())
    });
    Ok(made.into_iter().collect::<Result<_, _>>()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "target/light".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let files: Vec<String> = arguments.collect();
    let open = |path: &String| -> Result<LightTexture, Box<dyn Error>> {
        Ok(texfold::open(&std::fs::read(path)?)?.into_light()?)
    };
    let lights =
        if files.is_empty() { spheres()? } else { files.iter().map(open).collect::<Result<_, _>>()? };
    let gpu = Gpu::new(Policy::from_env())?;
    let stage = Stage::new(&gpu, &lights)?;
    let bytes: u64 = stage.objects.iter().map(|object| object.light.bytes()).sum();
    println!(
        "{}: {} light fields, {:.2} MB; the floor's cache, {:.1} MB",
        gpu.info().name,
        lights.len(),
        bytes as f64 / 1e6,
        stage.cache.bytes() as f64 / 1e6,
    );
    for number in 0..FRAMES {
        let pixels = stage.frame(&gpu, eye(number, FRAMES))?;
        let path = folder.join(format!("{number:02}.png"));
        image::save_buffer(path, &pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?;
    }
    println!("wrote {}", folder.display());
    Ok(())
}

/// The largest difference between objects in the scene and each alone, in steps of 8 bits, and pixels that were compared.
///
/// # Errors
/// Where the device fails.
#[allow(dead_code, reason = "tests/light.rs calls it")]
pub(crate) fn check(gpu: &Gpu) -> Result<(u8, usize), Box<dyn Error>> {
    let stage = Stage::new(gpu, &spheres()?)?;
    let (mut largest, mut compared) = (0, 0);
    for number in [1, 8, 13] {
        let eye = eye(number, 16);
        let pixels = stage.frame(gpu, eye)?;
        let alone = |object: &Object| {
            let Uniform { projection, eye, .. } = object.seen(projection(eye), eye);
            gpu.draw_light(&object.light, projection, eye, SIZE)
        };
        let [first, second] = &stage.objects[..] else { return Err("not two objects".into()) };
        for ((found, first), second) in
            pixels.as_chunks::<4>().0.iter().zip(alone(first)?).zip(alone(second)?)
        {
            // The nearer one covers the other.
            let nearer = if first[3] == 255 && second[3] == 255 { continue } else { first.max(second) };
            if nearer[3] == 255 {
                let channels = found.iter().zip(nearer).take(3);
                largest = channels.map(|(a, b)| a.abs_diff(b)).fold(largest, u8::max);
                compared += 1;
            }
        }
    }
    Ok((largest, compared))
}

//! The cache of tiles beside plain textures, in one run on one adapter: `cargo bench -p texfold-benches --bench tiles`.
//!
//! Sixteen textures of 2048 texels a side on the walls of a room are drawn at 1920x1080: from plain RGBA8 and BC7 textures with trilinear
//! hardware filtering, and from the cache with all tiles there, with some of them new in each frame as the camera turns, and with all of them new.
//! Materials of three maps are drawn likewise: each map looked up by itself, and all by one lookup.
//! Times are medians of frames: by timestamps on a GPU, by the wall clock from the submission to the device's answer where software
//! draws. The program needs nothing beside it where it runs: textures are drawn and encoded when it starts.

#[path = "../../crates/gpu/examples/support/scene.rs"]
mod scene;

use std::error::Error;
use std::time::{Duration, Instant};

use glam::{Mat4, Vec3, Vec4};
use scene::{Quad, Scene, camera};
use texfold::core::image::{Alpha, ColorSpace, Depth, ImageSet, MapKind, PixelInfo, Raster};
use texfold::core::{ImageSize, PlaneFormat, Rect};
use texfold::{AnyImage, Choice, Effort, EncodeSettings, Goal, Guidance, Job};
use texfold_gpu::{
    DctDecoder, Gpu, GpuError, Policy, TileCache, TileContents, TileLook, TileOptions, TileReport, wgpu,
};

const SIZE: (u32, u32) = (1920, 1080);
/// Textures, of which some are drawn and encoded and the others are the same again.
const TEXTURES: u32 = 16;
const DRAWN: u32 = 2;
const SIDE: u32 = 2048;
/// A median is taken of so many frames, or of those within a time.
const FRAMES: usize = 100;
const SECONDS: f64 = 10.0;
/// Textures that are decoded before the device is waited for.
const DECODED: usize = 8;
/// Frames before those that count.
const WARM_UP: Duration = Duration::from_millis(500);

/// Maps of a material.
const MAPS: u32 = 3;

/// Shading of a rectangle by colour, normals and packed data.
const LIT: &str = "
fn lit(color: vec3<f32>, normal: vec3<f32>, packed: vec3<f32>) -> vec4<f32> {
    let light = max(dot(normalize(normal), vec3<f32>(0.48, 0.6, 0.64)), 0.0);
    return vec4<f32>(color * light * packed.x * (1.0 - packed.z) + light * packed.z * packed.y, 1.0);
}
";
const PLAIN: &str = "
@group(0) @binding(0) var filtered: sampler;
@group(0) @binding(1) var color: texture_2d<f32>;
@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    return textureSample(color, filtered, in.uv);
}
";
const PLAIN_MAPS: &str = "
@group(0) @binding(0) var filtered: sampler;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var normal: texture_2d<f32>;
@group(0) @binding(3) var packed: texture_2d<f32>;
@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    let bent = textureSample(normal, filtered, in.uv).xyz * 2.0 - 1.0;
    return lit(textureSample(color, filtered, in.uv).xyz, bent, textureSample(packed, filtered, in.uv).xyz);
}
";
const APART: &str = "
@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    let normal = texfold_tile_sample(in.texture + 1u, in.uv).xyz * 2.0 - 1.0;
    let packed = texfold_tile_sample(in.texture + 2u, in.uv).xyz;
    return lit(texfold_tile_sample(in.texture, in.uv).xyz, normal, packed);
}
";
const TOGETHER: &str = "
@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    let maps = texfold_tile_sample_material(in.texture, in.uv);
    return lit(maps.color.xyz, maps.normal, vec3<f32>(maps.occlusion, maps.roughness, maps.metalness));
}
";

fn main() -> Result<(), Box<dyn Error>> {
    let gpu = Gpu::new(Policy::from_env())?;
    let info = gpu.info();
    let clock = if gpu.has_timestamps() { "timestamps" } else { "wall clock" };
    println!("{} ({:?}, {}), by {clock}", info.name, info.device_type, info.driver_info);
    let images = (0..DRAWN).map(land).collect::<Result<Vec<_>, _>>()?;
    let superblocks = images.iter().map(|image| encode("dct", image)).collect::<Result<Vec<_>, _>>()?;
    let bc7 = images.iter().map(|image| encode("bc", image)).collect::<Result<Vec<_>, _>>()?;

    println!(
        "| drawn from | ms a frame | of which update | tiles a frame | MB resident |\n|---|---|---|---|---|"
    );
    let plain = plain_frames(&gpu, &superblocks, false)?;
    println!("| plain RGBA8, trilinear | {:.3} | | | {:.1} |", plain.0, plain.1);
    let blocks = plain_frames(&gpu, &bc7, true)?;
    println!("| BC7, trilinear | {:.3} | | | {:.1} |", blocks.0, blocks.1);

    tiled_frames(&gpu, &superblocks, plain.0)?;
    println!("whole textures: {:.3} gigatexels/s decoded", decoded(&gpu, &superblocks)?);
    material_frames(&gpu)
}

/// Gigatexels a second of decoding first levels whole, each in one submission, from the first submission to the end of the last.
fn decoded(gpu: &Gpu, textures: &[AnyImage]) -> Result<f64, Box<dyn Error>> {
    let decoder = DctDecoder::new(gpu)?;
    let forms: Vec<_> = textures.iter().map(|texture| texture.as_encoded().gpu()).collect();
    let blocks = forms.iter().filter_map(|form| form.blocks.first());
    let images = blocks.map(|blocks| decoder.upload(gpu, blocks)).collect::<Result<Vec<_>, _>>()?;
    let rect = Rect { image: 0, level: 0, x: 0, y: 0, width: SIDE, height: SIDE };
    let first = images.first().ok_or("no superblocks")?;
    let target = decoder.decode(gpu, first, rect, first.colours())?;
    let (start, mut texels) = (Instant::now(), 0.0);
    gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
    while start.elapsed() < WARM_UP || texels == 0.0 {
        for image in images.iter().cycle().take(DECODED) {
            decoder.decode_into(gpu, image, rect, image.colours(), &target, [0, 0])?;
            texels += f64::from(SIDE).powi(2);
        }
        gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
    }
    Ok(texels / start.elapsed().as_secs_f64() / 1e9)
}

/// An image by a codec, with mip levels.
fn encode(codec: &str, image: &Raster) -> Result<AnyImage, Box<dyn Error>> {
    let settings = EncodeSettings {
        codec: Choice::named(codec).ok_or("no such codec")?,
        // BC7 with mip levels, or a bit a texel.
        goal: Goal::Bpp(if codec == "bc" { 11.0 } else { 1.0 }),
        effort: Effort::Fast,
        mips: true,
        ..EncodeSettings::default()
    };
    let set = ImageSet::single(image.clone());
    Ok(texfold::encode_images(&set, Guidance::default(), &settings, &mut Job::default())?)
}

/// A cache, and the scene that is drawn from it.
struct Cached<'c> {
    name: &'static str,
    cache: &'c TileCache,
    scene: Scene,
    /// Maps of a tile that the report counts once.
    maps: u32,
}

/// Prints times of frames from a cache, beside that of plain textures in milliseconds.
fn cached_frames(gpu: &Gpu, with: &Cached<'_>, plain: f64) -> Result<(), Box<dyn Error>> {
    let Cached { name, cache, scene, maps } = with;
    let megabytes = cache.bytes() as f64 / 1e6;
    let groups = [cache.bind_group().clone()];
    let frame = |view: Mat4| -> Result<Frame, Box<dyn Error>> {
        let drawing = gpu.measure(|encoder| scene.draw(gpu, encoder, view, &groups))?;
        let update = gpu.measure(|encoder| cache.update(encoder))?;
        Ok(Frame { drawing, update })
    };
    // First everything is new: from the first frame to the one that misses nothing.
    let (mut all, mut tiles, mut count) = (Vec::new(), 0, 0u32);
    loop {
        let time = frame(still())?;
        let TileReport { decoded, missing, bias } = cache.report(gpu)?;
        all.extend((decoded > 0).then_some(time.update));
        tiles += decoded * maps;
        count += 1;
        if decoded == 0 && missing == 0 && count > 2 || count == 400 {
            let [seconds, longest] = [all.iter().sum(), all.iter().max().copied().unwrap_or_default()]
                .map(|time: Duration| time.as_secs_f64());
            println!(
                "{name}, all new: {tiles} tiles by {} updates in {:.2} ms, the longest {:.2}, bias {bias}: {:.0} tiles/s, {:.3} gigatexels/s without borders",
                all.len(),
                1e3 * seconds,
                1e3 * longest,
                f64::from(tiles) / seconds,
                f64::from(tiles) * 120.0 * 120.0 / seconds / 1e9,
            );
            break;
        }
    }
    let row = |what: &str, frames: &Frames| {
        let new = f64::from(frames.decoded * maps) / frames.times.len() as f64;
        let [whole, update] = [frames.median(Frame::whole), frames.median(|frame| frame.update)];
        println!("| {name}, {what} | {whole:.3} | {update:.3} | {new:.1} | {megabytes:.1} |");
        whole
    };
    let warm = row("all there", &frames(|_| Ok((frame(still())?, 0)))?);
    let turning = frames(|number| Ok((frame(turned(number))?, cache.report(gpu)?.decoded)))?;
    let turning = row("camera turning", &turning);
    println!("of the plain trilinear draw's speed: {:.2} warm, {:.2} turning", plain / warm, plain / turning);
    Ok(())
}

/// Prints times of frames of textures in tiles.
fn tiled_frames(gpu: &Gpu, superblocks: &[AnyImage], plain: f64) -> Result<(), Box<dyn Error>> {
    let mut cache = TileCache::new(gpu, &options(1))?;
    let textures = fill(gpu, &mut cache, superblocks)?;
    let scene = Scene::tiled(gpu, &cache, &quads(&textures), SIZE);
    cached_frames(gpu, &Cached { name: "tiles", cache: &cache, scene, maps: 1 }, plain)
}

/// A cache for textures of so many maps.
fn options(maps: u32) -> TileOptions {
    TileOptions {
        pool_bytes: u64::from(maps) << 26,
        stream_bytes: u64::from(maps) << 25,
        textures: maps * TEXTURES,
        anisotropy: 1,
        ..TileOptions::default()
    }
}

/// Prints times of frames of materials of three maps: from plain textures, from tiles of each map by itself, and from tiles of all maps.
fn material_frames(gpu: &Gpu) -> Result<(), Box<dyn Error>> {
    let materials = (0..DRAWN).map(material).collect::<Result<Vec<_>, _>>()?;
    let kept = materials.iter().map(|material| gpu.upload(&material.as_encoded().gpu()));
    let kept = kept.collect::<Result<Vec<_>, _>>()?;
    let view = |number: u32, map: u32| kept[(number % DRAWN) as usize].decoded_view(map, map == 0);
    let plain = plain_draws(gpu, PLAIN_MAPS, MAPS, view)?;
    println!("| plain RGBA8, three maps | {plain:.3} | | | |");

    let mut cache = TileCache::new(gpu, &options(MAPS))?;
    let mut textures = Vec::new();
    for number in 0..TEXTURES {
        let material = &materials[(number % DRAWN) as usize];
        let added = cache.add(gpu, material.as_encoded(), TileLook::default())?;
        textures.extend(added.first().map(|texture| texture.index()));
    }
    let shader = [&cache.wgsl(0), APART, LIT].concat();
    let scene = Scene::new(gpu, &shader, cache.bind_group_layout(), &[], &quads(&textures), SIZE);
    cached_frames(gpu, &Cached { name: "three maps apart", cache: &cache, scene, maps: 1 }, plain)?;

    let contents = TileContents::Materials { emissive: false };
    let mut cache = TileCache::new(gpu, &TileOptions { contents, ..options(MAPS) })?;
    let add = |number: u32| -> Result<u32, Box<dyn Error>> {
        let material = materials[(number % DRAWN) as usize].as_encoded();
        Ok(cache.add_material(gpu, material, TileLook::default())?.index())
    };
    let textures = (0..TEXTURES).map(add).collect::<Result<Vec<_>, _>>()?;
    let shader = [&cache.wgsl(0), TOGETHER, LIT].concat();
    let scene = Scene::new(gpu, &shader, cache.bind_group_layout(), &[], &quads(&textures), SIZE);
    cached_frames(gpu, &Cached { name: "materials", cache: &cache, scene, maps: MAPS }, plain)
}

/// A material of land: its colours, normals as if its green were heights, and packed data.
fn material(number: u32) -> Result<AnyImage, Box<dyn Error>> {
    let colors = land(number)?;
    let height = |x: u32, y: u32| colors.texel(x % SIDE, y % SIDE).y;
    let normal = |x: u32, y: u32| {
        let slope = Vec3::new(height(x, y) - height(x + 1, y), height(x, y) - height(x, y + 1), 0.5);
        (0.5 * slope.normalize() + 0.5).extend(1.0)
    };
    let packed = |x: u32, y: u32| {
        let color = colors.texel(x, y);
        Vec4::new(1.0, 1.0 - 0.5 * color.y, (color.x * 4.0).floor() / 4.0, 1.0)
    };
    let of = |color: ColorSpace, texel: &dyn Fn(u32, u32) -> Vec4| {
        let info = PixelInfo { channels: 3, depth: Depth::Eight, color, alpha: Alpha::Opaque };
        let texels: Vec<Vec4> = (0..SIDE * SIDE).map(|place| texel(place % SIDE, place / SIDE)).collect();
        Raster::from_texels(SIDE, SIDE, info, &texels)
    };
    let maps = vec![
        (MapKind::Normal, "normal".to_owned(), of(ColorSpace::Normal, &normal)?),
        (MapKind::OcclusionRoughnessMetalness, "packed".to_owned(), of(ColorSpace::Linear, &packed)?),
    ];
    let base = (MapKind::BaseColor, "color".to_owned(), colors.clone());
    let images = ImageSet::of_maps([vec![base], maps].concat())?;
    Ok(texfold::Encode::new(&images).goal(Goal::Bpp(2.0)).effort(Effort::Fast).mips(true).run()?)
}

/// Land that no other number has.
fn land(number: u32) -> Result<Raster, Box<dyn Error>> {
    let samples = texfold_testkit::fixtures::land::land((number * SIDE, 0), (SIDE, SIDE));
    Ok(Raster::from_u8(SIDE, SIDE, 3, ColorSpace::Srgb, &samples)?)
}

fn fill(gpu: &Gpu, cache: &mut TileCache, textures: &[AnyImage]) -> Result<Vec<u32>, Box<dyn Error>> {
    let mut numbers = Vec::new();
    for number in 0..TEXTURES as usize {
        let texture = &textures[number % textures.len()];
        numbers.extend(cache.add(gpu, texture.as_encoded(), TileLook::default())?.iter().map(|t| t.index()));
    }
    Ok(numbers)
}

/// Panels on the floor around the camera, up to the horizon.
fn quads(textures: &[u32]) -> Vec<Quad> {
    let panel = |(number, &texture): (u32, &u32)| {
        let (column, row) = ((number % 4) as f32, (number / 4) as f32);
        Quad {
            corner: Vec3::new(4.0 * column - 8.0, 0.0, 4.0 * row - 8.0),
            across: Vec3::new(4.0, 0.0, 0.0),
            down: Vec3::new(0.0, 0.0, 4.0),
            repeats: [1.0, 1.0],
            texture,
        }
    };
    (0..).zip(textures).map(panel).collect()
}

fn still() -> Mat4 {
    turned(0)
}

/// The camera of a frame, which turns by less than a circle in all: some 5 % of the tiles are new in each.
fn turned(number: usize) -> Mat4 {
    let angle = 0.056 * number as f32;
    let ahead = Vec3::new(angle.sin(), -0.75, angle.cos());
    camera(Vec3::new(0.0, 1.6, 0.0), Vec3::new(0.0, 1.6, 0.0) + ahead, SIZE)
}

/// Milliseconds of a frame of plain textures with mip levels, and their megabytes.
fn plain_frames(gpu: &Gpu, textures: &[AnyImage], is_bc7: bool) -> Result<(f64, f64), Box<dyn Error>> {
    let mut views = Vec::new();
    let mut kept = Vec::new();
    for texture in textures {
        if is_bc7 {
            views.push(bc7_view(gpu, texture)?);
        } else {
            let uploaded = gpu.upload(&texture.as_encoded().gpu())?;
            views.push(uploaded.decoded_view(0, true)?);
            kept.push(uploaded);
        }
    }
    let view = |number: u32, _| Ok(views[number as usize % views.len()].clone());
    let time = plain_draws(gpu, PLAIN, 1, view)?;
    let bits = if is_bc7 { 8 } else { 32 };
    let size = ImageSize { width: SIDE, height: SIDE };
    let texels: u64 = (0..size.full_levels()).map(|level| size.at_level(level).texels()).sum();
    Ok((time, (u64::from(TEXTURES) * texels * bits / 8) as f64 / 1e6))
}

/// Milliseconds of a frame of rectangles that are each drawn from so many plain textures.
fn plain_draws(
    gpu: &Gpu,
    fragments: &str,
    maps: u32,
    view: impl Fn(u32, u32) -> Result<wgpu::TextureView, GpuError>,
) -> Result<f64, Box<dyn Error>> {
    let device = gpu.device();
    let entry = |(binding, ty)| {
        let visibility = wgpu::ShaderStages::FRAGMENT;
        wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
    };
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
    let types = std::iter::once(sampler).chain((0..maps).map(|_| texture));
    let entries: Vec<_> = (0..).zip(types).map(entry).collect();
    let layout =
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries });
    let numbers: Vec<u32> = (0..TEXTURES).collect();
    let scene = Scene::new(gpu, &[fragments, LIT].concat(), &layout, &[], &quads(&numbers), SIZE);
    let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        ..Default::default()
    });
    let group = |&number: &u32| -> Result<wgpu::BindGroup, GpuError> {
        let views = (0..maps).map(|map| view(number, map)).collect::<Result<Vec<_>, _>>()?;
        let resources = std::iter::once(wgpu::BindingResource::Sampler(&sampler))
            .chain(views.iter().map(wgpu::BindingResource::TextureView));
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries };
        Ok(device.create_bind_group(&descriptor))
    };
    let groups = numbers.iter().map(group).collect::<Result<Vec<_>, _>>()?;
    let frames = frames(|_| {
        let drawing = gpu.measure(|encoder| scene.draw(gpu, encoder, still(), &groups))?;
        Ok((Frame { drawing, update: Duration::ZERO }, 0))
    })?;
    Ok(frames.median(Frame::whole))
}

/// A texture of BC7 blocks with its mip levels.
fn bc7_view(gpu: &Gpu, texture: &AnyImage) -> Result<wgpu::TextureView, Box<dyn Error>> {
    let form = texture.as_encoded().gpu();
    let plane = form.planes.first().filter(|plane| plane.format == PlaneFormat::Bc7);
    let plane = plane.ok_or("8 bits a texel are not BC7")?;
    let made = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: plane.width, height: plane.height, depth_or_array_layers: 1 },
        mip_level_count: plane.levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Bc7RgbaUnormSrgb,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut rest = &plane.data[..];
    for (level, (width, height, bytes)) in (0..).zip(plane.level_sizes()) {
        let (data, behind) = rest.split_at(bytes as usize);
        rest = behind;
        gpu.queue().write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level, ..made.as_image_copy() },
            data,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width.div_ceil(4) * 16),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width: width.next_multiple_of(4),
                height: height.next_multiple_of(4),
                depth_or_array_layers: 1,
            },
        );
    }
    Ok(made.create_view(&wgpu::TextureViewDescriptor::default()))
}

/// Times of a frame.
#[derive(Clone, Copy)]
struct Frame {
    drawing: Duration,
    update: Duration,
}

impl Frame {
    fn whole(self) -> Duration {
        self.drawing + self.update
    }
}

/// Frames of one kind, and tiles that their updates decoded.
#[derive(Default)]
struct Frames {
    times: Vec<Frame>,
    decoded: u32,
}

impl Frames {
    /// Median of a part of the frames, in milliseconds.
    fn median(&self, part: impl Fn(Frame) -> Duration) -> f64 {
        let mut times: Vec<Duration> = self.times.iter().copied().map(part).collect();
        times.sort();
        1e3 * times[times.len() / 2].as_secs_f64()
    }
}

/// Frames, each with the tiles that it decoded, after some to warm up: GPUs raise their clock with the load.
fn frames(
    mut frame: impl FnMut(usize) -> Result<(Frame, u32), Box<dyn Error>>,
) -> Result<Frames, Box<dyn Error>> {
    let start = Instant::now();
    frame(0)?;
    while start.elapsed() < WARM_UP {
        frame(0)?;
    }
    let (start, mut frames) = (Instant::now(), Frames::default());
    while frames.times.len() < FRAMES && (frames.times.len() < 3 || start.elapsed().as_secs_f64() < SECONDS) {
        let (time, decoded) = frame(frames.times.len())?;
        frames.times.push(time);
        frames.decoded += decoded;
    }
    Ok(frames)
}

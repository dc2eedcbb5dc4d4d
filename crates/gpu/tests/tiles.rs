//! The cache of tiles against filtering on the CPU.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(
    clippy::duplicate_mod,
    reason = "the examples and the other tests' support each draw without a window"
)]

mod materials;
#[path = "../examples/support/offscreen.rs"]
mod offscreen;

use glam::{DVec2, DVec4, Vec4};
use texfold::core::image::{Alpha, ColorSpace, Depth, ImageSet, MapKind, PixelInfo, Raster, srgb_to_linear};
use texfold::core::rng::Rng;
use texfold::core::{Encoded, Image2d, ImageSize, Rect, Texel};
use texfold::{AnyImage, Arrived, Arriving, Choice, Effort, EncodeSettings, Goal, Guidance, Job, Limits};
use texfold_gpu::{
    AddressMode, Gpu, GpuError, Policy, TileBytes, TileCache, TileLook, TileOptions, TileTexture, TileUse,
    wgpu,
};
use texfold_testkit::{crop, full};

use crate::support::{gpu, image};

/// Pixels along a side of a view; its rows need no padding.
const VIEW: u32 = 64;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
/// Updates within which all tiles of a view are there.
const UPDATES: u32 = 3;

/// Uniform and vertices of all shaders.
const SHADER: &str = "
struct View { origin: vec2<f32>, across: vec2<f32>, down: vec2<f32>, texture: u32, lod: f32 }
@group(1) @binding(0) var<uniform> view: View;

@vertex
fn vs(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
";
const COLOUR: &str = "
@fragment
fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let uv = view.origin + view.across * at.x + view.down * at.y;
    if view.lod >= 0.0 {
        return texfold_tile_sample_level(view.texture, uv, view.lod);
    }
    return texfold_tile_sample_grad(view.texture, uv, view.across, view.down);
}
";

/// A flat view of a texture.
#[derive(Debug, Clone, Copy)]
struct View {
    origin: DVec2,
    across: DVec2,
    down: DVec2,
    texture: u32,
    /// The level to read, or below 0 the one that changes across a pixel ask for.
    lod: f32,
}

impl View {
    /// The shader's bytes; single precision, so that the CPU starts from the same numbers.
    fn bytes(&self) -> Vec<u8> {
        let numbers = [self.origin, self.across, self.down];
        let mut bytes: Vec<u8> =
            numbers.iter().flat_map(|pair| pair.to_array()).flat_map(|v| (v as f32).to_le_bytes()).collect();
        bytes.extend(self.texture.to_le_bytes());
        bytes.extend(self.lod.to_le_bytes());
        bytes
    }

    fn rounded(self) -> View {
        let single = |pair: DVec2| pair.as_vec2().as_dvec2();
        View { origin: single(self.origin), across: single(self.across), down: single(self.down), ..self }
    }
}

/// A renderer that draws views from a cache.
struct Renderer<'g> {
    gpu: &'g Gpu,
    cache: TileCache,
    pipeline: wgpu::RenderPipeline,
    target: wgpu::Texture,
}

impl<'g> Renderer<'g> {
    fn new(gpu: &'g Gpu, options: &TileOptions) -> Self {
        Renderer::of(gpu, options, COLOUR)
    }

    /// A renderer whose fragments are these.
    fn of(gpu: &'g Gpu, options: &TileOptions, fragments: &str) -> Self {
        let cache = TileCache::new(gpu, options).unwrap();
        let device = gpu.device();
        let source = wgpu::ShaderSource::Wgsl([&cache.wgsl(0), SHADER, fragments].concat().into());
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let uniform = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let groups = [Some(cache.bind_group_layout()), Some(&uniform)];
        let pipeline = offscreen::pipeline(gpu, &shader, &groups, &[], FORMAT);
        let target = offscreen::target(gpu, (VIEW, VIEW), FORMAT);
        Renderer { gpu, cache, pipeline, target }
    }

    /// Draws a view, and records an update behind it.
    fn frame(&self, view: &View) -> Vec<Vec4> {
        let texels = self.draw(view);
        let encoder = wgpu::CommandEncoderDescriptor::default();
        let mut encoder = self.gpu.device().create_command_encoder(&encoder);
        self.cache.update(&mut encoder);
        self.gpu.queue().submit([encoder.finish()]);
        texels
    }

    /// Draws a view.
    fn draw(&self, view: &View) -> Vec<Vec4> {
        let device = self.gpu.device();
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 32,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.gpu.queue().write_buffer(&buffer, 0, &view.bytes());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(1),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        let groups = [self.cache.bind_group(), &group];
        let bytes = offscreen::draw(self.gpu, &self.pipeline, &groups, &self.target).unwrap();
        bytemuck::pod_collect_to_vec::<u8, Vec4>(&bytes)
    }

    /// Draws a view until all of its tiles are there.
    fn settled(&self, view: &View) -> Vec<Vec4> {
        for _ in 0..UPDATES {
            self.frame(view);
        }
        let report = self.cache.report(self.gpu).unwrap();
        assert!(report.missing == 0 && report.bias == 0.0, "{view:?}: {report:?}");
        self.frame(view)
    }
}

/// A texture as the CPU filters it.
struct Reference {
    levels: Vec<(ImageSize, Vec<DVec4>)>,
    look: TileLook,
}

impl Reference {
    fn new(texture: &dyn Encoded<Domain = Image2d>, image: u32, look: TileLook) -> Self {
        let layout = texture.layout();
        let own = layout.images[image as usize];
        let level = |level: u32| {
            let size = own.at_level(level);
            let ImageSize { width, height } = size;
            let mut texels = vec![Texel::ZERO; (width * height) as usize];
            let rect = Rect { image, level, x: 0, y: 0, width, height };
            texture.decode(rect, &mut texels).unwrap();
            let value = |texel: &Texel| {
                // The pool has 8 bits a sample.
                let [r, g, b, a] = texel.to_array().map(|v| (f64::from(v) * 255.0).round() / 255.0);
                let light = |v: f64| if look.srgb { f64::from(srgb_to_linear(v as f32)) } else { v };
                DVec4::new(light(r), light(g), light(b), a)
            };
            (size, texels.iter().map(value).collect())
        };
        Reference { levels: (0..layout.levels.min(own.full_levels())).map(level).collect(), look }
    }

    /// As [`Reference::new`], of an image so many halvings smaller than the texture: levels that it lacks are enlarged from the stored values of its finest.
    fn halved(texture: &dyn Encoded<Domain = Image2d>, image: u32, look: TileLook, halvings: u32) -> Self {
        let stored = Reference::new(texture, image, TileLook { srgb: false, ..look });
        let light = |v: f64| if look.srgb { f64::from(srgb_to_linear(v as f32)) } else { v };
        let ImageSize { width, height } = stored.levels[0].0;
        let enlarged = |level: u32| {
            let [width, height] = [width, height].map(|side| side << (halvings - level));
            let size = DVec2::new(f64::from(width), f64::from(height));
            let centre = |place: u32| DVec2::new(f64::from(place % width), f64::from(place / width)) + 0.5;
            let texel = |place: u32| {
                let value = (stored.bilinear(0, centre(place) / size) * 255.0).round() / 255.0;
                DVec4::new(light(value.x), light(value.y), light(value.z), value.w)
            };
            (ImageSize { width, height }, (0..width * height).map(texel).collect())
        };
        let own = Reference::new(texture, image, look).levels;
        Reference { levels: (0..halvings).map(enlarged).chain(own).collect(), look }
    }

    fn bilinear(&self, level: usize, uv: DVec2) -> DVec4 {
        let (ImageSize { width, height }, texels) = &self.levels[level];
        let clamped = self.look.address == AddressMode::Clamp;
        let uv = if clamped { uv.clamp(DVec2::ZERO, DVec2::ONE) } else { uv };
        let at = uv * DVec2::new(f64::from(*width), f64::from(*height)) - 0.5;
        let texel = |x: f64, y: f64| {
            let place = |at: f64, size: u32| {
                let (at, size) = (at as i64, i64::from(size));
                (if clamped { at.clamp(0, size - 1) } else { at.rem_euclid(size) }) as usize
            };
            texels[place(y, *height) * *width as usize + place(x, *width)]
        };
        let (low, share) = (at.floor(), at - at.floor());
        let row = |y: f64| texel(low.x, y).lerp(texel(low.x + 1.0, y), share.x);
        row(low.y).lerp(row(low.y + 1.0), share.y)
    }

    fn trilinear(&self, uv: DVec2, view: &View) -> DVec4 {
        let ImageSize { width, height } = self.levels[0].0;
        let size = DVec2::new(f64::from(width), f64::from(height));
        let extent = (view.across * size).length().max((view.down * size).length());
        let lod = if view.lod < 0.0 { extent.log2() } else { f64::from(view.lod) };
        let lod = lod.clamp(0.0, (self.levels.len() - 1) as f64);
        let level = lod as usize;
        let fine = self.bilinear(level, uv);
        if lod.fract() == 0.0 { fine } else { fine.lerp(self.bilinear(level + 1, uv), lod.fract()) }
    }
}

/// An image encoded by a codec, with mip levels or without.
fn encode(codec: &str, image: Raster, mips: bool) -> AnyImage {
    let settings = EncodeSettings {
        codec: Choice::named(codec).unwrap(),
        goal: Goal::Bpp(2.0),
        effort: Effort::Fast,
        mips,
        ..EncodeSettings::default()
    };
    texfold::encode_images(&ImageSet::single(image), Guidance::default(), &settings, &mut Job::default())
        .unwrap()
}

/// Small pools and few tiles: what a test needs.
fn options() -> TileOptions {
    TileOptions {
        pool_bytes: 8 << 20,
        stream_bytes: 2 << 20,
        textures: 16,
        pages: 1024,
        anisotropy: 1,
        stride: 1,
        ..TileOptions::default()
    }
}

/// A view of a random place, scale and direction.
fn random_view(rng: &mut Rng, size: ImageSize, levels: u32, texture: TileTexture) -> View {
    let mut unit = || f64::from(rng.below(1 << 20)) / f64::from(1 << 20);
    let scale = (unit() * (f64::from(levels) + 1.0) - 1.5).exp2();
    let angle = unit() * std::f64::consts::TAU;
    let across = DVec2::from_angle(angle) * scale;
    let down = DVec2::from_angle(angle + 1.2 + 0.7 * unit()) * scale * (0.5 + 0.5 * unit());
    let texels = DVec2::new(f64::from(size.width), f64::from(size.height));
    let origin = DVec2::new(unit() * 3.0 - 1.0, unit() * 3.0 - 1.0);
    View { origin, across: across / texels, down: down / texels, texture: texture.index(), lod: -1.0 }
        .rounded()
}

/// Adds a texture, compares some views of it, and returns its number.
fn hold(
    renderer: &mut Renderer<'_>,
    texture: &AnyImage,
    look: TileLook,
    bounds: (u32, f64),
    rng: &mut Rng,
) -> TileTexture {
    let added = renderer.cache.add(renderer.gpu, texture.as_encoded(), look).unwrap()[0];
    compare(renderer, texture, (added, look), bounds, rng);
    added
}

/// Compares some views of a texture with filtering on the CPU; they differ by at most so many steps of 255.
fn compare(
    renderer: &Renderer<'_>,
    texture: &AnyImage,
    (added, look): (TileTexture, TileLook),
    (views, most): (u32, f64),
    rng: &mut Rng,
) {
    let texture = texture.as_encoded();
    let reference = Reference::new(texture, 0, look);
    let (size, levels) = (texture.layout().images[0], texture.layout().levels);
    for _ in 0..views {
        compare_view(renderer, (texture, &reference), &random_view(rng, size, levels, added), most);
    }
}

fn compare_view(
    renderer: &Renderer<'_>,
    (texture, reference): (&dyn Encoded<Domain = Image2d>, &Reference),
    view: &View,
    most: f64,
) {
    let found = renderer.settled(view);
    for (place, found) in (0u32..).zip(&found) {
        let at = DVec2::new(f64::from(place % VIEW) + 0.5, f64::from(place / VIEW) + 0.5);
        let uv = view.origin + view.across * at.x + view.down * at.y;
        let wanted = reference.trilinear(uv, view);
        let off = (found.as_dvec4() - wanted).abs().max_element();
        let (name, look) = (texture.codec().name, reference.look);
        assert!(off <= most / 255.0, "{name} {look:?}, {view:?}, pixel {at}: {found}, not {wanted}");
    }
}

/// All tiles of level 0.
fn whole_view(texture: TileTexture) -> View {
    let step = 1.0 / f64::from(VIEW);
    let (across, down) = (DVec2::new(step, 0.0), DVec2::new(0.0, step));
    View { origin: DVec2::ZERO, across, down, texture: texture.index(), lod: 0.0 }
}

#[test]
fn views_equal_filtering_of_decoded_texels_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(gpu, &options());
    let repeat = TileLook { address: AddressMode::Repeat, srgb: false };
    let clamp = TileLook { address: AddressMode::Clamp, srgb: false };
    let facade = encode("dct", crop(&image("facade"), (3, 5), (251, 247)), true);
    let small = encode("dct", image("odd_37x61"), true);
    let plain = encode("dct", crop(&image("terrain"), (0, 0), (130, 200)), false);
    let light = TileLook { srgb: true, ..repeat };
    let mut rng = Rng::new(7);
    for (texture, look) in
        [(&facade, repeat), (&facade, clamp), (&facade, light), (&small, repeat), (&plain, clamp)]
    {
        hold(&mut renderer, texture, look, (if full() { 200 } else { 12 }, 2.0), &mut rng);
    }
    for codec in ["bc", "vq", "epitome", "progressive"] {
        let texture = encode(codec, crop(&image("facade"), (0, 0), (150, 140)), true);
        // Processors round BC1 to BC5 differently, by two steps.
        hold(&mut renderer, &texture, repeat, (3, 4.0), &mut rng);
    }
}

/// A photograph of that many channels and that depth; its alpha fades from left to right.
fn of_pixels(channels: u8, depth: Depth) -> Raster {
    let source = crop(&image("facade"), (0, 0), (150, 140));
    let texel = |place: u32| {
        let (x, y) = (place % 150, place / 150);
        let colour = source.texel(x, y);
        Texel::new(colour.x, colour.y, colour.z, x as f32 / 149.0)
    };
    let texels: Vec<Texel> = (0..150 * 140).map(texel).collect();
    let info = PixelInfo { channels, depth, color: ColorSpace::Srgb, alpha: Alpha::Straight };
    Raster::from_texels(150, 140, info, &texels).unwrap()
}

#[test]
fn channels_and_depths_of_all_kinds_are_drawn() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(gpu, &options());
    let look = TileLook { address: AddressMode::Clamp, srgb: false };
    let mut rng = Rng::new(17);
    for (channels, depth) in
        [(1, Depth::Eight), (2, Depth::Eight), (4, Depth::Eight), (1, Depth::Sixteen), (3, Depth::Sixteen)]
    {
        let texture = encode("dct", of_pixels(channels, depth), true);
        assert_eq!(texture.as_encoded().layout().pixel.channels, channels);
        hold(&mut renderer, &texture, look, (3, 2.0), &mut rng);
    }
}

#[test]
fn tiles_that_a_removed_texture_asked_for_do_no_harm() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(gpu, &TileOptions { textures: 1, ..options() });
    let look = TileLook { address: AddressMode::Repeat, srgb: false };
    let large = encode("dct", crop(&image("facade"), (0, 0), (512, 512)), true);
    let small = encode("dct", crop(&image("terrain"), (0, 0), (130, 100)), true);
    let mut rng = Rng::new(23);
    for next in [&small, &large, &small] {
        let asked = renderer.cache.add(gpu, large.as_encoded(), look).unwrap()[0];
        renderer.draw(&whole_view(asked));
        // The update finds the marks of a texture that is gone, under the number of another.
        renderer.cache.remove(gpu, asked);
        let added = renderer.cache.add(gpu, next.as_encoded(), look).unwrap()[0];
        assert_eq!(added, asked);
        compare(&renderer, next, (added, look), (4, 2.0), &mut rng);
        renderer.cache.remove(gpu, added);
    }
}

#[test]
fn a_pool_that_is_too_small_shows_coarser_levels_until_it_suffices() {
    let Some(gpu) = gpu() else { return };
    let options = TileOptions { pool_bytes: 1 << 20, ..options() };
    let mut renderer = Renderer::new(gpu, &options);
    let texture = encode("dct", crop(&image("facade"), (0, 0), (512, 512)), true);
    let added = renderer.cache.add(gpu, texture.as_encoded(), TileLook::default()).unwrap()[0];
    // All tiles of level 0: 25, where the pool has places for 12 beside tails.
    let view = whole_view(added);
    let mut drawn = Vec::new();
    for _ in 0..40 {
        drawn = renderer.frame(&view);
        assert!(drawn.iter().all(|colour| colour.w == 1.0), "a hole");
    }
    let report = renderer.cache.report(gpu).unwrap();
    assert!(report.missing == 0 && (0.5..=2.0).contains(&report.bias), "{report:?}");
    assert_ne!(drawn.first(), drawn.last());
    // Few tiles: the bias falls, and level 0 shows.
    let view = View { across: view.across / 16.0, down: view.down / 16.0, ..view };
    for _ in 0..200 {
        renderer.frame(&view);
    }
    assert_eq!(renderer.cache.report(gpu).unwrap().bias, 0.0);
}

#[test]
fn textures_come_and_go_and_take_nothing_with_them() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(gpu, &TileOptions { textures: 2, ..options() });
    let look = TileLook { address: AddressMode::Repeat, srgb: false };
    let mut rng = Rng::new(3);
    let one = encode("dct", crop(&image("facade"), (0, 0), (251, 247)), true);
    let other = encode("dct", crop(&image("terrain"), (0, 0), (192, 200)), true);
    for texture in [&one, &other, &one] {
        let held = hold(&mut renderer, texture, look, (0, 2.0), &mut rng);
        // The same places of the table as those of the texture before, whose tiles are all in the pool.
        let texture = texture.as_encoded();
        compare_view(&renderer, (texture, &Reference::new(texture, 0, look)), &whole_view(held), 2.0);
        let first = renderer.cache.add(gpu, other.as_encoded(), look).unwrap();
        let full = renderer.cache.add(gpu, one.as_encoded(), look);
        assert!(matches!(full, Err(GpuError::TilesFull { option: "textures", .. })), "{full:?}");
        for texture in [held, first[0]] {
            renderer.cache.remove(gpu, texture);
        }
        let view = random_view(&mut rng, ImageSize { width: 64, height: 64 }, 1, first[0]);
        assert!(renderer.frame(&view).iter().all(|colour| *colour == Vec4::ZERO));
    }
}

#[test]
fn a_file_that_arrives_in_pieces_shows_what_is_there() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(gpu, &options());
    let look = TileLook { address: AddressMode::Clamp, srgb: false };
    let whole = encode("dct", crop(&image("facade"), (0, 0), (200, 180)), true);
    let mut arriving = Arriving::new(Limits::default());
    let mut rng = Rng::new(9);
    let mut added = Vec::new();
    let mut shown = Vec::new();
    for piece in whole.to_bytes().chunks(64) {
        if matches!(arriving.push(piece).unwrap(), Arrived::Nothing) {
            continue;
        }
        let Some(texture) = arriving.texture() else { continue };
        match added.is_empty() {
            true => added = renderer.cache.add(gpu, texture.as_encoded(), look).unwrap(),
            false => renderer.cache.replace(gpu, &added, texture.as_encoded()).unwrap(),
        }
        compare(&renderer, texture, (added[0], look), (2, 2.0), &mut rng);
        shown.push(texture.as_encoded().layers().loaded);
    }
    assert!(shown.len() > 1 && shown.is_sorted(), "{shown:?}");
    renderer.cache.remove(gpu, added[0]);
    let gone = renderer.cache.replace(gpu, &added, whole.as_encoded());
    assert!(matches!(gone, Err(GpuError::NoSuchImage { image: 0, .. })), "{gone:?}");
}

#[test]
fn streams_of_several_buffers_are_read() {
    let Some(gpu) = gpu() else { return };
    let binding = gpu.device().limits().max_storage_buffer_binding_size;
    // The second buffer holds the streams of one of these textures.
    let options = TileOptions { stream_bytes: binding + 8192, ..options() };
    let mut renderer = Renderer::new(gpu, &options);
    let look = TileLook { address: AddressMode::Clamp, srgb: false };
    let textures = [(0, 0), (120, 7), (33, 90)]
        .map(|corner| encode("dct", crop(&image("facade"), corner, (112, 112)), false));
    let added = textures.each_ref().map(|t| renderer.cache.add(gpu, t.as_encoded(), look).unwrap()[0]);
    // Tiles of both buffers in one update.
    for texture in added {
        renderer.draw(&whole_view(texture));
    }
    renderer.frame(&whole_view(added[0]));
    assert_eq!(renderer.cache.report(gpu).unwrap().decoded, 3);
    let mut rng = Rng::new(5);
    for (texture, added) in textures.iter().zip(added) {
        compare(&renderer, texture, (added, look), (2, 2.0), &mut rng);
    }
}

/// What was looked at, once the GPU has come to it.
fn uses(renderer: &Renderer<'_>) -> Vec<TileUse> {
    let watch = renderer.cache.watch(renderer.gpu).unwrap();
    renderer.gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
    watch.poll(renderer.gpu).unwrap().unwrap()
}

#[test]
fn coarse_textures_tell_what_is_looked_at_and_show_it_once_it_is_there() {
    let Some(gpu) = gpu() else { return };
    let look = TileLook { address: AddressMode::Clamp, srgb: false };
    let [facade, terrain] =
        ["facade", "terrain"].map(|name| encode("dct", crop(&image(name), (0, 0), (250, 246)), true));
    let share = TileBytes::of(facade.as_encoded()).held;
    let mut renderer = Renderer::new(gpu, &TileOptions { stream_bytes: share * 3 / 2, ..options() });
    let mut coarse = |texture: &AnyImage| renderer.cache.add_coarse(gpu, texture.as_encoded(), look).unwrap();
    let (first, second) = (coarse(&facade), coarse(&terrain));
    assert_eq!(uses(&renderer), []);
    // The largest level that is there, of 31 columns.
    let view = whole_view(first[0]);
    let reference = Reference::new(facade.as_encoded(), 0, look);
    let texels = renderer.settled(&view);
    for (place, found) in (0u32..).zip(&texels) {
        let at = DVec2::new(f64::from(place % VIEW) + 0.5, f64::from(place / VIEW) + 0.5);
        let off =
            found.as_dvec4() - reference.bilinear(3, view.origin + view.across * at.x + view.down * at.y);
        assert!(off.abs().max_element() <= 2.0 / 255.0, "{at}");
    }
    assert_eq!(renderer.cache.report(gpu).unwrap().decoded, 0);
    assert_eq!(uses(&renderer), [TileUse { texture: first[0], level: 0, frames: 0 }]);
    renderer.frame(&View { lod: 1.0, ..whole_view(second[0]) });
    let used = [
        TileUse { texture: first[0], level: 0, frames: 1 },
        TileUse { texture: second[0], level: 1, frames: 0 },
    ];
    assert_eq!(uses(&renderer), used);

    renderer.cache.replace(gpu, &first, facade.as_encoded()).unwrap();
    compare_view(&renderer, (facade.as_encoded(), &reference), &view, 2.0);
    // Streams of both do not fit; of the first one tiles remain without them.
    let full = renderer.cache.replace(gpu, &second, terrain.as_encoded());
    assert!(matches!(full, Err(GpuError::TilesFull { option: "stream_bytes", .. })), "{full:?}");
    renderer.cache.make_coarse(gpu, first[0]);
    renderer.cache.replace(gpu, &second, terrain.as_encoded()).unwrap();
    // It takes the pages of one that was looked at.
    assert!(uses(&renderer).iter().all(|used| used.texture == first[0]));
    compare_view(&renderer, (facade.as_encoded(), &reference), &view, 2.0);
    let mut rng = Rng::new(3);
    compare(&renderer, &terrain, (second[0], look), (4, 2.0), &mut rng);
}

#[test]
fn sizes_that_a_device_or_a_cache_does_not_have_are_refused() {
    let Some(gpu) = gpu() else { return };
    let texture = encode("dct", crop(&image("facade"), (0, 0), (200, 200)), true);
    for (options, wanted) in [
        (TileOptions { stream_bytes: 1 << 10, ..options() }, "stream_bytes"),
        (TileOptions { pages: 3, ..options() }, "pages"),
        (TileOptions { scratch_bytes: 1 << 10, ..options() }, "scratch_bytes"),
    ] {
        let mut cache = TileCache::new(gpu, &options).unwrap();
        let found = cache.add(gpu, texture.as_encoded(), TileLook::default());
        assert!(matches!(found, Err(GpuError::TilesFull { option, .. }) if option == wanted), "{found:?}");
    }
    let small = TileCache::new(gpu, &TileOptions { pool_bytes: 1 << 20, textures: 33, ..options() });
    assert!(matches!(small, Err(GpuError::TilesFull { option: "pool_bytes", .. })));
    let limit = gpu.device().limits().max_storage_buffer_binding_size;
    let large = TileCache::new(gpu, &TileOptions { scratch_bytes: limit + 4, ..options() });
    assert!(matches!(large, Err(GpuError::TileLimit { .. })));
}

#[test]
fn a_texture_takes_the_bytes_of_its_share() {
    let Some(gpu) = gpu() else { return };
    let held = [false, true].map(|mips| {
        let settings = EncodeSettings { mips, effort: Effort::Fast, ..EncodeSettings::default() };
        let settings = EncodeSettings { codec: Choice::named("dct").unwrap(), ..settings };
        let set = ImageSet::new(vec![image("facade"), crop(&image("terrain"), (0, 0), (130, 70))]).unwrap();
        let texture =
            texfold::encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
        let texture = texture.as_encoded();
        let share = TileBytes::of(texture);
        let constants = 4 * u64::from(texfold_shaders::DCT_TABLES);
        for (missing, fits) in [(0, true), (4, false)] {
            let stream_bytes = constants + share.held - missing;
            let options = TileOptions { stream_bytes, ..options() };
            let mut cache = TileCache::new(gpu, &options).unwrap();
            let added = cache.add(gpu, texture, TileLook::default());
            assert_eq!(added.is_ok(), fits, "{mips} {missing}");
        }
        // 256 is three tiles of 120 texels, 128 two, 64 one; 130 two by one, 65 one; with the tails that share a tile.
        let tiles = if mips { 9 + 4 + 1 + 2 + 1 + 1 } else { 9 + 2 + 1 };
        assert_eq!(share.decoded, tiles * 4 * 128 * 128, "{mips}");
        share.held
    });
    // Stored levels of these images are in their tails, which are uploaded as texels.
    assert_eq!(held[0], held[1]);
}

/// As after a driver's reset: the caller learns of it from its device, makes another and fills a new cache.
#[test]
fn a_lost_device_ends_in_errors_and_another_draws() {
    if gpu().is_none() {
        return;
    }
    let settings = EncodeSettings { effort: Effort::Fast, ..EncodeSettings::default() };
    let set = ImageSet::single(image("facade"));
    let texture = texfold::encode_images(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
    let texture = texture.as_encoded();
    let lost = Gpu::new(Policy::Require).unwrap();
    let mut cache = TileCache::new(&lost, &options()).unwrap();
    let numbers = cache.add(&lost, texture, TileLook::default()).unwrap();
    let uploaded = lost.upload(&texture.gpu()).unwrap();
    lost.device().destroy();

    // What a renderer does in the frames until it has heard of it.
    let _ = cache.add(&lost, texture, TileLook::default());
    cache.remove(&lost, numbers[0]);
    let mut encoder = lost.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    cache.update(&mut encoder);
    lost.queue().submit([encoder.finish()]);
    assert!(matches!(cache.report(&lost), Err(GpuError::Lost)));
    let whole = texfold_gpu::View::whole(0, (8, 8), texfold_gpu::Lookup::Fetch { level: 0 });
    assert!(matches!(lost.read_view(&uploaded, &whole), Err(GpuError::Lost)));

    let next = Gpu::new(Policy::Require).unwrap();
    let mut renderer = Renderer::new(&next, &options());
    renderer.cache.add(&next, texture, TileLook::default()).unwrap();
    let (across, down) = (DVec2::new(4e-3, 0.0), DVec2::new(0.0, 4e-3));
    let seen = renderer.settled(&View { origin: DVec2::ZERO, across, down, texture: 0, lod: -1.0 });
    assert!(seen.iter().any(|texel| texel.x != seen[0].x));
}

//! A scene is drawn without a window from the cache of tiles, and compared with the decoded files.

#![cfg(feature = "tiles")]

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bevy::asset::{AssetPlugin, RenderAssetUsages};
use bevy::camera::{RenderTarget, ScalingMode};
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::gpu_readback::{Readback, ReadbackComplete};
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::renderer::RenderAdapterInfo;
use bevy::window::ExitCondition;
use texfold_bevy::{TexfoldPlugin, TileContents, TileMaterial, TileOptions, TilePlugin, Tiles};
use wgpu_types::DeviceType;

const GOLDEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/golden");
/// Time until files are loaded, pipelines made and tiles decoded, by software.
const PATIENCE: Duration = Duration::from_secs(60);

/// An app that draws to an image of that size, and its last frame that was read back.
struct Stage {
    app: App,
    size: (u32, u32),
    frame: Arc<Mutex<Vec<u8>>>,
}

impl Stage {
    fn new(size: (u32, u32)) -> Stage {
        Stage::with(TileContents::Textures, size)
    }

    fn with(contents: TileContents, (width, height): (u32, u32)) -> Stage {
        let mut app = App::new();
        let window = WindowPlugin {
            primary_window: None,
            exit_condition: ExitCondition::DontExit,
            ..Default::default()
        };
        // Software Vulkan blurs what it filters along footprints.
        let options = TileOptions {
            anisotropy: 1,
            pool_bytes: 4 << 20,
            textures: 16,
            contents,
            ..TileOptions::default()
        };
        let assets = AssetPlugin { file_path: GOLDEN.to_owned(), ..Default::default() };
        let render = RenderPlugin { synchronous_pipeline_compilation: true, ..Default::default() };
        app.add_plugins((
            DefaultPlugins.set(window).set(assets).set(render),
            TexfoldPlugin,
            TilePlugin { options },
        ));
        while app.plugins_state() == bevy::app::PluginsState::Adding {
            bevy::tasks::tick_global_task_pools_on_main_thread();
        }
        app.finish();
        app.cleanup();
        let extent = Extent3d { width, height, depth_or_array_layers: 1 };
        let format = TextureFormat::Rgba8UnormSrgb;
        let zeros = [0; 4];
        let usage = RenderAssetUsages::default();
        let mut target = Image::new_fill(extent, TextureDimension::D2, &zeros, format, usage);
        target.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
        let world = app.world_mut();
        let target = world.resource_mut::<Assets<Image>>().add(target);
        let scaling_mode = ScalingMode::Fixed { width: width as f32, height: height as f32 };
        world.spawn((
            Camera3d::default(),
            Camera { clear_color: Color::BLACK.into(), ..Default::default() },
            RenderTarget::from(target.clone()),
            Projection::from(OrthographicProjection { scaling_mode, ..OrthographicProjection::default_3d() }),
            Transform::from_xyz(0.0, 0.0, 10.0).looking_at(Vec3::ZERO, Vec3::Y),
            Tonemapping::None,
            DebandDither::Disabled,
            Msaa::Off,
        ));
        let frame = Arc::new(Mutex::new(Vec::new()));
        let read = Arc::clone(&frame);
        let keep = move |event: On<ReadbackComplete>| read.lock().unwrap().clone_from(&event.data);
        world.spawn(Readback::texture(target)).observe(keep);
        Stage { app, size: (width, height), frame }
    }

    fn load<A: Asset>(&self, path: &'static str) -> Handle<A> {
        self.app.world().resource::<AssetServer>().load(path)
    }

    /// Draws a material on a rectangle that fills the image.
    fn fill<M: Material>(&mut self, material: M) -> Entity {
        let (width, height) = self.size;
        let world = self.app.world_mut();
        let mut mesh = Mesh::from(Rectangle::new(width as f32, height as f32));
        mesh.generate_tangents().unwrap();
        let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
        let material = world.resource_mut::<Assets<M>>().add(material);
        world.spawn((Mesh3d(mesh), MeshMaterial3d(material))).id()
    }

    /// Runs until a frame satisfies `is_done`, or as long as anything could take; gives the last one, rows without padding.
    fn frame_where(&mut self, is_done: impl Fn(&[u8]) -> bool) -> Vec<u8> {
        let (width, height) = self.size;
        let mut rows = Vec::new();
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            self.app.update();
            let frame = self.frame.lock().unwrap();
            rows = frame
                .chunks(frame.len().max(1).div_ceil(height as usize))
                .flat_map(|row| &row[..4 * width as usize])
                .copied()
                .collect();
            if !rows.is_empty() && is_done(&rows) {
                break;
            }
            drop(frame);
            std::thread::sleep(Duration::from_millis(2));
        }
        rows
    }
}

/// Level 0 of an image, opaque.
fn texels(file: &str, number: u32) -> ((u32, u32), Vec<u8>) {
    let texture = texfold::open(&std::fs::read(format!("{GOLDEN}/{file}")).unwrap()).unwrap();
    let texture = texture.into_image().unwrap();
    let rect = texture.as_encoded().layout().whole(number, 0).unwrap();
    let mut rgba = vec![0; 4 * rect.width as usize * rect.height as usize];
    texture.decode_rgba8(rect, &mut rgba, 4 * rect.width as usize).unwrap();
    rgba.chunks_mut(4).for_each(|texel| texel[3] = u8::MAX);
    ((rect.width, rect.height), rgba)
}

/// The largest difference.
fn apart(left: &[u8], right: &[u8]) -> u8 {
    assert_eq!(left.len(), right.len());
    left.iter().zip(right).map(|(left, right)| left.abs_diff(*right)).max().unwrap_or(0)
}

#[test]
fn an_image_is_drawn_as_it_is_decoded() {
    for (file, number) in [("dct_preset.txf", 0), ("vq_bc1_mips.txf", 0), ("vq_raw_sequence.txf", 3)] {
        let (size, expected) = texels(file, number);
        let mut stage = Stage::new(size);
        let handle = stage.load(file);
        stage.fill(TileMaterial { file: handle, image: number, unlit: true, ..Default::default() });
        let adapter = stage.app.world().resource::<RenderAdapterInfo>();
        // GPUs decode BC1 in their own ways, within 3 % and a rounding.
        let bound = if file.contains("bc1") && adapter.device_type != DeviceType::Cpu { 8 } else { 1 };
        let drawn = stage.frame_where(|frame| apart(frame, &expected) <= bound);
        assert!(apart(&drawn, &expected) <= bound, "{file}: {}", apart(&drawn, &expected));
    }
}

#[test]
fn maps_from_one_lookup_look_as_one_by_one() {
    let contents = [TileContents::Textures, TileContents::Materials { emissive: false }];
    let [one_by_one, together] = contents.map(|contents| {
        let mut stage = Stage::with(contents, (128, 128));
        let light = Transform::from_xyz(60.0, 40.0, 50.0).looking_at(Vec3::ZERO, Vec3::Y);
        stage.app.world_mut().spawn((DirectionalLight { illuminance: 5000.0, ..Default::default() }, light));
        let file = stage.load("dct_maps.txf");
        stage.fill(TileMaterial { file, metallic: 0.6, ..Default::default() });
        stage.frame_where(|frame| frame.chunks(4).any(|texel| texel[..3] != [0; 3]));
        // Until all tiles are decoded.
        (0..30).for_each(|_| stage.app.update());
        stage.frame_where(|_| true)
    });
    assert!(one_by_one.chunks(4).any(|texel| texel[..3] != [0; 3]));
    assert!(apart(&one_by_one, &together) <= 2, "{}", apart(&one_by_one, &together));
}

#[test]
fn light_falls_as_on_the_maps_of_bevy() {
    let mut stage = Stage::new((128, 128));
    let light = Transform::from_xyz(60.0, 40.0, 50.0).looking_at(Vec3::ZERO, Vec3::Y);
    stage.app.world_mut().spawn((DirectionalLight { illuminance: 5000.0, ..Default::default() }, light));
    let (perceptual_roughness, metallic) = (0.3, 0.6);
    let standard = stage.fill(StandardMaterial {
        base_color_texture: Some(stage.load("dct_material.txf#color")),
        normal_map_texture: Some(stage.load("dct_material.txf#normal")),
        perceptual_roughness,
        metallic,
        ..Default::default()
    });
    let is_drawn = |frame: &[u8]| frame.chunks(4).any(|texel| texel[..3] != [0; 3]);
    // Maps arrive after one another.
    stage.frame_where(is_drawn);
    (0..20).for_each(|_| stage.app.update());
    let expected = stage.frame_where(is_drawn);
    stage.app.world_mut().despawn(standard);
    stage.frame_where(|frame| !is_drawn(frame));
    let file = stage.load("dct_material.txf");
    let tiled = stage.fill(TileMaterial { file, perceptual_roughness, metallic, ..Default::default() });
    let drawn = stage.frame_where(|frame| apart(frame, &expected) <= 2);
    assert!(apart(&drawn, &expected) <= 2, "{}", apart(&drawn, &expected));
    // Without their last handle files leave the cache.
    let tiles = stage.app.world().resource::<Tiles>().clone();
    assert_eq!(tiles.files(), 1);
    stage.app.world_mut().despawn(tiled);
    stage.frame_where(|_| tiles.files() == 0);
    assert_eq!(tiles.files(), 0);
}

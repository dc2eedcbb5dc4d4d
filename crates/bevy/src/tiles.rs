//! A material that draws from a cache of decoded tiles: files lie on the GPU as they are on disk, and a pool of fixed size holds the tiles that
//! are seen, decoded by the GPU.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bevy_app::{App, Plugin, PostUpdate};
use bevy_asset::io::Reader;
use bevy_asset::{
    Asset, AssetApp, AssetEvent, AssetEventSystems, AssetId, AssetLoader, AssetMut, Assets, Handle,
    LoadContext, uuid_handle,
};
use bevy_color::{ColorToComponents, LinearRgba};
use bevy_ecs::message::MessageReader;
use bevy_ecs::resource::Resource;
use bevy_ecs::schedule::IntoScheduleConfigs;
use bevy_ecs::system::{Res, ResMut, SystemParamItem};
use bevy_material::descriptor::BindGroupLayoutDescriptor;
use bevy_material::{AlphaMode, OpaqueRendererMethod};
use bevy_pbr::{MATERIAL_BIND_GROUP_INDEX, Material, MaterialPlugin};
use bevy_reflect::TypePath;
use bevy_render::render_resource::{
    AsBindGroup, AsBindGroupError, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BindingResources,
    BindingType, BufferBindingType, BufferInitDescriptor, BufferUsages, CommandEncoderDescriptor,
    OwnedBindingResource, PipelineCache, PreparedBindGroup, ShaderStages, UnpreparedBindGroup,
};
use bevy_render::renderer::{RenderDevice, RenderQueue};
use bevy_render::{Render, RenderApp, RenderSystems};
use bevy_shader::{Shader, ShaderRef};
use texfold::AnyImage;
use texfold::core::image::MapKind;
use texfold_gpu::{Gpu, GpuError, TileCache, TileLook, TileOptions, TileTexture};

use crate::{TexfoldError, TexfoldSettings};

/// The shader of [`TileMaterial`], made with the cache's options.
const SHADER: Handle<Shader> = uuid_handle!("5a9c2f0e-3d57-4b7c-9a61-6f1d2c8e4b90");
/// No map in the uniform.
const NO_MAP: u32 = u32::MAX;
/// Flags of `pbr_types.wgsl`.
const UNLIT: u32 = 1 << 5;
const FOG: u32 = 1 << 8;
const ALPHA_MODE_SHIFT: u32 = 29;

/// Draws [`TileMaterial`] from a cache of tiles; behind `DefaultPlugins`.
///
/// With [`TileContents::Materials`](crate::TileContents::Materials) as the options' contents, all maps of a material are found by one lookup and decoded together; they take
/// three layers of the pool, four with emitted light. Else, and where their sides are not those of the largest, halves, quarters or eighths, each is looked up by itself.
///
/// Where the cache cannot be made, as on a device with lower limits than the options take, that is logged and nothing of these materials
/// is drawn.
#[derive(Debug, Default, Clone, Copy)]
pub struct TilePlugin {
    /// Sizes of the cache.
    pub options: TileOptions,
}

/// A file that is not decoded: images, or the maps of a material.
#[derive(Asset, TypePath, Debug, Clone)]
pub struct TexfoldFile(Arc<AnyImage>);

impl TexfoldFile {
    /// The texture of the file.
    #[must_use]
    pub fn texture(&self) -> &AnyImage {
        &self.0
    }
}

impl From<AnyImage> for TexfoldFile {
    fn from(texture: AnyImage) -> Self {
        TexfoldFile(Arc::new(texture))
    }
}

/// A material of Bevy's lighting whose maps are those of a file. A file without maps is its base colour.
///
/// Meshes take texture coordinates, and tangents where there is a map of normals. Shadows are those of the whole mesh, also where
/// alpha is masked.
#[derive(Asset, TypePath, Debug, Clone)]
pub struct TileMaterial {
    /// The file; nothing is drawn before it is loaded.
    pub file: Handle<TexfoldFile>,
    /// Number of the image that is drawn, of files without maps.
    pub image: u32,
    /// Factor of the base colour.
    pub base_color: LinearRgba,
    /// Factor of the map of emitted light.
    pub emissive: LinearRgba,
    /// Roughness where no map has it.
    pub perceptual_roughness: f32,
    /// Metalness where no map has it.
    pub metallic: f32,
    /// Whether red of the map of roughness (green) and metalness (blue) is occlusion. glTF leaves it open.
    pub packed_occlusion: bool,
    /// Whether light has no influence.
    pub unlit: bool,
    /// Use of alpha, which is that of the base colour times the map of opacity.
    pub alpha_mode: AlphaMode,
}

impl Default for TileMaterial {
    fn default() -> Self {
        TileMaterial {
            file: Handle::default(),
            image: 0,
            base_color: LinearRgba::WHITE,
            emissive: LinearRgba::WHITE,
            perceptual_roughness: 0.5,
            metallic: 0.0,
            packed_occlusion: false,
            unlit: false,
            alpha_mode: AlphaMode::Opaque,
        }
    }
}

/// The cache of tiles, the same in both worlds.
#[derive(Resource, Clone)]
pub struct Tiles(Arc<Mutex<Held>>);

struct Held {
    gpu: Gpu,
    cache: TileCache,
    files: HashMap<AssetId<TexfoldFile>, Images>,
}

/// The images of a file in the cache.
enum Images {
    /// Each looked up by itself, with the kinds of maps.
    Apart(Vec<(Option<MapKind>, TileTexture)>),
    /// Maps of a material from one lookup, and their kinds.
    Material(TileTexture, Vec<MapKind>),
}

impl Images {
    /// The number of a map in the cache, or [`NO_MAP`].
    fn of_kind(&self, kind: MapKind) -> u32 {
        let found = match self {
            Images::Apart(images) => {
                images.iter().find(|(found, _)| *found == Some(kind)).map(|(_, own)| own)
            }
            Images::Material(texture, kinds) => kinds.contains(&kind).then_some(texture),
        };
        found.map_or(NO_MAP, |texture| texture.index())
    }
}

impl Tiles {
    /// Bytes of GPU memory of the whole cache, which stay the same as files come and go.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.held().cache.bytes()
    }

    /// Number of files that lie in the cache.
    #[must_use]
    pub fn files(&self) -> usize {
        self.held().files.len()
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Held {
    fn add(&mut self, id: AssetId<TexfoldFile>, file: &TexfoldFile) -> Result<(), GpuError> {
        self.remove(id);
        let encoded = file.0.as_encoded();
        let maps = &encoded.layout().maps;
        if !maps.is_empty() {
            match self.cache.add_material(&self.gpu, encoded, TileLook::default()) {
                Ok(texture) => {
                    let kinds = maps.iter().map(|map| map.kind).collect();
                    self.files.insert(id, Images::Material(texture, kinds));
                    return Ok(());
                }
                // Maps of other sizes or kinds, or a cache without layers for them.
                Err(GpuError::Material { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        let textures = self.cache.add(&self.gpu, encoded, TileLook::default())?;
        let kinds = (0..).map(|number: usize| maps.get(number).map(|map| map.kind));
        self.files.insert(id, Images::Apart(kinds.zip(textures).collect()));
        Ok(())
    }

    fn remove(&mut self, id: AssetId<TexfoldFile>) {
        let textures = match self.files.remove(&id) {
            Some(Images::Apart(images)) => images.into_iter().map(|(_, texture)| texture).collect(),
            Some(Images::Material(texture, _)) => vec![texture],
            None => Vec::new(),
        };
        textures.into_iter().for_each(|texture| self.cache.remove(&self.gpu, texture));
    }
}

impl Plugin for TilePlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<TexfoldFile>().register_asset_loader(TexfoldFileLoader);
        app.add_plugins(MaterialPlugin::<TileMaterial>::default());
        app.add_systems(PostUpdate, follow_files.after(AssetEventSystems));
    }

    fn finish(&self, app: &mut App) {
        let world = app.world_mut();
        let (Some(device), Some(queue)) =
            (world.get_resource::<RenderDevice>(), world.get_resource::<RenderQueue>())
        else {
            return;
        };
        let gpu = Gpu::from_device(device.wgpu_device().clone(), (**queue.0).clone());
        let cache = match TileCache::new(&gpu, &self.options) {
            Ok(cache) => cache,
            Err(error) => return tracing::error!("no cache of tiles: {error}"),
        };
        let shader = [&cache.wgsl(MATERIAL_BIND_GROUP_INDEX as u32), include_str!("tiles.wgsl")].join("\n");
        let shader = Shader::from_wgsl(shader, "texfold_bevy/tiles.wgsl");
        let tiles = Tiles(Arc::new(Mutex::new(Held { gpu, cache, files: HashMap::new() })));
        if let Err(error) = world.resource_mut::<Assets<Shader>>().insert(SHADER.id(), shader) {
            return tracing::error!("no shader of tiles: {error}");
        }
        world.insert_resource(tiles.clone());
        if let Some(render) = app.get_sub_app_mut(RenderApp) {
            render.insert_resource(tiles);
            render.add_systems(Render, decode_tiles.in_set(RenderSystems::Cleanup));
        }
    }
}

/// Decodes what the frame before looked at and did not find.
fn decode_tiles(tiles: Res<'_, Tiles>, device: Res<'_, RenderDevice>, queue: Res<'_, RenderQueue>) {
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("tiles") });
    tiles.held().cache.update(&mut encoder);
    queue.submit([encoder.finish()]);
}

/// Adds files to the cache as they are loaded, and removes them with their last handle.
fn follow_files(
    mut events: MessageReader<'_, '_, AssetEvent<TexfoldFile>>,
    files: Res<'_, Assets<TexfoldFile>>,
    mut materials: ResMut<'_, Assets<TileMaterial>>,
    tiles: Option<Res<'_, Tiles>>,
) {
    let Some(tiles) = tiles else { return };
    let mut held = tiles.held();
    for event in events.read() {
        match *event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => {
                let Some(file) = files.get(id) else { continue };
                if let Err(error) = held.add(id, file) {
                    tracing::error!("a file is not in the cache of tiles: {error}");
                }
                // Materials name textures of the cache.
                let of_file = materials.iter().filter(|(_, material)| material.file.id() == id);
                for material in of_file.map(|(material, _)| material).collect::<Vec<_>>() {
                    let _changed = materials.get_mut(material).map(AssetMut::into_inner);
                }
            }
            AssetEvent::Removed { id } => held.remove(id),
            AssetEvent::Unused { .. } | AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}

impl TileMaterial {
    /// The material as `TexfoldMaterial` of the shader; `None` before its file is loaded.
    fn uniform(&self, held: &Held) -> Option<[u8; 96]> {
        let images = held.files.get(&self.file.id())?;
        let base_color = match images {
            Images::Apart(all) if all.iter().all(|(kind, _)| kind.is_none()) => {
                all.get(self.image as usize).map_or(NO_MAP, |(_, texture)| texture.index())
            }
            _ => images.of_kind(MapKind::BaseColor),
        };
        let material = if let Images::Material(texture, _) = images { texture.index() } else { NO_MAP };
        let (mode, cutoff) = match self.alpha_mode {
            AlphaMode::Opaque => (0, 0.5),
            AlphaMode::Mask(cutoff) => (1, cutoff),
            AlphaMode::Blend => (2, 0.5),
            AlphaMode::Premultiplied => (3, 0.5),
            AlphaMode::Add => (4, 0.5),
            AlphaMode::Multiply => (5, 0.5),
            AlphaMode::AlphaToCoverage => (6, 0.5),
        };
        let unlit = if self.unlit { UNLIT } else { 0 };
        let factors = [self.perceptual_roughness, self.metallic, cutoff, 0.0];
        let colors = [self.base_color, self.emissive].map(|color| color.to_f32_array());
        let floats = colors.into_iter().chain([factors]).flatten().map(f32::to_bits);
        // In the order of the shader's.
        let maps = [
            MapKind::Normal,
            MapKind::OcclusionRoughnessMetalness,
            MapKind::Emissive,
            MapKind::Roughness,
            MapKind::Metalness,
            MapKind::Occlusion,
            MapKind::Opacity,
        ];
        let flags = [unlit | FOG | (mode << ALPHA_MODE_SHIFT), u32::from(self.packed_occlusion), material, 0];
        let mut bytes = [0; 96];
        let words = floats.chain([base_color]).chain(maps.map(|kind| images.of_kind(kind))).chain(flags);
        for (bytes, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *bytes = word.to_le_bytes();
        }
        Some(bytes)
    }
}

impl AsBindGroup for TileMaterial {
    type Data = ();
    type Param = Option<Res<'static, Tiles>>;

    fn label() -> &'static str {
        "texfold tiles"
    }

    fn bind_group_data(&self) {}

    fn unprepared_bind_group(
        &self,
        _: &BindGroupLayout,
        _: &RenderDevice,
        _: &mut SystemParamItem<'_, '_, Self::Param>,
        _: bool,
    ) -> Result<UnpreparedBindGroup, AsBindGroupError> {
        Err(AsBindGroupError::CreateBindGroupDirectly)
    }

    fn as_bind_group(
        &self,
        layout: &BindGroupLayoutDescriptor,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        tiles: &mut SystemParamItem<'_, '_, Self::Param>,
    ) -> Result<PreparedBindGroup, AsBindGroupError> {
        let tiles = tiles.as_ref().ok_or(AsBindGroupError::RetryNextUpdate)?;
        let held = tiles.held();
        let contents = self.uniform(&held).ok_or(AsBindGroupError::RetryNextUpdate)?;
        let uniform = device.create_buffer_with_data(&BufferInitDescriptor {
            label: Some("texfold material"),
            contents: &contents,
            usage: BufferUsages::UNIFORM,
        });
        let resources = held.cache.bindings().into_iter().chain([uniform.as_entire_binding()]);
        let entry = |(binding, resource)| BindGroupEntry { binding, resource };
        let entries: Vec<_> = (0..).zip(resources).map(entry).collect();
        let layout = pipelines.get_bind_group_layout(layout);
        let bind_group = device.create_bind_group(Self::label(), &layout, &entries);
        let number = entries.len() as u32 - 1;
        let bindings = BindingResources(vec![(number, OwnedBindingResource::Buffer(uniform))]);
        Ok(PreparedBindGroup { bindings, bind_group })
    }

    fn bind_group_layout_entries(_: &RenderDevice, _: bool) -> Vec<BindGroupLayoutEntry> {
        let uniform = BindingType::Buffer {
            ty: BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let entry = |(binding, ty)| BindGroupLayoutEntry {
            binding,
            visibility: ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        (0..).zip(TileCache::binding_types().into_iter().chain([uniform])).map(entry).collect()
    }
}

impl Material for TileMaterial {
    fn fragment_shader() -> ShaderRef {
        SHADER.into()
    }

    fn alpha_mode(&self) -> AlphaMode {
        self.alpha_mode
    }

    fn opaque_render_method(&self) -> OpaqueRendererMethod {
        OpaqueRendererMethod::Forward
    }

    fn enable_prepass() -> bool {
        false
    }
}

/// The loader of [`TilePlugin`].
#[derive(Debug, Default, Clone, Copy, TypePath)]
pub struct TexfoldFileLoader;

impl AssetLoader for TexfoldFileLoader {
    type Asset = TexfoldFile;
    type Settings = TexfoldSettings;
    type Error = TexfoldError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &TexfoldSettings,
        _: &mut LoadContext<'_>,
    ) -> Result<TexfoldFile, TexfoldError> {
        Ok(crate::read(reader, settings).await?.into())
    }

    /// None, so that labels are those of [`crate::TexfoldLoader`]; Bevy finds this loader by its type.
    fn extensions(&self) -> &[&str] {
        &[]
    }
}

//! Texfold files in [Bevy](https://bevy.org), in two ways: decoded whole as images, for any material; or, with the feature `tiles`, compressed
//! on the GPU, which decodes the tiles that are seen.
//!
//! # Images
//!
//! With [`TexfoldPlugin`], `asset_server.load("stone.txf")` gives a `Handle<Image>` with all stored mip levels.
//!
//! ```no_run
//! use bevy_app::App;
//! use texfold_bevy::TexfoldPlugin;
//!
//! let mut app = App::new();
//! // app.add_plugins(DefaultPlugins)
//! app.add_plugins(TexfoldPlugin);
//! // base_color_texture: Some(asset_server.load("stone.txf#color")), normal_map_texture: Some(asset_server.load("stone.txf#normal"))
//! ```
//!
//! The CPU decodes while the asset is loaded, to 8 bits a channel, or 16 where the source has more, which takes a device with
//! `TEXTURE_FORMAT_16BIT_NORM`. Images in sRGB have an sRGB format, as Bevy wants base colours. The maps of a material and the images of a set
//! are labelled: maps by their kinds (their names where several are of a kind), images by their numbers ("stone.txf#normal", "walk.txf#3");
//! the asset itself is the first.
//!
//! # A cache of tiles
//!
//! With `TilePlugin`, the file itself is the asset, and a `TileMaterial` draws its maps under Bevy's lights. A pool of fixed size holds the decoded
//! tiles; materials share it.
//!
//! ```no_run
//! # #[cfg(feature = "tiles")]
//! # mod example {
//! use bevy::prelude::*;
//! use texfold_bevy::{TileMaterial, TilePlugin};
//!
//! fn main() {
//!     App::new().add_plugins((DefaultPlugins, TilePlugin::default())).add_systems(Startup, wall).run();
//! }
//!
//! fn wall(
//!     mut commands: Commands,
//!     server: Res<AssetServer>,
//!     mut meshes: ResMut<Assets<Mesh>>,
//!     mut materials: ResMut<Assets<TileMaterial>>,
//! ) {
//!     let material = TileMaterial { file: server.load("stone.txf"), ..default() };
//!     commands.spawn((Mesh3d(meshes.add(Cuboid::default())), MeshMaterial3d(materials.add(material))));
//! }
//! # }
//! ```

#[cfg(feature = "tiles")]
mod tiles;

use bevy_app::{App, Plugin};
use bevy_asset::io::Reader;
use bevy_asset::{AssetApp, AssetLoader, Assets, LoadContext, RenderAssetUsages};
use bevy_image::Image;
use bevy_reflect::TypePath;
use serde::{Deserialize, Serialize};
use texfold::core::ImageSize;
use texfold::core::image::{Depth, ImageLayout, PixelInfo};
use texfold::{AnyImage, AnyTexture, BytesError, ColorSpace, Limits, LoadError};
#[cfg(feature = "tiles")]
pub use texfold_gpu::{TileContents, TileOptions};
#[cfg(feature = "tiles")]
pub use tiles::{TexfoldFile, TexfoldFileLoader, TileMaterial, TilePlugin, Tiles};
use wgpu_types::{Extent3d, TextureDimension, TextureFormat};

/// Loads `.txf` files.
#[derive(Debug, Default, Clone, Copy)]
pub struct TexfoldPlugin;

impl Plugin for TexfoldPlugin {
    fn build(&self, app: &mut App) {
        // A second time would drop the images that plugins before have added.
        if !app.world().contains_resource::<Assets<Image>>() {
            app.init_asset::<Image>();
        }
        app.register_asset_loader(TexfoldLoader);
    }
}

/// The loader of [`TexfoldPlugin`].
#[derive(Debug, Default, Clone, Copy, TypePath)]
pub struct TexfoldLoader;

/// Settings of a file, as its `.meta` has them.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(default)]
pub struct TexfoldSettings {
    /// Finest mip levels to leave out; each takes four times the memory of the next. The coarsest one is always loaded.
    pub skipped_levels: u32,
    /// Largest number of bytes that opening the file may allocate.
    pub max_bytes: u64,
    /// Worlds that hold the texels, as of any image of Bevy.
    pub asset_usage: RenderAssetUsages,
}

impl Default for TexfoldSettings {
    fn default() -> Self {
        let (max_bytes, asset_usage) = (Limits::default().bytes, RenderAssetUsages::RENDER_WORLD);
        TexfoldSettings { skipped_levels: 0, max_bytes, asset_usage }
    }
}

/// Causes for which a file is no image.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TexfoldError {
    /// The file cannot be read.
    #[error("the file cannot be read")]
    Read(#[from] std::io::Error),
    /// It holds no textures of images, or is damaged.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Its texels cannot be decoded.
    #[error(transparent)]
    Decode(#[from] BytesError),
}

impl AssetLoader for TexfoldLoader {
    type Asset = Image;
    type Settings = TexfoldSettings;
    type Error = TexfoldError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &TexfoldSettings,
        context: &mut LoadContext<'_>,
    ) -> Result<Image, TexfoldError> {
        let texture = read(reader, settings).await?;
        let layout = texture.as_encoded().layout().clone();
        let first = image(&texture, 0, settings)?;
        if layout.images.len() > 1 || !layout.maps.is_empty() {
            context.add_labeled_asset(label(&layout, 0), first.clone());
        }
        for number in 1..layout.images.len() {
            context.add_labeled_asset(label(&layout, number), image(&texture, number as u32, settings)?);
        }
        Ok(first)
    }

    fn extensions(&self) -> &[&str] {
        &["txf"]
    }
}

/// Opens the file of a reader.
async fn read(reader: &mut dyn Reader, settings: &TexfoldSettings) -> Result<AnyImage, TexfoldError> {
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).await?;
    let limits = Limits { bytes: settings.max_bytes, ..Limits::default() };
    Ok(texfold::open_with(&bytes, &limits).and_then(AnyTexture::into_image)?)
}

/// The label of an image: the kind of a map, its name where others are of that kind, else its number.
fn label(layout: &ImageLayout, number: usize) -> String {
    let Some(map) = layout.maps.get(number) else { return number.to_string() };
    let is_alone = layout.maps.iter().filter(|other| other.kind == map.kind).count() == 1;
    if is_alone { map.kind.name().to_owned() } else { map.name.clone() }
}

/// An image of a texture with its levels.
///
/// # Errors
/// [`TexfoldError::Decode`] where there is no such image.
pub fn image(texture: &AnyImage, number: u32, settings: &TexfoldSettings) -> Result<Image, TexfoldError> {
    let layout = texture.as_encoded().layout();
    let pixel = layout.pixel_of(number);
    let size = layout.images.get(number as usize).copied().unwrap_or(ImageSize { width: 1, height: 1 });
    let levels = layout.levels.min(size.full_levels());
    let first = settings.skipped_levels.min(levels - 1);
    let mut data = Vec::new();
    for level in first..levels {
        let size = size.at_level(level);
        let rect = texfold::Rect { image: number, level, x: 0, y: 0, width: size.width, height: size.height };
        let values = 4 * size.width as usize * size.height as usize;
        if pixel.depth == Depth::Sixteen {
            let mut rgba = vec![0; values];
            texture.decode_rgba16(rect, &mut rgba, 4 * size.width as usize)?;
            data.extend(rgba.into_iter().flat_map(u16::to_le_bytes));
        } else {
            let start = data.len();
            data.resize(start + values, 0);
            texture.decode_rgba8(rect, &mut data[start..], 4 * size.width as usize)?;
        }
    }
    let ImageSize { width, height } = size.at_level(first);
    let extent = Extent3d { width, height, depth_or_array_layers: 1 };
    let mut image = Image::new_uninit(extent, TextureDimension::D2, format_of(pixel), settings.asset_usage);
    image.texture_descriptor.mip_level_count = levels - first;
    image.data = Some(data);
    Ok(image)
}

/// The format of an image of such pixels. WebGPU has no sRGB format of 16 bits: such values are as stored.
fn format_of(pixel: PixelInfo) -> TextureFormat {
    match (pixel.depth, pixel.color) {
        (Depth::Sixteen, _) => TextureFormat::Rgba16Unorm,
        (_, ColorSpace::Srgb) => TextureFormat::Rgba8UnormSrgb,
        _ => TextureFormat::Rgba8Unorm,
    }
}

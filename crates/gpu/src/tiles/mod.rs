//! A cache of decoded tiles for any number of textures in superblocks, filled by the GPU alone.
//!
//! Compressed streams of all textures lie in one buffer. Decoded texels lie in a pool of tiles of 128 texels a side, 4 of which
//! are border, so that the hardware filters inside of a tile; a table of pages says where each tile lies, if anywhere. Shaders that draw
//! call `texfold_tile_sample` ([`TileCache::wgsl`]), which marks the tiles it looks at. [`TileCache::update`], once a frame,
//! records compute passes that choose among the marked tiles that are missing, the coarsest first, give them the places that were not
//! looked at for longest, and decode them. Nothing is read back. Until a tile is there the nearest coarser one shows; the levels of at most 32 texels
//! a side, decoded by the CPU when a texture is added, are always there.
//!
//! One bind group serves all textures, of any size: within WebGPU's default limits, with 8192 texels a side and 256 layers of the pool.
//! A pool that is too small for the view raises a mip bias until it suffices.
//!
//! Textures of other codecs are uploaded as [`Gpu::upload`] does, and their tiles are drawn from that.
//!
//! Streams that do not fit one binding of the device, 128 MiB where it was made with WebGPU's defaults, lie in several buffers.
//!
//! *Not done*: pools of more than 8 bits a sample (16-bit samples are rounded to 8).

mod buffers;
mod options;
mod parts;
mod pipelines;
mod rows;
mod share;
mod streams;
mod tail;
mod watch;

use std::ops::Range;
use std::sync::Arc;

use range_alloc::RangeAllocator;
use texfold_core::image::ColorSpace;
use texfold_core::{Encoded, GpuDct, Image2d, ImageSize};
use texfold_shaders::{DctChannel, ModuleInfo};
use wgpu::{BindingResource, BindingType, BufferUsages, CommandEncoder, Extent3d, Texture, TextureUsages};

use crate::upload::PLAIN_MODULE;
use crate::{AddressMode, Gpu, GpuError, GpuTexture, compute};
use buffers::Buffers;
pub use options::{TileContents, TileLook, TileOptions, TileReport, TileTexture};
use parts::Part;
use pipelines::{Drawn, Pipelines, Resources, STEP_STRIDE, Source};
use rows::{
    CLAMP, COARSE, FEEDBACK_BYTES, INNER, MOST_LEVELS, MOST_TILES, PLANES, SIDE, SRGB, StageRow, TextureRow,
    tail_of,
};
pub use share::TileBytes;
use streams::Streams;
pub use watch::{TileUse, TileWatch};

/// Format of the pool.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Texels along a side of a quarter of a tile, which holds a tail.
const QUARTER: u32 = SIDE / 2;
/// A place of the pool that holds tails.
const KEPT: u32 = u32::MAX;
/// Largest anisotropy: half of such a footprint, and half a texel of filtering, lie within a tile's border.
const MOST_ANISOTROPY: u16 = 2 * rows::BORDER as u16 - 1;

/// A texture's share of the cache.
#[derive(Debug, Default)]
struct Held {
    look: TileLook,
    /// Whether its images are the maps of a material.
    is_material: bool,
    row: TextureRow,
    /// The pass that draws its tiles, for textures that are not in superblocks.
    source: Option<Source>,
    pages: Range<u32>,
    stages: Range<u32>,
    /// Words and streams of each stage, in words of the data.
    data: Vec<Range<u32>>,
}

impl Held {
    /// Pages of each level that has tiles of its own.
    fn levels(&self) -> Vec<Range<u32>> {
        let starts = self.row.levels.iter().filter(|[_, columns]| *columns > 0).map(|[start, _]| *start);
        let ends = starts.clone().skip(1).chain([self.pages.end]);
        starts.zip(ends).map(|(start, end)| start..end).collect()
    }
}

/// A texture to add: its stages where it is in superblocks, or as it is drawn; neither where its tail alone is to be held.
struct TileSource<'t> {
    texture: &'t dyn Encoded<Domain = Image2d>,
    stages: Vec<GpuDct<'t>>,
    uploaded: Option<Arc<GpuTexture>>,
    is_coarse: bool,
}

impl<'t> TileSource<'t> {
    fn new(gpu: &Gpu, texture: &'t dyn Encoded<Domain = Image2d>) -> Result<Self, GpuError> {
        let form = texture.gpu();
        if !form.blocks.is_empty() && form.module == PLAIN_MODULE {
            return Ok(TileSource { texture, stages: form.blocks, uploaded: None, is_coarse: false });
        }
        let uploaded = Some(Arc::new(gpu.upload(&form)?));
        Ok(TileSource { texture, stages: Vec::new(), uploaded, is_coarse: false })
    }

    fn coarse(texture: &'t dyn Encoded<Domain = Image2d>) -> Self {
        TileSource { texture, stages: Vec::new(), uploaded: None, is_coarse: true }
    }
}

/// A cache of decoded tiles.
#[derive(Debug)]
pub struct TileCache {
    options: TileOptions,
    pipelines: Pipelines,
    pool: Texture,
    stored: wgpu::TextureView,
    buffers: Buffers,
    /// Pipelines that draw tiles of textures of a module.
    drawing: Vec<(&'static ModuleInfo, wgpu::ComputePipeline)>,
    scratch_words: u64,
    held: Vec<Option<Held>>,
    /// Free ranges of the tables.
    pages: RangeAllocator<u32>,
    stages: RangeAllocator<u32>,
    streams: Streams,
}

impl TileCache {
    /// Makes the pool, buffers and pipelines.
    ///
    /// # Errors
    /// [`GpuError::TileLimit`] where the device was made with lower limits than the options need, [`GpuError::TilesFull`] where the pool is
    /// too small for so many textures, [`GpuError`] where the device refuses.
    pub fn new(gpu: &Gpu, options: &TileOptions) -> Result<TileCache, GpuError> {
        let options = TileOptions {
            textures: options.textures.clamp(1, 1 << 20),
            pages: options.pages.max(1),
            tiles_per_update: options.tiles_per_update.clamp(1, MOST_TILES),
            anisotropy: options.anisotropy.clamp(1, MOST_ANISOTROPY),
            stride: 1 << options.stride.clamp(1, 8).ilog2(),
            ..*options
        };
        let limits = gpu.device.limits();
        let [side, layers] = pool_size(&options, limits.max_texture_array_layers);
        let slots = (side / SIDE).pow(2) * (layers / options.contents.layers());
        if options.textures.div_ceil(4) > slots / 2 {
            let what = "the smallest levels of so many textures would fill half of the pool";
            return Err(GpuError::TilesFull { what, option: "pool_bytes" });
        }
        let pages = FEEDBACK_BYTES + 4 * u64::from(options.pages);
        for (limit, needed, given) in [
            (
                "max_storage_buffers_per_shader_stage",
                7,
                u64::from(limits.max_storage_buffers_per_shader_stage),
            ),
            (
                "max_storage_buffer_binding_size",
                options.scratch_bytes,
                limits.max_storage_buffer_binding_size,
            ),
            ("max_storage_buffer_binding_size", pages, limits.max_storage_buffer_binding_size),
            ("max_texture_dimension_2d", u64::from(side), u64::from(limits.max_texture_dimension_2d)),
        ] {
            if needed > given {
                return Err(GpuError::TileLimit { limit, needed, given });
            }
        }
        gpu.guarded(|| Ok(TileCache::made(gpu, options, [side, layers])))
    }

    fn made(gpu: &Gpu, options: TileOptions, [side, layers]: [u32; 2]) -> TileCache {
        let pool = pool(&gpu.device, [side, layers]);
        let slots = (side / SIDE).pow(2) * (layers / options.contents.layers());
        let tails = options.textures.div_ceil(4);
        let buffers = Buffers::new(gpu, &options, slots);
        let binding_bytes = gpu.device.limits().max_storage_buffer_binding_size;
        let streams = Streams::new(gpu, options.stream_bytes, binding_bytes);
        // Places in buffers are 32 bits.
        let scratch_words = (options.scratch_bytes / 4).min(u64::from(u32::MAX));
        let sources = options.textures;
        let per_layer = side / SIDE;
        let layers = options.contents.layers();
        let settings =
            [slots, options.tiles_per_update, scratch_words as u32, sources, per_layer, layers, 0, 0];
        let settings = gpu.buffer("options of tiles", bytemuck::cast_slice(&settings), BufferUsages::UNIFORM);
        let mut steps = Vec::new();
        for step in (0..PLANES).map(|plane| [plane, 0, 0]).chain(streams.steps()) {
            steps.extend_from_slice(bytemuck::bytes_of(&step));
            steps.resize(steps.len().next_multiple_of(STEP_STRIDE as usize), 0);
        }
        let steps = gpu.buffer("steps of tiles", &steps, BufferUsages::UNIFORM);
        // The first frame has the number 1: pages that were never looked at have the mark 0.
        gpu.queue.write_buffer(&buffers.feedback, 0, &1u32.to_le_bytes());
        gpu.queue.write_buffer(&buffers.slots, 0, bytemuck::cast_slice(&vec![KEPT; tails as usize]));
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("tiles"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: options.anisotropy,
            ..Default::default()
        });
        let stored = view_of(&pool, FORMAT, TextureUsages::STORAGE_BINDING);
        let pipelines = Pipelines::new(
            &gpu.device,
            &Resources {
                textures: &buffers.textures,
                pages: &buffers.pages,
                feedback: &buffers.feedback,
                slots: &buffers.slots,
                stages: &buffers.stages,
                plan: &buffers.plan,
                workgroups: &buffers.workgroups,
                options: &settings,
                steps: &steps,
                streams: &streams,
                scratch: &buffers.scratch,
                stored: &stored,
                plain: &view_of(&pool, FORMAT, TextureUsages::TEXTURE_BINDING),
                srgb: &view_of(&pool, FORMAT.add_srgb_suffix(), TextureUsages::TEXTURE_BINDING),
                sampler: &sampler,
            },
        );
        TileCache {
            held: (0..options.textures).map(|_| None).collect(),
            pages: RangeAllocator::new(0..options.pages),
            stages: RangeAllocator::new(0..options.most_stages()),
            streams,
            options,
            pipelines,
            pool,
            stored,
            buffers,
            drawing: Vec::new(),
            scratch_words,
        }
    }

    /// The WGSL to paste into shaders that draw, with [`TileCache::bind_group`] bound to `group`: `texfold_tile_sample(texture: u32, uv:
    /// vec2<f32>) -> vec4<f32>` in uniform control flow, `texfold_tile_sample_grad(texture, uv, dpdx, dpdy)` and
    /// `texfold_tile_sample_level(texture, uv, lod)` in any. Pipelines that draw colours alone may set the constant `TEXFOLD_TILE_COLOURS` to
    /// 1, those that draw other data alone to 0.
    #[must_use]
    pub fn wgsl(&self, group: u32) -> String {
        texfold_shaders::tiles(group, self.options.anisotropy, self.options.stride)
    }

    /// The layout of [`TileCache::bind_group`].
    #[must_use]
    pub fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.pipelines.draw_layout
    }

    /// All textures: what a fragment shader binds. It stays the same as textures come and go.
    #[must_use]
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.pipelines.draw
    }

    /// The resources of [`TileCache::bind_group`] in the order of their bindings, from 0: for a group that holds a renderer's own behind them.
    #[must_use]
    pub fn bindings(&self) -> [BindingResource<'_>; 6] {
        self.pipelines.drawn.bindings()
    }

    /// The types of [`TileCache::bindings`], which the fragment stage sees.
    #[must_use]
    pub fn binding_types() -> [BindingType; 6] {
        Drawn::TYPES
    }

    /// Bytes of GPU memory of the whole cache: pool, streams, tables and scratch memory.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let Extent3d { width, height, depth_or_array_layers } = self.pool.size();
        let streams: u64 = self.streams.buffers().map(wgpu::Buffer::size).sum();
        let pool = 4 * u64::from(width) * u64::from(height) * u64::from(depth_or_array_layers);
        pool + streams + self.buffers.bytes()
    }

    /// Adds all images of a texture, and returns their numbers in the order of its layout: uploads what its tiles are decoded from, and
    /// decodes the smallest levels on the CPU. Images without mip levels are drawn from their only one.
    ///
    /// # Errors
    /// [`GpuError::TilesFull`], and [`GpuError`] as [`Gpu::upload`]; nothing is added then.
    pub fn add(
        &mut self,
        gpu: &Gpu,
        texture: &dyn Encoded<Domain = Image2d>,
        look: TileLook,
    ) -> Result<Vec<TileTexture>, GpuError> {
        let source = TileSource::new(gpu, texture)?;
        self.add_all(gpu, &source, look)
    }

    /// Adds all images of a texture with their smallest levels alone, which show until [`TileCache::replace`] brings the rest: images of a data set that is
    /// larger than memory, each from the first bytes of its file. What draws look at of them is not decoded; [`TileCache::watch`] tells of it.
    ///
    /// # Errors
    /// As [`TileCache::add`].
    pub fn add_coarse(
        &mut self,
        gpu: &Gpu,
        texture: &dyn Encoded<Domain = Image2d>,
        look: TileLook,
    ) -> Result<Vec<TileTexture>, GpuError> {
        self.add_all(gpu, &TileSource::coarse(texture), look)
    }

    /// Lets go of what the tiles of a texture are decoded from: it becomes as one that [`TileCache::add_coarse`] added. Tiles that are in the pool stay until others take
    /// their places.
    pub fn make_coarse(&mut self, gpu: &Gpu, texture: TileTexture) {
        let Some(held) = self.held.get_mut(texture.0 as usize).and_then(Option::as_mut) else { return };
        let (stages, data) = (std::mem::take(&mut held.stages), std::mem::take(&mut held.data));
        held.source = None;
        held.row = TextureRow { shape: held.row.shape | (COARSE << 16), source: 0, ..held.row };
        let row = held.row;
        self.free(Held { stages, data, ..Held::default() });
        self.write_row(gpu, texture.0 as usize, &row);
    }

    fn add_all(
        &mut self,
        gpu: &Gpu,
        source: &TileSource<'_>,
        look: TileLook,
    ) -> Result<Vec<TileTexture>, GpuError> {
        let mut added = Vec::new();
        for image in 0..source.texture.layout().images.len() as u32 {
            let map = source.texture.layout().maps.get(image as usize);
            let is_color = map.is_none_or(|map| map.pixel.color == ColorSpace::Srgb);
            let look = TileLook { srgb: look.srgb && is_color, ..look };
            let index = self.free_index();
            let put = index.and_then(|index| self.put(gpu, source, &[Part::whole(image)], (index, look)));
            match put {
                Ok(texture) => added.push(texture),
                Err(error) => {
                    added.into_iter().for_each(|texture| self.remove(gpu, texture));
                    return Err(error);
                }
            }
        }
        Ok(added)
    }

    fn free_index(&self) -> Result<usize, GpuError> {
        let full = GpuError::TilesFull { what: "all textures are in use", option: "textures" };
        self.held.iter().position(Option::is_none).ok_or(full)
    }

    /// Layers of the pool that a tile takes.
    fn layers(&self) -> u32 {
        self.options.contents.layers()
    }

    /// Puts another texture in the place of one that [`TileCache::add`] returned as `textures`, under the same numbers: a file of which more
    /// has arrived. Its tiles are decoded anew; the smallest levels show until then.
    ///
    /// # Errors
    /// [`GpuError`] as [`TileCache::add`], where there is no room for both at once, too: the image at which that happens and those behind
    /// it stay as they were. [`GpuError::NoSuchImage`] where the texture has fewer images, or one was removed.
    pub fn replace(
        &mut self,
        gpu: &Gpu,
        textures: &[TileTexture],
        texture: &dyn Encoded<Domain = Image2d>,
    ) -> Result<(), GpuError> {
        let source = TileSource::new(gpu, texture)?;
        let sizes = texture.layout().images.len();
        for (image, replaced) in (0..).zip(textures) {
            let held = self.held.get(replaced.0 as usize).and_then(Option::as_ref);
            let look = held.filter(|_| (image as usize) < sizes).map(|held| held.look);
            let look = look.ok_or(GpuError::NoSuchImage { image, images: sizes })?;
            let at = (replaced.0 as usize, look);
            if held.is_some_and(|held| held.is_material) {
                self.put_material(gpu, &source, at)?;
            } else {
                self.put(gpu, &source, &[Part::whole(image)], at)?;
            }
        }
        Ok(())
    }

    /// Puts images whose tiles lie over one another under a number, in place of what has it.
    fn put(
        &mut self,
        gpu: &Gpu,
        source: &TileSource<'_>,
        parts: &[Part],
        (index, look): (usize, TileLook),
    ) -> Result<TileTexture, GpuError> {
        let TileSource { texture, stages, uploaded, is_coarse } = source;
        let layout = texture.layout();
        let largest = parts.iter().min_by_key(|part| part.halvings);
        let &Part { image, .. } = largest.ok_or(GpuError::Form { what: "no image" })?;
        let size = layout.images[image as usize];
        let tail = tail_of(size);
        let levels = layout.levels.min(size.full_levels());
        let own = levels.min(tail);
        let mut drawn: Vec<&GpuDct<'_>> = Vec::new();
        let mut words = 0;
        for part in parts {
            let before = drawn.len();
            let own = part.own_levels(own);
            drawn.extend(stages_of(stages, part.image, own));
            let added = &drawn[before..];
            let is_cut = (0..).zip(added).all(|(number, stage)| stage.level == 3 * number);
            let is_whole = stages.is_empty() || added.len() as u32 == own.div_ceil(3);
            if own as usize > MOST_LEVELS || !is_cut || !is_whole {
                return Err(GpuError::Form {
                    what: "an image is larger, or cut otherwise, than tiles expect",
                });
            }
            let most = added.iter().map(|stage| StageRow::most_words(stage, stage.levels - 1)).max();
            words += most.unwrap_or(0);
        }
        if words + u64::from(texfold_shaders::BLOCK_WORDS) > self.scratch_words {
            let what = "a tile of this texture needs more scratch memory";
            return Err(GpuError::TilesFull { what, option: "scratch_bytes" });
        }
        let (row, mut held) = self.reserve(size, own, &drawn)?;
        held.look = look;
        let number = index as u32 + 1;
        let clamp = look.address == AddressMode::Clamp;
        let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
        let flags = flag(look.srgb, SRGB) | flag(clamp, CLAMP) | flag(*is_coarse, COARSE);
        let source = if uploaded.is_some() { number } else { 0 };
        let tail = self.tail_of(index as u32, levels.max(tail + 1).min(size.full_levels()), tail);
        let row = TextureRow {
            shape: bytes_and_half([levels, tail.first, flags]),
            tail: bytes_and_half(tail.place),
            source,
            parts: parts::row(parts),
            ..row
        };
        let written = gpu.guarded(|| {
            held.source =
                uploaded.as_ref().map(|texture| self.source(gpu, texture, image, number)).transpose()?;
            self.write_stages(gpu, &drawn, &held)?;
            self.write_tail(gpu, (*texture, parts), &tail, (levels, flags));
            held.row = row;
            self.write_row(gpu, index, &row);
            Ok(())
        });
        if let Err(error) = written {
            self.free(held);
            return Err(error);
        }
        if let Some(before) = self.held[index].replace(held) {
            self.clear_pages(gpu, &before);
            self.free(before);
        }
        Ok(TileTexture(index as u32))
    }

    /// The pass that draws tiles of an uploaded image.
    fn source(
        &mut self,
        gpu: &Gpu,
        texture: &Arc<GpuTexture>,
        image: u32,
        number: u32,
    ) -> Result<Source, GpuError> {
        let module = texture.module();
        let known = self.drawing.iter().find(|(known, _)| *known == module);
        let pipeline = if let Some((_, pipeline)) = known {
            pipeline.clone()
        } else {
            let shader = compute::shader(&gpu.device, module.name, texfold_shaders::tile_drawing(module));
            let layouts = [Some(&self.pipelines.source_layout), Some(gpu.layouts.of(module))];
            let made = compute::pipeline(&gpu.device, &shader, "draw_tiles", &layouts);
            self.drawing.push((module, made.clone()));
            made
        };
        let (_, place) = texture.bind_group(image)?;
        let params =
            gpu.buffer("source", bytemuck::cast_slice(&[number, place, 0, 0]), BufferUsages::UNIFORM);
        let resources = [
            self.buffers.plan.as_entire_binding(),
            self.buffers.textures.as_entire_binding(),
            BindingResource::TextureView(&self.stored),
            params.as_entire_binding(),
        ];
        let group = compute::group(&gpu.device, &self.pipelines.source_layout, &resources);
        Ok(Source { number, texture: Arc::clone(texture), image, pipeline, group })
    }

    /// Removes a texture; lookups of it give transparent black until another one takes its number. Tiles that are being decoded do no harm.
    pub fn remove(&mut self, gpu: &Gpu, texture: TileTexture) {
        let Some(held) = self.held.get_mut(texture.0 as usize).and_then(Option::take) else { return };
        self.write_row(gpu, texture.0 as usize, &TextureRow::default());
        // Places of the pool that still name its pages are free as soon as these name no place.
        self.clear_pages(gpu, &held);
        self.free(held);
    }

    /// Records the passes that decode what draws before it have looked at and not found: once a frame, after these.
    pub fn update(&self, encoder: &mut CommandEncoder) {
        let sources = self.held.iter().flatten().filter_map(|held| held.source.as_ref());
        self.pipelines.record(encoder, &self.buffers.workgroups, sources);
    }

    /// The outcome of the last update; waits for the GPU. For tests and displays of statistics: nothing depends on it.
    ///
    /// # Errors
    /// [`GpuError::Lost`].
    pub fn report(&self, gpu: &Gpu) -> Result<TileReport, GpuError> {
        let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("report of tiles"),
            size: 16,
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&self.buffers.feedback, 0, &copy, 0, Some(16));
        let words: Vec<u32> = gpu.map(encoder.finish(), &copy, bytemuck::pod_collect_to_vec)?;
        let &[_, bias, decoded, missing] = words.as_slice() else { return Err(GpuError::Lost) };
        Ok(TileReport { decoded, missing, bias: f32::from_bits(bias) })
    }

    /// Room for a texture: its row but for what its number and look decide.
    fn reserve(
        &mut self,
        size: ImageSize,
        own: u32,
        stages: &[&GpuDct<'_>],
    ) -> Result<(TextureRow, Held), GpuError> {
        let mut row = TextureRow { size: [size.width, size.height], ..TextureRow::default() };
        let mut count = 0u32;
        for (level, pages) in (0..own).zip(&mut row.levels) {
            let [columns, rows] = tiles_of(size, level);
            *pages = [count, columns];
            count = columns.saturating_mul(rows).saturating_add(count);
        }
        let mut held = Held::default();
        let done = self.allocate(count, stages, &mut held);
        if let Err(error) = done {
            self.free(held);
            return Err(error);
        }
        row.levels.iter_mut().for_each(|pages| pages[0] += held.pages.start);
        row.stages = held.stages.start;
        Ok((row, held))
    }

    fn allocate(&mut self, pages: u32, stages: &[&GpuDct<'_>], held: &mut Held) -> Result<(), GpuError> {
        let full = |what, option| move |_| GpuError::TilesFull { what, option };
        if pages > 0 {
            let range = self.pages.allocate_range(pages);
            held.pages = range.map_err(full("all pages are in use", "pages"))?;
        }
        if !stages.is_empty() {
            let range = self.stages.allocate_range(stages.len() as u32);
            held.stages = range.map_err(full("all stages are in use", "textures"))?;
        }
        for stage in stages {
            let [words, streams] = stage_words(stage);
            let does_not_fit = || GpuError::TilesFull { what: "streams do not fit", option: "stream_bytes" };
            held.data.push(self.streams.allocate_words(words).ok_or_else(does_not_fit)?);
            held.data.push(self.streams.allocate_streams(streams).ok_or_else(does_not_fit)?);
        }
        Ok(())
    }

    fn free(&mut self, held: Held) {
        let some = |range: &Range<u32>| !range.is_empty();
        held.data.into_iter().filter(some).for_each(|range| self.streams.free(range));
        Some(held.stages).into_iter().filter(some).for_each(|range| self.stages.free_range(range));
        Some(held.pages).into_iter().filter(some).for_each(|range| self.pages.free_range(range));
    }

    fn write_row(&self, gpu: &Gpu, index: usize, row: &TextureRow) {
        let offset = row_bytes::<TextureRow>(index as u32);
        gpu.queue.write_buffer(&self.buffers.textures, offset, bytemuck::bytes_of(row));
    }

    /// Writes all stages of a texture, and that none of its tiles is there or was looked at.
    fn write_stages(&self, gpu: &Gpu, stages: &[&GpuDct<'_>], held: &Held) -> Result<(), GpuError> {
        for ((stage, data), number) in stages.iter().zip(held.data.chunks(2)).zip(held.stages.clone()) {
            self.write_stage(gpu, stage, data, number)?;
        }
        self.clear_pages(gpu, held);
        Ok(())
    }

    fn clear_pages(&self, gpu: &Gpu, held: &Held) {
        let (zeros, start) = (vec![0u8; 4 * held.pages.len()], 4 * u64::from(held.pages.start));
        gpu.queue.write_buffer(&self.buffers.pages, start, &zeros);
        gpu.queue.write_buffer(&self.buffers.feedback, FEEDBACK_BYTES + start, &zeros);
    }

    /// Writes words and streams of a stage to their places, and its row.
    fn write_stage(
        &self,
        gpu: &Gpu,
        stage: &GpuDct<'_>,
        data: &[Range<u32>],
        number: u32,
    ) -> Result<(), GpuError> {
        let [words, streams] = data else { return Err(GpuError::Form { what: "a stage has no place" }) };
        let (shared, own) = stage.words.split_at(texfold_shaders::DCT_TABLES as usize);
        self.streams.write(gpu, 0, bytemuck::cast_slice(shared));
        self.streams.write(gpu, words.start, bytemuck::cast_slice(own));
        let (whole, rest) = stage.streams.split_at(stage.streams.len() / 4 * 4);
        let mut last = [0; 8];
        last[..rest.len()].copy_from_slice(rest);
        self.streams.write(gpu, streams.start, whole);
        self.streams.write(gpu, streams.start + whole.len() as u32 / 4, &last);
        let row = StageRow::new(
            stage,
            DctChannel::parameters(&stage.layout, DctChannel::colours(&stage.layout))?,
            (words.start, 4 * streams.start),
        );
        gpu.queue.write_buffer(&self.buffers.stages, row_bytes::<StageRow>(number), bytemuck::bytes_of(&row));
        Ok(())
    }
}

/// The stages of an image whose first `own` levels are in tiles of their own.
fn stages_of<'s, 't>(
    stages: &'s [GpuDct<'t>],
    image: u32,
    own: u32,
) -> impl Iterator<Item = &'s GpuDct<'t>> + use<'s, 't> {
    stages.iter().filter(move |stage| stage.image == image as usize && stage.level < own)
}

/// Words of a stage's tables and of its streams: the shader reads bytes as parts of two words.
fn stage_words(stage: &GpuDct<'_>) -> [usize; 2] {
    [stage.words.len() - texfold_shaders::DCT_TABLES as usize, stage.streams.len().div_ceil(4) + 2]
}

/// Columns and rows of the tiles of a level.
fn tiles_of(size: ImageSize, level: u32) -> [u32; 2] {
    let ImageSize { width, height } = size.at_level(level);
    [width, height].map(|side| side.div_ceil(INNER))
}

/// Sizes and flags of the cache, and the places of a tail's levels: for the cache of the browser package.
#[doc(hidden)]
#[must_use]
pub fn tile_numbers() -> (&'static [(&'static str, u64)], &'static [[u32; 2]]) {
    (&rows::NUMBERS, &rows::TAIL_PLACES)
}

/// Two numbers of 8 bits and one of 16 in a word, the lowest first.
fn bytes_and_half([one, two, three]: [u32; 3]) -> u32 {
    one | (two << 8) | (three << 16)
}

/// A pool of that many texels a side and layers.
fn pool(device: &wgpu::Device, [side, layers]: [u32; 2]) -> Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("tiles"),
        size: Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[FORMAT.add_srgb_suffix()],
    })
}

fn view_of(pool: &Texture, format: wgpu::TextureFormat, usage: TextureUsages) -> wgpu::TextureView {
    pool.create_view(&wgpu::TextureViewDescriptor {
        format: Some(format),
        usage: Some(usage),
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// Texels a side and layers of the pool.
fn pool_size(options: &TileOptions, most_layers: u32) -> [u32; 2] {
    // Few small layers, or many large ones.
    let side: u32 = match options.pool_bytes >> 20 {
        0..4 => 512,
        4..64 => 1024,
        _ => 2048,
    };
    let layers = options.pool_bytes / (4 * u64::from(side) * u64::from(side));
    let each = options.contents.layers();
    [side, ((layers.min(u64::from(most_layers)) as u32) / each).max(1) * each]
}

/// Bytes of so many rows.
fn row_bytes<Row>(rows: u32) -> u64 {
    size_of::<Row>() as u64 * u64::from(rows)
}

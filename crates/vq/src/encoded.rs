//! The shipped form: one codebook, and an index plane for each size of image.

use std::borrow::Cow;

use glam::{IVec2, UVec2};
use texfold_bc::ContentPlanes;
use texfold_core::address::{TEXFOLD_CLAMP, texfold_level_size};
use texfold_core::container::{SectionWriter, write_layout};
use texfold_core::{
    CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageLayout, MAX_PLANE_SIDE, Notes,
    Plane, PlaneFormat, Rect, RegionError, SurfaceBinding, SurfaceSize, Texel, TextureCodec,
};

use crate::decode::{TEXFOLD_VQ_LEVELS, TexfoldVqParams, VqView, texfold_vq_fetch};
use crate::{Vq, wire};

/// A rectangle of the codebook that holds one image sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CodebookPart {
    /// Column of its upper left texel in the codebook.
    pub x: u32,
    /// Row of its upper left texel in the codebook.
    pub y: u32,
    /// Columns and rows.
    pub side: u32,
    /// Which image it was cut from.
    pub surface: u32,
    /// Column in that image.
    pub source_x: u32,
    /// Row in that image.
    pub source_y: u32,
}

/// Images of one size: where each one's blocks lie in the shared index plane.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SizeClass {
    pub(crate) params: TexfoldVqParams,
    pub(crate) index: Vec<[u8; 2]>,
    pub(crate) index_width: u32,
    /// Images side by side in the plane.
    columns: u32,
    /// Images of this size, in the order of their place in the plane.
    pub(crate) surfaces: Vec<u32>,
}

/// Images stored as indices into a codebook.
#[derive(Debug, Clone, PartialEq)]
pub struct VqTexture {
    pub(crate) layout: ImageLayout,
    pub(crate) codebook: ContentPlanes,
    /// The codebook's texels, decoded once.
    pub(crate) texels: Vec<Texel>,
    pub(crate) classes: Vec<SizeClass>,
    /// For each image its class and its place in the class's plane.
    pub(crate) places: Vec<(usize, u32)>,
    pub(crate) samples: Vec<CodebookPart>,
    /// Free 4x4 cells at the end of the codebook, for further images.
    pub(crate) free_cells: u32,
    /// RMS error in 8-bit units within which blocks of further images join what is there.
    pub(crate) join_rms: f32,
    pub(crate) notes: Notes,
}

impl SizeClass {
    /// An empty plane for `surfaces` images of `size`.
    pub(crate) fn new(size: SurfaceSize, levels: u32, swizzle: u32, surfaces: Vec<u32>) -> Self {
        let (width, height) = size.blocks();
        let mut level_start = [0; TEXFOLD_VQ_LEVELS];
        let mut blocks = width * height;
        for level in 1..levels {
            level_start[level as usize] = blocks;
            let (columns, rows) = size.at_level(level).blocks();
            blocks += columns * rows;
        }
        let rows = blocks.div_ceil(width);
        let count = surfaces.len() as u32;
        let per_column = (MAX_PLANE_SIDE / rows).max(1);
        let columns = count.div_ceil(per_column);
        let params = TexfoldVqParams {
            size: [size.width, size.height],
            levels,
            address_mode: TEXFOLD_CLAMP,
            swizzle,
            rows,
            reserved: [0; 2],
            level_start,
        };
        let plane_texels = (width * columns) as usize * (rows * count.div_ceil(columns)) as usize;
        SizeClass {
            params,
            index: vec![[0; 2]; plane_texels],
            index_width: width * columns,
            columns,
            surfaces,
        }
    }

    /// Rows of the index plane.
    pub(crate) fn index_height(&self) -> u32 {
        self.index.len() as u32 / self.index_width
    }

    /// Columns of the plane that one image fills.
    fn width(&self) -> u32 {
        self.params.size[0].div_ceil(4)
    }

    /// Column and row of the plane where the image at `place` begins.
    fn origin(&self, place: u32) -> (u32, u32) {
        (place % self.columns * self.width(), place / self.columns * self.params.rows)
    }

    /// The shader's `surface` argument for the image at `place`.
    fn argument(&self, place: u32) -> u32 {
        let (x, y) = self.origin(place);
        x * MAX_PLANE_SIDE + y
    }

    /// Position in the plane of block `block` (levels one after the other, row by row) of the image at `place`.
    pub(crate) fn position(&self, place: u32, block: u32) -> usize {
        let ((x, y), width) = (self.origin(place), self.width());
        ((y + block / width) * self.index_width + x + block % width) as usize
    }

    /// Blocks of all levels of one image.
    pub(crate) fn blocks(&self) -> u32 {
        blocks_of(SurfaceSize { width: self.params.size[0], height: self.params.size[1] }, self.params.levels)
    }
}

/// Blocks of `levels` levels of an image of `size`.
pub(crate) fn blocks_of(size: SurfaceSize, levels: u32) -> u32 {
    (0..levels).map(|level| size.at_level(level).blocks()).map(|(columns, rows)| columns * rows).sum()
}

/// Groups images by size, in the order in which sizes first appear.
pub(crate) fn size_classes(layout: &ImageLayout, swizzle: u32) -> (Vec<SizeClass>, Vec<(usize, u32)>) {
    let mut sizes: Vec<(SurfaceSize, Vec<u32>)> = Vec::new();
    let mut known = std::collections::HashMap::new();
    let mut places = Vec::new();
    for (surface, &size) in layout.surfaces.iter().enumerate() {
        let class = *known.entry(size).or_insert_with(|| {
            sizes.push((size, Vec::new()));
            sizes.len() - 1
        });
        places.push((class, sizes[class].1.len() as u32));
        sizes[class].1.push(surface as u32);
    }
    let class = |(size, surfaces)| SizeClass::new(size, layout.levels, swizzle, surfaces);
    (sizes.into_iter().map(class).collect(), places)
}

impl VqTexture {
    /// Columns and rows of the codebook in texels.
    #[must_use]
    pub fn codebook_size(&self) -> (u32, u32) {
        self.codebook.size()
    }

    /// How the codebook is stored.
    #[must_use]
    pub fn content(&self) -> texfold_bc::Content {
        self.codebook.content()
    }

    /// The codebook's texels, row by row.
    #[must_use]
    pub fn codebook_texels(&self) -> &[Texel] {
        &self.texels
    }

    /// The image samples in the codebook.
    #[must_use]
    pub fn samples(&self) -> &[CodebookPart] {
        &self.samples
    }

    /// Corners of all windows that blocks may point at: those in samples, and the codewords'.
    pub(crate) fn corners(&self, grid: crate::encode::plan::Grid) -> (Vec<[u8; 2]>, Vec<[u8; 2]>) {
        let window = |part: &CodebookPart| {
            let part = *part;
            (0..part.side - 3)
                .flat_map(move |y| (0..part.side - 3).map(move |x| [(part.x + x) as u8, (part.y + y) as u8]))
        };
        let cells = grid.free_cells(&self.samples);
        let used = cells.len() - self.free_cells as usize;
        let codewords = cells.iter().take(used).map(|&(x, y)| [x as u8, y as u8]);
        (self.samples.iter().flat_map(window).collect(), codewords.collect())
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// The size class of an image as the shader sees it, and the `surface` argument of its functions for the image;
    /// the last image where there is no such one.
    #[must_use]
    #[inline]
    pub fn view(&self, surface: u32) -> (VqView<'_>, u32) {
        let (class, place) = self.places[(surface as usize).min(self.places.len() - 1)];
        let class = &self.classes[class];
        let view = VqView {
            params: class.params,
            index: &class.index,
            index_width: class.index_width,
            codebook: &self.texels,
            codebook_width: self.codebook.size().0,
        };
        (view, class.argument(place))
    }
}

impl Encoded for VqTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Vq::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.layout
    }

    fn sample(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let (view, surface) = self.view(at.surface);
        let level = at.level.min(self.layout.levels - 1);
        texfold_vq_fetch(&view, surface, IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let (view, surface) = self.view(region.surface);
        let mut lines = out.chunks_exact_mut((region.width as usize).max(1));
        for y in region.y..region.y + region.height {
            let Some(line) = lines.next() else { break };
            decode_line(&view, surface, region, y, line);
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.layout, out);
        wire::store(self, out);
    }

    /// As measured, with the codebook told apart into samples and codewords by their texels.
    fn footprint(&self) -> Footprint {
        let mut footprint = Footprint::measure(self, &self.gpu());
        let Some(at) = footprint.parts.iter().position(|part| part.name == "codebook") else {
            return footprint;
        };
        let codebook = footprint.parts.remove(at);
        let (width, height) = self.codebook.size();
        let sampled: u64 = self.samples.iter().map(|part| u64::from(part.side * part.side)).sum();
        let share = |bits: u64| bits * sampled / u64::from(width * height);
        let (memory, disk) = (share(codebook.bits_memory), share(codebook.bits_disk));
        if sampled > 0 {
            let samples = footprint.part("samples");
            (samples.bits_memory, samples.bits_disk) = (memory, disk);
        }
        let codewords = footprint.part("codewords");
        (codewords.bits_memory, codewords.bits_disk) =
            (codebook.bits_memory - memory, codebook.bits_disk - disk);
        footprint.with_notes(&self.notes)
    }

    fn gpu(&self) -> GpuForm<'_> {
        let codebook: Vec<Plane<'_>> = self.codebook.gpu_planes("codebook").collect();
        let last = codebook.len() - 1;
        let mut form = GpuForm { module: "vq", planes: codebook, uniforms: Vec::new(), surfaces: Vec::new() };
        let mut bindings = Vec::new();
        for class in &self.classes {
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(&class.params));
            bindings.push((vec![form.planes.len(), 0, last], start..form.uniforms.len()));
            form.planes.push(Plane {
                part: "index",
                format: PlaneFormat::Rg8Uint,
                width: class.index_width,
                height: class.index_height(),
                levels: 1,
                data: Cow::Borrowed(class.index.as_flattened()),
            });
        }
        let binding = |&(class, place): &(usize, u32)| {
            let (planes, uniforms) = bindings[class].clone();
            SurfaceBinding { planes, uniforms, surface: self.classes[class].argument(place) }
        };
        form.surfaces = self.places.iter().map(binding).collect();
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

/// One row of a region: four texels at a time from the codebook, as [`texfold_vq_fetch`] finds them one by one.
fn decode_line(view: &VqView<'_>, surface: u32, region: Rect, y: u32, line: &mut [Texel]) {
    let width = view.params.size[0].div_ceil(4);
    let level_width = texfold_level_size(UVec2::from(view.params.size), region.level).x.div_ceil(4);
    let first = view.params.level_start[region.level as usize] + y / 4 * level_width;
    let origin = surface % MAX_PLANE_SIDE * view.index_width + surface / MAX_PLANE_SIDE;
    let mut left = region.x;
    let mut rest = line;
    while !rest.is_empty() {
        // Blocks up to the end of the line, or to where the index plane goes on in its next row.
        let (x, row) = ((first + left / 4) % width, (first + left / 4) / width);
        let count = (width - x).min((left % 4 + rest.len() as u32).div_ceil(4)) as usize;
        let start = (origin + row * view.index_width + x) as usize;
        for &[x, y_of_cell] in &view.index[start..start + count] {
            let from = (u32::from(y_of_cell) + y % 4) * view.codebook_width + u32::from(x) + left % 4;
            let cell = &view.codebook[from as usize..];
            let run = ((4 - left % 4) as usize).min(rest.len());
            let (head, tail) = rest.split_at_mut(run);
            // A whole row of a block is copied without asking for its length.
            match (head.first_chunk_mut::<4>(), cell.first_chunk::<4>()) {
                (Some(head), Some(cell)) => *head = *cell,
                _ => head.copy_from_slice(&cell[..run]),
            }
            rest = tail;
            left += run as u32;
        }
    }
}

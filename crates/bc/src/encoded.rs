//! The shipped form: planes of blocks, one chain for each image.

use std::borrow::Cow;

use glam::{IVec2, UVec2, Vec2};
use texfold_core::address::{TEXFOLD_CLAMP, texfold_level_size, texfold_tap};
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::sample::{TEXFOLD_NORMAL, texfold_bilinear, texfold_swizzle};
use texfold_core::{
    Budget, CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageBinding, ImageLayout,
    ImageSize, LoadError, MemoryBits, Notes, Plane, PlaneFormat, Rect, RegionError, Texel, TextureCodec,
};

use crate::decode::{BcView, TexfoldBcParams, expand, texfold_bc_fetch};
use crate::parts::Parts;
use crate::{Bc, Content, ContentPlanes, wire};

/// Images stored as plain blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct BcTexture {
    pub(crate) parts: Parts,
    pub(crate) notes: Notes,
}

impl BcTexture {
    pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        let notes = Notes::read(file, budget)?;
        Ok(BcTexture { parts: wire::load(file, budget)?, notes })
    }

    /// How the blocks are stored.
    #[must_use]
    pub fn content(&self) -> Content {
        self.parts.content
    }

    /// Log2 downscale of width and height before compression.
    #[must_use]
    pub fn reduce_log2(&self) -> u32 {
        self.parts.reduce_log2
    }

    /// The notes, for a caller that has more to say.
    #[must_use]
    pub fn notes_mut(&mut self) -> &mut Notes {
        &mut self.notes
    }

    /// Replaces the notes, as a caller does that chose this codec over another.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// One image as the shader sees it; the last where there is no such image.
    #[must_use]
    pub fn view(&self, image: u32) -> BcView<'_> {
        let index = (image as usize).min(self.parts.images.len() - 1);
        let (size, levels) = (self.parts.layout.images[index], &self.parts.images[index]);
        let plane = levels[0].size();
        let params = TexfoldBcParams {
            size: [size.width, size.height],
            plane_size: [plane.0, plane.1],
            levels: levels.len() as u32,
            address_mode: TEXFOLD_CLAMP,
            swizzle: levels[0].swizzle().0,
            reduced: u32::from(self.parts.reduce_log2 > 0),
        };
        BcView { params, levels }
    }

    /// The levels of one image that a GPU holds: those beyond 1 x 1 repeat the last, a texture cannot hold them, and the
    /// shader does not read them.
    fn held(&self, image: usize) -> &[ContentPlanes] {
        let levels = &self.parts.images[image];
        let (width, height) = levels[0].size();
        &levels[..levels.len().min(ImageSize { width, height }.full_levels() as usize)]
    }

    fn planes_of(&self, image: usize) -> Vec<Plane<'_>> {
        let levels = self.held(image);
        let mut planes: Vec<Plane<'_>> = levels[0].gpu_planes("blocks").collect();
        for (index, plane) in planes.iter_mut().enumerate().filter(|_| levels.len() > 1) {
            plane.levels = levels.len() as u32;
            plane.data =
                Cow::Owned(levels.iter().flat_map(|level| level.planes()[index].1.iter().copied()).collect());
        }
        planes
    }
}

impl Encoded for BcTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Bc::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.parts.layout
    }

    fn texel(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.parts.layout.levels - 1);
        texfold_bc_fetch(&self.view(at.image), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.parts.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let view = self.view(region.image);
        if view.params.reduced == 0 {
            expand(&view, region.level, UVec2::new(region.x, region.y), region.width, out);
        } else {
            enlarge(&view, region, out);
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.parts.layout, out);
        wire::store(&self.parts, out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    fn gpu(&self) -> GpuForm<'_> {
        let mut form = GpuForm::new("bc");
        for image in 0..self.parts.images.len() {
            let first = form.planes.len();
            form.planes.extend(self.planes_of(image));
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(&self.view(image as u32).params));
            let mut planes: Vec<usize> = (first..form.planes.len()).collect();
            // The shader binds two planes; where there is one it is bound twice.
            planes.resize(2, first);
            form.images.push(ImageBinding { planes, uniforms: start..form.uniforms.len(), image: 0 });
        }
        form
    }

    fn memory(&self) -> MemoryBits {
        let planes = (0..self.parts.images.len()).flat_map(|image| self.held(image).iter());
        let bits = |level: &ContentPlanes| {
            let (width, height) = level.size();
            let texels = u64::from(width) * u64::from(height);
            let of = |(format, bytes): &(PlaneFormat, Vec<u8>)| {
                let block = u64::from(format.block_side()).pow(2);
                (8 * bytes.len() as u64, texels * u64::from(8 * format.block_bytes()) / block)
            };
            level.planes().iter().map(of).fold((0, 0), |sum, bits| (sum.0 + bits.0, sum.1 + bits.1))
        };
        let (stored, counted) = planes.map(bits).fold((0, 0), |sum, bits| (sum.0 + bits.0, sum.1 + bits.1));
        let headers = 8 * (self.parts.images.len() * size_of::<TexfoldBcParams>()) as u64;
        MemoryBits { compressed: stored + headers, resident: stored + headers, goal: counted }
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

/// Fills `out` from a plane smaller than the source, as [`texfold_bc_fetch`] does texel by texel.
fn enlarge(view: &BcView<'_>, region: Rect, out: &mut [Texel]) {
    if out.is_empty() {
        return;
    }
    let full = texfold_level_size(UVec2::from(view.params.size), region.level);
    let size = texfold_level_size(UVec2::from(view.params.plane_size), region.level);
    let tap = |x: u32, y: u32| {
        let uv = (UVec2::new(x, y).as_vec2() + 0.5) / full.as_vec2();
        texfold_tap(uv, size, TEXFOLD_CLAMP)
    };
    let (first, last) =
        (tap(region.x, region.y), tap(region.x + region.width - 1, region.y + region.height - 1));
    let (corner, extent) = (first.low, last.high + 1 - first.low);
    let mut texels = vec![Texel::ZERO; (extent.x * extent.y) as usize];
    expand(view, region.level, corner, extent.x, &mut texels);
    let columns: Vec<_> = (region.x..region.x + region.width).map(|x| tap(x, region.y)).collect();
    for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
        let rows = tap(region.x, y);
        let row = |y: u32| &texels[((y - corner.y) * extent.x) as usize..][..extent.x as usize];
        let (upper, lower) = (row(rows.low.y), row(rows.high.y));
        for (texel, tap) in line.iter_mut().zip(&columns) {
            let (left, right) = ((tap.low.x - corner.x) as usize, (tap.high.x - corner.x) as usize);
            let four = [upper[left], upper[right], lower[left], lower[right]];
            *texel = texfold_bilinear(four, Vec2::new(tap.weight.x, rows.weight.y));
            // The shader swizzles after blending: the same but for normals.
            if view.params.swizzle == TEXFOLD_NORMAL {
                *texel = texfold_swizzle(*texel, *texel, TEXFOLD_NORMAL);
            }
        }
    }
}

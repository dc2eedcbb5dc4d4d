//! The shipped form: planes of blocks, one chain for each image.

use std::borrow::Cow;

use glam::{IVec2, UVec2};
use texfold_core::address::{TEXFOLD_CLAMP, texfold_level_size, texfold_tap, texfold_wrap};
use texfold_core::container::{SectionWriter, write_layout};
use texfold_core::sample::texfold_bilinear;
use texfold_core::{
    CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageLayout, Notes, Plane, Rect,
    RegionError, SurfaceBinding, Texel, TextureCodec,
};

use crate::decode::{BcView, TexfoldBcParams, expand_level, texfold_bc_fetch};
use crate::{Bc, Content, ContentPlanes, wire};

/// Images stored as plain blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct BcTexture {
    pub(crate) layout: ImageLayout,
    pub(crate) content: Content,
    /// Halvings of width and height before compression.
    pub(crate) reduce_log2: u32,
    /// For each image the planes of its levels.
    pub(crate) surfaces: Vec<Vec<ContentPlanes>>,
    pub(crate) notes: Notes,
}

impl BcTexture {
    /// How the blocks are stored.
    #[must_use]
    pub fn content(&self) -> Content {
        self.content
    }

    /// Halvings of width and height before compression.
    #[must_use]
    pub fn reduce_log2(&self) -> u32 {
        self.reduce_log2
    }

    /// Replaces the notes, as a caller does that chose this codec over another.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// One image as the shader sees it; the last where there is no such image.
    #[must_use]
    pub fn view(&self, surface: u32) -> BcView<'_> {
        let index = (surface as usize).min(self.surfaces.len() - 1);
        let (size, levels) = (self.layout.surfaces[index], &self.surfaces[index]);
        let plane = levels[0].size();
        let params = TexfoldBcParams {
            size: [size.width, size.height],
            plane_size: [plane.0, plane.1],
            levels: levels.len() as u32,
            address_mode: TEXFOLD_CLAMP,
            swizzle: levels[0].swizzle().0,
            reduced: u32::from(self.reduce_log2 > 0),
        };
        BcView { params, levels }
    }

    fn planes_of(&self, surface: usize) -> Vec<Plane<'_>> {
        let levels = &self.surfaces[surface];
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
        &self.layout
    }

    fn sample(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.layout.levels - 1);
        texfold_bc_fetch(&self.view(at.surface), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let view = self.view(region.surface);
        let plane = self.layout.surfaces[region.surface as usize].at_level(self.reduce_log2 + region.level);
        // Expanding the level pays once the region holds a good part of it.
        if (out.len() as u64) < plane.texels() / 8 {
            for (index, texel) in out.iter_mut().enumerate() {
                *texel = self.sample(Image2d::address(region, index));
            }
            return Ok(());
        }
        let texels = expand_level(&view, region.level);
        let size = UVec2::from(view.levels[region.level as usize].size());
        copy_region(&view, region, &texels, size, out);
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.layout, out);
        wire::store(self, out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    fn gpu(&self) -> GpuForm<'_> {
        let mut form =
            GpuForm { module: "bc", planes: Vec::new(), uniforms: Vec::new(), surfaces: Vec::new() };
        for surface in 0..self.surfaces.len() {
            let first = form.planes.len();
            form.planes.extend(self.planes_of(surface));
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(&self.view(surface as u32).params));
            let mut planes: Vec<usize> = (first..form.planes.len()).collect();
            // The shader binds two planes; where there is one it is bound twice.
            planes.resize(2, first);
            form.surfaces.push(SurfaceBinding { planes, uniforms: start..form.uniforms.len(), surface: 0 });
        }
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

/// Fills `out` from the expanded level, as [`texfold_bc_fetch`] does texel by texel.
fn copy_region(view: &BcView<'_>, region: Rect, texels: &[Texel], size: UVec2, out: &mut [Texel]) {
    let full = texfold_level_size(UVec2::from(view.params.size), region.level);
    for (row, line) in out.chunks_exact_mut(region.width as usize).enumerate() {
        let y = region.y + row as u32;
        if view.params.reduced == 0 {
            let start = (y * size.x + region.x) as usize;
            line.copy_from_slice(&texels[start..start + line.len()]);
            continue;
        }
        for (x, texel) in (region.x..).zip(line) {
            let uv = (UVec2::new(x, y).as_vec2() + 0.5) / full.as_vec2();
            let tap = texfold_tap(uv, size);
            let at = |dx: i32, dy: i32| {
                let column = texfold_wrap(tap.low.x + dx, size.x, TEXFOLD_CLAMP);
                let row = texfold_wrap(tap.low.y + dy, size.y, TEXFOLD_CLAMP);
                texels[(row * size.x + column) as usize]
            };
            *texel = texfold_bilinear([at(0, 0), at(1, 0), at(0, 1), at(1, 1)], tap.weight);
        }
    }
}

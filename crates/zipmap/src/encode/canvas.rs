//! The texture as far as it is laid, uncompressed: what the next patch is fitted to and held against.

use glam::{DMat3, DVec2, UVec4, Vec2};
use texfold_core::Texel;
use texfold_core::address::TEXFOLD_CLAMP;
use texfold_core::sample::TEXFOLD_RGBA;

use crate::decode::{
    TEXFOLD_ZIPMAP_RECORD, TexfoldZipmapParams, ZipmapView, texfold_zipmap_layer, texfold_zipmap_pixel,
};
use crate::geometry::{normalised, seen_in, slope};
use crate::linear::{area, project};
use crate::table::{list_texels, record};

/// A patch as it is laid.
#[derive(Debug, Clone)]
pub(crate) struct Laid {
    /// Which patch of the stack.
    pub(crate) source: usize,
    /// From the root's texture coordinates to its own.
    pub(crate) matrix: DMat3,
    pub(crate) size: (u32, u32),
    /// Its upper left texel in its image.
    pub(crate) corner: (u32, u32),
    /// Texels to a texel of the root.
    pub(crate) zoom: f64,
    /// Which of the canvas's images it has.
    pub(crate) content: usize,
}

impl Laid {
    pub(crate) fn rows(&self) -> [f32; 9] {
        self.matrix.transpose().to_cols_array().map(|value| value as f32)
    }
}

/// Where a texel of a patch lies on the root, and how large it is there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Footprint {
    pub(crate) uv: Vec2,
    pub(crate) dx: Vec2,
    pub(crate) dy: Vec2,
}

impl Footprint {
    /// Of a texel of `size` to the whole at `at`, both in texture coordinates that `inverse` leads to the root's.
    pub(crate) fn of(inverse: &DMat3, at: DVec2, size: DVec2) -> Footprint {
        let (across, down) = slope(inverse, at);
        Footprint {
            uv: project(inverse, at).as_vec2(),
            dx: (across * size.x).as_vec2(),
            dy: (down * size.y).as_vec2(),
        }
    }
}

/// A root and the patches on it, 8 bits a channel.
#[derive(Debug, Clone)]
pub(crate) struct Canvas {
    pub(crate) root_size: (u32, u32),
    pub(crate) root: Vec<Vec<[u8; 4]>>,
    pub(crate) laid: Vec<Laid>,
    /// Patch images: one for each patch, but one for all patches that share it.
    pub(crate) levels: Vec<Vec<Vec<[u8; 4]>>>,
}

impl Canvas {
    /// Patches, by their number, that share some of the root with what `matrix` leads into 0 to 1.
    pub(crate) fn touching(&self, matrix: &DMat3) -> Vec<u16> {
        let inverse = normalised(matrix.inverse());
        let touches =
            |laid: &Laid| area(&seen_in(&normalised(laid.matrix * inverse), DVec2::ONE, DVec2::ONE)) > 1e-9;
        (0u16..).zip(&self.laid).filter(|(_, laid)| touches(laid)).map(|(index, _)| index).collect()
    }

    /// A table of one tile that names these patches, read at the levels that fit.
    pub(crate) fn table(&self, names: &[u16]) -> Vec<UVec4> {
        let mut table = vec![UVec4::new((names.len() as u32) << 20 | 1, 0, 0, 0)];
        let uppermost_first: Vec<u16> = names.iter().rev().copied().collect();
        table.extend(list_texels(&uppermost_first, f32::INFINITY));
        table.resize(table.len().next_multiple_of(TEXFOLD_ZIPMAP_RECORD as usize), UVec4::ZERO);
        for laid in &self.laid {
            let numbers = (self.levels[laid.content].len(), laid.content);
            table.extend(record(&laid.rows(), laid.size, numbers, (&[], 1)));
        }
        table
    }

    pub(crate) fn view<'a>(&'a self, table: &'a [UVec4]) -> ZipmapView<'a> {
        let (width, height) = self.root_size;
        let params = TexfoldZipmapParams {
            size: [width, height],
            levels: self.root.len() as u32,
            address_mode: TEXFOLD_CLAMP,
            root_size: [width, height],
            root_levels: self.root.len() as u32,
            root_swizzle: TEXFOLD_RGBA,
            tiles: [1, 1],
            record_start: (table.len() - TEXFOLD_ZIPMAP_RECORD as usize * self.laid.len()) as u32,
            patch_swizzle: TEXFOLD_RGBA,
            row_log2: 8,
            reserved: [0; 3],
        };
        ZipmapView { params, table, root: &self.root, patches: &self.levels }
    }
}

/// The colour under a footprint.
pub(crate) fn colour(view: &ZipmapView<'_>, at: &Footprint) -> Texel {
    texfold_zipmap_pixel(view, at.uv, at.dx, at.dy)
}

/// Opacity of patch `index` there, were it alone.
pub(crate) fn cover(view: &ZipmapView<'_>, index: u16, at: &Footprint) -> f32 {
    texfold_zipmap_layer(view, u32::from(index), at.uv, at.dx, at.dy).w
}

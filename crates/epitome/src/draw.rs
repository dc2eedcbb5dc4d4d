//! Images drawn between texels on the CPU: as [`crate::decode::texfold_epitome_bilinear`] place by place, but row by
//! row.
//!
//! Columns and rows of pixels have their texels, places and weights found once. Along a row the leaves above and
//! below are kept until the texels leave them, and a leaf that stands at several corners is read once.

use glam::{BVec2, UVec2, Vec2, Vec4};
use texfold_core::address::{texfold_level_size, texfold_tap};
use texfold_core::parallel::for_each_row;
use texfold_core::sample::{TEXFOLD_NORMAL, texfold_bilinear, texfold_mix, texfold_swizzle};
use texfold_core::{Encoded, Texel};

use crate::EpitomeTexture;
use crate::decode::{
    EpitomeView, TexfoldEpitomeLeaf, TexfoldEpitomeSource, plane_of, tap_at, texfold_epitome_leaf,
    texfold_epitome_place, texfold_epitome_plane_level, texfold_epitome_seam, texfold_epitome_source,
};

/// What a column or a row of pixels reads.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    /// The texels on both sides.
    texels: [u32; 2],
    /// The place in texels, as leaves of either side see it: another one only where an image repeats.
    places: [f32; 2],
    /// Weight of the second.
    weight: f32,
}

impl EpitomeTexture {
    /// An image of `width` x `height` pixels of level 0 of image `image`, from `corner` on, `extent` wide and high,
    /// both in texture coordinates: continuous reconstruction, at any magnification. All black where there is no such
    /// image.
    #[must_use]
    pub fn draw(&self, image: u32, corner: Vec2, extent: Vec2, (width, height): (u32, u32)) -> Vec<Texel> {
        let mut out = vec![Texel::ZERO; width as usize * height as usize];
        if out.is_empty() || image as usize >= self.layout().images.len() {
            return out;
        }
        let view = self.view(image);
        let step = extent / UVec2::new(width, height).as_vec2();
        let columns: Vec<Line> =
            (0..width).map(|x| lines(&view, corner + (x as f32 + 0.5) * step)[0]).collect();
        for_each_row(&mut out, width as usize, |y, row| {
            let line = lines(&view, corner + (y as f32 + 0.5) * step)[1];
            draw_row(&view, &columns, line, row);
        });
        out
    }
}

/// The column and the row that `uv` lies in.
fn lines(view: &EpitomeView<'_>, uv: Vec2) -> [Line; 2] {
    let size = UVec2::from(view.params.size);
    let tap = texfold_tap(uv, size, view.params.address_mode);
    let seam = texfold_epitome_seam(&view.params, tap, size, 0);
    let edge = seam.high.cmpeq(seam.low);
    let ahead = seam.low.as_vec2() + 0.5 + Vec2::select(edge, Vec2::ZERO, seam.away);
    let back = seam.high.as_vec2() + 0.5 + Vec2::select(edge, Vec2::ZERO, seam.away - Vec2::ONE);
    // Equal texels have one place, and no rounding between the two.
    let next: BVec2 = seam.high.cmpeq(seam.low + UVec2::ONE);
    let back = Vec2::select(next, ahead, back);
    [0, 1].map(|axis| Line {
        texels: [seam.low[axis], seam.high[axis]],
        places: [ahead[axis], back[axis]],
        weight: seam.weight[axis],
    })
}

/// The leaves of a column of texels on both sides of a row of pixels.
struct Column<'a> {
    /// The texels' columns that have these leaves.
    range: std::ops::Range<u32>,
    leaves: [Ready<'a>; 2],
}

impl<'a> Column<'a> {
    fn at(view: &EpitomeView<'a>, x: u32, row: &Line) -> Self {
        let leaves = row.texels.map(|y| texfold_epitome_leaf(view, UVec2::new(x, y)));
        let [first, second] = leaves.map(|leaf| leaf.corner.x..leaf.corner.x + leaf.side);
        let range = first.start.max(second.start)..first.end.min(second.end);
        Column { range, leaves: leaves.map(|leaf| Ready::new(view, leaf)) }
    }

    fn colour(&self, x: f32, row: &Line) -> Texel {
        let [upper, lower] = &self.leaves;
        let first = upper.colour(Vec2::new(x, row.places[0]));
        if upper.leaf == lower.leaf && row.places[0] == row.places[1] {
            return first;
        }
        texfold_mix(first, lower.colour(Vec2::new(x, row.places[1])), row.weight)
    }
}

fn draw_row(view: &EpitomeView<'_>, columns: &[Line], row: Line, out: &mut [Texel]) {
    let Some(first) = columns.first() else { return };
    let mut sides = first.texels.map(|x| Column::at(view, x, &row));
    for (texel, line) in out.iter_mut().zip(columns) {
        for (side, &x) in sides.iter_mut().zip(&line.texels) {
            if !side.range.contains(&x) {
                *side = Column::at(view, x, &row);
            }
        }
        let [left, right] = &sides;
        let colour = left.colour(line.places[0], &row);
        let same = left.leaves[0].leaf == right.leaves[0].leaf && left.leaves[1].leaf == right.leaves[1].leaf;
        *texel = if same && line.places[0] == line.places[1] {
            colour
        } else {
            texfold_mix(colour, right.colour(line.places[1], &row), line.weight)
        };
    }
}

/// A leaf with all that does not change within it.
struct Ready<'a> {
    leaf: TexfoldEpitomeLeaf,
    source: TexfoldEpitomeSource,
    /// Its outermost texels' centres.
    inside: [Vec2; 2],
    plane_level: u32,
    /// Texels of the epitome's level, and its size.
    texels: &'a [Texel],
    size: UVec2,
    is_normal: bool,
}

impl<'a> Ready<'a> {
    fn new(view: &EpitomeView<'a>, leaf: TexfoldEpitomeLeaf) -> Self {
        let source = texfold_epitome_source(view, leaf.entry);
        let plane_level = texfold_epitome_plane_level(view, source.matrix, 0);
        let (size, planes) = plane_of(view, source.plane);
        let corner = leaf.corner.as_vec2();
        let end = (corner + leaf.side as f32).min(UVec2::from(view.params.size).as_vec2());
        Ready {
            leaf,
            source,
            inside: [corner + 0.5, end - 0.5],
            plane_level,
            texels: planes.get(plane_level as usize).map_or(&[], Vec::as_slice),
            size: texfold_level_size(size, plane_level),
            is_normal: view.params.swizzle == TEXFOLD_NORMAL,
        }
    }

    /// Its colour at a place of the image, in texels, or the nearest that is inside.
    #[inline]
    fn colour(&self, at: Vec2) -> Texel {
        let at = at.min(self.inside[1]).max(self.inside[0]);
        let place = texfold_epitome_place(&self.source, self.leaf, at, self.plane_level);
        let tap = tap_at(place, self.size, self.plane_level);
        let texel =
            |x: u32, y: u32| self.texels.get((y * self.size.x + x) as usize).copied().unwrap_or(Texel::ZERO);
        let around = [
            texel(tap.low.x, tap.low.y),
            texel(tap.high.x, tap.low.y),
            texel(tap.low.x, tap.high.y),
            texel(tap.high.x, tap.high.y),
        ];
        let mut blended = texfold_bilinear(around, tap.weight);
        if self.is_normal {
            blended = texfold_swizzle(blended, blended, TEXFOLD_NORMAL);
        }
        (blended * self.source.gain + self.source.offset).clamp(Vec4::ZERO, Vec4::ONE)
    }
}

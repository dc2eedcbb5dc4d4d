//! CPU reference of `shaders/wgsl/zipmap.wgsl`, function for function.
//!
//! A colour is that of the root at the texture coordinate, and over it that of each patch that its tile names, the
//! uppermost first: by its alpha, at the place that the patch's matrix leads to, from the mip level that fits. A patch
//! has no colour where its own texture coordinates leave 0 to 1, and fades out behind its last mip level. Texels are
//! those of [`ZipmapView`], with all of their channels, where the shader reads planes and puts channels in their place
//! at the end.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

use glam::{IVec2, UVec2, UVec4, Vec2, Vec3, Vec4};
use texfold_core::Texel;
use texfold_core::address::{
    texfold_fold, texfold_inside, texfold_level, texfold_level_size, texfold_lod, texfold_nearest,
    texfold_tap,
};
use texfold_core::sample::{texfold_bilinear, texfold_mix};

/// Most patches that a tile names.
pub const TEXFOLD_ZIPMAP_MOST: u32 = 2048;
/// Texels of the table that describe a patch.
pub const TEXFOLD_ZIPMAP_RECORD: u32 = 8;
/// Numbers of 16 bits before the names in a list: how fine its patches are.
pub const TEXFOLD_ZIPMAP_BEFORE: u32 = 2;
/// Transmittance below which compositing stops: a quarter of a step of 8 bits.
pub const TEXFOLD_ZIPMAP_LEAST: f32 = 0.0009765625;
/// Levels that are blended.
pub const TEXFOLD_ZIPMAP_BLENDED: u32 = 2;
/// Most lookups for one pixel that is longer than wide.
pub const TEXFOLD_ZIPMAP_LONG: u32 = 8;
/// Least third coordinate of a place inside a patch: nearer to its horizon, or behind it, the patch is transparent.
pub const TEXFOLD_ZIPMAP_HORIZON: f32 = 0.0001;

/// The parameters of a texture, as the shader's uniform block holds them: 16 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldZipmapParams {
    /// Columns and rows of level 0, as fine as the finest patch.
    pub size: [u32; 2],
    /// Mip levels.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// Columns and rows of level 0 of the root.
    pub root_size: [u32; 2],
    /// Mip levels of the root.
    pub root_levels: u32,
    /// How texels are read from the root's planes.
    pub root_swizzle: u32,
    /// Columns and rows of tiles.
    pub tiles: [u32; 2],
    /// First texel of the table that describes patches.
    pub record_start: u32,
    /// How texels are read from the patches' plane.
    pub patch_swizzle: u32,
    /// Binary logarithm of the texels in a row of the table.
    pub row_log2: u32,
    /// Always 0.
    pub reserved: [u32; 3],
}

/// A texture: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct ZipmapView<'a> {
    /// The uniform block.
    pub params: TexfoldZipmapParams,
    /// The table's texels.
    pub table: &'a [UVec4],
    /// The texels of each level of the root, row by row.
    pub root: &'a [Vec<[u8; 4]>],
    /// The texels of each level of the patch images, row by row: the shader finds them in one plane.
    pub patches: &'a [Vec<Vec<[u8; 4]>>],
}

/// A patch as the table describes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldZipmapPatch {
    /// What the root's texture coordinate u adds to the place in texels of level 0, times a third coordinate.
    pub by_u: Vec3,
    /// The same for v.
    pub by_v: Vec3,
    /// The same for 1.
    pub by_one: Vec3,
    /// Columns and rows of level 0.
    pub size: IVec2,
    /// Mip levels.
    pub levels: u32,
    /// Number of its patch image: the shader has places in the plane instead.
    pub content: u32,
}

fn texel(bytes: [u8; 4]) -> Texel {
    Vec4::from_array(bytes.map(f32::from)) / 255.0
}

/// Where texel `index` of the table lies.
#[must_use]
#[inline]
pub fn texfold_zipmap_place(view: &ZipmapView<'_>, index: u32) -> UVec2 {
    let row = index >> view.params.row_log2;
    UVec2::new(index - (row << view.params.row_log2), row)
}

/// Texel `index` of the table; an out-of-range read returns zeros that are never used.
#[must_use]
#[inline]
pub fn texfold_zipmap_entry(view: &ZipmapView<'_>, index: u32) -> UVec4 {
    let place = texfold_zipmap_place(view, index);
    let at = ((place.y as usize) << view.params.row_log2) + place.x as usize;
    view.table.get(at).copied().unwrap_or(UVec4::ZERO)
}

/// Two numbers of 16 bits.
#[must_use]
#[inline]
pub fn texfold_zipmap_pair(both: u32) -> IVec2 {
    UVec2::new(both & 0xffff, both >> 16).as_ivec2()
}

/// The patch of that number.
#[must_use]
#[inline]
pub fn texfold_zipmap_patch(view: &ZipmapView<'_>, index: u32) -> TexfoldZipmapPatch {
    let start = view.params.record_start + index * TEXFOLD_ZIPMAP_RECORD;
    let [x, y, z] = [0, 1, 2].map(|column| texfold_zipmap_entry(view, start + column));
    let column = |column: UVec4| Vec3::from_array([column.x, column.y, column.z].map(f32::from_bits));
    TexfoldZipmapPatch {
        by_u: column(x),
        by_v: column(y),
        by_one: column(z),
        size: texfold_zipmap_pair(x.w),
        levels: z.w & 0xff,
        content: z.w >> 8,
    }
}

/// Four texels of a level around `at`, in texels of it, blended.
#[must_use]
#[inline]
pub fn texfold_zipmap_blend(texels: &[[u8; 4]], size: IVec2, at: Vec2) -> Vec4 {
    let last = size - 1;
    let place = (at - 0.5).max(Vec2::ZERO).min(last.as_vec2());
    let low = place.as_ivec2();
    // Behind the last column or row, where the weight is 0, the shader reads what lies beside.
    let high = (low + 1).min(last);
    let texel =
        |x: i32, y: i32| texels.get((y * size.x + x) as usize).map_or(Vec4::ZERO, |&bytes| texel(bytes));
    let around = [texel(low.x, low.y), texel(high.x, low.y), texel(low.x, high.y), texel(high.x, high.y)];
    texfold_bilinear(around, place - low.as_vec2())
}

/// Colour and alpha of a texel of a patch: transparent where it is not `inside`.
#[must_use]
#[inline]
pub fn texfold_zipmap_visible(texel: Vec4, inside: bool) -> Vec4 {
    texel.truncate().extend(if inside { texel.w } else { 0.0 })
}

/// Colour and alpha of a patch at `uv` of the root, where no pixel is larger than its texels.
#[must_use]
#[inline]
pub fn texfold_zipmap_near(view: &ZipmapView<'_>, index: u32, uv: Vec2) -> Vec4 {
    let layer = texfold_zipmap_patch(view, index);
    let place = layer.by_u * uv.x + layer.by_v * uv.y + layer.by_one;
    let at = place.truncate() / place.z;
    let inside = at.cmpge(Vec2::ZERO).all() && at.cmple(layer.size.as_vec2()).all();
    let texels = view.patches.get(layer.content as usize).and_then(|levels| levels.first());
    let Some(texels) = texels else { return Vec4::ZERO };
    let texel = texfold_zipmap_blend(texels, layer.size, at);
    texfold_zipmap_visible(texel, inside && place.z >= TEXFOLD_ZIPMAP_HORIZON)
}

/// Four texels of level `level` of a patch around `share` of its sides, blended.
#[must_use]
#[inline]
pub fn texfold_zipmap_level(
    view: &ZipmapView<'_>,
    layer: &TexfoldZipmapPatch,
    share: Vec2,
    level: u32,
) -> Vec4 {
    let size = texfold_level_size(layer.size.as_uvec2(), level).as_ivec2();
    let texels = view.patches.get(layer.content as usize).and_then(|levels| levels.get(level as usize));
    let Some(texels) = texels else { return Vec4::ZERO };
    texfold_zipmap_blend(texels, size, share * size.as_vec2())
}

/// Colour and alpha of a patch at `uv` of the root, which moves by `dx` and `dy` to the pixels right and below.
#[must_use]
#[inline]
pub fn texfold_zipmap_layer(view: &ZipmapView<'_>, index: u32, uv: Vec2, dx: Vec2, dy: Vec2) -> Vec4 {
    let layer = texfold_zipmap_patch(view, index);
    let place = layer.by_u * uv.x + layer.by_v * uv.y + layer.by_one;
    let at = place.truncate() / place.z;
    let size = layer.size.as_vec2();
    let inside = at.cmpge(Vec2::ZERO).all() && at.cmple(size).all() && place.z >= TEXFOLD_ZIPMAP_HORIZON;
    let to_right = layer.by_u * dx.x + layer.by_v * dx.y;
    let to_below = layer.by_u * dy.x + layer.by_v * dy.y;
    let across = (to_right.truncate() - at * to_right.z) / place.z;
    let down = (to_below.truncate() - at * to_below.z) / place.z;
    let lod = 0.5 * across.length_squared().max(down.length_squared()).max(1.0).log2();
    if !(inside && lod < layer.levels as f32) {
        return Vec4::ZERO;
    }
    let low = lod.floor();
    let share = at / size;
    let fine = texfold_zipmap_level(view, &layer, share, low as u32);
    let mut coarse = fine;
    if lod > low {
        coarse = texfold_zipmap_level(view, &layer, share, (low as u32 + 1).min(layer.levels - 1));
    }
    // Behind its last level a patch fades out.
    let last = low as u32 + 1 >= layer.levels;
    let texel = texfold_mix(fine, coarse, lod - low);
    let visible = texfold_zipmap_visible(texel, true);
    visible.truncate().extend(visible.w * if last { 1.0 - (lod - low) } else { 1.0 })
}

/// Four texels of level `level` of the root around `uv`, blended.
#[must_use]
#[inline]
pub fn texfold_zipmap_root_blend(view: &ZipmapView<'_>, uv: Vec2, level: u32) -> Vec4 {
    let size = texfold_level_size(UVec2::from(view.params.root_size), level);
    let texels = &view.root[level as usize];
    let tap = texfold_tap(uv, size, view.params.address_mode);
    let at = |x: u32, y: u32| texel(texels[(y * size.x + x) as usize]);
    let around = [
        at(tap.low.x, tap.low.y),
        at(tap.high.x, tap.low.y),
        at(tap.low.x, tap.high.y),
        at(tap.high.x, tap.high.y),
    ];
    texfold_bilinear(around, tap.weight)
}

/// The root's colour at `uv`, which moves by `dx` and `dy` to the pixels right and below.
#[must_use]
#[inline]
pub fn texfold_zipmap_root(view: &ZipmapView<'_>, uv: Vec2, dx: Vec2, dy: Vec2) -> Vec4 {
    let wanted = texfold_level(dx, dy, UVec2::from(view.params.root_size));
    let lod = texfold_lod(wanted, view.params.root_levels);
    let low = lod.floor();
    let fine = texfold_zipmap_root_blend(view, uv, low as u32);
    if lod == low {
        return fine;
    }
    texfold_mix(fine, texfold_zipmap_root_blend(view, uv, low as u32 + 1), lod - low)
}

/// The tile that `uv` lies in: how many patches touch it, and the first texel of their list.
#[must_use]
#[inline]
pub fn texfold_zipmap_tile(view: &ZipmapView<'_>, uv: Vec2) -> UVec2 {
    let tiles = UVec2::from(view.params.tiles);
    let tile = texfold_inside((uv * tiles.as_vec2()).floor().as_ivec2(), tiles);
    let number = tile.y * tiles.x + tile.x;
    let found = texfold_zipmap_entry(view, number / 4)[number as usize % 4];
    UVec2::new(found >> 20, found & 0xfffff)
}

/// The patch at place `k` of a list.
#[must_use]
#[inline]
pub fn texfold_zipmap_name(view: &ZipmapView<'_>, list: u32, k: u32) -> u32 {
    let at = k + TEXFOLD_ZIPMAP_BEFORE;
    texfold_zipmap_entry(view, list + at / 8)[at as usize / 2 % 4] >> (16 * (at % 2)) & 0xffff
}

/// What is seen of all so far, sums of colours and what is left to be seen of those below, with a further patch below.
#[must_use]
#[inline]
pub fn texfold_zipmap_under(front: Vec4, back: Vec4) -> Vec4 {
    let share = front.w * back.w;
    (front.truncate() + back.truncate() * share).extend(front.w - share)
}

/// The colour at `uv`, which moves by `dx` and `dy` to the pixels right and below, of a pixel that is about as long as
/// wide.
#[must_use]
pub fn texfold_zipmap_pixel(view: &ZipmapView<'_>, uv: Vec2, dx: Vec2, dy: Vec2) -> Texel {
    let at = texfold_fold(uv, view.params.address_mode);
    let found = texfold_zipmap_tile(view, at);
    let root = UVec2::from(view.params.root_size).as_vec2();
    let longest = (dx * root).length_squared().max((dy * root).length_squared());
    let is_near = longest * f32::from_bits(texfold_zipmap_entry(view, found.y).x) <= 1.0;
    // Sums of colours, and what is still to be seen of the patches below.
    let mut seen = Vec4::W;
    for k in 0..found.x.min(TEXFOLD_ZIPMAP_MOST) {
        let index = texfold_zipmap_name(view, found.y, k);
        let layer = if is_near {
            texfold_zipmap_near(view, index, at)
        } else {
            texfold_zipmap_layer(view, index, at, dx, dy)
        };
        seen = texfold_zipmap_under(seen, layer);
        if seen.w <= TEXFOLD_ZIPMAP_LEAST {
            break;
        }
    }
    let patches = seen.truncate().extend(1.0 - seen.w);
    if seen.w <= TEXFOLD_ZIPMAP_LEAST {
        return patches;
    }
    patches + texfold_zipmap_root(view, uv, dx, dy) * seen.w
}

/// The colour at `uv`, which moves by `dx` and `dy` to the pixels right and below: 0 to 1 from the top left of the
/// root, and beyond by the address mode. A pixel that is longer than wide is the mean of several, side by side.
#[must_use]
pub fn texfold_zipmap_sample_grad(view: &ZipmapView<'_>, uv: Vec2, dx: Vec2, dy: Vec2) -> Texel {
    let root = UVec2::from(view.params.root_size).as_vec2();
    let (across, down) = (dx * root, dy * root);
    let longer = across.length_squared() >= down.length_squared();
    let along = if longer { across } else { down };
    let squared = along.length_squared();
    // Its length over its width, which is its area over its length, and its length in texels of the finest patch.
    let ratio = squared / across.perp_dot(down).abs().max(1e-12);
    let texels = squared.sqrt() * view.params.size[0] as f32 / root.x;
    let count = (ratio + 0.5).floor().min(texels.ceil()).max(1.0).min(TEXFOLD_ZIPMAP_LONG as f32);
    let step = if longer { dx } else { dy } / count;
    // A part is as wide as long.
    let side = Vec2::new(-along.y, along.x) / (root * count);
    let (right, below) = if count == 1.0 { (dx, dy) } else { (step, side) };
    let mut sum = Vec4::ZERO;
    for k in 0..(count as u32).min(TEXFOLD_ZIPMAP_LONG) {
        let place = uv + step * (k as f32 + 0.5 - 0.5 * count);
        sum += texfold_zipmap_pixel(view, place, right, below);
    }
    sum / count
}

/// The colour at `uv` where pixels are as large as the texels of level `lod`, clamped to those that there are.
#[must_use]
pub fn texfold_zipmap_sample_level(view: &ZipmapView<'_>, uv: Vec2, lod: f32) -> Texel {
    let step = texfold_lod(lod, view.params.levels).exp2() / UVec2::from(view.params.size).as_vec2();
    texfold_zipmap_pixel(view, uv, Vec2::new(step.x, 0.0), Vec2::new(0.0, step.y))
}

/// The colour at `uv` where pixels are the texels of level `level`.
#[must_use]
pub fn texfold_zipmap_bilinear(view: &ZipmapView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level).as_vec2();
    texfold_zipmap_pixel(view, uv, Vec2::new(1.0 / size.x, 0.0), Vec2::new(0.0, 1.0 / size.y))
}

/// The texel at column `at.x` and row `at.y` of level `level`, clamped to it.
#[must_use]
pub fn texfold_zipmap_fetch(view: &ZipmapView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let place = texfold_inside(at, size).as_vec2() + 0.5;
    texfold_zipmap_bilinear(view, place / size.as_vec2(), level)
}

/// The texel of level `level` that `uv` lies in.
#[must_use]
pub fn texfold_zipmap_nearest(view: &ZipmapView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let at = texfold_nearest(uv, size, view.params.address_mode);
    texfold_zipmap_fetch(view, at.as_ivec2(), level)
}

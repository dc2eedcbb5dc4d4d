//! CPU reference of `shaders/wgsl/lightfield.wgsl`, function for function.
//!
//! The mesh is an array of 32-bit words: for each vertex its place (3 numbers), its smooth normal (3) and three scales
//! a stored term; then for each triangle its vertices and its patch: column (14 bits), row (14 bits), binary logarithm of the
//! side (3 bits) and whether it is turned by half (1 bit).
//!
//! A patch of side `n` holds the triangle's lattice of `(n + 1)(n + 2) / 2` texels; texel (i, j), i + j <= n, is the
//! place with weights i / n and j / n of the second and third corner. Two patches share a rectangle of n + 1 columns and
//! n + 2 rows, the second turned by half. Places between are blended from the three texels around them.

use glam::{UVec2, Vec2, Vec3};
use texfold_core::Texel;

/// View maps lie over the direction to the eye.
pub const TEXFOLD_LIGHTFIELD_VIEW: u32 = 0;
/// View maps lie over that direction reflected about the normal.
pub const TEXFOLD_LIGHTFIELD_REFLECTED: u32 = 1;
/// Most terms.
pub const TEXFOLD_LIGHTFIELD_TERMS: u32 = 8;
/// Words in a row of the mesh's texture.
pub const TEXFOLD_LIGHTFIELD_ROW: u32 = 1024;

/// The parameters, as the shader's uniform block holds them: 16 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldLightfieldParams {
    /// Vertices of the mesh.
    pub vertices: u32,
    /// Triangles of the mesh.
    pub triangles: u32,
    /// Terms that are drawn, at most those that are stored.
    pub terms: u32,
    /// Terms that the vertices have scales of.
    pub stored_terms: u32,
    /// [`TEXFOLD_LIGHTFIELD_VIEW`] or [`TEXFOLD_LIGHTFIELD_REFLECTED`].
    pub directions: u32,
    /// Texels a side of a view map.
    pub grid: u32,
    /// View maps in a row of their atlas.
    pub view_columns: u32,
    /// Rows from one term to the next in the atlas of view maps.
    pub view_height: u32,
    /// Columns from one corner to the next in the atlas of surface maps.
    pub surface_width: u32,
    /// Rows from one term to the next in the atlas of surface maps.
    pub surface_height: u32,
    /// How texels are read from the planes of the mean.
    pub mean_swizzle: u32,
    /// How texels are read from the planes of the maps.
    pub map_swizzle: u32,
    /// The byte of a map that stands for 0.
    pub map_zero: f32,
    /// Bytes from there to the one that stands for 1.
    pub map_range: f32,
    /// Always 0.
    pub reserved: [u32; 2],
}

/// What the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct LightfieldView<'a> {
    /// The uniform block.
    pub params: TexfoldLightfieldParams,
    /// The mesh.
    pub mesh: &'a [u32],
    /// Texels of the mean, `params.surface_width` a row.
    pub mean: &'a [Texel],
    /// Texels of the surface maps, three times `params.surface_width` a row.
    pub surface: &'a [Texel],
    /// Texels of the view maps, `params.view_columns * params.grid` a row.
    pub view: &'a [Texel],
}

/// Three texels of a patch and how much each counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldLightfieldPatch {
    /// Column and row of the first texel.
    pub a: UVec2,
    /// Of the second.
    pub b: UVec2,
    /// Of the third.
    pub c: UVec2,
    /// Their weights, summing to 1.
    pub weights: Vec3,
}

/// What is read of a view map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldLightfieldTap {
    /// Column and row of the upper left of four texels.
    pub low: UVec2,
    /// Weight of those right and below.
    pub weight: Vec2,
}

/// Word `index` of the mesh.
#[must_use]
pub fn texfold_lightfield_word(view: &LightfieldView<'_>, index: u32) -> u32 {
    view.mesh[index as usize]
}

/// Three words from `index` on as numbers.
#[must_use]
pub fn texfold_lightfield_vector(view: &LightfieldView<'_>, index: u32) -> Vec3 {
    let number = |offset: u32| f32::from_bits(texfold_lightfield_word(view, index + offset));
    Vec3::new(number(0), number(1), number(2))
}

/// The first word of a vertex.
#[must_use]
pub fn texfold_lightfield_vertex(view: &LightfieldView<'_>, vertex: u32) -> u32 {
    vertex * (6 + 3 * view.params.stored_terms)
}

/// The first word of a triangle.
#[must_use]
pub fn texfold_lightfield_triangle(view: &LightfieldView<'_>, triangle: u32) -> u32 {
    texfold_lightfield_vertex(view, view.params.vertices) + 4 * triangle
}

/// Where a vertex is.
#[must_use]
pub fn texfold_lightfield_position(view: &LightfieldView<'_>, vertex: u32) -> Vec3 {
    texfold_lightfield_vector(view, texfold_lightfield_vertex(view, vertex))
}

/// The smooth unit normal of a vertex.
#[must_use]
pub fn texfold_lightfield_normal(view: &LightfieldView<'_>, vertex: u32) -> Vec3 {
    texfold_lightfield_vector(view, texfold_lightfield_vertex(view, vertex) + 3)
}

/// How strongly a term of a vertex counts in red, green and blue.
#[must_use]
pub fn texfold_lightfield_scale(view: &LightfieldView<'_>, vertex: u32, term: u32) -> Vec3 {
    texfold_lightfield_vector(view, texfold_lightfield_vertex(view, vertex) + 6 + 3 * term)
}

/// `direction` in the frame whose third axis is `normal` (Duff et al. 2017).
#[must_use]
pub fn texfold_lightfield_local(direction: Vec3, normal: Vec3) -> Vec3 {
    let side = if normal.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (side + normal.z);
    let b = normal.x * normal.y * a;
    let x = Vec3::new(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    let y = Vec3::new(b, side + normal.y * normal.y * a, -normal.y);
    Vec3::new(direction.dot(x), direction.dot(y), direction.dot(normal))
}

/// The place of a local direction on the unit disc: the hemisphere around the normal, the rest on the rim.
#[must_use]
pub fn texfold_lightfield_disc(directions: u32, local: Vec3) -> Vec2 {
    let mut scale = 1.0;
    if directions == TEXFOLD_LIGHTFIELD_REFLECTED {
        scale = 1.0 / (1.0 + local.z).max(0.001).sqrt();
    }
    let at = local.truncate() * scale;
    let radius = at.length();
    if local.z < 0.0 || radius > 1.0 { at / radius.max(0.000_001) } else { at }
}

/// What is read of the view maps of `vertex` towards `direction`, a unit vector to the eye or its reflection.
#[must_use]
pub fn texfold_lightfield_tap(
    view: &LightfieldView<'_>,
    vertex: u32,
    direction: Vec3,
) -> TexfoldLightfieldTap {
    let local = texfold_lightfield_local(direction, texfold_lightfield_normal(view, vertex));
    let disc = texfold_lightfield_disc(view.params.directions, local);
    let grid = view.params.grid;
    let at = (disc * 0.5 + 0.5) * (grid - 1) as f32;
    let low = at.max(Vec2::ZERO).as_uvec2().min(UVec2::splat(grid - 2));
    let columns = view.params.view_columns;
    let tile = UVec2::new(vertex % columns, vertex / columns) * grid;
    TexfoldLightfieldTap { low: tile + low, weight: at - low.as_vec2() }
}

/// What is read of the patch `place` at weights `barycentric` of the triangle's corners.
#[must_use]
pub fn texfold_lightfield_patch(place: u32, barycentric: Vec3) -> TexfoldLightfieldPatch {
    let side = 1u32 << ((place >> 28) & 7);
    let at = Vec2::new(barycentric.y, barycentric.z).clamp(Vec2::ZERO, Vec2::ONE) * side as f32;
    let x = (at.x as u32).min(side - 1);
    let y = (at.y as u32).min(side - 1 - x);
    let part = (at - UVec2::new(x, y).as_vec2()).clamp(Vec2::ZERO, Vec2::ONE);
    let (a, weights) = if part.x + part.y > 1.0 && x + y + 2 <= side {
        (UVec2::new(x + 1, y + 1), Vec3::new(part.x + part.y - 1.0, 1.0 - part.y, 1.0 - part.x))
    } else {
        (UVec2::new(x, y), Vec3::new(1.0 - part.x - part.y, part.x, part.y))
    };
    let (b, c) = (UVec2::new(x + 1, y), UVec2::new(x, y + 1));
    let corner = UVec2::new(place & 0x3fff, (place >> 14) & 0x3fff);
    if place >> 31 == 1 {
        let last = corner + UVec2::new(side, side + 1);
        return TexfoldLightfieldPatch { a: last - a, b: last - b, c: last - c, weights };
    }
    TexfoldLightfieldPatch { a: corner + a, b: corner + b, c: corner + c, weights }
}

/// A value of a map from a stored one, 0 to 1.
#[must_use]
pub fn texfold_lightfield_value(view: &LightfieldView<'_>, stored: Vec3) -> Vec3 {
    (stored * 255.0 - view.params.map_zero) / view.params.map_range
}

/// A texel of the mean.
#[must_use]
pub fn texfold_lightfield_mean_load(view: &LightfieldView<'_>, at: UVec2) -> Vec3 {
    view.mean[(at.y * view.params.surface_width + at.x) as usize].truncate()
}

/// A texel of the surface maps.
#[must_use]
pub fn texfold_lightfield_surface_load(view: &LightfieldView<'_>, at: UVec2) -> Vec3 {
    let texel = view.surface[(at.y * 3 * view.params.surface_width + at.x) as usize];
    texfold_lightfield_value(view, texel.truncate())
}

/// A texel of the view maps.
#[must_use]
pub fn texfold_lightfield_view_load(view: &LightfieldView<'_>, at: UVec2) -> Vec3 {
    let texel = view.view[(at.y * view.params.view_columns * view.params.grid + at.x) as usize];
    texfold_lightfield_value(view, texel.truncate())
}

/// The mean of a patch.
#[must_use]
pub fn texfold_lightfield_mean(view: &LightfieldView<'_>, read: TexfoldLightfieldPatch) -> Vec3 {
    texfold_lightfield_mean_load(view, read.a) * read.weights.x
        + texfold_lightfield_mean_load(view, read.b) * read.weights.y
        + texfold_lightfield_mean_load(view, read.c) * read.weights.z
}

/// The surface map of a term and a corner of the triangle.
#[must_use]
pub fn texfold_lightfield_surface(
    view: &LightfieldView<'_>,
    read: TexfoldLightfieldPatch,
    corner: u32,
    term: u32,
) -> Vec3 {
    let at = UVec2::new(corner * view.params.surface_width, term * view.params.surface_height);
    texfold_lightfield_surface_load(view, at + read.a) * read.weights.x
        + texfold_lightfield_surface_load(view, at + read.b) * read.weights.y
        + texfold_lightfield_surface_load(view, at + read.c) * read.weights.z
}

/// The view map of a term.
#[must_use]
pub fn texfold_lightfield_view(view: &LightfieldView<'_>, tap: TexfoldLightfieldTap, term: u32) -> Vec3 {
    let low = tap.low + UVec2::new(0, term * view.params.view_height);
    let load = |x, y| texfold_lightfield_view_load(view, low + UVec2::new(x, y));
    let mix = |a: Vec3, b: Vec3, weight: f32| a * (1.0 - weight) + b * weight;
    let upper = mix(load(0, 0), load(1, 0), tap.weight.x);
    let lower = mix(load(0, 1), load(1, 1), tap.weight.x);
    mix(upper, lower, tap.weight.y)
}

/// All terms of one corner.
#[must_use]
pub fn texfold_lightfield_corner(
    view: &LightfieldView<'_>,
    read: TexfoldLightfieldPatch,
    corner: u32,
    vertex: u32,
    direction: Vec3,
) -> Vec3 {
    let tap = texfold_lightfield_tap(view, vertex, direction);
    let mut sum = Vec3::ZERO;
    for term in 0..view.params.terms.min(TEXFOLD_LIGHTFIELD_TERMS) {
        let surface = texfold_lightfield_surface(view, read, corner, term);
        let scale = texfold_lightfield_scale(view, vertex, term);
        sum += scale * surface * texfold_lightfield_view(view, tap, term);
    }
    sum
}

/// The direction that the view maps lie over, for a unit vector to the eye.
#[must_use]
pub fn texfold_lightfield_direction(directions: u32, direction: Vec3, normal: Vec3) -> Vec3 {
    if directions == TEXFOLD_LIGHTFIELD_VIEW {
        return direction;
    }
    2.0 * direction.dot(normal) * normal - direction
}

/// The colour of a place on a triangle, given by weights of its corners, towards `direction`, a unit vector to the eye.
#[must_use]
pub fn texfold_lightfield_sample(
    view: &LightfieldView<'_>,
    triangle: u32,
    barycentric: Vec3,
    direction: Vec3,
) -> Texel {
    let first = texfold_lightfield_triangle(view, triangle);
    let [a, b, c] = [0, 1, 2].map(|corner| texfold_lightfield_word(view, first + corner));
    let read = texfold_lightfield_patch(texfold_lightfield_word(view, first + 3), barycentric);
    let smooth = texfold_lightfield_normal(view, a) * barycentric.x
        + texfold_lightfield_normal(view, b) * barycentric.y
        + texfold_lightfield_normal(view, c) * barycentric.z;
    // Normals may cancel out.
    let normal = smooth / smooth.length().max(0.000_001);
    let towards = texfold_lightfield_direction(view.params.directions, direction, normal);
    let colour = texfold_lightfield_mean(view, read)
        + texfold_lightfield_corner(view, read, 0, a, towards)
        + texfold_lightfield_corner(view, read, 1, b, towards)
        + texfold_lightfield_corner(view, read, 2, c, towards);
    colour.clamp(Vec3::ZERO, Vec3::ONE).extend(1.0)
}

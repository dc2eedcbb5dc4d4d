//! CPU reference of `shaders/wgsl/lightfield.wgsl`, function for function.
//!
//! The mesh is an array of 32-bit words: for each vertex its place (3 numbers), its smooth normal (3) and for each stored term its scales
//! (a byte each for red, green and blue; 0 where the vertex has no such term) and where its view map lies (column 14 bits, row
//! above); then for each triangle its vertices, its patch of the mean and for each stored term the patches of its three corners.
//! A patch is column (14 bits), row (14 bits), binary logarithm of the side (3 bits) and whether it is turned by half (1 bit).
//!
//! A patch of side `n` holds the triangle's lattice of `(n + 1)(n + 2) / 2` texels; texel (i, j), i + j <= n, is the
//! place with weights i / n and j / n of the second and third corner. Two patches share a rectangle of n + 1 columns and
//! n + 2 rows, the second turned by half. Places between are blended from the three texels around them.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

use glam::{UVec2, Vec2, Vec3};
use texfold_core::Texel;

/// View maps lie over the direction to the eye.
pub const TEXFOLD_LIGHTFIELD_VIEW: u32 = 0;
/// View maps lie over that direction reflected about the normal.
pub const TEXFOLD_LIGHTFIELD_REFLECTED: u32 = 1;
/// View maps lie over the reflected direction in space.
pub const TEXFOLD_LIGHTFIELD_WORLD: u32 = 2;
/// Most terms.
pub const TEXFOLD_LIGHTFIELD_TERMS: u32 = 8;
/// Eighths of an octave: the step of 2^(1/8) costs at most 0.13 bits of a map's 8.
const STEPS: [f32; 8] = [
    1.0,
    1.090_507_7,
    1.189_207_1,
    1.296_839_6,
    std::f32::consts::SQRT_2,
    1.542_210_8,
    1.681_792_9,
    1.834_008,
];
/// Words in a row of the mesh's texture.
pub const TEXFOLD_LIGHTFIELD_ROW: u32 = 1024;

/// The parameters, as the shader's uniform block holds them: 12 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldLightfieldParams {
    /// Vertices of the mesh.
    pub vertices: u32,
    /// Triangles of the mesh.
    pub triangles: u32,
    /// Terms that are drawn, at most those that are stored.
    pub terms: u32,
    /// Terms that the mesh has words of.
    pub stored_terms: u32,
    /// [`TEXFOLD_LIGHTFIELD_VIEW`] or [`TEXFOLD_LIGHTFIELD_REFLECTED`].
    pub directions: u32,
    /// Texels a side of a view map.
    pub grid: u32,
    /// How texels are read from the planes of the mean.
    pub mean_swizzle: u32,
    /// How texels are read from the planes of the maps.
    pub map_swizzle: u32,
    /// The byte of a map that stands for 0.
    pub map_zero: f32,
    /// Bytes from there to the one that stands for 1.
    pub map_range: f32,
    /// How often the sides of surface maps are halved beside those of the mean.
    pub reduce_log2: u32,
    /// Always 0.
    pub reserved: u32,
}

/// What the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct LightfieldView<'a> {
    /// The uniform block.
    pub params: TexfoldLightfieldParams,
    /// The mesh.
    pub mesh: &'a [u32],
    /// Texels of the mean.
    pub mean: &'a [Texel],
    /// Of these in a row.
    pub mean_width: u32,
    /// Texels of the surface maps.
    pub surface: &'a [Texel],
    /// Of these in a row.
    pub surface_width: u32,
    /// Texels of the view maps.
    pub view: &'a [Texel],
    /// Of these in a row.
    pub view_width: u32,
}

/// Three texels of any patch of one side and how much each counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldLightfieldPatch {
    /// Steps to the second and third corner of the first texel.
    pub a: UVec2,
    /// Of the second.
    pub b: UVec2,
    /// Of the third.
    pub c: UVec2,
    /// The patch's side in steps.
    pub side: u32,
    /// Weights of the three, summing to 1.
    pub weights: Vec3,
}

/// What is read of any view map of a vertex.
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
    vertex * (6 + 2 * view.params.stored_terms)
}

/// The first word of a triangle.
#[must_use]
pub fn texfold_lightfield_triangle(view: &LightfieldView<'_>, triangle: u32) -> u32 {
    texfold_lightfield_vertex(view, view.params.vertices) + triangle * (4 + 3 * view.params.stored_terms)
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

/// The number that a byte of scales stands for: 0, or 2^((byte - 1) / 8 - 26).
#[must_use]
pub fn texfold_lightfield_scale(byte: u32) -> f32 {
    if byte == 0 {
        return 0.0;
    }
    let step = byte - 1;
    STEPS[(step & 7) as usize] * f32::from_bits((101 + (step >> 3)) << 23)
}

/// How strongly a term counts in red, green and blue, from its word.
#[must_use]
pub fn texfold_lightfield_scales(word: u32) -> Vec3 {
    Vec3::new(
        texfold_lightfield_scale(word & 0xff),
        texfold_lightfield_scale((word >> 8) & 0xff),
        texfold_lightfield_scale((word >> 16) & 0xff),
    )
}

/// `direction` in the frame whose third axis is `normal` (Duff et al. 2017); in space the direction itself.
#[must_use]
pub fn texfold_lightfield_local(directions: u32, direction: Vec3, normal: Vec3) -> Vec3 {
    if directions == TEXFOLD_LIGHTFIELD_WORLD {
        return direction;
    }
    let side = if normal.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (side + normal.z);
    let b = normal.x * normal.y * a;
    let x = Vec3::new(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    let y = Vec3::new(b, side + normal.y * normal.y * a, -normal.y);
    Vec3::new(direction.dot(x), direction.dot(y), direction.dot(normal))
}

/// The place of a direction on the square around the unit disc. A local direction lies on the disc: the hemisphere around the normal,
/// the rest on the rim; one in space on the octahedron, its lower half turned out (Meyer et al. 2010).
#[must_use]
pub fn texfold_lightfield_disc(directions: u32, local: Vec3) -> Vec2 {
    if directions == TEXFOLD_LIGHTFIELD_WORLD {
        let size = (local.x.abs() + local.y.abs() + local.z.abs()).max(0.000_001);
        let at = local.truncate() / size;
        if local.z >= 0.0 {
            return at;
        }
        let x = if at.x >= 0.0 { 1.0 - at.y.abs() } else { at.y.abs() - 1.0 };
        let y = if at.y >= 0.0 { 1.0 - at.x.abs() } else { at.x.abs() - 1.0 };
        return Vec2::new(x, y);
    }
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
    let local =
        texfold_lightfield_local(view.params.directions, direction, texfold_lightfield_normal(view, vertex));
    let disc = texfold_lightfield_disc(view.params.directions, local);
    let grid = view.params.grid;
    let at = (disc * 0.5 + 0.5) * (grid - 1) as f32;
    let low = at.max(Vec2::ZERO).as_uvec2().min(UVec2::splat(grid - 2));
    TexfoldLightfieldTap { low, weight: at - low.as_vec2() }
}

/// What is read of patches of `side` steps at weights `barycentric` of the triangle's corners.
#[must_use]
pub fn texfold_lightfield_patch(side: u32, barycentric: Vec3) -> TexfoldLightfieldPatch {
    let at = Vec2::new(barycentric.y, barycentric.z).clamp(Vec2::ZERO, Vec2::ONE) * side as f32;
    let x = (at.x as u32).min(side - 1);
    let y = (at.y as u32).min(side - 1 - x);
    let part = (at - UVec2::new(x, y).as_vec2()).clamp(Vec2::ZERO, Vec2::ONE);
    let (a, weights) = if part.x + part.y > 1.0 && x + y + 2 <= side {
        (UVec2::new(x + 1, y + 1), Vec3::new(part.x + part.y - 1.0, 1.0 - part.y, 1.0 - part.x))
    } else {
        (UVec2::new(x, y), Vec3::new(1.0 - part.x - part.y, part.x, part.y))
    };
    TexfoldLightfieldPatch { a, b: UVec2::new(x + 1, y), c: UVec2::new(x, y + 1), side, weights }
}

/// Column and row of texel `at` of the patch `place`.
#[must_use]
pub fn texfold_lightfield_texel(place: u32, side: u32, at: UVec2) -> UVec2 {
    let corner = UVec2::new(place & 0x3fff, (place >> 14) & 0x3fff);
    if place >> 31 == 1 {
        return corner + UVec2::new(side, side + 1) - at;
    }
    corner + at
}

/// A value of a map from a stored one, 0 to 1.
#[must_use]
pub fn texfold_lightfield_value(view: &LightfieldView<'_>, stored: Vec3) -> Vec3 {
    (stored * 255.0 - view.params.map_zero) / view.params.map_range
}

/// A texel of the mean.
#[must_use]
pub fn texfold_lightfield_mean_load(view: &LightfieldView<'_>, at: UVec2) -> Vec3 {
    view.mean[(at.y * view.mean_width + at.x) as usize].truncate()
}

/// A texel of the surface maps, as stored.
#[must_use]
pub fn texfold_lightfield_surface_load(view: &LightfieldView<'_>, at: UVec2) -> Vec3 {
    view.surface[(at.y * view.surface_width + at.x) as usize].truncate()
}

/// A texel of the view maps, as stored.
#[must_use]
pub fn texfold_lightfield_view_load(view: &LightfieldView<'_>, at: UVec2) -> Vec3 {
    view.view[(at.y * view.view_width + at.x) as usize].truncate()
}

/// The mean of the patch `place`.
#[must_use]
pub fn texfold_lightfield_mean(view: &LightfieldView<'_>, read: TexfoldLightfieldPatch, place: u32) -> Vec3 {
    texfold_lightfield_mean_load(view, texfold_lightfield_texel(place, read.side, read.a)) * read.weights.x
        + texfold_lightfield_mean_load(view, texfold_lightfield_texel(place, read.side, read.b))
            * read.weights.y
        + texfold_lightfield_mean_load(view, texfold_lightfield_texel(place, read.side, read.c))
            * read.weights.z
}

/// The surface map of the patch `place`.
#[must_use]
pub fn texfold_lightfield_surface(
    view: &LightfieldView<'_>,
    read: TexfoldLightfieldPatch,
    place: u32,
) -> Vec3 {
    let a = texfold_lightfield_surface_load(view, texfold_lightfield_texel(place, read.side, read.a));
    let b = texfold_lightfield_surface_load(view, texfold_lightfield_texel(place, read.side, read.b));
    let c = texfold_lightfield_surface_load(view, texfold_lightfield_texel(place, read.side, read.c));
    texfold_lightfield_value(view, a * read.weights.x + b * read.weights.y + c * read.weights.z)
}

/// The view map that lies at `place`.
#[must_use]
pub fn texfold_lightfield_view(view: &LightfieldView<'_>, tap: TexfoldLightfieldTap, place: u32) -> Vec3 {
    let low = tap.low + UVec2::new(place & 0x3fff, place >> 14);
    let load = |x, y| texfold_lightfield_view_load(view, low + UVec2::new(x, y));
    let mix = |a: Vec3, b: Vec3, weight: f32| a * (1.0 - weight) + b * weight;
    let upper = mix(load(0, 0), load(1, 0), tap.weight.x);
    let lower = mix(load(0, 1), load(1, 1), tap.weight.x);
    texfold_lightfield_value(view, mix(upper, lower, tap.weight.y))
}

/// All terms of one corner of the triangle whose words begin at `first`.
#[must_use]
pub fn texfold_lightfield_corner(
    view: &LightfieldView<'_>,
    read: TexfoldLightfieldPatch,
    first: u32,
    corner: u32,
    direction: Vec3,
) -> Vec3 {
    let vertex = texfold_lightfield_word(view, first + corner);
    let tap = texfold_lightfield_tap(view, vertex, direction);
    let own = texfold_lightfield_vertex(view, vertex) + 6;
    let mut sum = Vec3::ZERO;
    for term in 0..view.params.terms.min(TEXFOLD_LIGHTFIELD_TERMS) {
        let scales = texfold_lightfield_word(view, own + 2 * term);
        if scales == 0 {
            continue;
        }
        let surface = texfold_lightfield_surface(
            view,
            read,
            texfold_lightfield_word(view, first + 4 + 3 * term + corner),
        );
        let seen = texfold_lightfield_view(view, tap, texfold_lightfield_word(view, own + 2 * term + 1));
        sum += texfold_lightfield_scales(scales) * surface * seen;
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

/// The mean at a place on a triangle, given by weights of its corners, and what each of its vertices adds to it towards `direction`, a unit
/// vector to the eye.
#[must_use]
pub fn texfold_lightfield_parts(
    view: &LightfieldView<'_>,
    triangle: u32,
    barycentric: Vec3,
    direction: Vec3,
) -> (Vec3, [Vec3; 3]) {
    let first = texfold_lightfield_triangle(view, triangle);
    let [a, b, c] = [0, 1, 2].map(|corner| texfold_lightfield_word(view, first + corner));
    let place = texfold_lightfield_word(view, first + 3);
    let side = 1 << ((place >> 28) & 7);
    let read = texfold_lightfield_patch(side, barycentric);
    let coarse = texfold_lightfield_patch((side >> view.params.reduce_log2).max(1), barycentric);
    let smooth = texfold_lightfield_normal(view, a) * barycentric.x
        + texfold_lightfield_normal(view, b) * barycentric.y
        + texfold_lightfield_normal(view, c) * barycentric.z;
    // Normals may cancel out.
    let normal = smooth / smooth.length().max(0.000_001);
    let towards = texfold_lightfield_direction(view.params.directions, direction, normal);
    let corners = [0, 1, 2].map(|corner| texfold_lightfield_corner(view, coarse, first, corner, towards));
    (texfold_lightfield_mean(view, read, place), corners)
}

/// The colour of a place on a triangle, given by weights of its corners, towards `direction`, a unit vector to the eye.
#[must_use]
pub fn texfold_lightfield_sample(
    view: &LightfieldView<'_>,
    triangle: u32,
    barycentric: Vec3,
    direction: Vec3,
) -> Texel {
    let (mean, [a, b, c]) = texfold_lightfield_parts(view, triangle, barycentric, direction);
    (mean + a + b + c).clamp(Vec3::ZERO, Vec3::ONE).extend(1.0)
}

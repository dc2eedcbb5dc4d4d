// Surface light-field maps: a mesh whose colour depends on place and direction, as a mean and a sum of products of
// surface maps and view maps around each vertex. CPU twins: crates/lightfield/src/decode.rs.
//
// Colours are as stored: no gamma conversion (see texfold_linear). Every function works in any control flow.

struct TexfoldLightfieldParams {
    // Vertices and triangles of the mesh.
    vertices: u32,
    triangles: u32,
    // Terms that are drawn, at most those that are stored.
    terms: u32,
    stored_terms: u32,
    // TEXFOLD_LIGHTFIELD_VIEW or TEXFOLD_LIGHTFIELD_REFLECTED.
    directions: u32,
    // Texels a side of a view map.
    grid: u32,
    // How texels are read from the planes of the mean and of the maps.
    mean_swizzle: u32,
    map_swizzle: u32,
    // The byte of a map that stands for 0, and bytes from there to the one that stands for 1.
    map_zero: f32,
    map_range: f32,
    // How often the sides of surface maps are halved beside those of the mean.
    reduce_log2: u32,
    reserved: u32,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_lightfield_params: TexfoldLightfieldParams;
// For each vertex place, normal and for each term scales and the place of the view map; then for each triangle its vertices, its
// patch of the mean and for each term those of its corners.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_lightfield_mesh: texture_2d<u32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_lightfield_mean_a: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_lightfield_mean_b: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_4) var texfold_lightfield_surface_a: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_5) var texfold_lightfield_surface_b: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_6) var texfold_lightfield_view_a: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_7) var texfold_lightfield_view_b: texture_2d<f32>;

// View maps lie over the direction to the eye.
const TEXFOLD_LIGHTFIELD_VIEW: u32 = 0u;
// View maps lie over that direction reflected about the normal.
const TEXFOLD_LIGHTFIELD_REFLECTED: u32 = 1u;
// View maps lie over the reflected direction in space.
const TEXFOLD_LIGHTFIELD_WORLD: u32 = 2u;
// Most terms.
const TEXFOLD_LIGHTFIELD_TERMS: u32 = 8u;
// Words in a row of the mesh's texture.
const TEXFOLD_LIGHTFIELD_ROW: u32 = 1024u;

// Three texels of any patch of one side, in steps from its first corner, and how much each counts.
struct TexfoldLightfieldPatch {
    a: vec2<u32>,
    b: vec2<u32>,
    c: vec2<u32>,
    side: u32,
    weights: vec3<f32>,
}

// The upper left of four texels of any view map, and the weight of those right and below.
struct TexfoldLightfieldTap {
    low: vec2<u32>,
    weight: vec2<f32>,
}

// Word `index` of the mesh.
fn texfold_lightfield_word(index: u32) -> u32 {
    let at = vec2<u32>(index % TEXFOLD_LIGHTFIELD_ROW, index / TEXFOLD_LIGHTFIELD_ROW);
    return textureLoad(texfold_lightfield_mesh, at, 0u).x;
}

// Three words from `index` on as numbers.
fn texfold_lightfield_vector(index: u32) -> vec3<f32> {
    let x = bitcast<f32>(texfold_lightfield_word(index));
    let y = bitcast<f32>(texfold_lightfield_word(index + 1u));
    let z = bitcast<f32>(texfold_lightfield_word(index + 2u));
    return vec3<f32>(x, y, z);
}

// The first word of a vertex.
fn texfold_lightfield_vertex(vertex: u32) -> u32 {
    return vertex * (6u + 2u * texfold_lightfield_params.stored_terms);
}

// The first word of a triangle.
fn texfold_lightfield_triangle(triangle: u32) -> u32 {
    let words = 4u + 3u * texfold_lightfield_params.stored_terms;
    return texfold_lightfield_vertex(texfold_lightfield_params.vertices) + triangle * words;
}

// Where a vertex is.
fn texfold_lightfield_position(vertex: u32) -> vec3<f32> {
    return texfold_lightfield_vector(texfold_lightfield_vertex(vertex));
}

// The smooth unit normal of a vertex.
fn texfold_lightfield_normal(vertex: u32) -> vec3<f32> {
    return texfold_lightfield_vector(texfold_lightfield_vertex(vertex) + 3u);
}

// The number that a byte of scales stands for: 0, or 2^((byte - 1) / 8 - 26).
fn texfold_lightfield_scale(byte: u32) -> f32 {
    if byte == 0u {
        return 0.0;
    }
    let step = byte - 1u;
    return exp2(f32(step & 7u) * 0.125) * bitcast<f32>((101u + (step >> 3u)) << 23u);
}

// How strongly a term counts in red, green and blue, from its word.
fn texfold_lightfield_scales(word: u32) -> vec3<f32> {
    return vec3<f32>(
        texfold_lightfield_scale(word & 0xffu),
        texfold_lightfield_scale((word >> 8u) & 0xffu),
        texfold_lightfield_scale((word >> 16u) & 0xffu),
    );
}

// `direction` in the frame whose third axis is `normal` (Duff et al. 2017); in space the direction itself.
fn texfold_lightfield_local(direction: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    if texfold_lightfield_params.directions == TEXFOLD_LIGHTFIELD_WORLD {
        return direction;
    }
    let side = select(-1.0, 1.0, normal.z >= 0.0);
    let a = -1.0 / (side + normal.z);
    let b = normal.x * normal.y * a;
    let x = vec3<f32>(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    let y = vec3<f32>(b, side + normal.y * normal.y * a, -normal.y);
    return vec3<f32>(dot(direction, x), dot(direction, y), dot(direction, normal));
}

// The place of a direction on the square around the unit disc. A local direction lies on the disc: the hemisphere around the normal,
// the rest on the rim; one in space on the octahedron, its lower half turned out (Meyer et al. 2010).
fn texfold_lightfield_disc(local: vec3<f32>) -> vec2<f32> {
    if texfold_lightfield_params.directions == TEXFOLD_LIGHTFIELD_WORLD {
        let at = local.xy / max(abs(local.x) + abs(local.y) + abs(local.z), 0.000001);
        if local.z >= 0.0 {
            return at;
        }
        return (1.0 - abs(at.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), at >= vec2<f32>(0.0));
    }
    var scale = 1.0;
    if texfold_lightfield_params.directions == TEXFOLD_LIGHTFIELD_REFLECTED {
        scale = inverseSqrt(max(1.0 + local.z, 0.001));
    }
    let at = local.xy * scale;
    let radius = length(at);
    if local.z < 0.0 || radius > 1.0 {
        return at / max(radius, 0.000001);
    }
    return at;
}

// What is read of the view maps of `vertex` towards `direction`, a unit vector to the eye or its reflection.
fn texfold_lightfield_tap(vertex: u32, direction: vec3<f32>) -> TexfoldLightfieldTap {
    let disc = texfold_lightfield_disc(texfold_lightfield_local(direction, texfold_lightfield_normal(vertex)));
    let grid = texfold_lightfield_params.grid;
    let at = (disc * 0.5 + 0.5) * f32(grid - 1u);
    let low = min(vec2<u32>(max(at, vec2<f32>(0.0))), vec2<u32>(grid - 2u));
    return TexfoldLightfieldTap(low, at - vec2<f32>(low));
}

// What is read of patches of `side` steps at weights `barycentric` of the triangle's corners.
fn texfold_lightfield_patch(side: u32, barycentric: vec3<f32>) -> TexfoldLightfieldPatch {
    let at = clamp(barycentric.yz, vec2<f32>(0.0), vec2<f32>(1.0)) * f32(side);
    let x = min(u32(at.x), side - 1u);
    let y = min(u32(at.y), side - 1u - x);
    let part = clamp(at - vec2<f32>(vec2<u32>(x, y)), vec2<f32>(0.0), vec2<f32>(1.0));
    let upper = part.x + part.y > 1.0 && x + y + 2u <= side;
    var a = vec2<u32>(x, y);
    var weights = vec3<f32>(1.0 - part.x - part.y, part.x, part.y);
    if upper {
        a = vec2<u32>(x + 1u, y + 1u);
        weights = vec3<f32>(part.x + part.y - 1.0, 1.0 - part.y, 1.0 - part.x);
    }
    return TexfoldLightfieldPatch(a, vec2<u32>(x + 1u, y), vec2<u32>(x, y + 1u), side, weights);
}

// Column and row of texel `at` of the patch `place`.
fn texfold_lightfield_texel(place: u32, side: u32, at: vec2<u32>) -> vec2<u32> {
    let corner = vec2<u32>(place & 0x3fffu, (place >> 14u) & 0x3fffu);
    if (place >> 31u) == 1u {
        return corner + vec2<u32>(side, side + 1u) - at;
    }
    return corner + at;
}

// A value of a map from a stored one, 0 to 1.
fn texfold_lightfield_value(stored: vec3<f32>) -> vec3<f32> {
    return (stored * 255.0 - texfold_lightfield_params.map_zero) / texfold_lightfield_params.map_range;
}

// A texel of the mean.
fn texfold_lightfield_mean_load(at: vec2<u32>) -> vec3<f32> {
    let a = textureLoad(texfold_lightfield_mean_a, at, 0u);
    let b = textureLoad(texfold_lightfield_mean_b, at, 0u);
    return texfold_swizzle(a, b, texfold_lightfield_params.mean_swizzle).xyz;
}

// A texel of the surface maps, as stored.
fn texfold_lightfield_surface_load(at: vec2<u32>) -> vec3<f32> {
    let a = textureLoad(texfold_lightfield_surface_a, at, 0u);
    let b = textureLoad(texfold_lightfield_surface_b, at, 0u);
    return texfold_swizzle(a, b, texfold_lightfield_params.map_swizzle).xyz;
}

// A texel of the view maps, as stored.
fn texfold_lightfield_view_load(at: vec2<u32>) -> vec3<f32> {
    let a = textureLoad(texfold_lightfield_view_a, at, 0u);
    let b = textureLoad(texfold_lightfield_view_b, at, 0u);
    return texfold_swizzle(a, b, texfold_lightfield_params.map_swizzle).xyz;
}

// The mean of the patch `place`.
fn texfold_lightfield_mean(read: TexfoldLightfieldPatch, place: u32) -> vec3<f32> {
    return texfold_lightfield_mean_load(texfold_lightfield_texel(place, read.side, read.a)) * read.weights.x
        + texfold_lightfield_mean_load(texfold_lightfield_texel(place, read.side, read.b)) * read.weights.y
        + texfold_lightfield_mean_load(texfold_lightfield_texel(place, read.side, read.c)) * read.weights.z;
}

// The surface map of the patch `place`.
fn texfold_lightfield_surface(read: TexfoldLightfieldPatch, place: u32) -> vec3<f32> {
    let a = texfold_lightfield_surface_load(texfold_lightfield_texel(place, read.side, read.a));
    let b = texfold_lightfield_surface_load(texfold_lightfield_texel(place, read.side, read.b));
    let c = texfold_lightfield_surface_load(texfold_lightfield_texel(place, read.side, read.c));
    return texfold_lightfield_value(a * read.weights.x + b * read.weights.y + c * read.weights.z);
}

// The view map that lies at `place`.
fn texfold_lightfield_view(tap: TexfoldLightfieldTap, place: u32) -> vec3<f32> {
    let low = tap.low + vec2<u32>(place & 0x3fffu, place >> 14u);
    let upper = mix(
        texfold_lightfield_view_load(low),
        texfold_lightfield_view_load(low + vec2<u32>(1u, 0u)),
        tap.weight.x,
    );
    let lower = mix(
        texfold_lightfield_view_load(low + vec2<u32>(0u, 1u)),
        texfold_lightfield_view_load(low + vec2<u32>(1u, 1u)),
        tap.weight.x,
    );
    return texfold_lightfield_value(mix(upper, lower, tap.weight.y));
}

// All terms of one corner of the triangle whose words begin at `first`.
fn texfold_lightfield_corner(
    read: TexfoldLightfieldPatch,
    first: u32,
    corner: u32,
    direction: vec3<f32>,
) -> vec3<f32> {
    let vertex = texfold_lightfield_word(first + corner);
    let tap = texfold_lightfield_tap(vertex, direction);
    let own = texfold_lightfield_vertex(vertex) + 6u;
    var sum = vec3<f32>(0.0);
    for (var term = 0u; term < min(texfold_lightfield_params.terms, TEXFOLD_LIGHTFIELD_TERMS); term++) {
        let scales = texfold_lightfield_word(own + 2u * term);
        if scales == 0u {
            continue;
        }
        let image = texfold_lightfield_surface(read, texfold_lightfield_word(first + 4u + 3u * term + corner));
        let seen = texfold_lightfield_view(tap, texfold_lightfield_word(own + 2u * term + 1u));
        sum += texfold_lightfield_scales(scales) * image * seen;
    }
    return sum;
}

// The direction that the view maps lie over, for a unit vector to the eye.
fn texfold_lightfield_direction(direction: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    if texfold_lightfield_params.directions == TEXFOLD_LIGHTFIELD_VIEW {
        return direction;
    }
    return 2.0 * dot(direction, normal) * normal - direction;
}

// The mean at a place on a triangle, given by weights of its corners, and what each of its vertices adds to it towards `direction`, a unit
// vector to the eye.
fn texfold_lightfield_parts(triangle: u32, barycentric: vec3<f32>, direction: vec3<f32>) -> array<vec3<f32>, 4> {
    let first = texfold_lightfield_triangle(triangle);
    let a = texfold_lightfield_word(first);
    let b = texfold_lightfield_word(first + 1u);
    let c = texfold_lightfield_word(first + 2u);
    let place = texfold_lightfield_word(first + 3u);
    let side = 1u << ((place >> 28u) & 7u);
    let read = texfold_lightfield_patch(side, barycentric);
    let coarse = texfold_lightfield_patch(max(side >> texfold_lightfield_params.reduce_log2, 1u), barycentric);
    let smooth_normal = texfold_lightfield_normal(a) * barycentric.x
        + texfold_lightfield_normal(b) * barycentric.y
        + texfold_lightfield_normal(c) * barycentric.z;
    // Normals may cancel out.
    let normal = smooth_normal / max(length(smooth_normal), 0.000001);
    let towards = texfold_lightfield_direction(direction, normal);
    return array<vec3<f32>, 4>(
        texfold_lightfield_mean(read, place),
        texfold_lightfield_corner(coarse, first, 0u, towards),
        texfold_lightfield_corner(coarse, first, 1u, towards),
        texfold_lightfield_corner(coarse, first, 2u, towards),
    );
}

// The colour of a place on a triangle, given by weights of its corners, towards `direction`, a unit vector to the eye.
fn texfold_lightfield_sample(triangle: u32, barycentric: vec3<f32>, direction: vec3<f32>) -> vec4<f32> {
    let parts = texfold_lightfield_parts(triangle, barycentric, direction);
    let colour = parts[0] + parts[1] + parts[2] + parts[3];
    return vec4<f32>(clamp(colour, vec3<f32>(0.0), vec3<f32>(1.0)), 1.0);
}

// Texels of a tile, and where they lie.

// The texel of a level of that size that one beside it repeats.
fn texfold_tile_address(place: vec2<i32>, size: vec2<u32>, flags: u32) -> vec2<u32> {
    let whole = vec2<i32>(size);
    if (flags & TEXFOLD_TILE_CLAMP) != 0u {
        return vec2<u32>(clamp(place, vec2<i32>(0), whole - vec2<i32>(1)));
    }
    return vec2<u32>((place % whole + whole) % whole);
}

// The texel of a level of that size that texel `at` of a tile repeats, border included.
fn texfold_tile_source(tile: vec2<u32>, size: vec2<u32>, flags: u32, at: vec2<u32>) -> vec2<u32> {
    let whole = vec2<i32>(size);
    let border = vec2<i32>(i32(TEXFOLD_TILE_BORDER));
    // Further behind the edge nothing is read.
    let place = min(vec2<i32>(tile * TEXFOLD_TILE_INNER + at) - border, whole + border - vec2<i32>(1));
    return texfold_tile_address(place, size, flags);
}

// Column and row of a place's first texel, and its first layer: of what pages hold.
fn texfold_tile_place(page: u32) -> vec3<u32> {
    let corner = vec2<u32>(page & 255u, (page >> 8u) & 255u) * TEXFOLD_TILE_SIDE;
    return vec3<u32>(corner, (page >> 16u) & 0x7fffu);
}

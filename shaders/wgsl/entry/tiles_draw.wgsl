// The update of a cache of tiles: tiles of one texture that is not in superblocks, texel by texel.

struct EntrySource {
    // Number of the pass, counted from 1.
    number: u32,
    // Place of the image in its binding.
    image: u32,
    reserved: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> entry_plan: TexfoldTilePlan;
@group(0) @binding(1) var<storage, read> texfold_tile_textures: array<TexfoldTileTexture>;
@group(0) @binding(2) var entry_pool: texture_storage_2d_array<rgba8unorm, write>;
@group(0) @binding(3) var<uniform> entry_source: EntrySource;

@compute @workgroup_size(8, 8)
fn draw_tiles(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.z >= entry_plan.count || entry_plan.requests[id.z].stage != (0x80000000u | entry_source.number) {
        return;
    }
    let request = entry_plan.requests[id.z];
    let flags = texfold_tile_flags(texfold_tile_textures[request.texture].shape);
    let size = texfold_tile_level_size(texfold_tile_textures[request.texture].size, request.level);
    let at = texfold_tile_source(request.tile, size, flags, id.xy);
    let target_texel = texfold_tile_place(request.place);
    let texel = entry_fetch(entry_source.image, vec2<i32>(at), request.level);
    textureStore(entry_pool, target_texel.xy + id.xy, target_texel.z, texel);
}

// Texels of 16 bits, whole.

@group(1) @binding(1) var entry_target: texture_storage_2d<rgba16uint, write>;

@compute @workgroup_size(8, 8)
fn write_texels(@builtin(global_invocation_id) id: vec3<u32>) {
    if all(id.xy < entry_output.size) {
        texfold_block_pass = entry_passes[0].plane;
        textureStore(entry_target, entry_output.place + id.xy, vec4<u32>(entry_texel(entry_output.origin + id.xy)));
    }
}

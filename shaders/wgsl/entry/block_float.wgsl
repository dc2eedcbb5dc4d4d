// Texels of 8 or 16 bits as numbers from 0 to 1, all of their bits kept.

@group(1) @binding(1) var entry_target: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn write_texels(@builtin(global_invocation_id) id: vec3<u32>) {
    if all(id.xy < entry_output.size) {
        texfold_block_pass = entry_passes[0].plane;
        let texel = vec4<f32>(entry_texel(entry_output.origin + id.xy)) / f32(entry_output.largest);
        textureStore(entry_target, entry_output.place + id.xy, texel);
    }
}

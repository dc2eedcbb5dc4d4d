// Texels of 8 bits, for a texture that the hardware samples.

@group(1) @binding(1) var entry_target: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn write_texels(@builtin(global_invocation_id) id: vec3<u32>) {
    if all(id.xy < entry_output.size) {
        texfold_block_pass = entry_passes[0].plane;
        // A division by 255 that is off by a rounding still stores the same byte.
        let texel = vec4<f32>(entry_texel(entry_output.origin + id.xy)) / 255.0;
        textureStore(entry_target, entry_output.place + id.xy, texel);
    }
}

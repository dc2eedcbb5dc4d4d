// A plain texture through the hardware sampler: what a renderer does without Texfold.

@group(0) @binding(0) var plain_texture: texture_2d<f32>;
@group(0) @binding(1) var plain_sampler: sampler;

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return textureSampleLevel(plain_texture, plain_sampler, view_uv(position.xy), view.lod);
}

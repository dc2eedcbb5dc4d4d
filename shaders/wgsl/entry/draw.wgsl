// Trilinear lookups: drawing a flat rectangle.

// Which lookup: fixed when the pipeline is made, so that a pipeline holds the code of one only. Software renderers run
// the loads of every branch.
override LOOKUP: u32 = 0u;

const LOOKUP_DERIVATIVE: u32 = 0u;

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let uv = view_uv(position.xy);
    if LOOKUP == LOOKUP_DERIVATIVE {
        return entry_sample(view.image, uv);
    }
    return entry_sample_level(view.image, uv, view.lod);
}

// Lookups within a given level: decoding on the GPU.

// Which lookup: fixed when the pipeline is made, so that a pipeline holds the code of one only. Software renderers run
// the loads of every branch.
override LOOKUP: u32 = 0u;

const LOOKUP_FETCH: u32 = 0u;
const LOOKUP_NEAREST: u32 = 1u;
const LOOKUP_BILINEAR: u32 = 2u;

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let uv = view_uv(position.xy);
    switch LOOKUP {
        case LOOKUP_FETCH: {
            return entry_fetch(view.image, vec2<i32>(floor(position.xy + view.offset)), view.level);
        }
        case LOOKUP_NEAREST: { return entry_nearest(view.image, uv, view.level); }
        case LOOKUP_BILINEAR: { return entry_bilinear(view.image, uv, view.level); }
        default: { return texfold_linear(entry_nearest(view.image, uv, view.level)); }
    }
}

// The loads of a lookup without its arithmetic: what a lookup costs at least. Not an image to look at: edges,
// weights and further mip levels are left out.

// The number of texels, 1, 4 or 8: fixed when the pipeline is made, so that a pipeline holds the code of one only.
// Software renderers run the loads of every branch.
override LOOKUP: u32 = 1u;

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = vec2<u32>(view_uv(position.xy) * entry_size());
    switch LOOKUP {
        case 1u: { return entry_loads(at); }
        case 4u: { return entry_loads_four(at); }
        default: { return entry_loads_four(at) + entry_loads_four(at >> vec2<u32>(1u)); }
    }
}

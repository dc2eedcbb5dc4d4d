// Texels that are blended.
const TEXFOLD_EPITOME_TAPS: u32 = 4u;

// Four texels around `place` (in texels of level 0) of level `level` of an epitome, blended. The last epitome is residual
// content, which residual.wgsl reads.
fn texfold_epitome_read(plane: u32, place: vec2<f32>, level: u32) -> vec4<f32> {
    let mixed = texfold_epitome_params.mixed == 1u;
    let plain = mixed & (plane == 0u);
    let size = texfold_level_size(
        select(texfold_epitome_params.plane_b, texfold_epitome_params.plane_a, plain),
        level,
    );
    let at = place * (1.0 / f32(i32(1u << level))) - vec2<f32>(0.5);
    let corner = floor(at);
    let low = texfold_inside(vec2<i32>(corner), size);
    let high = texfold_inside(vec2<i32>(corner) + vec2<i32>(1), size);
    if plain {
        let blended = texfold_blend(texfold_epitome_plane_a, TexfoldTap(low, high, at - corner), level);
        return texfold_swizzle(blended, blended, texfold_epitome_params.swizzle);
    }
    // One after the other in a loop, as the code of a load is long: 32 of them, for a trilinear lookup between leaves, take
    // compilers minutes.
    var texels = array<vec4<f32>, 4>();
    for (var tap = 0u; tap < min(4u, TEXFOLD_EPITOME_TAPS); tap += 1u) {
        let corners = vec2<bool>((tap & 1u) == 1u, tap >= 2u);
        texels[tap] = texfold_residual_load(vec2<i32>(select(low, high, corners)), level);
    }
    return texfold_bilinear(texels, at - corner);
}

// Reading an epitome whose planes hold texels alone.

// Four texels around `place` (in texels of level 0) of level `level` of an epitome, blended.
fn texfold_epitome_read(plane: u32, place: vec2<f32>, level: u32) -> vec4<f32> {
    let second = (plane == 1u) & (texfold_epitome_params.mixed == 1u);
    let size = texfold_level_size(
        select(texfold_epitome_params.plane_a, texfold_epitome_params.plane_b, second),
        level,
    );
    let at = place * (1.0 / f32(i32(1u << level))) - vec2<f32>(0.5);
    let corner = floor(at);
    let low = texfold_inside(vec2<i32>(corner), size);
    let tap = TexfoldTap(low, texfold_inside(vec2<i32>(corner) + vec2<i32>(1), size), at - corner);
    // One of two epitomes is read, or both planes of one.
    var a = vec4<f32>(0.0);
    if !second {
        a = texfold_blend(texfold_epitome_plane_a, tap, level);
    }
    var b = a;
    if second | (texfold_epitome_params.swizzle == TEXFOLD_SPLIT) {
        b = texfold_blend(texfold_epitome_plane_b, tap, level);
    }
    return texfold_swizzle(select(a, b, second), b, texfold_epitome_params.swizzle);
}

// Four texels around `place` (in texels of level 0) of level `level` of an epitome, blended. The last epitome has an error
// map: module progressive reads it.
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
    let upper_right = vec2<u32>(high.x, low.y);
    let lower_left = vec2<u32>(low.x, high.y);
    if plain {
        let blended = texfold_bilinear(
            array<vec4<f32>, 4>(
                textureLoad(texfold_epitome_plane_a, low, level),
                textureLoad(texfold_epitome_plane_a, upper_right, level),
                textureLoad(texfold_epitome_plane_a, lower_left, level),
                textureLoad(texfold_epitome_plane_a, high, level),
            ),
            at - corner,
        );
        return texfold_swizzle(blended, blended, texfold_epitome_params.swizzle);
    }
    return texfold_bilinear(
        array<vec4<f32>, 4>(
            texfold_progressive_load(low, level),
            texfold_progressive_load(upper_right, level),
            texfold_progressive_load(lower_left, level),
            texfold_progressive_load(high, level),
        ),
        at - corner,
    );
}

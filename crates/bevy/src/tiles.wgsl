// Fragments of a `TileMaterial`; behind the functions of the cache of tiles.

#import bevy_pbr::{
    forward_io::VertexOutput,
    mesh_bindings::mesh,
    mesh_types::MESH_FLAGS_SHADOW_RECEIVER_BIT,
    mesh_view_bindings::view,
    pbr_functions,
    pbr_types,
}

// As `Uniform` of the material.
struct TexfoldMaterial {
    base_color: vec4<f32>,
    emissive: vec4<f32>,
    // Roughness and metalness without maps, the cutoff of alpha.
    factors: vec4<f32>,
    // Textures of the cache, or TEXFOLD_NO_MAP: colour, normals, occlusion with roughness and metalness, emitted light.
    maps: vec4<u32>,
    // Roughness, metalness, occlusion, opacity.
    further: vec4<u32>,
    // Flags of StandardMaterial; whether occlusion stands in red beside roughness and metalness; the material whose maps are looked up together, or
    // TEXFOLD_NO_MAP.
    flags: vec4<u32>,
}

@group(#{MATERIAL_BIND_GROUP}) @binding(6) var<uniform> texfold_material: TexfoldMaterial;

const TEXFOLD_NO_MAP: u32 = 0xffffffffu;

// A texel of a map, or what stands for it.
fn texfold_map(map: u32, uv: vec2<f32>, otherwise: vec4<f32>) -> vec4<f32> {
    if map == TEXFOLD_NO_MAP {
        return otherwise;
    }
    return texfold_tile_sample(map, uv);
}

// Maps at texture coordinates, with the material's factors for those that are missing; unlit ones have a color alone where maps are looked up one by
// one. Normals are from 0 to 1, as Bevy takes them.
fn texfold_maps(material: TexfoldMaterial, uv: vec2<f32>) -> TexfoldTileMaterial {
    let has_packed = material.maps.z != TEXFOLD_NO_MAP;
    var maps: TexfoldTileMaterial;
    if material.flags.z != TEXFOLD_NO_MAP {
        maps = texfold_tile_sample_material(material.flags.z, uv);
        maps.normal = maps.normal * 0.5 + 0.5;
        let has = material.further != vec4<u32>(TEXFOLD_NO_MAP);
        maps.roughness = select(material.factors.x, maps.roughness, has.x || has_packed);
        maps.metalness = select(material.factors.y, maps.metalness, has.y || has_packed);
        maps.occlusion = select(1.0, maps.occlusion, has.z || material.flags.y != 0u);
        maps.emissive = select(vec3<f32>(0.0), maps.emissive, material.maps.w != TEXFOLD_NO_MAP);
        return maps;
    }
    maps.color = texfold_map(material.maps.x, uv, vec4<f32>(1.0));
    maps.color.a *= texfold_map(material.further.w, uv, vec4<f32>(1.0)).x;
    if (material.flags.x & pbr_types::STANDARD_MATERIAL_FLAGS_UNLIT_BIT) != 0u {
        return maps;
    }
    let packed = texfold_map(material.maps.z, uv, vec4<f32>(1.0, material.factors.xy, 1.0));
    maps.roughness = texfold_map(material.further.x, uv, packed.yyyy).x;
    maps.metalness = texfold_map(material.further.y, uv, packed.zzzz).x;
    let beside = select(1.0, packed.x, material.flags.y != 0u);
    maps.occlusion = texfold_map(material.further.z, uv, vec4<f32>(beside)).x;
    maps.emissive = texfold_map(material.maps.w, uv, vec4<f32>(0.0)).rgb;
#ifdef VERTEX_TANGENTS
    maps.normal = texfold_map(material.maps.y, uv, vec4<f32>(0.5, 0.5, 1.0, 1.0)).xyz;
#endif
    return maps;
}

@fragment
fn fragment(in: VertexOutput, @builtin(front_facing) is_front: bool) -> @location(0) vec4<f32> {
    let material = texfold_material;
    var pbr = pbr_types::pbr_input_new();
    pbr.material.flags = material.flags.x;
    pbr.material.alpha_cutoff = material.factors.z;
#ifdef VERTEX_UVS_A
    let uv = in.uv;
#else
    let uv = vec2<f32>(0.0);
#endif
    let maps = texfold_maps(material, uv);
    pbr.material.base_color = pbr_functions::alpha_discard(pbr.material, maps.color * material.base_color);
    if (material.flags.x & pbr_types::STANDARD_MATERIAL_FLAGS_UNLIT_BIT) != 0u {
        return pbr_functions::main_pass_post_lighting_processing(pbr, pbr.material.base_color);
    }
    pbr.material.perceptual_roughness = maps.roughness;
    pbr.material.metallic = maps.metalness;
    pbr.diffuse_occlusion = vec3<f32>(maps.occlusion);
    pbr.specular_occlusion = maps.occlusion;
    pbr.material.emissive = vec4<f32>(maps.emissive * material.emissive.rgb, material.emissive.a);
    pbr.frag_coord = in.position;
    pbr.world_position = in.world_position;
    pbr.is_orthographic = view.clip_from_view[3].w == 1.0;
    pbr.V = pbr_functions::calculate_view(in.world_position, pbr.is_orthographic);
    pbr.world_normal = pbr_functions::prepare_world_normal(in.world_normal, false, is_front);
    pbr.N = normalize(pbr.world_normal);
#ifdef VERTEX_TANGENTS
    if material.maps.y != TEXFOLD_NO_MAP {
        let frame = pbr_functions::calculate_tbn_mikktspace(pbr.world_normal, in.world_tangent);
        pbr.N = pbr_functions::apply_normal_mapping(material.flags.x, frame, false, is_front, maps.normal);
    }
#endif
    pbr.flags = mesh[in.instance_index].flags;
    return pbr_functions::main_pass_post_lighting_processing(pbr, pbr_functions::apply_pbr_lighting(pbr));
}

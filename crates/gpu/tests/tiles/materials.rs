//! Materials in the cache of tiles.

use super::*;
use texfold::core::image::MapInfo;
use texfold_gpu::TileContents;

#[test]
fn maps_of_a_material_are_filtered_as_what_they_are() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(gpu, &options());
    let normals = image("normal_map").tagged(ColorSpace::Normal, Alpha::Opaque);
    let height = of_pixels(1, Depth::Sixteen).tagged(ColorSpace::Linear, Alpha::Opaque);
    let maps = vec![
        (MapKind::BaseColor, "color".to_owned(), of_pixels(3, Depth::Eight)),
        (MapKind::Normal, "normal".to_owned(), normals),
        (MapKind::Height, "height".to_owned(), height),
    ];
    let images = ImageSet::of_maps(maps).unwrap();
    let texture =
        texfold::Encode::new(&images).goal(Goal::Bpp(4.0)).effort(Effort::Fast).mips(true).run().unwrap();
    let look = TileLook { address: AddressMode::Repeat, srgb: true };
    let added = renderer.cache.add(renderer.gpu, texture.as_encoded(), look).unwrap();
    let mut rng = Rng::new(23);
    for (number, &added) in (0..).zip(&added) {
        let look = TileLook { srgb: number == 0, ..look };
        let reference = Reference::new(texture.as_encoded(), number, look);
        let levels = reference.levels.len() as u32;
        for _ in 0..3 {
            let view = random_view(&mut rng, reference.levels[0].0, levels, added);
            compare_view(&renderer, (texture.as_encoded(), &reference), &view, 2.0);
        }
    }
}

/// A material of all kinds of maps, or of some, all of that size.
fn material(kinds: &[MapKind], size: (u32, u32)) -> AnyImage {
    material_of(&kinds.iter().map(|&kind| (kind, 0)).collect::<Vec<_>>(), size)
}

/// Maps whose sides are so often halves of those of that size; the seeds differ, so that no map is mistaken for another.
fn material_of(kinds: &[(MapKind, u32)], size: (u32, u32)) -> AnyImage {
    let map = |(number, &(kind, halvings)): (usize, &(MapKind, u32))| {
        let (width, height) = (size.0 >> halvings, size.1 >> halvings);
        let channels = match kind {
            MapKind::BaseColor => 4,
            MapKind::Normal | MapKind::Emissive | MapKind::OcclusionRoughnessMetalness => 3,
            _ => 1,
        };
        let wave = |x: u32, y: u32, channel: usize| {
            let turn = (number + 2) as f32 * x as f32 / 37.0 + (channel as f32 + 1.0) * y as f32 / 23.0;
            0.5 + 0.4 * turn.sin()
        };
        let texels: Vec<Texel> = (0..width * height)
            .map(|place| Vec4::from_array([0, 1, 2, 3].map(|c| wave(place % width, place / width, c))))
            .collect();
        let info = PixelInfo {
            channels,
            depth: Depth::Eight,
            color: kind.color_space(),
            alpha: if channels == 4 { Alpha::Straight } else { Alpha::Opaque },
        };
        (kind, format!("{number}"), Raster::from_texels(width, height, info, &texels).unwrap())
    };
    let images = ImageSet::of_maps(kinds.iter().enumerate().map(map).collect()).unwrap();
    texfold::Encode::new(&images).goal(Goal::Bpp(8.0)).effort(Effort::Fast).mips(true).run().unwrap()
}

const MAPS: &str = "
@fragment
fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    // The four rows of a block of pixels show the maps at one place.
    let block = floor(at.xy / 4.0) * 4.0 + 2.0;
    let uv = view.origin + view.across * block.x + view.down * block.y;
    var maps = texfold_tile_sample_material_grad(view.texture, uv, view.across, view.down);
    if view.lod >= 0.0 {
        maps = texfold_tile_sample_material_level(view.texture, uv, view.lod);
    }
    switch u32(at.y) % 4u {
        case 0u: { return maps.color; }
        case 1u: { return vec4<f32>(maps.normal * 0.5 + 0.5, maps.height); }
        case 2u: { return vec4<f32>(maps.occlusion, maps.roughness, maps.metalness, 1.0); }
        default: { return vec4<f32>(maps.emissive, 1.0); }
    }
}
";

/// The maps of a material as the CPU filters them, in the rows of `MAPS`.
fn expected_maps(references: &[(MapKind, Reference)], uv: DVec2, view: &View) -> [DVec4; 4] {
    let mut rows = [DVec4::ONE, DVec4::new(0.5, 0.5, 1.0, 1.0), DVec4::ONE, DVec4::ONE];
    let whole = |kind: &MapKind| {
        matches!(
            kind,
            MapKind::BaseColor | MapKind::Normal | MapKind::OcclusionRoughnessMetalness | MapKind::Emissive
        )
    };
    let (first, behind): (Vec<_>, Vec<_>) = references.iter().partition(|(kind, _)| whole(kind));
    for (kind, reference) in first.into_iter().chain(behind) {
        let value = reference.trilinear(uv, view);
        match kind {
            MapKind::BaseColor => rows[0] = value,
            MapKind::Opacity => rows[0].w = value.x,
            MapKind::Normal => rows[1] = value.truncate().extend(rows[1].w),
            MapKind::Height => rows[1].w = value.x,
            MapKind::OcclusionRoughnessMetalness => rows[2] = value,
            MapKind::Occlusion => rows[2].x = value.x,
            MapKind::Roughness => rows[2].y = value.x,
            MapKind::Metalness => rows[2].z = value.x,
            MapKind::Emissive => rows[3] = value,
            // No material of the test has others.
            _ => {}
        }
    }
    rows
}

#[test]
fn all_maps_of_a_material_come_from_one_lookup() {
    use MapKind::{
        BaseColor, Emissive, Height, Metalness, Normal, Occlusion, OcclusionRoughnessMetalness, Opacity,
        Roughness,
    };
    let Some(gpu) = gpu() else { return };
    let materials: [(&[(MapKind, u32)], _); 9] = [
        (&[(BaseColor, 0), (Normal, 0), (OcclusionRoughnessMetalness, 0)], (300, 260)),
        (
            &[
                (Height, 0),
                (Roughness, 0),
                (Opacity, 0),
                (Emissive, 0),
                (Normal, 0),
                (Metalness, 0),
                (BaseColor, 0),
                (Occlusion, 0),
            ],
            (290, 400),
        ),
        (&[(Roughness, 0), (OcclusionRoughnessMetalness, 0), (Emissive, 0)], (131, 257)),
        (&[(Height, 0), (Occlusion, 0)], (200, 300)),
        (&[(Opacity, 0)], (20, 30)),
        // Of unlike size: the largest is neither the first nor the first of its layer.
        (&[(Emissive, 2), (Height, 3), (BaseColor, 1), (Normal, 0), (Roughness, 1)], (600, 520)),
        (&[(BaseColor, 3), (Opacity, 0), (OcclusionRoughnessMetalness, 2)], (264, 1032)),
        (&[(BaseColor, 0), (Normal, 1), (Metalness, 3)], (24, 32)),
        // Tile 31 ends where a superblock of the smaller map begins.
        (&[(Roughness, 0), (Height, 3)], (3968, 64)),
    ];
    let contents = TileContents::Materials { emissive: true };
    let options = TileOptions { contents, pool_bytes: 16 << 20, ..options() };
    let mut renderer = Renderer::of(gpu, &options, MAPS);
    let mut rng = Rng::new(31);
    for (number, (kinds, size)) in materials.into_iter().enumerate() {
        let texture = material_of(kinds, size);
        // Means of enlarged texels are often between two steps of 8 bits, one of which is up to 2.3/255 in linear light.
        let bound = if kinds.iter().any(|(_, halvings)| *halvings > 0) { 3.0 } else { 2.0 };
        let address = if number % 2 == 0 { AddressMode::Repeat } else { AddressMode::Clamp };
        let look = TileLook { address, srgb: number != 2 };
        let added = renderer.cache.add_material(gpu, texture.as_encoded(), look).unwrap();
        let reference = |(image, map): (u32, &MapInfo)| {
            let srgb = look.srgb && map.pixel.color == ColorSpace::Srgb;
            let (look, halvings) = (TileLook { srgb, ..look }, kinds[image as usize].1);
            (map.kind, Reference::halved(texture.as_encoded(), image, look, halvings))
        };
        let references: Vec<_> = (0..).zip(&texture.as_encoded().layout().maps).map(reference).collect();
        let (size, levels) = (references[0].1.levels[0].0, references[0].1.levels.len() as u32);
        let quarter = 0.25 / DVec2::new(f64::from(size.width), f64::from(size.height));
        let origin = 4.0 * quarter * DVec2::new((f64::from(size.width) - 136.0).max(0.0) + 0.4, 5.4);
        let (across, down) = (DVec2::new(quarter.x, 0.0), DVec2::new(0.0, quarter.y));
        let close = View { origin, across, down, texture: added.index(), lod: 0.0 };
        for number in 0..5 {
            let random = random_view(&mut rng, size, levels, added);
            let view = if number == 0 { close } else { random }.rounded();
            let drawn = renderer.settled(&view);
            for (place, drawn) in (0..).zip(&drawn) {
                let at = DVec2::new(f64::from(place % VIEW), f64::from(place / VIEW));
                let block = (at / 4.0).floor() * 4.0 + 2.0;
                let uv = view.origin + view.across * block.x + view.down * block.y;
                let row = place / VIEW % 4;
                let expected = expected_maps(&references, uv, &view)[row as usize];
                let difference = (drawn.as_dvec4() - expected).abs().max_element();
                assert!(difference < bound / 255.0, "{kinds:?}, row {row}: {drawn} for {expected}, {view:?}");
            }
        }
    }
}

#[test]
fn textures_and_materials_share_a_cache_and_replace_one_another() {
    let Some(gpu) = gpu() else { return };
    let contents = TileContents::Materials { emissive: false };
    let options = TileOptions { contents, ..options() };
    let mut renderer = Renderer::new(gpu, &options);
    let look = TileLook { address: AddressMode::Repeat, srgb: false };
    let mut rng = Rng::new(41);
    let texture = encode("dct", crop(&image("facade"), (3, 5), (251, 247)), true);
    let held = hold(&mut renderer, &texture, look, (2, 2.0), &mut rng);
    // Its colour is what plain lookups give.
    let first = material(&[MapKind::BaseColor], (140, 150));
    let added = renderer.cache.add_material(gpu, first.as_encoded(), look).unwrap();
    compare(&renderer, &first, (added, look), (2, 2.0), &mut rng);
    // Its base colour is not the first of its images.
    let second = material(&[MapKind::Height, MapKind::BaseColor, MapKind::Occlusion], (200, 90));
    renderer.cache.replace(gpu, &[added], second.as_encoded()).unwrap();
    let reference = Reference::new(second.as_encoded(), 1, look);
    let (size, levels) = (reference.levels[0].0, reference.levels.len() as u32);
    for _ in 0..2 {
        let view = random_view(&mut rng, size, levels, added);
        compare_view(&renderer, (second.as_encoded(), &reference), &view, 2.0);
    }
    renderer.cache.remove(gpu, held);
    assert_eq!(renderer.cache.add_material(gpu, first.as_encoded(), look).unwrap(), held);
    compare(&renderer, &first, (held, look), (2, 2.0), &mut rng);
}

#[test]
fn a_material_takes_the_bytes_of_its_share() {
    let Some(gpu) = gpu() else { return };
    let texture = material_of(&[(MapKind::Roughness, 1), (MapKind::BaseColor, 0)], (256, 248));
    let contents = TileContents::Materials { emissive: false };
    let share = TileBytes::of_material(texture.as_encoded(), contents).unwrap();
    // Nine tiles, four and one, and the tails that share a tile, each of three layers.
    assert_eq!(share.decoded, 3 * (9 + 4 + 1 + 1) * 4 * 128 * 128);
    let constants = 4 * u64::from(texfold_shaders::DCT_TABLES);
    for (missing, fits) in [(0, true), (4, false)] {
        let stream_bytes = constants + share.held - missing;
        let mut cache = TileCache::new(gpu, &TileOptions { contents, stream_bytes, ..options() }).unwrap();
        let added = cache.add_material(gpu, texture.as_encoded(), TileLook::default());
        assert_eq!(added.is_ok(), fits, "{missing}");
    }
    let none = encode("dct", crop(&image("facade"), (0, 0), (40, 40)), true);
    assert!(TileBytes::of_material(none.as_encoded(), contents).is_err());
}

#[test]
fn maps_that_cannot_share_tiles_are_refused() {
    use MapKind::{BaseColor, Emissive, Normal, Other};
    let Some(gpu) = gpu() else { return };
    let textures = options();
    let contents = TileContents::Materials { emissive: false };
    let refused = |options: &TileOptions, texture: &AnyImage| {
        let mut cache = TileCache::new(gpu, options).unwrap();
        cache.add_material(gpu, texture.as_encoded(), TileLook::default()).unwrap_err().to_string()
    };
    let has = |found: String, expected: &str| assert!(found.contains(expected), "{found}");
    let of_size = |side: u32| crop(&image("facade"), (0, 0), (side, side));
    let unlike = vec![(BaseColor, "a".to_owned(), of_size(64)), (Normal, "b".to_owned(), of_size(31))];
    let unlike =
        texfold::Encode::new(&ImageSet::of_maps(unlike).unwrap()).effort(Effort::Fast).run().unwrap();
    let materials = TileOptions { contents, ..textures };
    has(refused(&materials, &unlike), "halves, quarters or eighths");
    has(refused(&materials, &material(&[BaseColor, Other], (40, 40))), "another kind");
    has(refused(&materials, &material(&[BaseColor, BaseColor], (40, 40))), "the same kind");
    has(refused(&materials, &material(&[BaseColor, Emissive], (40, 40))), "no layers");
    has(refused(&textures, &material(&[BaseColor, Normal], (40, 40))), "no layers");
    has(refused(&materials, &encode("dct", of_size(40), true)), "no maps");
    // All maps of a tile are decoded together.
    let scratch = TileOptions { scratch_bytes: 3 << 20, ..materials };
    let one = material(&[BaseColor], (300, 300));
    let mut cache = TileCache::new(gpu, &scratch).unwrap();
    cache.add_material(gpu, one.as_encoded(), TileLook::default()).unwrap();
    has(refused(&scratch, &material(&[BaseColor, Normal, MapKind::Height], (300, 300))), "scratch");
}

//! `decompress --to bc1 … rgba8`: KTX2 and DDS that readers of these formats take, with the texels of the decoded image.

use std::fs;

use texfold_bc::encode_plane;
use texfold_core::{Effort, PlaneFormat};

use crate::support::{Place, names};

/// RGB with opaque alpha.
fn with_alpha(rgb: &[u8]) -> Vec<u8> {
    rgb.chunks_exact(3).flat_map(|texel| [texel[0], texel[1], texel[2], 255]).collect()
}

/// Format, sides and levels of a KTX2 file, and its levels.
fn ktx2(place: &Place, name: &str) -> (ktx2::Format, (u32, u32), Vec<Vec<u8>>) {
    let reader = ktx2::Reader::new(fs::read(place.at(name)).unwrap()).unwrap();
    let header = reader.header();
    assert_eq!(reader.writer(), Some(concat!("Texfold ", env!("CARGO_PKG_VERSION"), "\0")));
    // The descriptor is that of the format.
    let format = header.format.unwrap();
    assert_eq!(reader.basic_dfd(), Some(&ktx2::dfd::Basic::from_format(format).unwrap().0));
    let levels = reader.levels().map(|level| level.data.to_vec()).collect();
    (format, (header.pixel_width, header.pixel_height), levels)
}

/// A place with the textures `color` (RGB with mip levels), `clear` (RGBA) and `gray`, and their decoded images in `png`.
fn place() -> Place {
    let place = Place::new();
    for (name, channels) in [("color", 3), ("clear", 4), ("gray", 1)] {
        place.image(&format!("{name}.png"), 60, 44, channels);
    }
    for options in ["color.png --mips", "clear.png", "gray.png"] {
        assert_eq!(place.run(&format!("compress {options} --codec dct --psnr 40 --out txf")).code, Some(0));
    }
    assert_eq!(place.run("decompress txf/color.txf txf/clear.txf txf/gray.txf --out png").code, Some(0));
    place
}

#[test]
fn plain_texels_are_those_of_the_decoded_image_at_every_level() {
    let place = place();
    let run = place.run("decompress txf/color.txf txf/clear.txf txf/gray.txf --to rgba8 --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let (format, size, levels) = ktx2(&place, "out/color.ktx2");
    assert_eq!((format, size, levels.len()), (ktx2::Format::R8G8B8A8_SRGB, (60, 44), 6));
    for (level, data) in levels.iter().enumerate() {
        let options = format!("decompress txf/color.txf --lod {level} --out level{level}");
        assert_eq!(place.run(&options).code, Some(0));
        let (.., wanted) = place.samples(&format!("level{level}/color.png"));
        let found = data.chunks_exact(4).zip(wanted.chunks_exact(3));
        assert_eq!(data.len() / 4, wanted.len() / 3);
        assert!(found.into_iter().all(|(found, wanted)| found[..3] == *wanted && found[3] == 255), "{level}");
    }
    let (.., wanted) = place.samples("png/clear.png");
    assert_eq!(ktx2(&place, "out/clear.ktx2").2, [wanted]);
    let (.., wanted) = place.samples("png/gray.png");
    let wanted: Vec<u8> = wanted.iter().flat_map(|&gray| [gray, gray, gray, 255]).collect();
    assert_eq!(ktx2(&place, "out/gray.ktx2").2, [wanted]);
}

#[test]
fn blocks_are_read_back_from_both_containers() {
    let place = place();
    for (to, name, blocks) in [("bc1", "color", 8), ("bc3", "clear", 16), ("bc7", "clear", 16)] {
        // What the codec of plain blocks makes of the same image.
        let options = format!("compress png/{name}.png --codec bc --content {to} --bpp 8 --out bc-{to}");
        assert_eq!(place.run(&options).code, Some(0));
        assert_eq!(place.run(&format!("decompress bc-{to}/{name}.txf --out bc-{to}")).code, Some(0));
        let (.., wanted) = place.samples(&format!("bc-{to}/{name}.png"));
        for container in ["ktx2", "dds"] {
            let out = format!("{to}-{container}");
            let options = format!("decompress txf/{name}.txf --to {to} --container {container} --out {out}");
            assert_eq!(place.run(&options).code, Some(0));
            let file = format!("{out}/{name}.{container}");
            let run =
                place.run(&format!("compress {file} --codec bc --content raw --bpp 64 --out again-{out}"));
            assert_eq!(run.code, Some(0), "{}", run.stderr);
            let texture = names(&place.at(&format!("again-{out}")));
            let texture = texture.iter().find(|name| name.ends_with("txf")).unwrap();
            place.run(&format!("decompress again-{out}/{texture} --out back-{out}"));
            let (.., found) = place.samples(&format!("back-{out}/{name}.png"));
            let difference = found.iter().zip(&wanted).filter(|(found, wanted)| found != wanted).count();
            assert_eq!((found.len(), difference), (wanted.len(), 0), "{out}");
        }
        let (_, _, levels) = ktx2(&place, &format!("{to}-ktx2/{name}.ktx2"));
        assert_eq!(levels[0].len(), 15 * 11 * blocks);
    }
}

#[test]
fn what_a_format_cannot_hold_is_refused_or_said() {
    let place = place();
    for to in ["bc4", "bc5"] {
        let run = place.run(&format!("decompress txf/color.txf --to {to} --out out"));
        assert_eq!(run.code, Some(1));
        assert!(run.stderr.contains("3 channels") && run.stderr.contains("--to bc7"), "{}", run.stderr);
    }
    assert!(names(&place.at("out")).is_empty());
    let run = place.run("decompress txf/clear.txf --to bc1 --out out");
    assert!(run.code == Some(0) && run.stderr.contains("alpha is left out"), "{}", run.stderr);
    // Where alpha is low the colours stay: the blocks are those of the opaque image.
    let (width, height, clear) = place.samples("png/clear.png");
    assert!(clear.chunks_exact(4).any(|texel| texel[3] < 128));
    let opaque: Vec<u8> = clear.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]).collect();
    let blocks = encode_plane(PlaneFormat::Bc1, width, height, &with_alpha(&opaque), Effort::Normal);
    assert_eq!(ktx2(&place, "out/clear.ktx2").2, [blocks]);
    assert_eq!(place.run("decompress txf/gray.txf --to bc4 --out out").code, Some(0));
    assert_eq!(ktx2(&place, "out/gray.ktx2").0, ktx2::Format::BC4_UNORM_BLOCK);
    let run = place.run("decompress txf/color.txf --to bc7 --container dds --region 1,2,30,20 --out part");
    assert!(run.code == Some(0) && run.stderr.contains("multiples of 4"), "{}", run.stderr);
    assert_eq!(names(&place.at("part")), ["color-1-2-30x20.dds"]);
    for options in ["--to bc7 --gpu", "--to bc7 --continuous", "--to png --container dds", "--container ktx2"]
    {
        assert_eq!(
            place.run(&format!("decompress txf/color.txf {options} --out out")).code,
            Some(2),
            "{options}"
        );
    }
    assert_eq!(place.run("bank add color.png --out bank").code, Some(0));
    let run = place.run("bank extract bank --to bc7 --out out");
    assert!(run.code == Some(2) && run.stderr.contains("windows of a bank"), "{}", run.stderr);
    assert_eq!(place.run("decompress txf/color.txf --to bc7 --out out").code, Some(0));
    assert_eq!(place.run("decompress txf/color.txf --to bc7 --out out").code, Some(1), "it is there");
}

#[test]
fn values_of_16_bits_are_held_and_levels_are_compressed_without_loss() {
    let place = place();
    let values: Vec<u16> = (0..60 * 44u32).map(|at| (at * 977 % 65_521) as u16).collect();
    let image: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_raw(60, 44, values).unwrap();
    image.save(place.at("deep.png")).unwrap();
    assert_eq!(place.run("compress deep.png --codec dct --psnr 50 --out txf").code, Some(0));
    assert_eq!(place.run("decompress txf/deep.txf --out png").code, Some(0));
    let wanted = image::open(place.at("png/deep.png")).unwrap().into_luma16().into_raw();
    let run = place.run("decompress txf/deep.txf --to rgba16 --out out");
    assert!(run.code == Some(0) && !run.stderr.contains("rounded"), "{}", run.stderr);
    let (format, size, levels) = ktx2(&place, "out/deep.ktx2");
    assert_eq!((format, size), (ktx2::Format::R16G16B16A16_UNORM, (60, 44)));
    let texel = |gray: &u16| [*gray, *gray, *gray, u16::MAX];
    let wanted: Vec<u8> = wanted.iter().flat_map(texel).flat_map(u16::to_le_bytes).collect();
    assert!(levels == [wanted]);
    let run = place.run("decompress txf/deep.txf --to rgba8 --out eight");
    assert!(run.stderr.contains("rounded to 8 bits; rgba16 holds them"), "{}", run.stderr);

    for to in ["rgba8", "bc7"] {
        assert_eq!(place.run(&format!("decompress txf/color.txf --to {to} --out {to}")).code, Some(0));
        let run = place.run(&format!("decompress txf/color.txf --to {to} --zstd --out {to}-zstd"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let plain = ktx2(&place, &format!("{to}/color.ktx2")).2;
        let reader =
            ktx2::Reader::new(fs::read(place.at(&format!("{to}-zstd/color.ktx2"))).unwrap()).unwrap();
        assert_eq!(reader.header().supercompression_scheme, Some(ktx2::SupercompressionScheme::Zstandard));
        let levels = reader.levels().map(|level| {
            let bytes = zstd::bulk::decompress(level.data, 1 << 20).unwrap();
            assert_eq!(bytes.len() as u64, level.uncompressed_byte_length);
            bytes
        });
        assert!(levels.collect::<Vec<_>>() == plain, "{to}");
        // It is read as any other.
        let run = place
            .run(&format!("compress {to}-zstd/color.ktx2 --codec bc --content raw --bpp 64 --out again"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
    for options in ["--to png --zstd", "--to bc7 --zstd --container dds", "--to astc6x6 --container dds"] {
        assert_eq!(
            place.run(&format!("decompress txf/color.txf {options} --out no")).code,
            Some(2),
            "{options}"
        );
    }
}

#[test]
fn astc_is_written_where_its_encoder_is_built_in() {
    let place = place();
    let run = place.run("decompress txf/clear.txf --to astc6x6 --out out");
    if cfg!(feature = "astc") {
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let (format, size, levels) = ktx2(&place, "out/clear.ktx2");
        assert_eq!((format, size), (ktx2::Format::ASTC_6x6_SRGB_BLOCK, (60, 44)));
        assert_eq!(levels[0].len(), 10 * 8 * 16);
        // At twice the bits it is closer than BC1.
        let (.., wanted) = place.samples("png/color.png");
        let [astc, bc1] = ["astc4x4", "bc1"].map(|to| {
            assert_eq!(place.run(&format!("decompress txf/color.txf --to {to} --out {to}")).code, Some(0));
            let options = format!("compress {to}/color.ktx2 --codec bc --content raw --bpp 64 --out {to}");
            assert_eq!(place.run(&options).code, Some(0));
            assert_eq!(place.run(&format!("decompress {to}/color.txf --out {to}")).code, Some(0));
            let (.., found) = place.samples(&format!("{to}/color.png"));
            assert_eq!(found.len(), wanted.len());
            found.iter().zip(&wanted).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2)).sum::<u64>()
        });
        assert!(astc < bc1 / 2, "{astc} {bc1}");
    } else {
        assert!(run.code == Some(1) && run.stderr.contains("--features astc"), "{}", run.stderr);
        assert!(names(&place.at("out")).is_empty());
    }
}

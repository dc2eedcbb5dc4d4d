//! Formats that are read, and hostile files.

use std::fs;

use crate::support::{Place, samples};

#[test]
fn formats_and_depths_keep_their_channels() {
    let place = Place::new();
    for (name, channels) in [("gray.png", 1), ("ga.png", 2), ("rgb.bmp", 3), ("rgb.tga", 3), ("rgba.tiff", 4)]
    {
        place.image(&format!("in/{name}"), 24, 20, channels);
    }
    place.image16("in/deep.png", 24, 20);
    for (name, channels) in [("gray", 1), ("ga", 2), ("rgb", 3), ("rgba", 4), ("deep", 3)] {
        let file = names_with_stem(&place, name);
        let (run, _) = place.compress(&format!("{file} --out out --codec bc --content raw --force"));
        assert_eq!(run.code, Some(0), "{name}: {}", run.stderr);
        assert_eq!(place.run(&format!("decompress out/{name}.txf --out png")).code, Some(0));
        let (width, height, decoded) = place.samples(&format!("png/{name}.png"));
        let mut wanted = samples(24, 20, channels);
        if name == "deep" {
            wanted = wanted.into_iter().flat_map(|byte| [byte, byte]).collect();
        }
        assert_eq!((width, height, decoded), (24, 20, wanted), "{name}");
    }
}

fn names_with_stem(place: &Place, stem: &str) -> String {
    let names = crate::support::names(&place.at("in"));
    format!("in/{}", names.iter().find(|name| name.starts_with(&format!("{stem}."))).unwrap())
}

/// A PNG that states a size and holds a few bytes.
fn png_of(width: u32, height: u32) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut body = kind.to_vec();
        body.extend(data);
        let mut chunk = (data.len() as u32).to_be_bytes().to_vec();
        chunk.extend(&body);
        chunk.extend(crc(&body).to_be_bytes());
        chunk
    };
    let mut header = width.to_be_bytes().to_vec();
    header.extend(height.to_be_bytes());
    header.extend([8, 6, 0, 0, 0]);
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    file.extend(chunk(b"IHDR", &header));
    file.extend(chunk(b"IDAT", &[0x78, 0x9c, 0x03, 0x00, 0x00, 0x00, 0x00, 0x01]));
    file.extend(chunk(b"IEND", &[]));
    file
}

fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 })
    })
}

#[test]
fn hostile_headers_cost_nothing_and_are_named() {
    let place = Place::new();
    fs::write(place.at("wide.png"), png_of(1_000_000, 1_000_000)).unwrap();
    fs::write(place.at("large.png"), png_of(32_768, 32_768)).unwrap();
    fs::write(place.at("zero.png"), png_of(0, 16)).unwrap();
    fs::write(place.at("short.png"), png_of(64, 64)).unwrap();
    place.image("cut.png", 64, 64, 3);
    let whole = fs::read(place.at("cut.png")).unwrap();
    fs::write(place.at("cut.png"), &whole[..whole.len() / 2]).unwrap();
    let (run, report) = place.compress("wide.png large.png zero.png short.png cut.png --out out --memory 1");
    assert_eq!((run.code, report.len()), (Some(1), 5));
    for row in &report {
        let (input, error) = (row["input"].as_str().unwrap(), row["error"].as_str().unwrap());
        assert!(error.starts_with(input) && !error.contains("internal"), "{error}");
    }
    assert!(report[0]["error"].as_str().unwrap().contains("32768"), "{report:?}");
    assert!(report[1]["error"].as_str().unwrap().contains("--memory"), "{report:?}");
    assert_eq!(crate::support::names(&place.at("out")), [] as [&str; 0]);
}

#[test]
fn what_cannot_be_made_of_a_file_is_said() {
    let place = Place::new();
    place.image("a.png", 16, 16, 3);
    for (arguments, what) in [
        ("a.png --codec zipmap", "is not a folder of photographs"),
        ("a.png --as zoom", "is not a folder of photographs"),
    ] {
        let (run, report) = place.compress(&format!("{arguments} --out out"));
        assert_eq!((run.code, report.len()), (Some(1), 1), "{arguments}");
        let error = report[0]["error"].as_str().unwrap();
        assert!(error.contains(what), "{error}");
    }
}

/// A BC1 image of 10x6 texels: 3x2 blocks.
fn blocks() -> Vec<u8> {
    (0..6u8).flat_map(|i| [i * 40, 0xf8 - i, i, 7, 0x1b, i * 3, 0xe4, 0x55 ^ i]).collect()
}

fn dds_of(blocks: &[u8], levels: u32) -> Vec<u8> {
    let header = dds::header::Header::new_image(10, 6, dds::Format::BC1_UNORM).with_mipmap_count(levels);
    let mut file = b"DDS ".to_vec();
    header.to_raw().write(&mut file).unwrap();
    file.extend(blocks);
    file
}

fn ktx2_of(blocks: &[u8]) -> Vec<u8> {
    let mut file = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    // Format BC1_RGB_UNORM, type size 1, 10x6, no depth, no layers, one face, one level, not supercompressed.
    for word in [131u32, 1, 10, 6, 0, 0, 1, 1, 0, 0, 0, 0, 0] {
        file.extend(word.to_le_bytes());
    }
    file.extend([0; 16]);
    for word in [104u64, blocks.len() as u64, blocks.len() as u64] {
        file.extend(word.to_le_bytes());
    }
    file.extend(blocks);
    file
}

#[test]
fn bc1_is_taken_over_block_for_block() {
    let place = Place::new();
    let mut with_levels = blocks();
    with_levels.extend([9; 16]);
    fs::write(place.at("a.dds"), dds_of(&blocks(), 1)).unwrap();
    fs::write(place.at("b.dds"), dds_of(&with_levels, 3)).unwrap();
    fs::write(place.at("c.ktx2"), ktx2_of(&blocks())).unwrap();
    let (run, report) = place.compress("a.dds b.dds c.ktx2 --out out");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for (name, row) in ["a", "b", "c"].into_iter().zip(&report) {
        assert_eq!((row["codec"].as_str(), row["width"].as_u64()), (Some("bc"), Some(10)));
        assert!(row["psnr"].as_f64().unwrap() > 138.0, "{row}");
        let file = fs::read(place.at(&format!("out/{name}.txf"))).unwrap();
        let image = texfold::open(&file).unwrap().into_image().unwrap();
        let form = image.as_encoded().gpu();
        assert_eq!(form.planes[0].data.as_ref(), blocks(), "{name}");
    }
    // The program's decoder and an independent one agree on the texels.
    place.run("decompress out/a.txf --out png");
    let mut decoder = dds::Decoder::new(fs::File::open(place.at("a.dds")).unwrap()).unwrap();
    let mut texels = vec![0u8; 10 * 6 * 4];
    let view = dds::ImageViewMut::new(&mut texels, dds::Size::new(10, 6), dds::ColorFormat::RGBA_U8).unwrap();
    decoder.read_surface(view).unwrap();
    let ours = image::open(place.at("png/a.png")).unwrap().to_rgba8();
    assert!(ours.as_raw().iter().zip(&texels).all(|(a, b)| a.abs_diff(*b) <= 1), "{ours:?} {texels:?}");
}

#[test]
fn bc1_is_encoded_again_where_another_form_is_requested() {
    let place = Place::new();
    fs::write(place.at("a.dds"), dds_of(&blocks(), 1)).unwrap();
    let (_, report) = place.compress("a.dds --out out --codec bc --content bc7");
    assert!(report[0]["settings"].as_str().unwrap().contains("bc7"), "{report:?}");
    assert!(report[0]["warnings"][0].as_str().unwrap().contains("encoded again"), "{report:?}");
    fs::write(place.at("short.dds"), &dds_of(&blocks(), 1)[..160]).unwrap();
    let header = dds::header::Header::new_image(10, 6, dds::Format::BC7_UNORM);
    let mut other = b"DDS ".to_vec();
    header.to_raw().write(&mut other).unwrap();
    fs::write(place.at("other.dds"), other).unwrap();
    fs::write(place.at("head.ktx2"), &ktx2_of(&blocks())[..40]).unwrap();
    let (run, report) = place.compress("short.dds other.dds head.ktx2 --out out");
    assert_eq!((run.code, report.len()), (Some(1), 3));
    for (row, hint) in report.iter().zip(["ends before its blocks", "ends before its blocks", "KTX2 header"])
    {
        assert!(row["error"].as_str().unwrap().contains(hint), "{row}");
    }
}

#[test]
fn a_fourth_band_of_a_tiff_is_alpha_only_by_its_tags() {
    use tiff::encoder::{TiffEncoder, colortype::RGBA8};
    use tiff::tags::Tag;
    let place = Place::new();
    let texels = samples(40, 30, 4);
    let metadata = r#"<GDALMetadata><Item name="COLORINTERP" sample="3" role="colorinterp">Undefined</Item>
        <Item name="DESCRIPTION" sample="3" role="description">nir</Item></GDALMetadata>"#;
    for (name, extra) in [("infrared", 0u16), ("alpha", 2), ("named", 2)] {
        let file = fs::File::create(place.at(&format!("{name}.tif"))).unwrap();
        let mut encoder = TiffEncoder::new(file).unwrap();
        let mut image = encoder.new_image::<RGBA8>(40, 30).unwrap();
        image.encoder().write_tag(Tag::ExtraSamples, &[extra][..]).unwrap();
        if name == "named" {
            image.encoder().write_tag(Tag::Unknown(42112), metadata).unwrap();
        }
        image.write_data(&texels).unwrap();
    }
    for command in ["compress", "bank add"] {
        let arguments = "infrared.tif alpha.tif named.tif --codec dct --psnr 26 --out";
        let out = if command == "compress" { "image" } else { "set" };
        assert_eq!(place.run(&format!("{command} {arguments} {out}")).code, Some(0));
    }
    let bands = [("infrared", "4 bands are"), ("alpha", ""), ("named", "4 bands (nir) are")];
    for (name, note) in bands {
        let run = place.run(&format!("info image/{name}.txf --json"));
        let info: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        assert_eq!(info["alpha"], if note.is_empty() { "straight" } else { "band" }, "{name}");
        // The file keeps what was noted.
        let remark = info["source"][0].as_str().unwrap_or_default();
        assert!(remark.starts_with(note) && remark.is_empty() == note.is_empty(), "{remark}");
    }
    assert_eq!(place.run("bank extract set --out tiff --to tiff").code, Some(0));
    assert_eq!(place.run("decompress image/named.txf --out named --to tiff").code, Some(0));
    let tag = |file: &str, tag: Tag| {
        let mut decoder = tiff::decoder::Decoder::new(fs::File::open(place.at(file)).unwrap()).unwrap();
        decoder.find_tag(tag).unwrap()
    };
    for (name, note) in bands {
        let kind = tag(&format!("tiff/{name}.tiff"), Tag::ExtraSamples).unwrap().into_u16_vec().unwrap();
        assert_eq!(kind, [if note.is_empty() { 2 } else { 0 }], "{name}");
    }
    let kept = tag("named/named.tiff", Tag::Unknown(42112)).unwrap().into_string().unwrap();
    assert_eq!(kept, metadata);
}

/// A JPEG of that size, left half bright, to be turned as this EXIF orientation asks for.
fn turned_jpeg(place: &Place, name: &str, (width, height): (u32, u32), orientation: u8) {
    let image =
        image::GrayImage::from_fn(width, height, |x, _| image::Luma([if x < width / 2 { 240 } else { 20 }]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
    // Big-endian TIFF with one directory of one entry: tag 0x0112, a short.
    let exif =
        [&b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation, 0, 0, 0, 0, 0, 0]]
            .concat();
    let mut bytes = bytes.into_inner();
    let segment = [&[0xff, 0xe1, 0, exif.len() as u8 + 2], &exif[..]].concat();
    bytes.splice(2..2, segment);
    fs::write(place.at(name), bytes).unwrap();
}

#[test]
fn images_stand_upright_as_their_exif_orientation_asks_for() {
    let place = Place::new();
    fs::create_dir_all(place.at("in")).unwrap();
    // Where the bright half lies: left, right, top, bottom.
    for (orientation, bright) in [(1, "left"), (3, "right"), (6, "top"), (8, "bottom")] {
        turned_jpeg(&place, "in/photo.jpg", (64, 32), orientation);
        for command in [
            "compress in/photo.jpg --codec bc --content raw --out out",
            "bank add in --codec dct --psnr 30 --effort fast --out bank",
        ] {
            let run = place.run(command);
            assert_eq!(run.code, Some(0), "{}", run.stderr);
        }
        assert_eq!(place.run("decompress out/photo.txf --out png --force").code, Some(0));
        assert_eq!(place.run("bank extract bank --out banked --force").code, Some(0));
        for shown in ["png/photo.png", "banked/photo.png"] {
            let (width, height, samples) = place.samples(shown);
            assert_eq!((width, height), if orientation > 4 { (32, 64) } else { (64, 32) }, "{shown}");
            let channels = samples.len() as u32 / (width * height);
            let at = |x: u32, y: u32| samples[(channels * (y * width + x)) as usize] > 128;
            let found =
                [at(2, height / 2), at(width - 3, height / 2), at(width / 2, 2), at(width / 2, height - 3)];
            let is_there = ["left", "right", "top", "bottom"].iter().zip(found);
            let alone = |side: &str| bright == side;
            let opposite = match bright {
                "left" => "right",
                "right" => "left",
                "top" => "bottom",
                _ => "top",
            };
            for (side, found) in is_there.filter(|(side, _)| alone(side) || **side == opposite) {
                assert_eq!(found, alone(side), "{shown}, orientation {orientation}: {side}");
            }
        }
        fs::remove_dir_all(place.at("bank")).unwrap();
    }
}

/// An allocation that fails ends the process, so what may not fit is refused before.
#[cfg(target_os = "linux")]
#[test]
fn no_address_space_ends_in_an_abort() {
    let place = Place::new();
    place.image("a.png", 1400, 1400, 3);
    let (mut refused, mut made) = (0, 0);
    // Beside what the threads of this machine reserve.
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    for codec in ["dct", "bc", "epitome"] {
        for kilobytes in [100_000, 200_000, 300_000 + 65_536 * (threads + 1)] {
            let command = format!(
                "ulimit -v {kilobytes}; exec {} compress a.png --codec {codec} --bpp 2 --effort fast --jobs 1 --out {codec}{kilobytes}",
                env!("CARGO_BIN_EXE_texfold")
            );
            let run = std::process::Command::new("sh")
                .args(["-c", &command])
                .current_dir(place.at(""))
                .output()
                .unwrap();
            let stderr = String::from_utf8_lossy(&run.stderr);
            let is_refusal = run.status.code() == Some(1) && stderr.contains("raise --memory");
            assert!(
                is_refusal || run.status.success(),
                "{codec} in {kilobytes} kB: {:?} {stderr}",
                run.status
            );
            refused += u32::from(is_refusal);
            made += u32::from(run.status.success());
        }
    }
    assert!(refused >= 5 && made >= 1, "{refused} refused, {made} made");
}

//! Outputs of `decompress` and `bank extract`: formats, depths, rectangles, names, and no overwriting without `--force`.

use std::fs;

use image::{DynamicImage, ExtendedColorType};

use crate::support::{Place, names, samples};

/// Values of 16 bits whose low bytes count.
fn deep(width: u32, height: u32, channels: u8) -> Vec<u16> {
    let value = |(at, byte): (usize, u8)| u16::from(byte) * 251 + (at * 37 % 97) as u16;
    samples(width, height, channels).into_iter().enumerate().map(value).collect()
}

fn save_deep(place: &Place, name: &str, width: u32, height: u32, channels: u8) {
    let color = match channels {
        1 => ExtendedColorType::L16,
        2 => ExtendedColorType::La16,
        3 => ExtendedColorType::Rgb16,
        _ => ExtendedColorType::Rgba16,
    };
    let bytes: Vec<u8> = deep(width, height, channels).into_iter().flat_map(u16::to_ne_bytes).collect();
    image::save_buffer(place.at(name), &bytes, width, height, color).unwrap();
}

/// Samples of an image; of a TIFF by its own decoder, as `image` reads none of gray and alpha.
fn opened(place: &Place, name: &str) -> (tiff::ColorType, Vec<u16>) {
    let path = place.at(name);
    if name.ends_with("png") {
        let image = image::open(path).unwrap();
        let (bits, channels) = (image.color().bits_per_pixel(), image.color().channel_count());
        let bytes = image.as_bytes();
        let samples = match bits / u16::from(channels) {
            8 => bytes.iter().map(|&byte| byte.into()).collect(),
            _ => bytes.chunks_exact(2).map(|pair| u16::from_ne_bytes([pair[0], pair[1]])).collect(),
        };
        return (color(channels, (bits / u16::from(channels)) as u8), samples);
    }
    let mut decoder = tiff::decoder::Decoder::new(fs::File::open(path).unwrap()).unwrap();
    let samples = match decoder.read_image().unwrap() {
        tiff::decoder::DecodingResult::U8(bytes) => bytes.into_iter().map(u16::from).collect(),
        tiff::decoder::DecodingResult::U16(values) => values,
        other => panic!("{other:?}"),
    };
    (decoder.colortype().unwrap(), samples)
}

fn color(channels: u8, bits: u8) -> tiff::ColorType {
    match channels {
        1 => tiff::ColorType::Gray(bits),
        2 => tiff::ColorType::Multiband { bit_depth: bits, num_samples: 2 },
        3 => tiff::ColorType::RGB(bits),
        _ => tiff::ColorType::RGBA(bits),
    }
}

/// Texels of a rectangle of an image.
fn cut(image: &DynamicImage, [x, y, width, height]: [u32; 4]) -> DynamicImage {
    image.crop_imm(x, y, width, height)
}

#[test]
fn textures_of_16_bits_are_written_with_16_bits() {
    let place = Place::new();
    for channels in 1..=4 {
        save_deep(&place, &format!("{channels}.png"), 40, 24, channels);
    }
    let run = place.run("compress 1.png 2.png 3.png 4.png --out out --codec dct --psnr 40 --effort fast");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for to in ["png", "tiff"] {
        let run =
            place.run(&format!("decompress out/1.txf out/2.txf out/3.txf out/4.txf --out {to} --to {to}"));
        assert!(run.code == Some(0) && run.stderr.is_empty(), "{}", run.stderr);
        for channels in 1..=4u8 {
            let (found, values) = opened(&place, &format!("{to}/{channels}.{to}"));
            assert_eq!(found, color(channels, 16));
            let file = fs::read(place.at(&format!("out/{channels}.txf"))).unwrap();
            let image = texfold::open(&file).unwrap().into_image().unwrap();
            let raster = texfold::core::metric::decode_image(image.as_encoded(), 0, 0).unwrap();
            let wanted = raster.values().map(|value| (value * 65535.0).clamp(0.0, 65535.0));
            assert!(
                values.iter().zip(wanted).all(|(&found, wanted)| (f32::from(found) - wanted).abs() < 0.51)
            );
            // Bytes are multiples of 257.
            let fine = values.iter().filter(|&value| value % 257 != 0).count();
            assert!(fine * 10 > values.len() * 9, "{to} {channels}: {fine}");
        }
    }
    let run = place.run("decompress out/3.txf --out webp --to webp");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.starts_with("warning: webp/3.webp: WebP keeps 8 of"), "{}", run.stderr);
    let webp = image::open(place.at("webp/3.webp")).unwrap();
    assert_eq!(webp.to_rgb8(), image::open(place.at("png/3.png")).unwrap().to_rgb8());
}

#[test]
fn sources_of_fewer_bits_in_16_keep_their_steps() {
    let place = Place::new();
    // A smooth image of 11 bits.
    let value = |x: u32, y: u32| (1000.0 + 900.0 * (x as f32 / 9.0).sin() * (y as f32 / 7.0).cos()) as u16;
    let image = image::ImageBuffer::from_fn(96, 64, |x, y| image::Luma([value(x, y)]));
    image.save(place.at("deep.png")).unwrap();
    let (run, report) = place.compress("deep.png --out out");
    assert_eq!((run.code, &report[0]["goal_met"]), (Some(0), &true.into()), "{}", run.stderr);
    assert!(run.stdout.contains("values use 11 of 16 bits"), "{}", run.stdout);
    assert_eq!(place.run("decompress out/deep.txf --out png").code, Some(0));
    let (_, values) = opened(&place, "png/deep.png");
    let squared = image.as_raw().iter().zip(&values).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2));
    let rms = (squared.sum::<f64>() / f64::from(96 * 64)).sqrt();
    // 34 dB of 0 to 2047 are 41.
    assert!(rms < 42.0, "{rms}");
}

#[test]
fn every_format_holds_the_channels_and_values_of_the_texture() {
    let place = Place::new();
    for channels in 1..=4 {
        place.image(&format!("in/{channels}.png"), 40, 24, channels);
    }
    assert_eq!(place.run("compress in --as image --out out --codec bc --content raw").code, Some(0));
    for to in ["png", "tiff", "webp", "exr"] {
        let run =
            place.run(&format!("decompress out/1.txf out/2.txf out/3.txf out/4.txf --out {to} --to {to}"));
        assert!(run.code == Some(0) && run.stderr.is_empty(), "{}", run.stderr);
        let lines: Vec<String> = (1..=4).map(|channels| format!("wrote {to}/{channels}.{to}")).collect();
        assert_eq!(run.stdout.lines().collect::<Vec<_>>(), lines);
        // What is written can be read.
        let (run, report) =
            place.compress(&format!("{to} --as image --out of-{to} --codec bc --content raw --force"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        // Dark floats are measured against their own peak, of which 8 bits hold less than all.
        let least = if to == "exr" { 40.0 } else { 100.0 };
        assert!(report.iter().all(|row| row["psnr"].as_f64().unwrap() > least), "{report:?}");
    }
    for channels in 1..=4u8 {
        let open = |to: &str| image::open(place.at(&format!("{to}/{channels}.{to}"))).unwrap();
        for to in ["png", "tiff"] {
            let (found, values) = opened(&place, &format!("{to}/{channels}.{to}"));
            assert_eq!(found, color(channels, 8));
            let wanted = samples(40, 24, channels);
            assert!(values.into_iter().eq(wanted.into_iter().map(u16::from)), "{to} {channels}");
        }
        let (webp, exr) = (open("webp"), open("exr").to_rgba32f());
        assert_eq!(webp.to_rgba8(), open("png").to_rgba8());
        // Linear light, times alpha.
        let texels = exr.pixels().zip(webp.to_rgba8().pixels().copied().collect::<Vec<_>>());
        for (float, texel) in texels {
            let alpha = f32::from(texel[3]) / 255.0;
            let wanted = |value: u8| texfold::core::image::srgb_to_linear(f32::from(value) / 255.0) * alpha;
            assert!((0..3).all(|at| (float[at] - wanted(texel[at])).abs() < 1e-6), "{float:?} {texel:?}");
            assert!((float[3] - alpha).abs() < 1e-6);
        }
    }
}

#[test]
fn a_side_that_webp_has_no_room_for_is_refused() {
    let place = Place::new();
    place.image("long.png", 16_390, 2, 1);
    assert_eq!(place.run("compress long.png --out out --codec bc --content raw").code, Some(0));
    let run = place.run("decompress out/long.txf --out webp --to webp");
    assert!(run.code == Some(1) && run.stderr.contains("at most 16384 texels a side"), "{}", run.stderr);
    let run = place.run("decompress out/long.txf --out webp --to webp --region 6,0,16384,2");
    assert_eq!((run.code, names(&place.at("webp")).len()), (Some(0), 1), "{}", run.stderr);
}

#[test]
fn nothing_is_overwritten_without_force() {
    let place = Place::new();
    for name in ["a", "b", "c"] {
        place.image(&format!("{name}.png"), 40, 24, 3);
    }
    assert_eq!(place.run("compress a.png b.png c.png --out out --codec bc --mips").code, Some(0));
    assert_eq!(place.run("decompress out/c.txf --out png").code, Some(0));
    let before = fs::read(place.at("png/c.png")).unwrap();
    let all = "decompress out/a.txf out/b.txf out/c.txf --out png --lod 1";
    let run = place.run(all);
    assert_eq!((run.code, run.stdout.as_str()), (Some(1), ""));
    assert!(run.stderr.contains("png/c.png: exists already; give --force"), "{}", run.stderr);
    assert_eq!(names(&place.at("png")), ["c.png"], "the first of the files is not written either");
    assert!(fs::read(place.at("png/c.png")).unwrap() == before);
    assert_eq!(place.run(&format!("{all} --force")).code, Some(0));
    assert_eq!((names(&place.at("png")).len(), place.samples("png/c.png").0), (3, 20));
    let run = place.run(all);
    assert!(run.stderr.contains("png/a.png: exists already, and 2 more"), "{}", run.stderr);
    assert_eq!(place.run("bank add a.png b.png --codec dct --bpp 2 --effort fast --out bank").code, Some(0));
    let run = place.run("bank extract bank --out png");
    assert!(
        run.code == Some(1) && run.stderr.contains("png/a.png: exists already, and 1 more"),
        "{}",
        run.stderr
    );
    let run = place.run("bank extract bank --out png --force");
    assert_eq!((run.code, run.stdout.as_str()), (Some(0), "wrote png/a.png\nwrote png/b.png\n"));
}

#[test]
fn a_rectangle_is_that_part_of_the_whole_in_every_codec() {
    let place = Place::new();
    place.image("a.png", 96, 80, 3);
    let codecs = ["bc", "vq", "epitome", "progressive", "dct"];
    for codec in codecs {
        let goal = "--bpp 3 --effort fast --mips";
        let run = place.run(&format!("compress a.png --out {codec} --codec {codec} {goal}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        for (level, region) in [("0", [17, 5, 61, 70]), ("1", [3, 9, 1, 31])] {
            let [x, y, width, height] = region;
            let (out, part) = (format!("{codec}{level}"), format!("--region {x},{y},{width},{height}"));
            for options in ["", &part] {
                let run =
                    place.run(&format!("decompress {codec}/a.txf --out {out} --level {level} {options}"));
                assert_eq!(run.code, Some(0), "{}", run.stderr);
            }
            let open = |name: &str| image::open(place.at(&out).join(name)).unwrap();
            let (whole, part) = (open("a.png"), open(&format!("a-{x}-{y}-{width}x{height}.png")));
            assert!(cut(&whole, region) == part, "{codec} {level}");
        }
    }
    let run = place.run("decompress dct/a.txf --out no --level 1 --region 40,0,9,1");
    assert_eq!((run.code, names(&place.at("no")).len()), (Some(1), 0));
    assert!(run.stderr.contains("the rectangle leaves the level's 48x40 texels"), "{}", run.stderr);
    for wrong in ["1,2,3", "0,0,0,4", "0,0,4,-1", "0,0,4294967295,1"] {
        let run = place.run(&format!("decompress dct/a.txf --out no --region {wrong}"));
        assert!(
            run.code != Some(0) && run.stderr.contains("rectangle") || run.stderr.contains("64,0,256,128")
        );
    }
    let run = place.run("decompress dct/a.txf --out gpu --region 17,5,61,70 --gpu");
    if run.code != Some(0) && std::env::var("TEXFOLD_GPU").as_deref() != Ok("require") {
        assert!(run.stderr.contains("GPU"), "{}", run.stderr);
        return;
    }
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let name = "a-17-5-61x70.png";
    let (cpu, gpu) = (place.samples(&format!("dct0/{name}")), place.samples(&format!("gpu/{name}")));
    assert_eq!((cpu.0, cpu.1), (gpu.0, gpu.1));
    assert!(cpu.2.iter().zip(&gpu.2).all(|(a, b)| a.abs_diff(*b) <= 1));
}

#[test]
fn one_image_of_a_sequence_is_decoded_under_its_number() {
    let place = Place::new();
    for frame in 0..3u8 {
        place.image(&format!("walk/{frame}.png"), 20 + u32::from(frame), 16, 3);
    }
    assert_eq!(place.run("compress walk --out out --codec bc --content raw").code, Some(0));
    let run = place.run("decompress out/walk.txf --out png --image 2");
    assert_eq!((run.code, run.stdout.as_str()), (Some(0), "wrote png/walk-002.png\n"), "{}", run.stderr);
    assert_eq!(place.samples("png/walk-002.png"), place.samples("walk/2.png"));
    for image in ["3", "4294967295"] {
        let run = place.run(&format!("decompress out/walk.txf --out png --image {image}"));
        assert!(run.code == Some(1) && run.stderr.contains(&format!("image {image} of 3")), "{}", run.stderr);
    }
    // A rectangle is of all of them.
    let run = place.run("decompress out/walk.txf --out parts --region 4,2,16,8 --to tiff");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let parts = names(&place.at("parts"));
    assert_eq!(parts, [0, 1, 2].map(|frame| format!("walk-00{frame}-4-2-16x8.tiff")));
    let whole = image::open(place.at("walk/1.png")).unwrap();
    assert!(cut(&whole, [4, 2, 16, 8]) == image::open(place.at("parts").join(&parts[1])).unwrap());
}

#[test]
fn a_rectangle_of_a_bank_is_read_from_the_tiles_that_hold_it() {
    let place = Place::new();
    fs::create_dir_all(place.at("in")).unwrap();
    save_deep(&place, "in/wide.png", 2100, 40, 3);
    let run = place.run("bank add in --codec dct --psnr 40 --effort fast --mips --out bank");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let extract = |options: &str| place.run(&format!("bank extract bank --out png {options}"));
    for level in ["0", "1"] {
        assert_eq!(extract(&format!("--level {level} --to tiff --force")).code, Some(0));
        let whole = image::open(place.at("png/wide.tiff")).unwrap();
        assert_eq!(whole.color(), image::ColorType::Rgb16);
        let region = if level == "0" { [1000, 7, 60, 20] } else { [500, 3, 30, 10] };
        let [x, y, width, height] = region;
        let run = extract(&format!("--level {level} --region {x},{y},{width},{height}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let part = image::open(place.at(&format!("png/wide-{x}-{y}-{width}x{height}.png"))).unwrap();
        assert!(cut(&whole, region) == part, "level {level}");
    }
    // Other tiles are not read.
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(place.at("bank/bank.json")).unwrap()).unwrap();
    let file = manifest["images"][0]["tiles"][0]["file"].as_str().unwrap();
    fs::remove_file(place.at("bank").join(file)).unwrap();
    assert_eq!(extract("--region 1024,0,100,40").code, Some(0));
    assert_eq!(extract("--region 1023,0,100,40").code, Some(1));
    for (options, message) in [
        ("--tile 2,0", "there is no tile 2,0; tiles are 0,0 to 1,0"),
        ("--region 2000,0,101,40", "the rectangle leaves the level's 2100x40 texels"),
        ("--level 1 --region 1050,0,1,1", "the rectangle leaves the level's 1050x20 texels"),
        ("--level 20", "level 20 of"),
        ("--tile 1,0 --region 0,0,1,1", "cannot be used with"),
    ] {
        let run = extract(options);
        assert!(run.code != Some(0) && run.stderr.contains(message), "{options}: {}", run.stderr);
    }
}

#[test]
fn what_does_not_fit_into_memory_is_refused_before_it_is_decoded() {
    let place = Place::new();
    place.image("a.png", 96, 80, 3);
    assert_eq!(place.compress("a.png --out out --codec dct").0.code, Some(0));
    assert_eq!(place.run("bank add a.png --out bank --codec dct --effort fast").code, Some(0));
    for command in ["decompress out/a.txf --out png", "bank extract bank --out png"] {
        let run = place.run(&format!("{command} --memory 0.0001"));
        assert!(run.code == Some(1) && run.stderr.contains("raise --memory"), "{command}: {}", run.stderr);
        assert!(!place.at("png/a.png").exists());
        assert_eq!(place.run(&format!("{command} --memory 0.01 --force")).code, Some(0), "{command}");
        fs::remove_file(place.at("png/a.png")).unwrap();
        let run = place.run(&format!("{command} --memory nan"));
        assert!(run.code == Some(2) && run.stderr.contains("GiB"), "{command}: {}", run.stderr);
    }
}

#[test]
fn every_command_that_reads_files_has_a_memory_limit() {
    let place = Place::new();
    place.image("a.png", 96, 80, 3);
    assert_eq!(place.compress("a.png --out out --codec dct --mips").0.code, Some(0));
    let quad = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    fs::write(place.at("quad.obj"), quad).unwrap();
    for (command, enough) in [
        ("info out/a.txf", 0.001),
        ("info out/a.txf --pictures parts", 0.01),
        ("view out/a.txf --out page.html", 0.001),
        ("render out/a.txf --mesh quad.obj --cpu --out turn", 0.01),
        ("compare a.png --out report", 0.1),
    ] {
        let run = place.run(&format!("{command} --memory 0.000001"));
        assert!(run.code == Some(1) && run.stderr.contains("raise --memory"), "{command}: {}", run.stderr);
        if !command.starts_with("compare") {
            assert_eq!(place.run(&format!("{command} --memory {enough}")).code, Some(0), "{command}");
        }
    }
    // What is loaded may be smaller than what is drawn of it.
    place.image("b.png", 320, 240, 3);
    assert_eq!(place.compress("b.png --out out --codec dct --bpp 0.5").0.code, Some(0));
    for command in ["info out/b.txf --pictures parts", "render out/b.txf --mesh quad.obj --cpu --out turn"] {
        let run = place.run(&format!("{command} --memory 0.003"));
        assert!(
            run.code == Some(1) && run.stderr.contains("4 MiB are needed and 3"),
            "{command}: {}",
            run.stderr
        );
    }
}

/// A TIFF file with a corner at 500000, 4100000 and texels of 2 x 3, in UTM zone 15.
fn save_georeferenced(place: &Place, name: &str, width: u32, height: u32) {
    use tiff::encoder::{TiffEncoder, colortype::RGB8};
    use tiff::tags::Tag;
    fs::create_dir_all(place.at(name).parent().unwrap()).unwrap();
    let mut encoder = TiffEncoder::new(fs::File::create(place.at(name)).unwrap()).unwrap();
    let mut image = encoder.new_image::<RGB8>(width, height).unwrap();
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, [2.0, 3.0, 0.0].as_slice()).unwrap();
    tags.write_tag(Tag::ModelTiepointTag, [0.0, 0.0, 0.0, 5e5, 4.1e6, 0.0].as_slice()).unwrap();
    let keys = [1u16, 1, 0, 2, 1025, 0, 1, 1, 3072, 0, 1, 32615];
    tags.write_tag(Tag::GeoKeyDirectoryTag, keys.as_slice()).unwrap();
    tags.write_tag(Tag::GdalNodata, "0").unwrap();
    image.write_data(&samples(width, height, 3)).unwrap();
}

#[test]
fn georeferences_are_kept_and_follow_parts_and_levels() {
    use tiff::tags::Tag;
    let place = Place::new();
    save_georeferenced(&place, "map.tif", 40, 24);
    let run = place.run("compress map.tif --out out --codec bc --mips");
    assert!(run.code == Some(0) && run.stderr.is_empty(), "{}", run.stderr);
    let info = place.run("info out/map.txf").stdout;
    let words = "place     EPSG:32615, upper left 500000, 4100000, a texel is 2 x 3";
    assert!(info.contains(words), "{info}");
    let found = |name: &str| {
        let mut decoder = tiff::decoder::Decoder::new(fs::File::open(place.at(name)).unwrap()).unwrap();
        assert_eq!(decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap()[11], 32615);
        assert_eq!(decoder.get_tag_ascii_string(Tag::GdalNodata).unwrap(), "0");
        let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap();
        let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        [tie[3] - tie[0] * scale[0], tie[4] + tie[1] * scale[1], scale[0], scale[1]]
    };
    assert_eq!(place.run("decompress out/map.txf --out maps --to tiff").code, Some(0));
    assert_eq!(found("maps/map.tiff"), [5e5, 4.1e6, 2.0, 3.0]);
    let run = place.run("decompress out/map.txf --out maps --to tiff --level 1 --region 5,2,8,4");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(found("maps/map-5-2-8x4.tiff"), [5e5 + 20.0, 4.1e6 - 12.0, 4.0, 6.0]);
    // What is written is read again.
    assert_eq!(place.run("compress maps/map-5-2-8x4.tiff --out again --codec bc").code, Some(0));
    let info = place.run("info again/map-5-2-8x4.txf").stdout;
    assert!(info.contains("EPSG:32615, upper left 500020, 4099988, a texel is 4 x 6"), "{info}");

    let run = place.run("decompress out/map.txf --out maps");
    assert_eq!(
        run.stderr.trim(),
        "warning: maps/map.png: the georeference is left out; give --to tiff or cog to keep it"
    );
    let run = place.run("bank add map.tif --codec dct --psnr 26 --effort fast --mips --out bank");
    assert!(run.code == Some(0) && run.stderr.is_empty(), "{}", run.stderr);
    assert!(place.run("bank list bank").stdout.contains("at EPSG:32615, upper left 500000, 4100000"));
    assert_eq!(place.run("bank extract bank --out of-bank --to tiff").code, Some(0));
    assert_eq!(found("of-bank/map.tiff"), [5e5, 4.1e6, 2.0, 3.0]);
    let run = place.run("bank extract bank --out of-bank --to tiff --level 1 --region 5,2,8,4");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(found("of-bank/map-5-2-8x4.tiff"), [5e5 + 20.0, 4.1e6 - 12.0, 4.0, 6.0]);
    let forged = fs::read_to_string(place.at("bank/bank.json")).unwrap();
    for (from, to) in
        [("\"georeference\":\"", "\"georeference\":\"!"), ("\"georeference\":\"", "\"georeference\":\"AAAA")]
    {
        fs::write(place.at("bank/bank.json"), forged.replace(from, to)).unwrap();
        for command in ["bank list bank", "bank extract bank --out of-bank --to tiff --force"] {
            let run = place.run(command);
            assert_eq!(run.code, Some(0), "{}", run.stderr);
            assert!(run.stderr.contains("the georeference of map is damaged and left out"), "{}", run.stderr);
        }
    }
    save_georeferenced(&place, "set/a.tif", 40, 24);
    save_georeferenced(&place, "set/b.tif", 40, 24);
    let (run, report) = place.compress("set --as set --out out --codec bc");
    assert_eq!(run.code, Some(0));
    let warning = "georeferences are kept of single images, not of sets";
    assert!(report[0]["warnings"][0].as_str().unwrap().ends_with(warning), "{}", report[0]["warnings"]);
}

/// Directories of a TIFF file as cloud-optimised ones are checked by GDAL: offset of each, of its first tile, and its size.
fn directories(place: &Place, name: &str) -> Vec<(u64, u64, (usize, usize))> {
    use tiff::tags::Tag;
    let mut decoder = tiff::decoder::Decoder::new(fs::File::open(place.at(name)).unwrap()).unwrap();
    let mut all = Vec::new();
    loop {
        assert_eq!(decoder.chunk_dimensions(), (512, 512));
        let tiles = decoder.get_tag_u64_vec(Tag::TileOffsets).unwrap();
        assert!(tiles.is_sorted());
        let (width, height) = decoder.dimensions().unwrap();
        all.push((decoder.ifd_pointer().unwrap().0, tiles[0], (width as usize, height as usize)));
        if !decoder.more_images() {
            return all;
        }
        decoder.next_image().unwrap();
    }
}

#[test]
fn cloud_optimised_files_hold_the_same_samples_with_overviews() {
    use tiff::tags::Tag;
    let place = Place::new();
    save_georeferenced(&place, "map.tif", 1300, 601);
    save_deep(&place, "deep.png", 530, 40, 4);
    let run = place.run("compress map.tif deep.png --out out --codec dct --psnr 26 --effort fast");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for (name, levels) in
        [("map", vec![(1300, 601), (650, 301), (325, 151)]), ("deep", vec![(530, 40), (265, 20)])]
    {
        for (to, out) in [("tiff", "plain"), ("cog", "cog")] {
            let run = place.run(&format!("decompress out/{name}.txf --out {out} --to {to}"));
            assert!(run.code == Some(0) && run.stderr.is_empty(), "{}", run.stderr);
        }
        let file = format!("cog/{name}.tiff");
        let (color, samples) = opened(&place, &format!("plain/{name}.tiff"));
        assert_eq!(opened(&place, &file), (color, samples.clone()));
        let found = directories(&place, &file);
        assert_eq!(found.iter().map(|directory| directory.2).collect::<Vec<_>>(), levels);
        // Directories at the head, the image's first; texels behind them all, the smallest overview's first.
        assert_eq!(found[0].0, 8);
        assert!(found.is_sorted_by(|one, next| one.0 < next.0 && one.1 > next.1), "{found:?}");
        assert!(found.last().unwrap().0 < found.last().unwrap().1, "{found:?}");

        let mut decoder = tiff::decoder::Decoder::new(fs::File::open(place.at(&file)).unwrap()).unwrap();
        if name == "map" {
            assert_eq!(
                decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap(),
                [0.0, 0.0, 0.0, 5e5, 4.1e6, 0.0]
            );
        }
        for directory in found.iter().skip(1) {
            decoder.next_image().unwrap();
            assert!(decoder.read_image().is_ok(), "{directory:?}");
        }
        // Overviews are no pages of the file.
        let run = place.run(&format!("compress {file} --out again --codec bc"));
        assert!(run.code == Some(0) && run.stderr.is_empty(), "{}", run.stderr);
    }
    // A georeferenced part, of a bank too.
    assert_eq!(place.run("bank add map.tif --codec dct --psnr 26 --effort fast --out bank").code, Some(0));
    let run = place.run("bank extract bank --out part --to cog --region 5,2,600,10");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(directories(&place, "part/map-5-2-600x10.tiff").len(), 2);
}

//! Files are loaded by an asset server as any user's are.

use bevy_app::{App, TaskPoolPlugin};
use bevy_asset::{AssetPlugin, AssetServer, Assets, Handle, LoadState, RenderAssetUsages};
use bevy_image::{CompressedImageFormats, Image, ImageSampler, ImageType};
use texfold_bevy::{TexfoldPlugin, TexfoldSettings};
use wgpu_types::TextureFormat;

fn app() -> App {
    let mut app = App::new();
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/golden");
    app.add_plugins((
        TaskPoolPlugin::default(),
        AssetPlugin { file_path: golden.to_owned(), ..Default::default() },
    ));
    app.add_plugins(TexfoldPlugin);
    app
}

/// The state of an asset once it is settled.
fn settled(app: &mut App, handle: &Handle<Image>) -> LoadState {
    for _ in 0..2000 {
        app.update();
        match app.world().resource::<AssetServer>().load_state(handle) {
            LoadState::Loaded => return LoadState::Loaded,
            failed @ LoadState::Failed(_) => return failed,
            _ => std::thread::sleep(std::time::Duration::from_millis(5)),
        }
    }
    LoadState::Loading
}

fn load(app: &mut App, path: &'static str) -> Handle<Image> {
    // What is drawn alone is not kept by the CPU.
    let keep = |settings: &mut TexfoldSettings| settings.asset_usage = RenderAssetUsages::all();
    app.world().resource::<AssetServer>().load_builder().with_settings(keep).load(path)
}

/// Decodes level by level.
fn texels(file: &str, number: u32) -> Vec<u8> {
    let path = format!("{}/../../fixtures/golden/{file}", env!("CARGO_MANIFEST_DIR"));
    let texture = texfold::open(&std::fs::read(path).unwrap()).unwrap().into_image().unwrap();
    let layout = texture.as_encoded().layout();
    let mut all = Vec::new();
    for level in 0..layout.levels.min(layout.images[number as usize].full_levels()) {
        let rect = layout.whole(number, level).unwrap();
        let mut rgba = vec![0; 4 * rect.width as usize * rect.height as usize];
        texture.decode_rgba8(rect, &mut rgba, 4 * rect.width as usize).unwrap();
        all.extend(rgba);
    }
    all
}

#[test]
fn images_have_the_texels_and_levels_of_the_file() {
    let mut app = app();
    for (path, file, number) in [
        ("dct_alpha.txf", "dct_alpha.txf", 0),
        ("vq_bc1_mips.txf", "vq_bc1_mips.txf", 0),
        ("vq_raw_sequence.txf#3", "vq_raw_sequence.txf", 3),
        ("dct_material.txf", "dct_material.txf", 0),
    ] {
        let handle = load(&mut app, path);
        assert!(matches!(settled(&mut app, &handle), LoadState::Loaded), "{path}");
        let image = app.world().resource::<Assets<Image>>().get(&handle).unwrap();
        assert!(image.data.as_deref() == Some(&texels(file, number)[..]), "{path}");
        assert_eq!(image.texture_descriptor.format, TextureFormat::Rgba8UnormSrgb, "{path}");
    }
    let handle = load(&mut app, "dct_material.txf#normal");
    assert!(matches!(settled(&mut app, &handle), LoadState::Loaded));
    let image = app.world().resource::<Assets<Image>>().get(&handle).unwrap();
    assert_eq!(image.texture_descriptor.format, TextureFormat::Rgba8Unorm);
}

#[test]
fn what_is_no_image_fails_with_its_reason() {
    let mut app = app();
    for (path, reason) in [("lightfield.txf", "codec number 5"), ("none.txf", "none.txf")] {
        let handle = load(&mut app, path);
        match settled(&mut app, &handle) {
            LoadState::Failed(error) => assert!(error.to_string().contains(reason), "{error}"),
            state => panic!("{path}: {state:?}"),
        }
    }
}

#[test]
fn bevy_reads_the_textures_that_the_program_writes() {
    let program = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/debug/texfold");
    if !std::path::Path::new(program).exists() {
        println!("no {program}: build it to test KTX2 files");
        return;
    }
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/golden/dct_alpha.txf");
    for (to, format) in [("bc7", TextureFormat::Bc7RgbaUnormSrgb), ("rgba8", TextureFormat::Rgba8UnormSrgb)] {
        for options in [&["--zstd"][..], &[]] {
            let out = std::env::temp_dir().join(format!(
                "texfold-bevy-{}-{to}-{}",
                std::process::id(),
                options.len()
            ));
            let mut command = std::process::Command::new(program);
            command.args(["decompress", golden, "--to", to, "--out"]).arg(&out).args(options);
            assert!(command.status().unwrap().success());
            let file = std::fs::read(out.join("dct_alpha.ktx2")).unwrap();
            std::fs::remove_dir_all(&out).unwrap();
            let image = Image::from_buffer(
                &file,
                ImageType::Extension("ktx2"),
                CompressedImageFormats::all(),
                true,
                ImageSampler::Default,
                RenderAssetUsages::all(),
            );
            let image = image.unwrap();
            assert_eq!(
                (image.texture_descriptor.format, image.texture_descriptor.mip_level_count),
                (format, 8)
            );
            if to == "rgba8" {
                assert!(image.data.as_deref() == Some(&texels("dct_alpha.txf", 0)[..]));
            }
        }
    }
}

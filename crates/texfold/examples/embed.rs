//! Encode an image, store it, open it, sample it: `cargo run -p texfold --example embed`.

use std::fs::File;
use texfold::{ColorSpace, Encode, Goal, ImageAddress, ImageSet, Limits, Raster};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // 64 x 64 RGB texels, as any image library gives them.
    let pixels: Vec<u8> =
        (0..64 * 64u32).flat_map(|i| [(i % 64) as u8 * 4, (i / 64) as u8 * 4, 128]).collect();
    let images = ImageSet::single(Raster::from_u8(64, 64, 3, ColorSpace::Srgb, &pixels)?);
    let texture = Encode::new(&images).goal(Goal::Bpp(2.0)).mips(true).run()?;
    let path = std::env::temp_dir().join("texfold-embed.txf");
    texture.write_to(File::create(&path)?)?;

    let texture = texfold::open_from(File::open(&path)?, &Limits::default())?.into_image()?;
    let texel = texture.as_encoded().texel(ImageAddress { image: 0, level: 0, x: 10, y: 20 });
    let whole = texture.as_encoded().layout().whole(0, 0).ok_or("no image")?;
    let mut rgba = vec![0; 4 * 64 * 64];
    texture.decode_rgba8(whole, &mut rgba, 4 * 64)?;
    // For a GPU: texture.as_encoded().gpu() lists the planes to upload, texfold-shaders has the WGSL that samples them.
    println!("codec {}, texel {texel}, first bytes {:?}", texture.codec().name, &rgba[..4]);
    Ok(())
}

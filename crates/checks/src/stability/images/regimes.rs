//! Images that methods built on repetition, on codebooks or on transforms do not suit.

use texfold::Texel;
use texfold::core::image::{Alpha, ColorSpace, ImageSet, Raster};
use texfold_testkit::image;

use crate::stability::Outcome;

/// Images of one kind, and what is hard about them.
pub(crate) struct Regime {
    pub(crate) name: &'static str,
    pub(crate) about: &'static str,
    pub(crate) images: fn() -> Outcome<ImageSet>,
}

/// All regimes of images.
pub(crate) const REGIMES: [Regime; 27] = [
    Regime {
        name: "constant",
        about: "one colour: no variance to share out",
        images: || fixture("constant"),
    },
    Regime { name: "black", about: "gains of nothing by nothing", images: || fixture("black") },
    Regime { name: "1x1", about: "a single texel", images: || fixture("one_texel") },
    Regime { name: "3x5", about: "less than one block of 4x4 across", images: || fixture("odd_3x5") },
    Regime { name: "37x61", about: "sides that no block size divides", images: || fixture("odd_37x61") },
    Regime { name: "4097x1", about: "a row longer than a power of two", images: row_of_texels },
    Regime { name: "1x4097", about: "a column longer than a power of two", images: column_of_texels },
    Regime { name: "16384x1", about: "the longest side of a common texture", images: longest_row },
    Regime { name: "noise", about: "nothing to predict, nothing that recurs", images: || fixture("noise") },
    Regime { name: "zebra", about: "high frequencies that do not recur", images: || fixture("zebra") },
    Regime {
        name: "stripes",
        about: "structure in one dimension: singular Hessians",
        images: || fixture("stripes"),
    },
    Regime {
        name: "ramp",
        about: "each block like each other: a clique of matches",
        images: || fixture("ramp"),
    },
    Regime { name: "gradient of 16 bits", about: "steps finer than 8 bits", images: fine_gradient },
    Regime { name: "tile of 2x2", about: "recurs within a block", images: || tiles(2, 2) },
    Regime { name: "tile of 3x3", about: "recurs off the grid of blocks", images: || tiles(3, 3) },
    Regime { name: "tile of 5x7", about: "recurs off the grid of leaves", images: || tiles(5, 7) },
    Regime {
        name: "equal blocks",
        about: "descriptors equal by the thousand, and one that differs",
        images: equal_blocks,
    },
    Regime { name: "two blocks", about: "fewer distinct blocks than codewords", images: two_blocks },
    Regime { name: "one bright texel", about: "a single texel that no mean shows", images: bright_texel },
    Regime {
        name: "saturated edges",
        about: "full steps of colour inside of blocks",
        images: saturated_edges,
    },
    Regime { name: "text", about: "black on white: two levels, sharp", images: text },
    Regime { name: "transparent", about: "nothing to see, colours hidden below", images: transparent },
    Regime {
        name: "cutout",
        about: "alpha with a hard border, hidden colours",
        images: || fixture("cutout"),
    },
    Regime { name: "gray", about: "one channel", images: || fixture("gray") },
    Regime { name: "two channels", about: "two channels that mean nothing to the eye", images: two_channels },
    Regime { name: "normals", about: "unit vectors, a channel left out", images: normals },
    Regime {
        name: "unlike images",
        about: "a set whose images share nothing, of unlike sizes",
        images: unlike_images,
    },
];

fn fixture(name: &str) -> Outcome<ImageSet> {
    Ok(ImageSet::single(image(name)))
}

/// An image of that size whose texel at (x, y) is `shade`.
fn drawn(width: u32, height: u32, shade: impl Fn(u32, u32) -> [u8; 3]) -> Outcome<Raster> {
    let bytes: Vec<u8> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| shade(x, y)).collect();
    Ok(Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes)?)
}

fn single(image: Outcome<Raster>) -> Outcome<ImageSet> {
    Ok(ImageSet::single(image?))
}

fn along(x: u32) -> [u8; 3] {
    [(x * 7 % 251) as u8, (x / 16 % 256) as u8, 90]
}

fn row_of_texels() -> Outcome<ImageSet> {
    single(drawn(4097, 1, |x, _| along(x)))
}

fn column_of_texels() -> Outcome<ImageSet> {
    single(drawn(1, 4097, |_, y| along(y)))
}

fn longest_row() -> Outcome<ImageSet> {
    // GPUs take 8192 texels a side; two images of that are as long together.
    Ok(ImageSet::new(vec![drawn(8192, 1, |x, _| along(x))?, drawn(8192, 1, |x, _| along(x + 8192))?])?)
}

fn fine_gradient() -> Outcome<ImageSet> {
    let values: Vec<u16> =
        (0..128 * 64).flat_map(|i| [20_000 + i, 30_000 + 2 * (i % 128), 40_000 - i]).collect();
    Ok(ImageSet::single(Raster::from_u16(128, 64, 3, ColorSpace::Srgb, &values)?))
}

fn tiles(across: u32, down: u32) -> Outcome<ImageSet> {
    let shade = move |x: u32, y: u32| {
        let at = (x % across) * 53 + (y % down) * 97;
        [(at * 3 % 256) as u8, (at * 7 % 256) as u8, (at * 11 % 256) as u8]
    };
    single(drawn(96, 80, shade))
}

fn equal_blocks() -> Outcome<ImageSet> {
    let shade = |x: u32, y: u32| {
        if (x, y) == (100, 100) { [255, 0, 0] } else { [(x % 8 * 30) as u8, (y % 8 * 30) as u8, 128] }
    };
    single(drawn(192, 192, shade))
}

fn two_blocks() -> Outcome<ImageSet> {
    let shade = |x: u32, y: u32| {
        let checked = (x / 4 + y / 4).is_multiple_of(2);
        if checked { [(x % 4 * 60) as u8, 40, 200] } else { [30, (y % 4 * 60) as u8, 10] }
    };
    single(drawn(64, 64, shade))
}

fn bright_texel() -> Outcome<ImageSet> {
    single(drawn(64, 64, |x, y| if (x, y) == (37, 21) { [255; 3] } else { [20, 30, 40] }))
}

fn saturated_edges() -> Outcome<ImageSet> {
    let corners = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [0, 255, 255], [255, 0, 255]];
    single(drawn(96, 96, |x, y| corners[((x * x + 3 * x * y + y * 7) / 97 % 6) as usize]))
}

fn text() -> Outcome<ImageSet> {
    let page = image("text_page");
    let (width, height) = (page.size().width.min(128), page.size().height.min(128));
    let texels: Vec<Texel> = (0..width * height).map(|i| page.texel(i % width, i / width)).collect();
    Ok(ImageSet::single(Raster::from_texels(width, height, page.info(), &texels)?))
}

fn transparent() -> Outcome<ImageSet> {
    let hidden = drawn(64, 48, |x, y| [(x * 37 + y * 11) as u8, (x * y) as u8, (y * 5) as u8])?;
    let clear: Vec<Texel> = hidden.texels().map(|texel| texel.truncate().extend(0.0)).collect();
    let mut info = hidden.info();
    (info.channels, info.alpha) = (4, Alpha::Straight);
    Ok(ImageSet::single(Raster::from_texels(64, 48, info, &clear)?))
}

fn two_channels() -> Outcome<ImageSet> {
    Ok(ImageSet::single(image("cutout").with_channels(2)))
}

fn normals() -> Outcome<ImageSet> {
    Ok(ImageSet::single(image("normal_map").tagged(ColorSpace::Normal, Alpha::Opaque)))
}

fn unlike_images() -> Outcome<ImageSet> {
    let smooth = drawn(70, 33, |x, y| [(x * 3) as u8, (y * 7) as u8, 128])?;
    Ok(ImageSet::new(vec![smooth, image("noise"), image("odd_3x5"), image("constant")])?)
}

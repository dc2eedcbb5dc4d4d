//! Strokes that recur, turned, in cells of 32 texels.

use texfold_core::image::{ColorSpace, Raster};

/// An RGB image of so many columns and rows with so many shapes, each in one of four rotations; `seed` chooses which stands where.
#[must_use]
pub fn strokes((width, height): (u32, u32), seed: u32, shapes: u32) -> Raster {
    let value = |x: u32, y: u32| {
        let (tile_x, tile_y) = (x / 32, y / 32);
        let kind = (tile_x * 7 + tile_y * 13 + seed * 5) % 4;
        let (u, v) = (x % 32, y % 32);
        let (a, b) = match kind {
            0 => (u, v),
            1 => (31 - v, u),
            2 => (31 - u, 31 - v),
            _ => (v, 31 - u),
        };
        let shape = (tile_x * 5 + tile_y * 3 + seed) % shapes;
        let stroke =
            (a * a / (9 + shape) + (3 + shape % 3) * b + a * b / (17 + 2 * shape)) % (23 + shape) < 9;
        (60 + (x + y) / 10 + if stroke { 50 } else { 0 }).min(255) as u8
    };
    let bytes: Vec<u8> = (0..width * height).flat_map(|i| [value(i % width, i / width); 3]).collect();
    Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes)
        .unwrap_or_else(|error| unreachable!("three values a texel: {error}"))
}

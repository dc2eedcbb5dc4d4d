//! The levels of a texture that are always there: in a quarter of a tile, decoded by the CPU.

use texfold_core::{Encoded, Image2d, ImageAddress, ImageSize, Rect, Texel};
use wgpu::Extent3d;

use super::parts::Part;
use super::rows::{self, CLAMP, SIDE, tail_place};
use super::{QUARTER, TileCache};
use crate::Gpu;

/// The levels of a texture that are always there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tail {
    /// Column and row in quarters of tiles, and layer.
    pub(super) place: [u32; 3],
    /// The first one, and the one behind the last.
    pub(super) first: u32,
    pub(super) levels: u32,
}

impl TileCache {
    /// The tail of a texture of that number.
    pub(super) fn tail_of(&self, index: u32, levels: u32, first: u32) -> Tail {
        let side = self.pool.width() / SIDE;
        let slot = index / 4;
        let layer = slot / (side * side) * self.layers();
        let place = [2 * (slot % side) + index % 2, 2 * (slot / side % side) + index / 2 % 2, layer];
        Tail { place, first, levels }
    }

    /// Writes the levels that are always there: those that the texture has, else a coarse sample of its only one.
    pub(super) fn write_tail(
        &self,
        gpu: &Gpu,
        (texture, parts): (&dyn Encoded<Domain = Image2d>, &[Part]),
        tail: &Tail,
        shape: (u32, u32),
    ) {
        let images: Vec<_> = parts.iter().map(|part| tail_texels(texture, *part, tail, shape)).collect();
        let [column, row, first] = tail.place;
        for layer in 0..self.layers() {
            let mut texels = vec![[255u8; 4]; (QUARTER * QUARTER) as usize];
            parts.iter().zip(&images).for_each(|(part, image)| part.fill(layer, &mut texels, image));
            let origin = wgpu::Origin3d { x: column * QUARTER, y: row * QUARTER, z: first + layer };
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo { origin, ..self.pool.as_image_copy() },
                texels.as_flattened(),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * QUARTER),
                    rows_per_image: None,
                },
                Extent3d { width: QUARTER, height: QUARTER, depth_or_array_layers: 1 },
            );
        }
    }
}

/// The texels of an image's tail, of a quarter of a tile.
fn tail_texels(
    texture: &dyn Encoded<Domain = Image2d>,
    Part { image, halvings, .. }: Part,
    tail: &Tail,
    (levels, flags): (u32, u32),
) -> Vec<[u8; 4]> {
    let size = texture.layout().images[image as usize];
    let mut texels = vec![[0u8; 4]; (QUARTER * QUARTER) as usize];
    for level in tail.first..tail.levels {
        let own = level.saturating_sub(halvings);
        let mut decoded = decoded(texture, image, (own, levels), size);
        let ImageSize { mut width, mut height } = size.at_level(own);
        if let Some(times) = halvings.checked_sub(level).filter(|&times| times > 0) {
            decoded = enlarged(&decoded, [width, height], times, flags);
            (width, height) = (width << times, height << times);
        }
        let [left, top] = tail_place(level - tail.first);
        let border = rows::BORDER as i32;
        for y in -border..height as i32 + border {
            for x in -border..width as i32 + border {
                let [column, row] = [addressed(x, width, flags), addressed(y, height, flags)];
                let place = (top as i32 + y) * QUARTER as i32 + left as i32 + x;
                texels[place as usize] = decoded[(row * width + column) as usize];
            }
        }
    }
    texels
}

/// An image of 2^`times` the sides, each texel between the four nearest ones: as `write_tiles` in `shaders/wgsl/entry/tiles.wgsl`.
fn enlarged(texels: &[[u8; 4]], [width, height]: [u32; 2], times: u32, flags: u32) -> Vec<[u8; 4]> {
    let part = 2i32 << times;
    let near = |at: u32, size: u32| {
        let place = 2 * at as i32 + 1 - part / 2;
        let share = place & (part - 1);
        [(place, part - share), (place + part, share)]
            .map(|(place, weight)| (addressed(place >> (times + 1), size, flags), weight as u32))
    };
    let value = |place: u32, channel: usize| {
        let (columns, rows) = (near(place % (width << times), width), near(place / (width << times), height));
        let taps = rows.iter().flat_map(|row| columns.map(|column| (column, *row)));
        let weighted = |((x, one), (y, other)): ((u32, u32), (u32, u32))| {
            one * other * u32::from(texels[(y * width + x) as usize][channel])
        };
        let (sum, whole) = (taps.map(weighted).sum::<u32>(), part as u32 * part as u32);
        ((sum + whole / 2) / whole) as u8
    };
    let places = 0..(width << times) * (height << times);
    places.map(|place| [0, 1, 2, 3].map(|channel| value(place, channel))).collect()
}

/// The column or row of an image of `size` of them that one outside of it repeats.
fn addressed(at: i32, size: u32, flags: u32) -> u32 {
    let size = size as i32;
    (if flags & CLAMP != 0 { at.clamp(0, size - 1) } else { at.rem_euclid(size) }) as u32
}

/// The texels of a level; of levels that the texture does not have, those in the middle of what each stands for.
fn decoded(
    texture: &dyn Encoded<Domain = Image2d>,
    image: u32,
    (level, levels): (u32, u32),
    size: ImageSize,
) -> Vec<[u8; 4]> {
    let few = size.at_level(level);
    let ImageSize { width, height } = few;
    let mut texels = vec![Texel::ZERO; (width * height) as usize];
    let rect = Rect { image, level, x: 0, y: 0, width, height };
    if level >= levels || texture.decode(rect, &mut texels).is_err() {
        let middle = |at: u32, few: u32, all: u32| {
            ((2 * u64::from(at) + 1) * u64::from(all) / (2 * u64::from(few))) as u32
        };
        for (place, texel) in (0..).zip(&mut texels) {
            let (x, y) =
                (middle(place % width, width, size.width), middle(place / width, height, size.height));
            *texel = texture.texel(ImageAddress { image, level: 0, x, y });
        }
    }
    texels.into_iter().map(bytes_of).collect()
}

fn bytes_of(texel: Texel) -> [u8; 4] {
    texel.to_array().map(|value| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
}

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
        let images: Vec<_> = parts.iter().map(|part| tail_texels(texture, part.image, tail, shape)).collect();
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
    image: u32,
    tail: &Tail,
    (levels, flags): (u32, u32),
) -> Vec<[u8; 4]> {
    let size = texture.layout().images[image as usize];
    let mut texels = vec![[0u8; 4]; (QUARTER * QUARTER) as usize];
    for level in tail.first..tail.levels {
        let ImageSize { width, height } = size.at_level(level);
        let decoded = decoded(texture, image, (level, levels), size);
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

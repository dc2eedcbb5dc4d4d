//! Decoding of single blocks, format by format.
//!
//! Decoding follows the Direct3D definitions without intermediate rounding: BC1 and BC3 colours are 565 values
//! scaled to [0, 1] and interpolated, BC4 and BC5 interpolate in [0, 1]. Hardware decoders round differently by up
//! to 2/255; BC7 is exact by definition.

use dds::{ColorFormat, ImageViewMut, Size};
use glam::Vec4;
use texfold_core::PlaneFormat;

/// The texels of one stored block, row by row; a single texel is repeated. Missing channels are 0, missing alpha is 1. Bytes
/// missing from `block` count as 0.
#[must_use]
pub fn decode_block(format: PlaneFormat, block: &[u8]) -> [Vec4; 16] {
    let byte = |index: usize| f32::from(block.get(index).copied().unwrap_or(0));
    match format {
        PlaneFormat::R8Unorm => [Vec4::new(byte(0) / 255.0, 0.0, 0.0, 1.0); 16],
        PlaneFormat::Rg8Unorm => [Vec4::new(byte(0) / 255.0, byte(1) / 255.0, 0.0, 1.0); 16],
        PlaneFormat::Rg8Uint => [Vec4::new(byte(0), byte(1), 0.0, 1.0); 16],
        PlaneFormat::R32Uint | PlaneFormat::Rgba32Uint | PlaneFormat::Rgba8Unorm => {
            [Vec4::new(byte(0), byte(1), byte(2), byte(3)) / 255.0; 16]
        }
        PlaneFormat::Bc1 => decode_bc1(first_eight(block, 0), false),
        PlaneFormat::Bc3 => {
            let (alpha, mut texels) =
                (decode_bc4(first_eight(block, 0)), decode_bc1(first_eight(block, 8), true));
            texels.iter_mut().zip(alpha).for_each(|(texel, alpha)| texel.w = alpha);
            texels
        }
        PlaneFormat::Bc4 => decode_bc4(first_eight(block, 0)).map(|red| Vec4::new(red, 0.0, 0.0, 1.0)),
        PlaneFormat::Bc5 => {
            let (red, green) = (decode_bc4(first_eight(block, 0)), decode_bc4(first_eight(block, 8)));
            std::array::from_fn(|i| Vec4::new(red[i], green[i], 0.0, 1.0))
        }
        _ => decode_bc7(block),
    }
}

fn first_eight(block: &[u8], start: usize) -> [u8; 8] {
    std::array::from_fn(|i| block.get(start + i).copied().unwrap_or(0))
}

fn decode_bc1(block: [u8; 8], always_four: bool) -> [Vec4; 16] {
    let (low, high) = (u16::from_le_bytes([block[0], block[1]]), u16::from_le_bytes([block[2], block[3]]));
    let (a, b) = (unpack_565(low), unpack_565(high));
    let palette = if always_four || low > high {
        [a, b, (a * 2.0 + b) / 3.0, (a + b * 2.0) / 3.0]
    } else {
        [a, b, (a + b) * 0.5, Vec4::ZERO]
    };
    let selectors = u32::from_le_bytes([block[4], block[5], block[6], block[7]]);
    std::array::from_fn(|i| palette[(selectors >> (2 * i) & 3) as usize])
}

fn unpack_565(value: u16) -> Vec4 {
    let field =
        |shift: u32, bits: u32| f32::from(value >> shift & ((1 << bits) - 1)) / ((1 << bits) - 1) as f32;
    Vec4::new(field(11, 5), field(5, 6), field(0, 5), 1.0)
}

fn decode_bc4(block: [u8; 8]) -> [f32; 16] {
    let (a, b) = (f32::from(block[0]) / 255.0, f32::from(block[1]) / 255.0);
    let level = |code: u64| match (code, block[0] > block[1]) {
        (0, _) => a,
        (1, _) => b,
        (code, true) => (a * (8 - code) as f32 + b * (code - 1) as f32) / 7.0,
        (6, false) => 0.0,
        (7, false) => 1.0,
        (code, false) => (a * (6 - code) as f32 + b * (code - 1) as f32) / 5.0,
    };
    let codes = u64::from_le_bytes(block) >> 16;
    std::array::from_fn(|i| level(codes >> (3 * i) & 7))
}

fn decode_bc7(block: &[u8]) -> [Vec4; 16] {
    let mut rgba = [0u8; 64];
    let bytes: [u8; 16] = std::array::from_fn(|i| block.get(i).copied().unwrap_or(0));
    if let Some(view) = ImageViewMut::new(&mut rgba, Size::new(4, 4), ColorFormat::RGBA_U8) {
        let done =
            dds::decode(&mut bytes.as_slice(), view, dds::Format::BC7_UNORM, &dds::DecodeOptions::default());
        debug_assert!(done.is_ok(), "any 16 bytes are a BC7 block: {done:?}");
    }
    std::array::from_fn(|i| {
        let texel = &rgba[4 * i..4 * i + 4];
        Vec4::from_array(std::array::from_fn(|channel| f32::from(texel[channel]) / 255.0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Decoders may round BC1 to BC5 differently by this much (Direct3D 11.3 specification, 19.5).
    const ROUNDING: f32 = 2.0 / 255.0;

    fn largest_difference(texels: &[Vec4], other: &[u8], channels: &[usize]) -> f32 {
        let stride = other.len() / 16;
        let difference = |i: usize, channel: usize, plane: usize| {
            (texels[i][channel] - f32::from(other[i * stride + plane]) / 255.0).abs()
        };
        (0..16)
            .flat_map(|i| {
                channels.iter().enumerate().map(move |(plane, &channel)| difference(i, channel, plane))
            })
            .fold(0.0, f32::max)
    }

    proptest! {
        #[test]
        fn any_bytes_decode_as_an_independent_decoder_says(bytes in proptest::array::uniform16(any::<u8>())) {
            let mut rgba = [0u8; 64];
            bcdec_rs::bc1(&bytes[..8], &mut rgba, 16);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc1, &bytes), &rgba, &[0, 1, 2, 3]) <= ROUNDING);
            bcdec_rs::bc3(&bytes, &mut rgba, 16);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc3, &bytes), &rgba, &[0, 1, 2, 3]) <= ROUNDING);
            let mut red = [0u8; 16];
            bcdec_rs::bc4(&bytes[..8], &mut red, 4, false);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc4, &bytes), &red, &[0]) <= ROUNDING);
            let mut two = [0u8; 32];
            bcdec_rs::bc5(&bytes, &mut two, 8, false);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc5, &bytes), &two, &[0, 1]) <= ROUNDING);
            bcdec_rs::bc7(&bytes, &mut rgba, 16);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc7, &bytes), &rgba, &[0, 1, 2, 3]) < 1e-6);
        }
    }
}

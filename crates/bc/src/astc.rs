//! ASTC by Arm's own encoder and decoder, which the crate `ctt-astcenc` builds from source.
//!
//! Blocks are LDR and linear, decoded as hardware without a decode mode does: in half precision, here rounded to 8 bits.
//! Hardware that decodes to 8 bits cuts instead of rounding: both differ from this by at most 1/255.
//!
//! *Not taken*: the crate `astc-decode` (0.3.1) differs from Arm's decoder by more than rounding in 2 to 7 % of legal random
//! blocks, and `texture2ddecoder` (0.1.2) panics on a third of all random ones; Arm's gives illegal blocks the error colour.
//! Arm's encoder is built for several kinds of processors, which may round differently: the bytes of a file do not depend
//! on the number of threads, but may on the processor.

use std::cell::RefCell;

use ctt_astcenc::bindings::{astcenc_image, astcenc_type_ASTCENC_TYPE_U8};
use ctt_astcenc::{Context, Flags, Preset, Profile, Swizzle, config_init};
use glam::Vec4;
use texfold_core::AstcBlock;

/// Whether this build can encode and decode ASTC.
pub(crate) const AVAILABLE: bool = true;

/// The colour of illegal blocks (Khronos Data Format 1.3, 23.20).
const ERROR: [u8; 4] = [255, 0, 255, 255];

thread_local! {
    /// A decoder for each kind of block, made when it is first needed.
    static DECODERS: RefCell<[Option<Context>; AstcBlock::ALL.len()]> = const { RefCell::new([const { None }; AstcBlock::ALL.len()]) };
}

pub(crate) fn context(block: AstcBlock, preset: Preset, flags: Flags) -> Option<Context> {
    let side = block.side();
    let config = config_init(Profile::Ldr, side, side, 1, preset, flags).ok()?;
    Context::new(&config).ok()
}

/// Does `work` with a description of `rgba` that Arm's library takes.
pub(crate) fn with_image<T>(
    width: u32,
    height: u32,
    rgba: &mut [u8],
    work: impl FnOnce(&mut astcenc_image) -> T,
) -> T {
    debug_assert_eq!(rgba.len(), (width * height * 4) as usize, "an image of another length");
    let mut slice = rgba.as_mut_ptr().cast();
    let mut image = astcenc_image {
        dim_x: width,
        dim_y: height,
        dim_z: 1,
        data_type: astcenc_type_ASTCENC_TYPE_U8,
        data: &raw mut slice,
    };
    work(&mut image)
}

/// The texels of one block, row by row; bytes missing from it count as 0.
pub(crate) fn decode(block: AstcBlock, bytes: &[u8]) -> Vec<Vec4> {
    let side = block.side();
    let bytes: [u8; 16] = std::array::from_fn(|i| bytes.get(i).copied().unwrap_or(0));
    let mut rgba = ERROR.repeat((side * side) as usize);
    DECODERS.with_borrow_mut(|decoders| {
        let slot = &mut decoders[block as usize];
        if slot.is_none() {
            *slot = context(block, Preset::Fastest, Flags::DECOMPRESS_ONLY);
        }
        if let Some(context) = slot {
            let done = with_image(side, side, &mut rgba, |image| {
                context.decompress(&bytes, image, Swizzle::IDENTITY).and_then(|()| context.decompress_reset())
            });
            debug_assert!(done.is_ok(), "any 16 bytes decode: {done:?}");
        }
    });
    let channel = |byte: u8| f32::from(byte) / 255.0;
    rgba.chunks_exact(4)
        .map(|t| Vec4::new(channel(t[0]), channel(t[1]), channel(t[2]), channel(t[3])))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode_block;
    use texfold_core::PlaneFormat;

    #[test]
    fn illegal_and_short_blocks_show_the_error_colour() {
        let error = Vec4::new(1.0, 0.0, 1.0, 1.0);
        for block in AstcBlock::ALL {
            let texels = decode_block(PlaneFormat::Astc(block), &[0; 7]);
            assert_eq!(texels.len(), block.side().pow(2) as usize);
            assert!(texels.iter().all(|&texel| texel == error), "{block:?}");
        }
        // A void extent without an extent: one colour (Khronos Data Format 1.3, 23.19).
        let mut flat = [0xffu8; 16];
        flat[..2].copy_from_slice(&[0xfc, 0xfd]);
        flat[8..].copy_from_slice(&[0, 0x80, 0, 0x40, 0, 0, 0xff, 0xff]);
        let texels = decode_block(PlaneFormat::Astc(AstcBlock::B8), &flat);
        let wanted = Vec4::new(128.0 / 255.0, 64.0 / 255.0, 0.0, 1.0);
        assert!(texels.iter().all(|texel| (*texel - wanted).abs().max_element() < 1e-6), "{}", texels[0]);
    }
}

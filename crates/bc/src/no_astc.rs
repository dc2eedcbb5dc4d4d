//! ASTC in builds without the feature `astc`: nothing makes or loads such content, so nothing comes here but what calls
//! [`crate::encode_plane`] and [`crate::decode_block`] by hand.

use glam::Vec4;
use texfold_core::{AstcBlock, Effort};

/// Whether this build can encode and decode ASTC.
pub(crate) const AVAILABLE: bool = false;

/// Blocks of zeros, which are illegal in ASTC.
pub(crate) fn encode(block: AstcBlock, width: u32, height: u32, _: &[u8], _: Effort) -> Vec<u8> {
    vec![0; texfold_core::PlaneFormat::Astc(block).bytes(width, height) as usize]
}

/// The colour of illegal blocks (Khronos Data Format 1.3, 23.20).
pub(crate) fn decode(block: AstcBlock, _: &[u8]) -> Vec<Vec4> {
    vec![Vec4::new(1.0, 0.0, 1.0, 1.0); block.side().pow(2) as usize]
}

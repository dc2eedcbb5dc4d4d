//! ASTC in builds without the feature `astc`: nothing loads such content, so nothing comes here but what
//! calls [`crate::decode_block`] by hand.

use glam::Vec4;
use texfold_core::AstcBlock;

/// Whether this build can encode and decode ASTC.
pub(crate) const AVAILABLE: bool = false;

/// The colour of illegal blocks (Khronos Data Format 1.3, 23.20).
pub(crate) fn decode(block: AstcBlock, _: &[u8]) -> Vec<Vec4> {
    vec![Vec4::new(1.0, 0.0, 1.0, 1.0); block.side().pow(2) as usize]
}

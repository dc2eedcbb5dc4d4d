//! ASTC in builds without the feature `astc`: nothing makes such content, so nothing comes here but what calls
//! [`crate::encode_plane`] by hand.

use texfold_core::{AstcBlock, Effort};

/// Blocks of zeros, which are illegal in ASTC.
pub(crate) fn encode(block: AstcBlock, width: u32, height: u32, _: &[u8], _: Effort) -> Vec<u8> {
    vec![0; texfold_core::PlaneFormat::Astc(block).bytes(width, height) as usize]
}

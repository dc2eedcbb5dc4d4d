//! Lone texels: a superblock is decoded once, and the last ones are kept.

use super::context::Around;
use super::decode::BlockTexture;
use super::plane::Patch;

/// Reads a texture texel by texel. It holds the decoded means (a 64th of the image's samples, 4 bytes each) and some
/// superblocks.
#[derive(Debug)]
pub struct BlockSampler<'a> {
    texture: &'a BlockTexture,
    base: Option<Patch>,
    around: Around,
    /// Superblocks, the one used last at the end.
    kept: Vec<Kept>,
    most: usize,
}

/// A superblock's texels, row by row.
#[derive(Debug)]
struct Kept {
    place: (u32, u32),
    width: u32,
    samples: Vec<u16>,
}

impl<'a> BlockSampler<'a> {
    /// Reads `texture` and keeps at most `superblocks` of it, at least one.
    #[must_use]
    pub fn new(texture: &'a BlockTexture, superblocks: usize) -> Self {
        let base = texture.whole_base();
        BlockSampler { texture, base, around: Around::default(), kept: Vec::new(), most: superblocks.max(1) }
    }

    /// The channels of a texel; `None` outside of the image.
    pub fn texel(&mut self, x: u32, y: u32) -> Option<&[u16]> {
        let form = self.texture.form();
        if x >= form.size.width || y >= form.size.height {
            return None;
        }
        let (channels, log2) = (form.channels(), form.superblock_log2);
        let place = (x >> log2, y >> log2);
        match self.kept.iter().position(|kept| kept.place == place) {
            Some(at) => self.kept[at..].rotate_left(1),
            None => self.decode(place),
        }
        let kept = self.kept.last()?;
        let (column, row) = (x - (place.0 << log2), y - (place.1 << log2));
        kept.samples.get((row * kept.width + column) as usize * channels..)?.get(..channels)
    }

    fn decode(&mut self, place: (u32, u32)) {
        let form = self.texture.form();
        let side = 1u32 << form.superblock_log2;
        let width = (form.size.width - place.0 * side).min(side);
        let height = (form.size.height - place.1 * side).min(side);
        // The buffer of the superblock that has not been used for longest.
        let mut samples = if self.kept.len() < self.most { Vec::new() } else { self.kept.remove(0).samples };
        samples.resize((width * height) as usize * form.channels(), 0);
        self.texture.decode_superblock(place, self.base.as_ref(), &mut self.around, &mut samples);
        self.kept.push(Kept { place, width, samples });
    }
}

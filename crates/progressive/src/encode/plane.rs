//! Planes as content of other codecs: coded at a price of bits, each block with a weight, and none blended with its neighbours,
//! which are not those that it has in a picture.

use texfold_bc::Content;
use texfold_core::Effort;
use texfold_core::image::{ImageSet, Raster};

use super::CLASS_BITS;
use super::base::{Base, Ground, Kind, plane_kinds};
use super::coder::Coder;
use super::draft::{CROWD, share_of_largest};
use super::frame::Frame;
use super::model::{Reach, train};
use crate::rates::Model;
use crate::{ProgressiveTexture, Shared};

/// A base and a model that suit a picture at some price of bits.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneForm {
    kind: Kind,
    model: Model,
}

impl PlaneForm {
    /// What stores `image` with the least error + `lambda` x bits, where errors are squared ones in 8-bit units over all
    /// channels; `None` where its pixels have alpha or are normals, or no plane could hold it.
    #[must_use]
    pub fn suited(image: &Raster, lambda: f32, effort: Effort) -> Option<PlaneForm> {
        let source = ImageSet::single(image.clone());
        let mut best: Option<(f64, PlaneForm)> = None;
        for kind in plane_kinds(source.info()) {
            let Some(base) = base(&source, std::slice::from_ref(image), kind, effort) else { continue };
            for class_bits in CLASS_BITS {
                let model = train(&base.blocks, class_bits, lambda, Reach::Far);
                let coder = Coder::new(&base.blocks, model, Effort::Fast);
                let classes = coder.choose(lambda);
                let bits = base.bits(&coder, &classes) as f64;
                let cost = coder.error_of(&classes, &base.counted) + f64::from(lambda) * bits;
                if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                    best = Some((cost, PlaneForm { kind, model: coder.model }));
                }
                if share_of_largest(&classes) <= CROWD {
                    break;
                }
            }
        }
        best.map(|(_, form)| form)
    }

    /// How the base is stored.
    #[must_use]
    pub fn content(&self) -> Content {
        self.kind.content
    }

    /// Bits in memory that a block of 8x8 texels of that class takes, with its share of the base.
    #[must_use]
    pub fn block_bits(&self, image: &Raster, class: u8) -> f32 {
        let base = self.kind.content.bits_per_texel(image.info()) as f32 * 64.0;
        let header =
            32.0 * crate::decode::TEXFOLD_PROGRESSIVE_GROUP_WORDS as f32 / crate::encoded::GROUP as f32;
        base / (1u32 << (2 * self.kind.reduce_log2)) as f32
            + header
            + (self.model.class_bits * u32::from(class)) as f32
    }

    /// `levels`, a picture and its mip levels, stored where a bit is worth `lambda`; the errors of the blocks of level 0, row by
    /// row, count by `weights`, all by 1 where there are none. `None` where no plane can hold them.
    #[must_use]
    pub fn encode(
        &self,
        levels: &[Raster],
        lambda: f32,
        weights: &[f32],
        effort: Effort,
    ) -> Option<ProgressiveTexture> {
        let source = ImageSet::single(levels.first()?.clone());
        let base = base(&source, levels, self.kind, effort)?;
        let mut coder = Coder::new(&base.blocks, self.model.clone(), effort);
        let mut all = weights.to_vec();
        all.resize(base.blocks.len(), 1.0);
        let classes = coder.choose_weighted(lambda, &all);
        coder.code_some(0..base.blocks.len(), &classes);
        // What coding has shown moves bits among the blocks.
        let classes = coder.choose_weighted(lambda, &all);
        coder.code_some(0..base.blocks.len(), &classes);
        base.assemble(&coder, &classes).ok()
    }
}

fn base(source: &ImageSet, levels: &[Raster], kind: Kind, effort: Effort) -> Option<Base> {
    let full = source.layout(levels.len() as u32);
    let frame = Frame { full, shrink_log2: 0, chains: vec![levels.to_vec()], around: None, floor: 0.0 };
    Ground::new(&frame, kind, (effort, &Shared::default()))?.base(&frame, 0)
}

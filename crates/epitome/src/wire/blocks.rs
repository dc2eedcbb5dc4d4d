//! An epitome and coarse mip levels in blocks of variable length: sections of block content 0, the epitome, and where there are
//! coarse levels, of block content 1.

use texfold_core::container::ContentId;
use texfold_core::container::{SectionWriter, Sections};
use texfold_core::{Budget, ImageLayout, ImageSize, LoadError, Texel};
use texfold_dct::DctContent;

use super::form::{EpitomeForm, Form};
use crate::parts::{BlockParts, coarse_layout, epitome_layout};

const EPITOME: ContentId = ContentId::ONLY;
const COARSE: ContentId = ContentId::SECOND;

pub(super) fn store_blocks(blocks: &BlockParts, out: &mut SectionWriter) {
    blocks.epitome.store_as("epitome", EPITOME, out);
    if let Some(coarse) = &blocks.coarse {
        coarse.store_as("mips", COARSE, out);
    }
}

/// Reads what [`store_blocks`] wrote, where the form says that it is there.
pub(super) fn read_blocks(
    file: &Sections<'_>,
    form: &Form,
    images: &ImageLayout,
    budget: &mut Budget,
) -> Result<Option<BlockParts>, LoadError> {
    let Some(&EpitomeForm { width, height, .. }) = form.epitomes.last().filter(|_| form.in_blocks) else {
        return Ok(None);
    };
    let layout = epitome_layout(ImageSize { width, height }, images);
    let epitome = load_content(&layout, EPITOME, file, budget)?;
    let coarse = coarse_layout(images);
    let coarse = coarse.map(|layout| load_content(&layout, COARSE, file, budget)).transpose()?;
    Ok(Some(BlockParts { epitome, coarse }))
}

/// Content of those images; all of it, as such a texture has no layers.
fn load_content(
    layout: &ImageLayout,
    id: ContentId,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<DctContent, LoadError> {
    let content = DctContent::load_whole(layout, id, file, budget)?;
    // The texels that the CPU reads, when they are made, and as many while they are.
    budget.take(2 * layout.texels() * size_of::<Texel>() as u64)?;
    Ok(content)
}

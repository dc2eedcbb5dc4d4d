//! A file of one layer: how blocks are split ("EPTR"), entries ("EPEN"), planes of the epitomes ("EPAT").

use texfold_core::container::ContentId;
use texfold_core::container::{Reader, SectionWriter, Sections};
use texfold_core::{Budget, ImageLayout, ImageSize, LoadError, String4};
use texfold_residual::ResidualContent;

use super::blocks::{read_blocks, store_blocks};
use super::form::{EpitomeForm, Form, Head};
use super::map::{Leaves, count_leaves, entry_bytes, laid_out, read_entries};
use super::planes::{plane_bytes, read_coarse, read_planes, store_coarse};
use crate::format::LayerMap;
use crate::parts::{PLANE_MIPS, Parts};

const TREE_ID: [u8; 4] = *b"EPTR";
const ENTRY_ID: [u8; 4] = *b"EPEN";
const PLANE_ID: [u8; 4] = *b"EPAT";
/// The residual content of a file.
const CONTENT: ContentId = ContentId::ONLY;

pub(super) fn store_whole(parts: &Parts, out: &mut SectionWriter) {
    let map = parts.map.unpacked(&parts.format);
    out.section("map", TREE_ID, &map.trees);
    out.section("map", ENTRY_ID, &entry_bytes(&map.entries, |_| true));
    if !parts.epitomes.is_empty() {
        out.section("epitome", PLANE_ID, &plane_bytes(parts.epitomes.iter().flatten()));
    }
    if let Some(errors) = &parts.errors {
        errors.store_base(CONTENT, out);
        errors.store_planes(CONTENT, out);
    }
    if let Some(blocks) = &parts.blocks {
        store_blocks(blocks, out);
    }
    store_coarse(parts, out);
}

pub(super) fn load_whole(file: &Sections<'_>, head: Head, budget: &mut Budget) -> Result<Parts, LoadError> {
    let Head { layout, form, palettes } = head;
    let trees = file.read(TREE_ID, budget)?;
    let count = count_leaves(TREE_ID, &trees, &form.format, &layout)?;
    let raw = file.read(ENTRY_ID, budget)?;
    let entries = read_entries(ENTRY_ID, &raw, Leaves { before: None, trees: &trees, count }, &form, budget)?;
    let map = LayerMap { trees, entries };
    let map = laid_out(&form.format, &palettes, &map, budget)?;
    let mut epitomes = Vec::new();
    let plain = form.plain();
    if !plain.is_empty() {
        let raw = file.read(PLANE_ID, budget)?;
        let mut reader = Reader::new(String4(PLANE_ID), &raw);
        for epitome in plain {
            let sizes = form.level_sizes(epitome);
            epitomes.push(read_planes(&mut reader, epitome.content, &layout, sizes, budget)?);
        }
        reader.end()?;
    }
    let errors = read_errors(file, &form, &layout, budget)?.map(Box::new);
    let blocks = read_blocks(file, &form, &layout, budget)?.map(Box::new);
    let coarse = if form.in_blocks { Vec::new() } else { read_coarse(file, &form, &layout, budget)? };
    Ok(Parts { layout, format: form.format, palettes, map, epitomes, errors, coarse, blocks, layering: None })
}

/// The epitome with a residual plane, where there is one.
fn read_errors(
    file: &Sections<'_>,
    form: &Form,
    layout: &ImageLayout,
    budget: &mut Budget,
) -> Result<Option<ResidualContent>, LoadError> {
    let Some(&EpitomeForm { width, height, .. }) = form.epitomes.last().filter(|_| form.errors) else {
        return Ok(None);
    };
    let levels = if form.mips { 1 + PLANE_MIPS } else { 1 };
    let size = ImageSize { width, height };
    let layout = ImageLayout::new(vec![size], levels, layout.pixel);
    // Its texels are decoded when the texture is laid out.
    budget.take(2 * size.texels() * size_of::<texfold_core::Texel>() as u64)?;
    let content = ResidualContent::load_whole(&layout, CONTENT, file, budget)?;
    if content.form().shrink_log2 > 0 {
        let what = "residual content whose levels are not all stored";
        return Err(LoadError::Corrupt {
            section: String4(ResidualContent::form_section(CONTENT)),
            offset: 0,
            what,
        });
    }
    Ok(Some(content))
}

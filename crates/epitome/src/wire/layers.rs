//! A file of several layers ("EPLA"), each with what it adds to those before it: "EPT0" (how blocks are split),
//! "EPE0" (entries), "EPC0" (cells that it brings), "EPA0" (what they hold) and so on.

use texfold_bc::ContentPlanes;
use texfold_core::container::{Reader, SectionWriter, Sections};
use texfold_core::{Budget, LoadError, String4};

use super::form::{EpitomeForm, FORM_ID, Form, Head, read_head};
use super::map::{Leaves, count_leaves, entry_bytes, laid_out, read_bits, read_entries};
use super::planes::{blank_planes, read_coarse, store_coarse};
use crate::format::LayerMap;
use crate::layers::{CellLayers, cell_bytes, columns_of, edited, gather, layer_names, layers_at, numbers};
use crate::layers::{Layering, MAX_LAYERS};
use crate::map::{CoarserMap, MapPlane, pack_bits, same_leaves};
use crate::parts::Parts;

const LAYERS_ID: [u8; 4] = *b"EPLA";

/// Id of a layer's section of that kind: trees, entries, cells, planes.
fn layer_id(kind: u8, layer: u32) -> [u8; 4] {
    [b'E', b'P', kind, b'0' + layer as u8]
}

/// Ids of all sections of a layer. The last layer brings all cells that are left and needs no list of them.
fn layer_ids(layer: u32, total: u32) -> impl Iterator<Item = [u8; 4]> {
    let kinds: &[u8] = if layer + 1 < total { b"TECA" } else { b"TEA" };
    kinds.iter().map(move |&kind| layer_id(kind, layer))
}

/// Whether a file has several layers.
pub(super) fn is_layered(file: &Sections<'_>) -> bool {
    file.ids().any(|(id, _)| id == LAYERS_ID)
}

pub(super) fn store_layers(parts: &Parts, layering: &Layering, out: &mut SectionWriter) {
    let rows = layering.rows.iter().flat_map(|rows| rows.to_le_bytes());
    let raw: Vec<u8> = std::iter::once(layering.total as u8).chain(rows).collect();
    out.section("container", LAYERS_ID, &raw);
    store_coarse(parts, out);
    for layer in 0..layering.loaded() {
        store_layer(parts, layering, layer, out);
    }
}

/// What a layer adds to those before it.
fn store_layer(parts: &Parts, layering: &Layering, layer: u32, out: &mut SectionWriter) {
    let (map, epitome) = layer_names(layer);
    let LayerMap { trees, entries } = parts.map_of(layer);
    let before = layer.checked_sub(1).map(|before| parts.map_of(before));
    let mut changes = trees.clone();
    if let Some(before) = &before {
        changes.iter_mut().zip(&before.trees).for_each(|(tree, before)| *tree ^= before);
    }
    out.section(map, layer_id(b'T', layer), &changes);
    let same = same_leaves(before.as_ref().map(|before| before.trees.as_slice()), &trees, entries.len());
    let old = |leaf: usize| before.as_ref().zip(same[leaf]).and_then(|(before, old)| before.entries.get(old));
    let kept: Vec<bool> = (0..entries.len()).map(|leaf| old(leaf) == Some(&entries[leaf])).collect();
    let mut raw = pack_bits((0..entries.len()).filter(|&leaf| same[leaf].is_some()).map(|leaf| kept[leaf]));
    raw.extend(entry_bytes(&entries, |leaf| !kept[leaf]));
    out.section(map, layer_id(b'E', layer), &raw);
    let cells: Vec<Vec<u8>> = layering.cells.iter().map(CellLayers::unpacked).collect();
    if layer + 1 < layering.total {
        let left = cells.iter().flatten().filter(|&&cell| u32::from(cell) >= layer);
        out.section(epitome, layer_id(b'C', layer), &pack_bits(left.map(|&cell| u32::from(cell) == layer)));
    }
    let mut raw = Vec::new();
    for (levels, cells) in parts.epitomes.iter().zip(&cells) {
        for (level, planes) in (0..).zip(levels) {
            let brought = numbers(&layers_at(cells, columns_of(levels), level), |of| u32::from(of) == layer);
            gather(planes, &brought, &mut raw);
        }
    }
    out.section(epitome, layer_id(b'A', layer), &raw);
}

/// The layers that are whole: at least the first.
pub(super) fn load_layers(file: &Sections<'_>, head: Head, budget: &mut Budget) -> Result<Parts, LoadError> {
    if head.form.errors || head.form.in_blocks {
        let what = "layers of content with a residual plane";
        return Err(LoadError::Corrupt { section: String4(FORM_ID), offset: 0, what });
    }
    let (total, rows) = read_layers(file, &head.form, budget)?;
    let Head { layout, form, palettes } = head;
    let coarse = read_coarse(file, &form, &layout, budget)?;
    let (mut epitomes, mut cells) = (Vec::new(), Vec::new());
    for epitome in &form.epitomes {
        let &EpitomeForm { content, width, height } = epitome;
        epitomes.push(blank_planes(content, &layout, form.level_sizes(epitome), budget)?);
        let all = budget.zeroed(u64::from(width / 4) * u64::from(height / 4))?;
        cells.push(CellLayers::new(&all, total));
    }
    let layering = Some(Box::new(Layering { total, rows, coarser: Vec::new(), cells }));
    let map = MapPlane::new(&form.format, &palettes, &LayerMap::default());
    let mut parts = Parts {
        layout,
        format: form.format,
        palettes,
        map,
        epitomes,
        errors: None,
        coarse,
        blocks: None,
        layering,
    };
    for layer in 0..total {
        // A file may end between layers; a later layer without one before it is of no use.
        if layer > 0 && !layer_ids(layer, total).all(|id| file.has(id)) {
            break;
        }
        add_layer(&mut parts, &form, layer, file, budget)?;
    }
    Ok(parts)
}

/// Number of layers, and rows of each epitome that the finest layer reads.
fn read_layers(file: &Sections<'_>, form: &Form, budget: &mut Budget) -> Result<(u32, Vec<u32>), LoadError> {
    let raw = file.read(LAYERS_ID, budget)?;
    let mut reader = Reader::new(String4(LAYERS_ID), &raw);
    let total = u32::from(reader.u8()?);
    if !(2..=MAX_LAYERS).contains(&total) {
        return Err(reader.corrupt("layers outside 2..=8"));
    }
    let mut rows = Vec::new();
    for &EpitomeForm { height, .. } in &form.epitomes {
        let read = reader.u32()?;
        if !read.is_multiple_of(form.step()) || !(form.step()..=height).contains(&read) {
            return Err(reader.corrupt("rows that the epitome has not"));
        }
        rows.push(read);
    }
    reader.end()?;
    Ok((total, rows))
}

/// Adds the layer of that number to those before it. Where it fails the parts are those of no file.
fn add_layer(
    parts: &mut Parts,
    form: &Form,
    layer: u32,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<(), LoadError> {
    let map = read_map(parts, form, layer, file, budget)?;
    let Some(layering) = &mut parts.layering else { return Ok(()) };
    if layer > 0 {
        let before = parts.map.unpacked(&parts.format);
        budget.take(u64::from(parts.format.entry_bytes()) * before.entries.len() as u64)?;
        layering.coarser.push(CoarserMap::new(&parts.format, &before, &map));
    }
    parts.map = laid_out(&parts.format, &parts.palettes, &map, budget)?;
    let mut brought: Vec<Vec<u8>> = layering.cells.iter().map(CellLayers::unpacked).collect();
    if layer + 1 < layering.total {
        let id = layer_id(b'C', layer);
        let raw = file.read(id, budget)?;
        let mut reader = Reader::new(String4(id), &raw);
        let left = brought.iter().flatten().filter(|of| u32::from(**of) == layer).count();
        let bits = read_bits(&mut reader, left)?;
        let left = brought.iter_mut().flatten().filter(|of| u32::from(**of) == layer);
        left.zip(bits).for_each(|(of, here)| *of += u8::from(!here));
        reader.end()?;
    }
    let id = layer_id(b'A', layer);
    let raw = file.read(id, budget)?;
    let mut reader = Reader::new(String4(id), &raw);
    let mut epitomes = Vec::new();
    for (levels, cells) in parts.epitomes.iter().zip(&brought) {
        let mut filled = Vec::new();
        for (level, planes) in (0..).zip(levels) {
            let cells = numbers(&layers_at(cells, columns_of(levels), level), |of| u32::from(of) == layer);
            let size: usize = planes.planes().iter().map(|(format, _)| cell_bytes(*format)).sum();
            let bytes = reader.bytes(size * cells.len())?;
            filled.push(edited(planes, &cells, |place, start| {
                if let Some(bytes) = bytes.get(start..start + place.len()) {
                    place.copy_from_slice(bytes);
                }
            }));
        }
        epitomes.push(filled);
    }
    reader.end()?;
    layering.cells = brought.iter().map(|cells| CellLayers::new(cells, layering.total)).collect();
    parts.epitomes = epitomes;
    Ok(())
}

/// The map of a layer, where those before it are there.
fn read_map(
    parts: &Parts,
    form: &Form,
    layer: u32,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<LayerMap, LoadError> {
    let before = layer.checked_sub(1).map(|before| parts.map_of(before));
    let id = layer_id(b'T', layer);
    let mut trees = file.read(id, budget)?;
    if let Some(before) = &before {
        trees.iter_mut().zip(&before.trees).for_each(|(tree, before)| *tree ^= before);
    }
    let leaves = count_leaves(id, &trees, &form.format, &parts.layout)?;
    let id = layer_id(b'E', layer);
    let raw = file.read(id, budget)?;
    let leaves = Leaves { before: before.as_ref(), trees: &trees, count: leaves };
    let entries = read_entries(id, &raw, leaves, form, budget)?;
    Ok(LayerMap { trees, entries })
}

/// The parts with one further layer from a longer prefix of the same file; `None` where all are there.
pub(crate) fn next_layer(
    parts: &Parts,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Option<Parts>, LoadError> {
    let Some(layering) = parts.layering.as_ref().filter(|layering| layering.loaded() < layering.total) else {
        return Ok(None);
    };
    let head = read_head(file, budget)?;
    let layers = read_layers(file, &head.form, budget)?;
    let sizes = parts.epitomes.iter().flat_map(|levels| levels.first());
    let form_of = |base: &ContentPlanes| {
        let (width, height) = base.size();
        EpitomeForm { content: base.content(), width, height }
    };
    let sizes: Vec<EpitomeForm> = sizes.map(form_of).collect();
    let first = read_map(parts, &head.form, 0, file, budget)?;
    let same = (&head.layout, head.form.format, &head.palettes)
        == (&parts.layout, parts.format, &parts.palettes)
        && (head.form.epitomes.as_slice(), layers)
            == (sizes.as_slice(), (layering.total, layering.rows.clone()))
        && first == parts.map_of(0);
    if !same {
        let what = "it is not of the file whose layers are there";
        return Err(LoadError::Corrupt { section: String4(LAYERS_ID), offset: 0, what });
    }
    let mut next = parts.clone();
    add_layer(&mut next, &head.form, layering.loaded(), file, budget)?;
    Ok(Some(next))
}

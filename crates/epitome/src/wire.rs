//! Sections of an `epitome` file: "EPFM" (form of the map and the planes), "EPPL" (linear parts and tones), "EPTR" (how
//! blocks are split), "EPEN" (entries, field by field, positions as what differs from the leaf before), "EPAT" (planes of
//! the epitomes), "EPMC" (coarse mip levels). A progressive file has "EPLA" (number of layers) and, instead of "EPTR", "EPEN"
//! and "EPAT", for each layer "EPT0", "EPE0", "EPC0" (cells that it brings), "EPA0" and so on.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Notes, Reader, SectionWriter, Sections, read_layout};
use texfold_core::{Budget, ImageLayout, LoadError, MAX_PLANE_SIDE, String4, SurfaceSize};
use texfold_residual::{BLOCK_SIDE, ContentId, ResidualContent};

use crate::encoded::{
    Entry, EpitomeTexture, LEAST_STRIP, Linear, MAX_BLOCK, MapFormat, PLANE_MIPS, Parts, Tone, blocks_of,
    coarse_content, coarse_levels, epitome_size, leaves_of,
};
use crate::layers::{
    LayerMap, Layering, MAX_LAYERS, MapRef, cell_bytes, columns_of, edited, gather, layer_names, layers_at,
    numbers, same_leaves,
};

const FORM_ID: [u8; 4] = *b"EPFM";
const PALETTE_ID: [u8; 4] = *b"EPPL";
const TREE_ID: [u8; 4] = *b"EPTR";
const ENTRY_ID: [u8; 4] = *b"EPEN";
const PLANE_ID: [u8; 4] = *b"EPAT";
/// The residual content of a file.
const CONTENT: ContentId = ContentId::ONLY;
const COARSE_ID: [u8; 4] = *b"EPMC";
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

/// Most entries and most blocks: the map plane, with up to one and a half words an entry, has at most 8192 x 8192 words.
pub(crate) const MAX_ENTRIES: u64 = 1 << 25;
/// Flag of an epitome with an error map.
const ERRORS_FLAG: u32 = 2;
/// Flag of leaves that are blended in wider strips than between their outermost texels.
const STRIP_FLAG: u32 = 4;
/// Flag of coarse mip levels in BC7 beside an epitome in BC1.
const COARSE_FLAG: u32 = 8;
/// Blocks of these sides are allowed.
const BLOCK_SIDES: std::ops::RangeInclusive<u32> = 4..=MAX_BLOCK as u32;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let format = &parts.format;
    let mips = parts.layout.levels > 1;
    let is_wide = format.strip > LEAST_STRIP;
    let flags = u32::from(mips)
        | if parts.errors.is_some() { ERRORS_FLAG } else { 0 }
        | if is_wide { STRIP_FLAG } else { 0 }
        | if parts.has_finer_coarse() { COARSE_FLAG } else { 0 };
    let mut form: Vec<u8> = [
        format.block,
        u32::from(format.split),
        format.x_bits,
        format.y_bits,
        format.fraction_bits,
        format.tone_bits,
        format.linear_bits,
        flags,
        (parts.epitomes.len() + usize::from(parts.errors.is_some())) as u32,
    ]
    .map(|value| value as u8)
    .to_vec();
    for epitome in &parts.epitomes {
        let Some(base) = epitome.first() else { continue };
        let number = base.content().number();
        form.push(number);
        form.extend(base.size().0.to_le_bytes());
        form.extend(base.size().1.to_le_bytes());
    }
    if let Some(errors) = &parts.errors {
        form.push(errors.form().content.number());
        form.extend(epitome_size(errors).iter().flat_map(|side| side.to_le_bytes()));
    }
    form.extend((parts.linears.len() as u32).to_le_bytes());
    form.extend((parts.tones.len() as u32).to_le_bytes());
    form.extend(is_wide.then_some(format.strip as u8));
    out.section("container", FORM_ID, &form);
    let linears = parts.linears.iter().flatten().flat_map(|value| value.to_le_bytes());
    let palettes: Vec<u8> = linears.chain(parts.tones.iter().flatten().copied()).collect();
    out.section("map", PALETTE_ID, &palettes);
    match &parts.layering {
        None => {
            out.section("map", TREE_ID, &parts.trees);
            out.section("map", ENTRY_ID, &entry_bytes(&parts.entries, |_| true));
            if !parts.epitomes.is_empty() {
                out.section("epitome", PLANE_ID, &plane_bytes(parts.epitomes.iter().flatten()));
            }
            if let Some(errors) = &parts.errors {
                errors.store_base(CONTENT, out);
                errors.store_planes(CONTENT, out);
            }
            store_coarse(parts, out);
        }
        Some(layering) => {
            let rows = layering.rows.iter().flat_map(|rows| rows.to_le_bytes());
            let raw: Vec<u8> = std::iter::once(layering.total as u8).chain(rows).collect();
            out.section("container", LAYERS_ID, &raw);
            store_coarse(parts, out);
            for layer in 0..layering.loaded() {
                store_layer(parts, layering, layer, out);
            }
        }
    }
}

impl Parts {
    /// Whether the coarse mip levels are in BC7, the epitome in BC1.
    fn has_finer_coarse(&self) -> bool {
        let coarse = self.coarse.first().and_then(|levels| levels.first());
        let base = self.epitomes.first().and_then(|levels| levels.first());
        let base = base.map(ContentPlanes::content);
        let base = base.or(self.errors.as_ref().map(|errors| errors.form().content));
        base == Some(Content::Bc1) && coarse.is_some_and(|coarse| coarse.content() == Content::Bc7)
    }
}

fn plane_bytes<'a>(levels: impl Iterator<Item = &'a ContentPlanes>) -> Vec<u8> {
    levels.flat_map(|level| level.planes()).flat_map(|(_, bytes)| bytes).copied().collect()
}

fn store_coarse(parts: &Parts, out: &mut SectionWriter) {
    if parts.coarse.iter().any(|levels| !levels.is_empty()) {
        out.section("mips", COARSE_ID, &plane_bytes(parts.coarse.iter().flatten()));
    }
}

/// What a layer adds to those before it.
fn store_layer(parts: &Parts, layering: &Layering, layer: u32, out: &mut SectionWriter) {
    let (map, epitome) = layer_names(layer);
    let (trees, entries) = parts.map_of(layer);
    let before = layer.checked_sub(1).map(|before| parts.map_of(before));
    let mut changes = trees.to_vec();
    if let Some((before, _)) = before {
        changes.iter_mut().zip(before).for_each(|(tree, before)| *tree ^= before);
    }
    out.section(map, layer_id(b'T', layer), &changes);
    let same = same_leaves(before.map(|before| before.0), trees, entries.len());
    let old = |leaf: usize| before.zip(same[leaf]).and_then(|((_, entries), old)| entries.get(old));
    let kept: Vec<bool> = (0..entries.len()).map(|leaf| old(leaf) == Some(&entries[leaf])).collect();
    let mut raw = pack_bits((0..entries.len()).filter(|&leaf| same[leaf].is_some()).map(|leaf| kept[leaf]));
    raw.extend(entry_bytes(entries, |leaf| !kept[leaf]));
    out.section(map, layer_id(b'E', layer), &raw);
    if layer + 1 < layering.total {
        let left = layering.cells.iter().flatten().filter(|&&cell| u32::from(cell) >= layer);
        out.section(epitome, layer_id(b'C', layer), &pack_bits(left.map(|&cell| u32::from(cell) == layer)));
    }
    let mut raw = Vec::new();
    for (levels, cells) in parts.epitomes.iter().zip(&layering.cells) {
        for (level, planes) in (0..).zip(levels) {
            let brought = numbers(&layers_at(cells, columns_of(levels), level), |of| u32::from(of) == layer);
            gather(planes, &brought, &mut raw);
        }
    }
    out.section(epitome, layer_id(b'A', layer), &raw);
}

/// Eight bits a byte, the first in bit 0.
fn pack_bits(bits: impl Iterator<Item = bool>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (index, bit) in bits.enumerate() {
        if index % 8 == 0 {
            bytes.push(0);
        }
        if let Some(byte) = bytes.last_mut() {
            *byte |= u8::from(bit) << (index % 8);
        }
    }
    bytes
}

/// `count` bits as [`pack_bits`] packs them.
fn read_bits(reader: &mut Reader<'_>, count: usize) -> Result<Vec<bool>, LoadError> {
    let bytes = reader.bytes(count.div_ceil(8))?;
    let bit = |index: usize| bytes[index / 8] >> (index % 8) & 1 == 1;
    if (count..8 * bytes.len()).any(bit) {
        return Err(reader.corrupt("bits after the last"));
    }
    Ok((0..count).map(bit).collect())
}

/// The entries of leaves that are `wanted`, byte plane by byte plane: equal bytes stand together, which compresses better.
fn entry_bytes(entries: &[Entry], wanted: impl Fn(usize) -> bool) -> Vec<u8> {
    let mut planes: [Vec<u8>; 7] = Default::default();
    let (mut x, mut y) = (0u32, 0u32);
    for (leaf, entry) in entries.iter().enumerate() {
        let across = (entry.x.wrapping_sub(x) as u16).to_le_bytes();
        let down = (entry.y.wrapping_sub(y) as u16).to_le_bytes();
        (x, y) = (entry.x, entry.y);
        if !wanted(leaf) {
            continue;
        }
        let bytes =
            [across[0], across[1], down[0], down[1], entry.tone as u8, entry.linear as u8, entry.plane as u8];
        for (plane, byte) in planes.iter_mut().zip(bytes) {
            plane.push(byte);
        }
    }
    planes.concat()
}

/// What all layers share.
struct Head {
    layout: ImageLayout,
    form: Form,
    linears: Vec<Linear>,
    tones: Vec<Tone>,
}

fn read_head(file: &Sections<'_>, budget: &mut Budget) -> Result<Head, LoadError> {
    let layout = read_layout(file, budget)?;
    let raw = file.read(FORM_ID, budget)?;
    let form = read_form(&mut Reader::new(String4(FORM_ID), &raw), &layout)?;
    let raw = file.read(PALETTE_ID, budget)?;
    let (linears, tones) = read_palettes(&mut Reader::new(String4(PALETTE_ID), &raw), &form)?;
    Ok(Head { layout, form, linears, tones })
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<EpitomeTexture, LoadError> {
    let notes = Notes::read(file, budget)?;
    let head = read_head(file, budget)?;
    let layered = file.ids().any(|(id, _)| id == LAYERS_ID);
    if layered && head.form.errors {
        let what = "layers of content with an error map";
        return Err(LoadError::Corrupt { section: String4(FORM_ID), offset: 0, what });
    }
    let parts = if layered { load_layers(file, head, budget)? } else { load_whole(file, head, budget)? };
    Ok(EpitomeTexture::new(parts, notes))
}

fn load_whole(file: &Sections<'_>, head: Head, budget: &mut Budget) -> Result<Parts, LoadError> {
    let Head { layout, form, linears, tones } = head;
    let trees = file.read(TREE_ID, budget)?;
    let leaves = count_leaves(TREE_ID, &trees, &form.format, &layout)?;
    let raw = file.read(ENTRY_ID, budget)?;
    let entries = read_entries((ENTRY_ID, &raw), leaves, (None, &trees), &form, budget)?;
    let mut epitomes = Vec::new();
    let plain = form.plain();
    if !plain.is_empty() {
        let raw = file.read(PLANE_ID, budget)?;
        let mut reader = Reader::new(String4(PLANE_ID), &raw);
        for &(content, width, height) in plain {
            let sizes = form.level_sizes(width, height);
            epitomes.push(read_planes(&mut reader, content, &layout, sizes, budget)?);
        }
        reader.end()?;
    }
    let errors = read_errors(file, &form, &layout, budget)?.map(Box::new);
    let coarse = read_coarse(file, &form, &layout, budget)?;
    budget.take(8 * (trees.len() + entries.len()) as u64)?;
    let format = form.format;
    Ok(Parts { layout, format, trees, entries, linears, tones, epitomes, errors, coarse, layering: None })
}

/// The epitome with an error map, where there is one.
fn read_errors(
    file: &Sections<'_>,
    form: &Form,
    layout: &ImageLayout,
    budget: &mut Budget,
) -> Result<Option<ResidualContent>, LoadError> {
    let Some(&(_, width, height)) = form.epitomes.last().filter(|_| form.errors) else { return Ok(None) };
    let levels = if form.mips { 1 + PLANE_MIPS } else { 1 };
    let size = SurfaceSize { width, height };
    let layout = ImageLayout { surfaces: vec![size], levels, pixel: layout.pixel };
    // Its texels are decoded when the texture is laid out.
    budget.take(2 * size.texels() * size_of::<texfold_core::Texel>() as u64)?;
    let content = ResidualContent::load_whole(&layout, CONTENT, file, budget)?;
    if content.form().shrink_log2 > 0 {
        let what = "residual content whose levels are not all stored";
        return Err(LoadError::Corrupt { section: String4(CONTENT.form()), offset: 0, what });
    }
    Ok(Some(content))
}

/// The layers that are whole: at least the first.
fn load_layers(file: &Sections<'_>, head: Head, budget: &mut Budget) -> Result<Parts, LoadError> {
    let (total, rows) = read_layers(file, &head.form, budget)?;
    let Head { layout, form, linears, tones } = head;
    let coarse = read_coarse(file, &form, &layout, budget)?;
    let (mut epitomes, mut cells) = (Vec::new(), Vec::new());
    for &(content, width, height) in &form.epitomes {
        epitomes.push(blank_planes(content, &layout, form.level_sizes(width, height), budget)?);
        cells.push(budget.zeroed(u64::from(width / 4) * u64::from(height / 4))?);
    }
    let layering = Some(Box::new(Layering { total, rows, coarser: Vec::new(), cells }));
    let (trees, entries, format) = (Vec::new(), Vec::new(), form.format);
    let mut parts =
        Parts { layout, format, trees, entries, linears, tones, epitomes, errors: None, coarse, layering };
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
    for &(_, _, height) in &form.epitomes {
        let read = reader.u32()?;
        if !read.is_multiple_of(form.step()) || !(form.step()..=height).contains(&read) {
            return Err(reader.corrupt("rows that the epitome has not"));
        }
        rows.push(read);
    }
    reader.end()?;
    Ok((total, rows))
}

/// Adds the layer of that number to those before it.
fn add_layer(
    parts: &mut Parts,
    form: &Form,
    layer: u32,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<(), LoadError> {
    let map = read_map(parts, form, layer, file, budget)?;
    let Some(layering) = &mut parts.layering else { return Ok(()) };
    let mut brought = layering.cells.clone();
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
    layering.cells = brought;
    if layer > 0 {
        let before =
            LayerMap { trees: std::mem::take(&mut parts.trees), entries: std::mem::take(&mut parts.entries) };
        layering.coarser.push(before);
    }
    (parts.trees, parts.entries, parts.epitomes) = (map.trees, map.entries, epitomes);
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
    if let Some((before, _)) = before {
        trees.iter_mut().zip(before).for_each(|(tree, before)| *tree ^= before);
    }
    let leaves = count_leaves(id, &trees, &form.format, &parts.layout)?;
    let id = layer_id(b'E', layer);
    let raw = file.read(id, budget)?;
    let entries = read_entries((id, &raw), leaves, (before, &trees), form, budget)?;
    budget.take(8 * (trees.len() + entries.len()) as u64)?;
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
    let sizes: Vec<_> = sizes.map(|base| (base.content(), base.size().0, base.size().1)).collect();
    let first = read_map(parts, &head.form, 0, file, budget)?;
    let same = (&head.layout, head.form.format, &head.linears, &head.tones)
        == (&parts.layout, parts.format, &parts.linears, &parts.tones)
        && (head.form.epitomes.as_slice(), layers)
            == (sizes.as_slice(), (layering.total, layering.rows.clone()))
        && (first.trees.as_slice(), first.entries.as_slice()) == parts.map_of(0);
    if !same {
        let what = "it is not of the file whose layers are there";
        return Err(LoadError::Corrupt { section: String4(LAYERS_ID), offset: 0, what });
    }
    let mut next = parts.clone();
    add_layer(&mut next, &head.form, layering.loaded(), file, budget)?;
    Ok(Some(next))
}

struct Form {
    format: MapFormat,
    mips: bool,
    /// Whether the epitome has an error map.
    errors: bool,
    /// Whether the coarse mip levels are in BC7, the epitome in BC1.
    finer: bool,
    epitomes: Vec<(Content, u32, u32)>,
    linears: u32,
    tones: u32,
}

impl Form {
    /// The epitomes without an error map.
    fn plain(&self) -> &[(Content, u32, u32)] {
        &self.epitomes[..self.epitomes.len() - usize::from(self.errors)]
    }

    /// Sizes of an epitome's levels.
    fn level_sizes(&self, width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> + use<> {
        let count = if self.mips { 1 + PLANE_MIPS } else { 1 };
        (0..count).map(move |level| (width >> level, height >> level))
    }

    /// Sides of epitomes are multiples of this.
    fn step(&self) -> u32 {
        if self.mips { 4 << PLANE_MIPS } else { 4 }
    }

    /// Whether the fields of the map can hold an entry, and the palettes have what it names.
    fn holds(&self, entry: &Entry) -> bool {
        entry.x >> self.format.x_bits == 0
            && entry.y >> self.format.y_bits == 0
            && entry.tone < self.tones
            && entry.linear < self.linears
            && entry.plane <= u32::from(self.format.mixed)
    }
}

fn read_form(reader: &mut Reader<'_>, layout: &ImageLayout) -> Result<Form, LoadError> {
    let mut field = |most: u8, what: &'static str| -> Result<u32, LoadError> {
        let value = reader.u8()?;
        if value > most { Err(reader.corrupt(what)) } else { Ok(u32::from(value)) }
    };
    let mut format = MapFormat {
        block: field(64, "a block above 64 texels")?,
        split: field(1, "a flag above 1")? == 1,
        x_bits: field(16, "a field above 16 bits")?,
        y_bits: field(16, "a field above 16 bits")?,
        fraction_bits: field(3, "a fraction above 3 bits")?,
        tone_bits: field(8, "a field above 8 bits")?,
        linear_bits: field(8, "a field above 8 bits")?,
        mixed: false,
        strip: LEAST_STRIP,
    };
    let flags = field(15, "a flag above 15")?;
    let (mips, errors) = (flags & 1 == 1, flags & ERRORS_FLAG != 0);
    let count = field(2, "more than two epitomes")?;
    format.mixed = count == 2;
    if count == 0
        || !BLOCK_SIDES.contains(&format.block)
        || !format.block.is_multiple_of(4)
        || format.entry_bytes() > 6
    {
        return Err(reader.corrupt("a map that no writer makes"));
    }
    let mut epitomes = Vec::new();
    for index in 1..=count {
        let content = Content::read(reader)?;
        let (width, height) = (reader.u32()?, reader.u32()?);
        let side = if errors && index == count { BLOCK_SIDE } else { content.cell_side() };
        let step = side << if mips { PLANE_MIPS } else { 0 };
        let fits = |side: u32| side.is_multiple_of(step) && (step..=MAX_PLANE_SIDE).contains(&side);
        if !fits(width) || !fits(height) || !content.fits(layout.pixel) {
            return Err(reader.corrupt("an epitome of a size or content that no writer makes"));
        }
        // Two epitomes are told apart by their texture, so each is one.
        if count == 2 && content.formats(layout.pixel).0.len() > 1 {
            return Err(reader.corrupt("two epitomes of several planes"));
        }
        epitomes.push((content, width, height));
    }
    let swizzle = |index: usize| epitomes.get(index).map(|(content, ..)| content.formats(layout.pixel).1);
    if count == 2 && swizzle(0) != swizzle(1) {
        return Err(reader.corrupt("two epitomes whose channels differ"));
    }
    let (linears, tones) = (reader.u32()?, reader.u32()?);
    let fits = |count: u32, bits: u32| (1..=1 << bits).contains(&count);
    if !fits(linears, format.linear_bits) || !fits(tones, format.tone_bits) {
        return Err(reader.corrupt("a palette longer than its numbers"));
    }
    if flags & STRIP_FLAG != 0 {
        format.strip = u32::from(reader.u8()?);
        // Half a leaf on each side of a border.
        if !(LEAST_STRIP + 1..=4 * format.cell()).contains(&format.strip) {
            return Err(reader.corrupt("a strip narrower than a texel or wider than a leaf"));
        }
    }
    reader.end()?;
    let finer = flags & COARSE_FLAG != 0;
    if finer && (coarse_levels(layout.levels).is_empty() || epitomes[0].0 != Content::Bc1) {
        return Err(reader.corrupt("finer coarse levels where no writer makes them"));
    }
    // The epitome's mip levels and the coarse chain are there together.
    if mips != (layout.levels > 1) {
        return Err(
            reader.corrupt("mip levels of the epitome without mip levels of the images, or the other way")
        );
    }
    Ok(Form { format, mips, errors, finer, epitomes, linears, tones })
}

fn read_palettes(reader: &mut Reader<'_>, form: &Form) -> Result<(Vec<Linear>, Vec<Tone>), LoadError> {
    let (mut linears, mut tones) = (Vec::new(), Vec::new());
    for _ in 0..form.linears {
        let mut linear: Linear = [0; 4];
        for value in &mut linear {
            *value = reader.u16()? as i16;
        }
        linears.push(linear);
    }
    for _ in 0..form.tones {
        tones.push(reader.array()?);
    }
    reader.end()?;
    Ok((linears, tones))
}

/// Checks the tree bytes against the layout; gives the number of leaves.
fn count_leaves(
    id: [u8; 4],
    trees: &[u8],
    format: &MapFormat,
    layout: &ImageLayout,
) -> Result<u64, LoadError> {
    let reader = Reader::new(String4(id), trees);
    let blocks: u64 = layout
        .surfaces
        .iter()
        .map(|&size| blocks_of(size, format.block))
        .map(|(columns, rows)| u64::from(columns) * u64::from(rows))
        .sum();
    let wanted = if format.split { blocks } else { 0 };
    if trees.len() as u64 != wanted {
        return Err(reader.corrupt("another number of blocks than the layout has"));
    }
    if trees.iter().any(|&tree| tree > 31 || (tree & 1 == 0 && tree != 0)) {
        return Err(reader.corrupt("a block split in a way that no writer makes"));
    }
    let split_needs = if format.split { 16 } else { 4 };
    if !format.block.is_multiple_of(split_needs) {
        return Err(reader.corrupt("blocks that cannot be split twice"));
    }
    let leaves =
        if format.split { trees.iter().map(|&tree| u64::from(leaves_of(tree))).sum() } else { blocks };
    if leaves > MAX_ENTRIES {
        Err(reader.corrupt("more leaves than an entry's number can tell"))
    } else {
        Ok(leaves)
    }
}

/// The entries of `leaves` leaves. Where there is a map before, leaves that stand in it too have a bit each, which says whether
/// the entry is the same.
fn read_entries(
    (id, raw): ([u8; 4], &[u8]),
    leaves: u64,
    (before, trees): (Option<MapRef<'_>>, &[u8]),
    form: &Form,
    budget: &mut Budget,
) -> Result<Vec<Entry>, LoadError> {
    let mut reader = Reader::new(String4(id), raw);
    if before.is_none() && raw.len() as u64 != 7 * leaves {
        return Err(reader.corrupt("another number of leaves than the blocks have"));
    }
    budget.take(leaves * size_of::<(Entry, Option<usize>)>() as u64)?;
    let mut same = same_leaves(before.map(|before| before.0), trees, leaves as usize);
    let bits = read_bits(&mut reader, same.iter().flatten().count())?;
    for (leaf, is_same) in same.iter_mut().filter(|leaf| leaf.is_some()).zip(bits) {
        *leaf = leaf.filter(|_| is_same);
    }
    let count = same.iter().filter(|leaf| leaf.is_none()).count();
    let planes = reader.bytes(7 * count)?;
    reader.end()?;
    let byte = |plane: usize, index: usize| u32::from(planes[plane * count + index]);
    let (mut index, mut last) = (0, Entry::default());
    let mut entries = Vec::new();
    for leaf in same {
        let old = leaf.zip(before).and_then(|(leaf, (_, entries))| entries.get(leaf));
        last = match old {
            Some(old) => *old,
            None => {
                let x = last.x.wrapping_add(byte(0, index) | byte(1, index) << 8) & 0xffff;
                let y = last.y.wrapping_add(byte(2, index) | byte(3, index) << 8) & 0xffff;
                let (tone, linear, plane) = (byte(4, index), byte(5, index), byte(6, index));
                index += 1;
                Entry { x, y, tone, linear, plane }
            }
        };
        if !form.holds(&last) {
            return Err(reader.corrupt("an entry outside of what its fields can hold"));
        }
        entries.push(last);
    }
    Ok(entries)
}

fn read_planes(
    reader: &mut Reader<'_>,
    content: Content,
    layout: &ImageLayout,
    sizes: impl Iterator<Item = (u32, u32)>,
    budget: &mut Budget,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let mut levels = Vec::new();
    for (width, height) in sizes {
        let mut planes = Vec::new();
        for format in content.formats(layout.pixel).0 {
            planes.push(reader.bytes(format.bytes(width, height) as usize)?.to_vec());
        }
        budget.take(u64::from(width) * u64::from(height) * 16)?;
        let planes = ContentPlanes::from_planes(content, layout.pixel, (width, height), planes);
        levels.push(planes.ok_or(reader.corrupt("planes of another size"))?);
    }
    Ok(levels)
}

/// Planes of that content and those sizes with nothing in them.
fn blank_planes(
    content: Content,
    layout: &ImageLayout,
    sizes: impl Iterator<Item = (u32, u32)>,
    budget: &mut Budget,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let corrupt = LoadError::Corrupt { section: String4(FORM_ID), offset: 0, what: "planes of another size" };
    let mut levels = Vec::new();
    for (width, height) in sizes {
        let mut planes = Vec::new();
        for format in content.formats(layout.pixel).0 {
            planes.push(budget.zeroed(format.bytes(width, height))?);
        }
        budget.take(u64::from(width) * u64::from(height) * 16)?;
        let planes = ContentPlanes::from_planes(content, layout.pixel, (width, height), planes);
        levels.push(planes.ok_or(corrupt.clone())?);
    }
    Ok(levels)
}

fn read_coarse(
    file: &Sections<'_>,
    form: &Form,
    layout: &ImageLayout,
    budget: &mut Budget,
) -> Result<Vec<Vec<ContentPlanes>>, LoadError> {
    let levels = coarse_levels(layout.levels);
    if levels.is_empty() {
        return Ok(Vec::new());
    }
    let raw = file.read(COARSE_ID, budget)?;
    let mut reader = Reader::new(String4(COARSE_ID), &raw);
    let content = form.epitomes.first().map_or(Content::Raw, |&(content, ..)| content);
    let content = coarse_content(content, layout.pixel, form.finer);
    let mut coarse = Vec::new();
    for size in &layout.surfaces {
        let sizes = levels.clone().map(|level| size.at_level(level)).map(|size| (size.width, size.height));
        coarse.push(read_planes(&mut reader, content, layout, sizes, budget)?);
    }
    reader.end()?;
    Ok(coarse)
}

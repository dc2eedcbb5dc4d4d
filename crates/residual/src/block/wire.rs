//! Bytes of a texture in blocks: header, index, tables, superblocks.
//!
//! | bytes | what |
//! |---|---|
//! | 1 | version, 1 |
//! | 2, 2 | columns and rows, less one |
//! | 1, 1 | bits of a sample, binary logarithm of a superblock's side |
//! | 2, 1, 2 | step, slope, two offsets |
//! | 1 | groups; for each: 1 channels, then 2 for each mean, 2 for each of channels x channels weights of axes |
//! | 1, 2, 4 | bits of a length in the index, bytes of the tables, bytes of the superblocks |
//! | | words of the index, tables, superblocks: those of the coarsest base first, each plane row by row |
//!
//! So bytes that end early still hold the bases: superblocks that are missing decode to what their means predict.

use texfold_core::container::Reader;
use texfold_core::{Budget, LoadError, SurfaceSize};

use super::bits::BitReader;
use super::context::{SET_TABLES, SETS};
use super::decode::BlockTexture;
use super::form::{AXIS_BITS, BlockForm, Group, MAX_CHANNELS, MAX_GROUP, MAX_OFFSET, MAX_STEP, Quantiser};
use super::index::Index;
use super::tables::{AllStops, ROWS, STOP_VALUES, Table, predicted, usual};

/// Version of the layout.
const VERSION: u8 = 1;
/// Most bits of a length in the index.
const MAX_WIDTH: u8 = 24;
/// Largest weight of an axis: an orthonormal one.
const MAX_WEIGHT: i16 = 1 << AXIS_BITS;

impl BlockTexture {
    /// The bytes that [`BlockTexture::read`] reads.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let form = self.form();
        let mut out = vec![VERSION];
        out.extend(((form.size.width - 1) as u16).to_le_bytes());
        out.extend(((form.size.height - 1) as u16).to_le_bytes());
        out.extend([form.depth, form.superblock_log2]);
        out.extend(form.quantiser.step.to_le_bytes());
        out.extend([form.quantiser.slope, form.quantiser.offsets[0], form.quantiser.offsets[1]]);
        out.push(form.groups.len() as u8);
        for group in &form.groups {
            let count = usize::from(group.channels);
            out.push(group.channels);
            out.extend(group.means[..count].iter().flat_map(|mean| mean.to_le_bytes()));
            let weights = group.axes[..count].iter().flat_map(|weights| &weights[..count]);
            out.extend(weights.flat_map(|weight| weight.to_le_bytes()));
        }
        out.push(self.index.width() as u8);
        out.extend((self.stops.len() as u16).to_le_bytes());
        out.extend((self.bytes.len() as u32).to_le_bytes());
        out.extend(self.index.words().iter().flat_map(|word| word.to_le_bytes()));
        out.extend(&self.stops);
        out.extend(&self.bytes);
        out
    }

    /// Reads a texture. Superblocks are not looked into: any bytes decode.
    ///
    /// # Errors
    /// [`LoadError`] where the header says what no writer says, or the budget does not allow what decoding holds.
    pub fn read(reader: &mut Reader<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        let form = read_form(reader)?;
        budget.check_texels(form.size.texels())?;
        let width = reader.u8()?;
        if width > MAX_WIDTH {
            return Err(reader.corrupt("lengths of more than 24 bits"));
        }
        let table_bytes = usize::from(reader.u16()?);
        let stream_bytes = reader.u32()? as usize;
        let planes = form.planes();
        let superblocks = planes.iter().map(|plane| plane.count()).sum();
        let words = Index::words_of(superblocks, u32::from(width));
        // The bases as they are decoded with the whole image: 4 bytes a sample.
        let bases: u64 = planes[1..].iter().map(|plane| plane.size.texels()).sum();
        budget.take(4 * bases * form.channels() as u64 + 4 * words as u64)?;
        budget.take((SETS * SET_TABLES * size_of::<Table>()) as u64)?;
        let index = reader.bytes(4 * words)?;
        let index =
            index.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
        let index = Index::new(u32::from(width), index.collect());
        let stops = reader.bytes(table_bytes)?;
        let all = read_stops(stops).ok_or(reader.corrupt("tables of probabilities that no writer writes"))?;
        let tables = all.iter().map(|stops| Table::new(&stops.frequencies())).collect();
        let bytes = reader.bytes(stream_bytes)?;
        budget.take((stops.len() + bytes.len()) as u64)?;
        Ok(BlockTexture::new(form, stops.to_vec(), tables, index, bytes.to_vec()))
    }
}

fn read_form(reader: &mut Reader<'_>) -> Result<BlockForm, LoadError> {
    if reader.u8()? != VERSION {
        return Err(reader.corrupt("a layout of blocks that this reader does not know"));
    }
    let (width, height) = (u32::from(reader.u16()?) + 1, u32::from(reader.u16()?) + 1);
    let (depth, superblock_log2) = (reader.u8()?, reader.u8()?);
    if depth != 8 && depth != 16 {
        return Err(reader.corrupt("samples of neither 8 nor 16 bits"));
    }
    if !(4..=6).contains(&superblock_log2) {
        return Err(reader.corrupt("superblocks of another side than 16, 32 or 64"));
    }
    let (step, slope, offsets) = (reader.u16()?, reader.u8()?, [reader.u8()?, reader.u8()?]);
    if step > MAX_STEP || offsets.iter().any(|&offset| offset > MAX_OFFSET) {
        return Err(reader.corrupt("a quantiser beyond the largest"));
    }
    let quantiser = Quantiser { step, slope, offsets };
    let mut groups = Vec::new();
    let mut channels = 0;
    for _ in 0..reader.u8()? {
        let group = read_group(reader)?;
        channels += usize::from(group.channels);
        if channels > MAX_CHANNELS {
            return Err(reader.corrupt("more than 16 channels"));
        }
        groups.push(group);
    }
    if groups.is_empty() {
        return Err(reader.corrupt("no channels"));
    }
    Ok(BlockForm { size: SurfaceSize { width, height }, depth, superblock_log2, quantiser, groups })
}

fn read_group(reader: &mut Reader<'_>) -> Result<Group, LoadError> {
    let channels = reader.u8()?;
    if !(1..=MAX_GROUP).contains(&usize::from(channels)) {
        return Err(reader.corrupt("a group of none or more than four channels"));
    }
    let mut group = Group { channels, means: [0; MAX_GROUP], axes: [[0; MAX_GROUP]; MAX_GROUP] };
    for mean in &mut group.means[..usize::from(channels)] {
        *mean = reader.u16()?;
    }
    for weights in &mut group.axes[..usize::from(channels)] {
        for weight in &mut weights[..usize::from(channels)] {
            *weight = reader.u16()? as i16;
            if !(-MAX_WEIGHT..=MAX_WEIGHT).contains(weight) {
                return Err(reader.corrupt("an axis longer than one"));
            }
        }
    }
    Ok(group)
}

/// Tables, row by row: a flag, set where the row is as predicted; else a flag for each table and the differences.
pub(super) fn read_stops(bytes: &[u8]) -> Option<AllStops> {
    let mut reader = BitReader::new(bytes);
    let mut all = usual();
    for set in 0..SETS {
        for row in ROWS.windows(2) {
            let as_predicted = reader.flag();
            for table in set * SET_TABLES + row[0]..set * SET_TABLES + row[1] {
                let mut stops = predicted(&all, table);
                if !as_predicted && !reader.flag() {
                    for value in stops.values_mut() {
                        let read = i32::from(*value) + reader.signed()?;
                        *value = u8::try_from(read).ok().filter(|&read| usize::from(read) < STOP_VALUES)?;
                    }
                }
                all[table] = stops;
            }
        }
    }
    Some(all)
}

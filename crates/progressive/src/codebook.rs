//! Codebooks and maps as they are shipped: atoms that the blocks of many images use, and for each block which and how.
//!
//! Atoms are residuals of a base, in luma, and of one contrast: brightness and colour come from the base, contrast and sign
//! from the block's gain. So one atom serves blocks of any colour, and 20 bits of place, rotation and gain a block do what
//! the paper's entry of nine numbers does. A public codebook may grow by whole rows of cells; an image names how many
//! rows it was made with and reads no others, so that no texel of it ever changes.
//!
//! Memory: a loaded codebook holds its planes, a loaded map its packed words, as GPUs do. Values and entries are unpacked
//! when the CPU asks for them.

use std::sync::Arc;

use texfold_bc::ContentPlanes;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::{Cached, ImageSize, Texel, WordRows};

/// Name of the map in a footprint.
pub(crate) const MAP_PART: &str = "map";
/// Name of a codebook that is kept elsewhere.
pub const PUBLIC_PART: &str = "public codebook";
/// Name of a texture's own codebook.
pub(crate) const PRIVATE_PART: &str = "codebook";
/// Texels a side of the pieces that codebooks are made of.
pub const CELL_SIDE: u32 = 32;
/// Longest side of a codebook in texels; public and private rows together are no more.
pub(crate) const MAX_CODEBOOK_SIDE: u32 = 4096;
/// Bits of a gain: its magnitude's number, then its sign.
pub(crate) const GAIN_BITS: u32 = 5;
/// Largest number of a magnitude.
pub(crate) const MOST_GAIN: u32 = 15;
/// Byte of content that stands for no detail.
pub(crate) const MIDDLE: f32 = 128.0;
/// Bytes from there to the largest value.
pub(crate) const REACH: f32 = 127.0;

/// Pixels of a codebook.
pub(crate) const CODEBOOK_PIXEL: PixelInfo =
    PixelInfo { channels: 1, depth: Depth::Eight, color: ColorSpace::Linear, alpha: Alpha::Opaque };

/// Atoms that blocks use. A clone shares its planes and values.
#[derive(Debug, Clone, PartialEq)]
pub struct Codebook {
    planes: Arc<ContentPlanes>,
    /// For each texel its value, -1 to 1, once values have been asked for.
    values: Arc<Cached<Vec<f32>>>,
}

impl Codebook {
    /// From its planes; `None` where they are no gray image of whole cells.
    #[must_use]
    pub fn from_planes(planes: ContentPlanes) -> Option<Self> {
        let (width, height) = planes.size();
        let whole = |side: u32| side.is_multiple_of(CELL_SIDE) && (1..=MAX_CODEBOOK_SIDE).contains(&side);
        if !whole(width) || !whole(height) || planes.planes().len() != 1 {
            return None;
        }
        Some(Codebook { planes: Arc::new(planes), values: Arc::default() })
    }

    /// The same with the rows of `further`, which has the same content and width, below its own.
    #[must_use]
    pub fn grown(&self, further: &Codebook) -> Option<Codebook> {
        let ((width, height), (other_width, other_height)) = (self.size(), further.size());
        let content = self.planes.content();
        if width != other_width || content != further.planes.content() {
            return None;
        }
        // Rows of whole blocks follow one another in a plane.
        let bytes = self.planes.planes().iter().zip(further.planes.planes());
        let planes = bytes.map(|((_, own), (_, more))| [own.as_slice(), more].concat()).collect();
        let size = (width, height + other_height);
        Codebook::from_planes(ContentPlanes::from_planes(content, CODEBOOK_PIXEL, size, planes)?)
    }

    /// The first `rows` rows of texels, of whole cells; `None` where it has fewer.
    #[must_use]
    pub fn first_rows(&self, rows: u32) -> Option<Codebook> {
        let (width, height) = self.size();
        if rows == height {
            return Some(self.clone());
        }
        if rows > height {
            return None;
        }
        let share = |bytes: &Vec<u8>| bytes[..bytes.len() / height as usize * rows as usize].to_vec();
        let planes = self.planes.planes().iter().map(|(_, bytes)| share(bytes)).collect();
        let content = self.planes.content();
        Codebook::from_planes(ContentPlanes::from_planes(content, CODEBOOK_PIXEL, (width, rows), planes)?)
    }

    /// Columns and rows in texels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        self.planes.size()
    }

    /// Tells one codebook from another: of its bytes.
    #[must_use]
    pub fn checksum(&self) -> u64 {
        let bytes: Vec<&[u8]> = self.planes.planes().iter().map(|(_, bytes)| bytes.as_slice()).collect();
        texfold_core::container::checksum(&bytes)
    }

    /// Bits in memory.
    #[must_use]
    pub fn bits_memory(&self) -> u64 {
        self.planes.planes().iter().map(|(_, bytes)| 8 * bytes.len() as u64).sum()
    }

    /// How it is stored.
    #[must_use]
    pub fn planes(&self) -> &ContentPlanes {
        &self.planes
    }

    /// All values row by row, -1 to 1.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        let value = |texel: &Texel| (texel.x * 255.0 - MIDDLE) / REACH;
        self.values.get_or_make(|| self.planes.decode().iter().map(value).collect())
    }
}

/// How a block's entry is laid out: column and row of its centre in the codebook in texels (public rows first, private ones
/// behind them), the number of a rotation, and a gain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MapForm {
    /// Binary logarithm of a block's side in texels: 3 or 4.
    pub side_log2: u32,
    /// Bits of the column.
    pub column_bits: u32,
    /// Bits of the row.
    pub row_bits: u32,
    /// Bits of the rotation, 3 to 5: reflection, quarter turns, and 1, 2 or 4 parts of a quarter.
    pub rotation_bits: u32,
}

impl MapForm {
    /// Bits of an entry, at most 32.
    #[must_use]
    pub fn entry_bits(self) -> u32 {
        self.column_bits + self.row_bits + self.rotation_bits + GAIN_BITS
    }

    /// As the shader reads it: 4 bits each.
    pub(crate) fn packed(self) -> u32 {
        self.side_log2 | self.column_bits << 4 | self.row_bits << 8 | self.rotation_bits << 12
    }

    /// From what [`MapForm::packed`] gives.
    pub(crate) fn unpacked(word: u32) -> Option<Self> {
        let [side_log2, column_bits, row_bits, rotation_bits] = [0, 4, 8, 12].map(|shift| word >> shift & 15);
        let form = MapForm { side_log2, column_bits, row_bits, rotation_bits };
        let fits = (3..=4).contains(&side_log2)
            && (1..=12).contains(&column_bits)
            && (1..=12).contains(&row_bits)
            && (3..=5).contains(&rotation_bits)
            && word >> 16 == 0
            && form.entry_bits() <= 32;
        fits.then_some(form)
    }

    /// Columns and rows of blocks that cover a level of that size.
    pub(crate) fn blocks_of(self, size: ImageSize) -> (u32, u32) {
        let side = 1 << self.side_log2;
        (size.width.div_ceil(side), size.height.div_ceil(side))
    }

    /// Blocks of all levels of an image.
    pub(crate) fn blocks(self, size: ImageSize, levels: u32) -> u64 {
        let of_level = |level| {
            let (columns, rows) = self.blocks_of(size.at_level(level));
            u64::from(columns) * u64::from(rows)
        };
        (0..levels).map(of_level).sum()
    }
}

/// Where and how a block reads the codebook.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Entry {
    /// Column of the block's centre in texels.
    pub column: u32,
    /// Row of it.
    pub row: u32,
    /// Number of its rotation.
    pub rotation: u32,
    /// Number of its gain's magnitude, 0 for none, and its sign in the bit above.
    pub gain: u32,
}

impl Entry {
    /// Its bits, the column lowest.
    pub(crate) fn packed(self, form: MapForm) -> u32 {
        let rows_at = form.column_bits;
        let rotations_at = rows_at + form.row_bits;
        self.column
            | self.row << rows_at
            | self.rotation << rotations_at
            | self.gain << (rotations_at + form.rotation_bits)
    }

    /// From its bits.
    #[must_use]
    pub fn unpacked(word: u32, form: MapForm) -> Self {
        let field = |start: u32, bits: u32| word >> start & ((1 << bits) - 1);
        let rotations_at = form.column_bits + form.row_bits;
        Entry {
            column: field(0, form.column_bits),
            row: field(form.column_bits, form.row_bits),
            rotation: field(rotations_at, form.rotation_bits),
            gain: field(rotations_at + form.rotation_bits, GAIN_BITS),
        }
    }
}

/// What a texture draws beside its residual content: codebooks and maps.
#[derive(Debug, Clone, PartialEq)]
pub struct Details {
    /// Shared with other textures; kept elsewhere.
    pub public: Option<Arc<Codebook>>,
    /// This texture's own.
    pub private: Option<Arc<Codebook>>,
    /// How entries are laid out.
    pub form: MapForm,
    /// The least gain above none, in units of 1/65536 of the range; number n is 2^((n - 1) / 2) of it.
    pub gain_unit: u16,
    /// For each image the entries of its blocks, packed.
    pub maps: Vec<EntryMap>,
}

/// The entries of an image's blocks, level after level, each row by row, as a GPU reads them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EntryMap {
    /// One entry after the other, the first bit lowest in the first word, and at least one word more: an entry is read
    /// from two. Whole rows of a plane.
    pub(crate) words: Vec<u32>,
    /// Binary logarithm of the words in a row of the plane.
    pub(crate) row_log2: u32,
    /// Blocks of all levels.
    pub(crate) blocks: usize,
}

impl EntryMap {
    /// Packs entries.
    #[must_use]
    pub fn new(entries: &[Entry], form: MapForm) -> Self {
        EntryMap::of_words(pack_entries(entries, form), entries.len())
    }

    /// From words as [`pack_entries`] gives them.
    pub(crate) fn of_words(words: Vec<u32>, blocks: usize) -> Self {
        let (words, WordRows { row_log2, .. }) = WordRows::padded(words);
        EntryMap { words, row_log2, blocks }
    }

    /// All entries, unpacked.
    pub fn entries(&self, form: MapForm) -> impl Iterator<Item = Entry> + '_ {
        unpack_entries(&self.words, self.blocks, form)
    }
}

impl Details {
    /// Columns and rows of the public and the private codebook; 0 where there is none.
    pub(crate) fn sizes(&self) -> [u32; 4] {
        let size = |book: &Option<Arc<Codebook>>| book.as_ref().map_or((0, 0), |book| book.size());
        let ((a, b), (c, d)) = (size(&self.public), size(&self.private));
        [a, b, c, d]
    }

    /// The least gain in units of the range.
    pub(crate) fn unit(&self) -> f32 {
        f32::from(self.gain_unit) / 65536.0
    }
}

/// Entries one after the other, the first bit lowest in the first word, and one word more.
pub(crate) fn pack_entries(entries: &[Entry], form: MapForm) -> Vec<u32> {
    let bits = form.entry_bits() as usize;
    let mut words = vec![0u32; (entries.len() * bits).div_ceil(32) + 1];
    for (index, entry) in entries.iter().enumerate() {
        let (at, wide) = (index * bits, u64::from(entry.packed(form)) << (index * bits % 32));
        words[at / 32] |= wide as u32;
        words[at / 32 + 1] |= (wide >> 32) as u32;
    }
    words
}

/// The entries that [`pack_entries`] packed.
fn unpack_entries(words: &[u32], count: usize, form: MapForm) -> impl Iterator<Item = Entry> + '_ {
    let bits = form.entry_bits() as usize;
    let word = |index: usize| u64::from(words.get(index).copied().unwrap_or(0));
    let entry = move |index: usize| {
        let at = index * bits;
        let wide = word(at / 32) | word(at / 32 + 1) << 32;
        Entry::unpacked((wide >> (at % 32)) as u32, form)
    };
    (0..count).map(entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_packed_and_read_again() {
        for rotation_bits in 3..=5 {
            let form = MapForm { side_log2: 4, column_bits: 9, row_bits: 10, rotation_bits };
            assert_eq!(MapForm::unpacked(form.packed()), Some(form));
            let entry = |i: u32| Entry {
                column: i * 37 % 512,
                row: i * 101 % 1024,
                rotation: i % (1 << rotation_bits),
                gain: i % 32,
            };
            let entries: Vec<Entry> = (0..75).map(entry).collect();
            let words = pack_entries(&entries, form);
            assert_eq!(unpack_entries(&words, entries.len(), form).collect::<Vec<_>>(), entries);
        }
        assert_eq!(MapForm::unpacked(0), None);
        assert_eq!(MapForm::unpacked(0xffff), None);
    }
}

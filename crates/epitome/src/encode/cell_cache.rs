//! Cells of content that were encoded before.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Mutex, PoisonError};

use glam::Vec4;
use texfold_bc::ContentPlanes;
use texfold_core::image::PixelInfo;
use texfold_core::{CancelCheck, Effort, EncodeError, PlaneFormat};

use super::pyramid::Stored;

/// Cells as they were encoded last: texels that did not change from one setting to the next are not encoded again.
#[derive(Debug, Default)]
pub(crate) struct CellCache {
    /// By cell: the hash of its texels, and its bytes, plane by plane. Two versions of a cell with one hash do no
    /// harm: what is encoded is compared with what is wanted before it is taken.
    known: Mutex<HashMap<u32, Known>>,
}

/// Hash of a cell's texels, and its bytes.
type Known = (u64, Box<[u8]>);

/// A cell whose texels are wanted.
pub(crate) struct WantedCell {
    /// Its number among those of all formats.
    pub(crate) number: u32,
    /// In 8-bit units, row by row.
    pub(crate) texels: Vec<Vec4>,
}

/// How cells are encoded.
#[derive(Clone, Copy)]
pub(crate) struct CellCoder<'a> {
    pub(crate) stored: &'a Stored,
    pub(crate) pixel: PixelInfo,
    pub(crate) effort: Effort,
    pub(crate) cancel: CancelCheck<'a>,
}

impl CellCache {
    /// Cells of those texels (8-bit units), one below the other.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the job was cancelled; nothing new is kept then.
    pub(crate) fn encode(
        &self,
        coder: CellCoder<'_>,
        cells: &[WantedCell],
    ) -> Result<ContentPlanes, EncodeError> {
        let CellCoder { stored, pixel, effort, cancel } = coder;
        let size = |count: usize| (stored.cell, stored.cell * count as u32);
        let to_bytes = |texel: &Vec4| (*texel + 0.5).to_array().map(|value| value as u8);
        let keys: Vec<Vec<[u8; 4]>> =
            cells.iter().map(|cell| cell.texels.iter().map(to_bytes).collect()).collect();
        let hashes: Vec<u64> = keys.iter().map(|key| hash(key)).collect();
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let fresh: Vec<usize> = {
            let known = known();
            let is_new = |&at: &usize| known.get(&cells[at].number).is_none_or(|known| known.0 != hashes[at]);
            (0..cells.len()).filter(is_new).collect()
        };
        let texel = |key: &[u8; 4]| Vec4::from_array(key.map(f32::from)) / 255.0;
        let texels: Vec<Vec4> = fresh.iter().flat_map(|&at| keys[at].iter().map(texel)).collect();
        let size_of_fresh = size(fresh.len());
        let strip =
            ContentPlanes::encode_cancellable(stored.content, pixel, size_of_fresh, &texels, effort, cancel)?;
        // Locked again only here: a thread that waits for others to encode may take up another epitome meanwhile.
        let mut known = known();
        for (place, &at) in fresh.iter().enumerate() {
            let of_plane = |(_, bytes): &(_, Vec<u8>)| {
                let length = bytes.len() / fresh.len();
                bytes[place * length..(place + 1) * length].to_vec()
            };
            let bytes: Vec<u8> = strip.planes().iter().flat_map(of_plane).collect();
            known.insert(cells[at].number, (hashes[at], bytes.into_boxed_slice()));
        }
        let mut planes = vec![Vec::new(); strip.planes().len()];
        for cell in cells {
            let mut rest: &[u8] = known.get(&cell.number).map_or(&[], |known| &known.1);
            for (plane, (kind, _)) in planes.iter_mut().zip(strip.planes()) {
                let (bytes, behind) = rest.split_at(rest.len().min(bytes_of(*kind, stored.cell)));
                plane.extend_from_slice(bytes);
                rest = behind;
            }
        }
        let all = ContentPlanes::from_planes(stored.content, pixel, size(cells.len()), planes);
        debug_assert!(all.is_some(), "every cell is known by now, with all its bytes");
        Ok(all.unwrap_or(strip))
    }
}

/// Bytes of a cell in a plane.
fn bytes_of(kind: PlaneFormat, cell: u32) -> usize {
    kind.bytes(cell, cell) as usize
}

/// The same on every machine.
fn hash(texels: &[[u8; 4]]) -> u64 {
    let mut hasher = DefaultHasher::new();
    texels.as_flattened().hash(&mut hasher);
    hasher.finish()
}

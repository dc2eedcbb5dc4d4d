//! The codebooks at hand, and the best entry of a block.

use std::sync::Arc;

use glam::{Mat2, UVec2, Vec2, Vec4};
use rayon::prelude::*;
use texfold_core::{CancelCheck, EncodeError};
use texfold_match::SpectrumIndex;

use super::{LumaResidual, ROTATION_BITS};
use crate::codebook::{Codebook, Entry, MOST_GAIN, MapForm};
use crate::decode::texfold_progressive_rotation;

/// Spots that a block is compared with.
const OFFERED: usize = 16;
/// Leaves of patches that are looked at for each orientation and sign: with 64, what is left of blocks of 8x8 is 0.04 dB less.
const LEAVES: usize = 48;
/// Most spots that are indexed: of larger codebooks those of every other column and row, or fewer.
const MOST_SPOTS: u32 = 1 << 18;
/// RMS of content that counts as noise.
const NOISE: f32 = 0.02;
/// Entries that are improved step by step.
const IMPROVED: usize = 2;
/// Steps at most.
const STEPS: usize = 4;

/// One codebook with what finds patches in it.
#[derive(Debug)]
struct Book {
    codebook: Arc<Codebook>,
    index: SpectrumIndex,
    spots: Spots,
}

/// Spots that are indexed: all parts of a quarter turn at places so many texels apart.
#[derive(Debug, Clone, Copy)]
struct Spots {
    stride: u32,
    columns: u32,
    count: u32,
}

impl Spots {
    fn new((width, height): (u32, u32)) -> Self {
        let of = |stride: u32| {
            let (columns, rows) = (width.div_ceil(stride), height.div_ceil(stride));
            Spots { stride, columns, count: (columns * rows) << (ROTATION_BITS - 3) }
        };
        (1..).map(of).find(|spots| spots.count <= MOST_SPOTS).unwrap_or(of(width))
    }

    /// Column, row, and rotation of less than a quarter.
    fn at(self, number: u32) -> (i32, i32, u32) {
        let place = number >> (ROTATION_BITS - 3);
        let (column, row) = (place % self.columns * self.stride, place / self.columns * self.stride);
        (column as i32, row as i32, (number % (1 << (ROTATION_BITS - 3))) << 3)
    }
}

/// A public and a private codebook.
#[derive(Debug)]
pub(crate) struct Library {
    side: usize,
    public: Option<Book>,
    private: Option<Book>,
}

/// A place in one of the codebooks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Spot {
    private: bool,
    column: i32,
    row: i32,
    rotation: u32,
}

/// What a spot can do for a block.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Offer {
    spot: Spot,
    gain: u32,
    explained: f32,
}

impl Library {
    /// For blocks of `side` texels. Of no use once the job is cancelled.
    pub(crate) fn new(
        public: Option<Arc<Codebook>>,
        private: Option<Arc<Codebook>>,
        side: usize,
        check: CancelCheck<'_>,
    ) -> Self {
        let book = |codebook: Arc<Codebook>| {
            let (width, height) = codebook.size();
            let spots = Spots::new((width, height));
            let show = |number: usize, out: &mut Vec<f32>| {
                let (column, row, rotation) = spots.at(number as u32);
                let spot = Spot { private: false, column, row, rotation };
                let rotation = texfold_progressive_rotation(rotation, ROTATION_BITS);
                read(codebook.values(), UVec2::new(width, height), spot, rotation, side, out);
            };
            let index = SpectrumIndex::new(side, NOISE, spots.count as usize, show, check);
            Book { codebook, index, spots }
        };
        Library { side, public: public.map(book), private: private.map(book) }
    }

    /// Columns, and rows of both codebooks together.
    pub(crate) fn size(&self) -> (u32, u32) {
        let size = |book: &Option<Book>| book.as_ref().map_or((0, 0), |book| book.codebook.size());
        let ((a, b), (c, d)) = (size(&self.public), size(&self.private));
        (a.max(c), b + d)
    }

    /// Both codebooks.
    pub(crate) fn books(&self) -> (Option<Arc<Codebook>>, Option<Arc<Codebook>>) {
        let book = |book: &Option<Book>| book.as_ref().map(|book| Arc::clone(&book.codebook));
        (book(&self.public), book(&self.private))
    }

    fn public_rows(&self) -> u32 {
        self.public.as_ref().map_or(0, |book| book.codebook.size().1)
    }

    /// The entries of all blocks of a level, row by row.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] within a few blocks of the caller's wish.
    pub(crate) fn entries(
        &self,
        residual: &LumaResidual,
        form: MapForm,
        unit: u16,
        check: CancelCheck<'_>,
    ) -> Result<Vec<Entry>, EncodeError> {
        let side = self.side;
        let (columns, rows) = (residual.width.div_ceil(side), residual.height.div_ceil(side));
        let gains = gains(unit);
        let entries = (0..columns * rows)
            .into_par_iter()
            .map_init(Room::default, |room, index| {
                if check.is_cancelled() {
                    return Entry::default();
                }
                let (column, row) = (index % columns, index / columns);
                residual.block(side, column, row, &mut room.target);
                match self.best(&gains, room) {
                    Some(offer) => self.entry(offer, form),
                    None => Entry::default(),
                }
            })
            .collect();
        check.checkpoint().map(|()| entries)
    }

    /// Squared error that the best entry of a block takes away.
    pub(crate) fn explained(&self, residual: &LumaResidual, at: (usize, usize), unit: u16) -> f32 {
        let mut room = Room::default();
        residual.block(self.side, at.0, at.1, &mut room.target);
        self.best(&gains(unit), &mut room).map_or(0.0, |offer| offer.explained)
    }

    fn entry(&self, offer: Offer, form: MapForm) -> Entry {
        let first = if offer.spot.private { self.public_rows() } else { 0 };
        let row = offer.spot.row as u32 + first;
        debug_assert!(row < 1 << form.row_bits, "rows of a codebook and the bits for them");
        Entry { column: offer.spot.column as u32, row, rotation: offer.spot.rotation, gain: offer.gain }
    }

    /// The best entry for the block in `room`.
    fn best(&self, gains: &[f32], room: &mut Room) -> Option<Offer> {
        let mut offers: Vec<Offer> = Vec::new();
        for (private, book) in [(false, &self.public), (true, &self.private)] {
            let Some(book) = book else { continue };
            for found in book.index.nearest(&room.target, OFFERED, LEAVES) {
                let (column, row, part) = book.spots.at(found.number as u32);
                let rotation = rotation_of(matrix_of(part) * found.matrix);
                offers.extend(self.offer(Spot { private, column, row, rotation }, gains, room));
            }
        }
        offers.sort_by(|a, b| b.explained.total_cmp(&a.explained));
        offers.truncate(IMPROVED);
        let improved = offers.into_iter().map(|offer| self.improve(offer, gains, room));
        improved.reduce(|a, b| if b.explained > a.explained { b } else { a })
    }

    /// What a spot can do for the block in `room`; `None` where it lies outside or does nothing.
    fn offer(&self, spot: Spot, gains: &[f32], room: &mut Room) -> Option<Offer> {
        let book = if spot.private { &self.private } else { &self.public };
        let codebook = &book.as_ref()?.codebook;
        let (width, height) = codebook.size();
        let inside = |at: i32, side: u32| (0..side as i32).contains(&at);
        if !inside(spot.column, width) || !inside(spot.row, height) {
            return None;
        }
        let rotation = texfold_progressive_rotation(spot.rotation, ROTATION_BITS);
        read(codebook.values(), UVec2::new(width, height), spot, rotation, self.side, &mut room.decoded);
        let (mut both, mut own) = (0.0, 0.0);
        for (&target, &decoded) in room.target.iter().zip(&room.decoded) {
            both += target * decoded;
            own += decoded * decoded;
        }
        offer(spot, both, own, gains)
    }

    /// Moves and rotates a spot while that helps.
    fn improve(&self, first: Offer, gains: &[f32], room: &mut Room) -> Offer {
        const MOVES: [(i32, i32, i32); 10] = [
            (-1, 0, 0),
            (1, 0, 0),
            (0, -1, 0),
            (0, 1, 0),
            (-1, -1, 0),
            (1, 1, 0),
            (-1, 1, 0),
            (1, -1, 0),
            (0, 0, 1),
            (0, 0, -1),
        ];
        let mut best = first;
        for _ in 0..STEPS {
            let from = best.spot;
            for (across, down, rotated) in MOVES {
                let rotation = rotated_by(from.rotation, rotated);
                let spot = Spot { column: from.column + across, row: from.row + down, rotation, ..from };
                if let Some(offer) = self.offer(spot, gains, room).filter(|o| o.explained > best.explained) {
                    best = offer;
                }
            }
            if best.spot == from {
                break;
            }
        }
        best
    }
}

/// Room for one block after another.
#[derive(Debug, Default)]
struct Room {
    target: Vec<f32>,
    decoded: Vec<f32>,
}

/// The rotation nearest to a 2x2 matrix.
pub(crate) fn rotation_of(matrix: Mat2) -> u32 {
    let quarter_parts = 1u32 << (ROTATION_BITS - 3);
    let steps = 4 * quarter_parts;
    let angle = matrix.x_axis.y.atan2(matrix.x_axis.x).rem_euclid(std::f32::consts::TAU);
    let step = (angle / std::f32::consts::TAU * steps as f32).round() as u32 % steps;
    numbered(step, matrix.determinant() < 0.0)
}

/// The 2x2 matrix of a rotation.
fn matrix_of(number: u32) -> Mat2 {
    let rotation = texfold_progressive_rotation(number, ROTATION_BITS);
    Mat2::from_cols(Vec2::new(rotation.x, rotation.z), Vec2::new(rotation.y, rotation.w))
}

/// The number of a rotation by so many parts of a quarter.
fn numbered(step: u32, reflected: bool) -> u32 {
    let parts = 1 << (ROTATION_BITS - 3);
    u32::from(reflected) | ((step / parts) << 1) | ((step % parts) << 3)
}

/// The rotation one part further, or back.
fn rotated_by(number: u32, by: i32) -> u32 {
    let parts = 1 << (ROTATION_BITS - 3);
    let step = (number >> 1 & 3) * parts + (number >> 3);
    let steps = 4 * parts as i32;
    numbered((step as i32 + by).rem_euclid(steps) as u32, number & 1 == 1)
}

/// What a spot reads as [`crate::decode::texfold_progressive_content`] reads it texel by texel.
fn read(values: &[f32], size: UVec2, spot: Spot, rotation: Vec4, side: usize, out: &mut Vec<f32>) {
    out.clear();
    let centre = Vec2::new(spot.column as f32, spot.row as f32);
    let start = 0.5 - 0.5 * side as f32;
    if spot.rotation >> 3 == 0 {
        // A quarter turn about a corner of texels: each is read at its centre.
        let (last_x, last_y) = (size.x as i32 - 1, size.y as i32 - 1);
        for y in 0..side {
            let row = Vec2::new(rotation.y, rotation.w) * (start + y as f32) + centre;
            for x in 0..side {
                let at = row + Vec2::new(rotation.x, rotation.z) * (start + x as f32);
                let (x, y) = ((at.x.floor() as i32).clamp(0, last_x), (at.y.floor() as i32).clamp(0, last_y));
                out.push(values[(y * size.x as i32 + x) as usize]);
            }
        }
        return;
    }
    let last = size.as_vec2() - 1.0;
    for y in 0..side {
        let row = Vec2::new(rotation.y, rotation.w) * (start + y as f32) + centre;
        for x in 0..side {
            let at = row + Vec2::new(rotation.x, rotation.z) * (start + x as f32);
            let at = (at - 0.5).clamp(Vec2::ZERO, last);
            let low = at.as_uvec2();
            let high = (low + 1).min(size - 1);
            let weight = at - low.as_vec2();
            let value = |x: u32, y: u32| values[(y * size.x + x) as usize];
            let upper = value(low.x, low.y) + (value(high.x, low.y) - value(low.x, low.y)) * weight.x;
            let lower = value(low.x, high.y) + (value(high.x, high.y) - value(low.x, high.y)) * weight.x;
            out.push(upper + (lower - upper) * weight.y);
        }
    }
}

/// Magnitudes by number in 8-bit units, that of none first.
fn gains(unit: u16) -> Vec<f32> {
    let unit = f32::from(unit) / 65536.0 * 255.0;
    let magnitude = |number: u32| if number == 0 { 0.0 } else { unit * ((number - 1) as f32 * 0.5).exp2() };
    (0..=MOST_GAIN).map(magnitude).collect()
}

/// The gain that takes most away: `both` is the product of block and content, `own` that of the content with itself.
fn offer(spot: Spot, both: f32, own: f32, gains: &[f32]) -> Option<Offer> {
    let wanted = both.abs() / own.max(1e-6);
    let next = gains.partition_point(|&gain| gain < wanted);
    let explained = |number: usize| gains.get(number).map(|gain| (2.0 * both.abs() - gain * own) * gain);
    let tried = [next.saturating_sub(1), next].into_iter().filter_map(|n| Some((n, explained(n)?)));
    let (number, explained) = tried.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let sign = if both < 0.0 { MOST_GAIN + 1 } else { 0 };
    (explained > 0.0).then_some(Offer { spot, gain: number as u32 | sign, explained })
}

/// The least gain of a texture: the largest is what the blocks of most contrast want.
pub(crate) fn gain_unit(residuals: &[Vec<LumaResidual>], side_log2: u32) -> u16 {
    let side = 1usize << side_log2;
    let mut largest = 0.0f32;
    let mut block = Vec::new();
    for residual in residuals.iter().flatten() {
        for row in 0..residual.height.div_ceil(side) {
            for column in 0..residual.width.div_ceil(side) {
                residual.block(side, column, row, &mut block);
                largest = largest.max(block.iter().map(|value| value * value).sum::<f32>());
            }
        }
    }
    // Content has an RMS of about a third; what it explains is about half.
    let gain = 2.0 * (largest / (side * side) as f32).sqrt();
    let steps = ((MOST_GAIN - 1) as f32 * 0.5).exp2();
    (gain / steps / 255.0 * 65536.0).round().clamp(1.0, 65535.0) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_have_the_numbers_of_their_matrices() {
        for number in 0..1 << ROTATION_BITS {
            let (rotation, matrix) = (texfold_progressive_rotation(number, ROTATION_BITS), matrix_of(number));
            assert_eq!(rotation_of(matrix), number);
            assert!((matrix.determinant().abs() - 1.0).abs() < 1e-6);
            let further = texfold_progressive_rotation(rotated_by(number, 1), ROTATION_BITS);
            let angle = rotation.x * further.x + rotation.z * further.z;
            assert!((angle - (std::f32::consts::TAU / 16.0).cos()).abs() < 1e-5, "{number}");
            assert_eq!(rotated_by(rotated_by(number, 1), -1), number);
        }
    }

    #[test]
    fn the_best_gain_is_the_best_of_all() {
        let gains = gains(40);
        let spot = Spot { private: false, column: 0, row: 0, rotation: 0 };
        for (both, own) in [(10.0, 3.0), (-7.0, 0.4), (0.02, 5.0), (4000.0, 1.0)] {
            let all = gains.iter().map(|gain| (2.0 * f32::abs(both) - gain * own) * gain);
            let best = all.fold(0.0, f32::max);
            assert_eq!(offer(spot, both, own, &gains).map_or(0.0, |offer| offer.explained), best);
        }
    }

    /// Residuals of a base of flat blocks of 8x8 texels.
    fn residual() -> LumaResidual {
        let image = texfold_testkit::image("terrain");
        let size = image.size();
        let (width, height) = (size.width as usize, size.height as usize);
        let luma = |x: usize, y: usize| {
            let texel = image.texel(x as u32, y as u32);
            (texel.x + texel.y + texel.z) * 85.0
        };
        let value = |i: usize| {
            let (x, y) = (i % width, i / width);
            let block = |n: usize| luma(x / 8 * 8 + n % 8, y / 8 * 8 + n / 8);
            luma(x, y) - (0..64).map(block).sum::<f32>() / 64.0
        };
        LumaResidual { width, height, values: (0..width * height).map(value).collect() }
    }

    #[test]
    fn the_search_loses_little_against_all_places_and_rotations() {
        let residual = residual();
        let flat = residual.flattened();
        let cells = [(0, 0), (96, 32), (32, 160), (192, 96)].map(|(x, y)| flat.cell(x, y));
        let book = Codebook::of_cells(texfold_bc::Content::Raw, 64, &cells).unwrap();
        let (side, unit) = (8, gain_unit(&[vec![residual.clone()]], 3));
        let library = Library::new(None, Some(Arc::new(book)), side, CancelCheck::default());
        let (mut all, mut searched, mut best) = (0.0f64, 0.0f64, 0.0f64);
        for block in 0..32 {
            let at = (block * 7 % 32, block * 5 % 32);
            let mut room = Room::default();
            residual.block(side, at.0, at.1, &mut room.target);
            all += f64::from(room.target.iter().map(|value| value * value).sum::<f32>());
            searched += f64::from(library.explained(&residual, at, unit));
            let spots = (0..64 * 64 * 32u32).map(|i| Spot {
                private: true,
                column: (i % 64) as i32,
                row: (i / 64 % 64) as i32,
                rotation: i / 4096,
            });
            let gains = gains(unit);
            let explained =
                spots.filter_map(|spot| library.offer(spot, &gains, &mut room)).map(|o| o.explained);
            best += f64::from(explained.fold(0.0, f32::max));
        }
        let lost = 10.0 * ((all - searched) / (all - best)).log10();
        // Of 131072 places and rotations; measured 0.07 dB.
        assert!(lost < 0.1 && best < all, "{lost} dB: {searched} and {best} of {all}");
    }
}

//! Range asymmetric numeral systems in 32 bits: how a superblock's symbols are read.
//!
//! Source: Duda, "Asymmetric numeral systems: entropy coding combining speed of Huffman coding with compression rate of
//! arithmetic coding", 2013. State of 32 bits, refilled 16 bits at a time. The stream's first 0 to 4 bytes are the state,
//! 16-bit words follow; the parity of the stream's length says whether the state has 3 or 4 bytes. The encoder begins with
//! the state 0 and the decoder goes on without refilling where the words end, which saves the 16 bits of a normalised state.

use crate::tables::{PROBABILITY_BITS, Table};

/// A state below is refilled.
const LOW: u32 = 1 << 16;

/// A stream that is being read. Any bytes can be read; behind their end come zeros.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rans<'a> {
    state: u32,
    words: &'a [u8],
    /// First byte that is not read.
    next: usize,
}

impl<'a> Rans<'a> {
    /// Reads `bytes`.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let head = match bytes.len() {
            few @ 0..4 => few,
            many => 4 - many % 2,
        };
        let (head, words) = bytes.split_at(head);
        let state = head.iter().rev().fold(0, |state, &byte| state << 8 | u32::from(byte));
        Rans { state, words, next: 0 }
    }

    #[inline(always)]
    fn refill(&mut self) {
        // Only the end can be foretold: whether a word is needed is not made a branch.
        if let Some(&[low, high]) = self.words.get(self.next..).and_then(<[u8]>::first_chunk) {
            let needed = u32::from(self.state < LOW);
            let refilled = self.state << 16 | u32::from(u16::from_le_bytes([low, high]));
            self.state = if needed != 0 { refilled } else { self.state };
            self.next += 2 * needed as usize;
        }
    }

    /// The next symbol.
    #[inline(always)]
    pub(super) fn symbol(&mut self, table: &Table) -> usize {
        let (symbol, frequency, within) = table.find(self.state & ((1 << PROBABILITY_BITS) - 1));
        self.state = frequency.wrapping_mul(self.state >> PROBABILITY_BITS).wrapping_add(within);
        self.refill();
        symbol
    }

    /// The next number of at most 16 bits.
    #[inline(always)]
    pub(super) fn bits(&mut self, count: u32) -> u32 {
        let value = self.state & ((1 << count) - 1);
        self.state >>= count;
        self.refill();
        value
    }
}

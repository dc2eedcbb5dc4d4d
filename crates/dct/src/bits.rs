//! Bits of the probability tables in a header: flags and Exp-Golomb numbers, the lowest bit first.

/// Reads bits; zeros behind the end.
#[derive(Debug)]
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    next: usize,
}

impl<'a> BitReader<'a> {
    /// Reads `bytes`.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        BitReader { bytes, next: 0 }
    }

    /// The next bit.
    pub(super) fn flag(&mut self) -> bool {
        let byte = self.bytes.get(self.next / 8).copied().unwrap_or(0);
        let bit = byte >> (self.next % 8) & 1;
        self.next += 1;
        bit != 0
    }

    /// The next signed Exp-Golomb number, at most 127 away from 0; `None` for another one.
    pub(super) fn signed(&mut self) -> Option<i32> {
        let mut length = 0;
        while !self.flag() {
            length += 1;
            if length > 7 {
                return None;
            }
        }
        let value = (0..length).fold(1i32, |value, _| value << 1 | i32::from(self.flag())) - 1;
        Some(if value % 2 == 0 { -(value / 2) } else { value / 2 + 1 })
    }
}

/// Bits that [`BitReader::signed`] takes for `value`.
#[cfg(feature = "encode")]
pub(super) fn signed_bits(value: i32) -> u32 {
    2 * folded(value).ilog2() + 1
}

/// 1, 2, 3, 4, 5 for 0, 1, -1, 2, -2.
#[cfg(feature = "encode")]
fn folded(value: i32) -> u32 {
    if value > 0 { 2 * value.unsigned_abs() } else { 2 * value.unsigned_abs() + 1 }
}

/// Writes what [`BitReader`] reads.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
pub(super) struct BitWriter {
    bytes: Vec<u8>,
    next: usize,
}

#[cfg(feature = "encode")]
impl BitWriter {
    /// Writes a bit.
    pub(super) fn flag(&mut self, flag: bool) {
        if self.next.is_multiple_of(8) {
            self.bytes.push(0);
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= u8::from(flag) << (self.next % 8);
        }
        self.next += 1;
    }

    /// Writes a number.
    pub(super) fn signed(&mut self, value: i32) {
        let value = folded(value);
        let length = value.ilog2();
        (0..length).for_each(|_| self.flag(false));
        (0..=length).rev().for_each(|bit| self.flag(value >> bit & 1 != 0));
    }

    /// The bytes.
    pub(super) fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_and_take_what_they_are_said_to() {
        let mut writer = BitWriter::default();
        (-70..=70).for_each(|value| writer.signed(value));
        let bits: u32 = (-70..=70).map(signed_bits).sum();
        assert_eq!(writer.next, bits as usize);
        let bytes = writer.finish();
        let mut reader = BitReader::new(&bytes);
        (-70..=70).for_each(|value| assert_eq!(reader.signed(), Some(value)));
        assert_eq!(BitReader::new(&[0; 4]).signed(), None);
    }
}

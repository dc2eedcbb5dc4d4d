//! zstd frames: by the C library with the feature `encode`, by a decoder in Rust without it.

use std::io;

#[cfg(feature = "encode")]
pub(super) use library::{compress, decompress, scratch_bytes};
#[cfg(not(feature = "encode"))]
pub(super) use pure::{compress, decompress, scratch_bytes};

#[cfg(feature = "encode")]
mod library {
    use super::io;

    /// zstd level: 19 is the strongest that needs no large window; textures are written once and read often.
    const LEVEL: i32 = 19;
    /// zstd level of long sections: planes of BC7 become 3 % larger than by 19, in an eighth of the time.
    const LEVEL_LONG: i32 = 12;
    /// Bytes from which on a section is long.
    const LONG: usize = 1 << 22;

    /// zstd level that tells whether streams of an entropy coder can become shorter: in a twentieth of the time of the strongest.
    const LEVEL_FIRST: i32 = 9;

    /// The bytes as one frame; `None` where that is not shorter, or the library fails. Whether streams become shorter is tried by a fast level first.
    pub(in crate::container) fn compress(raw: &[u8], are_streams: bool) -> Option<Vec<u8>> {
        let shorter = |level| zstd::bulk::compress(raw, level).ok().filter(|frame| frame.len() < raw.len());
        if are_streams {
            shorter(LEVEL_FIRST)?;
        }
        shorter(if raw.len() < LONG { LEVEL } else { LEVEL_LONG })
    }

    /// The `raw_len` bytes that a frame holds. Fails where it holds more.
    pub(in crate::container) fn decompress(frame: &[u8], raw_len: usize) -> io::Result<Vec<u8>> {
        let mut raw = Vec::new();
        raw.try_reserve_exact(raw_len).map_err(io::Error::other)?;
        zstd::bulk::Decompressor::new()?.decompress_to_buffer(frame, &mut raw)?;
        Ok(raw)
    }

    /// Bytes that decompressing takes beside the result: nothing, as the result is the window.
    pub(in crate::container) fn scratch_bytes(_raw_len: u64) -> u64 {
        0
    }
}

#[cfg(any(test, not(feature = "encode")))]
mod pure {
    use std::io::Read;

    use ruzstd::decoding::StreamingDecoder;

    use super::io;

    /// Least window that a frame may state, in bytes (RFC 8878, 3.1.1.1.2).
    const LEAST_WINDOW: u64 = 1024;

    /// Nothing: this build stores sections as they are.
    #[cfg(not(feature = "encode"))]
    pub(in crate::container) fn compress(_raw: &[u8], _are_streams: bool) -> Option<Vec<u8>> {
        None
    }

    /// The `raw_len` bytes that a frame holds. Fails where it holds more, or where its window is larger than they are.
    pub(in crate::container) fn decompress(frame: &[u8], raw_len: usize) -> io::Result<Vec<u8>> {
        let window = LEAST_WINDOW.max(raw_len as u64);
        let decoder = StreamingDecoder::new_with_max_window_size(frame, window).map_err(io::Error::other)?;
        let mut raw = Vec::new();
        raw.try_reserve_exact(raw_len).map_err(io::Error::other)?;
        decoder.take(raw_len as u64 + 1).read_to_end(&mut raw)?;
        Ok(raw)
    }

    /// Bytes that decompressing takes beside the result: a window of its length, which grows to a power of two.
    #[cfg(not(feature = "encode"))]
    pub(in crate::container) fn scratch_bytes(raw_len: u64) -> u64 {
        raw_len.saturating_mul(2)
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::{library, pure};

    #[test]
    fn both_decoders_read_the_same() {
        assert!(
            [false, true].iter().all(|&are_streams| library::compress(b"no shorter", are_streams).is_none())
        );
        for length in [0usize, 1, 1000, 100_000, 5 << 20] {
            let raw: Vec<u8> = (0..length).map(|i| (i * i / 7 % 251) as u8).collect();
            let frame = zstd::bulk::compress(&raw, 12).unwrap();
            let shorter = library::compress(&raw, true);
            assert!(shorter.is_none_or(|shorter| library::decompress(&shorter, length).unwrap() == raw));
            assert!(library::decompress(&frame, length).is_ok_and(|found| found == raw), "{length} bytes");
            assert!(pure::decompress(&frame, length).is_ok_and(|found| found == raw), "{length} bytes");
            // A frame that is cut, or holds more than is said.
            for cut in [frame.len() / 2, frame.len().saturating_sub(1)] {
                assert!(library::decompress(&frame[..cut], length).is_err(), "{length} cut at {cut}");
                let part = pure::decompress(&frame[..cut], length);
                assert!(
                    part.is_err() || part.is_ok_and(|part| part.len() < length.max(1)),
                    "{length} at {cut}"
                );
            }
            if length > 0 {
                assert!(library::decompress(&frame, length - 1).is_err(), "{length} bytes");
                let more = pure::decompress(&frame, length - 1);
                assert!(more.is_err() || more.is_ok_and(|more| more.len() == length), "{length} bytes");
            }
        }
    }
}

//! zstd frames: by the C library with the feature `encode`, by a decoder in Rust without it.

use std::io::{self, Read};

/// Largest window that a section may have been compressed with: 2^27 bytes, zstd's own default bound.
const WINDOW_LOG_MAX: u32 = 27;

#[cfg(feature = "encode")]
pub(super) use library::{compress, reader};
#[cfg(not(feature = "encode"))]
pub(super) use pure::{compress, reader};

#[cfg(feature = "encode")]
mod library {
    use super::{Read, WINDOW_LOG_MAX, io};

    /// zstd level: 19 is the strongest that needs no large window; textures are written once and read often.
    const LEVEL: i32 = 19;
    /// zstd level of long sections: planes of BC7 become 3 % larger than by 19, in an eighth of the time.
    const LEVEL_LONG: i32 = 12;
    /// Bytes from which on a section is long.
    const LONG: usize = 1 << 22;

    /// The bytes as one frame; `None` where the library fails.
    pub(in crate::container) fn compress(raw: &[u8]) -> Option<Vec<u8>> {
        zstd::bulk::compress(raw, if raw.len() < LONG { LEVEL } else { LEVEL_LONG }).ok()
    }

    /// What a frame holds.
    pub(in crate::container) fn reader(frame: &[u8]) -> io::Result<impl Read> {
        let mut decoder = zstd::stream::read::Decoder::with_buffer(frame)?;
        decoder.window_log_max(WINDOW_LOG_MAX)?;
        Ok(decoder)
    }
}

#[cfg(any(test, not(feature = "encode")))]
mod pure {
    use ruzstd::decoding::StreamingDecoder;

    use super::{Read, WINDOW_LOG_MAX, io};

    /// Nothing: this build stores sections as they are.
    #[cfg(not(feature = "encode"))]
    pub(in crate::container) fn compress(_raw: &[u8]) -> Option<Vec<u8>> {
        None
    }

    /// What a frame holds.
    pub(in crate::container) fn reader(frame: &[u8]) -> io::Result<impl Read> {
        StreamingDecoder::new_with_max_window_size(frame, 1 << WINDOW_LOG_MAX).map_err(io::Error::other)
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::{Read, library, pure};

    #[test]
    fn both_decoders_read_the_same() {
        for length in [0usize, 1, 1000, 100_000, 5 << 20] {
            let raw: Vec<u8> = (0..length).map(|i| (i * i / 7 % 251) as u8).collect();
            let frame = library::compress(&raw).unwrap();
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            pure::reader(&frame).unwrap().read_to_end(&mut ours).unwrap();
            library::reader(&frame).unwrap().read_to_end(&mut theirs).unwrap();
            assert!(ours == raw && theirs == raw, "{length} bytes");
            for cut in [frame.len() / 2, frame.len().saturating_sub(1)] {
                let whole = pure::reader(&frame[..cut]).and_then(|mut reader| {
                    let mut part = Vec::new();
                    reader.read_to_end(&mut part).map(|_| part)
                });
                assert!(
                    whole.is_err() || whole.is_ok_and(|part| part.len() <= raw.len()),
                    "{length} cut at {cut}"
                );
            }
        }
    }
}

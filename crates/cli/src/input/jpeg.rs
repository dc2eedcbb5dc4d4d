//! The segments of a JPEG, as far as its decoder does not tell them.

/// Facts from the segments.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Outline {
    /// Components by the frame header.
    pub(super) components: Option<u8>,
    /// True where the last scan is followed by the end marker.
    pub(super) is_whole: bool,
}

/// Walks the segments of `bytes`, a JPEG, to its end marker or to the end.
pub(super) fn outline(bytes: &[u8]) -> Outline {
    let mut found = Outline::default();
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        // Coded data goes on over stuffed zeros and restart markers; fill bytes may stand before a marker.
        let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff | 0xd0..=0xd7);
        let Some(start) = rest.windows(2).position(is_marker) else { return found };
        let marker = rest[start + 1];
        rest = &rest[start + 2..];
        if marker == 0xd9 {
            return Outline { is_whole: true, ..found };
        }
        let Some(&[high, low]) = rest.first_chunk() else { return found };
        let is_frame = matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc);
        if is_frame && found.components.is_none() {
            found.components = rest.get(7).copied();
        }
        let Some(after) = rest.get(usize::from(u16::from_be_bytes([high, low]))..) else { return found };
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_jpeg_is_not_whole_and_a_thumbnail_ends_nothing() {
        // A thumbnail in an application segment, a frame of three components, and a scan with stuffed and restart bytes.
        let thumbnail = [0xff, 0xe1, 0, 6, 0xff, 0xd8, 0xff, 0xd9];
        let frame = [0xff, 0xc0, 0, 8, 8, 0, 1, 0, 1, 3];
        let scan = [0xff, 0xda, 0, 3, 1, 0x12, 0xff, 0, 0xff, 0xd3, 0x34, 0xff, 0xff, 0xd9];
        let whole = [&[0xff, 0xd8][..], &thumbnail, &frame, &scan].concat();
        assert_eq!(outline(&whole), Outline { components: Some(3), is_whole: true });
        assert!((0..whole.len()).all(|length| !outline(&whole[..length]).is_whole));
        assert!(outline(&[&whole[..], b"camera's own data"].concat()).is_whole);
    }
}

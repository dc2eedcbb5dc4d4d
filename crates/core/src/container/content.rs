//! Texel content that several codecs embed: its number in a file.

/// The only section ids of a codec that embeds content several times end with a digit.
const MAX_NUMBER: u8 = 9;

/// Number of a content in its file, 0 to 9.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ContentId(u8);

impl ContentId {
    /// The only content of a file.
    pub const ONLY: ContentId = ContentId(0);
    /// The second content of a file.
    pub const SECOND: ContentId = ContentId(1);

    /// That number; `None` above 9.
    #[must_use]
    pub fn new(number: u8) -> Option<Self> {
        (number <= MAX_NUMBER).then_some(ContentId(number))
    }

    /// Id of a section of this content: three letters, and the number as a digit.
    #[must_use]
    pub fn section(self, name: [u8; 3]) -> [u8; 4] {
        [name[0], name[1], name[2], b'0' + self.0]
    }
}

//! Typed errors by fault. Each message ends with what to do.

use crate::LimitError;
use crate::id::{CodecId, String4};

/// What a parameter was set to: a number, or the name of a choice.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ParamValue {
    /// A number.
    Number(f64),
    /// The name of a choice, as users write it.
    Word(&'static str),
}

impl std::fmt::Display for ParamValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ParamValue::Number(number) => write!(f, "{number}"),
            ParamValue::Word(word) => f.write_str(word),
        }
    }
}

impl From<f64> for ParamValue {
    fn from(number: f64) -> Self {
        ParamValue::Number(number)
    }
}

impl From<f32> for ParamValue {
    fn from(number: f32) -> Self {
        // By way of its shortest text, so that a message says 0.1 and not 0.10000000149011612.
        ParamValue::Number(number.to_string().parse().unwrap_or(f64::from(number)))
    }
}

impl From<u32> for ParamValue {
    fn from(number: u32) -> Self {
        ParamValue::Number(f64::from(number))
    }
}

impl From<u8> for ParamValue {
    fn from(number: u8) -> Self {
        ParamValue::Number(f64::from(number))
    }
}

impl From<&'static str> for ParamValue {
    fn from(word: &'static str) -> Self {
        ParamValue::Word(word)
    }
}

/// A parameter out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("parameter {field} is {value}; allowed: {range}")]
pub struct ParamError {
    /// Name of the field.
    pub field: &'static str,
    /// What it was.
    pub value: ParamValue,
    /// What it may be, as text such as "4..=256".
    pub range: &'static str,
}

impl ParamError {
    /// The parameter `field` was set to `value`, where only `range` is allowed.
    pub fn new(field: &'static str, value: impl Into<ParamValue>, range: &'static str) -> Self {
        ParamError { field, value: value.into(), range }
    }
}

/// What is wrong with a source.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// No image at all.
    #[error("the source holds no image; give at least one")]
    Empty,
    /// A side of 0 texels.
    #[error("image {index} is {width}x{height}; give images of at least 1x1 texels")]
    ZeroSize {
        /// Which image.
        index: usize,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A side too long for the encoded form.
    #[error("image {index} is {width}x{height}, longer than {max} texels a side; split it or scale it down")]
    TooLarge {
        /// Which image.
        index: usize,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Longest side that can be encoded.
        max: u32,
    },
    /// Something other than 1 to 4 channels.
    #[error("{channels} channels; give images of 1 to 4 channels")]
    Channels {
        /// Channels found.
        channels: u8,
    },
    /// Data of another length than width x height x channels.
    #[error("{found} values for an image that needs {needed}; give width x height x channels values")]
    Length {
        /// Values found.
        found: usize,
        /// Values needed.
        needed: usize,
    },
    /// NaN or infinite values.
    #[error("a value of image {index} is not a finite number; replace NaN and infinities")]
    NotFinite {
        /// Which image.
        index: usize,
    },
    /// Images of one set that do not agree.
    #[error(
        "image {index} differs in {what} from the first; give images that agree or compress each by itself"
    )]
    Unlike {
        /// Which image.
        index: usize,
        /// What differs.
        what: &'static str,
    },
    /// Maps of a material, for a codec of images of one kind.
    #[error("only the codec dct takes the maps of a material; compress each map by itself")]
    Maps,
    /// A map's name that no file can have, or that another map has.
    #[error(
        "{name:?} cannot name a map; give each map of a material a name of its own of 1 to 64 bytes, as files are named"
    )]
    MapName {
        /// The name.
        name: String,
    },
    /// More maps than a file can name.
    #[error("{maps} maps in a material; give at most 64")]
    TooManyMaps {
        /// Maps found.
        maps: usize,
    },
    /// A guidance map that does not fit.
    #[error("the {map} does not fit: {what}; give one for the same image")]
    Guidance {
        /// Which map.
        map: &'static str,
        /// What is wrong.
        what: &'static str,
    },
    /// No result of the codec can meet the goal.
    #[error("{what}; ask for less, or choose another codec")]
    OutOfReach {
        /// What cannot be, as a sentence.
        what: &'static str,
    },
    /// An encoded form has no room for a further source.
    #[error("{what}")]
    Full {
        /// The full part and a way out, as a sentence.
        what: &'static str,
    },
}

/// Why encoding failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// A parameter out of range.
    #[error(transparent)]
    Params(#[from] ParamError),
    /// An unsuitable source.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A limit reached.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The codec cannot add images to a texture that is encoded already.
    #[error("codec {codec} cannot take further images; use {instead} for growing sets")]
    CannotGrow {
        /// Which codec.
        codec: CodecId,
        /// Name of a codec that can.
        instead: &'static str,
    },
    /// The caller cancelled the job.
    #[error("cancelled; start it again to have the result")]
    Cancelled,
    /// A fault of the codec's own; see `source()`.
    #[error("{codec} could not encode this; see the cause")]
    Codec {
        /// Which codec.
        codec: CodecId,
        /// The codec's own error.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

/// Why loading failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// Not a `.txf` file.
    #[error("not a .txf file; give a file that Texfold wrote")]
    NotTexfold,
    /// A codec that this reader does not have.
    #[error("the file holds codec number {found}; open it with a Texfold that has that codec")]
    NotThisCodec {
        /// Number found.
        found: u16,
    },
    /// Another format version.
    #[error(
        "the file is of format version {found}, this reader knows {supported}; update Texfold, or encode the source again where the file is older"
    )]
    Version {
        /// Version found.
        found: u16,
        /// The version known.
        supported: u16,
    },
    /// The file ends before something that is needed.
    #[error("the file ends before section '{section}' is whole; fetch the rest of it")]
    Truncated {
        /// First section that is missing.
        section: String4,
    },
    /// A value that no writer writes.
    #[error("section '{section}' at byte {offset}: {what}; fetch or write the file again")]
    Corrupt {
        /// Section that is wrong.
        section: String4,
        /// Where in the section.
        offset: u64,
        /// What is wrong.
        what: &'static str,
    },
    /// A limit reached.
    #[error(transparent)]
    Limit(#[from] LimitError),
}

/// Why a region cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegionError {
    /// No such image.
    #[error("image {image} of {images}; ask for one below that number")]
    NoSuchImage {
        /// Asked for.
        image: u32,
        /// How many there are.
        images: usize,
    },
    /// No such mip level.
    #[error("level {level} of {levels}; ask for one below that number")]
    NoSuchLevel {
        /// Asked for.
        level: u32,
        /// How many there are.
        levels: u32,
    },
    /// The rectangle leaves the image.
    #[error("the rectangle leaves the level's {width}x{height} texels; cut it to them")]
    Outside {
        /// Columns of the level.
        width: u32,
        /// Rows of the level.
        height: u32,
    },
    /// The output has another length than the region.
    #[error("room for {found} texels where the region has {needed}; give exactly that many")]
    OutputLength {
        /// Length of the output.
        found: usize,
        /// Texels of the region.
        needed: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_named_in_numbers_and_in_words() {
        let number = ParamError::new("codebook", 3u32, "4..=256");
        assert_eq!(number.to_string(), "parameter codebook is 3; allowed: 4..=256");
        let word = ParamError::new("content", "bc3", "raw, bc1 and bc7");
        assert_eq!(word.to_string(), "parameter content is bc3; allowed: raw, bc1 and bc7");
        assert_eq!(
            ParamError::new("tau", 0.1f32, "1..=2").to_string(),
            "parameter tau is 0.1; allowed: 1..=2"
        );
        let codec = CodecId { number: 1, name: "bc" };
        assert_eq!(
            EncodeError::CannotGrow { codec, instead: "vq" }.to_string(),
            "codec bc cannot take further images; use vq for growing sets"
        );
    }
}

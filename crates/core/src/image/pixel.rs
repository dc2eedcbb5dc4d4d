//! What the channels of an image mean.

use super::ColorSpace;

/// How alpha is to be read.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Alpha {
    /// Every texel is opaque, or there is no alpha channel.
    #[default]
    Opaque,
    /// Colour is stored unmultiplied.
    Straight,
    /// A texel is drawn where alpha is at least this threshold (0 to 1); mip levels keep the covered share.
    Cutout(f32),
}

/// Precision of the values that a raster was made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Depth {
    /// 8 bits a channel.
    #[default]
    Eight,
    /// 16 bits a channel.
    Sixteen,
}

/// What the channels of a raster are.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PixelInfo {
    /// 1 gray, 2 gray + alpha, 3 RGB, 4 RGB + alpha.
    pub channels: u8,
    /// Precision of the source.
    pub depth: Depth,
    /// Meaning of the colour channels.
    pub color: ColorSpace,
    /// Meaning of the alpha channel.
    pub alpha: Alpha,
}

impl PixelInfo {
    /// Colour channels: 1 or 3.
    #[must_use]
    pub fn color_channels(self) -> u8 {
        if self.channels < 3 { 1 } else { 3 }
    }

    /// Whether there is an alpha channel.
    #[must_use]
    pub fn has_alpha(self) -> bool {
        self.channels.is_multiple_of(2)
    }
}

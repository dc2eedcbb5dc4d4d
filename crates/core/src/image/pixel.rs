//! What the channels of an image mean.

use super::ColorSpace;

/// Meaning of the channel beside gray or RGB.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Alpha {
    /// Every texel is opaque, or there is no alpha channel.
    #[default]
    Opaque,
    /// Colour is stored unmultiplied.
    Straight,
    /// A texel is drawn where alpha is at least this threshold (0 to 1); mip levels keep the covered share.
    Cutout(f32),
    /// The channel is a band of its own, such as near infrared: it counts as colours do, and texels are opaque.
    Band,
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
    /// 1 gray, 2 gray + alpha or a band, 3 RGB, 4 RGB + alpha or a band.
    pub channels: u8,
    /// Precision of the source.
    pub depth: Depth,
    /// Meaning of the colour channels.
    pub color: ColorSpace,
    /// Meaning of the second or fourth channel.
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
        self.has_extra() && self.alpha != Alpha::Band
    }

    /// Whether texels whose alpha is 0 show nothing: alpha of data, such as of normals, hides none of it.
    #[must_use]
    pub fn hides_colors(self) -> bool {
        self.has_alpha() && self.color == ColorSpace::Srgb
    }

    /// Whether there is a channel beside gray or RGB: alpha or a band.
    #[must_use]
    pub fn has_extra(self) -> bool {
        self.channels.is_multiple_of(2)
    }

    /// Channels of a [`crate::Texel`] that count as colours: those of [`PixelInfo::color_channels`], and a band.
    #[must_use]
    pub fn counted_channels(self) -> &'static [usize] {
        match (self.channels, self.alpha) {
            (2, Alpha::Band) => &[0, 3],
            (4, Alpha::Band) => &[0, 1, 2, 3],
            (1 | 2, _) => &[0],
            _ => &[0, 1, 2],
        }
    }
}

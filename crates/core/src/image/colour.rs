//! Colour spaces as tags, and the one conversion that filtering needs (IEC 61966-2-1).

/// What the stored values of a raster mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum ColorSpace {
    /// Colour encoded with the sRGB transfer function; alpha is linear.
    #[default]
    Srgb,
    /// Values proportional to what they measure: roughness, masks, heights.
    Linear,
    /// Unit vectors stored as `v * 0.5 + 0.5` in the first three channels.
    Normal,
}

/// Decodes one sRGB value in [0, 1] to linear light.
#[must_use]
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Encodes linear light in [0, 1] to sRGB.
#[must_use]
pub fn linear_to_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_round_trip() {
        for byte in 0..=255u8 {
            let value = f32::from(byte) / 255.0;
            let back = linear_to_srgb(srgb_to_linear(value));
            assert!((back - value).abs() < 1e-4, "{byte}: {back}");
        }
        assert!((srgb_to_linear(0.5) - 0.214_041).abs() < 1e-5);
    }
}

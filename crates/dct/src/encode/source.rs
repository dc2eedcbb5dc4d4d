//! What is encoded.

use texfold_core::image::{Depth, Raster};
use texfold_core::{ImageSize, MAX_IMAGE_SIDE, SourceError};

use super::hidden::fill;
use crate::form::{MAX_CHANNELS, MAX_GROUP};

/// An image of 1 to 16 channels, in groups that share axes.
#[derive(Debug, Clone)]
pub struct DctSource {
    pub(super) size: ImageSize,
    pub(super) depth: u8,
    pub(super) groups: Vec<u8>,
    /// Whether the last channel is alpha.
    pub(super) has_alpha: bool,
    pub(super) samples: Vec<u16>,
}

impl DctSource {
    /// An image of samples of 8 or 16 bits, texel by texel, row by row; `groups` has the number of channels of each group, 1 to 4.
    ///
    /// # Errors
    /// [`SourceError`] where sizes, groups and samples do not fit.
    pub fn new(size: ImageSize, groups: &[u8], depth: u8, samples: Vec<u16>) -> Result<Self, SourceError> {
        let ImageSize { width, height } = size;
        if width == 0 || height == 0 {
            return Err(SourceError::ZeroSize { index: 0, width, height });
        }
        if width.max(height) > MAX_IMAGE_SIDE {
            return Err(SourceError::TooLarge { index: 0, width, height, max: MAX_IMAGE_SIDE });
        }
        let channels: usize = groups.iter().map(|&channels| usize::from(channels)).sum();
        let fits = groups.iter().all(|&channels| (1..=MAX_GROUP).contains(&usize::from(channels)));
        if !fits || !(1..=MAX_CHANNELS).contains(&channels) {
            return Err(SourceError::Channels { channels: channels.min(usize::from(u8::MAX)) as u8 });
        }
        let needed = size.texels() as usize * channels;
        if samples.len() != needed {
            return Err(SourceError::Length { found: samples.len(), needed });
        }
        let largest = if depth > 8 { u16::MAX } else { u16::from(u8::MAX) };
        if (depth != 8 && depth != 16) || samples.iter().any(|&sample| sample > largest) {
            return Err(SourceError::Unlike { index: 0, what: "its samples' depth" });
        }
        Ok(DctSource { size, depth, groups: groups.to_vec(), has_alpha: false, samples })
    }

    /// An image of 8-bit samples.
    ///
    /// # Errors
    /// As [`DctSource::new`].
    pub fn from_u8(size: ImageSize, groups: &[u8], samples: &[u8]) -> Result<Self, SourceError> {
        Self::new(size, groups, 8, samples.iter().map(|&sample| u16::from(sample)).collect())
    }

    /// An image of values from 0 to 1, which are rounded to samples of that depth: gray or colours, with a band beside
    /// them, and alpha in a group of its own.
    ///
    /// # Errors
    /// As [`DctSource::new`].
    pub fn from_raster(image: &Raster, depth: Depth) -> Result<Self, SourceError> {
        let groups: &[u8] = match (image.info().channels, image.info().has_alpha()) {
            (2, true) => &[1, 1],
            (4, true) => &[3, 1],
            (1, _) => &[1],
            (2, _) => &[2],
            (3, _) => &[3],
            _ => &[4],
        };
        let (bits, largest) = match depth {
            Depth::Eight => (8, f32::from(u8::MAX)),
            Depth::Sixteen => (16, f32::from(u16::MAX)),
        };
        let sample = |value: f32| (value.clamp(0.0, 1.0) * largest + 0.5) as u16;
        let source = Self::new(image.size(), groups, bits, image.values().map(sample).collect())?;
        Ok(DctSource { has_alpha: image.info().has_alpha(), ..source })
    }

    /// With colours that cost next to nothing where channel `alpha` is 0, and so hides them; all channels but `alpha` change
    /// there. Nothing changes where there is no such channel.
    #[must_use]
    pub fn with_free_colours(self, alpha: usize) -> Self {
        let channels = self.channels();
        if alpha >= channels {
            return self;
        }
        let visible: Vec<bool> = self.samples.chunks_exact(channels).map(|texel| texel[alpha] > 0).collect();
        self.with_free_colours_but(alpha, &visible)
    }

    /// With colours that cost next to nothing in all texels but those that count: all channels but `alpha` change there. Nothing
    /// changes where `counts` has not a value for each texel.
    #[must_use]
    pub fn with_free_colours_but(mut self, alpha: usize, counts: &[bool]) -> Self {
        let channels = self.channels();
        if counts.len() * channels == self.samples.len() {
            fill(&mut self.samples, self.size, (channels, alpha), counts);
        }
        self
    }

    /// Number of channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.groups.iter().map(|&channels| usize::from(channels)).sum()
    }

    /// The samples.
    #[must_use]
    pub fn samples(&self) -> &[u16] {
        &self.samples
    }
}

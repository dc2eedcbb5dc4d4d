//! Texels of textures in blocks, read back.

use texfold_core::Rect;
use texfold_shaders::DctPlan;

use crate::{DctChannel, DctDecoder, DctImage, Gpu, GpuError};

/// Texels along the side of a tile that is read back.
const TILE_SIDE: u32 = 2048;

impl DctDecoder {
    /// The texels of a rectangle, read back row by row: the samples as they are, whole numbers.
    ///
    /// # Errors
    /// As [`DctDecoder::decode`]; rectangles may be of any size.
    pub fn decode_texels(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        rect: Rect,
        channels: [DctChannel; 4],
    ) -> Result<Vec<[u16; 4]>, GpuError> {
        DctPlan::new(image.layout(), rect)?;
        let mut texels = vec![[0; 4]; rect.width as usize * rect.height as usize];
        for top in (0..rect.height).step_by(TILE_SIDE as usize) {
            for left in (0..rect.width).step_by(TILE_SIDE as usize) {
                let (width, height) =
                    ((rect.width - left).min(TILE_SIDE), (rect.height - top).min(TILE_SIDE));
                let tile = Rect { x: rect.x + left, y: rect.y + top, width, height, ..rect };
                let texture = self.decode(gpu, image, tile, channels)?;
                let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                gpu.guarded(|| {
                    gpu.read_rows(encoder, &texture, |y, line| {
                        let start = (top + y) as usize * rect.width as usize + left as usize;
                        read_line(line, &mut texels[start..start + width as usize]);
                    })
                })?;
            }
        }
        Ok(texels)
    }
}

/// Texels of a row: four bytes or four times two bytes each.
fn read_line(line: &[u8], texels: &mut [[u16; 4]]) {
    let wide = line.len() >= 8 * texels.len();
    for (number, sample) in texels.as_flattened_mut().iter_mut().enumerate() {
        *sample = if wide {
            u16::from_le_bytes([line[2 * number], line[2 * number + 1]])
        } else {
            u16::from(line[number])
        };
    }
}

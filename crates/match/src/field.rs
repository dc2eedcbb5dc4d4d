//! Images to search in.

use glam::Vec4;

/// An image in memory for searching: texels in row order, values 0 to 255.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Field {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// All texels, row by row.
    pub texels: Vec<Vec4>,
}

impl Field {
    /// The texel at (`x`, `y`), both clamped to the field.
    #[must_use]
    #[inline]
    pub fn at(&self, x: i32, y: i32) -> Vec4 {
        let x = x.clamp(0, self.width as i32 - 1) as usize;
        let y = y.clamp(0, self.height as i32 - 1) as usize;
        self.texels[y * self.width + x]
    }

    /// Mean of red, green and blue of every texel.
    #[must_use]
    pub fn luma(&self) -> Vec<f32> {
        self.texels.iter().map(|texel| (texel.x + texel.y + texel.z) * (1.0 / 3.0)).collect()
    }
}

/// Sums of luma over rectangles in constant time (Crow 1984).
#[derive(Debug, Clone)]
pub struct LumaSums {
    stride: usize,
    sums: Vec<u32>,
}

impl LumaSums {
    /// Sums of the three colour channels, rounded to whole numbers.
    #[must_use]
    pub fn new(field: &Field) -> Self {
        let stride = field.width + 1;
        let mut sums = vec![0u32; stride * (field.height + 1)];
        for y in 0..field.height {
            let mut row = 0u32;
            for x in 0..field.width {
                let texel = field.texels[y * field.width + x];
                let value = (texel.x + texel.y + texel.z).clamp(0.0, 765.0);
                row = row.wrapping_add((value + 0.5) as u32);
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1].wrapping_add(row);
            }
        }
        LumaSums { stride, sums }
    }

    /// Columns and rows of the image.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.stride - 1, self.sums.len() / self.stride - 1)
    }

    /// Sum over columns `x..x + width` and rows `y..y + height`, which lie inside. Differences of wrapped sums are right as
    /// long as the rectangle's own sum fits 32 bits: up to 5 million texels.
    #[must_use]
    #[inline]
    pub fn sum(&self, x: usize, y: usize, width: usize, height: usize) -> f32 {
        let at = |x: usize, y: usize| self.sums[y * self.stride + x];
        let lower = at(x + width, y + height).wrapping_sub(at(x, y + height));
        let upper = at(x + width, y).wrapping_sub(at(x, y));
        lower.wrapping_sub(upper) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_texels() {
        let texels = (0..7 * 5).map(|i| Vec4::new(i as f32, 2.0, 3.0, 255.0)).collect();
        let field = Field { width: 7, height: 5, texels };
        let sums = LumaSums::new(&field);
        let slow: f32 = (1..4).flat_map(|y| (2..7).map(move |x| (y * 7 + x) as f32 + 5.0)).sum();
        assert_eq!(sums.sum(2, 1, 5, 3), slow);
        assert_eq!(field.at(-3, 9), field.at(0, 4));
    }
}

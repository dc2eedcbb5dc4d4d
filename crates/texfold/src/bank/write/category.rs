//! Categories: tiles by what colours they have.
//!
//! A tile's colours are the shares of 4 x 4 x 4 ranges of red, green and blue. The first tiles of a bank are divided by
//! k-means (k-means++ starts, seeded); later ones join the nearest category, or open a new one where that is far. The
//! user may name the category of an image: its colours are then the mean of the first images of that name, and others
//! join it.

use ndarray::Array2;
use texfold_codebook::{Settings, build};
use texfold_core::image::Raster;

use super::super::Category;
use super::WriteError;

/// Ranges of a channel.
const RANGES: usize = 4;
/// Shares of a tile.
const COLOURS: usize = RANGES * RANGES * RANGES;
/// Most categories of a bank: the paper's six.
const MOST: usize = 6;
/// Texels that are counted in each direction.
const COUNTED: u32 = 256;
/// Where k-means starts from.
const SEED: u64 = 0x7e8f_01d5;
/// Distance of shares (0 to 2, the sum of differences) from which a tile opens a category of its own.
const FAR: f32 = 1.2;

/// Most categories that a user may name.
const MOST_NAMED: usize = 64;

/// The categories of a bank, as images join them.
#[derive(Debug, Clone)]
pub struct Categories(Vec<Category>);

impl Categories {
    /// Those of a bank.
    #[must_use]
    pub fn of(categories: Vec<Category>) -> Categories {
        Categories(categories)
    }

    /// The categories.
    #[must_use]
    pub fn into_inner(self) -> Vec<Category> {
        self.0
    }

    /// Makes a category of that name, with the mean of such colours ([`colours`]), where there is none and room for one.
    pub fn name(&mut self, name: &str, tiles: &[Vec<f32>]) {
        named(&mut self.0, name, tiles);
    }

    /// Divides tiles of such colours into the first categories, where there are none.
    pub fn begin(&mut self, tiles: &[Vec<f32>]) {
        if self.0.is_empty() {
            self.0 = divide(tiles, SEED);
        }
    }

    /// The categories that tiles of such colours join: that of the name, or those of the nearest colours, which may be new.
    ///
    /// # Errors
    /// [`WriteError::Categories`] where there is no room for the name.
    pub fn join(&mut self, name: Option<&str>, tiles: &[Vec<f32>]) -> Result<Vec<usize>, WriteError> {
        let Some(name) = name else {
            return Ok(tiles.iter().map(|colours| join(&mut self.0, colours.clone())).collect());
        };
        let number = named(&mut self.0, name, &[]).ok_or(WriteError::Categories { most: MOST_NAMED })?;
        Ok(vec![number; tiles.len()])
    }
}

fn category(name: Option<String>, colours: Vec<f32>) -> Category {
    Category { name, colours, tiles: 0, file: None, rows: 0 }
}

/// The category of that name, with the mean of such colours where it is new; `None` where there are too many.
fn named(categories: &mut Vec<Category>, name: &str, tiles: &[Vec<f32>]) -> Option<usize> {
    let known = categories.iter().position(|category| category.name.as_deref() == Some(name));
    if known.is_some() || categories.len() >= MOST_NAMED {
        return known;
    }
    let mut colours = vec![0.0; COLOURS];
    for tile in tiles {
        colours.iter_mut().zip(tile).for_each(|(sum, share)| *sum += share / tiles.len() as f32);
    }
    categories.push(category(Some(name.to_owned()), colours));
    Some(categories.len() - 1)
}

/// The shares of colours of a tile: of 4 x 4 x 4 ranges of red, green and blue, of a part of its texels.
#[must_use]
pub fn colours(tile: &Raster) -> Vec<f32> {
    let size = tile.size();
    let mut counts = vec![0u32; COLOURS];
    let step = |side: u32| side.div_ceil(COUNTED).max(1) as usize;
    let mut sum = 0;
    for y in (0..size.height).step_by(step(size.height)) {
        for x in (0..size.width).step_by(step(size.width)) {
            let texel = tile.texel(x, y);
            let range = |value: f32| ((value * RANGES as f32) as usize).min(RANGES - 1);
            counts[(range(texel.x) * RANGES + range(texel.y)) * RANGES + range(texel.z)] += 1;
            sum += 1;
        }
    }
    counts.into_iter().map(|count| count as f32 / sum.max(1) as f32).collect()
}

/// Categories for tiles of such colours: fewer than [`MOST`] where tiles are alike.
fn divide(tiles: &[Vec<f32>], seed: u64) -> Vec<Category> {
    let values: Vec<f32> = tiles.iter().flatten().copied().collect();
    let Ok(vectors) = Array2::from_shape_vec((tiles.len(), COLOURS), values) else { return Vec::new() };
    let settings = Settings { seed, ..Settings::default() };
    let found = build(vectors.view(), &vec![1.0; tiles.len()], MOST.min(tiles.len()), settings);
    let mut categories: Vec<Category> = Vec::new();
    for row in found.codewords.rows() {
        let colours = row.to_vec();
        let near = categories.iter().any(|known| distance(&known.colours, &colours) < FAR * 0.5);
        if !near {
            categories.push(category(None, colours));
        }
    }
    categories
}

/// The category that a tile joins, which may be a new one.
fn join(categories: &mut Vec<Category>, colours: Vec<f32>) -> usize {
    let away = |category: &Category| distance(&category.colours, &colours);
    let nearest =
        (0..categories.len()).min_by(|&a, &b| away(&categories[a]).total_cmp(&away(&categories[b])));
    match nearest.filter(|&nearest| away(&categories[nearest]) < FAR || categories.len() >= MOST) {
        Some(nearest) => nearest,
        None => {
            categories.push(category(None, colours));
            categories.len() - 1
        }
    }
}

fn distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::ColorSpace;

    fn plain(colour: [u8; 3]) -> Vec<f32> {
        let bytes: Vec<u8> = (0..64).flat_map(|_| colour).collect();
        colours(&Raster::from_u8(8, 8, 3, ColorSpace::Srgb, &bytes).unwrap())
    }

    #[test]
    fn tiles_of_like_colours_share_a_category() {
        let tiles: Vec<Vec<f32>> =
            [[10, 90, 20], [12, 95, 22], [200, 180, 90], [20, 30, 200], [14, 99, 5]].map(plain).to_vec();
        let mut categories = divide(&tiles, 1);
        assert_eq!(categories.len(), 3);
        let joined: Vec<usize> = tiles.iter().map(|tile| join(&mut categories, tile.clone())).collect();
        assert!(joined[0] == joined[1] && joined[0] == joined[4] && joined[0] != joined[2]);
        let new = join(&mut categories, plain([255, 255, 255]));
        assert_eq!((new, categories.len()), (3, 4));
        // A named one is the nearest for tiles of its colours.
        let snow = [plain([240, 5, 240]), plain([250, 10, 250])];
        assert_eq!(named(&mut categories, "snow", &snow), Some(4));
        assert_eq!(named(&mut categories, "snow", &[]), Some(4));
        assert_eq!(join(&mut categories, plain([244, 8, 244])), 4);
    }
}

//! Images with what surrounds them, where they are tiles of larger ones: reduced in step with the tile, so that a texel of
//! the reduced one covers the same place whatever the tile's size.

use rayon::prelude::*;
use texfold_core::image::Raster;
use texfold_core::{ImageSize, Texel};

use crate::APRON;

/// An image and as many texels more on each side.
#[derive(Debug, Clone)]
pub struct PaddedRaster {
    /// The image and its padding.
    pub raster: Raster,
    /// Texels beyond each border of the image; 0 where nothing is known of them.
    pub padding: u32,
}

impl PaddedRaster {
    /// An image with `padding` texels on each side, at most [`APRON`]. `around` is the image with [`APRON`] of them:
    /// `None` where it is of another size.
    #[must_use]
    pub fn new(around: &Raster, image: ImageSize, padding: u32) -> Option<PaddedRaster> {
        let whole = around.size();
        let fits = whole.width == image.width + 2 * APRON && whole.height == image.height + 2 * APRON;
        fits.then(|| PaddedRaster { raster: cut(around, APRON - padding), padding })
    }

    /// An image of which no more is known.
    #[must_use]
    pub fn alone(image: Raster) -> PaddedRaster {
        PaddedRaster { raster: image, padding: 0 }
    }

    /// Columns and rows of the image.
    #[must_use]
    pub fn inner(&self) -> ImageSize {
        let ImageSize { width, height } = self.raster.size();
        ImageSize { width: width - 2 * self.padding, height: height - 2 * self.padding }
    }

    /// The same with `padding` texels on each side, or as many as there are.
    #[must_use]
    pub fn within(&self, padding: u32) -> PaddedRaster {
        let padding = padding.min(self.padding);
        PaddedRaster { raster: cut(&self.raster, self.padding - padding), padding }
    }

    /// The mean of what each texel covers, values as they are stored, in an image of `size` texels, of which `padding`
    /// lie on each side and the others are the image. `level` is a mip level of the raster. Hidden colours count where
    /// nothing else is seen.
    #[must_use]
    pub fn reduced(&self, level: &Raster, size: ImageSize, padding: f64) -> Vec<Texel> {
        let inner = self.inner();
        let whole = self.raster.size();
        let shares = |count: u32, (inner, whole, held): (u32, u32, u32)| -> Vec<(usize, Vec<f32>)> {
            let step = f64::from(inner) / (f64::from(count) - 2.0 * padding);
            let place = |at: u32| (f64::from(at) - padding) * step + f64::from(self.padding);
            let scale = f64::from(held) / f64::from(whole);
            (0..count).map(|at| covered(place(at) * scale, place(at + 1) * scale, held)).collect()
        };
        let held = level.size();
        let columns = shares(size.width, (inner.width, whole.width, held.width));
        let rows = shares(size.height, (inner.height, whole.height, held.height));
        let plain = means(level, &columns, &rows, |texel| texel);
        if !self.raster.info().has_alpha() {
            return plain;
        }
        let weighted = means(level, &columns, &rows, |texel| (texel.truncate() * texel.w).extend(texel.w));
        let seen = |(plain, weighted): (Texel, Texel)| {
            if plain.w > 0.0 { (weighted.truncate() / plain.w).extend(plain.w) } else { plain }
        };
        plain.into_iter().zip(weighted).map(seen).collect()
    }
}

/// Places and shares of the texels that each column or row covers.
type Shares = [(usize, Vec<f32>)];

/// The mean of a value of the texels that columns and rows cover.
fn means(
    level: &Raster,
    columns: &Shares,
    rows: &Shares,
    value: impl Fn(Texel) -> Texel + Sync,
) -> Vec<Texel> {
    let row = |(top, shares): &(usize, Vec<f32>)| -> Vec<Texel> {
        let mut line = vec![Texel::ZERO; level.size().width as usize];
        for (y, &share) in (*top as u32..).zip(shares) {
            (0..).zip(&mut line).for_each(|(x, sum)| *sum += value(level.texel(x, y)) * share);
        }
        let mean = |(left, shares): &(usize, Vec<f32>)| {
            line[*left..].iter().zip(shares).map(|(&texel, &share)| texel * share).sum::<Texel>()
        };
        columns.iter().map(mean).collect()
    };
    rows.par_iter().flat_map_iter(row).collect()
}

/// A raster without its outermost `away` texels on each side.
fn cut(raster: &Raster, away: u32) -> Raster {
    let ImageSize { width, height } = raster.size();
    let (width, height) = (width - 2 * away, height - 2 * away);
    let texel = |i: u32| raster.texel(away + i % width, away + i / width);
    let texels: Vec<Texel> = (0..width * height).map(texel).collect();
    // As many texels as the size says.
    Raster::from_texels(width, height, raster.info(), &texels).unwrap_or_else(|_| raster.clone())
}

/// The first of the `count` texels of a row that lie between two places of it, and the share that each has; the outermost where none does.
fn covered(start: f64, end: f64, count: u32) -> (usize, Vec<f32>) {
    let last = f64::from(count) - 1.0;
    let (first, past) = (start.floor().clamp(0.0, last), (end.ceil() - 1.0).clamp(0.0, last));
    let lengths: Vec<f64> = (first as u32..=past as u32)
        .map(|at| (end.min(f64::from(at) + 1.0) - start.max(f64::from(at))).max(0.0))
        .collect();
    let sum: f64 = lengths.iter().sum();
    if sum <= 0.0 {
        return (first as usize, vec![1.0]);
    }
    (first as usize, lengths.into_iter().map(|length| (length / sum) as f32).collect())
}

#[cfg(test)]
mod tests {
    use texfold_core::image::{Alpha, ColorSpace, MipFilter, mip_chain};

    use super::*;

    #[test]
    fn whole_texels_are_the_means_of_mip_levels() {
        let image = texfold_testkit::image("terrain").tagged(ColorSpace::Linear, Alpha::Opaque);
        let whole = PaddedRaster { raster: image.clone(), padding: 64 };
        let small = mip_chain(&image, 4, MipFilter::Box);
        let found = whole.reduced(&image, small[3].size(), 8.0);
        for (found, wanted) in found.iter().zip(small[3].texels()) {
            assert!((*found - wanted).abs().max_element() < 1e-5, "{found} {wanted}");
        }
        // From a mip level, with as much of it around.
        let found = whole.reduced(&small[1], small[3].size(), 8.0);
        for (found, wanted) in found.iter().zip(small[3].texels()) {
            assert!((*found - wanted).abs().max_element() < 1e-5, "{found} {wanted}");
        }
    }

    #[test]
    fn a_slope_stays_where_it_is_at_any_size() {
        let info = texfold_testkit::image("terrain").tagged(ColorSpace::Linear, Alpha::Opaque).info();
        for (inner, count) in [(15u32, 1u32), (100, 12), (101, 12), (238, 29)] {
            let (padding, beyond) = (32, 4u32);
            let width = inner + 2 * padding;
            let value = |at: f64| (at / f64::from(width)) as f32;
            let texels: Vec<Texel> =
                (0..width * width).map(|i| Texel::splat(value(f64::from(i % width) + 0.5))).collect();
            let raster = Raster::from_texels(width, width, info, &texels).unwrap();
            let around = PaddedRaster { raster, padding };
            let size = ImageSize { width: count + 2 * beyond, height: count + 2 * beyond };
            let found = around.reduced(&around.raster, size, f64::from(beyond));
            // Those whose whole place is known.
            for at in beyond..beyond + count {
                let middle = (f64::from(at - beyond) + 0.5) / f64::from(count);
                let wanted = value(middle * f64::from(inner) + f64::from(padding));
                assert!((found[at as usize].x - wanted).abs() < 2e-3, "{inner} {at}");
            }
        }
    }

    #[test]
    fn the_middle_is_cut_out() {
        let info = texfold_testkit::image("terrain").info();
        let image = ImageSize { width: 10, height: 3 };
        let (width, height) = (image.width + 2 * APRON, image.height + 2 * APRON);
        let value = |x: u32, y: u32| Texel::splat((x * 7 + y * 3) as f32 / 4096.0);
        let texels: Vec<Texel> = (0..width * height).map(|i| value(i % width, i / width)).collect();
        let raster = Raster::from_texels(width, height, info, &texels).unwrap();
        assert!(PaddedRaster::new(&raster, ImageSize { width: 11, height: 3 }, 8).is_none());
        let cut = PaddedRaster::new(&raster, image, 8).unwrap().within(4);
        assert_eq!((cut.inner(), cut.padding), (image, 4));
        assert_eq!(cut.raster.texel(0, 2).x, value(APRON - 4, APRON - 2).x);
        assert_eq!(cut.within(0).raster.texel(9, 2).x, value(APRON + 9, APRON + 2).x);
    }

    #[test]
    fn hidden_colours_are_not_mixed_in() {
        let mut image = texfold_testkit::image("terrain").with_channels(4);
        let size = image.size();
        let half =
            |i: u32, texel: Texel| if i.is_multiple_of(2) { texel } else { Texel::new(1.0, 0.0, 1.0, 0.0) };
        let texels: Vec<Texel> = (0..).zip(image.texels()).map(|(i, texel)| half(i, texel)).collect();
        image = Raster::from_texels(size.width, size.height, image.info(), &texels).unwrap();
        image = image.tagged(ColorSpace::Linear, Alpha::Straight);
        let small = mip_chain(&image, 3, MipFilter::Box);
        let found = PaddedRaster { raster: image.clone(), padding: 16 }.reduced(&image, small[2].size(), 4.0);
        for (found, wanted) in found.iter().zip(small[2].texels()) {
            assert!((*found - wanted).abs().max_element() < 1e-5, "{found} {wanted}");
        }
        // Where all are hidden they stay.
        let hidden: Vec<Texel> = image.texels().map(|texel| texel.truncate().extend(0.0)).collect();
        let hidden = Raster::from_texels(size.width, size.height, image.info(), &hidden).unwrap();
        let found = PaddedRaster::alone(hidden.clone()).reduced(&hidden, small[2].size(), 0.0);
        let opaque = mip_chain(&hidden.with_channels(3), 3, MipFilter::Box);
        for (found, wanted) in found.iter().zip(opaque[2].texels()) {
            assert!((found.truncate() - wanted.truncate()).abs().max_element() < 1e-5, "{found} {wanted}");
        }
    }
}

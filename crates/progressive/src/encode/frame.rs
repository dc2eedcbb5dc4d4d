//! What of images is coded: all levels, or only those from a half or a quarter of the width and height on, enlarged for the others.
//!
//! Below a bit a texel most of an error map's bits say which blocks have none. An image of half the size at four times the bits
//! has the same memory, and what enlarging loses is then less than what the bits buy. The smaller image is the one whose
//! enlargement is nearest to the image, not its mean texel by texel, but where it is a mip level too: found by simultaneous iterative reconstruction (Gilbert,
//! "Iterative methods for the three-dimensional reconstruction of an object from projections", 1972). Cost: a dozen passes over the image.

use glam::{UVec2, Vec2};
use rayon::prelude::*;
use texfold_core::address::{TEXFOLD_CLAMP, TexfoldTap, texfold_tap};
use texfold_core::image::{Alpha, ColorSpace, ImageSet, MipFilter, Raster, mip_chain};
use texfold_core::sample::texfold_bilinear;
use texfold_core::{Effort, Goal, ImageLayout, Texel};

use super::base::levels;
use crate::ProgressiveParams;
use crate::encoded::stored_layout;

/// Bits a texel below which images of a half and of a quarter of the size are tried.
const SMALLER: [f64; 2] = [0.9, 0.4];
/// PSNR in dB below which they are.
const COARSE: f64 = 34.0;
/// Least side of an image that is stored smaller.
const LEAST_SIDE: u32 = 16;
/// Passes of the fit: of 12 the last changes the PSNR of the terrain by 0.006 dB, and 24 leave it 0.02 dB better.
const PASSES: usize = 12;
/// Share of the squared error of the smaller image that is left in the enlarged one: two thirds in each direction where errors are
/// independent, more where they are smooth.
const KEPT: f64 = 0.55;
/// Squared error of a value of 8 bits at 0 dB.
const FULL: f64 = 255.0 * 255.0;

/// Images as they are coded.
#[derive(Debug)]
pub(crate) struct Frame {
    /// The images.
    pub(crate) full: ImageLayout,
    /// Levels that are not stored.
    pub(crate) shrink_log2: u32,
    /// For each image the levels that are.
    pub(crate) chains: Vec<Vec<Raster>>,
    /// Mean squared error of what they show enlarged, in 8-bit units.
    pub(crate) floor: f64,
}

/// The sizes that are tried, as the goal and the pixels need: the first is the whole.
pub(crate) fn shrinks(source: &ImageSet, params: &ProgressiveParams) -> Vec<u32> {
    let least = source.images().iter().map(|image| image.size().width.min(image.size().height)).min();
    let possible = |log2: u32| {
        !source.info().has_alpha() && params.reduce_log2.is_none() && least >= Some(LEAST_SIDE << log2)
    };
    let wanted = |log2: u32| match params.goal {
        Goal::Bpp(bpp) => bpp < SMALLER[log2 as usize - 1],
        Goal::Psnr(psnr) => psnr < COARSE && params.effort != Effort::Fast,
        Goal::Tolerance(_) => false,
    };
    std::iter::once(0).chain((1..=2).filter(|&log2| possible(log2) && wanted(log2))).collect()
}

impl Frame {
    pub(crate) fn new(source: &ImageSet, mips: bool, shrink_log2: u32) -> Frame {
        let mut chains = levels(source, mips);
        let full = source.layout(chains.first().map_or(1, |levels| levels.len() as u32));
        if shrink_log2 == 0 {
            return Frame { full, shrink_log2, chains, floor: 0.0 };
        }
        let (mut sum, mut values) = (0.0, 0.0);
        for (image, chain) in source.images().iter().zip(&mut chains) {
            // Fitted, it would be too sharp for the mip level that it also is.
            let (small, squared) = fitted(image, shrink_log2, if mips { 0 } else { PASSES });
            sum += squared;
            values += (image.size().texels() * u64::from(image.info().color_channels())) as f64;
            let further = chain.drain(..).skip(shrink_log2 as usize + 1);
            *chain = std::iter::once(small).chain(further).collect();
        }
        Frame { full, shrink_log2, chains, floor: FULL * sum / values }
    }

    /// The levels that are stored.
    pub(crate) fn stored(&self) -> ImageLayout {
        stored_layout(&self.full, self.shrink_log2)
    }

    /// The goal for what is stored that serves a goal for the images; `None` where it is out of reach.
    pub(crate) fn inner_goal(&self, goal: Goal) -> Option<Goal> {
        if self.shrink_log2 == 0 {
            return Some(goal);
        }
        match goal {
            Goal::Bpp(bpp) => {
                Some(Goal::Bpp(bpp * self.full.texels() as f64 / self.stored().texels() as f64))
            }
            Goal::Psnr(psnr) => {
                let left = (FULL / 10f64.powf(psnr / 10.0) - self.floor) / KEPT;
                (left > 0.0).then(|| Goal::Psnr(10.0 * (FULL / left).log10()))
            }
            Goal::Tolerance(_) => None,
        }
    }
}

/// The places that texels of the enlarged image are read at: columns or rows.
fn taps(count: u32, small: u32) -> Vec<TexfoldTap> {
    let tap = |at: u32| {
        texfold_tap(Vec2::splat((at as f32 + 0.5) / count as f32), UVec2::splat(small), TEXFOLD_CLAMP)
    };
    (0..count).map(tap).collect()
}

/// The smaller image whose enlargement is nearest to `image`, as far as so many passes come, and that enlargement's squared error in
/// units of the range.
fn fitted(image: &Raster, shrink_log2: u32, passes: usize) -> (Raster, f64) {
    let plain = image.clone().tagged(ColorSpace::Linear, Alpha::Opaque);
    let means = mip_chain(&plain, shrink_log2 + 1, MipFilter::Box);
    let start = means.last().unwrap_or(&plain);
    let (size, full) = (start.size(), image.size());
    let (columns, rows) = (taps(full.width, size.width), taps(full.height, size.height));
    let (width, height) = (size.width as usize, size.height as usize);
    let wanted: Vec<Texel> = image.texels().collect();
    let mut small: Vec<Texel> = start.texels().collect();
    // How much of the enlarged image a column and a row show.
    let share = |taps: &[TexfoldTap], count: usize| {
        let mut shares = vec![0.0f32; count];
        for tap in taps {
            shares[tap.low.x as usize] += 1.0 - tap.weight.x;
            shares[tap.high.x as usize] += tap.weight.x;
        }
        shares
    };
    let (across, down) = (share(&columns, width), share(&rows, height));
    let mut squared = 0.0;
    for pass in 0..=passes {
        // What each row of the image lacks, gathered in the columns of the smaller image.
        let lines: Vec<(Vec<Texel>, f64)> = rows
            .par_iter()
            .zip(wanted.par_chunks(full.width as usize))
            .map(|(tap, line)| lacking(&small, width, (tap, &columns), line))
            .collect();
        squared = lines.iter().map(|(_, squared)| squared).sum();
        if pass == passes {
            break;
        }
        let mut sums = vec![Texel::ZERO; width * height];
        for (tap, (line, _)) in rows.iter().zip(&lines) {
            for (row, weight) in [(tap.low.x, 1.0 - tap.weight.x), (tap.high.x, tap.weight.x)] {
                let own = &mut sums[row as usize * width..][..width];
                own.iter_mut().zip(line).for_each(|(sum, &lack)| *sum += lack * weight);
            }
        }
        for (index, (texel, sum)) in small.iter_mut().zip(sums).enumerate() {
            let shown = (across[index % width] * down[index / width]).max(f32::MIN_POSITIVE);
            *texel = (*texel + sum / shown).clamp(Texel::ZERO, Texel::ONE);
        }
    }
    // As many texels as they were made of.
    let small = Raster::from_texels(size.width, size.height, image.info(), &small);
    (small.unwrap_or_else(|_| start.clone()), squared)
}

/// What a row of the image has beyond the enlarged one, in the columns that show it, and its squares.
fn lacking(
    small: &[Texel],
    width: usize,
    (row, columns): (&TexfoldTap, &[TexfoldTap]),
    line: &[Texel],
) -> (Vec<Texel>, f64) {
    let mut sums = vec![Texel::ZERO; width];
    let mut squared = 0.0;
    let at = |x: u32, y: u32| small[y as usize * width + x as usize];
    for (tap, &wanted) in columns.iter().zip(line) {
        let (left, right) = (tap.low.x, tap.high.x);
        let four = [at(left, row.low.x), at(right, row.low.x), at(left, row.high.x), at(right, row.high.x)];
        let away = wanted - texfold_bilinear(four, Vec2::new(tap.weight.x, row.weight.x));
        sums[left as usize] += away * (1.0 - tap.weight.x);
        sums[right as usize] += away * tap.weight.x;
        squared += f64::from(away.truncate().length_squared());
    }
    (sums, squared)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_is_nearer_than_means_and_nearly_the_nearest() {
        let image = texfold_testkit::picture("terrain");
        let means = mip_chain(&image.clone().tagged(ColorSpace::Linear, Alpha::Opaque), 2, MipFilter::Box);
        let columns = taps(256, 128);
        let texels: Vec<Texel> = means[1].texels().collect();
        let wanted: Vec<Texel> = image.texels().collect();
        let row = |y: usize| lacking(&texels, 128, (&columns[y], &columns), &wanted[256 * y..][..256]).1;
        let of_means: f64 = (0..256).map(row).sum();
        let (small, squared) = fitted(&image, 1, PASSES);
        assert!(small.size().width == 128 && squared < 0.9 * of_means, "{squared} {of_means}");
        // What is left has nothing in common with what a smaller image could show.
        let texels: Vec<Texel> = small.texels().collect();
        let (mut common, mut left) = (0.0, 0.0);
        for y in (0..256).step_by(2) {
            let (sums, squared) = lacking(&texels, 128, (&columns[y], &columns), &wanted[256 * y..][..256]);
            common += sums.iter().map(|sum| f64::from(sum.truncate().length_squared())).sum::<f64>();
            left += squared;
        }
        assert!(common < left, "{common} {left}");
    }
}

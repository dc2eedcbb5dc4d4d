//! No more than needed: mip levels that show what lies under them, patches that show nothing or that others hide.

use glam::DVec2;
use rayon::prelude::*;

use super::canvas::{Canvas, Footprint, Laid, colour, cover};

/// Most texels of a level that are looked at.
const SAMPLES: u32 = 1 << 14;
/// What is seen of a hidden patch at most.
const HIDDEN: f32 = 1.0 / 255.0;

/// Places of a level's texels, evenly thinned, with their index.
fn places((width, height): (u32, u32)) -> (u32, Vec<(u32, u32)>) {
    let stride = (f64::from(width) * f64::from(height) / f64::from(SAMPLES)).sqrt().ceil().max(1.0) as u32;
    let rows = (stride / 2..height).step_by(stride as usize);
    (stride, rows.flat_map(|y| (stride / 2..width).step_by(stride as usize).map(move |x| (x, y))).collect())
}

/// RMS difference in 8-bit units, where the level is shown, between it and what lies under it.
fn difference(laid: &Laid, level: u32, texels: &[[u8; 4]], canvas: &Canvas) -> f64 {
    let size = ((laid.size.0 >> level).max(1), (laid.size.1 >> level).max(1));
    let table = canvas.table(&canvas.touching(&laid.matrix));
    let view = canvas.view(&table);
    let inverse = laid.matrix.inverse();
    let texel = DVec2::new(1.0 / f64::from(size.0), 1.0 / f64::from(size.1));
    let sums: Vec<(f64, f64)> = places(size)
        .1
        .into_par_iter()
        .map(|(x, y)| {
            let own = texels[(y * size.0 + x) as usize];
            let at = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * texel;
            let under = colour(&view, &Footprint::of(&inverse, at, texel)) * 255.0;
            let weight = f64::from(own[3]) / 255.0;
            let squares = (0..3).map(|k| (f64::from(own[k]) - f64::from(under[k])).powi(2)).sum::<f64>();
            (weight * weight * squares / 3.0, weight * weight)
        })
        .collect();
    let (squares, weights) = sums.into_iter().fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d));
    (squares / weights.max(1e-9)).sqrt()
}

/// Leaves out coarse levels that show what the canvas shows, from the coarsest on; all of them where the patch adds nothing.
pub(crate) fn drop_levels(laid: &Laid, levels: &mut Vec<Vec<[u8; 4]>>, canvas: &Canvas, least: f64) -> usize {
    let before = levels.len();
    while let Some(last) = levels.last() {
        if difference(laid, levels.len() as u32 - 1, last, canvas) >= least {
            break;
        }
        levels.pop();
    }
    before - levels.len()
}

/// Patches of which those laid later leave nothing to be seen.
pub(crate) fn hidden(canvas: &Canvas) -> Vec<usize> {
    let table = canvas.table(&[]);
    let view = canvas.view(&table);
    let is_hidden = |index: &usize| {
        let laid = &canvas.laid[*index];
        let inverse = laid.matrix.inverse();
        let texel = DVec2::new(1.0 / f64::from(laid.size.0), 1.0 / f64::from(laid.size.1));
        let later: Vec<u16> =
            canvas.touching(&laid.matrix).into_iter().filter(|&other| usize::from(other) > *index).collect();
        if later.is_empty() {
            return false;
        }
        places(laid.size).1.into_par_iter().all(|(x, y)| {
            let own = canvas.levels[*index][0][(y * laid.size.0 + x) as usize][3];
            let at = Footprint::of(&inverse, (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * texel, texel);
            let seen = later
                .iter()
                .fold(f32::from(own) / 255.0, |seen, &other| seen * (1.0 - cover(&view, other, &at)));
            seen <= HIDDEN
        })
    };
    (0..canvas.laid.len()).filter(is_hidden).collect()
}

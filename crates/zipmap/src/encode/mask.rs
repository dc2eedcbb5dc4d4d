//! Opacity of a patch: by the cost of the cheapest path to its border, where gradients are dear (Eisemann and
//! others 2010; paper section 4, equations 2 and 3).
//!
//! The edge of what is visible thus runs along edges of the image, and where these lack, alpha rises slowly. Deviation:
//! one path for all channels, with the largest gradient of any, where the paper takes the dearest of a path for each.
//! Cost: one pass of Dijkstra's algorithm over whole numbers, linear in the texels (Dial 1969).

use texfold_core::{CancelCheck, Texel};

/// Steps of cost for a change by the whole range.
const UNITS: f32 = 255.0;
/// Least cost of a texel, so that flat parts become opaque too, if far from the border.
const LEAST: u32 = 1;
/// Largest cost of a texel: a change by the whole range on both axes.
const MOST: u32 = 2 * UNITS as u32;
/// Largest limit of costs in units: paths that are dearer are of no texture, and the ring of lists is gone round 130
/// times at most.
const MOST_LIMIT: f32 = 65_000.0;

/// Alpha of each texel, row by row: 0 at the border, 1 from a cost of `tau` on. Of no use once the job is cancelled.
pub(crate) fn geodesic(
    texels: &[Texel],
    (width, height): (usize, usize),
    tau: f32,
    cancel: CancelCheck<'_>,
) -> Vec<f32> {
    let costs = costs(texels, width, height);
    let limit = (tau * UNITS).ceil().clamp(1.0, MOST_LIMIT) as u32;
    let mut reached = vec![u32::MAX; costs.len()];
    // A ring of lists, one for each cost that may be open at a time.
    let mut open: Vec<Vec<u32>> = vec![Vec::new(); (MOST + LEAST) as usize + 1];
    let ring = open.len();
    for y in 0..height {
        for x in (0..width).filter(|&x| x == 0 || y == 0 || x + 1 == width || y + 1 == height) {
            reached[y * width + x] = 0;
            open[0].push((y * width + x) as u32);
        }
    }
    for cost in 0..limit {
        let mut list = std::mem::take(&mut open[cost as usize % ring]);
        while let Some(at) = list.pop().filter(|_| !cancel.is_cancelled()) {
            let at = at as usize;
            if reached[at] != cost {
                continue;
            }
            let (x, y) = (at % width, at / width);
            let near = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then_some(at + width),
            ];
            for next in near.into_iter().flatten() {
                let through = cost + costs[next];
                if through < reached[next] {
                    reached[next] = through;
                    open[through as usize % ring].push(next as u32);
                }
            }
        }
    }
    // What was not reached is farther than the limit.
    reached.into_iter().map(|cost| (cost as f32 / (tau * UNITS)).min(1.0)).collect()
}

/// What it costs to enter each texel.
fn costs(texels: &[Texel], width: usize, height: usize) -> Vec<u32> {
    let cost = |at: usize| {
        let (x, y) = (at % width, at / width);
        let left = texels[if x > 0 { at - 1 } else { at }];
        let above = texels[if y > 0 { at - width } else { at }];
        let change = (texels[at] - left).abs() + (texels[at] - above).abs();
        LEAST + ((change.truncate().max_element() * UNITS) as u32).min(MOST - LEAST)
    };
    (0..width * height).map(cost).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relaxes every texel until nothing changes.
    fn slowly(texels: &[Texel], width: usize, height: usize, tau: f32) -> Vec<f32> {
        let costs = costs(texels, width, height);
        let border = |x: usize, y: usize| x == 0 || y == 0 || x + 1 == width || y + 1 == height;
        let mut reached: Vec<u32> = (0..width * height)
            .map(|at| if border(at % width, at / width) { 0 } else { u32::MAX / 2 })
            .collect();
        loop {
            let before = reached.clone();
            for at in (0..width * height).filter(|at| !border(at % width, at / width)) {
                let near = [at - 1, at + 1, at - width, at + width].map(|k| reached[k]);
                reached[at] = reached[at].min(near.into_iter().min().unwrap_or(0) + costs[at]);
            }
            if before == reached {
                return reached.into_iter().map(|cost| (cost as f32 / (tau * UNITS)).min(1.0)).collect();
            }
        }
    }

    #[test]
    fn quick_costs_are_those_of_the_slow_way() {
        let texel = |i: usize| {
            let hash = (i as u32).wrapping_mul(0x9e37_79b1) >> 20;
            Texel::splat(hash as f32 / 4096.0 * if i % 7 < 3 { 0.02 } else { 0.9 })
        };
        for (width, height, tau) in [(31, 23, 0.5), (31, 23, 4.0), (1, 5, 1.0), (2, 2, 1.0), (3, 3, 0.01)] {
            let texels: Vec<Texel> = (0..width * height).map(texel).collect();
            assert_eq!(
                geodesic(&texels, (width, height), tau, CancelCheck::default()),
                slowly(&texels, width, height, tau)
            );
        }
    }

    /// By `cargo test --release -p texfold-zipmap -- --ignored --nocapture large`; idle.
    #[test]
    #[ignore = "a measurement, for an idle machine"]
    fn a_large_mask_takes_at_most_a_second() {
        let texel =
            |i: usize| Texel::splat((i as u32).wrapping_mul(0x9e37_79b1) as f32 / u32::MAX as f32 * 0.01);
        let texels: Vec<Texel> = (0..2048 * 2048).map(texel).collect();
        let start = std::time::Instant::now();
        let alpha = geodesic(&texels, (2048, 2048), 100.0, CancelCheck::default());
        let seconds = start.elapsed().as_secs_f64();
        println!("2048x2048: {seconds:.2} s, {} in the middle", alpha[1024 * 2049]);
        assert!(seconds < 1.0, "{seconds}");
    }

    #[test]
    fn a_flat_image_is_shown_where_it_is_far_from_its_border() {
        let texels = vec![Texel::splat(0.5); 64 * 64];
        let alpha = geodesic(&texels, (64, 64), 16.0 / UNITS, CancelCheck::default());
        assert_eq!((alpha[0], alpha[32 * 64], alpha[32 * 64 + 8], alpha[32 * 64 + 32]), (0.0, 0.0, 0.5, 1.0));
    }
}

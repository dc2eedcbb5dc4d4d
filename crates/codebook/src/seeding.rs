//! k-means++ seeding (Arthur and Vassilvitskii 2007), exact but with most distances skipped: a new seed is compared with
//! those vectors alone whose nearest seed may be further away.

use texfold_core::rng::XorShift;

use crate::search::Nearest;

/// Vectors whose sampling weights are summed together.
const BLOCK: usize = 256;

struct Seeder<'a> {
    points: &'a [f32],
    padded: usize,
    weights: &'a [f32],
    /// Points in the order of their first number, so that neighbours share a block, and the place of each.
    order: Vec<u32>,
    places: Vec<u32>,
    nearest: Nearest,
    /// Sums of weight x distance over blocks of places.
    sums: Vec<f64>,
}

/// Rows of `points` to start from: at most `count`, fewer where there are fewer distinct points; `None` once `stop` says so.
pub(crate) fn seeds(
    points: &[f32],
    padded: usize,
    weights: &[f32],
    count: usize,
    random: &mut XorShift,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<u32>> {
    let total = weights.len();
    if total <= count {
        return Some((0..total as u32).collect());
    }
    let first_of = |point: u32| points[point as usize * padded];
    let mut order: Vec<u32> = (0..total as u32).collect();
    order.sort_by(|&a, &b| first_of(a).total_cmp(&first_of(b)).then(a.cmp(&b)));
    let mut places = vec![0; total];
    order.iter().zip(0..).for_each(|(&point, place)| places[point as usize] = place);
    let nearest = Nearest::new(points, padded);
    let sums = vec![0.0; total.div_ceil(BLOCK)];
    let mut seeder = Seeder { points, padded, weights, order, places, nearest, sums };
    let heaviest = (0..total).max_by(|&a, &b| weights[a].total_cmp(&weights[b]).then(b.cmp(&a)));
    let mut chosen = vec![heaviest.unwrap_or(0) as u32];
    seeder.add(chosen[0]);
    while chosen.len() < count {
        if stop() {
            return None;
        }
        match seeder.draw(random) {
            Some(point) => {
                chosen.push(point);
                seeder.add(point);
            }
            None => break,
        }
    }
    Some(chosen)
}

impl Seeder<'_> {
    /// Takes `seed` into account.
    fn add(&mut self, seed: u32) {
        let vector = &self.points[seed as usize * self.padded..(seed as usize + 1) * self.padded];
        let mut is_changed = vec![false; self.sums.len()];
        let places = &self.places;
        self.nearest.show(vector, &mut |point| is_changed[places[point as usize] as usize / BLOCK] = true);
        for block in (0..self.sums.len()).filter(|&block| is_changed[block]) {
            self.sums[block] = self.block(block).map(|place| self.share(place)).sum();
        }
    }

    fn block(&self, block: usize) -> std::ops::Range<usize> {
        block * BLOCK..((block + 1) * BLOCK).min(self.order.len())
    }

    fn share(&self, place: usize) -> f64 {
        let point = self.order[place];
        f64::from(self.nearest.distance(point)) * f64::from(self.weights[point as usize])
    }

    /// A point drawn by weight x squared distance; `None` where every point is a seed already.
    fn draw(&self, random: &mut XorShift) -> Option<u32> {
        let total: f64 = self.sums.iter().sum();
        if total <= 0.0 {
            return None;
        }
        let mut rest = random.unit() * total;
        let mut last = None;
        for (block, &sum) in self.sums.iter().enumerate().filter(|(_, sum)| **sum > 0.0) {
            last = Some(block);
            if rest < sum {
                break;
            }
            rest -= sum;
        }
        let mut drawn = None;
        for place in self.block(last?) {
            let share = self.share(place);
            if share > 0.0 {
                drawn = Some(self.order[place]);
                if rest < share {
                    break;
                }
                rest -= share;
            }
        }
        drawn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_distinct_points() {
        let points: Vec<f32> = (0..100).flat_map(|i| [(i % 10) as f32, 0., 0., 0., 0., 0., 0., 0.]).collect();
        let chosen = seeds(&points, 8, &[1.0; 100], 50, &mut XorShift::new(3), &|| false).unwrap();
        let mut values: Vec<u32> = chosen.iter().map(|&point| point % 10).collect();
        values.sort_unstable();
        assert_eq!(values, (0..10).collect::<Vec<_>>());
    }

    #[test]
    fn weight_zero_is_never_drawn() {
        let points: Vec<f32> = (0..64).flat_map(|i| [i as f32, 0., 0., 0., 0., 0., 0., 0.]).collect();
        let weights: Vec<f32> = (0..64).map(|i| if i < 32 { 1.0 } else { 0.0 }).collect();
        let chosen = seeds(&points, 8, &weights, 20, &mut XorShift::new(9), &|| false).unwrap();
        assert!(chosen.iter().all(|&point| point < 32), "{chosen:?}");
        assert_eq!(chosen.len(), 20);
    }
}

//! Near items without a look at all of them: items lie in groups around some of them, and those of the groups nearest to a query are
//! looked through (an inverted file: Sivic and Zisserman, "Video Google", ICCV 2003).
//!
//! Descriptors of 16 values that look like noise leave a k-d tree no choice but to visit most of its leaves; here a query costs
//! some tenth of a scan. What is found is near, but not always the nearest. Cost to build: items x groups.

use rayon::prelude::*;

use crate::index::first_of_each;

/// Groups a root of the number of items.
const GROUPS_A_ROOT: f32 = 2.0;
/// Groups that a query looks through.
const PROBES: usize = 12;

/// Items found by their descriptors.
pub(crate) struct Groups<T, const K: usize> {
    centres: Vec<[f32; K]>,
    /// Where the items of each group begin, and where the last end.
    starts: Vec<usize>,
    /// Descriptors group by group.
    points: Vec<[f32; K]>,
    items: Vec<T>,
}

fn distance<const K: usize>(a: &[f32; K], b: &[f32; K]) -> f32 {
    let mut sums = [0.0f32; 4];
    for (a, b) in a.chunks(4).zip(b.chunks(4)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += (a - b) * (a - b);
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

impl<T: Copy + Sync, const K: usize> Groups<T, K> {
    /// All items but further ones that look the same.
    pub(crate) fn new(described: Vec<(T, [f32; K])>) -> Self {
        let described = first_of_each(described);
        let count = (GROUPS_A_ROOT * (described.len() as f32).sqrt()).ceil() as usize;
        let step = described.len().div_ceil(count.max(1)).max(1);
        let centres: Vec<[f32; K]> = described.iter().step_by(step).map(|(_, point)| *point).collect();
        let nearest = |(_, point): &(T, [f32; K])| {
            let away = (0..).zip(&centres).map(|(group, centre)| (distance(centre, point), group));
            away.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, group)| group)
        };
        let of: Vec<usize> = described.par_iter().map(nearest).collect();
        let mut starts = vec![0; centres.len() + 1];
        of.iter().for_each(|&group| starts[group + 1] += 1);
        for group in 0..centres.len() {
            starts[group + 1] += starts[group];
        }
        let mut order: Vec<usize> = (0..described.len()).collect();
        order.sort_by_key(|&index| of[index]);
        let points = order.iter().map(|&index| described[index].1).collect();
        let items = order.iter().map(|&index| described[index].0).collect();
        Groups { centres, starts, points, items }
    }

    /// Number of items.
    pub(crate) fn len(&self) -> usize {
        self.items.len()
    }

    /// At most `count` items near to `query` and within a squared distance, nearest first, with their distances.
    pub(crate) fn nearest(&self, query: &[f32; K], within: f32, count: usize) -> Vec<(&T, f32)> {
        if query.iter().any(|value| !value.is_finite()) || count == 0 {
            return Vec::new();
        }
        let mut groups: Vec<(f32, usize)> =
            (0..).zip(&self.centres).map(|(group, centre)| (distance(centre, query), group)).collect();
        let order = |a: &(f32, usize), b: &(f32, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if groups.len() > PROBES {
            groups.select_nth_unstable_by(PROBES, order);
            groups.truncate(PROBES);
        }
        let mut found: Vec<(f32, usize)> = Vec::new();
        let mut most = within;
        for (_, group) in groups {
            let range = self.starts[group]..self.starts[group + 1];
            for (index, point) in range.clone().zip(&self.points[range]) {
                let away = distance(point, query);
                if away <= most {
                    let near = (away, index);
                    let place = found.partition_point(|other| order(other, &near).is_lt());
                    found.insert(place, near);
                    found.truncate(count);
                    if found.len() == count {
                        most = found[count - 1].0;
                    }
                }
            }
        }
        found.into_iter().map(|(away, index)| (&self.items[index], away)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_of_the_nearest_are_found() {
        // Points in 16 dimensions, as even as noise.
        let mut rng = texfold_core::rng::Rng::new(1);
        let mut point = || -> [f32; 16] { std::array::from_fn(|_| rng.between(-0.5, 0.5) as f32) };
        let all: Vec<(usize, [f32; 16])> = (0..20_000).map(|index| (index, point())).collect();
        let groups = Groups::new(all.clone());
        assert_eq!(groups.len(), all.len());
        let (mut found, mut wanted) = (0, 0);
        for _ in 0..50 {
            let query = point();
            let mut scanned: Vec<f32> = all.iter().map(|(_, other)| distance(other, &query)).collect();
            scanned.sort_by(f32::total_cmp);
            let near = groups.nearest(&query, 100.0, 8);
            assert!(near.len() == 8 && near.is_sorted_by(|a, b| a.1 <= b.1));
            assert!(near.iter().all(|(index, away)| distance(&all[**index].1, &query) == *away));
            found += near.iter().filter(|(_, away)| *away <= scanned[7]).count();
            wanted += 8;
        }
        assert!(found * 4 > wanted, "{found} of {wanted}");
        // An item is found by its own descriptor.
        assert!(all.iter().step_by(997).all(|(index, point)| groups.nearest(point, 1.0, 1)[0].0 == index));
        assert!(groups.nearest(&[f32::NAN; 16], 1.0, 1).is_empty());
        assert!(Groups::<u32, 16>::new(Vec::new()).nearest(&[0.0; 16], 1.0, 1).is_empty());
    }
}

//! Maps whose errors count alike.
//!
//! A term adds scale * surface map * view map, so an error in one map counts by the scale and by the mean square of the other: little where the
//! term is weak. Maps of full range would have errors of one size everywhere. Where blocks store them, each is made smaller by as much as its
//! errors count less than those of the mean, channel by channel, and the scale makes up for it: then a step that is the
//! same for all texels of all maps shares bits out as squared errors of the colours ask for (reverse water-filling).
//!
//! Smaller maps lose more when they are rounded to bytes. Where steps are fine, maps are made smaller by less, all by the same factor, and
//! their steps are as much coarser than the mean's.

use std::collections::BTreeMap;

use glam::Vec3;

use super::assemble::{MEAN_GAIN, Maps};
use super::share::{LayerMaps, Map, Rgb};
use crate::kinds::Factors;
use crate::parts::zero_and_range;

/// Steps of a scale in an octave.
const OCTAVE: f32 = 8.0;
/// The largest scale.
const LARGEST: u8 = u8::MAX;

/// Steps of the scale by which the channels of a map are made smaller.
type Steps = [u8; 3];

impl Maps {
    /// The same maps, made smaller where their errors count less than `part` of those of the mean, above 0 to 1, with scales that make
    /// up for it. Equal view maps stay equal; surface maps of a term do so where `alike`, all made smaller by the same.
    pub(super) fn levelled(&self, triangles: &[[u32; 3]], factors: Factors, part: f32, alike: bool) -> Maps {
        let mut maps = self.clone();
        let level = Level { factors, gain: part * MEAN_GAIN };
        let count = maps.scales.len() / maps.terms.len().max(1);
        for (layer, scales) in maps.terms.iter_mut().zip(maps.scales.chunks_exact_mut(count.max(1))) {
            let (scales, _) = scales.as_chunks_mut::<3>();
            level_views(layer, scales, level);
            level_images(layer, triangles, scales, level, alike);
        }
        maps
    }

    /// For each term, how much an error of one step in a texel of its surface maps and of its view maps counts, in the mean of
    /// these.
    pub(super) fn weights(&self) -> Vec<[f64; 2]> {
        let mean = |maps: &[Map]| {
            let texels = maps.iter().map(|map| map.texels.len() as f64).sum::<f64>();
            maps.iter().map(|map| map.texels.len() as f64 * f64::from(map.weight)).sum::<f64>()
                / texels.max(1.0)
        };
        self.terms.iter().map(|layer| [mean(&layer.patches), mean(&layer.views)]).collect()
    }
}

/// What maps are made smaller for.
#[derive(Debug, Clone, Copy)]
struct Level {
    factors: Factors,
    /// How much an error of one step in a texel is to count, in each channel.
    gain: f32,
}

/// Makes view maps smaller, equal ones alike.
fn level_views(layer: &mut LayerMaps, scales: &mut [[u8; 3]], level: Level) {
    let mut kinds: BTreeMap<Vec<Rgb>, (Vec3, Steps)> = BTreeMap::new();
    for (map, scales) in layer.views.iter().zip(&*scales).filter(|(map, _)| !map.texels.is_empty()) {
        let (gains, room) = kinds.entry(map.texels.clone()).or_insert((Vec3::ZERO, [LARGEST; 3]));
        *gains += map.gains;
        *room = least(*room, room_of(*scales));
    }
    for (map, scales) in layer.views.iter_mut().zip(scales) {
        if let Some(&(gains, room)) = kinds.get(&map.texels) {
            let steps = level.steps(gains, room);
            raise(scales, steps);
            shrink(map, steps, level.factors);
        }
    }
}

/// Makes the surface maps of each vertex smaller, or all by the same where they are to stay `alike`.
fn level_images(
    layer: &mut LayerMaps,
    triangles: &[[u32; 3]],
    scales: &mut [[u8; 3]],
    level: Level,
    alike: bool,
) {
    let corners = triangles.as_flattened();
    // For each vertex the sum of its maps' gains, by texels, and their texels.
    let mut sums = vec![(Vec3::ZERO, 0f32); scales.len()];
    for (map, &vertex) in layer.patches.iter().zip(corners) {
        let texels = map.texels.len() as f32;
        let sum = &mut sums[vertex as usize];
        *sum = (sum.0 + texels * map.gains, sum.1 + texels);
    }
    let has_maps = |sum: &(Vec3, f32)| sum.1 > 0.0;
    let mean = |(gains, texels): (Vec3, f32)| gains / texels.max(1.0);
    let all = sums.iter().fold((Vec3::ZERO, 0.0), |all, sum| (all.0 + sum.0, all.1 + sum.1));
    let used = sums.iter().zip(&*scales).filter(|(sum, _)| has_maps(sum));
    let room = used.fold([LARGEST; 3], |room, (_, scales)| least(room, room_of(*scales)));
    let of_all = level.steps(mean(all), room);
    let of_vertex = |(sum, scales): (&(Vec3, f32), &[u8; 3])| match has_maps(sum) {
        false => [0; 3],
        true if alike => of_all,
        true => level.steps(mean(*sum), room_of(*scales)),
    };
    let steps: Vec<Steps> = sums.iter().zip(&*scales).map(of_vertex).collect();
    scales.iter_mut().zip(&steps).for_each(|(scales, &steps)| raise(scales, steps));
    for (map, &vertex) in layer.patches.iter_mut().zip(corners) {
        shrink(map, steps[vertex as usize], level.factors);
    }
}

/// By how many steps scales may rise; those of 0 stay.
fn room_of(scales: [u8; 3]) -> Steps {
    scales.map(|scale| if scale == 0 { LARGEST } else { LARGEST - scale })
}

fn least(one: Steps, other: Steps) -> Steps {
    std::array::from_fn(|channel| one[channel].min(other[channel]))
}

impl Level {
    /// Steps with which errors of a map with these gains count as they are to, at least one step of a byte being left of its range.
    fn steps(self, gains: Vec3, room: Steps) -> Steps {
        let most = (OCTAVE * zero_and_range(self.factors).1.log2()).floor();
        let gains = gains.to_array();
        std::array::from_fn(|channel| {
            let part = (gains[channel] / self.gain).max(f32::MIN_POSITIVE);
            // Gains go by the square of the scale.
            let steps = (-0.5 * OCTAVE * part.log2()).round();
            steps.clamp(0.0, most.min(f32::from(room[channel]))) as u8
        })
    }
}

fn raise(scales: &mut [u8; 3], steps: Steps) {
    for (scale, steps) in scales.iter_mut().zip(steps).filter(|(scale, _)| **scale > 0) {
        *scale += steps;
    }
}

/// Makes the texels of a map smaller by that many steps, so that an error of one step of a byte counts more.
fn shrink(map: &mut Map, steps: Steps, factors: Factors) {
    let (zero, _) = zero_and_range(factors);
    let parts = steps.map(|steps| (-f32::from(steps) / OCTAVE).exp2());
    for texel in &mut map.texels {
        for (byte, part) in texel.iter_mut().zip(parts) {
            *byte = ((f32::from(*byte) - zero) * part + zero).round() as u8;
        }
    }
    map.gains /= Vec3::from(parts).powf(2.0);
    map.weight = map.gains.element_sum().max(f32::MIN_POSITIVE);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mesh of one triangle with a term: maps of three vertices, of which errors count by `gains`.
    fn maps(gains: [f32; 3]) -> Maps {
        let map = |at: usize, texels: usize| Map {
            texels: (0..texels).map(|texel| [(128 + 5 * texel + at) as u8, 3, 250]).collect(),
            gains: Vec3::splat(gains[at] * MEAN_GAIN),
            weight: gains[at],
        };
        let layer = LayerMaps {
            patches: (0..3).map(|at| map(at, 6)).collect(),
            views: (0..3).map(|at| map(at, 16)).collect(),
        };
        Maps { mean: Vec::new(), scales: vec![150, 0, 240, 160, 160, 160, 120, 121, 122], terms: vec![layer] }
    }

    /// Products of scale, surface map and view map.
    fn product(maps: &Maps, vertex: usize, channel: usize) -> f32 {
        let value = |map: &Map| f32::from(map.texels[4][channel]) - 128.0;
        let layer = &maps.terms[0];
        let scale = (f32::from(maps.scales[3 * vertex + channel]) / OCTAVE).exp2();
        scale * value(&layer.patches[vertex]) * value(&layer.views[vertex])
    }

    #[test]
    fn products_stay_and_errors_count_alike() {
        let before = maps([1.0 / 16.0, 3.0, 1.0 / 64.0]);
        let after = before.levelled(&[[0, 1, 2]], Factors::Signed, 1.0, false);
        assert_eq!(before.scales[3..6], after.scales[3..6]);
        for vertex in 0..3 {
            for channel in [0, 2] {
                let (was, is) = (product(&before, vertex, channel), product(&after, vertex, channel));
                // Maps of few steps of a byte are rounded by half a step.
                assert!((was - is).abs() < 0.5 * was.abs(), "{vertex} {channel}: {was} {is}");
            }
            for map in [&after.terms[0].patches[vertex], &after.terms[0].views[vertex]] {
                let wanted = if vertex == 1 { 3.0 } else { 1.0 };
                // Scales that are almost as large as can be leave less room.
                assert!(vertex == 0 || (map.weight / wanted - 1.0).abs() < 0.01, "{vertex}: {}", map.weight);
            }
        }
        // A scale of 0 stays, and none goes beyond the largest.
        assert_eq!((after.scales[1], after.scales[2]), (0, 255));
    }

    #[test]
    fn equal_view_maps_stay_equal() {
        let mut before = maps([0.5, 0.01, 0.0001]);
        let first = before.terms[0].views[0].texels.clone();
        before.terms[0].views[2].texels = first;
        let after = before.levelled(&[[0, 1, 2]], Factors::Signed, 0.25, true);
        assert_eq!(after.terms[0].views[0].texels, after.terms[0].views[2].texels);
        let raised = |vertex: usize| after.scales[3 * vertex] - before.scales[3 * vertex];
        assert_eq!(raised(0), raised(2));
    }
}

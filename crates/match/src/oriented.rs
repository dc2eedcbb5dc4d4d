//! Patches that look alike however they are rotated: descriptors on a grid that is aligned with the patch's main direction, the
//! idea of the GSR descriptor (progressive codebooks, section 4).

use std::f32::consts::TAU;

use glam::{Mat2, Vec2};
use rayon::prelude::*;
use texfold_core::CancelCheck;

use crate::descriptor::{SIDE, transform};
use crate::index::Tree;
use crate::{DESCRIPTOR_LENGTH, Descriptor, LumaSums, Mirror};

/// Bins of the histogram of directions.
pub(crate) const BINS: usize = 36;
/// Share of the fullest bin below which a patch has no main direction.
const LEAST_SHARE: f32 = 0.05;

/// A patch and the direction that it is aligned with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedPatch {
    /// Number of its field.
    pub field: u32,
    /// Its centre in texels, texel (x, y) covering x to x + 1.
    pub centre: Vec2,
    /// Texels a side.
    pub side: f32,
    /// Main direction of its gradients in radians.
    pub angle: f32,
}

/// Square patches of one or several fields and sizes, found however they are rotated.
pub struct OrientedIndex {
    tree: Tree<OrientedPatch, DESCRIPTOR_LENGTH>,
}

impl std::fmt::Debug for OrientedIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OrientedIndex").field("patches", &self.tree.len()).finish()
    }
}

impl OrientedIndex {
    /// Indexes patches of the given centres and sides whose main direction is clear, whose contrast is at least `contrast` 8-bit
    /// steps, and which `keep` accepts. The angle of `patches` is found here. Of no use once the job is cancelled.
    #[must_use]
    pub fn new(
        fields: &[&LumaSums],
        patches: &[(u32, Vec2, f32)],
        contrast: f32,
        keep: impl Fn(&OrientedPatch) -> bool + Sync,
        cancel: CancelCheck<'_>,
    ) -> Self {
        let described: Vec<_> = patches
            .par_iter()
            .filter(|_| !cancel.is_cancelled())
            .filter_map(|&(field, centre, side)| {
                let (rotated, descriptor, found) = align(fields[field as usize], field, centre, side)?;
                (found >= contrast && keep(&rotated)).then_some((rotated, descriptor))
            })
            .collect();
        OrientedIndex { tree: Tree::new(if cancel.is_cancelled() { Vec::new() } else { described }, cancel) }
    }

    /// For a patch of a field, at most `count` patches like it and as many like its reflection within the squared distance
    /// `within`: where each lies, and what carries places of the patch, from its centre, to places of the other.
    #[must_use]
    pub fn nearest(
        &self,
        sums: &LumaSums,
        (centre, side): (Vec2, f32),
        within: f32,
        count: usize,
    ) -> Vec<(f32, OrientedPatch, Mat2)> {
        let Some((query, descriptor, _)) = align(sums, 0, centre, side) else { return Vec::new() };
        // Reflection along the main direction keeps it.
        let reflect = Mirror { across: false, down: true };
        let kinds = [(descriptor, Vec2::ONE), (reflect.of(&descriptor), Vec2::new(1.0, -1.0))];
        let mut found = Vec::new();
        for (descriptor, sign) in kinds {
            for (&near, distance) in self.tree.nearest(&descriptor, within, count) {
                let upright = Mat2::from_diagonal(sign) * Mat2::from_angle(-query.angle);
                let matrix = Mat2::from_angle(near.angle) * upright * (near.side / side);
                found.push((distance, near, matrix));
            }
        }
        found
    }
}

/// Mean luma of the square of `side` texels around a place; `None` where it leaves the image.
fn mean(sums: &LumaSums, place: Vec2, side: usize) -> Option<f32> {
    let corner = (place - side as f32 * 0.5).round();
    let (width, height) = sums.size();
    if corner.x < 0.0 || corner.y < 0.0 {
        return None;
    }
    let (x, y) = (corner.x as usize, corner.y as usize);
    let inside = x + side <= width && y + side <= height;
    inside.then(|| sums.sum(x, y, side, side) / (3 * side * side) as f32)
}

/// The patch around `centre` with its main direction, its descriptor in the grid that is aligned with it, and its contrast.
/// `None` where it has no direction, or where the rotated patch leaves the image.
fn align(sums: &LumaSums, field: u32, centre: Vec2, side: f32) -> Option<(OrientedPatch, Descriptor, f32)> {
    let spacing = side / SIDE as f32;
    let box_side = (spacing.round() as usize).max(1);
    let angle = main_direction(sums, centre, spacing, box_side)?;
    let rotation = Mat2::from_angle(angle);
    let mut values = [[0.0f32; SIDE]; SIDE];
    for (v, row) in values.iter_mut().enumerate() {
        for (u, value) in row.iter_mut().enumerate() {
            *value = mean(sums, centre + rotation * offset(u, v, spacing), box_side)?;
        }
    }
    let (descriptor, contrast) = transform(&values);
    Some((OrientedPatch { field, centre, side, angle }, descriptor, contrast))
}

/// From the centre to a place of the grid.
fn offset(u: usize, v: usize, spacing: f32) -> Vec2 {
    (Vec2::new(u as f32, v as f32) - (SIDE as f32 - 1.0) * 0.5) * spacing
}

/// The direction that most of the gradients in the disc around `centre` have, from a histogram of 36 (epitome paper, section
/// 3.2), to a fraction of a bin.
fn main_direction(sums: &LumaSums, centre: Vec2, spacing: f32, box_side: usize) -> Option<f32> {
    let mut bins = [0.0f32; BINS];
    let radius = spacing * SIDE as f32 * 0.5;
    let step = box_side as f32;
    for v in 0..SIDE {
        for u in 0..SIDE {
            let from_centre = offset(u, v, spacing);
            if from_centre.length() > radius {
                continue;
            }
            let at = |x: f32, y: f32| mean(sums, centre + from_centre + Vec2::new(x, y), box_side);
            let gradient = Vec2::new(at(step, 0.0)? - at(-step, 0.0)?, at(0.0, step)? - at(0.0, -step)?);
            let (bin, part) = bin_of(gradient);
            bins[bin] += gradient.length() * (1.0 - part);
            bins[(bin + 1) % BINS] += gradient.length() * part;
        }
    }
    peak(&bins)
}

/// The bin of a gradient's direction, and how far it lies towards the next.
pub(crate) fn bin_of(gradient: Vec2) -> (usize, f32) {
    let place = gradient.y.atan2(gradient.x).rem_euclid(TAU) / TAU * BINS as f32;
    (place as usize % BINS, place.fract())
}

/// The direction of the fullest bin, to a fraction of a bin; `None` where none stands out.
pub(crate) fn peak(bins: &[f32; BINS]) -> Option<f32> {
    let smooth: Vec<f32> =
        (0..BINS).map(|i| bins[(i + BINS - 1) % BINS] + 2.0 * bins[i] + bins[(i + 1) % BINS]).collect();
    let sum: f32 = smooth.iter().sum();
    let peak = (0..BINS).max_by(|&a, &b| smooth[a].total_cmp(&smooth[b]))?;
    if sum <= 0.0 || smooth[peak] < LEAST_SHARE * sum {
        return None;
    }
    let (before, after) = (smooth[(peak + BINS - 1) % BINS], smooth[(peak + 1) % BINS]);
    let bend = before - 2.0 * smooth[peak] + after;
    let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    Some((peak as f32 + shift) / BINS as f32 * TAU)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Field;
    use glam::Vec4;

    /// A smooth image around (60, 60), laid by `matrix` and moved to `centre`.
    fn image(matrix: Mat2, centre: Vec2) -> LumaSums {
        let inverse = matrix.inverse();
        let value = |x: usize, y: usize| {
            let at = inverse * (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - centre);
            let wave = (at.x * 0.31).sin() * 40.0 + (at.y * 0.17 + at.x * 0.05).cos() * 30.0;
            120.0 + wave + 6.0 * at.x.clamp(-9.0, 9.0)
        };
        let texels = (0..120 * 120).map(|i| Vec4::splat(value(i % 120, i / 120))).collect();
        LumaSums::new(&Field { width: 120, height: 120, texels })
    }

    #[test]
    fn a_patch_is_found_however_it_is_rotated_scaled_and_reflected() {
        let centre = Vec2::splat(60.0);
        let plain = image(Mat2::IDENTITY, centre);
        for (angle, scale, flip) in [(0.0, 1.0, 1.0), (0.7, 1.0, 1.0), (2.9, 1.25, 1.0), (-1.3, 0.8, -1.0)] {
            let matrix = Mat2::from_angle(angle) * Mat2::from_diagonal(Vec2::new(1.0, flip)) * scale;
            let other = image(matrix, centre);
            let patches: Vec<(u32, Vec2, f32)> = (4..20)
                .flat_map(|y| (4..20).map(move |x| Vec2::new(x as f32, y as f32) * 6.0))
                .flat_map(|at| [0.8f32, 1.0, 1.25].map(|size| (0, at, 32.0 * size)))
                .collect();
            let index = OrientedIndex::new(&[&other], &patches, 1.0, |_| true, CancelCheck::default());
            let found = index.nearest(&plain, (centre, 32.0), 0.3, 4);
            let best = found.iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
            assert!(best.1.centre.distance(centre) < 3.0, "{angle} {scale} {flip}: {best:?}");
            let difference = best.2 - matrix;
            let off = difference.x_axis.length().max(difference.y_axis.length());
            assert!(off < 0.2, "{angle} {scale} {flip}: {:?} for {matrix:?}", best.2);
        }
    }

    #[test]
    fn what_has_no_direction_or_no_room_is_left_out() {
        let flat = LumaSums::new(&Field { width: 64, height: 64, texels: vec![Vec4::splat(9.0); 64 * 64] });
        let index = OrientedIndex::new(
            &[&flat],
            &[(0, Vec2::splat(32.0), 16.0)],
            0.0,
            |_| true,
            CancelCheck::default(),
        );
        assert!(index.nearest(&flat, (Vec2::splat(32.0), 16.0), 1.0, 3).is_empty());
        let plain = image(Mat2::IDENTITY, Vec2::splat(60.0));
        let index = OrientedIndex::new(
            &[&plain],
            &[(0, Vec2::splat(2.0), 16.0)],
            0.0,
            |_| true,
            CancelCheck::default(),
        );
        assert_eq!(index.tree.len(), 0);
    }
}

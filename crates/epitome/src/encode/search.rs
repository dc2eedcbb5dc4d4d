//! For every leaf, places elsewhere that look like it: descriptors and a k-d tree, then affine refinement, then what
//! the neighbours and the parent found.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{Mat2, UVec2, Vec2};
use rayon::prelude::*;
use texfold_core::image::ColorSpace;
use texfold_core::{CancelCheck, Effort, EncodeError, Goal, Job};
use texfold_match::{
    Field, Freedom, LumaSums, Mirror, OrientedIndex, OrientedPatch, PatchIndex, Place, Refiner, Transform,
    describe,
};

use super::candidate::{Match, ScaleErrors, is_upright};
use super::leaf::{Grid, Node};
use super::pyramid::{CellRows, LEAST_SIDE, SCALES, Space};
use crate::{EpitomeParams, Transforms};

/// Contrast in 8-bit steps below which a leaf is not searched for: plain content at a quarter of the size suffices.
const LEAST_CONTRAST: f32 = 1.0;
/// Squared distance of descriptors beyond which nothing is alike.
const WITHIN: f32 = 0.4;
/// Luma differs less than colour does: by what to multiply its squared error to compare it with that of all channels.
const CHANNELS: f32 = 3.0;
/// Places of two matches nearer than this, in texels, are one match.
const APART: f32 = 2.5;
/// Share of an upright match's error above which refining its 2x2 matrix is not worth it: what leaves share is fitted
/// to all of them, and content that is rotated a little for each meets in fewer texels. On nine photographs 0.25 to
/// 0.5 came out the same, 0.8 a hundredth larger.
const ROTATED_SHARE: f32 = 0.5;
/// 2x2 matrices are kept within these factors of the seed's.
const STRETCH: std::ops::RangeInclusive<f32> = 0.6..=1.6;

/// Sizes of rotated patches by that of the leaf, a third of an octave apart.
const SIZES: [f32; 3] = [0.794, 1.0, 1.26];
/// Texels of all images up to which matches are looked for everywhere at once.
const WHOLE: u64 = 2 << 20;
/// Texels a side of the parts that larger ones are searched in at first.
const PART: u32 = 1024;
/// Places that are searched at most, of one size: as many as a part has, and half as many again.
const MOST_PLACES: usize = 400_000;
/// Steps between rotated patches, by their side (paper section 3.2).
const ROTATED_STEP: f32 = 0.25;

/// How widely to search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reach {
    /// Scales whose content is searched.
    pub(crate) scales: usize,
    /// Neighbours taken from the tree under each mirroring.
    pub(crate) neighbours: usize,
    /// Matches kept for a leaf at each scale.
    pub(crate) kept: usize,
    /// Steps between places, in texels.
    pub(crate) stride: u32,
    /// Neighbours taken from the tree of rotated patches, plain and reflected; 0 looks for upright ones only.
    pub(crate) rotated: usize,
    /// What matches may be.
    pub(crate) transforms: Transforms,
    /// Texels a side of the squares of images within which leaves look for matches; everywhere where there is none.
    pub(crate) part: Option<u32>,
}

impl Reach {
    /// Rotated patches cost half as much again and are found where things lie about at all angles; in buildings,
    /// plants and pages, which stand upright, hardly one was taken. Where time counts they are searched for
    /// tolerances only, and there many matches are kept: leaves are to meet in the same content.
    pub(crate) fn of(params: &EpitomeParams, texels: u64) -> Self {
        let stride = 2;
        let part = (texels > WHOLE).then_some(PART);
        let (neighbours, kept, stride, rotated) = match (params.effort, params.goal) {
            (Effort::Fast, _) => (3, 2, stride * 2, 0),
            (Effort::Normal, Goal::Tolerance(_)) => (16, 12, stride, 16),
            (Effort::High, Goal::Tolerance(_)) => (16, 12, stride / 2, 16),
            (Effort::Normal, _) => (6, 4, stride, 0),
            (Effort::High, _) => (16, 4, stride / 2, 8),
        };
        let transforms = params.transforms;
        let rotated = if transforms.affine { rotated } else { 0 };
        Reach { scales: 9, neighbours, kept, stride, rotated, transforms, part }
    }
}

/// Where content may come from, and what a match must be worth.
pub(crate) struct Allowed<'a> {
    /// By cell of all formats; all of them where there is no restriction.
    pub(crate) cells: Option<&'a [bool]>,
    /// By cell whether many read it already: where there are too many places, those of such cells come first.
    pub(crate) shared: Option<&'a [bool]>,
    /// For each node the squared error that a match may have at most, less than which it gains nothing.
    pub(crate) errors: &'a [f32],
    /// For each node the least error of its own content at each scale: a match at that scale is hardly better.
    pub(crate) own: &'a [ScaleErrors],
}

/// A square of an image in which its leaves look for matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Part {
    image: usize,
    /// Its texels in the image.
    low: UVec2,
    high: UVec2,
}

/// Luma of each field, and its sums.
struct Searchable {
    luma: Vec<f32>,
    sums: LumaSums,
}

/// Finds matches for every node; `found` has a list for each and keeps what it has.
pub(crate) fn search(
    space: &Space,
    grid: &Grid,
    reach: Reach,
    allowed: &Allowed<'_>,
    found: &mut [Vec<Match>],
    job: &mut Job<'_>,
) -> Result<(), EncodeError> {
    let scales = reach.scales.min(space.scales());
    let cancel = job.cancel_check();
    for scale in 0..scales {
        job.stage("searching", scale as f32 / scales as f32)?;
        let fields: Vec<Searchable> = space
            .pyramids
            .par_iter()
            .map(|pyramid| &pyramid.source[scale])
            .map(|field| Searchable { luma: field.luma(), sums: LumaSums::new(field) })
            .collect();
        let sides =
            if grid.split { vec![grid.block, grid.block / 2, grid.block / 4] } else { vec![grid.block] };
        let mut fresh: Vec<Vec<Match>> = vec![Vec::new(); found.len()];
        for side in sides {
            let across = side >> SCALES[scale].across;
            let down = side >> SCALES[scale].down;
            if across < LEAST_SIDE || down < LEAST_SIDE {
                continue;
            }
            let round = Round { space, grid, reach, scale, side, fields: &fields, allowed, cancel };
            round.run(&mut fresh);
            round.propagate(&mut fresh);
            job.checkpoint()?;
        }
        for (all, fresh) in found.iter_mut().zip(fresh) {
            for found in fresh {
                // Later rounds find again what earlier ones found.
                if grid.split || !all.iter().any(|known| known.is_like(&found)) {
                    all.push(found);
                }
            }
        }
    }
    Ok(())
}

/// Leaves of one size at one scale.
struct Round<'a> {
    space: &'a Space,
    grid: &'a Grid,
    reach: Reach,
    scale: usize,
    side: u32,
    fields: &'a [Searchable],
    allowed: &'a Allowed<'a>,
    /// Once this is cancelled nothing more is found.
    cancel: CancelCheck<'a>,
}

impl Round<'_> {
    fn field(&self, image: usize) -> &Field {
        &self.space.pyramids[image].source[self.scale]
    }

    /// Columns and rows of a leaf in the field.
    fn patch(&self) -> (usize, usize) {
        let scale = SCALES[self.scale];
        ((self.side >> scale.across) as usize, (self.side >> scale.down) as usize)
    }

    /// Upper left texel of a leaf in the field.
    fn corner(&self, node: &Node) -> (usize, usize) {
        let scale = SCALES[self.scale];
        ((node.corner.x >> scale.across) as usize, (node.corner.y >> scale.down) as usize)
    }

    /// From texels of the leaf to those of the field.
    fn shrink(&self) -> Mat2 {
        let scale = SCALES[self.scale];
        Mat2::from_diagonal(Vec2::new(1.0 / (1 << scale.across) as f32, 1.0 / (1 << scale.down) as f32))
    }

    /// Number of the nodes that are searched for.
    fn nodes(&self) -> Vec<usize> {
        (0..self.grid.nodes())
            .filter(|&index| {
                let node = self.grid.node(index);
                let most = self.allowed.errors[index];
                node.side == self.side && !node.is_outside() && self.allowed.own[index][self.scale] < most
            })
            .collect()
    }

    /// Whether content may be mirrored: vectors cannot be by moving texels.
    fn mirrors(&self) -> bool {
        self.reach.transforms.mirrors && self.space.pixel.color != ColorSpace::Normal
    }

    fn run(&self, found: &mut [Vec<Match>]) {
        for (part, nodes) in self.parts() {
            if self.cancel.is_cancelled() {
                return;
            }
            self.run_part(part, &nodes, found);
        }
    }

    /// The parts of all images, each with the nodes that are searched for in it.
    fn parts(&self) -> Vec<(Option<Part>, Vec<usize>)> {
        let Some(side) = self.reach.part else { return vec![(None, self.nodes())] };
        let mut parts: BTreeMap<(usize, u32, u32), Vec<usize>> = BTreeMap::new();
        for index in self.nodes() {
            let node = self.grid.node(index);
            let number = node.corner / side;
            parts.entry((node.image, number.y, number.x)).or_default().push(index);
        }
        let part = |(image, row, column)| {
            let low = UVec2::new(column, row) * side;
            Part { image, low, high: low + side }
        };
        parts.into_iter().map(|(number, nodes)| (Some(part(number)), nodes)).collect()
    }

    fn run_part(&self, part: Option<Part>, nodes: &[usize], found: &mut [Vec<Match>]) {
        let images = part.map_or(0..self.fields.len(), |part| part.image..part.image + 1);
        let places = images.clone().flat_map(|image| self.places(image, part)).collect();
        let places = self.thinned(places, MOST_PLACES);
        let sums: Vec<&LumaSums> = self.fields.iter().map(|field| &field.sums).collect();
        let index = PatchIndex::new(&sums, self.patch(), &places, LEAST_CONTRAST, self.cancel);
        let rotated = self.rotated(&sums, images, part);
        let matches: Vec<Vec<Match>> =
            nodes.par_iter().map(|&node| self.matches_of(node, &index, rotated.as_ref())).collect();
        for (&index, matches) in nodes.iter().zip(matches) {
            found[index] = matches;
        }
    }

    /// Columns and rows of a part, or of its whole image, in texels of the field.
    fn within(&self, image: usize, part: Option<Part>) -> (UVec2, UVec2) {
        // Beyond the image's edge content repeats it: nothing new is there.
        let (scale, size) = (SCALES[self.scale], self.space.pyramids[image].size);
        let end = UVec2::new(size.width, size.height);
        let (low, high) = part.map_or((UVec2::ZERO, end), |part| (part.low, part.high.min(end)));
        let reduced = |at: UVec2| UVec2::new(at.x >> scale.across, at.y >> scale.down);
        (reduced(low), reduced(high))
    }

    /// Places in an image whose patch lies within a part and in cells that are allowed, in any format.
    fn places(&self, image: usize, part: Option<Part>) -> Vec<Place> {
        let (width, height) = self.patch();
        let patch = UVec2::new(width as u32, height as u32);
        let (low, high) = self.within(image, part);
        if (low + patch).cmpgt(high).any() {
            return Vec::new();
        }
        let (step, last) = (self.stride() as usize, high - patch);
        let all = (low.y..=last.y)
            .step_by(step)
            .flat_map(|y| (low.x..=last.x).step_by(step).map(move |x| (x, y)))
            .map(|(x, y)| Place { field: image as u32, x, y });
        let Some(formats) = self.cell_sums(image, self.allowed.cells) else { return all.collect() };
        all.filter(|place| formats.iter().any(|sums| sums.holds((place.x, place.y), patch.into()))).collect()
    }

    /// At most `most` places: those whose content is shared already first, then an even choice of the others.
    fn thinned(&self, places: Vec<Place>, most: usize) -> Vec<Place> {
        if places.len() <= most {
            return places;
        }
        let (width, height) = self.patch();
        let shared: Vec<_> =
            (0..self.fields.len()).map(|image| self.cell_sums(image, self.allowed.shared)).collect();
        let is_shared = |place: &Place| {
            let formats = shared[place.field as usize].iter().flatten();
            let patch = (width as u32, height as u32);
            formats.map(|sums| sums.count((place.x, place.y), patch)).any(|(shared, all)| 2 * shared > all)
        };
        let (mut first, others): (Vec<Place>, Vec<Place>) = places.into_iter().partition(is_shared);
        let even = |mut places: Vec<Place>, count: usize| {
            let length = places.len();
            let mut index = 0;
            places.retain(|_| {
                index += 1;
                index * count / length != (index - 1) * count / length
            });
            places
        };
        if first.len() > most {
            return even(first, most);
        }
        let rest = most - first.len();
        first.extend(if others.len() > rest { even(others, rest) } else { others });
        first
    }

    /// Sums of those of an image's cells that `cells` names, by format; `None` where all are.
    fn cell_sums(&self, image: usize, cells: Option<&[bool]>) -> Option<Vec<CellSums>> {
        let cells = cells?;
        let field = self.field(image);
        let sums = |format| CellSums::new(cells, field, self.space.rows_of(format, image, self.scale));
        Some((0..self.space.stored.len()).map(sums).collect())
    }

    /// Patches however they are rotated, of several sizes, in cells that are allowed. Only where content is as wide
    /// as high, and not of normals, whose values rotate with them.
    fn rotated(&self, sums: &[&LumaSums], images: Range<usize>, part: Option<Part>) -> Option<OrientedIndex> {
        let scale = SCALES[self.scale];
        if self.reach.rotated == 0
            || scale.across != scale.down
            || self.space.pixel.color == ColorSpace::Normal
        {
            return None;
        }
        let side = self.patch().0 as f32;
        let step = (side * ROTATED_STEP).max(2.0);
        let mut patches = Vec::new();
        for image in images {
            let (low, high) = self.within(image, part);
            let steps = |low: u32, high: u32| (low as f32 / step) as u32 + 1..(high as f32 / step) as u32;
            let places = steps(low.y, high.y).flat_map(|y| steps(low.x, high.x).map(move |x| (x, y)));
            let centres = places.map(|(x, y)| Vec2::new(x as f32, y as f32) * step);
            patches.extend(centres.flat_map(|at| SIZES.map(|size| (image as u32, at, size * side))));
        }
        let allowed: Vec<Option<Vec<CellSums>>> =
            (0..self.fields.len()).map(|image| self.cell_sums(image, self.allowed.cells)).collect();
        let keep = |rotated: &OrientedPatch| {
            let Some(formats) = &allowed[rotated.field as usize] else { return true };
            let field = self.field(rotated.field as usize);
            let axis = Vec2::from_angle(rotated.angle).abs();
            let half = rotated.side * 0.5 * (axis.x + axis.y);
            let end = Vec2::new(field.width as f32, field.height as f32);
            let low = (rotated.centre - half).floor().max(Vec2::ZERO).as_uvec2();
            let high = (rotated.centre + half).ceil().min(end).as_uvec2();
            let patch = (high.x - low.x, high.y - low.y);
            formats.iter().any(|sums| sums.holds((low.x, low.y), patch))
        };
        Some(OrientedIndex::new(sums, &patches, LEAST_CONTRAST, keep, self.cancel))
    }

    /// Finer content has fewer texels to step over.
    fn stride(&self) -> u32 {
        let scale = SCALES[self.scale];
        let patch = (self.side >> scale.across).min(self.side >> scale.down);
        (self.reach.stride * patch / 8).clamp(1, 4)
    }

    fn matches_of(&self, number: usize, index: &PatchIndex, rotated: Option<&OrientedIndex>) -> Vec<Match> {
        if self.cancel.is_cancelled() {
            return Vec::new();
        }
        let node = &self.grid.node(number);
        let (x, y) = self.corner(node);
        let (width, height) = self.patch();
        let own = &self.fields[node.image];
        let (descriptor, contrast) = describe(&own.sums, x, y, width, height);
        if contrast < LEAST_CONTRAST {
            return Vec::new();
        }
        let most = self.most_luma(number);
        // What the low frequencies leave is part of what all leave.
        let length = contrast * contrast * (width * height) as f32;
        let within = WITHIN.min(most / length);
        let half = Vec2::new(width as f32, height as f32) * 0.5;
        let centre = Vec2::new(x as f32, y as f32) + half;
        let mut seeds: Vec<(f32, u16, Transform)> = Vec::new();
        let mirrors = if self.mirrors() { Mirror::ALL.len() } else { 1 };
        for &mirror in &Mirror::ALL[..mirrors] {
            let query = mirror.of(&descriptor);
            for near in index.nearest(&query, within, self.reach.neighbours) {
                let place = near.place;
                let itself = place.field as usize == node.image
                    && place.x.abs_diff(x as u32) < (width as u32 / 2).max(2)
                    && place.y.abs_diff(y as u32) < (height as u32 / 2).max(2);
                if !itself {
                    let position = Vec2::new(place.x as f32, place.y as f32) + half;
                    let sign = |flip: bool| if flip { -1.0 } else { 1.0 };
                    let matrix = Mat2::from_diagonal(Vec2::new(sign(mirror.across), sign(mirror.down)));
                    seeds.push((near.distance, place.field as u16, Transform { position, matrix }));
                }
            }
        }
        for (distance, near, matrix) in rotated
            .map(|index| index.nearest(&own.sums, (centre, width as f32), WITHIN, self.reach.rotated))
            .unwrap_or_default()
        {
            let itself = near.field as usize == node.image && near.centre.distance(centre) < half.x.max(2.0);
            if !itself && (self.mirrors() || matrix.determinant() > 0.0) {
                seeds.push((distance, near.field as u16, Transform { position: near.centre, matrix }));
            }
        }
        seeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        let target = self.target(node);
        let refiner = self.refiner(&target);
        let mut matches: Vec<Match> = Vec::new();
        for (_, image, seed) in seeds {
            let known = |m: &Match| m.image == image && m.position.distance(seed.position) < APART;
            if matches.len() < 2 * self.reach.kept && !matches.iter().any(known) {
                let freedom = if is_upright(seed.matrix) { Freedom::Position } else { Freedom::Affine };
                matches.extend(self.refined(&refiner, image, seed, freedom));
            }
        }
        let mut kept = self.keep_best(matches);
        if self.reach.transforms.affine && self.space.pixel.color != ColorSpace::Normal {
            let rotated: Vec<Match> =
                kept.iter().filter_map(|found| self.rotated_too(&refiner, found)).collect();
            kept = self.keep_best(kept.into_iter().chain(rotated).collect());
        }
        kept.retain(|found| found.error < most);
        kept
    }

    /// An upright match with its 2x2 matrix refined too, where that is worth it.
    fn rotated_too(&self, refiner: &Refiner<'_>, found: &Match) -> Option<Match> {
        let matrix = found.matrix * self.shrink().inverse();
        let seed = Transform { position: found.position, matrix };
        let rotated =
            is_upright(matrix).then(|| self.refined(refiner, found.image, seed, Freedom::Affine))??;
        (rotated.error < ROTATED_SHARE * found.error).then_some(rotated)
    }

    /// Squared error of luma in texels of the field that a match of a node may have.
    fn most_luma(&self, number: usize) -> f32 {
        let scale = SCALES[self.scale];
        self.allowed.errors[number] / CHANNELS / (1u32 << (scale.across + scale.down)) as f32
    }

    /// The leaf's luma in its own field.
    fn target(&self, node: &Node) -> Vec<f32> {
        let ((x, y), (width, height)) = (self.corner(node), self.patch());
        let field = self.field(node.image);
        let luma = &self.fields[node.image].luma;
        (y..y + height)
            .flat_map(|y| &luma[y * field.width + x..y * field.width + x + width])
            .copied()
            .collect()
    }

    fn refiner<'t>(&self, target: &'t [f32]) -> Refiner<'t> {
        Refiner::new(target, self.patch())
    }

    /// A seed refined within the field; `None` where it strays.
    fn refined(&self, refiner: &Refiner<'_>, image: u16, seed: Transform, freedom: Freedom) -> Option<Match> {
        let field = self.field(usize::from(image));
        let size = (field.width, field.height);
        let luma = &self.fields[usize::from(image)].luma;
        let refined = refiner.refine(luma, size, seed, freedom);
        let Transform { position, matrix } = refined.transform;
        let stretch = |axis: Vec2| STRETCH.contains(&axis.length());
        if !stretch(matrix.x_axis) || !stretch(matrix.y_axis) || !position.is_finite() {
            return None;
        }
        let scale = self.scale as u8;
        Some(Match { image, scale, position, matrix: matrix * self.shrink(), error: refined.error })
    }

    /// The best upright matches, then the best of the others, as many of each.
    fn keep_best(&self, mut matches: Vec<Match>) -> Vec<Match> {
        matches.sort_by(|a, b| a.error.total_cmp(&b.error));
        let (upright, others) = matches.into_iter().partition(|found: &Match| is_upright(found.matrix));
        let best = |sorted: Vec<Match>| {
            let mut kept: Vec<Match> = Vec::new();
            for found in sorted {
                let known = |m: &Match| m.image == found.image && m.position.distance(found.position) < APART;
                if kept.len() < self.reach.kept && !kept.iter().any(known) {
                    kept.push(found);
                }
            }
            kept
        };
        [upright, others].into_iter().flat_map(best).collect()
    }

    /// Each leaf tries what its four neighbours of the same size found, carried on to its own place.
    fn propagate(&self, found: &mut [Vec<Match>]) {
        let nodes = self.nodes();
        let before: &[Vec<Match>] = found;
        let better: Vec<Option<Vec<Match>>> =
            nodes.par_iter().map(|&index| self.with_neighbours(index, before)).collect();
        for (index, better) in nodes.into_iter().zip(better) {
            if let Some(matches) = better {
                found[index] = matches;
            }
        }
    }

    /// A leaf's matches and those of its neighbours, where there is anything to try.
    fn with_neighbours(&self, index: usize, before: &[Vec<Match>]) -> Option<Vec<Match>> {
        if self.cancel.is_cancelled() {
            return None;
        }
        let node = self.grid.node(index);
        let mut matches = before[index].clone();
        let most = self.most_luma(index);
        let own = matches.first().map_or(most, |found| found.error);
        let target = self.target(&node);
        let refiner = self.refiner(&target);
        let mut tried = false;
        for neighbour in self.grid.neighbours(index) {
            let step = node.corner.as_vec2() - self.grid.node(neighbour).corner.as_vec2();
            let first = |upright| before[neighbour].iter().find(move |m| is_upright(m.matrix) == upright);
            for theirs in [first(true), first(false)].into_iter().flatten() {
                let Some(seed) = self.carried(theirs, step, &matches).filter(|_| theirs.error < 4.0 * own)
                else {
                    continue;
                };
                let freedom = if is_upright(seed.matrix) { Freedom::Position } else { Freedom::Affine };
                matches.extend(self.refined(&refiner, theirs.image, seed, freedom));
                tried = true;
            }
        }
        matches.retain(|found| found.error < most);
        tried.then(|| self.keep_best(matches))
    }

    /// Where a match lies for a leaf a `step` away, unless that is outside or among its `matches` already.
    fn carried(&self, theirs: &Match, step: Vec2, matches: &[Match]) -> Option<Transform> {
        let position = theirs.position + theirs.matrix * step;
        let known = |m: &Match| {
            m.image == theirs.image
                && m.position.distance(position) < 1.0
                && is_upright(m.matrix) == is_upright(theirs.matrix)
        };
        let field = self.field(usize::from(theirs.image));
        let half = Vec2::new(self.patch().0 as f32, self.patch().1 as f32) * 0.5;
        let end = Vec2::new(field.width as f32, field.height as f32) - half;
        let inside = position.cmpge(half).all() && position.cmple(end).all();
        let matrix = theirs.matrix * self.shrink().inverse();
        (inside && !matches.iter().any(known)).then_some(Transform { position, matrix })
    }
}

/// How many cells of a field are allowed above and left of each.
struct CellSums {
    columns: usize,
    /// Texels a side of a cell.
    side: u32,
    sums: Vec<u32>,
}

impl CellSums {
    fn new(cells: &[bool], field: &Field, CellRows { columns, base, side }: CellRows) -> Self {
        let columns = columns as usize;
        let rows = field.height.div_ceil(side as usize);
        let mut sums = vec![0u32; (columns + 1) * (rows + 1)];
        for y in 0..rows {
            let mut row = 0;
            for x in 0..columns {
                row += u32::from(cells[base as usize + y * columns + x]);
                sums[(y + 1) * (columns + 1) + x + 1] = sums[y * (columns + 1) + x + 1] + row;
            }
        }
        CellSums { columns: columns + 1, side, sums }
    }

    /// Whether all cells under a patch are allowed.
    fn holds(&self, at: (u32, u32), patch: (u32, u32)) -> bool {
        let (sum, all) = self.count(at, patch);
        sum == all
    }

    /// How many cells under a patch are named, and how many there are.
    fn count(&self, (x, y): (u32, u32), (width, height): (u32, u32)) -> (usize, usize) {
        let (left, top) = ((x / self.side) as usize, (y / self.side) as usize);
        let end = |at: u32| at.div_ceil(self.side) as usize;
        let (right, bottom) = (end(x + width), end(y + height));
        let at = |x: usize, y: usize| self.sums[y * self.columns + x];
        let sum = at(right, bottom) + at(left, top) - at(right, top) - at(left, bottom);
        (sum as usize, (right - left) * (bottom - top))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::candidate::Rules;
    use crate::encode::options::direct_options;
    use crate::encode::pyramid::{ScaleChoice, Storage};
    use texfold_bc::Content;
    use texfold_core::ImageSize;
    use texfold_core::image::ImageSet;

    #[test]
    fn of_too_many_places_those_of_shared_content_stay() {
        let image = texfold_testkit::image("facade");
        let grid = Grid::new(&[image.size()], 32, true);
        let set = ImageSet::single(image);
        let content = [Storage::Planes(Content::Bc1)];
        let scales = ScaleChoice { padding: 32, scales: 1 };
        let space = Space::new(&set, None, &content, scales, Effort::Fast, CancelCheck::default()).unwrap();
        let field = &space.pyramids[0].source[0];
        // Content of the left eighth is shared: an eighth of all places.
        let columns = field.width as u32 / 4;
        let shared: Vec<bool> = (0..space.cells() as u32).map(|cell| cell % columns < columns / 8).collect();
        let fields = [Searchable { luma: field.luma(), sums: LumaSums::new(field) }];
        let errors = vec![0.0; grid.nodes()];
        let allowed = Allowed { cells: None, shared: Some(&shared), errors: &errors, own: &[] };
        let reach = Reach::of(&EpitomeParams::default(), 1 << 16);
        let round = Round {
            space: &space,
            grid: &grid,
            reach,
            scale: 0,
            side: 8,
            fields: &fields,
            allowed: &allowed,
            cancel: CancelCheck::default(),
        };
        let places = round.places(0, None);
        let left = |places: &[Place]| places.iter().filter(|place| place.x + 8 <= columns / 2).count();
        let (all, of_left) = (places.len(), left(&places));
        let thinned = round.thinned(places.clone(), all / 4);
        assert_eq!((thinned.len(), left(&thinned)), (all / 4, of_left));
        // The others are taken evenly: as many above the middle as below.
        let above = thinned.iter().filter(|place| place.y < field.height as u32 / 2).count();
        assert!(above.abs_diff(all / 8) <= all / 80, "{above} of {}", all / 4);
        assert_eq!(round.thinned(places.clone(), of_left / 2).len(), of_left / 2);
        assert_eq!(round.thinned(places.clone(), all), places);
    }

    #[test]
    fn leaves_look_within_their_own_part() {
        let image = texfold_testkit::image("facade");
        let ImageSize { width, height } = image.size();
        let grid = Grid::new(&[image.size()], 32, true);
        let space = Space::new(
            &ImageSet::single(image),
            None,
            &[Storage::Planes(Content::Bc1)],
            ScaleChoice { padding: 32, scales: SCALES.len() },
            Effort::Fast,
            CancelCheck::default(),
        )
        .unwrap();
        let (_, own) = direct_options(&space, &grid, &Rules::default(), CancelCheck::default());
        let errors = vec![1e9; grid.nodes()];
        let allowed = Allowed { cells: None, shared: None, errors: &errors, own: &own };
        let whole = Reach::of(&EpitomeParams::default(), u64::from(width) * u64::from(height));
        assert_eq!(whole.part, None);
        let side = 128;
        let found = |part| {
            let mut found = vec![Vec::new(); grid.nodes()];
            let mut job = Job::default();
            search(&space, &grid, Reach { part, ..whole }, &allowed, &mut found, &mut job).unwrap();
            found
        };
        // Refinement may carry a match a little beyond.
        let strays = |found: &[Vec<Match>]| {
            let stray = |node: Node, found: &Match| {
                let scale = SCALES[usize::from(found.scale)];
                let unit = Vec2::new((1 << scale.across) as f32, (1 << scale.down) as f32);
                let (low, at) = ((node.corner / side * side).as_vec2(), found.position * unit);
                at.cmplt(low).any() || at.cmpgt(low + side as f32).any()
            };
            let all = found.iter().enumerate().map(|(index, found)| (grid.node(index), found));
            all.map(|(node, found)| found.iter().filter(|found| stray(node, found)).count()).sum::<usize>()
        };
        let (parts, everywhere) = (found(Some(side)), found(None));
        let count = |found: &[Vec<Match>]| found.iter().map(Vec::len).sum::<usize>();
        assert!(count(&parts) > grid.nodes() && strays(&everywhere) > count(&everywhere) / 4);
        // What neighbours across the border of a part found is carried on, too.
        assert!(strays(&parts) < count(&parts) / 10, "{} of {}", strays(&parts), count(&parts));
    }
}

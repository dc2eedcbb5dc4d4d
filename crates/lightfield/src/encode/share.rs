//! Codebooks of maps: maps that several triangles or vertices may use (paper section 4, vector quantisation).
//!
//! Patches of one side and the view maps, layer by layer, are groups of vectors. For each group codebooks of several sizes are built
//! (generalised Lloyd), each map weighted by the error in the colours that an error in it makes. Bits, those of the numbers of codewords
//! included, are then given to where they take away most of that error: along the convex hull of each group's sizes, until the share that is asked
//! for is used up. O(maps x codewords x rounds) a group.
//!
//! *Deviation*: the paper gives every group the same ratio or the same distortion. *Not done*: maps of unlike sides in one codebook.

use std::collections::BTreeMap;

use glam::Vec3;
use ndarray::{Array2, ArrayView1};
use texfold_codebook::{Settings, build};
use texfold_core::CancelCheck;

use super::principal::principal;
use crate::layout::{NONE, SIDES, Sharing};

/// A texel of a map.
pub(crate) type Rgb = [u8; 3];

/// Codebooks are built for each half of a group's size down to this one.
const LEAST_CODEWORDS: usize = 2;
/// And from this one on: larger ones take minutes to build.
const MOST_CODEWORDS: usize = 1500;
/// Rounds of a codebook: further ones take away a hundredth of the error.
const ROUNDS: u32 = 8;

/// A map and how much an error of one step in all of its texels counts.
#[derive(Debug, Clone, Default)]
pub(crate) struct Map {
    /// Its texels; none where there is no map.
    pub(crate) texels: Vec<Rgb>,
    /// In each channel.
    pub(crate) gains: Vec3,
    /// In all, not 0.
    pub(crate) weight: f32,
}

/// The maps of the mean or of a term.
#[derive(Debug, Clone, Default)]
pub(crate) struct LayerMaps {
    /// Of each triangle of the mean, of each corner of each triangle of a term.
    pub(crate) patches: Vec<Map>,
    /// Of each vertex.
    pub(crate) views: Vec<Map>,
}

/// What is stored of a layer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stored {
    pub(crate) sharing: Sharing,
    /// Patches by side.
    pub(crate) patches: [Vec<Vec<Rgb>>; SIDES],
    pub(crate) views: Vec<Vec<Rgb>>,
}

/// Which maps a group has.
#[derive(Debug, Clone, Copy)]
struct Kind {
    /// 0 for the mean, from 1 for terms.
    layer: usize,
    /// Log2 of the patches' side; `None` for view maps.
    log2: Option<usize>,
    /// Whether it may have codebooks.
    has_books: bool,
}

/// Maps of one size, of one layer.
struct Group {
    kind: Kind,
    /// Their numbers among the layer's patches or views.
    members: Vec<usize>,
    /// Bits of its maps where each has its own, or where equal ones are one and it has no codebooks.
    own_bits: f64,
    /// Of rising size along the convex hull.
    sizes: Vec<Size>,
    chosen: usize,
}

/// A way to store a group.
struct Size {
    /// Of texels and of the numbers of codewords.
    bits: f64,
    error: f64,
    /// `None` where each map is its own.
    book: Option<Book>,
}

/// A codebook for a group.
struct Book {
    /// Weighted means of the maps that use them.
    codewords: Array2<f32>,
    /// The codeword of each map.
    numbers: Vec<u32>,
    error: f64,
}

impl Book {
    fn of(found: Vec<u32>, vectors: &Array2<f32>, weights: &[f32]) -> Book {
        let mut used = found.clone();
        used.sort_unstable();
        used.dedup();
        let number = |found: &u32| used.binary_search(found).unwrap_or(0) as u32;
        let numbers: Vec<u32> = found.iter().map(number).collect();
        let mut codewords = Array2::zeros((used.len(), vectors.ncols()));
        let mut totals = vec![0f32; used.len()];
        for ((row, &number), &weight) in vectors.rows().into_iter().zip(&numbers).zip(weights) {
            codewords.row_mut(number as usize).scaled_add(weight, &row);
            totals[number as usize] += weight;
        }
        for (mut codeword, total) in codewords.rows_mut().into_iter().zip(totals) {
            codeword /= total.max(f32::MIN_POSITIVE);
        }
        let error = |((row, &number), &weight): ((ArrayView1<'_, f32>, &u32), &f32)| {
            let codeword = codewords.row(number as usize);
            let squares: f32 = row.iter().zip(codeword).map(|(a, b): (&f32, &f32)| (a - b) * (a - b)).sum();
            f64::from(squares) * f64::from(weight)
        };
        let error = vectors.rows().into_iter().zip(&numbers).zip(weights).map(error).sum();
        Book { codewords, numbers, error }
    }
}

/// The first of the members that is the same, for each; `None` where all are different.
fn equal(members: &[usize], maps: &[Map]) -> Option<Vec<u32>> {
    let mut known = BTreeMap::new();
    let first = |(number, &member): (u32, &usize)| *known.entry(&maps[member].texels).or_insert(number);
    let numbers: Vec<u32> = (0..).zip(members).map(first).collect();
    (known.len() < members.len()).then_some(numbers)
}

/// Of which maps there are codebooks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Books {
    /// None: equal maps are stored once.
    None,
    /// Of patches; of view maps equal ones are stored once.
    Patches,
    /// All.
    All,
}

/// How much may be stored where there are codebooks.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Room {
    /// A share of what the maps take where each has its own.
    Share(f32),
    Bits(f64),
}

/// What may be shared, and in how much room.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Codebooks {
    pub(crate) of: Books,
    pub(crate) room: Room,
}

/// The layers with each map its own, or, where there are `books`, with as many bits of all as there is `room`: `texel_bits` a texel, and
/// numbers of codewords. And how many bits that room is. Of no use once the job is cancelled.
///
/// Sides are those of the mean's patches and those of the terms'.
pub(crate) fn share(
    layers: &[&LayerMaps],
    sides_log2: [&[u8]; 2],
    books: Codebooks,
    texel_bits: f64,
    cancel: CancelCheck<'_>,
) -> (Vec<Stored>, f64) {
    let mut groups = Vec::new();
    for (number, layer) in layers.iter().enumerate() {
        let sides_log2 = sides_log2[number.min(1)];
        let corners = layer.patches.len() / sides_log2.len().max(1);
        for log2 in 0..SIDES {
            let of_side = |at: &usize| usize::from(sides_log2[at / corners.max(1)]) == log2;
            let members = present(&layer.patches).filter(of_side).collect();
            let kind = Kind { layer: number, log2: Some(log2), has_books: books.of != Books::None };
            groups.push(group(kind, &layer.patches, members, texel_bits, cancel));
        }
        let kind = Kind { layer: number, log2: None, has_books: books.of == Books::All };
        let members = present(&layer.views).collect();
        groups.push(group(kind, &layer.views, members, texel_bits, cancel));
    }
    let bits = match books.room {
        Room::Bits(bits) => bits,
        Room::Share(share) => f64::from(share) * groups.iter().map(|group| group.own_bits).sum::<f64>(),
    };
    spend(&mut groups, bits);
    let mut stored: Vec<Stored> = layers.iter().map(|layer| own_numbers(layer)).collect();
    for group in &groups {
        let layer = &layers[group.kind.layer];
        keep(
            group,
            if group.kind.log2.is_some() { &layer.patches } else { &layer.views },
            &mut stored[group.kind.layer],
        );
    }
    (stored, bits)
}

fn own_numbers(layer: &LayerMaps) -> Stored {
    let mut stored = Stored::default();
    stored.sharing.patch_of = vec![NONE; layer.patches.len()];
    stored.sharing.view_of = vec![NONE; layer.views.len()];
    stored
}

/// Numbers of the maps that have texels.
fn present(maps: &[Map]) -> impl Iterator<Item = usize> {
    (0..maps.len()).filter(|&at| !maps[at].texels.is_empty())
}

/// The `members` among `maps`, and codebooks for them where they may have some.
fn group(kind: Kind, maps: &[Map], members: Vec<usize>, texel_bits: f64, cancel: CancelCheck<'_>) -> Group {
    let texels = members.first().map_or(0, |&at| maps[at].texels.len());
    let bits = |maps: usize| (maps * texels) as f64 * texel_bits;
    let with_book = |book: Book| {
        let numbers = members.len() as f64 * (book.codewords.nrows().max(1) as f64).log2();
        Size { bits: bits(book.codewords.nrows()) + numbers, error: book.error, book: Some(book) }
    };
    let mut sizes = vec![Size { bits: bits(members.len()), error: 0.0, book: None }];
    if !members.is_empty() {
        let values =
            members.iter().flat_map(|&at| maps[at].texels.as_flattened()).map(|&byte| f32::from(byte));
        let vectors =
            Array2::from_shape_vec((members.len(), 3 * texels), values.collect()).unwrap_or_default();
        let weights: Vec<f32> = members.iter().map(|&at| maps[at].weight).collect();
        let reduced = if kind.has_books { principal(&vectors) } else { Array2::zeros((0, 0)) };
        sizes.extend(equal(&members, maps).map(|numbers| {
            // Means of equal maps are rounded; their error is none.
            Size { error: 0.0, ..with_book(Book::of(numbers, &vectors, &weights)) }
        }));
        let halves = (1..usize::BITS).map(|halvings| members.len() >> halvings);
        for count in halves
            .take_while(|&count| kind.has_books && count >= LEAST_CODEWORDS)
            .filter(|&count| count <= MOST_CODEWORDS && !cancel.is_cancelled())
        {
            let settings = Settings { rounds: ROUNDS, ..Settings::default() };
            let found = build(reduced.view(), &weights, count, settings).matches;
            let numbers = found.iter().map(|found| found.index).collect();
            sizes.push(with_book(Book::of(numbers, &vectors, &weights)));
        }
    }
    let own_bits = bits(members.len());
    let sizes = hull(sizes);
    let own_bits = if kind.has_books { own_bits } else { sizes.last().map_or(own_bits, |size| size.bits) };
    Group { kind, members, own_bits, sizes, chosen: 0 }
}

/// Those of rising sizes that lie on the lower convex hull of error over size.
fn hull(mut sizes: Vec<Size>) -> Vec<Size> {
    sizes.sort_by(|a, b| a.bits.total_cmp(&b.bits).then(a.error.total_cmp(&b.error)));
    let mut kept: Vec<Size> = Vec::new();
    let slope = |a: &Size, b: &Size| (a.error - b.error) / (b.bits - a.bits).max(1.0);
    for size in sizes {
        if kept.last().is_some_and(|last| last.error <= size.error) {
            continue;
        }
        while kept.len() > 1
            && slope(&kept[kept.len() - 2], &kept[kept.len() - 1]) <= slope(&kept[kept.len() - 1], &size)
        {
            kept.pop();
        }
        kept.push(size);
    }
    kept
}

/// Chooses sizes: always the step that takes away most error for a bit, until no further one fits in `bits`.
fn spend(groups: &mut [Group], bits: f64) {
    let mut used: f64 = groups.iter().map(|group| group.sizes[0].bits).sum();
    loop {
        let gain = |group: &Group| {
            let (now, next) = (&group.sizes[group.chosen], group.sizes.get(group.chosen + 1)?);
            let cost = next.bits - now.bits;
            let gain = (now.error - next.error) / cost.max(1.0);
            (used + cost <= bits && gain > 0.0).then_some((gain, cost))
        };
        let gains = groups.iter().enumerate().filter_map(|(at, group)| Some((at, gain(group)?)));
        let Some((at, (_, cost))) = gains.max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0))) else {
            return;
        };
        groups[at].chosen += 1;
        used += cost;
    }
}

/// Stores the codewords of a group, or its maps, and the numbers of its members.
fn keep(group: &Group, maps: &[Map], stored: &mut Stored) {
    let (sharing, kept): (&mut Sharing, &mut Vec<Vec<Rgb>>) = match group.kind.log2 {
        Some(log2) => (&mut stored.sharing, &mut stored.patches[log2]),
        None => (&mut stored.sharing, &mut stored.views),
    };
    let numbers = if group.kind.log2.is_some() { &mut sharing.patch_of } else { &mut sharing.view_of };
    match &group.sizes[group.chosen].book {
        None => {
            for (number, &member) in (0..).zip(&group.members) {
                numbers[member] = number;
                kept.push(maps[member].texels.clone());
            }
        }
        Some(book) => {
            sharing.shared = true;
            // Alike ones side by side: blocks of block compression hold texels of neighbours.
            let brightness = |&codeword: &u32| book.codewords.row(codeword as usize).sum();
            let mut order: Vec<u32> = (0..book.codewords.nrows() as u32).collect();
            order.sort_by(|a, b| f32::total_cmp(&brightness(a), &brightness(b)).then(a.cmp(b)));
            let mut places = vec![0; order.len()];
            (0..).zip(&order).for_each(|(place, &codeword)| places[codeword as usize] = place);
            for (&member, &codeword) in group.members.iter().zip(&book.numbers) {
                numbers[member] = places[codeword as usize];
            }
            for &codeword in &order {
                let values: Vec<u8> = book
                    .codewords
                    .row(codeword as usize)
                    .iter()
                    .map(|&value| value.round().clamp(0.0, 255.0) as u8)
                    .collect();
                kept.push(values.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect());
            }
        }
    }
    let count = kept.len() as u32;
    match group.kind.log2 {
        Some(log2) => sharing.patches[log2] = count,
        None => sharing.views = count,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(count: usize, kinds: usize) -> LayerMaps {
        let map = |at: usize| Map {
            texels: (0..6).map(|texel| [(at % kinds * 40) as u8, (texel * 9) as u8, 7]).collect(),
            gains: Vec3::ZERO,
            weight: 1.0 + at as f32,
        };
        let empty = Map::default();
        // Three corners a triangle, of which the second has no map.
        let patches = (0..3 * count).map(|at| if at % 3 == 1 { empty.clone() } else { map(at) });
        LayerMaps { patches: patches.collect(), views: (0..count).map(map).collect() }
    }

    #[test]
    fn alike_maps_become_one_codeword_without_loss() {
        let maps = layer(40, 3);
        let layers = [&maps];
        let sides = [1u8; 40];
        // Equal maps are stored once in any case.
        let own = share(
            &layers,
            [&sides; 2],
            Codebooks { of: Books::None, room: Room::Share(1.0) },
            24.0,
            CancelCheck::default(),
        )
        .0;
        let shared = share(
            &layers,
            [&sides; 2],
            Codebooks { of: Books::All, room: Room::Share(0.3) },
            24.0,
            CancelCheck::default(),
        )
        .0;
        for stored in [&own[0], &shared[0]] {
            // Two corners of three have a map, and their kinds go by threes as well.
            let counts = (stored.patches[1].len(), stored.views.len());
            assert!(stored.sharing.shared && counts == (2, 3), "{counts:?}");
            for (map, &number) in layers[0].patches.iter().zip(&stored.sharing.patch_of) {
                match number {
                    NONE => assert!(map.texels.is_empty()),
                    number => assert_eq!(stored.patches[1][number as usize], map.texels),
                }
            }
            for (map, &number) in layers[0].views.iter().zip(&stored.sharing.view_of) {
                assert_eq!(stored.views[number as usize], map.texels);
            }
        }
    }

    #[test]
    fn texels_go_where_they_take_away_most_error() {
        // Views are all alike, patches all different: a third of the texels suffices for all but a few patches.
        let mut maps = layer(16, 1);
        for (at, map) in maps.patches.iter_mut().enumerate().filter(|(_, map)| !map.texels.is_empty()) {
            map.texels.iter_mut().for_each(|texel| *texel = [(at * 5) as u8; 3]);
        }
        let stored = share(
            &[&maps],
            [&[1; 16]; 2],
            Codebooks { of: Books::All, room: Room::Share(0.75) },
            24.0,
            CancelCheck::default(),
        )
        .0;
        assert_eq!(stored[0].patches[1].len(), 32);
        assert!(stored[0].views.len() <= 4);
    }
}

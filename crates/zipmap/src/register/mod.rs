//! Registration: from an unordered folder of photographs to a root, and for each other photograph a matrix and a
//! parent.
//!
//! Features of every photograph, matches of every pair, a homography with its inliers, refinement on all pixels, and
//! checks that leave out what does not agree; then the photograph of the coarsest scale becomes the root, and each
//! other one hangs on the one that it is a detail of. Source: Eisemann, Eisemann, Seidel, Magnor, "Photo zoom: high
//! resolution from unordered image collections", GI 2010. Matrices are then fitted to
//! all homographies by turns.

mod dense;
mod descriptor;
mod features;
mod gray;
mod homography;
mod matching;

use glam::{DMat3, DVec2};
use rayon::prelude::*;
use texfold_core::image::Raster;
use texfold_core::{CancelCheck, EncodeError, Job};

use crate::geometry::{normalised, seen_in};
use crate::linear::{area, area_scale, project};
pub use dense::Agreement;
use features::Feature;
use gray::{Gray, Pyramid};
use homography::Fit;

/// Features below which a photograph shows nothing to recognise.
const LEAST_FEATURES: usize = 12;
/// Matches that a homography is accepted on at least.
const LEAST_INLIERS: usize = 10;
/// As a share of all matches between features that lie in what both photographs share.
const LEAST_SHARE: f64 = 0.2;
/// Least part of the shared area that the inliers' spread covers: a cluster says little of what lies around it.
const LEAST_SPREAD: f64 = 0.02;
/// Least correlation of the photographs, median of fields.
const LEAST_AGREEMENT: f64 = 0.45;
/// Least zoom by which a photograph shows more than its parent.
const LEAST_ZOOM: f64 = 1.05;
/// Least part of a photograph that lies within the root.
const LEAST_INSIDE: f64 = 0.05;

/// Variance of even places on a side of 1 is a twelfth: this factor makes the spread of inliers over all of an area 1.
const EVEN_SPREAD: f64 = 12.0;
/// Share of a photograph that another of its scale must show for it to show nothing new.
const SAME_SHARE: f64 = 0.9;
/// Pairs of photographs that are matched between two reports of progress: one for each of the usual number of threads.
const PAIRS_A_TIME: usize = 4;
/// Multiplier that spreads the bits of a pair's number over its seed (Fibonacci hashing, Knuth).
const SEED_SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;

/// Turns in which matrices are fitted to all links: errors of a chain of ten links are shared out among them by then.
const SWEEPS: usize = 30;
/// Places a side that stand for a link.
const GRID: usize = 8;

/// Why a photograph is no part of the texture.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LeftOut {
    /// Too few features.
    #[error("shows too little to be recognised by ({features} features)")]
    Blank {
        /// Features found.
        features: usize,
    },
    /// No homography to any other photograph.
    #[error(
        "shows nothing that another photograph shows; its best match has {inliers} points in common and {fault}"
    )]
    Alone {
        /// Matches that agree with the best homography.
        inliers: usize,
        /// What was wrong with it.
        fault: Fault,
    },
    /// It overlaps others, but not those that the root is part of.
    #[error("belongs to another place than the root")]
    Elsewhere,
    /// No finer than a photograph that shows the same.
    #[error("is no finer than photograph {than}, which shows the same (zoom {zoom:.2})")]
    NoFiner {
        /// The other photograph.
        than: usize,
        /// How much finer.
        zoom: f64,
    },
    /// Too little of it lies within the root.
    #[error("lies outside of the root but for {share:.3} of it")]
    Outside {
        /// The share of it that lies within.
        share: f64,
    },
}

/// Why two photographs are not taken to show the same.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// No homography at all.
    #[error("no homography")]
    NoFit,
    /// Too few points agree.
    #[error("too few of {matches} agree")]
    FewInliers {
        /// Matches in what both share.
        matches: usize,
    },
    /// They lie together.
    #[error("these cover only {spread:.3} of what both would share")]
    Cluster {
        /// Share of the area.
        spread: f64,
    },
    /// Another homography fits about as well: a repeating pattern.
    #[error("another homography fits as well")]
    Ambiguous,
    /// The pixels differ.
    #[error("the pixels do not agree (correlation {correlation:.2})")]
    Pixels {
        /// Median correlation of fields.
        correlation: f64,
    },
}

/// Two photographs that show the same.
#[derive(Debug, Clone)]
pub struct Link {
    /// The coarser one.
    pub coarse: usize,
    /// The finer one.
    pub fine: usize,
    /// From pixels of the coarser to pixels of the finer one; (0, 0) is the upper left corner.
    pub matrix: DMat3,
    /// Pixels of the finer one to a pixel of the coarser one.
    pub zoom: f64,
    /// Matches that agree.
    pub inliers: usize,
    /// How well the pixels agree.
    pub agreement: Agreement,
}

/// Where a photograph has its place.
#[derive(Debug, Clone)]
pub struct Placed {
    /// Which photograph.
    pub photo: usize,
    /// The photograph that it is a detail of; the root may be.
    pub parent: usize,
    /// From texture coordinates of the root to its own, 0 to 1 each.
    pub matrix: DMat3,
    /// Its pixels to a pixel of the root.
    pub zoom: f64,
    /// How it agrees with its parent.
    pub link: Link,
}

/// A folder of photographs, put in order.
#[derive(Debug, Clone)]
pub struct Registration {
    /// The photograph of the coarsest scale.
    pub root: usize,
    /// All others that show more, coarse to fine.
    pub placed: Vec<Placed>,
    /// The rest, and why.
    pub left_out: Vec<(usize, LeftOut)>,
    /// All pairs that show the same.
    pub links: Vec<Link>,
}

/// What is known of a photograph.
struct Photo {
    pyramid: Pyramid,
    features: Vec<Feature>,
}

impl Photo {
    fn extent(&self) -> DVec2 {
        self.pyramid.levels[0].extent()
    }

    fn side(&self) -> f64 {
        self.extent().max_element()
    }
}

/// Puts photographs of one surface in order.
///
/// # Errors
/// [`EncodeError`] where there is no photograph, or the job is cancelled.
pub fn register(photos: &[Raster], job: &mut Job<'_>) -> Result<Registration, EncodeError> {
    if photos.is_empty() {
        return Err(texfold_core::SourceError::Empty.into());
    }
    let cancel = job.cancel_check();
    let mut known = Vec::new();
    for (index, photo) in photos.iter().enumerate() {
        job.stage("features", 0.3 * index as f32 / photos.len() as f32)?;
        known.push(job.install(|| {
            let gray = Gray::of(photo);
            let features = features::features(&gray, cancel);
            Photo { pyramid: Pyramid::new(gray), features }
        }));
        job.checkpoint()?;
    }
    let mut links = Vec::new();
    let mut faults = vec![Misfit::NONE; photos.len()];
    let pairs: Vec<(usize, usize)> = (0..photos.len()).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    for (step, batch) in pairs.chunks(PAIRS_A_TIME).enumerate() {
        job.stage("matching", 0.3 + 0.7 * (PAIRS_A_TIME * step) as f32 / pairs.len() as f32)?;
        let seed = job.seed;
        let found: Vec<Result<Link, Misfit>> =
            job.install(|| batch.par_iter().map(|&(a, b)| link(&known, (a, b), seed, cancel)).collect());
        job.checkpoint()?;
        for (&(a, b), found) in batch.iter().zip(found) {
            match found {
                Ok(link) => links.push(link),
                Err(misfit) => [a, b].into_iter().for_each(|photo| {
                    if misfit.inliers >= faults[photo].inliers {
                        faults[photo] = misfit;
                    }
                }),
            }
        }
    }
    Ok(arrange(&known, links, &faults))
}

/// Why two photographs are not linked.
#[derive(Debug, Clone, Copy)]
struct Misfit {
    /// Matches that agree with the best homography.
    inliers: usize,
    fault: Fault,
}

impl Misfit {
    /// No homography at all.
    const NONE: Misfit = Misfit { inliers: 0, fault: Fault::NoFit };
}

/// What two photographs have in common.
fn link(
    photos: &[Photo],
    (a, b): (usize, usize),
    seed: u64,
    cancel: CancelCheck<'_>,
) -> Result<Link, Misfit> {
    let (from, to) = (&photos[a], &photos[b]);
    let matches = matching::matches(&from.features, &to.features, cancel);
    let pairs = homography::pairs(&from.features, &to.features, &matches);
    let seed = seed ^ ((a as u64) << 32 | b as u64).wrapping_mul(SEED_SPREAD);
    let fit = homography::fit(&pairs, (from.side(), to.side()), seed, cancel).ok_or(Misfit::NONE)?;
    let inliers = fit.inliers.len();
    check(&fit, &pairs, from, to).map_err(|fault| Misfit { inliers, fault })?;
    let middle = fit.inliers.iter().map(|pair| pair.from).sum::<DVec2>() / inliers as f64;
    let zoom = area_scale(&fit.matrix, middle).sqrt();
    let (coarse, fine, matrix) =
        if zoom >= 1.0 { (a, b, fit.matrix) } else { (b, a, normalised(fit.matrix.inverse())) };
    let (matrix, agreement) = dense::refine(&photos[coarse].pyramid, &photos[fine].pyramid, &matrix, cancel);
    if agreement.fields < LEAST_AGREEMENT {
        return Err(Misfit { inliers, fault: Fault::Pixels { correlation: agreement.fields } });
    }
    let at = project(&normalised(matrix.inverse()), photos[fine].extent() * 0.5);
    let zoom = area_scale(&matrix, at).max(0.0).sqrt();
    Ok(Link { coarse, fine, matrix, zoom, inliers, agreement })
}

/// Statistics of the inliers: their number, their share of the matches in what both show, and their spread over it.
fn check(fit: &Fit, pairs: &[homography::Pair], from: &Photo, to: &Photo) -> Result<(), Fault> {
    let shared = seen_in(&fit.matrix, from.extent(), to.extent());
    let inside = |pair: &&homography::Pair| {
        let moved = project(&fit.matrix, pair.from);
        moved.cmpge(DVec2::ZERO).all() && moved.cmple(to.extent()).all()
    };
    let matches = pairs.iter().filter(inside).count();
    let inliers = fit.inliers.len();
    if inliers < LEAST_INLIERS || (inliers as f64) < LEAST_SHARE * matches as f64 {
        return Err(Fault::FewInliers { matches });
    }
    let mean = fit.inliers.iter().map(|pair| pair.to).sum::<DVec2>() / inliers as f64;
    let mut moments = [0.0; 3];
    for pair in &fit.inliers {
        let d = pair.to - mean;
        moments = [moments[0] + d.x * d.x, moments[1] + d.y * d.y, moments[2] + d.x * d.y];
    }
    let [xx, yy, xy] = moments.map(|sum| sum / inliers as f64);
    let spread = EVEN_SPREAD * (xx * yy - xy * xy).max(0.0).sqrt() / area(&shared).max(1e-9);
    if spread < LEAST_SPREAD { Err(Fault::Cluster { spread }) } else { Ok(()) }
}

/// Root, parents and matrices.
fn arrange(photos: &[Photo], links: Vec<Link>, faults: &[Misfit]) -> Registration {
    let (component, scales) = scales(photos.len(), &links);
    let size_of = |c: usize| component.iter().filter(|&&other| other == c).count();
    // The largest group; in it the coarsest photograph, of equals the one that shows most, then the first.
    let largest = (0..photos.len()).rev().max_by_key(|&photo| size_of(component[photo])).unwrap_or(0);
    let members = (0..photos.len()).filter(|&photo| component[photo] == component[largest]);
    let extent = |photo: usize| photos[photo].extent().element_product() / scales[photo].powi(2);
    let coarser = |a: &usize, b: &usize| {
        let level = |photo: usize| (scales[photo].ln() / LEAST_ZOOM.ln()).round();
        level(*a).total_cmp(&level(*b)).then(extent(*b).total_cmp(&extent(*a))).then(a.cmp(b))
    };
    let mut order: Vec<usize> = members.collect();
    order.sort_by(coarser);
    let root = order[0];
    let mut result = Registration { root, placed: Vec::new(), left_out: Vec::new(), links };
    for &photo in &order[1..] {
        match place(photo, photos, &result) {
            Ok(placed) => result.placed.push(placed),
            Err(reason) => result.left_out.push((photo, reason)),
        }
    }
    settle(photos, &mut result);
    for photo in (0..photos.len()).filter(|&photo| component[photo] != component[root]) {
        let Misfit { inliers, fault } = faults[photo];
        let features = photos[photo].features.len();
        let reason = if features < LEAST_FEATURES {
            LeftOut::Blank { features }
        } else if size_of(component[photo]) > 1 {
            LeftOut::Elsewhere
        } else {
            LeftOut::Alone { inliers, fault }
        };
        result.left_out.push((photo, reason));
    }
    result.left_out.sort_by_key(|(photo, _)| *photo);
    result
}

/// For each photograph its group, and its pixels to a pixel of the group's first.
fn scales(count: usize, links: &[Link]) -> (Vec<usize>, Vec<f64>) {
    let mut component: Vec<usize> = (0..count).collect();
    let mut scales = vec![1.0; count];
    // The most certain links first, as a spanning tree.
    let mut order: Vec<&Link> = links.iter().collect();
    order.sort_by_key(|link| std::cmp::Reverse(link.inliers));
    for link in order {
        let (old, new) = (component[link.fine], component[link.coarse]);
        if old == new {
            continue;
        }
        let factor = scales[link.coarse] * link.zoom / scales[link.fine];
        for photo in 0..count {
            if component[photo] == old {
                component[photo] = new;
                scales[photo] *= factor;
            }
        }
    }
    (component, scales)
}

/// The place of a photograph below those that have one.
fn place(photo: usize, photos: &[Photo], known: &Registration) -> Result<Placed, LeftOut> {
    let at = |index: usize| known.placed.iter().find(|placed| placed.photo == index);
    let has_place = |index: usize| index == known.root || at(index).is_some();
    let mut parents: Vec<&Link> =
        known.links.iter().filter(|link| link.fine == photo && has_place(link.coarse)).collect();
    // The parent that most agrees: errors of a chain are those of its links.
    parents.sort_by_key(|link| std::cmp::Reverse(link.inliers));
    let Some(link) = parents.iter().find(|link| link.zoom >= LEAST_ZOOM).or(parents.first()) else {
        return Err(LeftOut::Elsewhere);
    };
    if link.zoom < LEAST_ZOOM {
        return Err(LeftOut::NoFiner { than: link.coarse, zoom: link.zoom });
    }
    // A photograph of the same scale that shows it all as well.
    let double = known.links.iter().find(|other| {
        let pair = [other.coarse, other.fine];
        let partner = if pair[0] == photo { pair[1] } else { pair[0] };
        pair.contains(&photo)
            && has_place(partner)
            && other.zoom < LEAST_ZOOM
            && covers(photos, other, photo) > SAME_SHARE
    });
    if let Some(double) = double {
        let than = if double.coarse == photo { double.fine } else { double.coarse };
        return Err(LeftOut::NoFiner { than, zoom: double.zoom });
    }
    let to_pixels = |index: usize| DMat3::from_scale(photos[index].extent());
    let parent = at(link.coarse).map_or(DMat3::IDENTITY, |placed| placed.matrix);
    let own = to_pixels(photo).inverse() * link.matrix * to_pixels(link.coarse);
    let matrix = normalised(own * parent);
    let inverse = normalised(matrix.inverse());
    let share = area(&seen_in(&matrix, DVec2::ONE, DVec2::ONE));
    if share.is_nan() || share < LEAST_INSIDE {
        return Err(LeftOut::Outside { share });
    }
    let middle = project(&inverse, DVec2::splat(0.5));
    let pixels = to_pixels(photo) * matrix * to_pixels(known.root).inverse();
    let zoom = area_scale(&pixels, middle * photos[known.root].extent()).max(0.0).sqrt();
    Ok(Placed { photo, parent: link.coarse, matrix, zoom, link: (*link).clone() })
}

/// Fits the matrices to all links, by turns: a chain of links alone would add up their errors.
fn settle(photos: &[Photo], known: &mut Registration) {
    // From pixels of the root to pixels of each photograph.
    let root = photos[known.root].extent();
    let mut matrices: Vec<Option<DMat3>> = vec![None; photos.len()];
    matrices[known.root] = Some(DMat3::IDENTITY);
    for placed in &known.placed {
        let own = DMat3::from_scale(photos[placed.photo].extent());
        matrices[placed.photo] = Some(own * placed.matrix * DMat3::from_scale(root.recip()));
    }
    for _ in 0..SWEEPS {
        for placed in &known.placed {
            let photo = placed.photo;
            let links = known.links.iter().filter(|link| [link.coarse, link.fine].contains(&photo));
            let places: Vec<(DVec2, DVec2)> = links
                .filter_map(|link| {
                    let other = link.coarse + link.fine - photo;
                    let to_root = matrices[other]?.inverse();
                    let matrix = if link.fine == photo { link.matrix } else { link.matrix.inverse() };
                    Some((photos[other].extent(), photos[photo].extent(), to_root, matrix))
                })
                .flat_map(|(extent, own, to_root, matrix)| {
                    let inside = move |place: &DVec2| {
                        let moved = project(&matrix, *place);
                        moved.cmpge(DVec2::ZERO).all() && moved.cmple(own).all()
                    };
                    let places = grid(extent, own, &matrix).into_iter().filter(inside);
                    places.map(move |place| (project(&to_root, place), project(&matrix, place)))
                })
                .collect();
            if let Some(found) = homography::through(&places).filter(DMat3::is_finite) {
                matrices[photo] = Some(found);
            }
        }
    }
    for placed in &mut known.placed {
        let own = DMat3::from_scale(photos[placed.photo].extent().recip());
        if let Some(matrix) = matrices[placed.photo] {
            placed.matrix = normalised(own * matrix * DMat3::from_scale(root));
        }
    }
}

/// Places of a photograph spread over what another shows of it.
fn grid(extent: DVec2, other: DVec2, matrix: &DMat3) -> Vec<DVec2> {
    let shared = seen_in(&normalised(matrix.inverse()), other, extent);
    let low = shared.iter().copied().reduce(DVec2::min).unwrap_or(DVec2::ZERO);
    let high = shared.iter().copied().reduce(DVec2::max).unwrap_or(extent);
    let at = |k: usize| f64::from(k as u32) / (GRID - 1) as f64;
    (0..GRID * GRID).map(|k| low + (high - low) * DVec2::new(at(k % GRID), at(k / GRID))).collect()
}

/// The share of `photo` that its partner in a link shows too.
fn covers(photos: &[Photo], link: &Link, photo: usize) -> f64 {
    let (own, other) = (photos[photo].extent(), photos[link.coarse + link.fine - photo].extent());
    let matrix = if link.fine == photo { link.matrix } else { normalised(link.matrix.inverse()) };
    area(&seen_in(&matrix, other, own)) / own.element_product()
}

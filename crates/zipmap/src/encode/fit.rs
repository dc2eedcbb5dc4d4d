//! How finely each image is stored: from the first of its mip levels that the goal needs, upsampled for those that are not stored; and
//! in which content.

use std::collections::HashMap;

use glam::DMat3;
use rayon::prelude::*;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::metric::SquaredError;
use texfold_core::target::{Measured, search};
use texfold_core::{CancelCheck, EncodeError, Encoded, Goal, ImageLayout, ImageSize, Job, Notes, Texel};

use super::canvas::{Canvas, Laid};
use super::compare::compare;
use super::enlarge::{Change, change};
use super::{fault, trim};
use crate::encoded::bytes_of;
use crate::parts::{ImageForm, Parts, PatchForm, Payload, patch_pixel, suits_patches};
use crate::{ZipError, ZipParams, ZipTexture};

/// What was made of a canvas.
pub(crate) struct Fitted {
    pub(crate) texture: ZipTexture,
    /// What compression changes, at texels of the root and of each patch.
    pub(crate) losses: Vec<SquaredError>,
    /// Number of finest levels of each image that are not stored: all where it is left out.
    pub(crate) cuts: Vec<usize>,
    /// Texels of each patch to a texel of the root, as it is stored.
    pub(crate) zooms: Vec<f64>,
}

/// The texture in planes that meets the goal best: images without the levels that it does not need, contents from the
/// smallest on.
pub(crate) fn fit(
    maker: &mut Maker<'_>,
    contents: &[Content],
    source_texels: f64,
    job: &mut Job<'_>,
) -> Result<(Measured, Fitted), EncodeError> {
    let goal = maker.params.goal;
    let plans = job.install(|| Plans::of(maker.canvas, goal, maker.pixel.color, maker.cancel));
    job.checkpoint()?;
    let mut best: Option<(Measured, Fitted)> = None;
    for (index, &content) in contents.iter().enumerate() {
        job.stage("compressing blocks", 0.65 + 0.3 * index as f32 / contents.len() as f32)?;
        let guess = plans.guess(maker, content, source_texels);
        let found = search(goal, 1..=plans.count(), guess, 0.0, |index| {
            let cuts = plans.cuts(index);
            let made = job.install(|| maker.make(content, &cuts, source_texels))?;
            Ok::<_, EncodeError>((made.measured, (cuts, made)))
        })?;
        // More bits elsewhere cannot help before all images are as fine as they come.
        let is_enough = match goal {
            Goal::Bpp(_) => found.index < plans.count() || !found.met,
            _ => found.met,
        };
        let (cuts, Made { losses, texture, .. }) = found.value;
        if best.as_ref().is_none_or(|(best, _)| goal.prefers(&found.measured, best)) {
            let is_stored = |laid: &&Laid| cuts[laid.content] < maker.canvas.levels[laid.content].len();
            let zoom = |laid: &Laid| laid.zoom / f64::from(1 << cuts[laid.content]);
            let zooms = maker.canvas.laid.iter().filter(is_stored).map(zoom).collect();
            best = Some((found.measured, Fitted { texture, losses, cuts, zooms }));
        }
        if is_enough {
            break;
        }
    }
    best.ok_or(fault(ZipError::Full))
}

/// Ways to leave out fine levels, from the coarsest image of all contents to the finest, the best step first.
struct Plans {
    /// For each content the change and the texels without its first 0, 1, 2 … levels, down to none but for tolerances.
    states: Vec<Vec<(Change, u64)>>,
    /// Levels that the coarsest plan leaves out of each content.
    coarsest: Vec<usize>,
    /// Which content becomes finer, and how many levels it lacks then.
    steps: Vec<(usize, usize)>,
}

impl Plans {
    fn of(canvas: &Canvas, goal: Goal, color: ColorSpace, cancel: CancelCheck<'_>) -> Plans {
        let of_content = |content: usize| {
            if cancel.is_cancelled() {
                return vec![(Change { squares: 0.0, worst_block: 0.0 }, 0)];
            }
            let levels = &canvas.levels[content];
            let places = || (0..canvas.laid.len()).filter(|&index| canvas.laid[index].content == content);
            let count = places().count() as f64;
            let size = places().next().map_or((1, 1), |index| canvas.laid[index].size);
            let lost: f64 = places().map(|index| trim::lost(canvas, index, color)).sum();
            let contrast = (lost / (3.0 * count * trim::seen(&levels[0])).max(1e-9)).sqrt();
            let state = |cut: usize| {
                let mut change = change(&levels[0], size, (&levels[cut], cut), contrast, cancel);
                change.squares *= count;
                (change, levels[cut..].iter().map(|level| level.len() as u64).sum())
            };
            let mut states: Vec<_> = (0..levels.len()).into_par_iter().map(state).collect();
            if !matches!(goal, Goal::Tolerance(_)) {
                states.push((Change { squares: lost, worst_block: f64::INFINITY }, 0));
            }
            states
        };
        let states: Vec<Vec<(Change, u64)>> =
            (0..canvas.levels.len()).into_par_iter().map(of_content).collect();
        let mut keyed: Vec<(f64, usize, usize)> = Vec::new();
        let mut coarsest = Vec::new();
        for (content, states) in states.iter().enumerate() {
            let worth = match goal {
                Goal::Bpp(_) => by_texel(states),
                Goal::Psnr(_) => {
                    let texels = canvas.levels[content].first().map_or(0, Vec::len) as f64;
                    worst_first(states, |change| change.squares / texels)
                }
                Goal::Tolerance(_) => worst_first(states, |change| change.worst_block),
            };
            coarsest.push(worth.first().map_or(0, |&(_, from, _)| from));
            keyed.extend(worth.into_iter().map(|(key, _, to)| (key, content, to)));
        }
        // Stable: steps of one content stay in their order.
        keyed.sort_by(|a, b| b.0.total_cmp(&a.0));
        let steps = keyed.into_iter().map(|(_, content, cut)| (content, cut)).collect();
        Plans { states, coarsest, steps }
    }

    fn count(&self) -> u32 {
        self.steps.len() as u32 + 1
    }

    /// Levels that each content lacks by plan `index`, from 1 to [`Plans::count`].
    fn cuts(&self, index: u32) -> Vec<usize> {
        let mut cuts = self.coarsest.clone();
        for &(content, cut) in &self.steps[..index as usize - 1] {
            cuts[content] = cut;
        }
        cuts
    }

    /// The plan that would meet the goal if blocks changed nothing.
    fn guess(&self, maker: &Maker<'_>, content: Content, source_texels: f64) -> u32 {
        let (_, of_patches) = maker.patch_content(content);
        let root_bits = texels(maker.canvas.root_size) * content.bits_per_texel(maker.pixel) * 4.0 / 3.0;
        let meets = |index: &u32| {
            let cuts = self.cuts(*index);
            let chosen = || self.states.iter().zip(&cuts).map(|(states, &cut)| states[cut]);
            match maker.params.goal {
                Goal::Psnr(wanted) => chosen().enumerate().all(|(content, (change, _))| {
                    let count = 3 * maker.canvas.levels[content][0].len() as u64;
                    SquaredError { sum: change.squares, count }.psnr() >= wanted
                }),
                Goal::Tolerance(most) => chosen().all(|(change, _)| change.worst_block <= most),
                Goal::Bpp(bpp) => {
                    let texels: u64 = chosen().map(|(_, texels)| texels).sum();
                    root_bits + texels as f64 * of_patches > bpp * source_texels
                }
            }
        };
        (1..=self.count()).find(meets).unwrap_or(self.count())
    }
}

/// Steps from the coarsest to the finest: squared error saved a texel, and levels left out before and after. Those on
/// the convex hull alone, so that each is worth less than the one before.
fn by_texel(states: &[(Change, u64)]) -> Vec<(f64, usize, usize)> {
    let mut steps: Vec<(f64, usize, usize)> = Vec::new();
    for cut in (0..states.len().saturating_sub(1)).rev() {
        let mut from = cut + 1;
        loop {
            let saved = states[from].0.squares - states[cut].0.squares;
            let worth = saved / (states[cut].1 - states[from].1).max(1) as f64;
            match steps.last() {
                Some(&(before, earlier, _)) if before <= worth => {
                    from = earlier;
                    steps.pop();
                }
                _ => {
                    steps.push((worth, from, cut));
                    break;
                }
            }
        }
    }
    steps
}

/// As [`by_texel`], by how bad what the step leaves behind is.
fn worst_first(states: &[(Change, u64)], badness: impl Fn(&Change) -> f64) -> Vec<(f64, usize, usize)> {
    let mut steps = Vec::new();
    let mut from = states.len() - 1;
    for cut in (0..from).rev() {
        let before = badness(&states[from].0);
        if badness(&states[cut].0) < before {
            steps.push((before, from, cut));
            from = cut;
        }
    }
    steps
}

fn texels((width, height): (u32, u32)) -> f64 {
    f64::from(width) * f64::from(height)
}

/// Makes textures of one canvas, and remembers levels that it has encoded.
pub(crate) struct Maker<'a> {
    pub(crate) canvas: &'a Canvas,
    pub(crate) pixel: PixelInfo,
    /// Levels finer than the root.
    pub(crate) deep: u32,
    pub(crate) params: &'a ZipParams,
    /// Levels of the root, where `None`, and of patch images.
    pub(crate) encoded: HashMap<LevelKey, ContentPlanes>,
    pub(crate) cancel: CancelCheck<'a>,
}

/// A level that is encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct LevelKey {
    /// Which of the patch images; the root where there is none.
    image: Option<usize>,
    level: usize,
    content: Content,
}

/// A texture, what it measures, and what compression changes at the texels of the root and of each patch.
struct Made {
    measured: Measured,
    losses: Vec<SquaredError>,
    texture: ZipTexture,
}

impl Maker<'_> {
    /// How patches are stored where the root has `content`, and their bits a texel.
    fn patch_content(&self, content: Content) -> (Content, f64) {
        let pixel = patch_pixel(self.pixel);
        let stored = match (content, self.params.content) {
            (Content::Raw, _) => Content::Raw,
            (_, Some(Content::Bc3)) if suits_patches(Content::Bc3, pixel) => Content::Bc3,
            _ if pixel.channels == 2 => Content::Bc5,
            _ => Content::Bc7,
        };
        (stored, stored.bits_per_texel(pixel))
    }

    /// The texture of that content without so many fine levels of each image.
    fn make(&mut self, content: Content, cuts: &[usize], source_texels: f64) -> Result<Made, EncodeError> {
        let wanted = self.wanted(content, cuts);
        let missing = wanted.par_iter().filter(|key| !self.encoded.contains_key(key));
        let made =
            missing.map(|&key| Ok((key, self.encode(key)?))).collect::<Result<Vec<_>, EncodeError>>()?;
        self.encoded.extend(made);
        let texture = self.assemble(&wanted, cuts).ok_or(fault(ZipError::Full))?;
        let worst_block = || self.worst_block(&wanted);
        let (measured, losses) = self.measured(&texture, source_texels, worst_block)?;
        Ok(Made { measured, losses, texture })
    }

    /// What a texture measures, and what compression changes at the texels of the root and of each patch. The worst block is
    /// looked for where the goal is a tolerance.
    pub(crate) fn measured(
        &self,
        texture: &ZipTexture,
        source_texels: f64,
        worst_block: impl FnOnce() -> f64,
    ) -> Result<(Measured, Vec<SquaredError>), EncodeError> {
        let losses = losses(self.canvas, texture, self.cancel);
        self.cancel.checkpoint()?;
        let total = losses.iter().fold(SquaredError::default(), |sum, &loss| sum + loss);
        let worst = losses.iter().map(|loss| loss.psnr()).fold(f64::INFINITY, f64::min);
        let measured = Measured {
            psnr: if matches!(self.params.goal, Goal::Psnr(_)) { worst } else { total.psnr() },
            bpp: texture.memory().goal as f64 / source_texels,
            worst_block_rms: if matches!(self.params.goal, Goal::Tolerance(_)) { worst_block() } else { 0.0 },
        };
        self.cancel.checkpoint()?;
        Ok((measured, losses))
    }

    /// The levels of the root, then those of each image behind its cut.
    fn wanted(&self, content: Content, cuts: &[usize]) -> Vec<LevelKey> {
        let stored = self.patch_content(content).0;
        let root = (0..self.canvas.root.len()).map(|level| LevelKey { image: None, level, content });
        let images = self.canvas.levels.iter().zip(cuts).enumerate().flat_map(|(image, (levels, &cut))| {
            (cut..levels.len()).map(move |level| LevelKey { image: Some(image), level, content: stored })
        });
        root.chain(images).collect()
    }

    /// The texture of levels that are encoded; `None` where it does not fit a plane.
    fn assemble(&self, wanted: &[LevelKey], cuts: &[usize]) -> Option<ZipTexture> {
        let mut planes = wanted.iter().filter_map(|key| self.encoded.get(key)).cloned();
        let root = planes.by_ref().take(self.canvas.root.len()).collect();
        // Numbers of the images of which something is left.
        let mut numbers = vec![None; cuts.len()];
        let mut images: Vec<Vec<ContentPlanes>> = Vec::new();
        for (number, (levels, &cut)) in numbers.iter_mut().zip(self.canvas.levels.iter().zip(cuts)) {
            if cut < levels.len() {
                *number = Some(images.len());
                images.push(planes.by_ref().take(levels.len() - cut).collect());
            }
        }
        let image_of = |levels: &Vec<ContentPlanes>| {
            let (width, height) = levels[0].size();
            ImageForm { size: ImageSize { width, height }, levels: levels.len() as u32 }
        };
        let parts = Parts {
            layout: self.layout(),
            deep: self.deep,
            images: images.iter().map(image_of).collect(),
            patches: self.patches(&numbers),
            payload: Payload::Planes { root, images },
        };
        ZipTexture::new(parts, Notes::default())
    }

    /// Layout of the texture: one image, as fine as the finest patch.
    pub(crate) fn layout(&self) -> ImageLayout {
        let (width, height) = self.canvas.root_size;
        ImageLayout::new(
            vec![ImageSize { width: width << self.deep, height: height << self.deep }],
            self.deep + self.canvas.root.len() as u32,
            self.pixel,
        )
    }

    /// The patches whose image is stored, where `numbers` has the number of each that is.
    pub(crate) fn patches(&self, numbers: &[Option<usize>]) -> Vec<PatchForm> {
        let form = |laid: &Laid| Some(PatchForm { matrix: laid.rows(), content: numbers[laid.content]? });
        self.canvas.laid.iter().filter_map(form).collect()
    }

    fn encode(&self, LevelKey { image, level, content }: LevelKey) -> Result<ContentPlanes, EncodeError> {
        self.cancel.checkpoint()?;
        let (pixel, bytes) = match image {
            None => (self.pixel, &self.canvas.root[level]),
            Some(image) => (patch_pixel(self.pixel), &self.canvas.levels[image][level]),
        };
        let texel = |bytes: &[u8; 4]| Texel::from_array(bytes.map(f32::from)) / 255.0;
        let texels: Vec<Texel> = bytes.iter().map(texel).collect();
        let size = self.size_of(image);
        let size = ((size.0 >> level).max(1), (size.1 >> level).max(1));
        let effort = self.params.effort;
        ContentPlanes::encode_cancellable(content, pixel, size, &texels, effort, self.cancel)
    }

    /// Size of the root, or of a patch image.
    pub(crate) fn size_of(&self, index: Option<usize>) -> (u32, u32) {
        let has = |laid: &&Laid| Some(laid.content) == index;
        match index {
            None => self.canvas.root_size,
            Some(_) => self.canvas.laid.iter().find(has).map_or((1, 1), |laid| laid.size),
        }
    }

    /// RMS error of the worst 4x4 block of the root and of all patch images, in 8-bit units, from the finest level
    /// of each that is among `stored`.
    fn worst_block(&self, stored: &[LevelKey]) -> f64 {
        let is_finest = |at: &usize| *at == 0 || stored[*at].image != stored[at - 1].image;
        let worst = |at: usize| {
            let LevelKey { image: index, level, .. } = stored[at];
            let source = index.map_or(&self.canvas.root[0], |index| &self.canvas.levels[index][0]);
            let Some(planes) = self.encoded.get(&stored[at]) else { return 0.0 };
            let pixel = if index.is_some() { patch_pixel(self.pixel) } else { self.pixel };
            let decoded = bytes_of(planes, pixel);
            change(source, self.size_of(index), (&decoded, level), 0.0, self.cancel).worst_block
        };
        (0..stored.len()).into_par_iter().filter(is_finest).map(worst).reduce(|| 0.0, f64::max)
    }
}

/// What compression changes, at texels of the root and of each patch.
fn losses(canvas: &Canvas, texture: &ZipTexture, cancel: CancelCheck<'_>) -> Vec<SquaredError> {
    let of = |names: &[u16], matrix: DMat3, size: (u32, u32)| {
        let table = canvas.table(names);
        compare(&canvas.view(&table), &texture.view(), &matrix.inverse(), size, cancel)
    };
    let all: Vec<u16> = (0..canvas.laid.len() as u16).collect();
    let root = of(&all, DMat3::IDENTITY, canvas.root_size);
    let of_patch = |laid: &Laid| of(&canvas.touching(&laid.matrix), laid.matrix, laid.size);
    std::iter::once(root).chain(canvas.laid.iter().map(of_patch)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(squares: f64, worst_block: f64, texels: u64) -> (Change, u64) {
        (Change { squares, worst_block }, texels)
    }

    #[test]
    fn steps_are_worth_less_and_less_and_lead_to_the_finest() {
        // Without the second level little more is lost than without the first alone.
        let states = [state(0.0, 0.0, 85), state(90.0, 6.0, 21), state(100.0, 6.0, 5), state(900.0, 9.0, 1)];
        assert_eq!(by_texel(&states), [(200.0, 3, 2), (1.25, 2, 0)]);
        let by_block = |states: &[(Change, u64)]| worst_first(states, |change| change.worst_block);
        assert_eq!(by_block(&states), [(9.0, 3, 2), (6.0, 2, 0)]);
        assert!(by_texel(&states[..1]).is_empty() && by_block(&states[..1]).is_empty());
    }
}

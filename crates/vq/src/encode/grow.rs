//! Adding images to a texture (paper section 4.2): blocks that the codebook holds within the join threshold use it, the
//! rest becomes new codewords in free cells or in rows added below. No texel that was valid before changes.
//!
//! Cost: one exact search for each block, and an incremental codeword for each that is not within the threshold. *Not
//! done*: moving codewords that are there, as other images use them.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use texfold_codebook::{Leaders, Search};
use texfold_core::{Cached, CancelCheck, EncodeError, Job, SourceError, Texel};

use super::assemble::{assign, corners_of, windows_at};
use super::blocks::{Blocks, texel_of};
use super::incremental::{ROWS_A_LOOK, squared_reach};
use super::{check_sizes, held_bytes, report};
use crate::classes::Groups;
use crate::grid::{Grid, MAX_CODEBOOK_SIDE};
use crate::{VqSource, VqTexture};

/// Ends the verdict of a texture that has grown.
const GROWN: &str = " Images were added later; what each part brings was not measured again.";

pub(crate) fn add(
    texture: &mut VqTexture,
    source: VqSource<'_>,
    job: &mut Job<'_>,
) -> Result<(), EncodeError> {
    let index: u64 = texture.parts.classes.iter().map(|class| 2 * class.index.len() as u64).sum();
    // The grown texture stands beside the old one until it is whole.
    let bytes = held_bytes(source.images) + 2 * index;
    let grown = job.holding(bytes, |job| {
        job.stage("matching", 0.0)?;
        // A set that is stored as gray takes further colour images as gray.
        let gray = (texture.parts.layout.pixel.channels == 1 && source.images.info().channels == 3)
            .then(|| source.images.to_gray());
        let source = VqSource { images: gray.as_ref().unwrap_or(source.images), ..source };
        check(texture, &source)?;
        let cancel = job.cancel_check();
        job.install(|| grow(texture, &source, cancel))
    })?;
    job.stage("done", 1.0)?;
    *texture = grown;
    Ok(())
}

fn check(texture: &VqTexture, source: &VqSource<'_>) -> Result<(), SourceError> {
    let (pixel, known) = (source.images.info(), texture.parts.layout.pixel);
    if pixel.channels != known.channels {
        return Err(SourceError::Unlike { index: 0, what: "its number of channels" });
    }
    if pixel.color != known.color {
        return Err(SourceError::Unlike { index: 0, what: "its colour space" });
    }
    check_sizes(source.images, texture.parts.layout.levels)
}

fn grow(
    texture: &VqTexture,
    source: &VqSource<'_>,
    cancel: CancelCheck<'_>,
) -> Result<VqTexture, EncodeError> {
    let blocks = Blocks::cut(source.images, texture.parts.layout.levels, cancel)?;
    let channels = blocks.channels;
    let (width, _) = texture.parts.codebook.size();
    let grid = Grid::of_texels(texture.parts.codebook.size());
    let (mut corners, codewords) = corners_of(texture);
    corners.extend(codewords);
    let windows = windows_at(texture.codebook_texels(), width, &corners, channels);
    let codewords = new_codewords(&blocks, windows.view(), f64::from(texture.parts.join_rms), cancel)?;
    let Room { cells, height } = room_for(texture, grid, codewords.nrows())?;
    let filled: Vec<(u32, u32, [Texel; 16])> = cells
        .iter()
        .zip(codewords.rows())
        .map(|(&(x, y), codeword)| (x, y, cell_texels(&codeword.to_vec(), channels)))
        .collect();
    let codebook = texture.parts.codebook.with_cells(&filled, height);
    let mut grown = texture.clone();
    grown.texels = Cached::from(codebook.decode());
    grown.parts.codebook = codebook;
    grown.parts.free_cells = (cells.len() - codewords.nrows()) as u32;
    corners.extend(cells.iter().take(codewords.nrows()).map(|&(x, y)| [x as u8, y as u8]));
    append_images(&mut grown, &blocks, &corners, cancel)?;
    grown.notes.verdict = report::verdict(&grown, true) + GROWN;
    grown.notes.psnr_without.clear();
    Ok(grown)
}

/// Codewords for the blocks that no window matches within the threshold.
fn new_codewords(
    blocks: &Blocks,
    windows: ArrayView2<'_, f32>,
    join_rms: f64,
    cancel: CancelCheck<'_>,
) -> Result<Array2<f32>, EncodeError> {
    let reach = squared_reach(join_rms, blocks.vectors.ncols());
    let search = (windows.nrows() > 0).then(|| Search::new(windows));
    let is_new = |&row: &usize| {
        let near = |search: &Search| search.nearest(blocks.vector(row), reach).is_some();
        !cancel.is_cancelled() && !search.as_ref().is_some_and(near)
    };
    let unseen: Vec<usize> = (0..blocks.len()).into_par_iter().filter(is_new).collect();
    let mut leaders = Leaders::new(blocks.view());
    for rows in unseen.chunks(ROWS_A_LOOK) {
        cancel.checkpoint()?;
        rows.iter().for_each(|&row| _ = leaders.join_or_add(blocks.vector(row), reach));
    }
    cancel.checkpoint().map(|()| leaders.into_codewords())
}

/// Where further codewords go.
struct Room {
    /// Corners of all cells that are free once the codebook has grown.
    cells: Vec<(u32, u32)>,
    /// Rows of texels that the codebook needs.
    height: u32,
}

fn room_for(texture: &VqTexture, grid: Grid, count: usize) -> Result<Room, SourceError> {
    let used = grid.free_cells(&texture.parts.samples).len() - texture.parts.free_cells as usize;
    let missing = (count as u32).saturating_sub(texture.parts.free_cells);
    let rows = grid.rows + missing.div_ceil(grid.columns);
    if rows > MAX_CODEBOOK_SIDE / 4 {
        return Err(SourceError::Full {
            what: "the codebook has its most rows, 256, and all are in use; encode all images anew, or the first ones with a smaller codebook",
        });
    }
    let cells = Grid { rows, ..grid }.free_cells(&texture.parts.samples);
    Ok(Room { cells: cells[used..].to_vec(), height: rows * 4 })
}

fn cell_texels(codeword: &[f32], channels: usize) -> [Texel; 16] {
    std::array::from_fn(|index| texel_of(&codeword[index * channels..(index + 1) * channels]))
}

/// Adds the images to layout and index planes; those already there keep their indices.
fn append_images(
    grown: &mut VqTexture,
    blocks: &Blocks,
    corners: &[[u8; 2]],
    cancel: CancelCheck<'_>,
) -> Result<(), EncodeError> {
    let windows =
        windows_at(grown.codebook_texels(), grown.parts.codebook.size().0, corners, blocks.channels);
    let all: Vec<usize> = (0..blocks.len()).collect();
    let matches = assign(blocks, &all, windows.view(), cancel)?;
    let (old_classes, old_places) =
        (std::mem::take(&mut grown.parts.classes), std::mem::take(&mut grown.parts.places));
    grown.parts.layout.images.extend(&blocks.sizes);
    let groups = Groups::of(&grown.parts.layout);
    let mut classes = groups.classes(grown.parts.codebook.swizzle().0);
    for (which, place) in groups.places.iter().enumerate() {
        let class = &mut classes[place.class];
        for block in 0..class.blocks() {
            let value = match old_places.get(which) {
                Some(old) => old_classes[old.class].index[old_classes[old.class].position(old.number, block)],
                None => {
                    let start = blocks.starts[which - old_places.len()];
                    corners[matches[start + block as usize].index as usize]
                }
            };
            let position = class.position(place.number, block);
            class.index[position] = value;
        }
    }
    grown.parts.classes = classes;
    grown.parts.places = groups.places;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::container::{SectionWriter, Sections};
    use texfold_core::image::{ColorSpace, ImageSet, Raster};
    use texfold_core::metric::{decode_image, quality};
    use texfold_core::{Budget, Cancel, Encoded, Encoder, Goal, Limits, TextureCodec};
    use texfold_testkit::frames;

    use crate::{Vq, VqParams};

    #[test]
    fn a_further_frame_changes_nothing_that_was_there() {
        for content in [texfold_bc::Content::Raw, texfold_bc::Content::Bc1, texfold_bc::Content::Bc7] {
            let mut frames = frames("ripple").images().to_vec();
            let last = ImageSet::single(frames.pop().unwrap());
            let first = ImageSet::new(frames).unwrap();
            let params = VqParams { goal: Goal::Bpp(6.0), content: Some(content), ..VqParams::default() };
            let mut texture = Vq::encode(VqSource::new(&first), &params, &mut Job::default()).unwrap();
            let before: Vec<_> = (0..4).map(|image| decode_image(&texture, image, 0)).collect();
            add(&mut texture, VqSource::new(&last), &mut Job::default()).unwrap();
            let after: Vec<_> = (0..4).map(|image| decode_image(&texture, image, 0)).collect();
            assert!(before == after, "{content:?}");
            assert_eq!(texture.layout().images.len(), 5);
            let decoded = decode_image(&texture, 4, 0).unwrap();
            let rms = texfold_core::metric::color_error(&last.images()[0], &decoded).rms();
            assert!(
                rms <= f64::from(texture.parts.join_rms) + 4.0,
                "{content:?}: {rms} {}",
                texture.parts.join_rms
            );
        }
    }

    fn through_a_file(texture: &VqTexture) -> VqTexture {
        let mut writer = SectionWriter::new(Vq::ID);
        texture.store(&mut writer);
        let (bytes, mut budget) = (writer.finish().bytes, Budget::default());
        Vq::load(&Sections::parse(&bytes, &mut budget).unwrap(), &mut budget).unwrap()
    }

    #[test]
    fn a_texture_grows_again_and_again_by_way_of_files() {
        let frames = frames("ripple").images().to_vec();
        let params = VqParams { goal: Goal::Bpp(3.0), ..VqParams::default() };
        let first = ImageSet::single(frames[0].clone());
        let mut direct = Vq::encode(VqSource::new(&first), &params, &mut Job::default()).unwrap();
        let mut filed = through_a_file(&direct);
        for frame in &frames[1..] {
            let set = ImageSet::single(frame.clone());
            for texture in [&mut direct, &mut filed] {
                add(texture, VqSource::new(&set), &mut Job::default()).unwrap();
            }
            filed = through_a_file(&filed);
            assert_eq!(filed, direct);
        }
        // The verdict speaks of the codebook as it is now, and nothing is said of what was not measured.
        let (width, height) = direct.codebook_size();
        let notes = direct.notes();
        assert!(notes.verdict.contains(&format!("{width}x{height}")), "{}", notes.verdict);
        assert!(notes.verdict.ends_with(GROWN) && notes.psnr_without.is_empty());
    }

    #[test]
    fn growth_that_is_cancelled_too_large_or_of_another_kind_changes_nothing() {
        let images = frames("ripple").images().to_vec();
        let (first, last) = (ImageSet::single(images[0].clone()), ImageSet::single(images[1].clone()));
        let params = VqParams { goal: Goal::Bpp(3.0), ..VqParams::default() };
        let mut texture = Vq::encode(VqSource::new(&first), &params, &mut Job::default()).unwrap();
        let copy = texture.clone();
        let cancel = Cancel::default();
        cancel.cancel();
        let cancelled = add(&mut texture, VqSource::new(&last), &mut Job::default().with_cancel(&cancel));
        assert!(matches!(cancelled, Err(EncodeError::Cancelled)));
        let mut small = Job::new(Limits { bytes: 1024, ..Limits::default() });
        assert!(matches!(add(&mut texture, VqSource::new(&last), &mut small), Err(EncodeError::Limit(_))));
        let linear = Raster::from_u8(4, 4, 3, ColorSpace::Linear, &[3; 48]).unwrap();
        let added = add(&mut texture, VqSource::new(&ImageSet::single(linear)), &mut Job::default());
        assert!(matches!(added, Err(EncodeError::Source(SourceError::Unlike { .. }))));
        assert_eq!(texture, copy);
    }

    #[test]
    fn a_texture_that_cannot_grow_stays_as_it_was() {
        let set = frames("caustics");
        let params = VqParams { codebook: Some((16, 16)), ..VqParams::default() };
        let mut texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
        texture.parts.join_rms = 0.1;
        let copy = texture.clone();
        let noise: Vec<u8> =
            (0..256 * 256 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 17) as u8).collect();
        let noise = Raster::from_u8(256, 256, 3, ColorSpace::Srgb, &noise).unwrap();
        let added = add(&mut texture, VqSource::new(&ImageSet::single(noise)), &mut Job::default());
        assert!(matches!(added, Err(EncodeError::Source(SourceError::Full { .. }))));
        assert_eq!(texture, copy);
        let gray = Raster::from_u8(4, 4, 4, ColorSpace::Srgb, &[3; 64]).unwrap();
        let added = add(&mut texture, VqSource::new(&ImageSet::single(gray)), &mut Job::default());
        assert!(matches!(added, Err(EncodeError::Source(SourceError::Unlike { .. }))));
        let _ = quality(&set, &texture);
    }
}

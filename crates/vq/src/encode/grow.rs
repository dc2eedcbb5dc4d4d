//! Adding images to a texture (paper section 4.2): what the codebook shows within the join threshold uses it, the
//! rest becomes new codewords in free cells or in rows added below. No texel that was valid before changes.

use ndarray::{Array2, ArrayView2};
use texfold_codebook::{Leaders, Search};
use texfold_core::{EncodeError, Job, SourceError, Texel};

use super::assemble::windows_at;
use super::blocks::{Blocks, texel_of};
use super::incremental::squared_reach;
use super::plan::Grid;
use crate::encoded::size_classes;
use crate::params::MAX_CODEBOOK_SIDE;
use crate::{VqSource, VqTexture};

pub(crate) fn add(
    texture: &mut VqTexture,
    source: VqSource<'_>,
    job: &mut Job<'_>,
) -> Result<(), EncodeError> {
    job.stage("matching", 0.0)?;
    // A picture that was stored as gray takes further colour pictures as gray.
    let gray = (texture.layout.pixel.channels == 1 && source.images.info().channels == 3)
        .then(|| source.images.to_gray());
    let source = VqSource { images: gray.as_ref().unwrap_or(source.images), ..source };
    check(texture, &source)?;
    let grown = job.install(|| grow(texture, &source))?;
    job.stage("done", 1.0)?;
    *texture = grown;
    Ok(())
}

fn check(texture: &VqTexture, source: &VqSource<'_>) -> Result<(), SourceError> {
    let pixel = source.images.info();
    if pixel.channels != texture.layout.pixel.channels {
        return Err(SourceError::Unlike { index: 0, what: "its number of channels" });
    }
    source.images.check_sides()
}

fn grow(texture: &VqTexture, source: &VqSource<'_>) -> Result<VqTexture, EncodeError> {
    let blocks = Blocks::cut(source.images, texture.layout.levels);
    let channels = blocks.channels;
    let (width, _) = texture.codebook.size();
    let grid = Grid::of_texels(texture.codebook.size());
    let (mut corners, codewords) = texture.corners(grid);
    corners.extend(codewords);
    let windows = windows_at(&texture.texels, width, &corners, channels);
    let codewords = new_codewords(&blocks, windows.view(), f64::from(texture.join_rms));
    let (cells, height) = cells_for(texture, grid, codewords.nrows())?;
    let filled: Vec<(u32, u32, [Texel; 16])> = cells
        .iter()
        .zip(codewords.rows())
        .map(|(&(x, y), codeword)| (x, y, cell_texels(&codeword.to_vec(), channels)))
        .collect();
    let codebook = texture.codebook.with_cells(&filled, height);
    let mut grown = texture.clone();
    grown.texels = codebook.decode();
    grown.codebook = codebook;
    grown.free_cells = (Grid { rows: height / 4, ..grid }.free_cells(&texture.samples).len()
        - (grid.free_cells(&texture.samples).len() - texture.free_cells as usize)
        - codewords.nrows()) as u32;
    let corners =
        corners.into_iter().chain(cells.iter().take(codewords.nrows()).map(|&(x, y)| [x as u8, y as u8]));
    append_images(&mut grown, &blocks, &corners.collect::<Vec<_>>());
    Ok(grown)
}

fn new_codewords(blocks: &Blocks, windows: ArrayView2<'_, f32>, join_rms: f64) -> Array2<f32> {
    let reach = squared_reach(join_rms, blocks.vectors.ncols());
    let search = (windows.nrows() > 0).then(|| Search::new(windows));
    let mut leaders = Leaders::new(blocks.view());
    for row in 0..blocks.len() {
        let block = blocks.vector(row);
        if search.as_ref().is_none_or(|search| search.nearest(block, reach).is_none()) {
            leaders.join_or_add(block, reach);
        }
    }
    leaders.into_codewords()
}

/// Corners of free cells for `count` codewords, and the height in texels that the codebook needs.
fn cells_for(texture: &VqTexture, grid: Grid, count: usize) -> Result<(Vec<(u32, u32)>, u32), SourceError> {
    let used = grid.free_cells(&texture.samples).len() - texture.free_cells as usize;
    let side = MAX_CODEBOOK_SIDE / 4;
    let missing = (count as u32).saturating_sub(texture.free_cells);
    let rows = grid.rows + missing.div_ceil(grid.columns);
    if rows > side {
        return Err(SourceError::Full { what: "the codebook of 256 rows" });
    }
    let cells = Grid { rows, ..grid }.free_cells(&texture.samples);
    Ok((cells[used..].to_vec(), rows * 4))
}

fn cell_texels(codeword: &[f32], channels: usize) -> [Texel; 16] {
    std::array::from_fn(|index| texel_of(&codeword[index * channels..(index + 1) * channels]))
}

/// Adds the images to layout and index planes; those already there keep their indices.
fn append_images(grown: &mut VqTexture, blocks: &Blocks, corners: &[[u8; 2]]) {
    let windows = windows_at(&grown.texels, grown.codebook.size().0, corners, blocks.channels);
    let all: Vec<usize> = (0..blocks.len()).collect();
    let matches = super::assemble::assign(blocks, &all, windows.view());
    let (old_classes, old_places) = (std::mem::take(&mut grown.classes), std::mem::take(&mut grown.places));
    grown.layout.surfaces.extend(&blocks.sizes);
    let (mut classes, places) = size_classes(&grown.layout, grown.codebook.swizzle().0);
    for (surface, &(class, place)) in places.iter().enumerate() {
        let class = &mut classes[class];
        for block in 0..class.blocks() {
            let value = match old_places.get(surface) {
                Some(&(old, old_place)) => {
                    old_classes[old].index[old_classes[old].position(old_place, block)]
                }
                None => {
                    let start = blocks.starts[surface - old_places.len()];
                    corners[matches[start + block as usize].index as usize]
                }
            };
            let position = class.position(place, block);
            class.index[position] = value;
        }
    }
    grown.classes = classes;
    grown.places = places;
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::{ColorSpace, ImageSet, Raster};
    use texfold_core::metric::{decode_surface, quality};
    use texfold_core::{Encoded, Encoder, Goal};
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
            let before: Vec<_> = (0..4).map(|surface| decode_surface(&texture, surface, 0)).collect();
            add(&mut texture, VqSource::new(&last), &mut Job::default()).unwrap();
            let after: Vec<_> = (0..4).map(|surface| decode_surface(&texture, surface, 0)).collect();
            assert!(before == after, "{content:?}");
            assert_eq!(texture.layout().surfaces.len(), 5);
            let decoded = decode_surface(&texture, 4, 0).unwrap();
            let rms = texfold_core::metric::color_error(&last.images()[0], &decoded).rms();
            assert!(rms <= f64::from(texture.join_rms) + 4.0, "{content:?}: {rms} {}", texture.join_rms);
        }
    }

    #[test]
    fn a_texture_that_cannot_grow_stays_as_it_was() {
        let set = frames("caustics");
        let params = VqParams { codebook: Some((16, 16)), ..VqParams::default() };
        let mut texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
        texture.join_rms = 0.1;
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

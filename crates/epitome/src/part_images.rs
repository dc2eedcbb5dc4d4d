//! Images of the parts of a texture, for a person to look at.

use std::collections::HashMap;
use std::f32::consts::TAU;

use glam::{UVec2, Vec2, Vec3, Vec4};
use texfold_core::image::{ColorSpace, PartImages, PixelInfo, Raster};
use texfold_core::{Domain, Encoded, Image2d, Texel};

use crate::EpitomeTexture;
use crate::decode::{
    EpitomeView, TexfoldEpitomeLeaf, TexfoldEpitomeSource, texfold_epitome_place,
    texfold_epitome_plane_level, texfold_epitome_source,
};
use crate::fast::leaves;

/// Texels a side of the cells that reads are counted in.
const CELL: u32 = 4;
/// What is left of an image where it lends nothing.
const CHART_GROUND: f32 = 0.2;
/// What is left of a colour at a leaf's upper and left edge.
const OUTLINE: f32 = 0.8;
/// Binary logarithm of the stored share of a leaf's texels that is drawn darkest.
const LEAST_SHARE_LOG2: f32 = -4.0;
/// Gray of what is darkest but not black, which is for what is not there at all.
const DARKEST: f32 = 0.2;

/// Draws the parts of `texture`; `None` only where an image cannot be made at all. Parts of an image have a texel for each of its texels,
/// with leaves outlined; those of an epitome have one for each of the epitome's texels.
///
/// - "epitome": each epitome.
/// - "position": for each image the place in the epitome that each texel is read at: red is the column, green the row, blue the second
///   epitome.
/// - "offset": for each image how each leaf's content is shifted once it is rotated and scaled: hue is the direction, saturation the
///   distance. Leaves whose content lies in the epitome as it does in the image have one colour.
/// - "side": for each image the sides of its leaves: the largest dark, the smallest bright.
/// - "scale": for each image the share of each leaf's texels that is stored: white all, darker by an octave of either side.
/// - "charts": for each image the charts that it lends to the epitomes: the image as it is drawn where it shows their cells as they stand
///   in them, only rotated to no side and in no other gain-offset pair, and dark elsewhere. Of several leaves that could have lent a cell
///   it is the first, images in their order; cells that all show rotated or in other gain-offset pairs are no image's.
/// - "usage": for each epitome how many texels of the images are read from each 4 x 4 cell: black none, the most white, shades between by
///   the logarithm.
#[must_use]
pub fn part_images(texture: &EpitomeTexture) -> Option<Vec<PartImages>> {
    let view = texture.view(0);
    let planes = [(view.params.plane_a, view.plane_a), (view.params.plane_b, view.plane_b)];
    let mut owners = vec![HashMap::new(); planes.len()];
    let [mut epitomes, mut usage, mut charts] = [Vec::new(), Vec::new(), Vec::new()];
    for (plane, (size, levels)) in planes.into_iter().enumerate() {
        let Some(texels) = levels.first() else { continue };
        epitomes.push(rgb(size, texels)?);
        usage.push(draw_usage(size, &count_reads(texture, plane as u32, size))?);
    }
    let images = 0..texture.layout().images.len() as u32;
    for image in images.clone() {
        charts.push(draw_charts(texture, image, &mut owners)?);
    }
    let drawn = |name, color: Color| {
        let images = images.clone().map(|image| draw_leaves(texture, image, color)).collect::<Option<_>>()?;
        Some(PartImages { name, images })
    };
    Some(vec![
        PartImages { name: "epitome", images: epitomes },
        drawn("position", position_color)?,
        drawn("offset", offset_color)?,
        drawn("side", side_color)?,
        drawn("scale", scale_color)?,
        PartImages { name: "charts", images: charts },
        PartImages { name: "usage", images: usage },
    ])
}

fn rgb([width, height]: [u32; 2], texels: &[Texel]) -> Option<Raster> {
    let info = PixelInfo { channels: 3, color: ColorSpace::Srgb, ..PixelInfo::default() };
    Raster::from_texels(width, height, info, texels).ok()
}

/// A leaf of an image, and where its content comes from.
struct DrawnLeaf<'a> {
    view: EpitomeView<'a>,
    leaf: TexfoldEpitomeLeaf,
    source: TexfoldEpitomeSource,
}

/// Colour of a leaf's texel, whose centre lies at that place of the image.
type Color = fn(&DrawnLeaf<'_>, Vec2) -> Vec3;

impl DrawnLeaf<'_> {
    /// The place in the epitome that the texel around `at` is read at, in texels.
    fn place(&self, at: Vec2) -> Vec2 {
        let level = texfold_epitome_plane_level(&self.view, self.source.matrix, 0);
        texfold_epitome_place(&self.source, self.leaf, at, level)
    }

    /// Columns and rows of its epitome.
    fn plane_size(&self) -> Vec2 {
        let params = &self.view.params;
        let size = if self.source.plane == 1 { params.plane_b } else { params.plane_a };
        UVec2::from(size).as_vec2()
    }
}

/// Calls `visit` for each texel of an image with its leaf.
fn for_each_texel(texture: &EpitomeTexture, image: u32, mut visit: impl FnMut(&DrawnLeaf<'_>, UVec2)) {
    let Some(whole) = texture.layout().whole(image, 0) else { return };
    let view = texture.view(image);
    for leaf in leaves(&view, whole) {
        let drawn = DrawnLeaf { view, leaf, source: texfold_epitome_source(&view, leaf.entry) };
        let end = (leaf.corner + leaf.side).min(UVec2::new(whole.width, whole.height));
        for y in leaf.corner.y..end.y {
            for x in leaf.corner.x..end.x {
                visit(&drawn, UVec2::new(x, y));
            }
        }
    }
}

fn draw_leaves(texture: &EpitomeTexture, image: u32, color: Color) -> Option<Raster> {
    let [width, height] = texture.view(image).params.size;
    let mut texels = vec![Texel::ONE; width as usize * height as usize];
    for_each_texel(texture, image, |drawn, at| {
        let edge = at.x == drawn.leaf.corner.x || at.y == drawn.leaf.corner.y;
        let shade = if edge { OUTLINE } else { 1.0 };
        let color = shade * color(drawn, at.as_vec2() + Vec2::splat(0.5));
        texels[at.y as usize * width as usize + at.x as usize] = color.extend(1.0);
    });
    rgb([width, height], &texels)
}

/// An image where it lends cells that `owners` has for no leaf yet: by epitome and cell the image and the entry that
/// it is of.
fn draw_charts(
    texture: &EpitomeTexture,
    index: u32,
    owners: &mut [HashMap<UVec2, (u32, u32)>],
) -> Option<Raster> {
    let whole = texture.layout().whole(index, 0)?;
    let mut image = vec![Texel::ZERO; Image2d::len(whole)];
    texture.decode(whole, &mut image).ok()?;
    let width = whole.width as usize;
    let mut texels: Vec<Texel> = image.iter().map(|texel| (CHART_GROUND * *texel).with_w(1.0)).collect();
    for_each_texel(texture, index, |drawn, at| {
        let TexfoldEpitomeSource { matrix, gain, offset, plane, .. } = drawn.source;
        let is_upright = matrix.y == 0.0 && matrix.z == 0.0 && matrix.x > 0.0 && matrix.w > 0.0;
        if !is_upright || gain != Vec4::ONE || offset != Vec4::ZERO {
            return;
        }
        let cell = drawn.place(at.as_vec2() + Vec2::splat(0.5)).max(Vec2::ZERO).as_uvec2() / CELL;
        let own = (index, drawn.leaf.entry);
        if *owners[plane as usize].entry(cell).or_insert(own) == own {
            let at = at.y as usize * width + at.x as usize;
            texels[at] = image[at];
        }
    });
    rgb([whole.width, whole.height], &texels)
}

fn position_color(drawn: &DrawnLeaf<'_>, at: Vec2) -> Vec3 {
    let place = drawn.place(at) / drawn.plane_size();
    place.clamp(Vec2::ZERO, Vec2::ONE).extend(drawn.source.plane as f32)
}

fn offset_color(drawn: &DrawnLeaf<'_>, _: Vec2) -> Vec3 {
    let matrix = drawn.source.matrix;
    let centre = drawn.leaf.corner.as_vec2() + Vec2::splat(0.5 * drawn.leaf.side as f32);
    let laid =
        Vec2::new(matrix.x * centre.x + matrix.y * centre.y, matrix.z * centre.x + matrix.w * centre.y);
    let offset = drawn.source.position - laid;
    let size = UVec2::from(drawn.view.params.size).as_vec2();
    let far = size.max(drawn.plane_size()).max_element();
    // A root, so that short distances are told apart.
    let saturation = (offset.length() / far).min(1.0).sqrt();
    Vec3::ONE.lerp(hue(offset), saturation)
}

/// The full colour of a direction: red to the right, then by a third of a turn each green and blue.
fn hue(direction: Vec2) -> Vec3 {
    let orientation = direction.y.atan2(direction.x) / TAU;
    let ramp = |from: f32| (6.0 * (orientation + from).rem_euclid(1.0) - 3.0).abs() - 1.0;
    Vec3::new(ramp(0.0), ramp(2.0 / 3.0), ramp(1.0 / 3.0)).clamp(Vec3::ZERO, Vec3::ONE)
}

fn side_color(drawn: &DrawnLeaf<'_>, _: Vec2) -> Vec3 {
    // A block is split twice at most: two octaves.
    let octaves = (drawn.view.params.block / drawn.leaf.side).ilog2() as f32;
    Vec3::splat(DARKEST + (1.0 - DARKEST) * octaves / 2.0)
}

fn scale_color(drawn: &DrawnLeaf<'_>, _: Vec2) -> Vec3 {
    let matrix = drawn.source.matrix;
    let share = (matrix.x * matrix.w - matrix.y * matrix.z).abs();
    let octaves = share.log2().clamp(LEAST_SHARE_LOG2, 0.0);
    Vec3::splat(1.0 - (1.0 - DARKEST) * octaves / LEAST_SHARE_LOG2)
}

/// Texels of all images that are read from each cell of an epitome, row by row.
fn count_reads(texture: &EpitomeTexture, plane: u32, [width, height]: [u32; 2]) -> Vec<u32> {
    let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
    let mut counts = vec![0u32; columns as usize * rows as usize];
    for image in 0..texture.layout().images.len() as u32 {
        for_each_texel(texture, image, |drawn, at| {
            if drawn.source.plane != plane {
                return;
            }
            let place = drawn.place(at.as_vec2() + Vec2::splat(0.5)).max(Vec2::ZERO);
            let cell = (place.as_uvec2() / CELL).min(UVec2::new(columns - 1, rows - 1));
            counts[cell.y as usize * columns as usize + cell.x as usize] += 1;
        });
    }
    counts
}

fn draw_usage(size: [u32; 2], counts: &[u32]) -> Option<Raster> {
    let columns = size[0].div_ceil(CELL);
    let most = counts.iter().copied().max().unwrap_or(0).max(2) as f32;
    let gray = |count: u32| match count {
        0 => 0.0,
        count => DARKEST + (1.0 - DARKEST) * (count as f32).log2() / most.log2(),
    };
    let texel = |x: u32, y: u32| {
        let count = counts[(y / CELL) as usize * columns as usize + (x / CELL) as usize];
        Vec3::splat(gray(count)).extend(1.0)
    };
    let texels: Vec<Texel> = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| texel(x, y))).collect();
    rgb(size, &texels)
}

#[cfg(feature = "encode")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::texfold_epitome_leaf;
    use crate::{Epitome, EpitomeParams, EpitomeSource};
    use texfold_core::image::ImageSet;
    use texfold_core::metric::decode_image;
    use texfold_core::{Access, Effort, Encoder, Goal, Job};

    fn texture() -> EpitomeTexture {
        let set = ImageSet::single(texfold_testkit::image("facade"));
        let params =
            EpitomeParams::new(Goal::Psnr(28.0)).with_access(Access::Texel).with_effort(Effort::Fast);
        Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap()
    }

    #[test]
    fn images_have_the_sizes_of_what_they_show() {
        let texture = texture();
        let parts = part_images(&texture).unwrap();
        let sizes = |rasters: &[Raster]| -> Vec<(u32, u32)> {
            rasters.iter().map(|raster| (raster.size().width, raster.size().height)).collect()
        };
        let epitomes: Vec<(u32, u32)> = texture.epitomes().map(|epitome| epitome.size()).collect();
        for part in &parts {
            match part.name {
                "epitome" | "usage" => assert_eq!(sizes(&part.images), epitomes, "{}", part.name),
                name => assert_eq!(sizes(&part.images), [(256, 256)], "{name}"),
            }
        }
    }

    #[test]
    fn each_texel_is_read_from_one_cell() {
        let texture = texture();
        let params = texture.view(0).params;
        let planes = [params.plane_a, params.plane_b];
        let epitomes = texture.epitomes().count();
        let reads = (0..epitomes).flat_map(|plane| count_reads(&texture, plane as u32, planes[plane]));
        assert_eq!(reads.sum::<u32>(), 256 * 256);
    }

    #[test]
    fn a_texel_is_drawn_where_its_leaf_says() {
        let texture = texture();
        let parts = part_images(&texture).unwrap();
        let view = texture.view(0);
        let at = UVec2::new(101, 59);
        let leaf = texfold_epitome_leaf(&view, at);
        let source = texfold_epitome_source(&view, leaf.entry);
        let drawn = DrawnLeaf { view, leaf, source };
        let wanted = position_color(&drawn, at.as_vec2() + Vec2::splat(0.5));
        assert!(at.x > leaf.corner.x && at.y > leaf.corner.y, "an edge is drawn darker");
        let found = PartImages::of(&parts, "position")[0].texel(at.x, at.y).truncate();
        assert!((found - wanted).abs().max_element() < 1e-6, "{found} {wanted}");
        let place = drawn.place(at.as_vec2() + Vec2::splat(0.5));
        let usage = &PartImages::of(&parts, "usage")[source.plane as usize];
        assert!(usage.texel(place.x as u32, place.y as u32).x >= DARKEST, "the cell is read");
    }

    #[test]
    fn what_an_image_repeats_is_lent_once() {
        let tile = texfold_testkit::image("salient");
        // From its middle: its corner is so plain that the whole takes no more bits than a tile.
        let texel = |at: u32| tile.texel(96 + at % 256 % 64, 96 + at / 256 % 64);
        let texels: Vec<Texel> = (0..256 * 256).map(texel).collect();
        let set = ImageSet::single(Raster::from_texels(256, 256, tile.info(), &texels).unwrap());
        let goal = Goal::Psnr(30.0);
        let params = EpitomeParams { goal, effort: Effort::Fast, ..EpitomeParams::default() };
        let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
        let drawn = decode_image(&texture, 0, 0).unwrap();
        let parts = part_images(&texture).unwrap();
        let charts = &PartImages::of(&parts, "charts")[0];
        let is_lent = |at: u32| {
            let (found, whole) = (charts.texel(at % 256, at / 256), drawn.texel(at % 256, at / 256));
            (found - whole).truncate().abs().max_element() < 1e-6 && whole.truncate().max_element() > 0.0
        };
        let lent = (0..256 * 256u32).filter(|&at| is_lent(at)).count();
        // About a tile of sixteen; leaves may begin anywhere in it.
        assert!((64 * 64 / 4..3 * 64 * 64).contains(&lent), "{lent}");
    }

    #[test]
    fn directions_have_hues() {
        let near = |direction: Vec2, color: [f32; 3]| {
            assert!((hue(direction) - Vec3::from(color)).abs().max_element() < 1e-5, "{direction}");
        };
        near(Vec2::X, [1.0, 0.0, 0.0]);
        near(Vec2::from_angle(TAU / 3.0), [0.0, 1.0, 0.0]);
        near(Vec2::from_angle(-TAU / 3.0), [0.0, 0.0, 1.0]);
        near(-Vec2::X, [0.0, 1.0, 1.0]);
    }

    #[test]
    fn usage_is_black_where_nothing_is_read() {
        let drawn = draw_usage([8, 4], &[0, 64]).unwrap();
        assert_eq!((drawn.texel(3, 3).x, drawn.texel(4, 0).x), (0.0, 1.0));
        let drawn = draw_usage([8, 4], &[1, 64]).unwrap();
        assert_eq!(drawn.texel(0, 0).x, DARKEST);
    }
}

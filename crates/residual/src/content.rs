//! Images held as a reduced base and a residual plane: what a codec embeds, stores, decodes and hands to a GPU.
//!
//! Memory: a loaded content holds the bytes of its GPU form and nothing else. The base's texels, which only the CPU
//! decoder reads, are decoded when they are first asked for.

use std::borrow::Cow;
use std::sync::Arc;

use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::PixelInfo;
use texfold_core::{
    BASE_PART, Cached, ImageLayout, ImageSize, Plane, PlaneFormat, RESIDUAL_PART, Rect, Texel, word_plane,
};

use crate::decode::fast::{add_residual, fill_base};
use crate::decode::{ResidualView, TEXFOLD_RESIDUAL_GROUP_WORDS, TexfoldResidualParams};
use crate::plane::{
    BLOCK_SIDE, GROUP_BLOCKS, PlaneWords, ResidualPlane, blocks_of, level_blocks, stored_layout,
};
use crate::rates::{RateModel, Rates};

/// Most that the base's width and height are reduced by, as a binary logarithm.
pub const MAX_REDUCE_LOG2: u32 = 3;
/// Most levels that are not stored but upsampled from the finest stored one.
pub const MAX_SHRINK_LOG2: u32 = 2;
/// Most that the contrast of alpha is raised by, as a binary logarithm.
#[cfg(feature = "encode")]
pub(crate) const MAX_ALPHA_GAIN_LOG2: u32 = 3;
/// Texels of level 0 of a padded base beyond the borders of its image: a 4x4 block of it, so that the same blocks cover
/// the same place in an image and in the one beside it.
pub const PADDING: u32 = 4;
/// Texels around an image that its padded base may hold, at any downscale: what an encoder must know of a tile's
/// surroundings.
pub const APRON: u32 = PADDING << (MAX_REDUCE_LOG2 + MAX_SHRINK_LOG2);

/// How the base of some content is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BaseForm {
    /// Format of its planes.
    pub content: Content,
    /// Log2 downscale of its width and height, 1 to 3.
    pub reduce_log2: u32,
    /// Number of finest mip levels not stored, 0 to 2; they are upsampled from the finest stored one.
    pub shrink_log2: u32,
    /// Whether it is block-isolated: no filtering across blocks of 8x8 texels, so that these may lie beside any others.
    pub isolated: bool,
    /// Whether it has [`PADDING`] texels beyond each border, so that neighbouring images decode to the same there.
    pub padded: bool,
    /// Log2 factor, 0 to 3, of alpha's contrast around one half, behind the filter: a small base then holds sharp outlines.
    pub alpha_gain_log2: u32,
}

impl BaseForm {
    /// A base that is neither isolated nor padded, of images whose levels are all stored.
    #[must_use]
    pub fn new(content: Content, reduce_log2: u32) -> Self {
        BaseForm { content, reduce_log2, shrink_log2: 0, isolated: false, padded: false, alpha_gain_log2: 0 }
    }

    /// Base texels of level 0 beyond each border.
    #[must_use]
    pub fn padding(&self) -> u32 {
        if self.padded { PADDING } else { 0 }
    }

    /// Factor of alpha's contrast.
    #[must_use]
    pub fn alpha_gain(&self) -> f32 {
        (1u32 << self.alpha_gain_log2) as f32
    }

    /// Levels of the base of an image with `levels` stored ones: down to 1x1, which any further level reads.
    #[must_use]
    pub fn levels(&self, size: ImageSize, levels: u32) -> u32 {
        levels.min(size.at_level(self.reduce_log2).full_levels())
    }

    /// Columns and rows of level 0 of the base of an image of that size.
    #[must_use]
    pub fn base_size(&self, size: ImageSize) -> ImageSize {
        let more = (2 * self.padding()) << self.reduce_log2;
        let padded = ImageSize { width: size.width + more, height: size.height + more };
        padded.at_level(self.reduce_log2)
    }

    /// Bits of base a texel of the image.
    #[must_use]
    pub fn bits_per_texel(&self, pixel: PixelInfo) -> f64 {
        self.content.bits_per_texel(pixel) / f64::from(1u32 << (2 * self.reduce_log2))
    }
}

/// The base of one image with its mip levels.
#[derive(Debug, PartialEq)]
pub(crate) struct BaseImage {
    pub(crate) size: ImageSize,
    pub(crate) levels: u32,
    /// Bytes of each plane, level after level, as a GPU takes them.
    pub(crate) planes: Vec<(PlaneFormat, Vec<u8>)>,
    /// The texels of each level, row by row, once they have been asked for.
    texels: Cached<Vec<Vec<Texel>>>,
}

impl BaseImage {
    pub(crate) fn new(size: ImageSize, levels: u32, planes: Vec<(PlaneFormat, Vec<u8>)>) -> Self {
        BaseImage { size, levels, planes, texels: Cached::default() }
    }

    /// The bytes of one plane at one level.
    pub(crate) fn level_bytes(&self, plane: usize, level: u32) -> &[u8] {
        let (format, bytes) = &self.planes[plane];
        let length = |level: u32| {
            let size = self.size.at_level(level);
            format.bytes(size.width, size.height) as usize
        };
        let start: usize = (0..level).map(length).sum();
        &bytes[start..start + length(level)]
    }

    fn decoded(&self, content: Content, pixel: PixelInfo) -> Vec<Vec<Texel>> {
        let decode = |level: u32| {
            let ImageSize { width, height } = self.size.at_level(level);
            let planes =
                (0..self.planes.len()).map(|plane| self.level_bytes(plane, level).to_vec()).collect();
            let planes = ContentPlanes::from_planes(content, pixel, (width, height), planes);
            planes.map_or(vec![Texel::ZERO; width as usize * height as usize], |planes| planes.decode())
        };
        (0..self.levels).map(decode).collect()
    }
}

/// The bases of all images.
#[derive(Debug, PartialEq)]
pub(crate) struct Bases {
    pub(crate) form: BaseForm,
    pixel: PixelInfo,
    pub(crate) images: Vec<BaseImage>,
}

impl Bases {
    pub(crate) fn new(form: BaseForm, pixel: PixelInfo, images: Vec<BaseImage>) -> Self {
        Bases { form, pixel, images }
    }

    fn texels(&self, index: usize) -> &[Vec<Texel>] {
        let image = &self.images[index];
        image.texels.get_or_make(|| image.decoded(self.form.content, self.pixel))
    }
}

/// Images as a base and a residual plane. A clone shares its bases.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualContent {
    layout: ImageLayout,
    bases: Arc<Bases>,
    model: RateModel,
    /// The residual plane of each image; none where the content has none or it has not been loaded.
    planes: Vec<PlaneWords>,
    params: Vec<TexfoldResidualParams>,
    /// What GPUs bind for a residual plane where there is none.
    empty: PlaneWords,
}

impl ResidualContent {
    /// Bases alone. `layout` is that of the stored levels.
    pub(crate) fn of_bases(layout: ImageLayout, bases: Arc<Bases>) -> Self {
        let (model, planes, empty) = (RateModel::default(), Vec::new(), PlaneWords::empty());
        let mut content = ResidualContent { layout, bases, model, planes, params: Vec::new(), empty };
        content.params = content.all_params();
        content
    }

    /// The same bases with residual planes of that model, one for each image; `None` where one is too large for a plane.
    #[must_use]
    pub fn with_planes(&self, model: RateModel, planes: &[ResidualPlane]) -> Option<Self> {
        let words = planes.iter().map(|plane| plane.words(model.class_bits)).collect::<Option<Vec<_>>>()?;
        Some(self.with_words(model, words))
    }

    pub(crate) fn with_words(&self, model: RateModel, planes: Vec<PlaneWords>) -> Self {
        let mut content = ResidualContent { model, planes, ..self.clone() };
        content.params = content.all_params();
        content
    }

    /// The same as it is before its residual planes are loaded: the base alone.
    #[must_use]
    pub fn base_alone(&self) -> Self {
        self.with_words(self.model.clone(), Vec::new())
    }

    /// The same bases without any residual plane.
    #[must_use]
    pub fn without_planes(&self) -> Self {
        self.with_words(RateModel::default(), Vec::new())
    }

    /// The levels that are stored.
    #[must_use]
    pub fn layout(&self) -> &ImageLayout {
        &self.layout
    }

    /// How the base is stored.
    #[must_use]
    pub fn form(&self) -> BaseForm {
        self.bases.form
    }

    /// Columns and rows of the first image's level 0.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        self.layout.images.first().copied().unwrap_or(ImageSize { width: 1, height: 1 })
    }

    /// What all blocks share.
    #[must_use]
    pub fn model(&self) -> &RateModel {
        &self.model
    }

    /// Whether there is a residual plane, loaded or not.
    #[must_use]
    pub fn has_planes(&self) -> bool {
        self.model.class_bits > 0
    }

    /// Whether all that there is has been loaded.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        !self.planes.is_empty() || !self.has_planes()
    }

    /// Rate class of each block of an image, level after level, each row by row; nothing where no residual plane is
    /// loaded.
    #[must_use]
    pub fn classes(&self, image: u32) -> Vec<u8> {
        self.planes.get(image as usize).map_or(Vec::new(), |plane| plane.classes().collect())
    }

    /// One image as the shader sees it; the last where there is no such image.
    #[must_use]
    #[inline]
    pub fn view(&self, image: u32) -> ResidualView<'_> {
        let image = (image as usize).min(self.params.len().saturating_sub(1));
        ResidualView {
            params: &self.params[image],
            plane: &self.plane(image).words,
            base: self.bases.texels(image),
        }
    }

    /// The texels of `region`, which lies inside of a stored level, equal to
    /// [`crate::decode::texfold_residual_load`] texel by texel.
    pub fn decode(&self, region: Rect, out: &mut [Texel]) {
        self.decode_base(region, out);
        self.add_residual(region, out);
    }

    /// The base's part of such a region.
    pub fn decode_base(&self, region: Rect, out: &mut [Texel]) {
        fill_base(&self.view(region.image), region, out);
    }

    /// Adds the residuals of such a region and clamps; nothing where no residual plane is loaded.
    pub fn add_residual(&self, region: Rect, out: &mut [Texel]) {
        add_residual(&self.view(region.image), region, out);
    }

    /// Bits in memory of the bases and their parameters.
    #[must_use]
    pub fn base_bits(&self) -> u64 {
        let bytes = |image: &BaseImage| image.planes.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
        8 * (self.bases.images.iter().map(bytes).sum::<u64>() + size_of_val(self.params.as_slice()) as u64)
    }

    /// Bits in memory of the residual planes, with the word that stands for one where there is none.
    #[must_use]
    pub fn plane_bits(&self) -> u64 {
        (0..self.params.len()).map(|image| 32 * self.plane(image).words.len() as u64).sum()
    }

    /// Bits in memory of all levels but the first: of the base, and of the residual plane.
    #[must_use]
    pub fn mip_bits(&self) -> (u64, u64) {
        let further = |image: &BaseImage| {
            let first = (0..image.planes.len()).map(|plane| image.level_bytes(plane, 0).len()).sum::<usize>();
            image.planes.iter().map(|(_, bytes)| bytes.len()).sum::<usize>() - first
        };
        let base: usize = self.bases.images.iter().map(further).sum();
        let header = u64::from(TEXFOLD_RESIDUAL_GROUP_WORDS) * 32 / GROUP_BLOCKS as u64;
        let mut bits = 0;
        for (size, plane) in self.layout.images.iter().zip(&self.planes) {
            let further = plane.classes().skip(level_blocks(*size, 1) as usize);
            bits += further
                .map(|class| u64::from(class) * u64::from(self.model.class_bits) + header)
                .sum::<u64>();
        }
        (8 * base as u64, bits)
    }

    /// Adds the planes of one image to those of a [`texfold_core::GpuForm`]; returns the indices that the shader's
    /// three textures bind: residual plane, base a, base b.
    pub fn push_planes<'a>(&'a self, index: usize, planes: &mut Vec<Plane<'a>>) -> [usize; 3] {
        let first = planes.len();
        let words = self.plane(index);
        planes.push(word_plane(RESIDUAL_PART, &words.words, words.row_log2));
        let image = &self.bases.images[index];
        planes.extend(image.planes.iter().map(|(format, bytes)| Plane {
            part: BASE_PART,
            format: *format,
            width: image.size.width,
            height: image.size.height,
            levels: image.levels,
            data: Cow::Borrowed(bytes),
        }));
        // Where the base has one plane it is bound twice.
        [first, first + 1, planes.len() - 1]
    }

    /// The uniform block of one image.
    #[must_use]
    pub fn uniforms(&self, image: usize) -> &[u8] {
        bytemuck::bytes_of(&self.params[image])
    }

    pub(crate) fn bases(&self) -> &Bases {
        &self.bases
    }

    pub(crate) fn planes(&self) -> &[PlaneWords] {
        &self.planes
    }

    fn plane(&self, image: usize) -> &PlaneWords {
        self.planes.get(image).unwrap_or(&self.empty)
    }

    fn all_params(&self) -> Vec<TexfoldResidualParams> {
        (0..self.layout.images.len()).map(|image| self.params_of(image)).collect()
    }

    fn params_of(&self, image: usize) -> TexfoldResidualParams {
        let (size, base, form) = (self.layout.images[image], &self.bases.images[image], self.form());
        let plane = self.plane(image);
        let mut level_start = [0; 16];
        let mut start = 0;
        for (level, first) in (0..self.layout.levels).zip(&mut level_start) {
            *first = start;
            let (columns, rows) = blocks_of(size.at_level(level));
            start += columns * rows;
        }
        TexfoldResidualParams {
            size: [size.width, size.height],
            base_size: [base.size.width, base.size.height],
            swizzle: form.content.formats(self.layout.pixel).1.0,
            class_bits: if self.planes.is_empty() { 0 } else { self.model.class_bits },
            row_log2: plane.row_log2,
            first_bit: plane.first_bit,
            base_levels: base.levels,
            base_block: if form.isolated { BLOCK_SIDE >> form.reduce_log2 } else { 0 },
            base_padding: form.padding(),
            axes: self.model.axes.packed(),
            level_start,
            classes: self.model.classes.map(Rates::packed),
            weights: self.model.scales(),
            alpha_gain: form.alpha_gain(),
        }
    }
}

/// The stored levels of `full`, as `form` says.
pub(crate) fn stored_by(full: &ImageLayout, form: &BaseForm) -> ImageLayout {
    stored_layout(full, form.shrink_log2)
}

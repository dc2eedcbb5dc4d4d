//! The codec: images that are decoded before they are drawn.

use crate::DctContent;
use texfold_bc::Content;
use texfold_bc::decode::TexfoldBcParams;
use texfold_core::address::TEXFOLD_CLAMP;
use texfold_core::container::{ContentId, SectionWriter, Sections, read_layout, read_maps, write_layout};
use texfold_core::image::{Depth, PixelInfo};
use texfold_core::{
    BASE_PART, Budget, CodecId, DecodedImage, Encoded, Footprint, GpuForm, Image2d, ImageAddress,
    ImageBinding, ImageLayout, ImageSize, Layers, LoadError, MemoryBits, Notes, RESIDUAL_PART, Rect, Refine,
    RegionError, Texel, TextureCodec,
};

/// The only content of a file.
const CONTENT: ContentId = ContentId::ONLY;

/// Channels of the textures that blocks decode to for drawing.
const DRAWN: PixelInfo = PixelInfo {
    channels: 4,
    depth: Depth::Eight,
    color: texfold_core::image::ColorSpace::Srgb,
    alpha: texfold_core::image::Alpha::Straight,
};

/// Images in DCT superblocks.
#[derive(Debug, Clone, Copy)]
pub enum Dct {}

impl TextureCodec for Dct {
    const ID: CodecId = CodecId { number: 7, name: "dct" };
    type Domain = Image2d;
    type Encoded = DctImages;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<DctImages, LoadError> {
        let notes = Notes::read(file, budget)?;
        let layout = read_layout(file, budget)?;
        let maps = read_maps(&layout, file, budget)?;
        let layout = ImageLayout { maps, ..layout };
        let content = DctContent::load(&layout, CONTENT, file, budget)?;
        Ok(DctImages { content, notes })
    }
}

/// Images in DCT superblocks, which are decoded before they are drawn. The second of two layers refines a soft image.
#[derive(Debug, Clone, PartialEq)]
pub struct DctImages {
    content: DctContent,
    notes: Notes,
}

impl DctImages {
    /// Such content, without notes.
    #[must_use]
    pub fn new(content: DctContent) -> Self {
        DctImages { content, notes: Notes::default() }
    }

    /// The images.
    #[must_use]
    pub fn content(&self) -> &DctContent {
        &self.content
    }

    /// The images.
    #[cfg(feature = "encode")]
    pub(crate) fn into_content(self) -> DctContent {
        self.content
    }

    /// The texture as it is with the first `count` layers of its file, at least one.
    #[must_use]
    pub fn first_layers(&self, count: u32) -> Self {
        if count > 1 {
            return self.clone();
        }
        DctImages { content: self.content.base_alone(), notes: self.notes.clone() }
    }

    /// The notes, for a caller that has more to say.
    #[must_use]
    pub fn notes_mut(&mut self) -> &mut Notes {
        &mut self.notes
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(self, notes: Notes) -> Self {
        DctImages { notes, ..self }
    }
}

impl Encoded for DctImages {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Dct::ID
    }

    fn layout(&self) -> &ImageLayout {
        self.content.layout()
    }

    fn layers(&self) -> Layers {
        self.content.layers()
    }

    fn texel(&self, at: ImageAddress) -> Texel {
        self.content.texel(at)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.content.decode(region, out)
    }

    fn decode_rgba8(&self, region: Rect, out: &mut [[u8; 4]]) -> Result<(), RegionError> {
        self.content.decode_rgba8(region, out)
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(self.layout(), out);
        self.content.store(CONTENT, out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    /// Textures in blocks; what they decode to is drawn by the module "bc", as plain texels.
    fn gpu(&self) -> GpuForm<'_> {
        let mut form = GpuForm::new("bc");
        form.blocks = self.content.gpu().collect();
        let layout = self.layout();
        for (image, size) in layout.images.iter().enumerate() {
            let params = TexfoldBcParams {
                size: [size.width, size.height],
                plane_size: [size.width, size.height],
                levels: layout.levels,
                address_mode: TEXFOLD_CLAMP,
                swizzle: Content::Raw.formats(DRAWN).1.0,
                reduced: 0,
            };
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(&params));
            let uniforms = start..form.uniforms.len();
            form.images.push(ImageBinding { planes: vec![image; 2], uniforms, image: 0 });
        }
        form
    }

    fn memory(&self) -> MemoryBits {
        let blocks = 8 * self.content.held_bytes();
        let params = 8 * (self.layout().images.len() * size_of::<TexfoldBcParams>()) as u64;
        let layout = self.layout();
        let decoded = |(image, &size): (u32, &ImageSize)| {
            let depth = if layout.pixel_of(image).depth == Depth::Eight { 8 } else { 16 };
            DecodedImage { size, levels: layout.levels, depth, is_stacked: false }.bits()
        };
        let resident = params + (0..).zip(&layout.images).map(decoded).sum::<u64>();
        MemoryBits { compressed: blocks + params, resident, goal: blocks }
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

impl Refine for DctImages {
    fn refine(&mut self, file: &Sections<'_>, budget: &mut Budget) -> Result<Vec<&'static str>, LoadError> {
        let Some(content) = self.content.with_rest(CONTENT, file, budget)? else {
            return Ok(Vec::new());
        };
        self.content = content;
        Ok(vec![BASE_PART, RESIDUAL_PART])
    }
}

//! Either form of a texture, and which of them a file has.

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::{
    Access, Budget, CodecId, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageLayout, Layers,
    LoadError, MemoryBits, Notes, Rect, Refine, RegionError, Texel,
};

use crate::{Codebook, DctImages, TexelTexture};

/// Images that arrive over time.
#[derive(Debug, Clone, PartialEq)]
pub enum ProgressiveTexture {
    /// In blocks of variable length, which are decoded before they are drawn.
    Block(DctImages),
    /// As residual content with details, read texel by texel.
    Texel(Box<TexelTexture>),
}

impl ProgressiveTexture {
    /// Loads either form; one that is read by texel may use a public codebook.
    pub(crate) fn load(
        file: &Sections<'_>,
        public: Option<&Codebook>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        if DctImages::is_in(file) {
            return DctImages::load(file, budget).map(ProgressiveTexture::Block);
        }
        TexelTexture::load(file, public, budget).map(ProgressiveTexture::from)
    }

    /// How its texels are reached.
    #[must_use]
    pub fn access(&self) -> Access {
        match self {
            ProgressiveTexture::Block(_) => Access::Block,
            ProgressiveTexture::Texel(_) => Access::Texel,
        }
    }

    /// The images in blocks, where they are stored so.
    #[must_use]
    pub fn block(&self) -> Option<&DctImages> {
        match self {
            ProgressiveTexture::Block(images) => Some(images),
            ProgressiveTexture::Texel(_) => None,
        }
    }

    /// The form that is read texel by texel, where the images are stored so.
    #[must_use]
    pub fn texel(&self) -> Option<&TexelTexture> {
        match self {
            ProgressiveTexture::Block(_) => None,
            ProgressiveTexture::Texel(texture) => Some(texture),
        }
    }

    /// The texture as it is with the first `count` layers of its file, at least one.
    #[must_use]
    pub fn first_layers(&self, count: u32) -> ProgressiveTexture {
        match self {
            ProgressiveTexture::Block(images) => ProgressiveTexture::Block(images.first_layers(count)),
            ProgressiveTexture::Texel(texture) => texture.first_layers(count).into(),
        }
    }

    /// The notes, for a caller that has more to say.
    #[must_use]
    pub fn notes_mut(&mut self) -> &mut Notes {
        match self {
            ProgressiveTexture::Block(images) => images.notes_mut(),
            ProgressiveTexture::Texel(texture) => texture.notes_mut(),
        }
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(self, notes: Notes) -> Self {
        match self {
            ProgressiveTexture::Block(images) => ProgressiveTexture::Block(images.with_notes(notes)),
            ProgressiveTexture::Texel(texture) => (*texture).with_notes(notes).into(),
        }
    }

    fn form(&self) -> &dyn Encoded<Domain = Image2d> {
        match self {
            ProgressiveTexture::Block(images) => images,
            ProgressiveTexture::Texel(texture) => texture.as_ref(),
        }
    }
}

impl From<TexelTexture> for ProgressiveTexture {
    fn from(texture: TexelTexture) -> Self {
        ProgressiveTexture::Texel(Box::new(texture))
    }
}

impl Encoded for ProgressiveTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        self.form().codec()
    }

    fn layout(&self) -> &ImageLayout {
        self.form().layout()
    }

    fn layers(&self) -> Layers {
        self.form().layers()
    }

    fn sample(&self, at: ImageAddress) -> Texel {
        self.form().sample(at)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.form().decode(region, out)
    }

    fn store(&self, out: &mut SectionWriter) {
        self.form().store(out);
    }

    fn footprint(&self) -> Footprint {
        self.form().footprint()
    }

    fn gpu(&self) -> GpuForm<'_> {
        self.form().gpu()
    }

    fn memory(&self) -> MemoryBits {
        self.form().memory()
    }

    fn notes(&self) -> &Notes {
        self.form().notes()
    }
}

impl Refine for ProgressiveTexture {
    fn refine(&mut self, file: &Sections<'_>, budget: &mut Budget) -> Result<Vec<&'static str>, LoadError> {
        match self {
            ProgressiveTexture::Block(images) => images.refine(file, budget),
            ProgressiveTexture::Texel(texture) => texture.refine(file, budget),
        }
    }
}

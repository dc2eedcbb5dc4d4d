//! The shipped form: one codebook, and an index plane for each size of image.

use std::borrow::Cow;

use glam::{IVec2, UVec2};
use texfold_core::address::texfold_level_size;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::{
    Budget, Cached, CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageBinding,
    ImageLayout, LoadError, MAX_PLANE_SIDE, Notes, Plane, PlaneFormat, Rect, RegionError, Texel,
    TextureCodec,
};

use crate::classes::Place;
use crate::decode::{VqView, texfold_vq_fetch};
use crate::grid::CodebookPart;
use crate::parts::Parts;
use crate::{Vq, wire};

/// Images stored as indices into a codebook.
#[derive(Debug, Clone, PartialEq)]
pub struct VqTexture {
    pub(crate) parts: Parts,
    /// The codebook's texels: what the CPU reads, and a GPU does not need.
    pub(crate) texels: Cached<Vec<Texel>>,
    pub(crate) notes: Notes,
}

impl VqTexture {
    pub(crate) fn new(parts: Parts, notes: Notes) -> Self {
        VqTexture { parts, texels: Cached::default(), notes }
    }

    pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        let notes = Notes::read(file, budget)?;
        Ok(VqTexture::new(wire::load(file, budget)?, notes))
    }

    /// Columns and rows of the codebook in texels.
    #[must_use]
    pub fn codebook_size(&self) -> (u32, u32) {
        self.parts.codebook.size()
    }

    /// How the codebook is stored.
    #[must_use]
    pub fn content(&self) -> texfold_bc::Content {
        self.parts.codebook.content()
    }

    /// The codebook's texels, row by row; decoded when first asked for.
    #[must_use]
    #[inline]
    pub fn codebook_texels(&self) -> &[Texel] {
        self.texels.get_or_make(|| self.parts.codebook.decode())
    }

    /// The image samples in the codebook.
    #[must_use]
    pub fn samples(&self) -> &[CodebookPart] {
        &self.parts.samples
    }

    /// The notes, for a caller that has more to say.
    #[must_use]
    pub fn notes_mut(&mut self) -> &mut Notes {
        &mut self.notes
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// The size class of an image as the shader sees it, and the `image` argument of its functions for the image;
    /// the last image where there is no such one.
    #[must_use]
    #[inline]
    pub fn view(&self, image: u32) -> (VqView<'_>, u32) {
        let place = self.parts.places[(image as usize).min(self.parts.places.len() - 1)];
        let class = &self.parts.classes[place.class];
        let view = VqView {
            params: class.params,
            index: &class.index,
            index_width: class.index_width,
            codebook: self.codebook_texels(),
            codebook_width: self.parts.codebook.size().0,
        };
        (view, class.argument(place.number))
    }
}

impl Encoded for VqTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Vq::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.parts.layout
    }

    fn texel(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let (view, image) = self.view(at.image);
        let level = at.level.min(self.parts.layout.levels - 1);
        texfold_vq_fetch(&view, image, IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.parts.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let (view, image) = self.view(region.image);
        let mut lines = out.chunks_exact_mut((region.width as usize).max(1));
        for y in region.y..region.y + region.height {
            let Some(line) = lines.next() else { break };
            decode_line(&view, image, region, y, line);
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.parts.layout, out);
        wire::store(&self.parts, out);
    }

    /// As measured, with the codebook told apart into samples and codewords by their texels.
    fn footprint(&self) -> Footprint {
        let mut footprint = Footprint::measure(self, &self.gpu());
        let Some(at) = footprint.parts.iter().position(|part| part.name == "codebook") else {
            return footprint;
        };
        let codebook = footprint.parts.remove(at);
        let (width, height) = self.parts.codebook.size();
        let sampled: u64 = self.parts.samples.iter().map(|part| u64::from(part.side * part.side)).sum();
        let share = |bits: u64| bits * sampled / u64::from(width * height);
        let (memory, disk) = (share(codebook.bits_memory), share(codebook.bits_disk));
        if sampled > 0 {
            let samples = footprint.part("samples");
            (samples.bits_memory, samples.bits_disk) = (memory, disk);
        }
        let codewords = footprint.part("codewords");
        (codewords.bits_memory, codewords.bits_disk) =
            (codebook.bits_memory - memory, codebook.bits_disk - disk);
        footprint.with_notes(&self.notes)
    }

    fn gpu(&self) -> GpuForm<'_> {
        let codebook: Vec<Plane<'_>> = self.parts.codebook.gpu_planes("codebook").collect();
        let last = codebook.len() - 1;
        let mut form = GpuForm { planes: codebook, ..GpuForm::new("vq") };
        let mut bindings = Vec::new();
        for class in &self.parts.classes {
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(&class.params));
            bindings.push((vec![form.planes.len(), 0, last], start..form.uniforms.len()));
            form.planes.push(Plane {
                part: "index",
                format: PlaneFormat::Rg8Uint,
                width: class.index_width,
                height: class.index_height(),
                levels: 1,
                data: Cow::Borrowed(class.index.as_flattened()),
            });
        }
        let binding = |place: &Place| {
            let (planes, uniforms) = bindings[place.class].clone();
            ImageBinding { planes, uniforms, image: self.parts.classes[place.class].argument(place.number) }
        };
        form.images = self.parts.places.iter().map(binding).collect();
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

/// One row of a region: four texels at a time from the codebook, as [`texfold_vq_fetch`] finds them one by one.
fn decode_line(view: &VqView<'_>, number: u32, region: Rect, y: u32, line: &mut [Texel]) {
    let width = view.params.size[0].div_ceil(4);
    let level_width = texfold_level_size(UVec2::from(view.params.size), region.level).x.div_ceil(4);
    let first = view.params.level_start[region.level as usize] + y / 4 * level_width;
    let origin = number % MAX_PLANE_SIDE * view.index_width + number / MAX_PLANE_SIDE;
    let mut left = region.x;
    let mut rest = line;
    while !rest.is_empty() {
        // Blocks up to the end of the line, or to where the index plane goes on in its next row.
        let (x, row) = ((first + left / 4) % width, (first + left / 4) / width);
        let count = (width - x).min((left % 4 + rest.len() as u32).div_ceil(4)) as usize;
        let start = (origin + row * view.index_width + x) as usize;
        for &[x, y_of_cell] in &view.index[start..start + count] {
            let from = (u32::from(y_of_cell) + y % 4) * view.codebook_width + u32::from(x) + left % 4;
            let cell = &view.codebook[from as usize..];
            let run = ((4 - left % 4) as usize).min(rest.len());
            let (head, tail) = rest.split_at_mut(run);
            // A whole row of a block is copied without asking for its length.
            match (head.first_chunk_mut::<4>(), cell.first_chunk::<4>()) {
                (Some(head), Some(cell)) => *head = *cell,
                _ => head.copy_from_slice(&cell[..run]),
            }
            rest = tail;
            left += run as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::container::Sections;
    use texfold_core::image::ImageSet;
    use texfold_core::{Budget, Encoder, Goal, Job};

    use crate::classes::SizeClass;
    use crate::{VqParams, VqSource};

    /// Bytes of everything in a texture whose size depends on the images.
    fn held_bytes(texture: &VqTexture) -> usize {
        let codebook: usize = texture.parts.codebook.planes().iter().map(|(_, bytes)| bytes.len()).sum();
        let index: usize = texture.parts.classes.iter().map(|class| 2 * class.index.len()).sum();
        let images = texture.parts.places.len() * (size_of::<Place>() + size_of::<texfold_core::ImageSize>());
        let classes = texture.parts.classes.len() * size_of::<SizeClass>();
        let table = if texture.texels.is_made() { size_of_val(texture.codebook_texels()) } else { 0 };
        codebook + index + images + classes + table + size_of_val(texture.samples())
    }

    #[test]
    fn a_texture_that_is_only_uploaded_holds_little_more_than_the_gpu() {
        let set = ImageSet::single(texfold_testkit::image("facade"));
        for goal in [Goal::Bpp(2.0), Goal::Bpp(6.0)] {
            let params = VqParams { goal, ..VqParams::default() };
            let encoded = Vq::encode(VqSource::new(&set), &params, &mut Job::default()).unwrap();
            let mut writer = SectionWriter::new(Vq::ID);
            encoded.store(&mut writer);
            let (file, mut budget) = (writer.finish().bytes, Budget::default());
            let texture = Vq::load(&Sections::parse(&file, &mut budget).unwrap(), &mut budget).unwrap();
            let gpu = texture.gpu();
            assert!(gpu.planes.iter().all(|plane| matches!(plane.data, Cow::Borrowed(_))));
            let (held, uploaded) = (held_bytes(&texture) as f64, gpu.memory().compressed as f64 / 8.0);
            assert!(held <= 1.3 * uploaded, "{goal:?}: {held} {uploaded}");
            let first = ImageAddress { image: 0, level: 0, x: 0, y: 0 };
            assert_eq!(texture.texel(first), encoded.texel(first));
            assert!(texture.texels.is_made() && texture == encoded);
        }
    }
}

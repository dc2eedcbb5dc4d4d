//! Uploading again only what changed: a file that arrives in pieces.

use texfold_core::{Access, GpuForm};

use crate::texture::GpuPlane;
use crate::upload::{Shape, blocks, describe, module_of, params_of, switches_of};
use crate::{Gpu, GpuError, GpuTexture};

/// What [`Gpu::update`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Updated {
    /// Bytes of texels and parameters that were written.
    pub bytes: u64,
    /// Whether [`GpuTexture::bind_group`] gives other bind groups than before: a plane has another size, or there are other planes.
    pub rebound: bool,
}

/// A plane to write again, into the texture that it has.
struct Rewrite {
    /// Its number in the form.
    plane: usize,
    /// The texture.
    target: GpuPlane,
}

impl Gpu {
    /// Takes the planes named in `changed` and all parameters from `form` into `texture`: `changed` is what
    /// [`texfold_core::Refine::refine`] returned. Planes that are new, or of another size than before, are uploaded whether they
    /// are named or not; the address mode stays as it was set.
    ///
    /// # Errors
    /// [`GpuError`] as [`Gpu::upload`]; the texture stays as it was, unless the device failed.
    pub fn update(
        &self,
        texture: &mut GpuTexture,
        form: &GpuForm<'_>,
        changed: &[&str],
    ) -> Result<Updated, GpuError> {
        if module_of(form)? != texture.module {
            return Err(GpuError::Form { what: "a texture has another module than before" });
        }
        if form.access() == Access::Block {
            return self.decode_again(texture, form);
        }
        for (image, binding) in form.images.iter().enumerate() {
            describe(texture.module, image, form, binding)?;
        }
        self.guarded(|| {
            let mut done = Updated::default();
            let (planes, rewrites) = self.new_planes(texture, form, changed, &mut done)?;
            let bound = if done.rebound || form.images != texture.bound.bindings {
                done.rebound = true;
                Some(self.bind_all(texture.module, form, &planes)?)
            } else {
                None
            };
            // Nothing of the form is refused from here on.
            for rewrite in rewrites {
                done.bytes += self.write_plane(&rewrite.target.texture, &form.planes[rewrite.plane])?;
            }
            texture.planes = planes;
            match bound {
                Some(bound) => texture.bound = bound,
                None => self.write_params(texture, form)?,
            }
            texture.write_address_mode();
            done.bytes += texture.bound.groups.iter().map(|group| group.params_bytes).sum::<u64>();
            Ok(done)
        })
    }

    /// Decodes all blocks of `form` anew.
    fn decode_again(&self, texture: &mut GpuTexture, form: &GpuForm<'_>) -> Result<Updated, GpuError> {
        let address_mode = texture.address_mode;
        *texture = GpuTexture { address_mode, ..self.upload(form)? };
        texture.write_address_mode();
        Ok(Updated { bytes: form.memory().compressed / 8, rebound: true })
    }

    /// The planes of `form`: those of `texture` where they have the same part and shape, new ones elsewhere; and those of the former
    /// that are still to be written.
    fn new_planes(
        &self,
        texture: &GpuTexture,
        form: &GpuForm<'_>,
        changed: &[&str],
        done: &mut Updated,
    ) -> Result<(Vec<GpuPlane>, Vec<Rewrite>), GpuError> {
        let (mut planes, mut rewrites) = (Vec::<GpuPlane>::new(), Vec::new());
        for (number, plane) in form.planes.iter().enumerate() {
            let shape = self.shape(plane)?;
            let before = planes.iter().filter(|other| other.part == plane.part).count();
            let known = texture.planes.iter().filter(|other| other.part == plane.part).nth(before);
            match known.filter(|known| Shape::of(&known.texture) == shape) {
                Some(known) => {
                    if plane.data.len() as u64 != known.bytes {
                        return Err(GpuError::Form { what: "a plane has another length than its size" });
                    }
                    if changed.contains(&plane.part) {
                        rewrites.push(Rewrite { plane: number, target: known.clone() });
                    }
                    planes.push(known.clone());
                }
                None => {
                    let made = self.upload_plane(plane)?;
                    done.rebound = true;
                    done.bytes += made.bytes;
                    planes.push(made);
                }
            }
        }
        Ok((planes, rewrites))
    }

    /// Writes the parameters of all images into the buffers that there are: `form` binds what `texture` does.
    fn write_params(&self, texture: &mut GpuTexture, form: &GpuForm<'_>) -> Result<(), GpuError> {
        texture.bound.switches = 0;
        for (number, binding) in form.images.iter().enumerate() {
            let group = texture.bound.images[number].group;
            let params = params_of(texture.module, form, binding)?;
            for (buffer, block) in
                texture.bound.groups[group].params.iter().zip(blocks(texture.module, params))
            {
                self.queue.write_buffer(buffer, 0, block);
            }
            texture.bound.images[number] = describe(texture.module, group, form, binding)?;
            texture.bound.switches |= switches_of(texture.module, params);
        }
        Ok(())
    }
}

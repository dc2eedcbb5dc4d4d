//! A file that arrives in pieces, drawn as far as it is there.

use texfold_core::container::Sections;
use texfold_core::{Budget, Limits, LoadError};

use crate::{AnyImage, Registration};

/// A `.txf` file of images that arrives in pieces, over a network or from a slow disk.
///
/// Layered files can be drawn from their first layer on, and take the others as they arrive; other files can be drawn
/// once they are whole.
///
/// ```
/// # use texfold::{Arriving, Arrived, Limits, LoadError};
/// # fn show(pieces: &[&[u8]]) -> Result<(), LoadError> {
/// let mut arriving = Arriving::new(Limits::default());
/// for piece in pieces {
///     match arriving.push(piece)? {
///         Arrived::Nothing => {}
///         Arrived::Texture => { /* upload arriving.texture() */ }
///         Arrived::Planes(names) => { /* upload these planes of it again */ }
///     }
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Arriving {
    bytes: Vec<u8>,
    limits: Limits,
    budget: Budget,
    texture: Option<AnyImage>,
    /// Whole sections at the last attempt.
    tried: usize,
}

/// What a piece of a file has brought.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Arrived {
    /// Nothing more can be drawn than before.
    Nothing,
    /// A texture where there was none, or another one in its place: upload all of it.
    Texture,
    /// The texture is finer: upload the planes of these names again.
    Planes(Vec<&'static str>),
}

impl Arriving {
    /// A file of which nothing is there yet.
    #[must_use]
    pub fn new(limits: Limits) -> Arriving {
        Arriving { bytes: Vec::new(), limits, budget: Budget::new(limits), texture: None, tried: 0 }
    }

    /// Takes the next piece of the file, of any length.
    ///
    /// # Errors
    /// [`LoadError`] names what is wrong with the file. That it is not whole is no error.
    pub fn push(&mut self, piece: &[u8]) -> Result<Arrived, LoadError> {
        self.budget.take(piece.len() as u64)?;
        self.bytes.extend_from_slice(piece);
        let file = match Sections::parse(&self.bytes, &mut self.budget) {
            Ok(file) => file,
            Err(LoadError::Truncated { .. }) => return Ok(Arrived::Nothing),
            Err(_) if self.bytes.is_empty() => return Ok(Arrived::Nothing),
            Err(error) => return Err(error),
        };
        let whole = file.ids().filter(|(_, whole)| *whole).count();
        if whole == self.tried {
            return Ok(Arrived::Nothing);
        }
        self.tried = whole;
        let found = file.codec();
        let codec = Registration::by_number(found).ok_or(LoadError::NotThisCodec { found })?;
        if let Some(texture) = self.texture.as_mut().filter(|_| codec.refines()) {
            return refine(codec, texture, &file, &mut self.budget);
        }
        // What an earlier attempt has booked is not held any more.
        let mut budget = Budget::new(self.limits);
        budget.take(self.bytes.len() as u64)?;
        match codec.load(&file, &mut budget) {
            Ok(texture) => {
                self.budget = budget;
                self.texture = Some(texture.into_image()?);
                Ok(Arrived::Texture)
            }
            Err(LoadError::Truncated { .. }) => Ok(Arrived::Nothing),
            Err(error) => Err(error),
        }
    }

    /// What can be drawn so far.
    #[must_use]
    pub fn texture(&self) -> Option<&AnyImage> {
        self.texture.as_ref()
    }

    /// What can be drawn when no more will come.
    #[must_use]
    pub fn into_texture(self) -> Option<AnyImage> {
        self.texture
    }
}

/// All layers that have arrived since; one piece may hold several.
fn refine(
    codec: &Registration,
    texture: &mut AnyImage,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Arrived, LoadError> {
    let mut changed: Vec<&'static str> = Vec::new();
    loop {
        let mut attempt = budget.clone();
        let planes = match codec.refine(texture, file, &mut attempt) {
            Ok(planes) if planes.is_empty() => break,
            Ok(planes) => planes,
            // A part of the next layer has not arrived.
            Err(LoadError::Truncated { .. }) => break,
            Err(error) => return Err(error),
        };
        *budget = attempt;
        for plane in planes {
            if !changed.contains(&plane) {
                changed.push(plane);
            }
        }
    }
    Ok(if changed.is_empty() { Arrived::Nothing } else { Arrived::Planes(changed) })
}

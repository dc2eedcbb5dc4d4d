//! What every light field says of itself: the kinds of its view maps and of its factors.

use crate::decode::{TEXFOLD_LIGHTFIELD_REFLECTED, TEXFOLD_LIGHTFIELD_VIEW, TEXFOLD_LIGHTFIELD_WORLD};

/// Most terms beside the mean: a bound of the shader's loop.
pub const MAX_TERMS: u32 = 8;

/// What view maps are laid over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Directions {
    /// The direction to the eye, orthographic, as in the paper.
    View,
    /// That direction reflected about the smooth normal: a highlight keeps its place in the map while it moves
    /// over the surface.
    #[default]
    Reflected,
    /// The reflected direction in space, on an octahedron: what is far away keeps its place in the maps of all vertices.
    World,
}

impl Directions {
    /// The shader's number, which is that of files as well.
    pub(crate) fn number(self) -> u32 {
        match self {
            Directions::View => TEXFOLD_LIGHTFIELD_VIEW,
            Directions::Reflected => TEXFOLD_LIGHTFIELD_REFLECTED,
            Directions::World => TEXFOLD_LIGHTFIELD_WORLD,
        }
    }

    /// The kind with a number; `None` where there is none.
    pub(crate) fn from_number(number: u32) -> Option<Directions> {
        [Directions::View, Directions::Reflected, Directions::World]
            .into_iter()
            .find(|directions| directions.number() == number)
    }
}

/// Which signs the factors have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Factors {
    /// Any: a term may add or take away.
    #[default]
    Signed,
    /// None below 0: terms only add to the mean, which is then what they have in common.
    NonNegative,
}

impl Factors {
    /// The number in files.
    pub(crate) fn number(self) -> u32 {
        match self {
            Factors::Signed => 0,
            Factors::NonNegative => 1,
        }
    }

    /// The kind with a number; `None` where there is none.
    pub(crate) fn from_number(number: u32) -> Option<Factors> {
        [Factors::Signed, Factors::NonNegative].into_iter().find(|factors| factors.number() == number)
    }
}

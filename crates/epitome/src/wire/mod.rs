//! Sections of an `epitome` file: "EPFM" (form of the map and the planes), "EPPL" (2x2 matrices and gain-offset
//! pairs), "EPTR" (how blocks are split), "EPEN" (entries, field by field, positions as what differs from the leaf
//! before), "EPAT" (planes of the epitomes), "EPMC" (coarse mip levels). A layered file has "EPLA" (number of layers)
//! and, instead of "EPTR", "EPEN" and "EPAT", for each layer "EPT0", "EPE0", "EPC0" (cells that it brings), "EPA0"
//! and so on. In blocks of variable length, instead of "EPAT" and "EPMC": sections of block contents.

mod blocks;
mod form;
mod layers;
mod map;
mod planes;
mod whole;

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::{Budget, LoadError};

use crate::parts::Parts;

pub(crate) use layers::next_layer;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    form::store_head(parts, out);
    match &parts.layering {
        None => whole::store_whole(parts, out),
        Some(layering) => layers::store_layers(parts, layering, out),
    }
}

/// Reads what [`store`] wrote, all checks of foreign bytes included.
pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Parts, LoadError> {
    let head = form::read_head(file, budget)?;
    if layers::is_layered(file) {
        layers::load_layers(file, head, budget)
    } else {
        whole::load_whole(file, head, budget)
    }
}

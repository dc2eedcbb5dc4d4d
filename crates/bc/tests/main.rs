//! Tests of plain blocks, as one program: what they share is compiled, linked and made once.

mod cancel;
mod formats;
mod goals;

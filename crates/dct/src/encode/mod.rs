//! The encoder: coefficients of all planes once, then numbers, tables and streams for a step, as often as the goal needs.

mod activity;
mod axes;
mod code;
mod cutout;
mod error;
mod fit;
mod forward;
mod goal;
mod hidden;
mod images;
mod intra;
mod masking;
mod quantise;
mod set;
mod source;
mod strength;
mod symbols;
#[cfg(test)]
mod training;

pub use code::Estimate;
pub use goal::{DctEncoder, DctSettings, STEPS, first_step, lambda_of, step_of};
pub use set::{DctSetEncoder, STAGE_FINER};
pub use source::DctSource;

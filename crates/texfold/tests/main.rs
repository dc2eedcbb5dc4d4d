//! Tests of the facade and what holds for every codec, as one program: what they share is compiled, linked and made once.

mod codecs;
mod golden;
mod hostile;
mod invariants;
mod ladder;
mod ledger;
mod readme;
mod regimes;
mod support;

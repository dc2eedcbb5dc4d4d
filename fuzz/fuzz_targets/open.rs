//! Any bytes as a file of any codec. Seeds: `fixtures/golden/*.txf`.

#![no_main]

#[path = "../../crates/texfold/tests/support/target.rs"]
#[allow(dead_code, reason = "each target uses its own part")]
mod target;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    target::open_any(data);
});

//! Files of a correct container whose content in blocks is forged as the bytes say.

#![no_main]

#[path = "../../crates/texfold/tests/support/target.rs"]
#[allow(dead_code, reason = "each target uses its own part")]
mod target;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = target::open_forged(data, target::Forged::Blocks);
});

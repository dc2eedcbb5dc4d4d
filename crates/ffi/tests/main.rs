//! The C interface: its header, and C programs that use it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod header;
mod programs;

//! The program as a user runs it: exit codes, files and reports.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

mod bank;
mod batch;
mod decompress;
mod inputs;
mod lightfield;
mod materials;
mod mesh;
mod results;
mod scenes;
mod shaders;
mod support;
mod textures;
mod zoom;

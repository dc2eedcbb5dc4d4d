//! `mutate`: breaks the code in known ways, one after the other, and expects a test to fail for each.
//!
//! Works in a copy of the tree below `target/`, so that an interrupted run leaves nothing behind: the next one copies again what
//! differs. The copy shares the target directory, so that each mutation compiles the packages above it and nothing else. A mutation
//! whose text is not found is an error: then it no longer says what it guards.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output};
use std::time::Instant;
use std::{env, fs};

use crate::root;

/// One way to break the code.
struct Mutation {
    /// What is broken.
    name: &'static str,
    file: &'static str,
    /// Text that stands in the file exactly once.
    find: &'static str,
    replace: &'static str,
    /// The test that must fail.
    test: Test,
}

/// One test function of a package's tests.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Test {
    package: &'static str,
    /// With the module that it stands in.
    function: &'static str,
    /// What the test prints when it fails for the right reason, and not because a shader does not compile.
    says: &'static str,
}

/// A test of `texfold-gpu` that compares a GPU's pixels with the CPU's.
const fn twin(function: &'static str) -> Test {
    Test { package: "texfold-gpu", function, says: "GPU [" }
}

/// A test of `texfold-gpu` that compares blocks decoded on a GPU with the CPU's.
const fn blocks(function: &'static str) -> Test {
    Test { package: "texfold-gpu", function, says: "texels differ" }
}

/// A test of the cache of tiles.
const fn tiles(function: &'static str, says: &'static str) -> Test {
    Test { package: "texfold-gpu", function, says }
}

const MUTATIONS: &[Mutation] = &[
    Mutation {
        name: "superblocks behind an edge are not the first ones again",
        file: "shaders/wgsl/block.wgsl",
        find: "    return at - select(vec2<u32>(0u), all, at >= all);",
        replace: "    return at - select(vec2<u32>(0u), vec2<u32>(0u), at >= all);",
        test: tiles("tiles::views_equal_filtering_of_decoded_texels_on_the_cpu", "pixel ["),
    },
    Mutation {
        name: "borders are filtered behind an edge",
        file: "shaders/wgsl/block.wgsl",
        find: " || any(texfold_block_place(slot) >= texfold_block_pass.plane_blocks) {",
        replace: " {",
        test: tiles("tiles::views_equal_filtering_of_decoded_texels_on_the_cpu", "pixel ["),
    },
    Mutation {
        name: "borders of tiles repeat their edge",
        file: "shaders/wgsl/tiles/place.wgsl",
        find: "tile * TEXFOLD_TILE_INNER + at) - border,",
        replace: "tile * TEXFOLD_TILE_INNER + clamp(at, vec2<u32>(4u), vec2<u32>(123u))) - border,",
        test: tiles("tiles::views_equal_filtering_of_decoded_texels_on_the_cpu", "pixel ["),
    },
    Mutation {
        name: "a new texture finds the tiles of the one before it",
        file: "crates/gpu/src/tiles/mod.rs",
        find: "        gpu.queue.write_buffer(&self.buffers.pages, start, &zeros);\n",
        replace: "",
        test: tiles("tiles::textures_come_and_go_and_take_nothing_with_them", "pixel ["),
    },
    Mutation {
        name: "a pool that is too small keeps its bias",
        file: "shaders/wgsl/entry/tiles_plan.wgsl",
        find: "max(bias - 0.015625, 0.0)",
        replace: "bias",
        test: tiles("tiles::a_pool_that_is_too_small_shows_coarser_levels_until_it_suffices", "assertion"),
    },
    Mutation {
        name: "derivatives measured in texels of the stored size",
        file: "shaders/wgsl/progressive.wgsl",
        find: "texfold_level(dx, dy, texfold_progressive_params.size)",
        replace: "texfold_level(dx, dy, texfold_residual_params.size)",
        test: twin("twins::derivatives_choose_the_level_that_the_cpu_computes"),
    },
    Mutation {
        name: "every base goes on beyond the border",
        file: "shaders/wgsl/progressive.wgsl",
        find: "if texfold_residual_params.base_padding > 0u && address_mode == TEXFOLD_CLAMP {",
        replace: "if address_mode == TEXFOLD_CLAMP {",
        test: twin("twins::pasted_shaders_give_the_texels_of_the_cpu"),
    },
    Mutation {
        // Not here: `if true`. With a side of 0 the last texel wraps around to that of the whole base, which is right.
        name: "block-isolated bases are blended across blocks",
        file: "shaders/wgsl/residual.wgsl",
        find: "        if block > 0u {",
        replace: "        if false {",
        test: twin("twins::pasted_shaders_give_the_texels_of_the_cpu"),
    },
    Mutation {
        name: "bilinear places off by 0.003 texels",
        file: "shaders/wgsl/shared/address.wgsl",
        find: "* vec2<f32>(vec2<i32>(size)) - vec2<f32>(0.5);",
        replace: "* vec2<f32>(vec2<i32>(size)) - vec2<f32>(0.503);",
        test: twin("twins::pasted_shaders_give_the_texels_of_the_cpu"),
    },
    Mutation {
        name: "bilinear weights of 8 bits",
        file: "shaders/wgsl/shared/sample.wgsl",
        find: "    return texfold_mix(upper, lower, weight.y);",
        replace: "    return texfold_mix(upper, lower, round(weight.y * 256.0) / 256.0);",
        test: twin("twins::pasted_shaders_give_the_texels_of_the_cpu"),
    },
    Mutation {
        name: "an epitome with a residual plane alone is read as planes",
        file: "shaders/wgsl/epitome/errors.wgsl",
        find: "let plain = mixed & (plane == 0u);",
        replace: "let plain = plane == 0u;",
        test: twin("twins::pasted_shaders_give_the_texels_of_the_cpu"),
    },
    Mutation {
        name: "interpolated normals are not normalised",
        file: "shaders/wgsl/lightfield.wgsl",
        find: "let normal = smooth_normal / max(length(smooth_normal), 0.000001);",
        replace: "let normal = smooth_normal;",
        test: twin("light::the_shader_gives_what_the_cpu_gives_for_the_same_arguments"),
    },
    Mutation {
        name: "mip levels of blocks are means of values and not of light",
        file: "shaders/wgsl/entry/block_texel.wgsl",
        find: "let is_light = (entry_output.average & 1u) == 1u;",
        replace: "let is_light = false;",
        test: blocks("dct::mip_levels_equal_those_of_the_cpu"),
    },
    Mutation {
        name: "products of means around a block are not rounded",
        file: "shaders/wgsl/block.wgsl",
        find: "    return (value * weight + 128) >> 8u;",
        replace: "    return (value * weight) >> 8u;",
        test: blocks("dct::images_equal_those_of_the_cpu"),
    },
    Mutation {
        name: "magnitudes of the block before count",
        file: "shaders/wgsl/block.wgsl",
        find: "max(texfold_block_held[own + 20u], zero)",
        replace: "texfold_block_held[own + 20u]",
        test: blocks("dct::images_equal_those_of_the_cpu"),
    },
    Mutation {
        name: "a workgroup reads streams of two tiles",
        file: "shaders/wgsl/entry/tiles_plan.wgsl",
        find: "superblocks += streams - streams % ENTRY_STREAMS;",
        replace: "superblocks += streams + 1u - ENTRY_STREAMS;",
        test: tiles("tiles::views_equal_filtering_of_decoded_texels_on_the_cpu", "pixel ["),
    },
];

/// Arguments of `mutate`.
#[derive(Debug, clap::Args)]
pub(crate) struct MutateArgs {
    /// Only mutations whose name or file holds this text.
    #[arg(default_value = "")]
    only: String,
}

/// Runs the command.
pub(crate) fn run(args: &MutateArgs) -> ExitCode {
    let chosen: Vec<&Mutation> = MUTATIONS
        .iter()
        .filter(|mutation| mutation.name.contains(&args.only) || mutation.file.contains(&args.only))
        .collect();
    match all_red(&chosen) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Whether every mutation makes its test fail.
fn all_red(mutations: &[&Mutation]) -> io::Result<bool> {
    let tree = Tree::copy()?;
    for mutation in mutations {
        tree.mutated(mutation)?;
    }
    let tests: HashSet<Test> = mutations.iter().map(|mutation| mutation.test).collect();
    for test in tests {
        let output = tree.test(test)?;
        if !output.status.success() {
            eprint!("{}", String::from_utf8_lossy(&output.stdout));
            return Err(io::Error::other(format!(
                "{} fails without a mutation; repair it first",
                test.function
            )));
        }
    }
    let mut rows = Vec::new();
    for mutation in mutations {
        let start = Instant::now();
        let text = tree.mutated(mutation)?;
        let place = tree.path.join(mutation.file);
        let before = fs::read(&place)?;
        fs::write(&place, text)?;
        let output = tree.test(mutation.test);
        fs::write(&place, before)?;
        let output = output?;
        let failed =
            !output.status.success() && String::from_utf8_lossy(&output.stdout).contains(mutation.test.says);
        let verdict = if failed { "red" } else { "SURVIVED" };
        println!("mutate: {} ... {verdict} in {:.0} s", mutation.name, start.elapsed().as_secs_f64());
        rows.push((mutation, failed));
    }
    println!("\n{:<9} {:<52} test", "result", "mutation");
    for (mutation, failed) in &rows {
        let verdict = if *failed { "red" } else { "SURVIVED" };
        println!("{verdict:<9} {:<52} {}", mutation.name, mutation.test.function);
    }
    Ok(rows.iter().all(|(_, failed)| *failed))
}

/// A copy of the workspace.
struct Tree {
    path: PathBuf,
    target: PathBuf,
}

impl Tree {
    /// Brings the copy up to date: files that are the same keep their times, and what was built of them.
    fn copy() -> io::Result<Tree> {
        let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
        let tree = Tree { path: root().join("target").join("mutate"), target };
        let list = Command::new("git")
            .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
            .current_dir(root())
            .output()?;
        if !list.status.success() {
            return Err(io::Error::other("git cannot list the files of the workspace; run in a checkout"));
        }
        let names: HashSet<PathBuf> = String::from_utf8_lossy(&list.stdout)
            .split('\0')
            .map(PathBuf::from)
            .filter(|name| root().join(name).is_file())
            .collect();
        for name in &names {
            let (from, to) = (root().join(name), tree.path.join(name));
            let text = fs::read(&from)?;
            if fs::read(&to).ok().as_ref() != Some(&text) {
                fs::create_dir_all(to.parent().unwrap_or(&tree.path))?;
                fs::write(&to, text)?;
            }
        }
        remove_others(&tree.path, &tree.path, &names)?;
        Ok(tree)
    }

    /// The text of a mutation's file with the mutation made.
    fn mutated(&self, mutation: &Mutation) -> io::Result<String> {
        let text = fs::read_to_string(self.path.join(mutation.file))?;
        match text.matches(mutation.find).count() {
            1 => Ok(text.replace(mutation.find, mutation.replace)),
            count => Err(io::Error::other(format!(
                "{}: found {count} times, not once: {:?}; bring the mutation \"{}\" up to date",
                mutation.file, mutation.find, mutation.name
            ))),
        }
    }

    /// Runs one test; an error where it cannot be compiled.
    fn test(&self, test: Test) -> io::Result<Output> {
        let cargo = |rest: &[&str]| {
            let program = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
            Command::new(program)
                .args(["test", "--quiet", "--package", test.package, "--test", "main"])
                .args(rest)
                .env("CARGO_TARGET_DIR", &self.target)
                .env("TEXFOLD_GPU", "require")
                .current_dir(&self.path)
                .output()
        };
        let built = cargo(&["--no-run"])?;
        if !built.status.success() {
            eprint!("{}", String::from_utf8_lossy(&built.stderr));
            return Err(io::Error::other(format!("tests of {} do not compile", test.package)));
        }
        let output = cargo(&["--", "--exact", test.function])?;
        if String::from_utf8_lossy(&output.stdout).contains("running 0 tests") {
            return Err(io::Error::other(format!("there is no test {} in {}", test.function, test.package)));
        }
        Ok(output)
    }
}

/// Removes the files below `folder` of the copy at `top` that the workspace does not have.
fn remove_others(top: &Path, folder: &Path, names: &HashSet<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            remove_others(top, &path, names)?;
        } else if path.strip_prefix(top).is_ok_and(|name| !names.contains(name))
            && !path.ends_with("Cargo.lock")
        {
            fs::remove_file(&path)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mutation_finds_its_text_once() -> io::Result<()> {
        for mutation in MUTATIONS {
            let found = fs::read_to_string(root().join(mutation.file))?.matches(mutation.find).count();
            assert_eq!(found, 1, "{}: {:?} in {}", mutation.name, mutation.find, mutation.file);
        }
        Ok(())
    }
}

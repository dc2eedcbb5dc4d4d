//! `torment`: runs the program `texfold` where it is killed, finds no space, shares its folder with another or has other numbers of
//! threads. What it leaves behind must be whole, and a further run must give the files of one that nothing disturbed.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Output, Stdio};
use std::time::{Duration, Instant};

use crate::root;
use crate::run::succeeds;

/// Arguments of `torment`.
#[derive(Debug, clap::Args)]
pub(crate) struct TormentArgs {
    /// Runs that are killed, of all commands together.
    #[arg(long, value_name = "N", default_value_t = 40)]
    kills: u32,
    /// Start of the moments at which runs are killed.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// A command, which reads `in` and writes `out`, and how `in` is made from fixtures.
struct Scene {
    name: &'static str,
    arguments: &'static str,
    /// Exit codes of one of two processes that run at a time: a bank refuses the second.
    beside: &'static [i32],
    prepare: fn(&Program, &Path) -> io::Result<()>,
}

const SCENES: [Scene; 5] = [
    Scene {
        name: "compress",
        arguments: "compress in --as image --effort fast --mips --out out",
        beside: &[0],
        prepare: |_, dir| copies(dir, &["facade", "noise", "cutout", "gray", "normal_map", "odd_37x61"]),
    },
    Scene {
        name: "bank add",
        arguments: "bank add in --codec progressive --effort fast --out out",
        beside: &[0, 1],
        prepare: |_, dir| copies(dir, &["facade", "noise", "terrain", "zebra", "cloth"]),
    },
    Scene {
        name: "light field",
        arguments: "compress in/ball --out out",
        beside: &[0],
        prepare: |_, dir| copy_folder(&root().join("fixtures/captures/ball"), &dir.join("ball")),
    },
    Scene {
        name: "zoom stack",
        arguments: "compress in/stack --effort fast --out out",
        beside: &[0],
        prepare: zoom_stack,
    },
    Scene {
        name: "decompress",
        arguments: "decompress in/facade.txf in/noise.txf in/cutout.txf in/gray.txf --to png --out out",
        beside: &[0, 1],
        prepare: |program, dir| {
            copies(&dir.join("images"), &["facade", "noise", "cutout", "gray"])?;
            program.done(dir, "compress images --as image --effort fast --out .")?;
            fs::remove_dir_all(dir.join("images"))
        },
    },
];

/// Names and contents of files.
type Files = BTreeMap<PathBuf, Vec<u8>>;

/// The program, built for release.
struct Program(PathBuf);

impl Program {
    fn command(&self, dir: &Path, arguments: &str) -> Command {
        let mut command = Command::new(&self.0);
        command.args(arguments.split_whitespace()).current_dir(dir).stdin(Stdio::null());
        command
    }

    /// Starts it, without reading what it prints.
    fn start(&self, dir: &Path, arguments: &str) -> io::Result<Child> {
        self.command(dir, arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn()
    }

    /// Runs it, which must succeed.
    fn done(&self, dir: &Path, arguments: &str) -> io::Result<()> {
        succeeded(arguments, &self.command(dir, arguments).output()?)
    }
}

/// Runs the command.
pub(crate) fn run(args: &TormentArgs) -> ExitCode {
    match torment(args.kills, args.seed) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The short form, of full runs of `ci`.
///
/// # Errors
/// The first fault that is found.
pub(crate) fn short() -> io::Result<bool> {
    torment(20, 1).map(|()| true)
}

fn torment(kills: u32, seed: u64) -> io::Result<()> {
    if !succeeds(&["build", "--release", "--package", "texfold-cli"])? {
        return Err(io::Error::other("texfold-cli cannot be built"));
    }
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    let program = Program(target.join("release/texfold"));
    let place = target.join("torment");
    let mut random = seed;
    for (scene, number) in SCENES.iter().zip(0..) {
        let share = kills / SCENES.len() as u32 + u32::from(number < kills % SCENES.len() as u32);
        let dir = place.join(scene.name.replace(' ', "-"));
        let trial = Trial::new(&program, scene, &dir)?;
        trial.threads()?;
        trial.two_at_a_time()?;
        let full = trial.full_disks()?;
        let systems = trial.full_systems()?;
        let systems = systems.map_or("no file system could be mounted".to_owned(), |count| {
            format!("{count} times on full file systems")
        });
        let cut = (0..share).try_fold(0, |cut, _| Ok::<_, io::Error>(cut + trial.kill(&mut random)?))?;
        println!(
            "{}: {} files, the same with 1 to 7 threads and beside another process; {full} times with files cut short; {systems}; \
             {share} times killed, {cut} of these before the end",
            scene.name,
            trial.wanted.len()
        );
    }
    fs::remove_dir_all(place)
}

/// A scene with what an undisturbed run gives.
struct Trial<'t> {
    program: &'t Program,
    scene: &'t Scene,
    dir: &'t Path,
    wanted: Files,
    time: Duration,
}

impl<'t> Trial<'t> {
    fn new(program: &'t Program, scene: &'t Scene, dir: &'t Path) -> io::Result<Trial<'t>> {
        remove(dir)?;
        fs::create_dir_all(dir.join("in"))?;
        (scene.prepare)(program, &dir.join("in"))?;
        let start = Instant::now();
        program.done(dir, scene.arguments)?;
        let time = start.elapsed();
        let wanted = files(&dir.join("out"))?;
        if wanted.is_empty() {
            return Err(io::Error::other(format!("{}: nothing was written", scene.name)));
        }
        Ok(Trial { program, scene, dir, wanted, time })
    }

    fn fault(&self, what: &str) -> io::Error {
        io::Error::other(format!("{}: {what}; see {}", self.scene.name, self.dir.display()))
    }

    fn clear(&self) -> io::Result<()> {
        remove(&self.dir.join("out"))
    }

    /// Files under final names are whole, whatever has happened. `bank.json` lists fewer images before the end.
    fn check_whole(&self) -> io::Result<()> {
        let odd = |(name, bytes): (&PathBuf, &Vec<u8>)| {
            let is_final = !hidden(name) && name.as_path() != Path::new("bank.json");
            is_final && self.wanted.get(name) != Some(bytes)
        };
        let found = files(&self.dir.join("out"))?;
        match found.iter().find(|file| odd(*file)) {
            Some((name, _)) => Err(self.fault(&format!("{} is not whole", name.display()))),
            None => Ok(()),
        }
    }

    /// A further run gives what an undisturbed one gives, and takes away what was left.
    fn check_rerun(&self) -> io::Result<()> {
        // Decompressed files are overwritten where that is asked for.
        let force = if self.scene.arguments.starts_with("decompress") { " --force" } else { "" };
        self.program.done(self.dir, &format!("{}{force}", self.scene.arguments))?;
        if files(&self.dir.join("out"))? == self.wanted {
            Ok(())
        } else {
            Err(self.fault("a further run gave other files"))
        }
    }

    fn threads(&self) -> io::Result<()> {
        for threads in 1..=7 {
            self.clear()?;
            let mut command = self.program.command(self.dir, self.scene.arguments);
            let output = command.env("RAYON_NUM_THREADS", threads.to_string()).output()?;
            succeeded(self.scene.arguments, &output)?;
            if files(&self.dir.join("out"))? != self.wanted {
                return Err(self.fault(&format!("{threads} threads gave other files")));
            }
        }
        Ok(())
    }

    fn two_at_a_time(&self) -> io::Result<()> {
        self.clear()?;
        let start = || self.program.start(self.dir, self.scene.arguments);
        let (mut one, mut other) = (start()?, start()?);
        for code in [one.wait()?.code(), other.wait()?.code()] {
            if !code.is_some_and(|code| self.scene.beside.contains(&code)) {
                return Err(self.fault(&format!("one of two processes ended with {code:?}")));
            }
        }
        self.check_whole()?;
        self.check_rerun()
    }

    /// Runs it where files may have up to that many blocks, from none on by ever larger steps, until a run succeeds; the number of runs
    /// that failed.
    fn full_disks(&self) -> io::Result<u32> {
        self.without_space(0, |blocks| format!("trap '' XFSZ; ulimit -f {blocks}; {}", self.line()))
    }

    /// Runs it on file systems of ever more blocks; `None` where none can be mounted.
    fn full_systems(&self) -> io::Result<Option<u32>> {
        let unshared = ["--user", "--map-root-user", "--mount", "sh", "-c"];
        let tried = Command::new("unshare").args(unshared).arg("mount -t tmpfs none /mnt").output();
        if !tried.is_ok_and(|output| output.status.success()) {
            return Ok(None);
        }
        // What is in it is copied before the file system goes.
        let inside = |blocks| {
            format!(
                "mkdir out && unshare {} \"mount -t tmpfs -o size={blocks}k none out || exit 9; {}; code=\\$?; \
                 mkdir copy && cp -a out/. copy && exit \\$code\"; code=$?; rm -r out; mv copy out; exit $code",
                unshared.join(" "),
                self.line()
            )
        };
        // One of no blocks has no bounds.
        self.without_space(1, inside).map(Some)
    }

    /// The command, for a shell.
    fn line(&self) -> String {
        format!("'{}' {}", self.program.0.display(), self.scene.arguments)
    }

    fn without_space(&self, first: u32, script: impl Fn(u32) -> String) -> io::Result<u32> {
        let mut failed = 0;
        for blocks in (first..4).chain((2..24).map(|step| 1 << step)) {
            self.clear()?;
            let output = Command::new("sh").args(["-c", &script(blocks)]).current_dir(self.dir).output()?;
            self.check_whole()?;
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            match output.status.code() {
                Some(0) => break,
                Some(1) if told.contains("error:") && !told.contains("panicked") => failed += 1,
                code => return Err(self.fault(&format!("without space it ended with {code:?}: {told}"))),
            }
        }
        self.check_rerun()?;
        Ok(failed)
    }

    /// Kills a run at a random moment; 1 where it had not ended.
    fn kill(&self, random: &mut u64) -> io::Result<u32> {
        self.clear()?;
        let mut child = self.program.start(self.dir, self.scene.arguments)?;
        std::thread::sleep(self.time.mul_f64(fraction(random)));
        child.kill()?;
        let was_cut = child.wait()?.code().is_none();
        self.check_whole()?;
        self.check_rerun()?;
        Ok(u32::from(was_cut))
    }
}

/// An error with what a run has printed where it did not succeed.
fn succeeded(arguments: &str, output: &Output) -> io::Result<()> {
    if output.status.success() {
        return Ok(());
    }
    Err(io::Error::other(format!("texfold {arguments}: {}", String::from_utf8_lossy(&output.stderr))))
}

/// A number from 0 to 1, by a linear congruential generator.
fn fraction(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

/// True for files that begin with a point: the cache of a folder, and what is not finished.
fn hidden(name: &Path) -> bool {
    name.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

/// Files of a folder and of those in it, with what depends on the clock left out: of the cache all but that it is there.
fn files(dir: &Path) -> io::Result<Files> {
    let mut found = Files::new();
    // None of a folder that is not there.
    let mut open: Vec<PathBuf> = dir.exists().then(|| dir.to_owned()).into_iter().collect();
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.is_dir() {
                open.push(path);
                continue;
            }
            let name = path.strip_prefix(dir).unwrap_or(&path).to_owned();
            let bytes = match name.to_str() {
                Some(".texfold-cache.jsonl") => Vec::new(),
                Some("bank.json") => timeless(&fs::read_to_string(&path)?).into_bytes(),
                _ => fs::read(&path)?,
            };
            found.insert(name, bytes);
        }
    }
    Ok(found)
}

/// Removes a folder, which may not be there.
fn remove(dir: &Path) -> io::Result<()> {
    if dir.exists() { fs::remove_dir_all(dir) } else { Ok(()) }
}

/// JSON without the values of members that depend on the clock or on the memory that a process has taken.
fn timeless(text: &str) -> String {
    let mut text = text.to_owned();
    for member in ["\"encode_seconds\":", "\"encode_texels_per_second\":", "\"peak_bytes\":"] {
        let parts: Vec<&str> = text.split(member).collect();
        let rest = parts[1..].iter().map(|part| part.split_once([',', '}']).map_or("", |(_, rest)| rest));
        text = std::iter::once(parts[0]).chain(rest).collect::<Vec<_>>().join(member);
    }
    text
}

/// Copies fixtures into a folder.
fn copies(dir: &Path, names: &[&str]) -> io::Result<()> {
    fs::create_dir_all(dir)?;
    for name in names {
        let file = format!("{name}.png");
        fs::copy(root().join("fixtures/images").join(&file), dir.join(&file))?;
    }
    Ok(())
}

fn copy_folder(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let path = entry?.path();
        let target = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            copy_folder(&path, &target)?;
        } else {
            fs::copy(&path, &target)?;
        }
    }
    Ok(())
}

/// A fixture at half its size, and the middle of it at its own.
fn zoom_stack(program: &Program, dir: &Path) -> io::Result<()> {
    let stack = dir.join("stack");
    copies(&stack, &["terrain"])?;
    program.done(&stack, "compress terrain.png --codec dct --psnr 50 --mips --out made")?;
    program.done(&stack, "decompress made/terrain.txf --level 1 --to png --out root")?;
    program.done(&stack, "decompress made/terrain.txf --region 64,64,128,128 --to png --out near")?;
    for (folder, name) in [("root", "root.png"), ("near", "near.png")] {
        let made = fs::read_dir(stack.join(folder))?.next();
        let made = made.ok_or_else(|| io::Error::other("decompress wrote nothing"))??.path();
        fs::rename(made, stack.join(name))?;
        fs::remove_dir_all(stack.join(folder))?;
    }
    fs::remove_dir_all(stack.join("made"))?;
    fs::remove_file(stack.join("terrain.png"))?;
    fs::write(stack.join("zipmap.toml"), "root = 'root.png'\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_the_clock_are_left_out() {
        let text = "{\"a\":1,\"encode_seconds\":0.25,\"peak_bytes\":9},{\"encode_seconds\":3}";
        assert_eq!(timeless(text), "{\"a\":1,\"encode_seconds\":\"peak_bytes\":,{\"encode_seconds\":");
        assert_eq!(timeless("{\"b\":2}"), "{\"b\":2}");
    }

    #[test]
    fn moments_are_spread_over_the_whole_run() {
        let mut state = 1;
        let found: Vec<f64> = (0..100).map(|_| fraction(&mut state)).collect();
        assert!(found.iter().all(|&at| (0.0..1.0).contains(&at)));
        assert!(found.iter().any(|&at| at < 0.1) && found.iter().any(|&at| at > 0.9));
    }
}

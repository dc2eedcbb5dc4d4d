//! Configuration files.

use std::io;
use std::path::{Path, PathBuf};

use super::options::{Options, RunOptions};
use crate::error::UsageError;
use crate::files;

/// A configuration file.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Config {
    pub(crate) run: RunOptions,
    top: Options,
    rules: Vec<(glob::Pattern, Options)>,
}

/// Keys at the top of a configuration that speak of the whole run.
const RUN_KEYS: [&str; 6] = ["jobs", "memory", "report", "force", "strict", "outside"];

impl Config {
    /// Reads a configuration. Paths in it are relative to its folder.
    pub(crate) fn read(path: &Path) -> Result<Config, UsageError> {
        let text = files::open(path)
            .and_then(io::read_to_string)
            .map_err(|source| UsageError::ConfigRead { path: path.to_owned(), source })?;
        Config::parse(&text, path)
    }

    pub(super) fn parse(text: &str, path: &Path) -> Result<Config, UsageError> {
        let syntax = |source| UsageError::ConfigSyntax { path: path.to_owned(), source };
        let mut top: toml::Table = text.parse().map_err(syntax)?;
        let rules: Vec<toml::Table> = match top.remove("rule") {
            Some(rules) => rules.try_into().map_err(syntax)?,
            None => Vec::new(),
        };
        let run: toml::Table =
            RUN_KEYS.iter().filter_map(|&key| Some((key.to_owned(), top.remove(key)?))).collect();
        let mut config = Config { run: run.try_into().map_err(syntax)?, ..Config::default() };
        config.top = options(top, path)?;
        for (index, mut rule) in rules.into_iter().enumerate() {
            let Some(toml::Value::String(glob)) = rule.remove("glob") else {
                return Err(UsageError::RuleWithoutGlob { path: path.to_owned(), index: index + 1 });
            };
            let pattern = glob::Pattern::new(&glob).map_err(|source| UsageError::RuleGlob {
                path: path.to_owned(),
                glob: glob.clone(),
                source,
            })?;
            config.rules.push((pattern, options(rule, path)?));
        }
        config.run.report = config.run.report.map(|report| beside(path, &report));
        Ok(config)
    }

    /// The options for the input at `path`: of the last rule that matches, then of those before it, then the top's.
    ///
    /// A glob with a slash is held against the whole path, one without against the file name.
    pub(crate) fn options(&self, path: &Path) -> Options {
        let name = path.file_name().map(Path::new).unwrap_or(path);
        let matches = |pattern: &glob::Pattern| {
            pattern.matches_path(if pattern.as_str().contains('/') { path } else { name })
        };
        let matching = self.rules.iter().rev().filter(|(pattern, _)| matches(pattern));
        matching.fold(Options::default(), |found, (_, options)| found.or(options)).or(&self.top)
    }
}

fn options(table: toml::Table, path: &Path) -> Result<Options, UsageError> {
    let mut options: Options =
        table.try_into().map_err(|source| UsageError::ConfigSyntax { path: path.to_owned(), source })?;
    let goals = [options.psnr, options.bpp, options.tolerance, options.degrees];
    if goals.iter().flatten().count() > 1 {
        return Err(UsageError::TwoGoals { path: path.to_owned() });
    }
    for file in
        [&mut options.content_from, &mut options.importance_map, &mut options.mesh].into_iter().flatten()
    {
        *file = beside(path, file);
    }
    Ok(options)
}

/// `file` as seen from the folder of `config`.
fn beside(config: &Path, file: &Path) -> PathBuf {
    config.parent().unwrap_or(Path::new("")).join(file)
}

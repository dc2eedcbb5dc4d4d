//! Options of `compress`: from the command line, and per glob from a configuration file.
//!
//! A value is looked for on the command line, then in the last rule whose glob matches, then at the top of the
//! configuration. The three goals count as one value: a goal on the command line replaces whatever the
//! configuration says of goals.

mod file;
mod names;
mod options;
mod values;

pub(crate) use file::Config;
pub(crate) use names::MapName;
pub use options::{Options, RunOptions};
pub(crate) use values::Weights;
pub use values::{AlphaChoice, CodecName, ColorName, ContentName, EffortName, Samples, Sides};

#[cfg(test)]
mod tests {
    use std::path::Path;

    use texfold_core::image::Alpha;

    use super::*;
    use crate::error::{CliError, UsageError};

    fn parse(text: &str) -> Result<Config, UsageError> {
        Config::parse(text, Path::new("etc/batch.toml"))
    }

    #[test]
    fn later_rules_win_and_the_command_line_wins_over_all() {
        let config = parse(
            "effort = 'fast'\npsnr = 30.0\n[[rule]]\nglob = '*.png'\nbpp = 2.0\ncodec = 'vq'\n\
             [[rule]]\nglob = 'wall*'\ncodec = 'bc'\nmesh = 'wall.obj'\n",
        )
        .unwrap();
        let wall = config.options(Path::new("in/wall.png"));
        assert_eq!(
            (wall.codec, wall.bpp, wall.psnr),
            (Some(CodecName::of::<texfold::bc::Bc>()), Some(2.0), None)
        );
        assert_eq!((wall.effort, wall.mesh.clone()), (Some(EffortName::Fast), Some("etc/wall.obj".into())));
        let photo = config.options(Path::new("in/photo.jpg"));
        assert_eq!((photo.codec, photo.bpp, photo.psnr), (None, None, Some(30.0)));
        let given = Options { tolerance: Some(5.0), ..Options::default() };
        let both = given.or(&wall);
        assert_eq!(
            (both.bpp, both.tolerance, both.codec),
            (None, Some(5.0), Some(CodecName::of::<texfold::bc::Bc>()))
        );
    }

    #[test]
    fn mistakes_are_named() {
        assert!(matches!(parse("pnsr = 3.0"), Err(UsageError::ConfigSyntax { .. })));
        assert!(matches!(parse("[[rule]]\nbpp = 3.0"), Err(UsageError::RuleWithoutGlob { index: 1, .. })));
        assert!(matches!(parse("[[rule]]\nglob = '*'\njobs = 3"), Err(UsageError::ConfigSyntax { .. })));
        assert!(matches!(parse("psnr = 3.0\nbpp = 1.0"), Err(UsageError::TwoGoals { .. })));
        assert!(matches!(parse("[[rule]]\nglob = '[a'"), Err(UsageError::RuleGlob { .. })));
        assert!(matches!(parse("codebook = '12'"), Err(UsageError::ConfigSyntax { .. })));
    }

    #[test]
    fn options_of_other_codecs_are_refused() {
        let terms = Options { terms: Some(3), ..Options::default() };
        assert!(matches!(terms.check(), Err(UsageError::NotForCodec { option: "terms", .. })));
        let later = Options { codec: Some(CodecName::of::<texfold::lightfield::Lightfield>()), ..terms };
        assert!(later.check().is_ok());
        assert!(matches!(later.resolve(Path::new("a.png")), Err(CliError::NotCapture { .. })));
        let bc = Options {
            codec: Some(CodecName::of::<texfold::bc::Bc>()),
            samples: Some(Samples(3, None)),
            ..Options::default()
        };
        assert!(matches!(bc.check(), Err(UsageError::NotForCodec { option: "samples", .. })));
        let masked = Options { content_from: Some("mask.png".into()), ..Options::default() };
        assert!(matches!(masked.check(), Err(UsageError::NotForCodec { option: "content-from", .. })));
        let masked = Options { codec: Some(CodecName::of::<texfold::epitome::Epitome>()), ..masked };
        assert!(masked.check().is_ok());
        let settings = masked.resolve(Path::new("a.png")).unwrap();
        assert_eq!(settings.content_from.as_deref(), Some(Path::new("mask.png")));
        let sampled = Options { codec: Some(CodecName::of::<texfold::epitome::Epitome>()), ..bc };
        assert!(matches!(sampled.check(), Err(UsageError::NotForCodec { option: "samples", .. })));
        let odd = Options { codebook: Some(Sides(130, 128)), ..Options::default() };
        assert!(matches!(odd.check(), Err(UsageError::Range { option: "codebook", .. })));
    }

    #[test]
    fn values_are_read_as_written() {
        assert_eq!("cutout=0.25".parse(), Ok(AlphaChoice(Alpha::Cutout(0.25))));
        assert!("cutout=1.5".parse::<AlphaChoice>().is_err());
        assert_eq!("256x128".parse(), Ok(Sides(256, 128)));
        assert_eq!("6x64".parse(), Ok(Samples(6, Some(64))));
        let options = Options { samples: Some(Samples(8, None)), ..Options::default() };
        assert_eq!(options.samples(), Some((8, 64)));
    }
}

//! What to encode for, whatever the codec; the codec's own parameters enter as their own type.

use std::any::Any;
use std::fmt::Debug;
use std::str::FromStr;
use std::sync::Arc;

use texfold_bc::{Bc1Blocks, Content, Family};
use texfold_core::image::Raster;
use texfold_core::mesh::UvMesh;
use texfold_core::{Access, CodecId, Effort, Goal, Metric, NameError, ParamError, TextureCodec};

use super::{ENCODINGS, Encoding, ImageEncoder};

/// What to encode for, whatever the codec.
#[derive(Debug, Clone, Default)]
pub struct EncodeSettings {
    /// Which codec, and its own parameters where they are not the usual ones.
    pub codec: Choice,
    /// What to reach.
    pub goal: Goal,
    /// How content planes are stored; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Formats that the goal may decide among where there is no `content`.
    pub family: Family,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
    /// How texels are reached, where a codec has both ways; `None` is the codec's own usual way.
    pub access: Option<Access>,
    /// Which errors count, where a codec can weigh them; `None` lets pixels and goal decide.
    pub metric: Option<Metric>,
    /// True to keep the named codec where plain blocks meet the goal better; without effect for a choice among all codecs.
    pub keeps_codec: bool,
}

impl EncodeSettings {
    /// The codec's own parameters with these settings: goal, content, mips and effort are these.
    #[must_use]
    pub fn params<C: ImageEncoder>(&self) -> C::Params {
        C::with_settings(self.codec.own::<C>().unwrap_or_default(), self)
    }

    /// Checks the settings for the codec that they name ([`Encoding::check`]); a choice among all codecs takes those that suit.
    ///
    /// # Errors
    /// [`ParamError`] names the setting, and what it may be.
    pub fn check(&self) -> Result<(), ParamError> {
        self.codec.encoding().map_or_else(|| self.goal.check(), |encoding| encoding.check(self))
    }

    /// About how many bytes for each texel of the source encoding takes at its peak, the source included. What a choice among all
    /// codecs seldom tries counts only where nothing else suits.
    #[must_use]
    pub fn bytes_per_texel(&self) -> u64 {
        if let Some(chosen) = self.codec.encoding() {
            return chosen.bytes_per_texel;
        }
        let suited: Vec<&Encoding> =
            ENCODINGS.iter().filter(|encoding| encoding.suits_settings(self)).collect();
        let most = |seldom: bool| {
            let counted = suited.iter().filter(|encoding| encoding.is_seldom_tried == seldom);
            counted.map(|encoding| encoding.bytes_per_texel).max()
        };
        most(false).or(most(true)).unwrap_or(0)
    }
}

/// Parameters of a codec.
pub trait OwnParams: Any + Debug + Send + Sync {}
impl<P: Any + Debug + Send + Sync> OwnParams for P {}

impl FromStr for Choice {
    type Err = NameError;

    /// "auto", or the name of one of [`ENCODINGS`].
    fn from_str(name: &str) -> Result<Choice, NameError> {
        let choice = if name == "auto" { Some(Choice::auto()) } else { Choice::named(name) };
        choice.ok_or_else(|| {
            let known = std::iter::once("auto").chain(ENCODINGS.iter().map(|encoding| encoding.id.name));
            let known = known.collect::<Vec<_>>().join(", ");
            NameError { setting: "codec", found: name.to_owned(), known }
        })
    }
}

/// Which codec to use for images: one, or the one that answers the goal best.
#[derive(Debug, Clone, Default)]
pub struct Choice {
    codec: Option<CodecId>,
    own: Option<(CodecId, Arc<dyn OwnParams>)>,
}

impl Choice {
    /// The codec that answers the goal best.
    #[must_use]
    pub fn auto() -> Choice {
        Choice::default()
    }

    /// Codec `C` with its usual parameters.
    #[must_use]
    pub fn of<C: ImageEncoder>() -> Choice {
        Choice { codec: Some(C::ID), own: None }
    }

    /// The codec of that name, one of [`ENCODINGS`], with its usual parameters.
    #[must_use]
    pub fn named(name: &str) -> Option<Choice> {
        let encoding = ENCODINGS.iter().find(|encoding| encoding.id.name == name)?;
        Some(Choice { codec: Some(encoding.id), own: None })
    }

    /// The same choice with parameters of codec `C`. A choice among all codecs is then one between `C` and plain block
    /// compression, whichever answers the goal better.
    #[must_use]
    pub fn with<C: ImageEncoder>(self, params: C::Params) -> Choice {
        Choice { own: Some((C::ID, Arc::new(params))), ..self }
    }

    /// The codec, where it is a certain one.
    #[must_use]
    pub fn encoding(&self) -> Option<&'static Encoding> {
        let id = self.codec?;
        ENCODINGS.iter().find(|encoding| encoding.id == id)
    }

    /// Whether it is codec `C` and no other.
    #[must_use]
    pub fn is<C: TextureCodec>(&self) -> bool {
        self.codec == Some(C::ID)
    }

    /// The codec whose own parameters are given.
    pub(crate) fn owner(&self) -> Option<CodecId> {
        self.own.as_ref().map(|(id, _)| *id)
    }

    pub(super) fn own<C: ImageEncoder>(&self) -> Option<C::Params> {
        let (_, own) = self.own.as_ref()?;
        let own: &dyn Any = &**own;
        own.downcast_ref::<C::Params>().cloned()
    }
}

/// Optional maps that tell a codec what matters.
#[derive(Debug, Clone, Copy, Default)]
pub struct Guidance<'s> {
    /// A painted importance image, bright where it matters.
    pub painted: Option<&'s Raster>,
    /// A mesh that the texture is drawn on.
    pub mesh: Option<&'s UvMesh>,
    /// Where content may come from, bright; everything else is made of it. Only codecs that place content elsewhere
    /// follow it.
    pub content_from: Option<&'s Raster>,
    /// The blocks of images that are BC1 already, to be taken over as they are.
    pub blocks: Option<&'s [Bc1Blocks]>,
}

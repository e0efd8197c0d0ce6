//! What rows depend on, apart from their recipes: the data's content and the build.

use std::fmt;

use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};

use crate::data::facts::DataFacts;

/// A build of the program.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Build {
    /// Version of the program.
    pub version: String,
    /// Revision of its sources, where git knew it; ends in `+changes` for a modified working copy.
    pub revision: Option<String>,
    /// Digest of the sources that rows depend on.
    pub sources: String,
}

impl Build {
    /// The running build.
    pub fn this() -> Self {
        let revision = env!("MCL_REVISION");
        Build {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            revision: (!revision.is_empty()).then(|| revision.to_owned()),
            sources: env!("MCL_SOURCES").to_owned(),
        }
    }
}

/// "0.1.0 (b92eb02c0de1, sources 0123456789abcdef)"
impl fmt::Display for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (", self.version)?;
        if let Some(revision) = &self.revision {
            write!(f, "{revision}, ")?;
        }
        write!(f, "sources {})", self.sources)
    }
}

/// The common identity of all rows of a result folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// The build that computed them.
    pub build: Build,
    /// The data that they were computed from.
    pub data: DataFacts,
}

impl Identity {
    /// Checks that rows of another identity may be combined with rows of this one. Revisions may differ as
    /// long as the sources that rows depend on are the same.
    ///
    /// # Errors
    /// The first difference.
    pub fn check_same(&self, other: &Identity) -> Result<()> {
        let (build, data) = (&self.build, &self.data);
        let limit = |data: &DataFacts| data.max_range.map(f64::to_bits);
        if build.version != other.build.version || build.sources != other.build.sources {
            bail!("were computed by build {}, this is build {build}", other.build);
        }
        if data.name != other.data.name {
            bail!(
                "are of data set {:?}, this is {:?}; the name seeds every draw",
                other.data.name,
                data.name
            );
        }
        if data.sha256 != other.data.sha256 {
            bail!(
                "were computed from other data (SHA-256 {}, this has {})",
                other.data.sha256,
                data.sha256
            );
        }
        if limit(data) != limit(&other.data) {
            let described =
                |data: &DataFacts| data.max_range.map_or("none".into(), |m| format!("{m} m"));
            bail!(
                "were computed with max_range {}, this is {}",
                described(&other.data),
                described(data)
            );
        }
        Ok(())
    }
}

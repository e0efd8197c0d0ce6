//! Options for opening data.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::Result;
use mcl_datasets::log::{ReadOptions, ReferencePoses};

use crate::data::reference;

/// Options for reading a log, as far as the user sets them.
#[derive(Debug, Clone, Default)]
pub struct SourceOptions {
    /// Largest reading that counts, in metres.
    pub max_range: Option<f64>,
    /// The source of the reference.
    pub reference: Option<ReferenceSource>,
    /// Options for what the content of a log leaves open; its reference follows from the field above.
    pub read: ReadOptions,
    /// Topic of a bag's point clouds.
    pub cloud_topic: Option<String>,
    /// 2 or 3, overriding the dimensions of a point cloud; 2 drops its heights.
    pub dimensions: Option<usize>,
}

/// The source of a log's reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ReferenceSource {
    /// The log itself.
    Log(ReferencePoses),
    /// A separate file: a TUM file, a bag or a CARMEN log.
    File(PathBuf),
}

/// `auto`, `recorded` and `none`; anything else is the name of a file.
impl FromStr for ReferenceSource {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text.parse() {
            Ok(poses) => ReferenceSource::Log(poses),
            Err(_) => ReferenceSource::File(text.into()),
        })
    }
}

impl SourceOptions {
    /// Options for reading the log; `reference` applies where the user does not choose one.
    ///
    /// # Errors
    /// When the reference is a file that cannot be read.
    pub(crate) fn read_options(&self, reference: ReferencePoses) -> Result<ReadOptions> {
        let mut options = ReadOptions { reference, ..self.read.clone() };
        match &self.reference {
            None => {}
            Some(ReferenceSource::Log(poses)) => options.reference = *poses,
            Some(ReferenceSource::File(path)) => {
                // The topic is one of that file.
                let topic = options.topics.reference.take();
                options.reference_track = Some(reference::read(path, topic.as_deref())?);
            }
        }
        Ok(options)
    }
}

/// The file's name up to its first dot: `intel.gfs.log.gz` is `intel`.
pub fn stem(path: &Path) -> String {
    // The folder of a bag may be given as `.` or `..`, which are not names.
    let absolute = path.canonicalize();
    let path = match path.file_name() {
        Some(_) => path,
        None => absolute.as_deref().unwrap_or(path),
    };
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    match name.split('.').next() {
        Some(stem) if !stem.is_empty() => stem.to_owned(),
        _ => name.into_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files() {
        assert_eq!(stem(Path::new("a/intel.gfs.log.gz")), "intel");
        assert_eq!(stem(Path::new("run7")), "run7");
        assert_eq!(stem(Path::new(".hidden")), ".hidden");
        for unnamed in [".", ".."] {
            let name = stem(Path::new(unnamed));
            assert!(!name.is_empty() && !name.starts_with('.'), "{name}");
        }
    }
}

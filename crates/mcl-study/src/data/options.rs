//! How to read what is opened, and what it is called.

use std::path::Path;

use mcl_datasets::log::{ReadOptions, ReferencePoses, TopicChoice};

/// How to read a log, as far as the user says.
#[derive(Debug, Clone, Default)]
pub struct SourceOptions {
    /// Largest reading that counts, in metres.
    pub max_range: Option<f64>,
    /// Whether the recorded laser poses are ground truth.
    pub reference: Option<ReferencePoses>,
    /// Topics of a bag.
    pub topics: TopicChoice,
    /// Topic of a bag's point clouds.
    pub cloud_topic: Option<String>,
    /// 2 or 3, whatever a point cloud says itself; 2 drops its heights.
    pub dimensions: Option<usize>,
}

impl SourceOptions {
    /// How to read the log, where the user does not say whether there is a reference: `reference`.
    pub(crate) fn read_options(&self, reference: ReferencePoses) -> ReadOptions {
        ReadOptions {
            reference: self.reference.unwrap_or(reference),
            topics: self.topics.clone(),
            ..ReadOptions::default()
        }
    }
}

/// The file's name up to its first dot: `intel.gfs.log.gz` is `intel`.
pub fn stem(path: &Path) -> String {
    // The folder of a bag may be given as `.` or `..`, which name nothing.
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

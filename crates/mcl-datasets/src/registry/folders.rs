use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use super::{DEFINITION_FILE, Dataset, DefinitionError, LogFile, displayed, joined};

/// Name of the folder of definitions and files, in the working directory or above it.
const REGISTRY_FOLDER: &str = "datasets";

/// Environment variable that names a further folder to look for files in.
const DATA_DIR_VARIABLE: &str = "MCL_DATA_DIR";

/// The definitions of this repository: `definitions` is a link to its `datasets/`, which an archive of the crate has as a
/// folder.
const BUILT_IN: [(&str, &str); 11] = [
    ("aces", include_str!("../../definitions/aces/dataset.toml")),
    ("csail", include_str!("../../definitions/csail/dataset.toml")),
    ("freiburg-079", include_str!("../../definitions/freiburg-079/dataset.toml")),
    ("freiburg-101", include_str!("../../definitions/freiburg-101/dataset.toml")),
    ("intel-lab", include_str!("../../definitions/intel-lab/dataset.toml")),
    ("olin-mac", include_str!("../../definitions/olin-mac/dataset.toml")),
    ("orebro", include_str!("../../definitions/orebro/dataset.toml")),
    ("seattle", include_str!("../../definitions/seattle/dataset.toml")),
    ("simulated-office", include_str!("../../definitions/simulated-office/dataset.toml")),
    ("simulated-office-3d", include_str!("../../definitions/simulated-office-3d/dataset.toml")),
    ("small-gicp-target", include_str!("../../definitions/small-gicp-target/dataset.toml")),
];

/// The known data sets, and the folders their files are looked for in.
#[derive(Debug, Clone, PartialEq)]
pub struct Registry {
    datasets: BTreeMap<String, Dataset>,
    /// `<folder>/<name>/<file>` is looked for in this order.
    folders: Vec<PathBuf>,
    /// Index of the folder that fetched files are written to.
    fetch_into: usize,
}

/// Errors of a registry.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegistryError {
    /// A definition is wrong.
    #[error("{}: {source}", path.display())]
    Definition {
        /// The `dataset.toml`, relative to the repository for a built-in one.
        path: PathBuf,
        /// What is wrong with it.
        source: DefinitionError,
    },
    /// A folder or a definition cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The folder or file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// No data set has this name.
    #[error("no data set is named `{name}`; known are: {}", joined(known))]
    UnknownDataset {
        /// The requested name.
        name: String,
        /// The names known, sorted.
        known: Vec<String>,
    },
    /// The file of a data set that is generated in memory was requested.
    #[error("data set `{name}` is simulated: it is made in memory and has no file")]
    NoFile {
        /// Name of the data set.
        name: String,
    },
    /// No file of the data set is on disk.
    #[error(
        "no file of data set `{name}` found: looked in {} for {}; {}",
        displayed(folders),
        joined(file_names),
        how_to_get(name, *has_address)
    )]
    NotFound {
        /// Name of the data set.
        name: String,
        /// The folders searched.
        folders: Vec<PathBuf>,
        /// The file names looked for in each.
        file_names: Vec<String>,
        /// Whether it can be fetched.
        has_address: bool,
    },
}

fn how_to_get(name: &str, has_address: bool) -> String {
    match has_address {
        true => format!("get it with `mcl-eval datasets fetch {name}`"),
        false => "it has no public address, so put it there by hand".to_owned(),
    }
}

impl Registry {
    /// The definitions of this repository alone; their files are looked for in `datasets/` below
    /// the working directory.
    ///
    /// # Errors
    /// [`RegistryError::Definition`], which the tests of this crate rule out.
    pub fn built_in() -> Result<Registry, RegistryError> {
        let mut datasets = BTreeMap::new();
        for (name, text) in BUILT_IN {
            let dataset = Dataset::parse(name, text).map_err(|source| {
                let path = Path::new(REGISTRY_FOLDER).join(name).join(DEFINITION_FILE);
                RegistryError::Definition { path, source }
            })?;
            datasets.insert(name.to_owned(), dataset);
        }
        Ok(Registry { datasets, folders: vec![PathBuf::from(REGISTRY_FOLDER)], fetch_into: 0 })
    }

    /// The registry for a program started here: [`discover`](Registry::discover) from the working directory,
    /// with the folder named by `MCL_DATA_DIR`.
    ///
    /// # Errors
    /// As [`discover`](Registry::discover).
    pub fn from_environment() -> Result<Registry, RegistryError> {
        let start = std::env::current_dir()
            .map_err(|source| RegistryError::Read { path: PathBuf::from("."), source })?;
        let data_dir = std::env::var_os(DATA_DIR_VARIABLE).filter(|value| !value.is_empty());
        Registry::discover(&start, data_dir.map(PathBuf::from).as_deref())
    }

    /// The built-in definitions, overridden by those of the first folder `datasets/` with a
    /// definition in it, looked for in `start` and the folders above it.
    ///
    /// Files are looked for in that folder (or in `start/datasets` when there is none), then in
    /// `data_dir`. Fetched files go into that folder; when there is none, into `data_dir`; when that
    /// is not given either, into `start/datasets`.
    ///
    /// # Errors
    /// [`RegistryError::Read`] and [`RegistryError::Definition`] name the file.
    pub fn discover(start: &Path, data_dir: Option<&Path>) -> Result<Registry, RegistryError> {
        let mut registry = Registry::built_in()?;
        let mut found = None;
        for ancestor in start.ancestors() {
            let folder = ancestor.join(REGISTRY_FOLDER);
            let definitions = definitions_in(&folder)?;
            if !definitions.is_empty() {
                found = Some(folder);
                registry.datasets.extend(definitions);
                break;
            }
        }
        let has_folder = found.is_some();
        registry.folders = vec![found.unwrap_or_else(|| start.join(REGISTRY_FOLDER))];
        if let Some(data_dir) = data_dir {
            registry.folders.push(data_dir.to_owned());
        }
        registry.fetch_into = if has_folder { 0 } else { registry.folders.len() - 1 };
        Ok(registry)
    }

    /// The data sets, sorted by name.
    pub fn datasets(&self) -> impl Iterator<Item = &Dataset> {
        self.datasets.values()
    }

    /// The data set of this name.
    ///
    /// # Errors
    /// [`RegistryError::UnknownDataset`] lists the names that are known.
    pub fn get(&self, name: &str) -> Result<&Dataset, RegistryError> {
        self.datasets.get(name).ok_or_else(|| RegistryError::UnknownDataset {
            name: name.to_owned(),
            known: self.datasets.keys().cloned().collect(),
        })
    }

    /// The file of a data set: the first that exists, folder by folder, name by name
    /// ([`LogFile::known_names`]). Its content is not looked at.
    ///
    /// # Errors
    /// [`RegistryError::NotFound`] says where it was looked for and how to get it;
    /// [`RegistryError::NoFile`] for a simulated data set.
    pub fn locate(&self, dataset: &Dataset) -> Result<PathBuf, RegistryError> {
        let file = dataset
            .log_file()
            .ok_or_else(|| RegistryError::NoFile { name: dataset.name.clone() })?;
        self.present_files(dataset, file).next().map(|(_, path)| path).ok_or_else(|| {
            RegistryError::NotFound {
                name: dataset.name.clone(),
                folders: self.folders.iter().map(|folder| folder.join(&dataset.name)).collect(),
                file_names: file.known_names(),
                has_address: !file.urls.is_empty(),
            }
        })
    }

    /// Every file of a data set on disk, in the order of [`locate`](Registry::locate), and whether
    /// a file fetched now would be found before it.
    pub(super) fn present_files(
        &self,
        dataset: &Dataset,
        file: &LogFile,
    ) -> impl Iterator<Item = (bool, PathBuf)> {
        let names = file.known_names();
        self.folders
            .iter()
            .enumerate()
            .flat_map(move |(index, folder)| {
                let folder = folder.join(&dataset.name);
                let is_later = index > self.fetch_into;
                let names = names.clone();
                names.into_iter().map(move |name| (is_later, folder.join(name)))
            })
            .filter(|(_, path)| path.is_file())
    }

    /// The folder a data set is fetched into.
    pub fn fetch_folder(&self, dataset: &Dataset) -> PathBuf {
        self.folders[self.fetch_into].join(&dataset.name)
    }
}

/// The definitions in a folder; none when the folder does not exist.
fn definitions_in(folder: &Path) -> Result<BTreeMap<String, Dataset>, RegistryError> {
    let read_error = |path: &Path, source| RegistryError::Read { path: path.to_owned(), source };
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error)
            if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) =>
        {
            return Ok(BTreeMap::new());
        }
        Err(source) => return Err(read_error(folder, source)),
    };
    let mut datasets = BTreeMap::new();
    for entry in entries {
        let entry = entry.map_err(|source| read_error(folder, source))?;
        let path = entry.path().join(DEFINITION_FILE);
        if !path.is_file() {
            continue;
        }
        let text = std::fs::read_to_string(&path).map_err(|source| read_error(&path, source))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let dataset = Dataset::parse(&name, &text)
            .map_err(|source| RegistryError::Definition { path, source })?;
        datasets.insert(name, dataset);
    }
    Ok(datasets)
}

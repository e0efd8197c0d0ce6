//! The repository's own definitions, and where a registry and its files are found.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use mcl_datasets::log::ReferencePoses;
use mcl_datasets::registry::{Content, DEFINITION_FILE, Dataset, Origin, Registry, RegistryError};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn names(registry: &Registry) -> Vec<&str> {
    registry.datasets().map(|dataset| dataset.name.as_str()).collect()
}

#[test]
fn every_definition_of_the_repository_is_built_in_as_it_stands() {
    let built_in = Registry::built_in().unwrap();
    let mut on_disk = BTreeSet::new();
    for entry in std::fs::read_dir(repository().join("datasets")).unwrap() {
        let path = entry.unwrap().path();
        let Ok(text) = std::fs::read_to_string(path.join(DEFINITION_FILE)) else { continue };
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let dataset = Dataset::parse(&name, &text).unwrap();
        assert_eq!(built_in.get(&name).unwrap(), &dataset);
        on_disk.insert(name);
    }
    assert_eq!(names(&built_in), on_disk.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(
        names(&built_in),
        [
            "aces",
            "csail",
            "freiburg-079",
            "freiburg-101",
            "intel-lab",
            "olin-mac",
            "orebro",
            "seattle",
            "simulated-office",
            "simulated-office-3d",
            "small-gicp-target"
        ]
    );
}

#[test]
fn the_definitions_agree_with_what_is_known_of_the_logs() {
    let registry = Registry::built_in().unwrap();
    for (name, file, beams) in [
        ("aces", "aces_publicb.gfs.log", 180),
        ("freiburg-079", "fr079-complete.gfs.log", 360),
        ("intel-lab", "intel.gfs.log", 180),
        ("csail", "csail-corrected.log", 361),
        ("freiburg-101", "freiburg-101-corrected.log", 360),
        ("orebro", "orebro-corrected.log", 181),
        ("seattle", "seattle-corrected.log", 361),
    ] {
        let dataset = registry.get(name).unwrap();
        let facts = dataset.facts.unwrap();
        assert_eq!(facts.readings, facts.scans * beams, "{name}");
        assert!(facts.points < facts.readings);
        assert_eq!(dataset.max_range, 10.0);
        assert_eq!(dataset.reference, ReferencePoses::Recorded);
        let log = dataset.log_file().unwrap();
        // A fetched file keeps the name it has at its address.
        assert!(log.urls[0].ends_with(&format!("/{file}.gz")), "{name}");
        assert_eq!(log.name, file);
        assert!(!dataset.terms.is_empty() && !dataset.citation.is_empty(), "{name}");
    }
    let freiburg = registry.get("freiburg-079").unwrap().log_file().unwrap().known_names();
    for name in ["fr079-complete.gfs.log.gz", "freiburg-079-corrected.log.gz"] {
        assert!(freiburg.iter().any(|known| known == name), "{name}");
    }
    let office = registry.get("simulated-office").unwrap();
    assert!(matches!(office.source, Origin::Simulated { .. }));
}

#[test]
#[cfg_attr(not(real_data), ignore = "needs data sets in MCL_DATA_DIR")]
fn the_logs_at_hand_are_known_copies() {
    let data_dir = std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set");
    let nowhere = tempfile::tempdir().unwrap();
    let registry = Registry::discover(nowhere.path(), Some(Path::new(&data_dir))).unwrap();
    let mut known = 0;
    for dataset in registry.datasets() {
        let Some(log) = dataset.log_file() else { continue };
        match registry.locate(dataset) {
            Ok(path) => {
                let content = Content::of_file(&path).unwrap();
                assert!(log.accepts(&content), "{}: {content:?}", path.display());
                known += 1;
            }
            Err(error) => eprintln!("not at hand: {error}"),
        }
    }
    assert!(known > 0, "no data set is in {}", Path::new(&data_dir).display());
}

#[test]
fn an_unknown_name_is_answered_with_the_known_ones() {
    let registry = Registry::built_in().unwrap();
    let message = registry.get("intel").unwrap_err().to_string();
    assert_eq!(
        message,
        "no data set is named `intel`; known are: aces, csail, freiburg-079, freiburg-101, intel-lab, \
         olin-mac, orebro, seattle, simulated-office, simulated-office-3d, small-gicp-target"
    );
}

#[test]
fn a_folder_of_definitions_is_found_from_below_and_overrides_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let below = folder.path().join("some/where/datasets/empty");
    std::fs::create_dir_all(&below).unwrap();
    let datasets = folder.path().join("datasets");
    let text = include_str!("../../../../datasets/aces/dataset.toml");
    for (name, text) in [("aces", text.replace("ACES", "our ACES")), ("mine", text.to_owned())] {
        std::fs::create_dir_all(datasets.join(name)).unwrap();
        std::fs::write(datasets.join(name).join(DEFINITION_FILE), text).unwrap();
    }
    let registry = Registry::discover(&below, None).unwrap();
    assert_eq!(
        names(&registry),
        [
            "aces",
            "csail",
            "freiburg-079",
            "freiburg-101",
            "intel-lab",
            "mine",
            "olin-mac",
            "orebro",
            "seattle",
            "simulated-office",
            "simulated-office-3d",
            "small-gicp-target"
        ]
    );
    assert!(registry.get("aces").unwrap().title.starts_with("our ACES"));
    assert_eq!(registry.fetch_folder(registry.get("mine").unwrap()), datasets.join("mine"));

    std::fs::write(datasets.join("mine").join(DEFINITION_FILE), "titel = 'x'").unwrap();
    let error = Registry::discover(&below, None).unwrap_err();
    assert!(matches!(error, RegistryError::Definition { .. }));
    let message = error.to_string();
    assert!(message.contains("mine") && message.contains("unknown field `titel`"), "{message}");
}

#[test]
fn a_missing_file_says_where_it_was_looked_for_and_how_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let data_dir = folder.path().join("shared");
    let registry = Registry::discover(folder.path(), Some(&data_dir)).unwrap();
    let freiburg = registry.get("freiburg-079").unwrap();
    let message = registry.locate(freiburg).unwrap_err().to_string();
    for expected in [
        folder.path().join("datasets/freiburg-079").to_str().unwrap(),
        data_dir.join("freiburg-079").to_str().unwrap(),
        "fr079-complete.gfs.log.gz",
        "freiburg-079-corrected.log,",
        "`mcl-eval datasets fetch freiburg-079`",
    ] {
        assert!(message.contains(expected), "{expected}: {message}");
    }
    let office = registry.get("simulated-office").unwrap();
    assert!(matches!(registry.locate(office), Err(RegistryError::NoFile { .. })));
}

#[test]
fn without_a_folder_of_definitions_files_are_fetched_into_the_data_folder() {
    let folder = tempfile::tempdir().unwrap();
    let aces = |registry: &Registry| registry.fetch_folder(registry.get("aces").unwrap());
    let data_dir = folder.path().join("shared");
    let registry = Registry::discover(folder.path(), Some(&data_dir)).unwrap();
    assert_eq!(aces(&registry), data_dir.join("aces"));
    let registry = Registry::discover(folder.path(), None).unwrap();
    assert_eq!(aces(&registry), folder.path().join("datasets/aces"));
}

#[test]
fn the_folder_of_definitions_comes_before_the_data_folder() {
    let folder = tempfile::tempdir().unwrap();
    let data_dir = folder.path().join("shared");
    let registry = Registry::discover(folder.path(), Some(&data_dir)).unwrap();
    let aces = registry.get("aces").unwrap();
    for path in [
        data_dir.join("aces/aces-corrected.log.gz"),
        data_dir.join("aces/aces_publicb.gfs.log"),
        folder.path().join("datasets/aces/aces-corrected.log"),
        folder.path().join("datasets/aces/aces_publicb.gfs.log.gz"),
    ] {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, "").unwrap();
        // Each of these is found before those put down earlier.
        assert_eq!(registry.locate(aces).unwrap(), path);
    }
}

//! A small laser log, and experiments on it as a user runs them.

// Each test program uses a part of this.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Localization with 20 trials.
pub const LOCALIZATION: &str = r#"
    kind = "localization"
    seed = 3
    runs = 4
    maps = 2
    splits = ["same", "held-out"]
    sizes = [5, 20]
    odometry_noise = { xy = 0.01, theta = 0.01 }
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 50
    filter = { particles = 50, beams = 30 }
    figures = { trajectory = 5 }
"#;

/// A folder with the first scans of the simulated office as `office.log`, and experiments by name.
pub struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// Of 40 scans.
    pub fn new(experiments: &[(&str, &str)]) -> Self {
        Self::with_scans(40, experiments)
    }

    pub fn with_scans(scans: usize, experiments: &[(&str, &str)]) -> Self {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        bench.mcl_eval(&["simulate", "-o", "whole.log"]);
        let whole = fs::read_to_string(bench.path("whole.log")).unwrap();
        // Comment and parameter lines, then each scan with its two odometry lines.
        let head = whole.lines().position(|line| line.starts_with("FLASER")).unwrap();
        let lines: Vec<&str> = whole.lines().take(head + 3 * scans).collect();
        fs::write(bench.path("office.log"), lines.join("\n") + "\n").unwrap();
        for (name, definition) in experiments {
            fs::write(bench.path(&format!("{name}.toml")), definition).unwrap();
        }
        bench
    }

    /// A file of this name.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program, to be run in the folder.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        command.args(arguments).current_dir(self.folder.path());
        command
    }

    /// Runs the program in the folder.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs a command that has to succeed, and returns its stdout.
    #[track_caller]
    pub fn mcl_eval(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs an experiment, which has to succeed, and returns its result folder.
    #[track_caller]
    pub fn experiment(&self, name: &str, root: &str, more: &[&str]) -> PathBuf {
        let definition = format!("{name}.toml");
        let mut arguments = vec!["run", &definition, "--dataset", "office.log", "-o", root];
        arguments.extend(more);
        self.mcl_eval(&arguments);
        self.path(root).join(name).join("office")
    }

    /// Runs an experiment on one thread, on two, and again after its rows were cut off in the middle, which has
    /// to give the same bytes, and returns its result folder.
    #[track_caller]
    pub fn reproduced(&self, name: &str) -> PathBuf {
        let one = self.experiment(name, "one", &["--threads", "1"]);
        let two = self.experiment(name, "two", &["--threads", "2"]);
        assert_same(&two, &one);
        let path = two.join("trials.csv");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() / 3]).unwrap();
        self.experiment(name, "two", &["--threads", "2"]);
        assert_same(&two, &one);
        one
    }
}

/// What is in the files of a result folder that are the same bytes for every run, by path.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let relative = path.strip_prefix(folder).unwrap().to_owned();
            if path.is_dir() {
                folders.push(path);
            } else if relative != Path::new("timings.csv") && relative != Path::new(".lock") {
                found.insert(relative, fs::read(path).unwrap());
            }
        }
    }
    found
}

/// Asserts that two result folders hold the same files with the same bytes.
#[track_caller]
pub fn assert_same(found: &Path, expected: &Path) {
    let (found, expected) = (contents(found), contents(expected));
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (path, bytes) in &expected {
        assert!(found[path] == *bytes, "{} differs", path.display());
    }
}
